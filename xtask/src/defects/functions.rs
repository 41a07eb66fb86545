//! Where the functions of a Rust source are: enough of the language to find the body that encloses a text. It knows comments, strings,
//! characters and lifetimes; a body begins with the first brace after `fn`, so a brace in a signature (`Foo<{ N }>`) is not understood.

use std::ops::Range;

/// The body of a function.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Body {
    /// The text between its braces.
    pub inside: Range<usize>,
    pub name: String,
    /// The word `const` before it: the compiler may evaluate it, so it cannot read a variable of the environment.
    pub constant: Option<Range<usize>>,
    /// It returns `impl Trait`: two versions of the body may have two types.
    pub is_opaque: bool,
}

/// The innermost function whose body has all of `place`.
pub fn enclosing(text: &str, place: &Range<usize>) -> Option<Body> {
    let has = |body: &Body| body.inside.start <= place.start && place.end <= body.inside.end;
    bodies(text).into_iter().filter(has).min_by_key(|body| body.inside.len())
}

/// The words `const` before the functions of this name.
pub fn constants(text: &str, name: &str) -> Vec<Range<usize>> {
    bodies(text).into_iter().filter(|body| body.name == name).filter_map(|body| body.constant).collect()
}

/// A word or a sign, and where it begins.
type Token<'a> = (usize, &'a str);

fn bodies(text: &str) -> Vec<Body> {
    let tokens = tokens(text);
    (0..tokens.len()).filter_map(|at| body(&tokens, at)).collect()
}

fn body(tokens: &[Token], at: usize) -> Option<Body> {
    let word = |at: usize| tokens.get(at).map_or("", |&(_, word)| word);
    // `fn(` is the type of a function pointer.
    if word(at) != "fn" || word(at + 1) == "(" {
        return None;
    }
    let before = tokens[..at].iter().rev();
    let mut qualifiers = before.take_while(|(_, word)| ["const", "async", "unsafe", "extern"].contains(word));
    let constant = qualifiers.find(|(_, word)| *word == "const").map(|&(at, word)| at..at + word.len());
    // In parentheses, a semicolon is part of the type of an array.
    let mut depth = 0;
    let open = (at..tokens.len()).find(|&at| {
        match word(at) {
            "(" | "[" => depth += 1,
            ")" | "]" => depth -= 1,
            _ => {}
        }
        depth == 0 && ["{", ";"].contains(&word(at))
    })?;
    let arrow = (at..open).find(|&at| word(at) == "-" && word(at + 1) == ">").unwrap_or(open);
    let is_opaque = (arrow..open).any(|at| word(at) == "impl");
    let mut depth = 0;
    let close = (open..tokens.len()).find(|&at| {
        match word(at) {
            "{" => depth += 1,
            "}" => depth -= 1,
            _ => {}
        }
        depth == 0
    })?;
    let inside = tokens[open].0 + 1..tokens[close].0;
    (word(open) == "{").then(|| Body { inside, name: word(at + 1).to_owned(), constant, is_opaque })
}

/// Words and signs, without comments and literals.
fn tokens(text: &str) -> Vec<Token<'_>> {
    let (mut tokens, mut at) = (Vec::new(), 0);
    while let Some(first) = text[at..].chars().next() {
        let rest = &text[at..];
        let len = literal(rest).unwrap_or_else(|| {
            let is_word = |c: char| c.is_alphanumeric() || c == '_';
            let len = rest.find(|c| !is_word(c)).unwrap_or(rest.len()).max(first.len_utf8());
            if !first.is_whitespace() {
                tokens.push((at, &rest[..len]));
            }
            len
        });
        at += len;
    }
    tokens
}

