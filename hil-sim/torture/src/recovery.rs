//! Liveness: once all faults have healed, what a user does by the tables of ERROR brings the hand back, in a stated time.

use servo_core::EndReason;
use tater_wire::{Destination, FaultCode, Group, Message, MotorKind, Property};

use super::case::{MOTORS, kind};
use super::download;
use super::fault::{Subject, node_of, with_rig};
use super::identity::KEYS;
use super::invariant::{HOMES, MOVES};
use super::program::packet;
use super::session::Session;
use super::stream::stream;
use hil_world::node::Node;

/// Longest time from the end of the faults until the hand has homed and moved, ms: attempts at HI, FIND for motors that have lost their wiring, C and O.
pub(crate) const RECOVERY_MS: u64 = 120_000;

/// Longest time of a command, ms.
const LINE_MS: u64 = 25_000;

/// Attempts at HI: the first may end in an error whose next step is another one.
const ATTEMPTS: usize = 4;

/// Housing and winding from which torque derates, C: 8 C below OTEMP's default, 110 C (docs/safety.md), less what HI adds. And how long a user
/// waits until they are cooler, ms: five of the housing's time constants.
const HOT_C: [f64; 2] = [57.0, 100.0];
const COOL_MS: u64 = 1_800_000;

/// What a host sends first: it ends what may still run, and undoes what the program has set in GOD.
const QUIET: [&str; 4] = ["REC 5", "REC", "PDEF", "0 S REPLY 0"];

/// And in the boards, once all are awake: an order to several ends at the first that does not answer.
const RESTORE: [&str; 3] = ["1234567 S STAT 2", "1234567 S DEF -1", "X1234567FDEF"];

/// A link without its finger: with X there is no breakaway.
const ALONE: &str = "X1IC 1000";

/// Time that a board needs to wake or to start anew, ms (docs/wire.md).
const START_MS: u64 = 1_200;

/// SET FIND: learn, test move and back, and what the observer says (docs/properties.md).
const LEARN: u8 = 1;
const TEST: u8 = 2;
const TEST_BACK: u8 = 5;
const CLOSED: u8 = 3;
const OPENED: u8 = 4;

/// What a host waits for longer than FIND's limit.
const MARGIN_MS: u64 = 1_000;

/// What an observer sees of a test move, counts.
const SEEN: f64 = 3.5;

/// GET FIND: learning; wiring and direction are known; the rotor does not turn; hall codes that contradict each other.
const LEARNING: i64 = 1;
const KNOWN: i64 = 4;
const BLOCKED: i64 = 8;
const CONTRADICTION: i64 = 10;

/// MT and IHIT that free a wedged joint: their maximum.
const FREEING: u16 = 990;

/// A hand that turns a motor: how hard at most, N m, how long, ms, and when it is loose, counts.
const STRENGTH_N_M: f64 = 1.0;
const TURN_MS: u64 = 2_000;
const LOOSE: f64 = 6.0;

/// Recovers the hand, whose faults ended at `from_ms`.
pub fn recover<S: Subject>(session: &mut Session<'_, S>, from_ms: u64) {
    // Boards that were powered up just now are booting.
    while session.ms() < from_ms + 30 {
        session.step();
    }
    session.abort();
    for line in QUIET {
        run(session, line);
    }
    revive(session);
    give_back_kinds(session);
    for line in RESTORE {
        run(session, line);
    }
    let mut answer = String::new();
    let cooled_ms = wait_until_cool(session);
    for attempt in 0..ATTEMPTS {
        session.forget_settings();
        answer = run(session, "HI");
        if !session.is_whole() || !is_error(&answer) {
            break;
        }
        let by_hand = attempt > 0;
        if by_hand {
            // A finger may be caught on the far side of what it held, and nothing in the simulated hand gives way.
            session.hand.take_objects();
        }
        find_wiring(session);
        free_jammed(session, by_hand);
        revive(session);
        run(session, "1234567 S STAT 2");
        rest(session, 1_000);
    }
    if !session.is_whole() {
        return;
    }
    if is_error(&answer) {
        let errors = errors(session);
        session.fail(HOMES, 0, format!("HI ends in {:?}; {errors}", text(&answer)));
        return;
    }
    for line in ["C", "O", ALONE] {
        session.look_at_settings();
        let answer = run(session, line);
        if (is_error(&answer) || !has_arrived(session)) && session.is_whole() && !session.is_blocked() {
            let errors = errors(session);
            session.fail(MOVES, 0, format!("{line} ends in {:?}; {errors}", text(&answer)));
        }
        session.compare_settings(!is_error(&answer));
    }
    if session.is_whole() {
        stream(session);
    }
    let took_ms = session.ms() - from_ms - cooled_ms;
    if took_ms > RECOVERY_MS {
        session.fail(MOVES, 0, format!("recovery took {took_ms} ms, allowed are {RECOVERY_MS}"));
    }
    if session.is_whole() {
        session.outcome.recovered_ms = Some(took_ms);
    }
}

