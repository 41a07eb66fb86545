//! What must hold of the hand at every millisecond, whatever its host says.
//!
//! GOD clamps no goal to a joint's range: a motor that meets its stop stalls there (manual 5.5). The limits that nothing a host says may
//! lift are the boards' (servo-core's guard) and the joints' (the plant's stops):
//!
//! * a joint stays between its stops, and dents them no deeper than a rotor at its highest speed does;
//! * no rotor turns faster than 97 % of the bus can turn it, unless it is the spread's and other fingers push it; and no set-point goes
//!   faster than MV with MCV or MOV has allowed since its motion began;
//! * the duty is 97 % at most; the torque MT at most, but where a rotor is so fast that the duty bound alone brakes harder (`LimitCause::Duty`);
//!   the phase current stays below the driver's trip, and the winding below its class;
//! * an idle motor, and one whose board is in its monitor, is not driven; no page is erased while one is; no watchdog bites;
//! * of all faults two may come of what a host says: HostLost, because the lower grammar can leave a motor in mode 2 or 4, or a host
//!   that never reads holds RealTime up; and OverTemperature, because it can set a board's OTEMP.
//!
//! And memory: GOD has no heap, and neither its queues nor its adapter's lose or grow.

use hil_sim::MotorKind;
use hil_sim::hand::Hand;
use hil_sim::metrics::fault_word;
use hil_sim::node::{Node, Sample};
use hil_sim::plant::{PlantParams, RAD_PER_COUNT};
use servo_core::guard::fault::{Fault, LimitCause};
use servo_core::mode::Mode;
use std::collections::BTreeSet;

/// Frames of GOD's that may wait for the bus in its adapter.
pub const WAITING: usize = 32;

/// The largest duty, 97 % of the bus, in 1/32768.
const DUTY: u16 = 31_680;

/// Winding temperature at which the boards' model allows no torque, 130 C, and 5 K for its error.
const WINDING_C: f64 = 135.0;

/// What has been seen at most.
#[derive(Clone, Debug, Default)]
pub struct Most {
    /// Beyond the last whole count of a joint's range, counts.
    pub beyond: f64,
    /// Counts/s.
    pub speed: f64,
    /// 1/1024 of peak.
    pub torque: i16,
    /// A.
    pub current: f64,
    /// C.
    pub winding: f64,
    /// Frames that waited in GOD's adapter.
    pub waiting: usize,
    /// How long the prompt has taken after ^C, us.
    pub prompt_us: u64,
    /// Faults that boards have had.
    pub faults: BTreeSet<&'static str>,
}

impl Most {
    pub fn and(mut self, other: Self) -> Self {
        self.beyond = self.beyond.max(other.beyond);
        self.speed = self.speed.max(other.speed);
        self.torque = self.torque.max(other.torque);
        self.current = self.current.max(other.current);
        self.winding = self.winding.max(other.winding);
        self.waiting = self.waiting.max(other.waiting);
        self.prompt_us = self.prompt_us.max(other.prompt_us);
        self.faults.extend(other.faults);
        self
    }
}

impl std::fmt::Display for Most {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { beyond, speed, torque, current, winding, waiting, prompt_us, faults } = self;
        let prompt_ms = prompt_us / 1000;
        write!(
            f,
            "at most {beyond:.2} counts beyond a joint's range, {speed:.0} counts/s, torque {torque}, {current:.1} A, winding \
             {winding:.0} C, {waiting} frames waiting, {prompt_ms} ms from ^C to the prompt; faults {faults:?}"
        )
    }
}

/// A motor's limits.
struct Joint {
    range: [f64; 2],
    /// How far beyond its range it can be at rest, pressed by the peak torque, counts.
    pressed: f64,
    /// And how much further for each count/s of its speed, s.
    per_speed: f64,
    no_load: f64,
    /// Its highest speed yet, and whether it is beyond `no_load` because something pushes it.
    peak: f64,
    pushed: bool,
    trip_a: f64,
    /// MT at the last looks: a tick that plans goes on with the torque of the one before.
    mt: [u16; 3],
    /// Whether it was idle at the last look: a tick turns the bridge off.
    was_idle: bool,
    /// The highest of MV with MCV and MOV since mode 5 began.
    fastest: u16,
}

impl Joint {
    fn new(kind: MotorKind) -> Self {
        let plant = PlantParams::for_motor(kind);
        let no_load = plant.bus_v * f64::from(DUTY) / 32_768.0 / plant.ke_v_s / RAD_PER_COUNT;
        let spring = plant.stop_stiffness_n_m_rad;
        let peak_torque = 1024.0 / 1575.0;
        Self {
            range: [plant.min_count, plant.max_count],
            // The stop begins half a count beyond the range, and gives by T/k; a rotor goes v * sqrt(J/k) into one without a damper.
            pressed: 0.5 + peak_torque / spring / RAD_PER_COUNT,
            per_speed: (plant.j_kg_m2 / spring).sqrt(),
            no_load,
            peak: no_load,
            pushed: false,
            trip_a: plant.trip_a,
            mt: [0; 3],
            was_idle: false,
            fastest: 0,
        }
    }
}

