//! Hall code to sector, direction and count, and every kind of invalid transition.
//!
//! # Design
//!
//! The decoder keeps a *trusted* sector, to which its count belongs. A sample of a neighboring sector is a step, taken at
//! once, because the rotor must be commutated now. A sample two or three sectors away is *pending*: it is taken only if the
//! lines still show it [`CONFIRM`] later (at another edge, or when the control tick samples again), and dropped as soon as
//! a sample is next to the trusted sector. Codes 0 and 7 are never followed.
//!
//! Recovered (tested exhaustively): one or two wrong codes of any kind within [`CONFIRM`], also where they hide an edge or a
//! reversal, and one wrong code of any length at standstill. The next stable sample restores up to two lost edges.
//!
//! # Limits
//!
//! Three lost edges in a row are ambiguous by an electrical revolution, and six are invisible. A burst of four wrong codes
//! that happen to walk through neighbors is followed. A dead line loses counts until it is detected, within three
//! electrical revolutions. A jump at the end of a disturbance that was longer than [`CONFIRM`] is marked as uncertain. A wrong code next to the trusted one looks like a rotor that rocks on the boundary until it
//! returns; if that takes less than [`BOUNCE`], the step back is marked.

pub use crate::sense::wiring::Wiring;
use crate::units::Micros;
use crate::way::Way;

#[cfg(test)]
mod tests;

/// Confirmation time of a jump. Longer than the bridge's interference (edges every 25 µs ring for 1–2 µs), shorter than the
/// shortest cell: 600 µs at 1100 counts/s with edges displaced by 10° electrical.
pub const CONFIRM: Micros = Micros(200);

/// A step back within this time is a glitch: at 70,000 counts/s², four times what peak torque gives, a rotor moves 0.0007
/// counts in 100 µs, far less than any sensor's hysteresis.
pub const BOUNCE: Micros = Micros(100);

/// Illegal codes for this long (two control ticks) are a broken cable or supply, not a glitch.
pub const ILLEGAL: Micros = Micros(2000);

/// A glitch adds [`GLITCH`] to the score, a step subtracts 1, and [`FAULT`] is a fault. A dead line gives two glitches and at
/// most four steps an electrical revolution: 3 × (2 × 16 − 4) = 84 ≥ 80 in three of them. Glitches at 1 % of the edges add
/// 0.16 an edge, so a fault needs five within 20 edges: once in 10^7 edges.
const GLITCH: u8 = 16;
const FAULT: u8 = 80;
/// At standstill ([`STANDING`] without a step), the score decreases by 1 in this time, or a motor that holds would keep its
/// glitches for ever. A glitch expires in 0.26 s.
const LEAK: Micros = Micros(16_000);
/// Three times the slowest step at 10 counts/s.
const STANDING: Micros = Micros(300_000);

/// One accepted step of the count. `count` is the cell entered: cell k spans k−½ … k+½ counts, so that the
/// boundary just crossed is at `count − ½` when closing and at `count + ½` when opening.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HallEdge {
    /// Hall count after the step.
    pub count: i32,
    /// Counts that the step spans: more than 1 if edges were lost and the direction was clear.
    pub steps: u8,
    /// Way of the step.
    pub way: Way,
    /// Time of the line's change; a confirmed jump has the time of its last change.
    pub at: Micros,
    /// Whether the line that changed rose. Open-collector sensors fall sharply and rise late.
    pub rising: bool,
    /// The step reverses the last one within [`BOUNCE`]: that one was a glitch.
    pub bounce: bool,
    /// It jumps at the end of a disturbance that was longer than [`CONFIRM`]: the count may be off by an electrical revolution.
    pub uncertain: bool,
}

/// An invalid sample; the count does not follow it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Glitch {
    /// Code 0 or 7: no rotor position gives it.
    Illegal,
    /// A code two or three sectors away: an edge was lost, or the sample is invalid.
    Jump,
}

/// So many invalid samples that the count cannot be trusted any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum HallFault {
    /// Code 0 or 7 for [`ILLEGAL`]: broken cable or supply.
    Illegal,
    /// The line of this bit did not change while there were glitches.
    Stuck(u8),
    /// Repeated glitches on more than one line.
    Noisy,
}

/// The meaning of one sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HallEvent {
    /// The count moved.
    Step(HallEdge),
    /// A glitch was seen.
    Glitch(Glitch),
    /// Glitches became a fault; reported again while they continue.
    Fault(HallFault),
}

