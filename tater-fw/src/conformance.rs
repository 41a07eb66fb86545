//! Whether a port's hardware keeps the promises of [`Board`] (`docs/porting.md`), on a computer or on the board itself, with its motor at
//! rest. [`boot::conformance`] has those of its chip.

use boot::Chip;
use boot::conformance::{Broken, holds};
use servo_core::motor::BoardFigures;
use servo_core::sense::commutation::Bridge;
use servo_core::units::Micros;
use tater_wire::{FaultCode, Frame, Group, Node, Property};

use crate::board::{Analog, Board};
use crate::tater::Tater;

type Kept = Result<(), Broken>;

/// The sensors of a motor at rest, the word that survives a reset, and the application itself for three seconds of ticks.
///
/// # Errors
/// The first promise that is broken.
pub fn board<B: Board>(mut board: B) -> Result<B, Broken> {
    board.bridge(Bridge::Off);
    board.brake(false);
    halls(&board)?;
    analog(&board.analog())?;
    for word in [0, u32::MAX, 0x1234_5678] {
        board.retain(word);
        holds(board.retained() == word, "a retained word is kept", 0, board.retained())?;
    }
    rests(board)
}

fn halls<B: Board>(board: &B) -> Kept {
    let code = board.halls();
    holds((1..=6).contains(&code), "a motor's halls read 1 to 6", 0, code)?;
    for _ in 0..100 {
        let (settled, raw) = (board.halls(), board.raw_halls());
        holds(settled == code, "the halls of a motor at rest stay as they are", 0, settled)?;
        holds(raw < 8, "a sample of the halls has three bits", 0, raw)?;
    }
    Ok(())
}

fn analog(analog: &Analog) -> Kept {
    let Analog { bus, current, motor_temp, board_temp, raw, bridge_fault, .. } = *analog;
    holds((5_000..=60_000).contains(&bus.0), "the supply is on, in millivolts", 0, bus.0)?;
    let ma = current.0.unsigned_abs();
    holds(ma <= 500, "no current with the bridge off, in milliamperes", 0, ma)?;
    for celsius in [motor_temp, board_temp] {
        let tenths = celsius.0.unsigned_abs();
        holds((-400..=1250).contains(&celsius.0), "temperatures in tenths of a degree", 0, tenths)?;
    }
    for code in raw {
        holds(code < 4096, "a raw input has twelve bits", 0, code)?;
    }
    holds(!bridge_fault, "no fault of a bridge that is off", 0, 0_u8)
}

/// A board whose outputs are watched.
struct Watched<B> {
    board: B,
    /// The bridge was switched on, or the brake released.
    moved: bool,
    fed: u32,
}

impl<B: Board> Chip for Watched<B> {
    type Flash = B::Flash;

    fn transmit(&mut self, frame: &Frame) -> bool {
        self.board.transmit(frame)
    }

    fn set_filters(&mut self, node: Node, groups: [Option<Group>; 3]) {
        self.board.set_filters(node, groups);
    }

    fn flash(&mut self) -> &mut B::Flash {
        self.board.flash()
    }

    fn feed_watchdog(&mut self) {
        self.board.feed_watchdog();
    }

    fn reset(&mut self) {}

    fn reset_cause(&self) -> Option<FaultCode> {
        self.board.reset_cause()
    }

    fn straps(&self) -> Node {
        self.board.straps()
    }

    fn serial_number(&self) -> u16 {
        self.board.serial_number()
    }
}

impl<B: Board> Board for Watched<B> {
    const FIGURES: BoardFigures = B::FIGURES;

    fn bridge(&mut self, bridge: Bridge) {
        self.moved |= bridge != Bridge::Off;
        self.board.bridge(bridge);
    }

    fn brake(&mut self, released: bool) {
        self.moved |= released;
        self.board.brake(released);
    }

    fn halls(&self) -> u8 {
        self.board.halls()
    }

    fn raw_halls(&self) -> u8 {
        self.board.raw_halls()
    }

    fn analog(&self) -> Analog {
        self.board.analog()
    }

    fn feed_tick_watchdog(&mut self) {
        self.fed = self.fed.saturating_add(1);
        self.board.feed_tick_watchdog();
    }

    fn retained(&self) -> u32 {
        self.board.retained()
    }

    fn retain(&mut self, word: u32) {
        self.board.retain(word);
    }
}

/// Ticks that the application runs.
const TICKS: u32 = 3_000;

/// The application, as an interrupt each millisecond and the idle loop call it: it moves nothing and finds no fault.
fn rests<B: Board>(board: B) -> Result<B, Broken> {
    let mut tater = Tater::new(Watched { board, moved: false, fed: 0 }, Micros(0));
    let fit = tater.property(Property::FIT).unwrap_or(0).unsigned_abs();
    let fit = u32::try_from(fit).unwrap_or(u32::MAX);
    holds(fit == 0, "this board drives the hand's motor: FIT", 0, fit)?;
    for ms in 1..=TICKS {
        let now = Micros(ms.saturating_mul(1000));
        if tater.tick(now) {
            tater.flush();
        }
        if ms.is_multiple_of(100) {
            tater.housekeeping(now);
        }
        let _ = tater.store();
    }
    let error = u32::try_from(tater.property(Property::ERROR).unwrap_or(0)).unwrap_or(u32::MAX);
    holds(error == 0, "no fault at rest: ERROR", 0, error)?;
    let watched = tater.into_board();
    holds(!watched.moved, "nothing moves unasked", 0, 0_u8)?;
    holds(watched.fed >= TICKS, "each tick feeds its watchdog", 0, watched.fed)?;
    Ok(watched.board)
}
