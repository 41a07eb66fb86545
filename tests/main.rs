//! System tests: one binary, a module a subject.

mod arrival;
mod bad_link;
mod chart;
mod contact;
mod effort;
mod emulated;
mod fences;
mod figures;
mod god;
mod halls;
mod heat;
mod homing;
mod host;
mod identify;
mod loops;
mod metal;
mod over_can;
mod power_cuts;
mod profile;
mod protocol;
mod random_commands;
mod supply;
mod targets;
mod torture;
mod trust;
mod wiring;
