//! Scripts as `hil-sim gcl` types them.

use god::Memory;
use hil_experiment::typist::{Reply, Typist};
use hil_world::hand::Hand;
use hil_world::plant::Model;

fn typist() -> Typist {
    let (typist, hello) = Typist::new(Hand::new(Model::Averaged, 1, Memory::default())).expect("it prompts");
    assert!(hello.contains("BarrettHand Firmware"), "{hello:?}");
    typist
}

#[test]
fn typist_returns_answers_and_statuses() {
    let mut typist = typist();
    let [long, longer] = [1_000, 4_000].map(|len| "x".repeat(len));
    for (line, answer, status) in [
        ("", "", 0),
        ("frOb", "ERR 32", 32),
        ("frob\x03", "", 0),
        // Longer than GOD's input queue: no byte is lost.
        (&long, "ERR 1024", 1024),
        // The echo is longer than GOD's output queue.
        (&longer, "ERR 1024", 1024),
        ("HI", "", 0),
        ("1 loop ", "*", 0),
        ("", "", 0),
    ] {
        let received = typist.run_line(line).expect("it prompts");
        let ms = received.ms;
        let (line, answer, unsolicited) = (line.to_owned(), answer.to_owned(), vec![]);
        assert_eq!(received, Reply { line, answer, status, unsolicited, ms });
        // HI, with its proof that each motor turns (decision 0048), takes 5.3 s.
        assert!(ms > 0.0 && ms < 6000.0, "{ms} ms: {received:?}");
    }
}

/// RealTime of several motors ends some ms after its ^C: a second one would have a prompt that the next line takes for its own.
#[test]
fn typist_keeps_step_after_loop() {
    let mut typist = typist();
    for line in ["HI", "LOOP", "VERS", "frob", "13SLOOP", "PGET LFT", "X1234567LOOP", "VERS"] {
        let reply = typist.run_line(line).expect("it prompts");
        let expected = match line {
            "VERS" => ("600", 0),
            "frob" => ("ERR 32", 32),
            "PGET LFT" => ("0", 0),
            "HI" => ("", 0),
            _ => ("*", 0),
        };
        assert_eq!(
            (&*reply.answer, reply.status, reply.unsolicited.len()),
            (expected.0, expected.1, 0),
            "{line}"
        );
    }
    assert_eq!(typist.unsolicited(), [""; 0]);
}

/// `0 S REPLY 1`: packets are shown as digits, in answers and unasked.
#[test]
fn typist_prints_packets_as_digits() {
    let mut typist = typist();
    for line in ["WAKE", "0 S REPLY 1", "4 S E 20", "4 S M 5", "WAIT 3000"] {
        assert_eq!(typist.run_line(line).expect("it prompts").answer, "", "{line}");
    }
    let reply = typist.run_line("12 G TEMP").expect("it prompts");
    assert_eq!(reply.unsolicited, ["04 86 04 88 00 03 00 (4 MODE=3)"]);
    assert_eq!(reply.answer, "04 26 04 89 00 5E 01 (1 TEMP=350)\n04 46 04 89 00 5E 01 (2 TEMP=350)");
}

#[test]
fn typist_separates_unsolicited_text_from_answers() {
    let mut typist = typist();
    for line in ["HI", "4 S E 82", "4 S M 5", "WAIT 2000"] {
        let received = typist.run_line(line).expect("it prompts");
        assert_eq!((&*received.answer, received.unsolicited.len()), ("", 0), "{received:?}");
    }
    assert_eq!(typist.run_line("4 G AP").expect("it prompts").unsolicited, ["4 MODE=3"]);
    typist.run_line("4 S E 0").expect("it prompts");
    typist.run_line("4 S M 5").expect("it prompts");
    // Longer than the timeout of any other line.
    assert_eq!(typist.run_line("wait 700000").expect("it prompts").ms.round(), 700_000.0);
    assert_eq!(typist.unsolicited(), ["4 MODE=3"]);
}
