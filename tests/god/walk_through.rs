//! The walk-through (manual 3), steps 7 to 17, typed verbatim at the host's console (`hil_sim::grasper`).

use hil_sim::grasper::Console;
use hil_sim::hand::Hand;
use hil_sim::hand::scene::Scene;
use hil_sim::plant::Model;

use super::movement::assert_near;
use super::{COMMAND_US, Session, golden};

/// Steps (there is no step 9), entries, and the positions after them, hall counts. Tips follow: 27 and 88 for 100 and 331; 331 is CT's default.
const STEPS: &[(u8, &[&str], [i32; 7])] = &[
    (7, &["WAKE"], [0; 7]),
    (8, &["123 G TEMP"], [0; 7]),
    (10, &["M", "123", "100"], [100, 100, 100, 0, 27, 27, 27]),
    (11, &["4 S E 82", "4 S M 5"], [100, 100, 100, 82, 27, 27, 27]),
    (12, &["C", "1"], [331, 100, 100, 82, 88, 27, 27]),
    (13, &["O", "1"], [0, 100, 100, 82, 0, 27, 27]),
    (14, &["4 S E 164", "4 S M 5"], [0, 100, 100, 164, 0, 27, 27]),
    (15, &["C", "123"], [331, 331, 331, 164, 88, 88, 88]),
    (16, &["123 G TEMP"], [331, 331, 331, 164, 88, 88, 88]),
    (17, &["SAVE"], [331, 331, 331, 164, 88, 88, 88]),
];

/// The hand after its power has been off, fingers that may meet each other around it.
fn power_cycle(session: &Session) -> Session {
    let mut hand = Hand::restore(Model::Averaged, 1, &session.hand.state()).expect("within its stops");
    hand.set_scene(Scene::default());
    Session::from_hand(hand)
}

struct Person<'a> {
    session: &'a mut Session,
    console: Console,
    screen: String,
}

impl Person<'_> {
    fn wait(&mut self) {
        let end_us = self.session.hand.now_us() + COMMAND_US;
        loop {
            if let Some(line) = self.console.next_line() {
                self.session.hand.push_rx(line.as_bytes());
            }
            if let Some(question) = self.console.question() {
                self.screen.push_str(question);
                return;
            }
            assert!(self.session.hand.now_us() < end_us, "no question: {}", self.screen);
            self.session.wait_us(1000);
            for line in
                self.session.hand.take_tx().into_iter().filter_map(|byte| self.console.push_byte(byte))
            {
                self.screen.push_str(&format!("{line}\n"));
            }
        }
    }

    fn enter(&mut self, entry: &str) {
        self.screen.push_str(&format!("{entry}\n"));
        for line in self.console.enter(entry).expect("the manual's") {
            self.screen.push_str(&format!("-> {line}\n"));
        }
        self.wait();
    }
}

fn walk(session: &mut Session) -> String {
    let mut person = Person { session, console: Console::default(), screen: String::new() };
    person.wait();
    for (step, entries, places) in STEPS {
        entries.iter().for_each(|entry| person.enter(entry));
        assert_near(person.session, *places, &format!("step {step}"));
    }
    assert!(!person.console.had_error(), "{}", person.screen);
    person.screen + "\n"
}

#[test]
fn walk_through_after_save_keeps_trusted_positions() {
    let mut session = Session::new();
    for line in ["HI", "SAVE"] {
        assert_eq!(session.run(line), "");
    }
    let mut session = power_cycle(&session);
    golden::verbatim("walk-through", &walk(&mut session));
    let mut session = power_cycle(&session);
    assert_eq!(session.run("X1234567FGET S"), "0 0 0 0 0 0 0", "ready");
    assert_eq!(session.run("HOME"), "", "and moved by GCL without HI");
    assert_near(&session, [0; 7], "HOME");
}

#[test]
fn walk_through_without_homing_keeps_positions_untrusted() {
    let mut session = Session::new();
    walk(&mut session);
    let mut session = power_cycle(&session);
    assert_eq!(session.run("X1234567FGET S"), "4 4 4 4 4 4 4");
    assert_eq!(session.run("HOME"), "ERR 4");
}
