//! The set-point's motion, and the control laws from error to torque to voltage.
pub mod pid;
pub mod profile;
pub mod torque;
pub mod velocity_loop;
