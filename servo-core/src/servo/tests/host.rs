//! The host's silence, its readings, and a stored position.

use super::*;

#[test]
fn lost_host_ends_modes_2_and_4_of_a_host_only_and_forbids_nothing() {
    let orders = [
        (Command::Mode(Mode::Torque), true),
        (Command::Mode(Mode::Velocity), true),
        (Command::Mode(Mode::Pid), false),
        (Command::Mode(Mode::Trapezoidal), false),
        (Command::Move(100), false),
        (Command::TorqueControlled { way: Way::Closing }, false),
        (Command::TorqueControlled { way: Way::Opening }, false),
        (Command::Home, false),
    ];
    for joint in [Joint::Link, Joint::Spread, Joint::Tip] {
        for (order, needs_host) in orders {
            // Also while the brake releases, and after V has taken over from TC.
            for (ticks, takes_over) in [(0, false), (1, false), (40, false), (40, true)] {
                let mut bench = Bench::new(joint);
                bench.servo.command(Command::End(100)).unwrap();
                bench.servo.command(order).unwrap();
                for _ in 0..ticks {
                    bench.tick();
                }
                let takes_over = takes_over && matches!(order, Command::TorqueControlled { .. });
                if takes_over {
                    bench.servo.command(Command::Velocity(CountsPerSec::from_int(50))).unwrap();
                }
                let before = bench.servo.telemetry().mode;
                bench.host_lost = true;
                bench.tick();
                let status = bench.servo.telemetry();
                let expected = if needs_host || takes_over {
                    (Mode::Idle, Some(Fault::HostLost))
                } else {
                    (before, None)
                };
                assert_eq!((status.mode, status.fault), expected, "{order:?} after {ticks} ticks");
                bench.host_lost = false;
                assert_eq!(bench.servo.command(order), Ok(()), "{order:?}");
                assert_eq!(bench.servo.telemetry().fault, None, "{order:?}");
            }
        }
    }
}

#[test]
fn lost_host_is_cleared_by_an_order_and_replaced_by_another_fault() {
    let lost = || {
        let mut bench = Bench::in_mode(Mode::Velocity);
        bench.host_lost = true;
        bench.tick();
        bench.host_lost = false;
        bench
    };
    for order in [Command::Mode(Mode::Idle), Command::Terminate, Command::ClearFault] {
        let mut bench = lost();
        bench.servo.command(order).unwrap();
        assert_eq!(bench.servo.telemetry().fault, None, "{order:?}");
    }
    for no_order in [Command::End(3), Command::Velocity(CountsPerSec::ZERO), Command::ClearBreakaway] {
        let mut bench = lost();
        bench.servo.command(no_order).unwrap();
        assert_eq!(bench.servo.telemetry().fault, Some(Fault::HostLost), "{no_order:?}");
    }
    let mut bench = lost();
    bench.servo.host_is_back();
    assert_eq!(bench.servo.telemetry().fault, None, "an order that the servo does not see");
    let mut bench = lost();
    bench.servo.bridge_fault();
    bench.tick();
    assert_eq!(bench.servo.telemetry().fault, Some(Fault::Bridge));
    let refused = Err(Refusal::Fault(Fault::Bridge));
    assert_eq!(bench.servo.command(Command::Mode(Mode::Velocity)), refused);
}

#[test]
fn torque_reads_as_commanded_unless_a_limit_reduces_it() {
    let mut bench = Bench::in_mode(Mode::Torque);
    bench.servo.command(Command::Torque(Torque(300))).unwrap();
    bench.tick();
    assert_eq!(bench.servo.torque(), Torque(300));
    bench.servo.command(Command::Torque(Torque(-990))).unwrap();
    assert_eq!(bench.servo.torque(), Torque(-750), "MT, before the first tick");
    bench.tick();
    assert_eq!(bench.servo.torque(), Torque(-512), "the supply is loaded by steps");
    for _ in 0..20 {
        bench.tick();
    }
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

#[test]
fn position_is_unknown_after_an_uncertain_step() {
    for uncertain in [false, true] {
        let mut servo = Servo::new(Joint::Tip.config(), 0);
        servo.trust_position();
        let way = Way::Closing;
        let step =
            HallEdge { count: 2, steps: 2, way, at: Micros(9), rising: true, bounce: false, uncertain };
        servo.hall(&HallEvent::Step(step));
        assert_eq!(servo.telemetry().homed, !uncertain);
    }
}
