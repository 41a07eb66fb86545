//! Functions of the manual's section 7, and what closes and cancels a connection.
//!
//! Nodes are digits: 1 to 4 fingers and spread, where a function speaks of fingers, else boards 1 to 7. Limits are in ms; `WRAPTOR_ENDLESS` waits
//! for ever.

use std::ffi::{c_char, c_int};
use std::net::Ipv6Addr;
use std::time::Duration;

use tater_wire::Property;
use wraptor::{Boards, Connect, Deadline};

use crate::border::{border, deadline, process, property_of, store, store_text, text, with_hand};
use crate::error::{Problem, wraptor_error};
use crate::property;
use crate::slot::{self, wraptor_hand};

/// Time between two looks at what hands have sent.
const LISTEN: Duration = Duration::from_millis(20);

/// Nothing to do: sockets of this library start by themselves (the manual's ws_init).
// SAFETY: no other symbol has this name.
#[unsafe(no_mangle)]
pub extern "C" fn wraptor_ws_init() -> wraptor_error {
    border(|| Ok(()))
}

/// Closes all connections, and waits until calls of other threads and the threads of `wraptor_start_thread` have ended (the manual's ws_down). A
/// connection that another thread is making ends with WRAPTOR_CANCELLED.
///
/// A thread that calls this is not waited for.
///
/// Errors: WRAPTOR_TIMED_OUT if a call or a thread goes on; WRAPTOR_INVALID in a callback.
// SAFETY: no other symbol has this name.
#[unsafe(no_mangle)]
pub extern "C" fn wraptor_ws_down(limit_ms: u32) -> wraptor_error {
    border(|| {
        let deadline = deadline(limit_ms);
        slot::close_all(&deadline)?;
        crate::thread::join_all(&deadline)
    })
}

/// Sets the list of property values to zero (the manual's initSoftware).
// SAFETY: no other symbol has this name.
#[unsafe(no_mangle)]
pub extern "C" fn wraptor_init_software() -> wraptor_error {
    border(|| {
        property::clear();
        Ok(())
    })
}

/// Connects to a hand over TCP and stores the connection's number in `hand` (the manual's tcp_connect). Boards are neither woken nor asked.
///
/// Errors: WRAPTOR_NOT_CONNECTED, whose text names the cause; WRAPTOR_CANCELLED if wraptor_ws_down was called meanwhile.
///
/// # Safety
/// `host` is NULL or a string; `hand` is NULL or may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn wraptor_tcp_connect(
    host: *const c_char,
    port: u16,
    hand: *mut wraptor_hand,
    limit_ms: u32,
) -> wraptor_error {
    border(|| {
        // SAFETY: the caller's promise.
        let host = unsafe { text("host", host) }?;
        if hand.is_null() {
            return Err(Problem::null("hand"));
        }
        let is_ipv6 = host.parse::<Ipv6Addr>().is_ok();
        if host.is_empty() || host.contains(':') && !is_ipv6 {
            let expected =
                "expected a name or an address such as 192.168.1.10, and the port as an argument of its own";
            return Err(Problem::invalid(&format!("host: found {host:?}, {expected}")));
        }
        let host = if is_ipv6 { format!("[{host}]") } else { host.to_owned() };
        // SAFETY: the caller's promise.
        unsafe { store("hand", hand, connected(Connect::tcp(&format!("{host}:{port}")), limit_ms)?) }
    })
}

/// Connects to a hand on a serial port such as `/dev/ttyUSB0` (manual 1.5); its default is 9600 baud. All else is as over TCP. On Windows
/// it fails.
///
/// Errors: WRAPTOR_NOT_CONNECTED, whose text names the cause; WRAPTOR_CANCELLED if wraptor_ws_down was called meanwhile.
///
/// # Safety
/// `port` is NULL or a string; `hand` is NULL or may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn wraptor_serial_connect(
    port: *const c_char,
    baud: u32,
    hand: *mut wraptor_hand,
    limit_ms: u32,
) -> wraptor_error {
    border(|| {
        // SAFETY: the caller's promise.
        let port = unsafe { text("port", port) }?;
        if hand.is_null() {
            return Err(Problem::null("hand"));
        }
        if baud == 0 {
            return Err(Problem::invalid(
                "baud: found 0, expected the hand's rate, 9600 unless BAUD was set",
            ));
        }
        // SAFETY: the caller's promise.
        unsafe { store("hand", hand, connected(Connect::serial(port, baud), limit_ms)?) }
    })
}

