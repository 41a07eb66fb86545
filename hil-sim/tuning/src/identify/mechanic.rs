//! The mechanical half: inertia, friction, delay and the halls' placement, by linear least squares over stretches of motion in one direction.
//!
//! With A, S and W the double integrals of torque, sign and velocity since the start of a stretch, each edge gives
//!
//! ```text
//! boundary + e_sector = θ0 + ω0·t + (1/J)·A − (Fc/J)·S − (b/J)·W − delay·ω
//! ```
//!
//! θ0 and ω0 belong to the stretch and are projected out; the rest is common.

use super::electric::Drawn;
use super::linear::{Normal, Solution};
use super::path::{Edge, Point};
use super::record::Row;
use hil_world::plant::PlantParams;

/// Least speed, counts/s: below, friction falls with speed (Stribeck), which this model lacks.
pub(crate) const LEAST_SPEED: f64 = 90.0;

/// Longest stretch, s: the current's noise, integrated twice, grows with t^1.5.
const MOST_S: f64 = 0.2;

/// Fewest edges of a stretch: two are spent on its start.
const LEAST_EDGES: usize = 6;

/// Cells next to the ends of the way that are left out: stops may lie there.
const END_CELLS: i64 = 2;

/// Largest acceleration at which a duty that is not known is followed well enough, counts/s², over so many rows to either side.
const STEADY_COUNTS_S2: f64 = 3000.0;
const STEADY_ROWS: usize = 10;

/// Error of a boundary, counts: jitter, hysteresis and cogging.
const BOUNDARY_COUNTS: f64 = 0.02;

/// Mean square of the residuals of a stretch, over their variance, up to which it is believed in full; without other errors it is 1.
const USUAL_SQUARE: f64 = 1.5;

/// What is believed of a motor before: weakly.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beliefs {
    /// 1/J, Fc/J, b/J and the delay.
    pub(crate) x: [f64; 4],
    sigmas: [f64; 4],
    rad_per_count: f64,
}

impl Beliefs {
    /// Of a motor whose inertia is within a factor of four of the plant's, and whose friction at full speed is below two thirds of the torque that
    /// the supply drives at rest. The delay is half a row.
    pub(crate) fn new(plant: &PlantParams) -> Self {
        let per_j = 1.0 / plant.j_kg_m2;
        let most_n_m = 0.3 * plant.ke_v_s * plant.bus_v / plant.r_ohm;
        let no_load = plant.bus_v / plant.ke_v_s;
        Self {
            x: [per_j, plant.coulomb_n_m * per_j, plant.viscous_n_m_s * per_j, 0.0],
            sigmas: [3.0 * per_j, most_n_m * per_j, 0.18 * most_n_m / no_load * per_j, 5e-4],
            rad_per_count: plant.rad_per_count(),
        }
    }

    /// Whether an inertia, given as its inverse, is between a tenth of and five times the plant's.
    pub(crate) fn admits(&self, per_j: f64) -> bool {
        (0.2..10.0).contains(&(per_j / self.x[0]))
    }
}

/// Rounds of the weights of the stretches.
const ROUNDS: usize = 6;

/// Columns of the common unknowns: 1/J, Fc/J, b/J, delay, five of six placements.
pub(crate) const SIZE: usize = 9;

/// What the mechanical half consists of.
#[derive(Clone, Debug)]
pub struct Mechanic {
    /// 1/J; Fc/J, rad/s²; b/J, 1/s; delay, s; placements of the sectors 0 to 4 less the mean of all six, counts.
    pub solution: Solution,
    /// Time, residual and direction of each edge that was used: s, counts.
    pub residuals: Vec<(f64, f64)>,
    /// Number of stretches.
    pub stretches: usize,
}

impl Mechanic {
    /// Errors of the boundaries by the sector below, counts; their mean is 0.
    pub(crate) fn placement(&self) -> [f64; 6] {
        let x = &self.solution.x;
        let last = -x[4..SIZE].iter().sum::<f64>();
        [x[4], x[5], x[6], x[7], x[8], last]
    }
}

