//! Recorded shafts: what the estimator says about hall codes of motors that speed up, turn back, rest, and whose marks are out of place.

use crate::Record;
use hil_experiment::recorded::RecordedShaft;
use hil_experiment::replay::{estimate, readings, samples};
use servo_core::units::Counts;

const CODES: [u8; 6] = [1, 3, 2, 6, 4, 5];

const RATE_HZ: u32 = 20_000;

/// Hall codes of a shaft at a `place` in counts at each time, with marks that repeat every `lap` counts, each up to `error` out of place.
fn codes(seconds: f64, lap: i64, error: f64, place: impl Fn(f64) -> f64) -> Vec<u8> {
    let boundary = |count: i64| count as f64 + error * (1.7 * count.rem_euclid(lap) as f64).sin();
    let code = |sample: u32| {
        let at = place(f64::from(sample) / f64::from(RATE_HZ));
        let near = at.floor() as i64;
        let count = (near - 1..=near + 2).filter(|count| boundary(*count) <= at).max().unwrap_or(near);
        CODES[count.rem_euclid(6) as usize]
    };
    (0..(seconds * f64::from(RATE_HZ)) as u32).map(code).collect()
}

fn note(record: &mut Record, what: &str, rows: &[(f64, f64)]) {
    for part in rows.chunks(rows.len().div_ceil(8).max(1)) {
        let (position, velocity) = part.last().copied().unwrap_or_default();
        record.note(format!("{what}: {position:.3} counts, {velocity:.1} counts/s"), &part);
    }
}

fn estimates() -> Record {
    let mut record = Record::new("recorded shafts");
    let speeding = |t: f64| 40.0 * t + 300.0 * t * t;
    let swinging = |t: f64| 50.0 * (1.5 * t).sin() + 3.0 * t;
    let resting = |t: f64| if t < 0.5 { 200.0 * t } else { 100.0 - 80.0 * (t - 1.9).max(0.0) };
    let slow = |t: f64| 7.0 * t + 0.3 * (9.0 * t).sin();
    let fast = |t: f64| 4_000.0 * t;
    note(&mut record, "speeding up", &estimate::<18>(&codes(2.0, 18, 0.1, speeding), RATE_HZ));
    note(&mut record, "swinging", &estimate::<180>(&codes(3.0, 90, 0.15, swinging), RATE_HZ));
    note(&mut record, "resting", &estimate::<84>(&codes(2.5, 42, 0.05, resting), RATE_HZ));
    note(&mut record, "slow", &estimate::<18>(&codes(3.0, 18, 0.2, slow), RATE_HZ));
    note(&mut record, "fast", &estimate::<36>(&codes(1.0, 18, 0.1, fast), RATE_HZ));
    let at =
        readings(&codes(2.0, 18, 0.1, swinging), RATE_HZ, RecordedShaft::<18>::new(4), RecordedShaft::at);
    note(&mut record, "the rotor's", &at);
    let counted = |shaft: &mut RecordedShaft<18>, now| {
        let lap = shaft.lap().map_or(0, i32::from);
        let (_, velocity) = shaft.at(now);
        (Counts::from_int(shaft.count() + 1000 * lap), velocity)
    };
    note(
        &mut record,
        "its count and lap",
        &readings(&codes(2.0, 18, 0.1, speeding), RATE_HZ, RecordedShaft::new(4), counted),
    );
    let mut bouncing = codes(1.0, 18, 0.0, speeding);
    for at in (500..bouncing.len()).step_by(997) {
        bouncing[at] = bouncing[at - 40];
    }
    bouncing[12_000..12_030].fill(7);
    bouncing[15_000..15_400].fill(0);
    note(&mut record, "with bounces", &estimate::<18>(&bouncing, RATE_HZ));
    record.note(format!("nothing: {:?}", estimate::<18>(&[], RATE_HZ)), &());
    record
}

/// Captures with bytes lost, added or damaged.
fn damaged() -> Record {
    let mut record = Record::new("damaged captures");
    let whole: Vec<u8> =
        codes(0.02, 18, 0.0, |t| 900.0 * t).into_iter().flat_map(|code| [0x5A, code, 0]).collect();
    let mut cases =
        vec![("whole", whole.clone()), ("from byte 2", whole[2..].to_vec()), ("cut", whole[..301].to_vec())];
    let changed = |what: &'static str, change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = whole.clone();
        change(&mut bytes);
        (what, bytes)
    };
    cases.extend([
        changed("a byte lost", &|bytes| _ = bytes.remove(302)),
        changed("two bytes lost", &|bytes| drop(bytes.drain(300..302))),
        changed("a byte more", &|bytes| bytes.insert(400, 9)),
        changed("seven bytes more", &|bytes| drop(bytes.splice(400..400, [1; 7]))),
        changed("a sync byte damaged", &|bytes| bytes[300] = 0),
        changed("the last sync byte damaged", &|bytes| {
            let last = bytes.len() - 6;
            bytes[last] = 1;
        }),
        changed("a wrong code", &|bytes| bytes[301] = 7),
        changed("a wide code", &|bytes| bytes[302] = 1),
        changed("the end damaged", &|bytes| bytes[900..].fill(3)),
        changed("a short end damaged", &|bytes| {
            let from = bytes.len() - 12;
            bytes[from..].fill(3);
        }),
        ("nothing", Vec::new()),
    ]);
    for (what, bytes) in cases {
        let read = samples(&bytes);
        let shown = read.as_ref().map(|read| (read.codes.len(), read.bad, read.dropped, read.impossible));
        record.note(format!("{what}: {shown:?}"), &read);
    }
    record
}

pub fn scenes() -> Vec<Record> {
    vec![estimates(), damaged()]
}