/// Shortest distance from one sector to another: −2..=3 steps.
const fn distance(from: u8, to: u8) -> i8 {
    let d = to.wrapping_sub(from).cast_signed();
    if d > 3 {
        d - 6
    } else if d < -2 {
        d + 6
    } else {
        d
    }
}

#[derive(Clone, Copy, Debug)]
struct Pending {
    sector: u8,
    delta: i8,
    /// It is three steps away, in an unknown direction.
    either: bool,
    at: Micros,
    /// Another glitch was before it, for longer than [`CONFIRM`].
    late: bool,
}

/// Decodes the lines of one motor. Runs in the hall interrupt.
#[derive(Clone, Copy, Debug)]
pub struct HallDecoder {
    wiring: Wiring,
    code: u8,
    /// Trusted sector; `None` until the first legal code.
    sector: Option<u8>,
    count: i32,
    way: Way,
    /// Time of the last step; `None` if it is so long ago that it means nothing any more ([`HallDecoder::age`]).
    at: Option<Micros>,
    /// The last step was a jump, or came within [`CONFIRM`] of the one before: it may have been a glitch.
    doubtful: bool,
    pending: Option<Pending>,
    illegal_since: Option<Micros>,
    score: u8,
    /// Time of the last glitch, if the score is not 0.
    glitched: Micros,
    /// The lines show the trusted sector and no state waits for time to pass.
    quiet: bool,
    leaked: Micros,
    /// Lines that changed since the score left 0.
    toggled: u8,
}

impl HallDecoder {
    /// A decoder whose lines read `code` at hall count `count`. If the code is invalid, `count` belongs to the first valid one.
    #[must_use]
    pub fn new(wiring: Wiring, code: u8, count: i32) -> Self {
        Self {
            wiring,
            code: code & 7,
            sector: wiring.sector(code),
            count,
            way: Way::Closing,
            at: None,
            doubtful: false,
            pending: None,
            illegal_since: None,
            score: 0,
            glitched: Micros(0),
            quiet: false,
            leaked: Micros(0),
            toggled: 0,
        }
    }

    /// The hall count.
    #[must_use]
    pub const fn count(&self) -> i32 {
        self.count
    }

    /// The sector 0..=5 of the count; `None` until the lines have been valid once.
    #[must_use]
    pub const fn sector(&self) -> Option<u8> {
        self.sector
    }

    /// The sector that a sample of `code` would move the count to: a neighbor at once, another after its confirmation.
    #[must_use]
    pub fn ahead(&self, code: u8, at: Micros) -> Option<u8> {
        let sector = self.wiring.sector(code)?;
        let follows = match distance(self.sector?, sector) {
            -1 | 1 => true,
            0 => false,
            _ => self.pending.is_some_and(|p| {
                at.wrapping_since(p.at).0 >= CONFIRM.0 && (-1..=1).contains(&distance(p.sector, sector))
            }),
        };
        follows.then_some(sector)
    }

    /// Forgets the time of a step that is long ago. Must be called at least once an hour: the clock returns to that time after
    /// 71.6 min, and a reversal then would look like a bounce.
    pub fn age(&mut self, now: Micros) {
        self.at = self.at.filter(|&last| now.wrapping_since(last).0 < STANDING.0);
    }

    /// One sample of the lines (bits 2..0), at each change and at each control tick, which confirms a jump without an edge
    /// after it.
    #[inline]
    pub fn sample(&mut self, code: u8, at: Micros) -> Option<HallEvent> {
        let code = code & 7;
        if self.quiet {
            if code == self.code {
                return None;
            }
            if let (Some(sector), Some(trusted)) = (self.wiring.sector(code), self.sector)
                && let delta @ (-1 | 1) = distance(trusted, sector)
            {
                self.code = code;
                return Some(self.step(sector, delta, at, false));
            }
        }
        let event = self.judge(code, at);
        self.quiet = self.pending.is_none() && self.illegal_since.is_none() && self.score == 0;
        event
    }

    /// Whether one more sample of `code` would change nothing.
    #[inline]
    #[must_use]
    pub fn is_settled(&self, code: u8) -> bool {
        self.quiet && code & 7 == self.code
    }

