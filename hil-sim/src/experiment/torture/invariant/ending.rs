//! How motions end.

use servo_core::mode::Mode;
use servo_core::{EndReason, Event};
use tater_fw::events::BoardEvent;
use tater_wire::Property;

use super::joint::{Ending, Joint, Orderer, View};
use crate::experiment::torture::kinds::{FaultKind, Kinds};

/// Fastest rotor that may be called arrived, counts/s: the fastest of 32,400 moves had 77.7 (tests/arrival.rs).
const ARRIVED_SPEED: f64 = 100.0;

/// The same of one that wild gains shake about its end: in two cells, with an error of 10° at each end, for the servo's 250 ms. The servo takes
/// up to 130 counts/s there for a rest at a boundary (servo-core's guard/arrival.rs), which halls cannot tell from it.
const SHAKEN_SPEED: f64 = 130.0;
const SHAKEN_COUNTS: f64 = 2.4;
const SHAKEN_MS: u64 = 240;

/// From E to the rotor beyond MPE, counts: half a cell at each end, and the placement of the halls.
const CELL: f64 = 1.5;

/// Time for what neither profile nor stall explains, ms: the brake, and an arrival that waits for TSTOP and 2 s.
const OWN_MS: f64 = 4_000.0;

/// How much longer than its profile a move may take that nothing hinders, and with a supply or a clock that is off.
const LATE: f64 = 2.0;

/// Orders that may begin or end a motion.
fn may_begin(property: Property) -> bool {
    matches!(
        property,
        Property::MODE
            | Property::CMD
            | Property::M
            | Property::E
            | Property::V
            | Property::T
            | Property::FIND
            | Property::STAT
            | Property::LOAD
            | Property::DEF
            | Property::WIRING
    )
}

pub fn host(joint: &mut Joint, view: &View) -> Option<String> {
    let (node, (tater, sample)) = (view.node?, view.application()?);
    for event in view.events {
        let Ending { own, asked, .. } = &mut joint.ending;
        match event {
            // The mode that HI has already is no order to end it.
            BoardEvent::Order { property: Property::MODE, .. } => *asked = true,
            BoardEvent::Order { property: Property::CMD | Property::FIND, .. } => {
                (*own, *asked) = (true, false)
            }
            BoardEvent::Mode(_) if *asked => (*own, *asked) = (false, false),
            _ => {}
        }
    }
    let watched = matches!(sample.status.mode, Mode::Torque | Mode::Velocity) && !joint.ending.own;
    let limit_ms = u64::try_from(tater.property(Property::HOSTMS)?).ok().filter(|&ms| ms > 0)?;
    let silent_ms = (1_000 * view.ms).saturating_sub(node.heard_us()) / 1_000;
    // Two ticks, and a clock that is off.
    (watched && view.driven() && silent_ms > limit_ms + limit_ms / 40 + 2)
        .then(|| format!("driven in {:?} {silent_ms} ms after the last frame", sample.status.mode))
}

pub fn velocity(_: &mut Joint, view: &View) -> Option<String> {
    let ended = view.events.iter().any(|event| matches!(event, BoardEvent::Motor(Event::Ended { .. })));
    // A frame since then may have set it anew.
    if !ended || view.node?.heard_us() + 1_500 > 1_000 * view.ms {
        return None;
    }
    let set = view.application()?.0.property(Property::VSET)?;
    (set != 0).then(|| format!("a motion has ended, and V is {set}"))
}

pub fn once(joint: &mut Joint, view: &View) -> Option<String> {
    let ending = &mut joint.ending;
    if view.sample.is_none() {
        (ending.ends, ending.holds) = (0, false);
        return None;
    }
    let mut wrong = None;
    for (at, event) in view.events.iter().enumerate() {
        match event {
            BoardEvent::Order { property, .. } if may_begin(*property) => {
                (ending.ends, ending.holds) = (0, false)
            }
            BoardEvent::Motor(Event::Ended { reason, mode }) => {
                // The order that replaces a motion, and the refusal of one, are recorded in the same tick as the end that they report.
                let replaced = *reason == EndReason::Aborted
                    && view.events.iter().any(
                        |event| matches!(event, BoardEvent::Order { property, .. } if may_begin(*property)),
                    );
                let refused =
                    view.events[at..].iter().any(|event| matches!(event, BoardEvent::Refused { .. }));
                // A hold is a motion of its own, which a fault or a stall may end.
                let held = std::mem::replace(&mut ending.holds, *mode != Mode::Idle);
                if !replaced && !refused && !held {
                    ending.ends += 1;
                    if ending.ends > 1 {
                        wrong = Some(format!("a second end, {reason:?}, of one motion"));
                    }
                }
            }
            _ => {}
        }
    }
    wrong
}

/// Longest time of a motion at this tick's state, ms.
fn longest_ms(view: &View) -> Option<f64> {
    let (tater, sample) = view.application()?;
    let config = tater.config();
    if config.tstop == 0 || config.accel == 0 {
        return None;
    }
    let here: f64 = sample.status.position.0.to_num();
    let end = tater.property(Property::E)? as f64;
    let speed = f64::from(config.mv.min(config.mcv).min(config.mov)).max(16.0);
    let accel = (f64::from(config.accel) / 1024.0).powi(2) * 1e6;
    let distance = (end - here).abs();
    let profile_ms = 1e3 * (distance / speed + 2.0 * speed.min((distance * accel).sqrt()) / accel);
    Some(LATE * profile_ms + f64::from(config.tstop) + OWN_MS)
}

