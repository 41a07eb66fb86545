//! Downloads through a hand and over a bus, whole and cut off, and hands that are discovered.

mod served;

use std::net::SocketAddrV4;
use std::ops::ControlFlow;
use std::thread;
use std::time::Duration;

use served::{Cut, HANGS, Proxy, Served, firmware, tek};
use tater_f103::map::APPLICATION;
use tater_wire::tek::{Encoder, end};
use wraptor::{
    BoardState, Boards, Bus, Connect, DownloadProgress, Failure, Firmware, Hand, Node, Property, discover,
};

const LIMIT: Duration = Duration::from_secs(120);

/// A connection as a download needs it.
fn connected(address: &str) -> Hand {
    Connect::tcp(address).boards(Boards::Any).connect(HANGS).expect("connected")
}

fn node(number: u8) -> Node {
    Node::new(number).expect("a node")
}

#[test]
fn hand_downloads_to_several_boards_with_progress() {
    let served = Served::fast_hand();
    let mut hand = connected(served.place("gcl"));
    let mut seen: Vec<DownloadProgress> = Vec::new();
    let firmware = firmware(4096);
    hand.download("13", &firmware, LIMIT, &mut |progress| {
        seen.push(*progress);
        ControlFlow::Continue(())
    })
    .expect("they run it");
    for number in [1, 3] {
        let of_node = || seen.iter().filter(|progress| progress.node == node(number));
        assert_eq!(of_node().next_back().map(DownloadProgress::percent), Some(100), "{seen:?}");
        assert!(of_node().all(|progress| progress.percent() <= 100));
    }
    assert!(seen.iter().all(|progress| progress.node == node(1) || progress.node == node(3)));
    // Lines again, no packets; boards 1 and 3 run the application, the others still sleep.
    let states = hand.boards(HANGS).expect("states");
    use BoardState::{Asleep, Ready};
    assert_eq!(states, [Ready, Asleep, Ready, Asleep, Asleep, Asleep, Asleep]);
    assert_eq!(hand.get("1", Property::STAT, HANGS), Ok(vec![(node(1), 2)]));
}

/// By CAN packets of the session become frames in this program.
#[test]
fn hand_by_can_downloads() {
    let served = Served::new(&["bus", "--nodes", "1-7", "--slcan", "127.0.0.1:0"], 1);
    let mut hand = Connect::can(served.place("slcan")).boards(Boards::Any).connect(HANGS).expect("connected");
    hand.download("2", &firmware(2048), LIMIT, &mut |_| ControlFlow::Continue(())).expect("it runs it");
    let states = hand.boards(HANGS).expect("states");
    assert_eq!(states[..2], [BoardState::Asleep, BoardState::Ready]);
}

#[test]
fn damaged_file_is_refused_before_anything_is_sent() {
    let whole = tek(512, 601);
    let mut flipped = whole.clone();
    flipped[30] = if flipped[30] == b'0' { b'1' } else { b'0' };
    let cut = whole[..whole.len() / 2].to_vec();
    for (text, found) in [
        (flipped, "1:"),
        (cut, "expected"),
        (Vec::new(), "expected a termination record"),
        (b"hello\n".to_vec(), "1:1: "),
    ] {
        let error = Firmware::new(text).expect_err("damaged").to_string();
        assert!(error.contains(found) && error.contains("\n  next: "), "{error}");
    }
}

/// Records of zeros at offsets from the application's first address, and a termination.
fn records(pieces: &[(i64, usize)]) -> Vec<u8> {
    let mut text = Vec::new();
    for &(offset, len) in pieces {
        let at = u32::try_from(i64::from(APPLICATION.start) + offset).expect("an address");
        for line in Encoder::new(at, &vec![0; len]).into_iter().flatten() {
            text.extend_from_slice(line.as_bytes());
        }
    }
    text.extend_from_slice(end(APPLICATION.start).as_bytes());
    text
}

#[test]
fn records_at_wrong_addresses_are_named_by_their_addresses() {
    let area = i64::from(APPLICATION.len);
    let gap = "; no record brings 0x08004020 to 0x0800405f";
    for (pieces, found) in [
        (&[(-64, 32)][..], "found addresses 0x08003fc0 to 0x08003fdf, expected 0x08004000 to 0x08010fff"),
        (&[(0, 512), (area - 16, 32)], "found addresses 0x08010ff0 to 0x0801100f"),
        (&[(64, 32), (32, 32)], "found address 0x08004020, expected 0x08004060 or above"),
        (&[(0, 64), (63, 32)], "found address 0x0800403f, expected 0x08004040 or above"),
        (&[(0, 32), (96, 512)], gap),
    ] {
        let error = Firmware::new(records(pieces)).expect_err("no image").to_string();
        assert!(error.contains(found), "{pieces:?}: {error}");
        assert_eq!(error.contains("no record brings"), found == gap, "{error}");
    }
}

