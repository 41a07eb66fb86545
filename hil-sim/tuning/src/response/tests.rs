use super::*;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// `per_decade` points a decade from `from` to `to` Hz.
fn response(from: f64, to: f64, per_decade: f64, of: impl Fn(Complex64) -> Complex64) -> Response {
    let count = ((to / from).log10() * per_decade).round();
    let hz = |i: usize| from * (to / from).powf(i as f64 / count);
    let points = (0..=count as usize).map(hz);
    let points = points.map(|hz| Point { hz, value: of(Complex64::new(0.0, TAU * hz)) }).collect();
    Response::new(points).expect("a response")
}

fn delayed(s: Complex64) -> Complex64 {
    10.0 * (-0.05 * s).exp() / s
}

fn third_order(gain: f64) -> impl Fn(Complex64) -> Complex64 {
    move |s| gain / (s * s * s + 10.0 * s * s + 10.0 * s + 10.0)
}

#[track_caller]
fn assert_near(found: impl Into<Option<f64>>, wanted: f64, tolerance: f64) {
    let found = found.into().expect("it exists");
    assert!((found - wanted).abs() <= tolerance, "{found}, want {wanted} ± {tolerance}");
}

/// ω = 10: the phase is −90 − 0.5 rad; ω = 10π: it is −180, with 1/π.
#[test]
fn delayed_integrator_has_its_analytic_margins() {
    let margins = response(0.1, 100.0, 20.0, delayed).margins();
    assert_near(margins.phase_margin_deg, 90.0 - 0.5_f64.to_degrees(), 0.01);
    assert_near(margins.gain_margin, std::f64::consts::PI, 0.001);
    assert_near(margins.crossover_hz, 10.0 / TAU, 1e-6);
    assert_near(margins.phase_crossover_hz, 5.0, 0.002);
    // The phase margin over the crossover: (π/2 − 0.5)/10 s.
    assert_near(margins.delay_margin_ms, 107.08, 0.02);
    assert_eq!(margins.stable, Some(true));
    assert_eq!(margins.gain_margin_low, None);
}

/// 29.11°, 3.600 and 2.487: the requirement. GM: ω² = 10, so 25/(100 − 10).
#[test]
fn third_order_loop_has_its_margins_on_fine_and_coarse_grids() {
    for (per_decade, phase, gain, peak) in [(100.0, 0.005, 0.0005, 0.0005), (10.0, 0.1, 0.01, 0.005)] {
        let margins = response(0.01, 10.0, per_decade, third_order(25.0)).margins();
        assert_near(margins.phase_margin_deg, 29.11, phase);
        assert_near(margins.gain_margin, 3.600, gain);
        assert_near(margins.ms, 2.487, peak);
        assert_eq!(margins.stable, Some(true));
    }
}

/// The peak of |(1 − L)/(1 + L)| on a grid of a million points.
#[test]
fn disk_margin_and_bandwidth_are_those_of_a_dense_search() {
    let of = third_order(25.0);
    let dense = (0..1_000_000).map(|i| 0.01 * 1000f64.powf(f64::from(i) / 1e6));
    let (mut most, mut bandwidth) = (0.0_f64, None);
    for hz in dense {
        let l = of(Complex64::new(0.0, TAU * hz));
        most = most.max(((1.0 - l) / (1.0 + l)).norm());
        if bandwidth.is_none() && (l / (1.0 + l)).norm() < 0.5_f64.sqrt() {
            bandwidth = Some(hz);
        }
    }
    let margins = response(0.01, 10.0, 100.0, of).margins();
    assert_near(margins.disk_margin, 2.0 / most, 1e-4);
    assert_near(margins.bandwidth_hz, bandwidth.expect("it falls"), 1e-4);
}

#[test]
fn unstable_loop_has_a_negative_phase_margin_and_a_gain_margin_below_1() {
    let margins = response(0.01, 10.0, 50.0, third_order(120.0)).margins();
    assert_eq!(margins.stable, Some(false));
    assert!(margins.phase_margin_deg.is_some_and(|margin| margin < -4.0), "{margins:?}");
    assert_near(margins.gain_margin, 0.75, 1e-3);
    assert_near(margins.gain_margin_low, 0.75, 1e-3);
    assert_eq!((margins.disk_margin, margins.delay_margin_ms), (None, None));
    assert!(margins.doubts.iter().any(|doubt| doubt.contains("unstable")));
}

/// A phase of −400° at the crossover, and a band that begins above 0 dB with a phase that no slope of −1 has.
#[test]
fn phase_beyond_a_turn_is_unstable_and_a_strange_begin_is_unknown() {
    let late = response(0.01, 3.0, 60.0, |s| 10.0 * (-0.55 * s).exp() / s).margins();
    assert_eq!(late.stable, Some(false));
    // −90 − 5.5 rad = −405.1°: 134.9° from −540°.
    assert_near(late.phase_margin_deg, -134.9, 0.1);
    let strange = response(0.01, 10.0, 20.0, |s| Complex64::new(0.0, 1.0) / s).margins();
    assert_eq!(strange.stable, None);
    assert!(strange.reasons.iter().any(|(name, why)| *name == "closed_loop_stable" && why.contains("begin")));
}

