//! The C functions, called as C does: arguments, errors, threads, and constants that repeat the tables.

#[path = "../../tests/served/mod.rs"]
mod served;

use std::ffi::{CStr, CString, c_int, c_long, c_void};
use std::ptr::{null, null_mut};
use std::thread;

use served::Served;
use tater_wire::{Property, mode, property};
use wraptor_c::border::WRAPTOR_ENDLESS;
use wraptor_c::error::{wraptor_error, wraptor_error_status, wraptor_error_text};
use wraptor_c::functions::*;
use wraptor_c::network::*;
use wraptor_c::property::{WRAPTOR_NODES, WRAPTOR_PROPERTIES, wraptor_property_list};
use wraptor_c::realtime::{wraptor_axis, wraptor_control, wraptor_realtime};
use wraptor_c::thread::wraptor_start_thread;
use wraptor_error::*;

/// ms; a busy machine may stop a process for seconds.
const HANGS: u32 = 60_000;

const P: c_int = Property::P.id() as c_int;
const MT: c_int = Property::MT.id() as c_int;
const STAT: c_int = Property::STAT.id() as c_int;

fn string(text: &str) -> CString {
    CString::new(text).expect("no zero in it")
}

fn text() -> String {
    // SAFETY: a string of the library, copied before its next call.
    unsafe { CStr::from_ptr(wraptor_error_text()) }.to_str().expect("UTF-8").to_owned()
}

fn connected(served: &Served) -> isize {
    let (host, port) = served.place("gcl").split_once(':').expect("HOST:PORT");
    let mut hand = 0;
    // SAFETY: a string, and a place for the number.
    let error = unsafe {
        wraptor_tcp_connect(string(host).as_ptr(), port.parse().expect("a port"), &raw mut hand, HANGS)
    };
    assert_eq!(error, WRAPTOR_OK, "{}", text());
    hand
}

fn awake() -> (Served, isize) {
    let served = Served::fast_hand();
    let hand = connected(&served);
    assert_eq!(wraptor_wake_grasper(hand, HANGS), WRAPTOR_OK, "{}", text());
    (served, hand)
}

fn get(hand: isize, nodes: &str, property: c_int, limit_ms: u32) -> (wraptor_error, [i64; WRAPTOR_NODES]) {
    let mut values = [-1; WRAPTOR_NODES];
    // SAFETY: a string, and an array of this length.
    let error = unsafe { wraptor_get(hand, string(nodes).as_ptr(), property, values.as_mut_ptr(), limit_ms) };
    (error, values)
}

fn listed(node: usize, property: c_int) -> c_long {
    // SAFETY: the list has so many rows and columns, and lives as long as the program.
    let list = unsafe { std::slice::from_raw_parts(wraptor_property_list(), WRAPTOR_NODES) };
    list[node][usize::try_from(property).expect("a column")]
}

#[test]
fn constants_are_those_of_the_tables() {
    let header = include_str!("../include/wraptor.h");
    let of = |prefix: &str| -> Vec<(String, i64)> {
        let constants = header.lines().filter_map(|line| line.trim().strip_prefix(prefix)?.strip_suffix(','));
        let pair = |constant: &str| {
            let (name, value) = constant.split_once(" = ")?;
            Some((name.to_owned(), value.parse().ok()?))
        };
        constants.filter_map(pair).collect()
    };
    let rows = property::ROWS.iter();
    let properties: Vec<_> = rows.map(|row| (row.name.to_owned(), i64::from(row.property.id()))).collect();
    assert_eq!(of("WRAPTOR_PROPERTY_"), properties);
    for row in property::ROWS {
        let unit = if row.unit == "-" { String::new() } else { format!("; unit: {}", row.unit) };
        let text = format!("     {}{unit}\n", row.meaning);
        assert!(header.contains(&text), "{}: the header has another text", row.name);
        assert!(usize::from(row.property.id()) < WRAPTOR_PROPERTIES);
    }
    let modes: Vec<i64> = of("WRAPTOR_MODE_").into_iter().map(|(_, value)| value).collect();
    assert_eq!(modes, mode::ROWS.iter().map(|row| i64::from(row.code)).collect::<Vec<_>>());
    let compat = include_str!("../include/wraptor_compat.h");
    for (name, property) in [
        ("MOTOR_TEMPERATURE", Property::TEMP),
        ("TRAP_END_POSITION", Property::E),
        ("CONTROL_MODE", Property::MODE),
    ] {
        let line = format!("#define {name} WRAPTOR_PROPERTY_{}\n", property.row().name);
        assert!(compat.contains(&line), "{line}");
    }
}

