//! The shaft and every torque on it except the motor's current's: friction, cogging, worm, brake, stops and objects.
//!
//! Behind the gear is the joint, without inertia: its own is a hundredth of the rotor's. Backlash and the gear's compliance separate the two,
//! so contacts and the load act on the joint, which rests on the flank to which they push it.
//!
//! Implicit midpoint: with forces linear in position and velocity it is stable at any stiffness and closes
//! the energy balance to rounding. Cogging is linear about the middle of each step. Standstill is an exact state, entered at the instant
//! of zero velocity.

use std::cell::Cell;

use super::params::PlantParams;

/// A joint's stops, the first of its contacts; a person's finger, if there is one, and objects follow.
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
    /// 1 / the speed at which the friction beyond Coulomb's has fallen to 1/e, s/rad; infinite where it falls at once.
    per_stribeck: f64,
    viscous: f64,
    cogging: f64,
    /// Cogging periods per turn of the motor: the least common multiple of slots and poles, such as 9 and 6; once a count.
    per_turn: f64,
    /// Friction torque per load torque when driving against the load and when moving with it.
    worm: [f64; 2],
    /// Rotor and joint move freely against each other by so much, rad.
    backlash: f64,
    /// rad/(N·m).
    compliance: f64,
    contacts: Vec<Contact>,
    /// The person's finger among them.
    finger: Option<Contact>,
    /// Where the rotor is when the joint meets each contact.
    meetings: Vec<f64>,
    /// Positions of the joint between which it presses no contact.
    clear: (f64, f64),
    /// Torque of a load on the joint, N·m at the motor.
    disturbance: f64,
    /// Where the joint was last behind which rotor: a motor that stands and presses asks at each step.
    last: Cell<Option<(f64, Behind)>>,
}

/// Torque that the gear transmits to the rotor, linear about a position.
struct Load {
    torque: f64,
    stiffness: f64,
    damping: f64,
}

/// The joint behind the gear.
#[derive(Clone, Copy, Debug)]
struct Behind {
    /// Its position, rad at the motor.
    theta: f64,
    /// Torque of contacts and load on it.
    torque: f64,
    /// Stiffness of the contacts that it presses.
    stiffness: f64,
    /// In the gap between the flanks it does not follow the rotor.
    is_free: bool,
}

impl Joint {
    /// The joint of `p` with its two stops and `objects`.
    #[must_use]
    pub fn new(p: &PlantParams, objects: &[Contact]) -> Self {
        let lead = libm::tan(p.worm_lead_deg.to_radians());
        let worm = if lead > 0.0 {
            let (lambda, phi) = (p.worm_lead_deg.to_radians(), libm::atan(p.worm_friction));
            // Motor torque per load torque is tan(φ+λ)/tan λ against the load and tan(φ−λ)/tan λ with it,
            // both against the motion. The excess over the ideal gear's ∓1 is friction.
            [libm::tan(phi + lambda) / lead - 1.0, libm::tan(phi - lambda) / lead + 1.0]
        } else {
            [0.0; 2]
        };
        let stop = |count: f64, side: f64| Contact {
            from: count * p.rad_per_count(),
            side,
            stiffness: p.stop_stiffness_n_m_rad,
            damping: p.stop_damping_n_m_s,
        };
        let mut contacts = vec![stop(p.min_count - 0.5, -1.0), stop(p.max_count + 0.5, 1.0)];
        contacts.extend_from_slice(objects);
        let mut joint = Self {
            j: p.j_kg_m2,
            coulomb: p.coulomb_n_m,
            stiction: p.static_n_m,
            per_stribeck: 1.0 / (p.stribeck_counts_s * p.rad_per_count()),
            viscous: p.viscous_n_m_s,
            cogging: p.cogging_n_m,
            per_turn: 6.0 * f64::from(p.pole_pairs),
            worm,
            backlash: p.backlash_counts * p.rad_per_count(),
            compliance: p.gear_rad_n_m,
            contacts,
            finger: None,
            meetings: Vec::new(),
            clear: (0.0, 0.0),
            disturbance: 0.0,
            last: Cell::new(None),
        };
        joint.place_contacts();
        joint
    }

