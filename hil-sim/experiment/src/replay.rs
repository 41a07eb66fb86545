//! Runs recorded hall lines through the servo's decoder and the estimator of recorded shafts.
//!
//! A capture is a sequence of three-byte samples: 0x5A, then the hall code (bits 2..0 of a little-endian
//! word, whose other bits are 0). It may begin in the middle of a sample, and may be gzipped.
//!
//! No hall code is 0x5A, so samples are found again after bytes that were lost, added or damaged (see [`samples`]).

use crate::recorded::{RecordedShaft, SPEED_MAX};
use servo_core::sense::hall::{HallDecoder, HallEvent, Wiring};
use servo_core::units::{Counts, CountsPerSec, Micros};
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

use traces::input::BadInput;

/// The wiring of the recorded motors: the hand's, whose codes are 2, 6, 4, 5, 1, 3, counted from two sectors before.
const WIRING: u8 = 2;

const SYNC: u8 = 0x5A;

/// Largest capture read, compressed or not: 64 MiB are 12 minutes at 30 kHz, and need 1 GB during the replay.
const MAX_BYTES: u64 = 64 << 20;

/// Samples in a row that show where samples begin.
const RUN: usize = 5;

/// How often something happened, and where first; both 0 if never.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// How often.
    pub count: usize,
    /// Where first.
    pub first: usize,
}

impl Tally {
    fn add(&mut self, count: usize, at: usize) {
        if self.count == 0 {
            self.first = at;
        }
        self.count += count;
    }
}

/// Result of a replay. Lines are those of the estimate, from 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Replayed {
    /// Samples, and lines written.
    pub samples: usize,
    /// Samples without their sync byte, which were used nevertheless.
    pub bad: usize,
    /// Bytes that belong to no sample, and the offset of the first in the unpacked capture.
    pub dropped: Tally,
    /// Samples whose hall code is impossible, and the line of the first.
    pub impossible: Tally,
    /// Velocities at the estimator's limit, and the line of the first.
    pub saturated: Tally,
}

/// The samples of a capture.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Samples {
    /// Hall code of each.
    pub codes: Vec<u8>,
    /// Number of samples without their sync byte.
    pub bad: usize,
    /// See [`Replayed::dropped`].
    pub dropped: Tally,
    /// See [`Replayed::impossible`].
    pub impossible: Tally,
}

/// Nowhere after this byte do five samples in a row begin with 0x5A.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoSamplesAfter(pub usize);

/// Writes one `position,velocity` line (hall counts, counts/s) for each sample of a capture.
///
/// With 90 counts a revolution, laps of up to 180 counts are tried: a recording's motor is often not the one its
/// user assumes, and 180 fits every motor with 1, 2, 3, 5, 6, 10, 15 or 30 pole pairs.
///
/// # Errors
/// The file cannot be read or is no capture; the sample rate or the counts a revolution are out of range; the
/// disk is full.
pub fn replay(
    capture: &Path,
    counts_per_rev: u32,
    rate_hz: u32,
    out: &mut impl Write,
) -> Result<Replayed, BadInput> {
    if !(1000..=1_000_000).contains(&rate_hz) {
        return Err(BadInput::new("--rate-hz", "the sample rate is out of range")
            .found(rate_hz.to_string())
            .expected("1000 to 1000000 samples a second")
            .next("give the recorder's rate, which is usually 30000"));
    }
    let estimate = estimator_for(counts_per_rev)?;
    let raw = bytes(capture, MAX_BYTES)?;
    let Samples { codes, bad, dropped, impossible } =
        samples(&raw).map_err(|NoSamplesAfter(at)| no_samples(capture, raw.len(), at))?;
    if impossible.count == codes.len() {
        return Err(BadInput::new(capture.display().to_string(), "no sample has a possible hall code")
            .found(format!("{} samples, each with the code 0 or 7 or with other bits set", codes.len()))
            .expected("codes 1 to 6")
            .next("check the supply and the wires of the sensors, and record again"));
    }
    let mut saturated = Tally::default();
    let limit = SPEED_MAX.0.to_num::<f64>();
    for (line, (position, velocity)) in (1..).zip(estimate(&codes, rate_hz)) {
        if velocity.abs() >= limit {
            saturated.add(1, line);
        }
        writeln!(out, "{position:.4},{velocity:.3}").map_err(|e| {
            BadInput::new(capture.display().to_string(), "its estimate cannot be written")
                .found(e.to_string())
                .expected("room for a line a sample")
                .next("free space, or choose another path")
        })?;
    }
    Ok(Replayed { samples: codes.len(), bad, dropped, impossible, saturated })
}

