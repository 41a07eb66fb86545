//! The winding's true temperature over any sequence of stalls, resets, brown-outs, hangs and power cuts (decision 0051).

use crate::effort::effort;
use hil_world::board::SimBoard;
use hil_world::node::Node;
use hil_world::plant::{Heat, Model, PlantParams, Start};
use hil_world::rig::{Rig, RigParams};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use servo_core::guard::thermal::DISABLED;
use tater_wire::{Cmd, Destination, Message, MotorKind, Node as Id, Property};

/// Limit of the true winding, °C, with nominal resistance and thermal resistance.
pub const MOST_C: f64 = 135.0;

/// A finger's link, the spread, a fingertip.
pub const KINDS: [u8; 3] = [1, 4, 5];

/// The longest time to a reset by the independent watchdog, µs, and by that of the tick.
pub const HANGS_US: [u64; 2] = [667_000, 59_000];

/// Distance that a motor leaves a stop by before it is pressed against it, counts.
const OFF_COUNTS: f64 = 10.0;

/// One board whose winding is watched.
pub struct Bench {
    pub node: Node,
    pub to: Destination,
    /// Highest winding temperature so far, °C.
    pub hottest_c: f64,
    /// Highest phase current so far, A.
    pub most_a: f64,
}

impl Bench {
    pub fn new(number: u8, plant: PlantParams, seed: u64) -> Self {
        let id = Id::new(number).expect("a node");
        let heat = Heat { winding_c: plant.ambient_c, housing_c: plant.ambient_c };
        let start = Start { count: 20.0, counts_per_s: 0.0, heat };
        let rig = Rig::new(plant, RigParams::default(), &[], Model::Averaged, start, seed).expect("in range");
        let node = Node::new(SimBoard::new(rig, id));
        Self { node, to: Destination::Node(id), hottest_c: 0.0, most_a: 0.0 }
    }

    pub fn set(&mut self, property: Property, value: i64) {
        if let Some(message) = Message::set(self.to, property, value) {
            let _ = self.node.receive(&message.frame());
        }
    }

    pub fn step(&mut self) {
        self.node.step();
        let truth = self.node.board().rig().truth();
        self.hottest_c = self.hottest_c.max(truth.winding_c);
        self.most_a = self.most_a.max(truth.peak_phase_a);
    }

    pub fn wait(&mut self, ms: u32) {
        for _ in 0..ms {
            self.step();
        }
    }

    pub fn wake(&mut self) {
        self.wait(10);
        self.set(Property::STAT, 2);
        self.wait(20);
        // Little torque until the direction has been seen would heat less.
        self.node.trust_direction();
    }

    /// Off the stop, then against it at full torque, without a stall time or OTEMP; as a host does that wants the most heat.
    pub fn press(&mut self, ms: u32, closing: bool) {
        let sign = if closing { 1 } else { -1 };
        for (property, value) in [
            (Property::MT, 990),
            (Property::TSTOP, 0),
            (Property::OTEMP, DISABLED.into()),
            (Property::MODE, 2),
            (Property::T, -990 * sign),
        ] {
            self.set(property, value);
        }
        // A motor gets its full torque only once it has turned as it should.
        let from = self.node.board().rig().truth().counts;
        let mut left = ms;
        while left > 0
            && ms - left < 600
            && (self.node.board().rig().truth().counts - from).abs() < OFF_COUNTS
        {
            self.keep_torque(left, -990 * sign);
            left -= 1;
        }
        self.set(Property::T, 990 * sign);
        while left > 0 {
            self.keep_torque(left, 990 * sign);
            left -= 1;
        }
    }

    /// A millisecond of mode 2 with a host.
    fn keep_torque(&mut self, ms: u32, torque: i64) {
        if ms.is_multiple_of(100) {
            self.set(Property::T, torque);
        }
        self.step();
    }

    fn winding_c(&self) -> f64 {
        self.node.board().rig().truth().winding_c
    }

    fn power_cycle(&mut self, off_ms: u32) {
        self.node.power_off();
        self.wait(off_ms);
        self.node.power_on();
    }
}

fn nominal(number: u8) -> PlantParams {
    PlantParams::for_motor(MotorKind::of(Id::new(number).expect("a node")))
}

