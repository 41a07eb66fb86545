//! The shaft and every torque on it except the motor's: friction, worm, brake, stops and objects.
//!
//! Implicit midpoint: with forces linear in position and velocity it is stable at any stiffness and closes
//! the energy balance to rounding. Standstill is an exact state, entered at the instant of zero velocity.

use super::params::{PlantParams, RAD_PER_COUNT};

/// A joint's own contacts, before those of objects.
const STOPS: usize = 2;

/// A spring and damper that resists motion beyond a position.
#[derive(Clone, Copy, Debug)]
pub struct Contact {
    /// Position at which it begins, rad at the motor.
    pub from: f64,
    /// +1 resists closing beyond `from`, −1 resists opening below it.
    pub side: f64,
    /// N·m/rad at the motor.
    pub stiffness: f64,
    /// N·m·s/rad at the motor; acts only while being pressed in.
    pub damping: f64,
}

impl Contact {
    /// Energy in the spring at a position in rad, J.
    #[must_use]
    pub fn stored_j(&self, theta: f64) -> f64 {
        let depth = (self.side * (theta - self.from)).max(0.0);
        0.5 * self.stiffness * depth * depth
    }
}

/// The shaft's motion.
#[derive(Clone, Copy, Debug, Default)]
pub struct Shaft {
    /// Position, rad of the motor from count 0.
    pub theta: f64,
    /// Velocity, rad/s.
    pub omega: f64,
    /// Mean acceleration over the last step, rad/s²; it predicts the middle of the next step.
    pub acceleration: f64,
    /// Torque of contacts and disturbance on the motor before the worm, N·m, positive closing.
    pub load: f64,
}

/// Mechanical energy of a step, J.
#[derive(Clone, Copy, Debug, Default)]
pub struct Work {
    /// From the motor.
    pub motor: f64,
    /// From the disturbance.
    pub disturbance: f64,
    /// Lost in friction, worm and brake.
    pub friction: f64,
    /// Lost in the dampers of stops and objects.
    pub damper: f64,
}

/// The constants of the shaft's surroundings.
#[derive(Clone, Debug)]
pub struct Joint {
    j: f64,
    coulomb: f64,
    stiction: f64,
    viscous: f64,
    /// Friction torque per load torque when driving against the load and when moving with it.
    worm: [f64; 2],
    contacts: Vec<Contact>,
}

/// Load torque, linear about a position.
struct Load {
    spring: f64,
    stiffness: f64,
    damping: f64,
}

impl Joint {
    /// The joint of `p` with its two stops and `objects`.
    #[must_use]
    pub fn new(p: &PlantParams, objects: &[Contact]) -> Self {
        let lead = p.worm_lead_deg.to_radians().tan();
        let worm = if lead > 0.0 {
            let (lambda, phi) = (p.worm_lead_deg.to_radians(), p.worm_friction.atan());
            // Motor torque per load torque is tan(φ+λ)/tan λ against the load and tan(φ−λ)/tan λ with it,
            // both against the motion. The excess over the ideal gear's ∓1 is friction.
            [(phi + lambda).tan() / lead - 1.0, (phi - lambda).tan() / lead + 1.0]
        } else {
            [0.0; 2]
        };
        let stop = |count: f64, side: f64| Contact {
            from: count * RAD_PER_COUNT,
            side,
            stiffness: p.stop_stiffness_n_m_rad,
            damping: p.stop_damping_n_m_s,
        };
        let mut contacts = vec![stop(p.min_count - 0.5, -1.0), stop(p.max_count + 0.5, 1.0)];
        contacts.extend_from_slice(objects);
        Self {
            j: p.j_kg_m2,
            coulomb: p.coulomb_n_m,
            stiction: p.static_n_m,
            viscous: p.viscous_n_m_s,
            worm,
            contacts,
        }
    }

    /// Replaces the objects in the joint's way; its stops remain.
    pub fn set_objects(&mut self, objects: &[Contact]) {
        self.contacts.truncate(STOPS);
        self.contacts.extend_from_slice(objects);
    }

    /// Energy stored in springs at a position, J.
    #[must_use]
    pub fn spring_j(&self, theta: f64) -> f64 {
        self.contacts.iter().map(|c| c.stored_j(theta)).sum()
    }

    /// The part of it in objects.
    #[must_use]
    pub fn objects_j(&self, theta: f64) -> f64 {
        self.contacts[STOPS..].iter().map(|c| c.stored_j(theta)).sum()
    }

