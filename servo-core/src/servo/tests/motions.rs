//! What each motion means for mode, guards and limits, by tables over all motions.

use super::*;
use crate::guard::fault::LimitCause;

fn at(position: i32) -> PositionLoop {
    PositionLoop::at_rest(Counts::from_int(position), PidState::default())
}

fn moving(position: i32, velocity: i16) -> PositionLoop {
    let velocity = CountsPerSec::from_int(velocity);
    PositionLoop { setpoint: SetPoint { velocity, ..at(position).setpoint }, pid: PidState::default() }
}

fn to_end(control: PositionLoop) -> Motion {
    let profile = Profile::at_rest(control.setpoint.position);
    Motion::Move { control, profile, breakaway: Breakaway::default(), arrival: Arrival::default() }
}

fn to_zero(control: PositionLoop) -> Motion {
    let profile = Profile::at_rest(control.setpoint.position);
    Motion::Zero { control, profile, arrival: Arrival::default() }
}

const fn starting(goal: Goal) -> Motion {
    Motion::Starting { goal, brake_ms: 0 }
}

const fn home(stage: Homing) -> Motion {
    Motion::Home { stage, way: 0 }
}

struct Row {
    motion: Motion,
    mode: Mode,
    /// A host waits for its end.
    awaited: bool,
    /// A host closes its loop.
    needs_host: bool,
}

fn rows() -> [Row; 21] {
    let pid = PidState::default();
    let of = |motion, mode, awaited, needs_host| Row { motion, mode, awaited, needs_host };
    [
        of(Motion::Idle, Mode::Idle, false, false),
        of(starting(Goal::Torque(Torque(5))), Mode::Torque, false, true),
        of(starting(Goal::Position { at: None, pid }), Mode::Pid, false, false),
        of(starting(Goal::Velocity), Mode::Velocity, false, true),
        of(starting(Goal::TorqueControlled { closing: true }), Mode::Velocity, true, false),
        of(starting(Goal::Move { pid }), Mode::Trapezoidal, true, false),
        of(starting(Goal::Find), Mode::Trapezoidal, true, false),
        of(starting(Goal::SeekStop), Mode::Velocity, true, false),
        of(starting(Goal::Zero), Mode::Trapezoidal, true, false),
        of(Motion::Torque(Torque(5)), Mode::Torque, false, true),
        of(Motion::Position(at(0)), Mode::Pid, false, false),
        of(Motion::Velocity, Mode::Velocity, false, true),
        of(Motion::TorqueControlled { closing: false }, Mode::Velocity, true, false),
        of(Motion::Pressing { closing: true }, Mode::Velocity, false, false),
        of(to_end(at(0)), Mode::Trapezoidal, true, false),
        of(Motion::Field(Torque(5)), Mode::Trapezoidal, true, false),
        of(home(Homing::Seek), Mode::Velocity, true, false),
        of(home(Homing::Leave { closing: true }), Mode::Velocity, true, false),
        of(home(Homing::Return { closing: true }), Mode::Velocity, true, false),
        of(to_zero(at(0)), Mode::Trapezoidal, true, false),
        of(to_zero(moving(0, 5)), Mode::Trapezoidal, true, false),
    ]
}

#[test]
fn motion_has_the_mode_and_the_host_that_it_needs() {
    for Row { motion, mode, awaited, needs_host } in rows() {
        assert_eq!(
            (motion.mode(), motion.is_awaited(), motion.needs_host()),
            (mode, awaited, needs_host),
            "{motion:?}"
        );
        let has_loop = matches!(motion, Motion::Position(_) | Motion::Move { .. } | Motion::Zero { .. });
        assert_eq!(motion.position_loop().is_some(), has_loop, "{motion:?}");
        let mut bench = Bench::new(Joint::Spread);
        bench.servo.motion = motion;
        let finding = matches!(motion, Motion::Field(_) | Motion::Starting { goal: Goal::Find, .. });
        assert_eq!(bench.servo.is_finding(), finding, "{motion:?}");
        assert_eq!(bench.servo.has_field(), matches!(motion, Motion::Field(_)), "{motion:?}");
    }
}

