//! What each motion means for mode, guards and limits, by tables over all motions.

use super::*;
use crate::guard::fault::LimitCause;

fn at(position: i32) -> PositionLoop {
    PositionLoop::at_rest(Counts::from_int(position), PidState::default())
}

fn moving(position: i32, velocity: i16) -> PositionLoop {
    let velocity = CountsPerSec::from_int(velocity);
    let control = at(position);
    PositionLoop { setpoint: SetPoint { velocity, ..control.setpoint }, ..control }
}

/// An integral of about 300 units.
fn loaded() -> PidState {
    let mut pid = PidState::default();
    let integrating = Gains { kp: Law::ZERO, kd: Law::ZERO, kpv: Law::ZERO }.build(30_000);
    let errors = Errors {
        stage: Stage::Move,
        position: Law::from_num(10),
        velocity: Law::ZERO,
        emf: Law::ZERO,
        feed: Law::ZERO,
    };
    let torque = integrating.step(&mut pid, &errors, (Law::from_num(-750), Law::from_num(750)));
    assert_eq!(torque, Torque(300));
    pid
}

fn to_end(control: PositionLoop) -> Motion {
    Motion::Move { control, breakaway: Breakaway::default(), arrival: Arrival::of(false), holds: false }
}

fn to_zero(control: PositionLoop) -> Motion {
    Motion::Zero { control, arrival: Arrival::of(false) }
}

const fn held(control: PositionLoop) -> Motion {
    Motion::Position { control, to: None }
}

/// A bench whose motion waits for its brake, energized for so long.
fn starting(motion: Motion, brake_ms: u16) -> Bench {
    let mut bench = with(motion);
    bench.servo.releasing = Some(brake_ms);
    bench
}

const fn home(stage: Homing) -> Motion {
    Motion::Home { stage, way: 0 }
}

/// Torque of a motion at a velocity, below this ceiling.
fn velocity_torque(bench: &Bench, most: Torque) -> Torque {
    match bench.servo.demand().law {
        Wanted::Velocity(goal, presses) => bench.servo.velocity_torque(goal, presses, most),
        other => panic!("{other:?}"),
    }
}

type Change = fn(Config) -> Config;

struct Row {
    motion: Motion,
    mode: Mode,
    /// A host waits for its end.
    awaited: bool,
    /// A host closes its loop.
    needs_host: bool,
}

fn rows() -> [Row; 13] {
    let of = |motion, mode, awaited, needs_host| Row { motion, mode, awaited, needs_host };
    [
        of(Motion::Idle, Mode::Idle, false, false),
        of(Motion::Torque(Torque(5)), Mode::Torque, false, true),
        of(held(at(0)), Mode::Pid, false, false),
        of(Motion::Velocity, Mode::Velocity, false, true),
        of(Motion::TorqueControlled { way: Way::Opening }, Mode::Velocity, true, false),
        of(Motion::Pressing { way: Way::Closing }, Mode::Velocity, false, false),
        of(to_end(at(0)), Mode::Trapezoidal, true, false),
        of(Motion::Field(Torque(5)), Mode::Trapezoidal, true, false),
        of(home(Homing::Seek), Mode::Velocity, true, false),
        of(home(Homing::Leave { stop: Way::Closing }), Mode::Velocity, true, false),
        of(home(Homing::Return { stop: Way::Closing }), Mode::Velocity, true, false),
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
        let has_loop = matches!(motion, Motion::Position { .. } | Motion::Move { .. } | Motion::Zero { .. });
        assert_eq!(motion.position_loop().is_some(), has_loop, "{motion:?}");
        let finding = matches!(motion, Motion::Field(_));
        let (bench, waiting) = (with(motion), starting(motion, 0));
        assert_eq!((bench.servo.is_finding(), waiting.servo.is_finding()), (finding, finding), "{motion:?}");
        assert_eq!((bench.servo.has_field(), waiting.servo.has_field()), (finding, false), "{motion:?}");
    }
}

