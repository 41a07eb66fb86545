//! Any characters: the monitor's decoder neither panics nor returns a record longer than its characters.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tater_wire::tek::{Decoder, Record};

fuzz_target!(|input: &[u8]| {
    let mut decoder = Decoder::default();
    let (mut bytes_in, mut bytes_out) = (0, 0);
    for &character in input {
        bytes_in += 1;
        match decoder.push(character) {
            Ok(Some(Record::Data { bytes, .. })) => bytes_out += 2 * bytes.len(),
            Ok(_) => {}
            Err(_) => break,
        }
        assert!(bytes_out <= bytes_in);
    }
});
