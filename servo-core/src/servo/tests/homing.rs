//! HI: the stop, the way back from it, zero.

use super::*;

#[test]
fn homing_zeroes_at_the_stop_and_again_after_ioff() {
    let mut bench = Bench::new(MotorKind::Link);
    bench.servo.command(Command::End(77)).unwrap();
    bench.servo.command(Command::Home).unwrap();
    // The stop is 40 counts in the opening direction; 200 counts/s to it.
    for tick in 0..600 {
        let moved = i32::from(tick % 5 == 0);
        bench.tick_to((bench.count - moved).max(-40));
        if bench.servo.status().mode != Mode::Velocity {
            break;
        }
    }
    assert_eq!(bench.follow(2000), Some(EndReason::Arrived));
    let status = bench.servo.status();
    assert!(status.homed && status.mode == Mode::Idle);
    // IOFF 25 from the stop at −40.
    assert_eq!((bench.count, status.position.round()), (-15, 0));
    bench.servo.command(Command::Mode(Mode::Trapezoidal)).unwrap();
    assert_eq!(bench.follow(3000), Some(EndReason::Arrived), "E written before HI is kept");
    assert_eq!(bench.servo.status().position.round(), 77);
}

#[test]
fn homing_never_stalls_before_hosts_can_see_mode_4() {
    let mut bench = Bench::new(MotorKind::Link);
    let config = Config { tstop: 20, ..*bench.servo.config() };
    bench.servo.command(Command::Configure(config)).unwrap();
    bench.servo.command(Command::Home).unwrap();
    let left_at = (1..2000).find(|_| {
        bench.tick();
        bench.servo.status().mode != Mode::Velocity
    });
    assert!((250..=253).contains(&left_at.unwrap()), "{left_at:?}");
}

#[test]
fn homing_ends_at_a_stop_whatever_the_gain_and_needs_a_velocity() {
    let mut bench = Bench::new(MotorKind::Tip);
    let config = Config { kpv: 0, ivel: 20, ..*bench.servo.config() };
    bench.servo.command(Command::Configure(config)).unwrap();
    bench.servo.command(Command::Home).unwrap();
    for _ in 0..302 {
        bench.tick();
    }
    assert_eq!(bench.servo.status().mode, Mode::Trapezoidal, "on its way from the stop");
    bench.servo.command(Command::Terminate).unwrap();
    bench.servo.command(Command::Configure(Config { ivel: 0, ..config })).unwrap();
    assert_eq!(bench.servo.command(Command::Home), Err(Refusal::Range));
}
