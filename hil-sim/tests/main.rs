//! The program `hil-sim` as people and programs meet it: its commands and servers.
//!
//! One binary, because linking takes seconds for each, and because what one test waits for leaves its processor to another.

mod apply;
mod bus;
mod cli;
mod commission;
mod compare;
mod convert;
mod events;
mod hand;
mod identify;
mod log;
mod peers;
mod readers;
mod response;
mod served;
mod sweep;
mod tune;
