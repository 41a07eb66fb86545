//! The physical half of one motor: winding, bridge, shaft, joint and heat, in SI units and f64.
//!
//! Knows nothing of sensors or firmware. The caller advances the time; nothing here is random.

pub mod circuit;
pub mod inverter;
pub mod joint;
pub mod params;
pub mod supply;
pub mod thermal;

pub use inverter::Model;
pub use joint::Contact;
pub use params::{ParamError, PlantParams, RAD_PER_COUNT};
pub use supply::{SharedSupply, Supply};
pub use thermal::Heat;

use circuit::{Flow, Winding};
use inverter::{Inverter, PERIOD_US};
use joint::{Joint, Shaft};
use servo_core::sense::commutation::Bridge;

/// Interval of the heat equations and of the resistance update, µs.
const HEAT_US: u64 = 1000;

/// How far beyond a stop a rotor may start, counts: full speed dents one by 2.7.
const START_BEYOND_COUNTS: f64 = 2.0;

/// Energy since the start, J. Input equals losses plus stored energy.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ledger {
    /// From the supply, minus what was fed back.
    pub supply_j: f64,
    /// From the disturbance, and from a hand on the shaft.
    pub disturbance_j: f64,
    /// Heat in the winding.
    pub copper_j: f64,
    /// Heat in the bridge's diodes.
    pub diode_j: f64,
    /// Heat in friction, worm and brake.
    pub friction_j: f64,
    /// Heat in the dampers of stops and objects.
    pub damper_j: f64,
    /// Mechanical work of the motor.
    pub motor_j: f64,
    /// Stored in motion, springs and inductance now, minus what was stored at the start.
    pub stored_j: f64,
}

impl Ledger {
    /// Energy balance error, J: in − lost − stored. Zero except for the integration error.
    #[must_use]
    pub fn residual_j(&self) -> f64 {
        self.supply_j + self.disturbance_j
            - self.copper_j
            - self.diode_j
            - self.friction_j
            - self.damper_j
            - self.stored_j
    }

    /// The scale for the residual, J: the largest entry.
    #[must_use]
    pub fn turnover_j(&self) -> f64 {
        [self.supply_j, self.disturbance_j, self.copper_j, self.friction_j, self.damper_j, self.stored_j]
            .into_iter()
            .fold(0.0, |most, entry| most.max(entry.abs()))
    }
}

/// The state that changes with every step; copied so that a step can be undone.
#[derive(Clone, Copy, Debug)]
pub struct State {
    /// Since the start, µs.
    pub t_us: u64,
    /// The shaft.
    pub shaft: Shaft,
    /// Phase currents into the winding, A.
    pub current: [f64; 3],
    /// Charge drawn from the bus since the start, C.
    pub bus_charge: f64,
    /// Torque of the motor, mean over the last step, N·m.
    pub torque: f64,
    peak_a: f64,
    ledger: Ledger,
    heat: Heat,
    /// Copper and friction heat that the heat equations have not taken yet, J.
    pending: [f64; 2],
    heat_at_us: u64,
}

/// Initial conditions of a run, without current.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// Rotor position, counts.
    pub count: f64,
    /// Rotor velocity, counts/s.
    pub counts_per_s: f64,
    /// Temperatures.
    pub heat: Heat,
}

/// The plant of one motor.
#[derive(Clone, Debug)]
pub struct Plant {
    /// Radians of the shaft per hall count.
    rad_per_count: f64,
    params: PlantParams,
    model: Model,
    max_step_us: u64,
    inverter: Inverter,
    joint: Joint,
    shaft_torque: f64,
    stored_at_start: f64,
    state: State,
    /// The brake's friction torque under which the motor stands, its bridge off and its winding without current, N·m. As long as nothing of that
    /// changes, a step changes its time and its heat alone.
    rests_under: Option<f64>,
}

impl Plant {
    /// A plant at its start.
    ///
    /// # Errors
    /// A parameter is out of range.
    pub fn new(
        params: PlantParams,
        objects: &[Contact],
        model: Model,
        start: Start,
    ) -> Result<Self, ParamError> {
        params.validate()?;
        params::check(&[
            ("start_counts_per_s", start.counts_per_s, -1e4, 1e4),
            ("winding_c", start.heat.winding_c, -60.0, 300.0),
            ("housing_c", start.heat.housing_c, -60.0, 300.0),
        ])?;
        let (low, high) = (params.min_count - 0.5, params.max_count + 0.5);
        if !(start.count >= low - START_BEYOND_COUNTS && start.count <= high + START_BEYOND_COUNTS) {
            let expected =
                format!("at most {START_BEYOND_COUNTS} counts beyond the stops at {low} and {high}");
            return Err(ParamError { field: "start_count", found: start.count, expected });
        }
        let winding = winding(&params, start.heat.winding_c);
        let rad_per_count = params.rad_per_count();
        let shaft = Shaft {
            theta: start.count * rad_per_count,
            omega: start.counts_per_s * rad_per_count,
            ..Shaft::default()
        };
        let joint = Joint::new(&params, objects);
        let stored_at_start = joint.kinetic_j(&shaft) + joint.spring_j(shaft.theta);
        Ok(Self {
            rad_per_count,
            inverter: Inverter::new(model, winding, params.dead_time_us * 1e-6),
            joint,
            model,
            max_step_us: params.longest_step_us(),
            shaft_torque: 0.0,
            rests_under: None,
            stored_at_start,
            state: State {
                t_us: 0,
                shaft,
                current: [0.0; 3],
                bus_charge: 0.0,
                torque: 0.0,
                peak_a: 0.0,
                ledger: Ledger::default(),
                heat: start.heat,
                pending: [0.0; 2],
                heat_at_us: 0,
            },
            params,
        })
    }

