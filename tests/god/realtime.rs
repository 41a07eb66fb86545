//! LOOP, its blocks (manual 6) and their rate.

mod errors;
mod follow;
mod going_on;
mod latency;

use super::Session;
use crate::figures::Figure::Near;
use crate::figures::claim;

struct Host {
    session: Session,
}

/// Longest answer to a block, us: clients wait 100 ms (decision 0026).
const BLOCK_US: u64 = 100_000;

impl Host {
    /// A hand after HI, in RealTime with the motors of a prefix.
    fn new(prefix: &str) -> Self {
        Self::from_session(Session::new(), prefix)
    }

    fn from_session(mut session: Session, prefix: &str) -> Self {
        assert_eq!(session.run(&format!("{prefix}HI")), "");
        Self::enter(session, prefix)
    }

    fn enter(mut session: Session, prefix: &str) -> Self {
        let line = format!("{prefix}LOOP");
        session.hand.push_rx(line.as_bytes());
        session.hand.push_rx(b"\r");
        let mut host = Self { session };
        assert_eq!(host.read(line.len()), line.as_bytes());
        assert_eq!(host.read(1), b"*", "the very next byte after the echo");
        host
    }

    fn read(&mut self, count: usize) -> Vec<u8> {
        let end = self.session.hand.now_us() + BLOCK_US + 2_000_000 * u64::from(count == 1);
        let mut received = self.session.hand.take_tx();
        while received.len() < count {
            assert!(self.session.hand.now_us() < end, "{received:?}");
            self.session.wait_us(10);
            received.extend(self.session.hand.take_tx());
        }
        assert_eq!(received.len(), count, "{received:?}");
        received
    }

    fn block(&mut self, block: &[u8], answer: usize) -> Vec<u8> {
        self.session.hand.push_rx(block);
        self.read(answer)
    }

    /// True velocity and position of each motor, counts/s and counts.
    fn truth(&self) -> Vec<(f64, f64)> {
        let truths = self.session.hand.bus().stations().map(|node| node.board().rig().truth());
        truths.map(|truth| (truth.counts_per_s, truth.counts)).collect()
    }
}

const ALL: &str = "X1234567";
fn control(velocity: i8, gain: u8) -> Vec<u8> {
    std::iter::once(b'C').chain([velocity.cast_unsigned(), gain].repeat(7)).collect()
}
/// Bytes of its answer: header, then velocity, strain, four of position and the change for each motor.
const FEEDBACK: usize = 1 + 7 * 7;

#[test]
fn blocks_move_motors_and_feed_back_positions() {
    let mut host = Host::new("");
    let block: Vec<u8> = std::iter::once(b'C').chain([25, 32].repeat(4)).collect();
    let mut answer = Vec::new();
    for _ in 0..50 {
        answer = host.block(&block, 1 + 4 * 7);
        host.session.wait_us(5_000);
    }
    let truth = host.truth();
    // 25 x LCVC 8 = 200 counts/s. Friction is compensated (decision 0064); before, it took 32 counts/s.
    for (motor, &(speed, _)) in truth[..4].iter().enumerate() {
        assert!((195.0..205.0).contains(&speed), "motor {}: {speed}", motor + 1);
    }
    // A tip follows its link's place (realtime/follow.rs); its velocity still settles.
    for (finger, &(speed, _)) in truth[4..].iter().enumerate() {
        let share = truth[finger].0 * 13.0 / 49.0;
        assert!((speed - share).abs() < 20.0, "tip {}: {speed} of {share}", finger + 5);
    }
    for (axis, (data, &(speed, counts))) in answer[1..].chunks(7).zip(&truth).enumerate() {
        let told = f64::from(data[0].cast_signed()) * 8.0;
        assert!((told - speed).abs() < 40.0, "axis {axis}: {told} of {speed}");
        let position = f64::from(i32::from_be_bytes(data[2..6].try_into().expect("four")));
        assert!((position - 55.0 * counts).abs() < 55.0 * 3.0, "axis {axis}: {position} of {counts} counts");
    }
    assert_eq!(host.block(b"a", 1), b"*");
    host.session.hand.push_rx(b"\x03");
    assert_eq!(host.session.read_to_prompt(), "\r\n\r=> ", "no ERR");
    host.session.wait_us(300_000);
    assert!(host.truth().iter().all(|(speed, _)| speed.abs() < 1.0), "{:?}", host.truth());
}

