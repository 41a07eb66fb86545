use std::collections::BTreeMap;
use std::ops::Range;

use super::super::elf::{Section, Symbol};
use super::*;

/// Start of the test programs, behind a vector table.
pub const TEXT: u32 = 0x0800_4130;

/// No data between the instructions.
pub const NONE: Range<u32> = 0..0;

/// A program of functions from [`TEXT`] on, with a vector table. `data` are addresses without instructions.
pub fn program(vectors: &[(u32, u32)], functions: &[(&str, &[u16])], data: Range<u32>) -> Program {
    let mut table = vec![0; 0x130];
    for &(number, address) in vectors {
        let at = usize::try_from(4 * number).unwrap();
        table[at..at + 4].copy_from_slice(&(address | 1).to_le_bytes());
    }
    let (mut text, mut symbols) = (Vec::new(), Vec::new());
    for (name, halves) in functions {
        let start = TEXT + u32::try_from(text.len()).unwrap();
        text.extend(halves.iter().flat_map(|half| half.to_le_bytes()));
        let len = 2 * u32::try_from(halves.len()).unwrap();
        symbols.push(Symbol { name: (*name).into(), start, len, function: true });
    }
    let mut code = BTreeMap::from([(TEXT, true)]);
    if !data.is_empty() {
        code.insert(data.start, false);
        code.insert(data.end, true);
    }
    let section = |name: &str, start, bytes: Vec<u8>, code| {
        let len = u32::try_from(bytes.len()).unwrap();
        Section { name: name.into(), start, len, bytes, code }
    };
    let sections =
        vec![section(".vector_table", TEXT - 0x130, table, false), section(".text", TEXT, text, true)];
    Program { sections, symbols, code }
}

/// Paths through the first function.
fn ways(halves: &[u16], data: Range<u32>) -> Result<Ways, String> {
    let program = program(&[], &[("f", halves), ("g", &[0x4770])], data);
    Graph::new(&program).ways(TEXT, false, &mut |_| Ok(false))
}

fn depths(ways: &Ways) -> Vec<(u32, i32)> {
    ways.calls.iter().map(|(at, call)| (at - TEXT, call.depth)).collect()
}

#[test]
fn frame_includes_pushes_and_locals() {
    // push {r7, lr}; mov r7, sp; sub sp, #16; add sp, #16; pop {r7, pc}
    let ways = ways(&[0xB580, 0x466F, 0xB084, 0xB004, 0xBD80], NONE).unwrap();
    assert_eq!((ways.deepest, ways.deepest_open), (24, 24));
}

#[test]
fn each_call_has_its_own_depth() {
    // push {r4, lr}; bl g; sub sp, #8; bl g; add sp, #8; pop.w {r4, lr}; b.w g
    let ways =
        ways(&[0xB510, 0xF000, 0xF808, 0xB082, 0xF000, 0xF805, 0xB002, 0xE8BD, 0x4010, 0xF000, 0xB800], NONE)
            .unwrap();
    assert_eq!(depths(&ways), [(2, 8), (8, 16), (18, 0)]);
    assert!(ways.calls.values().all(|call| call.callee == Callee::At(TEXT + 22)), "{:?}", ways.calls);
}

#[test]
fn deeper_side_of_a_branch_counts() {
    // cbz r0, +4 (over the push); push {r4}; nop; sub sp, #4; bkpt-free end: b .
    let ways = ways(&[0xB108, 0xB410, 0xBF00, 0xB081, 0xE7FE], NONE).unwrap();
    assert_eq!(ways.deepest, 8);
}

#[test]
fn conditional_return_keeps_the_depth() {
    // push {r7, lr}; it ne; popne {r7, pc}; sub sp, #8; add sp, #8; pop {r7, pc}
    let ways = ways(&[0xB580, 0xBF18, 0xBD80, 0xB082, 0xB002, 0xBD80], NONE).unwrap();
    assert_eq!(ways.deepest, 16);
}

