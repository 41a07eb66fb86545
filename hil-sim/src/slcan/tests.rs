use super::*;
use proptest::prelude::*;

fn exchange(slcan: &mut Slcan, text: &[u8]) -> (Vec<u8>, Vec<Frame>) {
    let mut out = Vec::new();
    let frames = text.iter().filter_map(|&byte| slcan.push(byte, &mut out)).collect();
    (out, frames)
}

fn answer(slcan: &mut Slcan, text: &str) -> String {
    String::from_utf8(exchange(slcan, text.as_bytes()).0).expect("answers are ASCII")
}

fn opened() -> Slcan {
    let mut slcan = Slcan::default();
    assert_eq!(answer(&mut slcan, "S8\rO\r"), "\r\r");
    slcan
}

fn frame(id: u16, data: &[u8]) -> Frame {
    Frame::from_raw(id, data).expect("a classic frame")
}

#[test]
fn python_can_opens_and_closes() {
    // slcanBus(bitrate=1000000): set_bitrate closes, sets, sends an empty data bit rate, opens; the constructor opens
    // again. It reads no answer, so the refusals (closed twice, opened twice) do no harm.
    let mut slcan = Slcan::default();
    assert_eq!(answer(&mut slcan, "C\rS8\r\rO\rO\r"), "\x07\r\r\r\x07");
    let (out, frames) = exchange(&mut slcan, b"t00410A\r");
    assert_eq!((out.as_slice(), frames), (&b"z\r"[..], vec![frame(4, &[10])]));
    // get_version reads two digits of hardware and two of software, get_serial_number all up to the end.
    assert_eq!(answer(&mut slcan, "V\rN\r"), "V0100\rNTATR\r");
    assert_eq!(answer(&mut slcan, "C\r"), "\r");
}

#[test]
fn linux_slcand_opens_and_closes() {
    assert_eq!(answer(&mut Slcan::default(), "C\rS8\rO\rF\rC\r"), "\x07\r\rF00\r\r");
}

#[test]
fn other_bit_rates_are_refused() {
    for rate in 0..=7 {
        assert_eq!(answer(&mut Slcan::default(), &format!("S{rate}\r")), "\x07");
    }
    let mut slcan = Slcan::default();
    // 1 Mbit/s with a sample point of 75 %, then 500 kbit/s, then two that are no registers.
    assert_eq!(answer(&mut slcan, "s0014\rs001C\rs14\rs00140\r"), "\r\x07\x07\x07");
    assert_eq!(answer(&mut slcan, "S4\rO\r"), "\x07\r");
    assert_eq!(answer(&mut slcan, "S8\r"), "\x07", "not while the channel is open");
}

#[test]
fn command_in_the_wrong_channel_state_is_refused() {
    for text in ["t0010\r", "F\r", "C\r"] {
        assert_eq!(answer(&mut Slcan::default(), text), "\x07", "{text} while closed");
    }
    for text in ["S8\r", "O\r", "L\r", "Z1\r", "M00000000\r", "mFFFFFFFF\r", "X1\r", "s0014\r"] {
        assert_eq!(answer(&mut opened(), text), "\x07", "{text} while open");
        assert_eq!(answer(&mut Slcan::default(), text), "\r", "{text} while closed");
    }
    let mut slcan = Slcan::default();
    assert_eq!(exchange(&mut slcan, b"L\rt0010\r"), (b"\r\x07".to_vec(), vec![]), "listening only");
}

#[test]
fn unsupported_frame_is_refused() {
    for text in [
        "t8000\r",                   // identifier above 0x7FF
        "t0019000000000000000000\r", // nine bytes
        "t0011\r",                   // too few digits
        "t001101AA\r",               // too many
        "t00110G\r",                 // no digit
        "t0+10\r",
        "t\r",
        "T000000010\r",
        "r0010\r",
        "R000000010\r",
        "m00000000\r",
        "Q\r",
    ] {
        assert_eq!(exchange(&mut opened(), text.as_bytes()), (vec![BEL], vec![]), "{text}");
    }
    let lower = exchange(&mut opened(), b"t7ff2abcd\n\r").1;
    assert_eq!(lower, [frame(0x7FF, &[0xAB, 0xCD])], "lower case and LF are taken");
}

#[test]
fn overlong_line_is_refused_once() {
    let mut slcan = opened();
    let mut text = vec![b't'; 1_000_000];
    text.extend(b"\rt0010\r");
    assert_eq!(exchange(&mut slcan, &text), (b"\x07z\r".to_vec(), vec![frame(1, &[])]));
    assert!(slcan.line.capacity() < 100, "its memory is bounded");
}

#[test]
fn longest_command_with_a_suffix_is_refused() {
    let eight = "t00181122334455667788";
    assert_eq!(exchange(&mut opened(), format!("{eight}\r").as_bytes()).1.len(), 1);
    for more in ["9", "99", "\x079", "t0010"] {
        assert_eq!(
            exchange(&mut opened(), format!("{eight}{more}\r").as_bytes()),
            (vec![BEL], vec![]),
            "{more:?}"
        );
    }
}

#[test]
fn received_frame_has_a_time_stamp_on_request() {
    let told = |setup: &str, at_us| {
        let mut slcan = Slcan::default();
        let mut out = Vec::new();
        exchange(&mut slcan, setup.as_bytes());
        slcan.frame(&Stamped { at_us, frame: frame(0x486, &[0x85, 0, 2, 0]) }, &mut out);
        String::from_utf8(out).expect("ASCII")
    };
    assert_eq!(told("", 0), "", "closed");
    assert_eq!(told("O\r", 0), "t486485000200\r");
    assert_eq!(told("L\r", 0), "t486485000200\r");
    // 61.234 s: the stamp has wrapped at a minute, to 1234 ms.
    assert_eq!(told("Z1\rO\r", 61_234_567), "t48648500020004D2\r");
    assert_eq!(told("Z1\rZ0\rO\r", 61_234_567), "t486485000200\r");
}

proptest! {
    #[test]
    fn random_bytes_get_one_answer_per_line(text in proptest::collection::vec(
        prop_oneof![any::<u8>(), Just(CR), Just(b't'), Just(b'O'), b'0'..=b'9'], 0..400))
    {
        let mut slcan = Slcan::default();
        let (out, frames) = exchange(&mut slcan, &text);
        let lines = text.iter().filter(|&&byte| byte == CR).count();
        prop_assert_eq!(out.iter().filter(|&&byte| byte == CR || byte == BEL).count(), lines);
        prop_assert!(frames.len() <= lines);
        prop_assert!(slcan.line.len() <= MAX_LINE);
        // After the next CR it accepts commands again.
        exchange(&mut slcan, b"\rC\r");
        prop_assert_eq!(exchange(&mut slcan, b"O\r").0, b"\r".to_vec());
    }

    #[test]
    fn sent_frame_parses_back(id in 0u16..0x800, data in proptest::collection::vec(any::<u8>(), 0..=8)) {
        let mut slcan = opened();
        let sent = frame(id, &data);
        let mut text = Vec::new();
        slcan.frame(&Stamped { at_us: 0, frame: sent }, &mut text);
        prop_assert_eq!(exchange(&mut slcan, &text).1, vec![sent]);
    }
}