/// s³ + K(s + 1)²: stable from K = 0.5 on (Routh), and for all higher gains.
#[test]
fn conditionally_stable_loop_has_a_margin_downward() {
    let loop_of =
        |gain: f64| response(0.001, 10.0, 40.0, move |s| gain * (s + 1.0) * (s + 1.0) / (s * s * s));
    let margins = loop_of(2.0).margins();
    assert_eq!((margins.stable, margins.gain_margin), (Some(true), None));
    assert_near(margins.gain_margin_low, 0.25, 1e-3);
    assert!(margins.phase_margin_deg.is_some_and(|margin| margin > 0.0));
    let margins = loop_of(0.25).margins();
    assert_eq!(margins.stable, Some(false));
    assert_near(margins.gain_margin, 2.0, 0.01);
}

/// k/(s − 1) circles −1 once, as its unstable pole asks for.
#[test]
fn loop_with_an_unstable_pole_is_taken_for_stable_and_its_mirror_not() {
    let margins = response(0.001, 10.0, 20.0, |s| 10.0 / (s - 1.0)).margins();
    assert_eq!(margins.stable, Some(true));
    assert_near(margins.phase_margin_deg, 84.26, 0.02);
    let margins = response(0.001, 10.0, 20.0, |s| -10.0 / (s + 1.0)).margins();
    assert_eq!(margins.stable, Some(false));
}

#[test]
fn missing_margins_have_reasons() {
    let margins = response(0.01, 10.0, 20.0, |s| 0.5 / (s + 1.0)).margins();
    assert_eq!((margins.phase_margin_deg, margins.gain_margin), (None, None));
    let why = |name: &str| {
        let found = margins.reasons.iter().find(|(of, _)| *of == name);
        found.map(|(_, why)| why.clone()).unwrap_or_default()
    };
    assert!(why("phase_margin_deg").contains("below 0 dB from 0.01"), "{}", why("phase_margin_deg"));
    assert!(why("gain_margin").contains("does not cross -180"), "{}", why("gain_margin"));
    let high = response(0.01, 10.0, 20.0, |s| 5000.0 / (s + 1.0)).margins();
    assert_eq!((high.phase_margin_deg, high.stable), (None, None));
}

/// A resonance behind an integrator lifts the gain above 0 dB again.
#[test]
fn smallest_margin_of_several_crossings_counts() {
    let resonance = |s: Complex64, w: f64| w * w / (s * s + 0.02 * w * s + w * w);
    let of = move |s: Complex64| 1.0 / s * (1.0 + resonance(s, 8.0) * 0.5) * (-0.01 * s).exp();
    let margins = response(0.01, 100.0, 200.0, of).margins();
    assert_eq!(margins.gain_crossings.len(), 3, "{margins:?}");
    let all = margins.gain_crossings.iter().map(|crossing| crossing.phase_margin_deg.abs());
    let smallest = all.min_by(f64::total_cmp).expect("three");
    let first = margins.gain_crossings[0].phase_margin_deg;
    assert_near(margins.phase_margin_deg.map(f64::abs), smallest, 1e-9);
    assert!(smallest < first - 10.0, "{smallest} of {first}");
}

#[test]
fn bad_points_are_named() {
    let point = |hz: f64, re: f64| Point { hz, value: Complex64::new(re, 0.0) };
    let with = |at: usize, bad: Point| {
        let mut points: Vec<Point> = (1..=5).map(|i| point(f64::from(i), 1.0)).collect();
        points[at] = bad;
        Response::new(points).map(|_| ()).expect_err("refused")
    };
    assert_eq!(with(0, point(0.0, 1.0)), ResponseError::Frequency { at: 0 });
    assert_eq!(with(1, point(-2.0, 1.0)), ResponseError::Frequency { at: 1 });
    assert_eq!(with(4, point(f64::NAN, 1.0)), ResponseError::Frequency { at: 4 });
    assert_eq!(with(2, point(2.0, 1.0)), ResponseError::Order { at: 2 });
    assert_eq!(with(3, point(1.5, 1.0)), ResponseError::Order { at: 3 });
    assert_eq!(with(3, point(4.0, 0.0)), ResponseError::Value { at: 3 });
    assert_eq!(with(3, point(4.0, f64::INFINITY)), ResponseError::Value { at: 3 });
    let few = Response::new(vec![point(1.0, 1.0), point(2.0, 1.0), point(3.0, 1.0)]);
    assert_eq!(few.map(|_| ()), Err(ResponseError::TooFew { found: 3 }));
}

/// −1 itself, and a double integrator that runs along −180 degrees: no panic, no infinite number of crossings.
#[test]
fn degenerate_loops_have_finite_answers() {
    let margins = response(0.01, 10.0, 20.0, |s| 1.0 / (s * s)).margins();
    assert_near(margins.phase_margin_deg, 0.0, 1e-9);
    assert!(margins.phase_crossings.len() < 100);
    let margins = response(0.01, 10.0, 20.0, |_| Complex64::new(-1.0, 0.0)).margins();
    assert!(!margins.ms.is_finite() && margins.reasons.iter().any(|(name, _)| *name == "ms"));
}
