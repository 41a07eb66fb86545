//! Any bytes in RealTime with any flags, any answers from the boards: each block has the answer of manual
//! 6.2, to the byte; ^C or a bad header gives a prompt, and then every motor has been ordered to stop.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tater_fuzz::{God, PROMPT};

/// The sizes of the blocks of seven motors, by the bits of their flags.
struct Shape {
    control: usize,
    feedback: usize,
}

fn begin(god: &mut God, flags: u16) -> Shape {
    let bit = |bit: u16| usize::from(flags >> bit & 1);
    let [lcv, lcpg, lfv, lfs, lfdp, lft, lfdpd] = [bit(0), bit(1), bit(2), bit(3), bit(4), bit(5), bit(6)];
    let lfap = usize::from(flags >> 7 & 3) % 3;
    god.types(&format!("X1234567FSET LCV {lcv} LCPG {lcpg} LFV {lfv} LFS {lfs} LFDP {lfdp} LFAP {lfap}\r"));
    god.types(&format!("PSET LFT {lft} LFDPD {lfdpd}\rX1234567LOOP\r"));
    // A board may take 40 ms until it drives.
    god.run_for(50_000);
    assert!(god.is_raw() && god.said.ends_with(b"LOOP*"), "{}", god.told());
    let each = lfv + lfs + lfdp + [0, 4, 2][lfap];
    Shape { control: 7 * (lcv + lcpg), feedback: 1 + 7 * each + 2 * lft }
}

fuzz_target!(|input: (u32, u16, &[u8])| {
    let (word, flags, bytes) = input;
    let mut god = God::new(word, true);
    let Shape { control, feedback } = begin(&mut god, flags);
    let mut expected = god.said.len();
    // One LF still belongs to LOOP's line.
    let bytes = bytes.strip_prefix(b"\n").map_or(bytes, |rest| {
        god.send(b'\n');
        rest
    });
    let mut bytes = bytes.iter().copied();
    'blocks: while let Some(header) = bytes.next() {
        god.send(header);
        let error = match header {
            b'C' | b'A' => {
                expected += feedback;
                None
            }
            b'a' => {
                expected += 1;
                None
            }
            b'c' => None,
            3 => Some(""),
            _ => Some("\r\n\rERR 2048"),
        };
        if let Some(error) = error {
            // After an error GOD drains the host's bytes until it has been silent for 20 ms.
            god.run_for(30_000);
            assert_eq!(String::from_utf8_lossy(&god.said[expected..]), format!("{error}{PROMPT}"));
            assert!(god.stands() && !god.is_raw());
            break;
        }
        if matches!(header, b'C' | b'c') {
            for _ in 0..control {
                assert_eq!(god.said.len(), expected, "{}", god.told());
                match bytes.next() {
                    Some(byte) => god.send(byte),
                    None => break 'blocks,
                }
            }
        }
        expected += usize::from(header == b'c');
        assert_eq!(god.said.len(), expected, "{}", god.told());
    }
    // The rest is lines.
    bytes.for_each(|byte| god.send(byte));
    god.must_prompt();
});