/// Connects to a hand's motor boards by CAN (manual 1.5), without GOD: this library interprets the hand's language itself, and is the bus's one host. `place` is a
/// CAN interface of Linux that is up at 1 Mbit/s, such as `can0`, or an SLCAN adapter: `HOST:PORT`, `/dev/ttyACM0`, or `/dev/ttyUSB0@57600` with its baud
/// rate. All else is as over TCP, but what is GOD's own: node 0 of wraptor_save_parameters is refused.
///
/// Errors: WRAPTOR_NOT_CONNECTED, whose text names the cause; WRAPTOR_CANCELLED if wraptor_ws_down was called meanwhile.
///
/// # Safety
/// `place` is NULL or a string; `hand` is NULL or may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn wraptor_can_connect(
    place: *const c_char,
    hand: *mut wraptor_hand,
    limit_ms: u32,
) -> wraptor_error {
    border(|| {
        // SAFETY: the caller's promise.
        let place = unsafe { text("place", place) }?;
        if hand.is_null() {
            return Err(Problem::null("hand"));
        }
        // SAFETY: the caller's promise.
        unsafe { store("hand", hand, connected(Connect::can(place), limit_ms)?) }
    })
}

/// Connects without a question to boards, and numbers the connection.
fn connected(connect: Connect, limit_ms: u32) -> Result<wraptor_hand, Problem> {
    let connect = connect.boards(Boards::Any);
    slot::insert(|| Ok(connect.connect(deadline(limit_ms).remaining())?))
}

/// Closes a connection and frees its thread and its socket. A call of another thread is cancelled and waited for. Motors stop, as after ^C, unless
/// characters of `wraptor_tcp_msg` came last, which the hand finishes.
///
/// Errors: WRAPTOR_BAD_HANDLE; WRAPTOR_TIMED_OUT if that call goes on, with which the connection then ends; WRAPTOR_INVALID in a callback of this
/// connection.
// SAFETY: no other symbol has this name.
#[unsafe(no_mangle)]
pub extern "C" fn wraptor_close_connection(hand: wraptor_hand, limit_ms: u32) -> wraptor_error {
    border(|| slot::close(hand, &deadline(limit_ms)))
}

/// Cancels the call that another thread runs on this connection: a motion, a wait, RealTime or a download. Does nothing if there is none.
///
/// Errors: WRAPTOR_BAD_HANDLE.
// SAFETY: no other symbol has this name.
#[unsafe(no_mangle)]
pub extern "C" fn wraptor_cancel(hand: wraptor_hand) -> wraptor_error {
    border(|| {
        slot::find(hand)?.cancel();
        Ok(())
    })
}

/// Sends `len` characters as they are (the manual's tcp_msg). Lines end with a carriage return; a line that these characters leave without it is
/// ended by the next call. Answers are recorded in the list of property values by `wraptor_listener`, `wraptor_delay` or the next call.
///
/// # Safety
/// `characters` is NULL or has `len` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn wraptor_tcp_msg(
    hand: wraptor_hand,
    characters: *const c_char,
    len: usize,
    limit_ms: u32,
) -> wraptor_error {
    with_hand(hand, limit_ms, |call| {
        if characters.is_null() {
            return Err(Problem::null("characters"));
        }
        if isize::try_from(len).is_err() {
            return Err(Problem::invalid("len: longer than any buffer"));
        }
        // SAFETY: not NULL, not longer than a slice may be, and by the caller's promise so many bytes.
        let bytes = unsafe { std::slice::from_raw_parts(characters.cast::<u8>(), len) };
        let left = call.left();
        Ok(call.hand.write(bytes, left)?)
    })
}

/// Runs a line of the hand's language. If it sets boards in motion by MODE or CMD, waits until their moves are over (the manual's command).
/// The lines that the hand prints go to `answer`, a buffer of `size` bytes or NULL, separated by line feeds and cut to the size.
///
/// Errors: WRAPTOR_STATUS if the hand answers ERR.
///
/// # Safety
/// `message` is NULL or a string; `answer` is NULL or has `size` bytes that may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn wraptor_command(
    hand: wraptor_hand,
    message: *const c_char,
    answer: *mut c_char,
    size: usize,
    limit_ms: u32,
) -> wraptor_error {
    // SAFETY: the caller's promise.
    unsafe { store_text(answer, size, "") };
    with_hand(hand, limit_ms, |call| {
        // SAFETY: the caller's promise.
        let message = unsafe { text("message", message) }?;
        let lines =
            call.run(Property::P, |hand, left, progress| hand.command_and_wait(message, left, progress))?;
        property::record_lines(&lines);
        // SAFETY: the caller's promise.
        unsafe { store_text(answer, size, &lines.join("\n")) };
        Ok(())
    })
}

