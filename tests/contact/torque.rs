//! MT bounds the torque of a rotor that something holds, but for the milliseconds that the winding and the control take.

use tater_wire::{MotorKind, Property};

use super::{Bench, KINDS, LOOK_US, UNITS, object};
use hil_world::hand::person::N_PER_MM;
use hil_world::plant::PlantParams;
use hil_world::rig::Object;

use crate::chart::{self, BLUE, ORANGE, Panel, Points};

/// Counts that the motor has to speed up in.
const RUN_UP: f64 = 80.0;

/// V and MCV beyond what a motor can do, counts/s.
const FULL: i64 = 4080;

/// How long is looked after the contact, ms.
const AFTER_MS: f64 = 150.0;

/// A motor that closes in mode 4, into its stop or, in the middle of its range, into something that gives way.
#[derive(Clone, Debug)]
struct Approach {
    kind: MotorKind,
    plant: PlantParams,
    mt: i64,
    speed: i64,
    mke: i64,
    /// Stiffness of what it meets, N/mm; its stop if there is none.
    n_per_mm: Option<f64>,
}

impl Approach {
    fn new(kind: MotorKind, mt: i64, speed: i64) -> Self {
        let mke = Property::MKE.row().default_for_motor(kind).expect("a default");
        Self { kind, plant: PlantParams::for_motor(kind), mt, speed, mke: mke.into(), n_per_mm: None }
    }

    /// The torque of MT by this motor's own Ke, and by its resistance where that lets more than the nominal current flow, N·m. Of a motor with more
    /// resistance the board knows no better than the current that MT means.
    fn own_n_m(&self) -> f64 {
        let nominal = PlantParams::for_motor(self.kind);
        let current = (nominal.r_ohm / self.plant.r_ohm).max(1.0);
        self.mt as f64 / UNITS * (self.plant.ke_v_s / nominal.ke_v_s) * current
    }

    /// Where it meets what it meets, counts, and the object there, if any.
    fn obstacle(&self) -> (f64, Option<Object>) {
        let Some(n_per_mm) = self.n_per_mm else { return (self.plant.max_count + 0.5, None) };
        let from_count = f64::midpoint(self.plant.min_count, self.plant.max_count);
        (from_count, Some(object(self.kind, from_count, n_per_mm)))
    }

    /// Begins it. Returns as well where it meets what it meets, counts.
    fn begin(&self) -> (Bench, f64) {
        let (stop, object) = self.obstacle();
        let mut bench = Bench::new(self.kind, &self.plant, stop - RUN_UP, object.as_slice());
        for (property, value) in [
            (Property::MT, self.mt),
            (Property::MKE, self.mke),
            (Property::HOLD, 0),
            (Property::MCV, FULL),
            (Property::MODE, 4),
            (Property::V, self.speed),
        ] {
            bench.set(property, value);
        }
        (bench, stop)
    }
}

/// What a stop or an object felt.
#[derive(Clone, Debug, Default)]
struct Impact {
    /// Time in the stop with more than 1.25 of the torque of MT, ms, and what more than 1.1 of it was beyond MT, mN·m·s.
    over_ms: f64,
    over_m_n_m_s: f64,
    /// Phase current, A.
    peak_a: f64,
    /// Torque units by the time from the contact on, ms.
    torque: Points,
}

fn impact(approach: &Approach) -> Impact {
    let (mut bench, stop) = approach.begin();
    let own = approach.own_n_m();
    let mut found = Impact::default();
    bench.watch(approach, stop, [5_000.0, AFTER_MS], |truth, since_ms| {
        let Some(since_ms) = since_ms else { return };
        let in_stop = truth.counts > stop;
        if in_stop && truth.torque_n_m > 1.25 * own {
            found.over_ms += LOOK_US as f64 * 1e-3;
        }
        if in_stop && truth.torque_n_m > 1.1 * own {
            found.over_m_n_m_s += (truth.torque_n_m - own) * LOOK_US as f64 * 1e-3;
        }
        found.peak_a = found.peak_a.max(truth.peak_phase_a);
        found.torque.push((since_ms, truth.torque_n_m * UNITS));
    });
    found
}

