//! Any bytes from a CAN tool: every line is answered, memory is bounded.
#![no_main]

use hil_world::bus::Stamped;
use hil_sim::slcan::Slcan;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let (mut slcan, mut out) = (Slcan::default(), Vec::new());
    for &byte in input {
        let before = out.len();
        if let Some(frame) = slcan.push(byte, &mut out) {
            // What a tool may send, it may also receive.
            slcan.frame(&Stamped { at_us: 1, frame }, &mut out);
        }
        assert_eq!(out.len() > before, byte == b'\r', "an answer a line");
        assert!(out.len() - before <= 64);
    }
});
