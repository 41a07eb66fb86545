//! What must never go on, and what merely bounds: two enums, each naming the property that governs it.

/// A condition that ends motion at once: bridge off, brake engaged, until `Command::ClearFault`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The hall lines lie too often or one of them is stuck (property HALLS).
    Halls,
    /// Phase current above what a working motor can draw (property IMOTOR).
    OverCurrent,
    /// Motor temperature at its limit (property OTEMP).
    OverTemperature,
    /// Bus voltage above the bridge's rating (property VBUS).
    OverVoltage,
    /// Bus voltage too low for the gate drivers (property VBUS).
    UnderVoltage,
    /// The gate driver or the over-current comparator switched the bridge off.
    Bridge,
}

/// A bound that the torque or the duty ran into; the motion goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// Torque at MT, or IHIT while homing.
    Torque,
    /// Duty at 97 %: the bootstrap drivers need the rest (property VBUS).
    Duty,
    /// Torque derated near the motor's temperature limit (property OTEMP).
    Thermal,
    /// Torque cut back because the phase current is above the motor's peak (property IMOTOR).
    Current,
}
