//! The star-connected winding between its terminals: exact currents while terminals and EMF stay as they are.
//!
//! With each terminal at a fixed voltage, or open, every phase current is one exponential towards its own end
//! value, so an interval costs one `exp` and a diode's end of conduction is one `ln`.

/// What holds one terminal for an interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Terminal {
    /// A closed switch, or the mean of a switching leg: `v` volts, current drawn from the bus for `bus_share` of
    /// the time. `bus_share · bus − v` is what is lost on the way, in diodes.
    Held {
        /// Volts above ground.
        v: f64,
        /// 0 for ground, 1 for the bus, between for a mean over a PWM period.
        bus_share: f64,
    },
    /// Both switches open: only the body diodes may conduct.
    Open,
}

/// What flowed during an interval.
#[derive(Clone, Copy, Debug, Default)]
pub struct Flow {
    /// Charge into each phase, C.
    pub charge: [f64; 3],
    /// Charge drawn from the bus, C.
    pub bus_charge: f64,
    /// Heat in the winding, J.
    pub copper_j: f64,
    /// Heat in diodes, J.
    pub drop_j: f64,
}

/// The winding's constants and its rails.
#[derive(Clone, Copy, Debug)]
pub struct Winding {
    /// Resistance of one phase, Ω.
    pub phase_r: f64,
    /// Inductance of one phase, H.
    pub phase_l: f64,
    /// Supply, V.
    pub bus_v: f64,
    /// Forward voltage of a body diode, V.
    pub diode_v: f64,
}

/// A conducting terminal: the volts it holds and its share of the bus.
#[derive(Clone, Copy)]
struct Hold {
    v: f64,
    bus_share: f64,
    diode: bool,
}

impl Winding {
    /// Time constant of the currents, s.
    #[must_use]
    pub fn tau(&self) -> f64 {
        self.phase_l / self.phase_r
    }

    fn low_diode(&self) -> Hold {
        Hold { v: -self.diode_v, bus_share: 0.0, diode: true }
    }

    fn high_diode(&self) -> Hold {
        Hold { v: self.bus_v + self.diode_v, bus_share: 1.0, diode: true }
    }

    /// Advances the currents `i` (A, into the winding) by `dt` seconds with the terminals and the EMFs `e` (V)
    /// held; `decay` is exp(−dt/τ). Adds to `flow`.
    pub fn advance(
        &self,
        i: &mut [f64; 3],
        held: &[Terminal; 3],
        e: [f64; 3],
        dt: f64,
        decay: f64,
        flow: &mut Flow,
    ) {
        let (mut dt, mut decay) = (dt, decay);
        // Each pass but the last ends with a diode falling out of conduction; three legs can do so, and start
        // again, only a few times. What a pathological case leaves undone after 12 is less than one PWM period.
        for _ in 0..12 {
            let Some(end) = self.until_diode_stops(i, held, e, dt, decay, flow) else { return };
            dt -= end;
            if dt <= 0.0 {
                return;
            }
            decay = (-dt / self.tau()).exp();
        }
    }

    /// One interval of one topology: to its end (`None`) or to the first diode's zero current (when that was).
    fn until_diode_stops(
        &self,
        i: &mut [f64; 3],
        held: &[Terminal; 3],
        e: [f64; 3],
        dt: f64,
        decay: f64,
        flow: &mut Flow,
    ) -> Option<f64> {
        let holds = self.conducting(i, held, e);
        let (mut count, mut sum) = (0.0, 0.0);
        for k in 0..3 {
            if let Some(hold) = holds[k] {
                count += 1.0;
                sum += hold.v - e[k];
            }
        }
        if count < 2.0 {
            *i = [0.0; 3];
            return None;
        }
        let star = sum / count;
        let mut to = [0.0; 3];
        let mut end = *i;
        let mut first: Option<(usize, f64)> = None;
        for k in 0..3 {
            let Some(hold) = holds[k] else { continue };
            to[k] = (hold.v - e[k] - star) / self.phase_r;
            end[k] = to[k] + (i[k] - to[k]) * decay;
            // A low diode carries current into the winding (> 0), a high diode out of it (< 0).
            if hold.diode
                && (if hold.bus_share == 0.0 { end[k] <= 0.0 } else { end[k] >= 0.0 })
                && i[k] != 0.0
            {
                let ratio = to[k] / (to[k] - i[k]);
                if first.is_none_or(|(_, r)| ratio > r) {
                    first = Some((k, ratio));
                }
            }
        }
        let mut span = dt;
        let mut stopped = None;
        if let Some((leg, ratio)) = first
            && ratio > decay
        {
            span = (-self.tau() * ratio.ln()).clamp(0.0, dt);
            for k in 0..3 {
                end[k] = if holds[k].is_some() { to[k] + (i[k] - to[k]) * ratio } else { 0.0 };
            }
            stop_leg(&mut end, leg);
            stopped = Some(span);
        } else if let Some((leg, _)) = first {
            stop_leg(&mut end, leg);
        }
        self.account(&holds, i, &to, &end, span, flow);
        *i = end;
        stopped
    }

