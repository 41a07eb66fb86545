//! The board as both programs have it: [`Chip`] over registers, and [`Board`] where the motor's pins are set up.

use core::convert::Infallible;

use boot::Chip;
use bsp_stm32f1::adc::{Adc, Channels, Codes};
use bsp_stm32f1::can::Can;
use bsp_stm32f1::clock::{Clock, Ticker};
use bsp_stm32f1::flash::{self, Mapped};
use bsp_stm32f1::halls::Halls;
use bsp_stm32f1::pwm::Guarded;
use bsp_stm32f1::watchdog::{TickWatchdog, Watchdog};
use bsp_stm32f1::{clocks, stop, system, timing};
use embedded_hal::digital::InputPin;
use servo_core::motor::BoardFigures;
use servo_core::sense::commutation::Bridge;
use servo_core::units::Micros;
use stm32f1xx_hal::can::Can as CanPins;
use stm32f1xx_hal::flash::FlashExt;
use stm32f1xx_hal::gpio::{GpioExt, Output, PB5};
use stm32f1xx_hal::pac::{self, CAN};
use stm32f1xx_hal::rcc::Reset;
use tater_fw::{Analog, Board};
use tater_wire::map::Map;
use tater_wire::{FaultCode, Frame, Group, Node};

use crate::map::{APPLICATION, MAP, STORAGE};
use crate::pins::{self, BusPins, MotorPins};
use crate::{digital, scale};

/// This board's memory map.
pub struct Here;

impl Mapped for Here {
    const MAP: Map = MAP;
}

/// The monitor has no motor: the pins stay as reset leaves them, so the bridge is off and the brake engaged.
pub struct Held;

/// The motor's outputs and sensors, which the application has.
pub struct Armed {
    bridge: Guarded,
    brake: PB5<Output>,
    adc: Adc,
    /// Interrupts at each edge of the hall lines.
    pub halls: Halls,
    tick_watchdog: TickWatchdog,
}

impl Armed {
    #[inline(always)]
    fn analog(&self) -> Analog {
        let Codes { injected: [current, bus, strain, motor], regular } = self.adc.read();
        Analog {
            bus: scale::bus(bus),
            current: scale::current(current),
            motor_temp: scale::temperature(motor),
            board_temp: scale::temperature(regular),
            strain: scale::strain(strain),
            raw: [strain, motor],
            bridge_fault: self.bridge.broken(),
        }
    }
}

/// The inputs of the front end, in the order of [`Armed::analog`].
const CHANNELS: Channels = Channels { injected: [5, 1, 2, 3], regular: 4 };

/// The board.
pub struct Metal<M> {
    motor: M,
    /// The bus.
    pub can: Can,
    flash: flash::Metal<Here>,
    watchdog: Watchdog,
    straps: Node,
    cause: Option<FaultCode>,
    clock: Clock,
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
        }
    }};
}

impl Metal<Held> {
    /// The monitor's board, after a reset.
    pub fn monitor(chip: pac::Peripherals) -> Self {
        // First, so that the watchdog ends every wait below.
        let watchdog = Watchdog::new(chip.IWDG, chip.DBGMCU);
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
        system::start(APPLICATION)
    }
}

impl Metal<Armed> {
    /// The application's board, with its tick.
    pub fn application(chip: pac::Peripherals) -> (Self, Ticker) {
        let watchdog = Watchdog::new(chip.IWDG, chip.DBGMCU);
        let mut parts = chip.FLASH.constrain();
        let mut rcc = clocks::start(chip.RCC, &mut parts);
        // Before its pins, which follow TIM1 as soon as they are switched to it.
        let bridge = Guarded::new(chip.TIM1, &mut rcc);
        let (bus, motor) = pins::all(chip.GPIOA.split(&mut rcc), chip.GPIOB.split(&mut rcc));
        let MotorPins { brake, .. } = motor;
        let armed = Armed {
            adc: Adc::new(chip.ADC1, &CHANNELS, &mut rcc),
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
        let before = self.clock.last();
        let since = self.now().wrapping_since(before).0;
        // Not before the last call: two counters may differ by one.
        before.wrapping_add(Micros(since.saturating_sub(self.motor.halls.age().into())))
    }

    /// Clears the break interrupt.
    pub fn broken(&mut self) {
        self.motor.bridge.seen();
    }
}

impl<M> Metal<M> {
    /// The time, in us since the program's start. Must be called at least every 65 ms.
    pub fn now(&mut self) -> Micros {
        self.clock.now()
    }
}

impl<M> Chip for Metal<M> {
    type Flash = flash::Metal<Here>;

    fn transmit(&mut self, frame: &Frame) -> bool {
        self.can.transmit(frame)
    }

    fn set_filters(&mut self, node: Node, groups: [Option<Group>; 3]) {
        self.can.set_filters(node, groups);
    }

    fn flash(&mut self) -> &mut flash::Metal<Here> {
        &mut self.flash
    }

    fn feed_watchdog(&mut self) {
        self.watchdog.feed();
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
        system::serial_number()
    }
}

impl Board for Metal<Armed> {
    const FIGURES: BoardFigures = BoardFigures::TATER;

    #[inline(always)]
    fn bridge(&mut self, bridge: Bridge) {
        self.motor.bridge.set(bridge);
    }

    fn brake(&mut self, released: bool) {
        digital::set_brake(&mut self.motor.brake, released);
    }

    fn halls(&self) -> u8 {
        self.motor.halls.code()
    }

    fn raw_halls(&self) -> u8 {
        self.motor.halls.first()
    }

    #[inline(always)]
    fn analog(&self) -> Analog {
        self.motor.analog()
    }

    #[inline(always)]
    fn feed_tick_watchdog(&mut self) {
        self.motor.tick_watchdog.feed();
    }

    fn retained(&self) -> u32 {
        stop::retained()
    }

    fn retain(&mut self, word: u32) {
        stop::retain(word);
    }
}
