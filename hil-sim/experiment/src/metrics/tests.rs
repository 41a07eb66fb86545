//! Feeds the meter hand-made ticks: what counts as a move, from which time, and past which goal.

use servo_core::units::{Counts, CountsPerSec, DeciCelsius, Duty, MilliAmps, MilliVolts, Torque};
use servo_core::way::Way;
use servo_core::{Command, EndReason, Event, Telemetry};

use super::*;
use hil_world::node::Sample;
use hil_world::plant::Ledger;
use hil_world::rig::Truth;
use tater_fw::Analog;

fn at(ms: u32, mode: Mode, counts: f64) -> Sample {
    let seen = Counts(fixed_counts(counts));
    Sample {
        ms,
        status: Telemetry {
            mode,
            position: seen,
            velocity: CountsPerSec::ZERO,
            setpoint: seen,
            setpoint_velocity: CountsPerSec::ZERO,
            torque: Torque(-40),
            duty: Duty::ZERO,
            fault: None,
            limit: None,
            end: None,
            homed: false,
            breakaway: None,
        },
        driven: mode != Mode::Idle,
        brake_released: false,
        truth: Truth {
            t_us: u64::from(ms) * 1000,
            counts,
            counts_per_s: 0.0,
            torque_n_m: 0.0,
            phase_a: [1.0, -3.0, 2.0],
            peak_phase_a: 3.5,
            bus_charge_c: 0.0,
            load_n_m: 0.0,
            finger_n_m: 0.0,
            finger_j: 0.0,
            winding_c: 30.0,
            housing_c: 25.0,
            brake_engaged: false,
            ledger: Ledger::default(),
        },
        halls: 1,
        analog: Analog {
            bus: MilliVolts(24_000),
            current: MilliAmps(0),
            motor_temp: DeciCelsius(250),
            strain: 128,
            ..Analog::default()
        },
        last_count_us: 0,
        zero_counts: 0.0,
    }
}

/// A position in the servo's own resolution; test values are multiples of 1/1024.
fn fixed_counts(counts: f64) -> fixed::types::I22F10 {
    fixed::types::I22F10::from_num(counts)
}

fn begun() -> Meter {
    Meter::new(&at(0, Mode::Idle, 0.0))
}

fn so_far(meter: &Meter) -> Metrics {
    meter.clone().finish(&at(0, Mode::Idle, 0.0))
}

fn tick(meter: &mut Meter, sample: &Sample) {
    meter.tick(sample, std::iter::empty());
}

fn ended(meter: &mut Meter, sample: &Sample, reason: EndReason) {
    meter.tick(sample, std::iter::once(Event::Ended { reason, mode: sample.status.mode }));
}

#[test]
fn time_zero_is_the_first_driven_tick_not_the_command() {
    let mut meter = begun();
    meter.command(&Command::Move(10), true, &at(100, Mode::Idle, 0.0), 0.0);
    // Waiting for the brake: in mode 5, bridge off.
    for ms in 101..130 {
        tick(&mut meter, &Sample { driven: false, ..at(ms, Mode::Trapezoidal, 0.0) });
    }
    for ms in 130..150 {
        tick(&mut meter, &at(ms, Mode::Trapezoidal, 5.0));
    }
    ended(&mut meter, &at(150, Mode::Idle, 10.0), EndReason::Arrived);
    let metrics = meter.finish(&at(150, Mode::Idle, 10.0));
    assert_eq!((metrics.end_ms, metrics.arrival_ms(), metrics.ends), (Some(20.0), Some(20.0), 1));
    assert_eq!((metrics.peak_torque, metrics.peak_current_a), (40.0, 3.5));
}

#[test]
fn stall_ends_without_arrival() {
    let mut meter = begun();
    meter.command(&Command::Move(10), true, &at(0, Mode::Idle, 0.0), 0.0);
    tick(&mut meter, &at(1, Mode::Trapezoidal, 0.0));
    let end = Sample { last_count_us: 101_500, ..at(401, Mode::Idle, 4.0) };
    ended(&mut meter, &end, EndReason::Stalled);
    let metrics = meter.finish(&end);
    assert_eq!((metrics.end_ms, metrics.arrival_ms()), (Some(400.0), None));
    assert_eq!(metrics.end_after_last_count_ms, Some(299.5));
}

