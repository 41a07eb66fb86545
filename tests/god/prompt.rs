//! Echo, prompt and line ends, on which clients synchronize (decision 0025).

use super::Session;

#[test]
fn start_prints_banner_and_prompt() {
    let session = Session::new();
    assert!(session.transcript.contains("BarrettHand Firmware"), "{:?}", session.transcript);
    assert!(session.transcript.ends_with("\r\n\r=> "));
    // Barrett's library searches for the words with LF behind them, in a text whose end it has trimmed.
    let trimmed = session.transcript.trim_end_matches("=> ").trim();
    assert!(trimmed.contains("BarrettHand Firmware\n"), "{trimmed:?}");
}

#[test]
fn echo_keeps_case_and_omits_cr() {
    let mut session = Session::new();
    session.hand.push_rx(b"frOb\r");
    assert_eq!(session.read_to_prompt(), "frOb\r\n\rERR 32\r\n\r=> ");
    session.hand.push_rx(b"\r");
    assert_eq!(session.read_to_prompt(), "\r\n\r=> ", "an empty line prompts");
    session.hand.push_rx(b"abc\x03");
    assert_eq!(session.read_to_prompt(), "\r\n\r=> ", "^C drops the line");
    session.hand.push_rx(b"\x08vx\x08\x7f\r");
    assert_eq!(session.read_to_prompt(), "vx\x08 \x08\x08 \x08\r\n\r=> ", "backspace");
}

#[test]
fn line_ends_with_cr_or_lf_or_both() {
    let mut session = Session::new();
    for (ends, prompts) in
        [("\r", 1), ("\n", 1), ("\r\n", 1), ("\n\r", 1), ("\r\r", 2), ("\n\n", 2), ("\r\n\r\n", 2)]
    {
        // The CR or LF of the line before does not combine with this line's end.
        session.hand.push_rx(b"frob");
        session.hand.push_rx(ends.as_bytes());
        session.wait_us(10_000);
        let received: String = session.hand.take_tx().into_iter().map(char::from).collect();
        assert_eq!(received, format!("frob\r\n\rERR 32{}", "\r\n\r=> ".repeat(prompts)), "{ends:?}");
    }
    // CR and LF of one line end may come far apart.
    session.hand.push_rx(b"\r");
    session.read_to_prompt();
    session.hand.push_rx(b"\n\tFGET\tEN\t\r");
    assert_eq!(session.read_to_prompt(), "\tFGET\tEN\t\r\n\r1 1 1 1\r\n\r=> ");
}

/// Telnet ends a line by CR NUL, and old terminals send NULs as fillers.
#[test]
fn nul_ends_no_line_and_begins_none() {
    let mut session = Session::new();
    for (bytes, received) in [
        (&b"PGET LFT\r\0PGET BAUD\r\0VERS\r\0"[..], "PGET LFT|0|=> PGET BAUD|96|=> VERS|600|=> "),
        (b"VERS\r\0\r\0\r\0", "VERS|600|=> |=> |=> "),
        (b"\0\0\0VE\0RS\r\0\0", "VERS|600|=> "),
        (b"VERS\r\n\0", "VERS|600|=> "),
        // A packet may follow a NUL as it may follow a line: GET STAT to node 1.
        (b"VERS\r\0\0\x01\x01\x05", "VERS|600|=> |1 STAT=0"),
    ] {
        session.hand.push_rx(bytes);
        session.wait_us(100_000);
        let text: String = session.hand.take_tx().into_iter().map(char::from).collect();
        assert_eq!(text.replace("\r\n\r", "|"), received, "{:?}", bytes.escape_ascii().to_string());
    }
}

/// `1FSET DP -100` with an en dash would set +100 without it.
#[test]
fn line_with_a_byte_of_no_character_runs_nothing() {
    let mut session = Session::new();
    let dp = |session: &mut Session| session.run("1FGET DP");
    assert_eq!(dp(&mut session), "8500");
    let lines = ["1FSET DP \u{2013}100", "1FSET DP \u{2212}7", "1FSET DP 1\u{a0}00", "1FSET\u{3000}DP 5"];
    let lines = lines.iter().map(|line| line.as_bytes().to_vec());
    let bytes = (0..=0xFF).filter(|byte| !matches!(byte, 0 | 3 | 8..=10 | 13 | b' '..=0x7F));
    let lines = lines.chain(bytes.map(|byte| [b"1FSET DP ", &[byte][..], b"100"].concat()));
    for line in lines {
        session.hand.push_rx(&line);
        session.hand.push_rx(b"\r");
        let received = session.read_to_prompt();
        // Clients count the echo; a control character is not echoed, because it could be a packet's head.
        let echo: String = line.iter().filter(|&&byte| byte >= b' ').map(|&byte| char::from(byte)).collect();
        assert_eq!(
            received,
            format!("{echo}\r\n\rERR 128\r\n\r=> "),
            "{:?}",
            line.escape_ascii().to_string()
        );
    }
    assert_eq!(dp(&mut session), "8500");
    // Backspace takes the dash back.
    session.hand.push_rx("1FSET DP \u{2013}\x7f-100\r".as_bytes());
    session.read_to_prompt();
    assert_eq!(dp(&mut session), "-100");
}

/// A break of the serial line, for which a device server takes a Telnet client's Interrupt Process and Break as well.
#[test]
fn break_aborts_a_line_a_command_a_packet_and_realtime() {
    let mut session = Session::new();
    session.run("HI");
    for (bytes, wait_us, received) in [
        (&b""[..], 0, "|=> "),
        (b"half a line", 1_000, "half a line|=> "),
        (b"WAIT 5000\r", 100_000, "WAIT 5000|ERR 16384|=> "),
        (b"GC\r", 300_000, "GC|ERR 16384|=> "),
        (b"\x00\x04\x06\xBA", 1_000, "|=> "),
        (b"\x00\x04\x09", 1_000, "|=> "),
        (b"SLOOP\rC\x14", 300_000, "SLOOP*"),
    ] {
        session.hand.push_rx(bytes);
        session.wait_us(wait_us);
        session.hand.push_break();
        session.wait_us(200_000);
        let text: String = session.hand.take_tx().into_iter().map(char::from).collect();
        let text = text.replace("\r\n\r", "|");
        // RealTime's feedback is binary.
        let is_realtime =
            received.ends_with('*') && text.starts_with(received) && text.ends_with("|ERR 16384|=> ");
        assert!(text == received || is_realtime, "{text:?}");
        let truths = session.hand.bus().stations().map(|node| node.board().rig().truth().counts_per_s);
        assert!(truths.into_iter().all(|speed| speed.abs() < 1.0), "{received}");
        assert_eq!(session.run("VERS"), "600");
    }
}