/// A stretch of motion in one direction.
struct Stretch {
    /// First and last row.
    from: usize,
    to: usize,
}

fn stretches(rows: &[Row], points: &[Point]) -> Vec<Stretch> {
    let cells = || rows.iter().map(|row| row.cell);
    let (low, high) = (cells().min().unwrap_or(0), cells().max().unwrap_or(0));
    let usable = |index: usize| {
        let (row, speed) = (rows[index], points[index].speed);
        let inside = row.cell > low + END_CELLS && row.cell < high - END_CELLS;
        let (before, after) = (index.saturating_sub(STEADY_ROWS), (index + STEADY_ROWS).min(rows.len() - 1));
        let change = (points[after].speed - points[before].speed) / (rows[after].t_s - rows[before].t_s);
        let is_steady = row.duty.is_some() || change.abs() < STEADY_COUNTS_S2;
        inside && is_steady && speed.abs() > LEAST_SPEED && (row.is_driven || row.is_free)
    };
    let mut found: Vec<Stretch> = Vec::new();
    let mut from: Option<usize> = None;
    for index in 0..rows.len() {
        let goes_on = from.is_some_and(|from| {
            rows[index].t_s - rows[from].t_s <= MOST_S && points[index].speed * points[from].speed > 0.0
        });
        if usable(index) && goes_on {
            continue;
        }
        if let Some(from) = from.filter(|from| index - 1 > *from) {
            found.push(Stretch { from, to: index - 1 });
        }
        from = usable(index).then_some(index);
    }
    if let Some(from) = from.filter(|from| rows.len() - 1 > *from) {
        found.push(Stretch { from, to: rows.len() - 1 });
    }
    found
}

/// Double integrals of torque, sign and velocity, in counts, and their rates.
#[derive(Clone, Copy, Default)]
struct Integrals {
    at: [f64; 3],
    rate: [f64; 3],
}

impl Integrals {
    fn advance(self, dt: f64, by: [f64; 3]) -> Self {
        let at = [0, 1, 2].map(|i| self.at[i] + dt * self.rate[i] + 0.5 * dt * dt * by[i]);
        Self { at, rate: [0, 1, 2].map(|i| self.rate[i] + dt * by[i]) }
    }
}

/// Fits the mechanical half; `None` if no stretch of motion is long enough.
pub fn fit(
    beliefs: &Beliefs,
    rows: &[Row],
    points: &[Point],
    edges: &[Edge],
    drawn: &[Drawn],
) -> Option<Mechanic> {
    let mut found: Vec<Found> = Vec::new();
    for stretch in stretches(rows, points) {
        let lines = lines(&stretch, rows, points, edges, drawn, beliefs.rad_per_count);
        if lines.len() >= LEAST_EDGES {
            let is_sure =
                rows[stretch.from..stretch.to].iter().all(|row| row.duty.is_some() || !row.is_driven);
            let times_s = lines.iter().map(|line| line.t_s).collect();
            found.push(Found { times_s, equations: project(&lines), is_sure });
        }
    }
    let mut doubts = vec![1.0; found.len()];
    let mut solution = None;
    for _ in 0..ROUNDS {
        let next = solve(beliefs, &found, &doubts)?;
        for (doubt, Found { equations, .. }) in doubts.iter_mut().zip(&found).filter(|(_, of)| !of.is_sure) {
            let square: f64 = equations.iter().map(|of| of.1 * residual(of, &next).powi(2)).sum();
            // A stretch that fits worse than its edges can be measured has an error of its own: a torque that was not recorded in time.
            *doubt = (square / (equations.len() as f64 - 2.0) / USUAL_SQUARE).max(1.0);
        }
        solution = Some(next);
    }
    let solution = solution?;
    let residuals = found.iter().flat_map(|Found { times_s, equations, .. }| {
        times_s.iter().zip(equations).map(|(t_s, of)| (*t_s, residual(of, &solution)))
    });
    Some(Mechanic { residuals: residuals.collect(), stretches: found.len(), solution })
}

/// A stretch's equations.
struct Found {
    times_s: Vec<f64>,
    equations: Vec<Equation>,
    /// Its torque does not depend on a duty that nobody recorded.
    is_sure: bool,
}

