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
    session.hand.hear(b"frOb\r");
    assert_eq!(session.until_prompt(), "frOb\r\n\rERR 32\r\n\r=> ");
    session.hand.hear(b"\r");
    assert_eq!(session.until_prompt(), "\r\n\r=> ", "an empty line prompts");
    session.hand.hear(b"abc\x03");
    assert_eq!(session.until_prompt(), "\r\n\r=> ", "^C forgets the line");
    session.hand.hear(b"\n\x08vx\x08\x7f\r");
    assert_eq!(session.until_prompt(), "vx\x08 \x08\x08 \x08\r\n\r=> ", "backspace; LF is skipped");
}
