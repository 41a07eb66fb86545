//! How motors that start together arrive together: who would be there first cruises slower (MV, for the time of the motion).
//!
//! Decides by the boards' trapezoid: acceleration a = (ACCEL/1024)² counts/ms², cruise velocity min(MV, MCV or MOV). ACCEL, a parameter of
//! the language, is left as it is, so on the way their shares differ a little: the slower one cruises longer.

use tater_wire::Property;

use super::{moves, ready};
use crate::boards::Answers;
use crate::god::God;
use crate::motors::{Motor, Motors};
use crate::status::Status;
use crate::units;

/// Range of MV, hall counts/s.
const SLOWEST: i64 = 16;

/// What a board goes by on its way.
#[derive(Clone, Copy, Debug)]
struct Way {
    /// Hall counts, 0 or more.
    distance: i64,
    /// ACCEL.
    accel: i64,
    /// Cruise velocity, hall counts/s.
    velocity: i64,
}

impl Way {
    /// How long it takes, µs; `None` with ACCEL 0, which never moves.
    fn duration_us(self) -> Option<i64> {
        let Self { distance, accel, velocity } = self;
        let square = accel.checked_mul(accel).filter(|&square| square > 0)?;
        // v/a in µs: a is ACCEL² · 10⁶/2²⁰ counts/s².
        let ramp_us = velocity.checked_mul(1 << 20)? / square;
        let cruises = velocity.checked_mul(ramp_us)? <= distance.checked_mul(1_000_000)?;
        if cruises {
            Some(distance.checked_mul(1_000_000)? / velocity.max(1) + ramp_us)
        } else {
            // 2·√(d/a).
            Some(2 * distance.checked_mul(1_000_000)?.checked_mul(1 << 20)?.isqrt() / accel)
        }
    }

    /// The slowest cruise with which it takes no longer than that; its own if it takes as long anyway.
    fn velocity_within(self, duration_us: i64) -> i64 {
        let in_time = |velocity| {
            Self { velocity, ..self }.duration_us().is_some_and(|duration| duration <= duration_us)
        };
        let (mut too_slow, mut enough) = (SLOWEST - 1, self.velocity);
        // Each time halved: 12 times at most.
        while enough - too_slow > 1 {
            let middle = too_slow.midpoint(enough);
            if in_time(middle) {
                enough = middle;
            } else {
                too_slow = middle;
            }
        }
        enough
    }
}

/// Lets the motors of each of `groups` arrive together, from `from` to `goals`, GCL counts.
///
/// # Errors
/// A board does not answer: [`Status::NO_BOARD`].
pub(super) async fn together(
    god: &God<'_>,
    groups: &[Motors],
    from: &Answers,
    goals: &Answers,
) -> Result<(), Status> {
    let motors = groups.iter().copied().fold(Motors::NONE, Motors::union);
    if motors.is_empty() {
        return Ok(());
    }
    let accel = ready::all(god, motors, Property::ACCEL).await?;
    let cruise = ready::all(god, motors, Property::MV).await?;
    let closing = ready::all(god, motors, Property::MCV).await?;
    let opening = ready::all(god, motors, Property::MOV).await?;
    let way = |motor: Motor| {
        let distance = units::halls(goals.get(motor)?) - units::halls(from.get(motor)?);
        let limit = if distance > 0 { &closing } else { &opening };
        let velocity = cruise.get(motor)?.min(limit.get(motor)?);
        Some(Way { distance: distance.abs(), accel: accel.get(motor)?, velocity })
    };
    let mut slower = Answers::default();
    for group in groups {
        let longest = group.iter().filter_map(|motor| way(motor)?.duration_us()).max().unwrap_or(0);
        for motor in group.iter() {
            let Some(way) = way(motor).filter(|way| way.distance > 0) else { continue };
            let velocity = way.velocity_within(longest);
            if velocity < way.velocity {
                slower.set(motor, velocity);
            }
        }
    }
    moves::lend(god, Property::MV, &slower, &cruise).await;
    Ok(())
}

/// Lets the tips of `fingers` go along with their links while both go until they stall, as far as velocities can do it: there are no goals.
///
/// # Errors
/// A board does not answer: [`Status::NO_BOARD`].
pub(super) async fn along(god: &God<'_>, fingers: &[Motors], closing: bool) -> Result<(), Status> {
    let motors = fingers.iter().copied().fold(Motors::NONE, Motors::union);
    if motors.is_empty() {
        return Ok(());
    }
    let property = if closing { Property::MCV } else { Property::MOV };
    let limits = ready::all(god, motors, property).await?;
    let mut slower = Answers::default();
    for tip in motors.intersection(Motors::TIPS).iter() {
        let of_link = tip.link().and_then(|link| limits.get(link));
        let velocity = of_link.map(|velocity| units::of_tip_along(velocity).max(SLOWEST));
        if let Some(velocity) = velocity.filter(|&velocity| limits.get(tip).is_some_and(|own| velocity < own))
        {
            slower.set(tip, velocity);
        }
    }
    moves::lend(god, property, &slower, &limits).await;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_those_of_the_manual_and_of_the_design() {
        // 166 counts of the spread at ACCEL 30: 0.88 s (manual 1.3.1, MANUAL-NOTES 25).
        let spread = Way { distance: 166, accel: 30, velocity: 1000 };
        assert_eq!(spread.duration_us().map(|us| us / 1000), Some(879));
        // Long enough to cruise: 1000 counts at 100/s and 100/858.3 s of ramps.
        let long = Way { distance: 1000, accel: 30, velocity: 100 };
        assert_eq!(long.duration_us().map(|us| us / 1000), Some(10_116));
        assert_eq!(Way { distance: 0, ..spread }.duration_us(), Some(0));
        assert_eq!(Way { accel: 0, ..spread }.duration_us(), None);
        assert_eq!(Way { distance: i64::MAX, ..spread }.duration_us(), None, "and no overflow");
    }

    #[test]
    fn the_slower_cruise_takes_as_long_as_was_asked_and_no_longer() {
        for distance in [1, 10, 88, 350, 65_534] {
            for accel in [1, 20, 30, 60, 65_535] {
                let way = Way { distance, accel, velocity: 1000 };
                let own = way.duration_us().expect("it moves");
                assert_eq!(way.velocity_within(own - 1), 1000, "it cannot be faster");
                for duration in [own, own + own / 10, 2 * own, 100 * own] {
                    let velocity = way.velocity_within(duration);
                    let at = |velocity| Way { velocity, ..way }.duration_us().expect("it moves");
                    assert!(at(velocity) <= duration, "{way:?} {duration}");
                    assert!(velocity == SLOWEST || at(velocity - 1) > duration, "{way:?} {duration}");
                }
            }
        }
    }
}
