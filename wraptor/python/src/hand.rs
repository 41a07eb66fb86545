//! A hand over TCP, a serial port or CAN, as `wraptor.Hand`.

use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyType};
use wraptor::{BoardState, Boards, CallError, Canceller, Connect, FileError, Firmware, Found};

use crate::call::{Callback, Watch, bytes, limit, path, property, whole, whole_or_none};
use crate::connection::Connection;
use crate::errors;
use crate::realtime::{Choice, RealTime};

/// A hand, as its one host: through its GOD, or by CAN without one. Limits are in seconds. Motors are a prefix of the hand's language ("13", "G", "S",
/// "X15", or empty for all with EN), nodes digits ("567").
#[pyclass(module = "wraptor", frozen)]
pub struct Hand {
    connection: Arc<Connection<wraptor::Hand>>,
    canceller: Canceller,
    address: String,
    version: u16,
}

impl Hand {
    fn new(hand: wraptor::Hand) -> Self {
        Self {
            canceller: hand.canceller(),
            address: hand.place().to_owned(),
            version: hand.version(),
            connection: Arc::new(Connection::new(hand)),
        }
    }

    /// Makes a bus of it.
    pub fn take(&self, py: Python<'_>, limit: Duration) -> PyResult<wraptor::Hand> {
        Ok(self.connection.take(py, limit, None)?.0)
    }
}

fn boards(name: &str) -> PyResult<Boards> {
    match name {
        "wake" => Ok(Boards::Wake),
        "ready" => Ok(Boards::Ready),
        "any" => Ok(Boards::Any),
        _ => Err(errors::value("boards", &format!("{name:?}"), "wake, ready or any", "give one of them")),
    }
}

fn connect(py: Python<'_>, way: &Connect, seconds: f64) -> PyResult<Hand> {
    let limit = limit(seconds)?;
    let hand = py.detach(|| way.connect(limit)).map_err(|error| errors::connect(py, &error))?;
    Ok(Hand::new(hand))
}

/// Name of a board's state.
pub const fn state(state: BoardState) -> &'static str {
    match state {
        BoardState::Silent => "silent",
        BoardState::Asleep => "asleep",
        BoardState::Unusable => "unusable",
        BoardState::Ready => "ready",
    }
}

/// Reads and checks a `.tek` file.
///
/// # Errors
/// `OSError`: it is no file, or cannot be read; `ValueError`: a board does not take it.
pub fn firmware(path: &Path) -> PyResult<Firmware> {
    Firmware::read(path).map_err(|error| match &error {
        FileError::Unreadable(_, why) if why.kind() != ErrorKind::InvalidData => {
            io::Error::new(why.kind(), error.to_string()).into()
        }
        _ => PyValueError::new_err(error.to_string()),
    })
}

#[pymethods]
impl Hand {
    /// Connects over TCP to HOST:PORT. Raises ConnectError.
    #[classmethod]
    #[pyo3(name = "connect", signature = (address, limit=5.0, boards="wake"))]
    fn connect_tcp(
        _: &Bound<'_, PyType>,
        py: Python<'_>,
        address: &str,
        limit: f64,
        boards: &str,
    ) -> PyResult<Self> {
        connect(py, &Connect::tcp(address).boards(self::boards(boards)?), limit)
    }

    /// Connects over a serial port such as /dev/ttyUSB0. Raises ConnectError.
    #[cfg(unix)]
    #[classmethod]
    #[pyo3(signature = (path, baud=9600, limit=10.0, boards="wake"))]
    fn serial(
        _: &Bound<'_, PyType>,
        py: Python<'_>,
        path: &str,
        #[pyo3(from_py_with = whole)] baud: u32,
        limit: f64,
        boards: &str,
    ) -> PyResult<Self> {
        connect(py, &Connect::serial(path, baud).boards(self::boards(boards)?), limit)
    }

