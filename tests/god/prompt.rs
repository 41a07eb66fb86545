//! Echo, prompt and line ends, on which clients synchronize (decision 0025).

use super::Session;

#[test]
fn start_prints_banner_and_prompt() {
    let session = Session::new();
    assert!(session.transcript.contains("BarrettHand Firmware"), "{:?}", session.transcript);
    assert!(session.transcript.ends_with("\r\n\r=> "));
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
