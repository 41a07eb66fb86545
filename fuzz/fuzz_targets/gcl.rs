//! Any words and bytes from a host, any answers from the boards: the prompt returns, and the output is text.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tater_fuzz::{God, text};

fuzz_target!(|input: (u32, bool, &[u8])| {
    let (word, known, bytes) = input;
    let mut god = God::new(word, known);
    text(bytes).iter().for_each(|&byte| god.send(byte));
    god.must_prompt();
    god.must_be_text();
});
