//! HI: seeking the stop, leaving it, zero.

use super::*;

#[test]
fn homing_zeroes_at_ioff_from_the_stop() {
    let mut bench = Bench::new(Joint::Link);
    bench.servo.command(Command::End(77)).unwrap();
    bench.servo.command(Command::Home).unwrap();
    // The stop is 40 counts in the opening direction; 200 counts/s to it.
    for tick in 0..600 {
        let moved = i32::from(tick % 5 == 0);
        bench.tick_to((bench.count - moved).max(-40));
        if bench.servo.telemetry().mode != Mode::Velocity {
            break;
        }
    }
    assert_eq!(bench.follow(2000), Some(EndReason::Arrived));
    let status = bench.servo.telemetry();
    assert!(status.homed && status.mode == Mode::Idle);
    // IOFF 25 from the stop at −40.
    assert_eq!((bench.count, status.position.round()), (-15, 0));
    bench.servo.command(Command::Mode(Mode::Trapezoidal)).unwrap();
    assert_eq!(bench.follow(3000), Some(EndReason::Arrived), "E written before HI is kept");
    assert_eq!(bench.servo.telemetry().position.round(), 77);
}

#[test]
fn ioff_written_while_leaving_the_stop_replans_to_the_new_zero() {
    let mut bench = Bench::new(Joint::Link);
    bench.servo.command(Command::Home).unwrap();
    while bench.servo.telemetry().mode != Mode::Trapezoidal {
        bench.tick();
    }
    bench.follow(60);
    let config = Config { ioff: 40, ..*bench.servo.config() };
    bench.servo.command(Command::Configure(config)).unwrap();
    assert_eq!(bench.follow(2000), Some(EndReason::Arrived));
    assert_eq!((bench.count, bench.servo.telemetry().position.round()), (40, 0));
}

#[test]
fn homing_never_stalls_before_hosts_can_see_mode_4() {
    let mut bench = Bench::new(Joint::Link);
    let config = Config { tstop: 20, ..*bench.servo.config() };
    bench.servo.command(Command::Configure(config)).unwrap();
    bench.servo.command(Command::Home).unwrap();
    let left_at = (1..2000).find(|_| {
        bench.tick();
        bench.servo.telemetry().mode != Mode::Velocity
    });
    assert!((250..=253).contains(&left_at.unwrap()), "{left_at:?}");
}

/// Telemetry one second after HI with a blocked rotor.
fn pressed(config: impl FnOnce(Config) -> Config, meanwhile: impl FnOnce(Config) -> Config) -> Telemetry {
    let mut bench = Bench::new(Joint::Tip);
    let config = config(*bench.servo.config());
    bench.servo.command(Command::Configure(config)).unwrap();
    bench.servo.command(Command::Home).unwrap();
    bench.tick();
    bench.servo.command(Command::Configure(meanwhile(config))).unwrap();
    for _ in 0..1000 {
        if bench.tick().duty.is_none() || bench.servo.telemetry().mode == Mode::Trapezoidal {
            break;
        }
    }
    bench.servo.telemetry()
}

#[test]
fn stall_is_the_stop_only_at_full_homing_torque() {
    let same = |config| config;
    let leaves =
        |status: Telemetry| (status.mode, status.end, status.homed) == (Mode::Trapezoidal, None, false);
    let stays = |status: Telemetry| (status.mode, status.end) == (Mode::Idle, Some(EndReason::Stalled));
    assert!(leaves(pressed(same, same)));
    // 20 counts/s times 16 units per count/s are 320, of which IHIT lets 250 through.
    assert!(leaves(pressed(|c| Config { ivel: 20, kpv: 255, ..c }, same)));
    // 200 counts/s times 1 unit are 200, below IHIT.
    for kpv in [0, 1, 16] {
        let status = pressed(|c| Config { kpv, ..c }, same);
        assert!(stays(status) && !status.homed, "KPV {kpv}: {status:?}");
    }
    assert!(stays(pressed(same, |c| Config { ivel: 0, ..c })));
    assert!(stays(pressed(same, |c| Config { ihit: 0, ..c })));
    assert!(stays(pressed(same, |c| Config { mt: 20, ..c })));
}

#[test]
fn derated_motor_does_not_find_its_stop() {
    // Of 990 over 8 °C, half a degree below OTEMP leaves 61, and two degrees 247.
    for (motor_temp, found) in [(695, Mode::Idle), (680, Mode::Trapezoidal)] {
        let mut bench = Bench::new(Joint::Tip);
        bench.motor_temp = DeciCelsius(motor_temp);
        bench.servo.command(Command::Home).unwrap();
        for _ in 0..310 {
            bench.tick();
        }
        assert_eq!(bench.servo.telemetry().mode, found);
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
