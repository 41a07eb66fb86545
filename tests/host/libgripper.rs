//! libgripper: a BH8-262's driver over a serial line of 9600 baud.
//!
//! It compares the echo, then reads to LF CR `=> ` within 15 s, and takes LF CR `ERR n` for an error. In RealTime it sends a velocity for
//! each finger and a torque of two bytes for the spread, and accepts a feedback block only whole and within 100 ms: two bytes of position for
//! each motor, then one byte of temperature.

use god::Memory;
use hil_world::hand::Motorized;
use hil_world::node::Node;

use board_emu::hand::boards;

use super::serial::{Port, native};
use crate::emulated::bench::production;

const SUPERVISORY_MS: u64 = 15_000;
const LOOP_MS: u64 = 500;
const BLOCK_MS: u64 = 100;
const STOP_MS: u64 = 1_500;

/// Header, four positions, temperature.
const FEEDBACK: usize = 1 + 4 * 2 + 1;

struct Gripper<S> {
    port: Port<S>,
}

#[derive(Debug)]
struct Feedback {
    /// GCL counts, unsigned.
    positions: [u16; 4],
    /// °C.
    temperature: i8,
}

impl<S: Motorized> Gripper<S> {
    fn on(boards: Vec<S>, memory: Memory) -> Self {
        Self { port: Port::open(boards, memory) }
    }

    /// A hand that has been set up for this program: COMPAT 262, kept by PSAVE over a power-off.
    fn set_up(boards: impl Fn() -> Vec<S>) -> Self {
        let mut gripper = Self::on(boards(), Memory::default());
        gripper.supervisory("PSET COMPAT 262").expect("a parameter of the hand");
        gripper.supervisory("PSAVE").expect("it is kept");
        Self::on(boards(), Memory::new(gripper.port.hand.memory().stored()))
    }

    /// Returns the text, or the number after ERR.
    fn supervisory(&mut self, command: &str) -> Result<String, u16> {
        self.port.write(format!("{command}\r").as_bytes());
        let echo = self.port.read(command.len(), SUPERVISORY_MS).expect("an echo in time");
        assert_eq!(echo, command.as_bytes(), "the echo is what was sent");
        let text = self.port.read_until(b"\n\r=> ", SUPERVISORY_MS);
        let text = text.unwrap_or_else(|| panic!("no prompt after {command}: {:?}", self.port.unread()));
        let text: String = text.into_iter().map(char::from).collect();
        match text.split_once("\n\rERR ") {
            Some((_, code)) => {
                Err(code.split('\r').next().and_then(|code| code.parse().ok()).expect("a number"))
            }
            None => Ok(text.trim_end_matches("\n\r=> ").trim().to_owned()),
        }
    }

    fn is_initialized(&mut self) -> bool {
        let status = self.supervisory("1234FGET S").expect("four statuses");
        let status: Vec<&str> = status.split_whitespace().collect();
        assert_eq!(status.len(), 4, "{status:?}");
        status.iter().all(|status| *status == "0")
    }

    /// Initializes the hand and configures RealTime. Returns the first error.
    fn initialize(&mut self) -> Result<(), u16> {
        if !self.is_initialized() {
            self.supervisory("HI")?;
        }
        // Gains of that hand's motor controllers; it does not look at the result.
        let _ = self.supervisory("SFSET FPG 5 FIP 1 FDZ 100");
        let _ = self.supervisory("GFSET FPG 10 FIP 0 FDZ 0");
        for (motor, velocity, coefficient, torque) in
            [("1", 1, 2, 0), ("2", 1, 2, 0), ("3", 1, 2, 0), ("S", 0, 0, 1)]
        {
            let flags = format!(
                "LCV {velocity} LCVC {coefficient} LCPG 0 LCT {torque} LFV 0 LFVC 1 LFAP 1 LFS 0 LFDP 0 LFBP 0 LFAIN 0"
            );
            self.supervisory(&format!("{motor}FSET {flags}"))?;
        }
        self.supervisory("PSET LFT 1").map(|_| ())
    }

    fn start_realtime(&mut self) {
        let line = "1234LOOP";
        self.port.write(format!("{line}\r").as_bytes());
        assert_eq!(self.port.read(line.len(), LOOP_MS).as_deref(), Some(line.as_bytes()));
        assert_eq!(self.port.read(1, LOOP_MS).as_deref(), Some(&b"*"[..]));
        self.block(b"A");
    }

    fn block(&mut self, control: &[u8]) -> Feedback {
        self.port.write(control);
        let block = self.port.read(FEEDBACK, BLOCK_MS).expect("a feedback block in time");
        assert_eq!(block[0], b'*', "{block:?}");
        let position = |motor: usize| u16::from_be_bytes([block[1 + 2 * motor], block[2 + 2 * motor]]);
        Feedback { positions: std::array::from_fn(position), temperature: block[9].cast_signed() }
    }

