//! A motor that a file describes by its data sheet: the plant that the simulator computes, and the properties that its board gets.
//!
//! ```
//! let file = hil_experiment::motor_file::MotorFile::parse("my-motor.toml", r#"
//!     [motor]
//!     name = "EC 45 flat 50 W"
//!     r_ohm = 0.942          # line to line, at 25 °C
//!     kt_n_m_a = 0.036       # also the EMF in V·s/rad
//!     pole_pairs = 8
//!     j_kg_m2 = 1.35e-5
//!     peak_a = 10.2
//!
//!     [joint]                # optional, as every key in it
//!     load_j_kg_m2 = 2e-6    # at the motor
//!     min_count = 0
//!     max_count = 400
//! "#).unwrap();
//! assert_eq!(file.motor().poles, 16);
//! ```
//!
//! What a file leaves out has the defaults of [`MotorTable`] and [`JointTable`].

use std::path::Path;

use boot::Chip;
use serde::Deserialize;
use servo_core::motor::{BoardFigures, Motor};
use servo_core::{Command, Config};
use tater_wire::property::Range;
use tater_wire::{MotorKind, Property};
use toml::Spanned;

use crate::properties::{self, PROPERTIES};
use crate::scenario::{Action, Order, Scenario};
use crate::toml_text::Source;
use hil_world::board::SimBoard;
use hil_world::node::store;
use hil_world::plant::PlantParams;
use traces::input::BadInput;

/// Size limit, bytes; such a file has half a kilobyte.
const MAX_FILE_BYTES: u64 = 1 << 16;

/// Bandwidth of the position loop, 0.1 Hz: KBW of the board.
const BANDWIDTH: u16 = 166;

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    motor: Spanned<MotorTable>,
    #[serde(default)]
    joint: Option<Spanned<JointTable>>,
}

/// `[motor]`: the figures of a data sheet.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotorTable {
    /// Its name; default: that of the file.
    #[serde(default)]
    pub name: Option<String>,
    /// Resistance line to line at 25 °C, Ω.
    pub r_ohm: f64,
    /// Inductance line to line, mH; default: a third of a millisecond times the resistance.
    #[serde(default)]
    pub l_mh: Option<f64>,
    /// Torque constant, N·m/A, which is the EMF in V·s/rad.
    pub kt_n_m_a: f64,
    /// Pole pairs.
    pub pole_pairs: u8,
    /// Inertia of the rotor, kg·m².
    pub j_kg_m2: f64,
    /// Coulomb friction, N·m; default: 1 % of the peak torque.
    #[serde(default)]
    pub coulomb_n_m: Option<f64>,
    /// Friction at rest, N·m; default: a third above Coulomb's.
    #[serde(default)]
    pub static_n_m: Option<f64>,
    /// Viscous friction, N·m·s/rad; default: none.
    #[serde(default)]
    pub viscous_n_m_s: f64,
    /// Peak current of a phase, A.
    pub peak_a: f64,
    /// Highest temperature of the winding, °C; default: 130, insulation class B.
    #[serde(default)]
    pub max_winding_c: Option<f64>,
    /// Heat capacity of the winding, J/K; default: peak current heats it by 24 K/s, as the hand's.
    #[serde(default)]
    pub winding_j_k: Option<f64>,
    /// Thermal resistance from winding to housing, K/W; default: 15 s over the heat capacity.
    #[serde(default)]
    pub winding_housing_k_w: Option<f64>,
    /// Nominal voltage of the supply, V; default: 24.
    #[serde(default)]
    pub volts: Option<f64>,
}

/// `[joint]`: what the motor drives.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointTable {
    /// Motor turns per joint turn; default: 1.
    #[serde(default)]
    pub gear_ratio: Option<f64>,
    /// Inertia of the load at the motor, kg·m²; default: none.
    #[serde(default)]
    pub load_j_kg_m2: f64,
    /// Lowest whole hall count; default: that of the kind of motor in its place.
    #[serde(default)]
    pub min_count: Option<i16>,
    /// Highest whole hall count; default: that of the kind of motor in its place.
    #[serde(default)]
    pub max_count: Option<i16>,
    /// Lead angle of a worm, degrees; default: 0, no worm.
    #[serde(default)]
    pub worm_lead_deg: f64,
    /// Free play of the gear, counts; default: none.
    #[serde(default)]
    pub backlash_counts: f64,
    /// Stiffness of the stops at the motor, N·m/rad; default: peak torque dents them by a tenth of a count.
    #[serde(default)]
    pub stop_stiffness_n_m_rad: Option<f64>,
}

