//! A host that starts motions faster than they can run must not disable the guards.

use super::*;

fn pushing() -> Bench {
    let mut bench = Bench::new(Joint::Link);
    bench.servo.command(Command::Mode(Mode::Torque)).unwrap();
    bench.servo.command(Command::Torque(Torque(700))).unwrap();
    assert!(bench.tick().duty.is_some_and(|duty| duty > Duty::ZERO));
    bench
}

fn restarted(bench: &mut Bench) -> (bool, Drive) {
    let taken = bench.servo.command(Command::Mode(Mode::Pid)).is_ok()
        && bench.servo.command(Command::Move(50)).is_ok();
    (taken, bench.tick())
}

#[test]
fn restart_in_every_tick_does_not_hide_over_temperature() {
    let mut bench = pushing();
    bench.motor_temp = DeciCelsius(900);
    let most = usize::from(crate::guard::thermal::TICKS) + 1;
    let hot = (1..=2000).find(|_| {
        restarted(&mut bench);
        bench.servo.telemetry().fault == Some(Fault::OverTemperature)
    });
    assert!(hot.is_some_and(|ticks| ticks <= most), "{hot:?}");
}

/// Each motion begins at rest: it gets no more than the friction, 65 units, and the first tick of ACCEL 40, 1.53 counts/s at 91 counts/s²
/// a unit, 17 units.
#[test]
fn restart_in_every_tick_drops_the_old_torque() {
    let mut bench = pushing();
    for tick in 0..100 {
        let (taken, drive) = restarted(&mut bench);
        assert!(taken && drive.duty.is_some());
        let torque = bench.servo.telemetry().torque;
        assert!(torque <= Torque(82), "tick {tick}: {torque:?}");
    }
    while bench.servo.event().is_some() {}
    assert_eq!(bench.follow(2000), Some(EndReason::Arrived));
}

#[test]
fn cleared_fault_is_measured_again_before_it_latches() {
    let mut bench = pushing();
    bench.motor_temp = DeciCelsius(900);
    for _ in 0..crate::guard::thermal::TICKS {
        bench.tick();
    }
    assert_eq!(bench.servo.telemetry().fault, Some(Fault::OverTemperature));
    bench.motor_temp = DeciCelsius(300);
    bench.servo.command(Command::ClearFault).unwrap();
    bench.servo.command(Command::Move(50)).unwrap();
    bench.tick();
    assert_eq!(bench.servo.telemetry().fault, None);
}

#[test]
fn hold_waits_for_the_brake() {
    let mut bench = Bench::new(Joint::Spread);
    bench.servo.command(Command::Move(50)).unwrap();
    for _ in 0..10 {
        bench.tick();
    }
    bench.servo.command(Command::Mode(Mode::Pid)).unwrap();
    assert_eq!(bench.servo.telemetry().mode, Mode::Pid);
    let brake = bench.servo.config().brake_ms;
    for tick in 10..brake {
        assert_eq!(bench.tick(), Drive { duty: None, brake_released: true }, "tick {tick}");
    }
    assert!(bench.tick().duty.is_some());
}
