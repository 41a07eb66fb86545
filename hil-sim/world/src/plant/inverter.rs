//! The bridge: the effect of its three legs on the winding over a step, averaged over the PWM period or edge
//! by edge.

use super::circuit::{Flow, PairFlow, Terminal, Winding};
use servo_core::sense::commutation::{Bridge, Leg};

/// PWM period, µs: 20 kHz.
pub(crate) const PERIOD_US: u64 = 50;
const PERIOD_S: f64 = 50e-6;
/// Compare steps from zero to full duty: a 72 MHz timer counting up and down at 20 kHz. A duty that rounds to
/// full never switches, so it has no dead time.
const COMPARE_STEPS: f64 = 1800.0;

/// The inverter model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// Means over the PWM period.
    Averaged,
    /// Every switching instant.
    Switched,
}

/// A stretch of the PWM period with the PWM leg in one state.
#[derive(Clone, Copy, Debug)]
struct Segment {
    /// Seconds from the period's start.
    end: f64,
    /// exp(−length/τ).
    decay: f64,
    pwm: Terminal,
}

#[derive(Clone, Copy, Debug)]
struct Roles {
    pwm: usize,
    low: usize,
    float: usize,
    /// One leg in each role; otherwise `low` and `float` are the two remaining legs.
    six_step: bool,
}

fn terminals(legs: &[Leg; 3], pwm: Terminal) -> [Terminal; 3] {
    legs.map(|leg| match leg {
        Leg::Pwm => pwm,
        Leg::Low => Terminal::Held { v: 0.0, bus_share: 0.0 },
        Leg::Float => Terminal::Open,
    })
}

/// Half of the peak-to-peak current ripple in two phases at a duty, A.
fn swing(w: &Winding, duty: f64) -> f64 {
    0.25 * w.bus_v * duty * (1.0 - duty) * PERIOD_S / w.phase_l
}

/// The bridge as last commanded, with everything that can be precomputed for it.
#[derive(Clone, Debug)]
pub struct Inverter {
    model: Model,
    /// The averaged model's last step, s, and its exp(−step/τ); most steps are equal.
    mean_decay: (f64, f64),
    bridge: Bridge,
    legs: [Leg; 3],
    roles: Option<Roles>,
    duty: f64,
    winding: Winding,
    dead_s: f64,
    dead_share: f64,
    swing: f64,
    /// Current change of two phases per volt within a dead time, A/V.
    dead_a_v: f64,
    /// 1 / (current change that the bus voltage causes in a dead time), 1/A.
    per_dead_a: f64,
    segments: Vec<Segment>,
}

impl Inverter {
    /// A bridge that is off.
    #[must_use]
    pub fn new(model: Model, winding: Winding, dead_s: f64) -> Self {
        let mut inverter = Self {
            model,
            mean_decay: (0.0, 1.0),
            bridge: Bridge::Off,
            legs: [Leg::Float; 3],
            roles: None,
            duty: 0.0,
            winding,
            dead_s,
            dead_share: dead_s / PERIOD_S,
            swing: 0.0,
            dead_a_v: 0.0,
            per_dead_a: 0.0,
            segments: Vec::new(),
        };
        inverter.build_segments();
        inverter
    }

    /// The winding with the present resistance and supply.
    #[must_use]
    pub fn winding(&self) -> &Winding {
        &self.winding
    }

    /// Changes resistance and supply.
    pub fn set_winding(&mut self, winding: Winding) {
        self.winding = winding;
        self.mean_decay = (0.0, 1.0);
        self.build_segments();
    }

    /// Commands the legs.
    pub fn set_bridge(&mut self, bridge: Bridge) {
        if self.bridge == bridge {
            return;
        }
        self.bridge = bridge;
        let (legs, duty) = match bridge {
            Bridge::Off => ([Leg::Float; 3], 0.0),
            Bridge::On { legs, duty } => {
                let steps = f64::from(duty.0.to_bits()) / 32768.0 * COMPARE_STEPS;
                (legs, steps.round().clamp(0.0, COMPARE_STEPS) / COMPARE_STEPS)
            }
        };
        self.legs = legs;
        self.roles = legs.iter().position(|&leg| leg == Leg::Pwm).map(|pwm| {
            let (a, b) = ((pwm + 1) % 3, (pwm + 2) % 3);
            let (low, float) = if legs[a] == Leg::Low { (a, b) } else { (b, a) };
            Roles { pwm, low, float, six_step: legs[low] == Leg::Low && legs[float] == Leg::Float }
        });
        if duty != self.duty {
            self.duty = duty;
            self.build_segments();
        }
    }