/// Motors that are not the nominal one: what multiplies Ke, R and the rotor's inertia.
const MOTORS: [(f64, f64, f64); 9] = [
    (1.0, 1.0, 1.0),
    (0.7, 1.0, 1.0),
    (1.3, 1.0, 1.0),
    (1.0, 0.7, 1.0),
    (1.0, 1.3, 1.0),
    (0.7, 0.7, 1.0),
    (1.3, 1.3, 1.0),
    (1.0, 1.0, 0.7),
    (1.0, 1.0, 1.3),
];

/// Motors and properties with which the compensated EMF is right, and wrong by as much as it can be.
fn motors(kind: MotorKind) -> [(&'static str, f64, i64); 5] {
    let mke = Property::MKE.row().default_for_motor(kind).expect("a default").into();
    [
        ("nominal", 1.0, mke),
        ("Ke −30 %", 0.7, mke),
        ("Ke +30 %", 1.3, mke),
        // 40 and 126 % of the motor's: what docs/safety.md promises for.
        ("MKE least", 1.0, 1600),
        ("MKE most", 1.0, 5000),
    ]
}

/// The bounds of docs/safety.md: time above 1.25 MT in the stop, ms, and torque beyond MT, mN·m·s. A spread is thrown back by its stop while the
/// motor still pushes, and a winding that moves backwards draws more.
fn bounds(kind: MotorKind) -> (f64, f64) {
    if kind == MotorKind::Spread { (8.5, 1.8) } else { (4.5, 1.0) }
}

#[test]
fn mt_bounds_the_torque_at_a_stop_from_any_speed_and_with_any_ke() {
    for kind in KINDS {
        let (mut longest, mut most) = (0.0_f64, 0.0_f64);
        for (name, ke, mke) in motors(kind) {
            for mt in [100, 200, 400, 750] {
                for speed in [50, 100, 200, 400, 700, 1000] {
                    let mut approach = Approach { mke, ..Approach::new(kind, mt, speed) };
                    approach.plant.ke_v_s *= ke;
                    let found = impact(&approach);
                    let (ms, m_n_m_s) = bounds(kind);
                    assert!(
                        found.over_ms <= ms && found.over_m_n_m_s <= m_n_m_s,
                        "{kind:?}, {name}, MT {mt}, V {speed}: above MT for {:.1} ms, {:.2} mN·m·s, {:.1} A",
                        found.over_ms,
                        found.over_m_n_m_s,
                        found.peak_a
                    );
                    longest = longest.max(found.over_ms);
                    most = most.max(found.over_m_n_m_s);
                }
            }
        }
        let (ms, m_n_m_s) = worst(kind, &[None], bounds(kind));
        (longest, most) = (longest.max(ms), most.max(m_n_m_s));
        println!(
            "figure: {kind:?} in its stop: above 1.25 MT for {longest:.1} ms, {most:.2} mN·m·s beyond MT"
        );
    }
}

/// The bounds of docs/safety.md for what gives way by a millimeter for up to 30 N, as a person's finger: it slows a rotor down for longer than the halls show, and
/// throws a spread back.
fn soft_bounds(kind: MotorKind) -> (f64, f64) {
    if kind == MotorKind::Spread { (45.0, 5.5) } else { (31.0, 2.0) }
}

/// The longest time above 1.25 MT, ms, and the most beyond MT, mN·m·s, of every motor at every speed and MT; none may pass its bounds.
fn worst(kind: MotorKind, met: &[Option<f64>], (ms, m_n_m_s): (f64, f64)) -> (f64, f64) {
    let (mut longest, mut most) = (0.0_f64, 0.0_f64);
    for (ke, r, j) in MOTORS {
        for &n_per_mm in met {
            for mt in [100, 150, 200, 400, 750] {
                for speed in [50, 100, 200, 400, 700, 1000, FULL] {
                    let mut approach = Approach { n_per_mm, ..Approach::new(kind, mt, speed) };
                    approach.plant.ke_v_s *= ke;
                    approach.plant.r_ohm *= r;
                    approach.plant.j_kg_m2 *= j;
                    let found = impact(&approach);
                    assert!(
                        found.over_ms <= ms && found.over_m_n_m_s <= m_n_m_s,
                        "{kind:?}, Ke {ke}, R {r}, J {j}, {n_per_mm:?} N/mm, MT {mt}, V {speed}: above MT for {:.1} ms, {:.2} mN·m·s",
                        found.over_ms,
                        found.over_m_n_m_s
                    );
                    longest = longest.max(found.over_ms);
                    most = most.max(found.over_m_n_m_s);
                }
            }
        }
    }
    (longest, most)
}

/// The time of docs/safety.md within which the supply current shows an EMF that is too high, ms, and the share of MT from which on a torque is against T.
const AGAINST_MS: f64 = 3.0;
const AGAINST: f64 = 0.25;

/// How long a rotor is looked at that its stop throws back, ms.
const THROWN_MS: f64 = 1_000.0;

/// A motor that cannot reach V is to be driven towards it all the time: a stop throws its rotor back, whose EMF is little known. An estimate that is too
/// high would drive it on, back across the whole range (with Ke 20 % low, by 1,130 counts/s).
#[test]
fn rotor_that_is_thrown_back_is_not_driven_against_t() {
    let mut longest = 0.0_f64;
    for kind in KINDS {
        for ke in [0.7, 0.8, 0.9, 1.0, 1.3] {
            for mt in [100, 150, 200, 300] {
                for n_per_mm in [None, Some(N_PER_MM), Some(3.0)] {
                    let mut approach = Approach { n_per_mm, ..Approach::new(kind, mt, FULL) };
                    approach.plant.ke_v_s *= ke;
                    let ms = driven_against(&approach);
                    assert!(ms <= AGAINST_MS, "{approach:?}: its torque is against V for {ms:.1} ms");
                    longest = longest.max(ms);
                }
            }
        }
    }
    println!("figure: thrown back, a motor's torque is against T for {longest:.1} ms");
}

/// The longest time for which the torque is against V after the contact, ms.
fn driven_against(approach: &Approach) -> f64 {
    let (mut bench, stop) = approach.begin();
    let least = -AGAINST * approach.own_n_m();
    let (mut longest, mut for_ms) = (0.0_f64, 0.0);
    bench.watch(approach, stop, [5_000.0, THROWN_MS], |truth, _| {
        for_ms = if truth.torque_n_m < least { for_ms + LOOK_US as f64 * 1e-3 } else { 0.0 };
        longest = longest.max(for_ms);
    });
    longest
}

#[test]
fn mt_bounds_the_torque_on_what_gives_way() {
    for kind in KINDS {
        let (longest, most) = worst(kind, &[Some(2.0), Some(10.0), Some(N_PER_MM)], soft_bounds(kind));
        println!(
            "figure: {kind:?} on what gives way: above 1.25 MT for {longest:.1} ms, {most:.2} mN·m·s beyond MT"
        );
    }
}

/// The first 40 ms of a link at MT 100 that meets its stop at full speed, and of one without the guard by the supply current, as it was before.
#[test]
fn picture_of_the_torque_at_contact_is_current() {
    let before: Points = include_str!("before.csv")
        .lines()
        .skip(1)
        .map(|line| {
            let (ms, torque) = line.split_once(',').expect("two columns");
            (ms.parse().expect("a number"), torque.parse().expect("a number"))
        })
        .collect();
    let panels: Vec<Panel> = motors(MotorKind::Link)
        .iter()
        .map(|&(name, ke, mke)| {
            let mut approach = Approach { mke, ..Approach::new(MotorKind::Link, 100, 1000) };
            approach.plant.ke_v_s *= ke;
            let torque = impact(&approach).torque.into_iter().filter(|&(ms, _)| ms <= 40.0).collect();
            let mut lines = vec![(BLUE, torque)];
            let mut title = format!("Link, MT 100, into its stop, {name}: torque over ms");
            if name == "nominal" {
                lines.insert(0, (ORANGE, before.clone()));
                title += "; orange: without the guard by the supply current";
            }
            Panel { title, x: (0.0, 40.0, 5.0), y: (0.0, 1000.0, 200.0), band: None, lines }
        })
        .collect();
    chart::keep("contact.svg", "MAKE_CONTACT_PICTURE", "contact::torque", &panels);
}
