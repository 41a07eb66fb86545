//! The host's shadow of the hand: what each setting of a board, and each parameter that GOD keeps, was before a command, and so must be after it. A command that moves or asks
//! changes no setting for longer than it takes: the BT that X takes away, the velocities of motors that arrive together and RealTime's KPV are given
//! back (docs/hand.md, *Motions*), after ^C as well.

use std::collections::BTreeMap;
use std::fmt::Debug;

use god::memory::Parameters;
use tater_wire::Property;
use tater_wire::property::{Access, ROWS, Stored};

use super::case::MOTORS;

/// Values of properties.
pub type Values = BTreeMap<Property, i64>;

/// The settings of a board: what SAVE stores and nothing but an order changes. P moves with its motor.
pub fn settings() -> impl Iterator<Item = Property> {
    ROWS.iter().map(|row| row.property).filter(|&property| is_setting(property))
}

/// Whether a property is one of [`settings`].
pub(crate) fn is_setting(property: Property) -> bool {
    let row = property.row();
    row.stored == Stored::Yes && row.access == Access::ReadWrite && property != Property::P
}

/// A board as its host may read it: how often it has started, and its settings.
pub type Seen = Option<(u32, Values)>;

/// What a host may read at a prompt: the boards, and the parameters that GOD keeps.
pub type Settings = ([Seen; MOTORS], Parameters);

/// What the host knows of the hand.
#[derive(Debug, Default)]
pub struct Shadow {
    boards: [Seen; MOTORS],
    /// None unless the host is in step.
    god: Option<Parameters>,
    /// The host knows to which command a prompt belongs.
    in_step: bool,
    /// Orders may have been lost since the last comparison: what a board did not confirm comes with the next motion.
    doubtful: bool,
}

impl Shadow {
    /// The host has begun, or has brought a prompt by ^C: what it sends next has the next prompt.
    pub(crate) fn fall_in_step(&mut self) {
        self.in_step = true;
    }

    /// The host has sent what may have any number of prompts and may set anything.
    pub(crate) fn lose_step(&mut self) {
        self.in_step = false;
        self.forget();
    }

    /// Settings may have been ordered.
    pub fn forget(&mut self) {
        self.boards = Default::default();
        self.god = None;
    }

    /// Orders may be lost.
    pub fn doubt(&mut self) {
        self.doubtful = true;
    }

    /// At the prompt before a command: takes what it does not know.
    pub fn look(&mut self, (boards, god): Settings) {
        self.drop_restarted(&boards);
        if !self.in_step {
            return;
        }
        // Nothing is lost between GOD and its parameters.
        self.god.get_or_insert(god);
        if self.doubtful {
            return;
        }
        for (known, now) in self.boards.iter_mut().zip(boards) {
            if known.is_none() {
                *known = now;
            }
        }
    }

    /// At the prompt after a command that leaves the settings alone. After one that `restored` what earlier ones may have left, no doubt is left
    /// either. Returns the first motor that differs, from 1, or 0 for the hand, and how.
    pub fn compare(&mut self, (now, god): Settings, restored: bool) -> Option<(usize, String)> {
        self.drop_restarted(&now);
        if !self.in_step {
            return None;
        }
        let known = self.god.replace(god);
        if let Some(found) = known.and_then(|known| changed(&known, &god)) {
            return Some(found);
        }
        if self.doubtful && !restored {
            return None;
        }
        self.doubtful = false;
        let differs = |(motor, (known, now)): (usize, (&Seen, &Seen))| {
            let ((_, known), (_, now)) = (known.as_ref()?, now.as_ref()?);
            let (property, was) = known.iter().find(|(property, value)| now.get(property) != Some(value))?;
            let found = now.get(property).copied().unwrap_or_default();
            Some((motor + 1, format!("{} was {was} before the command, and is {found}", property.row().name)))
        };
        let found = self.boards.iter().zip(&now).enumerate().find_map(differs);
        self.boards = now;
        found
    }

    /// A board that has started anew has its stored values, and what a motion had overridden comes back with the next one.
    fn drop_restarted(&mut self, now: &[Seen; MOTORS]) {
        for (known, now) in self.boards.iter_mut().zip(now) {
            let starts = |seen: &Seen| seen.as_ref().map(|(starts, _)| *starts);
            if known.is_some() && starts(known) != starts(now) {
                *known = None;
                self.doubtful = true;
            }
        }
    }
}

/// The first of GOD's parameters that differ.
fn changed(known: &Parameters, now: &Parameters) -> Option<(usize, String)> {
    let text = |known: &dyn Debug, now: &dyn Debug| {
        format!("GOD's parameters were {known:?} before the command, and are {now:?}")
    };
    let mut motors = known.motors.iter().zip(&now.motors).zip(1..);
    if let Some(((known, now), motor)) = motors.find(|((known, now), _)| known != now) {
        return Some((motor, text(known, now)));
    }
    (known.hand != now.hand).then(|| (0, text(&known.hand, &now.hand)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hand(bt: i64) -> Settings {
        let board = Some((1, Values::from([(Property::BT, bt), (Property::MV, 1000)])));
        (std::array::from_fn(|_| board.clone()), Parameters::default())
    }

    fn known() -> Shadow {
        let mut shadow = Shadow::default();
        shadow.fall_in_step();
        shadow.look(hand(400));
        shadow
    }

    #[test]
    fn setting_that_is_not_given_back_is_named() {
        let mut now = hand(400);
        assert_eq!(known().compare(now.clone(), false), None);
        now.0[2] = Some((1, Values::from([(Property::BT, 0), (Property::MV, 1000)])));
        let found = known().compare(now, false);
        assert_eq!(found, Some((3, "BT was 400 before the command, and is 0".to_owned())));
    }

    #[test]
    fn parameter_of_god_that_changes_is_named_while_orders_may_be_lost_too() {
        let mut now = hand(400);
        now.1.hand.lft = !now.1.hand.lft;
        let mut shadow = known();
        shadow.doubt();
        assert!(
            shadow
                .compare(now.clone(), false)
                .is_some_and(|(motor, found)| motor == 0 && found.contains("lft"))
        );
        now.1.motors[4].as_set[0] += 1;
        assert_eq!(shadow.compare(now.clone(), false).map(|(motor, _)| motor), Some(5));
        assert_eq!(shadow.compare(now, false), None, "one defect is one failure");
    }

    #[test]
    fn ordered_settings_restarts_and_unknown_prompts_are_not_compared() {
        let compared = |prepare: fn(&mut Shadow), starts: u32| {
            let mut shadow = known();
            prepare(&mut shadow);
            let mut now = hand(0);
            now.0.iter_mut().flatten().for_each(|seen| seen.0 = starts);
            shadow.compare(now, false)
        };
        assert!(compared(|_| {}, 1).is_some());
        assert_eq!(compared(|_| {}, 2), None);
        assert_eq!(compared(Shadow::forget, 1), None);
        assert_eq!(compared(Shadow::lose_step, 1), None);
        assert_eq!(compared(Shadow::doubt, 1), None);
    }

    #[test]
    fn doubt_lasts_until_a_motion_has_restored_everything() {
        let mut shadow = known();
        shadow.doubt();
        assert_eq!(shadow.compare(hand(0), false), None);
        assert!(shadow.compare(hand(0), true).is_some());
        // What is found is the new state: one defect is one failure.
        assert_eq!(shadow.compare(hand(0), false), None);
    }
}
