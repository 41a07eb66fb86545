//! The modules of one target with the names that each defines and imports, and paths resolved to the file that defines them.
//!
//! Limits: names made by a macro's expansion are known only if the macro's arguments spell them (`struct Name`); a path
//! whose end is unknown counts for the last module on it.

use std::collections::{HashMap, HashSet};

use super::Source;
use super::tokens::{Token, closing, item_end, reads, tokens, without_tests};

/// A path as it is written, from its first segment, and its line.
#[derive(Clone)]
pub struct Path {
    pub segments: Vec<String>,
    pub line: usize,
}

pub struct Import {
    /// What the name is here; `*` for all names of a module.
    pub name: String,
    pub path: Path,
    pub is_public: bool,
}

/// A module: a file, or a block `mod name { .. }` in one.
pub struct Module {
    pub file: usize,
    parent: usize,
    children: HashMap<String, usize>,
    items: HashSet<String>,
    pub imports: Vec<Import>,
    pub paths: Vec<Path>,
    /// Every name in its code that neither `::` nor `.` precedes.
    pub names: HashSet<String>,
}

#[derive(Clone, Copy)]
pub enum Named {
    /// Something that the file defines.
    Item {
        file: usize,
    },
    Module(usize),
}

/// What names mean in modules; nothing while one is looked up, so that a circle of imports ends.
type Seen<'p> = HashMap<(usize, &'p str), Option<Named>>;

/// The modules that a root file declares, without those of tests.
pub struct Target<'a> {
    sources: &'a [Source],
    pub modules: Vec<Module>,
}

impl<'a> Target<'a> {
    /// `root` is an index into `sources`. A missing file, or one that is not Rust, has no modules.
    pub fn read(sources: &'a [Source], root: usize) -> Self {
        let mut target = Self { sources, modules: Vec::new() };
        let path = &sources[root].path;
        let folder = path.rsplit_once('/').map_or("", |(folder, _)| folder).to_string();
        target.read_file(root, 0, folder);
        target
    }

    /// Reads a file whose submodules lie in `folder`; returns the index of its module.
    fn read_file(&mut self, file: usize, parent: usize, folder: String) -> usize {
        let tokens = without_tests(tokens(&self.sources[file]).unwrap_or_default());
        self.read_module(&tokens, file, parent, &folder)
    }

    fn read_module(&mut self, tokens: &[Token], file: usize, parent: usize, folder: &str) -> usize {
        let index = self.modules.len();
        self.modules.push(Module {
            file,
            parent,
            children: HashMap::new(),
            items: defined(tokens),
            imports: Vec::new(),
            paths: Vec::new(),
            names: HashSet::new(),
        });
        let mut at = 0;
        while let Some(token) = tokens.get(at) {
            at = match token.text.as_str() {
                "mod" => self.read_child(tokens, at, index, folder),
                "use" if !reads(tokens, at + 1, &["<"]) => {
                    let end = item_end_of_use(tokens, at);
                    let is_public = at > 0 && (tokens[at - 1].text == "pub" || reads(tokens, at - 1, &[")"]));
                    read_use(
                        &tokens[at + 1..end],
                        &mut Vec::new(),
                        is_public,
                        &mut self.modules[index].imports,
                    );
                    end + 1
                }
                _ => self.read_code(tokens, at, index),
            };
        }
        index
    }