/// Looks, and remembers.
pub struct Watch {
    joints: [Joint; 7],
    pub most: Most,
}

impl Watch {
    pub fn new() -> Self {
        let kind = |motor| match motor {
            0..3 => MotorKind::Link,
            3 => MotorKind::Spread,
            _ => MotorKind::Tip,
        };
        Self { joints: std::array::from_fn(|motor| Joint::new(kind(motor))), most: Most::default() }
    }

    /// To be called after each millisecond.
    pub fn look(&mut self, hand: &Hand) {
        for (motor, (joint, node)) in self.joints.iter_mut().zip(hand.bus().stations()).enumerate() {
            let at = format_args!("motor {} at {} us", motor + 1, hand.now_us()).to_string();
            look_at_plant(joint, node, &mut self.most, &at);
            match node.sample() {
                None => assert_eq!(node.board().driven_since_us(), None, "{at}: driven without a program"),
                Some(sample) => {
                    let config = node.application().expect("it has a sample").config();
                    joint.mt.rotate_right(1);
                    joint.mt[0] = config.mt;
                    let fastest = config.mv.min(config.mcv.max(config.mov));
                    let moves = sample.status.mode == Mode::Trapezoidal;
                    joint.fastest = if moves { joint.fastest.max(fastest) } else { 0 };
                    look_at_servo(joint, &sample, &mut self.most, &at);
                }
            }
        }
        self.most.waiting = self.most.waiting.max(hand.bus().waiting());
        assert!(hand.bus().waiting() <= WAITING, "{} frames wait", hand.bus().waiting());
        assert_eq!(hand.io().lost(), 0, "bytes or frames lost by GOD");
    }
}

/// The rotor, its winding and its flash.
fn look_at_plant(joint: &mut Joint, node: &Node, most: &mut Most, at: &str) {
    let truth = node.board().rig().truth();
    let [min, max] = joint.range;
    let beyond = (min - truth.counts).max(truth.counts - max);
    let speed = truth.counts_per_s.abs();
    joint.peak = joint.peak.max(speed);
    assert!(beyond <= joint.pressed + joint.per_speed * joint.peak, "{at}: {beyond} counts beyond its range");
    joint.pushed = truth.load_n_m * truth.counts_per_s > 0.0 || joint.pushed && speed > joint.no_load;
    assert!(speed <= joint.no_load || joint.pushed, "{at}: {speed} counts/s");
    assert!(truth.peak_phase_a < joint.trip_a, "{at}: {} A", truth.peak_phase_a);
    assert!(truth.winding_c <= WINDING_C, "{at}: {} C", truth.winding_c);
    let flash = node.board().sim_flash();
    assert!(!flash.is_dead() && flash.erased_while_driven() == 0, "{at}: {flash:?}");
    assert_eq!(node.watchdog_resets(), 0, "{at}");
    most.beyond = most.beyond.max(beyond);
    most.speed = most.speed.max(speed);
    most.current = most.current.max(truth.peak_phase_a);
    most.winding = most.winding.max(truth.winding_c);
}

/// What the servo applies, and what it is at.
fn look_at_servo(joint: &mut Joint, sample: &Sample, most: &mut Most, at: &str) {
    let status = &sample.status;
    assert!(status.duty.0.to_bits().unsigned_abs() <= DUTY, "{at}: {status:?}");
    let torque = status.torque.0.saturating_abs();
    let mt = joint.mt.into_iter().max().unwrap_or(0);
    assert!(
        status.limit == Some(LimitCause::Duty) || i32::from(torque) <= i32::from(mt),
        "{at}: beyond MT {mt}: {status:?}"
    );
    let is_idle = status.mode == Mode::Idle;
    let was_idle = std::mem::replace(&mut joint.was_idle, is_idle);
    assert!(!(is_idle && was_idle && sample.driven), "{at}: an idle motor is driven");
    let wanted: f64 = status.setpoint_velocity.0.to_num();
    assert!(
        status.mode != Mode::Trapezoidal || wanted.abs() <= f64::from(joint.fastest) + 1.0,
        "{at}: {wanted} counts/s, allowed are {}",
        joint.fastest
    );
    if let Some(fault) = status.fault {
        most.faults.insert(fault_word(fault));
        assert!(matches!(fault, Fault::HostLost | Fault::OverTemperature), "{at}: {fault:?}");
    }
    most.torque = most.torque.max(torque);
}
