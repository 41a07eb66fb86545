//! ERROR: every fault of the application can be provoked, idles the motor if it should, and is cleared by
//! STAT 2.

use super::board::Bench;
use crate::SetError;
use crate::codes::fault_code;
use boot::storage::Progress;
use servo_core::Refusal;
use servo_core::guard::fault::Fault;
use servo_core::mode::Mode;
use servo_core::sense::commutation::Bridge;
use servo_core::units::{Counts, DeciCelsius, MilliAmps, MilliVolts};
use tater_wire::{Body, Destination, FaultCode, Group, Node, Property, fault};

/// HOSTMS of a board on which nothing has been set.
const HOSTMS: usize = 2000;

fn draw_too_much(bench: &mut Bench) {
    bench.set(Property::MODE, 2).expect("mode 2");
    bench.set(Property::T, 600).expect("mode 2");
    bench.ticks(35);
    for _ in 0..6 {
        // 15.5 A in the phases, of which the supply carries the duty's share.
        let duty = i32::from(bench.tater.status().duty.0.to_bits());
        let bus = i16::try_from(15_500 * duty / 32_768).expect("below 15.5 A");
        bench.board().analog.current = MilliAmps(bus);
        bench.tick();
    }
}

fn run_the_wrong_way(bench: &mut Bench) {
    // Another wiring has not been seen to be right.
    bench.unlock();
    bench.set(Property::WIRING, 4).expect("in idle");
    bench.set(Property::MODE, 2).expect("mode 2");
    bench.set(Property::T, 60).expect("mode 2");
    bench.ticks(40);
    let count = bench.count;
    for wrong in 1..=5 {
        bench.tick_to(count - wrong);
    }
    bench.ticks(202);
}

/// Drives the board into a fault; `false` for faults of the monitor. The match is exhaustive: a new row needs
/// its provocation.
fn provoke(bench: &mut Bench, fault: FaultCode) -> bool {
    match fault {
        FaultCode::Halls => {
            bench.board().halls = 7;
            bench.ticks(4);
        }
        FaultCode::OverCurrent => draw_too_much(bench),
        FaultCode::OverTemperature => {
            bench.board().analog.motor_temp = DeciCelsius(700);
            // The temperature is judged each 16 ms.
            bench.ticks(16);
        }
        FaultCode::OverVoltage => {
            bench.board().analog.bus = MilliVolts(32_100);
            bench.ticks(10);
        }
        FaultCode::UnderVoltage => {
            bench.board().analog.bus = MilliVolts(15_900);
            bench.ticks(10);
        }
        FaultCode::Bridge => {
            bench.board().analog.bridge_fault = true;
            bench.tick();
        }
        FaultCode::HostLost => {
            bench.set(Property::MODE, 4).expect("mode 4");
            bench.ticks(HOSTMS + 1);
        }
        FaultCode::Wiring => run_the_wrong_way(bench),
        FaultCode::Jammed => {
            // A rotor that never turns: it stalls at a stop, and when it is to leave it.
            bench.set(Property::CMD, 13).expect("HI");
            for _ in 0..20 {
                bench.ticks(100);
                let _ = bench.get(Property::MODE);
            }
        }
        FaultCode::Storage => {
            bench.board().flash.broken = true;
            bench.set(Property::X0, 1).expect("in range");
            bench.set(Property::SAVE, -1).expect("stored");
            for _ in 0..1000 {
                match bench.tater.store() {
                    Progress::Failed(_) => break,
                    Progress::Waiting => bench.ticks(1),
                    Progress::Done | Progress::More => {}
                }
            }
            bench.board().flash.broken = false;
        }
        FaultCode::NoApplication
        | FaultCode::BadRecord
        | FaultCode::BadChecksum
        | FaultCode::AddressRange
        | FaultCode::Overlap
        | FaultCode::FlashWrite
        | FaultCode::BadImage
        | FaultCode::DownloadTimeout
        | FaultCode::Watchdog
        | FaultCode::Panic
        | FaultCode::HardFault
        | FaultCode::Clock => return false,
    }
    true
}

