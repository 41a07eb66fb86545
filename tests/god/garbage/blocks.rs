//! RealTime sessions: polite ones, whose every answer is checked, and random ones.

use rand::RngExt;

use super::client::Client;
use hil_torture::lines::one;

const AXES: [(&str, usize); 8] =
    [("", 4), ("G", 3), ("S", 1), ("12", 2), ("X1234567", 7), ("XGS", 7), ("X5", 1), ("X35", 2)];

/// Longest answer to a block, ms: clients wait 100 ms (decision 0026).
const BLOCK_MS: usize = 100;

struct Shape {
    axes: usize,
    control: usize,
    feedback: usize,
}

pub fn session(client: &mut Client) {
    let (prefix, axes) = *one(&mut client.rng, &AXES);
    let shape = set_flags(client, axes);
    let polite = client.rng.random_ratio(2, 3);
    client.send(format!("{prefix}LOOP").as_bytes(), 1);
    client.step();
    client.send(b"\r", 1);
    if polite {
        read_first_star(client);
    }
    let mut block = Vec::new();
    for _ in 0..client.rng.random_range(0..100) {
        if block.is_empty() || client.rng.random_ratio(1, 4) {
            block = (0..shape.control).map(|_| client.rng.random()).collect();
        }
        if polite {
            polite_block(client, &shape, &block);
        } else {
            any_block(client, &block);
        }
    }
    client.abort();
}

fn set_flags(client: &mut Client, axes: usize) -> Shape {
    let mut flag = |max: usize| client.rng.random_range(0..=max);
    let [lcv, lcpg, lfv, lfs, lfdp, lft, lfdpd] = [(); 7].map(|()| flag(1));
    let (lfap, lcvc, lfvc, lfdpc) = (flag(2), 1 + flag(254), 1 + flag(254), 1 + flag(254));
    for line in [
        format!("X1234567FSET LCV {lcv} LCVC {lcvc} LCPG {lcpg}"),
        format!("X1234567FSET LFV {lfv} LFVC {lfvc} LFS {lfs} LFAP {lfap} LFDP {lfdp} LFDPC {lfdpc}"),
        format!("PSET LFT {lft} LFDPD {lfdpd}"),
    ] {
        client.run(&line);
    }
    let each = lfv + lfs + [0, 4, 2][lfap] + lfdp;
    Shape { axes, control: axes * (lcv + lcpg), feedback: 1 + axes * each + 2 * lft }
}

fn read_first_star(client: &mut Client) {
    let received = client.read(1, 2_000);
    assert_eq!(received, b"*", "{:?}", received.escape_ascii().to_string());
}

fn polite_block(client: &mut Client, shape: &Shape, data: &[u8]) {
    let header = *one(&mut client.rng, b"CCCCCcAa");
    client.hand.push_rx(&[header]);
    if matches!(header, b'C' | b'c') {
        client.hand.push_rx(data);
        client.figure.bytes += data.len() as u64;
    }
    client.figure.bytes += 1;
    client.figure.blocks += 1;
    let len = if matches!(header, b'C' | b'A') { shape.feedback } else { 1 };
    let received = client.read(len, BLOCK_MS);
    let text = received.escape_ascii().to_string();
    assert!(
        received.len() == len && received[0] == b'*',
        "{}: {} axes, {len} bytes: {text}",
        header as char,
        shape.axes
    );
}

fn any_block(client: &mut Client, data: &[u8]) {
    client.figure.blocks += 1;
    let header =
        if client.rng.random_ratio(1, 30) { client.rng.random() } else { *one(&mut client.rng, b"CCCCcAa") };
    client.send(&[header], 1_000);
    let cut =
        if client.rng.random_ratio(1, 20) { client.rng.random_range(0..=data.len()) } else { data.len() };
    client.send(&data[..cut], 1_000);
    match client.rng.random_range(0..60) {
        0 => client.wait(700),
        1 => client.wait_unread(700),
        2 => client.send(&[3], 1_000),
        3 => {
            client.hand.hang_up();
            client.figure.hang_ups += 1;
        }
        4..30 => _ = client.step(),
        _ => {}
    }
}
