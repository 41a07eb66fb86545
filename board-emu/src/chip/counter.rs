//! The counter of all timers: prescaler, counter, auto-reload (RM0008 14.3.1, 14.3.2, 15.3.1, 15.3.2).
//!
//! A function of time, brought up to date when it is read, from one turn to the next.

use crate::time::{NEVER, Time};

/// Counting mode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Direction {
    /// Up: from 0 to ARR, and again from 0.
    #[default]
    Up,
    /// Down: from ARR to 0.
    Down,
    /// Up and down again.
    Centre,
}

/// A counter.
#[derive(Clone, Debug)]
pub struct Counter {
    /// Ticks per clock of the timer.
    cycle: Time,
    /// Time of the present count; unused while it is stopped.
    since: Time,
    /// CEN.
    pub running: bool,
    /// The count.
    pub count: u32,
    /// DIR as read: counting down.
    pub down: bool,
    /// Counting mode.
    pub direction: Direction,
    /// PSC as read; takes effect at the next update.
    pub prescaler: u32,
    /// ARR as read.
    pub reload: u32,
    /// ARPE: a new ARR takes effect at the next update.
    pub buffered: bool,
    /// PSC in effect.
    divider: u32,
    /// ARR in effect.
    pub top: u32,
}

impl Default for Counter {
    fn default() -> Self {
        Self {
            cycle: 2,
            since: 0,
            running: false,
            count: 0,
            down: false,
            direction: Direction::Up,
            prescaler: 0,
            reload: 0xFFFF,
            buffered: false,
            divider: 0,
            top: 0xFFFF,
        }
    }
}

impl Counter {
    /// Ticks per count.
    #[must_use]
    pub fn step(&self) -> Time {
        self.cycle * self.clocks()
    }

    /// Timer clocks per count.
    #[must_use]
    pub fn clocks(&self) -> Time {
        Time::from(self.divider) + 1
    }

    /// Changes the timer's clock at `now`, to which the counter is up to date.
    pub fn set_cycle(&mut self, cycle: Time, now: Time) {
        if cycle != self.cycle {
            let clocks = now.saturating_sub(self.since) / self.cycle;
            self.since = now.saturating_sub(clocks * cycle);
            self.cycle = cycle;
        }
    }

    /// Ticks per clock of the timer.
    #[must_use]
    pub const fn cycle(&self) -> Time {
        self.cycle
    }

    /// Starts or stops it; it is up to date with `now`.
    pub fn run(&mut self, on: bool, now: Time) {
        if on && !self.running {
            self.since = now;
        }
        self.running = on;
    }

    /// At least 1.
    fn to_turn(&self) -> u32 {
        match (self.direction, self.down) {
            // From beyond ARR it counts to the end of its 16 bits.
            (Direction::Up, _) => (if self.count <= self.top { self.top } else { 0xFFFF }) - self.count + 1,
            (Direction::Down, _) => self.count + 1,
            (Direction::Centre, false) if self.count >= self.top => 1,
            (Direction::Centre, false) => self.top - self.count,
            (Direction::Centre, true) => self.count.max(1),
        }
    }

    /// Time of the next turn, or of the next of these `counts`.
    #[must_use]
    pub fn next_stop(&self, counts: &[u32]) -> Time {
        // With ARR 0 the counter stands still (RM0008 14.4.12).
        if !self.running || self.top == 0 {
            return NEVER;
        }
        // A count in the other direction comes after the turn; so does the present one.
        let to_count = |count: u32| {
            if self.down { self.count.wrapping_sub(count) } else { count.wrapping_sub(self.count) }
        };
        let ahead = counts.iter().map(|&count| to_count(count)).filter(|&ahead| ahead > 0);
        let ahead = ahead.fold(self.to_turn(), u32::min);
        self.since + Time::from(ahead) * self.step()
    }

