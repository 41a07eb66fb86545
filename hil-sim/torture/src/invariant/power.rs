//! When a motor may be driven, and how hard.

use tater_wire::{FaultCode, ModeCode, MotorKind, Property};

use super::contact::{ABOVE, RIPPLE_N_M, UNITS, strength};
use super::excuse::{LYING_WINDING, PUSHED, UNKNOWN_EMF};
use super::joint::{Joint, MEMORY, View};
use super::meaning::WIRED;
use super::measure::Measure;
use hil_world::rig::{Bridge, Leg};

/// The largest duty, 990 of 1024, in 1/32768.
const DUTY: u16 = 31_680;

/// By how much dead time and rounding may reduce the largest duty, 1/32768: 500 ns of 50 us twice (docs/board.md, Bridge) are 1.1 %.
const DEAD: u16 = 512;

/// Bus voltage from which on a board returns less current, V (decision 0053), and the tolerance of its measurement.
const RETURN_V: f64 = 27.5;

/// Winding temperature at which the boards' model allows no torque, 130 C, and 5 K for its error.
pub(super) const WINDING_C: f64 = 135.0;

/// The same while the flash has no hot mark: a start without it assumes 100 C (decision 0051), and 10 K for plants that are not nominal.
const WINDING_UNMARKED_C: f64 = 110.0;

/// The same where a sensor lies: insulation class F.
const WINDING_LYING_C: f64 = 155.0;

/// Full torque, and the band of temperature below OTEMP in which it decreases, 0.1 C.
const FULL: i64 = 990;
const BAND: i64 = 80;

/// OTEMP that disables the limit (docs/properties.md).
const DISABLED: i64 = -551;

/// Rounding of the derating, torque units: 0.1 C.
const ROUNDING: i64 = 13;

/// Over-current may pass the trip by what one microsecond adds: 36 V over 0.8 mH are 0.045 A.
const TRIP_A: f64 = 0.5;

/// Full torque is 24 V at standstill (decision 0003): a board that sees the bus voltage and the rotor drives no more than that. A stop
/// takes a rotor's EMF within a tick: the most in 600 seeds was 3.0 A more, and 4.0 A in seed 1682. This is twice that.
const FULL_V: f64 = 24.0;
const IMPACT_A: f64 = 8.0;

/// Highest bus voltage, V: nothing is returned from 29 on, a tick after it is there. Six motors with little resistance that brake together on a source
/// of 27.8 V reached 30.3 (torture seed 1764400960); nominal ones stay below 30 (tests/supply.rs).
const BUS_V: f64 = 31.0;

pub fn legs(_: &mut Joint, view: &View) -> Option<String> {
    let Bridge::On { legs, .. } = view.bridge else { return None };
    let count = |wanted: Leg| legs.iter().filter(|leg| **leg == wanted).count();
    // A leg that is switched at duty 0 reads as low on the emulated board.
    let good = count(Leg::Float) == 1 && count(Leg::Pwm) <= 1;
    (!good).then(|| format!("legs {legs:?}"))
}

/// ERROR.
fn fault_of(view: &View) -> Option<FaultCode> {
    FaultCode::of(view.property(Property::ERROR)?)
}

pub fn load(joint: &mut Joint, view: &View) -> Option<String> {
    let low = fault_of(view) == Some(FaultCode::UnderVoltage);
    let was = std::mem::replace(&mut joint.power.was_low, low);
    (low && !was && joint.has_strong_source)
        .then(|| format!("ERROR 5 although the source is whole; the bus is at {:.1} V", view.volts))
}

pub fn idle(joint: &mut Joint, view: &View) -> Option<String> {
    let idle = view.mode() == Some(ModeCode::Idle);
    let was = std::mem::replace(&mut joint.power.was_idle, idle);
    (idle && was && view.driven()).then(|| "idle, but the bridge is on".to_owned())
}

pub fn monitor(_: &mut Joint, view: &View) -> Option<String> {
    (!view.runs() && view.driven()).then(|| "no application runs, but the bridge is on".to_owned())
}

pub fn fault(joint: &mut Joint, view: &View) -> Option<String> {
    let fault = fault_of(view);
    // A lost host forbids no motion, nor does the storage.
    let forbids = fault.is_some_and(|fault| !matches!(fault, FaultCode::HostLost | FaultCode::Storage));
    let was = std::mem::replace(&mut joint.power.was_faulty, forbids);
    (forbids && was && view.driven()).then(|| format!("{fault:?} is latched, but the bridge is on"))
}

