//! Any file: the reader neither panics nor finds more data than there are characters, and its error persists.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tater_wire::tek::{Dialect, Reader, Record};

fuzz_target!(|input: (bool, &[u8])| {
    let (strict, file) = input;
    let mut reader = Reader::new(if strict { Dialect::Ti } else { Dialect::Gnu });
    let (mut found, mut failed) = (0, None);
    for &byte in file {
        match reader.push(byte) {
            Ok(Some(Record::Data { bytes, .. })) => found += 2 * bytes.len(),
            Ok(_) => assert_eq!(failed, None, "an error stays"),
            Err(error) => {
                assert_eq!(*failed.get_or_insert(error), error);
                assert!(error.to_string().contains("expected") || !error.to_string().is_empty());
            }
        }
        let _ = reader.section();
    }
    let _ = reader.finish();
    assert!(found <= file.len());
});
