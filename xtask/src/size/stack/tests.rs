use super::super::graph::tests::{NONE, TEXT, program};
use super::*;

/// push {r4, lr}; bl to what follows; pop {r4, pc}.
const CALLS_NEXT: [u16; 4] = [0xB510, 0xF000, 0xF801, 0xBD10];
/// sub sp, #64; add sp, #64; bx lr.
const LEAF: [u16; 3] = [0xB090, 0xB010, 0x4770];
/// b .
const FOREVER: [u16; 1] = [0xE7FE];

fn task(binds: &str, priority: u32) -> Task {
    Task { binds: binds.into(), priority }
}

fn levels(worst: &Worst) -> Vec<(&str, u32)> {
    worst.levels.iter().map(|level| (level.name.as_str(), level.bytes())).collect()
}

#[test]
fn path_is_the_sum_of_its_frames() {
    let program = program(&[(1, TEXT)], &[("Reset", &CALLS_NEXT), ("leaf", &LEAF)], NONE);
    let worst = worst(&program, &[]).unwrap();
    let path: Vec<_> = worst.start.path.iter().map(|frame| (frame.function.as_str(), frame.bytes)).collect();
    assert_eq!((worst.start.bytes, path), (72, vec![("Reset", 8), ("leaf", 64)]));
    assert_eq!((worst.bytes(), worst.margin()), (72, 8192 - 72));
}

#[test]
fn each_priority_counts_its_deepest_handler_once() {
    let at = |index: u32| TEXT + index * 2;
    // Handlers of 4 and 8 bytes with the same priority; one of 12 above them.
    let functions: [(&str, &[u16]); 6] = [
        ("Reset", &FOREVER),
        ("CAN_TX", &[0xB410, 0xE7FE]),
        ("CAN_RX", &[0xB510, 0xE7FE]),
        ("TIM4", &[0xB5B0, 0xE7FE]),
        ("DefaultHandler", &FOREVER),
        ("HardFault", &FOREVER),
    ];
    let vectors = [(1, at(0)), (2, at(7)), (3, at(8)), (16, at(1)), (17, at(3)), (18, at(5)), (19, at(7))];
    let program = program(&vectors, &functions, NONE);
    let tasks = [task("CAN_TX", 2), task("TIM4", 5), task("CAN_RX", 2)];
    let found = worst(&program, &tasks).unwrap();
    let frame = EXCEPTION_FRAME;
    assert_eq!(
        levels(&found),
        [
            ("main", 0),
            ("priority 2", frame + 8),
            ("priority 5", frame + 16),
            ("unbound", frame),
            ("HardFault", frame),
            ("NMI", frame),
        ]
    );
    assert_eq!(found.bytes(), 24 + 5 * frame);
    let error = worst(&program, &tasks[..2]).unwrap_err();
    assert!(error.starts_with("found vector 17 with handler CAN_RX, expected one of the tasks"), "{error}");
}

#[test]
fn masked_start_is_not_below_interrupts() {
    // cpsid i; sub sp, #64; add sp, #64; cpsie i; b .
    let reset = [0xB672, 0xB090, 0xB010, 0xB662, 0xE7FE];
    let functions: [(&str, &[u16]); 2] = [("Reset", &reset), ("TIM4", &LEAF)];
    let found = worst(&program(&[(1, TEXT), (16, TEXT + 10)], &functions, NONE), &[task("TIM4", 1)]).unwrap();
    assert_eq!(levels(&found), [("main", 0), ("priority 1", EXCEPTION_FRAME + 64)]);
    assert_eq!((found.start.bytes, found.bytes()), (64, EXCEPTION_FRAME + 64));
    // The same with cpsie i before the stack is released.
    let reset = [0xB672, 0xB090, 0xB662, 0xB010, 0xE7FE];
    let functions: [(&str, &[u16]); 2] = [("Reset", &reset), ("TIM4", &LEAF)];
    let found = worst(&program(&[(1, TEXT), (16, TEXT + 10)], &functions, NONE), &[task("TIM4", 1)]).unwrap();
    assert_eq!(found.bytes(), 64 + EXCEPTION_FRAME + 64);
}

#[test]
fn interrupts_enabled_by_a_callee_count_on_top_of_its_callers() {
    // cpsid i; push {r4, lr}; bl next; pop {r4, pc}. Then: push {r4, lr}; bl next; cpsid i; pop {r4, pc}.
    let reset = [0xB672, 0xB510, 0xF000, 0xF801, 0xBD10];
    let middle = [0xB510, 0xF000, 0xF802, 0xB672, 0xBD10];
    let opens: [u16; 2] = [0xB662, 0x4770];
    let functions: [(&str, &[u16]); 3] = [("Reset", &reset), ("middle", &middle), ("opens", &opens)];
    let found = worst(&program(&[(1, TEXT)], &functions, NONE), &[]).unwrap();
    assert_eq!(levels(&found), [("main", 16)]);
    // They stay after it: cpsid i; push {r4, lr}; bl next; sub sp, #64; b .
    let reset = [0xB672, 0xB510, 0xF000, 0xF802, 0xB090, 0xE7FE];
    let functions: [(&str, &[u16]); 2] = [("Reset", &reset), ("opens", &opens)];
    let found = worst(&program(&[(1, TEXT)], &functions, NONE), &[]).unwrap();
    assert_eq!(levels(&found), [("main", 72)]);
}

#[test]
fn call_by_register_reaches_every_taken_address() {
    // push {r4, lr}; blx r0; pop {r4, pc}; nop; the address of leaf, which is next to g.
    let leaf = (TEXT + 12) | 1;
    let [low, high] = [leaf & 0xFFFF, leaf >> 16].map(|half| u16::try_from(half).unwrap());
    let reset = [0xB510, 0x4780, 0xBD10, 0xBF00, low, high];
    let functions: [(&str, &[u16]); 3] = [("Reset", &reset), ("leaf", &LEAF), ("idle", &FOREVER)];
    let found = worst(&program(&[(1, TEXT)], &functions, TEXT + 8..TEXT + 12), &[]).unwrap();
    assert_eq!(found.start.bytes, 72);
    assert_eq!((found.by_register, found.unreached), (vec!["leaf".to_owned()], vec!["idle".to_owned()]));
}

#[test]
fn recursion_is_an_error_with_its_chain() {
    // push {r4, lr}; bl next; pop {r4, pc}. Then: b.w first.
    let functions: [(&str, &[u16]); 2] = [("Reset", &CALLS_NEXT), ("back", &[0xF7FF, 0xBFFA])];
    let error = worst(&program(&[(1, TEXT)], &functions, NONE), &[]).unwrap_err();
    assert!(error.ends_with("found a recursion, expected none: Reset > back"), "{error}");
}

#[test]
fn function_with_unvisited_code_is_an_error() {
    let functions: [(&str, &[u16]); 1] = [("Reset", &[0x4770, 0xB410, 0x4770])];
    let error = worst(&program(&[(1, TEXT)], &functions, NONE), &[]).unwrap_err();
    assert!(error.contains("Reset at 0x08004132: found an instruction on no path"), "{error}");
}
