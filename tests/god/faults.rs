//! Single faults at any moment: every command reaches its prompt in time, and healthy motors reach their goals.

use crate::effort::effort;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::OnceLock;

use boot::Chip;
use hil_world::hand::Hand;
use hil_world::hand::state::State;
use hil_world::plant::Model;
use proptest::prelude::*;
use proptest::test_runner::{Config, RngSeed, TestRunner};

use super::Session;
use super::deadlines::{ABORT_US, SHARE_US};
use super::movement::{TOLERANCE, counts};
use hil_torture::deadline::command_us;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    /// All hall lines are open.
    HallCable,
    HallLineLow,
    HallLineHigh,
    /// 12 V.
    LowSupply,
    /// 36 V.
    HighSupply,
    OpenThermistor,
    /// 90 °C; OTEMP is 70 °C.
    HotMotor,
    NoBoard,
    /// The brake does not release; only the spread has one.
    JammedBrake,
    WornFlash,
}

use Fault::*;

const FAULTS: [Fault; 10] = [
    HallCable,
    HallLineLow,
    HallLineHigh,
    LowSupply,
    HighSupply,
    OpenThermistor,
    HotMotor,
    NoBoard,
    JammedBrake,
    WornFlash,
];

/// Faults that a board detects at rest. It then refuses every order to move.
const REFUSING: [Fault; 5] = [HallCable, LowSupply, HighSupply, OpenThermistor, HotMotor];

const MOTORS: [u8; 3] = [1, 4, 5];

