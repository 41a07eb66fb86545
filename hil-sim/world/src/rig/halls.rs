//! Three hall sensors on one board: where the boundaries are, and the levels of the lines over time.

use rand::RngExt;
use rand_pcg::Pcg64Mcg;

use super::params::{HallGlitch, RigParams};

/// Counts per electrical degree.
const COUNTS_PER_DEG: f64 = 1.0 / 60.0;

/// Draws of which a nearly normal one is the sum; it lies within 3.5 of its deviations.
const DRAWS: usize = 4;

/// Code of each sector (decision 0003), bit 0 = line 0.
pub const CODES: [u8; 6] = [2, 6, 4, 5, 1, 3];

/// The sensors and their lines.
#[derive(Clone, Debug)]
pub struct Halls {
    params: RigParams,
    zero_sector: u8,
    cell: i64,
    /// Where the rotor leaves the cell downwards and upwards, counts: a boundary may be elsewhere in either direction, and at each passing.
    bounds: (f64, f64),
    rng: Pcg64Mcg,
    sensed: u8,
    /// End of each line's rise delay, µs.
    rising: [Option<u64>; 3],
    /// Index of the first glitch that has not ended.
    glitch: usize,
    /// Forced level of each line with a broken wire.
    broken: [Option<bool>; 3],
    /// The lines, after delay, glitches and faults.
    lines: u8,
    /// Whether the lines follow the rotor alone: nothing changes while it stays in its cell.
    is_settled: bool,
}

impl Halls {
    /// Sensors settled at a rotor position, counts; `seed` is that of the edges' jitter.
    #[must_use]
    pub fn new(params: RigParams, zero_sector: u8, counts: f64, seed: u64) -> Self {
        let mut halls = Self {
            params,
            zero_sector,
            cell: counts.round() as i64,
            bounds: (0.0, 0.0),
            rng: Pcg64Mcg::new(u128::from(seed) << 64 | 0x4a11),
            sensed: 0,
            rising: [None; 3],
            glitch: 0,
            broken: [None; 3],
            lines: 0,
            is_settled: false,
        };
        let half = 0.5 * halls.params.hall_hysteresis_deg * COUNTS_PER_DEG;
        halls.bounds = (halls.boundary(halls.cell - 1) - half, halls.boundary(halls.cell) + half);
        // Errors are less than half a cell, so the nearest cell is off by one at most.
        while halls.follow(counts) {}
        halls.sensed = halls.code();
        halls.lines = halls.faulty(0);
        halls
    }

    /// The same rotor's sensors with other parameters, settled at a position.
    #[must_use]
    pub(crate) fn anew(&self, params: RigParams, counts: f64) -> Self {
        Self { rng: self.rng.clone(), ..Self::new(params, self.zero_sector, counts, 0) }
    }

    /// The lines as the board sees them.
    #[must_use]
    pub fn lines(&self) -> u8 {
        self.lines
    }

    /// The count in which the sensors are: the rotor's, shifted by their placement.
    #[must_use]
    pub const fn cell(&self) -> i64 {
        self.cell
    }

    /// `counts` on the side of a boundary that the sensors show, at most by their hysteresis and jitter away: where sensors that lose their
    /// power settle to the same cell.
    #[must_use]
    pub fn settled(&self, counts: f64) -> f64 {
        counts.clamp(self.boundary(self.cell - 1) + 1e-6, self.boundary(self.cell) - 1e-6)
    }

    /// Breaks the wires of lines 0 to 2, each at a level, from the next [`Self::update`] on; `None`: the line follows its sensor again.
    pub(crate) fn break_lines(&mut self, levels: [Option<bool>; 3]) {
        self.broken = levels;
        self.is_settled = false;
    }

    /// Adds a wrong code; ignored if it begins before the end of the last one.
    pub fn add_glitch(&mut self, glitch: HallGlitch) {
        let free_from = self.params.glitches.last().map_or(0, |last| last.at_us + last.duration_us);
        if glitch.at_us >= free_from {
            self.params.glitches.push(glitch);
            self.is_settled = false;
        }
    }

    /// Where the sensors change below and above the rotor, in counts.
    #[must_use]
    pub const fn bounds(&self) -> (f64, f64) {
        self.bounds
    }

    fn boundary(&self, k: i64) -> f64 {
        let error = self.params.hall_error_deg.get(self.sector(k)).copied().unwrap_or(0.0);
        k as f64 + 0.5 + error * COUNTS_PER_DEG
    }

