//! Latency from the host's bytes to the torque of seven motors, and the bus load.

use hil_world::hand::Hand;
use hil_world::hand::serial::Serial;
use servo_core::units::Duty;
use tater_wire::MotorKind;

use super::super::Session;
use super::{ALL, BLOCK_US, FEEDBACK, Host, control};
use crate::figures::Figure::Near;
use crate::figures::claim;

const RESOLUTION_US: u64 = 10;

/// Measured blocks. Each begins at another phase of the boards' ticks (1000 us), because 53 does not divide 1000.
const PHASES: u64 = 60;
const PHASE_US: u64 = 53;

/// Three GET frames (52 bits, at most 10 stuff bits, intermission 3), one answer on the wire, seven gains and velocities (76, 16, 3), 50 us of
/// the board and its next tick.
const BOUND_US: u64 = 3 * 65 + 15 * 95 + 50 + 1_000;

/// Duty of each bridge; 0 is off, or both phases alike.
fn duties(hand: &Hand) -> Vec<Duty> {
    let duty =
        |node: &hil_world::node::Node| node.application().and_then(|application| application.drive().duty);
    hand.bus().stations().map(|node| duty(node).unwrap_or_default()).collect()
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Change {
    after_us: u64,
    busy_us: u64,
}

fn changes(session: &mut Session, line: &mut Serial, max_us: u64) -> [Change; 7] {
    let now = |session: &Session| (session.hand.now_us(), session.hand.bus().stats().busy_us);
    let ((begin_us, begin_busy_us), before) = (now(session), duties(&session.hand));
    let (mut changes, mut received) = ([None; 7], Vec::new());
    while changes.contains(&None) {
        let (now_us, busy_us) = now(session);
        assert!(now_us <= begin_us + max_us, "no torque within {max_us} us: {changes:?}");
        line.run_until(&mut session.hand, now_us + RESOLUTION_US, &mut received, 1024);
        for ((change, now), before) in changes.iter_mut().zip(duties(&session.hand)).zip(&before) {
            if change.is_none() && now != *before {
                let after_us = session.hand.now_us() - begin_us;
                *change = Some(Change { after_us, busy_us: busy_us - begin_busy_us });
            }
        }
    }
    changes.map(Option::unwrap_or_default)
}

fn keep_longest(worst: &mut [u64; 7], changes: &[Change; 7]) {
    worst.iter_mut().zip(changes).for_each(|(worst, change)| *worst = change.after_us.max(*worst));
}

fn rest(host: &mut Host, gain: u8) {
    let (mut still, end) = (0, host.session.hand.now_us() + 10_000_000);
    while still < 10 {
        assert!(host.session.hand.now_us() < end, "at rest: {:?}", host.truth());
        host.block(&control(0, gain), FEEDBACK);
        let rests = duties(&host.session.hand).iter().all(|&duty| duty == Duty::ZERO);
        still = if rests { still + 1 } else { 0 };
    }
}

/// Longest time of each motor from the first byte of a control block that changes all velocities and gains, us.
fn worst(session: Session, paced: bool) -> [u64; 7] {
    let mut host = Host::from_session(session, ALL);
    let mut worst = [0; 7];
    for phase in 0..PHASES {
        rest(&mut host, 16);
        host.session.wait_us(phase * PHASE_US % 1_000);
        let velocity = if phase % 2 == 0 { 20 } else { -20 };
        let mut line = Serial::new(paced);
        line.put(&control(velocity, 17), &mut host.session.hand);
        keep_longest(&mut worst, &changes(&mut host.session, &mut line, BLOCK_US));
        host.session.wait_us(20_000);
        host.session.hand.take_tx();
    }
    worst
}

#[test]
fn block_to_torque_takes_its_frames_and_a_tick() {
    let worst = worst(Session::new(), false);
    println!(
        "figure: RealTime, last byte of a control block of seven motors to each one's torque: at worst {worst:?} us"
    );
    assert!(worst.iter().all(|&us| us <= BOUND_US), "{worst:?} us, {BOUND_US} at most");
    let most = worst.iter().copied().max().unwrap_or(0) as f64;
    claim("docs/figures.md", "to torque on all motors | RealTime {} ms; `M`", &[Near(most / 1000.0)]);
}

#[test]
fn block_to_torque_at_38400_baud_adds_its_own_bytes() {
    let mut session = Session::new();
    assert_eq!(session.run("PSET BAUD 384"), "");
    let worst = worst(session, true);
    println!(
        "figure: RealTime at 38400 baud, first byte of a control block of seven motors to each one's torque: at worst {worst:?} us"
    );
    // Ten bits each.
    let bytes_us = control(0, 0).len() as u64 * 10 * 1_000_000 / 38_400;
    let expected = bytes_us..=bytes_us + BOUND_US;
    assert!(worst.iter().all(|us| expected.contains(us)), "{worst:?} us, expected {expected:?}");
}

#[test]
fn move_to_torque_takes_its_frames_and_a_tick() {
    let (mut worst, mut load_percent) = ([0; 7], 0.0_f64);
    let mut session = Session::new();
    assert_eq!(session.run("HI"), "");
    // The spread's brake has to release first.
    let brake_us = 1_000 * u64::from(tater_fw::motion::defaults(MotorKind::Spread).brake_ms);
    // Without HOLD all bridges are off before the move; holding would change the duty all the time.
    assert_eq!(session.run("FSET HOLD 0"), "");
    for phase in 0..20 {
        assert_eq!(session.run("M 0"), "");
        session.wait_us(phase * PHASE_US % 1_000);
        assert!(duties(&session.hand).iter().all(|&duty| duty == Duty::ZERO));
        session.hand.push_rx(b"M 9000");
        session.wait_us(10_000);
        let (begin_us, before_us) = (session.hand.now_us(), session.hand.bus().stats().busy_us);
        session.hand.push_rx(b"\r");
        let changes = changes(&mut session, &mut Serial::new(false), 200_000);
        keep_longest(&mut worst, &changes);
        for (motor, Change { after_us, busy_us }) in changes.into_iter().enumerate() {
            // Its last frame, 50 us of the board, and its next tick.
            let bound_us = busy_us + 95 + 50 + 1_000 + if motor == 3 { brake_us } else { 0 };
            assert!(after_us <= bound_us, "motor {}: {after_us} us, {busy_us} us of bus time", motor + 1);
        }
        session.read_to_prompt();
        let busy_us = session.hand.bus().stats().busy_us - before_us;
        load_percent = load_percent.max(100.0 * busy_us as f64 / (session.hand.now_us() - begin_us) as f64);
    }
    println!(
        "figure: M of seven motors, CR to each one's torque: at worst {worst:?} us; bus load while they move {load_percent:.1} %"
    );
    let most = |is_spread: bool| {
        let motors = worst.iter().enumerate().filter(|(motor, _)| (*motor == 3) == is_spread);
        Near(motors.map(|(_, us)| *us as f64 / 1000.0).fold(0.0, f64::max))
    };
    claim("docs/figures.md", "`M` {} ms, the spread {} ms with its brake |", &[most(false), most(true)]);
}