impl Fault {
    fn inject(self, hand: &mut Hand, motor: u8) {
        let place = usize::from(motor) - 1;
        let node = hand.bus_mut().station_mut(place).expect("1 to 7");
        match self {
            HallCable => node.rig_mut().break_hall_lines([Some(true); 3]),
            HallLineLow => node.rig_mut().break_hall_lines([Some(false), None, None]),
            HallLineHigh => node.rig_mut().break_hall_lines([None, Some(true), None]),
            LowSupply => node.rig_mut().set_bus(12.0),
            HighSupply => node.rig_mut().set_bus(36.0),
            OpenThermistor => node.rig_mut().override_thermistor(Some(-50.0)),
            HotMotor => node.rig_mut().override_thermistor(Some(90.0)),
            NoBoard => hand.bus_mut().cut(place, true),
            JammedBrake => node.rig_mut().stick_brake(Some(true)),
            WornFlash => node.board_mut().flash().set_worn(true),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Moment {
    PowerUp,
    /// The boards are awake and have detected the fault before the command.
    Prompt,
    /// This long after the end of the line, ms.
    MidMotion(u64),
}

/// The motion commands, with arguments that move every motor of [`saved`].
const COMMANDS: [&str; 16] = [
    "HI", "C", "O", "M 9000", "MDEG 60", "MPER 60", "IC 3000", "IO 2000", "HOME", "TC", "TO", "T", "WM 6000",
    "PTM 2000", "MAC 3", "LOOP",
];

/// A hand with trusted positions in the middle of the ranges, and macro 3.
pub fn saved() -> &'static State {
    static SAVED: OnceLock<State> = OnceLock::new();
    SAVED.get_or_init(|| {
        let mut session = Session::new();
        for line in ["HI", "M 8000", "MACSET 3", "M 4000", "SAVE"] {
            assert_eq!(session.run(line), "", "{line}");
        }
        session.hand.state()
    })
}

#[derive(Clone, Debug)]
struct Case {
    fault: Fault,
    motor: u8,
    moment: Moment,
    line: String,
    /// TSTOP of all motors, ms; `None`: the defaults, 300 and 400.
    tstop_ms: Option<u64>,
}

#[derive(Debug)]
struct Outcome {
    /// The number after ERR, or 0.
    status: u16,
    took_us: u64,
    /// Time from the fault to the prompt, if the fault was later, us.
    after_fault_us: u64,
}

/// Time after which the host ends LOOP by ^C, and time between two blocks, us.
const LOOP_US: u64 = 1_000_000;
const BLOCK_US: u64 = 20_000;

impl Case {
    fn new(fault: Fault, motor: u8, moment: Moment, line: impl Into<String>) -> Self {
        Self { fault, motor, moment, line: line.into(), tstop_ms: None }
    }

    fn bound_us(&self) -> u64 {
        let host_us = if self.line.ends_with("LOOP") { LOOP_US } else { 0 };
        host_us + command_us(&self.line, self.tstop_ms.unwrap_or(400)).expect("a command")
    }

    fn session(&self) -> Session {
        let mut hand = Hand::restore(Model::Averaged, 1, saved()).expect("within its stops");
        if self.moment == Moment::PowerUp {
            self.fault.inject(&mut hand, self.motor);
        }
        let mut session = Session::from_hand(hand);
        if let Some(ms) = self.tstop_ms {
            session.run(&format!("X1234567FSET TSTOP {ms}"));
        } else if self.moment != Moment::PowerUp {
            session.run("WAKE");
        }
        if self.moment == Moment::Prompt {
            self.fault.inject(&mut session.hand, self.motor);
            session.wait_us(200_000);
        }
        session
    }

    fn run(&self) -> Result<Outcome, String> {
        let mut session = self.session();
        let start_us = session.hand.now_us();
        session.hand.push_rx(self.line.as_bytes());
        session.hand.push_rx(b"\r");
        let (mut received, mut fault_us) = (String::new(), start_us);
        while !received.ends_with("\n\r=> ") {
            let elapsed_us = session.hand.now_us() - start_us;
            if elapsed_us > self.bound_us() {
                return Err(format!(
                    "{self:?}: no prompt within {} ms, but {received:?}; {}",
                    self.bound_us() / 1000,
                    session.motors()
                ));
            }
            if self.moment == Moment::MidMotion(elapsed_us / 1000) && fault_us == start_us {
                self.fault.inject(&mut session.hand, self.motor);
                fault_us = session.hand.now_us();
            }
            if received.starts_with(&format!("{}*", self.line)) && elapsed_us.is_multiple_of(BLOCK_US) {
                self.send_block(&mut session, elapsed_us);
            }
            session.wait_us(1000);
            received.extend(session.hand.take_tx().into_iter().map(char::from));
        }
        let now_us = session.hand.now_us();
        let status = received.rsplit_once("ERR ").and_then(|(_, rest)| rest.split('\r').next()?.parse().ok());
        Ok(Outcome {
            status: status.unwrap_or(0),
            took_us: now_us - start_us,
            after_fault_us: now_us - fault_us,
        })
    }

    fn send_block(&self, session: &mut Session, elapsed_us: u64) {
        if elapsed_us > LOOP_US {
            session.hand.push_rx(b"\x03");
        } else {
            let axes = if self.line.starts_with('X') { 1 } else { 4 };
            session.hand.push_rx(&[&b"C"[..], &[10, 32].repeat(axes)].concat());
        }
    }
}

fn run_each_command(moment: Moment) {
    let mut wrong = Vec::new();
    let mut slowest: BTreeMap<&str, (u64, String)> = BTreeMap::new();
    for fault in FAULTS {
        for motor in MOTORS {
            for command in COMMANDS {
                for line in [command.to_owned(), format!("X{motor}{command}")] {
                    let case = Case::new(fault, motor, moment, line);
                    match case.run() {
                        Err(hang) => wrong.push(hang),
                        Ok(outcome) => {
                            let slow = slowest.entry(command).or_default();
                            if outcome.took_us > slow.0 {
                                *slow =
                                    (outcome.took_us, format!("{fault:?} of motor {motor}, {}", case.line));
                            }
                        }
                    }
                }
            }
        }
    }
    for (command, (us, what)) in slowest {
        let most_ms = command_us(command, 400).expect("a command") / 1000;
        println!(
            "figure: faults, {moment:?}: {command}: prompt after {} ms at most ({what}), bound {most_ms} ms",
            us / 1000
        );
    }
    assert!(wrong.is_empty(), "{} runs without a prompt:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn fault_at_power_up_each_command_reaches_its_prompt() {
    run_each_command(Moment::PowerUp);
}

#[test]
fn fault_at_the_prompt_each_command_reaches_its_prompt() {
    run_each_command(Moment::Prompt);
}

#[test]
fn fault_in_mid_motion_each_command_reaches_its_prompt() {
    run_each_command(Moment::MidMotion(200));
}

/// Whether a command moves a motor. T moves none, WM only fingers, PTM only tips.
fn moves(command: &str, motor: u8) -> bool {
    match command {
        "T" => false,
        "WM 6000" => motor < 4,
        "PTM 2000" => motor > 4,
        _ => true,
    }
}

#[test]
fn refused_motor_ends_within_100_ms_with_a_status() {
    let (mut wrong, mut slowest) = (Vec::new(), 0);
    for fault in REFUSING {
        for motor in MOTORS {
            for command in COMMANDS.into_iter().filter(|command| moves(command, motor)) {
                for moment in [Moment::Prompt, Moment::MidMotion(100)] {
                    let case = Case::new(fault, motor, moment, format!("X{motor}{command}"));
                    match case.run() {
                        // The motion had ended before the fault.
                        Ok(outcome) if outcome.status == 0 && matches!(moment, Moment::MidMotion(_)) => {}
                        Ok(outcome) if outcome.status != 0 && outcome.after_fault_us <= SHARE_US => {
                            slowest = slowest.max(outcome.after_fault_us);
                        }
                        Ok(outcome) => wrong.push(format!("{case:?}: {outcome:?}")),
                        Err(hang) => wrong.push(hang),
                    }
                }
            }
        }
    }
    println!("figure: faults: a refused or faulted motor has its status after {} ms at most", slowest / 1000);
    assert!(wrong.is_empty(), "{}:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn refused_motor_leaves_the_others_their_goals() {
    for fault in REFUSING {
        for motor in [2, 6] {
            let case = Case::new(fault, motor, Moment::MidMotion(100), "GM 9000");
            let mut session = case.session();
            session.hand.push_rx(b"GM 9000\r");
            session.wait_us(100_000);
            fault.inject(&mut session.hand, motor);
            let (received, _) =
                session.try_read_to_prompt(case.bound_us()).unwrap_or_else(|hang| panic!("{case:?}: {hang}"));
            assert!(received.contains("ERR "), "{case:?}: {received:?}");
            // 9000 GCL counts are 164 hall counts, and 44 of the tips.
            let found = counts(&session);
            for (place, goal) in [(0, 164), (2, 164), (4, 44), (6, 44)] {
                assert!((found[place] - goal).abs() <= TOLERANCE, "{case:?}: {found:?}");
            }
            assert_eq!(session.run("13FGET S"), "0 0", "{case:?}");
            assert_ne!(session.run(&format!("X{motor}FGET S")), "0", "{case:?}");
        }
    }
}

#[test]
fn refused_motor_leaves_the_others_initialized() {
    for fault in REFUSING {
        for motor in MOTORS {
            let case = Case::new(fault, motor, Moment::PowerUp, "HI");
            let mut session = case.session();
            let (answer, _) =
                session.try_run("HI", case.bound_us()).unwrap_or_else(|hang| panic!("{case:?}: {hang}"));
            assert!(answer.starts_with("ERR "), "{case:?}: {answer}");
            for other in (1..=7).filter(|&other| other != motor) {
                assert_eq!(session.run(&format!("X{other}M 1000")), "", "{case:?}: motor {other}");
            }
        }
    }
}

fn cases() -> u32 {
    u32::try_from(effort(96)).expect("cases")
}

fn check<S: Strategy>(seed: u64, of: S, property: impl Fn(S::Value) -> Result<(), TestCaseError>) {
    let config = Config {
        cases: cases(),
        rng_seed: RngSeed::Fixed(seed),
        failure_persistence: None,
        max_shrink_iters: 64,
        ..Config::default()
    };
    TestRunner::new(config).run(&of, property).unwrap_or_else(|failed| panic!("{failed}"));
}

fn any_case() -> impl Strategy<Value = Case> {
    let fault = prop::sample::select(&FAULTS[..]);
    let moment = prop_oneof![
        Just(Moment::PowerUp),
        Just(Moment::Prompt),
        // Most motions take 1 s; HI takes 5 s.
        (0u64..1_200).prop_map(Moment::MidMotion),
        (0u64..5_000).prop_map(Moment::MidMotion),
    ];
    let prefix = prop_oneof![
        Just(String::new()),
        Just("G".to_owned()),
        Just("S".to_owned()),
        (1u8..=7).prop_map(|motor| format!("X{motor}")),
        Just("X1234567".to_owned()),
        Just("12".to_owned()),
    ];
    let command = prop_oneof![
        prop::sample::select(&COMMANDS[..COMMANDS.len() - 1]).prop_map(str::to_owned),
        (0i64..=20_000).prop_map(|to| format!("M {to}")),
        (-2_000i64..=2_000).prop_map(|by| format!("PTM {by}")),
        (0i64..=130).prop_map(|degrees| format!("MDEG {degrees}")),
    ];
    let tstop = prop::option::of(50u64..2_000);
    (fault, 1u8..=7, moment, prefix, command, tstop).prop_map(
        |(fault, motor, moment, prefix, command, tstop_ms)| Case {
            tstop_ms,
            ..Case::new(fault, motor, moment, prefix + &command)
        },
    )
}

#[test]
fn any_command_under_any_single_fault_reaches_its_prompt_in_time() {
    check(0xFA01, any_case(), |case| case.run().map(|_| ()).map_err(TestCaseError::fail));
}

#[test]
fn control_c_and_disconnect_under_any_single_fault_get_a_prompt() {
    let slowest = Cell::new(0);
    check(0xFA02, (any_case(), 0u64..2_000, any::<bool>()), |(case, after_ms, hangs_up)| {
        let mut session = case.session();
        session.hand.push_rx(case.line.as_bytes());
        session.hand.push_rx(b"\r");
        for ms in 0..after_ms {
            if case.moment == Moment::MidMotion(ms) {
                case.fault.inject(&mut session.hand, case.motor);
            }
            session.wait_us(1000);
        }
        session.hand.take_tx();
        if hangs_up {
            session.hand.hang_up()
        } else {
            session.hand.push_rx(b"\x03")
        }
        let (_, us) = session
            .try_read_to_prompt(ABORT_US)
            .map_err(|hang| TestCaseError::fail(format!("{case:?}: {hang}")))?;
        slowest.set(us.max(slowest.get()));
        Ok(())
    });
    println!(
        "figure: faults: prompt {} ms after ^C or a disconnect at most, bound {} ms",
        slowest.get() / 1000,
        ABORT_US / 1000
    );
}
