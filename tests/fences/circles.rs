//! Imports flow one way inside a crate: its files form no circle.
//!
//! An edge goes from a file to the file that defines what it names, in a `use` or in a path of its code. A re-export on the
//! way makes no edge: `crate::Frame`, re-exported by `lib.rs`, leads to `frame.rs`. Neither does a parent's `mod child;`, nor its
//! `pub use child::Name` while its own code does not use the name: that is how a folder shows its parts. A parent that uses its
//! child and a child that uses its parent (`super::Name`) are a circle like any other. A method call is no import: an `impl` of
//! the parent's type in a child's file belongs to the parent's subject. Tests (`#[cfg(test)]`) may import as they like.
//!
//! One crate alone: `CRATE=god cargo test -p system-tests fences::circles`.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use toml::Table;

use super::modules::{Named, Target};
use super::{Source, Violation, assert_none, files};

struct Edge {
    line: usize,
    written: String,
}

type Edges = BTreeMap<usize, BTreeMap<usize, Edge>>;

fn edges(target: &Target<'_>) -> Edges {
    let mut edges = Edges::new();
    let mut add = |from: usize, to: usize, line: usize, written: String| {
        if from != to {
            edges.entry(from).or_default().entry(to).or_insert(Edge { line, written });
        }
    };
    for (index, module) in target.modules.iter().enumerate() {
        for import in &module.imports {
            let glob = import.name == "*";
            let to = match target.resolve(index, &import.path.segments) {
                Some(Named::Item { file }) => file,
                // A module's name alone is not a use of it; the paths that begin with it are.
                Some(Named::Module(other)) if glob => target.modules[other].file,
                _ => continue,
            };
            let shows_part = import.is_public
                && !module.names.contains(&import.name)
                && target
                    .modules
                    .iter()
                    .enumerate()
                    .any(|(at, m)| m.file == to && target.is_below(at, index));
            if !shows_part {
                add(module.file, to, import.path.line, format!("use {}", import.path.segments.join("::")));
            }
        }
        for path in module.paths.iter().filter(|path| path.segments.len() > 1) {
            if let Some(Named::Item { file }) = target.resolve(index, &path.segments) {
                add(module.file, file, path.line, path.segments.join("::"));
            }
        }
    }
    edges
}

/// The shortest way from a file back to itself, without itself at the end.
fn shortest_circle(edges: &Edges, start: usize) -> Option<Vec<usize>> {
    let mut came_from: BTreeMap<usize, usize> = BTreeMap::new();
    let mut queue = VecDeque::from([start]);
    while let Some(at) = queue.pop_front() {
        for next in edges.get(&at).into_iter().flat_map(BTreeMap::keys) {
            if *next == start {
                let mut way = vec![at];
                while way[0] != start {
                    way.insert(0, came_from[&way[0]]);
                }
                return Some(way);
            }
            if !came_from.contains_key(next) {
                came_from.insert(*next, at);
                queue.push_back(*next);
            }
        }
    }
    None
}

fn reachable(edges: &Edges, start: usize) -> BTreeSet<usize> {
    let mut seen = BTreeSet::new();
    let mut queue = vec![start];
    while let Some(at) = queue.pop() {
        queue.extend(edges.get(&at).into_iter().flat_map(BTreeMap::keys).filter(|next| seen.insert(**next)));
    }
    seen
}

