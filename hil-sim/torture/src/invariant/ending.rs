//! How motions end.

use tater_wire::{EndCode, ModeCode, Property};

use super::excuse::HINDERED;
use super::joint::{Ending, Joint, Orderer, Seen, View};

/// Fastest rotor that may be called arrived, counts/s: the fastest of 32,400 moves had 77.7 (tests/arrival.rs).
const ARRIVED_SPEED: f64 = 100.0;

/// The same of one that wild gains shake about its end: in two cells, with an error of 10° at each end, for the servo's 250 ms. The servo takes
/// up to 130 counts/s there for a rest at a boundary (servo-core's guard/arrival.rs), which halls cannot tell from it.
const SHAKEN_SPEED: f64 = 130.0;
const SHAKEN_COUNTS: f64 = 2.4;
const SHAKEN_MS: u64 = 240;

/// From E to P beyond MPE, counts: half a cell at each end, and the placement of the halls.
const CELL: i64 = 1;

/// Time for what neither profile nor stall explains, ms: the brake, and an arrival that waits for TSTOP and 2 s.
const OWN_MS: f64 = 4_000.0;

/// Time of the brake and of a rotor that coasts, ms.
const COAST_MS: f64 = 1_000.0;

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
    for seen in view.seen {
        let Ending { own, asked, .. } = &mut joint.ending;
        match seen {
            // The mode that HI has already is no order to end it.
            Seen::Order { property: Property::MODE, .. } => *asked = true,
            Seen::Order { property: Property::CMD | Property::FIND, .. } => (*own, *asked) = (true, false),
            Seen::Mode(_) if *asked => (*own, *asked) = (false, false),
            _ => {}
        }
    }
    let mode = view.mode()?;
    let watched = matches!(mode, ModeCode::Torque | ModeCode::Velocity) && !joint.ending.own;
    let limit_ms = u64::try_from(view.property(Property::HOSTMS)?).ok().filter(|&ms| ms > 0)?;
    let silent_ms = (1_000 * view.ms).saturating_sub(view.ground?.heard_us) / 1_000;
    // Two ticks, and a clock that is off.
    (watched && view.driven() && silent_ms > limit_ms + limit_ms / 40 + 2)
        .then(|| format!("driven in {mode:?} {silent_ms} ms after the last frame"))
}

pub fn velocity(_: &mut Joint, view: &View) -> Option<String> {
    let ended = view.seen.iter().any(|seen| matches!(seen, Seen::Ended { .. }));
    // A frame since then may have set it anew.
    if !ended || view.ground?.heard_us + 1_500 > 1_000 * view.ms {
        return None;
    }
    let set = view.property(Property::VSET)?;
    (set != 0).then(|| format!("a motion has ended, and V is {set}"))
}

pub fn once(joint: &mut Joint, view: &View) -> Option<String> {
    let ending = &mut joint.ending;
    if !view.runs() {
        (ending.ends, ending.holds) = (0, false);
        return None;
    }
    let mut wrong = None;
    for (at, seen) in view.seen.iter().enumerate() {
        match seen {
            Seen::Order { property, .. } if may_begin(*property) => (ending.ends, ending.holds) = (0, false),
            Seen::Ended { end, mode } => {
                // The order that replaces a motion, and the refusal of one, are recorded in the same tick as the end that they report.
                let replaced =
                    *end == EndCode::Aborted && view.orders().any(|(property, _)| may_begin(property));
                let refused = view.seen[at..].contains(&Seen::Refused);
                // A hold is a motion of its own, which a fault or a stall may end.
                let held = std::mem::replace(&mut ending.holds, *mode != ModeCode::Idle);
                if !replaced && !refused && !held {
                    ending.ends += 1;
                    if ending.ends > 1 {
                        wrong = Some(format!("a second end, {end:?}, of one motion"));
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
    let number = |property| view.property(property).map(|value| value as f64);
    let (tstop_ms, accel) = (number(Property::TSTOP)?, number(Property::ACCEL)?);
    if tstop_ms == 0.0 {
        return None;
    }
    if accel == 0.0 {
        // It moves no set-point, and ends as a stall (decision 0007): TSTOP after the brake and the last count of a rotor that coasts.
        return Some(tstop_ms + COAST_MS);
    }
    let (here, end) = (number(Property::P)?, number(Property::E)?);
    let speed = number(Property::MV)?.min(number(Property::MCV)?).min(number(Property::MOV)?).max(16.0);
    let accel = (accel / 1024.0) * (accel / 1024.0) * 1e6;
    let distance = (end - here).abs();
    let profile_ms = 1e3 * (distance / speed + 2.0 * speed.min((distance * accel).sqrt()) / accel);
    Some(LATE * profile_ms + tstop_ms + OWN_MS)
}

pub fn in_time(joint: &mut Joint, view: &View) -> Option<String> {
    let ending = &mut joint.ending;
    let moves = view.mode() == Some(ModeCode::Trapezoidal) && view.property(Property::END) == Some(0);
    if !moves || !view.is_homed() {
        (ending.begun_ms, ending.hindered) = (None, false);
        return None;
    }
    ending.hindered |= HINDERED.is_recent(view) || view.truth.load_n_m != 0.0;
    if ending.begun_ms.is_none() || view.orders().next().is_some() {
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
    if !view.seen.iter().any(|seen| matches!(seen, Seen::Ended { end: EndCode::Arrived, .. })) {
        return None;
    }
    let most = if shaken_ms >= SHAKEN_MS { SHAKEN_SPEED } else { ARRIVED_SPEED };
    if speed > most {
        return Some(format!("arrived at {speed:.0} counts/s"));
    }
    // An order in the same tick may have named another end, or another place.
    let ordered = view.orders().next().is_some();
    let homed = view.seen.contains(&Seen::Homed);
    let find = EndCode::of(view.property(Property::END)?) != Some(EndCode::Arrived);
    if ordered || homed || find || !view.is_homed() {
        return None;
    }
    let (end, mpe) = (view.property(Property::E)?, view.property(Property::MPE)?);
    let off = (view.property(Property::P)? - end).abs();
    (off > mpe + CELL).then(|| format!("arrived {off} counts from E {end}, MPE is {mpe}"))
}

pub fn hold(joint: &mut Joint, view: &View) -> Option<String> {
    let mode = view.mode()?;
    let before = joint.ending.mode.replace(mode);
    for (property, value) in view.orders() {
        joint.ending.orderer = joint.ending.orderer.after(property, value, before);
    }
    let orderer = joint.ending.orderer;
    if view.seen.iter().any(|seen| matches!(seen, Seen::Order { .. } | Seen::Refused)) {
        // It may have changed HOLD, or ended or begun a motion itself.
        return None;
    }
    if view.seen.iter().any(|seen| matches!(seen, Seen::Ended { .. })) {
        // The hold that follows may stall as well, and then HOLD says what follows.
        joint.ending.orderer = Orderer::Other;
    }
    view.seen.iter().find_map(|seen| {
        let Seen::Ended { end, mode } = seen else { return None };
        if orderer == Orderer::Unknown {
            return None;
        }
        let hold = view.property(Property::HOLD)?;
        let held = hold == 1 || orderer == Orderer::Mode && *end != EndCode::Aborted;
        let idles = !held || *end == EndCode::Fault;
        // FIND idles always.
        let good = (*mode == ModeCode::Idle) == idles || *mode == ModeCode::Idle && !view.is_homed();
        (!good).then(|| {
            format!("HOLD is {hold}, ordered by {orderer:?}, but the mode after {end:?} is {mode:?}")
        })
    })
}
