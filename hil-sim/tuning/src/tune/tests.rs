//! Small searches with the whole machinery.

use super::*;
use hil_experiment::properties;
use hil_experiment::scenario::Scenario;

fn settings(motor: MotorKind, objective: Objective, set: &[&str], plants: u64) -> Settings {
    let mut goal = Goal::new(objective, motor).unwrap_or_else(|bad| panic!("{bad}"));
    for assignment in set {
        goal.scenario.set(assignment).unwrap_or_else(|bad| panic!("{bad}"));
    }
    let config = goal.scenario.cases[0].config;
    let axes = [("KP", 20.0), ("KD", 100.0)]
        .map(|(name, knee)| {
            let property = properties::find(name).expect(name);
            Axis { property, start: property.get(&config), knee }
        })
        .to_vec();
    let ensemble = Ensemble {
        motor,
        goals: vec![goal],
        bench: crate::bode::scenario(motor).expect("valid"),
        scatter: 0.3,
        supply_v: None,
        first_seed: 1,
        plants,
    };
    Settings { axes, ensemble, shipped: Vec::new(), seed: 3, candidates: 30 }
}

fn pool(threads: usize) -> ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads")
}

#[test]
fn axis_begins_at_the_start_and_stays_in_range() {
    let property = properties::find("KI").expect("KI");
    for start in [0, 3, 500, 32_767] {
        let axis = Axis { property, start, knee: 200.0 };
        assert_eq!(axis.value(0.0), start);
        assert!(axis.value(1.0) > start || start == 32_767);
        assert_eq!((axis.value(-50.0), axis.value(50.0)), (0, 32_767));
    }
}

#[test]
fn search_finds_gains_for_a_motor_that_cannot_arrive() {
    // With 30 candidates chance decides whether it has come half of the way.
    let settings =
        Settings { candidates: 60, ..settings(MotorKind::Link, Objective::Step, &["KP=4", "KD=0"], 6) };
    let found = tune(&settings, &pool(2), &mut |_| true).expect("gains that keep the limits");
    assert!(found.tuned.judged.cost < 0.5 * found.start.judged.cost, "{found:?}");
    assert!(found.tuned.values[0] > 4, "{:?}", found.tuned.values);
    assert!(found.candidates >= 30);
}

#[test]
fn result_does_not_depend_on_threads() {
    let search = |threads| {
        let settings = settings(MotorKind::Spread, Objective::Step, &[], 6);
        let found = tune(&settings, &pool(threads), &mut |_| true).expect("gains that keep the limits");
        (
            found.tuned.values,
            found.tuned.judged.cost.to_bits(),
            found.runs,
            found.candidates,
            found.archive.len(),
        )
    };
    assert_eq!(search(1), search(3));
}

#[test]
fn go_on_ends_the_search() {
    let settings = settings(MotorKind::Spread, Objective::Step, &[], 2);
    let mut asked = 0;
    let found = tune(&settings, &pool(1), &mut |progress| {
        asked += 1;
        assert!(progress.best.is_finite() && progress.values.len() == 2);
        asked < 3
    });
    assert!(found.is_ok_and(|found| found.candidates < 30) && asked == 3);
}

/// Half of the motor's torque does not suffice for its friction.
#[test]
fn limits_that_nothing_keeps_name_the_plant() {
    let mut settings = settings(MotorKind::Link, Objective::Move, &["MT=20"], 2);
    settings.candidates = 6;
    let broken = tune(&settings, &pool(1), &mut |_| true).expect_err("no candidate can move");
    assert_eq!((broken.seed, broken.what.as_str()), (1, "ended stalled, not arrived"));
}

#[test]
fn hopeless_candidate_is_left_early() {
    let settings = settings(MotorKind::Spread, Objective::Step, &[], 40);
    let judge = |bound| settings.ensemble.judge(&|config| put(&settings.axes, &[120, 640], config), bound);
    let whole = judge(f64::INFINITY);
    let left = judge(whole.cost / 100.0);
    assert!(whole.is_whole && whole.runs == 40 && !left.is_whole && left.runs == 10);
}

#[test]
fn guards_trade_false_alarms_for_delay() {
    let settings = settings(MotorKind::Link, Objective::Grasp, &[], 3);
    let trades = alarms::trade_offs(&settings.ensemble, &|_| ());
    assert_eq!(trades.iter().map(|trade| trade.property.name).collect::<Vec<_>>(), ["TSTOP", "BT"]);
    for trade in &trades {
        let delay = |point: &Point| point.delay_ms.map(|(mean, _)| mean).expect("a delay");
        // The smallest values end moves before they touch the object.
        let first = trade.points.iter().find(|point| point.delay_ms.is_some()).expect("a delay");
        let last = &trade.points[trade.points.len() - 1];
        assert_eq!((last.alarms, last.missed), (0, 0), "{last:?}");
        assert!(delay(last) >= delay(first) && trade.suggested().is_some(), "{trade:?}");
    }
    // Slow moves have 50 ms from count to count, and TSTOP is waited for.
    let delay = |at: usize| trades[0].points[at].delay_ms.map_or(0.0, |(mean, _)| mean);
    assert!(delay(10) > delay(5) + 400.0, "{trades:?}");
    assert!(trades[0].points[0].alarms > 0, "{trades:?}");
}