/// TSTOP of HI is 250 ms at least, of everything else as it is set.
#[test]
fn stall_time_of_homing_has_a_floor() {
    for Row { motion, .. } in rows() {
        let homes = matches!(
            motion,
            Motion::Home { .. }
                | Motion::Zero { .. }
                | Motion::Starting { goal: Goal::SeekStop | Goal::Zero, .. }
        );
        for tstop in [0, 249, 251] {
            let mut bench = Bench::new(Joint::Spread);
            bench.servo.tuning.config.tstop = tstop;
            bench.servo.motion = motion;
            assert_eq!(bench.servo.tstop(), if homes { tstop.max(250) } else { tstop }, "{motion:?}");
        }
    }
}

/// The direction in which a missing count is a stall.
#[test]
fn motor_is_driven_where_its_motion_pushes() {
    let driven = |motion, config: fn(Config) -> Config| {
        let mut bench = Bench::new(Joint::Spread);
        bench.servo.tuning.config = config(bench.servo.tuning.config);
        bench.servo.motion = motion;
        bench.servo.end = 7;
        bench.servo.drives()
    };
    let same: fn(Config) -> Config = |config| config;
    let opens: fn(Config) -> Config = |config| Config { ivel: 5, ..config };
    let delta = Counts(fixed::types::I22F10::DELTA);
    let short = PositionLoop::at_rest(Counts::from_int(1).wrapping_sub(delta), PidState::default());
    for (motion, expected) in [
        (Motion::Idle, None),
        (starting(Goal::Velocity), None),
        (Motion::Field(Torque(5)), None),
        (Motion::Torque(Torque(5)), Some(true)),
        (Motion::Torque(Torque(-5)), Some(false)),
        (Motion::Torque(Torque(0)), None),
        (Motion::TorqueControlled { closing: true }, Some(true)),
        (Motion::Pressing { closing: false }, Some(false)),
        (Motion::Velocity, None),
        // A set-point a whole count ahead.
        (Motion::Position(short), None),
        (Motion::Position(at(1)), Some(true)),
        (Motion::Position(at(2)), Some(true)),
        (Motion::Position(at(-2)), Some(false)),
        (to_end(at(2)), Some(true)),
        (to_zero(at(-2)), Some(false)),
        // IVEL of a spread is −200.
        (home(Homing::Seek), Some(false)),
        (home(Homing::Leave { closing: false }), Some(true)),
        (home(Homing::Return { closing: false }), Some(false)),
        (home(Homing::Leave { closing: true }), Some(false)),
        (home(Homing::Return { closing: true }), Some(true)),
    ] {
        assert_eq!(driven(motion, same), expected, "{motion:?}");
    }
    assert_eq!(driven(home(Homing::Seek), opens), Some(true));
    assert_eq!(driven(home(Homing::Leave { closing: true }), opens), Some(false));
    // ACCEL 0 moves no set-point: by where the motion leads.
    let stuck: fn(Config) -> Config = |config| Config { accel: 0, ioff: 3, ..config };
    let stuck_back: fn(Config) -> Config = |config| Config { accel: 0, ioff: -3, ..config };
    let stuck_here: fn(Config) -> Config = |config| Config { accel: 0, ioff: 0, ..config };
    assert_eq!(driven(to_end(at(0)), stuck), Some(true), "E is 7");
    assert_eq!(driven(to_zero(at(0)), stuck), Some(true));
    assert_eq!(driven(to_zero(at(0)), stuck_back), Some(false));
    assert_eq!(driven(to_zero(at(0)), stuck_here), Some(false));
}

