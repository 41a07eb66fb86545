//! Recorded hall lines through the servo's decoder and estimator.
//!
//! A capture is a run of three-byte samples: 0x5A, then the hall code (bits 2..0 of a little-endian word). It
//! may begin in the middle of a sample, and may be gzipped.

use servo_core::sense::hall::{HallDecoder, HallEvent, Wiring};
use servo_core::sense::velocity::Estimator;
use servo_core::units::Micros;
use std::io::{Read, Write};
use std::path::Path;

/// Codes of sectors 0..5 of the recorded motors: the hand's wiring, counted from another sector.
const CODES: [u8; 6] = [1, 3, 2, 6, 4, 5];

/// A capture that cannot be replayed, as one line: what, where, found, wanted, and what to do.
#[derive(Debug, PartialEq, Eq)]
pub struct ReplayError(String);

impl std::fmt::Display for ReplayError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for ReplayError {}

/// Writes one `position,velocity` line (hall counts, counts/s) for each sample of a capture; returns how many.
///
/// Of 90 counts a revolution, the places of 180 edges are learned: a recording's motor is often not the one its
/// user thinks of, and 180 holds every motor of 1, 2, 3, 5, 6, 10, 15 or 30 pairs of poles.
///
/// # Errors
/// A file that cannot be read or is no capture, a sample rate or counts a revolution out of range, a full disk.
pub fn replay(
    capture: &Path,
    counts_per_rev: u32,
    rate_hz: u32,
    out: &mut impl Write,
) -> Result<usize, ReplayError> {
    if !(1000..=1_000_000).contains(&rate_hz) {
        return Err(ReplayError(format!(
            "--rate-hz {rate_hz}: a sample rate of 1000 to 1000000 Hz is wanted; the recorder's is usually 30000"
        )));
    }
    let estimate = estimator_for(counts_per_rev)?;
    let codes =
        codes(&bytes(capture)?).map_err(|what| ReplayError(format!("{}: {what}", capture.display())))?;
    for (position, velocity) in estimate(&codes, rate_hz) {
        writeln!(out, "{position:.4},{velocity:.3}").map_err(|e| {
            ReplayError(format!("cannot write the estimate: {e}; is there space, and is the path writable?"))
        })?;
    }
    Ok(codes.len())
}

/// The estimator of a motor with this many counts a revolution, six a pole pair. The hand's own learns its 18
/// edges, as on the board; any other learns two revolutions (see [`replay`]).
fn estimator_for(counts_per_rev: u32) -> Result<Estimate, ReplayError> {
    macro_rules! by_pole_pairs {
        ($($pairs:literal)*) => {
            match counts_per_rev {
                18 => Ok(estimate::<18> as Estimate),
                $(counts if counts == 6 * $pairs => Ok(estimate::<{ 12 * $pairs }> as Estimate),)*
                _ => Err(ReplayError(format!(
                    "--counts-per-rev {counts_per_rev}: six counts for each pair of poles are wanted, 6 to 180; \
                     the hand's motors have 18"
                ))),
            }
        };
    }
    by_pole_pairs!(1 2 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30)
}

/// Position and velocity at each sample of recorded codes.
type Estimate = fn(&[u8], u32) -> Vec<(f64, f64)>;

/// The file, unpacked if it begins as gzip does.
fn bytes(path: &Path) -> Result<Vec<u8>, ReplayError> {
    let fail = |what: &str, e: std::io::Error, next: &str| {
        ReplayError(format!("{}: cannot {what}: {e}; {next}", path.display()))
    };
    let raw = std::fs::read(path).map_err(|e| fail("read", e, "check the path"))?;
    if !raw.starts_with(&[0x1F, 0x8B]) {
        return Ok(raw);
    }
    let mut unpacked = Vec::new();
    flate2::read::MultiGzDecoder::new(raw.as_slice())
        .read_to_end(&mut unpacked)
        .map_err(|e| fail("unpack", e, "the file is damaged or cut short; copy it again"))?;
    Ok(unpacked)
}

/// The hall codes of a capture.
///
/// # Errors
/// What is wrong with it, without the file's name.
pub fn codes(raw: &[u8]) -> Result<Vec<u8>, String> {
    const SYNC: u8 = 0x5A;
    let aligned = |at: usize| (0..5).all(|k| raw.get(at + 3 * k) == Some(&SYNC));
    // Alignment is at one of three offsets, unless the recording begins with rubbish.
    let Some(start) = (0..raw.len()).find(|&at| aligned(at)) else {
        return Err(format!(
            "no five samples in a row begin with 0x5A in {} bytes; a capture is 3 bytes a sample: 0x5A, code, 0",
            raw.len()
        ));
    };
    let mut codes = Vec::with_capacity(raw.len() / 3);
    // The last sample may be cut: it is left out whether or not it is whole.
    for at in (start..raw.len().saturating_sub(3)).step_by(3) {
        match raw.get(at..at + 2) {
            Some(&[SYNC, code]) => codes.push(code & 7),
            found => {
                return Err(format!(
                    "sample {} at byte {at}: found {found:02X?}, want 0x5A and a code; bytes were lost, record again",
                    codes.len()
                ));
            }
        }
    }
    Ok(codes)
}