/// The other ways to a hand.
#[test]
fn wrong_places_are_errors_with_cause_and_next_step() {
    let mut number = 0;
    // SAFETY: strings, NULL, and a place for the number.
    let outcomes = unsafe {
        [
            (wraptor_serial_connect(null(), 9600, &raw mut number, HANGS), WRAPTOR_NULL),
            (wraptor_serial_connect(c"/dev/null".as_ptr(), 9600, null_mut(), HANGS), WRAPTOR_NULL),
            (wraptor_serial_connect(c"/dev/null".as_ptr(), 0, &raw mut number, HANGS), WRAPTOR_INVALID),
            (
                wraptor_serial_connect(c"/dev/none".as_ptr(), 9600, &raw mut number, HANGS),
                WRAPTOR_NOT_CONNECTED,
            ),
            (wraptor_can_connect(null(), &raw mut number, HANGS), WRAPTOR_NULL),
            (wraptor_can_connect(c"can0".as_ptr(), null_mut(), HANGS), WRAPTOR_NULL),
            (wraptor_can_connect(c"nocan9".as_ptr(), &raw mut number, HANGS), WRAPTOR_NOT_CONNECTED),
            (wraptor_can_connect(c"127.0.0.1:1".as_ptr(), &raw mut number, HANGS), WRAPTOR_NOT_CONNECTED),
        ]
    };
    assert_eq!(number, 0);
    for (number, (found, expected)) in outcomes.into_iter().enumerate() {
        assert_eq!(found, expected, "{number}");
    }
    assert!(
        text().contains("127.0.0.1:1: no adapter can be reached: nothing listens there\n  next: "),
        "{}",
        text()
    );
}

