//! What existing host programs do, rewritten from their behavior: over CAN against native and emulated boards, over serial through GOD; and
//! the project's own host library.

mod barrett_serial;
mod borders;
mod btutil;
mod can;
mod libbarrett;
mod libgripper;
mod library;
mod pyhand;
mod serial;