#[test]
fn tail_call_by_register_ends_the_path() {
    // push {r4}; cbz r0 over bx; bx r3; nop; b.w g
    let last = ways(&[0xB410, 0xB108, 0x4718, 0xBF00, 0xF000, 0xB800], NONE).unwrap();
    let calls: Vec<_> = last.calls.iter().map(|(at, call)| (at - TEXT, call.callee, call.depth)).collect();
    assert_eq!(calls, [(4, Callee::Any, 4), (8, Callee::At(TEXT + 12), 4)]);
    // cbz r0 over bx; bx r3; b.w g
    let aligned = ways(&[0xB100, 0x4718, 0xF000, 0xB800], NONE).unwrap();
    assert_eq!(depths(&aligned), [(2, 0), (4, 0)]);
    // it ne; bxne r3; push {r4}; b .
    let skipped = ways(&[0xBF18, 0x4718, 0xB410, 0xE7FE], NONE).unwrap();
    assert_eq!((depths(&skipped), skipped.deepest), (vec![(2, 0)], 4));
}

#[test]
fn jump_tables_lead_to_all_targets() {
    // tbb [pc, r0]; 2, 3, 4, filled up by 0; bx lr; push {r4} bx lr is missing: b . after it
    let bytes = ways(&[0xE8DF, 0xF000, 0x0302, 0x0004, 0x4770, 0xE7FE, 0xB410, 0xE7FE], TEXT + 4..TEXT + 8);
    assert_eq!(bytes.unwrap().deepest, 4);
    let halves = ways(&[0xE8DF, 0xF010, 0x0002, 0x0003, 0x4770, 0xB410, 0xE7FE], TEXT + 4..TEXT + 8);
    assert_eq!(halves.unwrap().deepest, 4);
    // adr r2, the table; tbb [r2, r0]; a constant; 3, 3; a constant; push {r4}; b .
    let elsewhere =
        ways(&[0xA201, 0xE8D2, 0xF000, 0x4000, 0x0303, 0x65FF, 0xB410, 0xE7FE], TEXT + 6..TEXT + 12);
    assert_eq!(elsewhere.unwrap().deepest, 4);
    // mov pc, r0; nop; b.w over the next; b.w to push {r4}; b .
    let jumps = ways(&[0x4687, 0xBF00, 0xF000, 0xB804, 0xF000, 0xB800, 0xB410, 0xE7FE, 0xE7FE], NONE);
    assert_eq!(jumps.unwrap().deepest, 4);
}

#[test]
fn unknown_jump_is_an_error_with_its_address() {
    for (halves, what) in [
        (&[0x4687, 0x4770][..], "found a jump by a register"),
        // add pc, r0; nop; b.w
        (&[0x4487, 0xBF00, 0xF000, 0xB800], "found a jump by a register"),
        (&[0xDF00, 0x4770], "found SVC"),
        (&[0xF380, 0x8814, 0x4770], "found a stack pointer set"),
        (&[0x468D, 0x4770], "found a stack pointer set"),
        (&[0xF004, 0xE800], "found an instruction that a Cortex-M3 lacks"),
        (&[0xBF00], "found data, expected an instruction"),
        (&[0xB410, 0xE7FD], "found a loop that pushes without end"),
        (&[0xE8DF, 0xF000], "found a table jump without"),
        (&[0xE8D2, 0xF000], "found a jump by a register"),
    ] {
        let error = ways(halves, NONE).unwrap_err();
        assert!(error.starts_with("f at 0x0800413") && error.contains(what), "{halves:x?}: {error}");
    }
}

#[test]
fn data_after_a_call_without_return_is_not_followed() {
    // push {r7, lr}; bl g; nop; data
    let ways = ways(&[0xB580, 0xF000, 0xF803, 0xBF00, 0x1234, 0x5678], TEXT + 8..TEXT + 12).unwrap();
    assert_eq!(depths(&ways), [(2, 8)]);
}

