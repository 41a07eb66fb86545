//! Reading and writing STAT, MODE, T, V, P and E.

use super::board::Bench;
use crate::SetError;
use crate::board::Analog;
use crate::codes::mode_code;
use servo_core::mode::Mode;
use servo_core::sense::commutation;
use servo_core::units::{CountsPerSec, DeciCelsius, Micros, MilliAmps, MilliVolts};
use servo_core::{EndReason, Refusal};
use tater_wire::Property;

#[test]
fn stat_reads_ready_wakes_resets_and_refuses_1() {
    let mut bench = Bench::new(1);
    assert_eq!(bench.get(Property::STAT), Some(2));
    assert_eq!(bench.set(Property::STAT, 2), Ok(()));
    assert_eq!(bench.set(Property::STAT, 1), Err(SetError::Range(Property::STAT)));
    assert_eq!(bench.set(Property::STAT, 3), Err(SetError::Range(Property::STAT)));
    assert!(bench.board().resets.is_empty());
}

#[test]
fn reset_switches_bridge_off_engages_brake_and_keeps_saved_values() {
    for (property, value) in [(Property::STAT, 0), (Property::CMD, 2)] {
        let mut bench = Bench::new(4);
        bench.set(Property::LFLAGS, 1).expect("in range");
        bench.set(Property::X3, 77).expect("in range");
        bench.set(Property::SAVE, i64::from(Property::X3.id())).expect("stored");
        bench.set(Property::M, 100).expect("moves");
        bench.ticks(60);
        assert!(bench.tater.drive().duty.is_some() && bench.board().brake_released);
        bench.set(property, value).expect("resets");
        assert_eq!(bench.board().resets, [(false, false)]);
        bench.tick();
        // MODE and END of the aborted move, before the reset; nothing after it.
        assert_eq!((bench.board().sent_at_reset, bench.said().len()), (2, 2));
        assert_eq!((bench.tater.drive().duty, bench.tater.status().mode), (None, Mode::Idle));
        assert_eq!(bench.restart().get(Property::X3), Some(77));
    }
}

#[test]
fn unknown_mode_is_refused() {
    let mut bench = Bench::new(1);
    for mode in [1, 6, -1] {
        assert_eq!(bench.set(Property::MODE, mode), Err(SetError::Range(Property::MODE)));
        assert_eq!(bench.get(Property::MODE), Some(0));
    }
    for mode in [2, 3, 4, 5, 0] {
        assert_eq!(bench.set(Property::MODE, mode), Ok(()));
        assert_eq!(bench.get(Property::MODE), Some(mode));
    }
}

#[test]
fn torque_is_set_in_mode_2_only_and_reads_after_the_limits() {
    let mut bench = Bench::new(1);
    for mode in [Mode::Idle, Mode::Pid, Mode::Velocity, Mode::Trapezoidal] {
        bench.set(Property::MODE, mode_code(mode).into()).expect("a mode");
        assert_eq!(bench.set(Property::T, 10), Err(SetError::Servo(Refusal::Mode(mode))));
    }
    bench.set(Property::MODE, 2).expect("mode 2");
    assert_eq!(bench.get(Property::T), Some(0));
    bench.set(Property::T, -200).expect("mode 2");
    assert_eq!(bench.get(Property::T), Some(-200));
    bench.tick();
    assert_eq!(bench.get(Property::T), Some(-200));
    // OTEMP 700 allows a quarter of 990 at 68 °C.
    bench.set(Property::T, 700).expect("mode 2");
    bench.board().analog.motor_temp = DeciCelsius(680);
    // The temperature is judged each 16 ms.
    bench.ticks(16);
    assert_eq!(bench.get(Property::T), Some(247));
    bench.set(Property::MODE, 0).expect("idle");
    bench.tick();
    assert_eq!(bench.get(Property::T), Some(0), "in idle nothing is applied");
}

#[test]
fn velocity_reads_the_command_in_mode_4_and_the_rotor_elsewhere() {
    let mut bench = Bench::new(1);
    bench.set(Property::V, -321).expect("written beforehand");
    assert_eq!(bench.get(Property::V), Some(0));
    bench.set(Property::MODE, 4).expect("mode 4");
    assert_eq!(bench.get(Property::V), Some(-321));
    bench.set(Property::MODE, 3).expect("mode 3");
    for _ in 0..60 {
        bench.ticks(4);
        let count = bench.count;
        bench.tick_to(count + 1);
    }
    let measured = i64::from(bench.tater.status().velocity.round());
    // A count each 5.1 ms.
    assert!((150..250).contains(&measured), "{measured}");
    assert_eq!(bench.get(Property::V), Some(measured));
    assert_ne!(bench.tater.status().velocity, CountsPerSec::ZERO);
}

#[test]
fn position_renames_in_idle_and_is_the_goal_in_mode_3() {
    let mut bench = Bench::new(1);
    bench.tick_to(12);
    assert_eq!((bench.get(Property::P), bench.get(Property::MECH)), (Some(12), Some(12)));
    bench.set(Property::P, -33).expect("idle");
    assert_eq!(bench.get(Property::P), Some(-33));
    bench.tick_to(0);
    bench.tick_to(-9);
    assert_eq!((bench.get(Property::P), bench.get(Property::MECH)), (Some(-54), Some(9)));
    bench.set(Property::MODE, 3).expect("mode 3");
    bench.tick();
    bench.set(Property::P, 34).expect("mode 3");
    bench.ticks(100);
    // The set-point heads for it, up to where it waits for the rotor of this bench.
    assert!((-49..-44).contains(&bench.tater.status().setpoint.round()));
    assert_eq!(bench.get(Property::P), Some(-54));
    for mode in [Mode::Torque, Mode::Velocity, Mode::Trapezoidal] {
        bench.set(Property::E, 0).expect("a goal after a refused P");
        bench.set(Property::MODE, mode_code(mode).into()).expect("a mode");
        assert_eq!(bench.set(Property::P, 5), Err(SetError::Servo(Refusal::Mode(mode))));
    }
}

