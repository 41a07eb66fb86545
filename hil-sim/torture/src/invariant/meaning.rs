//! Whether properties do what the documents say, judged by the plant and the wire: HSG, LSG and BT, and what END and the measured values say.

use std::collections::VecDeque;

use tater_wire::{EndCode, ModeCode, MotorKind, Property};

use super::contact::{RIPPLE_N_M, STILL, UNITS, presses, strength};
use super::joint::{Errand, Joint, Reported, View};
use super::measure::Measure;
use hil_world::plant::PlantParams;

/// Values of HSG and LSG that disable them, and HSG 0 (manual 5.3.1, docs/properties.md).
const DISABLED: i64 = 255;

/// Ticks within which a strain outside HSG and LSG ends a move: the tick that reads it, and the next.
pub(super) const STRAIN_MS: u32 = 2;

/// A link breaks away under BT (docs/safety.md: 10 ms). Torque above BT that the board cannot take for less: R, Ke and halls are off
/// by 30 % and 10°.
const LOADED: f64 = 1.3;

/// Ticks within which it must: 10 ms of BT, and until it is slower than a quarter of its set-point, which halls show by the time since the last
/// count: 4 counts at that speed. That is MV, or some 160 counts/s of a move that is held in its first counts (67 ms in the long seed 8). Half as
/// much again for both.
pub(super) const BREAKS_AWAY_MS: u32 = 100;
const BREAKS_AWAY_COUNTS: u32 = 6;

/// Counts before E from which on a set-point still moves while its link lags by the few counts that make up a torque.
const UNDER_WAY: i64 = 80;

/// Whether a motion of the errand is under way.
fn is_under_way(joint: &Joint, view: &View) -> bool {
    let mode = view.mode();
    let runs = match joint.meaning.errand {
        Errand::Moves => mode == Some(ModeCode::Trapezoidal),
        // V is the velocity of mode 4: one that a host sets meanwhile takes over, and ends TC and TO (docs/properties.md).
        Errand::Presses => {
            mode == Some(ModeCode::Velocity) && view.property(Property::V) != view.property(Property::VSET)
        }
        Errand::None | Errand::Homes => false,
    };
    runs && view.driven() && view.property(Property::END) == Some(0)
}

pub fn strain(joint: &mut Joint, view: &View) -> Option<String> {
    let under_way = is_under_way(joint, view);
    let meaning = &mut joint.meaning;
    let [hsg, lsg, sg] = [Property::HSG, Property::LSG, Property::SG].map(|it| view.property(it));
    let (hsg, lsg, sg) = (hsg?, lsg?, sg?);
    let above = hsg != 0 && hsg < DISABLED && sg > hsg;
    let below = lsg < DISABLED && sg < lsg;
    meaning.strained_ms = if under_way && (above || below) && view.orders().next().is_none() {
        meaning.strained_ms + 1
    } else {
        0
    };
    joint.worst.note(Measure::StrainMs, meaning.strained_ms.into());
    (meaning.strained_ms > STRAIN_MS)
        .then(|| format!("moves on for {} ms with SG {sg}; LSG is {lsg}, HSG {hsg}", meaning.strained_ms))
}

pub fn breakaway(joint: &mut Joint, view: &View) -> Option<String> {
    let strength = strength(&joint.plant);
    let moves = joint.meaning.errand == Errand::Moves && is_under_way(joint, view);
    let bt = view.property(Property::BT)?;
    let end = view.property(Property::E)?;
    let way = end - view.property(Property::P)?;
    // One whose end has come nearer than its set-point is on its way back: TSTOP ends it (docs/safety.md).
    let moves = moves && view.property(Property::DP)? <= end;
    let torque = view.truth.torque_n_m;
    let carries = torque > LOADED * bt as f64 / UNITS * strength + RIPPLE_N_M && presses(view);
    let stands = view.truth.counts_per_s.abs() <= STILL;
    let loaded = moves && bt != 0 && way > UNDER_WAY && carries && stands && view.orders().next().is_none();
    let meaning = &mut joint.meaning;
    meaning.loaded_ms = if loaded { meaning.loaded_ms + 1 } else { 0 };
    joint.worst.note(Measure::LoadedMs, meaning.loaded_ms.into());
    let speed = view.property(Property::MV)?.min(view.property(Property::MCV)?).unsigned_abs() as u32;
    (meaning.loaded_ms > BREAKS_AWAY_MS + 1_000 * BREAKS_AWAY_COUNTS / speed.max(1)).then(|| {
        let units = torque / strength * UNITS;
        format!("carries {units:.0} for {} ms and does not break away; BT is {bt}", meaning.loaded_ms)
    })
}

