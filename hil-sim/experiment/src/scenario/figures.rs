//! Figures of the simulated motor, its sensors and its supply, which `--plant`, `--rig` and `--supply` override.

use tater_wire::MotorKind;

use super::{Case, Scenario};
use hil_world::plant::{ParamError, PlantParams};
use hil_world::rig::RigParams;
use traces::input::{self, BadInput};

/// A figure that a run may override.
#[derive(Debug)]
pub struct Figure {
    /// The option without its dashes: `plant`, `rig` or `supply`.
    pub option: &'static str,
    /// Its name, as in a scenario file; it ends in the unit.
    pub name: &'static str,
    /// A plain word for it, which an override may use as well.
    pub word: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Where its default comes from.
    pub source: &'static str,
    place: Place,
}

#[derive(Debug)]
enum Place {
    Plant(fn(&mut PlantParams) -> &mut f64),
    Rig(fn(&RigParams) -> f64, fn(&mut RigParams, f64)),
}

macro_rules! plant {
    ($name:ident, $word:literal, $unit:literal, $source:literal) => {
        figure!("plant", stringify!($name), $word, $unit, $source, Place::Plant(|plant| &mut plant.$name))
    };
}

macro_rules! rig {
    ($name:ident, $word:literal, $unit:literal, $source:literal) => {
        figure!(
            "rig",
            stringify!($name),
            $word,
            $unit,
            $source,
            Place::Rig(|rig| rig.$name, |rig, value| rig.$name = value)
        )
    };
}

macro_rules! figure {
    ($option:literal, $name:expr, $word:literal, $unit:literal, $source:literal, $place:expr) => {
        Figure { option: $option, name: $name, word: $word, unit: $unit, source: $source, place: $place }
    };
}