#[test]
fn overshoot_is_past_the_end_in_the_direction_of_travel() {
    for (from, end, path, overshoot) in [
        (0.0, 10, [5.0, 11.5, 10.0], 1.5),
        (0.0, 10, [5.0, 9.5, 9.0], 0.0),
        (10.0, 0, [5.0, -0.75, 0.0], 0.75),
        // Away from the end first: no overshoot.
        (10.0, 0, [12.0, 5.0, 0.0], 0.0),
    ] {
        let mut meter = begun();
        meter.command(&Command::Move(end), true, &at(0, Mode::Idle, from), from);
        for (ms, counts) in (1..).zip(path) {
            tick(&mut meter, &at(ms, Mode::Trapezoidal, counts));
        }
        let metrics = meter.finish(&at(3, Mode::Trapezoidal, 0.0));
        assert_eq!(metrics.overshoot_counts, Some(overshoot), "{from} to {end}");
    }
}

#[test]
fn replan_keeps_the_move_and_changes_its_goal() {
    let mut meter = begun();
    meter.command(&Command::Move(100), true, &at(0, Mode::Idle, 0.0), 0.0);
    for ms in 1..=50 {
        tick(&mut meter, &at(ms, Mode::Trapezoidal, f64::from(ms)));
    }
    meter.command(&Command::End(40), true, &at(50, Mode::Trapezoidal, 50.0), 50.0);
    tick(&mut meter, &at(51, Mode::Trapezoidal, 60.0));
    tick(&mut meter, &at(52, Mode::Trapezoidal, 39.5));
    ended(&mut meter, &at(53, Mode::Pid, 40.0), EndReason::Arrived);
    let metrics = meter.finish(&at(53, Mode::Pid, 40.0));
    assert_eq!((metrics.end_ms, metrics.overshoot_counts), (Some(52.0), Some(0.5)));
}

#[test]
fn move_after_another_motion_has_its_own_time() {
    // From velocity without an idle tick between: mode 4 has no end.
    let mut meter = begun();
    meter.command(&Command::Mode(Mode::Velocity), true, &at(0, Mode::Idle, 0.0), 0.0);
    for ms in 1..=50 {
        tick(&mut meter, &at(ms, Mode::Velocity, 0.0));
    }
    meter.command(&Command::Move(10), true, &at(50, Mode::Velocity, 0.0), 0.0);
    for ms in 51..=70 {
        tick(&mut meter, &at(ms, Mode::Trapezoidal, 5.0));
    }
    ended(&mut meter, &at(71, Mode::Idle, 10.0), EndReason::Arrived);
    assert_eq!((so_far(&meter).end_ms, so_far(&meter).ends), (Some(20.0), 1));

    // After a move that the command cut short: that end belongs to the move before.
    meter.command(&Command::Move(90), true, &at(100, Mode::Idle, 10.0), 10.0);
    tick(&mut meter, &at(101, Mode::Trapezoidal, 10.0));
    let cut = at(150, Mode::Velocity, 50.0);
    meter.event(&Event::Ended { reason: EndReason::Aborted, mode: Mode::Velocity }, &cut);
    assert_eq!((so_far(&meter).end_reason, so_far(&meter).end_ms), (Some(EndReason::Aborted), Some(49.0)));
    meter.command(&Command::TorqueControlled { way: Way::Closing }, true, &cut, 50.0);
    assert_eq!((so_far(&meter).end_reason, so_far(&meter).end_ms), (None, None));
    tick(&mut meter, &at(151, Mode::Velocity, 50.0));
    ended(&mut meter, &at(451, Mode::Velocity, 50.0), EndReason::Stalled);
    let metrics = so_far(&meter);
    assert_eq!(
        (metrics.end_reason, metrics.end_ms, metrics.ends),
        (Some(EndReason::Stalled), Some(300.0), 3)
    );
    // The hold afterwards is no move, and neither is its end.
    ended(&mut meter, &at(600, Mode::Idle, 50.0), EndReason::Aborted);
    assert_eq!(so_far(&meter), metrics);
}

#[test]
fn move_at_its_goal_takes_no_time_and_undriven_move_has_none() {
    for (reason, end_ms) in [(EndReason::Arrived, Some(0.0)), (EndReason::Aborted, None)] {
        let mut meter = begun();
        meter.command(&Command::Move(0), true, &at(0, Mode::Idle, 0.0), 0.0);
        tick(&mut meter, &Sample { driven: false, ..at(1, Mode::Trapezoidal, 0.0) });
        ended(&mut meter, &at(2, Mode::Idle, 0.0), reason);
        let metrics = so_far(&meter);
        assert_eq!((metrics.end_reason, metrics.end_ms), (Some(reason), end_ms));
        assert_eq!(metrics.arrival_ms(), end_ms);
    }
}

