//! The star-connected winding between its terminals: exact currents while terminals and EMF are constant.
//!
//! With each terminal at a fixed voltage or open, every phase current is one exponential towards its own end
//! value. An interval costs one `exp`, and the end of a diode's conduction one `ln`.

/// The state of one terminal during an interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Terminal {
    /// A closed switch, or the mean of a switching leg: `v` volts, with current drawn from the bus for
    /// `bus_share` of the time. `bus_share · bus − v` is lost in diodes.
    Held {
        /// Volts above ground.
        v: f64,
        /// 0 for ground, 1 for the bus, in between for a mean over a PWM period.
        bus_share: f64,
    },
    /// Both switches open: only the body diodes can conduct.
    Open,
}

/// Charges and losses of an interval.
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
    /// Largest phase current, A, at the ends of the exponentials, where their extremes are.
    pub peak_a: f64,
}

/// Flow through two driven phases in series, from the first into the second.
#[derive(Clone, Copy, Debug, Default)]
pub struct PairFlow {
    charge: f64,
    bus_charge: f64,
    drop_j: f64,
    /// Integral of i², A²s.
    square: f64,
    peak_a: f64,
}

impl Flow {
    /// Adds the flow from phase `first` into phase `second`.
    pub fn add_pair(&mut self, first: usize, second: usize, pair: &PairFlow, phase_r: f64) {
        self.charge[first] += pair.charge;
        self.charge[second] -= pair.charge;
        self.bus_charge += pair.bus_charge;
        self.drop_j += pair.drop_j;
        self.copper_j += 2.0 * phase_r * pair.square;
        self.peak_a = self.peak_a.max(pair.peak_a);
    }
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
    /// Time constant of the currents, s.
    pub tau: f64,
    /// 1 / the resistance of two phases in series, S.
    per_pair_r: f64,
}

#[derive(Clone, Copy)]
struct Hold {
    v: f64,
    bus_share: f64,
    /// Sign of the only current that can flow into the winding: +1 through the low diode, −1 through the high
    /// one; 0 for a switch, which carries both.
    diode: f64,
}

const NO_HOLD: Hold = Hold { v: 0.0, bus_share: 0.0, diode: 0.0 };

struct Topology {
    holds: [Hold; 3],
    on: [bool; 3],
    count: u8,
    /// Sum over the conducting terminals of v − e.
    sum: f64,
}

impl Topology {
    fn connect(&mut self, leg: usize, hold: Hold, e: [f64; 3]) {
        self.holds[leg] = hold;
        self.on[leg] = true;
        self.count += 1;
        self.sum += hold.v - e[leg];
    }
}

impl Winding {
    /// Resistance (Ω) and inductance (H) of one phase; supply and forward voltage of a body diode, V.
    #[must_use]
    pub fn new(phase_r: f64, phase_l: f64, bus_v: f64, diode_v: f64) -> Self {
        Self { phase_r, phase_l, bus_v, diode_v, tau: phase_l / phase_r, per_pair_r: 0.5 / phase_r }
    }

    fn low_diode(&self) -> Hold {
        Hold { v: -self.diode_v, bus_share: 0.0, diode: 1.0 }
    }

    fn high_diode(&self) -> Hold {
        Hold { v: self.bus_v + self.diode_v, bus_share: 1.0, diode: -1.0 }
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
        // Each pass but the last ends when a diode stops conducting. Three legs can do so, and start again,
        // only a few times in a PWM period.
        for _ in 0..12 {
            let topology = self.topology(i, held, e);
            let spent = match topology.count {
                0 | 1 => {
                    *i = [0.0; 3];
                    return;
                }
                2 => self.pair(&topology, i, e, dt, decay, flow),
                _ => self.star(&topology, i, e, dt, decay, flow),
            };
            let Some(spent) = spent else { return };
            dt -= spent;
            if dt <= 0.0 {
                return;
            }
            decay = libm::exp(-dt / self.tau);
        }
    }