#[test]
fn feedback_is_the_measured_velocity() {
    let mut host = Host::new("X4");
    for _ in 0..20 {
        let answer = host.block(&[b'C', 100, 0], 8);
        assert_eq!(answer[1], 0, "{answer:?}");
        host.session.wait_us(5_000);
    }
}

#[test]
fn line_feed_after_loop_is_no_header() {
    let mut host = Host::new("X4");
    assert_eq!(host.block(b"\nA", 8)[0], b'*');
    host.session.hand.push_rx(b"\n");
    assert_eq!(host.session.read_to_prompt(), "\r\n\rERR 2048\r\n\r=> ");
}

#[test]
fn bad_header_ends_loop() {
    let mut host = Host::new("1");
    assert_eq!(host.block(b"A", 8)[0], b'*');
    host.session.hand.push_rx(b"x");
    assert_eq!(host.session.read_to_prompt(), "\r\n\rERR 2048\r\n\r=> ");
    assert_eq!(host.session.run("FROB"), "ERR 32", "lines again");
}

#[test]
fn control_c_after_the_end_of_loop_aborts() {
    for (bytes, received) in [
        (&b"x\x03"[..], "\r\n\rERR 2048\r\n\r=> \r\n\r=> "),
        (b"\x03\x03\x03", "\r\n\r=> \r\n\r=> "),
        (b"\x03VERS\r", "\r\n\r=> VERS\r\n\r600\r\n\r=> "),
        // GOD cannot tell what such a ^C was meant for.
        (b"xFROB\r\x03VERS\r", "\r\n\rERR 2048\r\n\r=> "),
        // C would be a long motion.
        (b"xC\r\x03", "\r\n\rERR 2048\r\n\r=> \r\n\r=> "),
    ] {
        let mut host = Host::new("1");
        host.session.hand.push_rx(bytes);
        host.session.wait_us(50_000);
        let text = String::from_utf8(host.session.hand.take_tx()).expect("text");
        assert_eq!(text, received, "{:?}", bytes.escape_ascii().to_string());
    }
}

#[test]
fn silent_host_stops_motors_until_the_next_block() {
    let mut host = Host::new("X4");
    host.block(&[b'C', 20, 32], 8);
    host.session.wait_us(240_000);
    assert!(host.truth()[3].0 > 80.0, "it moves on for a while");
    host.session.wait_us(160_000);
    assert!(host.truth()[3].0.abs() < 2.0, "{:?}", host.truth()[3]);
    // Without keep-alives the boards would idle after half a second.
    host.session.wait_us(5_000_000);
    for _ in 0..20 {
        host.block(&[b'C', 20, 32], 8);
        host.session.wait_us(10_000);
    }
    assert!(host.truth()[3].0 > 80.0, "{:?}", host.truth()[3]);
}

#[test]
fn lost_board_is_err_1_instead_of_the_next_star() {
    let mut host = Host::new("X12");
    host.block(b"A", 15);
    host.session.hand.bus_mut().cut(1, true);
    host.session.hand.push_rx(b"A");
    host.session.wait_us(300_000);
    let received = host.session.hand.take_tx();
    assert_eq!((received.len(), received[0]), (15, b'*'), "the answer begins before the loss is known");
    host.session.hand.push_rx(b"A");
    assert_eq!(host.session.read_to_prompt(), "\r\n\rERR 1\r\n\r=> ");
}