#[test]
fn goal_belongs_to_its_move_only() {
    let mut meter = begun();
    meter.command(&Command::Move(10), true, &at(0, Mode::Idle, 0.0), 0.0);
    tick(&mut meter, &at(1, Mode::Trapezoidal, 11.0));
    ended(&mut meter, &at(2, Mode::Idle, 10.25), EndReason::Arrived);
    for ms in 3..=202 {
        tick(&mut meter, &at(ms, Mode::Idle, 10.25));
    }
    let done = so_far(&meter);
    assert_eq!((done.overshoot_counts, done.final_error_counts), (Some(1.0), Some(0.25)));
    meter.command(&Command::End(-30), true, &at(202, Mode::Idle, 10.25), 10.0);
    assert_eq!(so_far(&meter), done);
    // Mode 4 has no goal to overshoot, and mode 5 uses the E written before.
    meter.command(&Command::Mode(Mode::Velocity), true, &at(202, Mode::Idle, 10.25), 10.0);
    tick(&mut meter, &at(203, Mode::Velocity, 80.0));
    assert_eq!(so_far(&meter).overshoot_counts, None);
    meter.command(&Command::Mode(Mode::Trapezoidal), true, &at(203, Mode::Velocity, 80.0), 80.0);
    tick(&mut meter, &at(204, Mode::Trapezoidal, -32.0));
    assert_eq!(so_far(&meter).overshoot_counts, Some(2.0));
    // The same E again is no new move, on whichever side the rotor is.
    meter.command(&Command::End(-30), true, &at(204, Mode::Trapezoidal, -32.0), -32.0);
    tick(&mut meter, &at(205, Mode::Trapezoidal, -31.0));
    assert_eq!(so_far(&meter).overshoot_counts, Some(2.0));
}

#[test]
fn final_error_is_taken_200_ms_after_the_end() {
    let mut meter = begun();
    meter.command(&Command::Move(10), true, &at(0, Mode::Idle, 0.0), 0.0);
    tick(&mut meter, &at(1, Mode::Trapezoidal, 10.0));
    ended(&mut meter, &at(2, Mode::Idle, 10.0), EndReason::Arrived);
    for ms in 3..=400 {
        assert_eq!(so_far(&meter).final_error_counts, (ms > 202).then_some(0.25), "before {ms} ms");
        let counts = if ms == 202 { 10.25 } else { 11.0 };
        tick(&mut meter, &at(ms, Mode::Idle, counts));
    }
}

#[test]
fn tracking_uses_true_rotor_and_positioned_moves_only() {
    let mut meter = begun();
    meter.command(&Command::Move(10), true, &at(0, Mode::Idle, 0.0), 0.0);
    for (ms, lag) in [(1, 3.0), (2, -4.0)] {
        let mut sample = at(ms, Mode::Trapezoidal, 5.0);
        sample.truth.counts = 5.0 - lag;
        tick(&mut meter, &sample);
    }
    assert_eq!(so_far(&meter).tracking_rms_counts, Some((25.0f64 / 2.0).sqrt()));

    let mut meter = begun();
    tick(&mut meter, &at(1, Mode::Velocity, 5.0));
    assert_eq!(so_far(&meter).tracking_rms_counts, None);
}

#[test]
fn hold_error_keeps_its_maximum() {
    let mut meter = begun();
    for (ms, off) in [(1, 0.5), (2, 3.0), (3, 0.25)] {
        let mut sample = at(ms, Mode::Pid, 20.0);
        sample.truth.counts += off;
        tick(&mut meter, &sample);
    }
    let metrics = meter.finish(&at(3, Mode::Pid, 20.0));
    assert_eq!((metrics.hold_error_counts, metrics.peak_hold_error_counts), (Some(0.25), Some(3.0)));
}

#[test]
fn lost_count_is_an_error_and_renamed_position_is_not() {
    let mut lost = at(5, Mode::Idle, 20.0);
    lost.truth.counts = 21.0;
    assert_eq!(begun().finish(&lost).count_error_counts, 1.0);

    let mut meter = begun();
    meter.command(&Command::Position(3), true, &at(0, Mode::Idle, 20.0), 3.0);
    assert_eq!(meter.zero_counts(), 17.0);
    let mut renamed = at(5, Mode::Idle, 3.0);
    renamed.truth.counts = 20.25;
    assert_eq!(meter.finish(&renamed).count_error_counts, 0.25);
}

#[test]
fn refused_command_changes_nothing_else() {
    let mut meter = begun();
    meter.command(&Command::Move(10), false, &at(0, Mode::Idle, 0.0), 0.0);
    let metrics = meter.finish(&at(0, Mode::Idle, 0.0));
    assert_eq!((metrics.refusals, metrics.overshoot_counts), (1, None));
}

