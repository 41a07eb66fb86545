//! Source text as a flat sequence of Rust tokens, including macro bodies, without comments.

use proc_macro2::{Delimiter, TokenStream, TokenTree};

use super::{Source, Violation};

/// A token with its line. Groups appear as their brackets.
pub struct Token {
    pub text: String,
    pub line: usize,
    pub is_literal: bool,
}

pub fn tokens(source: &Source) -> Result<Vec<Token>, Violation> {
    let stream: TokenStream =
        source.text.parse().map_err(|error| source.violation(1, format!("not Rust: {error}")))?;
    let mut flat = Vec::new();
    flatten(stream, &mut flat);
    Ok(flat)
}

fn flatten(stream: TokenStream, flat: &mut Vec<Token>) {
    for tree in stream {
        let line = tree.span().start().line;
        match tree {
            TokenTree::Group(group) => {
                let (open, close) = match group.delimiter() {
                    Delimiter::Parenthesis => ("(", ")"),
                    Delimiter::Brace => ("{", "}"),
                    Delimiter::Bracket => ("[", "]"),
                    Delimiter::None => ("", ""),
                };
                flat.push(Token { text: open.into(), line, is_literal: false });
                flatten(group.stream(), flat);
                let line = group.span_close().start().line;
                flat.push(Token { text: close.into(), line, is_literal: false });
            }
            TokenTree::Literal(literal) => {
                flat.push(Token { text: literal.to_string(), line, is_literal: true });
            }
            other => flat.push(Token { text: other.to_string(), line, is_literal: false }),
        }
    }
}

pub fn reads(tokens: &[Token], at: usize, pattern: &[&str]) -> bool {
    pattern.iter().enumerate().all(|(i, want)| tokens.get(at + i).is_some_and(|token| token.text == *want))
}

pub fn closing(tokens: &[Token], open: usize) -> usize {
    let mut depth = 0_usize;
    for (i, token) in tokens.iter().enumerate().skip(open) {
        match token.text.as_str() {
            "(" | "[" | "{" => depth += 1,
            ")" | "]" | "}" => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return i;
        }
    }
    tokens.len()
}

/// Index of the last token of the item at `at`: its closing brace or semicolon.
pub fn item_end(tokens: &[Token], at: usize) -> usize {
    let mut i = at;
    while let Some(token) = tokens.get(i) {
        match token.text.as_str() {
            ";" => return i,
            "{" => return closing(tokens, i),
            "(" | "[" => i = closing(tokens, i) + 1,
            _ => i += 1,
        }
    }
    tokens.len()
}

pub fn without_tests(tokens: Vec<Token>) -> Vec<Token> {
    let mut skip = vec![false; tokens.len()];
    for at in 0..tokens.len() {
        if reads(&tokens, at, &["#", "[", "cfg", "(", "test", ")", "]"]) {
            let end = item_end(&tokens, at + 7);
            skip.iter_mut().take(end + 1).skip(at).for_each(|s| *s = true);
        }
    }
    tokens.into_iter().zip(skip).filter(|(_, skip)| !skip).map(|(token, _)| token).collect()
}

/// Applies `wrong` to every token; it returns a message at a violation.
pub fn scan(source: &Source, wrong: impl Fn(&[Token], usize) -> Option<String>) -> Vec<Violation> {
    match tokens(source) {
        Ok(tokens) => scan_tokens(source, &tokens, wrong),
        Err(violation) => vec![violation],
    }
}

/// As [`scan`], for given tokens.
pub fn scan_tokens(
    source: &Source,
    tokens: &[Token],
    wrong: impl Fn(&[Token], usize) -> Option<String>,
) -> Vec<Violation> {
    (0..tokens.len())
        .filter_map(|at| wrong(tokens, at).map(|text| source.violation(tokens[at].line, text)))
        .collect()
}

#[test]
fn comments_and_strings_are_not_code() {
    let source = Source::new("a.rs", "// f32\nconst A: &str = \"f32 { \"; /// f32\nfn f() { g![f32] }");
    let tokens = tokens(&source).unwrap();
    let found: Vec<usize> = tokens.iter().filter(|t| t.text == "f32").map(|t| t.line).collect();
    assert_eq!(found, [3]);
}

#[test]
fn test_items_are_removed_and_later_items_kept() {
    let text = "#[cfg(test)] #[allow(x)] mod t { fn a() {} } fn b() {} #[cfg(test)] mod tests; fn c() {}";
    let source = Source::new("a.rs", text);
    let left: String = without_tests(tokens(&source).unwrap()).into_iter().map(|t| t.text).collect();
    assert_eq!(left, "fnb(){}fnc(){}");
}