pub fn brake(joint: &mut Joint, view: &View) -> Option<String> {
    let engaged = joint.kind == MotorKind::Spread && !view.brake_released;
    let was = std::mem::replace(&mut joint.power.was_engaged, engaged);
    (engaged && was && view.driven()).then(|| "driven against its brake".to_owned())
}

/// Whether the bounds of the duty set the torque, which may brake harder than MT: that of 97 % a rotor that is faster than its voltage drives it
/// (decision 0005), that of a high bus one that returns current (decision 0053).
fn is_by_duty(joint: &Joint, view: &View) -> bool {
    let Bridge::On { duty, .. } = view.bridge else { return false };
    // At a few volts dead time takes more of the duty.
    if view.truth.counts_per_s.abs() > joint.no_load(view.volts) {
        return true;
    }
    // The board has read the bus a tick ago.
    let read_v = view.property(Property::VBUS).map_or(0.0, |volts| volts as f64 / 10.0);
    duty.0.to_bits().unsigned_abs() >= DUTY - DEAD || view.volts.max(read_v) > RETURN_V
}

/// Whether T opposes the rotor, whose true torque is no more than MT. T follows from a voltage less the EMF that the board believes in: Ke 30 % off
/// is half of the full torque at full speed (docs/safety.md), and a bus that reads 0 V all of it.
fn brakes_within(joint: &Joint, view: &View, torque: i64, limit: i64) -> bool {
    let most = ABOVE * limit as f64 / UNITS * strength(&joint.plant) + RIPPLE_N_M;
    torque as f64 * view.truth.counts_per_s < 0.0 && view.truth.torque_n_m.abs() <= most
}

pub fn torque(joint: &mut Joint, view: &View) -> Option<String> {
    if !view.runs() {
        joint.power.limits = [0; MEMORY];
        return None;
    }
    let otemp = view.property(Property::OTEMP)?;
    let left = otemp - view.property(Property::THERM)?;
    let derated = if otemp == DISABLED { FULL } else { left.clamp(0, BAND) * FULL / BAND + ROUNDING };
    let power = &mut joint.power;
    power.limits[power.next] = view.property(Property::MT)?.min(derated);
    power.next = (power.next + 1) % MEMORY;
    let limit = power.limits.iter().copied().max().unwrap_or(0);
    let torque = view.property(Property::T)?;
    (torque.abs() > limit && !is_by_duty(joint, view) && !brakes_within(joint, view, torque, limit))
        .then(|| format!("torque {torque} beyond {limit}"))
}

/// What may drive a rotor against T, as a share of MT, and for how long, ms. One that runs ahead of T is braked: before the board knows the direction
/// of its motor it compensates no EMF (decision 0047). An EMF is compensated by an estimate, which a rotor that is thrown back
/// by a stop leaves behind: its supply current shows that within a few ticks (decision 0076).
const AGAINST: f64 = 0.25;
pub(super) const AGAINST_MS: u32 = 6;

pub fn sign(joint: &mut Joint, view: &View) -> Option<String> {
    let (torque, mt) = (view.property(Property::T)?, view.property(Property::MT)?);
    let truth = view.truth.torque_n_m;
    let most = AGAINST * mt as f64 / UNITS * strength(&joint.plant) + RIPPLE_N_M;
    // While FIND learns the wiring nobody knows the sign of a torque.
    let is_wired = view.property(Property::FIND) == Some(WIRED);
    // The current follows T within a tick.
    let stays = std::mem::replace(&mut joint.power.torque, torque).signum() == torque.signum();
    let (t, speed) = (torque as f64, view.truth.counts_per_s);
    let against = t * truth < 0.0 && t * speed < 0.0 && truth.abs() > most;
    let against = against && view.driven() && is_wired && stays;
    let ms = if against { joint.power.against_ms + 1 } else { 0 };
    joint.power.against_ms = ms;
    joint.worst.note(Measure::AgainstMs, ms.into());
    (ms > AGAINST_MS).then(|| {
        format!("T says {torque}, and {truth:.3} N·m drive against it for {ms} ms, at {speed:.0} counts/s")
    })
}