/// A described motor that the hand's board can drive.
#[derive(Clone, Debug)]
pub struct MotorFile {
    name: String,
    path: String,
    text: String,
    motor: Motor,
    table: MotorTable,
    joint: JointTable,
}

impl MotorFile {
    /// Reads a file.
    ///
    /// # Errors
    /// It cannot be read, is no description of a motor, or one that the hand's board cannot drive; with the reason.
    pub fn read(path: &Path) -> Result<Self, BadInput> {
        let shown = path.display().to_string();
        let bad = |problem: &str, found: String| {
            BadInput::new(shown.clone(), problem)
                .found(found)
                .expected("a TOML file with a table [motor]")
                .next("give --motor link, spread or tip, or the path of such a file")
        };
        let meta = path
            .metadata()
            .map_err(|e| bad("no motor and no file of this name can be read", e.to_string()))?;
        if !meta.is_file() || meta.len() > MAX_FILE_BYTES {
            return Err(bad("this is no description of a motor", format!("{} bytes", meta.len())));
        }
        let text = std::fs::read_to_string(path).map_err(|e| bad("cannot be read", e.to_string()))?;
        Self::parse(&shown, &text)
    }

    /// Parses a file's text; errors name it `file`.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn parse(file: &str, text: &str) -> Result<Self, BadInput> {
        let source = Source { file, text };
        let parsed: File = toml::from_str(text).map_err(|e| {
            let error = source.reader_error(&e);
            if error.problem.ends_with("is missing") {
                let next = "add it from the motor's data sheet; docs/motor.md names every key".to_owned();
                return BadInput { next, ..error };
            }
            error
        })?;
        let span = parsed.motor.span();
        let mut table = parsed.motor.into_inner();
        let joint = parsed.joint.map(Spanned::into_inner).unwrap_or_default();
        check(source, span.clone(), &table, &joint)?;
        let peak_n_m = table.kt_n_m_a * table.peak_a;
        let coulomb = *table.coulomb_n_m.get_or_insert(0.01 * peak_n_m);
        table.static_n_m.get_or_insert(coulomb * 4.0 / 3.0);
        table.l_mh.get_or_insert(table.r_ohm / 3.0);
        table.max_winding_c.get_or_insert(130.0);
        table.volts.get_or_insert(24.0);
        let heat = *table.winding_j_k.get_or_insert(table.r_ohm * table.peak_a * table.peak_a / 24.0);
        table.winding_housing_k_w.get_or_insert(15.0 / heat);
        let motor = described(&table, &joint);
        if let Err(unfit) = motor.check(&BoardFigures::TATER) {
            return Err(BadInput {
                found: figures(&motor),
                ..source.error(
                    span,
                    format!("the hand's board cannot drive this motor: {}", unfit.text()),
                    "a motor within the limits of docs/motor.md",
                    "check the figures against the data sheet: resistance and torque constant are line to line, the peak current is a phase's",
                )
            });
        }
        let stem = Path::new(file)
            .file_stem()
            .map_or_else(|| file.to_owned(), |stem| stem.to_string_lossy().into_owned());
        let name = table.name.clone().unwrap_or(stem);
        Ok(Self { name, path: file.to_owned(), text: text.to_owned(), motor, table, joint })
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The path, as it was given.
    #[must_use]
    pub fn path(&self) -> &str {
        &self.path
    }

    /// The file's text.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The description that the board gets.
    #[must_use]
    pub const fn motor(&self) -> &Motor {
        &self.motor
    }

    /// The joint's range, in the place of a kind of motor.
    #[must_use]
    pub fn range(&self, kind: MotorKind) -> Range {
        let Range { low, high } = kind.range();
        Range { low: self.joint.min_count.unwrap_or(low), high: self.joint.max_count.unwrap_or(high) }
    }