/// TSTOP of HI is 250 ms at least, of everything else as it is set.
#[test]
fn stall_time_of_homing_has_a_floor() {
    for Row { motion, .. } in rows() {
        let homes = matches!(motion, Motion::Home { .. } | Motion::Zero { .. });
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
        bench.servo.drives(bench.servo.demand().pushes, bench.servo.tstop())
    };
    let same: fn(Config) -> Config = |config| config;
    let opens: fn(Config) -> Config = |config| Config { ivel: 5, ..config };
    let delta = Counts(fixed::types::I22F10::DELTA);
    let short = PositionLoop::at_rest(Counts::from_int(1).wrapping_sub(delta), PidState::default());
    for (motion, expected) in [
        (Motion::Idle, None),
        (Motion::Field(Torque(5)), None),
        (Motion::Torque(Torque(5)), Some(Way::Closing)),
        (Motion::Torque(Torque(-5)), Some(Way::Opening)),
        (Motion::Torque(Torque(0)), None),
        (Motion::TorqueControlled { way: Way::Closing }, Some(Way::Closing)),
        (Motion::Pressing { way: Way::Opening }, Some(Way::Opening)),
        (Motion::Velocity, None),
        // A set-point a whole count ahead.
        (held(short), None),
        (held(at(1)), Some(Way::Closing)),
        (held(at(2)), Some(Way::Closing)),
        (held(at(-2)), Some(Way::Opening)),
        (to_end(at(2)), Some(Way::Closing)),
        (to_zero(at(-2)), Some(Way::Opening)),
        // IVEL of a spread is −200.
        (home(Homing::Seek), Some(Way::Opening)),
        (home(Homing::Leave { stop: Way::Opening }), Some(Way::Closing)),
        (home(Homing::Return { stop: Way::Opening }), Some(Way::Opening)),
        (home(Homing::Leave { stop: Way::Closing }), Some(Way::Opening)),
        (home(Homing::Return { stop: Way::Closing }), Some(Way::Closing)),
    ] {
        assert_eq!(driven(motion, same), expected, "{motion:?}");
    }
    assert_eq!(driven(home(Homing::Seek), opens), Some(Way::Closing));
    assert_eq!(driven(home(Homing::Leave { stop: Way::Closing }), opens), Some(Way::Opening));
    // ACCEL 0 moves no set-point: by where the motion leads.
    let stuck: fn(Config) -> Config = |config| Config { accel: 0, ioff: 3, ..config };
    let stuck_back: fn(Config) -> Config = |config| Config { accel: 0, ioff: -3, ..config };
    let stuck_here: fn(Config) -> Config = |config| Config { accel: 0, ioff: 0, ..config };
    assert_eq!(driven(to_end(at(0)), stuck), Some(Way::Closing), "E is 7");
    assert_eq!(driven(to_zero(at(0)), stuck), Some(Way::Closing));
    assert_eq!(driven(to_zero(at(0)), stuck_back), Some(Way::Opening));
    assert_eq!(driven(to_zero(at(0)), stuck_here), Some(Way::Opening));
}

/// The profile waits beyond six counts of lag towards its end.
#[test]
fn set_point_waits_from_more_than_six_counts_of_lag() {
    let delta = Counts(fixed::types::I22F10::DELTA);
    let six = Counts::from_int(6);
    let beyond = six.wrapping_add(delta);
    for (control, end, lag, waits) in [
        (moving(0, 5), 1, six, false),
        (moving(0, 5), 1, beyond, true),
        (moving(0, 5), 1, beyond.wrapping_neg(), false),
        (moving(0, -5), -1, six.wrapping_neg(), false),
        (moving(0, -5), -1, beyond.wrapping_neg(), true),
        (moving(0, -5), -1, beyond, false),
        // On its way back from an obstacle, and at rest.
        (moving(0, 5), -1, beyond, false),
        (moving(0, -5), 1, beyond.wrapping_neg(), false),
        (at(0), 0, beyond, false),
        (at(0), 0, beyond.wrapping_neg(), false),
        (at(0), 1, beyond, true),
        (at(0), -1, beyond.wrapping_neg(), true),
    ] {
        assert_eq!(control.lag(lag.wrapping_neg()), lag);
        let mut control = control;
        control.profile.set_end(Counts::from_int(end));
        assert_eq!(control.must_wait(lag.wrapping_neg()), waits, "{lag:?}");
    }
}

