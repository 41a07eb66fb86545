//! Runs of scenarios, with the overrides of `hil-sim run`.

use hil_sim::input::BadInput;
use hil_sim::scenario::{SHIPPED, Scenario, motor_name};
use hil_sim::trace::{COLUMNS, Trace};
use hil_sim::{Model, Options, Outcome, report};
use numpy::IntoPyArray;
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyList};
use serde_json::Value;

use crate::errors;

/// What the result of a run says besides its metrics.
const NO_METRICS: [&str; 4] = ["scenario", "seed", "model", "expectations"];

/// A value as `hil-sim run` takes it, from a text or a number.
#[derive(FromPyObject)]
enum Given {
    Text(String),
    Whole(i64),
    Number(f64),
}

/// Overrides by name.
pub struct Overrides(Vec<String>);

impl Overrides {
    /// `NAME=VALUE` for each entry, in the dictionary's order.
    ///
    /// # Errors
    /// `TypeError`: a name is no text, a value neither text nor number.
    pub fn of(named: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let assignment = |(name, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
            let name: String = name.extract()?;
            Ok(match value.extract()? {
                Given::Text(text) => format!("{name}={text}"),
                Given::Whole(number) => format!("{name}={number}"),
                Given::Number(number) => format!("{name}={number}"),
            })
        };
        named.into_iter().flatten().map(assignment).collect::<PyResult<_>>().map(Self)
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
pub fn out_of_range(place: &str, error: hil_sim::plant::ParamError) -> BadInput {
    BadInput {
        place: place.to_owned(),
        problem: format!("{} is out of range", error.field),
        found: error.found.to_string(),
        expected: error.expected,
        next: "give other figures".to_owned(),
    }
}

/// Names of the shipped scenarios.
#[pyfunction]
pub fn scenarios() -> Vec<&'static str> {
    SHIPPED.iter().map(|shipped| shipped.name).collect()
}

/// Runs a scenario.
#[pyfunction]
#[pyo3(signature = (
    scenario, properties=None, plant=None, seed=None, *, rig=None, supply=None, model="averaged", trace=true,
))]
#[allow(clippy::too_many_arguments, reason = "keywords of Python")]
pub fn run(
    py: Python<'_>,
    scenario: std::path::PathBuf,
    properties: Option<&Bound<'_, PyDict>>,
    plant: Option<&Bound<'_, PyDict>>,
    seed: Option<u64>,
    rig: Option<&Bound<'_, PyDict>>,
    supply: Option<&Bound<'_, PyDict>>,
    model: &str,
    trace: bool,
) -> PyResult<Run> {
    let changes = Changes {
        properties: Overrides::of(properties)?,
        figures: vec![
            ("plant", Overrides::of(plant)?),
            ("rig", Overrides::of(rig)?),
            ("supply", Overrides::of(supply)?),
        ],
    };
    let options = Options { seed: seed.unwrap_or(1), model: self::model(model)?, trace };
    let name = scenario.to_string_lossy().into_owned();
    let outcome = py.detach(|| {
        let mut scenario = Scenario::find(&name)?;
        changes.apply(&mut scenario)?;
        hil_sim::run(&scenario, &options).map_err(|error| out_of_range(&name, error))
    });
    outcome.map(Run::new).map_err(|bad| errors::bad_input(&bad))
}

/// The result of a run.
#[pyclass(module = "wraptor.sim", frozen)]
pub struct Run {
    outcome: Outcome,
    /// Converted once: reading a column twice costs nothing.
    traces: PyOnceLock<Py<PyDict>>,
}

impl Run {
    const fn new(outcome: Outcome) -> Self {
        Self { outcome, traces: PyOnceLock::new() }
    }

    fn result(&self, py: Python<'_>, wanted: impl Fn(&str) -> bool) -> PyResult<Py<PyDict>> {
        let dict = PyDict::new(py);
        if let Value::Object(result) = report::json_value_of(&self.outcome) {
            for (name, value) in result.iter().filter(|(name, _)| wanted(name)) {
                dict.set_item(name, python(py, value)?)?;
            }
        }
        Ok(dict.unbind())
    }

    fn all_traces<'py>(&self, py: Python<'py>) -> PyResult<&Bound<'py, PyDict>> {
        let traces = self.traces.get_or_try_init(py, || {
            let all = PyDict::new(py);
            for run in &self.outcome.runs {
                if let Some(trace) = &run.trace {
                    all.set_item(motor_name(run.motor), columns(py, trace)?)?;
                }
            }
            Ok::<_, PyErr>(all.unbind())
        })?;
        Ok(traces.bind(py))
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
        Value::Number(number) => match number.as_i64() {
            Some(whole) => whole.into_bound_py_any(py),
            None => number.as_f64().into_bound_py_any(py),
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
    #[getter]
    fn scenario(&self) -> &str {
        &self.outcome.scenario
    }

    #[getter]
    const fn seed(&self) -> u64 {
        self.outcome.options.seed
    }

    #[getter]
    fn passed(&self) -> bool {
        self.outcome.passed()
    }

    #[getter]
    fn metrics(&self, py: Python<'_>) -> PyResult<Py<PyDict>> {
        self.result(py, |name| !NO_METRICS.contains(&name))
    }

    #[getter]
    fn expectations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let result = self.result(py, |name| name == "expectations")?;
        result.bind(py).as_any().get_item("expectations")
    }

    /// Of the scenario's first motor.
    #[getter]
    fn trace<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let first = self.outcome.runs.first().filter(|run| run.trace.is_some());
        match first {
            Some(run) => self.all_traces(py)?.as_any().get_item(motor_name(run.motor)),
            None => Ok(PyDict::new(py).into_any()),
        }
    }

    #[getter]
    fn traces(&self, py: Python<'_>) -> PyResult<Py<PyDict>> {
        self.all_traces(py).map(|traces| traces.clone().unbind())
    }

    fn __repr__(&self) -> String {
        let verdict = if self.passed() { "passed" } else { "FAILED" };
        format!("<Run of {} with seed {}: {verdict}>", self.outcome.scenario, self.outcome.options.seed)
    }
}