fn no_samples(capture: &Path, len: usize, at: usize) -> BadInput {
    let (problem, next) = match at {
        0 => ("this is no capture of hall lines".to_owned(), "check the path, or record again".to_owned()),
        at => (
            format!("no samples are found from byte {at} on"),
            format!("unpack it if it is packed, cut it at byte {at}, or record again"),
        ),
    };
    BadInput::new(capture.display().to_string(), problem)
        .found(format!("{} bytes, of which nowhere five samples in a row begin with 0x5A", len - at))
        .expected("three bytes a sample: 0x5A, the hall code, 0")
        .next(next)
}

/// The estimator of a motor with this many counts a revolution, six for each pole pair. The hand's own motor
/// learns its 18 edges, as on the board; any other learns two revolutions (see [`replay`]).
fn estimator_for(counts_per_rev: u32) -> Result<Estimate, BadInput> {
    macro_rules! by_pole_pairs {
        ($($pairs:literal)*) => {
            match counts_per_rev {
                18 => Ok(estimate::<18> as Estimate),
                $(counts if counts == 6 * $pairs => Ok(estimate::<{ 12 * $pairs }> as Estimate),)*
                _ => Err(BadInput::new("--counts-per-rev", "no motor has so many counts a revolution").found(counts_per_rev.to_string()).expected("six counts for each pair of poles, 6 to 180").next("give the motor's pairs of poles times six; the hand's motors have 18")),
            }
        };
    }
    by_pole_pairs!(1 2 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30)
}

/// Position and velocity at each sample of recorded codes.
type Estimate = fn(&[u8], u32) -> Vec<(f64, f64)>;

fn bytes(path: &Path, most: u64) -> Result<Vec<u8>, BadInput> {
    let fail = |problem: &str, found: String, next: &str| {
        BadInput::new(path.display().to_string(), problem)
            .found(found)
            .expected(format!("a capture of at most {most} bytes, gzipped or not"))
            .next(next)
    };
    let unread = |e: std::io::Error| fail("cannot be read", e.to_string(), "check the path");
    // Check the type before opening: opening a pipe may block forever.
    if !path.metadata().map_err(unread)?.is_file() {
        return Err(fail(
            "this is not a file",
            "a directory, pipe or device".to_owned(),
            "give a recording's path",
        ));
    }
    let raw = at_most(File::open(path).map_err(unread)?, most).map_err(unread)?;
    let shorter = "cut it into shorter ones";
    let raw = raw.ok_or_else(|| fail("too large", format!("more than {most} bytes"), shorter))?;
    if !raw.starts_with(&[0x1F, 0x8B]) {
        return Ok(raw);
    }
    let damaged = "the file is damaged or cut short; copy it again";
    at_most(flate2::read::MultiGzDecoder::new(raw.as_slice()), most)
        .map_err(|e| fail("cannot be unpacked", e.to_string(), damaged))?
        .ok_or_else(|| fail("too large once unpacked", format!("more than {most} bytes"), shorter))
}

fn at_most(from: impl Read, most: u64) -> std::io::Result<Option<Vec<u8>>> {
    let mut bytes = Vec::new();
    let read = from.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    Ok((read as u64 <= most).then_some(bytes))
}

/// The samples of a capture. A sample that lacks its sync byte is used nevertheless while later samples are in step with it, so that
/// line n of the estimate is sample n for every reader. Where they are not, bytes up to the next run of samples are dropped,
/// and the code before holds for a sample each three of them, so that time goes on.
///
/// The last sample is left out, complete or not: scorers of recordings leave it out, and refuse an estimate with another
/// number of lines.
///
/// # Errors
/// There are no samples, or none for more than a run up to the end.
pub fn samples(raw: &[u8]) -> Result<Samples, NoSamplesAfter> {
    let run = |at: usize| (0..RUN).all(|k| raw.get(at + 3 * k) == Some(&SYNC));
    // Fewer at the end of the capture.
    let begins = |at: usize| (0..RUN).all(|k| raw.get(at + 3 * k).is_none_or(|byte| *byte == SYNC));
    let mut at = (0..raw.len()).find(|&at| run(at)).ok_or(NoSamplesAfter(0))?;
    let mut samples = Samples::default();
    if at > 2 {
        samples.dropped.add(at, 0);
    }
    // Samples before this offset are in step with the next run.
    let mut in_step = at;
    while at + 3 < raw.len() {
        let has_sync = raw[at] == SYNC;
        let next = match has_sync {
            _ if at < in_step => None,
            // Bytes of this sample are lost.
            true => (at + 1..at + 3).find(|&at| begins(at)),
            false => match (at + 1..raw.len()).find(|&at| begins(at)) {
                None if raw.len() - at > 3 * RUN => return Err(NoSamplesAfter(at)),
                None => Some(raw.len()),
                Some(next) if (next - at).is_multiple_of(3) => {
                    in_step = next;
                    None
                }
                next => next,
            },
        };
        match next {
            Some(next) => {
                samples.drop(next - at, at);
                at = next;
            }
            None => {
                samples.bad += usize::from(!has_sync);
                samples.push(u16::from_le_bytes([raw[at + 1], raw[at + 2]]));
                at += 3;
            }
        }
    }
    Ok(samples)
}