/// The issue's: before, the winding reached 180 °C.
#[test]
fn repeated_reset_and_stall_stays_below_the_winding_limit() {
    for number in KINDS {
        let mut bench = Bench::new(number, nominal(number), 1);
        for _ in 0..12 {
            bench.wake();
            bench.press(3000, true);
            bench.set(Property::CMD, Cmd::Reset.number().into());
        }
        println!(
            "figure: node {number}: 12 resets, each after 3 s of T 990 at a stop: {:.1} °C",
            bench.hottest_c
        );
        // The model takes the housing for cold, which warms by 1 K/s meanwhile, so the true winding stays below the model's 120 °C.
        assert!(bench.hottest_c > 75.0, "node {number}: the stall is no load: {:.1}", bench.hottest_c);
        assert!(bench.hottest_c <= MOST_C, "node {number}: {:.1} °C", bench.hottest_c);
    }
}

/// The power goes as soon as the winding is as hot as it gets without a mark, and comes back at once.
#[test]
fn repeated_power_cut_before_the_mark_stays_below_the_winding_limit() {
    for number in KINDS {
        let mut bench = Bench::new(number, nominal(number), 1);
        for round in 0..12 {
            bench.wake();
            for _ in 0..12 {
                bench.press(250, round % 2 == 0);
                if bench.winding_c() > 94.0 {
                    break;
                }
            }
            bench.power_cycle(2);
        }
        println!("figure: node {number}: 12 power cuts near the mark: {:.1} °C", bench.hottest_c);
        assert!(
            bench.hottest_c > 60.0 && bench.hottest_c <= MOST_C,
            "node {number}: {:.1} °C",
            bench.hottest_c
        );
    }
}

#[derive(Clone, Copy, Debug)]
enum Interruption {
    Ordered,
    /// NRST or a brown-out that the RAM survives.
    Pin,
    Watchdog(u64),
    Power,
    None,
}

/// A minute of stalls at random instants, by a host that knows where the thresholds are.
fn adversary(number: u8, plant: PlantParams, seed: u64) -> f64 {
    let mut rng = Pcg64Mcg::new(u128::from(seed) << 8 | u128::from(number));
    let mut bench = Bench::new(number, plant, seed);
    let mut ms = 0_u32;
    while ms < 60_000 {
        bench.wake();
        let press = [rng.random_range(1..150), rng.random_range(150..800), rng.random_range(500..6000)]
            [rng.random_range(0..3_usize)];
        bench.press(press, rng.random());
        let interruption = [
            Interruption::Ordered,
            Interruption::Pin,
            Interruption::Watchdog(HANGS_US[0]),
            Interruption::Watchdog(rng.random_range(1..HANGS_US[1])),
            Interruption::Power,
            Interruption::None,
        ][rng.random_range(0..6_usize)];
        match interruption {
            Interruption::Ordered => {
                let (property, value) = if rng.random() {
                    (Property::STAT, 0)
                } else {
                    (Property::CMD, Cmd::Reset.number().into())
                };
                bench.set(property, value);
            }
            Interruption::Pin => bench.node.power_on(),
            Interruption::Watchdog(us) => {
                bench.node.hang(us);
                bench.hottest_c = bench.hottest_c.max(bench.winding_c());
            }
            Interruption::Power => bench.power_cycle(rng.random_range(1..40)),
            Interruption::None => {}
        }
        let pause = [0, 0, 0, rng.random_range(0..6000)][rng.random_range(0..4_usize)];
        bench.wait(pause);
        ms += press + pause + 70;
    }
    bench.hottest_c
}

/// Sequences of [`adversary`] a kind. 20 s of CI.
const SEQUENCES: u64 = 6;

#[test]
fn random_interruptions_stay_below_the_winding_limit() {
    let sequences = effort(SEQUENCES);
    let mut hottest = 0.0_f64;
    for number in KINDS {
        for seed in 0..sequences {
            let found = adversary(number, nominal(number), seed);
            assert!(found <= MOST_C, "node {number}, seed {seed}: {found:.1} °C");
            hottest = hottest.max(found);
        }
    }
    // The worst corner: less resistance draws more current, which more thermal resistance carries off less.
    let mut corners = Vec::new();
    for (r, k_w) in [(0.7, 1.0), (1.3, 1.0), (1.0, 1.3), (0.7, 1.3)] {
        let mut plant = nominal(1);
        plant.r_ohm *= r;
        plant.winding_housing_k_w *= k_w;
        let found = (0..2).map(|seed| adversary(1, plant.clone(), seed)).fold(0.0, f64::max);
        corners.push(format!("R × {r}, K/W × {k_w}: {found:.0} °C"));
    }
    println!(
        "figure: {} sequences of a minute with resets, watchdogs, brown-outs and power cuts: {hottest:.1} °C at most; {}",
        3 * sequences,
        corners.join("; ")
    );
}