/// Reads a property of boards (the manual's get) into the list of property values, and into `values`, an array of WRAPTOR_NODES indexed by node,
/// or NULL. Elements of other nodes are left as they are.
///
/// Errors: WRAPTOR_NO_ANSWER if boards do not answer.
///
/// # Safety
/// `nodes` is NULL or a string; `values` is NULL or has WRAPTOR_NODES elements that may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn wraptor_get(
    hand: wraptor_hand,
    nodes: *const c_char,
    property: c_int,
    values: *mut i64,
    limit_ms: u32,
) -> wraptor_error {
    with_hand(hand, limit_ms, |call| {
        // SAFETY: the caller's promise.
        let nodes = unsafe { text("nodes", nodes) }?;
        let property = property_of(property)?;
        let left = call.left();
        let found = call.hand.get(nodes, property, left)?;
        property::record(property, &found);
        for (node, value) in found {
            let index = usize::from(node.number());
            if !values.is_null() && index < property::WRAPTOR_NODES {
                // SAFETY: below WRAPTOR_NODES, and by the caller's promise an element that may be written.
                unsafe { values.add(index).write(value) };
            }
        }
        Ok(())
    })
}

/// Sets a property of boards (the manual's set). WRAPTOR_OK says that the boards have received it: a locked property, or a MODE that a board
/// refuses, keeps its value, which `wraptor_get` reads.
///
/// Errors: WRAPTOR_INVALID if the property cannot be set or the value is out of range; WRAPTOR_STATUS with ERR 1 if a board sleeps or is silent.
///
/// # Safety
/// `nodes` is NULL or a string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn wraptor_set(
    hand: wraptor_hand,
    nodes: *const c_char,
    property: c_int,
    value: i64,
    limit_ms: u32,
) -> wraptor_error {
    with_hand(hand, limit_ms, |call| {
        // SAFETY: the caller's promise.
        let nodes = unsafe { text("nodes", nodes) }?;
        let (property, left) = (property_of(property)?, call.left());
        Ok(call.hand.set(nodes, property, value, left)?)
    })
}

/// Waits until a property of all boards has a value (the manual's waitFor). What it reads is recorded in the list of property values. Its limit
/// stops no motor.
///
/// # Safety
/// `nodes` is NULL or a string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn wraptor_wait_for(
    hand: wraptor_hand,
    nodes: *const c_char,
    property: c_int,
    value: i64,
    limit_ms: u32,
) -> wraptor_error {
    with_hand(hand, limit_ms, |call| {
        // SAFETY: the caller's promise.
        let nodes = unsafe { text("nodes", nodes) }?;
        let property = property_of(property)?;
        call.run(property, |hand, left, progress| hand.wait_for(nodes, property, value, left, progress))
    })
}

/// Moves fingers to a position of their links in hall counts, with their fingertips (the manual's move), and waits until they are there.
///
/// Errors: WRAPTOR_NOT_REACHED if a motor ends early.
///
/// # Safety
/// `fingers` is NULL or a string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn wraptor_move(
    hand: wraptor_hand,
    fingers: *const c_char,
    value: i64,
    limit_ms: u32,
) -> wraptor_error {
    with_hand(hand, limit_ms, |call| {
        // SAFETY: the caller's promise.
        let fingers = unsafe { text("fingers", fingers) }?;
        call.run(Property::P, |hand, left, progress| hand.move_halls(fingers, value, left, progress))
    })
}

/// Moves fingers to position zero, with their fingertips (the manual's open), and waits until they are there.
///
/// Errors: WRAPTOR_NOT_REACHED if a motor ends early.
///
/// # Safety
/// `fingers` is NULL or a string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn wraptor_open(
    hand: wraptor_hand,
    fingers: *const c_char,
    limit_ms: u32,
) -> wraptor_error {
    with_hand(hand, limit_ms, |call| {
        // SAFETY: the caller's promise.
        let fingers = unsafe { text("fingers", fingers) }?;
        call.run(Property::P, |hand, left, progress| hand.open_fingers(fingers, left, progress))
    })
}

