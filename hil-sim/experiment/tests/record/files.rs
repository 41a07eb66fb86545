//! What is said about a file, an option or a property that is wrong, in full.

use crate::Record;
use hil_experiment::scenario::{FIGURES, Scenario};
use hil_experiment::{grasp, properties};
use hil_world::hand::scene::Pose;
use tater_fw::motion;
use tater_wire::MotorKind;
use traces::input::BadInput;

/// A line with the whole message.
fn said<T: std::fmt::Debug>(record: &mut Record, of: &str, result: Result<T, BadInput>) {
    match result {
        Ok(good) => record.note(format!("{of:?}: good"), &good),
        Err(bad) => record.note(format!("{of:?}: {:?}", bad.to_string()), &bad),
    }
}

const GRASPS: [&str; 21] = [
    "",
    "[hand]\nspread_axis_mm = 26\nbase_mm = 51\nlink_mm = 71\ntip_mm = 49\npalm_mm = 77\npad_mm = 9\nlink_at_zero_deg = 1\ntip_at_zero_deg = 44\nfinger_radius_mm = 7",
    "[hand]\nspread_axis_mm = -1",
    "[hand]\nbase_mm = 1001",
    "[hand]\nlink_mm = 0.5",
    "[hand]\ntip_mm = 0.9",
    "[hand]\npalm_mm = -0.1",
    "[hand]\npad_mm = 0",
    "[hand]\nlink_at_zero_deg = 181",
    "[hand]\ntip_at_zero_deg = -181",
    "[hand]\nfinger_radius_mm = 101",
    "[hand]\nthumb_mm = 3",
    "[[object]]\nat_mm = [0, 0, 120]\nradius_mm = 20",
    "[[object]]\nat_mm = [0, 0, 120]\nto_mm = [10, 5, 130]\nradius_mm = 12\nstiffness_n_m = 3e4",
    "[[object]]\nat_mm = [0, 0, 120]\nto_mm = [2000, 5, 130]\nradius_mm = 12",
    "[[object]]\nat_mm = [0, 0, -1200]\nradius_mm = 12",
    "[[object]]\nat_mm = [0, 0, 120]\nradius_mm = 1200",
    "[[object]]\nat_mm = [0, 0, 120]\nradius_mm = 12\nstiffness_n_m = 0.1",
    "[[object]]\nat_mm = [0, 80, 79]\nradius_mm = 20",
    "[[object]]\nat_mm = [0, \"a\", 79]\nradius_mm = 20",
    "object = 3",
];

fn grasps() -> Record {
    let mut record = Record::new("grasps");
    for text in GRASPS {
        said(&mut record, text, grasp::parse("x.toml", text, &Pose::default()));
    }
    let many = "[[object]]\nat_mm = [0, 0, 120]\nradius_mm = 1\n".repeat(17);
    said(&mut record, "17 objects", grasp::parse("x.toml", &many, &Pose::default()));
    let ball = "[[object]]\nat_mm = [0, 0, 102]\nradius_mm = 34";
    for count in (0..=320).step_by(20).map(f64::from) {
        let pose = [count, count, count, 0.0, 0.0, 0.0, 0.0];
        said(&mut record, &format!("a ball at {count}"), grasp::parse("x.toml", ball, &pose));
    }
    said(&mut record, "a folder", grasp::read(std::path::Path::new("."), &Pose::default()));
    record
}

fn figures() -> Record {
    let mut record = Record::new("figures");
    for figure in FIGURES {
        let nominal = [MotorKind::Link, MotorKind::Spread, MotorKind::Tip].map(|kind| figure.nominal(kind));
        record.note(format!("--{} {}, or {}: {nominal:?}", figure.option, figure.name, figure.word), &());
        for value in ["1.01x", "-1e3", "1e7", "much"] {
            let mut scenario = Scenario::find("homing").expect("shipped");
            let assignment = format!("{}={value}", figure.word);
            let done = scenario.override_figures(&[(figure.option, &assignment)]);
            said(&mut record, &assignment, done.map(|()| scenario));
        }
    }
    let mut scattered = Scenario::find("homing").expect("shipped");
    scattered.scatter = 0.1;
    said(&mut record, "a scattered supply", scattered.override_figures(&[("supply", "volts=23")]));
    record
}

fn values() -> Record {
    let mut record = Record::new("properties");
    record.note(properties::names(), &());
    for property in &properties::PROPERTIES {
        let (low, high) = property.range();
        let mut config = motion::defaults(MotorKind::Spread);
        let mut set = |value: i64| {
            let done = property
                .set(&mut config, value)
                .map_err(|error| (error.to_string(), error.found(), error.expected()));
            (done, property.get(&config))
        };
        let tried = [set(low), set(high), set(low - 1), set(high + 1), set((low + high) / 2)];
        record.note(format!("{} {} {low} to {high}: {tried:?}", property.name, property.unit()), &config);
    }
    for (name, value) in [("kp", 5), ("KQ", 5), ("", 5), ("MT", -5)] {
        let mut config = motion::defaults(MotorKind::Tip);
        let done = properties::set(&mut config, name, value).map_err(|error| error.to_string());
        record.note(format!("{name} = {value}: {done:?}"), &config);
    }
    record
}

pub fn scenes() -> Vec<Record> {
    vec![grasps(), figures(), values()]
}
