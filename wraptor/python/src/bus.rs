//! Motor boards on their bus, as `wraptor.Bus`.

use std::path::PathBuf;

use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyType};
use wraptor::{ConnectError, Frame, Node};

use crate::call::{Callback, Watch, bytes, limit, node, path, property, whole, wholes};
use crate::connection::Connection;
use crate::errors;
use crate::hand::{Hand, firmware, state};

/// Motor boards on their bus, this program its one host. Limits are in seconds.
#[pyclass(module = "wraptor", frozen)]
pub struct Bus(Connection<wraptor::Bus>);

fn opened(py: Python<'_>, open: impl FnOnce() -> Result<wraptor::Bus, ConnectError> + Send) -> PyResult<Bus> {
    let bus = py.detach(open).map_err(|error| errors::connect(py, &error))?;
    Ok(Bus(Connection::new(bus)))
}

fn nodes(numbers: &[i64]) -> PyResult<Vec<Node>> {
    numbers.iter().map(|number| node(*number)).collect()
}

#[pymethods]
impl Bus {
    /// Connects to an SLCAN adapter over TCP, HOST:PORT. Raises ConnectError.
    #[classmethod]
    #[pyo3(signature = (address, limit=5.0))]
    fn slcan(_: &Bound<'_, PyType>, py: Python<'_>, address: &str, limit: f64) -> PyResult<Self> {
        let limit = self::limit(limit)?;
        opened(py, || wraptor::Bus::slcan(address, limit))
    }

    /// The same on a serial port.
    #[cfg(unix)]
    #[classmethod]
    #[pyo3(signature = (path, baud=115_200, limit=5.0))]
    fn slcan_serial(
        _: &Bound<'_, PyType>,
        py: Python<'_>,
        path: &str,
        #[pyo3(from_py_with = whole)] baud: u32,
        limit: f64,
    ) -> PyResult<Self> {
        let limit = self::limit(limit)?;
        opened(py, || wraptor::Bus::slcan_serial(path, baud, limit))
    }

    /// Opens a CAN interface of Linux, such as can0, which is up at 1 Mbit/s.
    #[cfg(target_os = "linux")]
    #[classmethod]
    fn can(_: &Bound<'_, PyType>, py: Python<'_>, interface: &str) -> PyResult<Self> {
        opened(py, || wraptor::Bus::can(interface))
    }

    /// Speaks to a hand's boards by packets; the hand takes no other calls afterwards.
    #[classmethod]
    #[pyo3(signature = (hand, limit=2.0))]
    fn through(_: &Bound<'_, PyType>, py: Python<'_>, hand: &Hand, limit: f64) -> PyResult<Self> {
        let limit = self::limit(limit)?;
        let hand = hand.take(py, limit)?;
        let bus = py.detach(|| wraptor::Bus::through(hand, limit));
        bus.map(|bus| Self(Connection::new(bus))).map_err(|error| errors::call(py, &error))
    }

