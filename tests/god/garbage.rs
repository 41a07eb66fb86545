//! Garbage in: whatever a host says, nothing panics, nothing moves outside its limits, nothing grows, and ^C gives the prompt back.
//!
//! 10^7 bytes in all, in distributions that reach more and more of GOD: any bytes; bytes that are often short commands; the words of
//! the language in any order; lines that are commands; RealTime blocks. In between the host says ^C, hangs up in mid-line, or reads
//! nothing for a while. Seeds are fixed: what fails once fails again. What must hold meanwhile is in watch.rs.

mod blocks;
mod client;
mod lines;
mod watch;

use client::{Client, Figure};
use rand::RngExt;

/// Any bytes.
const ANY: u64 = 6_000_000;
/// Characters of the language's commands, digits and line ends.
const CHARACTERS: u64 = 2_000_000;
/// Words of the tables.
const WORDS: u64 = 1_200_000;
/// Commands, one line each.
const COMMANDS: u64 = 60_000;
/// RealTime blocks and what goes before them.
const BLOCKS: u64 = 740_000;

const _: () = assert!(ANY + CHARACTERS + WORDS + COMMANDS + BLOCKS >= 10_000_000, "10^7 bytes");

/// Bytes that come at once: as many as GOD lets wait.
const AT_ONCE: usize = 256;

/// Hands that a distribution is said to, one after another: motors that have pressed on their stops for minutes are hot, and move no more.
const HANDS: u64 = 4;

/// Says to each hand its share of so many bytes: `say` some of it at a time.
fn said(what: &str, bytes: u64, seed: u128, mut say: impl FnMut(&mut Client)) {
    let mut figure = Figure::default();
    for hand in 0..HANDS {
        let seed = seed + u128::from(hand);
        // Seen where it fails.
        println!("{what}: seed {seed:#x}");
        let mut client = Client::new(seed);
        let mut homed = 0;
        while client.figure.bytes < bytes.div_ceil(HANDS) {
            // Now and then every motor knows where it is, and has the properties to move.
            if client.figure.bytes >= homed {
                client.homes();
                homed = client.figure.bytes + bytes / HANDS / 8;
            }
            say(&mut client);
        }
        figure = figure.and(client.ends());
    }
    println!("figure: garbage, {what}: {figure}");
    assert!(figure.bytes >= bytes, "{what}");
}

#[test]
fn any_bytes() {
    said("any bytes", ANY, 0xA11, |client| {
        let bytes: [u8; AT_ONCE] = client.rng.random();
        client.says(&bytes, 200);
    });
}

#[test]
fn any_characters() {
    const OFTEN: &[u8] = b"CHIOMTGSXLP123456790 \r\r\r\r";
    said("any characters", CHARACTERS, 0xC4A, |client| {
        let bytes: Vec<u8> = (0..AT_ONCE).map(|_| *lines::one(&mut client.rng, OFTEN)).collect();
        client.says(&bytes, 40);
    });
}

#[test]
fn any_words() {
    said("any words", WORDS, 0x50FA, |client| {
        let words: String = (0..24).map(|_| lines::word(&mut client.rng)).collect();
        client.says(words.as_bytes(), 40);
        client.may_hang_up(200);
    });
}

#[test]
fn any_commands() {
    said("any commands", COMMANDS, 0xC0, |client| {
        let line = lines::command(&mut client.rng);
        if client.may_hang_up(50) {
            client.says(line.as_bytes(), 1_000);
            client.hand.hang_up();
            return;
        }
        client.says(line.as_bytes(), 1_000);
        client.says(b"\r", 1_000);
        match client.rng.random_range(0..12) {
            0..5 => client.waits(20),
            5..8 => client.waits(300),
            8 => client.waits_for_prompt(5_000),
            9 => client.aborts(),
            10 => client.is_deaf(800),
            // It types ahead.
            _ => {}
        }
    });
}

#[test]
fn any_blocks() {
    said("any blocks", BLOCKS, 0xB10C, blocks::session);
}

/// What it does not read fills what GOD keeps for it, and then GOD takes no more. It loses nothing of what it was told.
#[test]
fn a_host_that_never_reads_is_waited_for() {
    let mut client = Client::new(2);
    let mut taken = 0;
    for _ in 0..1_000 {
        while client.hand.io().rx_room() > 0 {
            client.hand.push_rx(b"\r");
            taken += 1;
        }
        client.deaf_ms();
    }
    // A prompt has six bytes: so many prompts, and what is typed ahead.
    let (prompts, ahead) = (client::UNREAD / 6, AT_ONCE);
    assert!((prompts..=prompts + ahead + 1).contains(&taken), "{taken} lines");
    assert_eq!(client.reads(6 * taken, 1_000), b"\r\n\r=> ".repeat(taken));
    client.ends();
}

/// In RealTime, too; and its motors, which GOD cannot tell anything meanwhile, stop: their boards miss their host.
#[test]
fn motors_stop_whose_host_never_reads() {
    let mut client = Client::new(3);
    client.homes();
    client.hand.push_rx(b"LOOP\r");
    assert_eq!(client.reads(5, 1_000), b"LOOP*");
    let block = [&b"C"[..], &[25, 32].repeat(4)].concat();
    while client.hand.io().rx_room() > block.len() {
        client.hand.push_rx(&block);
        client.deaf_ms();
    }
    let speeds = |client: &Client| -> Vec<f64> {
        client.hand.bus().stations().map(|node| node.board().rig().truth().counts_per_s.abs()).collect()
    };
    assert!(speeds(&client).iter().all(|&speed| speed > 10.0), "{:?}", speeds(&client));
    // A board's patience of 500 ms, and 100 ms for a rotor to stand.
    (0..600).for_each(|_| client.deaf_ms());
    assert_eq!(speeds(&client), [0.0; 7]);
    client.ends();
}

/// GOD has no heap: all that it can ever hold is in these three values.
#[test]
fn god_is_no_bigger_than_it_is() {
    let (io, memory) = (god::Io::default(), god::Memory::default());
    let sizes = [size_of_val(&god::run(&io, &memory)), size_of_val(&io), size_of_val(&memory)];
    println!("figure: GOD's work, ports and memory: {sizes:?} bytes");
    // The manual does not say what processor GOD has: the RAM of a larger one of the motor boards' family, STM32F103xE.
    assert!(sizes.iter().sum::<usize>() <= 64 * 1024, "{sizes:?}");
}

/// Motions that ^C ends before they have begun leave questions to the boards behind, which the bus has to carry all the same.
#[test]
fn a_host_faster_than_the_bus_fills_no_memory() {
    let mut client = Client::new(1);
    for _ in 0..10_000 {
        client.hand.push_rx(b"X1234567C\r");
        let now_us = client.hand.now_us();
        client.hand.run_until(now_us + 10);
        client.hand.push_rx(b"\x03");
        client.hand.take_tx();
        assert!(client.hand.bus().waiting() <= watch::WAITING);
    }
    client.ends();
}
