//! Longest times from a command to its prompt.

use god::command::{self, GclCommand};

/// Speed of a tip in TC and TO, counts/s: it follows its link by velocity at 13/49 of MCV's and MOV's 1000.
const TIP_ALONG: u64 = 265;

/// Homing speed IVEL, counts/s.
const HOMING: u64 = 200;

/// Droop of the proportional velocity loop under friction, counts/s: 63 torque units (decision 0003) divided by KPV's gain of 2.
const DROOP: u64 = 32;

/// The joints' ranges, hall counts (manual table 1): link, spread, tip.
const LINK: u64 = 363;
const SPREAD: u64 = 166;
const TIP: u64 = 508;

/// Longest move, ms, a tip's over its whole range: 2·√(distance/acceleration) with an acceleration of (ACCEL/1024)² counts/ms² (decision
/// 0002). No range is long enough to reach MV. A link takes 976 ms and the spread 880 ms.
const MOVE_MS: u64 = triangle_ms(TIP, 30);

/// GOD's own time, ms: five questions to a silent board, three times 60 ms each, and 100 ms for brake (30 ms), waking (26 ms) and answers.
const OWN_MS: u64 = 5 * 3 * 60 + 100;

/// Longest time of a command, us: TSTOP (ms) and travel of each stage, and GOD's own time. TSTOP 0 has no bound.
/// `None` if the line does not begin with a command of the hand's language.
#[must_use]
pub fn command_us(line: &str, tstop_ms: u64) -> Option<u64> {
    let word = line.split(' ').next().unwrap_or_default();
    // The longest end of the word that is a command: the rest is its prefix.
    let command = (0..word.len()).find_map(|start| command::find(word.get(start..)?))?;
    let (stages, travel_ms) = match command {
        // Links to their stops and IOFF 25 back, then tips to theirs and 350 back; the spread is faster. Each goes 12 counts
        // from its stop and back to it, and stalls again.
        GclCommand::Hi => (
            4,
            (LINK + 24) * 1000 / (HOMING - DROOP)
                + triangle_ms(25, 40)
                + (TIP + 24) * 1000 / (HOMING - DROOP)
                + triangle_ms(350, 30),
        ),
        // A tip whose link breaks away continues to its own goal.
        GclCommand::C => (2, 2 * MOVE_MS),
        GclCommand::Tc | GclCommand::To => (1, TIP * 1000 / (TIP_ALONG - DROOP)),
        GclCommand::T => (0, 0),
        _ => (1, MOVE_MS),
    };
    // HI stalls for 250 ms at least (decision 0009).
    Some(1000 * (stages * tstop_ms.max(250) + travel_ms + OWN_MS))
}

/// 2·√(distance/acceleration), rounded up.
const fn triangle_ms(counts: u64, accel: u64) -> u64 {
    2 * (counts * 1024 * 1024).isqrt() / accel + 1
}

const _: () = assert!(MOVE_MS > triangle_ms(LINK, 40) && MOVE_MS > triangle_ms(SPREAD, 30));