#[test]
fn e_reads_as_set_and_m_is_e_and_mode_5_in_one() {
    let mut bench = Bench::new(1);
    bench.set(Property::P, 50).expect("idle");
    assert_eq!(bench.get(Property::E), Some(0));
    bench.set(Property::E, -22).expect("in range");
    assert_eq!((bench.get(Property::E), bench.get(Property::MODE)), (Some(-22), Some(0)));
    bench.set(Property::M, 60).expect("in range");
    assert_eq!((bench.get(Property::E), bench.get(Property::MODE)), (Some(60), Some(5)));
    assert_eq!(bench.get(Property::END), Some(0), "it has not ended");
    bench.follow(5_000);
    assert_eq!(bench.tater.status().end, Some(EndReason::Arrived));
    assert_eq!((bench.get(Property::END), bench.get(Property::P)), (Some(1), Some(60)));
}

#[test]
fn halls_and_hallh_read_the_last_ten_codes() {
    let mut bench = Bench::new(1);
    assert_eq!((bench.get(Property::HALLS), bench.get(Property::HALLH)), (Some(2), Some(2)));
    bench.tick_to(12);
    bench.tick_to(11);
    // Codes of counts 3, 4, ... 12, 11: the oldest of eleven has dropped out.
    let history = [1, 3, 2, 6, 4, 5, 1, 3, 2, 3].into_iter().fold(0, |all, code| all << 3 | code);
    assert_eq!((bench.get(Property::HALLS), bench.get(Property::HALLH)), (Some(3), Some(history)));
}

#[test]
fn hallh_bit_30_is_set_while_the_position_is_known() {
    let known = |bench: &mut Bench| bench.get(Property::HALLH).map(|bits| bits >> 30);
    let mut bench = Bench::new(1);
    assert_eq!(known(&mut bench), Some(0), "after power-up");
    bench.tick_to(12);
    assert_eq!(known(&mut bench), Some(0));
    bench.home();
    assert_eq!(known(&mut bench), Some(1), "after HI");
    bench.set(Property::CMD, 13).expect("HI");
    assert_eq!(known(&mut bench), Some(0), "HI has begun again");
}

#[test]
fn hall_edge_is_commutated_at_once() {
    let mut bench = Bench::new(1);
    bench.set(Property::MODE, 2).expect("mode 2");
    bench.set(Property::T, 300).expect("mode 2");
    bench.tick();
    let duty = bench.tater.drive().duty;
    for sector in [0, 1, 2, 3, 4, 5, 0] {
        bench.board().turn_to(sector);
        bench.now = bench.now.wrapping_add(Micros(300));
        let now = bench.now;
        bench.tater.hall(now);
        let sector = u8::try_from(sector).expect("a sector");
        assert_eq!(bench.board().bridge, commutation::bridge(Some(sector), duty));
    }
}

#[test]
fn measurements_read_in_their_units() {
    let mut bench = Bench::new(1);
    *bench.board().analog_mut() = Analog {
        bus: MilliVolts(23_950),
        current: MilliAmps(-1234),
        motor_temp: DeciCelsius(451),
        board_temp: DeciCelsius(-17),
        strain: 201,
        raw: [4095, 7],
        bridge_fault: false,
    };
    for (property, value) in [
        (Property::VBUS, 240),
        (Property::IMOTOR, -1234),
        (Property::THERM, 451),
        (Property::TEMP, -17),
        (Property::SG, 201),
        (Property::ANA0, 4095),
        (Property::ANA1, 7),
    ] {
        assert_eq!(bench.get(property), Some(value), "{property:?}");
    }
}

#[test]
fn brake_reads_as_commanded() {
    let mut bench = Bench::new(4);
    assert_eq!(bench.get(Property::B), Some(0));
    bench.set(Property::MODE, 3).expect("mode 3");
    bench.tick();
    assert_eq!(bench.get(Property::B), Some(1));
}

#[test]
fn v_is_pending_until_a_motion_ends_and_no_host_inherits_it() {
    for node in [1, 4, 5] {
        let mut bench = Bench::new(node);
        // A rotor that is not simulated never moves.
        bench.set(Property::TSTOP, 0).expect("in range");
        bench.set(Property::V, 30).expect("in range");
        assert_eq!((bench.get(Property::VSET), bench.get(Property::V)), (Some(30), Some(0)), "pending");
        bench.set(Property::MODE, 4).expect("mode 4");
        bench.ticks(50);
        assert_eq!((bench.get(Property::VSET), bench.get(Property::V)), (Some(30), Some(30)));
        bench.ticks(2001);
        assert_eq!(bench.get(Property::ERROR), Some(7), "the host is lost");
        assert_eq!(bench.get(Property::VSET), Some(0));
        bench.set(Property::STAT, 2).expect("clears");
        bench.set(Property::MODE, 4).expect("another host");
        for _ in 0..100 {
            bench.tick();
            assert_eq!(bench.tater.status().torque, servo_core::units::Torque::ZERO);
        }
    }
}