/// One violation for each set of files that lead to each other, with its shortest circle.
fn circles(sources: &[Source], root: usize) -> Vec<Violation> {
    let target = Target::read(sources, root);
    let edges = edges(&target);
    let reachable: BTreeMap<usize, BTreeSet<usize>> =
        edges.keys().map(|file| (*file, reachable(&edges, *file))).collect();
    let mut violations = Vec::new();
    let mut done = BTreeSet::new();
    for file in edges.keys() {
        if done.contains(file) || !reachable[file].contains(file) {
            continue;
        }
        let set: Vec<usize> = reachable[file]
            .iter()
            .copied()
            .filter(|other| reachable.get(other).is_some_and(|back| back.contains(file)))
            .collect();
        let circle = set.iter().filter_map(|start| shortest_circle(&edges, *start)).min_by_key(Vec::len);
        let Some(circle) = circle else { continue };
        let steps: Vec<String> = (0..circle.len())
            .map(|i| {
                let (from, to) = (circle[i], circle[(i + 1) % circle.len()]);
                let edge = &edges[&from][&to];
                format!(
                    "\n    {}:{}: {} -> {}",
                    sources[from].path, edge.line, edge.written, sources[to].path
                )
            })
            .collect();
        let names: Vec<&str> = set.iter().map(|file| sources[*file].path.as_str()).collect();
        let first = &edges[&circle[0]][&circle[1]];
        let text = format!(
            "{} files import each other in a circle: {}\n  the shortest, to cut at one of its lines (move what both sides name into a file below both):{}",
            set.len(),
            names.join(", "),
            steps.concat()
        );
        violations.push(sources[circle[0]].violation(first.line, text));
        done.extend(set);
    }
    violations
}

fn roots(sources: &[Source], manifest: &Source) -> Vec<usize> {
    let Ok(table) = manifest.text.parse::<Table>() else { return Vec::new() };
    let folder = manifest.path.trim_end_matches("Cargo.toml");
    let lists = ["bin", "test", "example", "bench"].iter().filter_map(|kind| table.get(*kind)?.as_array());
    let listed = lists.flatten().chain(table.get("lib"));
    let named: Vec<&str> = listed.filter_map(|target| target.get("path")?.as_str()).collect();
    let is_root = |path: &str| {
        let parts: Vec<&str> = path.split('/').collect();
        match parts[..] {
            ["build.rs"] | ["src", "lib.rs" | "main.rs"] => true,
            ["src", "bin", file] => file.ends_with(".rs"),
            ["examples" | "tests" | "benches", file] => file.ends_with(".rs"),
            ["examples" | "tests" | "benches", _, "main.rs"] => true,
            _ => named.contains(&path),
        }
    };
    let is_target = |source: &Source| source.path.strip_prefix(folder).is_some_and(is_root);
    (0..sources.len()).filter(|i| is_target(&sources[*i])).collect()
}

fn package(manifest: &Source) -> Option<String> {
    let table = manifest.text.parse::<Table>().ok()?;
    Some(table.get("package")?.get("name")?.as_str()?.to_string())
}

#[test]
fn no_crate_imports_in_circles() {
    let sources = files("rs");
    let only = std::env::var("CRATE").ok();
    let mut violations = Vec::new();
    let mut packages = Vec::new();
    for manifest in files("toml").iter().filter(|file| file.path.ends_with("Cargo.toml")) {
        let Some(name) = package(manifest) else { continue };
        let is_asked = only.as_ref().is_none_or(|only| *only == name);
        if is_asked {
            violations.extend(roots(&sources, manifest).iter().flat_map(|root| circles(&sources, *root)));
        }
        packages.push(name);
    }
    if let Some(only) = only {
        assert!(packages.contains(&only), "no crate {only}; there are {}", packages.join(", "));
    }
    assert_none(&violations);
}

fn of(files: &[(&str, &str)]) -> Vec<Violation> {
    let sources: Vec<Source> = files.iter().map(|(path, text)| Source::new(path, text)).collect();
    circles(&sources, 0)
}

