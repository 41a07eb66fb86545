//! The extension module behind the Python package `wraptor`: the host library, and the simulator in process (docs/python.md).
//!
//! Every call that waits or simulates releases the GIL. What Python sees of types is in `python/wraptor/*.pyi`; the doc comments of classes and methods
//! are what its help() shows, with the same words as there.
//!
//! | module | subject |
//! |---|---|
//! | `hand`, `realtime`, `bus` | the host library: [`wraptor::Hand`], [`wraptor::RealTime`], [`wraptor::Bus`] |
//! | `sim` | runs of scenarios; a hand and a board in simulated time |
//! | `connection` | turns of several threads |
//! | `call`, `errors` | arguments, limits, names, progress, signals; exceptions |
#![forbid(unsafe_code)]

mod bus;
mod call;
mod connection;
mod errors;
mod hand;
mod realtime;
mod sim;

use pyo3::prelude::*;

/// The package's extension module.
#[pymodule]
mod _wraptor {
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::bus::Bus;
    #[pymodule_export]
    use super::hand::{Hand, discover};
    #[pymodule_export]
    use super::realtime::{Feedback, RealTime, Statistics};

    /// The classes of `wraptor.sim`: two are called Hand.
    #[pymodule]
    mod sim {
        #[pymodule_export]
        use crate::sim::{Board, Run, SimHand, run, scenarios};
    }

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