    /// Connects by CAN, without GOD: this program interprets the hand's language itself. `place` is a CAN interface such as can0, or an SLCAN
    /// adapter: HOST:PORT, /dev/ttyACM0, or /dev/ttyUSB0@57600 with its baud rate. Raises ConnectError.
    #[classmethod]
    #[pyo3(signature = (place, limit=5.0, boards="wake"))]
    fn can(_: &Bound<'_, PyType>, py: Python<'_>, place: &str, limit: f64, boards: &str) -> PyResult<Self> {
        connect(py, &Connect::can(place).boards(self::boards(boards)?), limit)
    }

    /// Where it is connected, as it was given.
    #[getter]
    fn address(&self) -> &str {
        &self.address
    }

    /// The firmware's version.
    #[getter]
    const fn version(&self) -> u16 {
        self.version
    }

    /// Closes the connection, once a call of another thread has ended; `cancel` ends that. RealTime is ended. Motors stop.
    fn disconnect(&self, py: Python<'_>) -> PyResult<()> {
        self.connection.close(py)
    }

    fn __repr__(&self) -> String {
        format!("<Hand at {}: {}>", self.address, self.connection.state())
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

    /// Aborts a call of another thread, which raises CallError.
    fn cancel(&self, py: Python<'_>) -> PyResult<()> {
        py.detach(|| self.canceller.cancel()).map_err(|error| errors::call(py, &error))
    }

    /// Runs a line of the hand's language and returns what it prints.
    #[pyo3(signature = (line, limit=30.0, progress=None))]
    fn command(
        &self,
        py: Python<'_>,
        line: &str,
        limit: f64,
        progress: Option<Callback>,
    ) -> PyResult<Vec<String>> {
        self.connection.watched(py, limit, progress, |hand, limit, on| hand.command_with(line, limit, on))
    }

    /// The same, and waits until moves are over that the line begins by MODE 5 or CMD (the manual's command).
    #[pyo3(signature = (line, limit=30.0, progress=None))]
    fn command_and_wait(
        &self,
        py: Python<'_>,
        line: &str,
        limit: f64,
        progress: Option<Callback>,
    ) -> PyResult<Vec<String>> {
        self.connection.watched(py, limit, progress, |hand, limit, on| hand.command_and_wait(line, limit, on))
    }

    /// Writes bytes as they are, without waiting for an answer.
    #[pyo3(signature = (data, limit=1.0))]
    fn write(&self, py: Python<'_>, #[pyo3(from_py_with = bytes)] data: Vec<u8>, limit: f64) -> PyResult<()> {
        self.connection.run(py, limit, |hand, limit| hand.write(&data, limit))
    }

    /// Lines that the hand has printed unasked.
    #[pyo3(signature = (limit=1.0))]
    fn take_reports(&self, py: Python<'_>, limit: f64) -> PyResult<Vec<String>> {
        self.connection.run(py, limit, |hand, _| {
            hand.poll()?;
            Ok::<_, CallError>(hand.take_reports())
        })
    }

    /// Wakes all motor boards.
    #[pyo3(signature = (limit=3.0))]
    fn wake(&self, py: Python<'_>, limit: f64) -> PyResult<()> {
        self.connection.run(py, limit, wraptor::Hand::wake)
    }

    /// The states of motor boards 1 to 7.
    #[pyo3(signature = (limit=1.0))]
    fn boards(&self, py: Python<'_>, limit: f64) -> PyResult<Vec<&'static str>> {
        let states = self.connection.run(py, limit, wraptor::Hand::boards)?;
        Ok(states.map(state).to_vec())
    }

    /// Latched faults by node.
    #[pyo3(signature = (limit=1.0))]
    fn faults<'py>(&self, py: Python<'py>, limit: f64) -> PyResult<Bound<'py, PyDict>> {
        let faults = self.connection.run(py, limit, wraptor::Hand::faults)?;
        let by_node = PyDict::new(py);
        for (node, fault) in faults {
            by_node.set_item(node.number(), fault.row().cause)?;
        }
        Ok(by_node)
    }

