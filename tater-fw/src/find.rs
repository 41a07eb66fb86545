//! FIND: learns how the motor is wired, by turning it with a slow open-loop field.
//!
//! # Design
//!
//! The legs of one sector after another are held, with a torque that rises until a hall line changes or `Limits::most` is reached.
//! Legs of sector k pull the rotor to the boundary of sectors k + 1 and k + 2 (decision 0003). Each change of the code says
//! which way a vector turned the rotor over a boundary, so it did work of that sign. Of the twelve wirings that fit the order
//! of the codes, the one under which the field did most work is right:
//!
//! ```text
//! score(s, o) = Σ ±T(k − s·(p − o))    ±: the way the rotor went, p: the cell below the boundary, k: the vector,
//! T = 1, 1, 0, −1, −1, 0               s: ±1, o: the cell of sector 0; T of the legs k at the boundary above sector k − i
//! ```
//!
//! Friction holds the rotor behind the field by up to two cells in both rotations; a neighbor of the right wiring scores half.
//!
//! Each change of the code starts the torque from 0 again, with two phases short-circuited: the rotor creeps and does not
//! swing. Three lines change in turn (a, b, c, a ...), so two changes tell the order of all six codes, whatever the order of
//! the lines and whichever is inverted. A line that changes out of turn is broken.
//!
//! The rotation reverses `REACH` cells from the start, and where the rotor does not follow: at a stop. What it learns is
//! right up to the mirror image, which nothing on the board can see (decision 0046).

use core::cmp::Ordering;
use servo_core::Motor;
use servo_core::guard::direction::Starts;
use servo_core::num::saturating_i16;
use servo_core::sense::wiring::Wiring;
use servo_core::units::{MilliAmps, Torque};

/// Rise of the torque a ms, at first and after `FAST` rotations without a result: a rotor that slides while the torque rises fast
/// passes the boundary that should hold it, and two neighbors score the same.
const RATE: i16 = 4;
const SLOW_RATE: i16 = 1;
const FAST: u8 = 3;

/// Torque above that of the last change at which a rotor that moved is held: the lag is then 2/3 of a cell, far from the
/// next boundary on both sides.
const MARGIN: i16 = 3;

/// Time at full torque before the rotor counts as settled, ms: three quarters of an oscillation in the field (60 ms) have
/// passed by then.
const HOLD_MS: u8 = 12;

/// Cells from the start at which the rotation reverses. One more may follow by inertia.
const REACH: i8 = 3;

/// Vectors from the first, until the order of the codes is known: without halls the rotor follows unseen.
const BLIND_REACH: i8 = 4;
/// The same after two rotations, when a broken line would have shown: the rotor may be held at a stop.
const HELD_REACH: i8 = 6;

/// Vectors without a change after which the rotation reverses: the lag of both rotations is less than two.
const STUCK: u8 = 5;

/// Lead of the best score that decides: with 4, one wiring of 300 is off by a sector; with 6, one of 30,000 (decision 0046).
const LEAD: i8 = 6;

/// Vectors of one rotation, and up to three more: at a stop the field slips and turns the rotor back again and again, and
/// always the same number would repeat itself.
const SWEEP: u8 = 8;

/// Vectors without any change that are enough to judge: two electrical revolutions.
const SILENT: u8 = 12;

/// Vectors after a line changed out of turn, to see which lines still change.
const DIAGNOSIS: u8 = 14;

/// Vectors in all: the other rotation of the next attempt may do better.
const STEPS: u8 = 100;

/// Longest time, ms; stated in docs/wire.md. Most take two seconds; halls that never rest would take for ever.
pub const LIMIT_MS: u16 = 15_000;

/// Cells from the start at which something else turns the joint: FIND itself moves by six.
const LOST: i8 = 24;

/// What a motor's FIND takes, torque units; of the hand's motor in brackets.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Largest torque (200): a quarter more than what starts any motor. A rotor that creeps behind the field has the friction of a resting one, and
    /// where only the field's peak overcomes it, it stays a cell behind (torture seed 469504521).
    most: i16,
    /// Bus current at `most`, below which a phase is open (60 mA): 250 mA are expected of the highest resistance, after dead time.
    open_ma: i16,
    /// Least torque that moves a resting rotor (24): friction of 63 units less 30 %, with 30 % more torque an ampere and 30 % less resistance.
    /// Below it the rotor still moves from the vector before.
    starts: i16,
}