    /// What depends on contacts and load only: each step asks for it.
    fn place_contacts(&mut self) {
        self.last.set(None);
        self.meetings = self.contacts.iter().map(|c| self.meets(c)).collect();
        let from = |side: f64| self.contacts.iter().filter(move |c| c.side == side).map(|c| c.from);
        self.clear = (from(-1.0).fold(f64::NEG_INFINITY, f64::max), from(1.0).fold(f64::INFINITY, f64::min));
    }

    /// Whether nothing loads the joint behind a rotor's position, wherever it is in its play.
    fn is_clear(&self, rotor: f64) -> bool {
        let half = 0.5 * self.backlash;
        self.disturbance == 0.0 && rotor - half >= self.clear.0 && rotor + half <= self.clear.1
    }

    /// Where objects begin among the contacts.
    fn own(&self) -> usize {
        STOPS + usize::from(self.finger.is_some())
    }

    /// Puts a person's finger into the joint's way, or takes it out.
    pub fn set_finger(&mut self, finger: Option<Contact>) {
        self.contacts.splice(STOPS..self.own(), finger);
        self.finger = finger;
        self.place_contacts();
    }

    /// What a person's finger in the joint's way feels, N·m at the motor, and the energy that it stores, J.
    #[must_use]
    pub(crate) fn on_finger(&self, shaft: &Shaft) -> (f64, f64) {
        let Some(finger) = self.finger else { return (0.0, 0.0) };
        let joint = self.position(shaft.theta);
        let depth = finger.side * (joint - finger.from);
        if depth <= 0.0 {
            return (0.0, 0.0);
        }
        let speed = (finger.side * shaft.omega).max(0.0);
        (finger.stiffness * depth + finger.damping * speed, finger.stored_j(joint))
    }

    /// Replaces the objects in the joint's way; its stops and a finger remain.
    pub fn set_objects(&mut self, objects: &[Contact]) {
        self.contacts.truncate(self.own());
        self.contacts.extend_from_slice(objects);
        self.place_contacts();
    }

    /// Changes the load on the joint, N·m at the motor. Returns the work of the load on a joint that changes the flank, and what of it the
    /// impact takes, J.
    pub fn set_disturbance(&mut self, theta: f64, n_m: f64) -> (f64, f64) {
        let (before, stored) = (self.behind(theta).theta, self.spring_j(theta));
        self.disturbance = n_m;
        self.place_contacts();
        let work = n_m * (self.behind(theta).theta - before);
        (work, work - (self.spring_j(theta) - stored))
    }

    /// Whether the joint follows the rotor exactly.
    fn is_rigid(&self) -> bool {
        self.backlash == 0.0 && self.compliance == 0.0
    }

    /// Torque of contacts and load on a joint at a position, and the stiffness of the contacts that it presses.
    fn torque_at(&self, joint: f64) -> (f64, f64) {
        let mut sum = (self.disturbance, 0.0);
        for c in &self.contacts {
            if c.side * (joint - c.from) > 0.0 {
                sum.0 -= c.stiffness * (joint - c.from);
                sum.1 += c.stiffness;
            }
        }
        sum
    }

    /// Where contacts and load balance a spring with its rest at `flank`, N·m/rad: between `low` and `high`, from `start` on. Newton's steps
    /// are exact on the right piece of the contacts' sum; one to where another came from would go to and fro, and halves the bracket instead.
    fn balance(&self, start: f64, low: f64, high: f64, (flank, spring): (f64, f64)) -> f64 {
        let (mut low, mut high, mut joint) = (low - 1e-9, high + 1e-9, start);
        for _ in 0..64 {
            let (torque, stiffness) = self.torque_at(joint);
            let left = torque - spring * (joint - flank);
            if left == 0.0 {
                break;
            }
            *(if left > 0.0 { &mut low } else { &mut high }) = joint;
            let next = joint + left / (stiffness + spring);
            let next = if low < next && next < high { next } else { 0.5 * (low + high) };
            let is_settled = (next - joint).abs() < 1e-12;
            joint = next;
            if is_settled {
                break;
            }
        }
        joint
    }