    /// Finds the stops of all motors and goes to 0 (HI).
    #[pyo3(signature = (limit=60.0, progress=None))]
    fn init(&self, py: Python<'_>, limit: f64, progress: Option<Callback>) -> PyResult<()> {
        self.connection.watched(py, limit, progress, |hand, limit, on| hand.init(limit, on))
    }

    /// Finds the stops of motors and moves them to 0, links last (the manual's findZero).
    #[pyo3(signature = (motors="", limit=60.0, progress=None))]
    fn find_zero(
        &self,
        py: Python<'_>,
        motors: &str,
        limit: f64,
        progress: Option<Callback>,
    ) -> PyResult<()> {
        self.connection.watched(py, limit, progress, |hand, limit, on| hand.find_zero(motors, limit, on))
    }

    /// Closes motors (C).
    #[pyo3(signature = (motors="", limit=20.0, progress=None))]
    fn close(&self, py: Python<'_>, motors: &str, limit: f64, progress: Option<Callback>) -> PyResult<()> {
        self.connection.watched(py, limit, progress, |hand, limit, on| hand.close(motors, limit, on))
    }

    /// Opens motors (O).
    #[pyo3(signature = (motors="", limit=20.0, progress=None))]
    fn open(&self, py: Python<'_>, motors: &str, limit: f64, progress: Option<Callback>) -> PyResult<()> {
        self.connection.watched(py, limit, progress, |hand, limit, on| hand.open(motors, limit, on))
    }

    /// Closes motors with limited torque until they stall, and leaves them pressing (TC).
    #[pyo3(signature = (motors="", limit=20.0, progress=None))]
    fn grasp(&self, py: Python<'_>, motors: &str, limit: f64, progress: Option<Callback>) -> PyResult<()> {
        self.connection.watched(py, limit, progress, |hand, limit, on| hand.grasp(motors, limit, on))
    }

    /// Switches motors' power off (T).
    #[pyo3(signature = (motors="", limit=2.0))]
    fn relax(&self, py: Python<'_>, motors: &str, limit: f64) -> PyResult<()> {
        self.connection.run(py, limit, |hand, limit| hand.relax(motors, limit))
    }

    /// Moves motors to a position of the language, GCL counts, 0 to 20000 (M).
    #[pyo3(name = "move", signature = (motors, counts, limit=20.0, progress=None))]
    fn move_to(
        &self,
        py: Python<'_>,
        motors: &str,
        #[pyo3(from_py_with = whole)] counts: i64,
        limit: f64,
        progress: Option<Callback>,
    ) -> PyResult<()> {
        self.connection
            .watched(py, limit, progress, |hand, limit, on| hand.move_to(motors, counts, limit, on))
    }

    /// Moves fingers to a position of their links in hall counts, and their tips by a third of the joint angle.
    #[pyo3(signature = (fingers, halls, limit=20.0, progress=None))]
    fn move_halls(
        &self,
        py: Python<'_>,
        fingers: &str,
        #[pyo3(from_py_with = whole)] halls: i64,
        limit: f64,
        progress: Option<Callback>,
    ) -> PyResult<()> {
        self.connection
            .watched(py, limit, progress, |hand, limit, on| hand.move_halls(fingers, halls, limit, on))
    }

    /// Moves fingers and their tips to 0 (the manual's open).
    #[pyo3(signature = (fingers, limit=20.0, progress=None))]
    fn open_fingers(
        &self,
        py: Python<'_>,
        fingers: &str,
        limit: f64,
        progress: Option<Callback>,
    ) -> PyResult<()> {
        self.connection.watched(py, limit, progress, |hand, limit, on| hand.open_fingers(fingers, limit, on))
    }

    /// Moves fingers and their tips to the defaults of CT, or until an object stops them (the manual's close).
    #[pyo3(signature = (fingers, limit=20.0, progress=None))]
    fn close_fingers(
        &self,
        py: Python<'_>,
        fingers: &str,
        limit: f64,
        progress: Option<Callback>,
    ) -> PyResult<()> {
        self.connection.watched(py, limit, progress, |hand, limit, on| hand.close_fingers(fingers, limit, on))
    }

