//! The motor board as both programs have it: [`Board`] over registers.

use core::convert::Infallible;

use embedded_hal::digital::InputPin;
use servo_core::motor::BoardFigures;
use servo_core::sense::commutation::Bridge;
use servo_core::units::Micros;
use stm32f1xx_hal::can::Can as CanPins;
use stm32f1xx_hal::flash::FlashExt;
use stm32f1xx_hal::gpio::{GpioExt, Output, PB5};
use stm32f1xx_hal::pac::{self, CAN, DBGMCU, TIM2, TIM3};
use stm32f1xx_hal::rcc::{Enable, Rcc, Reset};
use tater_wire::memory::{APPLICATION, STORAGE};
use tater_wire::{FaultCode, Frame, Group, Node};

use super::adc::Adc;
use super::address::pointer;
use super::can::Can;
use super::halls::Halls;
use super::pins::{self, BusPins, MotorPins};
use super::pwm::Guarded;
use super::watchdog::{TickWatchdog, Watchdog};
use super::{clocks, digital, flash, stop, timing};
use crate::board::{Analog, Board};

/// The motor's outputs and sensors, or their absence.
pub trait Motor {
    /// See [`Board::bridge`].
    fn bridge(&mut self, bridge: Bridge);
    /// See [`Board::brake`].
    fn brake(&mut self, released: bool);
    /// See [`Board::halls`].
    fn halls(&self) -> u8;
    /// See [`Board::raw_halls`].
    fn raw_halls(&self) -> u8;
    /// See [`Board::analog`].
    fn analog(&self) -> Analog;
    /// See [`Board::feed_tick_watchdog`].
    fn feed_tick_watchdog(&mut self);
}

/// The monitor's: the pins stay as reset leaves them, so the bridge is off and the brake engaged, whatever is asked for.
pub struct Held;

impl Motor for Held {
    fn bridge(&mut self, _: Bridge) {}

    fn brake(&mut self, _: bool) {}

    fn halls(&self) -> u8 {
        0
    }

    fn raw_halls(&self) -> u8 {
        0
    }

    fn analog(&self) -> Analog {
        Analog::default()
    }

    fn feed_tick_watchdog(&mut self) {}
}

/// The application's.
pub struct Armed {
    bridge: Guarded,
    brake: PB5<Output>,
    adc: Adc,
    /// Interrupts at each edge of the hall lines.
    pub halls: Halls,
    tick_watchdog: TickWatchdog,
}

impl Motor for Armed {
    #[inline(always)]
    fn bridge(&mut self, bridge: Bridge) {
        self.bridge.set(bridge);
    }

    fn brake(&mut self, released: bool) {
        digital::set_brake(&mut self.brake, released);
    }

    fn halls(&self) -> u8 {
        self.halls.code()
    }

    fn raw_halls(&self) -> u8 {
        self.halls.first()
    }

    #[inline(always)]
    fn analog(&self) -> Analog {
        self.adc.read(self.bridge.broken())
    }

    #[inline(always)]
    fn feed_tick_watchdog(&mut self) {
        self.tick_watchdog.feed();
    }
}

/// The time base: TIM2 counts microseconds in 16 bits, the rest is counted here.
struct Clock {
    tim: TIM2,
    now: Micros,
}

impl Clock {
    fn new(tim: TIM2, rcc: &mut Rcc) -> Self {
        TIM2::enable(rcc);
        TIM2::reset(rcc);
        tim.psc().write(|w| w.psc().set(timing::tick::PRESCALER));
        tim.arr().write(|w| w.arr().set(u16::MAX));
        // The prescaler is taken over by an update.
        tim.egr().write(|w| w.ug().update());
        tim.cr1().write(|w| w.cen().enabled());
        Self { tim, now: Micros(0) }
    }

    /// Must be called at least every 65.5 ms.
    fn now(&mut self) -> Micros {
        let [low, high, ..] = self.now.0.to_le_bytes();
        let since = self.tim.cnt().read().cnt().bits().wrapping_sub(u16::from_le_bytes([low, high]));
        self.now = self.now.wrapping_add(Micros(since.into()));
        #[cfg(feature = "log")]
        LOGGED_AT.store(self.now.0, core::sync::atomic::Ordering::Relaxed);
        self.now
    }
}

