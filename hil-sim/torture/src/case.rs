//! What a seed stands for: a world, a program of hosts, and a schedule of faults.
//!
//! Everything is drawn before the run, so that parts can be left out without changing the others. Each seed draws its own rates: some
//! programs are all motions and some all parameters, some worlds have no fault and some have a dozen (swarm testing).

use rand::RngExt;
use rand_pcg::Pcg64Mcg;

use super::identity;
use super::kinds::{DRAWN, FaultKind, Place};
use super::lines::one;
use super::outside;
use super::program::{Act, Program, Step};
use hil_world::plant::PlantParams;
use hil_world::rig::RigParams;
use tater_wire::{MotorKind, Node as Id, Property};

/// Motors of a hand.
pub const MOTORS: usize = 7;

/// Shortest and longest program, ms of simulated time; and of those in which windings heat and cool, whose thermal time constants are minutes.
const LENGTH_MS: (u64, u64) = (1_000, 12_000);
const LONG_MS: (u64, u64) = (600_000, 900_000);

/// Longest fault of a long program, ms.
const LONG_FAULT_MS: u64 = 90_000;

/// One seed in so many meets something of the boards' identity, by each of the ways.
const RARELY: u32 = 16;

/// One in so many of the other hosts' programs passes a serial adapter.
const ADAPTERS: u32 = 2;

/// One seed in so many loses its bus about when motions are to be ordered.
const BUS_CUTS: u32 = 8;

/// One seed in so many that is not plain gives a property that shapes motions an end of its range.
const EXTREMES: u32 = 4;

/// One long seed in so many has boards that start anew while their motors are hot.
const HOT_STARTS: u32 = 2;

/// One long seed in so many has a rest, of 36 to 80 minutes: a clock of 32 bits in µs passes half of its range, and its end after 72 minutes.
const RESTS: u32 = 4;
const REST_MS: std::ops::Range<u64> = 2_160_000..4_800_000;

/// One seed in so many meets a person's fingers.
const FINGERS: u32 = 4;

/// MT of a motor that is to be gentle; below it, friction may hold it.
const GENTLE_MT: std::ops::Range<i64> = 100..300;

/// Highest voltage of a source, V, which half of the fast motors have: what they return is on top of it.
const MOST_V: f64 = 28.0;

/// What has no limit if motors are to be as fast as they can, and the powers of two that ACCEL has then: one that brakes softly returns the most to the
/// bus, since its current heats no winding.
const FAST: [Property; 2] = [Property::MCV, Property::MV];
const FAST_ACCEL: std::ops::RangeInclusive<u32> = 7..=15;

/// Motions that meet fingers, the time for each, and in which a finger comes, ms; and that for HI before them.
const MEETING: [&str; 10] = ["C", "O", "GC", "GO", "SC", "SO", "TC", "TO", "STC", "STO"];
const MEETS_MS: u64 = 1_500;
const FINGER_AFTER_MS: u64 = 600;
const HOMES_MS: u64 = 6_000;

/// What shapes a motion.
const SHAPING: [Property; 15] = [
    Property::ACCEL,
    Property::MV,
    Property::MCV,
    Property::MOV,
    Property::TSTOP,
    Property::MPE,
    Property::MT,
    Property::KP,
    Property::KI,
    Property::KD,
    Property::KPV,
    Property::BT,
    Property::HSG,
    Property::IVEL,
    Property::IOFF,
];

/// A fault and its time.
#[derive(Clone, Debug, PartialEq)]
pub struct Fault {
    /// The kind.
    pub kind: FaultKind,
    /// The motor that it hits, from 0; 0 if it hits no motor.
    pub motor: usize,
    /// Begin and duration, ms.
    pub from_ms: u64,
    /// See `from_ms`.
    pub for_ms: u64,
    /// Determines everything else about it.
    pub seed: u64,
}

/// The world of a case.
#[derive(Clone, Debug, PartialEq)]
pub struct World {
    /// The motors.
    pub plants: Vec<PlantParams>,
    /// Their sensors.
    pub rigs: Vec<RigParams>,
    /// Positions at the start, hall counts.
    pub starts: Vec<f64>,
    /// Source voltage, V, and current limit, A.
    pub source: (f64, f64),
    /// The object in the hand, if any: the text of a file of `grasps`.
    pub object: Option<&'static str>,
}

/// A seed's case.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// The seed.
    pub seed: u64,
    /// The world.
    pub world: World,
    /// Whether it is one of the long ones, of ten minutes and more.
    pub is_long: bool,
    /// Whether the program leaves every parameter at its default: then each command has a time to end in.
    pub is_plain: bool,
    /// The program.
    pub steps: Vec<Step>,
    /// The faults, by time.
    pub faults: Vec<Fault>,
    /// When the program ends and all faults heal, ms.
    pub stop_ms: u64,
}

