//! Half a minute of anything that a host, a supply and a hand can do to one board: every property, command and mode with any value,
//! locked ones too, saves, resets, STAT 0 and 2, watchdogs, brown-outs, power cuts, silence, loads and objects. The winding, the phase
//! current and the trust in the position are compared with the plant.
//!
//! `EFFORT=40 cargo test -p system-tests random_commands -- --nocapture` for more runs, `SEED=17` for that one.

use crate::effort::seeds;
use crate::heat::{Bench, HANGS_US, MOST_C};
use boot::Chip;
use hil_world::plant::{Contact, PlantParams, RAD_PER_COUNT};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use servo_core::mode::Mode;
use tater_wire::property::{Access, ROWS};
use tater_wire::{Destination, Frame, Group, Identifier, MotorKind, Node as Id, Property};

/// Simulated time of a run, ms.
const RUN_MS: u32 = 30_000;

/// Runs in CI: 20 s. One of some fifty restores a position, two of these.
const RUNS: u64 = 24;
const FIRST: u64 = 96;

/// Phase current, A: a motor at full speed that is plugged draws 20.
const MOST_A: f64 = 21.0;

/// Counts by which a trusted position may differ from the true one: the rotor is at the edge of its cell.
const MOST_COUNTS: i64 = 1;

/// Below this a rotor stands still, counts/s: the count of a tick is that of its end.
const SLOW: f64 = 100.0;

/// LOCK's sequence.
const KEYS: [i64; 5] = [18384, 23, 3145, 1024, 1];

/// Not set here: a host that states a wrong wiring or direction moves a motor that runs the other way, and its zero is elsewhere; one that
/// describes another motor or joint gets what suits that.
const STATED: [&str; 15] = [
    "WIRING", "FIND", "POLES", "MR", "MPK", "MKT", "MJ", "ML", "MVN", "MWX", "MWJ", "MWR", "JLO", "JHI",
    "KBW",
];

/// What the hand's motor may be taken for; beyond, it is another one.
const MODEL: [(&str, i64, i64); 5] =
    [("MKA", 400, 5000), ("MKE", 1600, 5000), ("MFC", 0, 100), ("MFS", 0, 130), ("MTE", 0, 1000)];

#[derive(Clone, Copy, Debug, Default)]
struct Figures {
    hottest_c: f64,
    most_a: f64,
    /// Milliseconds with a trusted position, and with a position that a new start trusted.
    trusted_ms: u64,
    restored: u64,
    moving_ms: u64,
    restarts: u64,
}

impl Figures {
    fn and(self, other: Self) -> Self {
        Self {
            hottest_c: self.hottest_c.max(other.hottest_c),
            most_a: self.most_a.max(other.most_a),
            trusted_ms: self.trusted_ms + other.trusted_ms,
            restored: self.restored + other.restored,
            moving_ms: self.moving_ms + other.moving_ms,
            restarts: self.restarts + other.restarts,
        }
    }
}

struct Run {
    bench: Bench,
    rng: Pcg64Mcg,
    ms: u32,
    figures: Figures,
    /// Position as reported less the true one, in whole counts, while the position is trusted.
    offset: Option<i64>,
    /// The same when the board was last reset: a start that trusts its position has this one.
    before: Option<i64>,
    awake: bool,
    wrong: Option<String>,
}

impl Run {
    fn new(seed: u64, scattered: bool) -> Self {
        let number = (seed % 7) as u8 + 1;
        let mut plant = PlantParams::for_motor(MotorKind::of(Id::new(number).expect("a node")));
        if scattered {
            plant = plant.scattered(seed, 0.3);
        }
        Self {
            bench: Bench::new(number, plant, seed),
            rng: Pcg64Mcg::new(u128::from(seed) << 1 | 1),
            ms: 0,
            figures: Figures::default(),
            offset: None,
            before: None,
            awake: false,
            wrong: None,
        }
    }

