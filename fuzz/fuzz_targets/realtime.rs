//! Any bytes in RealTime, any answers from the boards: ^C, or a bad header, gives the prompt back.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tater_fuzz::God;

fuzz_target!(|input: (u32, &[u8])| {
    let (word, bytes) = input;
    let mut god = God::new(word);
    b"X1234567LOOP\r".iter().for_each(|&byte| god.hear(byte));
    bytes.iter().for_each(|&byte| god.hear(byte));
    assert!(god.prompts());
});
