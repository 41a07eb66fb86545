//! Whether RealTime tells its host the truth: position, velocity, and changes of position whose sum is the position (manual 6.2.3).

use super::fault::Subject;
use super::invariant::STREAMS;
use super::session::Session;

/// The layout: velocity and gain in; velocity, position in four bytes and its change in GCL counts out, of which a block takes less than a motor at
/// full velocity makes: the next ones take the rest.
const LAYOUT: &str = "1FSET LCV 1 LCVC 8 LCPG 1 LFV 1 LFVC 8 LFS 0 LFAP 1 LFDP 1 LFDPC 1";
const COEFFICIENT: f64 = 8.0;

/// Blocks, the pause after each, ms, and how many of them move the finger, by a velocity of 160 counts/s with a gain that is not KPV's default.
const BLOCKS: usize = 18;
const PAUSE_MS: u64 = 20;
const MOVING: usize = 12;
const VELOCITY: u8 = 20;
const GAIN: u8 = 48;

/// GCL counts of a hall count (docs/hand.md).
const GCL: f64 = 55.0;

/// Changes that a block cannot pass.
const FULL: [i64; 2] = [i8::MIN as i64, i8::MAX as i64];

/// Bytes of an answer: `*`, velocity, position, change.
const ANSWER: usize = 7;

/// Hall counts by which a position may be off: half a cell at either end, and a count of travel between the board's answer and now. Velocity,
/// counts/s: one count each 6 ms, with halls that are off by 10°.
const OFF_COUNTS: f64 = 5.0;
const OFF_COUNTS_PER_S: f64 = 150.0;

/// Longest time of a line, ms.
const LINE_MS: u64 = 5_000;

struct Answer {
    velocity: f64,
    position: i64,
    change: i64,
}

fn parse(bytes: &[u8]) -> Option<Answer> {
    let [b'*', velocity, p0, p1, p2, p3, change] = *bytes else { return None };
    Some(Answer {
        velocity: f64::from(velocity.cast_signed()) * COEFFICIENT,
        position: i32::from_be_bytes([p0, p1, p2, p3]).into(),
        change: change.cast_signed().into(),
    })
}

/// The true place and velocity of the finger's link.
fn truth<S: Subject>(session: &Session<'_, S>) -> (f64, f64) {
    let truth = session.hand.bus().stations().next().map(|board| board.rig().truth());
    truth.map_or((0.0, 0.0), |truth| (truth.counts, truth.counts_per_s))
}

/// Streams blocks to the first finger of a hand whose faults have healed.
pub fn stream<S: Subject>(session: &mut Session<'_, S>) {
    let asked = [LAYOUT, "1FGET P"].map(|line| session.run_line(line, LINE_MS).unwrap_or_default());
    let number = asked[1].split_ascii_whitespace().find_map(|word| word.parse::<i64>().ok());
    let (Some(mut told), true) = (number, session.is_whole()) else {
        return session.fail(STREAMS, 1, format!("FSET and FGET P answer {asked:?}"));
    };
    let (from, first) = (told, truth(session).0);
    // The layout is GOD's: no order is on its way to a board.
    session.shadow.forget();
    session.look_at_settings();
    session.tail.clear();
    session.send(b"1LOOP\r");
    wait(session, LINE_MS, |tail| tail.ends_with(b"*"));
    for block in 0..BLOCKS {
        let velocity = if block < MOVING { VELOCITY } else { 0 };
        session.tail.clear();
        session.send(&[b'C', velocity, GAIN]);
        wait(session, PAUSE_MS, |tail| tail.len() >= ANSWER);
        let Some(answer) = parse(&session.tail) else {
            let found =
                format!("block {block} of LOOP is answered by {:?}", session.tail.escape_ascii().to_string());
            return session.fail(STREAMS, 1, found);
        };
        told += answer.change;
        let (counts, speed) = truth(session);
        let off = (answer.position - from) as f64 / GCL - (counts - first);
        let found = if off.abs() > OFF_COUNTS {
            format!("LFAP is {off:.1} counts from the rotor's way")
        } else if (answer.velocity - speed).abs() > OFF_COUNTS_PER_S {
            format!("LFV says {} counts/s, the rotor has {speed:.0}", answer.velocity)
        } else if answer.position != told && !FULL.contains(&answer.change) {
            format!("the sum of LFDP is {told}, LFAP {}", answer.position)
        } else {
            String::new()
        };
        if !found.is_empty() {
            return session.fail(STREAMS, 1, format!("in block {block} {found}"));
        }
        for _ in 0..PAUSE_MS {
            session.step();
        }
    }
    session.abort();
}

fn wait<S: Subject>(session: &mut Session<'_, S>, most_ms: u64, is_there: impl Fn(&[u8]) -> bool) {
    let end_ms = session.ms() + most_ms;
    while !is_there(&session.tail) && session.ms() < end_ms && session.is_whole() {
        session.step();
    }
}