impl Limits {
    /// Of a motor.
    #[must_use]
    pub fn new(starts: &Starts, motor: &Motor) -> Self {
        let start = starts.most.0;
        let most = start + start / 4;
        // The current of the supply goes with the square of the torque: (200/1024)² · 9.98 A are 381 mA, of which this is a sixth.
        let square = u32::from(most.unsigned_abs()).pow(2) >> 10;
        let open_ma = saturating_i16((square * u32::from(motor.mpk) * 3 / (19 << 10)).cast_signed());
        Self { most, open_ma, starts: start * 3 / 20 }
    }
}

/// Legs of the vectors 0 to 2 and again 3 to 5, a bit each.
const LEGS: [u8; 3] = [0b011, 0b101, 0b110];

/// Why the wiring could not be learned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Trouble {
    /// The rotor does not turn, though all phases take current.
    Blocked,
    /// All hall lines stay high, or all low.
    Silent,
    /// The phase of this leg takes no current.
    Open(u8),
    /// No more than one phase takes current.
    AllOpen,
    /// A line does not change.
    Stuck {
        /// 0 to 2.
        line: u8,
        /// Its level.
        high: bool,
    },
    /// Two lines change together: all but this one.
    Shorted(u8),
    /// The codes contradict each other: noise, or something turned the rotor.
    Unclear,
}

/// What is to be done in a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Hold the legs of this sector with this torque.
    Hold(u8, Torque),
    /// The wiring up to its mirror image, or why there is none.
    Done(Result<Wiring, Trouble>),
}

/// The cell in which the rotor is, and the lines (a bit each, 0 unknown) that change at its two boundaries.
#[derive(Clone, Copy, Debug, Default)]
struct Ring {
    code: u8,
    cell: i8,
    below: u8,
    above: u8,
}

impl Ring {
    /// The third line, once two are known.
    const fn third(&self) -> u8 {
        if self.below == 0 || self.above == 0 { 0 } else { 7 ^ self.below ^ self.above }
    }

    const fn up(&mut self) {
        (self.below, self.above) = (self.above, self.third());
        self.cell = self.cell.saturating_add(1);
    }

    const fn down(&mut self) {
        (self.below, self.above) = (self.third(), self.below);
        self.cell = self.cell.saturating_sub(1);
    }

    /// Follows a change of the code. Returns whether it is possible.
    fn follow(&mut self, code: u8) -> bool {
        let line = self.code ^ code;
        self.code = code;
        if line.count_ones() != 1 {
            return false;
        }
        if line == self.below {
            self.down();
        } else if line == self.above || self.above == 0 {
            self.above = line;
            self.up();
        } else if self.below == 0 {
            self.below = line;
            self.down();
        } else {
            return false;
        }
        true
    }

    /// Whether a wiring has these codes, if cell 0 is sector 0 at `origin`, and sectors rise with the cells or fall.
    fn is_of(mut self, wiring: &Wiring, origin: i8, sense: i8) -> bool {
        (0..6).all(|_| {
            let sector = (sense * (self.cell - origin)).rem_euclid(6);
            let fits = wiring.sector(self.code) == u8::try_from(sector).ok();
            self.code ^= self.above;
            self.up();
            fits
        })
    }
}

/// Lines over all codes so far.
#[derive(Clone, Copy, Debug, Default)]
struct Lines {
    high: u8,
    low: u8,
    /// Lines that were equal to, and different from, their next line.
    equal: u8,
    different: u8,
    changes: u16,
}

impl Lines {
    const fn see(&mut self, code: u8) {
        let next = (code >> 1 | code << 2) & 7;
        self.high |= code;
        self.low |= !code & 7;
        self.equal |= !(code ^ next) & 7;
        self.different |= code ^ next;
    }
}

/// The state of FIND.
#[derive(Clone, Copy, Debug)]
pub struct Find {
    limits: Limits,
    ring: Ring,
    lines: Lines,
    /// The code of the last tick; counts once it stays for a tick.
    candidate: u8,
    begun: bool,
    vector: i8,
    /// +1 or −1.
    turn: i8,
    torque: i16,
    cap: i16,
    held_ms: u8,
    changed: bool,
    /// Cell after the last vector.
    settled: i8,
    /// Vectors in a row that the rotor did not follow.
    still: u8,
    /// Vectors of this rotation.
    sweep: u8,
    rotations: u8,
    /// Of each wiring: rising sectors with origin 0 to 5, then falling ones.
    scores: [i8; 12],
    /// Legs that took current.
    fed: u8,
    starved: u8,
    steps: u8,
    ms: u16,
    /// Vectors left once a line changed out of turn.
    diagnosis: Option<u8>,
}

