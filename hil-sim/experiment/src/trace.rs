//! The run tick by tick, as rows of numbers: for CSV files, charts and golden files.

use std::io::{self, Write};

use tater_fw::codes::mode_code;
use tater_wire::MotorKind;

use hil_world::node::Sample;

/// Row limit; longer runs keep every n-th tick.
const MAX_ROWS: u32 = 20_000;

/// What a run records of a tick, as a column of its trace.
pub struct Signal {
    /// Name in the CSV; ends in the unit.
    pub name: &'static str,
    /// Digits after the point in the CSV.
    pub decimals: usize,
    get: fn(&Sample) -> f64,
}

macro_rules! columns {
    ($($name:ident $decimals:literal $get:expr;)*) => {
        /// The columns, in order.
        pub const COLUMNS: &[Signal] =
            &[$(Signal { name: stringify!($name), decimals: $decimals, get: $get }),*];
    };
}

columns! {
    time_ms 0 |s| f64::from(s.ms);
    mode 0 |s| f64::from(mode_code(s.status.mode).number());
    position_counts 3 |s| s.truth.counts;
    position_estimated_counts 3 Sample::estimated_counts;
    setpoint_counts 3 Sample::setpoint_counts;
    velocity_counts_s 2 |s| s.truth.counts_per_s;
    velocity_estimated_counts_s 2 |s| s.status.velocity.0.to_num();
    velocity_setpoint_counts_s 2 |s| s.status.setpoint_velocity.0.to_num();
    torque_per_1024 0 |s| f64::from(s.status.torque.0);
    torque_motor_n_m 4 |s| s.truth.torque_n_m;
    load_n_m 4 |s| s.truth.load_n_m;
    duty_percent 2 |s| if s.driven { 100.0 * s.status.duty.0.to_num::<f64>() } else { 0.0 };
    phase_a_a 3 |s| s.truth.phase_a[0];
    phase_b_a 3 |s| s.truth.phase_a[1];
    phase_c_a 3 |s| s.truth.phase_a[2];
    bus_v 2 |s| f64::from(s.analog.bus.0) / 1000.0;
    bus_a 3 |s| f64::from(s.analog.current.0) / 1000.0;
    halls_code 0 |s| f64::from(s.halls);
    winding_c 2 |s| s.truth.winding_c;
    housing_c 2 |s| s.truth.housing_c;
    thermistor_c 1 |s| f64::from(s.analog.motor_temp.0) / 10.0;
    strain 0 |s| f64::from(s.analog.strain);
    bridge_on 0 |s| f64::from(u8::from(s.driven));
    zero_counts 0 |s| s.zero_counts;
    brake_released 0 |s| f64::from(u8::from(s.brake_released));
}

/// The trace of one motor's run.
#[derive(Clone, Debug)]
pub struct Trace {
    /// The kind of motor.
    pub motor: MotorKind,
    every_ms: u32,
    values: Vec<f64>,
}

impl Trace {
    /// An empty trace with room for a run of `duration_ms`.
    #[must_use]
    pub fn new(motor: MotorKind, duration_ms: u32) -> Self {
        let every_ms = duration_ms.div_ceil(MAX_ROWS).max(1);
        let rows = (duration_ms / every_ms + 1) as usize;
        Self { motor, every_ms, values: Vec::with_capacity(rows * COLUMNS.len()) }
    }

    /// Records a tick, if it is one of those kept.
    pub fn record(&mut self, sample: &Sample) {
        if sample.ms.is_multiple_of(self.every_ms) {
            self.values.extend(COLUMNS.iter().map(|column| (column.get)(sample)));
        }
    }

    /// The rows, each as long as [`COLUMNS`].
    pub fn rows(&self) -> impl Iterator<Item = &[f64]> {
        self.values.chunks_exact(COLUMNS.len())
    }

    /// One column over time; empty for an unknown name.
    #[must_use]
    pub fn column(&self, name: &str) -> Vec<f64> {
        match COLUMNS.iter().position(|column| column.name == name) {
            Some(index) => self.rows().filter_map(|row| row.get(index).copied()).collect(),
            None => Vec::new(),
        }
    }
}

/// Writes traces as one CSV file: a header, then one row per tick. With several motors the second column is the motor's node
/// (1 link, 4 spread, 5 tip).
///
/// # Errors
/// Those of `out`.
pub fn write_csv(out: &mut impl Write, traces: &[Trace]) -> io::Result<()> {
    let several = traces.len() > 1;
    for (index, column) in COLUMNS.iter().enumerate() {
        let comma = if index == 0 { "" } else { "," };
        write!(out, "{comma}{}", column.name)?;
        if index == 0 && several {
            write!(out, ",motor")?;
        }
    }
    writeln!(out)?;
    for trace in traces {
        let motor = trace.motor.first_node();
        for row in trace.rows() {
            for (index, (value, column)) in row.iter().zip(COLUMNS).enumerate() {
                let comma = if index == 0 { "" } else { "," };
                write!(out, "{comma}{value:.*}", column.decimals)?;
                if index == 0 && several {
                    write!(out, ",{motor}")?;
                }
            }
            writeln!(out)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::{Options, run};
    use crate::scenario::Scenario;
    use hil_world::plant::Model;

    fn traces(motor: &str, duration_ms: u32) -> Vec<Trace> {
        let text = format!("name = 'x'\nabout = 'y'\nmotor = {motor}\nduration_ms = {duration_ms}");
        let scenario = Scenario::parse("x.toml", &text).expect("valid");
        let options = Options { seed: 1, model: Model::Averaged, trace: true };
        let runs = run(&scenario, &options).expect("valid").runs;
        runs.into_iter().filter_map(|run| run.trace).collect()
    }

    fn csv(traces: &[Trace]) -> Vec<String> {
        let mut csv = Vec::new();
        write_csv(&mut csv, traces).expect("memory is large enough");
        String::from_utf8(csv).expect("text").lines().map(str::to_owned).collect()
    }

    #[test]
    fn trace_has_a_row_per_tick_and_a_motor_column_for_several() {
        let one = csv(&traces("'tip'", 3));
        assert_eq!(one.len(), 1 + 4);
        assert!(one[0].starts_with("time_ms,mode,") && one[4].starts_with("3,0,"), "{one:?}");
        let several = csv(&traces("['link', 'spread', 'tip']", 1));
        assert!(several[0].starts_with("time_ms,motor,mode,"), "{several:?}");
        let starts: Vec<&str> = several[1..].iter().map(|row| row.get(..4).unwrap_or("")).collect();
        assert_eq!(starts, ["0,1,", "1,1,", "0,4,", "1,4,", "0,5,", "1,5,"]);
        for row in several.iter().chain(&one) {
            let columns = COLUMNS.len() + usize::from(several.contains(row));
            assert_eq!(row.split(',').count(), columns, "{row}");
        }
    }

    #[test]
    fn long_run_keeps_every_nth_tick() {
        let long = traces("'link'", 60_000);
        let times = long.first().map(|trace| trace.column("time_ms")).unwrap_or_default();
        assert_eq!((times.len(), times.get(1), times.last()), (20_001, Some(&3.0), Some(&60_000.0)));
    }
}
