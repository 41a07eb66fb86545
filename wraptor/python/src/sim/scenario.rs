//! Runs of scenarios, with the overrides of `hil-sim run`.

use std::path::PathBuf;

use hil_experiment::report;
use hil_experiment::run::{Options, Outcome};
use hil_experiment::scenario::{SHIPPED, Scenario};
use hil_experiment::trace::{COLUMNS, Trace};
use hil_world::plant::Model;
use numpy::IntoPyArray;
use pyo3::IntoPyObjectExt;
use pyo3::exceptions::{PyAttributeError, PyTypeError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyList, PyMapping};
use serde_json::Value;
use traces::input::BadInput;

use crate::call::{path, whole_or_none};
use crate::errors::{self, caused};

/// What the result of a run says besides its metrics.
const NO_METRICS: [&str; 4] = ["scenario", "seed", "model", "expectations"];

/// A number as `hil-sim run` takes it.
fn number(value: &Bound<'_, PyAny>) -> PyResult<String> {
    let py = value.py();
    match value.call_method0("__index__") {
        Ok(whole) => Ok(whole.to_string()),
        Err(error)
            if error.is_instance_of::<PyAttributeError>(py) || error.is_instance_of::<PyTypeError>(py) =>
        {
            Ok(value.extract::<f64>()?.to_string())
        }
        Err(error) => Err(error),
    }
}

/// Overrides by name.
pub struct Overrides(Vec<String>);

impl Overrides {
    /// `NAME=VALUE` for each entry of an argument, in the mapping's order.
    ///
    /// # Errors
    /// `TypeError`: a name is no text, a value neither text nor number; `ValueError`: a name is given twice.
    pub fn of(argument: &str, named: Option<&Bound<'_, PyMapping>>) -> PyResult<Self> {
        let Some(named) = named else { return Ok(Self(Vec::new())) };
        let wrong = |error: PyErr, what: String| match error.is_instance_of::<PyTypeError>(named.py()) {
            true => caused(named.py(), PyTypeError::new_err(what), error),
            false => error,
        };
        let mut names: Vec<String> = Vec::new();
        let mut assignments = Vec::new();
        for item in named.items()?.try_iter()? {
            let (key, value): (Bound<'_, PyAny>, Bound<'_, PyAny>) = item?.extract()?;
            let name: String = key.extract().map_err(|error| {
                wrong(error, format!("{argument}: found the name {key:?}, expected a text"))
            })?;
            let text = value.extract::<String>().or_else(|_| number(&value)).map_err(|error| {
                wrong(error, format!("{argument}[{key:?}]: found {value:?}, expected a number or a text"))
            })?;
            if let Some(other) = names.iter().find(|other| other.eq_ignore_ascii_case(&name)) {
                let found = format!("{other:?} and {name:?}");
                return Err(errors::value(argument, &found, "each name once", "remove one of the two"));
            }
            assignments.push(format!("{name}={text}"));
            names.push(name);
        }
        Ok(Self(assignments))
    }
}

/// All that is overridden in a scenario.
pub struct Changes {
    /// Of the servo.
    pub properties: Overrides,
    /// Of plant, sensors and supply, by option of `hil-sim run`.
    pub figures: Vec<(&'static str, Overrides)>,
}

impl Changes {
    /// Overrides them.
    ///
    /// # Errors
    /// An unknown name with the nearest one, a value out of range.
    pub fn apply(&self, scenario: &mut Scenario) -> Result<(), BadInput> {
        self.properties.0.iter().try_for_each(|assignment| scenario.set(assignment))?;
        let all = |(option, overrides): &'_ (&'static str, Overrides)| {
            let option = *option;
            overrides.0.iter().map(move |assignment| (option, assignment.clone())).collect::<Vec<_>>()
        };
        let figures: Vec<(&str, String)> = self.figures.iter().flat_map(all).collect();
        let figures: Vec<(&str, &str)> =
            figures.iter().map(|(option, assignment)| (*option, assignment.as_str())).collect();
        scenario.override_figures(&figures)
    }
}

/// The inverter's model by its name.
///
/// # Errors
/// `ValueError`: there is none of this name.
pub fn model(name: &str) -> PyResult<Model> {
    match name {
        "averaged" => Ok(Model::Averaged),
        "switched" => Ok(Model::Switched),
        _ => Err(errors::value("model", &format!("{name:?}"), "averaged or switched", "give one of them")),
    }
}

/// A parameter out of range that a scenario's check let pass.
pub fn out_of_range(place: &str, error: hil_world::plant::ParamError) -> BadInput {
    BadInput::new(place, format!("{} is out of range", error.field))
        .found(error.found.to_string())
        .expected(error.expected)
        .next("give other figures")
}

/// Names of the shipped scenarios.
#[pyfunction]
pub fn scenarios() -> Vec<&'static str> {
    SHIPPED.iter().map(|shipped| shipped.name).collect()
}

