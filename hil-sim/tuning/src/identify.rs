//! A motor's figures from a recorded move: resistance, EMF constant, inertia, friction, delay and the halls' placement, each with a 95 %
//! interval, and which move would tell what this one does not (docs/identify.md).
//!
//! Three steps, repeated until they agree: the rotor's path from the hall edges (`path`), the winding from the bus current along it
//! (`electric`), the shaft from the torque of that current (`mechanic`).

mod electric;
mod known;
mod linear;
mod mechanic;
mod path;
pub mod record;

use electric::{Bench, Drawn, Electric};
pub use known::Known;
use linear::Solution;
use mechanic::{Beliefs, Mechanic};
use path::{Edge, Point};
pub use record::Recording;
use record::Row;

use hil_experiment::properties::PropertyError;
use tater_wire::Property;

/// Degrees electrical of a count.
const DEG: f64 = 60.0;

/// 97.5th percentile of the normal distribution.
const SIGMAS: f64 = 1.96;

/// Rounds of path, winding and shaft: from the fourth on, none of 20 plants changed by more than a tenth of its interval.
const ROUNDS: usize = 5;

/// Fewest stretches of motion from which intervals are taken.
const LEAST_STRETCHES: usize = 6;

/// What the model leaves out, as a standard deviation of R, Ke, J, Coulomb, viscous and all friction each: the mean of the halls' errors, the
/// winding's heat before the recording, Stribeck's rest, and what an L that is only taken from a data sheet does to friction. Chosen by the
/// errors of 100 links, 20 tips and 20 spreads; docs/identify.md has the coverage.
const MODEL: [f64; 6] = [0.0012, 0.004, 0.002, 0.009, 0.08, 0.003];

/// A step of the board's converter of the bus current, A.
const STEP_A: f64 = 40.0 / 4095.0;

/// Standard deviation of J and friction where friction draws one step of the current at [`WORKING_SPEED`]: rounding is then a bias that no mean
/// removes. It falls with the square of the current. J of three motors that draw 1.0, 1.0 and 3.2 steps was off by 19, 2 and 0.1 %.
const ROUNDED: f64 = 0.1;

/// Speed at which all friction is given, counts/s.
pub const WORKING_SPEED: f64 = 500.0;

/// A figure with its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Best value.
    pub value: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
    /// Whether the interval is narrow enough to use the value.
    pub is_determined: bool,
}

impl Estimate {
    fn new(value: f64, sigma: f64, most: f64) -> Self {
        let half = SIGMAS * sigma.abs();
        Self { value, low: value - half, high: value + half, is_determined: half <= most }
    }

    /// Of a figure that no motor has below 0.
    fn positive(value: f64, sigma: f64, most: f64) -> Self {
        let estimate = Self::new(value, sigma, most.abs());
        Self { is_determined: estimate.is_determined && value > 0.0, ..estimate }
    }
}

/// The figures of a motor.
#[derive(Clone, Debug, PartialEq)]
pub struct Identified {
    /// Volts of a torque unit of the board, and radians of a count.
    unit_v: f64,
    rad_per_count: f64,
    /// Line to line at 25 °C, Ω.
    pub r_ohm: Estimate,
    /// EMF constant, V·s/rad, equal to the torque constant, N·m/A.
    pub ke_v_s: Estimate,
    /// Inertia at the rotor, kg·m².
    pub j_kg_m2: Estimate,
    /// Coulomb friction, N·m.
    pub coulomb_n_m: Estimate,
    /// Viscous friction, N·m·s/rad.
    pub viscous_n_m_s: Estimate,
    /// Coulomb and viscous friction at [`WORKING_SPEED`], N·m.
    pub friction_n_m: Estimate,
    /// Time by which recorded hall edges are later than the recorded current's effect, ms; negative if the current is the later one.
    pub delay_ms: Estimate,
    /// Error of the upper boundary of each sector less their mean, degrees electrical.
    pub hall_error_deg: [Estimate; 6],
    /// What the figures leave unexplained.
    pub residuals: Residuals,
    /// The moves that would determine what this one does not, each once.
    pub missing: Vec<&'static str>,
    /// Remarks on the recording.
    pub remarks: Vec<String>,
}

