//! Whose bytes a section's are: by the crate that a symbol's name begins with, or what it is if it has none.

use std::collections::BTreeMap;

use super::elf::{Program, Section, plain};

/// Where the names without a crate come from: the first row whose pattern fits, `*` at its end being anything.
const NAMED: [(&str, &str); 15] = [
    ("__aeabi_mem*", "tater_fw (assembler)"),
    ("memcpy", "tater_fw (assembler)"),
    ("memset", "tater_fw (assembler)"),
    ("HardFault", "tater_fw (assembler)"),
    ("HardFaultTrampoline", "cortex_m_rt"),
    ("Reset", "cortex_m_rt"),
    ("DefaultPreInit", "cortex_m_rt"),
    ("__pre_init", "cortex_m_rt"),
    ("main", "cortex_m_rt"),
    ("NonMaskableInt", "tater_fw"),
    ("DefaultHandler", "tater_fw"),
    ("_defmt*", "defmt"),
    ("_SEGGER*", "defmt_rtt"),
    ("__*", "compiler_builtins"),
    (".L*", "constants without a name"),
];

/// Bytes of a section by crate. Their sum is the section's length.
pub fn of(program: &Program, section: &Section, handlers: &[String]) -> BTreeMap<String, u32> {
    let mut crates = BTreeMap::new();
    for (name, bytes) in extents(program, section) {
        let whose = match name {
            _ if section.name == ".vector_table" => "vector table".into(),
            Some(name) if handlers.iter().any(|handler| handler == name) => {
                "tater (interrupt handlers)".into()
            }
            Some(name) => origin(name),
            None => "constants without a name".into(),
        };
        *crates.entry(whose).or_default() += bytes;
    }
    crates
}

/// The section cut at its symbols: each byte once, to the symbol that begins last before it; none where there is none.
pub fn extents<'p>(program: &'p Program, section: &Section) -> Vec<(Option<&'p str>, u32)> {
    let inside = |start: u32| (section.start..section.end()).contains(&start);
    let symbols: Vec<_> = program.symbols.iter().filter(|symbol| inside(symbol.start)).collect();
    let mut extents = Vec::new();
    let mut at = section.start;
    for (index, symbol) in symbols.iter().enumerate() {
        let next = symbols.get(index + 1).map_or(section.end(), |next| next.start);
        // What an assembler defines has no length: it goes to the next symbol, if it is a function.
        let end = match symbol.len {
            0 if symbol.function => next,
            len => (symbol.start + len).min(section.end()),
        };
        if symbol.start > at {
            extents.push((None, symbol.start - at));
            at = symbol.start;
        }
        if end > at {
            extents.push((Some(symbol.name.as_str()), end - at));
            at = end;
        }
    }
    if section.end() > at {
        extents.push((None, section.end() - at));
    }
    extents
}

/// The crate of a symbol, or what it is.
pub fn origin(name: &str) -> String {
    let fits =
        |pattern: &str| pattern.strip_suffix('*').map_or(name == pattern, |start| name.starts_with(start));
    // `.Lswitch.table.` and the name of the function that it belongs to.
    let function = name.find("_ZN").or_else(|| name.find("_RN")).map_or(name, |at| &name[at..]);
    let text = plain(function);
    if text.contains("::") {
        // `<&mut T as Trait>::f`: of T's crate.
        let path = text.trim_start_matches(|c: char| !c.is_alphanumeric() && c != '_');
        let path = ["mut ", "const ", "dyn "].iter().fold(path, |path, word| path.trim_start_matches(word));
        let end = path.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(path.len());
        return path[..end].into();
    }
    NAMED
        .iter()
        .find(|(pattern, _)| fits(pattern))
        .map_or_else(|| format!("{name} (no crate)"), |&(_, whose)| whose.into())
}