#[cfg(feature = "log")]
static LOGGED_AT: core::sync::atomic::AtomicU32 = core::sync::atomic::AtomicU32::new(0);

/// The time of a log line, in µs: that of the last tick.
#[cfg(feature = "log")]
pub fn logged_at() -> u32 {
    LOGGED_AT.load(core::sync::atomic::Ordering::Relaxed)
}

/// The control tick's timer, TIM3.
pub struct Ticker(TIM3);

impl Ticker {
    fn new(tim: TIM3, rcc: &mut Rcc) -> Self {
        TIM3::enable(rcc);
        tim.psc().write(|w| w.psc().set(timing::tick::PRESCALER));
        tim.arr().write(|w| w.arr().set(timing::tick::TOP));
        tim.egr().write(|w| w.ug().update());
        tim.sr().write(|w| w.uif().clear());
        tim.dier().write(|w| w.uie().enabled());
        tim.cr1().write(|w| w.cen().enabled());
        Self(tim)
    }

    /// Clears the interrupt.
    pub fn seen(&mut self) {
        self.0.sr().write(|w| w.uif().clear());
    }
}

/// The board.
pub struct Metal<M: Motor> {
    /// The motor's outputs and sensors.
    pub motor: M,
    /// The bus.
    pub can: Can,
    flash: flash::Metal,
    watchdog: Watchdog,
    straps: Node,
    cause: Option<FaultCode>,
    clock: Clock,
    debug: DBGMCU,
}

macro_rules! metal {
    ($chip:ident, $rcc:ident, $flash:ident, $cause:ident, $bus:ident, $watchdog:ident, $motor:expr) => {{
        let BusPins { can_rx, can_tx, mut strap_1, mut strap_2, mut strap_4 } = $bus;
        let straps: [&mut dyn InputPin<Error = Infallible>; 3] = [&mut strap_1, &mut strap_2, &mut strap_4];
        let can = CanPins::new($chip.CAN, $chip.USB, (can_tx, can_rx), &mut $rcc);
        // Clears the other program's state.
        CAN::reset(&mut $rcc);
        let can = Can::new(can);
        let clock = Clock::new($chip.TIM2, &mut $rcc);
        cortex_m::asm::delay(timing::straps::SETTLE);
        Metal {
            straps: digital::node(straps),
            motor: $motor,
            can,
            flash: $flash,
            watchdog: $watchdog,
            cause: $cause,
            clock,
            debug: $chip.DBGMCU,
        }
    }};
}

impl Metal<Held> {
    /// The monitor's board, after a reset.
    pub fn monitor(chip: pac::Peripherals) -> Self {
        // First, so that the watchdog ends every wait below.
        let watchdog = Watchdog::new(chip.IWDG);
        let mut parts = chip.FLASH.constrain();
        let mut rcc = clocks::start(chip.RCC, &mut parts);
        // Only once the crystal runs: until then each start ends by the watchdog, and the first cause must survive.
        let cause = stop::reset_cause(&rcc);
        let bus = pins::bus(chip.GPIOA.split(&mut rcc), chip.GPIOB.split(&mut rcc));
        let flash = flash::Metal::new(APPLICATION.start);
        metal!(chip, rcc, flash, cause, bus, watchdog, Held)
    }

    /// Jumps to the application, which sets up everything it uses.
    pub fn start(self) -> ! {
        // The application resets the controller, in the middle of a frame too.
        self.can.drain();
        // SAFETY: the monitor has verified the application: its vector table begins there, with a stack in RAM and a reset
        // vector inside. No interrupt is enabled, so none meets the new table too early.
        unsafe {
            (*cortex_m::peripheral::SCB::PTR).vtor.write(APPLICATION.start);
            cortex_m::asm::bootload(pointer(APPLICATION.start))
        }
    }
}