    /// Either gate of the PWM leg turns on a dead time after the other has turned off.
    fn build_segments(&mut self) {
        self.swing = swing(&self.winding, self.duty);
        self.dead_a_v = 0.5 * self.dead_s / self.winding.phase_l;
        // A nanoampere keeps the quotient finite without a supply or a dead time.
        self.per_dead_a = 1.0 / (self.dead_a_v * self.winding.bus_v + 1e-9);
        self.segments.clear();
        if self.model == Model::Averaged {
            return;
        }
        let low = Terminal::Held { v: 0.0, bus_share: 0.0 };
        let high = Terminal::Held { v: self.winding.bus_v, bus_share: 1.0 };
        let t = PERIOD_S;
        let rise = 0.5 * (1.0 - self.duty) * t;
        let fall = t - rise;
        let dead = self.dead_s;
        let plan = if self.duty <= 0.0 {
            [(t, low); 6]
        } else if self.duty >= 1.0 {
            [(t, high); 6]
        } else {
            [
                ((fall + dead - t).clamp(0.0, rise), Terminal::Open),
                (rise, low),
                ((rise + dead).min(fall), Terminal::Open),
                (fall, high),
                ((fall + dead).min(t), Terminal::Open),
                (t, low),
            ]
        };
        let tau = self.winding.tau;
        let mut start = 0.0;
        for (end, pwm) in plan {
            if end > start {
                self.segments.push(Segment { end, decay: libm::exp((start - end) / tau), pwm });
                start = end;
            }
        }
    }

    /// Advances the currents over `dt` seconds from `phase` seconds into the PWM period. In the switched
    /// model the step must not leave the period.
    pub fn advance(&mut self, i: &mut [f64; 3], e: [f64; 3], phase: f64, dt: f64, flow: &mut Flow) {
        let Some(roles) = self.roles else {
            let decay = self.mean_decay(dt);
            self.winding.advance(i, &terminals(&self.legs, Terminal::Open), e, dt, decay, flow);
            return;
        };
        match self.model {
            Model::Averaged => {
                let idle = i[roles.float] == 0.0;
                let decay = self.mean_decay(dt);
                let (v, bus_share) = self.mean_leg(i[roles.pwm], e[roles.pwm] - e[roles.low]);
                self.mean(roles, Terminal::Held { v, bus_share }, i, e, (dt, decay), flow);
                // A triangle of ±swing has the mean square swing²/3, in two phases; the supply delivers it.
                let w = &self.winding;
                let swing = swing(w, bus_share);
                let ripple_j = 2.0 * w.phase_r * swing * swing / 3.0 * dt;
                flow.copper_j += ripple_j;
                flow.bus_charge += ripple_j / w.bus_v.max(1.0);
                flow.peak_a += swing;
                if roles.six_step && idle && i[roles.float] == 0.0 {
                    self.float_pulses(roles, bus_share, e, dt, flow);
                }
            }
            Model::Switched => self.run(roles, &self.segments, i, e, (phase, phase + dt), flow),
        }
    }

    fn mean_decay(&mut self, dt: f64) -> f64 {
        if self.mean_decay.0 != dt {
            self.mean_decay = (dt, libm::exp(-dt / self.winding.tau));
        }
        self.mean_decay.1
    }

    /// Advances by `dt` with the PWM leg at its mean.
    #[inline(always)]
    fn mean(
        &self,
        roles: Roles,
        pwm_leg: Terminal,
        i: &mut [f64; 3],
        e: [f64; 3],
        (dt, decay): (f64, f64),
        flow: &mut Flow,
    ) {
        let w = &self.winding;
        let Roles { pwm, low, float, six_step } = roles;
        let mut pair = PairFlow::default();
        let mut current = i[pwm];
        if six_step
            && i[float] == 0.0
            && w.advance_pair(&mut current, pwm_leg, [e[pwm], e[low], e[float]], dt, decay, &mut pair)
        {
            i[pwm] = current;
            i[low] = -current;
        } else {
            w.advance(i, &terminals(&self.legs, pwm_leg), e, dt, decay, flow);
        }
        flow.add_pair(pwm, low, &pair, w.phase_r);
    }