    /// A control block: velocities of the fingers, torque of the spread.
    fn control(&mut self, velocity: i8, torque: i16) -> Feedback {
        let velocity = velocity.cast_unsigned();
        let [high, low] = torque.to_be_bytes();
        self.block(&[b'C', velocity, velocity, velocity, high, low])
    }

    fn stop_realtime(&mut self) {
        self.port.write(b"\x03");
        self.port.read_until(b"=> ", STOP_MS).expect("a prompt");
        assert_eq!(self.port.unread(), b"", "a block left over would be taken for the next echo");
    }
}

#[test]
fn libgripper_runs_with_compat_262() {
    runs(Gripper::set_up(native));
}

#[test]
fn libgripper_runs_with_compat_262_on_emulated_boards() {
    let Some(programs) = production() else { return };
    runs(Gripper::set_up(|| boards(&programs)));
}

fn runs<S: Motorized>(mut gripper: Gripper<S>) {
    gripper.initialize().expect("it is configured");
    assert!(gripper.is_initialized());
    gripper.start_realtime();
    // 60 × LCVC 2 × 55 GCL counts a second; the spread's friction takes 63 of the torque.
    let begin_us = gripper.port.hand.now_us();
    let mut blocks = 0;
    let feedback = loop {
        let feedback = gripper.control(60, 200);
        blocks += 1;
        assert!(gripper.port.hand.now_us() < begin_us + 10_000_000, "{feedback:?}");
        if feedback.positions[..3].iter().all(|position| (5_000..20_000).contains(position)) {
            break feedback;
        }
    };
    let seconds = (gripper.port.hand.now_us() - begin_us) as f64 * 1e-6;
    println!("figure: libgripper at 9600 baud: {:.0} blocks/s", f64::from(blocks) / seconds);
    assert!(feedback.positions[3] > 500, "the spread obeys its torque: {feedback:?}");
    assert_eq!(feedback.temperature, 35);
    let spread = feedback.positions[3];
    (0..40).for_each(|_| _ = gripper.control(0, -200));
    assert!(gripper.control(0, 0).positions[3] < spread, "and the other way");
    gripper.stop_realtime();
    // Its supervisory commands in between.
    for command in ["1234O", "GC", "GO"] {
        assert_eq!(gripper.supervisory(command), Ok(String::new()), "{command}");
    }
    // moveTo sends no command; it does not look at the result either.
    assert!(gripper.supervisory("S 1575").is_err() && gripper.supervisory("123 1575").is_err());
    gripper.start_realtime();
    gripper.stop_realtime();
}

/// A host that stops sending, as libgripper does when its callback hangs: the torque ends like the velocities do.
#[test]
fn libgripper_is_silent_spread_stops() {
    let mut gripper = Gripper::set_up(native);
    gripper.initialize().expect("it is configured");
    gripper.start_realtime();
    (0..30).for_each(|_| _ = gripper.control(20, 300));
    gripper.port.wait_ms(600);
    let truth = |gripper: &Gripper<Node>| -> Vec<f64> {
        gripper.port.hand.bus().stations().map(|node| node.board().rig().truth().counts_per_s).collect()
    };
    assert_eq!(truth(&gripper), [0.0; 7]);
    let still = gripper.block(b"A").positions;
    let moved = (0..30).map(|_| gripper.control(20, -300)).last().expect("30 blocks").positions;
    assert!(moved[0] > still[0] && moved[3] < still[3], "{still:?} {moved:?}");
    gripper.stop_realtime();
}

/// Without COMPAT 262 the manual's table 5 holds: LCVC 0 and LCT 1 are out of range, and the blocks are longer.
#[test]
fn libgripper_fails_without_compat_262() {
    let mut gripper = Gripper::on(native(), Memory::default());
    assert_eq!(gripper.initialize(), Err(128));
    for (line, result) in [
        ("SFSET LCT 0", Ok(String::new())),
        ("SFSET LCT 1", Err(128)),
        ("SFSET LCVC 0", Err(128)),
        ("PSET COMPAT 1", Err(128)),
        ("PSET COMPAT 262", Ok(String::new())),
        ("SFSET LCT 1", Ok(String::new())),
        ("SFGET LCT LCVC", Ok("1 8".to_owned())),
        ("GFSET LCT 1", Err(128)),
        ("FSET LCT 1", Err(128)),
        ("GFSET LCT 0", Ok(String::new())),
        ("1FSET LCVC 0", Ok(String::new())),
        ("PGET COMPAT", Ok("262".to_owned())),
        // Back: LCT has no effect, LCVC 0 stays until it is set.
        ("PSET COMPAT 0", Ok(String::new())),
        ("1FGET LCVC", Ok("0".to_owned())),
        ("PDEF", Ok(String::new())),
        ("PGET COMPAT", Ok("0".to_owned())),
    ] {
        assert_eq!(gripper.supervisory(line), result, "{line}");
    }
}
