//! Lines of SLCAN, for both sides of an adapter: `tiiildd...`, an identifier of three digits, the number of data bytes, and the data.
//!
//! SLCAN has no checksum, so the grammar is the only sign of a character that was lost, doubled or added on the way. It is therefore strict
//! (decision 0071): hexadecimal digits alone, exactly as many as the length says, and after them nothing, or in a received frame
//! the four digits of a time stamp. A line that differs is no frame. A digit that became another digit passes; who acts on a value checks its
//! range, and reads it twice.

use tater_wire::Frame;

/// Longest line of a frame, bytes: eight bytes of data and a time stamp.
pub const LONGEST: usize = 1 + 3 + 1 + 16 + 4;

/// Most characters kept of a line that is no frame: the text of an error or of a version.
const KEPT: usize = 200;

const BEL: u8 = 7;

/// The line of a frame without its end, with the time stamp in ms if there is one.
#[must_use]
pub fn format(frame: &Frame, stamp_ms: Option<u16>) -> String {
    let mut text = format!("t{:03X}{}", frame.raw_id(), frame.data().len());
    frame.data().iter().for_each(|byte| text.push_str(&format!("{byte:02X}")));
    stamp_ms.iter().for_each(|ms| text.push_str(&format!("{ms:04X}")));
    text
}

/// Parses a frame to send: nothing may follow the data. `None`: it is none.
#[must_use]
pub fn frame(line: &[u8]) -> Option<Frame> {
    let (frame, rest) = begin(line)?;
    rest.is_empty().then_some(frame)
}

/// Parses a received frame: its data, then nothing or a time stamp of four digits. `None`: it is none.
#[must_use]
pub fn received(line: &[u8]) -> Option<Frame> {
    let (frame, rest) = begin(line)?;
    (rest.is_empty() || rest.len() == 4 && hex(rest).is_some()).then_some(frame)
}

/// A frame and what follows its data.
fn begin(line: &[u8]) -> Option<(Frame, &[u8])> {
    let (id, rest) = line.strip_prefix(b"t")?.split_at_checked(3)?;
    let (len, rest) = rest.split_first()?;
    let len = usize::try_from(char::from(*len).to_digit(10)?).ok()?;
    let (digits, rest) = rest.split_at_checked(2 * len)?;
    let data: Option<Vec<u8>> = digits.chunks(2).map(|pair| u8::try_from(hex(pair)?).ok()).collect();
    Some((Frame::from_raw(u16::try_from(hex(id)?).ok()?, &data?)?, rest))
}

/// One to eight hexadecimal digits and nothing else.
#[must_use]
pub fn hex(digits: &[u8]) -> Option<u32> {
    let digit = |value: u32, byte: &u8| Some(value << 4 | char::from(*byte).to_digit(16)?);
    if digits.is_empty() || digits.len() > 8 { None } else { digits.iter().try_fold(0, digit) }
}

/// What an adapter has sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Said {
    /// An acknowledgment: a line without text, `z`, `Z`, or `#` of CANable 2.5.
    Done,
    /// A refusal: BEL, or `#` with a code.
    Refused,
    /// A frame from the bus.
    Frame(Frame),
    /// A line that should be a frame and is none.
    Damaged,
    /// Another line: an answer to a command, a banner, a report.
    Text(Vec<u8>),
}

/// Splits what an adapter sends. CR, LF and CR LF each end a line once; BEL stands alone.
#[derive(Clone, Debug, Default)]
pub struct Lines {
    line: Vec<u8>,
    has_cr: bool,
}

impl Lines {
    /// Takes the next byte, and passes on what it completes.
    pub fn push(&mut self, byte: u8, say: &mut dyn FnMut(Said)) {
        let had_cr = std::mem::replace(&mut self.has_cr, byte == b'\r');
        match byte {
            b'\n' if had_cr => {}
            b'\r' | b'\n' => {
                let line = std::mem::take(&mut self.line);
                if line.is_empty() { say(Said::Done) } else { meaning(&line, say) }
            }
            BEL => {
                let line = std::mem::take(&mut self.line);
                if !line.is_empty() {
                    meaning(&line, say);
                }
                say(Said::Refused);
            }
            _ if self.line.len() < KEPT => self.line.push(byte),
            _ => {}
        }
    }

    /// The line that has begun.
    #[must_use]
    pub fn rest(&self) -> &[u8] {
        &self.line
    }
}

