//! Figures that judge a run, taken from the true rotor, which the servo never sees.
//!
//! A *move* begins when the servo accepts a move, TC, TO, HI or a mode other than idle and its own. A new end
//! position during a move re-plans that move and begins no other. Its time zero is its first driven tick,
//! after the brake has released. Metrics of a move are those of the last one.

mod meter;

pub use meter::{Meter, Meters, Window};

use servo_core::EndReason;
use servo_core::guard::fault::Fault;
use servo_core::mode::Mode;

#[cfg(test)]
mod tests;

/// The figures of a run. Positions are of the true rotor, in hall counts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Metrics {
    /// Reason for the end of the last move.
    pub end_reason: Option<EndReason>,
    /// Time from the move's first driven tick to its end; none if it was cut short before it drove.
    pub end_ms: Option<f64>,
    /// Farthest position past E in the direction of travel since the move began, 0 if never past it; for a
    /// move to E only.
    pub overshoot_counts: Option<f64>,
    /// Distance from E 200 ms after the end.
    pub final_error_counts: Option<f64>,
    /// Root mean square distance from the set-point during the move (mode 5).
    pub tracking_rms_counts: Option<f64>,
    /// From the move's first driven tick until the rotor stays within a count of E; none if it does not.
    pub settling_ms: Option<f64>,
    /// From a tenth to nine tenths of the way to E.
    pub rise_ms: Option<f64>,
    /// Integral of the distance from E since the move's first driven tick, counts·s.
    pub iae: Option<f64>,
    /// The same, weighted with the time since then, counts·s².
    pub itae: Option<f64>,
    /// Speed a tick before the end of the last move.
    pub speed_at_end_counts_s: Option<f64>,
    /// Root mean square of the velocity about its mean, while the velocity set-point is constant.
    pub ripple_counts_s: Option<f64>,
    /// Mean velocity in that time.
    pub mean_velocity_counts_s: Option<f64>,
    /// Root mean square change of the torque from tick to tick while driven, 1/1024 of peak.
    pub chatter: Option<f64>,
    /// Heat in the winding.
    pub heat_j: f64,
    /// Largest applied torque, 1/1024 of peak.
    pub peak_torque: f64,
    /// Largest phase current at any instant, including the ripple of the switching.
    pub peak_current_a: f64,
    /// Highest winding temperature.
    pub peak_winding_c: f64,
    /// Distance from the held position at the end of the run, if one is held.
    pub hold_error_counts: Option<f64>,
    /// Largest distance from the held position while holding.
    pub peak_hold_error_counts: Option<f64>,
    /// Faults in the order in which they latched.
    pub faults: Vec<Fault>,
    /// Simulated time.
    pub sim_s: f64,
    /// From the last hall count to the end of the move.
    pub end_after_last_count_ms: Option<f64>,
    /// Moves that ended.
    pub ends: u32,
    /// Commands that the servo refused.
    pub refusals: u32,
    /// Hall glitches reported.
    pub glitches: u32,
    /// Whether HI has found zero.
    pub homed: bool,
    /// Mode at the end of the run.
    pub mode: Mode,
    /// Position at the end of the run.
    pub position_counts: f64,
    /// Velocity at the end of the run, counts/s.
    pub velocity_counts_s: f64,
    /// Largest speed of the run, counts/s.
    pub peak_speed_counts_s: f64,
    /// |P as read − true position| at the end of the run: up to half a count plus the halls' placement error if no count was lost.
    pub count_error_counts: f64,
    /// BP of the last breakaway.
    pub breakaway_counts: Option<f64>,
}

impl Metrics {
    /// `end_ms` of a move that arrived.
    #[must_use]
    pub fn arrival_ms(&self) -> Option<f64> {
        self.end_ms.filter(|_| self.end_reason == Some(EndReason::Arrived))
    }

