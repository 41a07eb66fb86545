//! The host's silence, its readings, and a stored position.

use super::*;

#[test]
fn lost_host_is_a_fault_in_modes_2_and_4_only() {
    for mode in Mode::ALL {
        let mut bench = Bench::in_mode(mode);
        bench.host_lost = true;
        bench.tick();
        let status = bench.servo.telemetry();
        if matches!(mode, Mode::Torque | Mode::Velocity) {
            assert_eq!((status.mode, status.fault), (Mode::Idle, Some(Fault::HostLost)));
            assert_eq!(bench.servo.command(Command::Mode(mode)), Err(Refusal::Fault(Fault::HostLost)));
            bench.host_lost = false;
            bench.servo.command(Command::ClearFault).unwrap();
            assert_eq!(bench.servo.command(Command::Mode(mode)), Ok(()));
        } else {
            assert_eq!((status.mode, status.fault), (mode, None));
        }
    }
}

#[test]
fn torque_reads_as_commanded_unless_a_limit_reduces_it() {
    let mut bench = Bench::in_mode(Mode::Torque);
    bench.servo.command(Command::Torque(Torque(300))).unwrap();
    bench.tick();
    assert_eq!(bench.servo.torque(), Torque(300));
    bench.servo.command(Command::Torque(Torque(-990))).unwrap();
    bench.tick();
    assert_eq!(bench.servo.torque(), Torque(-750));
    // The thermistor 4 °C below OTEMP: half of 990.
    bench.motor_temp = DeciCelsius(660);
    for _ in 0..crate::guard::thermal::TICKS {
        bench.tick();
    }
    assert_eq!(bench.servo.torque(), Torque(-495));
    bench.servo.command(Command::Mode(Mode::Pid)).unwrap();
    bench.tick();
    assert_eq!(bench.servo.torque(), bench.servo.telemetry().torque);
}

#[test]
fn stored_position_can_be_trusted_and_e_reads_back() {
    let mut servo = Servo::new(Joint::Tip.config(), -120);
    assert!(!servo.telemetry().homed);
    servo.trust_position();
    assert_eq!((servo.telemetry().homed, servo.telemetry().position.round()), (true, -120));
    servo.doubt_position();
    assert_eq!((servo.telemetry().homed, servo.telemetry().position.round()), (false, -120));
    servo.command(Command::End(-7)).unwrap();
    assert_eq!(servo.end(), -7);
}