impl Identified {
    /// The board's model of its motor, of the figures that are determined: number or name of the property, and value. The board counts torque
    /// in units of a voltage across the winding, so R and Ke are in all of them. Those that a board takes; [`Self::beyond`] has the others.
    #[must_use]
    pub fn properties(&self) -> Vec<(&'static str, i64)> {
        self.model().into_iter().flatten().collect()
    }

    /// The values of that model that are out of their properties' ranges.
    #[must_use]
    pub fn beyond(&self) -> Vec<PropertyError> {
        self.model().into_iter().filter_map(Result::err).collect()
    }

    fn model(&self) -> Vec<Result<(&'static str, i64), PropertyError>> {
        if !self.r_ohm.is_determined || !self.ke_v_s.is_determined {
            return Vec::new();
        }
        let (unit_v, rad_per_count) = (self.unit_v, self.rad_per_count);
        let unit_n_m = unit_v / self.r_ohm.value * self.ke_v_s.value;
        let mut all = vec![(Property::MKE, "MKE", 4096.0 * self.ke_v_s.value * rad_per_count / unit_v)];
        if self.j_kg_m2.is_determined {
            all.push((Property::MKA, "MKA", 16.0 * unit_n_m / self.j_kg_m2.value / rad_per_count));
        }
        if self.coulomb_n_m.is_determined {
            all.push((Property::MFC, "MFC", self.coulomb_n_m.value / unit_n_m));
        }
        let of = |(property, name, value): (Property, &'static str, f64)| {
            let (found, row) = (value.round() as i64, property.row());
            match property.rules().admits(found) {
                true => Ok((name, found)),
                false => Err(PropertyError::Range { name, found, min: row.min, max: row.max }),
            }
        };
        all.into_iter().map(of).collect()
    }

    /// All figures with name and unit, in order.
    #[must_use]
    pub fn figures(&self) -> Vec<(String, &'static str, Estimate)> {
        let mut all = vec![
            ("r_ohm".to_owned(), "Ohm, line to line at 25 C", self.r_ohm),
            ("ke_v_s".to_owned(), "V s/rad", self.ke_v_s),
            ("j_kg_m2".to_owned(), "kg m2 at the rotor", self.j_kg_m2),
            ("coulomb_n_m".to_owned(), "N m", self.coulomb_n_m),
            ("viscous_n_m_s".to_owned(), "N m s/rad", self.viscous_n_m_s),
            ("friction_n_m".to_owned(), "N m, both at 500 counts/s", self.friction_n_m),
            ("delay_ms".to_owned(), "ms", self.delay_ms),
        ];
        let halls = self.hall_error_deg.iter().enumerate();
        all.extend(
            halls.map(|(sector, of)| (format!("hall_error_deg[{sector}]"), "degrees electrical", *of)),
        );
        all
    }
}

/// Residuals over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Residuals {
    /// Time, ms, and measured less expected bus current, A, of each interval with a known duty.
    pub bus_a: Vec<(f64, f64)>,
    /// Time, ms, and boundary less the rotor's expected place, counts, of each edge that was used.
    pub edge_counts: Vec<(f64, f64)>,
}

/// The state of the fit.
struct Fit<'a> {
    rows: &'a [Row],
    edges: Vec<Edge>,
    known: &'a Known,
    beliefs: Beliefs,
    points: Vec<Point>,
    placement: [f64; 6],
    electric: Electric,
    winding: Option<Solution>,
    drawn: Vec<Drawn>,
    shaft: Option<Mechanic>,
}

impl<'a> Fit<'a> {
    fn new(recording: &'a Recording, known: &'a Known) -> Self {
        let rows = recording.rows.as_slice();
        Self {
            rows,
            edges: path::edges(rows),
            electric: Electric::first(known),
            known,
            beliefs: Beliefs::new(&known.plant),
            points: Vec::new(),
            placement: [0.0; 6],
            winding: None,
            drawn: Vec::new(),
            shaft: None,
        }
    }

