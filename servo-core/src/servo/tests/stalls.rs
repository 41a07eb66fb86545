//! A motor that cannot turn, or turns without getting anywhere: no write keeps it driven.

use super::*;

const KINDS: [Joint; 3] = [Joint::Link, Joint::Spread, Joint::Tip];

/// Runs a blocked rotor and calls `write` every 100 ms with the number of the call. Returns the longest time driven without a
/// rest of TSTOP, and the time driven in all, ms. Driven is a torque beyond a joint's friction.
fn driven(bench: &mut Bench, ms: usize, mut write: impl FnMut(&mut Servo, usize)) -> (u32, u32) {
    let (mut total, mut longest, mut here, mut rest) = (0, 0, 0, 0);
    for tick in 0..ms {
        if tick % 100 == 0 {
            write(&mut bench.servo, tick / 100);
        }
        bench.tick();
        while bench.servo.event().is_some() {}
        let pushes = bench.servo.telemetry().torque.saturating_abs() > bench.servo.tuning.figures.friction;
        (total, rest) = if pushes { (total + 1, 0) } else { (total, rest + 1) };
        here = if rest >= bench.servo.config().tstop { 0 } else { here + u32::from(pushes) };
        longest = longest.max(here);
    }
    (longest, total)
}

/// Most time driven without a count, ms: TSTOP and the lead in either direction, and what a set-point within a count of the
/// rotor drives, which is no stall.
fn most_ms(kind: Joint) -> u32 {
    // Mode 3 takes √(2·1.5/15,000) s to a count beyond the far side of its cell.
    2 * (u32::from(kind.config().tstop) + 10 + 14)
}

