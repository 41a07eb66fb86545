//! HI: seeking the stop, leaving it, zero.

use super::*;

/// A rotor between two stops, at 200 counts/s in mode 4 and on the set-point in mode 5.
struct Rotor {
    low: i32,
    high: i32,
}

impl Rotor {
    fn tick(&self, bench: &mut Bench) {
        let status = bench.servo.telemetry();
        let wanted = match status.mode {
            Mode::Trapezoidal => status.setpoint.round() + bench.servo.zero,
            _ if !(bench.now.0 / 1000).is_multiple_of(5) => bench.count,
            _ => {
                let goal = status.setpoint_velocity;
                bench.count + i32::from(goal > CountsPerSec::ZERO) - i32::from(goal < CountsPerSec::ZERO)
            }
        };
        bench.tick_to(wanted.max(self.low).min(self.high));
    }

    /// Ticks until a motion ends; its reason.
    fn until_end(&self, bench: &mut Bench, most: usize) -> Option<EndReason> {
        self.until(bench, most, |_| false)
    }

    /// Ticks until a motion ends or `found`.
    fn until(&self, bench: &mut Bench, most: usize, found: impl Fn(&Bench) -> bool) -> Option<EndReason> {
        for _ in 0..most {
            if found(bench) {
                return None;
            }
            self.tick(bench);
            while let Some(event) = bench.servo.event() {
                if let Event::Ended { reason, .. } = event {
                    return Some(reason);
                }
            }
        }
        None
    }
}

/// Longest HI on such a rotor, ms: its widest joint, three stalls and the way to zero.
const HI_MS: usize = 8000;

const KINDS: [Joint; 3] = [Joint::Link, Joint::Spread, Joint::Tip];

fn jammed(bench: &Bench) -> bool {
    let status = bench.servo.telemetry();
    (status.mode, status.fault, status.end, status.homed)
        == (Mode::Idle, Some(Fault::Jammed), Some(EndReason::Fault), false)
}

fn stage(bench: &Bench) -> Option<Homing> {
    match bench.servo.motion {
        Motion::Home { stage, .. } => Some(stage),
        _ => None,
    }
}

/// Stages of HI in their order; the first of each is where the cross product begins.
const STAGES: [fn(&Bench) -> bool; 5] = [
    |bench| matches!(stage(bench), Some(Homing::Seek)) && bench.servo.releasing.is_some(),
    |bench| matches!(stage(bench), Some(Homing::Seek)) && bench.servo.releasing.is_none(),
    |bench| matches!(stage(bench), Some(Homing::Leave { .. })),
    |bench| matches!(stage(bench), Some(Homing::Return { .. })),
    |bench| matches!(bench.servo.motion, Motion::Zero { .. }) && bench.servo.releasing.is_none(),
];

fn at_stage(kind: Joint, is_there: fn(&Bench) -> bool) -> (Bench, Rotor) {
    let mut bench = Bench::new(kind);
    let rotor = Rotor { low: -30, high: 45 };
    bench.servo.command(Command::Home).unwrap();
    assert_eq!(rotor.until(&mut bench, HI_MS, is_there), None);
    assert!(is_there(&bench), "{kind:?}: {:?}", bench.servo.motion);
    (bench, rotor)
}

#[test]
fn homing_zeroes_at_ioff_from_the_stop() {
    for (kind, at) in [(Joint::Link, -15), (Joint::Spread, -40), (Joint::Tip, -310)] {
        for start in [-40, -17, 40] {
            let mut bench = Bench::new(kind);
            bench.tick_to(start);
            bench.servo.command(Command::End(10)).unwrap();
            bench.servo.command(Command::Home).unwrap();
            let rotor = Rotor { low: if let Joint::Tip = kind { -400 } else { -40 }, high: 40 };
            assert_eq!(rotor.until_end(&mut bench, HI_MS), Some(EndReason::Arrived), "{kind:?} at {start}");
            let status = bench.servo.telemetry();
            let after = if let Joint::Spread = kind { Mode::Pid } else { Mode::Idle };
            assert!(status.homed && status.mode == after && status.fault.is_none(), "{kind:?} at {start}");
            assert_eq!((bench.count, status.position.round()), (at, 0), "{kind:?} at {start}");
            bench.servo.command(Command::Mode(Mode::Trapezoidal)).unwrap();
            bench.follow(3000);
            assert_eq!(bench.servo.telemetry().position.round(), 10, "E written before HI is kept");
        }
    }
}