    /// The worse of two motors' figures, for a scenario with several motors.
    #[must_use]
    pub fn worst(self, other: Self) -> Self {
        let most = |a: Option<f64>, b: Option<f64>| a.zip(b).map_or(a.or(b), |(a, b)| Some(a.max(b)));
        let same = self.end_reason == other.end_reason;
        let mut faults = self.faults;
        faults.extend(other.faults);
        Self {
            end_reason: self.end_reason.filter(|_| same),
            end_ms: most(self.end_ms, other.end_ms),
            overshoot_counts: most(self.overshoot_counts, other.overshoot_counts),
            final_error_counts: most(self.final_error_counts, other.final_error_counts),
            tracking_rms_counts: most(self.tracking_rms_counts, other.tracking_rms_counts),
            settling_ms: most(self.settling_ms, other.settling_ms),
            rise_ms: most(self.rise_ms, other.rise_ms),
            iae: most(self.iae, other.iae),
            itae: most(self.itae, other.itae),
            speed_at_end_counts_s: most(self.speed_at_end_counts_s, other.speed_at_end_counts_s),
            ripple_counts_s: most(self.ripple_counts_s, other.ripple_counts_s),
            mean_velocity_counts_s: most(self.mean_velocity_counts_s, other.mean_velocity_counts_s),
            chatter: most(self.chatter, other.chatter),
            heat_j: self.heat_j.max(other.heat_j),
            peak_torque: self.peak_torque.max(other.peak_torque),
            peak_current_a: self.peak_current_a.max(other.peak_current_a),
            peak_winding_c: self.peak_winding_c.max(other.peak_winding_c),
            hold_error_counts: most(self.hold_error_counts, other.hold_error_counts),
            peak_hold_error_counts: most(self.peak_hold_error_counts, other.peak_hold_error_counts),
            faults,
            sim_s: self.sim_s + other.sim_s,
            end_after_last_count_ms: most(self.end_after_last_count_ms, other.end_after_last_count_ms),
            ends: self.ends + other.ends,
            refusals: self.refusals + other.refusals,
            glitches: self.glitches + other.glitches,
            homed: self.homed && other.homed,
            mode: other.mode,
            position_counts: larger(self.position_counts, other.position_counts),
            velocity_counts_s: larger(self.velocity_counts_s, other.velocity_counts_s),
            peak_speed_counts_s: self.peak_speed_counts_s.max(other.peak_speed_counts_s),
            count_error_counts: self.count_error_counts.max(other.count_error_counts),
            breakaway_counts: most(self.breakaway_counts, other.breakaway_counts),
        }
    }
}

fn larger(a: f64, b: f64) -> f64 {
    if a.abs() >= b.abs() { a } else { b }
}

/// Name of an end reason.
#[must_use]
pub const fn end_word(reason: EndReason) -> &'static str {
    match reason {
        EndReason::Arrived => "arrived",
        EndReason::Stalled => "stalled",
        EndReason::Aborted => "aborted",
        EndReason::Strain => "strain",
        EndReason::Breakaway => "breakaway",
        EndReason::Fault => "fault",
    }
}

/// Name of a fault.
#[must_use]
pub const fn fault_word(fault: Fault) -> &'static str {
    match fault {
        Fault::Halls => "halls",
        Fault::OverCurrent => "over-current",
        Fault::OverTemperature => "over-temperature",
        Fault::OverVoltage => "over-voltage",
        Fault::UnderVoltage => "under-voltage",
        Fault::Bridge => "bridge",
        Fault::HostLost => "host-lost",
        Fault::Jammed => "jammed",
        Fault::Wiring => "wiring",
    }
}

/// Name of a mode.
#[must_use]
pub(crate) const fn mode_word(mode: Mode) -> &'static str {
    match mode {
        Mode::Idle => "idle",
        Mode::Torque => "torque",
        Mode::Pid => "pid",
        Mode::Velocity => "velocity",
        Mode::Trapezoidal => "trapezoidal",
    }
}

/// A metric's value.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A finite number.
    Number(f64),
    /// A word.
    Text(String),
    /// The run has no such value: no move, no end, not held.
    Absent,
}

impl From<f64> for Value {
    fn from(value: f64) -> Self {
        if value.is_finite() { Self::Number(value) } else { Self::Absent }
    }
}

impl From<u32> for Value {
    fn from(value: u32) -> Self {
        Self::Number(f64::from(value))
    }
}

impl From<Option<f64>> for Value {
    fn from(value: Option<f64>) -> Self {
        value.map_or(Self::Absent, Self::from)
    }
}

impl From<&str> for Value {
    fn from(value: &str) -> Self {
        Self::Text(value.to_owned())
    }
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(value) if *value == value.trunc() => write!(f, "{value:.0}"),
            Self::Number(value) => write!(f, "{value:.3}"),
            Self::Text(text) => f.write_str(text),
            Self::Absent => f.write_str("–"),
        }
    }
}

const END_WORDS: &[&str] = &[
    NONE,
    end_word(EndReason::Arrived),
    end_word(EndReason::Stalled),
    end_word(EndReason::Aborted),
    end_word(EndReason::Strain),
    end_word(EndReason::Breakaway),
    end_word(EndReason::Fault),
];

const FAULT_WORDS: &[&str] = &[
    NONE,
    fault_word(Fault::Halls),
    fault_word(Fault::OverCurrent),
    fault_word(Fault::OverTemperature),
    fault_word(Fault::OverVoltage),
    fault_word(Fault::UnderVoltage),
    fault_word(Fault::Bridge),
    fault_word(Fault::HostLost),
    fault_word(Fault::Jammed),
];

const MODE_WORDS: &[&str] = &[
    mode_word(Mode::Idle),
    mode_word(Mode::Torque),
    mode_word(Mode::Pid),
    mode_word(Mode::Velocity),
    mode_word(Mode::Trapezoidal),
];

const NONE: &str = "none";

const AND: &str = ", ";