/// What went through editors and mail: the records are sent as they are, and one termination.
#[test]
fn file_with_other_line_ends_is_downloaded() {
    let served = Served::fast_hand();
    let mut hand = connected(served.place("gcl"));
    let whole = String::from_utf8(tek(2048, 601)).expect("ASCII");
    let last = whole.lines().last().expect("a termination");
    for text in [
        whole.replace('\r', ""),
        whole.replace('\n', ""),
        format!("{}{last}\r\n\x1A", whole.replace('\r', " \t\r")),
    ] {
        let firmware = Firmware::new(text.into_bytes()).expect("the same records");
        hand.download("1", &firmware, LIMIT, &mut |_| ControlFlow::Continue(())).expect("it runs");
    }
    assert_eq!(hand.get("1", Property::STAT, HANGS), Ok(vec![(node(1), 2)]));
}

#[test]
fn board_that_is_not_there_is_named_and_the_hand_still_answers() {
    let served = Served::new(&["bus", "--nodes", "1-2", "--slcan", "127.0.0.1:0"], 1);
    let mut bus = Bus::slcan(served.place("slcan"), HANGS).expect("connected");
    let error = bus.download(node(3), &firmware(2048), LIMIT, &mut |_| ControlFlow::Continue(()));
    let error = error.expect_err("no such board");
    assert!(error.to_string().contains("no board of node 3 answers\n  next: check its number"), "{error}");
    bus.download(node(2), &firmware(2048), LIMIT, &mut |_| ControlFlow::Continue(())).expect("it runs");
    assert_eq!(bus.state(node(2), HANGS), Ok(BoardState::Ready));
}

/// Cancelled, cut off or out of time: the board's old application starts, and the next download succeeds.
#[test]
fn interrupted_download_leaves_the_old_application() {
    let served = Served::fast_hand();
    let firmware = firmware(8192);
    let mut hand = connected(served.place("gcl"));
    let halfway = &mut |progress: &DownloadProgress| match progress.percent() > 0 {
        true => ControlFlow::Break(()),
        false => ControlFlow::Continue(()),
    };
    let error = hand.download("2", &firmware, LIMIT, halfway).expect_err("cancelled");
    assert_eq!(error.failure, Failure::Cancelled);
    let limit = Duration::from_millis(30);
    let error =
        hand.download("2", &firmware, limit, &mut |_| ControlFlow::Continue(())).expect_err("too short");
    assert_eq!(error.failure, Failure::TimedOut(limit));
    hand.wake(HANGS).expect("the old application starts");
    drop(hand);
    // A numbered frame of node 2.
    let proxy = Proxy::new(&served, &[0, 2, 8], Cut::Silence);
    let mut hand = connected(&proxy.address);
    let limit = Duration::from_secs(3);
    let error =
        hand.download("2", &firmware, limit, &mut |_| ControlFlow::Continue(())).expect_err("cut off");
    assert!(matches!(error.failure, Failure::TimedOut(_)), "{error}");
    drop((hand, proxy));
    let mut hand = connected(served.place("gcl"));
    hand.wake(HANGS).expect("the old application starts");
    hand.download("2", &firmware, LIMIT, &mut |_| ControlFlow::Continue(())).expect("it runs the new one");
}

#[test]
fn download_over_a_serial_line_at_its_rate() {
    if !cfg!(unix) {
        return;
    }
    // In real time: with --speed max the hand runs away from a host on a busy machine, whose questions it then takes for silence.
    let served = Served::new(&["hand", "--pty", "--pace-baud"], 1);
    let hand = Connect::serial(served.place("pty"), 9600).boards(Boards::Any).connect(HANGS);
    let mut hand = hand.expect("connected");
    hand.download("5", &firmware(2048), LIMIT, &mut |_| ControlFlow::Continue(())).expect("it runs");
}

#[test]
fn all_hands_that_answer_are_found() {
    let ask = |served: &[Served]| {
        let to: Vec<SocketAddrV4> =
            served.iter().map(|served| served.place("discovery").parse().expect("IPv4")).collect();
        discover(&to, Duration::from_millis(300)).expect("sent")
    };
    let args = ["hand", "--listen", "127.0.0.1:0", "--discovery", "127.0.0.1:0"];
    let served: Vec<Served> = (0..3).map(|_| Served::new(&args, 2)).collect();
    let found = ask(&served);
    let mut places: Vec<String> = served.iter().map(|served| served.place("gcl").to_owned()).collect();
    places.sort_by_key(|place| place.parse::<SocketAddrV4>().expect("IPv4"));
    assert_eq!(found.iter().map(|found| found.address.to_string()).collect::<Vec<_>>(), places);
    assert!(found.iter().all(|found| found.hardware.is_some()), "{found:?}");
    // None answers: no error.
    drop(served);
    thread::yield_now();
    assert_eq!(discover(&["127.0.0.1:9".parse().expect("IPv4")], Duration::from_millis(50)), Ok(vec![]));
}
