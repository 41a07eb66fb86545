use super::*;
use fixed::types::I1F15;

/// EMF of phase A at an electrical angle in degrees: flat top 30, from 30° to 150°.
fn emf(degrees: i32) -> i32 {
    let x = (degrees + 90).rem_euclid(360) - 90;
    x.min(180 - x).clamp(-30, 30)
}

/// Torque per ampere of current from the `Pwm` leg to the `Low` leg.
fn torque(legs: [Leg; 3], degrees: i32) -> i32 {
    let phases = [emf(degrees), emf(degrees - 120), emf(degrees - 240)];
    legs.iter().zip(phases).fold(0, |sum, (leg, e)| match leg {
        Leg::Pwm => sum + e,
        Leg::Low => sum - e,
        Leg::Float => sum,
    })
}

fn legs(sector: u8, duty: i16) -> [Leg; 3] {
    match bridge(Some(sector), Some(Duty(I1F15::from_bits(duty)))) {
        Bridge::On { legs, duty } => {
            assert!(duty >= Duty::ZERO);
            legs
        }
        Bridge::Off => panic!("off in sector {sector}"),
    }
}

#[test]
fn vector_of_each_sector_is_the_best_of_six_for_either_sign() {
    for sector in 0..6_u8 {
        for degrees in 30 + 60 * i32::from(sector)..90 + 60 * i32::from(sector) {
            for (duty, sign) in [(1000, 1), (-1000, -1), (i16::MIN, -1)] {
                let ours = sign * torque(legs(sector, duty), degrees);
                let best = POSITIVE.iter().map(|&v| sign * torque(v, degrees)).max();
                assert_eq!(Some(ours), best, "sector {sector}, {degrees}°, duty {duty}");
                assert_eq!(ours, 60, "both phases at their flat tops");
            }
        }
    }
}

#[test]
fn adjacent_sectors_give_adjacent_vectors() {
    for sector in 0..6_u8 {
        let (a, b) = (legs(sector, 1), legs((sector + 1) % 6, 1));
        let changed = a.iter().zip(b).filter(|(a, b)| **a != *b).count();
        assert_eq!(changed, 2, "one leg keeps its current: {a:?} → {b:?}");
        assert_eq!(a.iter().filter(|l| **l == Leg::Float).count(), 1);
        assert_eq!(legs(sector, -1), legs((sector + 3) % 6, 1));
    }
}

#[test]
fn vector_follows_the_trusted_sector_and_ignores_glitches() {
    let wiring = Wiring::STANDARD;
    let mut c = Commutator::new(wiring, wiring.code(0), 7);
    assert_eq!(c.bridge(), Bridge::Off);
    let duty = Duty(I1F15::from_bits(1234));
    c.set(Some(duty));
    assert_eq!(c.bridge(), Bridge::On { legs: POSITIVE[0], duty });
    assert!(matches!(c.sample(wiring.code(1), Micros(1000)), Some(HallEvent::Step(_))));
    assert_eq!(c.bridge(), Bridge::On { legs: POSITIVE[1], duty });
    for code in [0, 7, wiring.code(3), wiring.code(4), wiring.code(5)] {
        assert!(!matches!(c.sample(code, Micros(1100)), Some(HallEvent::Step(_))));
        assert_eq!(c.bridge(), Bridge::On { legs: POSITIVE[1], duty });
    }
    assert_eq!(c.count(), 8);
    c.set(None);
    assert_eq!(c.bridge(), Bridge::Off);
}

#[test]
fn held_sector_stays_wherever_the_rotor_is() {
    let wiring = Wiring::STANDARD;
    let mut c = Commutator::new(wiring, wiring.code(0), 7);
    let duty = Duty(I1F15::from_bits(1234));
    c.set(Some(duty));
    c.hold(Some(4));
    assert_eq!(c.bridge(), bridge(Some(4), Some(duty)));
    _ = c.sample(wiring.code(1), Micros(10_000));
    assert_eq!(c.bridge(), bridge(Some(4), Some(duty)));
    c.hold(None);
    assert_eq!(c.bridge(), bridge(Some(1), Some(duty)));
}

#[test]
fn bridge_is_off_without_a_sector() {
    let mut c = Commutator::new(Wiring::STANDARD, 7, 0);
    c.set(Some(Duty::ZERO));
    assert_eq!(c.bridge(), Bridge::Off);
    assert_eq!(bridge(Some(6), Some(Duty::ZERO)), Bridge::Off);
    let code = Wiring::STANDARD.code(2);
    assert_eq!(c.sample(code, Micros(0)), None);
    assert!((1..9).any(|ms| {
        _ = c.sample(code, Micros(ms * 1000));
        c.is_settled(code)
    }));
    assert_eq!(c.bridge(), Bridge::On { legs: POSITIVE[2], duty: Duty::ZERO });
}

proptest::proptest! {
    #[test]
    fn ahead_is_the_bridge_after_the_sample(
        samples in proptest::collection::vec((0..8_u8, 0..5000_u32, -1..=1_i16), 0..200),
    ) {
        let mut c = Commutator::new(Wiring::STANDARD, 2, 0);
        let mut now = 0_u32;
        for (code, later, duty) in samples {
            now = now.wrapping_add(later);
            c.set((duty != 0).then_some(Duty(I1F15::from_bits(duty.wrapping_mul(1000)))));
            let (ahead, before) = (c.ahead(code, Micros(now)), c.count());
            c.sample(code, Micros(now));
            if ahead.is_some() {
                proptest::prop_assert_eq!(ahead, Some(c.bridge()));
            } else {
                proptest::prop_assert_eq!(c.count(), before);
            }
        }
    }
}
