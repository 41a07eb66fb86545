//! What existing host programs do, rewritten from their behavior: over CAN against native and emulated boards, over serial through GOD; and
//! the project's own host library.

mod barrett_serial;
mod bh8_282;
mod bhand_can;
mod bhand_serial;
mod borders;
mod btutil;
mod can;
mod cisst;
mod handif;
mod host_units;
mod libbarrett;
mod libgripper;
mod library;
mod owd;
mod pyhand;
mod serial;
mod serial_bhand;