    /// A property of boards by node, in the units of docs/properties.md. Raises ValueError for an unknown name.
    #[pyo3(signature = (nodes, name, limit=1.0))]
    fn get<'py>(&self, py: Python<'py>, nodes: &str, name: &str, limit: f64) -> PyResult<Bound<'py, PyDict>> {
        let property = property(name)?;
        let values = self.connection.run(py, limit, |hand, limit| hand.get(nodes, property, limit))?;
        let by_node = PyDict::new(py);
        for (node, value) in values {
            by_node.set_item(node.number(), value)?;
        }
        Ok(by_node)
    }

    /// Sets a property of boards.
    #[pyo3(signature = (nodes, name, value, limit=1.0))]
    fn set(
        &self,
        py: Python<'_>,
        nodes: &str,
        name: &str,
        #[pyo3(from_py_with = whole)] value: i64,
        limit: f64,
    ) -> PyResult<()> {
        let property = property(name)?;
        self.connection.run(py, limit, |hand, limit| hand.set(nodes, property, value, limit))
    }

    /// Polls a property until all boards have a value.
    #[pyo3(signature = (nodes, name, value, limit=20.0, progress=None))]
    fn wait_for(
        &self,
        py: Python<'_>,
        nodes: &str,
        name: &str,
        #[pyo3(from_py_with = whole)] value: i64,
        limit: f64,
        progress: Option<Callback>,
    ) -> PyResult<()> {
        let property = property(name)?;
        self.connection
            .watched(py, limit, progress, |hand, limit, on| hand.wait_for(nodes, property, value, limit, on))
    }

    /// A parameter of motors (FGET).
    #[pyo3(signature = (motors, name, limit=1.0))]
    fn parameter(&self, py: Python<'_>, motors: &str, name: &str, limit: f64) -> PyResult<Vec<i64>> {
        self.connection.run(py, limit, |hand, limit| hand.parameter(motors, name, limit))
    }

    /// Sets a parameter of motors (FSET).
    #[pyo3(signature = (motors, name, value, limit=1.0))]
    fn set_parameter(
        &self,
        py: Python<'_>,
        motors: &str,
        name: &str,
        #[pyo3(from_py_with = whole)] value: i64,
        limit: f64,
    ) -> PyResult<()> {
        self.connection.run(py, limit, |hand, limit| hand.set_parameter(motors, name, value, limit))
    }

    /// A parameter of the hand (PGET).
    #[pyo3(signature = (name, limit=1.0))]
    fn hand_parameter(&self, py: Python<'_>, name: &str, limit: f64) -> PyResult<i64> {
        self.connection.run(py, limit, |hand, limit| hand.hand_parameter(name, limit))
    }

    /// Sets a parameter of the hand (PSET).
    #[pyo3(signature = (name, value, limit=1.0))]
    fn set_hand_parameter(
        &self,
        py: Python<'_>,
        name: &str,
        #[pyo3(from_py_with = whole)] value: i64,
        limit: f64,
    ) -> PyResult<()> {
        self.connection.run(py, limit, |hand, limit| hand.set_hand_parameter(name, value, limit))
    }

    /// Temperature of GOD's board, degrees Celsius; by CAN there is none.
    #[pyo3(signature = (limit=1.0))]
    fn temperature(&self, py: Python<'_>, limit: f64) -> PyResult<f64> {
        self.connection.run(py, limit, wraptor::Hand::temperature)
    }

    /// Stores parameters of motors and of the hand.
    #[pyo3(signature = (limit=5.0))]
    fn save_parameters(&self, py: Python<'_>, limit: f64) -> PyResult<()> {
        self.connection.run(py, limit, wraptor::Hand::save_parameters)
    }

    /// Stores positions and parameters of boards, and with node 0 those of GOD (the manual's saveParameters).
    #[pyo3(signature = (nodes, limit=5.0))]
    fn save_nodes(&self, py: Python<'_>, nodes: &str, limit: f64) -> PyResult<()> {
        self.connection.run(py, limit, |hand, limit| hand.save_nodes(nodes, limit))
    }

    /// Switches motors off and stores positions and parameters (SAVE).
    #[pyo3(signature = (limit=5.0))]
    fn prepare_power_off(&self, py: Python<'_>, limit: f64) -> PyResult<()> {
        self.connection.run(py, limit, wraptor::Hand::prepare_power_off)
    }

    /// Downloads a .tek file to boards; connect with boards="any". Raises OSError if it cannot be read, ValueError if it is none.
    #[pyo3(signature = (nodes, path, limit=120.0, progress=None))]
    fn download(
        &self,
        py: Python<'_>,
        nodes: &str,
        #[pyo3(from_py_with = path)] path: PathBuf,
        limit: f64,
        progress: Option<Callback>,
    ) -> PyResult<()> {
        let (firmware, watch) = (firmware(&path)?, Watch::new(progress));
        let outcome = self.connection.run(py, limit, |hand, limit| {
            hand.download(nodes, &firmware, limit, &mut |seen| watch.on_download(seen))
        });
        watch.outcome(outcome)
    }

    /// Begins RealTime of motors (LOOP). `velocity` (0: none), `feeds_velocity` and `feeds_change` are units of a byte, hall counts/s
    /// and GCL counts. Until its end no other call of the hand is possible.
    #[pyo3(signature = (
        motors, limit=2.0, *, velocity=8, gain=false, feeds_velocity=None, feeds_strain=false,
        feeds_position=true, feeds_change=None, feeds_temperature=false,
    ))]
    #[allow(clippy::too_many_arguments, reason = "keywords of Python")]
    fn realtime(
        &self,
        py: Python<'_>,
        motors: &str,
        limit: f64,
        #[pyo3(from_py_with = whole)] velocity: u8,
        gain: bool,
        #[pyo3(from_py_with = whole_or_none)] feeds_velocity: Option<u8>,
        feeds_strain: bool,
        feeds_position: bool,
        #[pyo3(from_py_with = whole_or_none)] feeds_change: Option<u8>,
        feeds_temperature: bool,
    ) -> PyResult<RealTime> {
        let format = wraptor::Format {
            velocity: Some(velocity).filter(|unit| *unit > 0),
            gain,
            feeds_velocity,
            feeds_strain,
            feeds_position,
            feeds_change,
            feeds_temperature,
        };
        let choice = Choice { motors: motors.to_owned(), format, limit: self::limit(limit)? };
        RealTime::start(py, &self.connection, choice)
    }
}

