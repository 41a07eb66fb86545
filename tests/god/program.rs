//! A script of lines, as `hil-sim gcl` types it.

use god::Memory;
use hil_sim::hand::Hand;
use hil_sim::hand::script::{Answered, Typist};
use hil_sim::plant::Model;

fn typist() -> Typist {
    let (typist, hello) = Typist::new(Hand::new(Model::Averaged, 1, Memory::default())).expect("it prompts");
    assert!(hello.contains("BarrettHand Firmware"), "{hello:?}");
    typist
}

#[test]
fn lines_have_their_answers_and_statuses() {
    let mut typist = typist();
    let [long, longer] = [1_000, 4_000].map(|len| "x".repeat(len));
    for (line, answer, status) in [
        ("", "", 0),
        ("frOb", "ERR 32", 32),
        ("frob\x03", "", 0),
        // Longer than GOD's queue of bytes: it has heard all of it.
        (&long, "ERR 1024", 1024),
        // Longer than what it can say: its echo.
        (&longer, "ERR 1024", 1024),
        ("HI", "", 0),
        ("1 loop ", "*", 0),
        ("", "", 0),
    ] {
        let said = typist.line(line).expect("it prompts");
        let ms = said.ms;
        assert_eq!(said, Answered { line: line.to_owned(), answer: answer.to_owned(), status, ms });
        assert!(ms > 0.0 && ms < 5000.0, "{line:?} took {ms} ms");
    }
}