/// One metric by name.
pub struct Metric {
    /// Name as in an expectation; its end is the unit, except for integrals and torques.
    pub name: &'static str,
    /// Explanation for the report.
    pub about: &'static str,
    /// Reads the value.
    pub get: fn(&Metrics) -> Value,
    /// Possible texts; empty for a number.
    pub words: &'static [&'static str],
}

impl std::fmt::Debug for Metric {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name)
    }
}

macro_rules! metric {
    ($name:ident, $about:literal) => {
        Metric { name: stringify!($name), about: $about, get: |m| m.$name.into(), words: &[] }
    };
    ($name:ident, $about:literal, number $get:expr) => {
        Metric { name: stringify!($name), about: $about, get: $get, words: &[] }
    };
    ($name:ident, $about:literal, $words:ident $get:expr) => {
        Metric { name: stringify!($name), about: $about, get: $get, words: $words }
    };
}

impl Metric {
    /// Whether its value is a text.
    #[must_use]
    pub fn is_word(&self) -> bool {
        !self.words.is_empty()
    }

    /// Its unit: the end of its name, but for integrals and torques; empty for a word.
    #[must_use]
    pub fn unit(&self) -> &'static str {
        const ENDS: [(&str, &str); 8] = [
            ("_counts_s", "counts/s"),
            ("_counts", "counts"),
            ("_ms", "ms"),
            ("_s", "s"),
            ("_a", "A"),
            ("_c", "C"),
            ("_j", "J"),
            ("", "1"),
        ];
        match self.name {
            "iae" => "counts s",
            "itae" => "counts s^2",
            "chatter" | "peak_torque" => "1/1024 of peak",
            _ if self.is_word() => "",
            name => ENDS.iter().find(|(end, _)| name.ends_with(end)).map_or("1", |(_, unit)| unit),
        }
    }

    /// Whether its value can be that text: one of its names, or faults in the order in which they latch.
    #[must_use]
    pub fn can_be(&self, text: &str) -> bool {
        let several =
            self.name == "faults" && text.split(AND).all(|word| word != NONE && self.words.contains(&word));
        several || self.words.contains(&text)
    }
}

/// Every metric that an expectation can name.
pub const METRICS: [Metric; 33] = [
    metric!(
        end_reason,
        "why the last move ended",
        END_WORDS | m | m.end_reason.map_or(NONE, end_word).into()
    ),
    metric!(end_ms, "from the move's first driven tick to its end"),
    metric!(arrival_ms, "the same, of a move that arrived", number | m | m.arrival_ms().into()),
    metric!(overshoot_counts, "true rotor past the end position"),
    metric!(final_error_counts, "distance from the end position 200 ms after the end"),
    metric!(tracking_rms_counts, "RMS distance from the set-point during the move"),
    metric!(settling_ms, "until the rotor stays within a count of the end position"),
    metric!(rise_ms, "from a tenth to nine tenths of the way"),
    metric!(iae, "integral of the distance from the end position, counts s"),
    metric!(itae, "the same, weighted with time, counts s^2"),
    metric!(speed_at_end_counts_s, "true speed a tick before the end of the move"),
    metric!(ripple_counts_s, "RMS of the true velocity about its mean at a constant velocity set-point"),
    metric!(mean_velocity_counts_s, "mean of the true velocity at a constant velocity set-point"),
    metric!(chatter, "RMS change of the torque per tick, 1/1024 of peak"),
    metric!(heat_j, "heat in the winding"),
    metric!(peak_torque, "largest applied torque, 1/1024 of peak"),
    metric!(peak_current_a, "largest phase current at any instant"),
    metric!(peak_winding_c, "highest winding temperature"),
    metric!(hold_error_counts, "distance from the held position at the end of the run"),
    metric!(peak_hold_error_counts, "largest distance from the held position while holding"),
    metric!(
        faults,
        "faults that latched",
        FAULT_WORDS
            | m
            | match m.faults.as_slice() {
                [] => NONE.into(),
                faults => Value::Text(faults.iter().map(|f| fault_word(*f)).collect::<Vec<_>>().join(AND)),
            }
    ),
    metric!(end_after_last_count_ms, "from the last hall count to the end of the move"),
    metric!(ends, "moves that ended"),
    metric!(refusals, "commands that were refused"),
    metric!(glitches, "hall glitches reported"),
    metric!(homed, "1 if HI has found zero", number | m | f64::from(u8::from(m.homed)).into()),
    metric!(mode, "mode at the end of the run", MODE_WORDS | m | mode_word(m.mode).into()),
    metric!(position_counts, "true position at the end of the run"),
    metric!(velocity_counts_s, "true velocity at the end of the run"),
    metric!(peak_speed_counts_s, "largest true speed"),
    metric!(count_error_counts, "|P as read − true position| at the end of the run"),
    metric!(breakaway_counts, "where the link broke away (BP)"),
    metric!(sim_s, "simulated time"),
];

/// The metric of that name.
#[must_use]
pub fn find(name: &str) -> Option<&'static Metric> {
    const ROWS: &[Metric] = &METRICS;
    ROWS.iter().find(|metric| metric.name == name)
}