    /// A place of a scenario that is made for a kind of motor: its ends are the joint's, and nothing between lies beyond them.
    #[must_use]
    pub fn place(&self, kind: MotorKind, counts: f64) -> f64 {
        let (old, new) = (kind.range(), self.range(kind));
        let (low, high) = (f64::from(old.low), f64::from(old.high));
        if counts <= low {
            counts - low + f64::from(new.low)
        } else if counts >= high {
            counts - high + f64::from(new.high)
        } else {
            counts.clamp(f64::from(new.low), f64::from(new.high))
        }
    }

    /// The plant in the place of a kind of motor, whose stops are at `plant`'s.
    #[must_use]
    pub fn plant(&self, kind: MotorKind, plant: &PlantParams) -> PlantParams {
        let (motor, joint) = (&self.table, &self.joint);
        let peak_n_m = motor.kt_n_m_a * motor.peak_a;
        let j_kg_m2 = motor.j_kg_m2 + joint.load_j_kg_m2;
        let heat = motor.winding_j_k.unwrap_or(plant.winding_j_k);
        let housing = motor.winding_housing_k_w.unwrap_or(plant.winding_housing_k_w);
        let described = PlantParams {
            pole_pairs: motor.pole_pairs,
            r_ohm: motor.r_ohm,
            l_mh: motor.l_mh.unwrap_or(plant.l_mh),
            ke_v_s: motor.kt_n_m_a,
            j_kg_m2,
            coulomb_n_m: motor.coulomb_n_m.unwrap_or_default(),
            static_n_m: motor.static_n_m.unwrap_or_default(),
            // 0.3 % of the peak torque, as the hand's.
            cogging_n_m: 0.003 * peak_n_m,
            viscous_n_m_s: motor.viscous_n_m_s,
            bus_v: motor.volts.unwrap_or(plant.bus_v),
            gear_ratio: joint.gear_ratio.unwrap_or(1.0),
            backlash_counts: joint.backlash_counts,
            gear_rad_n_m: 0.0,
            worm_lead_deg: joint.worm_lead_deg,
            worm_friction: plant.worm_friction.max(libm::tan(joint.worm_lead_deg.to_radians()) + 0.0025),
            brake_n_m: if plant.brake_n_m > 0.0 { 3.0 * peak_n_m } else { 0.0 },
            min_count: self.place(kind, plant.min_count),
            max_count: self.place(kind, plant.max_count),
            winding_j_k: heat,
            winding_housing_k_w: housing,
            // As many times the winding's as the hand's.
            housing_j_k: 6.0 * heat,
            housing_ambient_k_w: 4.0 * housing,
            ..plant.clone()
        };
        let stiffness = joint.stop_stiffness_n_m_rad.unwrap_or(peak_n_m / (0.1 * described.rad_per_count()));
        PlantParams {
            stop_stiffness_n_m_rad: stiffness,
            // Half of critical.
            stop_damping_n_m_s: (j_kg_m2 * stiffness).sqrt(),
            ..described
        }
    }

    /// Stores the description in a board that drives it in the place of a kind of motor, as SETs and a SAVE before its last power-off do.
    pub fn store(&self, kind: MotorKind, board: &mut SimBoard) {
        let Range { low, high } = self.range(kind);
        let defaults = properties::defaults(kind);
        let config = self.config(&defaults);
        let changed = PROPERTIES.iter().filter(|row| row.get(&config) != row.get(&defaults));
        let values = changed.map(|row| (row.property, row.get(&config)));
        let ends = [(Property::JLO, i64::from(low)), (Property::JHI, i64::from(high))];
        for (property, value) in values.chain(ends) {
            store(board.flash(), property, value);
        }
    }

    /// The properties of its board, where `config` are those of another motor.
    #[must_use]
    pub fn config(&self, config: &Config) -> Config {
        Config { motor: self.motor, kbw: BANDWIDTH, ..*config }
    }
}