/// What a host may toggle: with an even number one value, with an odd one another.
type Write = (&'static str, fn(&mut Servo, usize));

fn writes() -> [Write; 15] {
    const fn odd(number: usize) -> bool {
        number % 2 == 1
    }

    fn configure(servo: &mut Servo, change: impl FnOnce(&mut Config)) {
        let mut config = *servo.config();
        change(&mut config);
        servo.command(Command::Configure(config)).unwrap();
    }
    [
        ("nothing", |_, _| ()),
        ("E", |servo, n| servo.command(Command::End(200 + i32::from(odd(n)))).unwrap()),
        ("E either way", |servo, n| servo.command(Command::End(200 - 400 * i32::from(odd(n)))).unwrap()),
        ("P", |servo, n| _ = servo.command(Command::Position(9 + i32::from(odd(n))))),
        ("P either way", |servo, n| _ = servo.command(Command::Position(9 - 18 * i32::from(odd(n))))),
        ("T", |servo, n| _ = servo.command(Command::Torque(Torque(500 + i16::from(odd(n)))))),
        ("T and 0", |servo, n| _ = servo.command(Command::Torque(Torque(500 * i16::from(odd(n)))))),
        ("V", |servo, n| {
            servo.command(Command::Velocity(CountsPerSec::from_int(500 + i16::from(odd(n))))).unwrap();
        }),
        ("ACCEL", |servo, n| configure(servo, |c| c.accel = 30 + u16::from(odd(n)))),
        ("MV", |servo, n| configure(servo, |c| c.mv = 1000 + u16::from(odd(n)))),
        ("TSTOP", |servo, n| configure(servo, |c| c.tstop -= u16::from(odd(n)))),
        ("HOLD", |servo, n| configure(servo, |c| c.hold = n % 2 == 0)),
        ("MT, KP, KI, KD, KPV, MPE", |servo, n| {
            configure(servo, |c| {
                let bit = u16::from(odd(n));
                (c.mt, c.kp, c.ki, c.kd, c.kpv, c.mpe) =
                    (750 - bit, 120 + bit, 800 * bit, 640, 32 + bit, 4 + bit);
            });
        }),
        ("MODE 0", |servo, n| {
            if n % 2 == 1 {
                servo.command(Command::Mode(Mode::Idle)).unwrap();
            }
        }),
        ("STAT 2", |servo, _| servo.command(Command::ClearFault).unwrap()),
    ]
}

type Start = (&'static str, fn(&mut Servo));

fn starts() -> [Start; 7] {
    [
        ("M", |servo| servo.command(Command::Move(200)).unwrap()),
        ("MODE 5", |servo| {
            servo.command(Command::End(200)).unwrap();
            servo.command(Command::Mode(Mode::Trapezoidal)).unwrap();
        }),
        ("MODE 3", |servo| {
            servo.command(Command::Mode(Mode::Pid)).unwrap();
            servo.command(Command::Position(9)).unwrap();
        }),
        ("MODE 2", |servo| {
            servo.command(Command::Mode(Mode::Torque)).unwrap();
            servo.command(Command::Torque(Torque(600))).unwrap();
        }),
        ("MODE 4", |servo| {
            servo.command(Command::Velocity(CountsPerSec::from_int(600))).unwrap();
            servo.command(Command::Mode(Mode::Velocity)).unwrap();
        }),
        ("TC", |servo| servo.command(Command::TorqueControlled { way: Way::Closing }).unwrap()),
        ("HI", |servo| servo.command(Command::Home).unwrap()),
    ]
}

fn blocked(kind: Joint) -> Bench {
    let mut bench = Bench::new(kind);
    // A link would break away, and a hold presses without an end: heat alone limits that (decision 0049).
    let config = Config { bt: 0, hold: false, ..kind.config() };
    bench.servo.command(Command::Configure(config)).unwrap();
    bench
}

#[test]
fn no_write_keeps_a_stalled_motor_driven() {
    for kind in KINDS {
        for (start, begin) in starts() {
            for (write, toggle) in writes() {
                for again in [false, true] {
                    let mut bench = blocked(kind);
                    begin(&mut bench.servo);
                    let what = (kind, start, write, again);
                    let holds = write == "HOLD";
                    let (longest, total) = driven(&mut bench, 30_000, |servo, number| {
                        toggle(servo, number);
                        if again && servo.telemetry().fault.is_none() {
                            begin(servo);
                        }
                    });
                    // Held, TC presses on.
                    if holds {
                        continue;
                    }
                    assert!(longest <= most_ms(kind), "{what:?}: {longest} ms");
                    assert!(again || total <= most_ms(kind), "{what:?}: {total} ms in all");
                    // Sent again, a motion runs only after a rest as long as its stall.
                    assert!(total <= 20_000, "{what:?}: {total} ms in all");
                }
            }
        }
    }
}

#[test]
fn motion_sent_again_right_after_a_stall_stalls_at_once() {
    for kind in KINDS {
        for (start, begin) in starts() {
            if start == "HI" {
                continue;
            }
            let mut bench = blocked(kind);
            begin(&mut bench.servo);
            let (_, first) = driven(&mut bench, 2000, |_, _| ());
            begin(&mut bench.servo);
            let (_, rested) = driven(&mut bench, 2000, |_, _| ());
            assert!(
                first > 0 && rested * 10 >= first * 8,
                "{kind:?} {start}: {first} ms, rested {rested} ms"
            );
            let mut bench = blocked(kind);
            begin(&mut bench.servo);
            while bench.servo.telemetry().end.is_none() {
                bench.tick();
            }
            begin(&mut bench.servo);
            let again = driven(&mut bench, 250, |_, _| ()).1;
            assert!(again <= 5, "{kind:?} {start}: {again} ms");
        }
    }
}

#[test]
fn count_or_other_direction_lets_a_stalled_motor_go_on() {
    for kind in KINDS {
        let mut bench = blocked(kind);
        bench.servo.command(Command::TorqueControlled { way: Way::Closing }).unwrap();
        while bench.servo.telemetry().mode != Mode::Idle {
            bench.tick();
        }
        bench.servo.command(Command::TorqueControlled { way: Way::Opening }).unwrap();
        let (_, other) = driven(&mut bench, 200, |_, _| ());
        assert!(other >= 150, "{kind:?}: the other way for {other} ms");
        bench.tick_to(-1);
        bench.servo.command(Command::TorqueControlled { way: Way::Closing }).unwrap();
        let (_, after) = driven(&mut bench, 200, |_, _| ());
        assert!(after >= 150, "{kind:?}: after a count for {after} ms");
    }
}

/// A stop throws a spread back before the next motion has released its brake.
#[test]
fn count_without_a_drive_lets_a_stalled_motor_go_on() {
    let close =
        |bench: &mut Bench| bench.servo.command(Command::TorqueControlled { way: Way::Closing }).unwrap();
    for kind in KINDS {
        for brake_releases in [false, true] {
            let mut bench = blocked(kind);
            close(&mut bench);
            while bench.servo.telemetry().mode != Mode::Idle {
                bench.tick();
            }
            if brake_releases {
                close(&mut bench);
            }
            bench.tick_to(-1);
            close(&mut bench);
            let (_, after) = driven(&mut bench, 200, |_, _| ());
            assert!(after >= 150, "{kind:?}, {brake_releases}: for {after} ms");
        }
    }
}

#[test]
fn homing_right_after_a_stall_rests_and_finds_its_stop() {
    for kind in KINDS {
        let mut bench = blocked(kind);
        let way = Way::closing_if(bench.servo.config().ivel > 0);
        bench.servo.command(Command::TorqueControlled { way }).unwrap();
        while bench.servo.telemetry().mode != Mode::Idle {
            bench.tick();
        }
        bench.servo.command(Command::Home).unwrap();
        let found = (0..2000).any(|_| {
            bench.tick();
            matches!(bench.servo.motion, Motion::Home { stage: Homing::Leave { .. }, .. })
        });
        assert!(found, "{kind:?}: {:?}", bench.servo.motion);
    }
}

#[test]
fn load_that_shakes_the_rotor_does_not_keep_a_move_waiting() {
    for kind in KINDS {
        for (end, around) in [(200, 40), (40, 50), (40, 40)] {
            let mut bench = Bench::new(kind);
            let config = Config { bt: 0, ..kind.config() };
            bench.servo.command(Command::Configure(config)).unwrap();
            bench.servo.command(Command::Move(end)).unwrap();
            // Counts come every 50 ms, and never nearer to the end.
            let ticks = (1_usize..20_000).find(|tick| {
                let free = bench.servo.telemetry().setpoint.round().min(around);
                bench.tick_to((free - [0, 3][tick / 50 % 2]).max(bench.count - 1).min(bench.count + 1));
                bench.servo.telemetry().end.is_some()
            });
            assert!(ticks.is_some_and(|ms| ms <= 6000), "{kind:?} to {end}: {ticks:?}");
        }
    }
}

type End = (&'static str, fn(&mut Bench));

#[test]
fn end_of_a_motion_clears_v() {
    let v = CountsPerSec::from_int(80);
    let ends: [End; 6] = [
        ("MODE 0", |bench| bench.servo.command(Command::Mode(Mode::Idle)).unwrap()),
        ("MODE 3", |bench| bench.servo.command(Command::Mode(Mode::Pid)).unwrap()),
        ("T", |bench| bench.servo.command(Command::Terminate).unwrap()),
        ("MODE 5", |bench| bench.servo.command(Command::Mode(Mode::Trapezoidal)).unwrap()),
        ("host lost", |bench| {
            bench.host_lost = true;
            bench.tick();
            bench.host_lost = false;
            bench.servo.command(Command::ClearFault).unwrap();
        }),
        ("stall", |bench| {
            bench.servo.command(Command::Velocity(CountsPerSec::from_int(900))).unwrap();
            for _ in 0..1000 {
                bench.tick();
            }
        }),
    ];
    for kind in KINDS {
        for (name, end) in ends {
            for hold in [false, true] {
                let mut bench = Bench::new(kind);
                let config = Config { hold, ..kind.config() };
                bench.servo.command(Command::Configure(config)).unwrap();
                bench.servo.command(Command::Velocity(v)).unwrap();
                assert_eq!(bench.servo.velocity_wanted(), v, "pending");
                bench.servo.command(Command::Mode(Mode::Velocity)).unwrap();
                for _ in 0..50 {
                    bench.tick();
                }
                assert_eq!(bench.servo.telemetry().setpoint_velocity, v, "SET V, then MODE 4");
                end(&mut bench);
                assert_eq!(bench.servo.velocity_wanted(), CountsPerSec::ZERO, "{kind:?} {name}");
                bench.servo.command(Command::Mode(Mode::Velocity)).unwrap();
                for _ in 0..50 {
                    bench.tick();
                }
                let status = bench.servo.telemetry();
                assert_eq!(status.setpoint_velocity, CountsPerSec::ZERO, "{name}");
                // What mode 4 may carry of a load at most; 80 counts/s would take 160 units.
                assert!(status.torque.saturating_abs() <= Torque(40), "{kind:?} {name}: {:?}", status.torque);
            }
        }
    }
}

#[test]
fn hold_at_its_end_is_not_driven_on_the_boundary_of_its_cell() {
    for kind in KINDS {
        for end in [200, -200] {
            let mut bench = blocked(kind);
            let config = Config { hold: true, ..*bench.servo.config() };
            bench.servo.command(Command::Configure(config)).unwrap();
            bench.servo.command(Command::Move(end)).unwrap();
            let most = usize::from(config.tstop) + 1000;
            let stalled = (0..most).any(|_| {
                bench.tick();
                bench.servo.telemetry().end == Some(EndReason::Stalled)
            });
            assert!(stalled, "{kind:?} {end}");
            // Half a count is the largest that a rest here can be from its middle, either way.
            for sixteenths in -8..=7 {
                let place = Counts(fixed::types::I22F10::from_num(sixteenths) / 16);
                bench.servo.position = bench.servo.cell().wrapping_add(place);
                assert_eq!(
                    bench.servo.drives(bench.servo.demand().pushes, config.tstop),
                    None,
                    "{kind:?} {end} {sixteenths}/16"
                );
            }
        }
    }
}