    fn pick<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.rng.random_range(0..of.len())]
    }

    fn wait(&mut self, ms: u32) {
        for _ in 0..ms {
            self.bench.step();
            self.ms += 1;
            self.check();
        }
    }

    fn check(&mut self) {
        let Some(sample) = self.bench.node.sample() else {
            if self.awake {
                self.figures.restarts += 1;
                self.before = self.offset;
            }
            self.awake = false;
            return;
        };
        let started = !std::mem::replace(&mut self.awake, true);
        self.figures.moving_ms += u64::from(sample.truth.counts_per_s.abs() > SLOW);
        if !sample.status.homed {
            self.offset = None;
            return;
        }
        self.figures.trusted_ms += 1;
        if started {
            self.figures.restored += 1;
            self.offset = self.before;
        }
        if sample.truth.counts_per_s.abs() > SLOW {
            return;
        }
        let found = i64::from(sample.status.position.round()) - sample.truth.counts.round() as i64;
        let offset = *self.offset.get_or_insert(found);
        if (found - offset).abs() > MOST_COUNTS && self.wrong.is_none() {
            self.wrong = Some(format!(
                "{} ms: position {} is trusted, but the rotor is at {:.2}: {found} instead of {offset} apart",
                self.ms,
                sample.status.position.round(),
                sample.truth.counts
            ));
        }
    }

    fn is_idle(&self) -> bool {
        self.bench.node.sample().is_none_or(|sample| sample.status.mode == Mode::Idle)
    }

    fn set(&mut self, property: Property, value: i64) {
        // It would rename the position, as the host wants; here it must stay what HI made it.
        let renames = property == Property::P && self.is_idle();
        if !renames && !STATED.contains(&property.row().name) {
            self.bench.set(property, value);
        }
    }

    /// A value of a property: an extreme, a small one, any, or one beyond its range.
    fn value(&mut self, property: Property) -> i64 {
        let (min, max) = (property.row().min, property.row().max);
        if let Some((_, min, max)) = MODEL.iter().find(|(name, ..)| *name == property.row().name) {
            return self.rng.random_range(*min..=*max);
        }
        match self.rng.random_range(0..8) {
            0 => min,
            1 => max,
            2 => 0,
            3 => self.pick(&[1, -1, 2, min.saturating_sub(1), max.saturating_add(1)]),
            4 => property.row().default_for(Id::new(1).expect("a node")).unwrap_or(0),
            _ => self.rng.random_range(min..=max),
        }
    }

    fn any_property(&mut self) -> Property {
        ROWS[self.rng.random_range(0..ROWS.len())].property
    }

    /// Any frame to the board or its groups; not one that [`Self::set`] leaves out.
    fn any_frame(&mut self) {
        let to = if self.rng.random() { self.bench.to } else { Destination::Group(Group::ALL) };
        let id = Identifier { from: Id::HOST, to };
        let len = self.rng.random_range(0..=8);
        let bytes: [u8; 8] = self.rng.random();
        let number = bytes[0] & 0x7F;
        let left_out = number == Property::P.id()
            || Property::of(number).is_some_and(|property| {
                let name = property.row().name;
                STATED.contains(&name) || MODEL.iter().any(|(of, ..)| *of == name)
            });
        if !left_out && let Some(frame) = Frame::new(id, &bytes[..len]) {
            let _ = self.bench.node.receive(&frame);
        }
    }

    /// What a host does to move a motor.
    fn move_it(&mut self) {
        let to = self.rng.random_range(-60..360);
        match self.rng.random_range(0..8) {
            0 | 1 => self.set(Property::M, to),
            2 => {
                self.set(Property::E, to);
                self.set(Property::MODE, 5);
            }
            3 => {
                self.set(Property::MODE, 4);
                let v = self.rng.random_range(-1200..1200);
                self.set(Property::V, v);
            }
            4 => {
                self.set(Property::MODE, 3);
                self.set(Property::P, to);
            }
            5 | 6 => {
                let cmd = self.pick(&[13, 13, 18, 19, 20, 12, 16, 14, 15, 21, 11]);
                self.set(Property::CMD, cmd);
            }
            _ => self.press(),
        }
    }

    /// The most heat: full torque either way, for some seconds, with the host's frames.
    fn press(&mut self) {
        let torque = self.pick(&[990, -990, 1023, -1024, 600]);
        if self.rng.random() {
            self.set(Property::TSTOP, 0);
            self.set(Property::MT, 990);
        }
        if self.rng.random() {
            self.set(Property::OTEMP, -551);
        }
        self.set(Property::MODE, 2);
        for _ in 0..self.rng.random_range(1..40) {
            self.set(Property::T, torque);
            self.wait(100);
        }
    }

    /// A load on the joint, or an object in its way; or neither.
    fn disturb(&mut self) {
        let n_m = self.pick(&[0.0, 0.0, 0.1, -0.1, 0.4, -0.4]);
        let here = self.bench.node.board().rig().truth().counts;
        let side = self.pick(&[1.0, -1.0]);
        let from = here + side * self.rng.random_range(5.0..100.0);
        let stiffness = self.pick(&[0.01, 0.3, 20.0]);
        let object = Contact { from: from * RAD_PER_COUNT, side, stiffness, damping: 0.002 };
        let objects: &[Contact] = if self.rng.random() { &[object] } else { &[] };
        let rig = self.bench.node.rig_mut();
        rig.set_objects(objects);
        rig.set_disturbance(n_m);
    }

    /// Nobody pushes a joint whose board does not count: a turn of six counts has the same hall code.
    fn release(&mut self) {
        let rig = self.bench.node.rig_mut();
        rig.set_objects(&[]);
        rig.set_disturbance(0.0);
    }

    fn interrupt(&mut self) {
        self.release();
        self.before = self.offset;
        self.figures.restarts += u64::from(std::mem::take(&mut self.awake));
        match self.rng.random_range(0..6) {
            0 => self.bench.node.power_on(),
            1 => {
                let us = self.pick(&HANGS_US);
                self.bench.node.hang(us);
                self.ms += (us / 1000) as u32;
            }
            2 | 3 => {
                self.bench.node.power_off();
                let ms = self.pick(&[1, 10, 100, 1500]);
                self.wait(ms);
                self.bench.node.power_on();
            }
            4 => self.set(Property::STAT, 0),
            _ => self.set(Property::CMD, 11),
        }
    }

    /// A power cut in the middle of one of the next flash operations.
    fn cut_flash(&mut self) {
        self.release();
        let seed = self.rng.random();
        let ahead = self.rng.random_range(0..30);
        let at = self.bench.node.board().sim_flash().operations() + ahead;
        self.bench.node.board_mut().flash().cut_at(at, seed);
        self.set(Property::SAVE, -1);
        self.wait(50);
        if self.bench.node.board().sim_flash().is_dead() {
            self.before = self.offset;
            self.wait(20);
        }
        self.bench.node.power_on();
    }

    fn act(&mut self) {
        match self.rng.random_range(0..40) {
            0..8 => {
                let property = self.any_property();
                let value = self.value(property);
                self.set(property, value);
            }
            8..11 => {
                let property =
                    self.pick(&[Property::ACCEL, Property::MV, Property::MT, Property::HOLD, Property::KP]);
                let value = self.value(property);
                self.set(property, value);
            }
            11 => {
                let locked: Vec<Property> =
                    ROWS.iter().filter(|row| row.access == Access::Locked).map(|row| row.property).collect();
                let property = self.pick(&locked);
                KEYS.into_iter().for_each(|key| self.set(Property::LOCK, key));
                let value = self.value(property);
                self.set(property, value);
            }
            12..14 => self.any_frame(),
            14 => {
                let id = self.rng.random_range(-2..128);
                let property = self.pick(&[Property::SAVE, Property::LOAD, Property::DEF]);
                // LOAD and DEF of P rename it as well.
                if property == Property::SAVE || id != i64::from(Property::P.id()) && id != -1 {
                    self.set(property, id);
                }
            }
            15 => {
                self.wait(300);
                self.set(Property::SAVE, -1);
                self.wait(50);
            }
            16 => {
                let mode = self.rng.random_range(-1..7);
                self.set(Property::MODE, mode);
            }
            17 => self.disturb(),
            18 => self.interrupt(),
            19 => self.cut_flash(),
            20 => {
                // The host is silent.
                let ms = self.rng.random_range(500..3000);
                self.wait(ms);
            }
            21 => {
                // What earlier values have made impossible is possible again.
                self.set(Property::DEF, -1);
                self.set(Property::STAT, 2);
                self.set(Property::CMD, 13);
                self.wait(2500);
            }
            22..25 => self.set(Property::STAT, 2),
            _ => self.move_it(),
        }
        let ms = self.pick(&[0, 1, 5, 50, 200, 400]);
        self.wait(ms);
        if self.bench.node.application().is_none() && self.rng.random_range(0..4) > 0 {
            self.wait(20);
            self.bench.to = Destination::Group(Group::ALL);
            self.bench.set(Property::STAT, 2);
            self.bench.to = Destination::Node(self.bench.node.straps());
            self.wait(30);
        }
    }

    fn play(mut self) -> Result<Figures, String> {
        while self.ms < RUN_MS && self.wrong.is_none() {
            self.act();
        }
        self.figures.hottest_c = self.bench.hottest_c;
        self.figures.most_a = self.bench.most_a;
        self.wrong.map_or(Ok(self.figures), Err)
    }
}

