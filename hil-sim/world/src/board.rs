//! The simulated hardware of one motor board: the rig in place of the pins, a flash, a CAN controller's mailboxes.
//! It implements [`tater_fw::Board`] and makes no decisions.

use boot::Chip;
use servo_core::motor::BoardFigures;
use servo_core::sense::commutation::Bridge;
use tater_fw::tater::heat::COLD;
use tater_fw::{Analog, Board};
use tater_wire::MotorKind;
use tater_wire::{Destination, FaultCode, Frame, Group, Node};

use crate::plant::{Heat, Model, ParamError, PlantParams, Start};
use crate::rig::flash::SimFlash;
use crate::rig::{Object, Rig, RigParams};

/// Transmit mailboxes of the CAN controller (bxCAN).
const MAILBOXES: usize = 3;

const GROUP_0_ONLY: (Node, [Option<Group>; 3]) = (Node::HOST, [None; 3]);

/// One board's hardware and its plant.
#[derive(Clone, Debug)]
pub struct SimBoard {
    rig: Rig,
    flash: SimFlash,
    straps: Node,
    reset_cause: Option<FaultCode>,
    /// Node and groups that the receive filters pass besides group 0.
    filters: (Node, [Option<Group>; 3]),
    bridge: Bridge,
    driven_since_us: Option<u64>,
    brake_released: bool,
    analog: Analog,
    mailboxes: Vec<Frame>,
    resets: u32,
    feeds: u32,
    tick_feeds: u32,
    retained: u32,
    /// What the chip gives as serial number.
    chip: u16,
}

impl SimBoard {
    /// Hardware with an erased flash; the straps select node `straps`.
    #[must_use]
    pub fn new(mut rig: Rig, straps: Node) -> Self {
        Self {
            analog: rig.analog(),
            rig,
            flash: SimFlash::default(),
            straps,
            reset_cause: None,
            filters: GROUP_0_ONLY,
            bridge: Bridge::Off,
            driven_since_us: None,
            brake_released: false,
            mailboxes: Vec::new(),
            resets: 0,
            feeds: 0,
            tick_feeds: 0,
            retained: COLD,
            // Arbitrary but distinct.
            chip: 1000 + u16::from(straps.number()),
        }
    }

    /// Makes it another chip, for a second board with the same straps.
    #[must_use]
    pub const fn with_chip(mut self, serial_number: u16) -> Self {
        self.chip = serial_number;
        self
    }

    /// The hand's board of that node with its motor's default plant, at position 0 and 25 °C.
    #[must_use]
    pub fn standard(node: Node, model: Model, seed: u64) -> Self {
        Self::at_position(0.0, node, model, seed).expect("the defaults are in range")
    }

    /// The same at another position, hall counts.
    ///
    /// # Errors
    /// The position is beyond the stops.
    pub fn at_position(count: f64, node: Node, model: Model, seed: u64) -> Result<Self, ParamError> {
        Self::with(count, node, RigParams::default(), &[], model, seed)
    }

    /// The same with the given sensors and objects.
    ///
    /// # Errors
    /// The position is beyond the stops, or a parameter is out of its range.
    pub fn with(
        count: f64,
        node: Node,
        rig: RigParams,
        objects: &[Object],
        model: Model,
        seed: u64,
    ) -> Result<Self, ParamError> {
        let plant = PlantParams::for_motor(MotorKind::of(node));
        let heat = Heat { winding_c: 25.0, housing_c: 25.0 };
        let start = Start { count, counts_per_s: 0.0, heat };
        Ok(Self::new(Rig::new(plant, rig, objects, model, start, seed)?, node))
    }

    /// Advances the plant to `until_us` or to the next hall edge, whichever is first; returns whether there was an edge.
    pub fn run(&mut self, until_us: u64) -> bool {
        self.rig.advance(self.bridge, self.brake_released, until_us).is_some()
    }

    /// Samples the analog inputs, as the ADC does before each tick.
    pub fn convert(&mut self) {
        self.analog = self.rig.analog();
    }

    /// The plant and its sensors.
    #[must_use]
    pub const fn rig(&self) -> &Rig {
        &self.rig
    }

    /// The plant, to disturb it.
    pub const fn rig_mut(&mut self) -> &mut Rig {
        &mut self.rig
    }

    /// The flash.
    #[must_use]
    pub const fn sim_flash(&self) -> &SimFlash {
        &self.flash
    }

