//! Hosts of a simulated hand or of boards on a bus: a typist, and a scenario over CAN alone.

use std::cell::RefCell;
use std::rc::Rc;

use crate::Record;
use god::Memory;
use hil_experiment::over_can::{Job, OverCan, judge, parked};
use hil_experiment::run::{Options, rig};
use hil_experiment::scenario::Scenario;
use hil_experiment::typist::Typist;
use hil_experiment::{events, grasp, packets, picture};
use hil_world::board::SimBoard;
use hil_world::hand::Hand;
use hil_world::hand::scene::Pose;
use hil_world::node::Node;
use hil_world::plant::Model;
use tater_f103::map::APPLICATION;
use tater_wire::tek::{Encoder, end};

fn typed() -> Record {
    let mut record = Record::new("a typist");
    let mut hand = Hand::new(Model::Averaged, 7, Memory::default());
    let text = include_str!("../../../grasps/ball.toml");
    hand.set_scene(grasp::parse("ball.toml", text, &Pose::default()).expect("shipped"));
    let (mut typist, banner) = Typist::new(hand).expect("a prompt");
    record.note(format!("{banner:?}"), &());
    for line in
        ["HI", "wait 50", "GM 40", "1FGET P,MODE", "", "FROB", "GC", "PGET TEMP", "0 S LFLAGS 3", "4 S M 100"]
    {
        let reply = typist.run_line(line).expect("a prompt");
        record.note(format!("{line}: {:?}, ERR {}, {} ms", reply.answer, reply.status, reply.ms), &reply);
    }
    typist.advance(typist.hand().now_us() + 1_500_000);
    record.note(format!("unasked: {:?}", typist.unsolicited()), &typist.take_output());
    let mut calls = 0;
    let cut = typist.run_line_within("SO", 40_000, &mut || true).expect_err("too short");
    record.note(format!("{cut}"), &cut);
    typist.abort();
    let ended = typist.run_line_within("SC", 10_000_000, &mut || {
        calls += 1;
        calls < 100
    });
    record.note(format!("after {calls} asked: {ended:?}"), &ended);
    typist.abort();
    typist.type_bytes(b"2IO\r");
    let waits = (typist.wait_for_line(5_000, &mut || true), typist.wait_for_line(3_000_000, &mut || true));
    record.note(format!("waits {waits:?}, {:?}", String::from_utf8_lossy(&typist.take_output())), &());
    for line in ["0 S REPLY 1", "4 G P", "4 G MODE", "0 S REPLY 0"] {
        let reply = typist.run_line(line).expect("a prompt");
        record.note(format!("{line}: {:?}", reply.answer), &reply);
    }
    let log = events::of_hand(typist.hand());
    record.note(
        format!("{} events, {} lines", log.len(), events::text(&log).lines().count()),
        &(&log, events::text(&log)),
    );
    let scene = typist.hand().scene().expect("a ball").clone();
    let pose = typist.hand().pose();
    record.note("its picture", &picture::svg(&scene, &Pose::default(), &pose, "A <ball> & a hand"));
    record
}

fn packed() -> Record {
    let mut record = Record::new("packets");
    let packet = [0x04, 0x86, 0x04, 0x88, 0x00, 0x03, 0x00];
    for length in 0..=packet.len() {
        let part = &packet[..length];
        let begins = part.first().map(|byte| packets::is_head(*byte));
        record.note(
            format!(
                "{begins:?} {:?} {} {:?}",
                packets::len(part),
                packets::text(part),
                packets::meaning(part)
            ),
            &(),
        );
    }
    record
}

fn over_can() -> Record {
    let mut record = Record::new("over CAN");
    let options = Options { seed: 2, model: Model::Averaged, trace: false };
    for (name, poll_ms) in [("homing", 1), ("stall-on-object", 1), ("hall-glitch", 3), ("link-fast", 0)] {
        let scenario = Scenario::find(name).expect("shipped");
        let (mut stations, mut jobs) = (Vec::new(), Vec::new());
        for case in &scenario.cases {
            let node = tater_wire::Node::new(case.motor.first_node()).expect("a node");
            let at_first = parked(&scenario, case, &options).expect("in range");
            stations.push((node, Node::new(SimBoard::new(at_first, node))));
            let rig = rig(&scenario, case, &options).expect("in range");
            jobs.push(Job { node, case: case.clone(), rig, judged: true, windows: scenario.windows() });
        }
        let mut host = OverCan::new(stations);
        host.phase_us = 130;
        let told = Rc::new(RefCell::new(Vec::new()));
        let heard = Rc::clone(&told);
        host.observe(Box::new(move |bus, progress| {
            heard.borrow_mut().push((bus.now_us(), format!("{progress:?}")))
        }));
        let up = host.power_on().and_then(|()| host.wake()).and_then(|()| host.turn_once());
        let ran = up
            .and_then(|()| host.run(&scenario, jobs, poll_ms))
            .unwrap_or_else(|trouble| panic!("{name}: {trouble}"));
        let (outcome, gaps) = judge(&scenario, &ran, &options, poll_ms);
        let apart = ran[0].path.difference(&ran.last().expect("a board").path);
        let end = outcome.metrics.end_ms;
        let shown = format!(
            "{name}: end {end:?} ms, {} of {} met",
            outcome.expectations.iter().filter(|v| v.ok).count(),
            outcome.expectations.len()
        );
        record.note(shown, &(&outcome, &ran, gaps, apart, host.bus().stats()));
        record.note(format!("    {} times told of its progress", told.borrow().len()), &told.borrow());
    }
    record
}

/// A download over CAN of an image that a board takes, and of what it does not.
fn downloaded() -> Record {
    let mut record = Record::new("downloads");
    let node = tater_wire::Node::new(3).expect("a node");
    let board = SimBoard::standard(node, Model::Averaged, 1);
    let mut host = OverCan::new(vec![(node, Node::new(board))]);
    host.power_on().expect("it boots");
    let image = hil_world::node::placeholder_application();
    let records = records(&image);
    for tek in [&records[..], &records[..40], b"no record", &[]] {
        record.note(format!("{} bytes: {:?}", tek.len(), host.download(node, tek)), &host.bus().stats());
    }
    let woken = host.wake();
    record.note(format!("woken: {woken:?}"), &host.bus().now_us());
    record
}

fn records(image: &[u8]) -> Vec<u8> {
    let lines = Encoder::new(APPLICATION.start, image).into_iter().flatten().chain([end(APPLICATION.start)]);
    lines.flat_map(|line| line.as_bytes().to_vec()).collect()
}

pub fn scenes() -> Vec<Record> {
    vec![typed(), packed(), over_can(), downloaded()]
}