    /// Advances from `begin` to `end`, seconds into the PWM period.
    fn run(
        &self,
        roles: Roles,
        segments: &[Segment],
        i: &mut [f64; 3],
        e: [f64; 3],
        (begin, end): (f64, f64),
        flow: &mut Flow,
    ) {
        let w = &self.winding;
        let Roles { pwm, low, float, six_step } = roles;
        let pair_e = [e[pwm], e[low], e[float]];
        let mut pair = PairFlow::default();
        let mut start = 0.0;
        for segment in segments {
            if segment.end > begin && start < end {
                let dt = segment.end.min(end) - f64::max(start, begin);
                // Rounding of the phase must not count as a cut segment.
                let whole = dt > (segment.end - start) * (1.0 - 1e-9);
                let decay = if whole { segment.decay } else { libm::exp(-dt / w.tau) };
                let mut current = i[pwm];
                if six_step
                    && i[float] == 0.0
                    && w.advance_pair(&mut current, segment.pwm, pair_e, dt, decay, &mut pair)
                {
                    i[pwm] = current;
                    i[low] = -current;
                } else {
                    w.advance(i, &terminals(&self.legs, segment.pwm), e, dt, decay, flow);
                }
            }
            start = segment.end;
        }
        flow.add_pair(pwm, low, &pair, w.phase_r);
    }

    /// Mean voltage and bus share of the PWM leg at a mean current of `i` A, against the driven pair's `emf`.
    /// During a dead time the current selects the diode: at the rising edge the ripple's valley loses the
    /// dead time if it is positive; at the falling edge its peak gains it if it is negative. A current that
    /// reaches zero within the dead time stays there, at the voltage of the EMF, for the rest. That makes the
    /// selection a ramp as wide as the current change that the bus causes in a dead time, with (bus − emf) of
    /// it on the negative side.
    fn mean_leg(&self, i: f64, emf: f64) -> (f64, f64) {
        let w = &self.winding;
        if self.duty <= 0.0 || self.duty >= 1.0 {
            return (self.duty * w.bus_v, self.duty);
        }
        let dead = self.dead_share;
        let zero = self.dead_a_v * (w.bus_v - emf);
        let positive = |i: f64| ((i + zero) * self.per_dead_a).clamp(0.0, 1.0);
        let valley = positive(i - self.swing);
        let peak = positive(i + self.swing);
        let bus_share = (self.duty - dead * (valley - (1.0 - peak))).clamp(0.0, 1.0);
        let drop = dead * w.diode_v * (2.0 * (valley + peak) - 2.0);
        (bus_share * w.bus_v - drop, bus_share)
    }

    /// The floating leg's diode pulses within a PWM period, which the mean voltages do not show. With the PWM
    /// leg low, the star point is near ground, and a negative EMF of the floating phase makes its low diode
    /// conduct until some time into the on-time; with the PWM leg high, the same happens towards the bus.
    /// Triangular pulses, resistance neglected (25 µs against τ = 330 µs).
    fn float_pulses(&self, roles: Roles, share: f64, e: [f64; 3], dt: f64, flow: &mut Flow) {
        let w = &self.winding;
        let Roles { pwm, low, float, .. } = roles;
        let off_v = e[float] - 0.5 * (e[pwm] + e[low]);
        let half_bus = 0.5 * w.bus_v;
        let below = -w.diode_v - off_v;
        let above = off_v + half_bus - w.bus_v - w.diode_v;
        let (drive, active, sign) = if below > 0.0 {
            (below, 1.0 - share, 1.0)
        } else if above > 0.0 {
            (above, share, -1.0)
        } else {
            return;
        };
        let release = active * drive / (half_bus - drive);
        if drive >= half_bus || release > 1.0 - active {
            return; // continuous: the mean circuit has it
        }
        // Everything is per period: times are fractions of it, so a mean current is a peak times a fraction.
        let peak = 2.0 / 3.0 * drive * active * PERIOD_S / w.phase_l;
        let mean = 0.5 * peak * (active + release) * sign;
        flow.peak_a = flow.peak_a.max(peak);
        flow.charge[float] += mean * dt;
        flow.charge[pwm] -= 0.5 * mean * dt;
        flow.charge[low] -= 0.5 * mean * dt;
        flow.bus_charge -=
            dt * if sign > 0.0 { 0.25 * peak * release } else { 0.25 * peak * active + 0.5 * peak * release };
        flow.drop_j += w.diode_v * mean.abs() * dt;
        flow.copper_j += w.phase_r * 1.5 * peak * peak / 3.0 * (active + release) * dt;
    }
}