/// Position and velocity at each sample. Nothing but the edges is known of the recorded rotor, so they are
/// [`undecided`](Estimator::undecided); the servo takes [`at`](Estimator::at) of the same estimator with the same
/// constants.
///
/// The lines' changes call the decoder as the interrupt does, and so does a tick each millisecond.
#[must_use]
pub fn estimate<const N: usize>(codes: &[u8], rate_hz: u32) -> Vec<(f64, f64)> {
    let Some(wiring) = Wiring::new(CODES) else { return Vec::new() };
    let first = codes.first().copied().unwrap_or(0);
    let mut halls = HallDecoder::new(wiring, first, 0);
    let mut estimator = Estimator::<N>::new(0);
    let mut last = first;
    let mut tick = 0_u64;
    let mut rows = Vec::with_capacity(codes.len());
    for (i, &code) in (0_u64..).zip(codes) {
        let us = i * 1_000_000 / u64::from(rate_hz);
        let now = Micros(u32::try_from(us & u64::from(u32::MAX)).unwrap_or(0));
        let ticked = us / 1000 > tick;
        tick = us / 1000;
        if code != last || ticked {
            if let Some(HallEvent::Step(edge)) = halls.sample(code, now) {
                estimator.edge(&edge);
            }
            last = code;
        }
        let (position, velocity) = estimator.undecided(now);
        rows.push((position.0.to_num::<f64>(), velocity.0.to_num::<f64>()));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A capture of `samples` codes that turns one cell in twenty samples.
    fn capture(samples: usize) -> Vec<u8> {
        (0..samples).flat_map(|i| [0x5A, CODES[i / 20 % 6], 0]).collect()
    }

    fn file(name: &str, content: &[u8]) -> std::path::PathBuf {
        let path = std::env::temp_dir().join(format!("replay-{}-{name}", std::process::id()));
        std::fs::write(&path, content).expect("temporary file");
        path
    }

    #[test]
    fn one_line_a_sample_whatever_the_start_and_packing() {
        let raw = capture(3000);
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        packed.write_all(&raw).expect("pack");
        let packed = packed.finish().expect("pack");
        // The last sample is left out, as the scorer does; cut in its middle, the rest is the same.
        for (name, bytes, want) in [
            ("whole", &raw[..], 2999),
            ("cut", &raw[..8998], 2999),
            ("begun", &raw[2..], 2998),
            ("packed", &packed, 2999),
        ] {
            let path = file(name, bytes);
            let mut out = Vec::new();
            assert_eq!(replay(&path, 90, 30_000, &mut out), Ok(want), "{name}");
            std::fs::remove_file(path).expect("temporary file");
            let text = String::from_utf8(out).expect("text");
            assert_eq!(text.lines().count(), want, "{name}");
            // 20 samples of 1/30000 s a count: 1500 counts/s.
            let last: Vec<f64> = text
                .lines()
                .last()
                .into_iter()
                .flat_map(|l| l.split(','))
                .map(|x| x.parse().expect("number"))
                .collect();
            assert!((last[1] - 1500.0).abs() < 15.0, "{name}: {last:?}");
            assert!((last[0] - 149.5).abs() < 1.5, "{name}: {last:?}");
        }
    }

    #[test]
    fn bad_input_is_named() {
        let mut lost = capture(100);
        lost.drain(151..153);
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        packed.write_all(&capture(3000)).expect("pack");
        let packed = packed.finish().expect("pack");
        for (name, bytes, counts, rate, want) in [
            ("empty", &[][..], 90, 30_000, "no five samples"),
            ("text", b"this is no capture", 90, 30_000, "no five samples"),
            ("short", &capture(4), 90, 30_000, "no five samples"),
            ("lost", &lost, 90, 30_000, "sample 51 at byte 153"),
            ("damaged", &packed[..packed.len() / 2], 90, 30_000, "damaged or cut short"),
            ("rate", &capture(100), 90, 0, "--rate-hz 0"),
            ("counts", &capture(100), 91, 30_000, "six counts for each pair of poles"),
        ] {
            let path = file(name, bytes);
            let error = replay(&path, counts, rate, &mut Vec::new()).expect_err(name).to_string();
            assert!(error.contains(want), "{name}: {error}");
            std::fs::remove_file(path).expect("temporary file");
        }
        let error =
            replay(Path::new("/no/such.dat"), 90, 30_000, &mut Vec::new()).expect_err("absent").to_string();
        assert!(error.contains("/no/such.dat") && error.contains("check the path"), "{error}");
    }
}