/// Coefficients, weight and right side of an equation.
type Equation = (Vec<f64>, f64, f64);

fn residual(equation: &Equation, solution: &Solution) -> f64 {
    equation.2 - equation.0.iter().zip(&solution.x).map(|(a, x)| a * x).sum::<f64>()
}

/// Solves for the common unknowns, with the weights of each stretch divided by its doubt; `None` without stretches.
fn solve(beliefs: &Beliefs, found: &[Found], doubts: &[f64]) -> Option<Solution> {
    if found.is_empty() {
        return None;
    }
    let mut normal = Normal::new(SIZE);
    for (Found { equations, .. }, doubt) in found.iter().zip(doubts) {
        normal.group(equations.iter().map(|(row, weight, y)| (row.clone(), weight / doubt, *y)).collect());
    }
    // For what a move does not show; placements of 15°.
    (0..4).for_each(|index| normal.prior(index, beliefs.x[index], beliefs.sigmas[index]));
    (4..SIZE).for_each(|index| normal.prior(index, 0.0, 0.15));
    normal.solve()
}

/// One edge's equation before the stretch's start is projected out.
struct Line {
    t_s: f64,
    row: [f64; SIZE],
    weight: f64,
    y: f64,
}

fn lines(
    stretch: &Stretch,
    rows: &[Row],
    points: &[Point],
    edges: &[Edge],
    drawn: &[Drawn],
    rad_per_count: f64,
) -> Vec<Line> {
    let mut lines = Vec::new();
    let mut integrals = Integrals::default();
    let begin = edges.partition_point(|edge| edge.row < stretch.from);
    let mut next = edges[begin..].iter().peekable();
    for index in stretch.from..stretch.to {
        let dt = rows[index + 1].t_s - rows[index].t_s;
        let speed = 0.5 * (points[index].speed + points[index + 1].speed);
        let by = [drawn[index].torque_n_m / rad_per_count, speed.signum() / rad_per_count, speed];
        while let Some(edge) = next.next_if(|edge| edge.row == index) {
            let at = integrals.advance(edge.t_s - rows[index].t_s, by).at;
            let mut row = [0.0; SIZE];
            let share = (edge.t_s - rows[index].t_s) / dt;
            let now = points[index].speed + share * (points[index + 1].speed - points[index].speed);
            [row[0], row[1], row[2], row[3]] = [at[0], -at[1], -at[2], -now];
            match row.get_mut(4 + edge.sector) {
                Some(own) => *own = -1.0,
                None => row[4..].fill(1.0),
            }
            let way = now * edge.half_s;
            let weight = 1.0 / (way * way / 3.0 + BOUNDARY_COUNTS * BOUNDARY_COUNTS);
            lines.push(Line { t_s: edge.t_s, row, weight, y: edge.boundary });
        }
        integrals = integrals.advance(dt, by);
    }
    lines
}

/// The equations less their best fit by a constant and a slope over time.
fn project(lines: &[Line]) -> Vec<Equation> {
    let total: f64 = lines.iter().map(|line| line.weight).sum();
    let mean = lines.iter().map(|line| line.weight * line.t_s).sum::<f64>() / total;
    let spread: f64 = lines.iter().map(|line| line.weight * (line.t_s - mean).powi(2)).sum();
    let residual = |value: &dyn Fn(&Line) -> f64| -> Vec<f64> {
        let centre = lines.iter().map(|line| line.weight * value(line)).sum::<f64>() / total;
        let slope =
            lines.iter().map(|line| line.weight * (line.t_s - mean) * value(line)).sum::<f64>() / spread;
        lines.iter().map(|line| value(line) - centre - slope * (line.t_s - mean)).collect()
    };
    let columns: Vec<Vec<f64>> = (0..SIZE).map(|index| residual(&|line: &Line| line.row[index])).collect();
    let y = residual(&|line: &Line| line.y);
    (0..lines.len())
        .map(|at| (columns.iter().map(|column| column[at]).collect(), lines[at].weight, y[at]))
        .collect()
}