    /// Sets the time of a plant that has not been stepped yet, µs.
    pub(crate) fn start_at(&mut self, us: u64) {
        (self.state.t_us, self.state.heat_at_us) = (us, us);
    }

    /// Limits the step to 1..=[`PlantParams::longest_step_us`] µs.
    pub fn set_max_step_us(&mut self, us: u64) {
        self.max_step_us = us.clamp(1, self.params.longest_step_us());
    }

    /// The state, to read or to restore.
    #[must_use]
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Largest phase current since the last call, A; the averaged model adds the ripple to its means.
    pub fn take_peak(&mut self) -> f64 {
        std::mem::take(&mut self.state.peak_a)
    }

    /// Undoes every step since `state` was read; bridge, supply and disturbance stay.
    pub fn restore(&mut self, state: State) {
        self.rests_under = None;
        self.state = state;
    }

    /// Radians of the shaft per hall count.
    #[must_use]
    pub const fn rad_per_count(&self) -> f64 {
        self.rad_per_count
    }

    /// Rotor position, counts.
    #[must_use]
    pub fn counts(&self) -> f64 {
        self.state.shaft.theta / self.rad_per_count
    }

    /// The parameters, with the present supply voltage.
    #[must_use]
    pub fn params(&self) -> &PlantParams {
        &self.params
    }

    /// Temperatures.
    #[must_use]
    pub fn heat(&self) -> Heat {
        self.state.heat
    }

    /// The energy ledger.
    #[must_use]
    pub fn ledger(&self) -> Ledger {
        let s = &self.state;
        let magnetic = 0.5 * self.inverter.winding().phase_l * s.current.iter().map(|i| i * i).sum::<f64>();
        let stored = self.joint.kinetic_j(&s.shaft) + self.joint.spring_j(s.shaft.theta) + magnetic;
        Ledger { stored_j: stored - self.stored_at_start, ..s.ledger }
    }

    /// Torque of a load on the joint, referred to the motor through a gear without losses; through a worm it
    /// cannot drive the motor.
    pub fn set_disturbance(&mut self, n_m: f64) {
        self.rests_under = None;
        let (work_j, lost_j) = self.joint.set_disturbance(self.state.shaft.theta, n_m);
        self.state.ledger.disturbance_j += work_j;
        self.state.ledger.damper_j += lost_j;
    }

    /// Torque on the motor's shaft from outside, N·m: a user who turns the motor by hand.
    pub fn set_shaft_torque(&mut self, n_m: f64) {
        self.rests_under = None;
        self.shaft_torque = n_m;
    }

    /// Position of the joint behind the gear's play and twist, counts of the motor.
    #[must_use]
    pub fn joint_counts(&self) -> f64 {
        self.joint.position(self.state.shaft.theta) / self.rad_per_count
    }

    /// Energy stored in the objects in the joint's way, J.
    #[must_use]
    pub fn objects_j(&self) -> f64 {
        self.joint.objects_j(self.state.shaft.theta)
    }

    /// Replaces the objects in the joint's way. The change of spring energy is booked on the disturbance.
    pub fn set_objects(&mut self, objects: &[Contact]) {
        self.replace(|joint| joint.set_objects(objects));
    }

    /// Puts a person's finger into the joint's way, or takes it out. The change of spring energy is booked as that of objects.
    pub fn set_finger(&mut self, finger: Option<Contact>) {
        self.replace(|joint| joint.set_finger(finger));
    }

    /// What that finger feels, N·m at the motor, and the energy that it stores, J.
    #[must_use]
    pub(crate) fn on_finger(&self) -> (f64, f64) {
        self.joint.on_finger(&self.state.shaft)
    }

    fn replace(&mut self, change: impl FnOnce(&mut Joint)) {
        self.rests_under = None;
        let theta = self.state.shaft.theta;
        let before = self.joint.spring_j(theta);
        change(&mut self.joint);
        self.state.ledger.disturbance_j += self.joint.spring_j(theta) - before;
    }