impl Find {
    /// Begins at a hall count; odd ones with the other rotation, so that a repetition differs.
    #[must_use]
    pub fn at(limits: Limits, count: i32) -> Self {
        Self {
            limits,
            ring: Ring::default(),
            lines: Lines::default(),
            candidate: 0,
            begun: false,
            vector: 0,
            turn: if count & 1 == 0 { 1 } else { -1 },
            torque: 0,
            cap: limits.most,
            held_ms: 0,
            changed: false,
            settled: 0,
            still: 0,
            sweep: 0,
            rotations: 0,
            scores: [0; 12],
            fed: 0,
            starved: 0,
            steps: 0,
            ms: 0,
            diagnosis: None,
        }
    }

    /// The sector whose legs are held.
    #[must_use]
    pub fn sector(&self) -> u8 {
        u8::try_from(self.vector.rem_euclid(6)).unwrap_or(0)
    }

    fn legs(&self) -> u8 {
        LEGS.get(usize::from(self.sector() % 3)).copied().unwrap_or(0)
    }

    /// One tick of 1 ms: the hall lines and the bus current.
    pub fn step(&mut self, code: u8, current: MilliAmps) -> Step {
        let code = code & 7;
        self.ms += 1;
        if self.ms >= LIMIT_MS || self.ring.cell.abs() > LOST {
            return Step::Done(Err(Trouble::Unclear));
        }
        if !self.begun {
            self.begun = true;
            self.ring.code = code;
            self.candidate = code;
            self.lines.see(code);
        }
        if code != self.candidate {
            self.candidate = code;
        } else if code != self.ring.code {
            self.change(code);
        } else if self.torque < self.cap {
            let rate = if self.rotations < FAST { RATE } else { SLOW_RATE };
            self.torque = (self.torque + rate).min(self.cap);
        } else {
            self.held_ms += 1;
            if self.held_ms >= HOLD_MS
                && let Some(result) = self.settle(current)
            {
                return Step::Done(result);
            }
        }
        Step::Hold(self.sector(), Torque(self.torque))
    }

    fn change(&mut self, code: u8) {
        self.lines.see(code);
        self.lines.changes = self.lines.changes.saturating_add(1);
        let before = self.ring.cell;
        if !self.ring.follow(code) && self.diagnosis.is_none() {
            self.diagnosis = Some(DIAGNOSIS);
        }
        self.score(before);
        if self.torque >= self.limits.starts {
            self.fed |= self.legs();
        }
        self.changed = true;
        self.cap = (self.torque / 2 * MARGIN).max(RATE).min(self.limits.most);
        self.torque = 0;
        self.held_ms = 0;
    }

    /// The rotor went from a cell to its neighbor.
    fn score(&mut self, before: i8) {
        let way = self.ring.cell - before;
        let below = before.min(self.ring.cell);
        for (score, number) in self.scores.iter_mut().zip(0..) {
            // The sector below the boundary, and the rotor's way in sectors.
            let (sector, way) = if number < 6 { (below - number, way) } else { (number - 7 - below, -way) };
            let torque = match (self.vector - sector).rem_euclid(6) {
                0 | 1 => 1,
                3 | 4 => -1,
                _ => 0,
            };
            *score = score.saturating_add(way * torque);
        }
    }

    /// The rotor has settled: learns from it and takes the next vector. Returns the end.
    #[inline(never)]
    fn settle(&mut self, current: MilliAmps) -> Option<Result<Wiring, Trouble>> {
        if !self.changed && current.0.saturating_abs() >= self.limits.open_ma {
            self.fed |= self.legs();
        } else if !self.changed {
            self.starved += 1;
        }
        let moved = self.ring.cell - self.settled;
        self.settled = self.ring.cell;
        self.still = if moved == 0 { self.still.saturating_add(1) } else { 0 };
        self.steps += 1;
        if let Some(left) = &mut self.diagnosis {
            *left = left.saturating_sub(1);
        }
        if let Some(wiring) = self.learned() {
            return Some(Ok(wiring));
        }
        let silent = self.lines.changes == 0 && self.steps >= SILENT;
        if silent || self.starved >= SILENT / 2 || self.diagnosis == Some(0) || self.steps >= STEPS {
            return Some(Err(self.judge()));
        }
        self.advance(moved);
        None
    }