/// Plays runs from `first` on, and adds them up; the limits of heat and current hold on nominal plants.
fn play(first: u64, runs: u64, scattered: bool) -> (Figures, Vec<String>) {
    let played = (first..first + runs).into_par_iter().map(|seed| Run::new(seed, scattered).play());
    let played: Vec<_> = played.collect();
    let (mut all, mut wrong) = (Figures::default(), Vec::new());
    for (seed, played) in (first..).zip(played) {
        let replay = format!("SEED={seed} cargo test -p system-tests random_commands");
        match played {
            Ok(figures) => {
                if !scattered && (figures.hottest_c > MOST_C || figures.most_a > MOST_A) {
                    let Figures { hottest_c, most_a, .. } = figures;
                    wrong.push(format!("{hottest_c:.1} °C, {most_a:.1} A: {replay}"));
                }
                all = all.and(figures);
            }
            Err(found) => wrong.push(format!("{found}: {replay}")),
        }
    }
    (all, wrong)
}

#[test]
fn random_commands_neither_overheat_nor_lose_the_position() {
    let seeds = seeds(FIRST, RUNS);
    let (first, runs) = (seeds.start, seeds.end - seeds.start);
    let (all, wrong) = play(first, runs, false);
    let (scattered, also_wrong) = play(first, runs.div_ceil(8), true);
    println!("figure: {runs} random runs of 30 s on nominal plants: {all:?}");
    println!("figure: {} on plants scattered by 30 %, 20 to 28 V: {scattered:?}", runs.div_ceil(8));
    let wrong = [wrong, also_wrong].concat();
    assert!(wrong.is_empty(), "{} runs\n{}", wrong.len(), wrong.join("\n"));
    assert!(runs < RUNS || all.trusted_ms > 10_000 && all.restored > 0, "nothing is trusted: {all:?}");
}