/// A set-point that waits at an obstacle does not have to get past it first.
#[test]
fn new_end_leads_away_from_an_obstacle() {
    for (blocked, end) in [(100, -20), (-100, 20)] {
        let mut bench = Bench::new(Joint::Spread);
        bench.servo.tuning.config.tstop = 0;
        bench.servo.command(Command::Move(blocked)).unwrap();
        (0..2000).for_each(|_| _ = bench.tick());
        let ahead = |bench: &Bench| bench.servo.telemetry().setpoint.round() * blocked.signum();
        assert!((6..=8).contains(&ahead(&bench)), "{}", ahead(&bench));
        bench.servo.command(Command::End(end)).unwrap();
        (0..2000).for_each(|_| _ = bench.tick());
        assert!((-8..=-6).contains(&ahead(&bench)), "{}", ahead(&bench));
    }
}

/// Writing the same E again does not re-plan.
#[test]
fn same_end_goes_on_with_its_profile() {
    let mut bench = Bench::new(Joint::Spread);
    bench.servo.command(Command::Move(100)).unwrap();
    bench.follow(200);
    let ticks = |bench: &Bench| match &bench.servo.motion {
        Motion::Move { control, .. } => control.profile.ticks(),
        _ => 0,
    };
    let before = ticks(&bench);
    bench.servo.command(Command::End(100)).unwrap();
    assert!(before > 0 && ticks(&bench) == before, "{before}");
    bench.servo.command(Command::End(99)).unwrap();
    assert_eq!(ticks(&bench), 0);
}

/// A hold that drives may just have been pushed away from its end, whatever its rotor does at this instant.
#[test]
fn move_without_a_way_ends_at_once_unless_the_motor_is_driven() {
    // At rest in its cell for twelve ticks, by the model alone.
    for (torque, most, least) in [(0, 12, 0), (20, 40, 20)] {
        let mut bench = Bench::new(Joint::Spread);
        bench.servo.command(Command::Mode(Mode::Pid)).unwrap();
        (0..400).for_each(|_| _ = bench.tick());
        bench.servo.applied.torque = Torque(torque);
        bench.servo.motion = to_end(at(0));
        bench.servo.releasing = Some(bench.servo.tuning.config.brake_ms);
        let ended = (0..200).find(|_| {
            bench.tick();
            bench.servo.telemetry().end.is_some()
        });
        assert!(ended.is_some_and(|ms| (least..=most).contains(&ms)), "{torque}: {ended:?}");
    }
}

/// Only an arrival leaves an integral that is still to be carried.
#[test]
fn hold_after_an_arrival_alone_keeps_the_integral() {
    for reason in [EndReason::Arrived, EndReason::Stalled, EndReason::Strain, EndReason::Breakaway] {
        let mut bench = Bench::new(Joint::Spread);
        bench.servo.motion = to_end(PositionLoop { pid: loaded(), ..at(0) });
        bench.servo.hold(reason);
        let Motion::Position { control, .. } = bench.servo.motion else { panic!("{:?}", bench.servo.motion) };
        let expected = if reason == EndReason::Arrived { loaded() } else { PidState::default() };
        assert_eq!(control.pid, expected, "{reason:?}");
    }
}

/// Torque of the position law for a rotor at rest in the center of cell 1, whose velocity is read as `velocity`.
fn torque_of(control: PositionLoop, velocity: i16, config: Change) -> i16 {
    let mut servo = Servo::new(config(Joint::Spread.config()), 1);
    servo.motion = held(control);
    servo.position = Counts::from_int(1);
    servo.velocity = CountsPerSec::from_int(velocity);
    let envelope = servo.limiter.envelope(
        &servo.tuning.figures.scale,
        (Torque(750), Torque(990)),
        0,
        MilliVolts(24_000),
        &LastTick::OFF,
    );
    servo.position_torque(&envelope).0
}

