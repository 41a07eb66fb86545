//! A hand that dies or a cable that is pulled during each C function: an error within the limit, and after the close no thread and no socket left. The
//! only test of this program, because it counts both.

#![cfg(target_os = "linux")]

#[path = "../../tests/served/mod.rs"]
mod served;

use std::ffi::{CString, c_char, c_int, c_void};
use std::fs;
use std::net::TcpListener;
use std::path::PathBuf;
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

use served::{Cut, Proxy, Served, answer_lines, left};
use tater_f103::map::{APPLICATION, MAP, RAM};
use tater_wire::Property;
use tater_wire::image::seal;
use tater_wire::tek::{Encoder, end};
use wraptor_c::border::WRAPTOR_ENDLESS;
use wraptor_c::error::wraptor_error;
use wraptor_c::functions::*;
use wraptor_c::network::{wraptor_discover_grasper, wraptor_download_firmware};
use wraptor_c::realtime::{wraptor_axis, wraptor_control, wraptor_realtime};
use wraptor_c::thread::wraptor_start_thread;
use wraptor_error::*;

/// Limit of each call, ms.
const LIMIT: u32 = 300;

/// Limit of what must succeed, ms.
const HANGS: u32 = 60_000;

/// A call is over by then: its limit, and a second for a machine that runs something else.
const OVER: Duration = Duration::from_millis(1300);

const E: c_int = Property::E.id() as c_int;
const MT: c_int = Property::MT.id() as c_int;
const STAT: c_int = Property::STAT.id() as c_int;

type Call = fn(isize) -> wraptor_error;

const ONE: *const c_char = c"1".as_ptr();

/// A control loop without an end.
///
/// # Safety
/// None is needed: it looks at nothing.
unsafe extern "C" fn goes_on(
    _: *mut c_void,
    _: u64,
    _: *const wraptor_axis,
    _: usize,
    _: f64,
    _: *mut wraptor_control,
) -> c_int {
    1
}

/// Each function with the bytes at which the connection is cut.
fn calls() -> [(&'static str, &'static [u8], Call); 11] {
    // SAFETY: of each: strings, and NULL where it is allowed.
    [
        ("command", b"PLIST\r", |hand| unsafe {
            wraptor_command(hand, c"PLIST".as_ptr(), null_mut(), 0, LIMIT)
        }),
        ("command, waits", b"G MODE\r", |hand| unsafe {
            wraptor_command(hand, c"1 S M 5".as_ptr(), null_mut(), 0, LIMIT)
        }),
        ("get", b"1 G MT\r", |hand| unsafe { wraptor_get(hand, ONE, MT, null_mut(), LIMIT) }),
        ("set", b"1 S E 9\r", |hand| unsafe { wraptor_set(hand, ONE, E, 9, LIMIT) }),
        ("waitFor", b"1 G STAT\r", |hand| unsafe { wraptor_wait_for(hand, ONE, STAT, 1, LIMIT) }),
        ("move", b"1 S E 9\r", |hand| unsafe { wraptor_move(hand, ONE, 9, LIMIT) }),
        ("open", b"1 S E 0\r", |hand| unsafe { wraptor_open(hand, ONE, LIMIT) }),
        ("close", b"15 S MODE 5\r", |hand| unsafe { wraptor_close(hand, ONE, LIMIT) }),
        ("findZero", b"X1HI\r", |hand| unsafe { wraptor_find_zero(hand, ONE, LIMIT) }),
        ("saveParameters", b"1 S SAVE -1\r", |hand| unsafe { wraptor_save_parameters(hand, ONE, LIMIT) }),
        ("wakeGrasper", b"WAKE\r", |hand| wraptor_wake_grasper(hand, LIMIT)),
    ]
}

