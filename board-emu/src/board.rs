//! The board: the chip's pins at the motor, its sensors and the bus.

use hil_sim::bus::Station;
use hil_sim::rig::Rig;
use tater_wire::{Frame, Node};

use crate::image::Programs;
use crate::machine::Machine;
use crate::stop::Stop;

/// A board that executes its flash, and its motor.
pub struct Board {
    machine: Machine,
    rig: Rig,
    /// What ended the run, if anything did.
    problem: Option<Stop>,
}

impl Board {
    /// A board whose power is off: the monitor in its flash, everything else erased. `straps` is its node number; `seed` is
    /// that of what its RAM holds at first.
    #[must_use]
    pub fn new(rig: Rig, straps: Node, programs: &Programs, seed: u64) -> Self {
        let _ = (rig, straps, programs, seed);
        todo!()
    }

    /// The power comes on.
    pub fn power_on(&mut self) {}

    /// The power fails.
    pub fn power_off(&mut self) {}

    /// The chip and its core.
    #[must_use]
    pub const fn machine(&self) -> &Machine {
        &self.machine
    }

    /// The chip and its core.
    pub const fn machine_mut(&mut self) -> &mut Machine {
        &mut self.machine
    }

    /// The motor.
    #[must_use]
    pub const fn rig(&self) -> &Rig {
        &self.rig
    }

    /// The motor, to disturb it.
    pub const fn rig_mut(&mut self) -> &mut Rig {
        &mut self.rig
    }

    /// What ended the run: from then on the board stands still.
    #[must_use]
    pub const fn problem(&self) -> Option<&Stop> {
        self.problem.as_ref()
    }
}

impl Station for Board {
    fn now_us(&self) -> u64 {
        todo!()
    }

    fn advance(&mut self, _until_us: u64) {
        todo!()
    }

    fn next_us(&self) -> u64 {
        todo!()
    }

    fn busy_until_us(&self) -> u64 {
        0
    }

    fn receive(&mut self, _frame: &Frame) {
        todo!()
    }

    fn pending(&self) -> &[Frame] {
        todo!()
    }

    fn sent(&mut self, _frame: &Frame) {
        todo!()
    }
}