/// Ticks that a motor has stood less than TSTOP when it reports a stall: a clock that is off.
const STALL_SLACK_MS: u64 = 15;

/// Counts by which a rotor that stalls springs to and fro.
const REST: i64 = 1;

/// Counts about its goal within which a motor with wild gains hunts.
const HUNT: i64 = 20;

/// And reversals within the ticks of the past by which it goes to and fro.
const REVERSALS: usize = 4;

/// Ticks of the past: of a longer TSTOP only so much is checked.
const CELLS_MS: usize = 400;

/// Time within which a motor that reports a breakaway has carried half of BT, ms.
const LOAD_MS: u64 = 60;

/// How often a rotor turns round.
fn reversals(cells: &VecDeque<i64>) -> usize {
    let steps: Vec<i64> = cells.iter().zip(cells.iter().skip(1)).map(|(a, b)| (a - b).signum()).collect();
    let moves: Vec<i64> = steps.into_iter().filter(|&step| step != 0).collect();
    moves.windows(2).filter(|pair| pair[0] != pair[1]).count()
}

pub fn end(joint: &mut Joint, view: &View) -> Option<String> {
    let strength = strength(&joint.plant);
    let bt = view.property(Property::BT)?;
    let carried = 0.5 * bt as f64 / UNITS * strength;
    let meaning = &mut joint.meaning;
    if view.driven() || meaning.was_driven {
        meaning.cells.push_front(view.cell);
        meaning.cells.truncate(CELLS_MS);
    }
    meaning.was_driven = view.driven();
    let loaded = view.truth.torque_n_m.abs() > carried && view.driven();
    meaning.since_load_ms = if loaded { 0 } else { meaning.since_load_ms + 1 };
    let end = view.property(Property::END)?;
    let before = std::mem::replace(&mut meaning.end, end);
    if end == before || view.orders().next().is_some() {
        return None;
    }
    match EndCode::of(end)? {
        EndCode::Stalled => {
            let tstop = view.property(Property::TSTOP)?.unsigned_abs();
            let checked = tstop.min(CELLS_MS as u64);
            let least = checked - checked / 20;
            // One that hunts about its goal, or to and fro about a set-point that creeps, gives up 2 s after TSTOP (docs/hand.md). HI has a goal that
            // E does not say.
            let goal = match meaning.errand {
                Errand::Homes => view.cell,
                _ => view.property(Property::E)? - (view.property(Property::P)? - view.cell),
            };
            let is_about = |goal: i64| meaning.cells.iter().all(|cell| (cell - goal).abs() <= HUNT);
            let hunts = is_about(goal) || is_about(view.cell) && reversals(&meaning.cells) >= REVERSALS;
            if meaning.cells.len() == CELLS_MS && hunts {
                return None;
            }
            let stood =
                meaning.cells.iter().take_while(|cell| (*cell - view.cell).abs() <= REST).count() as u64;
            (stood + STALL_SLACK_MS < least)
                .then(|| format!("says stalled, but has stood driven for {stood} ms only; TSTOP is {tstop}"))
        }
        EndCode::Breakaway => (meaning.since_load_ms > LOAD_MS).then(|| {
            format!("says that it broke away, but has not carried {bt}/2 for {} ms", meaning.since_load_ms)
        }),
        _ => None,
    }
}

/// Stated errors of measured values: the thermistor lags its housing, and the bus is read once a tick.
pub(super) const BUS_V: f64 = 1.0;
pub(super) const THERM_C: f64 = 3.0;

/// SG by the torque of the joint (docs/simulator.md): its reading without load, a N·m, and the steps by which it may be off.
const SG_ZERO: f64 = 128.0;
const SG_PER_N_M: f64 = 4.0;
const SG_STEPS: f64 = 4.0;

/// Ticks for which a value must be wrong: the erase of a page stops a board for 40 ms.
const WRONG_MS: u32 = 60;

/// The way by VEL in a window of time, ms, against the rotor's: an impact at full speed is seen when the next count is overdue.
const WAY_MS: u64 = 100;
pub(super) const WAY_COUNTS: f64 = 25.0;

