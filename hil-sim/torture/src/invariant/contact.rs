//! What stops, objects and other fingers feel, judged by the plant's truth, the wire and the documents alone: nothing of servo-core is named here
//! (tests/fences/judge.rs).

use tater_wire::{EndCode, ModeCode, Property};

use super::joint::{Contact, Errand, Joint, Seen, View};
use super::measure::Measure;
use hil_world::plant::PlantParams;
use hil_world::rig::Bridge;

/// Torque units a N·m (decision 0003).
pub(super) const UNITS: f64 = 1575.0;

/// A joint's friction, N·m (decision 0003): a motor that stands with more presses. A third more for plants that have more of it.
const FRICTION_N_M: f64 = 0.04 * 4.0 / 3.0;

/// Torque of a contact that holds a joint, N·m at the motor.
const TOUCH_N_M: f64 = 0.005;

/// A rotor that has stopped makes no count.
pub(super) const STILL: f64 = 1.0;

/// A torque above MT (docs/safety.md): from a quarter of it, for so long, ms, and with so much beyond MT, mN·m·s, for motors whose R, Ke and inertia
/// are 30 % off and halls 10°. tests/contact/torque.rs reaches 7.9 and 1.68 with halls in their places; 3,000 spreads with misplaced halls, 8.2; a spread
/// with 30 % less resistance and 29 % more Ke at full speed, 2.0.
pub(super) const ABOVE: f64 = 1.25;
pub(super) const ABOVE_MS: u32 = 10;
pub(super) const ABOVE_M_N_M_S: f64 = 3.0;

/// The same of an object, another finger or a person's: it slows a rotor down, and throws a spread back, for longer than halls show.
/// tests/contact/torque.rs reaches 41 and 4.9; a spread with 25 % less resistance and 24 % more Ke that turns its fingers about a bar, 80 and 6.3
/// (torture seed 1764303315).
pub(super) const ABOVE_SOFT_MS: u32 = 100;
pub(super) const ABOVE_SOFT_M_N_M_S: f64 = 7.0;

/// What cogging, rounding and the ripple of the current add to a torque, N·m.
pub(super) const RIPPLE_N_M: f64 = 0.012;

/// Time without a contact, ms, after which the next one is another impact.
const APART_MS: u32 = 5;

/// Ticks over which MT may have been higher.
const MEMORY_MS: u64 = 40;

/// HI stalls after this time at least (decision 0009), ms.
const HOMING_TSTOP: u64 = 250;

/// A move waits where its set-point rests for TSTOP and this time, ms (decision 0049).
const WAIT_MS: u64 = 2_000;

/// Counts from E within which a set-point may rest less than one ahead of P: a count, and half a cell at each end.
const NEAR: i64 = 2;

/// Acceleration of a set-point, counts/ms²: it follows what the motor can do now (decision 0064), which may be less than ACCEL. A motor that
/// stands at full torque is taken for one with a third of the manual's ACCEL.
const WEAK: f64 = 500e-6;

/// Ticks beyond TSTOP: the count that a set-point needs to be ahead (10), and the torque of HI that turns round slowly (decision 0053).
pub(super) const STALL_SLACK_MS: u64 = 40;

/// A motor that stands and presses on something, by its true torque and what its board says on the wire.
pub struct Pressing {
    mode: ModeCode,
    end: Option<EndCode>,
    tstop: i64,
    /// V of a host, counts/s.
    v: i64,
}

/// A motor that presses longer than TSTOP by right.
pub struct Right {
    /// Which one.
    pub who: &'static str,
    /// Why, and where that is said.
    pub why: &'static str,
    has: fn(&Pressing) -> bool,
}