#[test]
fn wrong_arguments_are_errors_with_cause_and_next_step() {
    let (_served, hand) = awake();
    let (nodes, none, mut number) = (string("8"), null(), 0);
    // SAFETY: strings, NULL, and places of their types.
    let outcomes = unsafe {
        [
            (wraptor_get(hand, nodes.as_ptr(), MT, null_mut(), HANGS), WRAPTOR_INVALID),
            (wraptor_set(hand, nodes.as_ptr(), MT, 1, HANGS), WRAPTOR_INVALID),
            (wraptor_wait_for(hand, nodes.as_ptr(), MT, 1, HANGS), WRAPTOR_INVALID),
            (wraptor_find_zero(hand, nodes.as_ptr(), HANGS), WRAPTOR_INVALID),
            (wraptor_save_parameters(hand, nodes.as_ptr(), HANGS), WRAPTOR_INVALID),
            (wraptor_open(hand, nodes.as_ptr(), HANGS), WRAPTOR_INVALID),
            (wraptor_close(hand, nodes.as_ptr(), HANGS), WRAPTOR_INVALID),
            (wraptor_move(hand, nodes.as_ptr(), 1, HANGS), WRAPTOR_INVALID),
            (wraptor_get(hand, c"1".as_ptr(), 6, null_mut(), HANGS), WRAPTOR_INVALID),
            (wraptor_get(hand, c"1".as_ptr(), -1, null_mut(), HANGS), WRAPTOR_INVALID),
            (wraptor_set(hand, c"1".as_ptr(), MT, 991, HANGS), WRAPTOR_INVALID),
            (wraptor_command(hand, c"HI\r".as_ptr(), null_mut(), 0, HANGS), WRAPTOR_INVALID),
            (wraptor_get(hand, c"\xff".as_ptr(), MT, null_mut(), HANGS), WRAPTOR_INVALID),
            (wraptor_get(hand, none, MT, null_mut(), HANGS), WRAPTOR_NULL),
            (wraptor_command(hand, none, null_mut(), 0, HANGS), WRAPTOR_NULL),
            (wraptor_tcp_msg(hand, none, 1, HANGS), WRAPTOR_NULL),
            (wraptor_tcp_connect(none, 1, &raw mut number, HANGS), WRAPTOR_NULL),
            (wraptor_tcp_connect(c"127.0.0.1".as_ptr(), 1, null_mut(), HANGS), WRAPTOR_NULL),
            (wraptor_tcp_connect(c"127.0.0.1".as_ptr(), 1, &raw mut number, HANGS), WRAPTOR_NOT_CONNECTED),
            (wraptor_download_firmware(hand, c"1".as_ptr(), none, None, null_mut(), HANGS), WRAPTOR_NULL),
            (
                wraptor_download_firmware(hand, c"1".as_ptr(), c"/".as_ptr(), None, null_mut(), HANGS),
                WRAPTOR_FILE,
            ),
            (
                wraptor_discover_grasper(c"x".as_ptr(), null_mut(), 0, null_mut(), 0, null_mut(), 1),
                WRAPTOR_INVALID,
            ),
            (wraptor_start_thread(None, null_mut(), null_mut()), WRAPTOR_NULL),
            (
                wraptor_realtime(
                    hand,
                    c"G".as_ptr(),
                    null(),
                    100.0,
                    HANGS,
                    None,
                    null_mut(),
                    null_mut(),
                    HANGS,
                ),
                WRAPTOR_NULL,
            ),
            (wraptor_get(hand + 1000, c"1".as_ptr(), MT, null_mut(), HANGS), WRAPTOR_BAD_HANDLE),
            (wraptor_command(-1, c"VERS".as_ptr(), null_mut(), 0, HANGS), WRAPTOR_BAD_HANDLE),
            (wraptor_listener(0, HANGS), WRAPTOR_BAD_HANDLE),
            (wraptor_cancel(-1), WRAPTOR_BAD_HANDLE),
            (wraptor_close_connection(-1, HANGS), WRAPTOR_BAD_HANDLE),
        ]
    };
    for (index, (found, expected)) in outcomes.into_iter().enumerate() {
        assert_eq!(found, expected, "call {index}");
    }
    assert!(text().contains("\n  next: "), "{}", text());
    // SAFETY: a string.
    let status = unsafe { wraptor_command(hand, c"FROB".as_ptr(), null_mut(), 0, HANGS) };
    assert_eq!((status, wraptor_error_status()), (WRAPTOR_STATUS, 32), "{}", text());
    assert_eq!(get(hand, "1", MT, HANGS).0, WRAPTOR_OK);
    assert_eq!((text().as_str(), wraptor_error_status()), ("", 0));
    assert_eq!(wraptor_close_connection(hand, HANGS), WRAPTOR_OK);
    assert_eq!(get(hand, "1", MT, HANGS).0, WRAPTOR_BAD_HANDLE);
}

#[test]
fn answers_fill_buffer_values_and_list() {
    let (_served, hand) = awake();
    let mut answer = [0x55_u8; 8];
    let command = |line: &str, answer: &mut [u8]| {
        // SAFETY: a string, and a buffer of this length.
        unsafe {
            wraptor_command(hand, string(line).as_ptr(), answer.as_mut_ptr().cast(), answer.len(), HANGS)
        }
    };
    assert_eq!(command("6 S MT 511", &mut []), WRAPTOR_OK);
    assert_eq!(command("67 G MT", &mut answer), WRAPTOR_OK);
    // Cut, with its zero.
    assert_eq!(&answer, b"6 MT=51\0");
    assert_eq!((listed(6, MT), listed(7, MT)), (511, 750));
    let (error, values) = get(hand, "67", MT, HANGS);
    assert_eq!((error, values), (WRAPTOR_OK, [-1, -1, -1, -1, -1, -1, 511, 750]));
    assert_eq!(command("5 S P 33", &mut []), WRAPTOR_OK);
    // A line without its end runs with the next call.
    // SAFETY: so many characters.
    assert_eq!(unsafe { wraptor_tcp_msg(hand, c"5 G P".as_ptr(), 5, HANGS) }, WRAPTOR_OK);
    assert_eq!(get(hand, "6", MT, HANGS).0, WRAPTOR_OK);
    assert_eq!(listed(5, P), 33);
    assert_eq!(wraptor_close_connection(hand, HANGS), WRAPTOR_OK);
}

