//! Conversions between GCL counts, the boards' hall counts (55 to 1, manual 1.3.2), degrees and percents. No other file converts them.

use tater_wire::MotorKind;

/// GCL counts per hall count.
pub const GCL_PER_HALL: i64 = 55;

/// GCL counts of a position in hall counts.
#[must_use]
pub const fn gcl_from_halls(halls: i64) -> i64 {
    halls.saturating_mul(GCL_PER_HALL)
}

/// Thousands of GCL counts in a distance in motor revolutions: 0.99 of it.
#[must_use]
pub const fn gcl_thousands_from_revolutions(revolutions: i64) -> i64 {
    gcl_from_halls(revolutions.saturating_mul(MotorKind::COUNTS_PER_TURN)) / 1000
}

/// The hall count nearest to a GCL count, rounding halves up.
#[must_use]
pub const fn halls_from_gcl(gcl: i64) -> i64 {
    // Half of it is 27.5, and GCL counts are integers.
    gcl.saturating_add(GCL_PER_HALL / 2).div_euclid(GCL_PER_HALL)
}

/// GCL counts of 100 revolutions of a joint: gear ratio × 18 hall counts × 55 (manual 1.3.2, table 2).
const fn gcl_per_100_revolutions(kind: MotorKind) -> i64 {
    kind.gear_hundredths() * MotorKind::COUNTS_PER_TURN * GCL_PER_HALL
}

/// GCL counts of a joint angle in degrees, rounding halves up: 90 degrees of a link are 12128.
#[must_use]
pub const fn gcl_from_degrees(kind: MotorKind, degrees: i64) -> i64 {
    rounded(degrees.saturating_mul(gcl_per_100_revolutions(kind)), 36_000)
}

/// GCL counts of a percentage of a close target, rounding halves up.
#[must_use]
pub const fn gcl_from_percent(percent: i64, close_target: i64) -> i64 {
    rounded(percent.saturating_mul(close_target), 100)
}

/// The travel of a tip that moves along with its link, in the unit of `link`: a third of the link's joint angle. The manual simulates a
/// BarrettHand without stating this share; that hand's gears, 375:1 and 125:1, make a third (decision 0030).
#[must_use]
pub const fn tip_travel_along(link: i64) -> i64 {
    rounded(link.saturating_mul(MotorKind::Tip.gear_hundredths()), 3 * MotorKind::Link.gear_hundredths())
}

/// The travel of a tip that keeps its direction while its link moves, in the unit of `link`: the same joint angle the other way.
#[must_use]
pub const fn tip_travel_against(link: i64) -> i64 {
    rounded(link.saturating_mul(-MotorKind::Tip.gear_hundredths()), MotorKind::Link.gear_hundredths())
}

const fn rounded(numerator: i64, denominator: i64) -> i64 {
    numerator.saturating_add(denominator / 2).div_euclid(denominator)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degrees_convert_as_in_the_manual() {
        assert_eq!(gcl_from_degrees(MotorKind::Link, 90), 12128, "1.3.2's example");
        assert_eq!(gcl_from_degrees(MotorKind::Link, -90), -12127, "halves go up");
        assert_eq!(gcl_from_degrees(MotorKind::Tip, 180), 19305);
        assert_eq!(gcl_from_degrees(MotorKind::Spread, 180), 9049);
        assert_eq!(gcl_from_percent(50, 18_200), 9100);
        assert_eq!(gcl_from_percent(-10, 9300), -930);
    }

    #[test]
    fn tip_follows_a_third_of_the_links_angle_and_opposes_all_of_it() {
        for degrees in -10..=130 {
            let link = gcl_from_degrees(MotorKind::Link, 3 * degrees);
            let (along, against) =
                (gcl_from_degrees(MotorKind::Tip, degrees), gcl_from_degrees(MotorKind::Tip, -3 * degrees));
            assert!((tip_travel_along(link) - along).abs() <= 1, "{degrees}");
            assert!((tip_travel_against(link) - against).abs() <= 1, "{degrees}");
        }
        // 18200 · 39 / 147 and 12000 · 39 / 49.
        assert_eq!((tip_travel_along(18_200), tip_travel_against(12_000)), (4829, -9551));
    }

    #[test]
    fn odometer_has_steps_of_one_thousand_gcl_counts() {
        // Six moves of 18,000 and HI: 1964 hall counts and some.
        assert_eq!(gcl_thousands_from_revolutions(110), 108);
        let steps = (0..5000)
            .map(|turns| gcl_thousands_from_revolutions(turns + 1) - gcl_thousands_from_revolutions(turns));
        assert!(steps.into_iter().all(|step| (0..=1).contains(&step)));
        assert_eq!(gcl_thousands_from_revolutions(u32::MAX.into()), 4_252_017_622);
    }

    #[test]
    fn halls_from_gcl_rounds_to_the_nearest_count() {
        for halls in -200..=400 {
            for off in -27..=27 {
                assert_eq!(halls_from_gcl(gcl_from_halls(halls) + off), halls);
            }
        }
        // The language's defaults: DP 8500, 1575; CT 18200, 9300; DS 1400, 800; MPE 200.
        let halls = [8500, 1575, 18_200, 9300, 1400, 800, 200].map(halls_from_gcl);
        assert_eq!(halls, [155, 29, 331, 169, 25, 15, 4]);
    }
}
