//! Motors that start together arrive together: those that would arrive first cruise slower, by MV for the time of the motion.
//!
//! The duration of a move by the boards' trapezoid, with acceleration a = (ACCEL/1024)² counts/ms² (decision 0002) and cruise velocity
//! v = min(MV, MCV or MOV), over d counts:
//!
//! ```text
//! t = d/v + v/a   if it cruises (v²/a ≤ d)
//! t = 2·√(d/a)    otherwise
//! ```
//!
//! ACCEL is a parameter of the language and is not changed: on the way two motors differ a little, because the slower one cruises longer.

use tater_wire::Property;

use crate::boards::Answers;
use crate::god::God;
use crate::motors::{Motor, Motors};
use crate::status::Status;
use crate::{order, query, units};

#[derive(Clone, Copy, Debug)]
struct Travel {
    /// Hall counts, 0 or more.
    distance: i64,
    accel: i64,
    /// Cruise velocity, hall counts/s.
    velocity: i64,
}

const MIN_VELOCITY: i64 = Property::MV.rules().min();

impl Travel {
    /// Its duration, µs; `None` with ACCEL 0, which never moves.
    fn duration_us(self) -> Option<i64> {
        let Self { distance, accel, velocity } = self;
        let square = accel.checked_mul(accel).filter(|&square| square > 0)?;
        // v/a in µs, with a = ACCEL² · 10⁶/2²⁰ counts/s².
        let ramp_us = velocity.checked_mul(1 << 20)?.checked_div(square)?;
        let cruises = velocity.checked_mul(ramp_us)? <= distance.checked_mul(1_000_000)?;
        if cruises {
            Some(distance.checked_mul(1_000_000)? / velocity.max(1) + ramp_us)
        } else {
            let area = distance.checked_mul(1_000_000)?.checked_mul(1 << 20)?.unsigned_abs();
            i64::try_from(2 * area.isqrt()).ok()?.checked_div(accel)
        }
    }

    /// The slowest cruise velocity that takes no longer than `duration_us`; its own if it takes as long anyway.
    fn velocity_within(self, duration_us: i64) -> i64 {
        let in_time = |velocity| {
            Self { velocity, ..self }.duration_us().is_some_and(|duration| duration <= duration_us)
        };
        let (mut too_slow, mut fast_enough) = (MIN_VELOCITY - 1, self.velocity);
        // The range is halved each time: at most 12 times.
        while fast_enough - too_slow > 1 {
            let middle = too_slow.midpoint(fast_enough);
            if in_time(middle) {
                fast_enough = middle;
            } else {
                too_slow = middle;
            }
        }
        fast_enough
    }
}

/// Slows motors so that those of each group arrive together, from `from` to `goals`, GCL counts.
///
/// # Errors
/// [`Status::NO_BOARD`]: one does not answer.
pub(crate) async fn arrive_together(
    god: &God<'_>,
    groups: &[Motors],
    from: &Answers,
    goals: &Answers,
) -> Result<(), Status> {
    let motors = groups.iter().copied().fold(Motors::NONE, Motors::union);
    if motors.is_empty() {
        return Ok(());
    }
    let accel = query::property(god, motors, Property::ACCEL).await?;
    let cruise = query::property(god, motors, Property::MV).await?;
    let closing = query::property(god, motors, Property::MCV).await?;
    let opening = query::property(god, motors, Property::MOV).await?;
    let travel = |motor: Motor| {
        let distance = units::halls_from_gcl(goals.get(motor)?) - units::halls_from_gcl(from.get(motor)?);
        let limit = if distance > 0 { &closing } else { &opening };
        let velocity = cruise.get(motor)?.min(limit.get(motor)?);
        Some(Travel { distance: distance.abs(), accel: accel.get(motor)?, velocity })
    };
    let mut slower = Answers::default();
    for group in groups {
        let longest = group.iter().filter_map(|motor| travel(motor)?.duration_us()).max().unwrap_or(0);
        for motor in group.iter() {
            let Some(travel) = travel(motor).filter(|travel| travel.distance > 0) else { continue };
            let velocity = travel.velocity_within(longest);
            if velocity < travel.velocity {
                slower.set(motor, velocity);
            }
        }
    }
    order::override_property(god, Property::MV, &slower, &cruise).await;
    Ok(())
}

