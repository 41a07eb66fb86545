//! Bytes of a section by crate, from the names of its symbols. Inlined code counts where it was inlined: most
//! of the servo counts for the tick's interrupt.

use std::collections::BTreeMap;

use super::elf::{Program, Section, plain};

/// Owners of names without a crate: the first pattern that matches; a final `*` matches anything.
const NAMED: [(&str, &str); 18] = [
    ("__aeabi_mem*", "tater_fw (assembler)"),
    ("memcpy", "tater_fw (assembler)"),
    ("memset", "tater_fw (assembler)"),
    ("HardFault", "tater_fw (assembler)"),
    ("HardFaultTrampoline", "cortex_m_rt"),
    ("Reset", "cortex_m_rt"),
    ("DefaultPreInit", "cortex_m_rt"),
    ("__pre_init", "cortex_m_rt"),
    ("main", "cortex_m_rt"),
    ("DEVICE_PERIPHERALS", "stm32f1"),
    ("CORE_PERIPHERALS", "cortex_m"),
    ("NonMaskableInt", "tater_fw"),
    ("DefaultHandler", "tater_fw"),
    ("_defmt*", "defmt"),
    ("_SEGGER*", "defmt_rtt"),
    ("__*", "compiler_builtins"),
    (".L*", "constants without a name"),
    // Shared pieces of several functions, numbered anew when any name changes.
    ("OUTLINED_FUNCTION_*", "pieces of several functions"),
];

/// Bytes between symbols.
pub const ALIGNMENT: &str = "alignment";

/// Bytes of a section by crate; the sum is its length.
pub fn of(program: &Program, section: &Section, handlers: &[String]) -> BTreeMap<String, u32> {
    let mut crates = BTreeMap::new();
    for (name, bytes) in extents(program, section) {
        let whose = match name {
            _ if section.name == ".vector_table" => "vector table".into(),
            Some(name) if handlers.iter().any(|handler| handler == name) => {
                "tater (interrupt handlers)".into()
            }
            Some(name) => origin(name),
            None if section.code || section.bytes.is_empty() => ALIGNMENT.into(),
            None => "constants without a name".into(),
        };
        *crates.entry(whose).or_default() += bytes;
    }
    crates
}

/// Splits the section at its symbols: each byte counts once, for the last symbol that begins before it, if
/// any.
pub fn extents<'p>(program: &'p Program, section: &Section) -> Vec<(Option<&'p str>, u32)> {
    let inside = |start: u32| (section.start..section.end()).contains(&start);
    let symbols: Vec<_> = program.symbols.iter().filter(|symbol| inside(symbol.start)).collect();
    let mut extents = Vec::new();
    let mut at = section.start;
    for (index, symbol) in symbols.iter().enumerate() {
        let next = symbols.get(index + 1).map_or(section.end(), |next| next.start);
        // Assembler symbols have no length: a function extends to the next symbol.
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

/// Crate or kind of a symbol.
pub fn origin(name: &str) -> String {
    let fits =
        |pattern: &str| pattern.strip_suffix('*').map_or(name == pattern, |start| name.starts_with(start));
    // `.Lswitch.table.` with the name of its function.
    let function = name.find("_ZN").or_else(|| name.find("_RN")).map_or(name, |at| &name[at..]);
    let text = plain(function);
    if text.contains("::") {
        // `<&mut T as Trait>::f` belongs to T's crate.
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

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::super::elf::Symbol;
    use super::*;

    #[test]
    fn crate_is_found_in_both_manglings() {
        for (name, crate_) in [
            ("_ZN10servo_core5servo5Servo4plan17hd4e02904b985974aE", "servo_core"),
            (
                "_ZN75_$LT$tater_fw..bsp..metal..Armed$u20$as$u20$tater_fw..bsp..metal..Motor$GT$6analog17h4a305c966236438bE",
                "tater_fw",
            ),
            (
                "_ZN62_$LT$$RF$mut$u20$servo_core..X$u20$as$u20$core..fmt..Debug$GT$3fmt17h4a305c966236438bE",
                "servo_core",
            ),
            ("_ZN4core3ptr45drop_in_place$LT$tater_fw..monitor..Phase$GT$17h8e9995bfd624b0d4E", "core"),
            ("_RNvNtCs1234_10servo_core3num5round", "servo_core"),
            (".Lswitch.table._ZN10tater_wire8property5table8Property4spec17h1ec259c43e4b3631E", "tater_wire"),
            (".Lanon.6393b366adb2bdc118465150026bf733.111", "constants without a name"),
            ("__aeabi_memcpy4", "tater_fw (assembler)"),
            ("__aeabi_uldivmod", "compiler_builtins"),
            ("Reset", "cortex_m_rt"),
            ("OUTLINED_FUNCTION_7", "pieces of several functions"),
            ("surprise", "surprise (no crate)"),
        ] {
            assert_eq!(origin(name), crate_, "{name} ({})", plain(name));
        }
    }

    #[test]
    fn each_byte_counts_once() {
        let symbol = |name: &str, start, len, function| Symbol { name: name.into(), start, len, function };
        let program = Program {
            sections: vec![Section {
                name: ".text".into(),
                start: 100,
                len: 60,
                bytes: vec![0; 60],
                code: true,
            }],
            symbols: vec![
                symbol("before", 90, 30, true),
                // Two names for one place; an assembler symbol; one that extends beyond others.
                symbol("a", 104, 10, true),
                symbol("b", 104, 10, true),
                symbol("assembled", 120, 0, true),
                symbol("Reset", 130, 20, true),
                symbol("inside", 140, 100, true),
                symbol("label", 150, 0, false),
            ],
            code: BTreeMap::new(),
        };
        let section = &program.sections[0];
        let extents = extents(&program, section);
        assert_eq!(
            extents,
            [
                (None, 4),
                (Some("a"), 10),
                (None, 6),
                (Some("assembled"), 10),
                (Some("Reset"), 20),
                (Some("inside"), 10),
            ]
        );
        let crates = of(&program, section, &["a".into()]);
        assert_eq!(crates.values().sum::<u32>(), section.len);
        assert_eq!(crates["tater (interrupt handlers)"], 10);
        assert_eq!((crates["alignment"], crates["cortex_m_rt"]), (10, 20));
    }
}
