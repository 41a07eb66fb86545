//! Whether what a board believes of its rotor is true.

use tater_wire::{Cmd, ModeCode, Property};

use super::contact::UNITS;
use super::excuse::{HOMED_ELSEWHERE, JAMMED_AGAIN, UNSEEN_COUNT};
use super::joint::{Joint, Seen, Trust, View};
use hil_world::plant::PlantParams;

/// Below this a rotor stands, counts/s: the count of a tick is that of its end.
const SLOW: f64 = 100.0;

/// Whole counts by which a known position may be off: the estimate is at the edge of its cell.
const MOST: i64 = 1;

/// Ticks for which a deviation must last: a glitch is resolved within them.
const LASTS: u32 = 50;

/// From the face of a stop and IOFF to the zero of HI, counts: the face lies half a count beyond the range; at the stop and at zero the rotor may stand
/// anywhere in its cell, and halls 10° off move a cell by half of it.
const MISPLACED: f64 = 0.5 + 2.0 * (0.5 + 0.5);

/// A third of a turn, and the cell in which the rotor started, counts.
const THIRD: f64 = 6.0 + 1.0;

/// The host has named the position anew, or HI has.
fn renames(seen: &Seen) -> bool {
    match *seen {
        Seen::Order { property: Property::CMD, value } => {
            matches!(Cmd::of(value), Some(Cmd::Load | Cmd::Def))
        }
        Seen::Order { property, .. } => {
            matches!(property, Property::P | Property::DEF | Property::LOAD | Property::WIRING)
        }
        Seen::Homed => true,
        _ => false,
    }
}

/// SAVE of P or of everything: what stores a position that the next start may trust.
fn saves_position(seen: &Seen) -> bool {
    match seen.order() {
        Some((Property::SAVE, value)) => value == -1 || value == Property::P as i64,
        Some((Property::CMD, value)) => Cmd::of(value) == Some(Cmd::Save),
        _ => false,
    }
}

impl Trust {
    /// The position less the truth; `None` while the rotor moves.
    fn found(view: &View) -> Option<i64> {
        let still = view.truth.counts_per_s.abs() <= SLOW;
        if still { Some(view.property(Property::P)? - view.cell) } else { None }
    }

    fn follow(&mut self, view: &View) {
        if !view.runs() {
            self.at_end = self.offset.or(self.at_end);
            self.offset = None;
            return;
        }
        let (starts, homed) = (view.starts(), view.is_homed());
        if starts != self.starts {
            self.starts = starts;
            self.restored = homed;
            self.offset = None;
        }
        if !homed {
            (self.offset, self.restored) = (None, false);
            return;
        }
        let before = self.offset;
        let renamed = view.seen.iter().rposition(renames);
        if renamed.is_some() && !self.restored {
            self.offset = Self::found(view);
            self.blind = UNSEEN_COUNT.is_active(view);
        }
        if let Some(saved) = view.seen.iter().rposition(saves_position) {
            self.at_save = if renamed > Some(saved) { before } else { self.offset };
        }
    }
}

/// How far a rotor that HI drives enters a stop, counts, where its worm holds it. The energies of IHIT and of the blow at IVEL add: friction takes the
/// work that IHIT does during the blow.
fn homing_dent(joint: &Joint, view: &View) -> Option<f64> {
    let pressed = joint.twist(view.property(Property::IHIT)? as f64 / UNITS);
    let speed = (view.property(Property::IVEL)?.unsigned_abs() as f64).min(joint.no_load(view.volts));
    Some(0.5 * joint.plant.backlash_counts + libm::hypot(pressed, joint.blow(speed)))
}

/// Follows IVEL and IHIT, which another host may change while HI runs.
fn follow_dent(joint: &mut Joint, view: &View) {
    let Some(dent) = view.orders().next().and_then(|_| homing_dent(joint, view)) else { return };
    joint.truth.dent = if begins_hi(view) { dent } else { joint.truth.dent.max(dent) };
}

