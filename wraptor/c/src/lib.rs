//! C library of a robot hand: the crate `wraptor` behind a C ABI, with the nineteen functions of the manual's section 7 (docs/c-library.md).
//!
//! Names are those that C sees; `include/wraptor.h` is generated from this source. Every function returns an error code and takes a limit. A
//! connection is a number in a table, so a wrong one is found and never followed. No panic passes the border.
//!
//! | module | subject |
//! |---|---|
//! | [`functions`] | seventeen of the nineteen functions, and what ends or cancels a connection |
//! | [`network`] | the other two: hands in the network, firmware |
//! | [`realtime`] | RealTime |
//! | [`thread`] | threads for the compatibility header |
//! | [`border`] | from a call of C to a call of a hand: arguments, panics |
//! | `slot` | connections, and whose turn it is |
//! | [`error`], [`property`] | error codes and the last error of a thread; property numbers and the list of values |
#![allow(non_camel_case_types, reason = "the names that C sees")]

pub mod border;
pub mod error;
pub mod functions;
pub mod network;
pub mod property;
pub mod realtime;
mod slot;
pub mod thread;