#[test]
fn worst_takes_the_worse_of_each_figure() {
    let a = Metrics {
        end_reason: Some(EndReason::Arrived),
        end_ms: Some(5.0),
        overshoot_counts: None,
        position_counts: -3.0,
        homed: true,
        ..Metrics::default()
    };
    let b = Metrics {
        end_reason: Some(EndReason::Stalled),
        end_ms: Some(4.0),
        overshoot_counts: Some(1.0),
        position_counts: 2.0,
        ..Metrics::default()
    };
    let worst = a.worst(b);
    assert_eq!((worst.end_reason, worst.end_ms, worst.overshoot_counts), (None, Some(5.0), Some(1.0)));
    assert_eq!((worst.position_counts, worst.homed), (-3.0, false));
}

#[test]
fn metric_names_are_unique_and_found() {
    for (index, metric) in METRICS.iter().enumerate() {
        let first = METRICS.iter().position(|other| other.name == metric.name);
        assert_eq!(first, Some(index), "{} is there twice", metric.name);
        assert!(
            matches!((metric.get)(&Metrics::default()), Value::Text(_)) == metric.is_word(),
            "{}",
            metric.name
        );
    }
}

#[test]
fn every_text_value_can_be_expected() {
    let of = |name: &str, metrics: &Metrics| {
        let metric = find(name).expect("a metric");
        let Value::Text(text) = (metric.get)(metrics) else { panic!("{name} is a word") };
        assert!(metric.can_be(&text), "{name} = {text}");
    };
    for mode in Mode::ALL {
        of("mode", &Metrics { mode, ..Metrics::default() });
    }
    for faults in [vec![], vec![Fault::Halls], vec![Fault::Bridge, Fault::OverVoltage]] {
        of("faults", &Metrics { faults, ..Metrics::default() });
    }
    of("end_reason", &Metrics::default());
    for (name, text) in
        [("faults", "none, halls"), ("faults", "halls,bridge"), ("mode", "none"), ("mode", "")]
    {
        assert!(!find(name).expect("a metric").can_be(text), "{name} = {text}");
    }
}

fn close_to(found: Option<f64>, expected: f64) {
    let found = found.expect("a value");
    assert!((found - expected).abs() < 1e-9, "found {found}, expected {expected}");
}

/// Ten counts in ten ticks, then at rest.
#[test]
fn step_has_settling_rise_and_integrals() {
    let mut meter = begun();
    meter.command(&Command::Move(10), true, &at(0, Mode::Idle, 0.0), 0.0);
    (1..=20).for_each(|ms| tick(&mut meter, &at(ms, Mode::Trapezoidal, f64::from(ms.min(10)))));
    let metrics = meter.finish(&at(20, Mode::Trapezoidal, 10.0));
    assert_eq!((metrics.settling_ms, metrics.rise_ms), (Some(8.0), Some(8.0)));
    close_to(metrics.iae, 0.045);
    close_to(metrics.itae, 120e-6);
}

/// As the step above, in parts.
#[test]
fn window_follows_the_move_from_its_beginning() {
    let within = |from_ms, to_ms| {
        let mut meter = begun().within(Window { from_ms, to_ms });
        meter.command(&Command::Move(10), true, &at(0, Mode::Idle, 0.0), 0.0);
        (1..=20).for_each(|ms| tick(&mut meter, &at(ms, Mode::Trapezoidal, f64::from(ms.min(10)))));
        ended(&mut meter, &at(21, Mode::Pid, 10.0), EndReason::Arrived);
        meter.finish(&at(21, Mode::Pid, 10.0))
    };
    let late = within(15, u32::MAX);
    assert_eq!(
        (late.settling_ms, late.rise_ms, late.end_ms, late.ends),
        (Some(8.0), Some(8.0), Some(20.0), 1)
    );
    close_to(late.iae, 0.0);
    let early = within(0, 12);
    assert_eq!((early.settling_ms, early.rise_ms, early.end_ms, early.ends), (Some(8.0), Some(8.0), None, 0));
    let middle = within(0, 5);
    assert_eq!((middle.settling_ms, middle.rise_ms), (None, None));
}

#[test]
fn replan_measures_from_the_change() {
    let mut meter = begun();
    meter.command(&Command::Move(50), true, &at(0, Mode::Idle, 0.0), 0.0);
    let moving = |ms: u32| at(ms, Mode::Trapezoidal, f64::from(ms.min(20)));
    (1..=10).for_each(|ms| tick(&mut meter, &moving(ms)));
    meter.command(&Command::End(20), true, &moving(10), 10.0);
    (11..=30).for_each(|ms| tick(&mut meter, &moving(ms)));
    let metrics = meter.finish(&moving(30));
    assert_eq!((metrics.settling_ms, metrics.rise_ms), (Some(9.0), Some(8.0)));
    close_to(metrics.iae, 0.045);
}

