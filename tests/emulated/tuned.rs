//! From an unknown motor to saved gains: the image with a motor that its properties do not describe is excited over the bus, identified,
//! tuned for, given the result, reset, and moves with it; then it gets its old values back (docs/tuning.md).

use std::path::{Path, PathBuf};
use std::time::Duration;

use board_emu::board::Board as Emulated;
use board_emu::session::load;
use commission::apply::{Board, Change, Present, compare, meet, write};
use commission::excite::{Link, csv, excite};
use hil_sim::cli::execute;
use hil_sim::simulated::Simulated;
use hil_tuning::identify::{Estimate, Identified, Known, Recording, identify};
use hil_tuning::tuned::Tuned;
use hil_world::plant::Model;
use hil_world::plant::{Heat, PlantParams, Start};
use hil_world::rig::{Rig, RigParams};
use tater_wire::MotorKind;
use tater_wire::{Cmd, Destination, EndCode, Message, Property};

use super::bench::{id, production};

/// A link.
const NODE: u8 = 1;

/// What the motor has of a link's inertia and EMF.
const INERTIA: f64 = 1.4;
const EMF: f64 = 0.9;

/// Longest time of HI and of a move, in looks of 10 ms.
const LOOKS: usize = 3000;

fn unknown() -> PlantParams {
    let link = PlantParams::for_motor(MotorKind::Link);
    PlantParams { j_kg_m2: INERTIA * link.j_kg_m2, ke_v_s: EMF * link.ke_v_s, ..link }
}

fn set(bus: &mut Simulated<Emulated>, property: Property, value: i64) {
    let message = Message::set(Destination::Node(id(NODE)), property, value).expect("fits");
    bus.send(&message.frame()).expect("plugged");
}

fn wait(bus: &mut Simulated<Emulated>, ms: u64) {
    let until_us = bus.now_us() + 1000 * ms;
    while bus.receive(until_us).expect("plugged").is_some() {}
}

fn get(bus: &mut Simulated<Emulated>, present: Present, property: Property) -> i64 {
    compare(bus, present, &[(property, 0)]).expect("it answers").changes[0].old
}

/// Waits for the end of a motion.
fn end(bus: &mut Simulated<Emulated>, present: Present) -> i64 {
    for _ in 0..LOOKS {
        wait(bus, 10);
        match get(bus, present, Property::END) {
            0 => {}
            end => return end,
        }
    }
    panic!("the motion has no end")
}

/// Runs hil-sim in this process: the tests of this package have no binary of another.
fn hil_sim(line: &str) {
    let code = execute(std::iter::once("hil-sim").chain(line.split(' ')), &|| Duration::ZERO);
    assert_eq!(code, 0, "hil-sim {line}");
}

fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("emulated-tuned");
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder for the test");
    folder
}

/// Within so many percent: far wider than docs/identify.md, far narrower than what is unknown.
fn near(name: &str, found: Estimate, truth: f64, percent: f64) {
    let error = 100.0 * (found.value / truth - 1.0);
    println!("figure: emulated {name}: {error:+.2} %");
    assert!(error.abs() < percent, "{name}: {} instead of {truth}", found.value);
}

fn identified(csv: &str) -> Identified {
    let recording = Recording::of_csv("trace.csv", csv.to_owned(), None).expect("a recording");
    identify(&recording, &Known::hands())
}

#[test]
fn unknown_motor_gets_gains_of_its_own_and_its_old_ones_back() {
    let Some(programs) = production() else { return };
    let plant = unknown();
    let start = Start { count: 60.0, counts_per_s: 0.0, heat: Heat { winding_c: 25.0, housing_c: 25.0 } };
    let rig =
        Rig::new(plant.clone(), RigParams::default(), &[], Model::Averaged, start, 1).expect("in range");
    let mut board = Emulated::new(rig, id(NODE), &programs, 1);
    load(&mut board, &programs);
    board.power_on();
    let mut bus = Simulated::new(board);
    wait(&mut bus, 100);

    let recorded = excite(&mut bus, id(NODE), &mut |_| {}).unwrap_or_else(|e| panic!("{e:?}"));
    let found = identified(&csv(&recorded));
    near("Ke", found.ke_v_s, plant.ke_v_s, 3.0);
    near("R", found.r_ohm, plant.r_ohm, 5.0);
    near("inertia", found.j_kg_m2, plant.j_kg_m2, 8.0);
    assert!(found.missing.is_empty(), "{:?}", found.missing);

    let folder = folder();
    let (out, file) = (folder.join("out"), folder.join("tuned.json"));
    let model: String =
        found.properties().iter().map(|(name, value)| format!(" --set {name}={value}")).collect();
    hil_sim(&format!(
        "tune --motor link --objective step --robust 3 --candidates 20 --plant r_ohm={} --plant ke_v_s={} --plant j_kg_m2={} \
         --plant coulomb_n_m={}{model} --json --out {}",
        found.r_ohm.value,
        found.ke_v_s.value,
        found.j_kg_m2.value,
        found.coulomb_n_m.value,
        out.display()
    ));
    hil_sim(&format!("export {} --to {}", out.display(), file.display()));
    let text = std::fs::read_to_string(&file).expect("exported");
    let values = Tuned::parse("tuned.json", &text).expect("valid").motors[0].values();
    let of = |property| values.iter().find(|(of, _)| *of == property).map(|(_, value)| *value);
    // 4096 Ke of the table's default, 3971 (docs/properties.md).
    let emf = of(Property::MKE).expect("of the motor model") as f64 / 3971.0;
    assert!((emf - EMF).abs() < 0.05, "the motor model goes with the gains: {emf}");

    let present = meet(&mut bus, id(NODE), &mut |_| {}).expect("it rests");
    let board = compare(&mut bus, present, &values).expect("it answers");
    write(&mut bus, std::slice::from_ref(&board), &mut |_| {}).expect("the image takes them");
    // A reset: what counts now is the flash.
    set(&mut bus, Property::STAT, 0);
    wait(&mut bus, 200);
    let mut told = Vec::new();
    let present = meet(&mut bus, id(NODE), &mut |step| told.push(step.to_owned())).expect("woken");
    assert_eq!(told.len(), 1, "it was reset");
    let after = compare(&mut bus, present, &values).expect("it answers");
    assert!(after.changes.iter().all(|change| change.old == change.new), "{after:?}");

    set(&mut bus, Property::CMD, Cmd::Hi.number().into());
    assert_eq!(end(&mut bus, present), i64::from(EndCode::Arrived), "HI");
    set(&mut bus, Property::M, 100);
    assert_eq!(end(&mut bus, present), i64::from(EndCode::Arrived), "M 100");
    wait(&mut bus, 300);
    let position = get(&mut bus, present, Property::P);
    // MPE is 4.
    assert!((position - 100).abs() <= 4, "P {position}");
    set(&mut bus, Property::MODE, 0);
    wait(&mut bus, 200);

    let back = |change: &Change| Change { old: change.new, new: change.old, ..*change };
    let undo = Board { changes: board.changes.iter().map(back).collect(), ..board.clone() };
    write(&mut bus, &[undo], &mut |_| {}).expect("the image takes them");
    let again = compare(&mut bus, present, &values).expect("it answers");
    assert_eq!(again, board, "exactly the old values");
    std::fs::remove_dir_all(&folder).expect("ours");
}
