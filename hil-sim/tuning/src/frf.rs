//! A table as a frequency response: which of its columns are frequency, magnitude and phase, by the names that analyzers give them.
//!
//! A name has words and a unit: `Channel 2 Magnitude (dB)`, `Trace 1: Gain: Phase [rad]`, `mag_db`. Of several channels the one counts whose
//! phase is there.

use std::f64::consts::TAU;

use num_complex::Complex64;
use traces::input::{BadInput, did_you_mean, shorten};
use traces::numbers::Numbers;

use super::response::Point;

/// The columns of a response.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Columns {
    hz: usize,
    hz_scale: f64,
    form: Form,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Form {
    /// Real and imaginary part.
    Parts(usize, usize),
    /// Magnitude and phase, with the radians of a unit of it.
    Polar { magnitude: usize, is_db: bool, phase: usize, rad: f64 },
}

impl Form {
    const fn column(self) -> usize {
        match self {
            Self::Parts(column, _) | Self::Polar { magnitude: column, .. } => column,
        }
    }

    fn value(self, table: &Numbers, row: usize) -> Result<Complex64, BadInput> {
        match self {
            Self::Parts(re, im) => Ok(Complex64::new(table.number(row, re)?, table.number(row, im)?)),
            Self::Polar { magnitude, is_db, phase, rad } => {
                let size = table.number(row, magnitude)?;
                if size < 0.0 && !is_db {
                    let expected = "a linear magnitude above 0; name it mag_db if it is in dB";
                    return Err(table.bad(row, magnitude, "negative", expected));
                }
                let size = if is_db { 10f64.powf(size / 20.0) } else { size };
                Ok(Complex64::from_polar(size, table.number(row, phase)? * rad))
            }
        }
    }
}

/// What a response must have.
pub(crate) const EXPECTED: &str = "freq_hz with re, im or mag, phase_deg (or mag_db, phase_deg)";

/// Names that `--columns` gives to columns.
pub const NAMES: [&str; 8] = ["freq_hz", "freq_rad_s", "re", "im", "mag", "mag_db", "phase_deg", "phase_rad"];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    Frequency,
    Real,
    Imaginary,
    Magnitude,
    Phase,
}

/// Units that are read.
const UNITS: [&str; 16] = [
    "hz", "khz", "mhz", "millihz", "rad/s", "db", "deg", "degree", "degrees", "°", "rad", "radians", "v/v",
    "abs", "linear", "ratio",
];

/// Words that make another quantity of a column, or another unit.
const OTHER: [&str; 9] = ["lag", "margin", "log", "log10", "rpm", "norm", "normalized", "order", "percent"];

/// A column's name in parts.
struct Name {
    role: Role,
    /// Of [`UNITS`], empty, or one that is not read.
    unit: String,
    /// The words that are neither: the channel.
    channel: Vec<String>,
}

impl Name {
    fn parse(text: &str) -> Option<Self> {
        // mHz and MHz differ in case alone.
        let lower = text.replace("mHz", "millihz").to_lowercase();
        let bracketed =
            lower.trim_end().strip_suffix([')', ']']).and_then(|rest| rest.rsplit_once(['(', '[']));
        let mut words: Vec<&str> = lower
            .split(|c: char| !c.is_alphanumeric() && c != '°' && c != '/')
            .filter(|word| !word.is_empty())
            .collect();
        let unit = words.last().copied().filter(|word| UNITS.contains(word));
        let mut unit = unit.unwrap_or_default().to_owned();
        words.truncate(words.len() - usize::from(!unit.is_empty()));
        let other =
            bracketed.map(|(_, unit)| unit.trim()).filter(|unit| !UNITS.contains(unit) && !unit.is_empty());
        if let Some(other) = other.or_else(|| words.iter().copied().find(|word| OTHER.contains(word))) {
            unit = other.to_owned();
        }
        // freq_rad_s
        if let [.., "rad", "s"] = words[..] {
            words.truncate(words.len() - 2);
            unit = "rad/s".to_owned();
        }
        // Of "Gain: Phase" the last word counts.
        let (at, role) = words.iter().enumerate().rev().find_map(|(at, word)| {
            let role = match *word {
                "frequency" | "freq" | "f" => Role::Frequency,
                "re" | "real" => Role::Real,
                "im" | "imag" | "imaginary" => Role::Imaginary,
                "magnitude" | "mag" | "gain" | "amplitude" | "ampl" => Role::Magnitude,
                "phase" | "arg" | "argument" => Role::Phase,
                _ => return None,
            };
            Some((at, role))
        })?;
        let is_channel = |(index, word): &(usize, &&str)| {
            *index != at && !["gain", "magnitude", "response"].contains(*word)
        };
        let channel =
            words.iter().enumerate().filter(is_channel).map(|(_, word)| (*word).to_owned()).collect();
        Some(Self { role, unit, channel })
    }
}