/// Every such right.
pub(crate) const MAY_PRESS: [Right; 4] = [
    Right {
        who: "any, with TSTOP 0",
        why: "its host wants no end: manual 5.3.4",
        has: |pressing| pressing.tstop == 0,
    },
    Right {
        who: "a hold",
        why: "it carries what the motion has met: manual 5.5",
        has: |pressing| pressing.mode == ModeCode::Pid,
    },
    Right {
        who: "TC or TO after its stall, with HOLD 1",
        why: "it presses on: manual 5.5; decision 0031",
        has: |pressing| pressing.mode == ModeCode::Velocity && pressing.end == Some(EndCode::Stalled),
    },
    Right {
        who: "mode 4 below eight counts a TSTOP",
        why: "a free joint may stick for as long: decision 0077",
        has: |pressing| {
            pressing.mode == ModeCode::Velocity
                && pressing.v != 0
                && pressing.v.abs() * pressing.tstop < 8_000
        },
    },
];

/// A motor's torque for that of the nominal motor: by its Ke, and by its resistance where that lets more than the nominal current flow. Of a
/// motor with more resistance the board knows no better than the current that MT means.
pub(super) fn strength(plant: &PlantParams) -> f64 {
    let nominal = PlantParams::for_motor(tater_wire::MotorKind::Link);
    plant.ke_v_s / nominal.ke_v_s * (nominal.r_ohm / plant.r_ohm).max(1.0)
}

/// Whether a rotor is in one of its joint's stops.
fn at_stop(plant: &PlantParams, counts: f64) -> bool {
    counts <= plant.min_count - 0.5 || counts >= plant.max_count + 0.5
}

/// The contact that holds back what the motor's torque pushes.
pub(super) fn presses(view: &View) -> bool {
    let (torque, load) = (view.truth.torque_n_m, view.truth.load_n_m);
    view.driven() && torque * load < 0.0 && load.abs() > TOUCH_N_M
}

/// The torque limit that the documents state: MT, and towards the stop of HI no more than IHIT until the second contact, while it runs in mode 4. The way
/// to IOFF is a move under MT: with IOFF 0 a spread presses its stop with up to 350 units on it.
pub(super) fn limit(joint: &Joint, view: &View) -> Option<f64> {
    let (mt, ihit, ivel) =
        (view.property(Property::MT)?, view.property(Property::IHIT)?, view.property(Property::IVEL)?);
    let seeks = joint.meaning.errand == Errand::Homes
        && view.mode() == Some(ModeCode::Velocity)
        && view.truth.torque_n_m * ivel as f64 > 0.0;
    Some(if seeks { mt.min(ihit) } else { mt } as f64)
}

pub fn torque(joint: &mut Joint, view: &View) -> Option<String> {
    joint.follow(view);
    let Some(mt) = limit(joint, view) else {
        joint.contact = Contact::default();
        return None;
    };
    let contact = &mut joint.contact;
    if mt != contact.mt {
        contact.earlier = (
            contact.mt.max(if view.ms < contact.earlier.1 { contact.earlier.0 } else { 0.0 }),
            view.ms + MEMORY_MS,
        );
        contact.mt = mt;
    }
    let most = if view.ms < contact.earlier.1 { mt.max(contact.earlier.0) } else { mt };
    let own = most / UNITS * strength(&joint.plant);
    let torque = view.truth.torque_n_m.abs();
    if presses(view) {
        contact.apart_ms = 0;
        contact.is_soft |= !at_stop(&joint.plant, view.truth.counts);
        if torque > ABOVE * own + RIPPLE_N_M && !is_shorted(view) {
            contact.above_ms += 1;
            contact.above_m_n_m_s += torque - own;
        }
    } else {
        contact.apart_ms += 1;
        if contact.apart_ms > APART_MS {
            (contact.above_ms, contact.above_m_n_m_s, contact.is_soft) = (0, 0.0, false);
        }
    }
    let (ms, impulse, most_ms, most_impulse) = if contact.is_soft {
        (Measure::AboveSoftMs, Measure::AboveSoftImpulse, ABOVE_SOFT_MS, ABOVE_SOFT_M_N_M_S)
    } else {
        (Measure::AboveMs, Measure::AboveImpulse, ABOVE_MS, ABOVE_M_N_M_S)
    };
    joint.worst.note(ms, f64::from(contact.above_ms));
    joint.worst.note(impulse, contact.above_m_n_m_s);
    (contact.above_ms > most_ms || contact.above_m_n_m_s > most_impulse).then(|| {
        format!(
            "pressed with more than {most} of MT or IHIT for {} ms, by {:.1} mN·m·s; now with {:.0}",
            contact.above_ms,
            contact.above_m_n_m_s,
            torque * UNITS / strength(&joint.plant)
        )
    })
}

