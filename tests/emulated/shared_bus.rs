//! What boards share, on the image: the supply, and the bus while the flash stalls them.

use board_emu::board::Board;
use board_emu::chip::uid::Uid;
use board_emu::session::load;
use hil_world::board::SimBoard;
use hil_world::bus::{Adapter, Bus, Station};
use hil_world::node::Node;
use hil_world::plant::{Model, SharedSupply, Supply};
use tater_wire::download::START;
use tater_wire::{Destination, Group, Message, Property};

use super::bench::{NODE, flashed, id, production};
use crate::protocol::hosts::answer;
use crate::supply::{Act, Hand, rig};

#[test]
fn seven_emulated_boards_keep_the_bus_within_20_and_30_v() {
    let Some(programs) = production() else { return };
    let acts = [Act::Stall, Act::Stall, Act::Stall, Act::Stall, Act::Start, Act::Start, Act::Reverse];
    let supply = SharedSupply::new(Supply::new(24.0, 7));
    let board = |(number, act): (u8, Act)| {
        let mut board = Board::new(rig(number, act, None), id(number), &programs, u64::from(number));
        load(&mut board, &programs);
        board.rig_mut().share(&supply);
        board.power_on();
        board
    };
    let mut hand = Hand::new((1..).zip(acts).map(board).collect(), supply.clone());
    hand.bus.run_until(100_000);
    hand.set(Destination::Group(Group::ALL), Property::STAT, 2);
    // The first start erases eight pages.
    hand.bus.run_until(1_500_000);
    hand.awake();
    let (mut low, mut high) = (24.0_f64, 24.0_f64);
    let mut most_a = 0.0_f64;
    hand.act(acts, 990, |_, supply| {
        (low, high) = (low.min(supply.volts()), high.max(supply.volts()));
        most_a = most_a.max(supply.source_a());
    });
    println!("figure: seven emulated boards: {low:.2} to {high:.2} V, {most_a:.1} A");
    assert!(low > 20.0 && high < 30.0, "{low} to {high} V");
    assert!(most_a >= 29.9, "the supply is loaded: {most_a} A");
    for number in 1..=7 {
        hand.bus.send(Message::get(Destination::Node(id(number)), Property::ERROR).frame()).expect("plugged");
        let deadline = hand.bus.now_us() + 10_000;
        let error = std::iter::from_fn(|| hand.bus.wait(deadline))
            .find_map(|s| answer(&s.frame, number, Property::ERROR));
        assert_eq!(error, Some(0), "board {number}");
    }
}

/// Properties whose answers arrive after five GETs during the first page erase of a download.
fn answered<S: Station>(board: S) -> Vec<Property> {
    const ASKED: [Property; 5] = [Property::VERS, Property::ROLE, Property::SN, Property::ID, Property::STAT];
    let mut bus = Bus::new(vec![board]);
    bus.plug_host("test", Adapter::default()).expect("the first host");
    bus.run_until(200_000);
    let to = Destination::Node(id(NODE));
    let start = Message::set(to, Property::VERS, i64::from(START)).expect("fits");
    bus.send(start.frame()).expect("plugged");
    // A page takes 40 ms.
    bus.run_until(220_000);
    while bus.receive().is_some() {}
    for property in ASKED {
        bus.send(Message::get(to, property).frame()).expect("plugged");
    }
    let got = std::iter::from_fn(|| bus.wait(3_000_000));
    let got: Vec<_> = got.map(|stamped| stamped.frame).collect();
    ASKED.into_iter().filter(|&asked| got.iter().any(|frame| answer(frame, NODE, asked).is_some())).collect()
}

#[test]
fn overrun_loses_the_same_frames_on_native_and_emulated_boards() {
    let native = answered(Node::new(SimBoard::standard(id(NODE), Model::Averaged, 1)));
    assert_eq!(native, [Property::VERS, Property::ROLE, Property::STAT], "two and the newest");
    let Some(programs) = production() else { return };
    let mut board = flashed(&programs, NODE);
    board.power_on();
    assert_eq!(answered(board), native);
}

/// Two images with one number: equal answers are one frame, different ones collide until both chips are error passive, and then both arrive.
#[test]
fn two_emulated_boards_with_one_number_answer_with_both_serial_numbers() {
    let Some(programs) = production() else { return };
    let mut boards = vec![flashed(&programs, NODE), flashed(&programs, NODE)];
    boards[1].machine_mut().chip_mut().uid = Uid([0x0043_1234, 0x3042_3132, 0x2039_3751]);
    boards.iter_mut().for_each(Board::power_on);
    let mut bus = Bus::new(boards);
    bus.plug_host("test", Adapter::default()).expect("the first host");
    bus.run_until(200_000);
    let mut answers = |property: Property| -> Vec<i64> {
        bus.send(Message::get(Destination::Node(id(NODE)), property).frame()).expect("plugged");
        let deadline = bus.now_us() + 10_000;
        std::iter::from_fn(|| bus.wait(deadline)).filter_map(|s| answer(&s.frame, NODE, property)).collect()
    };
    assert_eq!(answers(Property::STAT), [0], "equal answers are one");
    let serials = answers(Property::SN);
    assert!(serials.len() == 2 && serials[0] != serials[1], "{serials:?}");
    // For ever: both go on to answer, and those that differ are told apart each time.
    for _ in 0..100 {
        assert_eq!(answers(Property::SN).len(), 2);
    }
    let stats = bus.stats();
    println!("figure: two emulated boards with one number: {} errors in 101 answers of two", stats.errors);
    assert!(stats.conflicts >= 101 && stats.errors >= 16, "{stats:?}");
}
