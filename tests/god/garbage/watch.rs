//! Invariants of the hand, checked each millisecond whatever the host sends.
//!
//! GOD does not clamp goals to a joint's range (manual 5.5). The limits come from the boards (servo-core's guard) and the plant's stops:
//!
//! * A joint stays between its stops, and dents them no deeper than a rotor at its highest speed does.
//! * No rotor turns faster than 97 % of the bus voltage can turn it, except the spread while other fingers push it. No set-point moves
//!   faster than MV with MCV or MOV has allowed since the motion began.
//! * The duty is at most 97 %. The torque is at most MT, except where the duty limit alone brakes a fast rotor harder
//!   (`LimitCause::Duty`). The phase current stays below the driver's trip, and the winding below its class.
//! * An idle motor is not driven, nor one whose board is in its monitor. No page is erased while a motor is driven. No watchdog resets.
//! * A host can cause three faults: HostLost, because the walk-through grammar can leave a motor in mode 2 or 4 and a host that never reads blocks
//!   RealTime; OverTemperature, because it can set a board's OTEMP; and Jammed, because an object in the hand, or another finger, can stop a
//!   motor that homes, and an impact can wedge a joint whose board is then reset (decision 0047).
//! * GOD's queues and its transmit mailboxes neither lose nor grow.

use hil_experiment::metrics::fault_word;
use hil_world::hand::Hand;
use hil_world::node::{Node, Sample};
use hil_world::plant::{PlantParams, RAD_PER_COUNT};
use servo_core::guard::fault::{Fault, LimitCause};
use servo_core::mode::Mode;
use std::collections::BTreeSet;
use tater_wire::MotorKind;

/// Transmit mailboxes of GOD's CAN controller.
pub const WAITING: usize = 3;

/// The largest duty, 97 % of the bus, in 1/32768.
const DUTY: u16 = 31_680;

/// Winding temperature at which the boards' model allows no torque, 130 C, and 5 K for its error.
const WINDING_C: f64 = 135.0;

#[derive(Clone, Debug, Default)]
pub struct Peaks {
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
    pub waiting: usize,
    pub prompt_us: u64,
    pub faults: BTreeSet<&'static str>,
}

impl Peaks {
    pub fn merge(mut self, other: Self) -> Self {
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

impl std::fmt::Display for Peaks {
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

struct Joint {
    range: [f64; 2],
    /// Furthest position beyond the range at rest under peak torque, counts.
    pressed: f64,
    /// Additional distance for each count/s of speed, s.
    per_speed: f64,
    no_load: f64,
    peak: f64,
    pushed: bool,
    trip_a: f64,
    /// MT at the last three checks: a tick that plans a move still applies the torque of the tick before.
    mt: [u16; 3],
    /// Whether it was idle at the last check: the bridge turns off at the next tick.
    was_idle: bool,
    /// Highest limit by MV with MCV and MOV since mode 5 began, counts/s.
    fastest: u16,
}

impl Joint {
    fn new(kind: MotorKind) -> Self {
        let plant = PlantParams::for_motor(kind);
        let no_load = plant.bus_v * f64::from(DUTY) / 32_768.0 / plant.ke_v_s / RAD_PER_COUNT;
        let yields = plant.stop_rad_n_m();
        let peak_torque = 1024.0 / 1575.0;
        Self {
            range: [plant.min_count, plant.max_count],
            // As torture's invariant `within-stops`.
            pressed: 0.5 + 0.5 * plant.backlash_counts + peak_torque * yields / RAD_PER_COUNT,
            per_speed: (plant.j_kg_m2 * yields).sqrt(),
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

pub struct Watch {
    joints: [Joint; 7],
    pub peaks: Peaks,
    /// Whether more faults than those that a host causes are expected: boards lose their power.
    pub any_fault: bool,
}

impl Watch {
    pub fn new() -> Self {
        let kind = |motor| match motor {
            0..3 => MotorKind::Link,
            3 => MotorKind::Spread,
            _ => MotorKind::Tip,
        };
        Self {
            joints: std::array::from_fn(|motor| Joint::new(kind(motor))),
            peaks: Peaks::default(),
            any_fault: false,
        }
    }

    pub fn check(&mut self, hand: &Hand) {
        for (motor, (joint, node)) in self.joints.iter_mut().zip(hand.bus().stations()).enumerate() {
            let at = format_args!("motor {} at {} us", motor + 1, hand.now_us()).to_string();
            check_plant(joint, node, &mut self.peaks, &at);
            match node.sample() {
                None => assert_eq!(node.board().driven_since_us(), None, "{at}: driven without a program"),
                Some(sample) => {
                    let config = node.application().expect("it has a sample").config();
                    joint.mt.rotate_right(1);
                    joint.mt[0] = config.mt;
                    let fastest = config.mv.min(config.mcv.max(config.mov));
                    let moves = sample.status.mode == Mode::Trapezoidal;
                    joint.fastest = if moves { joint.fastest.max(fastest) } else { 0 };
                    check_servo(joint, &sample, &mut self.peaks, self.any_fault, &at);
                }
            }
        }
        self.peaks.waiting = self.peaks.waiting.max(hand.bus().waiting());
        assert!(hand.bus().waiting() <= WAITING, "{} frames wait", hand.bus().waiting());
        assert_eq!((hand.io().lost_bytes(), hand.io().lost_frames()), (0, 0), "bytes and frames lost by GOD");
    }
}

fn check_plant(joint: &mut Joint, node: &Node, peaks: &mut Peaks, at: &str) {
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
    peaks.beyond = peaks.beyond.max(beyond);
    peaks.speed = peaks.speed.max(speed);
    peaks.current = peaks.current.max(truth.peak_phase_a);
    peaks.winding = peaks.winding.max(truth.winding_c);
}

fn check_servo(joint: &mut Joint, sample: &Sample, peaks: &mut Peaks, any_fault: bool, at: &str) {
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
        peaks.faults.insert(fault_word(fault));
        let is_expected =
            any_fault || matches!(fault, Fault::HostLost | Fault::OverTemperature | Fault::Jammed);
        assert!(is_expected, "{at}: {fault:?}");
    }
    peaks.torque = peaks.torque.max(torque);
}
