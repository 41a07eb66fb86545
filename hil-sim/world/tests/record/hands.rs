//! A whole hand with a ball and a rod between its fingers, a serial line, a host that interrupts it, and its state on a disk.

use crate::Record;
use god::Memory;
use hil_world::hand::Hand;
use hil_world::hand::scene::{Capsule, Scene, SceneObject};
use hil_world::hand::serial::Serial;
use hil_world::hand::state::State;
use hil_world::plant::Model;

fn scene() -> Scene {
    let ball = Capsule { ends: [[0.002, -0.003, 0.13]; 2], radius_m: 0.03 };
    let rod = Capsule { ends: [[-0.04, 0.06, 0.17], [0.05, 0.07, 0.19]], radius_m: 0.012 };
    let object = |capsule, stiffness_n_m| SceneObject { capsule, stiffness_n_m };
    Scene { objects: vec![object(ball, 1e5), object(rod, 4e4)], ..Scene::default() }
}

/// Advances until `ms` have passed, and notes every 100 ms where the motors are.
fn watch(record: &mut Record, what: &str, line: &mut Serial, hand: &mut Hand, ms: u64) {
    let begin_us = hand.now_us();
    for part in 1..=ms.div_ceil(100) {
        let mut heard = Vec::new();
        line.run_until(hand, begin_us + 100_000 * part, &mut heard, 200);
        let pose = hand.pose();
        let truths: Vec<_> = hand.bus().stations().map(|node| node.board().rig().truth()).collect();
        let scene =
            hand.scene().map(|scene| (scene.overlap(&pose), scene.contacts(&pose), scene.fingers(&pose)));
        let shown = format!(
            "{what} {} ms: {} and {:?}",
            hand.now_us() / 1000,
            pose.map(|count| format!("{count:.1}")).join(" "),
            String::from_utf8_lossy(&heard)
        );
        let line = (line.waiting(), line.is_empty());
        let more = (hand.supply(), hand.io().temperature(), hand.bus().stats(), hand.is_on());
        record.note(shown, &(pose, truths, scene, line, more));
    }
}

fn grasp() -> Record {
    let mut record = Record::new("a grasp");
    let (hand, line) = (&mut Hand::new(Model::Averaged, 11, Memory::default()), &mut Serial::new(true));
    hand.set_scene(scene());
    hand.bus_mut().station_mut(0).expect("motor 1").rig_mut().jam(0.01);
    line.put(b"\rWAKE\rHI\r", hand);
    watch(&mut record, "HI", line, hand, 5_800);
    line.put(b"SM 60\rGC\r", hand);
    watch(&mut record, "spread, then close", line, hand, 2_000);
    line.put(b"SC\r", hand);
    watch(&mut record, "the spread against the grasp", line, hand, 600);
    record.note("changes", &hand.revision());
    hand.set_source(20.0, 1.5);
    line.put(b"GO\r", hand);
    watch(&mut record, "open from a weak source", line, hand, 400);
    line.put(b"\x03", hand);
    hand.take_objects();
    watch(&mut record, "interrupted", line, hand, 200);
    hand.fix_temperature(Some(61.5));
    line.put(b"1FGET P\rFGET TEMP\r", hand);
    watch(&mut record, "hot", line, hand, 300);
    hand.fix_temperature(None);
    line.put(b"TC\r", hand);
    watch(&mut record, "tips", line, hand, 100);
    line.put_break(hand);
    watch(&mut record, "break", line, hand, 100);
    line.hang_up(hand);
    watch(&mut record, "hung up", line, hand, 100);
    let state = hand.state();
    let bytes = state.to_bytes();
    assert_eq!(State::from_bytes(&bytes).as_ref(), Ok(&state), "what was written is read");
    record.note(format!("{} bytes of state", bytes.len()), &bytes);
    hand.set_power(false);
    line.put(b"?\r", hand);
    watch(&mut record, "no power", line, hand, 100);
    hand.set_power(true);
    watch(&mut record, "power", line, hand, 100);
    let mut restored = Hand::restore(Model::Averaged, 12, &state).expect("the places are between the stops");
    let line = &mut Serial::new(false);
    line.put(b"\rFGET MODE\r", &mut restored);
    watch(&mut record, "restored", line, &mut restored, 200);
    record
}

/// A file of a hand's state with one fault each is refused where the fault is.
fn bad_states() -> Record {
    let mut record = Record::new("bad states");
    let bytes = Hand::new(Model::Averaged, 1, Memory::default()).state().to_bytes();
    let mut bad = |what: &str, bytes: &[u8]| {
        let error = State::from_bytes(bytes).expect_err(what);
        record
            .note(format!("{what}: at {}: {}, expected {:?}", error.at, error.found, error.expected), &error);
    };
    bad("nothing", &[]);
    bad("another kind", &[b'x'; 100]);
    bad("cut", &bytes[..bytes.len() - 1]);
    bad("longer", &[&bytes[..], &[0]].concat());
    for at in [30, 34, 300, bytes.len() - 5] {
        let mut flipped = bytes.clone();
        flipped[at] ^= 4;
        bad(&format!("byte {at}"), &flipped);
    }
    // With a right sum, so that the contents are judged.
    let sealed = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = bytes[..bytes.len() - 4].to_vec();
        change(&mut bytes);
        let length = u32::try_from(bytes.len() - 26).expect("short").to_le_bytes();
        bytes[22..26].copy_from_slice(&length);
        let mut crc = flate2::Crc::new();
        crc.update(&bytes);
        [&bytes[..], &crc.sum().to_le_bytes()].concat()
    };
    bad("no number", &sealed(&|bytes| bytes[26..34].copy_from_slice(&f64::NAN.to_le_bytes())));
    bad("many pages", &sealed(&|bytes| bytes[34..36].copy_from_slice(&999u16.to_le_bytes())));
    bad("page 128", &sealed(&|bytes| bytes[36..38].copy_from_slice(&128u16.to_le_bytes())));
    bad("no storage", &sealed(&|bytes| bytes.truncate(bytes.len() - 3)));
    record
}

pub fn scenes() -> Vec<Record> {
    vec![grasp(), bad_states()]
}