/// Slows the tips of `fingers` to their share of their links' velocity, while both move until they stall: there are no goals.
///
/// # Errors
/// [`Status::NO_BOARD`]: one does not answer.
pub(crate) async fn move_along(god: &God<'_>, fingers: &[Motors], closing: bool) -> Result<(), Status> {
    let motors = fingers.iter().copied().fold(Motors::NONE, Motors::union);
    if motors.is_empty() {
        return Ok(());
    }
    let property = if closing { Property::MCV } else { Property::MOV };
    let limits = query::property(god, motors, property).await?;
    let mut slower = Answers::default();
    for tip in motors.intersection(Motors::TIPS).iter() {
        let of_link = tip.link().and_then(|link| limits.get(link));
        let velocity = of_link.map(|velocity| units::tip_travel_along(velocity).max(MIN_VELOCITY));
        if let Some(velocity) = velocity.filter(|&velocity| limits.get(tip).is_some_and(|own| velocity < own))
        {
            slower.set(tip, velocity);
        }
    }
    order::override_property(god, property, &slower, &limits).await;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn duration_equals_the_manual_and_the_formula() {
        // 166 counts of the spread at ACCEL 30: 0.88 s (manual 1.3.1, decision 0002).
        let spread = Travel { distance: 166, accel: 30, velocity: 1000 };
        assert_eq!(spread.duration_us().map(|us| us / 1000), Some(879));
        // Long enough to cruise: 1000 counts at 100/s and 100/858.3 s of ramps.
        let long = Travel { distance: 1000, accel: 30, velocity: 100 };
        assert_eq!(long.duration_us().map(|us| us / 1000), Some(10_116));
        assert_eq!(Travel { distance: 0, ..spread }.duration_us(), Some(0));
        assert_eq!(Travel { accel: 0, ..spread }.duration_us(), None);
        assert_eq!(Travel { distance: i64::MAX, ..spread }.duration_us(), None, "and no overflow");
    }

    #[test]
    fn velocity_within_is_the_slowest_that_is_in_time() {
        for distance in [1, 10, 88, 350, 65_534] {
            for accel in [1, 20, 30, 60, 65_535] {
                let travel = Travel { distance, accel, velocity: 1000 };
                let own = travel.duration_us().expect("it moves");
                assert_eq!(travel.velocity_within(own - 1), 1000, "it cannot be faster");
                for duration in [own, own + own / 10, 2 * own, 100 * own] {
                    let velocity = travel.velocity_within(duration);
                    let at = |velocity| Travel { velocity, ..travel }.duration_us().expect("it moves");
                    assert!(at(velocity) <= duration, "{travel:?} {duration}");
                    assert!(velocity == MIN_VELOCITY || at(velocity - 1) > duration, "{travel:?} {duration}");
                }
            }
        }
    }

    #[test]
    fn travel_that_just_reaches_its_cruise_velocity_takes_twice_its_ramp() {
        // ACCEL 1024 is 1 count/ms²: 1000 counts/s after 1 ms.
        let travel = |distance| Travel { distance, accel: 1024, velocity: 1000 };
        assert_eq!(travel(1).duration_us(), Some(2000));
        assert_eq!(travel(2).duration_us(), Some(3000));
        assert_eq!(Travel { velocity: 500, ..travel(1) }.duration_us(), Some(2500));
        assert_eq!(Travel { accel: 2048, ..travel(1) }.duration_us(), Some(1250));
        assert_eq!(Travel { velocity: 2000, ..travel(1) }.duration_us(), Some(2000), "a triangle");
    }
}