/// What a line with text means. Adapters that leave out the CR after an acknowledgment join it to the next line.
fn meaning(line: &[u8], say: &mut dyn FnMut(Said)) {
    let acknowledgments = line.iter().take_while(|byte| matches!(byte, b'z' | b'Z')).count();
    (0..acknowledgments).for_each(|_| say(Said::Done));
    match line.get(acknowledgments..).unwrap_or_default() {
        [] => {}
        rest @ [b't', ..] => say(received(rest).map_or(Said::Damaged, Said::Frame)),
        b"#" => say(Said::Done),
        [b'#', ..] => say(Said::Refused),
        // The first letter of a frame is lost or another one. Other frames, reports and answers have these.
        [first, rest @ ..]
            if rest.len() >= 4
                && rest.iter().all(u8::is_ascii_hexdigit)
                && !b"TRrdDbBEFLMNVX".contains(first) =>
        {
            say(Said::Damaged);
        }
        rest => say(Said::Text(rest.to_vec())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stat() -> Frame {
        Frame::from_raw(0x486, &[0x85, 0, 2, 0]).expect("a classic frame")
    }

    fn said(bytes: &[u8]) -> Vec<Said> {
        let (mut lines, mut all) = (Lines::default(), Vec::new());
        bytes.iter().for_each(|byte| lines.push(*byte, &mut |said| all.push(said)));
        all
    }

    #[test]
    fn frame_round_trips_with_and_without_a_time_stamp() {
        assert_eq!(format(&stat(), None), "t486485000200");
        assert_eq!(format(&stat(), Some(0xEA5F)), "t486485000200EA5F");
        assert_eq!(frame(b"t486485000200"), Some(stat()));
        assert_eq!(received(b"t486485000200EA5F"), Some(stat()));
        assert_eq!(received(b"t7ff2abcd"), Frame::from_raw(0x7FF, &[0xAB, 0xCD]), "lower case");
        assert_eq!(frame(b"t486485000200EA5F"), None, "nobody sends with a time stamp");
    }

    /// KP 120 with a stray digit, and what `from_str_radix` takes.
    #[test]
    fn damaged_line_is_no_frame() {
        for line in [
            &b""[..],
            b"t",
            b"t48",
            b"t4864850002",
            b"t4864CF0027800",
            b"t49648500+000",
            b"t+4864850002",
            b"t486+85000200",
            b"t486485000200 ",
            b"t4864850002001",
            b"t48648500020012",
            b"t486485000200123",
            b"t48648500020012345",
            b"t486485000200+123",
            b"t486485000200EA5F0",
            b"t8000",
            b"t48\xC3\xA9",
            b"T4860",
            b"t4869000000000000000000",
            b" t486485000200",
            b"t486485000200t486485000200",
        ] {
            assert_eq!(received(line), None, "{:?}", line.escape_ascii().to_string());
            assert_eq!(frame(line), None, "{:?}", line.escape_ascii().to_string());
        }
    }

    /// One character lost, doubled or added anywhere in the line of any frame.
    #[test]
    fn lost_doubled_or_added_character_is_never_another_frame() {
        for len in 0..=8_u8 {
            let data: Vec<u8> = (0..len).map(|at| 0x8F ^ at.wrapping_mul(0x35)).collect();
            let whole = format(&Frame::from_raw(0x486, &data).expect("a classic frame"), None).into_bytes();
            for at in 0..whole.len() {
                let mut lost = whole.clone();
                lost.remove(at);
                assert_eq!(received(&lost), None, "{:?}", lost.escape_ascii().to_string());
                for added in b"0123456789ABCDEFt+" {
                    let mut longer = whole.clone();
                    longer.insert(at, *added);
                    assert_eq!(received(&longer), None, "{:?}", longer.escape_ascii().to_string());
                }
            }
        }
    }

    #[test]
    fn dialects_say_the_same() {
        use Said::{Done, Refused};
        let frame = Said::Frame(stat());
        for (bytes, expected) in [
            (&b"\r"[..], vec![Done]),
            (b"\r\n", vec![Done]),
            (b"\n", vec![Done]),
            (b"z\r", vec![Done]),
            (b"Z\r", vec![Done]),
            (b"#\r", vec![Done]),
            (b"\x07", vec![Refused]),
            (b"#3\r", vec![Refused]),
            (b"zz\x07", vec![Done, Done, Refused]),
            (b"zt486485000200\rt486485000200\n", vec![Done, frame.clone(), frame.clone()]),
            (b"zZt486485000200EA5F\r\n", vec![Done, Done, frame]),
            (b"t4864CF0027800\r486485000200\r", vec![Said::Damaged, Said::Damaged]),
            (b"V1013\r", vec![Said::Text(b"V1013".to_vec())]),
            (b"b158aa7\r\n", vec![Said::Text(b"b158aa7".to_vec())]),
        ] {
            assert_eq!(said(bytes), expected, "{:?}", bytes.escape_ascii().to_string());
        }
    }

    #[test]
    fn line_without_an_end_is_bounded() {
        let mut lines = Lines::default();
        (0..1_000_000).for_each(|_| lines.push(b't', &mut |said| panic!("{said:?}")));
        assert!(lines.rest().len() <= KEPT);
    }
}