/// Every figure.
pub const FIGURES: [Figure; 38] = [
    plant!(r_ohm, "resistance", "Ohm", "24 V squared over 239.5 W (decision 0003), line to line at 25 C"),
    plant!(r_per_k, "copper", "1/K", "copper"),
    plant!(
        l_mh,
        "inductance",
        "mH",
        "chosen: 0.33 ms with the resistance, usual for a slotted motor of this size"
    ),
    plant!(ke_v_s, "emf", "V s/rad", "decision 0003; also the torque constant, N m/A"),
    plant!(
        j_kg_m2,
        "inertia",
        "kg m2",
        "chosen: a steel rotor of 30 mm diameter and length, and the joint behind its gear"
    ),
    plant!(coulomb_n_m, "friction", "N m", "chosen: decision 0003 limits it to 0.04"),
    plant!(
        static_n_m,
        "stiction",
        "N m",
        "chosen: a third above the friction in motion, as in greased gears"
    ),
    plant!(
        stribeck_counts_s,
        "stribeck",
        "counts/s",
        "chosen: speed at which stiction has fallen to the friction in motion but for 1/e, as in grease"
    ),
    plant!(cogging_n_m, "cogging", "N m", "chosen: amplitude, once a count, of a skewed stator"),
    plant!(viscous_n_m_s, "viscous", "N m s/rad", "chosen: an eighth of the friction at no-load speed"),
    plant!(diode_v, "diode", "V", "silicon at a few amperes"),
    plant!(dead_time_us, "dead_time", "us", "the board's timer (docs/board.md)"),
    plant!(trip_a, "trip", "A", "the gate driver's break input: above the 20 A of plugging at full speed"),
    plant!(gear_ratio, "gear", "1", "manual, table 1: motor turns per joint turn"),
    plant!(
        backlash_counts,
        "backlash",
        "counts",
        "chosen: free play of the gear at the motor, 8' of the joint"
    ),
    plant!(
        gear_rad_n_m,
        "compliance",
        "rad/(N m)",
        "chosen: twist of the gear under torque, both at the motor; 10,000 N m/rad at the joint"
    ),
    plant!(worm_lead_deg, "worm_lead", "deg", "chosen: a single-start worm; 0 is none"),
    plant!(
        worm_friction,
        "worm_mu",
        "1",
        "chosen: just above tan 5 deg, so that a finger cannot be driven backwards (manual 2)"
    ),
    plant!(brake_n_m, "brake", "N m", "three times the motor's peak; 0 is none"),
    plant!(brake_delay_ms, "brake_delay", "ms", "a small power-off brake"),
    plant!(min_count, "lowest", "counts", "manual, table 1: the open stop is half a count below"),
    plant!(max_count, "highest", "counts", "manual, table 1: the closed stop is half a count above"),
    plant!(
        stop_stiffness_n_m_rad,
        "stop_stiffness",
        "N m/rad",
        "chosen: full torque dents a stop by a tenth of a count"
    ),
    plant!(stop_damping_n_m_s, "stop_damping", "N m s/rad", "chosen: half of critical"),
    plant!(winding_j_k, "winding_heat", "J/K", "26 g of copper"),
    plant!(
        winding_housing_k_w,
        "winding_housing",
        "K/W",
        "chosen: 15 s with the winding's heat, usual at this size"
    ),
    plant!(housing_j_k, "housing_heat", "J/K", "130 g of steel"),
    plant!(housing_ambient_k_w, "housing_ambient", "K/W", "chosen: 6 min with the housing's heat"),
    plant!(ambient_c, "ambient", "C", "a room"),
    figure!(
        "rig",
        "hall_offset_deg",
        "hall_offset",
        "deg electrical",
        "none: common part of the six errors of the hall sensors' placement",
        Place::Rig(
            |rig| rig.hall_error_deg.iter().sum::<f64>() / 6.0,
            |rig, value| {
                let change = value - rig.hall_error_deg.iter().sum::<f64>() / 6.0;
                rig.hall_error_deg.iter_mut().for_each(|error| *error += change);
            }
        )
    ),
    figure!(
        "rig",
        "rise_delay_us",
        "rise_delay",
        "us",
        "none: an open collector with a weak pull-up rises late",
        // A negative one becomes one that is out of range.
        Place::Rig(
            |rig| rig.rise_delay_us as f64,
            |rig, value| rig.rise_delay_us = if value < 0.0 { u64::MAX } else { value.round() as u64 }
        )
    ),
    rig!(
        hall_hysteresis_deg,
        "hysteresis",
        "deg electrical",
        "chosen: between the edges of a boundary in either direction, 2 mT of a sensor"
    ),
    rig!(
        hall_jitter_deg,
        "jitter",
        "deg electrical",
        "chosen: rms of the place of each edge, at most 3.5 times that"
    ),
    rig!(adc_noise_lsb, "adc_noise", "LSB", "half a step of the converter"),
    rig!(thermistor_lag_s, "thermistor_lag", "s", "chosen: a bead glued to the housing"),
    rig!(strain_zero, "strain_zero", "1/255", "the middle of the range"),
    rig!(strain_per_n_m, "strain_gain", "1/255 per N m", "chosen: a link at full torque uses half the range"),
    figure!("supply", "volts", "volts", "V", "manual: 24 V", Place::Plant(|plant| &mut plant.bus_v)),
];

impl Figure {
    /// Its value for a motor with default sensors.
    #[must_use]
    pub fn nominal(&self, kind: MotorKind) -> f64 {
        match self.place {
            Place::Plant(field) => *field(&mut PlantParams::for_motor(kind)),
            Place::Rig(get, _) => get(&RigParams::default()),
        }
    }

    fn is_called(&self, name: &str) -> bool {
        self.name.eq_ignore_ascii_case(name) || self.word.eq_ignore_ascii_case(name)
    }

    /// The figure of an option by its name or its word.
    #[must_use]
    pub fn find(option: &str, name: &str) -> Option<&'static Self> {
        const ROWS: &[Figure] = &FIGURES;
        ROWS.iter().find(|figure| figure.option == option && figure.is_called(name))
    }
}

