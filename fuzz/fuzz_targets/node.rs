//! Any frames to a board with its plant, in the monitor and awake: no panic, no limit exceeded.
#![no_main]

use hil_world::board::SimBoard;
use hil_world::node::Node;
use hil_world::plant::Model;
use libfuzzer_sys::fuzz_target;
use tater_wire::Frame;

fuzz_target!(|input: (bool, Vec<(u8, u16, Vec<u8>)>)| {
    let (awake, frames) = input;
    let board = SimBoard::standard(tater_wire::Node::new(4).expect("a node"), Model::Averaged, 1);
    let mut node = if awake { Node::awake(board) } else { Node::new(board) };
    for (ms, id, data) in frames.into_iter().take(64) {
        // Most frames go to the board itself, or nothing would receive them.
        let id = if id & 0x8000 == 0 { 4 } else { id & 0x7FF };
        if let Some(frame) = Frame::from_raw(id, &data) {
            let _ = node.receive(&frame);
        }
        for _ in 0..ms % 8 {
            node.step();
        }
        while let Some(answer) = node.mailboxes().first().copied() {
            node.sent(&answer);
        }
        assert_eq!(node.board().sim_flash().erased_while_driven(), 0);
        if let Some(sample) = node.sample() {
            assert!(sample.status.duty.0.to_bits().unsigned_abs() <= 31_680, "97 % of the bus");
        }
    }
});