    /// The joint behind a rotor's position.
    fn behind(&self, rotor: f64) -> Behind {
        match self.last.get() {
            Some((at, behind)) if at.to_bits() == rotor.to_bits() => behind,
            _ => {
                let behind = self.find_behind(rotor);
                self.last.set(Some((rotor, behind)));
                behind
            }
        }
    }

    fn find_behind(&self, rotor: f64) -> Behind {
        let half = 0.5 * self.backlash;
        let at = |theta: f64| {
            let (torque, stiffness) = self.torque_at(theta);
            Behind { theta, torque, stiffness, is_free: false }
        };
        let closing = at(rotor - half);
        let mut behind = if closing.torque < 0.0 {
            closing
        } else {
            let opening = if half > 0.0 { at(rotor + half) } else { closing };
            if opening.torque > 0.0 {
                opening
            } else if closing.torque == 0.0 && opening.torque == 0.0 {
                // Nothing touches the joint between its flanks either: contacts only push the harder the deeper they are met.
                return Behind { theta: rotor, torque: 0.0, stiffness: 0.0, is_free: true };
            } else {
                // Neither flank touches it: its contacts have pushed it back to where they balance the load.
                let theta = self.balance(rotor, rotor - half, rotor + half, (0.0, 0.0));
                return Behind { theta, torque: 0.0, stiffness: 0.0, is_free: true };
            }
        };
        if self.compliance > 0.0 {
            let flank = behind.theta;
            let yields = flank + self.compliance * behind.torque;
            let spring = 1.0 / self.compliance;
            let theta = self.balance(flank, flank.min(yields), flank.max(yields), (flank, spring));
            let (_, stiffness) = self.torque_at(theta);
            behind = Behind { theta, torque: spring * (theta - flank), stiffness, is_free: false };
        }
        behind
    }

    /// Energy stored in springs and in the magnets at a position, J.
    #[must_use]
    pub(crate) fn spring_j(&self, theta: f64) -> f64 {
        let magnets = self.cogging / self.per_turn * (1.0 - libm::cos(self.per_turn * theta));
        let joint = self.behind(theta);
        let gear = 0.5 * self.compliance * joint.torque * joint.torque;
        self.contacts.iter().map(|c| c.stored_j(joint.theta)).sum::<f64>() + gear + magnets
    }

    /// The joint's own position, rad at the motor.
    #[must_use]
    pub fn position(&self, theta: f64) -> f64 {
        if self.is_rigid() { theta } else { self.behind(theta).theta }
    }

    /// The part of it in objects.
    #[must_use]
    pub fn objects_j(&self, theta: f64) -> f64 {
        let joint = self.position(theta);
        self.contacts[self.own()..].iter().map(|c| c.stored_j(joint)).sum()
    }

    /// Kinetic energy, J.
    #[must_use]
    pub(crate) fn kinetic_j(&self, shaft: &Shaft) -> f64 {
        0.5 * self.j * shaft.omega * shaft.omega
    }

    /// The load on the shaft about the middle of the coming `dt`.
    fn load(&self, shaft: &Shaft, dt: f64) -> Load {
        let mid = shaft.theta + 0.5 * dt * shaft.omega;
        let none = Load { torque: 0.0, stiffness: 0.0, damping: 0.0 };
        if self.is_clear(mid) {
            return none;
        }
        let joint = self.behind(mid);
        if joint.is_free {
            return none;
        }
        // How far the joint follows the rotor.
        let follow = 1.0 / (1.0 + self.compliance * joint.stiffness);
        let stiffness = follow * joint.stiffness;
        let pressed = |c: &&Contact| c.side * (joint.theta - c.from) > 0.0 && c.side * shaft.omega > 0.0;
        let damping: f64 = self.contacts.iter().filter(pressed).map(|c| c.damping).sum();
        Load {
            torque: joint.torque + stiffness * (mid - shaft.theta),
            stiffness,
            damping: follow * follow * damping,
        }
    }