#[test]
fn fault_is_err_8_instead_of_the_next_star() {
    for bus_v in [10.0, 40.0] {
        let mut host = Host::new("X12");
        host.block(&[b'C', 20, 32, 20, 32], 15);
        let node = host.session.hand.bus_mut().station_mut(1).expect("motor 2");
        node.rig_mut().set_bus(bus_v);
        host.session.wait_us(100_000);
        host.session.hand.push_rx(b"A");
        assert_eq!(host.session.read_to_prompt(), "\r\n\rERR 8\r\n\r=> ");
    }
}

/// Required blocks per second of seven motors with all feedback (decision 0026).
const RATE_HZ: u64 = 250;

#[test]
fn seven_motors_with_all_feedback_reach_250_blocks_per_second() {
    let mut host = Host::new(ALL);
    let begin = (host.session.hand.now_us(), host.session.hand.bus().stats().busy_us);
    let blocks: u32 = 500;
    let mut latency_us = 0;
    for i in 0..blocks {
        let before = host.session.hand.now_us();
        let (velocity, gain) = ((i % 16) as i8, 16 + (i % 2) as u8);
        host.block(&control(velocity, gain), FEEDBACK);
        latency_us = latency_us.max(host.session.hand.now_us() - before);
    }
    let took_us = host.session.hand.now_us() - begin.0;
    let busy_us = host.session.hand.bus().stats().busy_us - begin.1;
    let rate = 1_000_000 * u64::from(blocks) / took_us;
    println!(
        "figure: RealTime, seven motors, all data, gain changing: {rate} blocks/s, at worst {latency_us} us; bus load {} %",
        100 * busy_us / took_us
    );
    assert!(rate >= RATE_HZ, "{rate}");
    let [rate, load] =
        [1e6 * f64::from(blocks), 100.0 * busy_us as f64].map(|sum| Near(sum / took_us as f64));
    claim("README.md", "all feedback | {} blocks/s, limited by the CAN bus ({} % load) |", &[rate, load]);
}

const BYTE_NS: u64 = 10 * 1_000_000_000 / 38_400;

#[test]
fn loop_at_38400_baud_is_limited_by_the_wire() {
    let mut host = Host::new(ALL);
    let (blocks, begin) = (60, host.session.hand.now_us());
    for _ in 0..blocks {
        // Each direction has its own wire; `free_ns` is when the one to the host is free, ns.
        let start_ns = 1000 * host.session.hand.now_us();
        let block = control(10, 16);
        let (mut sent, mut got, mut free_ns, mut waits) = (0, 0, start_ns, 0);
        while got < FEEDBACK {
            let now_ns = 1000 * host.session.hand.now_us();
            while sent < block.len() && start_ns + BYTE_NS * (sent as u64 + 1) <= now_ns {
                host.session.hand.push_rx(&block[sent..=sent]);
                sent += 1;
            }
            host.session.wait_us(0);
            waits += host.session.hand.take_tx().len();
            while waits > 0 && free_ns.max(start_ns) + BYTE_NS <= now_ns {
                // A byte that was ready in time follows its predecessor at once.
                free_ns = (free_ns + BYTE_NS).max(now_ns - BYTE_NS);
                waits -= 1;
                got += 1;
            }
            if waits == 0 {
                free_ns = free_ns.max(now_ns);
            }
            host.session.wait_us(20);
        }
    }
    let took_ns = 1000 * (host.session.hand.now_us() - begin);
    // The header, then the feedback; the control data arrive meanwhile.
    let allowed_ns = blocks * (1 + FEEDBACK as u64) * BYTE_NS;
    let share = 100.0 * allowed_ns as f64 / took_ns as f64;
    println!(
        "figure: RealTime at 38400 baud, seven motors, all data: {:.1} blocks/s, {share:.1} % of what the wire allows",
        1e9 * blocks as f64 / took_ns as f64
    );
    assert!(share >= 95.0, "{share}");
}