fn connect(address: &str, limit_ms: u32) -> (wraptor_error, isize) {
    let (host, port) = address.split_once(':').expect("HOST:PORT");
    let (host, mut hand) = (CString::new(host).expect("no zero in it"), -1);
    // SAFETY: a string, and a place for the number.
    let error =
        unsafe { wraptor_tcp_connect(host.as_ptr(), port.parse().expect("a port"), &raw mut hand, limit_ms) };
    (error, hand)
}

/// Runs a call in a thread, and closes the connection after it.
fn in_time(name: &str, cut: Cut, hand: isize, call: impl FnOnce(isize) -> wraptor_error + Send + 'static) {
    let (sender, outcome) = channel();
    let thread = thread::spawn(move || sender.send(call(hand)));
    let error = outcome.recv_timeout(OVER).unwrap_or_else(|_| panic!("{name}, {cut:?}: no end in time"));
    let _ = thread.join().expect("it ends");
    let expected = match cut {
        Cut::Kill => WRAPTOR_LOST,
        Cut::Silence => WRAPTOR_TIMED_OUT,
    };
    assert_eq!(error, expected, "{name}, {cut:?}");
    assert_eq!(wraptor_close_connection(hand, LIMIT), WRAPTOR_OK, "{name}, {cut:?}");
    assert_eq!(left().0, 0, "{name}, {cut:?}: threads of the library");
}

/// The path of a sealed application.
fn application() -> CString {
    let mut image = vec![0x5A; 8192];
    image[..4].copy_from_slice(&RAM.end().to_le_bytes());
    image[4..8].copy_from_slice(&(APPLICATION.start + 0x101).to_le_bytes());
    // The vectors that hold the header are reserved.
    image[0x1C..0x2C].fill(0);
    seal(&mut image, 601, &MAP).expect("an application");
    let lines = Encoder::new(APPLICATION.start, &image).expect("it fits");
    let mut text: Vec<u8> = lines.flat_map(|line| line.as_bytes().to_vec()).collect();
    text.extend_from_slice(end(APPLICATION.start).as_bytes());
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("application.tek");
    fs::write(&path, text).expect("written");
    CString::new(path.to_str().expect("UTF-8")).expect("no zero in it")
}

#[test]
fn lost_hand_ends_each_function_in_time_and_leaves_nothing() {
    let before = left();
    assert_eq!(before.0, 0);
    for cut in [Cut::Kill, Cut::Silence] {
        for (name, trigger, call) in calls() {
            let served = Served::fast_hand();
            let proxy = Proxy::new(&served, trigger, cut);
            let (error, hand) = connect(&proxy.address, HANGS);
            assert_eq!(error, WRAPTOR_OK, "{name}");
            if name != "wakeGrasper" {
                assert_eq!(wraptor_wake_grasper(hand, HANGS), WRAPTOR_OK, "{name}");
            }
            in_time(name, cut, hand, call);
            drop((proxy, served));
            assert_eq!(left(), before, "{name}, {cut:?}: threads of the library, sockets");
        }
        realtime_and_download_end(cut);
        connect_ends(cut);
        assert_eq!(left(), before, "{cut:?}: threads of the library, sockets");
    }
    every_way_ends();
    assert_eq!(left(), before, "serial port, CAN: threads of the library, sockets");
    listener_ends_with_its_hand_and_with_ws_down();
    ws_down_waits_for_a_call_and_ends_a_connect();
    ended_threads_keep_no_stack();
    discovery_ends();
    assert_eq!(left(), before, "threads of the library, sockets");
}