    /// What accelerates the rotor in each interval as far as it is known, counts/s², and the noise of the rest.
    fn push(&self) -> (Vec<f64>, Vec<f64>) {
        let intervals = self.rows.len() - 1;
        let Some(shaft) = &self.shaft else {
            let noise = |row: &Row| if row.is_driven { 5e6 } else { 2e5 };
            return (vec![0.0; intervals], self.rows[..intervals].iter().map(noise).collect());
        };
        // A shaft that is hardly determined says nothing of the path; that of a motor says more than none.
        let (x, doubt) =
            if self.is_plausible(shaft) { (&shaft.solution.x[..], 0.1) } else { (&self.beliefs.x[..], 0.5) };
        let rad_per_count = self.known.plant.rad_per_count();
        let cells = || self.rows.iter().map(|row| row.cell);
        let (low, high) = (cells().min().unwrap_or(0), cells().max().unwrap_or(0));
        let one = |index: usize| {
            let (cell, speed) = (self.rows[index].cell, self.points[index].speed);
            // An impact on a stop, or a start from rest, is beyond the model.
            if cell <= low + 2 || cell >= high - 2 {
                return (0.0, 5e6);
            }
            let friction = (x[1] / rad_per_count + x[2] * speed.abs()) * speed.signum();
            let torque = x[0] * self.drawn[index].torque_n_m / rad_per_count;
            if speed.abs() < mechanic::LEAST_SPEED {
                return (0.0, 2e5 + (torque * torque) * 0.01);
            }
            let push = torque - friction;
            if self.rows[index].duty.is_none() {
                return (push, 4e4 + (0.5 * torque).powi(2) * 5e-3);
            }
            (push, 4e4 + (doubt * torque).powi(2) * 5e-3)
        };
        (0..intervals).map(one).unzip()
    }

    /// Whether a shaft is that of the motor.
    fn is_plausible(&self, shaft: &Mechanic) -> bool {
        self.beliefs.admits(shaft.solution.x[0])
    }

    fn round(&mut self) {
        let placed = if self.shaft.is_some() { 0.02 } else { 0.1 };
        let (push, noise) = self.push();
        self.points = path::smooth(self.rows, &self.edges, &self.placement, placed, (&push, &noise));
        let bench =
            Bench { rows: self.rows, points: &self.points, placement: self.placement, known: self.known };
        if let Some((electric, solution)) = bench.fit(self.electric) {
            (self.electric, self.winding) = (electric, Some(solution));
        }
        self.drawn = bench.run(self.electric);
        self.shaft = mechanic::fit(&self.beliefs, self.rows, &self.points, &self.edges, &self.drawn);
        if let Some(shaft) = &self.shaft {
            self.placement = shaft.placement();
        }
    }
}

/// Identifies the motor of a recording.
#[must_use]
pub fn identify(recording: &Recording, known: &Known) -> Identified {
    let mut fit = Fit::new(recording, known);
    for _ in 0..ROUNDS {
        fit.round();
    }
    figures(recording, &fit)
}