impl Columns {
    /// Finds the columns of a table. `given` are names of [`NAMES`] and the headers of the columns that they mean, which come first.
    ///
    /// # Errors
    /// A column that is missing, or several that may be meant.
    pub fn find(table: &Numbers, given: &[(String, String)]) -> Result<Self, BadInput> {
        let mut names: Vec<(usize, Name)> =
            table.names().enumerate().filter_map(|(at, name)| Some((at, Name::parse(name)?))).collect();
        for (name, header) in given {
            let at = table.need(&[header], &format!("a column for {name}, as --columns has it"))?;
            let parsed = Name::parse(name).filter(|_| NAMES.contains(&name.as_str()));
            let Some(parsed) = parsed else {
                return Err(BadInput::new("--columns", "names no part of a response")
                    .found(shorten(name))
                    .expected(NAMES.join(", "))
                    .next(
                        did_you_mean(name, NAMES.into_iter())
                            .unwrap_or_else(|| "use one of those".to_owned()),
                    ));
            };
            names.retain(|(other, of)| *other != at && of.role != parsed.role);
            names.push((at, parsed));
        }
        let of = |role: Role| names.iter().filter(move |(_, name)| name.role == role).collect::<Vec<_>>();
        let (hz, frequency) = one(table, &of(Role::Frequency), "freq_hz")?;
        let hz_scale = match frequency.unit.as_str() {
            "millihz" => 1e-3,
            "khz" => 1e3,
            "mhz" => 1e6,
            "rad/s" => 1.0 / TAU,
            _ => 1.0,
        };
        let chosen =
            |role: Role| given.iter().any(|(name, _)| Name::parse(name).is_some_and(|of| of.role == role));
        let is_polar_chosen = chosen(Role::Magnitude) || chosen(Role::Phase);
        let (real, imaginary) = (of(Role::Real), of(Role::Imaginary));
        let (magnitudes, phases) = (of(Role::Magnitude), of(Role::Phase));
        let mut forms = Vec::new();
        if !real.is_empty() && !imaginary.is_empty() && !is_polar_chosen
            || magnitudes.is_empty() && phases.is_empty()
        {
            forms.push(Form::Parts(one(table, &real, "re")?.0, one(table, &imaginary, "im")?.0));
        }
        match polar(table, &magnitudes, &phases) {
            Ok(found) => forms.extend(found),
            Err(error) if forms.is_empty() => return Err(error),
            Err(_) => {}
        }
        let columns = Self { hz, hz_scale, form: forms[0] };
        if !is_polar_chosen && !chosen(Role::Real) && !chosen(Role::Imaginary) {
            columns.agree(table, &forms[1..])?;
        }
        Ok(columns)
    }

    /// Refuses a table that says two things.
    fn agree(&self, table: &Numbers, others: &[Form]) -> Result<(), BadInput> {
        for other in others {
            let differs = |row: &usize| {
                let (Ok(own), Ok(beside)) = (self.form.value(table, *row), other.value(table, *row)) else {
                    return false;
                };
                (own - beside).norm() > 0.1 * own.norm().max(beside.norm())
            };
            // Small numbers may be rounded.
            let rows: Vec<usize> = (0..table.len()).filter(differs).collect();
            if 2 * rows.len() > table.len() {
                let (own, beside) = (self.form.column(), other.column());
                let problem = format!("says another response than {}", table.name(own));
                let name = if let Form::Polar { is_db: true, .. } = other { "mag_db" } else { "mag" };
                return Err(BadInput {
                    next: format!(
                        "find out which is right, and take that column out or choose this: --columns \"{name}={}\"",
                        table.name(beside)
                    ),
                    ..table.bad(rows[0], beside, &problem, "the same response in all columns")
                });
            }
        }
        Ok(())
    }