impl Scenario {
    /// Puts the motor of a file in the place of each of the scenario's: its plant, its properties, and its joint's ends where the scenario goes
    /// to the ends of its own.
    ///
    /// # Errors
    /// A figure of the plant out of the simulator's range.
    pub fn take_motor(&mut self, file: &MotorFile) -> Result<(), BadInput> {
        let mut next = self.clone();
        let Some(kind) = next.cases.first().map(|case| case.motor) else { return Ok(()) };
        for case in &mut next.cases {
            case.plant = file.plant(case.motor, &case.plant);
            case.config = file.config(&case.config);
            case.range = Some(file.range(case.motor));
        }
        let place = |counts: f64| file.place(kind, counts);
        next.initial.position_counts = place(next.initial.position_counts);
        for object in &mut next.objects {
            object.from_count = place(object.from_count);
        }
        for timed in &mut next.timeline {
            if let Action::Order(Order::Command(
                Command::Move(counts) | Command::End(counts) | Command::Position(counts),
            )) = &mut timed.action
            {
                *counts = place(f64::from(*counts)).round() as i32;
            }
        }
        next.check_figures().map_err(|e| {
            BadInput::new(file.path.clone(), format!("{} is out of the simulator's range", e.field))
                .found(e.found.to_string())
                .expected(e.expected.clone())
                .next("give a figure in this range")
        })?;
        next.arguments.push_str(&format!(" --motor {}", file.path));
        *self = next;
        Ok(())
    }
}

/// The board's description of a table whose defaults are in it.
fn described(table: &MotorTable, joint: &JointTable) -> Motor {
    let whole = |value: f64| value.round().clamp(0.0, 4e9) as u32;
    let short = |value: f64| value.round().clamp(0.0, 65_535.0) as u16;
    let units = |n_m: Option<f64>| short(n_m.unwrap_or_default() * 1024.0 / (table.kt_n_m_a * table.peak_a));
    let mut motor = Motor {
        poles: table.pole_pairs.saturating_mul(2),
        mr: whole(1e3 * table.r_ohm),
        mpk: short(1e3 * table.peak_a),
        mvn: short(10.0 * table.volts.unwrap_or_default()),
        mwx: short(10.0 * table.max_winding_c.unwrap_or_default()),
        mwj: short(100.0 * table.winding_j_k.unwrap_or_default()).max(1),
        mwr: short(100.0 * table.winding_housing_k_w.unwrap_or_default()).max(1),
        mfc: units(table.coulomb_n_m),
        mfs: units(table.static_n_m),
        ..Motor::HAND
    };
    motor.set_mkt(whole(1e6 * table.kt_n_m_a));
    motor.set_mj(whole(1e11 * (table.j_kg_m2 + joint.load_j_kg_m2)));
    motor.set_ml(whole(1e4 * table.l_mh.unwrap_or_default()));
    motor
}

/// The figures by which a board judges.
fn figures(motor: &Motor) -> String {
    let full_v = f64::from(motor.full_mv()) / 1e3;
    format!(
        "supply over R*peak {:.2}, R*J/Kt^2 {:.2} ms, {} counts/s without load, {:.1} K/s at peak current, L/R {:.2} ms",
        f64::from(motor.mvn) / 10.0 / full_v,
        65_536e3 / (f64::from(motor.mka) * f64::from(motor.mke)),
        motor.no_load(),
        f64::from(motor.peak_mw()) / (10.0 * f64::from(motor.mwj)),
        f64::from(motor.mte) / 1e3,
    )
}