fn figures(recording: &Recording, fit: &Fit) -> Identified {
    let Electric { r_ohm, ke_v_s, .. } = fit.electric;
    // The bus voltage is recorded in steps; its error is that of a whole recording.
    let bus_v = recording.rows.iter().map(|row| row.bus_v).sum::<f64>() / recording.rows.len() as f64;
    let coarse = recording.bus_step_v / 12f64.sqrt() / bus_v;
    let relative = |index: usize| match &fit.winding {
        Some(solution) => (solution.sigma(index).powi(2) + coarse * coarse + MODEL[index].powi(2)).sqrt(),
        None => 1.0,
    };
    let (r_sigma, ke_sigma) = (relative(0), relative(1));
    let mut missing = Vec::new();
    let r = Estimate::positive(r_ohm, r_sigma * r_ohm, 0.05 * r_ohm);
    let ke = Estimate::positive(ke_v_s, ke_sigma * ke_v_s, 0.025 * ke_v_s);
    let shaft = shaft(fit, ke_sigma, bus_v);
    let mut advise = |estimate: &Estimate, advice| {
        if !estimate.is_determined && !missing.contains(&advice) {
            missing.push(advice);
        }
    };
    advise(&r, "push at a stop with 250 to 400 of torque for 0.1 s (the first part of `hil-sim excite`)");
    advise(&ke, "run freely at full duty for 30 counts or more (the fast part of `hil-sim excite`)");
    if shaft.is_rounded {
        let advice = "nothing: at 500 counts/s its friction draws less than two steps of the bus current's converter. Take inertia and friction from a data sheet";
        [&shaft.j, &shaft.coulomb, &shaft.friction].into_iter().for_each(|of| advise(of, advice));
    } else {
        advise(&shaft.j, "accelerate and brake at a torque of 200 or more, several times (`hil-sim excite`)");
        advise(&shaft.coulomb, "cruise in both directions at 150 to 400 counts/s (`hil-sim excite`)");
        advise(
            &shaft.viscous,
            "cruise at two speeds that differ by 400 counts/s or more, each for 0.3 s (`hil-sim excite`)",
        );
        advise(&shaft.friction, "cruise in both directions at 150 to 400 counts/s (`hil-sim excite`)");
    }
    advise(&shaft.delay, "steps of torque while the rotor turns (`hil-sim excite`)");
    shaft.halls.iter().for_each(|hall| advise(hall, "cruise over 60 counts or more (`hil-sim excite`)"));
    let known =
        (0..fit.drawn.len()).filter(|index| fit.rows[*index].duty.is_some() && fit.rows[*index].is_driven);
    let bus_a = known
        .map(|index| (1e3 * fit.rows[index + 1].t_s, fit.rows[index + 1].bus_a - fit.drawn[index].bus_a))
        .collect();
    let edge_counts =
        fit.shaft.iter().flat_map(|shaft| &shaft.residuals).map(|(t_s, of)| (1e3 * t_s, *of)).collect();
    Identified {
        unit_v: fit.known.unit_v,
        rad_per_count: fit.known.plant.rad_per_count(),
        r_ohm: r,
        ke_v_s: ke,
        j_kg_m2: shaft.j,
        coulomb_n_m: shaft.coulomb,
        viscous_n_m_s: shaft.viscous,
        friction_n_m: shaft.friction,
        delay_ms: shaft.delay,
        hall_error_deg: shaft.halls,
        residuals: Residuals { bus_a, edge_counts },
        missing,
        remarks: remarks(recording, fit),
    }
}

/// The figures of the shaft.
struct Shaft {
    j: Estimate,
    coulomb: Estimate,
    viscous: Estimate,
    friction: Estimate,
    delay: Estimate,
    halls: [Estimate; 6],
    /// Friction draws too little current for inertia and friction to be known.
    is_rounded: bool,
}

/// Nothing known.
const UNKNOWN: Estimate =
    Estimate { value: f64::NAN, low: f64::NEG_INFINITY, high: f64::INFINITY, is_determined: false };