#[test]
fn unvisited_instruction_is_found() {
    let program = program(&[], &[("f", &[0x4770, 0xBF00, 0xB410, 0x4770])], NONE);
    let graph = Graph::new(&program);
    let ways = graph.ways(TEXT, false, &mut |_| Ok(false)).unwrap();
    assert_eq!(graph.missed(&graph.functions()[0], &[&ways]), Some(TEXT + 4));
    let rest = graph.ways(TEXT + 4, false, &mut |_| Ok(false)).unwrap();
    assert_eq!(graph.missed(&graph.functions()[0], &[&ways, &rest]), None);
}

#[test]
fn masked_needs_every_path_masked() {
    // cpsid i; push {r4}; cpsie i; pop {r4}; bx lr
    let open = ways(&[0xB672, 0xB410, 0xB662, 0xBC10, 0x4770], NONE).unwrap();
    assert_eq!((open.deepest, open.deepest_open, open.opens), (4, 4, true));
    // cpsid i; push {r4}; pop {r4}; cpsie i; bx lr
    let masked = ways(&[0xB672, 0xB410, 0xBC10, 0xB662, 0x4770], NONE).unwrap();
    assert_eq!((masked.deepest, masked.deepest_open, masked.opens), (4, 0, true));
    // cbz r0 over cpsid i; push {r4}; b .
    let perhaps = ways(&[0xB100, 0xB672, 0xB410, 0xE7FE], NONE).unwrap();
    assert_eq!((perhaps.deepest, perhaps.deepest_open), (4, 4));
}

#[test]
fn literal_and_built_addresses_are_taken() {
    // f has the address of g in a literal and builds that of h.
    let (g, h) = (TEXT + 16, TEXT + 18);
    let [low, high] = [(g | 1) & 0xFFFF, g >> 16].map(|half| u16::try_from(half).unwrap());
    // movw r0, #h + 1; movt r0, #0x0800; bx lr; nop; literal
    let f = [0xF244, 0x1043, 0xF6C0, 0x0000, 0x4770, 0xBF00, low, high];
    assert_eq!(h | 1, 0x0800_4143, "as the constants of f have it");
    let program = program(
        &[(1, TEXT)],
        &[("f", &f), ("g", &[0x4770]), ("h", &[0x4770]), ("i", &[0x4770])],
        TEXT + 12..TEXT + 16,
    );
    assert_eq!(Graph::new(&program).taken, BTreeSet::from([g, h]));
}

#[test]
fn each_lower_half_combines_with_an_upper_one() {
    let (g, h) = (TEXT + 16, TEXT + 18);
    // cbz r1; movw r0, #g + 1; b; movw r0, #h + 1; movt r0, #0x0800; bx lr
    let f = [0xB111, 0xF244, 0x1041, 0xE001, 0xF244, 0x1043, 0xF6C0, 0x0000];
    let ends: [(&str, &[u16]); 2] = [("g", &[0x4770]), ("h", &[0x4770])];
    let program = program(&[(1, TEXT)], &[("f", &f), ends[0], ends[1]], NONE);
    assert_eq!(Graph::new(&program).taken, BTreeSet::from([g, h]));
}

#[test]
fn chain_leads_from_its_root_to_the_function() {
    // Each calls the next, by bl, b.w and bne.w; the last two call each other.
    let calls: [(&str, &[u16]); 4] = [
        ("Reset", &[0xF000, 0xF802, 0x4770, 0xBF00]),
        ("other", &[0xF000, 0xB802, 0x4770, 0xBF00]),
        ("panic", &[0xF040, 0x8002, 0x4770, 0xBF00]),
        ("back", &[0xF7FF, 0xBFFA, 0x4770, 0xBF00]),
    ];
    let program = program(&[(1, TEXT)], &calls, NONE);
    let graph = Graph::new(&program);
    assert_eq!(graph.chain(TEXT), ["Reset"]);
    assert_eq!(graph.chain(TEXT + 16), ["Reset", "other", "panic"]);
}