    /// Which terminals conduct: closed switches, diodes with current, and diodes that the open terminal's
    /// voltage would push beyond the rails.
    fn conducting(&self, i: &[f64; 3], held: &[Terminal; 3], e: [f64; 3]) -> [Option<Hold>; 3] {
        let mut holds = [None; 3];
        let (mut count, mut sum) = (0.0, 0.0);
        let mut open = false;
        for k in 0..3 {
            holds[k] = match held[k] {
                Terminal::Held { v, bus_share } => Some(Hold { v, bus_share, diode: false }),
                Terminal::Open if i[k] > 0.0 => Some(self.low_diode()),
                Terminal::Open if i[k] < 0.0 => Some(self.high_diode()),
                Terminal::Open => None,
            };
            if let Some(hold) = holds[k] {
                count += 1.0;
                sum += hold.v - e[k];
            } else {
                open = true;
            }
        }
        if !open {
            return holds;
        }
        if count == 0.0 {
            return self.rectifying(e);
        }
        // The terminal that is farthest beyond a rail conducts first; then the star point has moved.
        loop {
            let star = sum / count;
            let mut worst: Option<(usize, f64, Hold)> = None;
            for k in 0..3 {
                if holds[k].is_none() {
                    let v = star + e[k];
                    let low = -self.diode_v - v;
                    let high = v - self.bus_v - self.diode_v;
                    let (excess, hold) =
                        if low > high { (low, self.low_diode()) } else { (high, self.high_diode()) };
                    if excess > 0.0 && worst.is_none_or(|(_, w, _)| excess > w) {
                        worst = Some((k, excess, hold));
                    }
                }
            }
            let Some((k, _, hold)) = worst else { return holds };
            holds[k] = Some(hold);
            count += 1.0;
            sum += hold.v - e[k];
        }
    }

    /// All terminals open and no current: the EMF conducts into the bus only if it exceeds it.
    fn rectifying(&self, e: [f64; 3]) -> [Option<Hold>; 3] {
        let mut holds = [None; 3];
        let top = if e[0] >= e[1] && e[0] >= e[2] {
            0
        } else if e[1] >= e[2] {
            1
        } else {
            2
        };
        let bottom = if e[0] < e[1] && e[0] < e[2] {
            0
        } else if e[1] < e[2] {
            1
        } else {
            2
        };
        if e[top] - e[bottom] > self.bus_v + 2.0 * self.diode_v {
            holds[top] = Some(self.high_diode());
            holds[bottom] = Some(self.low_diode());
        }
        holds
    }

    /// Exact integrals of i and i² over `span` of exponentials from `i` to `end` heading for `to`.
    fn account(
        &self,
        holds: &[Option<Hold>; 3],
        i: &[f64; 3],
        to: &[f64; 3],
        end: &[f64; 3],
        span: f64,
        flow: &mut Flow,
    ) {
        let tau = self.tau();
        for k in 0..3 {
            let Some(hold) = holds[k] else { continue };
            let fall = tau * (i[k] - end[k]);
            let charge = to[k] * span + fall;
            let square = to[k] * to[k] * span + fall * (to[k] + 0.5 * (i[k] + end[k]));
            flow.charge[k] += charge;
            flow.bus_charge += hold.bus_share * charge;
            flow.drop_j += (hold.bus_share * self.bus_v - hold.v) * charge;
            flow.copper_j += self.phase_r * square;
        }
    }
}

/// Sets one leg's current to exactly zero and keeps the sum of the three zero.
fn stop_leg(i: &mut [f64; 3], leg: usize) {
    let (a, b) = ((leg + 1) % 3, (leg + 2) % 3);
    let half = 0.5 * (i[a] - i[b]);
    i[leg] = 0.0;
    i[a] = half;
    i[b] = -half;
}
