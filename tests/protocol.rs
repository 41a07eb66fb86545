//! What goes over the bus: a Tater as a host sees it.

mod download;
mod hosts;
mod properties;
mod tek;
