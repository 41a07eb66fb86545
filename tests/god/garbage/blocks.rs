//! Sessions of RealTime: some by the manual, whose every answer is measured; the others with anything.

use rand::RngExt;

use super::client::Client;
use super::lines::one;

/// Prefixes and how many axes they have.
const AXES: [(&str, usize); 8] =
    [("", 4), ("G", 3), ("S", 1), ("12", 2), ("X1234567", 7), ("XGS", 7), ("X5", 1), ("X35", 2)];

/// How long a block's answer may take, ms: a clumsy client's patience (PROTOCOL 3).
const BLOCK_MS: usize = 100;

/// What the parameters say of the blocks.
struct Shape {
    axes: usize,
    /// Data bytes of a control block.
    control: usize,
    /// All of a feedback block.
    feedback: usize,
}

/// LOOP with any flags, some blocks, and ^C.
pub fn session(client: &mut Client) {
    let (prefix, axes) = *one(&mut client.rng, &AXES);
    let shape = flags(client, axes);
    let polite = client.rng.random_ratio(2, 3);
    client.says(format!("{prefix}LOOP").as_bytes(), 1);
    client.ms();
    client.says(b"\r", 1);
    if polite {
        begins(client);
    }
    let mut block = Vec::new();
    for _ in 0..client.rng.random_range(0..100) {
        if block.is_empty() || client.rng.random_ratio(1, 4) {
            block = (0..shape.control).map(|_| client.rng.random()).collect();
        }
        if polite {
            by_the_manual(client, &shape, &block);
        } else {
            anyhow(client, &block);
        }
    }
    client.aborts();
}

/// Sets all that shapes a block.
fn flags(client: &mut Client, axes: usize) -> Shape {
    let mut flag = |most: usize| client.rng.random_range(0..=most);
    let [lcv, lcpg, lfv, lfs, lfdp, lft, lfdpd] = [(); 7].map(|()| flag(1));
    let (lfap, lcvc, lfvc, lfdpc) = (flag(2), 1 + flag(254), 1 + flag(254), 1 + flag(254));
    for line in [
        format!("X1234567FSET LCV {lcv} LCVC {lcvc} LCPG {lcpg}"),
        format!("X1234567FSET LFV {lfv} LFVC {lfvc} LFS {lfs} LFAP {lfap} LFDP {lfdp} LFDPC {lfdpc}"),
        format!("PSET LFT {lft} LFDPD {lfdpd}"),
    ] {
        client.line(&line);
    }
    let each = lfv + lfs + [0, 4, 2][lfap] + lfdp;
    Shape { axes, control: axes * (lcv + lcpg), feedback: 1 + axes * each + 2 * lft }
}

/// The first `*`, or why not: a hand that is hot, or whose motors have faults that come back.
fn begins(client: &mut Client) {
    let said = client.reads(1, 2_000);
    assert_eq!(said, b"*", "{:?}", said.escape_ascii().to_string());
}

/// A block, and its answer.
fn by_the_manual(client: &mut Client, shape: &Shape, data: &[u8]) {
    let header = *one(&mut client.rng, b"CCCCCcAa");
    client.hand.push_rx(&[header]);
    if matches!(header, b'C' | b'c') {
        client.hand.push_rx(data);
        client.figure.bytes += data.len() as u64;
    }
    client.figure.bytes += 1;
    client.figure.blocks += 1;
    let most = if matches!(header, b'C' | b'A') { shape.feedback } else { 1 };
    let said = client.reads(most, BLOCK_MS);
    let text = said.escape_ascii().to_string();
    assert!(
        said.len() == most && said[0] == b'*',
        "{}: {} axes, {most} bytes: {text}",
        header as char,
        shape.axes
    );
}

/// Anything like a block, or not.
fn anyhow(client: &mut Client, data: &[u8]) {
    client.figure.blocks += 1;
    let header =
        if client.rng.random_ratio(1, 30) { client.rng.random() } else { *one(&mut client.rng, b"CCCCcAa") };
    client.says(&[header], 1_000);
    // Sometimes too few, or too many.
    let cut =
        if client.rng.random_ratio(1, 20) { client.rng.random_range(0..=data.len()) } else { data.len() };
    client.says(&data[..cut], 1_000);
    match client.rng.random_range(0..60) {
        0 => client.waits(700),
        1 => client.is_deaf(700),
        2 => client.says(&[3], 1_000),
        3 => {
            client.hand.hang_up();
            client.figure.hang_ups += 1;
        }
        4..30 => _ = client.ms(),
        _ => {}
    }
}