/// Rests until no motor is weak for its heat, as ERROR 3 advises, at most [`COOL_MS`]. Returns how long.
fn wait_until_cool<S: Subject>(session: &mut Session<'_, S>) -> u64 {
    let from_ms = session.ms();
    let is_hot = |session: &Session<'_, S>| {
        let mut boards = session.hand.bus().stations().map(|board| board.rig().truth());
        boards.any(|truth| truth.housing_c > HOT_C[0] || truth.winding_c > HOT_C[1])
    };
    while is_hot(session) && session.ms() < from_ms + COOL_MS && session.is_whole() {
        rest(session, 1_000);
    }
    session.ms() - from_ms
}

/// Whether each motor's last motion has arrived: O gives no error for one that stalls.
fn has_arrived<S: Subject>(session: &Session<'_, S>) -> bool {
    let mut nodes = session.hand.bus().stations().filter_map(Subject::native);
    nodes.all(|node| node.application().is_some_and(|tater| tater.status().end == Some(EndReason::Arrived)))
}

fn run<S: Subject>(session: &mut Session<'_, S>, line: &str) -> String {
    if !session.is_whole() {
        return String::new();
    }
    session.run_line(line, LINE_MS).unwrap_or_else(|| {
        session.fail(HOMES, 0, format!("{line} has no prompt within {LINE_MS} ms"));
        String::new()
    })
}

fn rest<S: Subject>(session: &mut Session<'_, S>, ms: u64) {
    let end_ms = session.ms() + ms;
    while session.ms() < end_ms && session.is_whole() {
        session.step();
    }
}

pub(super) fn is_error(answer: &str) -> bool {
    answer.contains("ERR ")
}

fn text(answer: &str) -> String {
    answer.replace("\r\n\r", "|")
}

fn native<'a, S: Subject>(session: &'a Session<'_, S>, motor: usize) -> Option<&'a Node> {
    session.hand.bus().stations().nth(motor).and_then(Subject::native)
}

/// A property of a board whose application runs. A host asks an emulated board for it.
fn property<S: Subject>(session: &mut Session<'_, S>, motor: usize, property: Property) -> Option<i64> {
    if let Some(node) = native(session, motor) {
        return node.application()?.property(property);
    }
    let answer = run(session, &format!("{} G {}", motor + 1, property.row().name));
    let (_, value) = answer.split_once('=')?;
    value.split_whitespace().next()?.parse().ok()
}

fn error_of<S: Subject>(session: &mut Session<'_, S>, motor: usize) -> i64 {
    property(session, motor, Property::ERROR).unwrap_or(0)
}

fn errors<S: Subject>(session: &mut Session<'_, S>) -> String {
    let mut all = Vec::new();
    for motor in 0..MOTORS {
        let error = property(session, motor, Property::ERROR);
        let end = property(session, motor, Property::END);
        all.push(match (error, end) {
            (Some(error), Some(end)) => format!("{error}/{end}"),
            _ => "asleep".to_owned(),
        });
    }
    format!("ERROR/END: {}", all.join(" "))
}

/// FIND for boards that report another wiring: the next step of ERROR 9.
fn find_wiring<S: Subject>(session: &mut Session<'_, S>) {
    for motor in 0..MOTORS {
        let known = property(session, motor, Property::FIND);
        let is_lost = known.is_some_and(|known| known != KNOWN)
            || error_of(session, motor) == i64::from(FaultCode::Wiring.code());
        if is_lost {
            // FIND wants an idle motor, and the spread holds after a stall, and after a move.
            run(session, &format!("{} S MODE 0", motor + 1));
            match learn(session, motor) {
                Some(BLOCKED) => {
                    turn_by_hand(session, motor);
                    learn(session, motor);
                }
                Some(CONTRADICTION) => _ = learn(session, motor),
                _ => {}
            }
            // At a stop it cannot make the first test move.
            let moved = find(session, motor, TEST, 1_000);
            let closed = if moved.abs() > SEEN {
                moved > 0.0
            } else {
                run(session, &format!("{} S MODE 0", motor + 1));
                find(session, motor, TEST_BACK, 1_000) < 0.0
            };
            find(session, motor, if closed { CLOSED } else { OPENED }, 100);
        }
    }
}

/// The next steps of ERROR 10: more torque, and if it comes back, a hand on the joint. An impact at full speed wedges a worm in its stop; a
/// board that was reset since then applies at most 250 units to it (decision 0047).
fn free_jammed<S: Subject>(session: &mut Session<'_, S>, by_hand: bool) {
    for motor in 0..MOTORS {
        if error_of(session, motor) == i64::from(FaultCode::Jammed.code()) {
            if by_hand {
                turn_by_hand(session, motor);
            }
            run(session, &format!("{} S MT {FREEING}", motor + 1));
            run(session, &format!("{} S IHIT {FREEING}", motor + 1));
        }
    }
}