/// The profile waits beyond six counts of lag, in the direction of its motion.
#[test]
fn set_point_waits_from_more_than_six_counts_of_lag() {
    let delta = Counts(fixed::types::I22F10::DELTA);
    let six = Counts::from_int(6);
    for (control, lag, waits) in [
        (moving(0, 5), six, false),
        (moving(0, 5), six.wrapping_add(delta), true),
        (moving(0, 5), six.wrapping_add(six).wrapping_neg(), false),
        (at(0), six, false),
        (at(0), six.wrapping_add(delta), true),
        (moving(0, -5), six.wrapping_neg(), false),
        (moving(0, -5), six.wrapping_add(delta).wrapping_neg(), true),
        (moving(0, -5), six.wrapping_add(six), false),
    ] {
        assert_eq!(control.lag(lag.wrapping_neg()), lag);
        assert_eq!(control.must_wait(lag.wrapping_neg()), waits, "{lag:?}");
    }
}

/// In the cell of a resting set-point there is no position error.
#[test]
fn errors_are_those_of_set_point_and_rotor() {
    let half = Counts(fixed::types::I22F10::ONE / 2);
    let speed = CountsPerSec::from_int(30);
    let (error, velocity_error) = at(3).errors(Counts::from_int(1), speed);
    assert_eq!((error, velocity_error), (Law::from_num(2), Law::from_num(-30)));
    let near = Counts::from_int(3).wrapping_sub(Counts(fixed::types::I22F10::ONE / 4));
    assert_eq!(at(3).errors(near, CountsPerSec::ZERO).0, Law::ZERO, "in its cell");
    assert_eq!(moving(3, 5).errors(near, CountsPerSec::ZERO), (Law::ONE / 4, Law::from_num(5)));
    assert_eq!(
        at(3).errors(Counts::from_int(2).wrapping_add(half.wrapping_neg()), speed).0,
        Law::ONE * 3 / 2
    );
}

/// Pressing: limited by something, and by more than friction.
#[test]
fn motor_presses_at_a_limit_with_more_than_friction() {
    for (torque, limit, presses) in [
        (63, Some(LimitCause::Torque), true),
        (-63, Some(LimitCause::Current), true),
        (62, Some(LimitCause::Torque), false),
        (-62, Some(LimitCause::Torque), false),
        (500, None, false),
    ] {
        let mut bench = Bench::new(Joint::Spread);
        bench.servo.applied = AppliedTorque { torque: Torque(torque), limit, ..AppliedTorque::OFF };
        assert_eq!(bench.servo.presses(), presses, "{torque} {limit:?}");
    }
}

/// IHIT bounds the way to the stop; leaving it, MT does.
#[test]
fn homing_seeks_with_ihit_and_leaves_with_mt() {
    for (motion, most) in [
        (home(Homing::Seek), 250),
        (home(Homing::Return { closing: true }), 250),
        (home(Homing::Leave { closing: true }), 750),
        (Motion::Velocity, 750),
        (to_zero(at(0)), 750),
    ] {
        let mut bench = Bench::new(Joint::Spread);
        bench.servo.motion = motion;
        assert_eq!(bench.servo.torque_ceiling(), Torque(most), "{motion:?}");
    }
    for (ihit, mt, ivel, can) in [
        (63, 63, 1, true),
        (62, 750, 1, false),
        (750, 62, 1, false),
        (750, 750, 0, false),
        (750, 750, -1, true),
    ] {
        let config = Config { ihit, mt, ivel, ..Joint::Spread.config() };
        assert_eq!(Tuning::new(config, Torque(990)).can_home(), can, "{ihit} {mt} {ivel}");
    }
}

#[test]
fn velocity_goal_is_that_of_the_motion() {
    for (motion, goal) in [
        (Motion::Idle, 0),
        (Motion::Torque(Torque(5)), 0),
        (Motion::Field(Torque(5)), 0),
        (Motion::Velocity, 33),
        (starting(Goal::Velocity), 33),
        (starting(Goal::Zero), 0),
        (Motion::TorqueControlled { closing: true }, 900),
        (Motion::Pressing { closing: false }, -800),
        (starting(Goal::TorqueControlled { closing: false }), -800),
        (home(Homing::Seek), -200),
        (starting(Goal::SeekStop), -200),
        (home(Homing::Leave { closing: false }), 200),
        (Motion::Position(moving(0, 44)), 44),
        (to_end(moving(0, -44)), -44),
        (to_zero(moving(0, 44)), 44),
    ] {
        let mut bench = Bench::new(Joint::Spread);
        bench.servo.tuning.config.mcv = 900;
        bench.servo.tuning.config.mov = 800;
        bench.servo.velocity_wanted = CountsPerSec::from_int(33);
        bench.servo.motion = motion;
        assert_eq!(bench.servo.velocity_goal(), CountsPerSec::from_int(goal), "{motion:?}");
    }
}

