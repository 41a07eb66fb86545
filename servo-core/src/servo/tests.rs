//! The whole mode table; entry, end and fault actions on an ideal motor.

use super::*;
use crate::guard::fault::Fault;
use crate::sense::hall::{HallEdge, HallFault};
use crate::units::{DeciCelsius, Duty, Micros, MilliAmps, MilliVolts};
use crate::way::Way;
use proptest::prelude::*;

mod entries;
mod homing;
mod host;
mod motions;
mod stalls;

#[derive(Clone, Copy, Debug)]
enum Joint {
    /// No brake; opens towards its stop; breaks away.
    Link,
    /// A brake; holds after a motion.
    Spread,
    /// No brake; closes towards its stop.
    Tip,
}

impl Joint {
    fn config(self) -> Config {
        let (accel, hold, tstop, ivel, ioff, bt, brake_ms) = match self {
            Self::Link => (40, false, 300, -200, 25, 400, 0),
            Self::Spread => (30, true, 400, -200, 0, 0, 30),
            Self::Tip => (30, false, 300, 200, -350, 0, 0),
        };
        Config {
            mt: 750,
            mv: 1000,
            mcv: 1000,
            mov: 1000,
            accel,
            mpe: 4,
            hold,
            tstop,
            kp: 120,
            kd: 640,
            ki: 0,
            kpv: 32,
            hsg: 256,
            lsg: 256,
            bt,
            bs: false,
            ivel,
            ioff,
            ihit: 250,
            otemp: 700,
            kbw: 0,
            motor: Motor::HAND,
            board: &crate::motor::BoardFigures::TATER,
            brake_ms,
        }
    }
}

/// Most ticks of one test, so that a motion without an end fails it.
const MAX_TICKS: u32 = 20_000_000;

struct Bench {
    servo: Servo,
    ticks: u32,
    now: Micros,
    count: i32,
    strain: u8,
    bus: MilliVolts,
    motor_temp: DeciCelsius,
    host_lost: bool,
}

impl Bench {
    fn new(kind: Joint) -> Self {
        let mut servo = Servo::new(kind.config(), 0);
        // The rotors here follow no torque.
        servo.trust_direction();
        Self {
            servo,
            ticks: 0,
            now: Micros(u32::MAX - 50_000), // the clock wraps during the test
            count: 0,
            strain: 100,
            bus: MilliVolts(24_000),
            motor_temp: DeciCelsius(300),
            host_lost: false,
        }
    }

    /// One tick in which the rotor moves to `count` in single steps.
    fn tick_to(&mut self, count: i32) -> Drive {
        while self.count != count {
            let closing = count > self.count;
            self.count += if closing { 1 } else { -1 };
            let way = Way::closing_if(closing);
            self.now = self.now.wrapping_add(Micros(60));
            let edge = HallEdge {
                count: self.count,
                steps: 1,
                way,
                at: self.now,
                rising: self.count & 1 == 0,
                bounce: false,
                uncertain: false,
            };
            self.servo.edge(&edge);
        }
        self.ticks += 1;
        assert!(self.ticks < MAX_TICKS, "no end: {:?}", self.servo.telemetry());
        self.now = self.now.wrapping_add(Micros(1000));
        self.servo.tick(&Sense {
            now: self.now,
            bus: self.bus,
            current: MilliAmps(0),
            motor_temp: self.motor_temp,
            strain: self.strain,
            host_lost: self.host_lost,
        })
    }

    fn tick(&mut self) -> Drive {
        self.tick_to(self.count)
    }

    /// Ticks with a rotor that follows the set-point exactly, until a motion ends.
    fn follow(&mut self, most: usize) -> Option<EndReason> {
        for _ in 0..most {
            let wanted = self.servo.telemetry().setpoint.round() + self.servo.zero;
            self.tick_to(wanted.clamp(self.count - 8, self.count + 8));
            while let Some(event) = self.servo.event() {
                if let Event::Ended { reason, .. } = event {
                    return Some(reason);
                }
            }
        }
        None
    }

