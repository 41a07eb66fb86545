//! A motor on its board, and the plants to try.

use crate::effort::effort;
use hil_experiment::run::Options;
use hil_experiment::scenario::Scenario;
use hil_world::node::{Node, Sample};
use hil_world::plant::Model;
use servo_core::{EndReason, Event};
use tater_wire::{Destination, Message, MotorKind, Property};

pub const KINDS: [&str; 3] = ["link", "spread", "tip"];

/// Ends of a joint's range, counts.
pub fn travel(kind: &str) -> (i32, i32) {
    let kind = match kind {
        "link" => MotorKind::Link,
        "spread" => MotorKind::Spread,
        _ => MotorKind::Tip,
    };
    let [low, high] = kind.range_counts().map(i32::from);
    (low, high)
}

/// Plants of a figure: the fewest that have a 95th percentile.
const PLANTS: u64 = 100;

/// The targets are for motors without what the defaults have beyond the ideal motor: cogging, friction that falls with speed, a gear with play
/// that twists, and edges that depend on their direction and scatter. `TARGET_EFFECTS` leaves it in.
const IDEAL: (&str, &str) = (
    "cogging_n_m = 0, stribeck_counts_s = 0, backlash_counts = 0, gear_rad_n_m = 0",
    "hall_hysteresis_deg = 0, hall_jitter_deg = 0",
);

/// Whether the plants have the defaults' effects.
pub fn with_effects() -> bool {
    std::env::var_os("TARGET_EFFECTS").is_some()
}

/// Interval of the host's polls, ms: modes 2 and 4 end without a host.
const POLL_MS: u32 = 100;

/// Seeds of scattered plants.
pub fn plants() -> std::ops::Range<u64> {
    0..effort(PLANTS)
}

/// What to try: lines of a scenario, and its motor.
#[derive(Clone, Debug)]
pub struct Setup {
    pub kind: &'static str,
    /// Such as `MV = 16, ACCEL = 100`.
    pub set: String,
    /// Such as `cogging_n_m = 0.005`.
    pub plant: String,
    pub from: f64,
    pub winding_c: f64,
    /// ± of the plants' figures, and of the halls' places in degrees electrical.
    pub scatter: (f64, f64),
}

impl Setup {
    pub fn new(kind: &'static str, set: &str, from: f64) -> Self {
        // Without breakaway, which ends the hard start of a link.
        let set = format!("MCV = 4080, MOV = 4080, BT = 0, {set}");
        Self { kind, set, plant: String::new(), from, winding_c: 25.0, scatter: (0.3, 10.0) }
    }

    pub fn plant(mut self, plant: &str) -> Self {
        plant.clone_into(&mut self.plant);
        self
    }
}

pub struct Motor {
    pub node: Node,
    pub ended: Option<EndReason>,
}

impl Motor {
    /// The nominal motor, or the plant of a seed. Its stops are far away.
    pub fn new(setup: &Setup, seed: Option<u64>) -> Self {
        let Setup { kind, set, plant, from, winding_c, scatter } = setup;
        let (scatter, degrees) = if seed.is_some() { *scatter } else { (0.0, 0.0) };
        let mut plant = plant.clone();
        if !plant.contains("max_count") {
            plant = format!("min_count = -4000, max_count = 4000, {plant}");
        }
        let mut rig = "";
        if !with_effects() {
            // A target with an effect of its own sets only that one.
            let others =
                IDEAL.0.split(", ").filter(|zero| !plant.contains(zero.split(' ').next().unwrap_or("?")));
            let others = others.collect::<Vec<_>>().join(", ");
            plant = format!("{}, {others}", plant.trim_end_matches(", "));
            rig = IDEAL.1;
        }
        let text = format!(
            "name = \"target\"\nabout = \"\"\nmotor = \"{kind}\"\nduration_ms = 1\nscatter = {scatter:?}\nhall_scatter_deg = {degrees:?}\n\
             set = {{ {set} }}\nplant = {{ {plant} }}\nrig = {{ {rig} }}\n\
             initial = {{ position_counts = {from}, winding_c = {winding_c:?}, housing_c = {winding_c:?} }}\n"
        );
        let scenario = Scenario::parse("target", &text).unwrap_or_else(|error| panic!("{error:?}\n{text}"));
        let options = Options { seed: seed.unwrap_or(1), model: Model::Averaged, trace: false };
        let node = hil_experiment::run::board(&scenario, &scenario.cases[0], &options).expect("valid");
        Self { node, ended: None }
    }

    pub fn set(&mut self, property: Property, value: i64) {
        hil_experiment::run::set(&mut self.node, property, value).expect("an order that it takes");
    }

    /// One millisecond.
    pub fn step(&mut self) -> Sample {
        let sample = self.node.sample().expect("awake");
        if sample.ms.is_multiple_of(POLL_MS) {
            let poll = Message::get(Destination::Node(self.node.straps()), Property::MODE);
            self.node.receive(&poll.frame()).expect("a request");
        }
        while let Some(answer) = self.node.mailboxes().first().copied() {
            self.node.sent(&answer);
        }
        self.node.step();
        while let Some(event) = self.node.event() {
            if let Event::Ended { reason, .. } = event {
                self.ended = Some(reason);
            }
        }
        self.node.sample().expect("awake")
    }

    pub fn run(&mut self, ms: u32) -> Vec<Sample> {
        (0..ms).map(|_| self.step()).collect()
    }

    /// Until the move ends, and the samples of it.
    pub fn run_to_end(&mut self, most_ms: u32) -> Vec<Sample> {
        let mut samples = Vec::new();
        self.ended = None;
        while self.ended.is_none() && samples.len() < most_ms as usize {
            samples.push(self.step());
        }
        samples
    }
}