    /// +1 if the cells rise with the vectors, −1 if they fall, 0 unknown.
    fn sense(&self) -> i8 {
        let (rising, falling) = self.scores.split_at(6);
        match rising.iter().max().cmp(&falling.iter().max()) {
            Ordering::Greater => 1,
            Ordering::Equal => 0,
            Ordering::Less => -1,
        }
    }

    /// The wiring that leads the others.
    fn learned(&self) -> Option<Wiring> {
        if self.lines.high & self.lines.low != 7 || self.diagnosis.is_some() {
            return None;
        }
        let (mut best, mut second, mut number) = (i8::MIN, i8::MIN, 0);
        for (&score, at) in self.scores.iter().zip(0..) {
            if score > best {
                (best, second, number) = (score, best, at);
            } else {
                second = second.max(score);
            }
        }
        if best.saturating_sub(second) < LEAD {
            return None;
        }
        let sense = if number < 6 { 1 } else { -1 };
        let mut wirings = (0..Wiring::RELATIONS).filter_map(Wiring::from_number);
        wirings.find(|wiring| self.ring.is_of(wiring, number % 6, sense))
    }

    /// The next vector, in the other rotation where this one has been followed, goes too far or is not followed.
    fn advance(&mut self, moved: i8) {
        let cell = self.ring.cell;
        // Unless the rotor slipped there, against the field.
        let far =
            cell.abs() >= REACH && cell.signum() == moved.signum() && moved * self.turn * self.sense() >= 0;
        let ordered = self.lines.high & self.lines.low == 7 && self.diagnosis.is_none();
        let reach = if self.rotations >= 2 { HELD_REACH } else { BLIND_REACH };
        let blind = !ordered && self.vector * self.turn >= reach;
        self.sweep += 1;
        if far || blind || self.still >= STUCK || self.sweep >= SWEEP + self.rotations % 4 {
            self.sweep = 0;
            self.rotations += 1;
            if self.rotations == FAST {
                self.scores = [0; 12];
            }
            self.turn = -self.turn;
            self.still = 0;
        }
        self.vector += self.turn;
        // Far from any reach, so that it cannot overflow.
        if self.vector.abs() > 60 {
            self.vector %= 6;
        }
        self.torque = 0;
        self.cap = self.limits.most;
        self.held_ms = 0;
        self.changed = false;
    }

    fn judge(&self) -> Trouble {
        let missing = 7 & !self.fed;
        if self.starved >= 2 && missing != 0 {
            return if missing.count_ones() == 1 { Trouble::Open(line(missing)) } else { Trouble::AllOpen };
        }
        if self.lines.changes == 0 {
            return if matches!(self.ring.code, 0 | 7) { Trouble::Silent } else { Trouble::Blocked };
        }
        let still = 7 & !(self.lines.high & self.lines.low);
        if self.diagnosis.is_none() {
            return if still == 0 { Trouble::Unclear } else { Trouble::Blocked };
        }
        if still.count_ones() == 1 {
            return Trouble::Stuck { line: line(still), high: self.lines.high & still != 0 };
        }
        // Bit k: lines k and k + 1, so the other one is k + 2.
        let together = 7 & !(self.lines.equal & self.lines.different);
        if still == 0 && together.count_ones() == 1 {
            return Trouble::Shorted((line(together) + 2) % 3);
        }
        Trouble::Unclear
    }
}

/// The number of a line from its bit.
fn line(bit: u8) -> u8 {
    u8::try_from(bit.trailing_zeros()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Hall codes, two ticks each, so that each is taken for a change; how FIND ends on them, and after how many ms.
    fn ended(codes: &[u8]) -> Option<(Result<Wiring, Trouble>, u16)> {
        let mut find = Find::at(Limits { most: 200, open_ma: 60, starts: 24 }, 0);
        let ticks = codes.iter().cycle().flat_map(|&code| [code; 2]);
        ticks.zip(1..=LIMIT_MS).find_map(|(code, ms)| match find.step(code, MilliAmps(300)) {
            Step::Done(found) => Some((found, ms)),
            Step::Hold(..) => None,
        })
    }

    #[test]
    fn halls_that_never_rest_do_not_hold_it_up() {
        assert_eq!(ended(&[1, 3, 2, 6, 4, 5, 4, 6, 2, 3]), Some((Err(Trouble::Unclear), LIMIT_MS)));
    }

    #[test]
    fn a_joint_that_is_turned_by_hand_ends_it() {
        let (found, ms) = ended(&[1, 3, 2, 6, 4, 5]).expect("an end");
        assert_eq!(found, Err(Trouble::Unclear));
        assert!(ms < 100, "{ms} ms");
    }
}