/// Which parts of a seed's case are played; `None`: all.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// Steps, by number.
    pub steps: Option<Vec<usize>>,
    /// Faults, by number.
    pub faults: Option<Vec<usize>>,
    /// An earlier end, ms.
    pub stop_ms: Option<u64>,
}

/// A generator for one purpose of a seed.
pub(super) fn rng(seed: u64, purpose: u64) -> Pcg64Mcg {
    Pcg64Mcg::new(
        (u128::from(seed) << 64 | u128::from(purpose))
            .wrapping_mul(0x9E37_79B9_7F4A_7C15_F39C_C060_5CED_C835)
            | 1,
    )
}

impl Case {
    /// The case of a seed.
    #[must_use]
    pub fn draw(seed: u64) -> Self {
        Self::draw_of(seed, false)
    }

    /// The long case of a seed: motors that press and rest for minutes, and faults that last for up to a minute and a half.
    #[must_use]
    pub fn draw_long(seed: u64) -> Self {
        Self::draw_of(seed, true)
    }

    fn draw_of(seed: u64, is_long: bool) -> Self {
        let mut rng = rng(seed, if is_long { 5 } else { 1 });
        let world = World::draw(seed, &mut rng);
        let (least_ms, most_ms) = if is_long { LONG_MS } else { LENGTH_MS };
        let stop_ms = rng.random_range(least_ms..=most_ms);
        let is_plain = rng.random_ratio(1, 3);
        let program = Program::draw(&mut rng, is_plain);
        let steps =
            if is_long { program.long_steps(&mut rng, stop_ms) } else { program.steps(&mut rng, stop_ms) };
        let mut faults = faults(&mut rng, stop_ms);
        if is_long {
            for fault in &mut faults {
                if rng.random_ratio(1, 3) {
                    fault.for_ms = rng.random_range(1..=LONG_FAULT_MS);
                }
            }
        }
        let case = Self { seed, world, is_long, is_plain, steps, faults, stop_ms };
        let mut case = if is_long {
            case.with_fingers().with_hot_starts().with_rest()
        } else {
            case.with_outsiders().with_fingers().with_bus_cuts().with_extremes()
        };
        case.faults.sort_by_key(|fault| fault.from_ms);
        case
    }

    /// In one seed of [`FINGERS`], the program ends with motions that meet a person's fingers, or what is softer: as fast as motors can, or with little
    /// torque. Half of the fast ones are stopped on their way. Drawn apart, as [`Self::with_outsiders`].
    fn with_fingers(mut self) -> Self {
        let mut rng = rng(self.seed, 7);
        if !rng.random_ratio(1, FINGERS) {
            return self;
        }
        // Whoever has chosen parameters may wait for hours otherwise.
        let patience = |ms| (!self.is_plain).then_some(ms);
        let (homes, meets) = (patience(HOMES_MS), patience(MEETS_MS));
        let is_fast = !self.is_plain && rng.random();
        if is_fast {
            if rng.random() {
                self.world.set_volts(MOST_V);
            }
            for property in FAST {
                let row = property.row();
                self.push_line(format!("1234567 S {} {}", row.name, row.max), homes);
            }
            self.push_line(format!("1234567 S ACCEL {}", 1 << rng.random_range(FAST_ACCEL)), homes);
        } else if !self.is_plain {
            self.push_line(format!("1234567 S MT {}", rng.random_range(GENTLE_MT)), homes);
        }
        self.push_line("HI".to_owned(), homes);
        self.stop_ms += HOMES_MS;
        for _ in 0..rng.random_range(1..=8) {
            let from_ms = self.stop_ms + rng.random_range(0..FINGER_AFTER_MS);
            let stops = is_fast && rng.random();
            let patience = if stops { Some(rng.random_range(50..FINGER_AFTER_MS)) } else { meets };
            self.push_line((*one(&mut rng, &MEETING)).to_owned(), patience);
            self.stop_ms += MEETS_MS;
            self.faults.push(Fault { from_ms, ..Fault::draw(FaultKind::Finger, &mut rng, self.stop_ms) });
        }
        self
    }

    /// Ends the program with a line.
    fn push_line(&mut self, text: String, patience_ms: Option<u64>) {
        self.steps.push(Step { at_ms: self.stop_ms, act: Act::Line { text, patience_ms } });
    }

