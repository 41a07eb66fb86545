//! The table of docs/force.md: what fingers do to an object that they meet.

use std::fmt::Write as _;
use std::path::PathBuf;

use tater_wire::{Cmd, MotorKind, Property};

use super::{Bench, KINDS, LOOK_US, object};
use hil_world::hand::person::{N_PER_MM, lever_m};
use hil_world::plant::PlantParams;

/// Stiffness of what is met, N/mm: a tool of steel behind a finger's cover, a person's finger, a rubber ball.
const OBJECTS: [(&str, f64); 3] = [("stiff", 300.0), ("person's finger", N_PER_MM), ("soft", 3.0)];

/// MT of the table, and MV and MCV, counts/s: a slow approach, and the highest value, which no motor reaches.
const TORQUES: [i64; 3] = [100, 400, 750];
const SPEEDS: [i64; 2] = [200, 4080];

/// Where the object stands in the joint's range.
const PLACE: f64 = 0.6;

/// What an object felt.
struct Squeeze {
    /// Greatest force, N.
    peak_n: f64,
    /// Impulse until the force has come within 10 % of what stays, N·s, and that time, ms.
    impulse_n_s: f64,
    settled_ms: f64,
    /// Force that stays after the end of the motion, N.
    stays_n: f64,
}

fn squeeze(plant: PlantParams, kind: MotorKind, n_per_mm: f64, mt: i64, speed: i64) -> Squeeze {
    let (lever_m, gear) = (lever_m(kind), plant.gear_ratio);
    let from_count = plant.min_count + PLACE * (plant.max_count - plant.min_count);
    let object = object(kind, from_count, n_per_mm);
    let mut bench = Bench::new(kind, &plant, plant.min_count, &[object]);
    for (property, value) in [
        (Property::MT, mt),
        (Property::MV, speed),
        (Property::MCV, speed),
        (Property::HOLD, 0),
        (Property::CMD, Cmd::Tc.into()),
    ] {
        bench.set(property, value);
    }
    // Of the contact: (ms, N), until a second after it.
    let mut felt: Vec<(f64, f64)> = Vec::new();
    while felt.first().is_none_or(|(at, _)| bench.ms() < at + 1_000.0) {
        assert!(bench.ms() < 20_000.0, "{kind:?} at MT {mt} never meets its object");
        let truth = bench.look();
        let newton = (-truth.load_n_m * gear / lever_m).max(0.0);
        if newton > 0.0 || !felt.is_empty() {
            felt.push((bench.ms(), newton));
        }
    }
    let (began_ms, stays_n) = (felt[0].0, felt[felt.len() - 1].1);
    let peak_n = felt.iter().fold(0.0_f64, |most, (_, newton)| most.max(*newton));
    let last = felt.iter().rposition(|(_, newton)| (newton - stays_n).abs() > 0.1 * peak_n).unwrap_or(0);
    let impulse_n_s = felt[..=last].iter().map(|(_, newton)| newton * LOOK_US as f64 * 1e-6).sum();
    Squeeze { peak_n, impulse_n_s, settled_ms: felt[last].0 - began_ms, stays_n }
}

/// The bounds of docs/safety.md, N: of a joint that comes with MCV's default at most, and of one without a limit of its speed.
const MOST_N: [(i64, f64); 2] = [(1000, 420.0), (4080, 450.0)];

/// Motors that are 30 % off in the ways that bring the most energy: little EMF, which is speed, a heavy rotor, and little resistance, which is torque, or
/// much EMF, which is torque as well, and little friction.
#[test]
fn a_person_feels_no_more_than_the_documents_say_of_motors_that_are_off() {
    for (speed, most_n) in MOST_N {
        let mut worst = 0.0_f64;
        for kind in KINDS {
            for (ke, r) in [(0.7, 0.7), (0.7, 1.3), (1.0, 0.7), (1.3, 0.7)] {
                for mt in [200, 990] {
                    let mut plant = PlantParams::for_motor(kind);
                    plant.ke_v_s *= ke;
                    plant.r_ohm *= r;
                    plant.j_kg_m2 *= 1.3;
                    plant.coulomb_n_m *= 0.7;
                    plant.static_n_m *= 0.7;
                    plant.bus_v = 28.0;
                    let peak_n = squeeze(plant, kind, N_PER_MM, mt, speed).peak_n;
                    assert!(
                        peak_n <= most_n,
                        "{kind:?}, Ke {ke}, R {r}, MT {mt}, MCV {speed}: {peak_n:.0} N"
                    );
                    worst = worst.max(peak_n);
                }
            }
        }
        println!("figure: MCV {speed}: a person's finger feels {worst:.0} N");
        // Tight: a looser bound would be a promise that nothing measures.
        assert!(worst > 0.9 * most_n, "{worst:.0} N of {most_n}");
    }
}

fn table() -> String {
    let mut text = String::new();
    text.push_str("| joint | object | MT | MV, MCV, counts/s | peak, N | impulse, N·s | within 10 % after, ms | stays, N |\n");
    text.push_str("|---|---|---|---|---|---|---|---|\n");
    for kind in KINDS {
        for (name, n_per_mm) in OBJECTS {
            for mt in TORQUES {
                for speed in SPEEDS {
                    let found = squeeze(PlantParams::for_motor(kind), kind, n_per_mm, mt, speed);
                    let _ = writeln!(
                        text,
                        "| {kind:?} | {name} | {mt} | {speed} | {:.0} | {:.2} | {:.0} | {:.0} |",
                        found.peak_n, found.impulse_n_s, found.settled_ms, found.stays_n
                    );
                }
            }
        }
    }
    text
}

/// docs/force.md has this table. MAKE_FORCE_TABLE=1 rewrites it.
#[test]
fn table_of_forces_is_current() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../docs/force.md");
    let page = std::fs::read_to_string(&path).expect("the page");
    let begin = page.find("| joint | object |").expect("the table");
    let end = begin + page[begin..].find("\n\n").expect("its end") + 1;
    let table = table();
    if std::env::var_os("MAKE_FORCE_TABLE").is_some() {
        std::fs::write(&path, format!("{}{table}{}", &page[..begin], &page[end..])).expect("written");
        return;
    }
    assert!(page[begin..end] == table, "docs/force.md: MAKE_FORCE_TABLE=1 cargo test -p system-tests force");
}