impl Scenario {
    /// Overrides figures in turn: each is an option (`plant`, `rig` or `supply`) with `NAME=VALUE`, or with `NAME=1.3x` for a
    /// multiple of what the scenario says. Ranges that depend on other figures are checked when all have their values.
    ///
    /// # Errors
    /// Another form, an unknown figure, a multiple of 0, a value out of range, or a supply that the scenario scatters; the
    /// scenario is unchanged.
    pub fn override_figures(&mut self, overrides: &[(&str, &str)]) -> Result<(), BadInput> {
        let mut next = self.clone();
        let mut given = Vec::new();
        for &(option, assignment) in overrides {
            let (figure, text) = next.put_figure(option, assignment)?;
            given.push((figure, assignment));
            next.arguments.push_str(&format!(" --{option} {}={text}", figure.name));
        }
        next.check_figures().map_err(|e| out_of_range(&e, &given))?;
        *self = next;
        Ok(())
    }

    /// Checks the ranges of all figures.
    ///
    /// # Errors
    /// The first figure out of its range.
    pub fn check_figures(&self) -> Result<(), ParamError> {
        for Case { plant, .. } in &self.cases {
            plant.validate()?;
            self.initial.check(plant)?;
        }
        self.rig.validate()
    }

    /// Puts a value in, whatever its range. Returns the figure, and the value as it was written.
    ///
    /// # Errors
    /// An unknown figure, or no number.
    pub fn put_figure<'a>(
        &mut self,
        option: &str,
        assignment: &'a str,
    ) -> Result<(&'static Figure, &'a str), BadInput> {
        let bad = |problem: &str, found: &str, expected: &str, next: String| {
            BadInput::new(format!("--{option} {}", input::shorten(assignment)), problem)
                .found(input::shorten(found))
                .expected(expected)
                .next(next)
        };
        let form =
            || format!("give --{option} NAME=VALUE or NAME=1.3x; `hil-sim list --plant` names the figures");
        let Some((name, text)) = assignment.split_once('=') else {
            return Err(bad("no = in it", assignment, "NAME=VALUE", form()));
        };
        let (name, text) = (name.trim(), text.trim());
        let Some(figure) = Figure::find(option, name) else {
            let of_option = || FIGURES.iter().filter(|figure| figure.option == option);
            let names: Vec<&str> = of_option().flat_map(|figure| [figure.name, figure.word]).collect();
            let next = input::did_you_mean(name, names.into_iter());
            let known: Vec<&str> = of_option().map(|figure| figure.name).collect();
            return Err(bad("no figure has this name", name, &known.join(", "), next.unwrap_or_else(form)));
        };
        let (digits, is_factor) =
            text.strip_suffix(['x', 'X']).map_or((text, false), |digits| (digits, true));
        let number = digits.trim().parse::<f64>().ok().filter(|number| number.is_finite());
        let Some(number) = number else {
            return Err(bad("the value is no number", text, "a number, or a number and x", form()));
        };
        if option == "supply" && self.scatter > 0.0 {
            let next = "take a scenario without scatter".to_owned();
            let problem = "this scenario draws the supply's voltage with each seed";
            return Err(bad(problem, assignment, "a scenario without scatter", next));
        }
        let before = match figure.place {
            Place::Plant(field) => self.cases.iter_mut().map(|case| *field(&mut case.plant)).collect(),
            Place::Rig(get, _) => vec![get(&self.rig)],
        };
        if is_factor && before.iter().all(|before| *before == 0.0) {
            let next = format!("give a value: --{option} {name}=...");
            return Err(bad("a multiple of 0 is 0", text, "a number without x", next));
        }
        let value = |before: f64| if is_factor { before * number } else { number };
        match figure.place {
            Place::Plant(field) => {
                for (Case { plant, .. }, before) in self.cases.iter_mut().zip(before) {
                    *field(plant) = value(before);
                }
            }
            Place::Rig(_, set) => before.iter().for_each(|before| set(&mut self.rig, value(*before))),
        }
        Ok((figure, text))
    }
}

