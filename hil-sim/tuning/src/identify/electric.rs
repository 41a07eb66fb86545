//! The electrical half: bridge and winding along the rotor's measured path, and the resistance, EMF constant and inductance with which the
//! bus current comes out as measured.
//!
//! ```text
//! duty·V = R·i + Ke·ω + L·di/dt      bus current = duty·i, and the ripple's heat
//! ```
//!
//! The bridge is the simulator's averaged model: dead time, floating phase and the rise of the current after each commutation are in it.

use servo_core::sense::commutation::{Bridge, bridge};
use servo_core::units::Duty;

use super::known::Known;
use super::linear::{Normal, Solution};
use super::path::Point;
use super::record::Row;
use hil_world::plant::circuit::{Flow, Winding};
use hil_world::plant::inverter::Inverter;
use hil_world::plant::{Model, PlantParams, trapezoid};

/// Steps of the circuit within an interval, s.
const STEP_S: f64 = 100e-6;

/// Error of the bus current: half a step of the ADC (40 A of 4095) by noise and half by rounding.
const ADC_A: f64 = 0.004;

/// Least duty at which the bus current shows that of the phase.
const LEAST_DUTY: f64 = 0.02;

/// Share of a difference by which the duty that nobody recorded follows the measured current in a row.
const FOLLOW: f64 = 0.2;

/// Length of the groups in which errors are correlated, s.
const GROUP_S: f64 = 0.05;

/// What the electrical half consists of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Electric {
    /// Line to line at 25 °C, Ω.
    pub r_ohm: f64,
    /// V·s/rad, and N·m/A.
    pub ke_v_s: f64,
    /// Line to line, H.
    pub l_h: f64,
}

impl Electric {
    /// The first guess.
    pub(crate) fn first(known: &Known) -> Self {
        let PlantParams { r_ohm, ke_v_s, l_mh, .. } = known.plant;
        Self { r_ohm, ke_v_s, l_h: l_mh * 1e-3 }
    }

    fn logs(self) -> [f64; 3] {
        [self.r_ohm.ln(), self.ke_v_s.ln(), self.l_h.ln()]
    }

    fn of(logs: [f64; 3]) -> Self {
        let [r_ohm, ke_v_s, l_h] = logs.map(f64::exp);
        Self { r_ohm, ke_v_s, l_h }
    }
}

/// What the model has in an interval between two rows, means.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Drawn {
    /// Bus current, A.
    pub bus_a: f64,
    /// The motor's torque with the current that was measured, N·m.
    pub torque_n_m: f64,
    /// The duty that was used.
    pub duty: f64,
}

/// The recording as the circuit needs it.
pub struct Bench<'a> {
    /// The rows.
    pub rows: &'a [Row],
    /// The rotor at each.
    pub points: &'a [Point],
    /// Errors of the boundaries, counts, by the sector below.
    pub placement: [f64; 6],
    /// The first guess; dead time, diodes, copper and heat capacities are its plant's.
    pub known: &'a Known,
}

/// The winding and its state.
struct Circuit {
    electric: Electric,
    inverter: Inverter,
    current: [f64; 3],
    /// Rise of the winding over the housing, K.
    rise_k: f64,
    /// Duty beyond the ordered one per speed, s/count, while driving and while braking.
    offsets: [f64; 2],
}