    /// Closes the connection, once a call of another thread has ended.
    fn disconnect(&self, py: Python<'_>) -> PyResult<()> {
        self.0.close(py)
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    fn __exit__(
        &self,
        py: Python<'_>,
        _kind: &Bound<'_, PyAny>,
        _value: &Bound<'_, PyAny>,
        _traceback: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        self.disconnect(py)
    }

    /// Sends a frame (docs/wire.md).
    #[pyo3(signature = (id, data, limit=1.0))]
    fn send(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = whole)] id: u16,
        #[pyo3(from_py_with = bytes)] data: Vec<u8>,
        limit: f64,
    ) -> PyResult<()> {
        let frame = Frame::from_raw(id, &data).ok_or_else(|| {
            let found = format!("id {id:#x} with {} bytes", data.len());
            errors::value("frame", &found, "an id of 11 bits and up to 8 bytes", "see docs/wire.md")
        })?;
        self.0.run(py, limit, |bus, limit| bus.send(&frame, limit))
    }

    /// The next frame's id and data; None if none comes within the limit.
    #[pyo3(signature = (limit=1.0))]
    fn receive<'py>(&self, py: Python<'py>, limit: f64) -> PyResult<Option<(u16, Bound<'py, PyBytes>)>> {
        let frame = self.0.run(py, limit, wraptor::Bus::receive)?;
        Ok(frame.map(|frame| (frame.raw_id(), PyBytes::new(py, frame.data()))))
    }

    /// A property of a board. Raises ValueError for an unknown name.
    #[pyo3(signature = (node, name, limit=1.0))]
    fn get(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = whole)] node: i64,
        name: &str,
        limit: f64,
    ) -> PyResult<i64> {
        let (node, property) = (self::node(node)?, property(name)?);
        self.0.run(py, limit, |bus, limit| bus.get(node, property, limit))
    }

    /// Sets a property of a board and reads it back.
    #[pyo3(signature = (node, name, value, limit=1.0))]
    fn set(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = whole)] node: i64,
        name: &str,
        #[pyo3(from_py_with = whole)] value: i64,
        limit: f64,
    ) -> PyResult<()> {
        let (node, property) = (self::node(node)?, property(name)?);
        self.0.run(py, limit, |bus, limit| bus.set(node, property, value, limit))
    }

    /// The state of a board.
    #[pyo3(signature = (node, limit=1.0))]
    fn state(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = whole)] node: i64,
        limit: f64,
    ) -> PyResult<&'static str> {
        let node = self::node(node)?;
        self.0.run(py, limit, |bus, limit| bus.state(node, limit)).map(state)
    }

    /// Requires boards that answer and are awake, each within the limit. Raises ConnectError.
    #[pyo3(signature = (nodes, limit=0.2))]
    fn require(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = wholes)] nodes: Vec<i64>,
        limit: f64,
    ) -> PyResult<()> {
        let nodes = self::nodes(&nodes)?;
        self.0.run(py, limit, |bus, limit| bus.require(&nodes, limit))
    }

    /// Wakes boards.
    #[pyo3(signature = (nodes, limit=3.0))]
    fn wake(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = wholes)] nodes: Vec<i64>,
        limit: f64,
    ) -> PyResult<()> {
        let nodes = self::nodes(&nodes)?;
        self.0.run(py, limit, |bus, limit| bus.wake(&nodes, limit))
    }

    /// Moves a motor to a hall count and waits for the end.
    #[pyo3(name = "move", signature = (node, halls, limit=20.0, progress=None))]
    fn move_to(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = whole)] node: i64,
        #[pyo3(from_py_with = whole)] halls: i64,
        limit: f64,
        progress: Option<Callback>,
    ) -> PyResult<()> {
        let node = self::node(node)?;
        self.0.watched(py, limit, progress, |bus, limit, on| bus.move_to(node, halls, limit, on))
    }

    /// Finds a motor's stop and waits for the end.
    #[pyo3(signature = (node, limit=20.0, progress=None))]
    fn find_zero(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = whole)] node: i64,
        limit: f64,
        progress: Option<Callback>,
    ) -> PyResult<()> {
        let node = self::node(node)?;
        self.0.watched(py, limit, progress, |bus, limit, on| bus.find_zero(node, limit, on))
    }

    /// The latched fault of a board.
    #[pyo3(signature = (node, limit=1.0))]
    fn fault(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = whole)] node: i64,
        limit: f64,
    ) -> PyResult<Option<&'static str>> {
        let node = self::node(node)?;
        let fault = self.0.run(py, limit, |bus, limit| bus.fault(node, limit))?;
        Ok(fault.map(|fault| fault.row().cause))
    }

    /// Stops every motor.
    #[pyo3(signature = (limit=1.0))]
    fn stop_all(&self, py: Python<'_>, limit: f64) -> PyResult<()> {
        self.0.run(py, limit, wraptor::Bus::stop_all)
    }

    /// Downloads a .tek file to a board. Raises OSError if it cannot be read, ValueError if it is none.
    #[pyo3(signature = (node, path, limit=60.0, progress=None))]
    fn download(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = whole)] node: i64,
        #[pyo3(from_py_with = path)] path: PathBuf,
        limit: f64,
        progress: Option<Callback>,
    ) -> PyResult<()> {
        let (node, firmware, watch) = (self::node(node)?, firmware(&path)?, Watch::new(progress));
        let outcome = self.0.run(py, limit, |bus, limit| {
            bus.download(node, &firmware, limit, &mut |seen| watch.on_download(seen))
        });
        watch.outcome(outcome)
    }
}
