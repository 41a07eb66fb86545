//! Any bytes from a host, any answers from the boards: the prompt comes back.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tater_fuzz::God;

fuzz_target!(|input: (u32, &[u8])| {
    let (word, bytes) = input;
    let mut god = God::new(word);
    bytes.iter().for_each(|&byte| god.hear(byte));
    assert!(god.prompts());
});
