//! When a motor may be driven, and how hard.

use servo_core::guard::fault::Fault;
use servo_core::guard::thermal::DISABLED;
use servo_core::mode::Mode;
use servo_core::sense::commutation::Leg;

use super::joint::{Joint, LYING_HALLS, LYING_SENSORS, MEMORY, View, is_by_duty, is_idle};
use super::measure::Measure;
use crate::experiment::torture::kinds::{FaultKind, Kinds};
use crate::world::plant::RAD_PER_COUNT;
use crate::world::rig::Bridge;

/// The largest duty, 990 of 1024, in 1/32768.
const DUTY: u16 = 31_680;

/// Winding temperature at which the boards' model allows no torque, 130 C, and 5 K for its error.
const WINDING_C: f64 = 135.0;

/// The same while the flash has no hot mark: a start without it assumes 100 C (decision 0051), and 10 K for plants that are not nominal.
const WINDING_UNMARKED_C: f64 = 110.0;

/// The same where a sensor lies: insulation class F. The thermistor is the model's only anchor.
const WINDING_LYING_C: f64 = 155.0;

/// Full torque, and the band of temperature below OTEMP in which it decreases, 0.1 C.
const FULL: i32 = 990;
const BAND: i32 = 80;

/// Rounding of the derating, torque units: 0.1 C.
const ROUNDING: i32 = 13;

/// Over-current may pass the trip by what one microsecond adds: 36 V over 0.8 mH are 0.045 A.
const TRIP_A: f64 = 0.5;

/// Full torque is 24 V at standstill (decision 0003): a board that sees the bus voltage and the rotor drives no more than that. A stop
/// takes a rotor's EMF within a tick: the most in 600 seeds was 3.0 A more, and 4.0 A in seed 1682. This is twice that.
const FULL_V: f64 = 24.0;
const IMPACT_A: f64 = 8.0;

/// Bus voltage that is a fault, V.
const BUS_V: f64 = 32.0;

pub fn legs(_: &mut Joint, view: &View) -> Option<String> {
    let Bridge::On { legs, .. } = view.bridge else { return None };
    let count = |wanted: Leg| legs.iter().filter(|leg| **leg == wanted).count();
    // A leg that is switched at duty 0 reads as low on the emulated board.
    let good = count(Leg::Float) == 1 && count(Leg::Pwm) <= 1;
    (!good).then(|| format!("legs {legs:?}"))
}

pub fn load(joint: &mut Joint, view: &View) -> Option<String> {
    let low = view.sample.as_ref().is_some_and(|sample| sample.status.fault == Some(Fault::UnderVoltage));
    let was = std::mem::replace(&mut joint.power.was_low, low);
    // A board that hangs does not fold back.
    if !joint.has_strong_source || view.anywhere.meets(Kinds::of(&[FaultKind::BoardHang])) {
        return None;
    }
    (low && !was).then(|| format!("ERROR 5 although the source is whole; the bus is at {:.1} V", view.volts))
}

pub fn idle(joint: &mut Joint, view: &View) -> Option<String> {
    let idle = view.sample.as_ref().is_some_and(is_idle);
    let was = std::mem::replace(&mut joint.power.was_idle, idle);
    (idle && was && view.driven()).then(|| "idle, but the bridge is on".to_owned())
}

pub fn monitor(_: &mut Joint, view: &View) -> Option<String> {
    let node = view.node?;
    (node.application().is_none() && view.driven())
        .then(|| "no application runs, but the bridge is on".to_owned())
}

pub fn fault(joint: &mut Joint, view: &View) -> Option<String> {
    let fault = view.sample.as_ref().and_then(|sample| sample.status.fault);
    // A lost host forbids no motion.
    let forbids = fault.is_some_and(|fault| fault != Fault::HostLost);
    let was = std::mem::replace(&mut joint.power.was_faulty, forbids);
    (forbids && was && view.driven()).then(|| format!("{fault:?} is latched, but the bridge is on"))
}

pub fn brake(joint: &mut Joint, view: &View) -> Option<String> {
    let engaged = joint.has_brake && !view.brake_released;
    let was = std::mem::replace(&mut joint.power.was_engaged, engaged);
    (engaged && was && view.driven()).then(|| "driven against its brake".to_owned())
}

pub fn torque(joint: &mut Joint, view: &View) -> Option<String> {
    let Some((tater, sample)) = view.application() else {
        joint.power.limits = [0; MEMORY];
        return None;
    };
    let config = tater.config();
    let left = i32::from(config.otemp) - i32::from(sample.analog.motor_temp.0);
    let derated = if config.otemp == DISABLED { FULL } else { left.clamp(0, BAND) * FULL / BAND + ROUNDING };
    let power = &mut joint.power;
    power.limits[power.next] = i32::from(config.mt).min(derated);
    power.next = (power.next + 1) % MEMORY;
    let limit = power.limits.iter().copied().max().unwrap_or(0);
    let torque = i32::from(sample.status.torque.0).abs();
    (torque > limit && !is_by_duty(sample)).then(|| format!("torque {torque} beyond {limit}"))
}