impl Bench<'_> {
    fn circuit(&self, electric: Electric) -> Circuit {
        let winding = Winding::new(1.0, 1e-3, 24.0, self.known.plant.diode_v);
        let dead_s = self.known.plant.dead_time_us * 1e-6;
        Circuit {
            electric,
            inverter: Inverter::new(Model::Averaged, winding, dead_s),
            current: [0.0; 3],
            rise_k: 0.0,
            offsets: [0.0; 2],
        }
    }

    /// Advances the circuit over the interval after a row with a duty; returns charge from the bus (A), torque (N·m) and heat (J).
    fn advance(&self, circuit: &mut Circuit, index: usize, duty: f64) -> (f64, f64, f64) {
        let (from, to) = (self.rows[index], self.rows[index + 1]);
        let (a, b) = (self.points[index], self.points[index + 1]);
        let dt = to.t_s - from.t_s;
        let Electric { r_ohm, ke_v_s, l_h } = circuit.electric;
        let hot = 1.0 + self.known.plant.r_per_k * (from.housing_c + circuit.rise_k - 25.0);
        let winding = Winding::new(0.5 * r_ohm * hot, 0.5 * l_h, from.bus_v, self.known.plant.diode_v);
        circuit.inverter.set_winding(winding);
        let bits = Duty::from_bits((duty * 32768.0).round().clamp(-32767.0, 32767.0) as i16);
        let steps = (dt / STEP_S).ceil().max(1.0);
        let (step, dir) = (dt / steps, (to.cell - from.cell).signum());
        let (mut cell, mut flow, mut impulse) = (from.cell, Flow::default(), 0.0);
        for at in 0..steps as usize {
            let share = (at as f64 + 0.5) / steps;
            let counts = hermite(a, b, dt, share);
            let speed = a.speed + share * (b.speed - a.speed);
            while cell != to.cell && dir as f64 * (counts - self.boundary(cell, dir)) >= 0.0 {
                cell += dir;
            }
            let shape = trapezoid(counts);
            let k = 0.5 * ke_v_s;
            let emf = shape.map(|of| k * of * speed * self.known.plant.rad_per_count());
            let sector = cell.rem_euclid(6) as u8;
            let legs = if from.is_driven { bridge(Some(sector), Some(bits)) } else { Bridge::Off };
            circuit.inverter.set_bridge(legs);
            let before = flow.charge;
            circuit.inverter.advance(&mut circuit.current, emf, 0.0, step, &mut flow);
            impulse +=
                (0..3).map(|phase| k * shape[phase] * (flow.charge[phase] - before[phase])).sum::<f64>();
        }
        (flow.bus_charge / dt, impulse / dt, flow.copper_j)
    }

    fn boundary(&self, cell: i64, dir: i64) -> f64 {
        let below = if dir > 0 { cell } else { cell - 1 };
        below as f64 + 0.5 + self.placement[below.rem_euclid(6) as usize]
    }

    /// The duty by decision 0005, as far as the recording tells: the board's EMF constant is its own.
    fn ordered(&self, electric: Electric, index: usize) -> f64 {
        let row = self.rows[index];
        let units = row.torque;
        let emf = electric.ke_v_s * self.known.plant.rad_per_count() * self.points[index].speed;
        let dead =
            0.01 * (1.0 + 2.0 * self.known.plant.diode_v / row.bus_v) * (units / 30.0).clamp(-1.0, 1.0);
        (units * self.known.unit_v + emf) / row.bus_v + dead
    }

    /// The interval after a row, with the duty that was recorded or else the ordered one, corrected slowly until the model draws what was
    /// measured. What is left of the difference corrects the torque at once.
    fn interval(&self, circuit: &mut Circuit, index: usize) -> Drawn {
        let (row, measured) = (self.rows[index], self.rows[index + 1].bus_a);
        let electric = circuit.electric;
        let speed = self.points[index].speed;
        // The board compensates its EMF in another way while it brakes.
        let kind = usize::from(row.torque * speed < 0.0);
        let duty = match row.duty {
            Some(duty) => duty,
            None if row.is_driven => {
                (self.ordered(electric, index) + circuit.offsets[kind] * speed).clamp(-0.967, 0.967)
            }
            None => 0.0,
        };
        let (bus_a, mut torque, heat) = self.advance(circuit, index, duty);
        let emf = electric.ke_v_s * self.known.plant.rad_per_count() * self.points[index].speed;
        let mut trust = 1.0;
        if row.duty.is_none() && row.is_driven {
            let slope = (2.0 * duty * row.bus_v - emf) / electric.r_ohm;
            // Where the slope is small, the current does not tell the duty.
            if slope.abs() > 1.0 {
                let change = ((measured - bus_a) / slope).clamp(-0.05, 0.05);
                circuit.offsets[kind] += FOLLOW * change * speed / (speed * speed + 1e4);
            }
        } else {
            let e_v = electric.ke_v_s * self.known.plant.rad_per_count() * self.points[index].sigma
                + 0.01 * row.bus_v;
            let e_a = duty.abs() * e_v / electric.r_ohm;
            trust = e_a * e_a / (e_a * e_a + ADC_A * ADC_A);
        }
        let dt = self.rows[index + 1].t_s - row.t_s;
        circuit.rise_k += (heat - circuit.rise_k / self.known.plant.winding_housing_k_w * dt)
            / self.known.plant.winding_j_k;
        // The measured current corrects that of a velocity which is a little wrong.
        if row.is_driven && duty.abs() > LEAST_DUTY {
            torque += trust * electric.ke_v_s * (measured - bus_a) / duty;
        }
        Drawn { bus_a, torque_n_m: torque, duty }
    }

    /// The whole recording: one entry for each interval.
    pub fn run(&self, electric: Electric) -> Vec<Drawn> {
        let mut circuit = self.circuit(electric);
        (0..self.rows.len() - 1).map(|index| self.interval(&mut circuit, index)).collect()
    }

    /// Weight of an interval's bus current; `None` if it tells nothing of the winding.
    fn weight(&self, electric: Electric, index: usize) -> Option<f64> {
        let row = self.rows[index];
        let duty = row.duty.filter(|duty| row.is_driven && duty.abs() > LEAST_DUTY)?;
        let measured = self.rows[index + 1].bus_a;
        let speed_a = duty * electric.ke_v_s * self.known.plant.rad_per_count() * self.points[index].sigma
            / electric.r_ohm;
        let model_a = 0.01 * measured;
        Some(1.0 / (ADC_A * ADC_A + speed_a * speed_a + model_a * model_a))
    }

    /// The constants with which the bus current comes out best, from a first guess, and the covariance of their logarithms. `None` if no
    /// duty is known.
    pub fn fit(&self, guess: Electric) -> Option<(Electric, Solution)> {
        const STEP: f64 = 1e-3;
        let mut electric = guess;
        let mut solution = None;
        for _ in 0..2 {
            let base = self.run(electric);
            let varied: Vec<Vec<Drawn>> = (0..3)
                .map(|index| {
                    let mut logs = electric.logs();
                    logs[index] += STEP;
                    self.run(Electric::of(logs))
                })
                .collect();
            let mut normal = Normal::new(3);
            let mut group = (f64::NEG_INFINITY, Vec::new());
            for (index, drawn) in base.iter().enumerate() {
                let Some(weight) = self.weight(electric, index) else { continue };
                if self.rows[index].t_s > group.0 + GROUP_S {
                    normal.group(std::mem::take(&mut group.1));
                    group.0 = self.rows[index].t_s;
                }
                let row = varied.iter().map(|of| (of[index].bus_a - drawn.bus_a) / STEP).collect();
                let residual = self.rows[index + 1].bus_a - drawn.bus_a;
                // Huber's weight: an impact or a missed edge is no measurement of the winding.
                let score = residual.abs() * weight.sqrt();
                let robust = if score > 4.0 { 4.0 / score } else { 1.0 };
                group.1.push((row, weight * robust, residual));
            }
            normal.group(group.1);
            let logs = electric.logs();
            // Weak beliefs, so that what a move does not show stays a motor: a factor of three of the first guess; L as the data sheet has it, ± 10 %.
            for (index, (centre, sigma)) in
                Electric::first(self.known).logs().into_iter().zip([1.0, 1.0, 0.1]).enumerate()
            {
                normal.prior(index, centre - logs[index], sigma);
            }
            let step = normal.solve()?;
            let next = [0, 1, 2].map(|index| logs[index] + step.x[index].clamp(-0.3, 0.3));
            let is_settled = step.x.iter().all(|x| x.abs() < 1e-5);
            electric = Electric::of(next);
            solution = Some(step);
            if is_settled {
                break;
            }
        }
        Some((electric, solution?))
    }
}

/// Position within an interval, counts, at a share of it.
fn hermite(a: Point, b: Point, dt: f64, share: f64) -> f64 {
    let (s, s2) = (share, share * share);
    let s3 = s2 * s;
    (2.0 * s3 - 3.0 * s2 + 1.0) * a.counts
        + (s3 - 2.0 * s2 + s) * dt * a.speed
        + (3.0 * s2 - 2.0 * s3) * b.counts
        + (s3 - s2) * dt * b.speed
}
