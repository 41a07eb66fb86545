//! `loop`: RealTime by hand. Keys set velocities, and the feedback is shown.

use std::fmt::Write;
use std::ops::ControlFlow;
use std::time::Duration;

use god::Motors;
use god::motors::Prefix;
use wraptor::{Control, Deadline, Feedback, Format, Hand};

use crate::entry::FASTEST;
use crate::output::print;
use crate::trouble::Trouble;
use programs::interrupt;

/// Time between two blocks. A hand stops its motors after 250 ms without one (manual 6).
const PERIOD: Duration = Duration::from_millis(50);

/// Longest time of a block, and of the beginning and the end.
const LIMIT: Duration = Duration::from_secs(2);

/// Unit of velocities in blocks, hall counts/s.
const UNIT: u8 = 8;

/// What one key adds, hall counts/s.
const STEP: i32 = 2 * UNIT as i32;

/// Half the width of a slider, characters.
const HALF: i32 = 10;

const KEYS: &str = "keys: 1 to 7 choose a motor, a all; + or up and - or down change its velocity, space stops all, q or ^C ends";

/// Velocities of the motors, and which of them keys change.
struct Dials {
    /// Numbers of the motors, in the order of the blocks.
    motors: Vec<u8>,
    /// Hall counts/s.
    velocities: Vec<i32>,
    /// A place in both; `None`: all.
    chosen: Option<usize>,
}

impl Dials {
    fn new(motors: &str, velocities: &[i32]) -> Result<Self, Trouble> {
        let axes =
            Prefix::parse(motors.as_bytes()).map_or(Motors::NONE, |prefix| prefix.select(Motors::NONE).axes);
        let motors: Vec<u8> = axes.iter().map(|motor| motor.number()).collect();
        let velocities = match velocities {
            [] => vec![0; motors.len()],
            [all] => vec![*all; motors.len()],
            each if each.len() == motors.len() => each.to_vec(),
            each => {
                return Err(Trouble::Input(format!(
                    "loop: found {} velocities, expected one, or one for each of {} motors\n  next: enter it again",
                    each.len(),
                    motors.len()
                )));
            }
        };
        Ok(Self { motors, velocities, chosen: None })
    }

    /// Obeys keys. [`ControlFlow::Break`]: the user ends the loop.
    fn press(&mut self, keys: &[u8]) -> ControlFlow<()> {
        let mut rest = keys;
        while let [key, after @ ..] = rest {
            rest = after;
            match (key, after) {
                // Up and down of a terminal: ESC [ A and B, in the mode of applications ESC O A.
                (0x1B, [b'[' | b'O', b'A', after @ ..]) => {
                    self.change(STEP);
                    rest = after;
                }
                (0x1B, [b'[' | b'O', b'B', after @ ..]) => {
                    self.change(-STEP);
                    rest = after;
                }
                (b'+' | b'=', _) => self.change(STEP),
                (b'-' | b'_', _) => self.change(-STEP),
                (b' ', _) => self.velocities.fill(0),
                (b'a' | b'A', _) => self.chosen = None,
                (b'1'..=b'7', _) => {
                    let place = self.motors.iter().position(|motor| *motor == key - b'0');
                    self.chosen = place.or(self.chosen);
                }
                // ^C where the terminal makes no signal of it, ^D.
                (b'q' | b'Q' | 3 | 4, _) => return ControlFlow::Break(()),
                _ => {}
            }
        }
        ControlFlow::Continue(())
    }

    fn change(&mut self, by: i32) {
        for (place, velocity) in self.velocities.iter_mut().enumerate() {
            if self.chosen.is_none_or(|chosen| chosen == place) {
                *velocity = (*velocity + by).clamp(-FASTEST, FASTEST);
            }
        }
    }

    /// A line for each motor: its slider, its velocity, and what the hand feeds back.
    fn show(&self, feedback: &Feedback) -> String {
        let mut text = String::new();
        for (place, (motor, velocity)) in self.motors.iter().zip(&self.velocities).enumerate() {
            let mark = if self.chosen.is_none_or(|chosen| chosen == place) { '>' } else { ' ' };
            let at = HALF + velocity * HALF / FASTEST;
            let slider: String = (0..=2 * HALF)
                .map(|x| {
                    if x == at {
                        '#'
                    } else if x == HALF {
                        '|'
                    } else {
                        '-'
                    }
                })
                .collect();
            let axis = feedback.axes.get(place);
            let position =
                axis.and_then(|axis| axis.position).map_or_else(|| "-".to_owned(), |p| p.to_string());
            let strain =
                axis.and_then(|axis| axis.strain).map_or_else(|| "-".to_owned(), |strain| strain.to_string());
            let _ = writeln!(
                text,
                "{mark}{motor} [{slider}] {velocity:>5} counts/s   position {position:>6}   strain {strain:>3}"
            );
        }
        text
    }
}

