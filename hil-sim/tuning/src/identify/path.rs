//! The rotor's path from hall edges: a Kalman filter and Rauch-Tung-Striebel smoother over position and velocity.
//!
//! An edge between two rows puts the rotor on a boundary in the middle of them, ± a quarter of the interval's way; without edges for long it rests.
//! The acceleration that the motor's current gives is an input, so that little is left to the process noise.

use super::record::Row;

/// Least error of a boundary, counts: jitter and hysteresis of the halls.
const EDGE_COUNTS: f64 = 0.015;

/// Time without an edge from which the rotor rests, s.
const REST_S: f64 = 0.06;

/// An edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// The row before it.
    pub row: usize,
    /// Where between this row and the next, s.
    pub t_s: f64,
    /// Longest error of the time, s.
    pub half_s: f64,
    /// The boundary without its error, counts.
    pub boundary: f64,
    /// Sector below the boundary.
    pub sector: usize,
    /// +1 closing, -1 opening.
    pub dir: f64,
}

/// The rotor at a row.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    /// Position, counts.
    pub counts: f64,
    /// Velocity, counts/s.
    pub speed: f64,
    /// Standard deviation of the velocity, counts/s.
    pub sigma: f64,
}

/// All edges of a recording.
pub fn edges(rows: &[Row]) -> Vec<Edge> {
    let mut edges = Vec::new();
    for (row, pair) in rows.windows(2).enumerate() {
        let (from, to) = (pair[0], pair[1]);
        let steps = to.cell - from.cell;
        let dir = steps.signum();
        let share = (to.t_s - from.t_s) / steps.abs().max(1) as f64;
        for step in 0..steps.abs() {
            let below = if dir > 0 { from.cell + step } else { from.cell - step - 1 };
            edges.push(Edge {
                row,
                t_s: from.t_s + share * (step as f64 + 0.5),
                half_s: 0.5 * share,
                boundary: below as f64 + 0.5,
                sector: below.rem_euclid(6) as usize,
                dir: dir as f64,
            });
        }
    }
    edges
}

#[derive(Clone, Copy)]
struct State {
    x: [f64; 2],
    /// Variances of position and velocity, and their covariance.
    p: [f64; 3],
}

impl State {
    fn predict(self, dt: f64, acceleration: f64, q: f64) -> Self {
        let [x, v] = self.x;
        let [pp, vv, pv] = self.p;
        Self {
            x: [x + dt * (v + 0.5 * dt * acceleration), v + dt * acceleration],
            p: [
                pp + dt * (2.0 * pv + dt * vv) + q * dt * dt * dt / 3.0,
                vv + q * dt,
                pv + dt * vv + q * dt * dt / 2.0,
            ],
        }
    }

    fn measure(&mut self, index: usize, value: f64, variance: f64) {
        let [pp, vv, pv] = self.p;
        let (own, other) = if index == 0 { (pp, pv) } else { (vv, pv) };
        let total = own + variance;
        let residual = value - self.x[index];
        let (gain, cross) = (own / total, other / total);
        self.x[index] += gain * residual;
        self.x[1 - index] += cross * residual;
        let shrink = [own * (1.0 - gain), pv * (1.0 - gain)];
        let rest = if index == 0 { vv - cross * pv } else { pp - cross * pv };
        self.p = if index == 0 { [shrink[0], rest, shrink[1]] } else { [rest, shrink[0], shrink[1]] };
    }
}

/// A time at which the filter stops: at an edge or at a row.
struct Stop {
    t_s: f64,
    before: State,
    after: State,
    row: Option<usize>,
}

/// The rotor at each row. `placement`: errors of the boundaries, counts, by the sector below; `acceleration`: of each interval between two
/// rows, counts/s²; `noise`: spectral density of what it does not know, (counts/s²)²·s, of each interval; `placed`: standard deviation
/// of `placement`.
pub fn smooth(
    rows: &[Row],
    edges: &[Edge],
    placement: &[f64; 6],
    placed: f64,
    (acceleration, noise): (&[f64], &[f64]),
) -> Vec<Point> {
    let start = rows[0].cell as f64;
    let mut state = State { x: [start, 0.0], p: [0.1, 1e4, 0.0] };
    let mut stops = vec![Stop { t_s: rows[0].t_s, before: state, after: state, row: Some(0) }];
    let mut next = edges.iter().peekable();
    let mut moved_s = rows[0].t_s - REST_S;
    for (index, row) in rows.iter().enumerate().skip(1) {
        let interval = index - 1;
        let mut advance = |to_s: f64, at: Option<usize>, measured: Option<&Edge>, moved_s: f64| {
            let dt = to_s - stops.last().map_or(to_s, |stop| stop.t_s);
            let before = state.predict(dt, acceleration[interval], noise[interval]);
            state = before;
            if let Some(edge) = measured {
                let way = state.x[1] * edge.half_s;
                let variance = way * way / 3.0 + EDGE_COUNTS * EDGE_COUNTS + placed * placed;
                state.measure(0, edge.boundary + placement[edge.sector], variance);
            } else if to_s - moved_s > REST_S {
                state.measure(1, 0.0, 1.0);
                state.measure(0, row.cell as f64, 1.0);
            }
            stops.push(Stop { t_s: to_s, before, after: state, row: at });
        };
        while let Some(edge) = next.next_if(|edge| edge.row == interval) {
            moved_s = edge.t_s;
            advance(edge.t_s, None, Some(edge), moved_s);
        }
        advance(row.t_s, Some(index), None, moved_s);
    }
    backwards(&mut stops);
    let at_row = |stop: &Stop| {
        stop.row.map(|_| Point {
            counts: stop.after.x[0],
            speed: stop.after.x[1],
            sigma: stop.after.p[1].max(0.0).sqrt(),
        })
    };
    stops.iter().filter_map(at_row).collect()
}

/// The smoother's pass: each stop learns what the later ones know.
fn backwards(stops: &mut [Stop]) {
    for index in (0..stops.len().saturating_sub(1)).rev() {
        let (later, before) = (stops[index + 1].after, stops[index + 1].before);
        let dt = stops[index + 1].t_s - stops[index].t_s;
        let own = stops[index].after;
        // C = P·Fᵀ·(P of the prediction)⁻¹.
        let [pp, vv, pv] = own.p;
        let to = [[pp + dt * pv, pv], [pv + dt * vv, vv]];
        let [bp, bv, bc] = before.p;
        let det = bp * bv - bc * bc;
        if det <= 0.0 {
            continue;
        }
        let inverse = [[bv / det, -bc / det], [-bc / det, bp / det]];
        let gain = [0, 1].map(|i| [0, 1].map(|j| to[i][0] * inverse[0][j] + to[i][1] * inverse[1][j]));
        let dx = [later.x[0] - before.x[0], later.x[1] - before.x[1]];
        let dp = [later.p[0] - before.p[0], later.p[1] - before.p[1], later.p[2] - before.p[2]];
        let spread = |i: usize, j: usize| {
            let [a, b] = [gain[i], gain[j]];
            a[0] * dp[0] * b[0] + a[1] * dp[1] * b[1] + (a[0] * b[1] + a[1] * b[0]) * dp[2]
        };
        stops[index].after = State {
            x: [0, 1].map(|i| own.x[i] + gain[i][0] * dx[0] + gain[i][1] * dx[1]),
            p: [pp + spread(0, 0), vv + spread(1, 1), pv + spread(0, 1)],
        };
    }
}