/// T reads as commanded in mode 2 while no limit acts, else as applied.
#[test]
fn torque_reads_as_commanded_in_mode_2_unless_limited() {
    for (motion, limit, torque) in [
        (Motion::Torque(Torque(400)), None, 400),
        (starting(Goal::Torque(Torque(400))), None, 400),
        (Motion::Torque(Torque(400)), Some(LimitCause::Torque), 77),
        (starting(Goal::Torque(Torque(400))), Some(LimitCause::Supply), 77),
        (Motion::Velocity, None, 77),
        (Motion::Idle, None, 77),
    ] {
        let mut bench = Bench::new(Joint::Spread);
        bench.servo.motion = motion;
        bench.servo.applied = AppliedTorque { torque: Torque(77), limit, ..AppliedTorque::OFF };
        assert_eq!(bench.servo.torque(), Torque(torque), "{motion:?} {limit:?}");
    }
}

/// Without a known direction of closing the motor may be right in itself and yet the mirror image.
#[test]
fn direction_is_trusted_only_with_a_known_wiring() {
    for wired in [true, false] {
        let mut bench = Bench::new(Joint::Spread);
        bench.servo.set_wired(wired);
        bench.servo.command(Command::Mode(Mode::Torque)).unwrap();
        bench.servo.command(Command::Torque(Torque(300))).unwrap();
        assert!((0..500).any(|_| bench.tick().duty.is_some_and(|duty| duty.0 > 0)), "the brake releases");
        for count in 1..=30 {
            bench.tick_to(count);
            // Slowly: at speed its own voltage would brake it.
            (0..20).for_each(|_| _ = bench.tick());
        }
        assert_eq!(bench.servo.direction.is_right(), wired);
        assert_eq!(bench.servo.tuning.most == Torque(750), wired, "{:?}", bench.servo.tuning.most);
        assert_eq!(bench.servo.telemetry().fault, None);
    }
}

#[test]
fn field_is_set_in_find_alone_and_its_end_is_reported_once() {
    for (found, reason) in [(true, EndReason::Arrived), (false, EndReason::Aborted)] {
        for motion in [Motion::Field(Torque(5)), starting(Goal::Find), Motion::Velocity] {
            let mut bench = Bench::new(Joint::Spread);
            bench.servo.motion = motion;
            bench.servo.set_field(Torque(9));
            let is_field = matches!(bench.servo.motion, Motion::Field(Torque(9)));
            assert_eq!(is_field, matches!(motion, Motion::Field(_)), "{motion:?}");
            bench.servo.end_field(found);
            let ends = !matches!(motion, Motion::Velocity);
            let expected = ends.then_some(Event::Ended { reason, mode: Mode::Idle });
            assert_eq!((bench.servo.event(), bench.servo.event()), (expected, None), "{motion:?}");
            assert_eq!(bench.servo.telemetry().end, ends.then_some(reason), "{motion:?}");
            assert_eq!(bench.servo.telemetry().mode, if ends { Mode::Idle } else { Mode::Velocity });
        }
    }
}

#[test]
fn oldest_event_makes_room_for_the_ninth() {
    let mut bench = Bench::new(Joint::Spread);
    assert!(!bench.servo.has_event());
    for position in 0..9 {
        bench.servo.report(Event::Breakaway { position, stop_tip: false });
        assert!(bench.servo.has_event());
    }
    for position in 1..9 {
        assert_eq!(bench.servo.event(), Some(Event::Breakaway { position, stop_tip: false }));
    }
    assert!(bench.servo.event().is_none() && !bench.servo.has_event());
}