    #[inline(never)]
    fn judge(&mut self, code: u8, at: Micros) -> Option<HallEvent> {
        let changed = code ^ self.code;
        self.code = code;
        let stands = self.at.is_none_or(|last| at.wrapping_since(last).0 >= STANDING.0);
        if stands && at.wrapping_since(self.leaked).0 >= LEAK.0 {
            self.leaked = at;
            self.score = self.score.saturating_sub(1);
        }
        self.toggled = if self.score == 0 { 0 } else { self.toggled | changed };
        let Some(sector) = self.wiring.sector(code) else { return self.illegal(at) };
        self.illegal_since = None;
        let Some(trusted) = self.sector else {
            self.sector = Some(sector);
            return None;
        };
        match distance(trusted, sector) {
            0 => {
                self.pending = None;
                None
            }
            delta @ (-1 | 1) => Some(self.rare_step(sector, delta, at, false)),
            delta => self.jump(sector, delta, at),
        }
    }

    fn illegal(&mut self, at: Micros) -> Option<HallEvent> {
        self.pending = None;
        match self.illegal_since {
            Some(since) if at.wrapping_since(since).0 >= ILLEGAL.0 => {
                // Keeps the time in reach of the wrapping clock.
                self.illegal_since = Some(at.wrapping_since(ILLEGAL));
                Some(HallEvent::Fault(HallFault::Illegal))
            }
            Some(_) => None,
            None => {
                self.illegal_since = Some(at);
                Some(self.glitch(Glitch::Illegal, at))
            }
        }
    }

    fn jump(&mut self, sector: u8, delta: i8, at: Micros) -> Option<HallEvent> {
        if let Some(p) = self.pending
            && at.wrapping_since(p.at).0 >= CONFIRM.0
        {
            match distance(p.sector, sector) {
                0 => return Some(self.rare_step(sector, p.delta, p.at, p.late)),
                // The rotor moved on from there, which also gives the direction of three sectors.
                on @ (-1 | 1) => {
                    let delta = if p.either { on * 4 } else { p.delta + on };
                    return Some(self.rare_step(sector, delta, at, p.late));
                }
                _ => {}
            }
        } else if self.pending.is_some_and(|p| p.sector == sector) {
            return None;
        }
        let either = delta == 3;
        let delta = if either { if self.likely_way().is_closing() { 3 } else { -3 } } else { delta };
        let disturbed = at.wrapping_since(self.glitched).0;
        let late = self.score != 0 && (CONFIRM.0..ILLEGAL.0).contains(&disturbed);
        self.pending = Some(Pending { sector, delta, either, at, late });
        Some(self.glitch(Glitch::Jump, at))
    }

    /// Way of a jump by three sectors: as before, but reversed after a doubtful step, so that a wrong code of any length is
    /// undone.
    const fn likely_way(&self) -> Way {
        if self.doubtful { self.way.back() } else { self.way }
    }

    /// A step that is not [`Self::sample`]'s quick one: not inlined, for size.
    #[inline(never)]
    fn rare_step(&mut self, sector: u8, delta: i8, at: Micros, uncertain: bool) -> HallEvent {
        self.step(sector, delta, at, uncertain)
    }

    #[inline]
    fn step(&mut self, sector: u8, delta: i8, at: Micros, uncertain: bool) -> HallEvent {
        let way = Way::closing_if(delta > 0);
        let steps = delta.unsigned_abs();
        let since = self.at.map_or(u32::MAX, |last| at.wrapping_since(last).0);
        let bounce = steps == 1 && way != self.way && since < BOUNCE.0;
        self.sector = Some(sector);
        self.count = self.count.wrapping_add(i32::from(delta));
        self.way = way;
        self.at = Some(at);
        self.doubtful = steps > 1 || since < CONFIRM.0;
        self.pending = None;
        self.score = self.score.saturating_sub(1);
        // Neighbors differ in one line, so they alternately have one and two lines high.
        let rising = self.wiring.two_high() >> self.code & 1 != 0;
        HallEvent::Step(HallEdge { count: self.count, steps, way, at, rising, bounce, uncertain })
    }

    /// Counts a glitch; returns it, or the fault that it completes.
    fn glitch(&mut self, glitch: Glitch, at: Micros) -> HallEvent {
        self.glitched = at;
        self.score = self.score.saturating_add(GLITCH);
        if self.score < FAULT {
            return HallEvent::Glitch(glitch);
        }
        self.score = 0;
        HallEvent::Fault(match !self.toggled & 7 {
            1 => HallFault::Stuck(0),
            2 => HallFault::Stuck(1),
            4 => HallFault::Stuck(2),
            _ => HallFault::Noisy,
        })
    }
}