/// T of a motor that stands and presses, after a time in which its current has settled, ms, is the voltage across its winding (decision 0005), in
/// units, once VEL is 0 as well: until then its EMF adds to it. The rounding of the duty is 0.6 of them, and in 98 % of the ticks of 100 seeds no more
/// is off. As a torque it is off by a share: R, Ke and halls are off by 30 % and 10°, a hot winding has 40 % more resistance, and six steps give less
/// between their middles.
const STEADY_MS: u64 = 30;
const PRESSES: f64 = 100.0;
pub(super) const WIRED: i64 = 4;
const VOLTAGE_UNITS: f64 = 6.0;
const UNIT_V: f64 = 24.0 / 1024.0;
const TORQUE_SHARE: f64 = 0.9;

impl Reported {
    /// The way by VEL less that of the rotor, counts, at the end of each window.
    fn way_off(&mut self, view: &View, vel: f64) -> Option<f64> {
        let (since_ms, sum, from) = self
            .way
            .filter(|(since_ms, ..)| view.ms <= since_ms + WAY_MS)
            .unwrap_or((view.ms, 0.0, view.truth.counts));
        let sum = if view.ms > since_ms { sum + vel * 1e-3 } else { sum };
        let is_whole = view.ms == since_ms + WAY_MS;
        self.way = Some(if is_whole { (view.ms, 0.0, view.truth.counts) } else { (since_ms, sum, from) });
        is_whole.then_some((sum - (view.truth.counts - from)).abs())
    }

    /// By how much T is off: as a voltage, units, and as a share of the true torque.
    fn torque_off(&mut self, plant: &PlantParams, view: &View, t: f64) -> Option<(f64, f64)> {
        // While FIND learns the wiring nobody knows the sign of a torque.
        let presses = presses(view)
            && view.property(Property::FIND) == Some(WIRED)
            && view.truth.counts_per_s.abs() <= STILL
            && t.abs() >= PRESSES;
        self.steady_ms = if presses && view.orders().next().is_none() { self.steady_ms + 1 } else { 0 };
        let share = view.truth.torque_n_m / strength(plant) * UNITS / t - 1.0;
        let amps = view.truth.phase_a.iter().fold(0.0, |most, a| a.abs().max(most));
        let volts = amps * plant.pair_ohm(view.truth.winding_c);
        let units = if view.property(Property::VEL) == Some(0) { volts / UNIT_V - t.abs() } else { 0.0 };
        (self.steady_ms > STEADY_MS).then(|| (units.abs(), share.abs()))
    }
}

pub fn values(joint: &mut Joint, view: &View) -> Option<String> {
    let value = |property| view.property(property).map(|value| value as f64);
    let (therm, vbus) = (value(Property::THERM)? / 10.0, value(Property::VBUS)? / 10.0);
    let sg = value(Property::SG)?;
    let joint_n_m = -view.truth.load_n_m * joint.plant.gear_ratio;
    let strain = (SG_ZERO + SG_PER_N_M * joint_n_m).clamp(0.0, 255.0);
    let (vel, t, released) = (value(Property::VEL)?, value(Property::T)?, value(Property::B)? != 0.0);
    let (c, v) = ((therm - view.truth.housing_c).abs(), (vbus - view.volts).abs());
    let reported = &mut joint.meaning.reported;
    let (way, torque) = (reported.way_off(view, vel), reported.torque_off(&joint.plant, view, t));
    joint.worst.note(Measure::Way, way.unwrap_or(0.0));
    if let Some(way) = way.filter(|&way| way > WAY_COUNTS) {
        return Some(format!("the way by VEL is {way:.1} counts off in {WAY_MS} ms"));
    }
    let wrong = if c > THERM_C {
        Some(format!("THERM says {therm} C, the housing has {:.1}", view.truth.housing_c))
    } else if v > BUS_V {
        Some(format!("VBUS says {vbus} V, the bus has {:.1}", view.volts))
    } else if (sg - strain).abs() > SG_STEPS {
        Some(format!("SG says {sg}, {joint_n_m:.2} N·m at the joint are {strain:.0}"))
    } else if joint.kind == MotorKind::Spread && released != view.brake_released {
        Some(format!("B says {released}, the brake is told to release: {}", view.brake_released))
    } else if let Some((units, share)) =
        torque.filter(|&(units, share)| units > VOLTAGE_UNITS || share > TORQUE_SHARE)
    {
        Some(format!(
            "T says {t}, and is off by {units:.0} units of voltage and {:.0} % of the torque",
            100.0 * share
        ))
    } else {
        joint.worst.note(Measure::Therm, c);
        joint.worst.note(Measure::Bus, v);
        None
    };
    let reported = &mut joint.meaning.reported;
    reported.wrong_ms = if wrong.is_some() { reported.wrong_ms + 1 } else { 0 };
    wrong.filter(|_| joint.meaning.reported.wrong_ms > WRONG_MS)
}