/// Name, value, range and unit of each figure: what the board's properties and the simulator take.
fn rows(table: &MotorTable, joint: &JointTable) -> [(&'static str, Option<f64>, f64, f64, &'static str); 18] {
    [
        ("r_ohm", Some(table.r_ohm), 0.02, 1000.0, "Ohm"),
        ("l_mh", table.l_mh, 0.001, 1000.0, "mH"),
        ("kt_n_m_a", Some(table.kt_n_m_a), 1e-4, 4.0, "N m/A"),
        ("pole_pairs", Some(f64::from(table.pole_pairs)), 2.0, 20.0, "pole pairs"),
        ("j_kg_m2", Some(table.j_kg_m2), 1e-9, 0.02, "kg m2"),
        ("coulomb_n_m", table.coulomb_n_m, 0.0, 10.0, "N m"),
        ("static_n_m", table.static_n_m, 0.0, 10.0, "N m"),
        ("viscous_n_m_s", Some(table.viscous_n_m_s), 0.0, 0.01, "N m s/rad"),
        ("peak_a", Some(table.peak_a), 0.05, 30.0, "A"),
        ("max_winding_c", table.max_winding_c, 60.0, 250.0, "C"),
        ("winding_j_k", table.winding_j_k, 0.1, 655.0, "J/K"),
        ("winding_housing_k_w", table.winding_housing_k_w, 0.01, 655.0, "K/W"),
        ("volts", table.volts, 12.0, 48.0, "V"),
        ("gear_ratio", joint.gear_ratio, 1.0, 1000.0, "turns"),
        ("load_j_kg_m2", Some(joint.load_j_kg_m2), 0.0, 0.02, "kg m2"),
        ("worm_lead_deg", Some(joint.worm_lead_deg), 0.0, 26.0, "degrees"),
        ("backlash_counts", Some(joint.backlash_counts), 0.0, 20.0, "counts"),
        ("stop_stiffness_n_m_rad", joint.stop_stiffness_n_m_rad, 0.1, 1e5, "N m/rad"),
    ]
}

