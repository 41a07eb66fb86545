//! Echo, prompt, line ends: what clients synchronise on (PROTOCOL 3).

use super::Session;

#[test]
fn it_says_hello_and_prompts() {
    let session = Session::new();
    assert!(session.heard.contains("BarrettHand Firmware"), "{:?}", session.heard);
    assert!(session.heard.ends_with("\r\n\r=> "));
}

#[test]
fn every_character_is_echoed_in_its_own_case_but_the_cr() {
    let mut session = Session::new();
    session.hand.push_rx(b"frOb\r");
    assert_eq!(session.until_prompt(), "frOb\r\n\rERR 32\r\n\r=> ");
    session.hand.push_rx(b"\r");
    assert_eq!(session.until_prompt(), "\r\n\r=> ", "an empty line prompts");
    session.hand.push_rx(b"abc\x03");
    assert_eq!(session.until_prompt(), "\r\n\r=> ", "^C forgets the line");
    session.hand.push_rx(b"\x08vx\x08\x7f\r");
    assert_eq!(session.until_prompt(), "vx\x08 \x08\x08 \x08\r\n\r=> ", "backspace");
}

#[test]
fn a_line_ends_with_cr_or_lf_or_both() {
    let mut session = Session::new();
    for (ends, prompts) in
        [("\r", 1), ("\n", 1), ("\r\n", 1), ("\n\r", 1), ("\r\r", 2), ("\n\n", 2), ("\r\n\r\n", 2)]
    {
        // What the last line ended with is none of this one's.
        session.hand.push_rx(b"frob");
        session.hand.push_rx(ends.as_bytes());
        session.wait_us(10_000);
        let said: String = session.hand.take_tx().into_iter().map(char::from).collect();
        assert_eq!(said, format!("frob\r\n\rERR 32{}", "\r\n\r=> ".repeat(prompts)), "{ends:?}");
    }
    // One of the two comes long after the other, as a command's end.
    session.hand.push_rx(b"\r");
    session.until_prompt();
    session.hand.push_rx(b"\n\tFGET\tEN\t\r");
    assert_eq!(session.until_prompt(), "\tFGET\tEN\t\r\n\r1 1 1 1\r\n\r=> ");
}