fn shaft(fit: &Fit, ke_sigma: f64, bus_v: f64) -> Shaft {
    let Some(mechanic @ Mechanic { solution, stretches, .. }) = &fit.shaft else {
        let [j, coulomb, viscous, friction, delay] = [UNKNOWN; 5];
        return Shaft { j, coulomb, viscous, friction, delay, halls: [UNKNOWN; 6], is_rounded: false };
    };
    let x = &solution.x;
    let j = 1.0 / x[0];
    let working_rad_s = WORKING_SPEED * fit.known.plant.rad_per_count();
    let rounded = ROUNDED * (STEP_A * bus_v / ((x[1] + x[2] * working_rad_s) * j * working_rad_s)).powi(2);
    // (c + s·b)/x of the Coulomb part c and the viscous part b: the gradient of y/x is (1/x, -y/x²).
    let ratio = |parts: [f64; 2], model: f64| {
        let value = (parts[0] * x[1] + parts[1] * x[2]) * j;
        let mut gradient = vec![0.0; mechanic::SIZE];
        (gradient[0], gradient[1], gradient[2]) = (-value * j, parts[0] * j, parts[1] * j);
        // The torque's scale is Ke.
        let scale = value * ke_sigma.hypot(model).hypot(rounded);
        (value, (solution.variance(&gradient) + scale * scale).sqrt())
    };
    let j_sigma = j
        * ((solution.sigma(0) * j).powi(2) + ke_sigma * ke_sigma + MODEL[2].powi(2) + rounded * rounded)
            .sqrt();
    let (coulomb, coulomb_sigma) = ratio([1.0, 0.0], MODEL[3]);
    let (viscous, viscous_sigma) = ratio([0.0, 1.0], MODEL[4]);
    let (friction, friction_sigma) = ratio([1.0, working_rad_s], MODEL[5]);
    let hall = |index: usize| {
        let mut gradient = vec![0.0; mechanic::SIZE];
        match gradient[4..].get_mut(index) {
            Some(own) => *own = 1.0,
            None => gradient[4..].fill(-1.0),
        }
        let sigma = solution.variance(&gradient).sqrt() * DEG;
        (fit.placement[index] * DEG, sigma, 3.0)
    };
    // The spread of a few stretches tells nothing of their errors, and a shaft that is none says nothing.
    let is_known = *stretches >= LEAST_STRETCHES && fit.is_plausible(mechanic);
    let known =
        |estimate: Estimate| Estimate { is_determined: estimate.is_determined && is_known, ..estimate };
    let of = |value: f64, sigma: f64, most: f64| known(Estimate::new(value, sigma, most));
    let positive = |value: f64, sigma: f64, most: f64| known(Estimate::positive(value, sigma, most));
    Shaft {
        j: positive(j, j_sigma, 0.075 * j),
        coulomb: positive(coulomb, coulomb_sigma, 0.2 * coulomb),
        viscous: positive(viscous, viscous_sigma, 0.3 * viscous),
        friction: positive(friction, friction_sigma, 0.1 * friction),
        delay: of(1e3 * x[3], 1e3 * solution.sigma(3), 1.0),
        is_rounded: 2.0 * SIGMAS * rounded > 0.1,
        halls: [0, 1, 2, 3, 4, 5].map(|index| {
            let (value, sigma, most) = hall(index);
            of(value, sigma, most)
        }),
    }
}

fn remarks(recording: &Recording, fit: &Fit) -> Vec<String> {
    let mut remarks = Vec::new();
    if !recording.has_temperature {
        remarks.push("no thermistor_c: R is that of a winding that began at 25 °C".to_owned());
    }
    if fit.winding.is_none() {
        remarks.push("no row has a known duty: R and Ke are guesses".to_owned());
    }
    let stretches = fit.shaft.as_ref().map_or(0, |shaft| shaft.stretches);
    if stretches < LEAST_STRETCHES {
        remarks.push(format!(
            "{stretches} stretches above {} counts/s: the intervals need {LEAST_STRETCHES} or more",
            mechanic::LEAST_SPEED
        ));
    }
    remarks
}

#[cfg(test)]
mod tests {
    use super::*;
    use servo_core::motor::Motor;

    fn sure(value: f64) -> Estimate {
        Estimate { value, low: value, high: value, is_determined: true }
    }

    fn identified(known: &Known, ke_v_s: f64) -> Identified {
        Identified {
            unit_v: known.unit_v,
            rad_per_count: known.plant.rad_per_count(),
            r_ohm: sure(2.405),
            ke_v_s: sure(ke_v_s),
            j_kg_m2: sure(2e-5),
            coulomb_n_m: sure(0.03),
            viscous_n_m_s: UNKNOWN,
            friction_n_m: UNKNOWN,
            delay_ms: UNKNOWN,
            hall_error_deg: [UNKNOWN; 6],
            residuals: Residuals::default(),
            missing: Vec::new(),
            remarks: Vec::new(),
        }
    }

    #[test]
    fn properties_are_those_of_the_boards_own_description() {
        let found = identified(&Known::hands(), 0.0651);
        let Motor { mke, mka, mfc, .. } = Motor::HAND;
        let want = [("MKE", mke), ("MKA", mka), ("MFC", mfc)].map(|(name, value)| (name, i64::from(value)));
        assert_eq!((found.properties(), found.beyond()), (want.to_vec(), Vec::new()));
    }

    #[test]
    fn value_that_no_board_takes_is_beyond_and_no_property() {
        let found = identified(&Known::hands(), 5.0);
        assert!(found.properties().iter().all(|(name, _)| *name != "MKE"), "{:?}", found.properties());
        let beyond = found.beyond();
        assert!(
            matches!(
                beyond.as_slice(),
                [PropertyError::Range { name: "MKE", found: 305_000..306_000, .. }, ..]
            ),
            "{beyond:?}"
        );
    }
}