#[test]
fn homing_leaves_the_stop_by_12_counts_and_returns_to_it() {
    for kind in KINDS {
        let (mut bench, rotor) = at_stage(kind, STAGES[2]);
        let (stop, mut farthest) = (bench.count, 0);
        rotor.until(&mut bench, HI_MS, STAGES[4]);
        assert_eq!(bench.count, stop, "{kind:?} leaves for zero from its stop");
        let (mut bench, rotor) = at_stage(kind, STAGES[2]);
        for _ in 0..1000 {
            rotor.tick(&mut bench);
            farthest = farthest.max((bench.count - stop).abs());
            if STAGES[4](&bench) {
                break;
            }
        }
        assert_eq!(farthest, 12, "{kind:?}");
    }
}

#[test]
fn motor_that_turns_fewer_than_12_counts_is_jammed() {
    for kind in KINDS {
        for way in 0..16 {
            let mut bench = Bench::new(kind);
            bench.servo.command(Command::Home).unwrap();
            let end = Rotor { low: 0, high: way }.until_end(&mut bench, HI_MS);
            // The way from stop to zero of a link or a tip is longer: it stalls there, and is not homed either.
            match kind {
                Joint::Spread if way >= 12 => assert_eq!(end, Some(EndReason::Arrived), "{way}"),
                _ if way >= 12 => assert_eq!(end, Some(EndReason::Stalled), "{kind:?} {way}"),
                _ => assert!(end == Some(EndReason::Fault) && jammed(&bench), "{kind:?} {way}: {end:?}"),
            }
            assert_eq!(bench.servo.telemetry().homed, end == Some(EndReason::Arrived), "{kind:?} {way}");
        }
    }
}

#[test]
fn second_contact_more_than_a_count_from_the_first_is_jammed() {
    for kind in KINDS {
        for shift in -9..=9 {
            let (mut bench, Rotor { low, high }) = at_stage(kind, STAGES[3]);
            let rotor = Rotor { low: low + shift, high: high + shift };
            let end = rotor.until(&mut bench, HI_MS, STAGES[4]);
            assert_eq!(end.is_none(), (-1..=1).contains(&shift), "{kind:?}, {shift} counts: {end:?}");
            assert_eq!(jammed(&bench), end.is_some(), "{kind:?}, {shift} counts");
        }
    }
}

/// Not only once it stalls there: the joint may be free to go on.
#[test]
fn rotor_that_passes_its_first_contact_is_jammed_at_once() {
    for kind in KINDS {
        let (mut bench, _) = at_stage(kind, STAGES[3]);
        let free = Rotor { low: -1000, high: 1000 };
        let first = bench.count;
        assert!(free.until_end(&mut bench, HI_MS).is_some());
        assert!(jammed(&bench), "{kind:?}");
        // Back over the 12 counts, and beyond the first contact by the two that are too many.
        assert!((12..=16).contains(&(bench.count - first).abs()), "{kind:?}: {} counts", bench.count - first);
    }
}

#[test]
fn stages_without_an_end_are_jammed_in_bounded_time() {
    for kind in KINDS {
        for ivel in [1, 20, 100, 4080] {
            for (first, most) in [(STAGES[1], SEEK_WAY), (STAGES[2], PROVE_WAY), (STAGES[3], PROVE_WAY)] {
                let (mut bench, _) = at_stage(kind, first);
                let config = Config { ivel, tstop: 0, ..*bench.servo.config() };
                bench.servo.command(Command::Configure(config)).unwrap();
                // A load that shakes the rotor: counts come, and it gets nowhere.
                let ticks = (1_usize..).find(|tick| {
                    bench.tick_to(bench.count + [0, 1, 0, -1][tick % 4]);
                    bench.servo.telemetry().fault.is_some()
                });
                let ms = ticks.unwrap();
                let most =
                    usize::try_from(most).unwrap() * 1000 / usize::from(ivel.unsigned_abs().min(SURE_SPEED));
                assert!(jammed(&bench) && ms <= most + 2, "{kind:?} IVEL {ivel}: {ms} of {most} ms");
            }
        }
    }
}