    /// [`Winding::advance`] for the usual case, several times as fast: current `i` flows into the phase at
    /// terminal `first` and out of one at ground; the third phase has none; `e` is in that order. Returns
    /// `false` if that changed within the interval; then nothing has been modified.
    #[inline]
    pub fn advance_pair(
        &self,
        i: &mut f64,
        first: Terminal,
        e: [f64; 3],
        dt: f64,
        decay: f64,
        flow: &mut PairFlow,
    ) -> bool {
        let (v, bus_share, diode) = match first {
            Terminal::Held { v, bus_share } => (v, bus_share, false),
            Terminal::Open if *i > 0.0 => (-self.diode_v, 0.0, true),
            Terminal::Open => (self.bus_v + self.diode_v, 1.0, true),
        };
        let open = e[2] + 0.5 * (v - e[0] - e[1]);
        let to = (v - e[0] + e[1]) * self.per_pair_r;
        let end = settled(to + (*i - to) * decay);
        if open < -self.diode_v || open > self.bus_v + self.diode_v || (diode && end * *i <= 0.0) {
            return false;
        }
        let (charge, square) = self.integrals(*i, to, end, dt);
        flow.charge += charge;
        flow.bus_charge += bus_share * charge;
        flow.drop_j += (bus_share * self.bus_v - v) * charge;
        flow.square += square;
        flow.peak_a = flow.peak_a.max(end.abs());
        *i = end;
        true
    }

    /// Conducting terminals: closed switches, diodes with current, and diodes biased beyond the rails.
    #[inline]
    fn topology(&self, i: &[f64; 3], held: &[Terminal; 3], e: [f64; 3]) -> Topology {
        let mut t = Topology { holds: [NO_HOLD; 3], on: [false; 3], count: 0, sum: 0.0 };
        for k in 0..3 {
            match held[k] {
                Terminal::Held { v, bus_share } => t.connect(k, Hold { v, bus_share, diode: 0.0 }, e),
                Terminal::Open if i[k] > 0.0 => t.connect(k, self.low_diode(), e),
                Terminal::Open if i[k] < 0.0 => t.connect(k, self.high_diode(), e),
                Terminal::Open => {}
            }
        }
        if t.count == 0 {
            self.rectify(&mut t, e);
            return t;
        }
        // The terminal farthest beyond a rail conducts first; that moves the star point.
        while t.count < 3 {
            let star = t.sum * if t.count == 2 { 0.5 } else { 1.0 };
            let mut worst = (0.0, 0, NO_HOLD);
            for (k, emf) in e.into_iter().enumerate() {
                if !t.on[k] {
                    let v = star + emf;
                    if -self.diode_v - v > worst.0 {
                        worst = (-self.diode_v - v, k, self.low_diode());
                    } else if v - self.bus_v - self.diode_v > worst.0 {
                        worst = (v - self.bus_v - self.diode_v, k, self.high_diode());
                    }
                }
            }
            if worst.0 <= 0.0 {
                break;
            }
            t.connect(worst.1, worst.2, e);
        }
        t
    }

    /// All terminals open and no current: the EMF conducts into the bus only if it exceeds the bus.
    fn rectify(&self, t: &mut Topology, e: [f64; 3]) {
        let (mut top, mut bottom) = (0, 0);
        for (k, &emf) in e.iter().enumerate() {
            if emf > e[top] {
                top = k;
            }
            if emf < e[bottom] {
                bottom = k;
            }
        }
        if e[top] - e[bottom] > self.bus_v + 2.0 * self.diode_v {
            t.connect(top, self.high_diode(), e);
            t.connect(bottom, self.low_diode(), e);
        }
    }