impl Metal<Armed> {
    /// The application's board, with its tick.
    pub fn application(chip: pac::Peripherals) -> (Self, Ticker) {
        let watchdog = Watchdog::new(chip.IWDG);
        let mut parts = chip.FLASH.constrain();
        let mut rcc = clocks::start(chip.RCC, &mut parts);
        // Before its pins, which follow TIM1 as soon as they are switched to it.
        let bridge = Guarded::new(chip.TIM1, &mut rcc);
        let (bus, motor) = pins::all(chip.GPIOA.split(&mut rcc), chip.GPIOB.split(&mut rcc));
        let MotorPins { brake, .. } = motor;
        let armed = Armed {
            adc: Adc::new(chip.ADC1, &mut rcc),
            bridge,
            brake,
            halls: Halls::new(chip.TIM4, &mut rcc),
            tick_watchdog: TickWatchdog::new(chip.WWDG, &mut rcc),
        };
        let ticker = Ticker::new(chip.TIM3, &mut rcc);
        let flash = flash::Metal::new(STORAGE.start);
        // The monitor has reported the cause.
        let cause = None;
        let mut metal = metal!(chip, rcc, flash, cause, bus, watchdog, armed);
        metal.can.interrupt();
        (metal, ticker)
    }

    /// Takes the first of the two samples of the hall lines that [`Board::halls`] compares. At least
    /// [`SAMPLE_GAP`](timing::hall::SAMPLE_GAP) must pass in between: reading the time, or the ADC, fills it.
    #[inline(always)]
    pub fn sample_halls(&mut self) {
        self.motor.halls.sample();
    }

    /// The time of the hall edge that interrupted; clears the interrupt.
    #[inline(always)]
    pub fn edge(&mut self) -> Micros {
        let before = self.clock.now;
        let since = self.now().wrapping_since(before).0;
        // Not before the last call: two counters may differ by one.
        before.wrapping_add(Micros(since.saturating_sub(self.motor.halls.age().into())))
    }

    /// Clears the break interrupt.
    pub fn broken(&mut self) {
        self.motor.bridge.seen();
    }
}

impl<M: Motor> Metal<M> {
    /// The time, in us since the program's start. Must be called at least every 65 ms.
    pub fn now(&mut self) -> Micros {
        self.clock.now()
    }
}

/// Address of the chip's 96-bit unique ID (RM0008 30.2).
const UNIQUE_ID: u32 = 0x1FFF_F7E8;

impl<M: Motor> Board for Metal<M> {
    type Flash = flash::Metal;
    const FIGURES: BoardFigures = BoardFigures::TATER;

    #[inline(always)]
    fn bridge(&mut self, bridge: Bridge) {
        self.motor.bridge(bridge);
    }

    fn brake(&mut self, released: bool) {
        self.motor.brake(released);
    }

    fn halls(&self) -> u8 {
        self.motor.halls()
    }

    fn raw_halls(&self) -> u8 {
        self.motor.raw_halls()
    }

    #[inline(always)]
    fn analog(&self) -> Analog {
        self.motor.analog()
    }

    fn transmit(&mut self, frame: &Frame) -> bool {
        self.can.transmit(frame)
    }

    fn set_filters(&mut self, node: Node, groups: [Option<Group>; 3]) {
        self.can.set_filters(node, groups);
    }

    fn flash(&mut self) -> &mut flash::Metal {
        &mut self.flash
    }

    fn feed_watchdog(&mut self) {
        // Halted by a debug probe, the bridge is off as after a break, and the watchdogs wait (RM0008 31.16.4). Set at each
        // feed, because the chip takes it only while a probe is attached (errata).
        self.debug
            .cr()
            .modify(|_, w| w.dbg_tim1_stop().set_bit().dbg_iwdg_stop().set_bit().dbg_wwdg_stop().set_bit());
        self.watchdog.feed();
    }

    #[inline(always)]
    fn feed_tick_watchdog(&mut self) {
        self.motor.feed_tick_watchdog();
    }

    fn retained(&self) -> u32 {
        stop::retained()
    }

    fn retain(&mut self, word: u32) {
        stop::retain(word);
    }

    fn reset(&mut self) {
        // A reset takes the controller off the bus at once, in the middle of a frame too.
        self.can.drain();
        cortex_m::peripheral::SCB::sys_reset();
    }

    fn reset_cause(&self) -> Option<FaultCode> {
        self.cause
    }

    fn straps(&self) -> Node {
        self.straps
    }

    fn serial_number(&self) -> u16 {
        // SAFETY: six half-words of the system memory, which every program may read.
        let words: [u16; 6] = unsafe { pointer::<[u16; 6]>(UNIQUE_ID).read() };
        words.iter().fold(0, |sum: u16, word| sum.rotate_left(3) ^ word) & 0x7FFF
    }
}
