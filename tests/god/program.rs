//! A script of lines, as `hil-sim gcl` types it.

use god::Memory;
use hil_sim::hand::Hand;
use hil_sim::typist::{Reply, Typist};
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
        let said = typist.run_line(line).expect("it prompts");
        let ms = said.ms;
        let (line, answer, unsolicited) = (line.to_owned(), answer.to_owned(), vec![]);
        assert_eq!(said, Reply { line, answer, status, unsolicited, ms });
        assert!(ms > 0.0 && ms < 5000.0, "{ms} ms: {said:?}");
    }
}

#[test]
fn what_nobody_asked_for_is_no_line_s_answer() {
    let mut typist = typist();
    for line in ["HI", "4 S E 82", "4 S M 5", "WAIT 2000"] {
        let said = typist.run_line(line).expect("it prompts");
        assert_eq!((&*said.answer, said.unsolicited.len()), ("", 0), "{said:?}");
    }
    assert_eq!(typist.run_line("4 G AP").expect("it prompts").unsolicited, ["4 MODE=3"]);
    typist.run_line("4 S E 0").expect("it prompts");
    typist.run_line("4 S M 5").expect("it prompts");
    // More than any other line has.
    assert_eq!(typist.run_line("wait 700000").expect("it prompts").ms.round(), 700_000.0);
    assert_eq!(typist.unsolicited(), ["4 MODE=3"]);
}