/// Runs a scenario, by its name or file, with the overrides and the seed (1) of `hil-sim run`.
///
/// Raises ValueError for an unknown name, with the nearest one, for a name given twice, and for a value out of range.
#[pyfunction]
#[pyo3(signature = (
    scenario, properties=None, plant=None, seed=None, *, rig=None, supply=None, model="averaged", trace=true,
))]
#[allow(clippy::too_many_arguments, reason = "keywords of Python")]
pub fn run(
    py: Python<'_>,
    #[pyo3(from_py_with = path)] scenario: PathBuf,
    properties: Option<&Bound<'_, PyMapping>>,
    plant: Option<&Bound<'_, PyMapping>>,
    #[pyo3(from_py_with = whole_or_none)] seed: Option<u64>,
    rig: Option<&Bound<'_, PyMapping>>,
    supply: Option<&Bound<'_, PyMapping>>,
    model: &str,
    trace: bool,
) -> PyResult<Run> {
    let changes = Changes {
        properties: Overrides::of("properties", properties)?,
        figures: vec![
            ("plant", Overrides::of("plant", plant)?),
            ("rig", Overrides::of("rig", rig)?),
            ("supply", Overrides::of("supply", supply)?),
        ],
    };
    let options = Options { seed: seed.unwrap_or(1), model: self::model(model)?, trace };
    let name = scenario.to_string_lossy().into_owned();
    let outcome = py.detach(|| {
        let mut scenario = Scenario::find(&name)?;
        changes.apply(&mut scenario)?;
        hil_experiment::run::run(&scenario, &options).map_err(|error| out_of_range(&name, error))
    });
    Run::of(py, outcome.map_err(errors::bad_input)?)
}

/// The result of a scenario, as `run` returns it. It can be pickled, so that a pool of processes can return it.
#[pyclass(module = "wraptor.sim", frozen)]
pub struct Run {
    /// As in run.json.
    result: Py<PyDict>,
    /// Those of a run here; a pickled one has `traces` alone.
    recorded: Vec<Trace>,
    /// Columns by motor, converted once somebody reads them.
    traces: PyOnceLock<Py<PyDict>>,
}

impl Run {
    fn of(py: Python<'_>, outcome: Outcome) -> PyResult<Self> {
        let result = python(py, &report::json_value_of(&outcome))?.cast_into::<PyDict>()?;
        let recorded = outcome.runs.into_iter().filter_map(|run| run.trace).collect();
        Ok(Self { result: result.unbind(), recorded, traces: PyOnceLock::new() })
    }

    fn all_traces<'py>(&self, py: Python<'py>) -> PyResult<&Bound<'py, PyDict>> {
        let traces = self.traces.get_or_try_init(py, || {
            let traces = PyDict::new(py);
            for trace in &self.recorded {
                traces.set_item(trace.motor.name(), columns(py, trace)?)?;
            }
            Ok::<_, PyErr>(traces.unbind())
        })?;
        Ok(traces.bind(py))
    }

    fn item<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        self.result.bind(py).as_any().get_item(name)
    }
}

fn columns<'py>(py: Python<'py>, trace: &Trace) -> PyResult<Bound<'py, PyDict>> {
    let columns = PyDict::new(py);
    for column in COLUMNS {
        columns.set_item(column.name, trace.column(column.name).into_pyarray(py))?;
    }
    Ok(columns)
}

/// A value of JSON in Python's types.
fn python<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    match value {
        Value::Null => Ok(py.None().into_bound(py)),
        Value::Bool(is) => is.into_bound_py_any(py),
        Value::Number(number) => match (number.as_u64(), number.as_i64()) {
            // The seed has 64 bits.
            (Some(whole), _) => whole.into_bound_py_any(py),
            (None, Some(whole)) => whole.into_bound_py_any(py),
            (None, None) => number.as_f64().into_bound_py_any(py),
        },
        Value::String(text) => text.into_bound_py_any(py),
        Value::Array(values) => {
            let list = PyList::empty(py);
            values.iter().try_for_each(|value| list.append(python(py, value)?))?;
            Ok(list.into_any())
        }
        Value::Object(values) => {
            let dict = PyDict::new(py);
            values.iter().try_for_each(|(name, value)| dict.set_item(name, python(py, value)?))?;
            Ok(dict.into_any())
        }
    }
}

#[pymethods]
impl Run {
    #[new]
    fn new(py: Python<'_>, result: Py<PyDict>, traces: Py<PyDict>) -> Self {
        let cell = PyOnceLock::new();
        // Nobody else has set it.
        let _ = cell.set(py, traces);
        Self { result, recorded: Vec::new(), traces: cell }
    }

    /// The scenario's name.
    #[getter]
    fn scenario<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.item(py, "scenario")
    }

    /// The seed of noise and scatter.
    #[getter]
    fn seed<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.item(py, "seed")
    }

    /// Whether all expectations were met.
    #[getter]
    fn passed(&self, py: Python<'_>) -> PyResult<bool> {
        for verdict in self.item(py, "expectations")?.try_iter()? {
            if !verdict?.get_item("ok")?.is_truthy()? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Metrics by name, as in run.json: numbers, words, a list of faults; None without a value.
    #[getter]
    fn metrics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let metrics = self.result.bind(py).copy()?;
        NO_METRICS.iter().try_for_each(|name| metrics.del_item(name))?;
        Ok(metrics)
    }

    /// The verdict on each expectation: name, ok, value, want.
    #[getter]
    fn expectations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.item(py, "expectations")
    }

    /// Columns of trace.csv by name, a row a millisecond, of the scenario's first motor; empty with trace=False.
    #[getter]
    fn trace<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let first = self.all_traces(py)?.iter().next();
        Ok(first.map_or_else(|| PyDict::new(py).into_any(), |(_, columns)| columns))
    }

    /// The same by motor: "link", "spread" and "tip".
    #[getter]
    fn traces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.all_traces(py).cloned()
    }

    fn __getnewargs__<'py>(&self, py: Python<'py>) -> PyResult<(Py<PyDict>, Bound<'py, PyDict>)> {
        Ok((self.result.clone_ref(py), self.traces(py)?))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let verdict = if self.passed(py)? { "passed" } else { "FAILED" };
        Ok(format!("<Run of {} with seed {}: {verdict}>", self.scenario(py)?, self.seed(py)?))
    }
}