/// A spike flips each line in turn. The edge interrupt may have read one of them, which shows code 0.
#[test]
fn spike_at_each_tick_is_no_fault_and_no_count() {
    let mut bench = Bench::new(4);
    bench.tick();
    let code = bench.board().halls;
    bench.board().halls = 0;
    let now = bench.now();
    bench.tater.hall(now);
    for tick in 0..30 {
        bench.board().halls = code ^ [1, 4, 2][tick % 3];
        bench.tick();
    }
    assert_eq!(bench.get(Property::ERROR), Some(0));
    assert_eq!(bench.tater.status().position, Counts::ZERO);
}

#[test]
fn every_application_fault_is_raised_named_and_cleared() {
    let mut provoked = 0;
    for row in fault::ROWS {
        let mut bench = Bench::new(4);
        let healthy = *bench.board().analog_mut();
        bench.tick();
        assert_eq!(bench.get(Property::ERROR), Some(0));
        if !provoke(&mut bench, row.code) {
            continue;
        }
        provoked += 1;
        assert_eq!(bench.get(Property::ERROR), Some(i64::from(row.code.code())), "{}", row.name);
        assert_eq!(bench.get(Property::STAT), Some(2), "{}", row.name);
        assert_eq!((bench.tater.status().mode, bench.board().brake_released), (Mode::Idle, false));
        // The next order clears a lost host.
        let forbids = bench.tater.status().fault.filter(|&fault| fault != Fault::HostLost);
        let refused = forbids.map(|fault| Err(SetError::Servo(Refusal::Fault(fault))));
        assert_eq!(bench.set(Property::M, 20), refused.unwrap_or(Ok(())), "{}", row.name);
        *bench.board().analog_mut() = healthy;
        let count = bench.count;
        bench.board().turn_to(count);
        bench.set(Property::STAT, 2).expect("clears");
        bench.tick();
        assert_eq!(bench.get(Property::ERROR), Some(0), "{}", row.name);
        assert_eq!(bench.set(Property::M, 30), Ok(()), "{}", row.name);
    }
    // The servo's nine, and the flash.
    assert_eq!(provoked, 10);
}

/// A host that clears a fault and continues without checking drives nothing while the cause persists.
#[test]
fn persistent_fault_returns_before_anything_is_driven() {
    let lasting = [
        FaultCode::Halls,
        FaultCode::OverTemperature,
        FaultCode::OverVoltage,
        FaultCode::UnderVoltage,
        FaultCode::Bridge,
    ];
    for fault in lasting {
        let mut bench = Bench::new(1);
        bench.tick();
        assert!(provoke(&mut bench, fault));
        for ticks in 0..39 {
            bench.set(Property::STAT, 2).expect("clears");
            bench.set(Property::M, 200).expect("nothing is latched");
            for _ in 0..ticks % 13 {
                assert_eq!(bench.tick().duty, None, "{fault:?}");
            }
        }
        assert_eq!(bench.get(Property::ERROR), Some(i64::from(fault.code())));
    }
}

#[test]
fn first_fault_stays_latched() {
    let mut bench = Bench::new(1);
    provoke(&mut bench, FaultCode::OverVoltage);
    provoke(&mut bench, FaultCode::Bridge);
    provoke(&mut bench, FaultCode::Storage);
    assert_eq!(bench.get(Property::ERROR), Some(4));
    bench.board().analog.bridge_fault = false;
    bench.board().analog.bus = MilliVolts(24_000);
    bench.set(Property::STAT, 2).expect("clears");
    bench.tick();
    assert_eq!(bench.get(Property::ERROR), Some(0));
}

#[test]
fn flash_fault_does_not_affect_the_motion() {
    let mut bench = Bench::new(4);
    bench.set(Property::SAVE, -1).expect("stored");
    bench.settle();
    bench.set(Property::M, 100).expect("moves");
    bench.ticks(60);
    provoke(&mut bench, FaultCode::Storage);
    assert_eq!(bench.get(Property::ERROR), Some(8));
    assert!(bench.tick().duty.is_some());
    assert_eq!(bench.tater.status().mode, Mode::Trapezoidal);
}