    fn in_mode(mode: Mode) -> Self {
        let mut bench = Self::new(Joint::Spread);
        bench.servo.command(Command::End(100)).expect("E may be written in idle");
        bench.servo.command(Command::Mode(mode)).expect("from idle every mode can be entered");
        for _ in 0..40 {
            bench.tick();
        }
        assert_eq!(bench.servo.telemetry().mode, mode);
        bench
    }
}

fn commands() -> [(Command, &'static str); 17] {
    [
        (Command::Mode(Mode::Idle), "MODE 0"),
        (Command::Mode(Mode::Torque), "MODE 2"),
        (Command::Mode(Mode::Pid), "MODE 3"),
        (Command::Mode(Mode::Velocity), "MODE 4"),
        (Command::Mode(Mode::Trapezoidal), "MODE 5"),
        (Command::MoveToEnd, "MODE 5 as HOLD says"),
        (Command::Torque(Torque(100)), "T"),
        (Command::Velocity(CountsPerSec::from_int(-50)), "V"),
        (Command::Position(7), "P"),
        (Command::End(20), "E"),
        (Command::Move(30), "M"),
        (Command::TorqueControlled { way: Way::Closing }, "TC"),
        (Command::Home, "HI"),
        (Command::Terminate, "T (command)"),
        (Command::Configure(Config { mt: 700, ..Joint::Spread.config() }), "MT"),
        (Command::ClearFault, "STAT 2"),
        (Command::ClearBreakaway, "O"),
    ]
}

#[test]
fn every_mode_accepts_or_refuses_every_command() {
    use Mode::{Idle, Pid, Torque as Tq, Trapezoidal as Trap, Velocity as Vel};
    for mode in Mode::ALL {
        for (command, name) in commands() {
            let mut bench = Bench::in_mode(mode);
            let answer = bench.servo.command(command);
            let refused = match name {
                "T" => mode != Tq,
                "P" => mode != Idle && mode != Pid,
                _ => false,
            };
            assert_eq!(answer, if refused { Err(Refusal::Mode(mode)) } else { Ok(()) }, "{name} in {mode:?}");
            let after = match command {
                Command::Mode(next) => next,
                Command::Move(_) | Command::MoveToEnd => Trap,
                Command::TorqueControlled { .. } | Command::Home => Vel,
                Command::Terminate => Idle,
                _ => mode,
            };
            assert_eq!(bench.servo.telemetry().mode, after, "{name} in {mode:?}");
        }
    }
}

#[test]
fn positions_that_would_wrap_are_refused_and_change_nothing() {
    for (mode, command) in [
        (Mode::Pid, Command::Position(1 + (1 << 20))),
        (Mode::Idle, Command::End(i32::MIN)),
        (Mode::Idle, Command::Move(-1 - (1 << 20))),
    ] {
        let mut bench = Bench::in_mode(mode);
        let before = (bench.servo.telemetry(), bench.servo.end());
        assert_eq!(bench.servo.command(command), Err(Refusal::Range), "{command:?}");
        assert_eq!((bench.servo.telemetry(), bench.servo.end()), before);
    }
}

#[test]
fn brake_releases_before_the_bridge_drives_and_engages_in_idle() {
    let mut bench = Bench::new(Joint::Spread);
    assert_eq!(bench.tick(), Drive { duty: None, brake_released: false });
    bench.servo.command(Command::Move(50)).unwrap();
    for tick in 0..30 {
        assert_eq!(bench.tick(), Drive { duty: None, brake_released: true }, "tick {tick}");
    }
    assert!(bench.tick().duty.is_some());
    bench.servo.command(Command::Terminate).unwrap();
    assert_eq!(bench.tick(), Drive { duty: None, brake_released: false });
    let mut link = Bench::new(Joint::Link);
    link.servo.command(Command::Mode(Mode::Pid)).unwrap();
    assert!(link.tick().duty.is_some(), "a motor without a brake drives at once");
}

/// Nothing is planned, so no tick goes by without a law.
#[test]
fn move_moves_its_set_point_in_its_first_tick() {
    let mut link = Bench::new(Joint::Link);
    link.servo.command(Command::Mode(Mode::Torque)).unwrap();
    link.servo.command(Command::Torque(Torque(200))).unwrap();
    let pushing = link.tick();
    assert!(pushing.duty.is_some_and(|duty| duty > Duty::ZERO));
    link.servo.command(Command::Move(-50)).unwrap();
    assert_ne!(link.tick(), pushing);
    assert!(link.servo.telemetry().setpoint_velocity < CountsPerSec::ZERO);
}

#[test]
fn move_arrives_then_holds_or_idles_by_hold() {
    for (kind, after) in [(Joint::Spread, Mode::Pid), (Joint::Link, Mode::Idle)] {
        let mut bench = Bench::new(kind);
        bench.servo.command(Command::Move(60)).unwrap();
        assert_eq!(bench.follow(2000), Some(EndReason::Arrived));
        let status = bench.servo.telemetry();
        assert_eq!((status.mode, status.end, status.position.round()), (after, Some(EndReason::Arrived), 60));
    }
}

/// Brings about the end of a motion.
type Cause = fn(&mut Bench);

/// The ends of a motion.
const ENDS: [(EndReason, Cause); 5] = [
    (EndReason::Arrived, |_| ()),
    (EndReason::Stalled, |_| ()),
    (EndReason::Strain, |bench| bench.strain = 250),
    (EndReason::Breakaway, |_| ()),
    (EndReason::Fault, |bench| bench.bus = MilliVolts(40_000)),
];

/// Orders a move to 60 and brings about its end, once it is under way. Returns the mode after it.
fn mode_after(orders: &[Command], hold: bool, (reason, cause): (EndReason, Cause)) -> Mode {
    let mut bench = Bench::new(Joint::Link);
    let (hsg, bt) = (200, if reason == EndReason::Breakaway { 150 } else { 0 });
    let config = Config { hold, hsg, bt, ..Joint::Link.config() };
    bench.servo.command(Command::Configure(config)).unwrap();
    bench.servo.command(Command::End(60)).unwrap();
    for order in orders {
        bench.servo.command(*order).unwrap();
        (0..5).for_each(|_| _ = bench.tick());
    }
    bench.follow(20);
    cause(&mut bench);
    let ended = if matches!(reason, EndReason::Stalled | EndReason::Breakaway) {
        // The rotor stays where it is.
        (0..3000).find_map(|_| {
            bench.tick();
            bench.servo.telemetry().end
        })
    } else {
        bench.follow(3000)
    };
    assert_eq!(ended, Some(reason), "{orders:?}, HOLD {hold}");
    bench.servo.telemetry().mode
}

#[test]
fn move_ordered_by_mode_5_ends_in_a_hold_and_any_other_as_hold_says() {
    let (mode_5, end) = (Command::Mode(Mode::Trapezoidal), Command::Move(61));
    for case in ENDS {
        for hold in [false, true] {
            let as_hold = if hold { Mode::Pid } else { Mode::Idle };
            for orders in [&[end][..], &[Command::MoveToEnd], &[mode_5, end], &[mode_5, Command::MoveToEnd]] {
                let expected = if case.0 == EndReason::Fault { Mode::Idle } else { as_hold };
                assert_eq!(mode_after(orders, hold, case), expected, "{orders:?}, HOLD {hold}, {:?}", case.0);
            }
            for orders in [&[mode_5][..], &[end, mode_5], &[mode_5, Command::End(61)]] {
                let expected = if case.0 == EndReason::Fault { Mode::Idle } else { Mode::Pid };
                assert_eq!(mode_after(orders, hold, case), expected, "{orders:?}, HOLD {hold}, {:?}", case.0);
            }
        }
    }
}

/// The observer lets a blocked rotor lean on the far side of its cell. ACCEL 30 needs 59 ms to a count beyond that, then TSTOP 300 runs.
const STALL_OF_ACCEL_30: core::ops::RangeInclusive<usize> = 358..=361;

#[test]
fn blocked_move_stalls_after_tstop() {
    // A tip: a link would break away first.
    let mut bench = Bench::new(Joint::Tip);
    bench.servo.command(Command::Move(60)).unwrap();
    let stalled_at = (1..2000).find(|_| {
        bench.tick();
        matches!(bench.servo.event(), Some(Event::Ended { reason: EndReason::Stalled, mode: Mode::Idle }))
    });
    assert!(STALL_OF_ACCEL_30.contains(&stalled_at.unwrap()), "{stalled_at:?}");
    assert!(bench.servo.telemetry().torque == Torque::ZERO && bench.tick().duty.is_none());
}

#[test]
fn profile_waits_for_a_lagging_rotor_and_resumes_without_a_step() {
    let mut bench = Bench::new(Joint::Tip);
    bench.servo.command(Command::Move(60)).unwrap();
    for _ in 0..250 {
        bench.tick();
    }
    let waiting = bench.servo.telemetry();
    // Six counts, and what the last step added: less than the set-point's velocity in 1 ms.
    assert!((6..=7).contains(&waiting.setpoint.round()), "{:?}", waiting.setpoint);
    assert!(waiting.setpoint_velocity > CountsPerSec::from_int(50), "{:?}", waiting.setpoint_velocity);
    let mut before = waiting;
    bench.tick_to(5);
    while bench.servo.telemetry().mode == Mode::Trapezoidal {
        let now = bench.servo.telemetry();
        // ACCEL 30 is 858 counts/s²: 0.86 counts/s a tick, and the profile never exceeds 60 counts' 227 counts/s.
        let jerk = now.setpoint_velocity.0.saturating_sub(before.setpoint_velocity.0).saturating_abs();
        assert!(jerk < Law::ONE, "the velocity steps by {jerk}");
        let step = now.setpoint.wrapping_sub(before.setpoint).saturating_error();
        assert!(step < Law::ONE / 4, "the set-point steps by {step}");
        before = now;
        bench.tick_to(now.setpoint.round());
    }
    assert_eq!(bench.servo.telemetry().end, Some(EndReason::Arrived));
}

#[test]
fn move_with_accel_0_ends_as_a_stall() {
    let mut bench = Bench::new(Joint::Tip);
    let config = Config { accel: 0, ..*bench.servo.config() };
    bench.servo.command(Command::Configure(config)).unwrap();
    bench.servo.command(Command::Move(60)).unwrap();
    assert_eq!(bench.follow(310), Some(EndReason::Stalled));
}

#[test]
fn torque_control_with_hold_keeps_pressing() {
    let mut bench = Bench::new(Joint::Spread);
    bench.servo.command(Command::TorqueControlled { way: Way::Closing }).unwrap();
    for _ in 0..2000 {
        bench.tick();
    }
    let status = bench.servo.telemetry();
    assert_eq!((status.mode, status.end), (Mode::Velocity, Some(EndReason::Stalled)));
    assert_eq!(status.torque, Torque(750));
    bench.servo.command(Command::Mode(Mode::Pid)).unwrap();
    assert_eq!(bench.servo.telemetry().mode, Mode::Pid);
}

#[test]
fn torque_control_stalls_at_any_gain_and_presses_with_mt() {
    let mut bench = Bench::new(Joint::Spread);
    // 16 counts/s at the least gain: the loop alone asks for one unit of torque.
    let config = Config { mov: 16, kpv: 1, mt: 600, ..*bench.servo.config() };
    bench.servo.command(Command::Configure(config)).unwrap();
    bench.servo.command(Command::TorqueControlled { way: Way::Opening }).unwrap();
    for _ in 0..31 + 400 {
        bench.tick();
    }
    assert_eq!(bench.servo.telemetry().end, Some(EndReason::Stalled));
    // Above 480 it rises by 32 a tick.
    for _ in 0..4 {
        bench.tick();
    }
    assert_eq!(bench.servo.telemetry().torque, Torque(-600));
}

#[test]
fn position_written_before_mode_3_starts_is_its_setpoint() {
    for kind in [Joint::Link, Joint::Spread] {
        let mut bench = Bench::new(kind);
        bench.servo.command(Command::Mode(Mode::Pid)).unwrap();
        bench.servo.command(Command::Position(10)).unwrap();
        for _ in 0..40 {
            bench.tick();
        }
        let torque = bench.servo.telemetry().torque;
        assert!(torque > Torque(100), "{kind:?}: {torque:?}");
        // It waits for a rotor that lags. For one that follows it needs two ramps of √(10/15,000) s = 26 ms.
        for _ in 0..60 {
            bench.tick_to(bench.servo.telemetry().setpoint.round());
        }
        let status = bench.servo.telemetry();
        assert_eq!((status.setpoint, status.position.round()), (Counts::from_int(10), 10), "{kind:?}");
    }
}

#[test]
fn interrupted_move_reports_end_3() {
    let cuts = [
        (Command::Mode(Mode::Idle), Mode::Idle),
        (Command::Mode(Mode::Pid), Mode::Pid),
        (Command::Terminate, Mode::Idle),
        (Command::Mode(Mode::Velocity), Mode::Velocity),
        (Command::Home, Mode::Velocity),
    ];
    for (cut, mode) in cuts {
        for order in [Command::MoveToEnd, Command::Mode(Mode::Trapezoidal)] {
            for hold in [false, true] {
                let mut bench = Bench::new(Joint::Spread);
                let config = Config { hold, ..*bench.servo.config() };
                bench.servo.command(Command::Configure(config)).unwrap();
                bench.servo.command(Command::End(60)).unwrap();
                bench.servo.command(order).unwrap();
                bench.follow(100);
                bench.servo.command(cut).unwrap();
                let ended = Event::Ended { reason: EndReason::Aborted, mode };
                assert_eq!(bench.servo.event(), Some(ended), "{cut:?}, {order:?}, HOLD {hold}");
                assert_eq!(bench.servo.event(), None);
                assert_eq!(bench.servo.telemetry().mode, mode, "{cut:?}, {order:?}, HOLD {hold}");
            }
        }
    }
    let mut bench = Bench::in_mode(Mode::Pid);
    bench.servo.command(Command::Terminate).unwrap();
    assert_eq!(bench.servo.event(), None, "a hold is no move");
}

fn stall_time_while_writing(change: fn(Config, u16) -> Config) -> usize {
    let mut bench = Bench::new(Joint::Tip);
    bench.servo.command(Command::Move(60)).unwrap();
    let stalled_at = (1..2000).find(|tick| {
        bench.tick();
        if tick % 50 == 0 {
            let config = change(*bench.servo.config(), u16::try_from(*tick).unwrap());
            bench.servo.command(Command::Configure(config)).unwrap();
            let _ = bench.servo.command(Command::End(60));
        }
        bench.servo.telemetry().end.is_some()
    });
    stalled_at.expect("a blocked move ends")
}

#[test]
fn properties_that_do_not_shape_the_move_do_not_restart_its_stall_time() {
    let unrelated: [fn(Config, u16) -> Config; 3] = [
        |config, _| Config { hsg: 200, ..config },
        |config, tick| Config { ioff: tick.into(), ..config },
        |config, tick| Config { kp: tick, ivel: 100, ..config },
    ];
    for change in unrelated {
        let stalled_at = stall_time_while_writing(change);
        assert!(STALL_OF_ACCEL_30.contains(&stalled_at), "{stalled_at}");
    }
}

#[test]
fn hold_after_strain_at_speed_starts_with_an_empty_integral() {
    let mut bench = Bench::new(Joint::Spread);
    let config = Config { hsg: 150, ..*bench.servo.config() };
    bench.servo.command(Command::Configure(config)).unwrap();
    bench.servo.command(Command::Move(160)).unwrap();
    bench.follow(400);
    assert!(bench.servo.telemetry().velocity > CountsPerSec::from_int(200));
    bench.strain = 151;
    bench.tick();
    assert_eq!(bench.servo.telemetry().end, Some(EndReason::Strain));
    assert!(bench.servo.telemetry().torque < Torque(-100), "{:?}", bench.servo.telemetry().torque);
}

#[test]
fn hall_fault_clears_homed() {
    let mut bench = Bench::new(Joint::Link);
    bench.servo.homed = true;
    bench.servo.hall(&HallEvent::Fault(HallFault::Noisy));
    bench.tick();
    let status = bench.servo.telemetry();
    assert_eq!((status.homed, status.fault), (false, Some(Fault::Halls)));
}

#[test]
fn strain_ends_a_move_but_not_a_hold() {
    let mut bench = Bench::new(Joint::Spread);
    let config = Config { hsg: 150, ..*bench.servo.config() };
    bench.servo.command(Command::Configure(config)).unwrap();
    bench.servo.command(Command::Move(60)).unwrap();
    bench.follow(100);
    bench.strain = 151;
    assert_eq!(bench.follow(2), Some(EndReason::Strain));
    assert_eq!(bench.follow(100), None, "holding: nothing ends again");
    assert_eq!(bench.servo.telemetry().mode, Mode::Pid);
}

#[test]
fn fault_idles_refuses_motion_and_can_be_cleared() {
    type Break = fn(&mut Bench);
    let rows: [(Break, Fault, usize); 5] = [
        (|bench| bench.servo.bridge_fault(), Fault::Bridge, 1),
        (|bench| bench.bus = MilliVolts(33_000), Fault::OverVoltage, 10),
        (|bench| bench.bus = MilliVolts(15_000), Fault::UnderVoltage, 10),
        // The temperature is judged at the first tick and each sixteenth from there: `in_mode` leaves it nine before one.
        (|bench| bench.motor_temp = DeciCelsius(700), Fault::OverTemperature, 9),
        // A broken wire.
        (|bench| bench.motor_temp = DeciCelsius(-500), Fault::OverTemperature, 9),
    ];
    for (break_it, fault, ticks) in rows {
        let mut bench = Bench::in_mode(Mode::Pid);
        break_it(&mut bench);
        for _ in 1..ticks {
            assert!(bench.tick().duty.is_some(), "{fault:?} too early");
        }
        assert_eq!(bench.tick(), Drive { duty: None, brake_released: false }, "{fault:?}");
        assert_eq!(bench.servo.event(), Some(Event::Fault(fault)));
        assert_eq!(bench.servo.event(), Some(Event::Ended { reason: EndReason::Fault, mode: Mode::Idle }));
        assert_eq!(bench.servo.command(Command::Move(10)), Err(Refusal::Fault(fault)));
        assert_eq!(bench.servo.command(Command::Mode(Mode::Idle)), Ok(()));
        bench.bus = MilliVolts(24_000);
        bench.motor_temp = DeciCelsius(300);
        bench.servo.command(Command::ClearFault).unwrap();
        assert_eq!(bench.servo.command(Command::Move(10)), Ok(()));
        bench.tick();
        assert_eq!(bench.servo.telemetry().fault, None);
    }
}

#[test]
fn replan_keeps_setpoint_and_velocity() {
    let mut bench = Bench::new(Joint::Spread);
    bench.servo.command(Command::Move(160)).unwrap();
    bench.follow(300);
    let before = bench.servo.telemetry();
    bench.servo.command(Command::End(60)).unwrap();
    let after = bench.servo.telemetry();
    assert_eq!((before.setpoint, before.setpoint_velocity), (after.setpoint, after.setpoint_velocity));
    assert_eq!(bench.follow(3000), Some(EndReason::Arrived));
    assert_eq!(bench.servo.telemetry().position.round(), 60);
}

fn any_config() -> impl Strategy<Value = Config> {
    let words = prop::collection::vec(prop_oneof![any::<u16>(), 0..1000_u16], 23);
    let motor = prop_oneof![Just(Motor::HAND), crate::motor::tests::any_fitting()];
    (words, any::<i32>(), any::<(bool, bool)>(), motor).prop_map(|(words, ioff, (hold, bs), motor)| Config {
        mt: words[0],
        mv: words[1],
        mcv: words[2],
        mov: words[3],
        accel: words[4],
        mpe: words[5],
        hold,
        tstop: words[6],
        kp: words[7],
        kd: words[8],
        ki: words[9],
        kpv: words[10],
        hsg: words[11],
        lsg: words[12],
        bt: words[13],
        bs,
        ivel: words[14].cast_signed(),
        ioff,
        ihit: words[15],
        otemp: words[16].cast_signed(),
        brake_ms: words[17] % 64,
        kbw: words[18] % 1000,
        motor: Motor { mka: words[19], mke: words[20], mfc: words[21], mfs: words[22], ..motor },
        board: &crate::motor::BoardFigures::TATER,
    })
}

proptest! {
    #[test]
    fn any_input_keeps_torque_and_duty_within_their_limits(
        steps in prop::collection::vec(
            (0usize..17, any::<i16>(), -8i32..=8, any::<i16>(), any::<u16>(), any::<u8>()), 1..200,
        ),
        configs in prop::collection::vec(any_config(), 1..8),
        far in 0..=6_u32,
    ) {
        let mut bench = Bench::new(Joint::Spread);
        for (which, value, moved, temp, bus, strain) in steps {
            let position = i32::from(value) << far;
            let command = match commands()[which].0 {
                Command::Torque(_) => Command::Torque(Torque(value)),
                Command::Velocity(_) => Command::Velocity(CountsPerSec::from_int(value)),
                Command::Position(_) => Command::Position(position),
                Command::End(_) => Command::End(position),
                Command::Move(_) => Command::Move(position),
                Command::Configure(_) => Command::Configure(configs[usize::from(strain) % configs.len()]),
                other => other,
            };
            let _ = bench.servo.command(command);
            bench.motor_temp = DeciCelsius(temp / 32);
            bench.bus = MilliVolts(bus);
            bench.strain = strain;
            let drive = bench.tick_to(bench.count + moved);
            let idle = bench.servo.telemetry().mode == Mode::Idle;
            let off = Drive { duty: None, brake_released: false };
            prop_assert!(!idle || drive == off);
            let duty = drive.duty.unwrap_or(Duty::ZERO).0.to_bits();
            prop_assert!(duty.unsigned_abs() <= 31_680);
            let telemetry = bench.servo.telemetry();
            let most = bench.servo.config().mt.min(990);
            // A replaced motion drives with the torque of the old MT for one more tick.
            let just_configured = matches!(command, Command::Configure(_));
            prop_assert!(just_configured || telemetry.limit == Some(crate::guard::fault::LimitCause::Duty)
                || telemetry.torque.0.unsigned_abs() <= most);
        }
    }
}

#[test]
fn home_needs_a_known_direction_of_closing() {
    let mut bench = Bench::new(Joint::Spread);
    bench.servo.set_wired(false);
    assert_eq!(bench.servo.command(Command::Home), Err(Refusal::Wiring));
    bench.servo.set_wired(true);
    assert_eq!(bench.servo.command(Command::Home), Ok(()));
}

/// Another wiring has to prove its direction, and drives with little torque until then.
#[test]
fn motor_that_runs_against_its_torque_is_stopped() {
    let mut bench = Bench::new(Joint::Spread);
    bench.servo.set_wired(true);
    bench.servo.command(Command::TorqueControlled { way: Way::Closing }).unwrap();
    let driven = (0..500).any(|_| bench.tick().duty.is_some_and(|duty| duty.0 > 0));
    assert!(driven, "after the brake's release");
    assert!((1..=6).any(|count| bench.tick_to(-count).duty.is_none()), "within six counts");
    // An open bridge shows whether something else pushed it: then it would move on.
    let found = (0..1000).any(|_| {
        let drive = bench.tick();
        bench.servo.telemetry().fault == Some(Fault::Wiring) && drive.duty.is_none()
    });
    assert!(found, "{:?}", bench.servo.telemetry());
}

#[test]
fn motor_that_runs_with_its_torque_is_not_stopped() {
    let mut bench = Bench::new(Joint::Spread);
    bench.servo.set_wired(true);
    bench.servo.command(Command::TorqueControlled { way: Way::Closing }).unwrap();
    assert!((0..500).any(|_| bench.tick().duty.is_some_and(|duty| duty.0 > 0)));
    assert!((1..=60).all(|count| bench.tick_to(count).duty.is_some()));
    assert_eq!(bench.servo.telemetry().fault, None);
}