    /// The bridge.
    #[must_use]
    pub const fn bridge_now(&self) -> Bridge {
        self.bridge
    }

    /// Time at which the bridge was switched on, µs; `None` while it is off.
    #[must_use]
    pub const fn driven_since_us(&self) -> Option<u64> {
        self.driven_since_us
    }

    /// Whether the brake is commanded to release.
    #[must_use]
    pub const fn is_brake_released(&self) -> bool {
        self.brake_released
    }

    /// The last ADC readings.
    #[must_use]
    pub(crate) const fn analog_now(&self) -> &Analog {
        &self.analog
    }

    /// Frames in the mailboxes.
    #[must_use]
    pub fn mailboxes(&self) -> &[Frame] {
        &self.mailboxes
    }

    /// Removes a sent frame from its mailbox. Ignored if the frame is gone (the board was reset meanwhile).
    pub fn sent(&mut self, frame: &Frame) {
        if let Some(index) = self.mailboxes.iter().position(|waiting| waiting == frame) {
            self.mailboxes.remove(index);
        }
    }

    /// How often the program requested a reset.
    #[must_use]
    pub const fn resets(&self) -> u32 {
        self.resets
    }

    /// How often the watchdog was fed.
    #[must_use]
    pub const fn feeds(&self) -> u32 {
        self.feeds
    }

    /// How often the watchdog of the control tick was fed.
    #[must_use]
    pub const fn tick_feeds(&self) -> u32 {
        self.tick_feeds
    }

    /// The RAM loses its contents: the word that a reset keeps becomes arbitrary.
    pub fn forget(&mut self) {
        self.retained = (self.rig.now_us() as u32).wrapping_mul(0x9E37_79B1);
    }

    /// Whether the receive filters pass a frame.
    #[must_use]
    pub fn accepts(&self, frame: &Frame) -> bool {
        let (node, groups) = self.filters;
        match frame.id().to {
            Destination::Node(to) => to == node && node != Node::HOST,
            Destination::Group(group) => group == Group::ALL || groups.contains(&Some(group)),
        }
    }

    /// Resets the pins and the CAN controller, as on a reset or a loss of power. [`Board::reset_cause`] returns `cause`.
    pub(crate) fn reset_pins(&mut self, cause: Option<FaultCode>) {
        self.bridge(Bridge::Off);
        self.brake_released = false;
        self.mailboxes.clear();
        self.filters = GROUP_0_ONLY;
        self.reset_cause = cause;
    }
}

impl Chip for SimBoard {
    type Flash = SimFlash;

    fn transmit(&mut self, frame: &Frame) -> bool {
        let room = self.mailboxes.len() < MAILBOXES;
        if room {
            self.mailboxes.push(*frame);
        }
        room
    }

    fn set_filters(&mut self, node: Node, groups: [Option<Group>; 3]) {
        self.filters = (node, groups);
    }

    fn flash(&mut self) -> &mut SimFlash {
        &mut self.flash
    }

    fn feed_watchdog(&mut self) {
        self.feeds += 1;
    }

    fn reset(&mut self) {
        self.resets += 1;
    }

    fn reset_cause(&self) -> Option<FaultCode> {
        self.reset_cause
    }

    fn straps(&self) -> Node {
        self.straps
    }

    fn serial_number(&self) -> u16 {
        self.chip
    }
}

impl Board for SimBoard {
    const FIGURES: BoardFigures = BoardFigures::TATER;

    fn bridge(&mut self, bridge: Bridge) {
        self.bridge = bridge;
        self.driven_since_us = match bridge {
            Bridge::Off => None,
            _ => Some(self.driven_since_us.unwrap_or(self.rig.now_us())),
        };
        self.flash.set_bridge_on(bridge != Bridge::Off);
    }

    fn brake(&mut self, released: bool) {
        self.brake_released = released;
    }

    fn halls(&self) -> u8 {
        self.rig.halls()
    }

    fn analog(&self) -> Analog {
        self.analog
    }

    fn feed_tick_watchdog(&mut self) {
        self.tick_feeds += 1;
    }

    fn retained(&self) -> u32 {
        self.retained
    }

    fn retain(&mut self, word: u32) {
        self.retained = word;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn simulated_board_keeps_the_promises_of_a_port() {
        let node = Node::new(4).expect("a node");
        let board = boot::conformance::chip(SimBoard::standard(node, Model::Averaged, 1)).expect("a chip");
        tater_fw::conformance::board(board).expect("a board");
    }
}