/// Checks each figure alone, and those that go together.
fn check(
    source: Source<'_>,
    table_at: std::ops::Range<usize>,
    table: &MotorTable,
    joint: &JointTable,
) -> Result<(), BadInput> {
    let bad = |name: &str, found: f64, expected: String| {
        // The key may be in either table.
        let at = source.field(table_at.clone(), name);
        let at = if at == table_at { source.field(0..source.text.len(), name) } else { at };
        let error = source.error(
            at,
            format!("{name} is out of range"),
            expected,
            "correct it from the motor's data sheet",
        );
        Err(BadInput { found: format!("{name} = {found}"), ..error })
    };
    for (name, value, low, high, unit) in rows(table, joint) {
        if let Some(value) = value
            && !(low..=high).contains(&value)
        {
            return bad(name, value, format!("{low} to {high} {unit}"));
        }
    }
    if let (Some(coulomb), Some(at_rest)) = (table.coulomb_n_m, table.static_n_m)
        && at_rest < coulomb
    {
        return bad("static_n_m", at_rest, format!("at least coulomb_n_m, {coulomb}"));
    }
    let (low, high) = (joint.min_count, joint.max_count);
    let wrong = |count: i16| !(-30_000..=30_000).contains(&count);
    if let Some(count) = low.into_iter().chain(high).find(|count| wrong(*count)) {
        return bad("max_count", f64::from(count), "-30000 to 30000 counts".to_owned());
    }
    match (low, high) {
        (Some(low), Some(high)) if high <= low => {
            bad("max_count", f64::from(high), format!("above min_count, {low}"))
        }
        (Some(_), None) | (None, Some(_)) => {
            let error = source.error(
                table_at,
                "[joint] has one end",
                "min_count and max_count",
                "give both, or none",
            );
            Err(BadInput { found: "one of them".to_owned(), ..error })
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use servo_core::motor::Unfit;

    const EC45: &str = "[motor]\nr_ohm = 0.942\nl_mh = 0.363\nkt_n_m_a = 0.036\npole_pairs = 8\nj_kg_m2 = 1.35e-5\npeak_a = 10.2\n";

    fn parse(text: &str) -> Result<MotorFile, String> {
        MotorFile::parse("my/ec45.toml", text).map_err(|bad| bad.to_string())
    }

    /// K: 0.036 V·s/rad over 48/2π counts a radian and 9.608 V; τ: R·J/Kt² = 9.81 ms.
    #[test]
    fn board_gets_what_the_data_sheet_says() {
        let file = parse(EC45).expect("a motor");
        let motor = *file.motor();
        assert_eq!(
            (file.name(), motor.poles, motor.mr, motor.mpk, motor.mvn),
            ("ec45", 16, 942, 10_200, 240)
        );
        assert_eq!((motor.full_mv(), motor.mkt(), motor.mte), (9610, 36_005, 385));
        let tau_ms = 65_536e3 / (f64::from(motor.mka) * f64::from(motor.mke));
        assert!((tau_ms / 9.812 - 1.0).abs() < 0.002, "{tau_ms}");
        // 1 % of the peak torque, and a third more.
        assert_eq!((motor.mfc, motor.mfs), (10, 14));
    }

    #[test]
    fn hands_motor_as_a_file_is_the_hands_motor() {
        let text = "[motor]\nr_ohm = 2.405\nl_mh = 0.8\nkt_n_m_a = 0.0651\npole_pairs = 3\nj_kg_m2 = 2e-5\ncoulomb_n_m = 0.03\n\
                    static_n_m = 0.04\npeak_a = 9.98\nwinding_j_k = 10\nwinding_housing_k_w = 1.5\n";
        assert_eq!(*parse(text).expect("a motor").motor(), Motor::HAND);
    }

    #[test]
    fn bad_files_name_line_field_and_what_is_right() {
        let with = |line: &str| format!("{EC45}{line}\n");
        for (text, expected) in [
            (EC45.replace("peak_a = 10.2\n", ""), ["peak_a is missing", "docs/motor.md"]),
            (EC45.replace("0.942", "nan"), ["ec45.toml:2", "r_ohm is out of range"]),
            (EC45.replace("pole_pairs = 8", "pole_pairs = 40"), ["ec45.toml:5", "2 to 20 pole pairs"]),
            (with("inertia = 3"), ["unknown field `inertia`", "ec45.toml:8"]),
            (with("coulomb_n_m = 0.01\nstatic_n_m = 0.005"), ["static_n_m", "at least coulomb_n_m, 0.01"]),
            (with("[joint]\nmin_count = 5"), ["one end", "give both"]),
            (with("[joint]\nmin_count = 5\nmax_count = 5"), ["max_count", "above min_count, 5"]),
            (EC45.replace("peak_a = 10.2", "peak_a = 3"), ["current loop", "supply over R*peak 8.48"]),
            (EC45.replace("1.35e-5", "1e-6"), ["below 1 ms", "R*J/Kt^2 0.73 ms"]),
            (EC45.replace("0.036", "0.02"), ["6000 counts/s", "check the figures"]),
        ] {
            let found = parse(&text).expect_err("refused");
            assert!(expected.iter().all(|part| found.contains(part)), "{text}: {found}");
        }
    }

    /// Each key has a row of its own or shares one, and each reason of FIT its number and its words.
    #[test]
    fn page_names_every_key_and_every_reason() {
        let page = include_str!("../../../docs/motor.md");
        let joint = "gear_ratio load_j_kg_m2 min_count max_count worm_lead_deg backlash_counts stop_stiffness_n_m_rad";
        let motor = "name r_ohm l_mh kt_n_m_a pole_pairs j_kg_m2 coulomb_n_m static_n_m viscous_n_m_s peak_a max_winding_c winding_j_k \
                     winding_housing_k_w volts";
        for key in motor.split_whitespace().chain(joint.split_whitespace()) {
            let rows =
                page.lines().filter(|line| line.starts_with('|') && line.contains(&format!("`{key}`")));
            assert_eq!(rows.count(), 1, "{key}");
        }
        for why in Unfit::ALL {
            assert!(page.contains(&format!("| {} | {} |", why.code(), why.text())), "{why:?}");
        }
    }

    #[test]
    fn ends_of_a_scenario_are_the_joints() {
        let file = parse(&format!("{EC45}[joint]\nmin_count = 0\nmax_count = 900\n")).expect("a motor");
        let mut scenario = Scenario::find("link-fast").expect("shipped");
        scenario.take_motor(&file).unwrap_or_else(|bad| panic!("{bad}"));
        let case = &scenario.cases[0];
        assert_eq!((case.plant.min_count, case.plant.max_count), (-65.0, 962.0));
        assert_eq!(scenario.initial.position_counts, 0.0);
        assert!(matches!(scenario.timeline[0].action, Action::Order(Order::Command(Command::Move(900)))));
        assert_eq!(scenario.arguments, "link-fast --motor my/ec45.toml");
    }
}