#[test]
fn break_input_keeps_the_bridge_off_and_raises_a_fault_at_the_next_tick() {
    let mut bench = Bench::new(4);
    bench.set(Property::M, 100).expect("moves");
    bench.ticks(60);
    assert_ne!(bench.board().bridge, Bridge::Off);
    bench.tater.bridge_fault();
    assert_eq!(bench.board().bridge, Bridge::Off);
    for count in 1..5 {
        bench.board().turn_to(count);
        let now = bench.now;
        bench.tater.hall(now);
        assert_eq!(bench.board().bridge, Bridge::Off, "edge {count}");
    }
    bench.set(Property::STAT, 2).expect("clears");
    assert_eq!(bench.tick_to(0).duty, None);
    assert_eq!((bench.get(Property::ERROR), bench.tater.status().mode), (Some(6), Mode::Idle));
    bench.set(Property::STAT, 2).expect("clears");
    bench.set(Property::M, 100).expect("moves");
    bench.ticks(60);
    assert_ne!(bench.board().bridge, Bridge::Off, "once");
}

/// Every order × motor kind: only modes 2 and 4 that a host has set need it. Pressing after TC counts as TC.
#[test]
fn host_is_lost_after_hostms_in_modes_2_and_4_that_it_set() {
    let modes = [2, 3, 4, 5].map(|mode| (Property::MODE, mode));
    let cmds = tater_wire::command::ROWS.iter().map(|row| (Property::CMD, i64::from(row.number)));
    let resets = i64::from(tater_wire::Cmd::Reset);
    for (property, value) in modes.into_iter().chain(cmds).chain([(Property::M, 60)]) {
        if (property, value) == (Property::CMD, resets) {
            continue;
        }
        for straps in [1, 4, 5] {
            // A motor that is stuck on its way and never stalls.
            let mut bench = Bench::new(straps);
            bench.set(Property::TSTOP, 0).expect("never");
            bench.set(Property::E, 100).expect("in range");
            bench.set(property, value).expect("an order");
            bench.ticks(HOSTMS);
            let lost = |bench: &Bench| bench.tater.status().fault == Some(Fault::HostLost);
            assert!(!lost(&bench), "{property:?} {value} on {straps}");
            bench.tick();
            let needs = property == Property::MODE && (value == 2 || value == 4);
            assert_eq!(lost(&bench), needs, "{property:?} {value} on {straps}");
            bench.ticks(2 * HOSTMS);
            assert_eq!(lost(&bench), needs, "{property:?} {value} on {straps}");
            if needs {
                assert_eq!(bench.tater.drive().duty, None);
                assert_eq!(bench.get(Property::ERROR), Some(7));
                assert_eq!(bench.set(property, value), Ok(()), "does not latch");
                assert_eq!(bench.get(Property::ERROR), Some(0));
                assert_eq!(bench.get(Property::MODE), Some(value));
            }
        }
    }
}

#[test]
fn every_mode_and_cmd_clears_a_lost_host() {
    let lost = |straps| {
        let mut bench = Bench::new(straps);
        bench.set(Property::MODE, 4).expect("mode 4");
        bench.ticks(HOSTMS + 1);
        assert_eq!(bench.get(Property::ERROR), Some(7));
        bench
    };
    let modes = [0, 2, 3, 4, 5].map(|mode| (Property::MODE, mode));
    let cmds = tater_wire::command::ROWS.iter().map(|row| (Property::CMD, i64::from(row.number)));
    for (property, value) in modes.into_iter().chain(cmds).chain([(Property::M, 20), (Property::STAT, 2)]) {
        for straps in [1, 4, 5] {
            let mut bench = lost(straps);
            bench.set(property, value).expect("nothing is latched");
            assert_eq!(bench.get(Property::ERROR), Some(0), "{property:?} {value} on {straps}");
        }
    }
    // Others do not, or a host would never read it.
    for (property, value) in [(Property::E, 5), (Property::V, 20), (Property::TSTOP, 0), (Property::HOLD, 1)]
    {
        let mut bench = lost(1);
        bench.set(property, value).expect("in range");
        assert_eq!(bench.get(Property::ERROR), Some(7), "{property:?}");
    }
}