/// Runs RealTime until its end: a key, ^C, or the time. A script gives velocities and a time.
///
/// # Errors
/// The hand refuses, ends it, or is lost; a script without velocities or time.
pub fn drive(
    hand: &mut Hand,
    motors: &str,
    velocities: &[i32],
    time: Option<Duration>,
    is_typed: bool,
) -> Result<(), Trouble> {
    let mut dials = Dials::new(motors, velocities)?;
    if !is_typed && (velocities.is_empty() || time.is_none()) {
        return Err(Trouble::Input(
            "loop: in a script expected velocities and a time, such as loop 12 40 for 2\n  next: enter it again".into(),
        ));
    }
    let format =
        Format { velocity: Some(UNIT), feeds_strain: true, feeds_position: true, ..Format::default() };
    let mut realtime = hand.realtime(motors, format, LIMIT)?;
    let keyboard = Keyboard::open(is_typed);
    if is_typed {
        print(&format!("{KEYS}\n"))?;
    }
    let end = Deadline::after(time.unwrap_or(Duration::MAX));
    let mut shown = String::new();
    while !end.is_over() && !interrupt::interrupted() {
        let controls: Vec<Control> =
            dials.velocities.iter().map(|velocity| Control { velocity: *velocity, gain: 0 }).collect();
        let feedback = realtime.exchange(&controls, LIMIT)?;
        let up = if shown.is_empty() { String::new() } else { format!("\x1b[{}A", dials.motors.len()) };
        shown = dials.show(&feedback);
        if is_typed {
            print(&format!("{up}{shown}"))?;
        }
        if dials.press(&keyboard.read(PERIOD.min(end.remaining()))).is_break() {
            break;
        }
    }
    realtime.end(LIMIT)?;
    // A script sees where they were last.
    if is_typed { Ok(()) } else { print(&shown) }
}

/// The keys of a person, each at once and without an echo.
struct Keyboard {
    #[cfg(unix)]
    before: Option<rustix::termios::Termios>,
}

#[cfg(unix)]
impl Keyboard {
    fn open(is_typed: bool) -> Self {
        use rustix::termios::{LocalModes, OptionalActions, tcgetattr, tcsetattr};
        let stdin = std::io::stdin();
        let before = if is_typed { tcgetattr(&stdin).ok() } else { None };
        if let Some(before) = &before {
            let mut each = before.clone();
            // ^C stays a signal.
            each.local_modes.remove(LocalModes::ICANON | LocalModes::ECHO);
            // Where the terminal refuses, keys come with Return.
            let _ = tcsetattr(&stdin, OptionalActions::Now, &each);
        }
        Self { before }
    }

    /// The keys that come within the time.
    fn read(&self, time: Duration) -> Vec<u8> {
        use rustix::event::{PollFd, PollFlags, Timespec, poll};
        let stdin = std::io::stdin();
        let rest = Deadline::after(time);
        let mut keys = Vec::new();
        while self.before.is_some() && !rest.is_over() {
            let Ok(limit) = Timespec::try_from(rest.remaining()) else { break };
            // A signal ends the wait: ^C is looked for next.
            if !matches!(poll(&mut [PollFd::new(&stdin, PollFlags::IN)], Some(&limit)), Ok(1..)) {
                return keys;
            }
            let mut bytes = [0; 64];
            match rustix::io::read(&stdin, &mut bytes) {
                Ok(len @ 1..) => keys.extend_from_slice(bytes.get(..len).unwrap_or_default()),
                // The terminal is gone.
                _ => return vec![4],
            }
        }
        if !rest.is_over() {
            std::thread::park_timeout(rest.remaining());
        }
        keys
    }
}

#[cfg(unix)]
impl Drop for Keyboard {
    fn drop(&mut self) {
        use rustix::termios::{OptionalActions, tcsetattr};
        if let Some(before) = &self.before {
            // A terminal that is gone needs nothing.
            let _ = tcsetattr(std::io::stdin(), OptionalActions::Now, before);
        }
    }
}

#[cfg(not(unix))]
impl Keyboard {
    const fn open(_: bool) -> Self {
        Self {}
    }

    /// There are no keys here: velocities are those of the entry.
    fn read(&self, time: Duration) -> Vec<u8> {
        std::thread::park_timeout(time);
        Vec::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_change_the_chosen_motor_or_all() {
        let mut dials = Dials::new("124", &[]).expect("three motors");
        for (keys, velocities) in [
            (&b"+"[..], [16, 16, 16]),
            (b"2++", [16, 48, 16]),
            (b"4\x1b[B\x1bOB", [16, 48, -16]),
            // Not in the loop: the last stays chosen.
            (b"7-", [16, 48, -32]),
            (b"a\x1b[A", [32, 64, -16]),
            (b" ", [0, 0, 0]),
        ] {
            assert!(dials.press(keys).is_continue());
            assert_eq!(dials.velocities, velocities, "{keys:?}");
        }
        assert!(dials.press(&[b'+'; 200]).is_continue());
        assert_eq!(dials.velocities, [FASTEST; 3]);
        for end in [&b"q"[..], b"\x03", b"\x04"] {
            assert!(dials.press(end).is_break());
        }
    }

    #[test]
    fn sliders_show_velocity_and_feedback() {
        let mut dials = Dials::new("X15", &[40, -1016]).expect("two motors");
        dials.chosen = Some(1);
        let lines = dials.show(&Feedback::default());
        assert!(lines.starts_with(" 1 [----------#----------]    40 counts/s"), "{lines}");
        assert!(lines.contains("\n>5 [#---------|----------] -1016 counts/s"), "{lines}");
        assert!(Dials::new("12", &[1, 2, 3]).is_err());
    }
}