    /// Reads `mod name;` or `mod name { .. }` at `at`; returns the index of what follows.
    fn read_child(&mut self, tokens: &[Token], at: usize, index: usize, folder: &str) -> usize {
        let Some(name) = tokens.get(at + 1).map(|name| name.text.clone()) else { return at + 1 };
        let below = if folder.is_empty() { name.clone() } else { format!("{folder}/{name}") };
        let file = self.modules[index].file;
        let end = if reads(tokens, at + 2, &["{"]) {
            let end = closing(tokens, at + 2);
            let child = self.read_module(&tokens[at + 3..end], file, index, &below);
            self.modules[index].children.insert(name, child);
            end
        } else if reads(tokens, at + 2, &[";"]) {
            let candidates = match path_attribute(tokens, at) {
                Some(given) => {
                    let beside = self.sources[file].path.rsplit_once('/').map_or("", |(folder, _)| folder);
                    vec![(normal(&format!("{beside}/{given}")), normal(&format!("{beside}/{given}/..")))]
                }
                None => vec![(format!("{below}.rs"), below.clone()), (format!("{below}/mod.rs"), below)],
            };
            for (path, folder) in candidates {
                if let Some(file) = self.sources.iter().position(|source| source.path == path) {
                    let child = self.read_file(file, index, folder);
                    self.modules[index].children.insert(name, child);
                    break;
                }
            }
            at + 2
        } else {
            at
        };
        end + 1
    }

    /// Records the path or name at `at`; returns the index of what follows.
    fn read_code(&mut self, tokens: &[Token], at: usize, index: usize) -> usize {
        let module = &mut self.modules[index];
        if !is_name(&tokens[at]) || at > 0 && tokens[at - 1].text == "." {
            return at + 1;
        }
        let mut segments = vec![tokens[at].text.clone()];
        let mut next = at + 1;
        while reads(tokens, next, &[":", ":"]) && tokens.get(next + 2).is_some_and(is_name) {
            segments.push(tokens[next + 2].text.clone());
            next += 3;
        }
        if at < 2 || !reads(tokens, at - 2, &[":", ":"]) {
            module.names.insert(segments[0].clone());
            module.paths.push(Path { segments, line: tokens[at].line });
        }
        next
    }

    /// What a path in a module names; `None` if it leaves the target.
    pub fn resolve(&self, module: usize, path: &[String]) -> Option<Named> {
        self.resolve_from(module, path, &mut HashMap::new())
    }

    fn resolve_from<'p>(&'p self, module: usize, path: &'p [String], seen: &mut Seen<'p>) -> Option<Named> {
        let mut at = module;
        let mut is_anchored = false;
        for segment in path {
            match segment.as_str() {
                "crate" => at = 0,
                "super" => at = self.modules[at].parent,
                "self" => {}
                name => match self.lookup(at, name, seen) {
                    Some(Named::Module(child)) => at = child,
                    Some(item) => return Some(item),
                    None if is_anchored => return Some(Named::Item { file: self.modules[at].file }),
                    None => return None,
                },
            }
            is_anchored = true;
        }
        Some(Named::Module(at))
    }

    /// Looks each name up once: imports of whole modules lead from one to the other in circles and by many ways.
    fn lookup<'p>(&'p self, module: usize, name: &'p str, seen: &mut Seen<'p>) -> Option<Named> {
        if let Some(known) = seen.get(&(module, name)) {
            return *known;
        }
        seen.insert((module, name), None);
        let found = self.find(module, name, seen);
        seen.insert((module, name), found);
        found
    }

    fn find<'p>(&'p self, module: usize, name: &'p str, seen: &mut Seen<'p>) -> Option<Named> {
        let here = &self.modules[module];
        if let Some(child) = here.children.get(name) {
            return Some(Named::Module(*child));
        }
        if here.items.contains(name) {
            return Some(Named::Item { file: here.file });
        }
        if let Some(import) = here.imports.iter().find(|import| import.name == name) {
            return self.resolve_from(module, &import.path.segments, seen);
        }
        here.imports.iter().filter(|import| import.name == "*").find_map(|import| {
            match self.resolve_from(module, &import.path.segments, seen)? {
                Named::Module(other) => self.lookup(other, name, seen),
                Named::Item { .. } => None,
            }
        })
    }

    pub fn is_below(&self, module: usize, above: usize) -> bool {
        let mut at = module;
        while at != above && at != 0 {
            at = self.modules[at].parent;
        }
        at == above
    }
}