#[test]
fn circle_fence_finds_each_circle() {
    let offending: [&[(&str, &str)]; 9] = [
        // Two files by `use`.
        &[
            ("src/lib.rs", "mod a; mod b;"),
            ("src/a.rs", "use crate::b::B; struct A;"),
            ("src/b.rs", "use crate::a::A; struct B;"),
        ],
        // By paths in code.
        &[
            ("src/lib.rs", "mod a; mod b;"),
            ("src/a.rs", "fn f() { crate::b::g() }"),
            ("src/b.rs", "fn g() { super::a::f() }"),
        ],
        // Three files, a list, a rename and a group.
        &[
            ("src/lib.rs", "mod a; mod b; mod c;"),
            ("src/a.rs", "use super::{b::{self, B as X}, Other}; struct A;"),
            ("src/b.rs", "use crate::c::*; struct B;"),
            ("src/c.rs", "fn f(a: crate::a::A) {}"),
        ],
        &[
            ("src/lib.rs", "mod a;"),
            ("src/a.rs", "mod b; use b::B; struct A;"),
            ("src/a/b.rs", "use super::A; struct B;"),
        ],
        // A parent that shows its child's part and uses it as well.
        &[
            ("src/lib.rs", "pub mod a;"),
            ("src/a.rs", "mod b; pub use b::B; pub struct A { b: B }"),
            ("src/a/b.rs", "use super::A; pub struct B;"),
        ],
        // The root of a program.
        &[
            ("src/main.rs", "mod a; type T = u8; fn main() { a::f() }"),
            ("src/a.rs", "use crate::T; fn f() {}"),
        ],
        // Through a re-export, and a module imported by its name.
        &[
            ("src/lib.rs", "mod a; mod b; pub use b::B;"),
            ("src/a.rs", "use crate::B; fn f() {}"),
            ("src/b.rs", "use super::a; pub struct B; fn g() { a::f() }"),
        ],
        // Inside a macro, a function and a module in a block.
        &[
            ("src/lib.rs", "mod a; mod b;"),
            ("src/a.rs", "mod inner { fn f() { use crate::b::B; } } newtype! { pub struct A; }"),
            ("src/b.rs", "m! { crate::a::A } struct B;"),
        ],
        // `mod.rs` and `#[path]`.
        &[
            ("src/lib.rs", "mod a; #[path = \"elsewhere/x.rs\"] mod b;"),
            ("src/a/mod.rs", "use crate::b::B; struct A;"),
            ("src/elsewhere/x.rs", "use crate::a::A; struct B;"),
        ],
    ];
    for files in offending {
        assert_eq!(of(files).len(), 1, "{files:?}: {:?}", of(files));
    }
}

#[test]
fn circle_fence_admits_one_way_imports() {
    let clean: [&[(&str, &str)]; 6] = [
        &[
            ("src/lib.rs", "mod a; mod b;"),
            ("src/a.rs", "use crate::b::B;"),
            ("src/b.rs", "use std::a; struct B; // use crate::a"),
        ],
        // A folder that shows its parts; they use it.
        &[
            ("src/lib.rs", "pub mod a;"),
            ("src/a.rs", "mod b; pub use b::B; pub struct A;"),
            ("src/a/b.rs", "use super::A; pub struct B;"),
        ],
        // A re-export by the root: the root itself is not used.
        &[
            ("src/lib.rs", "mod a; mod b; pub use a::A;"),
            ("src/a.rs", "struct A;"),
            ("src/b.rs", "use crate::A;"),
        ],
        // A module's name alone.
        &[
            ("src/lib.rs", "mod a; mod b;"),
            ("src/a.rs", "mod c; fn f() {}"),
            ("src/a/c.rs", "struct C;"),
            ("src/b.rs", "use crate::a; fn g() { a::f() }"),
        ],
        &[
            ("src/lib.rs", "mod a; mod b;"),
            ("src/a.rs", "use crate::b::B; struct A; #[cfg(test)] mod tests;"),
            ("src/a/tests.rs", "use super::A;"),
            ("src/b.rs", "struct B; #[cfg(test)] mod t { use crate::a::A; }"),
        ],
        // A file that does not exist, and one that is not Rust.
        &[("src/lib.rs", "mod gone; mod a;"), ("src/a.rs", "fn f( {")],
    ];
    for files in clean {
        assert!(of(files).is_empty(), "{files:?}: {:?}", of(files));
    }
}

#[test]
fn circle_is_printed_with_its_lines() {
    let found = of(&[
        ("src/lib.rs", "mod a;\nmod b;"),
        ("src/a.rs", "\nuse crate::b::B;\nstruct A;"),
        ("src/b.rs", "struct B;\nfn f(a: crate::a::A) {}"),
    ]);
    let text = found[0].to_string();
    assert!(
        text.starts_with("src/a.rs:2: 2 files import each other in a circle: src/a.rs, src/b.rs\n"),
        "{text}"
    );
    assert!(text.contains("\n    src/a.rs:2: use crate::b::B -> src/b.rs"), "{text}");
    assert!(text.contains("\n    src/b.rs:2: crate::a::A -> src/a.rs"), "{text}");
}