/// Hands in the network that answer within `limit`: address, and hardware address if they tell. `to` are broadcast addresses.
#[pyfunction]
#[pyo3(signature = (limit=1.0, to=None))]
pub fn discover(
    py: Python<'_>,
    limit: f64,
    to: Option<Vec<String>>,
) -> PyResult<Vec<(String, Option<String>)>> {
    let limit = self::limit(limit)?;
    let place = |text: &String| {
        let bare = text.parse::<Ipv4Addr>().map(|ip| SocketAddrV4::new(ip, wraptor::discovery::PORT));
        bare.or_else(|_| text.parse::<SocketAddrV4>()).map_err(|_| {
            errors::value("to", &format!("{text:?}"), "an IPv4 address", "give one such as 192.168.1.255")
        })
    };
    if to.as_ref().is_some_and(Vec::is_empty) {
        return Err(errors::value("to", "[]", "an IPv4 address or more", "leave it out for all networks"));
    }
    let to: Option<Vec<SocketAddrV4>> = to.map(|to| to.iter().map(place).collect()).transpose()?;
    let to = to.unwrap_or_else(|| wraptor::discovery::EVERYWHERE.to_vec());
    let found = py.detach(|| wraptor::discover(&to, limit)).map_err(|error| errors::connect(py, &error))?;
    let row = |Found { address, hardware }: Found| {
        let hardware = hardware.map(|bytes| bytes.map(|byte| format!("{byte:02x}")).join(":"));
        (address.to_string(), hardware)
    };
    Ok(found.into_iter().map(row).collect())
}
