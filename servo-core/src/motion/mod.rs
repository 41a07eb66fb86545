//! How a set-point moves and how the error becomes torque, and torque a duty.
pub mod pid;
pub mod profile;
pub mod torque;
pub mod velocity_loop;
