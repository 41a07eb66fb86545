//! What a SET of CMD does.

use super::storing::ALL;
use super::{Refused, Tater};
use crate::board::Board;
use servo_core::Command;
use tater_wire::{Cmd, Property};

impl<B: Board> Tater<B> {
    /// # Errors
    /// Why not; nothing has changed then.
    pub(super) fn cmd(&mut self, number: i64) -> Result<(), Refused> {
        match Cmd::of(number).ok_or(Refused::Range(Property::CMD))? {
            Cmd::Load => self.load(ALL),
            Cmd::Save => self.save(ALL),
            Cmd::Reset => {
                self.reset();
                Ok(())
            }
            Cmd::Def => self.factory(ALL),
            Cmd::Home => self.command(Command::Move(0)),
            // A fresh start: BD is of the time before it (manual 5.3.2 names only O).
            Cmd::Hi => self.command(Command::Home).and_then(|()| self.command(Command::ClearBreakaway)),
            Cmd::Ic => self.step_by(i32::from(self.kept.ds)),
            Cmd::Io => self.step_by(-i32::from(self.kept.ds)),
            Cmd::Tc => self.command(Command::TorqueControlled { closing: true }),
            Cmd::To => self.command(Command::TorqueControlled { closing: false }),
            Cmd::C => self.command(Command::Move(self.kept.ct)),
            Cmd::M => self.command(Command::Move(self.kept.dp)),
            Cmd::O => {
                self.command(Command::Move(self.kept.ot)).and_then(|()| self.command(Command::ClearBreakaway))
            }
            Cmd::T => self.command(Command::Terminate),
        }
    }

    /// IC and IO: so many counts from where the motor is (manual 5.2: "closes the motor the given number of counts"),
    /// during a move too.
    fn step_by(&mut self, counts: i32) -> Result<(), Refused> {
        let position = self.servo.telemetry().position.round();
        self.command(Command::Move(position.saturating_add(counts)))
    }
}
