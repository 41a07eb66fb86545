//! The board: its flash in an array, its bus a loop, its motor at rest.

use boot::{Chip, Flash, FlashError};
use heapless::Deque;
use servo_core::motor::{BoardFigures, Parts};
use servo_core::sense::commutation::Bridge;
use servo_core::units::{DeciCelsius, MilliVolts};
use tater_fw::{Analog, Board};
use tater_wire::map::{Area, Map};
use tater_wire::{FaultCode, Frame, Group, Node};

use crate::map::MAP;

/// The flash, in [`WORDS`](crate::map::WORDS) half-words of RAM.
#[derive(Clone, Debug)]
pub struct Ram<W>(pub W);

impl<W: AsRef<[u16]> + AsMut<[u16]>> Ram<W> {
    /// The half-words of an area, if it begins and ends where it must.
    fn at(&mut self, address: u32, len: u32, multiple: u32) -> Result<&mut [u16], FlashError> {
        let Area { start, .. } = MAP.of.flash;
        let is_own = address < MAP.application.start;
        if is_own || !address.is_multiple_of(multiple) || !MAP.of.flash.holds(address.into(), len.into()) {
            return Err(FlashError::Address);
        }
        let [from, to] = [address, address + len].map(|at| usize::try_from((at - start) / 2).unwrap_or(0));
        self.0.as_mut().get_mut(from..to).ok_or(FlashError::Address)
    }
}

impl<W: AsRef<[u16]> + AsMut<[u16]>> Flash for Ram<W> {
    const MAP: Map = MAP;

    fn half_word(&self, address: u32) -> u16 {
        let place = address.checked_sub(MAP.of.flash.start).filter(|place| place.is_multiple_of(2));
        let index = place.and_then(|place| usize::try_from(place / 2).ok());
        index.and_then(|index| self.0.as_ref().get(index)).copied().unwrap_or(u16::MAX)
    }

    fn program(&mut self, address: u32, unit: &[u16]) -> Result<(), FlashError> {
        let place = self.at(address, MAP.of.unit, MAP.of.unit)?;
        if place.len() != unit.len() {
            return Err(FlashError::Address);
        }
        if place.iter().any(|&word| word != u16::MAX) && unit.iter().any(|&word| word != 0) {
            return Err(FlashError::NotErased);
        }
        place.copy_from_slice(unit);
        Ok(())
    }

    fn erase(&mut self, page: u32) -> Result<(), FlashError> {
        self.at(page, MAP.of.page, MAP.of.page)?.fill(u16::MAX);
        Ok(())
    }
}

/// The board.
#[derive(Debug)]
pub struct Stub<W> {
    flash: Ram<W>,
    bus: Deque<Frame, 3>,
    retained: u32,
}

impl<W> Stub<W> {
    /// A board with this flash.
    #[must_use]
    pub const fn new(flash: Ram<W>) -> Self {
        Self { flash, bus: Deque::new(), retained: 0 }
    }

    /// The next frame from the bus.
    pub fn receive(&mut self) -> Option<Frame> {
        self.bus.pop_front()
    }
}

impl<W: AsRef<[u16]> + AsMut<[u16]>> Chip for Stub<W> {
    type Flash = Ram<W>;

    fn transmit(&mut self, frame: &Frame) -> bool {
        self.bus.push_back(*frame).is_ok()
    }

    fn set_filters(&mut self, _: Node, _: [Option<Group>; 3]) {}

    fn flash(&mut self) -> &mut Ram<W> {
        &mut self.flash
    }

    fn feed_watchdog(&mut self) {}

    fn reset(&mut self) {
        #[cfg(target_os = "none")]
        cortex_m::peripheral::SCB::sys_reset();
    }

    fn reset_cause(&self) -> Option<FaultCode> {
        None
    }

    fn straps(&self) -> Node {
        Node::HOST
    }

    fn serial_number(&self) -> u16 {
        1
    }
}

impl<W: AsRef<[u16]> + AsMut<[u16]>> Board for Stub<W> {
    const FIGURES: BoardFigures = BoardFigures::new(&Parts {
        pwm_ns: 50_000,
        dead_ns: 500,
        diode_mv: 800,
        most_ma: 25_000,
        step_ua: 10_000,
        bus_mv: (16_000, 32_000),
        capacitance_uf: 1_000,
    });

    fn bridge(&mut self, _: Bridge) {}

    fn brake(&mut self, _: bool) {}

    fn halls(&self) -> u8 {
        2
    }

    fn analog(&self) -> Analog {
        let room = DeciCelsius(250);
        Analog { bus: MilliVolts(24_000), motor_temp: room, board_temp: room, ..Analog::default() }
    }

    fn feed_tick_watchdog(&mut self) {}

    fn retained(&self) -> u32 {
        self.retained
    }

    fn retain(&mut self, word: u32) {
        self.retained = word;
    }
}