/// Every command and fault in every stage of every kind: HI ends at once or completes, and no motor is homed that has not
/// been at its stop twice.
#[test]
fn every_command_and_fault_in_every_stage_ends_or_completes() {
    for kind in KINDS {
        for (number, is_there) in STAGES.into_iter().enumerate() {
            for hold in [false, true] {
                for (command, name) in commands() {
                    let (mut bench, rotor) = at_stage(kind, is_there);
                    let what = (kind, number, hold, name);
                    let config = Config { hold, ..*bench.servo.config() };
                    bench.servo.command(Command::Configure(config)).unwrap();
                    let command = match command {
                        Command::Configure(_) => Command::Configure(Config { mt: 700, ..config }),
                        other => other,
                    };
                    let answer = bench.servo.command(command);
                    let mut end = rotor.until_end(&mut bench, HI_MS);
                    if matches!(command, Command::Home) {
                        assert_eq!(end, Some(EndReason::Aborted), "{what:?}");
                        end = rotor.until_end(&mut bench, HI_MS);
                    }
                    let status = bench.servo.telemetry();
                    let mode = if number == 4 { Mode::Trapezoidal } else { Mode::Velocity };
                    let (ends, homed) = match command {
                        _ if answer.is_err() => (true, true),
                        Command::Mode(wanted) => (wanted != mode, wanted == mode),
                        Command::MoveToEnd => (mode != Mode::Trapezoidal, mode == Mode::Trapezoidal),
                        Command::Move(_) | Command::TorqueControlled { .. } => (true, false),
                        Command::Terminate => (true, false),
                        _ => (true, true),
                    };
                    // A tip's zero is beyond this rotor's stop.
                    let homed = homed && !matches!(kind, Joint::Tip);
                    assert_eq!(status.homed, homed, "{what:?}: {end:?}");
                    assert!(!ends || end.is_some(), "{what:?}");
                    assert_eq!(status.fault, None, "{what:?}");
                }
            }
            for property in 0..6 {
                let (mut bench, rotor) = at_stage(kind, is_there);
                let old = *bench.servo.config();
                let config = match property {
                    0 => Config { ivel: -old.ivel, ..old },
                    1 => Config { ivel: 0, ..old },
                    2 => Config { ihit: 0, ..old },
                    3 => Config { mt: 0, ..old },
                    4 => Config { kpv: 0, kp: 0, ki: 0, ..old },
                    _ => Config { accel: 0, tstop: 0, ..old },
                };
                bench.servo.command(Command::Configure(config)).unwrap();
                let end = rotor.until_end(&mut bench, 30_000);
                assert!(end.is_some(), "{kind:?}, stage {number}, {config:?}: {:?}", bench.servo.motion);
            }
            let (mut bench, _) = at_stage(kind, is_there);
            bench.servo.bridge_fault();
            bench.tick();
            let status = bench.servo.telemetry();
            assert_eq!((status.mode, status.fault, status.homed), (Mode::Idle, Some(Fault::Bridge), false));
        }
    }
}

#[test]
fn new_sign_of_ivel_does_not_turn_the_way_back_to_the_stop() {
    for kind in KINDS {
        let (mut bench, rotor) = at_stage(kind, STAGES[2]);
        let stop = bench.count;
        let config = Config { ivel: -bench.servo.config().ivel, ..*bench.servo.config() };
        bench.servo.command(Command::Configure(config)).unwrap();
        assert_eq!(rotor.until(&mut bench, HI_MS, STAGES[4]), None);
        assert_eq!(bench.count, stop, "{kind:?}");
    }
}

#[test]
fn jammed_motor_refuses_motion_until_cleared_and_can_home_then() {
    let mut bench = Bench::new(Joint::Spread);
    bench.servo.command(Command::Home).unwrap();
    let stuck = Rotor { low: 0, high: 0 };
    assert_eq!(stuck.until_end(&mut bench, HI_MS), Some(EndReason::Fault));
    assert!(jammed(&bench) && bench.tick() == Drive { duty: None, brake_released: false });
    assert_eq!(bench.servo.command(Command::Home), Err(Refusal::Fault(Fault::Jammed)));
    bench.servo.command(Command::ClearFault).unwrap();
    bench.servo.command(Command::Home).unwrap();
    assert_eq!(Rotor { low: 0, high: 20 }.until_end(&mut bench, HI_MS), Some(EndReason::Arrived));
    assert!(bench.servo.telemetry().homed);
}

#[test]
fn ioff_written_on_the_way_to_zero_replans_to_the_new_zero() {
    let (mut bench, rotor) = at_stage(Joint::Link, STAGES[4]);
    let stop = bench.count;
    let config = Config { ioff: 40, ..*bench.servo.config() };
    bench.servo.command(Command::Configure(config)).unwrap();
    assert_eq!(rotor.until_end(&mut bench, 2000), Some(EndReason::Arrived));
    assert_eq!((bench.count, bench.servo.telemetry().position.round()), (stop + 40, 0));
}

#[test]
fn homing_never_stalls_before_hosts_can_see_mode_4() {
    let mut bench = Bench::new(Joint::Link);
    let config = Config { tstop: 20, ..*bench.servo.config() };
    bench.servo.command(Command::Configure(config)).unwrap();
    bench.servo.command(Command::Home).unwrap();
    let left_at = (1..2000).find(|_| {
        bench.tick();
        matches!(stage(&bench), Some(Homing::Leave { .. }))
    });
    assert!((250..=253).contains(&left_at.unwrap()), "{left_at:?}");
}