    /// The column of the frequency.
    #[must_use]
    pub const fn frequency(&self) -> usize {
        self.hz
    }

    /// The column that a value without magnitude or phase is in.
    #[must_use]
    pub const fn value(&self) -> usize {
        self.form.column()
    }

    /// The response of a row.
    ///
    /// # Errors
    /// A cell that is no number, or a linear magnitude below 0.
    pub fn point(&self, table: &Numbers, row: usize) -> Result<Point, BadInput> {
        let hz = table.number(row, self.hz)? * self.hz_scale;
        Ok(Point { hz, value: self.form.value(table, row)? })
    }

    /// Whether phases in degrees may be radians: they are all small, and go with the slope of the magnitude only as radians.
    #[must_use]
    pub fn doubt(&self, table: &Numbers, points: &[Point]) -> Option<String> {
        let Form::Polar { phase, rad, .. } = self.form else { return None };
        let degrees: Vec<f64> = (0..table.len()).filter_map(|row| table.number(row, phase).ok()).collect();
        let is_small = degrees.iter().all(|degrees| degrees.abs() <= 1.01 * TAU);
        if rad == 1.0 || !is_small {
            return None;
        }
        // A slope of n decades a decade has a phase of n·90° (Bode), and more for a delay.
        let slope = |pair: &[Point]| {
            (pair[1].value.norm() / pair[0].value.norm()).ln() / (pair[1].hz / pair[0].hz).ln()
        };
        let mut slopes: Vec<f64> = points.windows(2).map(slope).filter(|slope| slope.is_finite()).collect();
        slopes.sort_by(f64::total_cmp);
        let slope = slopes.get(slopes.len() / 2).copied()?;
        (slope.abs() >= 0.5).then(|| {
            format!(
                "{} is {:.2} at most, and the magnitude falls by {:.0} dB a decade, which goes with {:.0}°: if these are radians, name the \
                 column phase_rad",
                table.name(phase),
                degrees.iter().fold(0.0_f64, |most, degrees| most.max(degrees.abs())),
                -20.0 * slope,
                90.0 * slope
            )
        })
    }
}

/// Magnitude and phase: linear, and in dB.
fn polar(
    table: &Numbers,
    magnitudes: &[&(usize, Name)],
    phases: &[&(usize, Name)],
) -> Result<Vec<Form>, BadInput> {
    let (phase, angle) = one(table, phases, "phase_deg")?;
    let rad = if ["rad", "radians"].contains(&angle.unit.as_str()) { 1.0 } else { TAU / 360.0 };
    let own: Vec<_> = magnitudes.iter().copied().filter(|(_, name)| name.channel == angle.channel).collect();
    let own = if own.is_empty() { magnitudes.to_vec() } else { own };
    let (in_db, linear): (Vec<_>, Vec<_>) = own.into_iter().partition(|(_, name)| name.unit == "db");
    let form = |found: &[&(usize, Name)]| {
        let (magnitude, size) = one(table, found, "mag")?;
        Ok(Form::Polar { magnitude, is_db: size.unit == "db", phase, rad })
    };
    // Several columns in dB beside a linear one decide nothing.
    if linear.is_empty() {
        Ok(vec![form(&in_db)?])
    } else {
        Ok([form(&linear)?].into_iter().chain(form(&in_db).ok()).collect())
    }
}

