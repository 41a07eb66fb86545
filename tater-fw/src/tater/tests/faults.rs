//! ERROR: every fault of the application can be provoked, idles the motor if it should, and is cleared by
//! STAT 2.

use super::board::Bench;
use crate::SetError;
use crate::codes::fault_code;
use crate::storage::Progress;
use crate::tater::HOST_TIMEOUT_MS;
use servo_core::Refusal;
use servo_core::guard::fault::Fault;
use servo_core::mode::Mode;
use servo_core::sense::commutation::Bridge;
use servo_core::units::{DeciCelsius, MilliAmps, MilliVolts};
use tater_wire::{Body, Destination, FaultCode, Group, Node, Property, fault};

/// Drives the board into a fault; `false` for faults of the monitor. The match is exhaustive: a new row needs
/// its provocation.
fn provoke(bench: &mut Bench, fault: FaultCode) -> bool {
    match fault {
        FaultCode::Halls => {
            bench.board().halls = 7;
            bench.ticks(4);
        }
        FaultCode::OverCurrent => {
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
            bench.ticks(501);
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
        let refused = bench.tater.status().fault.map(|fault| Err(SetError::Servo(Refusal::Fault(fault))));
        assert_eq!(bench.set(Property::M, 20), refused.unwrap_or(Ok(())), "{}", row.name);
        *bench.board().analog_mut() = healthy;
        let count = bench.count;
        bench.board().turn_to(count);
        bench.set(Property::STAT, 2).expect("clears");
        bench.tick();
        assert_eq!(bench.get(Property::ERROR), Some(0), "{}", row.name);
        assert_eq!(bench.set(Property::M, 30), Ok(()), "{}", row.name);
    }
    // The servo's seven, and the flash.
    assert_eq!(provoked, 8);
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

#[test]
fn host_is_lost_after_500_ms_of_silence_in_modes_2_and_4() {
    for mode in [2, 3, 4, 5] {
        // A spread that is stuck on its way.
        let mut bench = Bench::new(4);
        bench.set(Property::TSTOP, 0).expect("never");
        bench.set(Property::E, 100).expect("in range");
        bench.set(Property::MODE, mode).expect("a mode");
        bench.ticks(usize::from(HOST_TIMEOUT_MS));
        assert_eq!(bench.tater.status().fault, None, "mode {mode}");
        bench.tick();
        let lost = (mode == 2 || mode == 4).then_some(Fault::HostLost);
        assert_eq!(bench.tater.status().fault, lost, "mode {mode}");
        assert_eq!(bench.tater.drive().duty.is_none(), lost.is_some(), "mode {mode}");
    }
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
            bench.ticks(400);
            let _ = bench.say(to, 0, Body::More { frames: 1, received: 0 });
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
    ];
    for (i, one) in all.into_iter().enumerate() {
        assert_eq!(fault_code(one).row().code, fault_code(one));
        assert!(all[..i].iter().all(|&other| fault_code(other) != fault_code(one)), "{one:?}");
    }
}