    /// Changes the supply voltage, at least 0.
    pub fn set_bus(&mut self, v: f64) {
        self.params.bus_v = v.max(0.0);
        self.inverter.set_winding(winding(&self.params, self.state.heat.winding_c));
    }

    /// The longest step from now to at most `until_us`.
    #[must_use]
    pub(crate) fn step_to(&self, until_us: u64) -> u64 {
        let t = self.state.t_us;
        let mut to = until_us.min(t + self.max_step_us);
        if self.model == Model::Switched {
            to = to.min(t - t % PERIOD_US + PERIOD_US);
        }
        to
    }

    /// Advances to `to_us`, at most as far as `step_to` allows, with the bridge unchanged and the
    /// brake's friction torque `brake` in N·m.
    pub fn step(&mut self, bridge: Bridge, brake: f64, to_us: u64) {
        let s = &mut self.state;
        let us = to_us.saturating_sub(s.t_us);
        if us == 0 {
            return;
        }
        if self.rests_under == Some(brake) && bridge == Bridge::Off {
            s.t_us = to_us;
            if s.t_us - s.heat_at_us >= HEAT_US {
                self.heat_up();
            }
            return;
        }
        let dt = us as f64 * 1e-6;
        self.inverter.set_bridge(bridge);
        // Predict the middle of the step with the acceleration of the last one.
        let half = 0.5 * dt;
        let omega = s.shaft.omega + half * s.shaft.acceleration;
        let theta = s.shaft.theta + half * (s.shaft.omega + 0.5 * half * s.shaft.acceleration);
        let shape = trapezoid(theta / self.rad_per_count + f64::from(self.params.zero_sector));
        let k = 0.5 * self.params.ke_v_s;
        let e = shape.map(|f| k * omega * f);
        let phase = (s.t_us % PERIOD_US) as f64 * 1e-6;
        let mut flow = Flow::default();
        self.inverter.advance(&mut s.current, e, phase, dt, &mut flow);
        let impulse = k * (shape[0] * flow.charge[0] + shape[1] * flow.charge[1] + shape[2] * flow.charge[2]);
        s.torque = impulse / dt;
        let before = s.shaft;
        let torque = s.torque + self.shaft_torque;
        let work = self.joint.advance(&mut s.shaft, torque, brake, dt);
        let by_hand_j = self.shaft_torque * (s.shaft.theta - before.theta);
        let stands = [before.omega, before.acceleration, s.shaft.omega, s.shaft.acceleration] == [0.0; 4];
        self.rests_under =
            (stands && bridge == Bridge::Off && s.current == [0.0; 3] && s.torque == 0.0).then_some(brake);
        s.bus_charge += flow.bus_charge;
        s.peak_a = s.peak_a.max(flow.peak_a);
        s.ledger.supply_j += flow.bus_charge * self.params.bus_v;
        s.ledger.copper_j += flow.copper_j;
        s.ledger.diode_j += flow.drop_j;
        s.ledger.motor_j += work.motor - by_hand_j;
        s.ledger.disturbance_j += work.disturbance + by_hand_j;
        s.ledger.friction_j += work.friction;
        s.ledger.damper_j += work.damper;
        s.pending[0] += flow.copper_j;
        s.pending[1] += work.friction;
        s.t_us = to_us;
        if s.t_us - s.heat_at_us >= HEAT_US {
            self.heat_up();
        }
    }

    fn heat_up(&mut self) {
        let s = &mut self.state;
        let dt = (s.t_us - s.heat_at_us) as f64 * 1e-6;
        s.heat.advance(&self.params, s.pending[0], s.pending[1], dt);
        s.pending = [0.0; 2];
        s.heat_at_us = s.t_us;
        self.inverter.set_winding(winding(&self.params, s.heat.winding_c));
    }
}

fn winding(p: &PlantParams, winding_c: f64) -> Winding {
    Winding::new(0.5 * p.pair_ohm(winding_c), 0.5e-3 * p.l_mh, p.bus_v, p.diode_v)
}

/// The three EMFs at an electrical position in sectors of 60°, as fractions of the flat top. In sector k (k −
/// ½ .. k + ½) one phase is at +1, one at −1, and the third crosses over linearly.
#[must_use]
pub fn trapezoid(sectors: f64) -> [f64; 3] {
    // Truncation towards zero is a floor for positive numbers: 2^21 · 6 sectors keep the argument positive.
    const OFFSET: f64 = 12_582_912.0;
    let cell = sectors + 0.5 + OFFSET;
    let whole = cell as u64;
    let ramp = 2.0 * (cell - whole as f64) - 1.0;
    match whole % 6 {
        0 => [1.0, -1.0, -ramp],
        1 => [1.0, ramp, -1.0],
        2 => [-ramp, 1.0, -1.0],
        3 => [-1.0, 1.0, ramp],
        4 => [-1.0, -ramp, 1.0],
        _ => [ramp, -1.0, 1.0],
    }
}