/// The only column of a part.
fn one<'a>(table: &Numbers, found: &[&'a (usize, Name)], name: &str) -> Result<(usize, &'a Name), BadInput> {
    match found {
        [(at, parsed)] if !parsed.unit.is_empty() && !UNITS.contains(&parsed.unit.as_str()) => {
            let header = table.name(*at);
            Err(table.bad_file(
                format!("{header}: another unit or quantity than a response has"),
                shorten(&parsed.unit),
                "Hz, kHz, MHz, mHz or rad/s; dB or none; degrees or radians".to_owned(),
                &format!("convert the column, or say what it is: --columns \"{name}={header}\""),
            ))
        }
        [(at, parsed)] => Ok((*at, parsed)),
        [] => Err(table.need(&[name], EXPECTED).err().unwrap_or_else(|| {
            table.bad_file(
                "wrong columns".to_owned(),
                name.to_owned(),
                EXPECTED.to_owned(),
                "rename the columns",
            )
        })),
        several => {
            let headers: Vec<&str> = several.iter().map(|(at, _)| table.name(*at)).collect();
            Err(table.bad_file(
                format!("several columns may be {name}"),
                shorten(&headers.join(", ")),
                "one of them".to_owned(),
                &format!("choose it: --columns \"{name}={}\"", headers[0]),
            ))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(csv: &str) -> Numbers {
        Numbers::read("a.csv", &traces::csv::Reader::new(csv.into()).expect("a table")).expect("a table")
    }

    fn first(csv: &str, given: &[(&str, &str)]) -> Result<Point, BadInput> {
        let table = table(csv);
        let given: Vec<_> = given.iter().map(|(a, b)| ((*a).to_owned(), (*b).to_owned())).collect();
        Columns::find(&table, &given)?.point(&table, 0)
    }

    #[test]
    fn unit_that_is_not_read_is_refused() {
        let first = |header: &str| first(&format!("{header}\n10,1,-90\n20,0.5,-90\n"), &[]);
        let milli = first("Frequency (mHz),mag,phase_deg").expect("millihertz");
        assert!((milli.hz - 0.01).abs() < 1e-12, "{milli:?}");
        for (header, unit) in [
            ("Frequency (rpm),mag,phase_deg", "rpm"),
            ("Frequency (krad/s),mag,phase_deg", "krad/s"),
            ("Log Frequency (Hz),mag,phase_deg", "log"),
            ("freq_rpm,mag,phase_deg", "rpm"),
            ("freq_hz,Magnitude (dBm),phase_deg", "dbm"),
            ("freq_hz,mag_percent,phase_deg", "percent"),
            ("freq_hz,mag,Phase (turns)", "turns"),
            ("freq_hz,mag,Phase Lag (deg)", "lag"),
            ("freq_hz,mag,Phase Margin (deg)", "margin"),
        ] {
            let error = first(header).expect_err(header).to_string();
            assert!(error.contains(&format!("found:    {unit}\n")) && error.contains("--columns"), "{error}");
        }
    }

    /// −j/2 at 10 Hz, as analyzers and libraries write it.
    #[test]
    fn headers_of_analyzers_are_known() {
        for csv in [
            "freq_hz,re,im\n10,0,-0.5\n",
            "freq_hz,re,im,mag,phase_deg,noise\n10,0,-0.5,0.5,270,9\n",
            "freq_hz,re,im,mag,mag_db,phase_deg\n10,0,-0.5,0.5,-6.02,-90\n",
            "freq_hz,mag,phase_deg\n10,0.5,-90\n",
            "freq_hz;mag_db;phase_deg\n10;-6,0206;-90\n",
            "#Digilent\n\nFrequency (Hz),Channel 1 Magnitude (dB),Channel 2 Magnitude (dB),Channel 2 Phase (deg)\n10,0,-6.0206,-90\n",
            "Frequency (Hz);Trace 1: Gain: Magnitude (dB);Trace 1: Gain: Phase (°)\n10;-6.0206;-90\n",
            "Frequency[Hz],Gain[dB],Phase[deg]\n10,-6.0206,-90\n",
            "Frequency(Hz)\tAmplitude(dB)\tPhase(Deg)\n10\t-6.0206\t270\n",
            "Frequency (Hz),Magnitude (abs),Phase (deg)\n10,0.5,-90\n",
            "Freq,Mag,Phase_rad\n10,0.5,-1.5707963267948966\n",
            "freq_rad_s,mag,phase_deg\n62.83185307179586,0.5,-90\n",
            "f (kHz),gain (dB),phase (°)\n0.01,-6.0206,-90\n",
        ] {
            let point = first(csv, &[]).unwrap_or_else(|error| panic!("{csv}: {error}"));
            let error = (point.value - Complex64::new(0.0, -0.5)).norm();
            assert!((point.hz - 10.0).abs() < 1e-9 && error < 1e-5, "{csv}: {point:?}");
        }
    }

    #[test]
    fn columns_that_say_two_things_are_refused() {
        for (csv, names) in [
            ("freq_hz,re,im,mag,phase_deg\n10,0,-0.5,9,-90\n", ["mag", "re"]),
            ("freq_hz,re,im,mag,phase_deg\n10,0,-0.5,0.5,90\n", ["mag", "re"]),
            ("freq_hz,mag,mag_db,phase_deg\n10,0.5,-3.01,-90\n", ["mag_db", "mag"]),
        ] {
            let error = first(csv, &[]).expect_err(csv).to_string();
            let [beside, own] = names;
            let words = format!("a.csv:2: {beside}: says another response than {own}\n");
            assert!(
                error.starts_with(&words) && error.contains(&format!("--columns \"{beside}=")),
                "{error}"
            );
            first(csv, &[(beside, beside)]).expect("chosen");
        }
        let several = "freq_hz,mag,a_mag_db,b_mag_db,phase_deg\n10,0.5,0,1,-90\n";
        first(several, &[]).expect("the linear one");
        // Rounded so far that a small number is lost.
        let rounded =
            "freq_hz,mag,mag_db,phase_deg\n1,0.500,-6.02,-90\n2,0.200,-13.98,-90\n9,0.001,-65.2,-90\n";
        first(rounded, &[]).expect("one response");
    }

    #[test]
    fn several_candidates_are_named_and_chosen() {
        let csv = "Frequency (Hz),A Gain (dB),B Gain (dB),Phase (deg)\n10,0,-6.0206,-90\n";
        let error = first(csv, &[]).expect_err("two").to_string();
        assert!(
            error.contains("several columns may be mag") && error.contains("A Gain (dB), B Gain (dB)"),
            "{error}"
        );
        let point = first(csv, &[("mag_db", "B Gain (dB)")]).expect("chosen");
        assert!((point.value.norm() - 0.5).abs() < 1e-5, "{point:?}");
        let error = first(csv, &[("mgnitude", "B Gain (dB)")]).expect_err("no part").to_string();
        assert!(error.contains("--columns: names no part"), "{error}");
        let error = first(csv, &[("mag_db", "C Gain")]).expect_err("no column").to_string();
        assert!(error.contains("no column C Gain") && error.contains("A Gain (dB), B Gain (dB)"), "{error}");
    }

    #[test]
    fn radians_under_degrees_raise_a_doubt() {
        let integrator = |phase: &str| -> String {
            let rows: String = (1..30).map(|i| format!("{i},{},{phase}\n", 10.0 / f64::from(i))).collect();
            format!("freq_hz,mag,phase_deg\n{rows}")
        };
        let doubt = |csv: &str| {
            let table = table(csv);
            let columns = Columns::find(&table, &[]).expect("a response");
            let points: Vec<Point> =
                (0..table.len()).map(|row| columns.point(&table, row).expect("a point")).collect();
            columns.doubt(&table, &points)
        };
        let text = doubt(&integrator("-1.5707")).expect("a doubt");
        assert!(
            text.contains("20 dB a decade") && text.contains("-90°") && text.contains("phase_rad"),
            "{text}"
        );
        assert_eq!(doubt(&integrator("-90")), None);
        assert_eq!(doubt(&integrator("-1.5707").replace("phase_deg", "phase_rad")), None);
        let flat = (1..30).map(|i| format!("{i},1,-2\n")).collect::<String>();
        assert_eq!(doubt(&format!("freq_hz,mag,phase_deg\n{flat}")), None);
    }
}
