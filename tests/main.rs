//! System tests: one binary, a module a subject.

mod emulated;
mod fences;
mod god;
mod halls;
mod loops;
mod metal;
mod over_can;
mod plant;
mod power_cuts;
mod profile;
mod protocol;
mod scenarios;
mod trust;
