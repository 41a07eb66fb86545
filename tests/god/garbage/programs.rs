//! Random programs of 30 s on the whole hand: every command, lower grammar, LOOP, ^C and disconnects, while boards are reset and lose their
//! power. Whatever happens, a prompt comes in time, no winding exceeds 135 °C and no phase current 21 A.
//!
//! * A *plain* program leaves all parameters at their defaults: each line has its prompt within [`command_us`], and [`WAKE_US`] for boards that
//!   have to be woken.
//! * A *wild* one sets anything anywhere (ACCEL 0, TSTOP 0), so a motion may last: its host types ^C, which has its prompt within 0.6 s
//!   (`client::PROMPT_US`).
//!
//! `EFFORT` plays more of them.

use crate::effort::effort;
use god::command::{Category, GclCommand};
use rand::RngExt;

use super::client::{Client, Figure};
use hil_torture::deadline::command_us;
use hil_torture::lines::{self, one};
use hil_torture::program;

const RUN_US: u64 = 30_000_000;

/// Limits of must-show 5, A: the bridge's trip is above it.
const CURRENT_A: f64 = 21.0;

/// Time to wake boards that have been reset, and WAIT's longest argument, us.
const WAKE_US: u64 = 1_700_000;
const WAIT_US: u64 = 2_000_000;

/// Longest time of a line that moves nothing, us: SAVE waits for motors that coast, ten times 0.3 s, and for boards that may be silent; FDEF and
/// FLISTAV end at the first silent board.
const QUIET_US: u64 = 6_000_000;

/// Longest patience of a wild program's host, ms.
const PATIENCE_MS: u32 = 4_000;

fn programs() -> u128 {
    effort(12).into()
}

/// A line that leaves the parameters alone, and its longest time, us.
fn plain_line(client: &mut Client) -> (String, u64) {
    // A longer WAIT would be the run.
    let (line, row) = program::plain_line(&mut client.rng, WAIT_US / 1_000);
    let us = match (row.command, row.category) {
        (GclCommand::Wait, _) => WAIT_US + QUIET_US,
        (GclCommand::Mac, _) | (_, Category::Movement) => {
            command_us(row.name, 400).expect("a command") + WAKE_US
        }
        _ => QUIET_US,
    };
    (line, us)
}

/// Now and then a board is reset, or loses its power for a while.
#[derive(Default)]
struct Cuts {
    off: Vec<(usize, u64)>,
    count: u64,
}

impl Cuts {
    fn step(&mut self, client: &mut Client) {
        let now_us = client.hand.now_us();
        if client.rng.random_ratio(1, 4_000) {
            let place = client.rng.random_range(0..7);
            let node = client.hand.bus_mut().station_mut(place).expect("0 to 6");
            self.count += 1;
            if client.rng.random() {
                node.power_on();
            } else if self.off.iter().all(|(off, _)| *off != place) {
                node.power_off();
                let ms = client.rng.random_range(1..1_500);
                self.off.push((place, now_us + 1_000 * ms));
            }
        }
        self.off.retain(|&(place, until_us)| {
            let stays = now_us < until_us;
            if !stays {
                client.hand.bus_mut().station_mut(place).expect("0 to 6").power_on();
            }
            stays
        });
    }
}

/// Steps until the prompt, for so long at most. Returns whether it came.
fn wait(client: &mut Client, cuts: &mut Cuts, us: u64) -> bool {
    let end_us = client.hand.now_us() + us;
    while !client.is_at_prompt() {
        if client.hand.now_us() >= end_us {
            return false;
        }
        cuts.step(client);
        client.step();
    }
    true
}

/// Blocks of a host that does not read them, then ^C.
fn random_loop(client: &mut Client, cuts: &mut Cuts) {
    for _ in 0..client.rng.random_range(0..300) {
        let header = *one(&mut client.rng, b"CCCcAa");
        let data: [u8; 14] = client.rng.random();
        let len = client.rng.random_range(0..=14);
        client.send(&[header], 1_000);
        client.send(&data[..len], 1_000);
        for _ in 0..client.rng.random_range(0..20) {
            cuts.step(client);
            client.step();
        }
    }
}

fn run(seed: u128, is_plain: bool) -> Figure {
    let mut client = Client::new(seed);
    client.expect_any_fault();
    let mut cuts = Cuts::default();
    if client.rng.random() {
        client.run("HI");
    }
    let (mut lines, mut slowest) = (Vec::new(), 0);
    while client.hand.now_us() < RUN_US {
        let (line, within_us) = if is_plain {
            plain_line(&mut client)
        } else {
            let us = 1_000 * u64::from(client.rng.random_range(1..=PATIENCE_MS));
            (lines::command(&mut client.rng), us)
        };
        let start_us = client.hand.now_us();
        lines.push(line.clone());
        client.type_line(&line);
        if !is_plain && line.to_ascii_uppercase().contains("LOOP") {
            random_loop(&mut client, &mut cuts);
        }
        if wait(&mut client, &mut cuts, within_us) {
            slowest = slowest.max(client.hand.now_us() - start_us);
        } else {
            let last = &lines[lines.len().saturating_sub(8)..];
            assert!(!is_plain, "seed {seed:#x}: no prompt within {within_us} us after {last:?}");
            if !client.maybe_hang_up(20) {
                client.abort();
            }
        }
    }
    let figure = client.stop_all();
    let peaks = figure.peaks();
    assert!(peaks.current <= CURRENT_A, "seed {seed:#x}: {} A; {lines:?}", peaks.current);
    println!("seed {seed:#x}: {} lines, {} cuts, slowest {} ms", lines.len(), cuts.count, slowest / 1000);
    figure
}

#[test]
fn random_programs_get_their_prompts_and_keep_the_limits() {
    let mut all = Figure::default();
    for number in 0..programs() {
        // Odd seeds have a ball in the hand.
        all = all.merge(run(0x9406 + number, number % 4 < 2));
    }
    println!("figure: {} random programs of 30 s: {all}", programs());
}