pub fn duty(_: &mut Joint, view: &View) -> Option<String> {
    let Bridge::On { duty, .. } = view.bridge else { return None };
    let duty = duty.0.to_bits().unsigned_abs();
    (duty > DUTY).then(|| format!("duty {duty}/32768"))
}

pub fn winding(joint: &mut Joint, view: &View) -> Option<String> {
    let lies = LYING_WINDING.is_recent(view);
    let unmarked = view.ground.is_some_and(|ground| !ground.is_marked_hot);
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
    let lies = UNKNOWN_EMF.is_recent(view);
    let most = if lies { joint.plant.trip_a + TRIP_A } else { FULL_V / joint.plant.r_ohm + IMPACT_A };
    (found > most).then(|| format!("{found:.1} A, allowed are {most:.1}"))
}

pub fn bus(_: &mut Joint, view: &View) -> Option<String> {
    let volts = view.volts;
    (volts > BUS_V).then(|| format!("bus at {volts:.1} V"))
}

pub fn erase(joint: &mut Joint, view: &View) -> Option<String> {
    let erased = view.ground?.erased_while_driven;
    let before = std::mem::replace(&mut joint.power.erased, erased);
    (erased > before).then(|| "a page was erased with the bridge on".to_owned())
}

pub fn watchdog(joint: &mut Joint, view: &View) -> Option<String> {
    let resets = view.ground?.watchdog_resets;
    let before = std::mem::replace(&mut joint.power.watchdog_resets, resets);
    (resets > before).then(|| "the watchdog has bitten".to_owned())
}

/// EMF that friction alone takes from a free rotor in a millisecond, V: 0.03 N·m on 2e-5 kg·m² and 0.0651 V·s are 0.1; the lowest of the
/// scattered plants have half.
const COASTING_V_MS: f64 = 0.05;

/// By how much, counts/s, and for how long, ms, a move may be faster than MV: a rotor that breaks loose overshoots a slow set-point. In 300 seeds
/// the most was 165 counts/s, and 47 ms.
const OVERSHOOT: f64 = 50.0;
const OVERSHOOT_MS: u32 = 100;

pub fn speed(joint: &mut Joint, view: &View) -> Option<String> {
    let speed = view.truth.counts_per_s.abs();
    joint.fastest = joint.fastest.max(speed);
    joint.driving_v = view.volts.max(joint.plant.bus_v).max(joint.driving_v - COASTING_V_MS);
    let no_load = joint.no_load(joint.driving_v);
    joint.pushed = view.truth.load_n_m * view.truth.counts_per_s > 0.0
        || PUSHED.is_recent(view)
        || joint.pushed && speed > no_load;
    if speed > no_load && !joint.pushed {
        return Some(format!("{speed:.0} counts/s, its voltage drives {no_load:.0}"));
    }
    let moves = view.mode()? == ModeCode::Trapezoidal;
    let either = view.property(Property::MCV)?.max(view.property(Property::MOV)?);
    let fastest = view.property(Property::MV)?.min(either);
    joint.power.allowed = if moves { joint.power.allowed.max(fastest) } else { 0 };
    // What another finger pushes is not the move's.
    let beyond = moves
        && !joint.pushed
        && view.truth.load_n_m == 0.0
        && speed > joint.power.allowed as f64 + OVERSHOOT;
    joint.power.fast_ms = if beyond { joint.power.fast_ms + 1 } else { 0 };
    (joint.power.fast_ms > OVERSHOOT_MS).then(|| {
        format!("moves at {speed:.0} counts/s for {OVERSHOOT_MS} ms, allowed are {}", joint.power.allowed)
    })
}

pub fn stops(joint: &mut Joint, view: &View) -> Option<String> {
    let plant = &joint.plant;
    let beyond = (plant.min_count - view.truth.counts).max(view.truth.counts - plant.max_count);
    // The stop begins half a count and half the gear's play beyond the range.
    let peak_n_m = view.volts.max(plant.bus_v) / plant.r_ohm * plant.ke_v_s;
    let pressed = 0.5 + 0.5 * plant.backlash_counts + joint.twist(peak_n_m);
    (beyond > pressed + joint.blow(joint.fastest)).then(|| format!("{beyond:.2} counts beyond its range"))
}
