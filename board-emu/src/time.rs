//! Time on the chip, in ticks that divide every clock.

/// Ticks since the board was made. 144 a microsecond: half a cycle of the core at 72 MHz, so that 1.5 cycles
/// are a whole number; a cycle of 8 MHz is 18 ticks, one of the watchdog's 40 kHz 3600.
pub type Time = u64;

/// Ticks a second.
pub const HZ: u64 = 144_000_000;

/// Ticks a microsecond.
pub const US: u64 = HZ / 1_000_000;

/// Time of an event that never happens by itself.
pub const NEVER: Time = Time::MAX;