/// Turns a motor away from its nearer stop, ever harder, until it has come loose.
fn turn_by_hand<S: Subject>(session: &mut Session<'_, S>, motor: usize) {
    session.outcome.turned_by_hand += 1;
    let began = session.hand.pose()[motor];
    let Some(board) = session.hand.bus().stations().nth(motor) else { return };
    let plant = board.rig().plant();
    let away = if 2.0 * began > plant.min_count + plant.max_count { -1.0 } else { 1.0 };
    for ms in 0..TURN_MS {
        if (session.hand.pose()[motor] - began).abs() > LOOSE || !session.is_whole() {
            break;
        }
        let n_m = away * STRENGTH_N_M * ms as f64 / TURN_MS as f64;
        with_rig(&mut session.hand, motor, |rig| rig.set_shaft_torque(n_m));
        session.step();
    }
    with_rig(&mut session.hand, motor, |rig| rig.set_shaft_torque(0.0));
}

/// SET FIND 1, and GET FIND until it has learned or refuses; returns that.
fn learn<S: Subject>(session: &mut Session<'_, S>, motor: usize) -> Option<i64> {
    run(session, &format!("{} S FIND {LEARN}", motor + 1));
    let end_ms = session.ms() + u64::from(tater_fw::find::LIMIT_MS) + MARGIN_MS;
    loop {
        rest(session, 100);
        let state = property(session, motor, Property::FIND);
        if state != Some(LEARNING) || !session.is_whole() {
            return state;
        }
        if session.ms() > end_ms {
            let why = format!("FIND learns for more than {} ms", tater_fw::find::LIMIT_MS);
            session.fail(HOMES, motor + 1, why);
            return state;
        }
    }
}

/// One step of FIND; returns what an observer of the joint sees, counts.
fn find<S: Subject>(session: &mut Session<'_, S>, motor: usize, step: u8, ms: u64) -> f64 {
    let before = session.hand.pose()[motor];
    run(session, &format!("{} S FIND {step}", motor + 1));
    rest(session, ms);
    session.hand.pose()[motor] - before
}

/// Wakes the boards. Downloads an application to boards that have none: the next step of ERROR 16. No fault of an emulated board takes its application.
fn revive<S: Subject>(session: &mut Session<'_, S>) {
    if is_error(&run(session, "WAKE")) {
        give_back_numbers(session);
    }
    for motor in 0..MOTORS {
        let asleep = native(session, motor).is_some_and(|node| node.application().is_none());
        if asleep && session.is_whole() {
            download::run(session, node_of(motor));
        }
    }
}

/// Gives boards their numbers back (docs/hand.md, Two boards with one number): two with one number by lines to both, and one that answers to none of 1 to 7
/// by packets to group 0.
fn give_back_numbers<S: Subject>(session: &mut Session<'_, S>) {
    let named = run(session, "ERR 1");
    // Boards without an application sleep on, and are no matter of numbers.
    if !named.contains("motor ") {
        return;
    }
    let motors = |named: &str, what: &str| -> Vec<usize> {
        (0..MOTORS).filter(|motor| named.contains(&format!("motor {}: {what}", motor + 1))).collect()
    };
    for motor in motors(&named, "two boards") {
        restore_locked(session, motor, Property::ID);
    }
    run(session, "WAKE");
    if motors(&run(session, "ERR 1"), "no answer").is_empty() {
        return;
    }
    let mut orders = vec![(Property::STAT, 2)];
    orders.extend(KEYS.map(|key| (Property::LOCK, key)));
    orders.extend([(Property::DEF, Property::ID.id().into()), (Property::STAT, 0)]);
    for (property, value) in orders {
        if let Some(message) = Message::set(Destination::Group(Group::ALL), property, value) {
            session.send(&packet(&message.frame()));
        }
        rest(session, if property == Property::STAT { START_MS } else { 0 });
    }
    run(session, "WAKE");
}

/// Gives motors the kind of their place back.
fn give_back_kinds<S: Subject>(session: &mut Session<'_, S>) {
    for (motor, number) in (0..MOTORS).zip(1..) {
        let found = property(session, motor, Property::KIND).and_then(MotorKind::from_code);
        if found.is_some_and(|found| found != kind(number)) {
            restore_locked(session, motor, Property::KIND);
            revive(session);
        }
    }
}

/// Resets a locked property to its default, and starts the board anew.
fn restore_locked<S: Subject>(session: &mut Session<'_, S>, motor: usize, property: Property) {
    let node = motor + 1;
    for key in KEYS {
        run(session, &format!("{node} S LOCK {key}"));
    }
    run(session, &format!("{node} S DEF {}", property.id()));
    run(session, &format!("{node} S STAT 0"));
}
