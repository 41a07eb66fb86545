//! The hardware of a motor board: registers on the metal, the plant in the simulator.

use boot::Chip;
use servo_core::motor::BoardFigures;
use servo_core::sense::commutation::Bridge;
use servo_core::units::{DeciCelsius, MilliAmps, MilliVolts};

/// The latest analog readings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Analog {
    /// Bus voltage.
    pub bus: MilliVolts,
    /// Bus current, positive into the bridge.
    pub current: MilliAmps,
    /// Motor thermistor (THERM).
    pub motor_temp: DeciCelsius,
    /// Board temperature (TEMP).
    pub board_temp: DeciCelsius,
    /// Strain gauge, 0..=255 (SG).
    pub strain: u8,
    /// The raw inputs behind ANA0 (strain gauge) and ANA1 (motor thermistor), 0..=4095.
    pub raw: [u16; 2],
    /// The break input has switched the bridge off; it stays so until the bridge is commanded off. Where an interrupt calls
    /// [`Tater::bridge_fault`](crate::Tater::bridge_fault), it may be `false` always.
    pub bridge_fault: bool,
}

/// One motor board: a chip with a bridge and sensors.
pub trait Board: Chip {
    /// What it is built of: limits of the motor follow from it.
    const FIGURES: BoardFigures;

    /// Sets the three legs of the bridge.
    fn bridge(&mut self, bridge: Bridge);

    /// Energizes the brake's coil, which frees the spread, or releases it. Boards without a brake ignore it.
    fn brake(&mut self, released: bool);

    /// The debounced hall lines, bits 2..0.
    fn halls(&self) -> u8;

    /// A single recent sample of the hall lines, which may be a spike: enough to see that nothing changed.
    fn raw_halls(&self) -> u8 {
        self.halls()
    }

    /// The analog readings.
    fn analog(&self) -> Analog;

    /// Feeds the watchdog of the control tick: the board is reset 60 ms after the last call at the latest, once there was one.
    fn feed_tick_watchdog(&mut self);

    /// The word of the last [`Self::retain`] if only resets came since; anything after power-up.
    fn retained(&self) -> u32;

    /// Keeps a word over a reset.
    fn retain(&mut self, word: u32);
}