/// Closes fingers, with their fingertips (the manual's close), and waits until they are closed or an object stops them.
///
/// Errors: WRAPTOR_NOT_REACHED if a fault ends a motion.
///
/// # Safety
/// `fingers` is NULL or a string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn wraptor_close(
    hand: wraptor_hand,
    fingers: *const c_char,
    limit_ms: u32,
) -> wraptor_error {
    with_hand(hand, limit_ms, |call| {
        // SAFETY: the caller's promise.
        let fingers = unsafe { text("fingers", fingers) }?;
        call.run(Property::P, |hand, left, progress| hand.close_fingers(fingers, left, progress))
    })
}

/// Finds the stops of boards' motors, sets their positions and moves them to zero (the manual's findZero): links 1 to 3 open first and stay at their
/// stops while the spread opens and fingertips 5 to 7 close; links return to zero last. The workspace must be clear.
///
/// # Safety
/// `nodes` is NULL or a string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn wraptor_find_zero(
    hand: wraptor_hand,
    nodes: *const c_char,
    limit_ms: u32,
) -> wraptor_error {
    with_hand(hand, limit_ms, |call| {
        // SAFETY: the caller's promise.
        let nodes = unsafe { text("nodes", nodes) }?;
        if nodes.is_empty() || !nodes.bytes().all(|node| matches!(node, b'1'..=b'7')) {
            return Err(Problem::invalid(&format!("nodes {nodes:?}: expected digits 1 to 7, such as 567")));
        }
        // X: each motor by itself, not a finger.
        let motors = format!("X{nodes}");
        call.run(Property::P, |hand, left, progress| hand.find_zero(&motors, left, progress))
    })
}

/// Stores positions and parameters of boards, and with node 0 those of GOD (the manual's saveParameters). Motors should be in mode
/// WRAPTOR_MODE_IDLE: only a position at rest is trusted at the next power-on.
///
/// Errors: WRAPTOR_STATUS with ERR 512 if a flash has not taken them.
///
/// # Safety
/// `nodes` is NULL or a string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn wraptor_save_parameters(
    hand: wraptor_hand,
    nodes: *const c_char,
    limit_ms: u32,
) -> wraptor_error {
    with_hand(hand, limit_ms, |call| {
        // SAFETY: the caller's promise.
        let nodes = unsafe { text("nodes", nodes) }?;
        let left = call.left();
        Ok(call.hand.save_nodes(nodes, left)?)
    })
}

/// Wakes all boards (the manual's wakeGrasper), up to 1.5 s. Not before `wraptor_download_firmware`.
///
/// Errors: WRAPTOR_STATUS with ERR 1 if some do not wake.
// SAFETY: no other symbol has this name.
#[unsafe(no_mangle)]
pub extern "C" fn wraptor_wake_grasper(hand: wraptor_hand, limit_ms: u32) -> wraptor_error {
    with_hand(hand, limit_ms, |call| {
        let left = call.left();
        Ok(call.hand.wake(left)?)
    })
}

/// Waits, and meanwhile records in the list of property values what all hands send (the manual's delay).
// SAFETY: no other symbol has this name.
#[unsafe(no_mangle)]
pub extern "C" fn wraptor_delay(ms: u32) -> wraptor_error {
    border(|| {
        let deadline = deadline(ms);
        loop {
            for number in slot::numbers() {
                // A hand that another thread uses, or that is lost, is not this call's concern.
                let now = Deadline::after(Duration::ZERO);
                let _ = slot::find(number).and_then(|slot| process(&mut *slot.take(&now)?));
            }
            if deadline.remaining().is_zero() {
                return Ok(());
            }
            std::thread::park_timeout(LISTEN.min(deadline.remaining()));
        }
    })
}

/// Records in the list of property values what a hand sends, until the limit (the manual's Listener). Calls of other threads go first: they
/// record too.
///
/// Errors: WRAPTOR_BAD_HANDLE once the connection is closed; WRAPTOR_LOST.
// SAFETY: no other symbol has this name.
#[unsafe(no_mangle)]
pub extern "C" fn wraptor_listener(hand: wraptor_hand, limit_ms: u32) -> wraptor_error {
    border(|| {
        let (deadline, slot) = (deadline(limit_ms), slot::find(hand)?);
        loop {
            match slot.take(&Deadline::after(Duration::ZERO)) {
                Ok(mut turn) => process(&mut turn)?,
                // Another thread's call reads.
                Err(problem) if problem.code == wraptor_error::WRAPTOR_TIMED_OUT => {}
                Err(problem) => return Err(problem),
            }
            if deadline.remaining().is_zero() {
                return Ok(());
            }
            slot.rest(LISTEN.min(deadline.remaining()));
        }
    })
}