/// The error of the last of the overrides that is about the field, or of the last of all.
fn out_of_range(e: &ParamError, given: &[(&'static Figure, &str)]) -> BadInput {
    // The plant's field of the supply is `bus_v`.
    let is_own = |figure: &Figure| figure.name == e.field || (figure.option, e.field) == ("supply", "bus_v");
    let own = given.iter().rev().find(|(figure, _)| is_own(figure));
    let Some((figure, assignment)) = own.or(given.last()) else {
        return BadInput::new("the scenario", format!("{} is out of range", e.field))
            .found(e.found.to_string())
            .expected(e.expected.clone())
            .next("correct it");
    };
    let found = format!("{} is {}, with {assignment}", e.field, e.found);
    BadInput::new(format!("--{} {}", figure.option, input::shorten(assignment)), "out of range")
        .found(if own.is_some() {
            input::shorten(assignment.split('=').next_back().unwrap_or(assignment).trim())
        } else {
            found
        })
        .expected(format!("{} of {}", e.field, e.expected))
        .next(match own {
            Some(_) => "give a value in this range".to_owned(),
            None => format!("give a value that leaves {} in this range, or override that as well", e.field),
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scenario() -> Scenario {
        Scenario::find("link-fast").expect("shipped")
    }

    #[test]
    fn figures_are_set_by_name_by_word_and_by_factor() {
        let mut scenario = scenario();
        let before = scenario.cases[0].plant.clone();
        let overrides = [
            ("plant", "inertia=1.3x"),
            ("plant", "coulomb_n_m = 0.02"),
            ("rig", "hall_offset_deg=7"),
            ("supply", "volts=22"),
        ];
        scenario.override_figures(&overrides).unwrap_or_else(|bad| panic!("{bad}"));
        let plant = &scenario.cases[0].plant;
        assert_eq!((plant.j_kg_m2, plant.coulomb_n_m, plant.bus_v), (1.3 * before.j_kg_m2, 0.02, 22.0));
        assert_eq!(scenario.rig.hall_error_deg, [7.0; 6]);
        assert_eq!(
            scenario.arguments,
            "link-fast --plant j_kg_m2=1.3x --plant coulomb_n_m=0.02 --rig hall_offset_deg=7 --supply volts=22"
        );
    }

    #[test]
    fn bad_overrides_name_the_option_and_a_next_step() {
        for (option, assignment, what, next) in [
            ("plant", "inertia", "no = in it", "NAME=1.3x"),
            ("plant", "inertai=2", "no figure has this name", "did you mean inertia?"),
            ("rig", "inertia=2", "no figure has this name", "hil-sim list --plant"),
            ("plant", "inertia=much", "no number", "NAME=1.3x"),
            ("plant", "inertia=nan", "no number", "NAME=1.3x"),
            ("plant", "inertia=1e9x", "out of range", "in this range"),
            ("supply", "volts=99", "out of range", "in this range"),
            ("supply", "volts= 0", "found:    0\n", "give a value in this range"),
            ("rig", "hall_offset_deg=30", "out of range", "in this range"),
            ("rig", "rise_delay=-1", "out of range", "in this range"),
            ("plant", "friction=2x", "static_n_m is 0.04, with friction=2x", "or override that as well"),
            ("rig", "hall_offset_deg=2x", "a multiple of 0", "--rig hall_offset_deg="),
        ] {
            let mut scenario = scenario();
            let text = scenario.override_figures(&[(option, assignment)]).unwrap_err().to_string();
            assert!(text.contains(what) && text.contains(next), "{assignment}: {text}");
            assert!(text.contains(&format!("--{option} {assignment}")), "{text}");
        }
    }

    #[test]
    fn friction_and_stiction_are_overridden_in_either_order() {
        for overrides in [
            [("plant", "friction=2x"), ("plant", "stiction=2x")],
            [("plant", "stiction=2x"), ("plant", "friction=2x")],
        ] {
            scenario().override_figures(&overrides).unwrap_or_else(|bad| panic!("{bad}"));
        }
    }

    #[test]
    fn every_number_of_the_plant_is_a_figure() {
        let table = toml::Table::try_from(PlantParams::for_motor(MotorKind::Link)).expect("a table");
        let named = |name: &str| FIGURES.iter().any(|figure| figure.name == name);
        // The supply's figure, a choice, and what makes another motor (docs/motor.md).
        let missing: Vec<_> = table
            .keys()
            .filter(|key| !named(key) && !["bus_v", "zero_sector", "pole_pairs"].contains(&key.as_str()))
            .collect();
        assert_eq!(missing, Vec::<&String>::new());
    }
}