    /// Follows the rotor by a cell. Back over the boundary that it has just passed it needs the hysteresis; the place of the one ahead is new.
    fn follow(&mut self, counts: f64) -> bool {
        let (low, high) = self.bounds;
        let gap = self.params.hall_hysteresis_deg * COUNTS_PER_DEG;
        if counts >= high {
            self.cell += 1;
            self.bounds = (high - gap, self.boundary(self.cell) + 0.5 * gap + self.jitter());
        } else if counts < low {
            self.cell -= 1;
            self.bounds = (self.boundary(self.cell - 1) - 0.5 * gap + self.jitter(), low + gap);
        } else {
            return false;
        }
        true
    }

    /// Counts.
    fn jitter(&mut self) -> f64 {
        let rms = self.params.hall_jitter_deg * COUNTS_PER_DEG;
        if rms == 0.0 {
            return 0.0;
        }
        let sum: f64 = (0..DRAWS).map(|_| self.rng.random_range(-1.0..=1.0)).sum();
        // A draw of -1 to 1 has the variance 1/3.
        rms * sum * (3.0 / DRAWS as f64).sqrt()
    }

    /// The next time after `now` at which the lines change while the rotor stands still.
    #[must_use]
    pub fn next_event(&self, now: u64) -> u64 {
        if self.is_settled {
            return u64::MAX;
        }
        let mut next = u64::MAX;
        let mut consider = |t: u64| {
            if t > now {
                next = next.min(t);
            }
        };
        self.rising.iter().flatten().copied().for_each(&mut consider);
        if let Some(g) = self.params.glitches.get(self.glitch) {
            consider(g.at_us);
            consider(g.at_us + g.duration_us);
        }
        if let Some(stuck) = self.params.stuck {
            consider(stuck.from_us);
        }
        next
    }

    /// Updates for the rotor at `counts` at time `now`; returns whether the lines changed.
    pub fn update(&mut self, counts: f64, now: u64) -> bool {
        let (low, high) = self.bounds;
        if self.is_settled && counts >= low && counts < high {
            return false;
        }
        while self.follow(counts) {
            let to = self.code();
            for line in 0..3 {
                let bit = 1 << line;
                if to & bit == 0 {
                    self.sensed &= !bit;
                    self.rising[line] = None;
                } else if self.sensed & bit == 0 && self.rising[line].is_none() {
                    self.rising[line] = Some(now + self.params.rise_delay_us);
                }
            }
        }
        for line in 0..3 {
            if self.rising[line].is_some_and(|at| at <= now) {
                self.rising[line] = None;
                self.sensed |= 1 << line;
            }
        }
        while self.params.glitches.get(self.glitch).is_some_and(|g| g.at_us + g.duration_us <= now) {
            self.glitch += 1;
        }
        let before = self.lines;
        self.lines = self.faulty(now);
        self.is_settled = self.rising == [None; 3]
            && self.params.stuck.is_none()
            && self.glitch >= self.params.glitches.len();
        self.lines != before
    }

    /// The sensors on their lines.
    fn wired(&self) -> u8 {
        let mut lines = 0;
        for (line, (&sensor, &inverted)) in self.params.halls.iter().zip(&self.params.inverted).enumerate() {
            let high = self.sensed >> sensor & 1 != 0;
            lines |= u8::from(high != inverted) << line;
        }
        if let Some([a, b]) = self.params.shorted {
            let both = 1 << a | 1 << b;
            if lines & both != both {
                lines &= !both;
            }
        }
        lines
    }

    fn faulty(&self, now: u64) -> u8 {
        let glitch = self.params.glitches.get(self.glitch).filter(|g| g.at_us <= now);
        let mut lines = glitch.map_or_else(|| self.wired(), |g| g.code);
        if let Some(stuck) = self.params.stuck
            && now >= stuck.from_us
        {
            let bit = 1 << stuck.line;
            lines = if stuck.high { lines | bit } else { lines & !bit };
        }
        for (line, level) in self.broken.iter().enumerate() {
            let bit = 1 << line;
            lines = match level {
                Some(true) => lines | bit,
                Some(false) => lines & !bit,
                None => lines,
            };
        }
        lines
    }

    fn sector(&self, cell: i64) -> usize {
        (cell + i64::from(self.zero_sector)).rem_euclid(6) as usize
    }

    fn code(&self) -> u8 {
        CODES[self.sector(self.cell)]
    }
}