/// The other ways to a hand: its end ends each function. By CAN only frames meet it: a command that no board is asked for is answered by this library.
fn every_way_ends() {
    for (name, _, call) in calls().into_iter().filter(|(name, ..)| *name != "command") {
        let serial = Served::new(&["hand", "--pty", "--speed", "max"], 1);
        let can = Served::new(&["bus", "--nodes", "1-7", "--slcan", "127.0.0.1:0"], 1);
        let (port, place) = (string(serial.place("pty")), string(can.place("slcan")));
        let (mut on_port, mut by_can) = (-1, -1);
        // SAFETY: strings, and places for numbers.
        unsafe {
            assert_eq!(wraptor_serial_connect(port.as_ptr(), 9600, &raw mut on_port, HANGS), WRAPTOR_OK);
            assert_eq!(wraptor_can_connect(place.as_ptr(), &raw mut by_can, HANGS), WRAPTOR_OK);
        }
        served::end(&serial.process);
        served::end(&can.process);
        for hand in [on_port, by_can] {
            let (sender, outcome) = channel();
            let thread = thread::spawn(move || sender.send(call(hand)));
            let error = outcome.recv_timeout(OVER).unwrap_or_else(|_| panic!("{name}: no end in time"));
            let _ = thread.join().expect("it ends");
            assert_eq!(error, WRAPTOR_LOST, "{name}");
            assert_eq!(wraptor_close_connection(hand, LIMIT), WRAPTOR_OK, "{name}");
        }
        assert_eq!(left().0, 0, "{name}: threads of the library");
    }
}

fn string(text: &str) -> CString {
    CString::new(text).expect("no zero in it")
}

fn realtime_and_download_end(cut: Cut) {
    let served = Served::fast_hand();
    let proxy = Proxy::new(&served, b"LOOP\rC", cut);
    let hand = connect(&proxy.address, HANGS).1;
    assert_eq!(wraptor_wake_grasper(hand, HANGS), WRAPTOR_OK);
    // Finger 1 is motors 1 and 5.
    // SAFETY: a string.
    assert_eq!(unsafe { wraptor_find_zero(hand, c"15".as_ptr(), HANGS) }, WRAPTOR_OK);
    in_time("realtime", cut, hand, |hand| {
        let (none, nothing) = (null_mut(), null_mut());
        // SAFETY: a string, a function that ignores its arguments, and NULL where it is allowed.
        unsafe { wraptor_realtime(hand, ONE, null(), 100.0, LIMIT, Some(goes_on), none, nothing, LIMIT) }
    });
    let served = Served::fast_hand();
    // A numbered frame of node 2.
    let proxy = Proxy::new(&served, &[0, 2, 8], cut);
    let (hand, file) = (connect(&proxy.address, HANGS).1, application());
    in_time("downloadFirmware", cut, hand, move |hand| {
        // SAFETY: strings, and NULL where it is allowed.
        unsafe { wraptor_download_firmware(hand, c"2".as_ptr(), file.as_ptr(), None, null_mut(), LIMIT) }
    });
}

fn connect_ends(cut: Cut) {
    let served = Served::fast_hand();
    let proxy = Proxy::new(&served, b"VERS\r", cut);
    let (sender, outcome) = channel();
    let address = proxy.address.clone();
    let thread = thread::spawn(move || sender.send(connect(&address, LIMIT)));
    assert_eq!(outcome.recv_timeout(OVER), Ok((WRAPTOR_NOT_CONNECTED, -1)), "{cut:?}");
    let _ = thread.join().expect("it ends");
}

/// The Listener of the compatibility header.
///
/// # Safety
/// None is needed: its argument is a number.
unsafe extern "C" fn listen(hand: *mut c_void) -> u32 {
    u32::from(wraptor_listener(hand as isize, WRAPTOR_ENDLESS) != WRAPTOR_OK)
}

static ENDED: AtomicU32 = AtomicU32::new(0);

/// # Safety
/// None is needed: it looks at nothing.
unsafe extern "C" fn ends(_: *mut c_void) -> u32 {
    ENDED.fetch_add(1, Ordering::SeqCst);
    0
}

/// Address space of this program, KiB.
fn address_space() -> u64 {
    let status = fs::read_to_string("/proc/self/status").expect("Linux has it");
    let line = status.lines().find_map(|line| line.strip_prefix("VmSize:")).expect("it is there");
    line.trim().trim_end_matches(" kB").parse().expect("a number")
}