/// KP 120 and KD 640 are 120 a count and 2.5 a count/s; MKE 3971 is 0.9695 a count/s. A rotor that sticks needs MFS and 2 more, 65.
#[test]
fn position_torque_is_of_the_errors_and_of_what_the_motion_takes() {
    let same: Change = |config| config;
    // At rest two counts ahead: 1.6·120·2 + 65 − (1.2·2.5 + 0.9695)·v.
    assert_eq!((torque_of(at(3), 0, same), torque_of(at(-1), 0, same)), (449, -449));
    assert_eq!(torque_of(at(3), 30, same), 330);
    // In its cell only the damping, twice 2.5 + 0.9695, beyond 10 counts/s the error too, which is 0 in the middle of the cell.
    assert_eq!((torque_of(at(1), 0, same), torque_of(at(1), 10, same)), (0, -60));
    let quarter = Counts(fixed::types::I22F10::ONE / 4);
    let near = PositionLoop::at_rest(Counts::from_int(1).wrapping_add(quarter), PidState::default());
    assert_eq!((torque_of(near, 10, same), torque_of(near, 20, same)), (-60, 30 - 119));
}

/// With a set-point that waits seven counts ahead: KP 10, KD 0 and the EMF of the set-point's velocity.
#[test]
fn position_torque_has_the_friction_of_the_set_points_direction() {
    let soft: Change = |config| Config { kp: 10, kd: 0, ..config };
    let waiting = |velocity: CountsPerSec, ahead: i32| {
        let mut control = at(1 + ahead);
        control.setpoint = SetPoint { velocity, done: false, ..control.setpoint };
        control.profile.set_end(Counts::from_int(100 * ahead));
        control
    };
    let half = CountsPerSec(Law::ONE / 2);
    for (velocity, ahead, torque) in [
        (CountsPerSec::from_int(5), 7, 70 + 5 + 65),
        (CountsPerSec::from_int(-5), -7, -70 - 5 - 65),
        // From 2 counts/s on it has all of it; half a count/s has a quarter, 16.25, and 0.48 of EMF.
        (CountsPerSec::from_int(2), 7, 70 + 2 + 65),
        (half, 7, 70 + 17),
        // One that does not move yet pushes where the error is.
        (CountsPerSec::ZERO, 7, 70 + 65),
        (CountsPerSec::ZERO, -7, -70 - 65),
    ] {
        assert_eq!(torque_of(waiting(velocity, ahead), 0, soft), torque, "{velocity:?}");
    }
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
        (home(Homing::Return { stop: Way::Closing }), 250),
        (home(Homing::Leave { stop: Way::Closing }), 750),
        (Motion::Velocity, 750),
        (to_zero(at(0)), 750),
    ] {
        let mut bench = Bench::new(Joint::Spread);
        bench.servo.motion = motion;
        assert_eq!(bench.servo.demand().ceiling, Torque(most), "{motion:?}");
    }
    for (ihit, mt, ivel, can) in [
        (63, 63, 1, true),
        (62, 750, 1, false),
        (750, 62, 1, false),
        (750, 750, 0, false),
        (750, 750, -1, true),
    ] {
        let config = Config { ihit, mt, ivel, ..Joint::Spread.config() };
        assert_eq!(
            Tuning::new(config, None, Figures::new(&config.motor, config.board), &Direction::Right)
                .can_home(),
            can,
            "{ihit} {mt} {ivel}"
        );
    }
}