    /// Counts up to `now`, which is not past [`Self::next_stop`]. Returns whether it turned: an overflow or
    /// underflow.
    pub fn advance(&mut self, now: Time) -> bool {
        if !self.running || self.top == 0 {
            return false;
        }
        let passed = now.saturating_sub(self.since) / self.step();
        self.since += passed * self.step();
        let passed = u32::try_from(passed).unwrap_or(u32::MAX);
        if passed < self.to_turn() {
            self.count = if self.down { self.count - passed } else { self.count + passed };
            return false;
        }
        match self.direction {
            Direction::Up => self.count = 0,
            Direction::Down => self.count = self.top,
            Direction::Centre => {
                self.count = if self.down { 0 } else { self.top };
                self.down = !self.down;
            }
        }
        true
    }

    /// Update: the buffered values take effect.
    pub fn update(&mut self) {
        self.divider = self.prescaler;
        self.top = self.reload;
    }

    /// UG, or a slave reset: restarts at `now` after an update.
    pub fn restart(&mut self, now: Time) {
        self.since = now;
        self.down = self.direction == Direction::Down;
        self.count = if self.down { self.top } else { 0 };
    }

    /// Writes ARR.
    pub fn set_reload(&mut self, reload: u32) {
        self.reload = reload;
        if !self.buffered {
            self.top = reload;
        }
    }

    /// Writes CNT at `now`; the prescaler is not restarted.
    pub fn set_count(&mut self, count: u32) {
        self.count = count;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counter(direction: Direction, top: u32) -> Counter {
        let mut counter = Counter { direction, ..Counter::default() };
        counter.set_reload(top);
        counter.update();
        counter.restart(0);
        counter.run(true, 0);
        counter
    }

    fn counts(counter: &mut Counter, clocks: u64) -> (Vec<u32>, Vec<u64>) {
        let mut turns = Vec::new();
        let mut seen = Vec::new();
        for clock in 0..clocks {
            if counter.advance(clock * 2) {
                turns.push(clock);
            }
            seen.push(counter.count);
        }
        (seen, turns)
    }

    #[test]
    fn up_down_and_centered() {
        let (seen, turns) = counts(&mut counter(Direction::Up, 3), 9);
        assert_eq!((seen, turns), (vec![0, 1, 2, 3, 0, 1, 2, 3, 0], vec![4, 8]));
        let (seen, turns) = counts(&mut counter(Direction::Down, 3), 9);
        assert_eq!((seen, turns), (vec![3, 2, 1, 0, 3, 2, 1, 0, 3], vec![4, 8]));
        // 0 to ARR - 1, then ARR down to 1: a period of 2 ARR (RM0008 14.3.2).
        let (seen, turns) = counts(&mut counter(Direction::Centre, 3), 13);
        assert_eq!((seen, turns), (vec![0, 1, 2, 3, 2, 1, 0, 1, 2, 3, 2, 1, 0], vec![3, 6, 9, 12]));
    }

    #[test]
    fn prescaler_takes_effect_at_update() {
        let mut counter = counter(Direction::Up, 9);
        counter.prescaler = 71;
        assert_eq!(counter.next_stop(&[]), 20);
        assert!(counter.advance(20));
        counter.update();
        assert_eq!(counter.next_stop(&[]), 20 + 10 * 144);
        counter.advance(20 + 3 * 144 - 1);
        assert_eq!(counter.count, 2);
        counter.advance(20 + 3 * 144);
        assert_eq!(counter.count, 3);
    }

    #[test]
    fn clock_change_keeps_counted_clocks() {
        let mut counter = counter(Direction::Up, 99);
        counter.prescaler = 9;
        counter.update();
        // Seven clocks of ten, then three slower ones.
        counter.advance(1014);
        assert_eq!(counter.count, 50);
        counter.set_cycle(18, 1014);
        counter.advance(1014 + 3 * 18 - 1);
        assert_eq!(counter.count, 50);
        counter.advance(1014 + 3 * 18);
        assert_eq!(counter.count, 51);
    }

    #[test]
    fn next_stop_is_a_given_count_or_the_turn() {
        let counter = counter(Direction::Centre, 1800);
        assert_eq!(counter.next_stop(&[85, 900]), 170);
        assert_eq!(counter.next_stop(&[0, 1801]), 3600);
    }
}