/// A stack has 2 MiB: those of 1000 threads would be 2000, and heaps of threads reserve some 500.
fn ended_threads_keep_no_stack() {
    let before = address_space();
    for number in 1..=1000 {
        // SAFETY: the function looks at nothing, and no number is wanted.
        assert_eq!(unsafe { wraptor_start_thread(Some(ends), null_mut(), null_mut()) }, WRAPTOR_OK);
        while ENDED.load(Ordering::SeqCst) < number {
            thread::yield_now();
        }
    }
    assert!(address_space() < before + (1000 << 10), "{} KiB, {before} before", address_space());
    assert_eq!(wraptor_ws_down(HANGS), WRAPTOR_OK);
}

fn ws_down_waits_for_a_call_and_ends_a_connect() {
    let served = Served::fast_hand();
    let proxy = Proxy::new(&served, b"STAT", Cut::Silence);
    let hand = connect(&proxy.address, HANGS).1;
    // Nothing but its limit ends it.
    // SAFETY: a string.
    let call = move || unsafe { wraptor_get(hand, ONE, STAT, null_mut(), 3000) };
    let call = thread::spawn(call);
    // A call waits for its turn, within its limit.
    // SAFETY: a string.
    while unsafe { wraptor_get(hand, ONE, MT, null_mut(), 200) } != WRAPTOR_TIMED_OUT {
        assert!(!call.is_finished(), "it has not taken its turn");
    }
    assert_eq!(wraptor_close_connection(hand, 20), WRAPTOR_TIMED_OUT);
    assert_eq!(wraptor_ws_down(20), WRAPTOR_TIMED_OUT);
    assert_eq!(wraptor_ws_down(HANGS), WRAPTOR_OK);
    assert_eq!(call.join().expect("it ends"), WRAPTOR_TIMED_OUT);

    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("its address").to_string();
    let connecting = thread::spawn(move || connect(&address, HANGS).0);
    let (peer, _) = listener.accept().expect("the connect has begun");
    assert_eq!(wraptor_ws_down(HANGS), WRAPTOR_OK);
    answer_lines(peer, &[("VERS", "601")]);
    assert_eq!(connecting.join().expect("it ends"), WRAPTOR_CANCELLED);
}

fn listener_ends_with_its_hand_and_with_ws_down() {
    let served = Served::fast_hand();
    let hand = connect(served.place("gcl"), HANGS).1;
    served::end(&served.process);
    let (sender, outcome) = channel();
    let thread = thread::spawn(move || sender.send(wraptor_listener(hand, WRAPTOR_ENDLESS)));
    assert_eq!(outcome.recv_timeout(OVER), Ok(WRAPTOR_LOST));
    let _ = thread.join().expect("it ends");
    let served = Served::fast_hand();
    for _ in 0..2 {
        let hand = connect(served.place("gcl"), HANGS).1;
        // SAFETY: the function takes the number as its argument.
        assert_eq!(
            unsafe { wraptor_start_thread(Some(listen), hand as *mut c_void, null_mut()) },
            WRAPTOR_OK
        );
        // It reads while the listener does.
        assert_eq!(wraptor_wake_grasper(hand, HANGS), WRAPTOR_OK);
        assert_eq!(wraptor_ws_down(HANGS), WRAPTOR_OK);
        assert_eq!(left().0, 0, "threads of the library");
    }
}

fn discovery_ends() {
    let (mut mac, mut address, mut port) = ([0; 18], [0; 16], 0);
    // SAFETY: a string, and buffers of these sizes.
    let error = unsafe {
        let (mac_at, address_at) = (mac.as_mut_ptr(), address.as_mut_ptr());
        wraptor_discover_grasper(c"127.0.0.1:9".as_ptr(), mac_at, 18, address_at, 16, &raw mut port, 50)
    };
    assert_eq!(error, WRAPTOR_NOT_CONNECTED);
}
