//! The control modes of the manual (property MODE, manual 6.1).

/// The control mode of a motor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Mode {
    /// MODE 0: bridge off, brake engaged.
    #[default]
    Idle,
    /// MODE 2: torque as commanded by T.
    Torque,
    /// MODE 3: hold or follow the position P.
    Pid,
    /// MODE 4: velocity V with proportional gain (RealTime, TC, TO).
    Velocity,
    /// MODE 5: trapezoidal move to E.
    Trapezoidal,
}

impl Mode {
    /// All modes.
    pub const ALL: [Self; 5] = [Self::Idle, Self::Torque, Self::Pid, Self::Velocity, Self::Trapezoidal];
}