pub fn in_time(joint: &mut Joint, view: &View) -> Option<String> {
    let ending = &mut joint.ending;
    let status = view.sample.as_ref().map(|sample| sample.status);
    let moves = status.is_some_and(|status| status.mode == Mode::Trapezoidal && status.end.is_none());
    let is_homing = status.is_some_and(|status| !status.homed);
    if !moves || is_homing {
        (ending.begun_ms, ending.hindered) = (None, false);
        return None;
    }
    let hinders = Kinds::of(&[
        FaultKind::Push,
        FaultKind::Jam,
        FaultKind::BrakeStuckOn,
        FaultKind::SupplySag,
        FaultKind::AdcRail,
        FaultKind::AdcNoise,
        FaultKind::AdcDrift,
    ]);
    // Hindered, it may make one count each TSTOP: only the unhindered ones have a useful bound.
    ending.hindered |= view.faults.meets(hinders) || view.truth.load_n_m != 0.0;
    let ordered = view.events.iter().any(|event| matches!(event, BoardEvent::Order { .. }));
    if ending.begun_ms.is_none() || ordered {
        ending.begun_ms = Some(view.ms);
        ending.within_ms = longest_ms(view).unwrap_or(f64::INFINITY);
    }
    let taken_ms = (view.ms - ending.begun_ms.unwrap_or(view.ms)) as f64;
    (taken_ms > ending.within_ms && !ending.hindered)
        .then(|| format!("a move has taken {taken_ms} ms, {:.0} are enough", ending.within_ms))
}

/// How long the rotor has stayed within two cells.
fn shaken_ms(ending: &mut Ending, counts: f64) -> u64 {
    let (low, high) = (ending.stayed.0.min(counts), ending.stayed.1.max(counts));
    if high - low > SHAKEN_COUNTS {
        (ending.stayed, ending.stayed_ms) = ((counts, counts), 0);
    } else {
        (ending.stayed, ending.stayed_ms) = ((low, high), ending.stayed_ms + 1);
    }
    ending.stayed_ms
}

pub fn arrived(joint: &mut Joint, view: &View) -> Option<String> {
    // Of the tick before: with its bridge off a rotor may spring back from a stop at once.
    let speed = std::mem::replace(&mut joint.ending.speed, view.truth.counts_per_s.abs());
    let shaken_ms = shaken_ms(&mut joint.ending, view.truth.counts);
    let (tater, sample) = view.application()?;
    let arrived = |event: &BoardEvent| {
        matches!(event, BoardEvent::Motor(Event::Ended { reason: EndReason::Arrived, .. }))
    };
    if !view.events.iter().any(arrived) {
        return None;
    }
    let most = if shaken_ms >= SHAKEN_MS { SHAKEN_SPEED } else { ARRIVED_SPEED };
    if speed > most {
        return Some(format!("arrived at {speed:.0} counts/s"));
    }
    // An order in the same tick may have named another end, or another place.
    let ordered = view.events.iter().any(|event| matches!(event, BoardEvent::Order { .. }));
    let homed = view.events.iter().any(|event| matches!(event, BoardEvent::Motor(Event::Homed)));
    let find = tater.property(Property::END).is_none_or(|end| end != 1);
    if ordered || homed || find || !sample.status.homed {
        return None;
    }
    let end = tater.property(Property::E)? as f64;
    let off = (sample.estimated_counts() - end).abs();
    let most = f64::from(tater.config().mpe) + CELL;
    (off > most).then(|| format!("arrived {off:.1} counts from E {end}, MPE is {}", tater.config().mpe))
}

pub fn hold(joint: &mut Joint, view: &View) -> Option<String> {
    let (tater, sample) = view.application()?;
    let before = std::mem::replace(&mut joint.ending.mode, sample.status.mode);
    for event in view.events {
        if let BoardEvent::Order { property, value } = event {
            joint.ending.orderer = joint.ending.orderer.after(*property, *value, before);
        }
    }
    let orderer = joint.ending.orderer;
    let hold = tater.config().hold;
    if view.events.iter().any(|event| matches!(event, BoardEvent::Order { .. } | BoardEvent::Refused { .. }))
    {
        // It may have changed HOLD, or ended or begun a motion itself.
        return None;
    }
    view.events.iter().find_map(|event| {
        let BoardEvent::Motor(Event::Ended { reason, mode }) = event else { return None };
        if orderer == Orderer::Unknown {
            return None;
        }
        let held = hold || orderer == Orderer::Mode && *reason != EndReason::Aborted;
        let idles = !held || *reason == EndReason::Fault;
        // FIND idles always.
        let good =
            (*mode == Mode::Idle) == idles || *mode == Mode::Idle && !view.sample.as_ref()?.status.homed;
        (!good).then(|| {
            format!("HOLD is {hold}, ordered by {orderer:?}, but the mode after {reason:?} is {mode:?}")
        })
    })
}