/// Length of the comment, string, character or lifetime that the text begins with.
fn literal(text: &str) -> Option<usize> {
    let until =
        |from: usize, end: &str| text[from..].find(end).map_or(text.len(), |found| from + found + end.len());
    if text.starts_with("//") {
        return Some(until(2, "\n"));
    }
    if text.starts_with("/*") {
        return Some(block_comment(text));
    }
    let prefix = ["br", "cr", "r", "b", "c", ""].into_iter().find(|prefix| {
        text.strip_prefix(prefix).is_some_and(|rest| rest.trim_start_matches('#').starts_with(['"', '\'']))
    })?;
    let rest = &text[prefix.len()..];
    let hashes = rest.len() - rest.trim_start_matches('#').len();
    if prefix.ends_with('r') && rest[hashes..].starts_with('"') {
        return Some(until(prefix.len() + hashes + 1, &format!("\"{}", "#".repeat(hashes))));
    }
    if hashes > 0 {
        return None;
    }
    let quote = rest.chars().next()?;
    let mut chars = rest.char_indices().skip(1);
    if quote == '\'' {
        let second = chars.next()?.1;
        if second != '\\' && !rest[1 + second.len_utf8()..].starts_with('\'') {
            // A lifetime: its word follows.
            return Some(prefix.len() + 1);
        }
        chars = rest.char_indices().skip(1);
    }
    while let Some((at, next)) = chars.next() {
        match next {
            '\\' => _ = chars.next(),
            next if next == quote => return Some(prefix.len() + at + 1),
            _ => {}
        }
    }
    Some(text.len())
}

fn block_comment(text: &str) -> usize {
    let (mut depth, mut at) = (0, 0);
    while at < text.len() {
        if text[at..].starts_with("/*") {
            (depth, at) = (depth + 1, at + 2);
        } else if text[at..].starts_with("*/") {
            (depth, at) = (depth - 1, at + 2);
        } else {
            at += text[at..].chars().next().map_or(1, char::len_utf8);
        }
        if depth == 0 {
            break;
        }
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The body around `X`.
    fn around(text: &str) -> Option<(&str, Body)> {
        let at = text.find('X').expect("an X");
        let body = enclosing(text, &(at..at + 1))?;
        Some((&text[body.inside.clone()], body))
    }

    fn inside(text: &str) -> Option<&str> {
        around(text).map(|(inside, _)| inside)
    }

    #[test]
    fn body_is_that_of_the_innermost_function() {
        assert_eq!(inside("fn f(a: [u8; 3]) -> u8 { g(X) } fn h() {}"), Some(" g(X) "));
        assert_eq!(inside("fn f() { fn g() {X} g() }"), Some("X"));
        assert_eq!(inside("fn f() { fn g() {} X }"), Some(" fn g() {} X "));
        assert_eq!(inside("impl A { fn f(&self) where A: B { if a { X } } }"), Some(" if a { X } "));
        assert_eq!(inside("const C: fn(u8) = X; fn f() {}"), None);
        assert_eq!(inside("trait T { fn f(); const C: u8 = { X }; }"), None);
        assert_eq!(inside("fn f(a: u8, X: u8) {}"), None);
    }

    #[test]
    fn braces_in_literals_and_comments_do_not_count() {
        for literal in [
            r#""}""#,
            r#""\"}""#,
            r##"r#""}"#"##,
            r#"b"}""#,
            "'}'",
            r"'\''",
            "b'}'",
            "// }\n",
            "/* } /* } */ } */",
            "'a'",
            "&'a u8",
            "'é'",
            "\"é}\"",
        ] {
            let text = format!("fn f() {{ {literal}; X }} fn g() {{}}");
            assert_eq!(inside(&text), Some(&*format!(" {literal}; X ")), "{literal}");
        }
    }

    #[test]
    fn constant_and_opaque_functions_are_known() {
        let kind = |text| around(text).map(|(_, body)| (body.constant.is_some(), body.is_opaque));
        assert_eq!(kind("pub const fn f() { X }"), Some((true, false)));
        assert_eq!(kind("const unsafe fn f() { X }"), Some((true, false)));
        assert_eq!(kind("pub(super) async fn f(a: impl Fn()) -> u8 { X }"), Some((false, false)));
        assert_eq!(kind("fn f() -> impl Iterator<Item = u8> { X }"), Some((false, true)));
    }

    #[test]
    fn each_body_of_the_project_has_balanced_braces() {
        let path = crate::program::root().join("servo-core/src/servo.rs");
        let text = std::fs::read_to_string(path).expect("there");
        let all = bodies(&text);
        assert!(all.len() > 80, "{}", all.len());
        for body in all {
            let text = &text[body.inside];
            assert_eq!(text.matches('{').count(), text.matches('}').count(), "{text}");
        }
    }
}