#[test]
fn hostms_sets_the_time_of_the_host_watchdog_is_stored_and_0_disables_it() {
    for hostms in [1, 100, 2000, 2001, 65_535] {
        let mut bench = Bench::new(1);
        bench.set(Property::HOSTMS, hostms).expect("in range");
        bench.set(Property::SAVE, Property::HOSTMS.id().into()).expect("stored");
        bench.settle();
        let mut bench = bench.restart();
        bench.set(Property::MODE, 4).expect("mode 4");
        bench.ticks(usize::try_from(hostms).expect("positive"));
        assert_eq!(bench.tater.status().fault, None, "{hostms}");
        bench.tick();
        assert_eq!(bench.tater.status().fault, Some(Fault::HostLost), "{hostms}");
    }
    let mut bench = Bench::new(1);
    bench.set(Property::MODE, 4).expect("mode 4");
    bench.set(Property::HOSTMS, 0).expect("in range");
    bench.ticks(200_000);
    assert_eq!((bench.tater.status().mode, bench.tater.status().fault), (Mode::Velocity, None));
}

/// Every fault of the application × motor kind. After a fault libbarrett's mode 3 is refused, and its next P meant a goal.
#[test]
fn set_of_p_in_idle_is_refused_while_error_is_not_0() {
    for row in fault::ROWS {
        for straps in [1, 4, 5] {
            let mut bench = Bench::new(straps);
            let healthy = *bench.board().analog_mut();
            bench.tick();
            if !provoke(&mut bench, row.code) {
                continue;
            }
            let position = bench.get(Property::P);
            for value in [135, -1, 0] {
                assert_eq!(bench.set(Property::P, value), Err(SetError::Fault(row.code)), "{}", row.name);
                assert_eq!(bench.get(Property::P), position, "{} on {straps}", row.name);
            }
            assert_eq!(bench.set(Property::LOAD, Property::P.id().into()), Err(SetError::Fault(row.code)));
            *bench.board().analog_mut() = healthy;
            let count = bench.count;
            bench.board().turn_to(count);
            bench.set(Property::STAT, 2).expect("clears");
            bench.tick();
            bench.set(Property::P, 12).expect("renames");
            assert_eq!(bench.get(Property::P), Some(12), "{}", row.name);
        }
    }
}

#[test]
fn set_of_p_in_mode_3_is_a_goal_also_after_a_flash_fault() {
    let mut bench = Bench::new(1);
    provoke(&mut bench, FaultCode::Storage);
    bench.set(Property::MODE, 3).expect("the flash does not stop the motor");
    assert_eq!(bench.set(Property::P, 40), Ok(()));
    // The set-point heads for it, up to where it waits for the rotor of this bench.
    bench.ticks(100);
    assert!((5..10).contains(&bench.tater.status().setpoint.round()));
}

#[test]
fn frame_to_the_board_or_its_groups_feeds_the_host_watchdog() {
    let group = |number| Destination::Group(Group::new(number).expect("a group"));
    let node = |number| Destination::Node(Node::new(number).expect("a node"));
    let rows = [(node(1), true), (group(0), true), (group(1), true), (group(4), true)];
    let others = [(node(2), false), (node(0), false), (group(2), false), (group(6), false)];
    for (to, is_life) in rows.into_iter().chain(others) {
        let mut bench = Bench::new(1);
        bench.set(Property::MODE, 2).expect("mode 2");
        for _ in 0..4 {
            bench.ticks(HOSTMS - 100);
            let _ = bench.say(to, 0, Body::Get(127));
        }
        assert_eq!(bench.tater.status().fault.is_none(), is_life, "{to:?}");
    }
}

#[test]
fn servo_faults_have_distinct_rows() {
    let all = [
        Fault::Halls,
        Fault::OverCurrent,
        Fault::OverTemperature,
        Fault::OverVoltage,
        Fault::UnderVoltage,
        Fault::Bridge,
        Fault::HostLost,
        Fault::Jammed,
    ];
    for (i, one) in all.into_iter().enumerate() {
        assert_eq!(fault_code(one).row().code, fault_code(one));
        assert!(all[..i].iter().all(|&other| fault_code(other) != fault_code(one)), "{one:?}");
    }
}