/// Whether HI has named as zero what is IOFF from neither stop, and how.
fn misplaced(plant: &PlantParams, dent: f64, view: &View) -> Option<String> {
    if !view.seen.contains(&Seen::Homed) || view.orders().next().is_some() {
        return None;
    }
    let zero = view.truth.counts - view.property(Property::P)? as f64;
    let ioff = view.property(Property::IOFF)? as f64;
    let from = |stop: f64| (zero - stop - ioff).abs();
    let off = from(plant.min_count).min(from(plant.max_count));
    let most = MISPLACED + dent;
    (off > most).then(|| {
        format!("HI names a place as zero that is {off:.1} counts from IOFF of a stop, {most:.1} at most")
    })
}

/// The host has begun HI.
fn begins_hi(view: &View) -> bool {
    view.orders().any(|order| order == (Property::CMD, Cmd::Hi.into()))
}

impl Trust {
    /// Whether a second jam has met the same HI. One that lasts since before counts.
    fn is_jammed_again(&mut self, view: &View) -> bool {
        let begins = begins_hi(view);
        let before = self.jammed && !begins;
        self.jammed = JAMMED_AGAIN.is_active(view);
        self.jams = if begins { 0 } else { self.jams } + u32::from(self.jammed && !before);
        self.jams > 1
    }
}

pub fn position(joint: &mut Joint, view: &View) -> Option<String> {
    follow_dent(joint, view);
    let trust = &mut joint.truth;
    trust.follow(view);
    // A jam is found out: HI leaves the place where it has stopped, and returns to it.
    trust.hindered |= HOMED_ELSEWHERE.is_recent(view) || trust.is_jammed_again(view);
    if !trust.hindered
        && let Some(found) = misplaced(&joint.plant, trust.dent, view)
    {
        return Some(found);
    }
    if trust.restored || !view.is_homed() {
        trust.off_ms = 0;
        return None;
    }
    let found = Trust::found(view)?;
    if trust.offset.is_none() {
        trust.blind = UNSEEN_COUNT.is_active(view);
    }
    let offset = *trust.offset.get_or_insert(found);
    trust.off_ms = if (found - offset).abs() > MOST + i64::from(trust.blind) { trust.off_ms + 1 } else { 0 };
    let lasts = if UNSEEN_COUNT.is_recent(view) { 20 * LASTS } else { LASTS };
    (trust.off_ms > lasts).then(|| {
        let at = view.truth.counts;
        format!("the position is known, but {} counts from the rotor at {at:.2}", found - offset)
    })
}

pub fn trust(joint: &mut Joint, view: &View) -> Option<String> {
    let trust = &mut joint.truth;
    if !trust.restored || !view.is_homed() {
        return None;
    }
    let found = Trust::found(view)?;
    let known: Vec<i64> = [trust.at_save, trust.at_end].into_iter().flatten().collect();
    trust.restored = false;
    trust.offset = Some(found);
    let right = known.is_empty() || known.iter().any(|offset| (found - offset).abs() <= MOST);
    (!right).then(|| format!("a start trusts a position that is {found} from the rotor; it was {known:?}"))
}

pub fn wrong_way(joint: &mut Joint, view: &View) -> Option<String> {
    let trust = &mut joint.truth;
    let torque = view.property(Property::T)?;
    let (counts, speed) = (view.truth.counts, view.truth.counts_per_s);
    if !view.driven() || torque == 0 || view.mode() == Some(ModeCode::Idle) || view.truth.load_n_m != 0.0 {
        trust.began = None;
        return None;
    }
    let closing = torque > 0;
    let against = if closing { -speed } else { speed };
    // Coasting against a torque that brakes it, a rotor slows down; only one that gets faster runs the wrong way. Its drive begins at rest.
    match trust.began {
        Some((from, was)) if was == closing => {
            let way = if closing { from - counts } else { counts - from };
            (way > THIRD && against > 0.0)
                .then(|| format!("{way:.1} counts against torque {torque}, at {speed:.0} counts/s"))
        }
        _ if speed.abs() < 1.0 => {
            trust.began = Some((counts, closing));
            None
        }
        _ => {
            trust.began = None;
            None
        }
    }
}