#[test]
fn velocity_goal_is_that_of_the_motion() {
    for (motion, goal) in [
        (Motion::Idle, 0),
        (Motion::Torque(Torque(5)), 0),
        (Motion::Field(Torque(5)), 0),
        (Motion::Velocity, 33),
        (to_zero(at(0)), 0),
        (Motion::TorqueControlled { way: Way::Closing }, 900),
        (Motion::Pressing { way: Way::Opening }, -800),
        (Motion::TorqueControlled { way: Way::Opening }, -800),
        (home(Homing::Seek), -200),
        (home(Homing::Leave { stop: Way::Opening }), 200),
        (held(moving(0, 44)), 44),
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
        (Motion::Torque(Torque(400)), Some(LimitCause::Torque), 77),
        (Motion::Torque(Torque(400)), Some(LimitCause::Supply), 77),
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
        let field = Motion::Field(Torque(5));
        for (motion, releasing) in [(field, None), (field, Some(0)), (Motion::Velocity, None)] {
            let mut bench = Bench::new(Joint::Spread);
            (bench.servo.motion, bench.servo.releasing) = (motion, releasing);
            bench.servo.set_field(Torque(9));
            let is_set = matches!(bench.servo.motion, Motion::Field(Torque(9)));
            assert_eq!(is_set, matches!(motion, Motion::Field(_)) && releasing.is_none(), "{motion:?}");
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

fn with(motion: Motion) -> Bench {
    let mut bench = Bench::new(Joint::Spread);
    bench.servo.motion = motion;
    bench
}

/// Ticks that the motor has been driven in one direction without a count.
fn stalled_for(bench: &mut Bench, way: Way, ms: usize) {
    (0..ms).for_each(|_| _ = bench.servo.stall.drive(way, 0));
}

/// The loop alone, with the friction of a motor at rest, MFS and 2 units more, and no load.
fn by_velocity_loop(bench: &Bench, goal: i16, velocity: CountsPerSec, most: Torque) -> Torque {
    let friction = (Law::from_num(65), Law::ZERO);
    bench.servo.tuning.velocity_loop.step(CountsPerSec::from_int(goal), velocity, friction, most)
}

#[test]
fn pressing_applies_all_torque_below_half_its_speed() {
    let most = Torque(400);
    let delta = CountsPerSec(Law::DELTA);
    for (way, goal) in [(Way::Closing, 1000), (Way::Opening, -1000)] {
        let half = CountsPerSec::from_int(goal / 2);
        let slower = CountsPerSec(half.0 - delta.0 * i32::from(goal.signum()));
        let mut bench = with(Motion::Pressing { way });
        bench.servo.tuning.velocity_loop = VelocityLoop::new(Law::from_bits(1 << 12), &Motor::HAND);
        let all = if way.is_closing() { most } else { most.saturating_neg() };
        for (velocity, presses) in [(slower, true), (half, false), (CountsPerSec::from_int(goal), false)] {
            bench.servo.velocity = velocity;
            let by_loop = by_velocity_loop(&bench, goal, velocity, most);
            assert_ne!(by_loop, all);
            let torque = velocity_torque(&bench, most);
            assert_eq!(torque, if presses { all } else { by_loop }, "{way:?} {velocity:?}");
        }
    }
}

#[test]
fn homing_applies_all_torque_once_it_has_stood_for_125_ms() {
    let most = Torque(400);
    for (ivel, closing) in [(200, true), (-200, false), (1, true), (0, true), (0, false)] {
        for (ms, all) in [(124, false), (125, true)] {
            let mut bench = with(home(Homing::Seek));
            bench.servo.tuning.config.ivel = ivel;
            bench.servo.tuning.velocity_loop = VelocityLoop::new(Law::from_bits(1 << 12), &Motor::HAND);
            stalled_for(&mut bench, Way::closing_if(closing), ms);
            let by_loop = by_velocity_loop(&bench, ivel, CountsPerSec::ZERO, most);
            let pushing = if closing { most } else { most.saturating_neg() };
            let expected = if all && ivel != 0 { pushing } else { by_loop };
            assert_eq!(velocity_torque(&bench, most), expected, "IVEL {ivel}, {ms} ms");
            // The other way it has not stood.
            bench.servo.tuning.config.ivel = -ivel;
            assert_ne!(velocity_torque(&bench, most).saturating_abs(), most, "IVEL {}", -ivel);
        }
    }
}

#[test]
fn velocity_mode_rests_after_a_stall_before_it_presses_again() {
    let most = Torque(400);
    // TSTOP of a spread is 400 ms.
    for (ms, applied, wanted, rests) in [
        (400, 0, 50, true),
        (399, 0, 50, false),
        (400, 1, 50, false),
        (400, 0, -50, false),
        (400, 0, 0, false),
    ] {
        let mut bench = with(Motion::Velocity);
        stalled_for(&mut bench, Way::Closing, ms);
        bench.servo.velocity_wanted = CountsPerSec::from_int(wanted);
        bench.servo.applied.torque = Torque(applied);
        let torque = velocity_torque(&bench, most);
        assert_eq!(torque == Torque::ZERO, rests || wanted == 0, "{ms} {applied} {wanted}: {torque:?}");
        assert_eq!(bench.servo.must_rest(CountsPerSec::from_int(wanted)), ms == 400 && wanted > 0);
    }
}

/// TSTOP of a spread is 400 ms: eight counts are 20 counts/s. 63 units are a joint's friction.
#[test]
fn missing_count_of_mode_4_is_a_stall_at_a_limit_or_beyond_friction_at_speed() {
    let most = LimitCause::Torque;
    for (wanted, torque, limit, stalls) in [
        (20, 63, None, true),
        (-20, -63, None, true),
        (19, 63, None, false),
        (20, 62, None, false),
        (1, 20, Some(most), true),
        (1000, 0, None, false),
    ] {
        let mut bench = with(Motion::Velocity);
        bench.servo.velocity_wanted = CountsPerSec::from_int(wanted);
        bench.servo.applied.torque = Torque(torque);
        bench.servo.applied.limit = limit;
        let expected = stalls.then_some(Way::closing_if(torque > 0));
        assert_eq!(
            bench.servo.drives(bench.servo.demand().pushes, 400),
            expected,
            "V {wanted}, {torque} by {limit:?}"
        );
    }
}

#[test]
fn motion_keeps_the_load_of_a_hold_or_move_that_it_replaces() {
    let pid = loaded();
    let loaded = PositionLoop { pid, ..at(0) };

    for (motion, carries) in [
        (held(loaded), true),
        (to_end(loaded), true),
        (to_zero(loaded), true),
        (Motion::Velocity, false),
        (Motion::Idle, false),
    ] {
        let carried = if carries { pid } else { PidState::default() };
        assert_eq!(with(motion).servo.carried_pid(), carried, "{motion:?}");
    }
}

#[test]
fn new_goal_waits_for_the_brake_only_as_long_as_it_has_to() {
    for (mut bench, ms) in [
        (with(Motion::Idle), 0),
        (starting(Motion::Velocity, 7), 7),
        (with(held(at(0))), 30),
        (with(Motion::Velocity), 30),
    ] {
        bench.servo.begin(Motion::Velocity);
        assert!(matches!(bench.servo.motion, Motion::Velocity), "{:?}", bench.servo.motion);
        assert_eq!(bench.servo.releasing, Some(ms));
        // A hold instead keeps the rest of that time.
        bench.servo.command(Command::Mode(Mode::Pid)).unwrap();
        let holds = matches!(bench.servo.motion, Motion::Position { to: None, .. });
        assert!(holds && bench.servo.releasing == Some(ms), "{:?}", bench.servo.motion);
    }
}

#[test]
fn motion_is_due_when_its_brake_is_free() {
    for motion in [to_end(at(0)), to_zero(at(0)), Motion::Velocity, held(at(0))] {
        for brake_ms in [29, 30] {
            assert_eq!(starting(motion, brake_ms).servo.is_due(), brake_ms == 30, "{motion:?}");
        }
    }
    // HI begins once half of the stall time has passed at rest.
    for (ms, due) in [(199, true), (200, false)] {
        let mut bench = starting(home(Homing::Seek), 30);
        stalled_for(&mut bench, Way::Closing, ms);
        assert_eq!(bench.servo.is_due(), due, "{ms}");
        bench.servo.motion = Motion::Velocity;
        assert!(bench.servo.is_due(), "{ms}");
    }
    assert!(!with(Motion::Velocity).servo.is_due());
}

#[test]
fn move_stalls_at_once_only_towards_what_it_stalled_at() {
    use Way::{Closing, Opening};
    for (way, end, stalls) in [
        (Closing, 5, true),
        (Closing, -5, false),
        (Closing, 0, false),
        (Opening, -5, true),
        (Opening, 5, false),
    ] {
        let mut bench = Bench::new(Joint::Tip);
        stalled_for(&mut bench, way, 300);
        bench.servo.end = end;
        bench.servo.motion = to_end(at(0));
        bench.servo.start();
        let reason = bench.servo.telemetry().end;
        assert_eq!(reason == Some(EndReason::Stalled), stalls, "{way:?} {end}: {reason:?}");
    }
}

#[test]
fn velocity_takes_over_from_pressing_alone() {
    for (motion, takes) in [
        (Motion::TorqueControlled { way: Way::Closing }, true),
        (Motion::Pressing { way: Way::Closing }, true),
        (home(Homing::Seek), false),
        (Motion::Idle, false),
    ] {
        let mut bench = with(motion);
        bench.servo.set_velocity(CountsPerSec::from_int(9));
        let is = matches!(bench.servo.motion, Motion::Velocity);
        assert_eq!(is, takes, "{motion:?}");
        assert_eq!(bench.servo.velocity_wanted(), CountsPerSec::from_int(9));
    }
}

/// Ticks of the profile in progress; a new plan begins at 0.
fn profile_ticks(bench: &Bench) -> u32 {
    match &bench.servo.motion {
        Motion::Move { control, .. } | Motion::Zero { control, .. } => control.profile.ticks(),
        _ => u32::MAX,
    }
}

#[test]
fn only_what_shapes_a_motion_plans_it_anew() {
    let changes: [(Change, bool, bool); 6] = [
        (|config| Config { accel: 31, ..config }, true, true),
        (|config| Config { mv: 900, ..config }, true, true),
        (|config| Config { mcv: 900, ..config }, true, true),
        (|config| Config { mov: 900, ..config }, true, true),
        (|config| Config { ioff: 90, ..config }, false, true),
        (|config| Config { kp: 61, ..config }, false, false),
    ];
    for (motion, is_zero) in [(to_end(at(0)), false), (to_zero(at(0)), true)] {
        for (change, of_move, of_zero) in changes {
            let mut bench = Bench::new(Joint::Tip);
            bench.servo.end = 100;
            (bench.servo.motion, bench.servo.releasing) = (motion, Some(0));
            (0..30).for_each(|_| _ = bench.tick());
            let ticks = profile_ticks(&bench);
            assert!((20..40).contains(&ticks), "{ticks}");
            bench.servo.command(Command::Configure(change(*bench.servo.config()))).unwrap();
            let plans = if is_zero { of_zero } else { of_move };
            assert_eq!(profile_ticks(&bench), if plans { 0 } else { ticks }, "{motion:?}");
            let config = *bench.servo.config();
            bench.servo.command(Command::Configure(config)).unwrap();
            assert_eq!(profile_ticks(&bench), if plans { 0 } else { ticks }, "the same again");
        }
    }
}

#[test]
fn direction_is_watched_until_it_settles_and_at_each_count() {
    for (motion, settled, counted, watches) in [
        (Motion::Velocity, false, false, true),
        (Motion::Velocity, true, false, false),
        (Motion::Velocity, true, true, true),
        (Motion::Field(Torque(5)), false, true, false),
    ] {
        let mut bench = with(motion);
        bench.servo.direction = bench.servo.at_rest();
        let starts = *bench.servo.starts();
        // A motor at rest that is not driven settles.
        (0..1000).filter(|_| settled).for_each(|_| _ = bench.servo.direction.step(&starts, 0, Torque(80)));
        assert_eq!(bench.servo.direction.is_settled(), settled);
        assert_eq!(bench.servo.watches(counted), watches, "{motion:?} {settled} {counted}");
    }
}

#[test]
fn hall_fault_counts_unless_find_looks_for_the_wiring() {
    for (motion, counts) in [(Motion::Velocity, true), (Motion::Field(Torque(5)), false)] {
        let mut bench = with(motion);
        bench.servo.trust_position();
        bench.servo.hall(&HallEvent::Fault(HallFault::Noisy));
        assert_eq!(bench.servo.telemetry().homed, !counts, "{motion:?}");
        bench.tick();
        assert_eq!(bench.servo.telemetry().fault.is_some(), counts, "{motion:?}");
        bench.servo.trust_position();
        bench.servo.doubt_position();
        assert!(!bench.servo.telemetry().homed);
    }
}

#[test]
fn strain_ends_torque_control_but_no_pressing() {
    let mut bench = Bench::new(Joint::Tip);
    let config = Config { hsg: 150, hold: true, ..*bench.servo.config() };
    bench.servo.command(Command::Configure(config)).unwrap();
    for (motion, ends) in [
        (Motion::TorqueControlled { way: Way::Closing }, true),
        (Motion::Pressing { way: Way::Closing }, false),
        (Motion::Velocity, false),
    ] {
        bench.servo.motion = motion;
        bench.strain = 150;
        bench.tick();
        assert_eq!(bench.servo.event(), None, "{motion:?}");
        bench.strain = 151;
        bench.tick();
        let ended = Event::Ended { reason: EndReason::Strain, mode: Mode::Pid };
        assert_eq!(bench.servo.event(), ends.then_some(ended), "{motion:?}");
    }
}

#[test]
fn position_set_in_idle_renames_the_count() {
    let mut bench = Bench::new(Joint::Link);
    bench.tick_to(7);
    bench.servo.command(Command::Position(-100)).unwrap();
    assert_eq!(bench.servo.telemetry().position.round(), -100);
    bench.tick_to(9);
    assert_eq!(bench.servo.telemetry().position.round(), -98);
}

#[test]
fn untrusted_direction_is_watched_from_where_a_motor_starts_that_was_off() {
    let mut bench = Bench::new(Joint::Link);
    bench.servo.set_direction(bench.servo.at_rest());
    bench.servo.applied = AppliedTorque::OFF;
    bench.tick_to(20);
    bench.servo.motion = Motion::Velocity;
    bench.servo.start();
    assert_eq!(bench.servo.direction, Direction::at_rest(bench.servo.starts(), 20));
    // What drives it already goes on being judged.
    bench.servo.applied.torque = Torque(80);
    bench.servo.count = 30;
    bench.servo.motion = Motion::Velocity;
    bench.servo.start();
    assert_eq!(bench.servo.direction, Direction::at_rest(bench.servo.starts(), 20));
}

#[test]
fn link_that_is_held_back_with_bt_for_10_ms_breaks_away() {
    for (bt, breaks) in [(400, true), (0, false)] {
        let mut bench = Bench::new(Joint::Link);
        let config = Config { bt, ..Joint::Link.config() };
        bench.servo.command(Command::Configure(config)).unwrap();
        bench.servo.command(Command::Move(300)).unwrap();
        let end = (0..500).find_map(|_| {
            bench.tick();
            core::iter::from_fn(|| bench.servo.event()).find_map(|event| match event {
                Event::Ended { reason, .. } => Some(reason),
                _ => None,
            })
        });
        assert_eq!(end, Some(if breaks { EndReason::Breakaway } else { EndReason::Stalled }), "BT {bt}");
    }
}

#[test]
fn winding_begins_as_hot_as_the_start_says_and_its_mark_is_judged() {
    let mut bench = Bench::new(Joint::Link);
    bench.servo.start_warm(Start::Reset(400));
    assert_eq!(
        (bench.servo.rise(), bench.servo.hot_mark()),
        (None, HotMark::Right),
        "nothing is known before a tick"
    );
    (0..40).for_each(|_| _ = bench.tick());
    let rise = bench.servo.rise().expect("judged");
    assert!((390..=410).contains(&rise), "{rise}");
    bench.servo.set_hot_mark(true);
    assert_eq!(bench.servo.hot_mark(), HotMark::Obsolete, "70 C");
}