    /// Gives one seed in [`RARELY`] a second board with the number of another, one a host that changes who a board is, and one another hand's host. Drawn apart, so
    /// that the other seeds stay as they are.
    fn with_outsiders(mut self) -> Self {
        let mut rng = rng(self.seed, 6);
        if rng.random_ratio(1, RARELY) {
            self.faults.push(Fault::draw(FaultKind::SameNumber, &mut rng, self.stop_ms));
        }
        if !self.is_plain && rng.random_ratio(1, RARELY) {
            let at_ms = rng.random_range(0..self.stop_ms);
            let to = Id::new(rng.random_range(1..=MOTORS as u8)).unwrap_or(Id::HOST);
            let place = self.steps.partition_point(|step| step.at_ms <= at_ms);
            self.steps.insert(place, Step { at_ms, act: Act::Raw(identity::frames(&mut rng, to)) });
        }
        if !self.is_plain && rng.random_ratio(1, RARELY) {
            let mut at_ms = rng.random_range(0..self.stop_ms);
            let mut bursts = outside::bursts(&mut rng);
            if rng.random_ratio(1, ADAPTERS) {
                bursts = outside::through_adapter(&mut rng, bursts);
            }
            for (frames, pause_ms) in bursts {
                self.steps.push(Step { at_ms, act: Act::Raw(frames) });
                at_ms += pause_ms;
            }
            self.steps.sort_by_key(|step| step.at_ms);
        }
        self
    }

    /// Cuts the bus about when motions are to be ordered, in one seed of [`BUS_CUTS`]. Drawn apart, as [`Self::with_outsiders`].
    fn with_bus_cuts(self) -> Self {
        let mut rng = rng(self.seed, 10);
        let kinds = [FaultKind::NoAck, FaultKind::CableCut, FaultKind::BusOff];
        // GOD wakes and asks its boards first.
        self.with_faults_after(&mut rng, Act::moves, BUS_CUTS, 6, &kinds, 120)
    }

    /// Gives a property that shapes motions an end of its range on every board, in one seed of [`EXTREMES`]. Drawn apart, as
    /// [`Self::with_outsiders`].
    fn with_extremes(mut self) -> Self {
        let mut rng = rng(self.seed, 11);
        if !self.is_plain && rng.random_ratio(1, EXTREMES) {
            let row = one(&mut rng, &SHAPING).row();
            let value = *one(&mut rng, &[row.min, row.max]);
            let text = format!("1234567 S {} {value}", row.name);
            self.insert_line(rng.random_range(0..self.stop_ms / 2), text);
        }
        self
    }

    /// Adds a line that each board answers, after the steps of that time.
    fn insert_line(&mut self, at_ms: u64, text: String) {
        let place = self.steps.partition_point(|step| step.at_ms <= at_ms);
        self.steps.insert(place, Step { at_ms, act: Act::Line { text, patience_ms: Some(1_000) } });
    }

    /// Starts boards anew while their motors are hot, in one long program of [`HOT_STARTS`]. Drawn apart, as [`Self::with_outsiders`].
    fn with_hot_starts(self) -> Self {
        let mut rng = rng(self.seed, 9);
        let kinds = [FaultKind::BoardReset, FaultKind::PowerCut, FaultKind::HandPowerCut];
        self.with_faults_after(&mut rng, Act::heats, HOT_STARTS, 12, &kinds, 2_000)
    }

    /// Adds up to `most` faults, each within so many ms of a step that `is_near` names, to one case in `of`.
    fn with_faults_after(
        mut self,
        rng: &mut Pcg64Mcg,
        is_near: fn(&Act) -> bool,
        of: u32,
        most: u32,
        kinds: &[FaultKind],
        within_ms: u64,
    ) -> Self {
        let steps: Vec<u64> =
            self.steps.iter().filter(|step| is_near(&step.act)).map(|step| step.at_ms).collect();
        if rng.random_ratio(1, of) && !steps.is_empty() {
            for _ in 0..rng.random_range(1..=most) {
                let kind = *one(rng, kinds);
                let from_ms = *one(rng, &steps) + rng.random_range(0..within_ms);
                self.faults.push(Fault { from_ms, ..Fault::draw(kind, rng, self.stop_ms) });
            }
            self.faults.retain(|fault| fault.from_ms < self.stop_ms);
        }
        self
    }