    /// Where the rotor is when the joint meets a contact.
    fn meets(&self, c: &Contact) -> f64 {
        if self.is_rigid() {
            return c.from;
        }
        let torque = self.torque_at(c.from).0;
        let flank = if torque == 0.0 { c.side } else { -torque.signum() };
        c.from + 0.5 * flank * self.backlash - self.compliance * torque
    }

    /// Torque of the magnets at a position, linear about the position `mid`, and its stiffness. A rotor rests in the middle of a count.
    fn cogging(&self, theta: f64, mid: f64) -> (f64, f64) {
        if self.cogging == 0.0 {
            return (0.0, 0.0);
        }
        let (sin, cos) = libm::sincos(self.per_turn * mid);
        let stiffness = self.per_turn * self.cogging * cos;
        (-self.cogging * sin - stiffness * (theta - mid), stiffness)
    }

    /// Friction of a moving shaft without its viscous part, N·m (Stribeck).
    fn sliding(&self, omega: f64) -> f64 {
        let speed = omega * self.per_stribeck;
        // Beyond three times the Stribeck speed a ten-thousandth is left.
        if speed.abs() < 3.0 {
            self.coulomb + (self.stiction - self.coulomb) * libm::exp(-speed * speed)
        } else {
            self.coulomb
        }
    }

    /// The fraction of the load torque that acts on a shaft moving in direction `dir`.
    fn worm_factor(&self, load: f64, dir: f64) -> f64 {
        if load * dir < 0.0 { 1.0 + self.worm[0] } else { 1.0 - self.worm[1] }
    }

    /// Advances the shaft by `dt` seconds under the motor's `torque` and the load, N·m; `brake` is the brake's
    /// friction torque.
    pub fn advance(&self, shaft: &mut Shaft, torque: f64, brake: f64, dt: f64) -> Work {
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
                // A division costs more than the rest: none where the contact is certainly farther.
                let reach = (1.001 * left * shaft.omega).abs();
                for meets in &self.meetings {
                    let distance = meets - shaft.theta;
                    if distance.abs() > reach {
                        continue;
                    }
                    let to_go = distance / shaft.omega;
                    // Within a nanosecond counts as reached.
                    if to_go > 1e-9 && to_go < span {
                        span = to_go;
                    }
                }
            }
            left -= self.smooth(shaft, torque, brake, span, &mut work);
        }
        shaft.acceleration = (shaft.omega - before) / dt;
        work
    }

    /// Advances by at most `dt`, up to standstill, without a change of contacts. Returns the time spent.
    fn smooth(&self, shaft: &mut Shaft, torque: f64, brake: f64, dt: f64, work: &mut Work) -> f64 {
        let load = self.load(shaft, dt);
        let half = 0.5 * dt;
        let mid = shaft.theta + half * (shaft.omega + 0.5 * half * shaft.acceleration);
        let (cogging, magnets) = self.cogging(shaft.theta, mid);
        let driving = torque + cogging;
        let static_load = load.torque;
        shaft.load = static_load - load.damping * shaft.omega;
        let dir = if shaft.omega != 0.0 {
            shaft.omega.signum()
        } else {
            let limit = self.stiction + brake;
            let pulls = |dir: f64| dir * (driving + self.worm_factor(static_load, dir) * static_load) > limit;
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
        let sliding = self.sliding(shaft.omega + half * shaft.acceleration);
        let push = driving + m * static_load - dir * (sliding + brake);
        let damp = self.viscous + m * load.damping;
        let stiff = m * load.stiffness + magnets;
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
        work.damper += load.damping * mean * moved;
        work.friction += (dir * (sliding + brake) + self.viscous * mean + (1.0 - m) * bare) * moved;
        if self.disturbance != 0.0 {
            let followed = if self.is_rigid() {
                moved
            } else {
                self.behind(shaft.theta + moved).theta - self.behind(shaft.theta).theta
            };
            work.disturbance += self.disturbance * followed;
        }
        shaft.theta += moved;
        shaft.omega = end;
        span
    }
}