fn is_name(token: &Token) -> bool {
    !token.is_literal && token.text.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

/// `a/b/../c` without the dots.
fn normal(path: &str) -> String {
    let mut parts: Vec<&str> = Vec::new();
    for part in path.split('/').filter(|part| !part.is_empty() && *part != ".") {
        if part == ".." {
            parts.pop();
        } else {
            parts.push(part);
        }
    }
    parts.join("/")
}

/// The file of `#[path = "file"]` above the `mod` at `at`.
fn path_attribute(tokens: &[Token], at: usize) -> Option<&str> {
    let above = &tokens[at.saturating_sub(10)..at];
    let path = (0..above.len()).find(|i| reads(above, *i, &["#", "[", "path", "="]))?;
    Some(above.get(path + 4)?.text.trim_matches('"'))
}

/// The names behind `struct`, `fn` and so on, at the module's level or as arguments of a macro there.
fn defined(tokens: &[Token]) -> HashSet<String> {
    const KINDS: [&str; 8] = ["fn", "struct", "enum", "union", "trait", "type", "static", "const"];
    let mut names = HashSet::new();
    let mut at = 0;
    while let Some(token) = tokens.get(at) {
        let word = token.text.as_str();
        let is_macro = reads(tokens, at + 1, &["!"]) && is_name(token);
        if word == "macro_rules" && is_macro {
            names.extend(tokens.get(at + 2).map(|name| name.text.clone()));
            at = item_end(tokens, at) + 1;
        } else if word == "mod" || word == "impl" {
            at = item_end(tokens, at) + 1;
        } else if KINDS.contains(&word) {
            let named = if reads(tokens, at + 1, &["mut"]) { at + 2 } else { at + 1 };
            names.extend(tokens.get(named).map(|name| name.text.clone()));
            let is_modifier = word == "const" && tokens.get(named).is_some_and(|next| next.text == "fn");
            at = if is_modifier { at + 1 } else { item_end(tokens, at) + 1 };
        } else {
            // Into a macro's arguments, past everything else.
            at += 1;
        }
    }
    names
}

fn item_end_of_use(tokens: &[Token], at: usize) -> usize {
    (at..tokens.len()).find(|i| tokens[*i].text == ";").unwrap_or(tokens.len())
}

fn read_use(tokens: &[Token], prefix: &mut Vec<String>, is_public: bool, imports: &mut Vec<Import>) {
    let before = prefix.len();
    let mut at = 0;
    while let Some(token) = tokens.get(at) {
        match token.text.as_str() {
            "{" => {
                let end = closing(tokens, at);
                let mut start = at + 1;
                for i in at + 1..=end {
                    let inside = &tokens[start..i];
                    if i == end || token_depth(&tokens[at + 1..i]) == 0 && tokens[i].text == "," {
                        read_use(inside, prefix, is_public, imports);
                        start = i + 1;
                    }
                }
                prefix.truncate(before);
                return;
            }
            "as" => break,
            ":" | "$" => {}
            name => prefix.push(name.to_string()),
        }
        at += 1;
    }
    if let (Some(last), true) = (prefix.last().cloned(), prefix.len() > before || !tokens.is_empty()) {
        let line = tokens[0].line;
        if last == "self" && prefix.len() > 1 {
            prefix.pop();
        }
        let name = if reads(tokens, at, &["as"]) {
            tokens.get(at + 1).map_or_else(|| "_".into(), |name| name.text.clone())
        } else {
            prefix.last().cloned().unwrap_or_default()
        };
        let mut segments = prefix.clone();
        if last == "*" {
            segments.pop();
        }
        imports.push(Import { name, path: Path { segments, line }, is_public });
    }
    prefix.truncate(before);
}

fn token_depth(tokens: &[Token]) -> usize {
    tokens.iter().fold(0_usize, |depth, token| match token.text.as_str() {
        "{" => depth + 1,
        "}" => depth.saturating_sub(1),
        _ => depth,
    })
}