    /// Lets the host rest in one long program of [`RESTS`], which delays everything after it: clocks and counters pass their ends. Drawn apart, as
    /// [`Self::with_outsiders`].
    fn with_rest(mut self) -> Self {
        let mut rng = rng(self.seed, 8);
        if rng.random_ratio(1, RESTS) {
            let (at_ms, for_ms) = (rng.random_range(0..self.stop_ms), rng.random_range(REST_MS));
            for step in self.steps.iter_mut().filter(|step| step.at_ms >= at_ms) {
                step.at_ms += for_ms;
            }
            for fault in self.faults.iter_mut().filter(|fault| fault.from_ms >= at_ms) {
                fault.from_ms += for_ms;
            }
            self.stop_ms += for_ms;
        }
        self
    }

    /// The parts of this case that are selected.
    #[must_use]
    pub fn select(&self, selection: &Selection) -> Self {
        let pick = |numbers: &Option<Vec<usize>>, len: usize| -> Vec<usize> {
            numbers.clone().unwrap_or_else(|| (0..len).collect())
        };
        Self {
            steps: pick(&selection.steps, self.steps.len())
                .iter()
                .filter_map(|&n| self.steps.get(n).cloned())
                .collect(),
            faults: pick(&selection.faults, self.faults.len())
                .iter()
                .filter_map(|&n| self.faults.get(n).cloned())
                .collect(),
            stop_ms: selection.stop_ms.unwrap_or(self.stop_ms).min(self.stop_ms),
            ..self.clone()
        }
    }
}

impl World {
    /// The nominal hand.
    #[must_use]
    pub fn nominal() -> Self {
        let plants: Vec<PlantParams> = (1..=7).map(|number| PlantParams::for_motor(kind(number))).collect();
        Self {
            starts: vec![0.0; MOTORS],
            rigs: vec![RigParams::default(); MOTORS],
            plants,
            source: (24.0, hil_world::plant::supply::LIMIT_A),
            object: None,
        }
    }

    fn set_volts(&mut self, volts: f64) {
        self.source.0 = volts;
        self.plants.iter_mut().for_each(|plant| plant.bus_v = volts);
    }

    fn draw(seed: u64, rng: &mut Pcg64Mcg) -> Self {
        let mut world = Self::nominal();
        if rng.random() {
            world.source = (rng.random_range(20.0..=MOST_V), rng.random_range(15.0..=40.0));
            for (motor, plant) in world.plants.iter_mut().enumerate() {
                *plant = plant.scattered(seed.wrapping_mul(8).wrapping_add(motor as u64), 0.3);
            }
            world.set_volts(world.source.0);
        }
        if rng.random() {
            for rig in &mut world.rigs {
                rig.hall_error_deg = std::array::from_fn(|_| rng.random_range(-10.0..=10.0));
                rig.rise_delay_us = rng.random_range(0..=20);
            }
        }
        match rng.random_range(0..8) {
            0 | 1 => world.object = Some(include_str!("../../grasps/ball.toml")),
            2 => world.object = Some(include_str!("../../grasps/bar.toml")),
            3..6 => {
                for (start, plant) in world.starts.iter_mut().zip(&world.plants) {
                    *start = rng.random_range(plant.min_count..=plant.max_count).round();
                }
            }
            _ => {}
        }
        world
    }
}

/// The kind of motor of a node.
#[must_use]
pub fn kind(number: u8) -> MotorKind {
    Id::new(number).map_or(MotorKind::Link, MotorKind::of)
}

fn faults(rng: &mut Pcg64Mcg, stop_ms: u64) -> Vec<Fault> {
    // One seed in eight has none: then every command must succeed on its own.
    let count = if rng.random_ratio(1, 8) { 0 } else { rng.random_range(1..=12) };
    let kinds: Vec<FaultKind> =
        (0..rng.random_range(1..=6)).map(|_| DRAWN[rng.random_range(0..DRAWN.len())].kind).collect();
    let mut faults: Vec<Fault> = (0..count)
        .map(|_| {
            let kind = kinds[rng.random_range(0..kinds.len())];
            Fault::draw(kind, rng, stop_ms)
        })
        .collect();
    faults.sort_by_key(|fault| fault.from_ms);
    faults
}

impl Fault {
    /// A fault of a kind, within a program that ends at `stop_ms`.
    #[must_use]
    pub fn draw(kind: FaultKind, rng: &mut Pcg64Mcg, stop_ms: u64) -> Self {
        let motor = match (kind, kind.row().place) {
            // Only the spread has a brake.
            (FaultKind::BrakeStuckOn | FaultKind::BrakeStuckOff, _) => 3,
            (_, Place::Motor) => rng.random_range(0..MOTORS),
            _ => 0,
        };
        let from_ms = rng.random_range(0..stop_ms);
        let longest = if rng.random() { 200 } else { 1_500 };
        Self { kind, motor, from_ms, for_ms: rng.random_range(1..=longest), seed: rng.random() }
    }
}