#[test]
fn rotor_beyond_a_count_has_not_settled() {
    let mut meter = begun();
    meter.command(&Command::Move(10), true, &at(0, Mode::Idle, 0.0), 0.0);
    (1..=20).for_each(|ms| tick(&mut meter, &at(ms, Mode::Trapezoidal, 10.0 + f64::from(ms % 2) * 1.5)));
    let metrics = meter.clone().finish(&at(20, Mode::Trapezoidal, 10.0));
    assert_eq!(metrics.settling_ms, Some(19.0), "the last tick is inside");
    assert_eq!(meter.finish(&at(20, Mode::Trapezoidal, 11.5)).settling_ms, None);
}

fn turning(ms: u32, set_point: i16, velocity: f64) -> Sample {
    let mut sample = at(ms, Mode::Velocity, 0.0);
    sample.status.setpoint_velocity = CountsPerSec::from_int(set_point);
    sample.truth.counts_per_s = velocity;
    sample
}

#[test]
fn ripple_is_about_the_mean_of_each_constant_set_point() {
    let mut meter = begun();
    let mut ms = 0;
    for (set_point, mean, ripple) in [(50, 48.0, 3.0), (100, 97.0, 1.0), (0, 0.0, 9.0)] {
        // The first hundred ticks of a set-point do not count.
        for tick_of in 0..300 {
            ms += 1;
            let early = if tick_of < 100 { 1000.0 } else { 0.0 };
            let sign = if tick_of % 2 == 0 { 1.0 } else { -1.0 };
            tick(&mut meter, &turning(ms, set_point, mean + sign * ripple + early));
        }
    }
    let metrics = so_far(&meter);
    close_to(metrics.ripple_counts_s, f64::sqrt((9.0 + 1.0) / 2.0));
    close_to(metrics.mean_velocity_counts_s, (48.0 + 97.0) / 2.0);
    assert_eq!(so_far(&begun()).ripple_counts_s, None);
}

#[test]
fn chatter_is_the_change_of_torque_while_driven() {
    let mut meter = begun();
    for ms in 1..=11 {
        let mut sample = at(ms, Mode::Pid, 0.0);
        sample.status.torque = Torque(if ms % 2 == 0 { 10 } else { 0 });
        tick(&mut meter, &sample);
    }
    close_to(so_far(&meter).chatter, 10.0);
    assert_eq!(so_far(&begun()).chatter, None);
}

#[test]
fn speed_at_the_end_is_that_of_the_tick_before() {
    let mut meter = begun();
    meter.command(&Command::Move(2), true, &at(0, Mode::Idle, 0.0), 0.0);
    for (ms, speed) in [(1, 500.0), (2, -7.0)] {
        let mut sample = at(ms, Mode::Trapezoidal, 1.0);
        sample.truth.counts_per_s = speed;
        tick(&mut meter, &sample);
    }
    ended(&mut meter, &at(3, Mode::Idle, 2.0), EndReason::Arrived);
    assert_eq!(so_far(&meter).speed_at_end_counts_s, Some(7.0));
}

#[test]
fn window_measures_its_ticks_only() {
    let window = Window { from_ms: 3, to_ms: 4 };
    let mut meters = Meters::new(&at(0, Mode::Idle, 0.0), &[window]);
    meters.command(&Command::Move(10), true, &at(0, Mode::Idle, 0.0), 0.0);
    for ms in 1..=9 {
        let mut sample = at(ms, Mode::Trapezoidal, f64::from(ms));
        sample.truth.ledger.copper_j = f64::from(ms);
        meters.tick(&sample, std::iter::empty());
    }
    let (whole, windows) = meters.finish(&at(9, Mode::Trapezoidal, 9.0));
    let (of, within) = &windows[0];
    assert_eq!((*of, within.position_counts, within.heat_j), (window, 4.0, 1.0));
    close_to(within.iae, 0.013);
    assert_eq!((whole.position_counts, whole.iae.is_some()), (9.0, true));
}

#[test]
fn each_metric_is_defined_in_the_document() {
    let page = include_str!("../../../../docs/metrics.md");
    for metric in &METRICS {
        assert!(page.contains(&format!("`{}`", metric.name)), "docs/metrics.md lacks {}", metric.name);
    }
}