pub fn duty(_: &mut Joint, view: &View) -> Option<String> {
    let duty = view.sample.as_ref()?.status.duty.0.to_bits().unsigned_abs();
    (duty > DUTY).then(|| format!("duty {duty}/32768"))
}

pub fn winding(joint: &mut Joint, view: &View) -> Option<String> {
    let lies = view.faults.meets(LYING_SENSORS.union(Kinds::of(&[FaultKind::ThermistorOpen])));
    let unmarked = view.application().is_some_and(|(tater, _)| !tater.is_marked_hot());
    let most = match (lies, unmarked) {
        (true, _) => WINDING_LYING_C,
        (false, true) => WINDING_UNMARKED_C,
        (false, false) => WINDING_C,
    };
    let found = view.truth.winding_c;
    joint.worst.note(Measure::Winding, found);
    (found > most).then(|| format!("winding at {found:.1} C, allowed are {most}"))
}

pub fn current(joint: &mut Joint, view: &View) -> Option<String> {
    let found = view.truth.peak_phase_a;
    let lies = view.faults.meets(LYING_SENSORS.union(LYING_HALLS).union(Kinds::of(&[FaultKind::BoardHang])));
    let most = if lies { joint.plant.trip_a + TRIP_A } else { FULL_V / joint.plant.r_ohm + IMPACT_A };
    (found > most).then(|| format!("{found:.1} A, allowed are {most:.1}"))
}

pub fn bus(_: &mut Joint, view: &View) -> Option<String> {
    let volts = view.volts;
    // A motor of the hand that is pushed beyond its no-load speed charges the bus through the diodes of a bridge that is off.
    let generates = view.anywhere.meets(Kinds::of(&[FaultKind::Push]));
    (volts > BUS_V && !generates).then(|| format!("bus at {volts:.1} V"))
}

pub fn erase(joint: &mut Joint, view: &View) -> Option<String> {
    let erased = view.node?.board().sim_flash().erased_while_driven();
    let before = std::mem::replace(&mut joint.power.erased, erased);
    (erased > before).then(|| "a page was erased with the bridge on".to_owned())
}

pub fn watchdog(joint: &mut Joint, view: &View) -> Option<String> {
    let resets = view.node?.watchdog_resets();
    let before = std::mem::replace(&mut joint.power.watchdog_resets, resets);
    let expected = view.faults.meets(Kinds::of(&[FaultKind::BoardHang]));
    (resets > before && !expected).then(|| "the watchdog has bitten".to_owned())
}

/// EMF that friction alone takes from a free rotor in a millisecond, V: 0.03 N·m on 2e-5 kg·m² and 0.0651 V·s are 0.1; the lowest of the
/// scattered plants have half.
const COASTING_V_MS: f64 = 0.05;

pub fn speed(joint: &mut Joint, view: &View) -> Option<String> {
    let speed = view.truth.counts_per_s.abs();
    joint.fastest = joint.fastest.max(speed);
    joint.driving_v = view.volts.max(joint.plant.bus_v).max(joint.driving_v - COASTING_V_MS);
    let no_load = joint.no_load(joint.driving_v);
    joint.pushed = view.truth.load_n_m * view.truth.counts_per_s > 0.0
        || view.faults.meets(Kinds::of(&[FaultKind::Push]))
        || joint.pushed && speed > no_load;
    if speed > no_load && !joint.pushed {
        return Some(format!("{speed:.0} counts/s, its voltage drives {no_load:.0}"));
    }
    let (tater, sample) = view.application()?;
    let config = tater.config();
    let moves = sample.status.mode == Mode::Trapezoidal;
    let fastest = config.mv.min(config.mcv.max(config.mov));
    joint.power.allowed = if moves { joint.power.allowed.max(fastest) } else { 0 };
    let wanted: f64 = sample.status.setpoint_velocity.0.to_num();
    let beyond = moves && wanted.abs() > f64::from(joint.power.allowed) + 1.0;
    beyond.then(|| format!("set-point at {wanted:.0} counts/s, allowed are {}", joint.power.allowed))
}

pub fn stops(joint: &mut Joint, view: &View) -> Option<String> {
    let plant = &joint.plant;
    let beyond = (plant.min_count - view.truth.counts).max(view.truth.counts - plant.max_count);
    // The stop begins half a count and half the gear's play beyond the range; it and the gear yield by T/k; without a damper a rotor would
    // enter it by v * sqrt(J/k).
    let peak_n_m = view.volts.max(plant.bus_v) / plant.r_ohm * plant.ke_v_s;
    let yields = plant.stop_rad_n_m();
    let pressed = 0.5 + 0.5 * plant.backlash_counts + peak_n_m * yields / RAD_PER_COUNT;
    let dent = (plant.j_kg_m2 * yields).sqrt() * joint.fastest;
    joint.worst.note(Measure::Dent, beyond);
    (beyond > pressed + dent).then(|| format!("{beyond:.2} counts beyond its range"))
}
