//! The supply of one or more boards: a source with a current limit behind a diode, and the capacitors of the boards.
//!
//! ```text
//! source (V, limit) --diode--+-- board 1: C, electronics, motor
//!                            +-- board 2: ...
//! ```
//!
//! The wires between the boards have no resistance: all capacitors have one voltage. The source cannot sink, so a motor
//! that feeds back charges the capacitors, and only the electronics and other motors discharge them. Motors draw charge, and
//! the voltage follows once an interval; within it the bridges see a constant voltage. That creates q²/2C of energy an
//! interval, where q is the difference between the charges in and out: under 0.5 % (test `supply::energy`).

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Current limit of the hand's source, A. The manual names 24 V and no current; 30 A are three motors at their peak.
pub const LIMIT_A: f64 = 30.0;

/// Capacitance at the bridge of each board, F (docs/board.md, "Supply").
pub const BOARD_F: f64 = 2.2e-3;

/// Current of a board's electronics, A; chosen: processor, transceiver, three hall sensors and gate drivers.
pub(crate) const ELECTRONICS_A: f64 = 0.04;

/// Longest interval between two exchanges while the voltage moves, µs: the full load of seven motors changes it by 0.4 V.
const INTERVAL_US: u64 = 100;

/// The same while the source holds its voltage, µs: a control tick.
const QUIET_US: u64 = 1_000;

/// Load below which the source certainly holds its voltage for [`QUIET_US`], A.
const QUIET_A: f64 = 10.0;

/// Charges and energies since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SupplyLedger {
    /// From the source, J at the bus.
    pub source_j: f64,
    /// Into the bridges, minus what they fed back, J.
    pub motors_j: f64,
    /// Into the boards' electronics, J.
    pub electronics_j: f64,
    /// In the capacitors now, minus what was there at the start, J.
    pub stored_j: f64,
}

/// Source and capacitors.
#[derive(Clone, Debug)]
pub struct Supply {
    source_v: f64,
    limit_a: f64,
    capacitance_f: f64,
    electronics_a: f64,
    volts: f64,
    at_us: u64,
    next_us: u64,
    /// Charge that the bridges have drawn since `at_us`, C.
    drawn_c: f64,
    /// Charges of the last interval, C, from the source and into the bridges, and its length, s.
    last: ([f64; 2], f64),
    start_v: f64,
    ledger: SupplyLedger,
}

impl Supply {
    /// A supply of `source_v` volts for a number of boards, its capacitors charged.
    #[must_use]
    pub fn new(source_v: f64, boards: u8) -> Self {
        Self::with(source_v, boards, LIMIT_A, BOARD_F)
    }

    /// The same with another current limit and another capacitance of each board.
    #[must_use]
    pub fn with(source_v: f64, boards: u8, limit_a: f64, board_f: f64) -> Self {
        Self {
            source_v,
            limit_a,
            capacitance_f: board_f * f64::from(boards.max(1)),
            electronics_a: ELECTRONICS_A * f64::from(boards),
            volts: source_v,
            at_us: 0,
            next_us: 0,
            drawn_c: 0.0,
            last: ([0.0; 2], 1.0),
            start_v: source_v,
            ledger: SupplyLedger::default(),
        }
    }

    /// The bus voltage, V.
    #[must_use]
    pub const fn volts(&self) -> f64 {
        self.volts
    }

    /// Current from the source in the last interval, A.
    #[must_use]
    pub const fn source_a(&self) -> f64 {
        self.last.0[0] / self.last.1
    }

    /// Current into all bridges in the last interval, A; negative if they fed back.
    #[must_use]
    pub const fn motors_a(&self) -> f64 {
        self.last.0[1] / self.last.1
    }

    /// The energy ledger.
    #[must_use]
    pub fn ledger(&self) -> SupplyLedger {
        let stored_j = 0.5 * self.capacitance_f * (self.volts * self.volts - self.start_v * self.start_v);
        SupplyLedger { stored_j, ..self.ledger }
    }

    /// Changes the source's voltage and current limit: a sag, another supply, a cable that breaks (0 A).
    pub const fn set_source(&mut self, volts: f64, limit_a: f64) {
        (self.source_v, self.limit_a) = (volts, limit_a);
    }

    /// Takes a charge from the bus, C.
    pub fn draw(&mut self, charge: f64) {
        self.drawn_c += charge;
    }

    /// Starts at another time than 0.
    pub(crate) const fn start_at(&mut self, us: u64) {
        (self.at_us, self.next_us) = (us, us);
    }

    /// Ends the interval if it is due at `now_us`.
    fn settle(&mut self, now_us: u64) {
        if now_us >= self.next_us {
            self.advance(now_us);
            let quiet = self.volts == self.source_v && (0.0..QUIET_A).contains(&self.motors_a());
            // A grid in absolute time, so that an interval does not depend on who asks.
            let interval = if quiet { QUIET_US } else { INTERVAL_US };
            self.next_us = (now_us / interval + 1) * interval;
        }
    }

    /// Advances to `now_us` with what has been drawn.
    pub fn advance(&mut self, now_us: u64) {
        let us = now_us.saturating_sub(self.at_us);
        if us == 0 {
            return;
        }
        let dt = us as f64 * 1e-6;
        let electronics_c = if self.volts > 0.0 { self.electronics_a * dt } else { 0.0 };
        let load_c = std::mem::take(&mut self.drawn_c) + electronics_c;
        let wanted_c = (self.source_v - self.volts) * self.capacitance_f + load_c;
        let source_c = wanted_c.clamp(0.0, self.limit_a * dt);
        let before = self.volts;
        // Exactly the source's voltage where it holds it, so that a run without feedback sees no rounding.
        let holds = source_c == wanted_c;
        let after = if holds { self.source_v } else { before + (source_c - load_c) / self.capacitance_f };
        self.volts = after.max(0.0);
        self.last = ([source_c, load_c - electronics_c], dt);
        let mean = 0.5 * (before + self.volts);
        self.ledger.source_j += source_c * mean;
        self.ledger.electronics_j += electronics_c * mean;
        self.ledger.motors_j += (load_c - electronics_c) * before;
        self.at_us = now_us;
    }
}

/// A supply that several boards share. Clones are the same supply.
#[derive(Clone, Debug)]
pub struct SharedSupply(Arc<Mutex<Supply>>);

impl SharedSupply {
    /// Shares a supply.
    #[must_use]
    pub fn new(supply: Supply) -> Self {
        Self(Arc::new(Mutex::new(supply)))
    }

    fn lock(&self) -> MutexGuard<'_, Supply> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The supply now.
    #[must_use]
    pub fn read(&self) -> Supply {
        self.lock().clone()
    }

    /// Voltage from `now_us` on and the end of the interval in which it holds. All boards must have drawn what they took up
    /// to now; what a board draws later belongs to the next interval.
    #[must_use]
    pub fn interval(&self, now_us: u64) -> (f64, u64) {
        let mut supply = self.lock();
        supply.settle(now_us);
        (supply.volts, supply.next_us)
    }

    /// See [`Supply::draw`].
    pub fn draw(&self, charge: f64) {
        self.lock().draw(charge);
    }

    /// See [`Supply::set_source`].
    pub fn set_source(&self, volts: f64, limit_a: f64) {
        self.lock().set_source(volts, limit_a);
    }
}

/// How a board is fed.
#[derive(Clone, Debug)]
pub enum Feed {
    /// By a supply of its own, exchanged at each step of the plant.
    Own(Supply),
    /// By a supply that other boards share.
    Shared(SharedSupply),
}