    /// Kinetic energy, J.
    #[must_use]
    pub fn kinetic_j(&self, shaft: &Shaft) -> f64 {
        0.5 * self.j * shaft.omega * shaft.omega
    }

    /// The contacts that act on the shaft in the middle of the coming `dt`.
    fn load(&self, shaft: &Shaft, dt: f64) -> Load {
        let mid = shaft.theta + 0.5 * dt * shaft.omega;
        let mut load = Load { spring: 0.0, stiffness: 0.0, damping: 0.0 };
        for c in &self.contacts {
            if c.side * (mid - c.from) > 0.0 {
                load.spring -= c.stiffness * (shaft.theta - c.from);
                load.stiffness += c.stiffness;
                if c.side * shaft.omega > 0.0 {
                    load.damping += c.damping;
                }
            }
        }
        load
    }

    /// The fraction of the load torque that acts on a shaft moving in direction `dir`.
    fn worm_factor(&self, load: f64, dir: f64) -> f64 {
        if load * dir < 0.0 { 1.0 + self.worm[0] } else { 1.0 - self.worm[1] }
    }

    /// Advances the shaft by `dt` seconds under the motor's `torque` and the disturbance, N·m; `brake` is the
    /// brake's friction torque.
    pub fn advance(&self, shaft: &mut Shaft, torque: f64, disturbance: f64, brake: f64, dt: f64) -> Work {
        let mut work = Work::default();
        let mut left = dt;
        let before = shaft.omega;
        // A step is cut at contact changes and at standstill: a few times at most.
        for _ in 0..16 {
            if left <= 1e-12 {
                break;
            }
            let mut span = left;
            if shaft.omega != 0.0 {
                for c in &self.contacts {
                    let to_go = (c.from - shaft.theta) / shaft.omega;
                    // Within a nanosecond counts as reached.
                    if to_go > 1e-9 && to_go < span {
                        span = to_go;
                    }
                }
            }
            left -= self.smooth(shaft, torque, disturbance, brake, span, &mut work);
        }
        shaft.acceleration = (shaft.omega - before) / dt;
        work
    }

    /// Advances by at most `dt`, up to standstill, without a change of contacts. Returns the time spent.
    fn smooth(
        &self,
        shaft: &mut Shaft,
        torque: f64,
        disturbance: f64,
        brake: f64,
        dt: f64,
        work: &mut Work,
    ) -> f64 {
        let load = self.load(shaft, dt);
        let static_load = load.spring + disturbance;
        shaft.load = static_load - load.damping * shaft.omega;
        let dir = if shaft.omega != 0.0 {
            shaft.omega.signum()
        } else {
            let limit = self.stiction + brake;
            let pulls = |dir: f64| dir * (torque + self.worm_factor(static_load, dir) * static_load) > limit;
            if pulls(1.0) {
                1.0
            } else if pulls(-1.0) {
                -1.0
            } else {
                return dt; // stuck
            }
        };
        let m = self.worm_factor(shaft.load, dir);
        // J·dω/dt = push − damp·ω̄ − m·stiffness·(ω̄·dt/2), with ω̄ the mean velocity over the segment.
        let push = torque + m * static_load - dir * (self.coulomb + brake);
        let damp = self.viscous + m * load.damping;
        let stiff = m * load.stiffness;
        let omega = shaft.omega;
        let mean_over =
            |dt: f64| (self.j * omega + 0.5 * dt * push) / (self.j + 0.5 * dt * (damp + 0.5 * dt * stiff));
        let mut span = dt;
        let mut mean = mean_over(dt);
        let mut end = 2.0 * mean - omega;
        if end * dir <= 0.0 && omega != 0.0 {
            // Time to standstill, where the mean is half the initial velocity. The spring's part is small, so
            // fixed-point iteration converges.
            span *= omega / (omega - end);
            for _ in 0..3 {
                let brakes = omega * (0.5 * damp + 0.25 * span * stiff) - push;
                if brakes * dir > 0.0 {
                    span = (self.j * omega / brakes).min(dt);
                }
            }
            mean = 0.5 * omega;
            end = 0.0;
        }
        let moved = mean * span;
        let bare = static_load - 0.5 * load.stiffness * moved - load.damping * mean;
        work.motor += torque * moved;
        work.disturbance += disturbance * moved;
        work.damper += load.damping * mean * moved;
        work.friction += (dir * (self.coulomb + brake) + self.viscous * mean + (1.0 - m) * bare) * moved;
        shaft.theta += moved;
        shaft.omega = end;
        span
    }
}