/// Whether duty 0 shorts the motor, which then brakes what turns it by nothing but its own EMF (docs/safety.md).
fn is_shorted(view: &View) -> bool {
    matches!(view.bridge, Bridge::On { duty, .. } if duty.0 == 0)
}

impl Contact {
    /// What ended the motion: END, but for an order that is refused where none is under way. That one sets END, and no more (decision 0036).
    fn follow_end(&mut self, view: &View) -> Option<()> {
        let told = EndCode::of(view.property(Property::END)?);
        let is_new = std::mem::replace(&mut self.told, told) != told;
        if is_new && (told.is_none() || !view.seen.contains(&Seen::Refused)) {
            self.end = told;
        }
        Some(())
    }

    fn let_go(&mut self) {
        (self.held_ms, self.tstop, self.waits_ms) = (0, 0, 0);
    }
}

/// Whether a move presses where its set-point may rest: less than two counts before E, beyond it, or with a goal that E does not say, which is that of
/// HI.
fn may_wait(view: &View, torque: f64) -> Option<bool> {
    let left = view.property(Property::E)? - view.property(Property::P)?;
    let ahead = if torque > 0.0 { left } else { -left };
    Some(ahead < NEAR || !view.is_homed())
}

/// Time in which a set-point at rest gets two counts ahead, ms: a = (ACCEL/1024)² counts/ms², at most what a weak motor can do.
fn creep_ms(accel: i64) -> u64 {
    let accel = accel as f64 / 1024.0;
    let accel = (accel * accel).min(WEAK);
    // With ACCEL 0 it never does.
    if accel == 0.0 { u64::from(u32::MAX) } else { (2.0 * NEAR as f64 / accel).sqrt() as u64 }
}

pub fn time(joint: &mut Joint, view: &View) -> Option<String> {
    let strength = strength(&joint.plant);
    let contact = &mut joint.contact;
    if !view.runs() {
        contact.let_go();
        return None;
    }
    let torque = view.truth.torque_n_m;
    contact.follow_end(view)?;
    let pressing = Pressing {
        mode: view.mode()?,
        end: contact.end,
        tstop: view.property(Property::TSTOP)?,
        v: view.property(Property::VSET)?,
    };
    // The cell, which the halls may place in the dent of a stop.
    let same = std::mem::replace(&mut contact.cell, view.cell) == view.cell;
    let stands = same && view.truth.counts_per_s.abs() <= STILL;
    let excused = MAY_PRESS.iter().any(|right| (right.has)(&pressing));
    if excused || !stands || !presses(view) || torque.abs() < FRICTION_N_M * strength {
        contact.let_go();
        return None;
    }
    let moves = pressing.mode == ModeCode::Trapezoidal;
    let waits = moves && may_wait(view, torque)?;
    // A new order of a move that waits is another move.
    if waits && view.orders().next().is_some() {
        contact.let_go();
    }
    contact.held_ms += 1;
    contact.tstop = contact.tstop.max(pressing.tstop.unsigned_abs()).max(HOMING_TSTOP);
    let waits_ms = match (moves, waits) {
        (true, true) => WAIT_MS,
        (true, false) => creep_ms(view.property(Property::ACCEL)?),
        (false, _) => 0,
    };
    contact.waits_ms = contact.waits_ms.max(waits_ms);
    // A clock that is off.
    let most_ms = contact.tstop + contact.tstop / 40 + contact.waits_ms;
    joint.worst.note(Measure::HeldMs, contact.held_ms as f64 - most_ms as f64);
    (contact.held_ms > most_ms + STALL_SLACK_MS).then(|| {
        format!("pressed for {} ms in mode {:?}; TSTOP is {}", contact.held_ms, pressing.mode, pressing.tstop)
    })
}
