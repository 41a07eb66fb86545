//! Whether RealTime tells its host the truth: position, velocity, and changes of position whose sum is the position (manual 6.2.3). And whether a
//! finger is one: its tip follows its link, and goes on alone when the link stalls (docs/hand.md). And how long a host may leave its answers unread.

use super::fault::{Subject, with_rig};
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

/// The first finger's link and tip.
const LINK: usize = 0;
const TIP: usize = 4;

/// The tip's share of its link's travel, and the counts by which it may be off: a nominal one by 3 at 80 counts/s and 5 at 1,000 (docs/hand.md),
/// and half as much again where friction, R and Ke are off by 30 %, until the integral has made up for them (0.3 s).
const SHARE: f64 = 13.0 / 49.0;
const LAG_COUNTS: f64 = 7.5;

/// Friction that holds a link, N·m: more than a motor makes.
const HELD_N_M: f64 = 5.0;

/// Blocks of a link that is held: TSTOP, and 0.6 s in which its tip goes on at its share of the link's velocity: 25 counts, and what is left of its lag.
const HELD: usize = 45;
const ALONE_COUNTS: f64 = 22.0;

/// Questions of a host that does not read: their answers are more than GOD's output holds, 1024 bytes. And as many as it sends in a ms.
const QUESTIONS: usize = 180;
const AT_ONCE: usize = 4;

/// GOD waits for its host when it has read nothing for so long, ms.
const WAITS_MS: u64 = 20;

/// The motors go on for 250 ms then (docs/safety.md), here by a third of what the velocity makes; and have come to rest 100 ms later.
const LOOKS_MS: u64 = 100;
const STOPS_MS: u64 = 250;
const ON_COUNTS: f64 = 5.0;
const REST_COUNTS: f64 = 2.0;

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

/// The true place and velocity of a motor.
fn truth<S: Subject>(session: &Session<'_, S>, motor: usize) -> (f64, f64) {
    let truth = session.hand.bus().stations().nth(motor).map(|board| board.rig().truth());
    truth.map_or((0.0, 0.0), |truth| (truth.counts, truth.counts_per_s))
}

/// Streams blocks to the first finger of a hand whose faults have healed.
pub fn stream<S: Subject>(session: &mut Session<'_, S>) {
    let asked = [LAYOUT, "1FGET P"].map(|line| session.run_line(line, LINE_MS).unwrap_or_default());
    let number = asked[1].split_ascii_whitespace().find_map(|word| word.parse::<i64>().ok());
    let (Some(mut told), true) = (number, session.is_whole()) else {
        return session.fail(STREAMS, 1, format!("FSET and FGET P answer {asked:?}"));
    };
    let (from, first, first_tip) = (told, truth(session, LINK).0, truth(session, TIP).0);
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
        let (counts, speed) = truth(session, LINK);
        let lag = SHARE * (counts - first) - (truth(session, TIP).0 - first_tip);
        let off = (answer.position - from) as f64 / GCL - (counts - first);
        let found = if off.abs() > OFF_COUNTS {
            format!("LFAP is {off:.1} counts from the rotor's way")
        } else if (answer.velocity - speed).abs() > OFF_COUNTS_PER_S {
            format!("LFV says {} counts/s, the rotor has {speed:.0}", answer.velocity)
        } else if answer.position != told && !FULL.contains(&answer.change) {
            format!("the sum of LFDP is {told}, LFAP {}", answer.position)
        } else if lag.abs() > LAG_COUNTS && !session.is_blocked() {
            format!("the tip is {lag:.1} counts behind its link")
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
    leave_unread(session);
    hold_link(session);
    session.abort();
}

/// Leaves answers unread until GOD waits for its host: motors go on for as long as a host may pause, and then stop.
fn leave_unread<S: Subject>(session: &mut Session<'_, S>) {
    session.send(&[b'C', VELOCITY, GAIN]);
    let (mut left, mut room, mut waits_ms) = (QUESTIONS, 0, 0);
    let end_ms = session.ms() + LINE_MS;
    while (left > 0 || waits_ms < WAITS_MS) && session.ms() < end_ms && session.is_whole() {
        let asked = left.min(AT_ONCE).min(session.hand.io().rx_room());
        session.hand.push_rx(&[b'A'; AT_ONCE][..asked]);
        left -= asked;
        session.step_unread();
        let before = std::mem::replace(&mut room, session.hand.io().rx_room());
        waits_ms = if asked == 0 && room == before { waits_ms + 1 } else { 0 };
    }
    let on = way_unread(session, LOOKS_MS);
    way_unread(session, STOPS_MS);
    let after = way_unread(session, LOOKS_MS);
    if on < ON_COUNTS && !session.is_blocked() {
        session.fail(
            STREAMS,
            1,
            format!("its host has paused for {LOOKS_MS} ms, and it moves {on:.1} counts"),
        );
    } else if after.abs() > REST_COUNTS {
        session.fail(STREAMS, 1, format!("its host does not read, and it moves on by {after:.1} counts"));
    }
    session.send(&[b'C', 0, GAIN]);
    session.wait_for_silence();
}

/// The way of the link while its host does not read, counts.
fn way_unread<S: Subject>(session: &mut Session<'_, S>, ms: u64) -> f64 {
    let from = truth(session, LINK).0;
    for _ in 0..ms {
        session.step_unread();
    }
    truth(session, LINK).0 - from
}

/// Holds the link that is to close: its tip goes on alone.
fn hold_link<S: Subject>(session: &mut Session<'_, S>) {
    let from = truth(session, TIP).0;
    with_rig(&mut session.hand, LINK, |rig| rig.jam(HELD_N_M));
    for _ in 0..HELD {
        session.send(&[b'C', VELOCITY, GAIN]);
        for _ in 0..PAUSE_MS {
            session.step();
        }
    }
    with_rig(&mut session.hand, LINK, |rig| rig.jam(0.0));
    let way = truth(session, TIP).0 - from;
    if way < ALONE_COUNTS && !session.is_blocked() {
        session.fail(STREAMS, TIP + 1, format!("beside a link that stalls its tip moves {way:.1} counts"));
    }
}

fn wait<S: Subject>(session: &mut Session<'_, S>, most_ms: u64, is_there: impl Fn(&[u8]) -> bool) {
    let end_ms = session.ms() + most_ms;
    while !is_there(&session.tail) && session.ms() < end_ms && session.is_whole() {
        session.step();
    }
}
