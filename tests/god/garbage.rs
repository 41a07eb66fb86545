//! Garbage in: whatever a host sends, nothing panics, no motor leaves its limits, no queue grows, and ^C brings the prompt back.
//!
//! 10^7 bytes in all, in five distributions that reach ever deeper. In between the host sends ^C, disconnects in mid-line, or stops reading.
//! Seeds are fixed, so a failure repeats. watch.rs has the invariants that are checked each millisecond.

mod blocks;
mod client;
mod programs;
mod watch;

use client::{Client, Figure};
use hil_torture::lines;
use rand::RngExt;

const ANY: u64 = 6_000_000;
/// Characters of the language's commands, digits and line ends.
const CHARACTERS: u64 = 2_000_000;
const WORDS: u64 = 1_200_000;
/// Commands, one line each.
const COMMANDS: u64 = 60_000;
const BLOCKS: u64 = 740_000;

const _: () = assert!(ANY + CHARACTERS + WORDS + COMMANDS + BLOCKS >= 10_000_000, "10^7 bytes");

/// Bytes sent at once: the size of GOD's input queue.
const CHUNK: usize = 256;

/// Hands that share a distribution, one after another: a motor that has pressed on its stop for minutes is too hot to move.
const HANDS: u64 = 4;

fn run(what: &str, bytes: u64, seed: u128, mut send: impl FnMut(&mut Client)) {
    let mut figure = Figure::default();
    for hand in 0..HANDS {
        let seed = seed + u128::from(hand);
        println!("{what}: seed {seed:#x}");
        let mut client = Client::new(seed);
        let mut homed = 0;
        while client.figure.bytes < bytes.div_ceil(HANDS) {
            if client.figure.bytes >= homed {
                client.restore_and_home();
                homed = client.figure.bytes + bytes / HANDS / 8;
            }
            send(&mut client);
        }
        figure = figure.merge(client.finish());
    }
    println!("figure: garbage, {what}: {figure}");
    assert!(figure.bytes >= bytes, "{what}");
}

#[test]
fn random_bytes_break_nothing() {
    run("any bytes", ANY, 0xA11, |client| {
        let bytes: [u8; CHUNK] = client.rng.random();
        client.send(&bytes, 200);
    });
}

#[test]
fn random_characters_break_nothing() {
    const OFTEN: &[u8] = b"CHIOMTGSXLP123456790 \r\r\r\r";
    run("any characters", CHARACTERS, 0xC4A, |client| {
        let bytes: Vec<u8> = (0..CHUNK).map(|_| *lines::one(&mut client.rng, OFTEN)).collect();
        client.send(&bytes, 40);
    });
}

#[test]
fn random_words_break_nothing() {
    run("any words", WORDS, 0x50FA, |client| {
        let words: String = (0..24).map(|_| lines::word(&mut client.rng)).collect();
        client.send(words.as_bytes(), 40);
        client.maybe_hang_up(200);
    });
}

#[test]
fn random_commands_break_nothing() {
    run("any commands", COMMANDS, 0xC0, |client| {
        let line = lines::command(&mut client.rng);
        if client.maybe_hang_up(50) {
            client.send(line.as_bytes(), 1_000);
            client.hand.hang_up();
            return;
        }
        client.send(line.as_bytes(), 1_000);
        client.send(b"\r", 1_000);
        match client.rng.random_range(0..12) {
            0..5 => client.wait(20),
            5..8 => client.wait(300),
            8 => client.wait_for_prompt(5_000),
            9 => client.abort(),
            10 => client.wait_unread(800),
            // Type-ahead.
            _ => {}
        }
    });
}

#[test]
fn random_blocks_break_nothing() {
    run("any blocks", BLOCKS, 0xB10C, blocks::session);
}

/// GOD stops reading input when its output queue is full.
#[test]
fn host_that_never_reads_loses_nothing() {
    let mut client = Client::new(2);
    let mut taken = 0;
    for _ in 0..1_000 {
        while client.hand.io().rx_room() > 0 {
            client.hand.push_rx(b"\r");
            taken += 1;
        }
        client.step_unread();
    }
    // A prompt has six bytes: the prompts that fit, and the type-ahead.
    let (prompts, ahead) = (client::UNREAD / 6, CHUNK);
    assert!((prompts..=prompts + ahead + 1).contains(&taken), "{taken} lines");
    assert_eq!(client.read(6 * taken, 1_000), b"\r\n\r=> ".repeat(taken));
    client.finish();
}

/// GOD stops the motors while it waits for the host to read; their boards would stop them by HOSTMS, after 2 s.
#[test]
fn loop_host_never_reads_motors_stop() {
    let mut client = Client::new(3);
    client.restore_and_home();
    client.hand.push_rx(b"LOOP\r");
    assert_eq!(client.read(5, 1_000), b"LOOP*");
    let block = [&b"C"[..], &[25, 32].repeat(4)].concat();
    while client.hand.io().rx_room() > block.len() {
        client.hand.push_rx(&block);
        client.step_unread();
    }
    // A tip begins once its link has moved.
    (0..100).for_each(|_| client.step_unread());
    let speeds = |client: &Client| -> Vec<f64> {
        client.hand.bus().stations().map(|node| node.board().rig().truth().counts_per_s.abs()).collect()
    };
    assert!(speeds(&client).iter().all(|&speed| speed > 10.0), "{:?}", speeds(&client));
    // GOD's 250 ms (docs/hand.md, Deadlines), and 100 ms for the rotors to stop.
    (0..350).for_each(|_| client.step_unread());
    assert_eq!(speeds(&client), [0.0; 7]);
    client.finish();
}

/// GOD has no heap: these three values are all its memory.
#[test]
fn god_fits_64_kib_of_ram() {
    let (io, memory) = (god::Io::default(), god::Memory::default());
    let sizes = [size_of_val(&god::run(&io, &memory)), size_of_val(&io), size_of_val(&memory)];
    println!("figure: GOD's future, ports and memory: {sizes:?} bytes");
    // The RAM of an STM32F103xE, a larger member of the motor boards' family. The manual does not name GOD's processor.
    assert!(sizes.iter().sum::<usize>() <= 64 * 1024, "{sizes:?}");
}

/// Commands aborted before their motion begins have already queued questions to the boards.
#[test]
fn host_faster_than_the_bus_fills_no_queue() {
    let mut client = Client::new(1);
    for _ in 0..10_000 {
        client.hand.push_rx(b"X1234567C\r");
        let now_us = client.hand.now_us();
        client.hand.run_until(now_us + 10);
        client.hand.push_rx(b"\x03");
        client.hand.take_tx();
        assert!(client.hand.bus().waiting() <= watch::WAITING);
    }
    client.finish();
}