#[test]
fn heavier_rotor_takes_margin_and_too_little_costs() {
    let settings = settings(MotorKind::Link, Objective::Step, &[], 1);
    let start: Vec<i64> = settings.axes.iter().map(|axis| axis.start).collect();
    let ms_of = |inertia: &str| {
        let mut settings = Settings {
            ensemble: settings.ensemble.clone(),
            axes: settings.axes.clone(),
            shipped: Vec::new(),
            ..settings
        };
        settings.ensemble.bench.override_figures(&[("plant", inertia)]).expect("valid");
        settings.ensemble.scatter = 0.0;
        let margins = stability::margins(&settings, &start);
        (margins[0].ms, margins[0].suffice(), stability::penalty(&settings, &start))
    };
    let (usual, suffices, costs) = ms_of("inertia=1x");
    assert!(usual < 1.4 && suffices && costs == 0.0, "{usual} {costs}");
    let (heavy, ..) = ms_of("inertia=3x");
    assert!(heavy > usual + 0.3, "{heavy}");
    let margins = stability::margins(&settings, &start);
    for (ms, phase, gain, suffices) in [
        (2.0, Some(30.0), Some(2.0), true),
        (2.1, Some(60.0), None, false),
        (1.5, Some(29.0), None, false),
        (1.5, None, Some(1.9), false),
    ] {
        let margins = LoopMargins { ms, phase_margin_deg: phase, gain_margin: gain, ..margins[0].clone() };
        assert_eq!(margins.suffice(), suffices, "{ms} {phase:?} {gain:?}");
    }
}

/// The gains that the objectives alone like best let the spread stall under the load of a shipped scenario.
#[test]
fn gains_that_break_a_shipped_scenario_are_told() {
    let mut settings = settings(MotorKind::Spread, Objective::Step, &[], 1);
    let axis = |(name, start): (&str, i64)| Axis {
        property: properties::find(name).expect("known"),
        start,
        knee: 1.0,
    };
    settings.axes = [("KP", 120), ("KI", 0), ("KD", 640), ("KPV", 32)].map(axis).into();
    let all =
        ["spread-hold-disturbance", "spread-full-travel"].map(|name| Scenario::find(name).expect("shipped"));
    settings.shipped = shipped::passed(all.into(), &settings.axes);
    assert_eq!(settings.shipped.len(), 2);
    assert!(shipped::lost(&settings, &[120, 0, 640, 32]).is_empty());
    let lost = shipped::lost(&settings, &[82, 227, 267, 58]);
    assert_eq!(lost.len(), 1, "{lost:?}");
    assert!(lost[0].starts_with("spread-hold-disturbance: "), "{lost:?}");
}

/// A scenario that is written with the values found reads them, also where its own text sets them.
#[test]
fn written_scenarios_have_the_values_found() {
    for objective in [Objective::Move, Objective::Step, Objective::Velocity, Objective::Grasp] {
        let goal = Goal::new(objective, MotorKind::Link).expect("valid");
        let text = goal.text_with(&[("MV", 300), ("KP", 70), ("HOLD", 0), ("MV", 321)]);
        let scenario = Scenario::parse("written", &text).unwrap_or_else(|bad| panic!("{bad}"));
        let value = |name| properties::find(name).expect(name).get(&scenario.cases[0].config);
        assert_eq!(["MV", "KP", "HOLD"].map(value), [321, 70, 0], "{text}");
    }
}

/// `hil-sim run` of a written scenario simulates the motor that was tuned, not the standard one.
#[test]
fn written_scenarios_have_the_plant_and_the_sensors_of_the_search() {
    let figures = [
        ("plant", "r_ohm=2.406"),
        ("plant", "inertia=1.4x"),
        ("plant", "ke_v_s=0.05834"),
        ("rig", "hall_offset_deg=7"),
        ("rig", "rise_delay=20"),
        ("supply", "volts=22"),
    ];
    for objective in [Objective::Move, Objective::Step, Objective::Velocity, Objective::Grasp] {
        for motor in [MotorKind::Link, MotorKind::Spread, MotorKind::Tip] {
            let mut goal = Goal::new(objective, motor).expect("valid");
            goal.scenario.override_figures(&figures).unwrap_or_else(|bad| panic!("{bad}"));
            let text = goal.text_with(&[("KP", 70)]);
            let scenario = Scenario::parse("written", &text).unwrap_or_else(|bad| panic!("{bad}"));
            assert_eq!(scenario.cases[0].plant, goal.scenario.cases[0].plant, "{text}");
            assert_eq!(scenario.rig, goal.scenario.rig, "{text}");
        }
    }
}