/// Waits in another thread for what never comes; returns once it does.
fn waiting(hand: isize) -> thread::JoinHandle<wraptor_error> {
    let wait = move || {
        // SAFETY: a string.
        unsafe { wraptor_wait_for(hand, c"1".as_ptr(), STAT, 1, WRAPTOR_ENDLESS) }
    };
    let thread = thread::spawn(wait);
    // A call waits for its turn, within its limit.
    while get(hand, "1", STAT, 50).0 != WRAPTOR_TIMED_OUT {
        assert!(!thread.is_finished());
    }
    assert!(text().contains("a call of another thread"), "{}", text());
    thread
}

#[test]
fn call_is_cancelled_and_connection_closed_from_another_thread() {
    let (_served, hand) = awake();
    let thread = waiting(hand);
    assert_eq!(wraptor_cancel(hand), WRAPTOR_OK);
    assert_eq!(thread.join().expect("it ends"), WRAPTOR_CANCELLED);
    assert_eq!(get(hand, "1", STAT, HANGS), (WRAPTOR_OK, [-1, 2, -1, -1, -1, -1, -1, -1]));
    // Nothing runs: the next call is not cancelled.
    assert_eq!(wraptor_cancel(hand), WRAPTOR_OK);
    let thread = waiting(hand);
    assert_eq!(wraptor_close_connection(hand, HANGS), WRAPTOR_OK, "{}", text());
    assert_eq!(thread.join().expect("it ends"), WRAPTOR_CANCELLED);
    assert_eq!(get(hand, "1", STAT, HANGS).0, WRAPTOR_BAD_HANDLE);
}

/// Uses its own connection, whose number `context` points to, and keeps there what that returns.
///
/// # Safety
/// `context` is a number and a list, which nobody else uses meanwhile.
unsafe extern "C" fn uses_its_hand(
    context: *mut c_void,
    _: u64,
    _: *const wraptor_axis,
    _: usize,
    _: f64,
    _: *mut wraptor_control,
) -> c_int {
    // SAFETY: the caller's promise.
    let (hand, errors) = unsafe { &mut *context.cast::<(isize, Vec<wraptor_error>)>() };
    errors.push(get(*hand, "1", STAT, WRAPTOR_ENDLESS).0);
    assert!(text().contains("this thread's own call"), "{}", text());
    errors.push(wraptor_listener(*hand, WRAPTOR_ENDLESS));
    errors.push(wraptor_close_connection(*hand, WRAPTOR_ENDLESS));
    errors.push(wraptor_delay(1));
    0
}

#[test]
fn callback_cannot_wait_for_its_own_call() {
    let (_served, hand) = awake();
    let mut context: (isize, Vec<wraptor_error>) = (hand, Vec::new());
    // SAFETY: strings, the callback's own context, and a NULL that is permitted.
    unsafe {
        assert_eq!(wraptor_find_zero(hand, c"4".as_ptr(), HANGS), WRAPTOR_OK, "{}", text());
        let own = (&raw mut context).cast();
        let error = wraptor_realtime(
            hand,
            c"S".as_ptr(),
            null(),
            100.0,
            HANGS,
            Some(uses_its_hand),
            own,
            null_mut(),
            HANGS,
        );
        assert_eq!(error, WRAPTOR_OK, "{}", text());
    }
    assert_eq!(context.1, [WRAPTOR_INVALID, WRAPTOR_INVALID, WRAPTOR_INVALID, WRAPTOR_OK]);
    assert_eq!(wraptor_close_connection(hand, HANGS), WRAPTOR_OK);
}

#[test]
fn two_hands_at_once_have_numbers_of_their_own() {
    let (_one, first) = awake();
    let (_two, second) = awake();
    assert_ne!(first, second);
    // SAFETY: a string.
    assert_eq!(unsafe { wraptor_set(first, c"1".as_ptr(), MT, 500, HANGS) }, WRAPTOR_OK);
    assert_eq!((get(first, "1", MT, HANGS).1[1], get(second, "1", MT, HANGS).1[1]), (500, 750));
    assert_eq!(wraptor_close_connection(first, HANGS), WRAPTOR_OK);
    assert_eq!(get(second, "1", MT, HANGS).0, WRAPTOR_OK);
    assert_eq!(wraptor_close_connection(second, HANGS), WRAPTOR_OK);
}