    /// Two conducting terminals. Returns the time at which a diode stopped conducting, if one did.
    #[inline]
    fn pair(
        &self,
        t: &Topology,
        i: &mut [f64; 3],
        e: [f64; 3],
        dt: f64,
        decay: f64,
        flow: &mut Flow,
    ) -> Option<f64> {
        let (a, b) = match t.on {
            [false, ..] => (1, 2),
            [_, false, _] => (2, 0),
            _ => (0, 1),
        };
        let (from, into) = (t.holds[a], t.holds[b]);
        let start = i[a];
        let to = (from.v - e[a] - 0.5 * t.sum) / self.phase_r;
        let mut end = settled(to + (start - to) * decay);
        let mut span = dt;
        let mut stopped = None;
        if start != 0.0 && (wrong_way(from, end) || wrong_way(into, -end)) {
            span = (-self.tau * libm::log(to / (to - start))).clamp(0.0, dt);
            end = 0.0;
            stopped = Some(span);
        }
        let (charge, square) = self.integrals(start, to, end, span);
        let share = from.bus_share - into.bus_share;
        flow.charge[a] += charge;
        flow.charge[b] -= charge;
        flow.bus_charge += share * charge;
        flow.drop_j += (share * self.bus_v - (from.v - into.v)) * charge;
        flow.copper_j += 2.0 * self.phase_r * square;
        flow.peak_a = flow.peak_a.max(end.abs());
        i[a] = end;
        i[b] = -end;
        stopped
    }

    /// Three conducting terminals. Returns the time at which the first diode stopped conducting, if one did.
    fn star(
        &self,
        t: &Topology,
        i: &mut [f64; 3],
        e: [f64; 3],
        dt: f64,
        decay: f64,
        flow: &mut Flow,
    ) -> Option<f64> {
        let star = t.sum / 3.0;
        let mut to = [0.0; 3];
        let mut end = [0.0; 3];
        // The decay factor at which the first diode's current reaches zero.
        let mut first: Option<(usize, f64)> = None;
        for k in 0..3 {
            to[k] = (t.holds[k].v - e[k] - star) / self.phase_r;
            end[k] = to[k] + (i[k] - to[k]) * decay;
            if i[k] != 0.0 && wrong_way(t.holds[k], end[k]) {
                let at = to[k] / (to[k] - i[k]);
                if first.is_none_or(|(_, earliest)| at > earliest) {
                    first = Some((k, at));
                }
            }
        }
        let mut span = dt;
        let mut stopped = None;
        if let Some((leg, at)) = first {
            span = (-self.tau * libm::log(at)).clamp(0.0, dt);
            for k in 0..3 {
                end[k] = to[k] + (i[k] - to[k]) * at;
            }
            stop_leg(&mut end, leg);
            stopped = Some(span);
        }
        for k in 0..3 {
            let hold = t.holds[k];
            let (charge, square) = self.integrals(i[k], to[k], end[k], span);
            flow.charge[k] += charge;
            flow.bus_charge += hold.bus_share * charge;
            flow.drop_j += (hold.bus_share * self.bus_v - hold.v) * charge;
            flow.copper_j += self.phase_r * square;
            flow.peak_a = flow.peak_a.max(end[k].abs());
        }
        *i = end;
        stopped
    }

    /// Integrals of i and i² over `span` of the exponential from `start` to `end` with the asymptote `to`.
    fn integrals(&self, start: f64, to: f64, end: f64, span: f64) -> (f64, f64) {
        let fall = self.tau * (start - end);
        (to * span + fall, to * to * span + fall * (to + 0.5 * (start + end)))
    }
}

/// A current that has died away, as 0: a processor takes a hundred times as long for the least numbers that it has, and a current that
/// decays ends up there. Far below an electron a step, it adds nothing to any sum.
fn settled(i: f64) -> f64 {
    if i.abs() < 1e-30 { 0.0 } else { i }
}

fn wrong_way(hold: Hold, i: f64) -> bool {
    hold.diode != 0.0 && i * hold.diode <= 0.0
}

/// Sets one leg's current to exactly zero and keeps the sum of the three zero.
fn stop_leg(i: &mut [f64; 3], leg: usize) {
    let (a, b) = ((leg + 1) % 3, (leg + 2) % 3);
    let half = 0.5 * (i[a] - i[b]);
    i[leg] = 0.0;
    i[a] = half;
    i[b] = -half;
}

#[cfg(test)]
mod tests;