impl Samples {
    fn push(&mut self, word: u16) {
        self.codes.push((word & 7) as u8);
        if !(1..=6).contains(&word) {
            self.impossible.add(1, self.codes.len());
        }
    }

    fn drop(&mut self, bytes: usize, at: usize) {
        self.dropped.add(bytes, at);
        let held = self.codes.last().copied();
        self.codes.extend(held.into_iter().flat_map(|code| std::iter::repeat_n(code, bytes.div_ceil(3))));
    }
}

/// Position and velocity at each sample, read [`on even marks`](RecordedShaft::on_even_marks), as the labels of recordings are.
#[must_use]
pub fn estimate<const N: usize>(codes: &[u8], rate_hz: u32) -> Vec<(f64, f64)> {
    readings(codes, rate_hz, RecordedShaft::<N>::new(0), RecordedShaft::on_even_marks)
}

/// One of the estimator's readings at each sample; [`RecordedShaft::at`] is the rotor's. Changes of the lines
/// call the decoder as the interrupt does, and so does a tick each millisecond.
#[must_use]
pub fn readings<const N: usize>(
    codes: &[u8],
    rate_hz: u32,
    mut shaft: RecordedShaft<N>,
    reading: fn(&mut RecordedShaft<N>, Micros) -> (Counts, CountsPerSec),
) -> Vec<(f64, f64)> {
    let Some(wiring) = Wiring::from_number(WIRING) else { return Vec::new() };
    let first = codes.first().copied().unwrap_or(0);
    let mut halls = HallDecoder::new(wiring, first, 0);
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
                shaft.edge(&edge);
            }
            last = code;
        }
        let (position, velocity) = reading(&mut shaft, now);
        rows.push((position.0.to_num::<f64>(), velocity.0.to_num::<f64>()));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    const CODES: [u8; 6] = [1, 3, 2, 6, 4, 5];

    fn capture(samples: usize) -> Vec<u8> {
        (0..samples).flat_map(|i| [0x5A, CODES[i / 20 % 6], 0]).collect()
    }

    fn file(name: &str, content: &[u8]) -> std::path::PathBuf {
        let path = std::env::temp_dir().join(format!("replay-{}-{name}", std::process::id()));
        std::fs::write(&path, content).expect("temporary file");
        path
    }

    #[test]
    fn replay_writes_one_line_per_sample_for_any_start_and_packing() {
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
            let replayed = Replayed { samples: want, ..Replayed::default() };
            assert_eq!(replay(&path, 90, 30_000, &mut out), Ok(replayed), "{name}");
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
    fn replay_of_bad_input_names_it() {
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        packed.write_all(&capture(3000)).expect("pack");
        let packed = packed.finish().expect("pack");
        for (name, bytes, counts, rate, want) in [
            ("empty", &[][..], 90, 30_000, "no capture of hall lines"),
            ("text", b"this is no capture", 90, 30_000, "no capture of hall lines"),
            ("short", &capture(4), 90, 30_000, "no capture of hall lines"),
            ("damaged", &packed[..packed.len() / 2], 90, 30_000, "damaged or cut short"),
            ("rate", &capture(100), 90, 0, "--rate-hz: the sample rate is out of range\n  found:    0\n"),
            ("counts", &capture(100), 91, 30_000, "six counts for each pair of poles"),
        ] {
            let path = file(name, bytes);
            let error = replay(&path, counts, rate, &mut Vec::new()).expect_err(name).to_string();
            for word in [want, "\n  found: ", "\n  expected: ", "\n  next: "] {
                assert!(error.contains(word), "{name}: {error}");
            }
            std::fs::remove_file(path).expect("temporary file");
        }
        let error =
            replay(Path::new("/no/such.dat"), 90, 30_000, &mut Vec::new()).expect_err("absent").to_string();
        assert!(error.contains("/no/such.dat") && error.contains("check the path"), "{error}");
    }

    #[test]
    fn samples_without_sync_are_used_and_counted() {
        let mut raw = capture(100);
        raw[150] = 0;
        raw[240] = 0xFF;
        let read = samples(&raw).expect("a capture");
        let codes = samples(&capture(100)).expect("a capture").codes;
        assert_eq!(codes.len(), 99);
        assert_eq!(read, Samples { codes, bad: 2, ..Samples::default() });
    }

    #[test]
    fn samples_are_found_again_after_lost_or_added_bytes() {
        let whole = samples(&capture(100)).expect("a capture").codes;
        // Sample 50 is at 150 to 152, amid its code.
        for (name, lost, dropped) in [
            ("sync", 150..151, (2, 150)),
            ("code", 151..152, (2, 150)),
            ("high byte", 152..153, (2, 150)),
            ("all but sync", 151..153, (1, 150)),
            // The next code is taken for the high byte.
            ("of two samples", 152..154, (1, 153)),
            ("two samples, and a byte", 150..157, (2, 150)),
        ] {
            let mut raw = capture(100);
            raw.drain(lost.clone());
            let read = samples(&raw).expect("a capture");
            let (count, first) = dropped;
            let impossible = if lost.start == 152 && lost.len() == 2 {
                Tally { count: 1, first: 51 }
            } else {
                Tally::default()
            };
            let lost_whole = lost.len() / 3;
            let mut codes = whole.clone();
            codes.drain(50..50 + lost_whole);
            let found = Samples { codes, bad: 0, dropped: Tally { count, first }, impossible };
            assert_eq!(read, found, "{name}");
        }
        // Bytes that were added, and a sync byte that is damaged beside them.
        let mut raw = capture(100);
        raw[153] = 0;
        raw.splice(150..150, [1, 2, 3, 4]);
        let read = samples(&raw).expect("a capture");
        assert_eq!((read.dropped, read.bad), (Tally { count: 10, first: 150 }, 0));
        assert_eq!(read.codes[read.codes.len() - 47..], whole[52..]);
        // Before the first sample.
        raw = [b"header".as_slice(), &capture(100)].concat();
        let read = samples(&raw).expect("a capture");
        assert_eq!((read.codes, read.dropped), (whole.clone(), Tally { count: 6, first: 0 }));
        // Within the last samples.
        raw = capture(100);
        raw.drain(292..293);
        raw[293] = 0;
        let read = samples(&raw).expect("a capture");
        assert_eq!((read.dropped.first, read.codes[..97] == whole[..97]), (294, true));
    }

    #[test]
    fn capture_whose_samples_are_not_found_again_is_refused_with_the_offset() {
        let mut raw = capture(3000);
        raw.iter_mut().skip(3001).for_each(|byte| *byte = 1);
        let path = file("lost", &raw);
        let error = replay(&path, 90, 30_000, &mut Vec::new()).expect_err("refused").to_string();
        std::fs::remove_file(&path).expect("temporary file");
        let place = format!("{}: no samples are found from byte 3003 on", path.display());
        assert!(error.starts_with(&place) && error.contains("5997 bytes"), "{error}");
    }

    #[test]
    fn impossible_codes_are_counted_and_alone_are_refused() {
        let mut raw = capture(100);
        (raw[31], raw[61], raw[92]) = (0, 7, 1);
        let path = file("impossible", &raw);
        let replayed = replay(&path, 90, 30_000, &mut Vec::new()).expect("a capture");
        assert_eq!(replayed.impossible, Tally { count: 3, first: 11 });
        for code in [0, 7, 0x0B] {
            std::fs::write(&path, [0x5A, code, 0].repeat(100)).expect("temporary file");
            let error = replay(&path, 90, 30_000, &mut Vec::new()).expect_err("refused").to_string();
            assert!(error.contains("99 samples, each with the code 0 or 7"), "{error}");
        }
        std::fs::remove_file(&path).expect("temporary file");
    }

    #[test]
    fn velocities_at_the_limit_are_counted() {
        // A count each 40 samples; at 1 MHz these are 25,000 counts/s, and at 100 kHz 2,500.
        let raw: Vec<u8> = (0..9000).flat_map(|i| [0x5A, CODES[i / 40 % 6], 0]).collect();
        let path = file("fast", &raw);
        let replayed = |rate_hz| replay(&path, 90, rate_hz, &mut Vec::new()).expect("a capture").saturated;
        let (fast, slow) = (replayed(1_000_000), replayed(100_000));
        std::fs::remove_file(&path).expect("temporary file");
        assert!(fast.count > 1000 && fast.first > 1, "{fast:?}");
        assert_eq!(slow, Tally::default());
    }

    #[test]
    fn oversized_capture_is_refused() {
        use std::error::Error;
        let check = |bytes: &[u8], most: u64| -> Result<usize, Box<dyn Error>> {
            let path = file("large", bytes);
            let read = super::bytes(&path, most);
            std::fs::remove_file(path)?;
            Ok(read?.len())
        };
        let raw = capture(3000);
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
        packed.write_all(&raw).expect("pack");
        let packed = packed.finish().expect("pack");
        assert!(packed.len() < 1000);
        for bytes in [&raw, &packed] {
            assert_eq!(check(bytes, 9000).ok(), Some(9000));
            let error = check(bytes, 8999).expect_err("too large").to_string();
            assert!(error.contains("too large") && error.contains("more than 8999 bytes"), "{error}");
        }
    }
}