/// After HI with a blocked rotor: whether it takes the place for its stop, and its telemetry.
fn pressed(
    config: impl FnOnce(Config) -> Config,
    meanwhile: impl FnOnce(Config) -> Config,
) -> (bool, Telemetry) {
    let mut bench = Bench::new(Joint::Tip);
    let config = config(*bench.servo.config());
    bench.servo.command(Command::Configure(config)).unwrap();
    bench.servo.command(Command::Home).unwrap();
    bench.tick();
    bench.servo.command(Command::Configure(meanwhile(config))).unwrap();
    for _ in 0..1000 {
        if bench.tick().duty.is_none() || STAGES[2](&bench) {
            break;
        }
    }
    (STAGES[2](&bench), bench.servo.telemetry())
}

#[test]
fn stall_is_the_stop_only_at_full_homing_torque() {
    let same = |config| config;
    let leaves = |(leaves, status): (bool, Telemetry)| leaves && !status.homed;
    let stays = |(_, status): (bool, Telemetry)| {
        (status.mode, status.end, status.homed) == (Mode::Idle, Some(EndReason::Stalled), false)
    };
    assert!(leaves(pressed(same, same)));
    // 20 counts/s times 16 units per count/s are 320, of which IHIT lets 250 through.
    assert!(leaves(pressed(|c| Config { ivel: 20, kpv: 255, ..c }, same)));
    // 200 counts/s times 1 unit are 200, below IHIT: all of it is applied all the same (decision 0062).
    for kpv in [0, 1, 16] {
        assert!(leaves(pressed(|c| Config { kpv, ..c }, same)), "KPV {kpv}");
    }
    assert!(leaves(pressed(|c| Config { ihit: 700, ..c }, same)), "IHIT above KPV x IVEL");
    assert!(stays(pressed(same, |c| Config { ivel: 0, ..c })));
    assert!(stays(pressed(same, |c| Config { ihit: 0, ..c })));
    assert!(stays(pressed(same, |c| Config { mt: 20, ..c })));
}

#[test]
fn derated_motor_does_not_find_its_stop() {
    // Of 990 over 8 °C, half a degree below OTEMP leaves 61, and two degrees 247.
    for (motor_temp, found) in [(695, false), (680, true)] {
        let mut bench = Bench::new(Joint::Tip);
        bench.motor_temp = DeciCelsius(motor_temp);
        bench.servo.command(Command::Home).unwrap();
        for _ in 0..310 {
            bench.tick();
        }
        assert_eq!(STAGES[2](&bench), found, "{:?}", bench.servo.telemetry().mode);
    }
}

#[test]
fn homing_without_velocity_or_torque_above_friction_is_refused() {
    let unable: [fn(Config) -> Config; 4] = [
        |c| Config { ivel: 0, ..c },
        |c| Config { ihit: 0, ..c },
        |c| Config { mt: 0, ..c },
        |c| Config { ihit: 62, ..c },
    ];
    for change in unable {
        let mut bench = Bench::new(Joint::Tip);
        let config = change(*bench.servo.config());
        bench.servo.trust_position();
        bench.servo.command(Command::Configure(config)).unwrap();
        assert_eq!(bench.servo.command(Command::Home), Err(Refusal::Homing), "{config:?}");
        assert!(bench.servo.telemetry().homed, "refused is unchanged");
        let config = Config { ivel: -1, ihit: 63, mt: 63, ..config };
        bench.servo.command(Command::Configure(config)).unwrap();
        assert_eq!(bench.servo.command(Command::Home), Ok(()));
    }
}

/// Between the second contact and the way to zero the bridge keeps its state for a tick.
#[test]
fn torque_goes_on_until_the_way_to_zero_begins() {
    let (mut bench, rotor) = at_stage(Joint::Tip, STAGES[3]);
    let is_starting =
        |bench: &Bench| matches!(bench.servo.motion, Motion::Zero { .. }) && bench.servo.releasing.is_some();
    let mut before = None;
    for _ in 0..HI_MS {
        rotor.tick(&mut bench);
        if is_starting(&bench) {
            break;
        }
        before = Some(bench.servo.telemetry());
    }
    assert!(is_starting(&bench));
    let (before, now) = (before.expect("a tick before"), bench.servo.telemetry());
    assert_eq!((now.torque, now.duty), (before.torque, before.duty));
    assert!(now.torque.saturating_abs() > bench.servo.tuning.figures.friction, "{:?}", now.torque);
}
