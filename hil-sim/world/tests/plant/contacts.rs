//! Contacts are passive: a joint that nothing drives never gains energy from a stop or an object.

use hil_world::board::SimBoard;
use hil_world::hand::Hand;
use hil_world::hand::scene::{Capsule, Pose, Scene, SceneObject};
use hil_world::node::Node;
use hil_world::plant::{Heat, Model, PlantParams, RAD_PER_COUNT, Start};
use hil_world::rig::{Bridge, Rig, RigParams};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use tater_wire::{MotorKind, Node as Id};

const SPREAD: usize = 3;

fn spread_plant() -> PlantParams {
    // Nothing but the contacts takes energy, and they are felt through the gear.
    PlantParams {
        brake_n_m: 0.0,
        coulomb_n_m: 0.0,
        static_n_m: 0.0,
        cogging_n_m: 0.0,
        viscous_n_m_s: 0.0,
        ..PlantParams::for_motor(MotorKind::Spread)
    }
}

fn rig(number: u8, plant: PlantParams, count: f64, counts_per_s: f64) -> Rig {
    let heat = Heat { winding_c: 25.0, housing_c: 25.0 };
    let start = Start { count, counts_per_s, heat };
    Rig::new(plant, RigParams::default(), &[], Model::Averaged, start, u64::from(number)).expect("valid")
}

/// A post in the way of finger 1 or 2, and the spread's speed.
fn case(seed: u64) -> (Scene, f64) {
    let mut rng = Pcg64Mcg::new(u128::from(seed) << 64 | 7);
    let angle = rng.random_range(1.2..2.4_f64);
    let (reach, side) = (rng.random_range(0.06..0.10), if rng.random_bool(0.5) { 1.0 } else { -1.0 });
    let bottom = Scene::default().hand.palm_m;
    let at = [side * reach * angle.sin(), -reach * angle.cos().abs(), bottom];
    let top = [at[0], at[1], bottom + rng.random_range(0.02..0.12)];
    let capsule = Capsule { ends: [at, top], radius_m: rng.random_range(0.005..0.015) };
    let stiffness_n_m = 10.0_f64.powf(rng.random_range(3.0..6.0));
    (
        Scene { objects: vec![SceneObject { capsule, stiffness_n_m }], ..Scene::default() },
        rng.random_range(200.0..900.0),
    )
}

/// All energy that was ever gained, J.
#[derive(Default)]
struct Gains {
    last_j: f64,
    gained_j: f64,
}

impl Gains {
    fn now(&mut self, rig: &Rig) {
        // Of motion, stops and objects, less that at the start.
        let now = rig.truth().ledger.stored_j;
        self.gained_j += (now - self.last_j).max(0.0);
        self.last_j = now;
    }

    /// As a share of the energy at the start.
    fn share(&self, counts_per_s: f64) -> f64 {
        let omega = counts_per_s * RAD_PER_COUNT;
        self.gained_j / (0.5 * spread_plant().j_kg_m2 * omega * omega)
    }
}

/// What a spread that nothing drives gains, as a share of its energy, and whether the post has thrown it back.
fn swing(scene: &Scene, links: f64, counts_per_s: f64) -> (f64, bool) {
    let node = |number: u8| {
        let id = Id::new(number).expect("a node");
        let kind = MotorKind::of(id);
        let rig = match kind {
            MotorKind::Spread => rig(number, spread_plant(), 1.0, counts_per_s),
            MotorKind::Link => rig(number, PlantParams::for_motor(kind), links, 0.0),
            MotorKind::Tip => rig(number, PlantParams::for_motor(kind), 0.0, 0.0),
        };
        Node::new(SimBoard::new(rig, id))
    };
    let mut hand = Hand::with((1..=7).map(node).collect(), god::Memory::default());
    hand.set_scene(scene.clone());
    let (mut gains, mut back) = (Gains::default(), false);
    for ms in 1..=400 {
        hand.run_until(1_000 * ms);
        let rig = hand.bus().stations().nth(SPREAD).expect("the spread").board().rig();
        gains.now(rig);
        back |= rig.truth().counts_per_s < 0.0 && rig.truth().counts < 150.0;
    }
    (gains.share(counts_per_s), back)
}

/// The same with the springs replaced each millisecond and no regard to their energy.
fn unbounded_swing(scene: &Scene, links: f64, counts_per_s: f64) -> f64 {
    let mut spread = rig(4, spread_plant(), 1.0, counts_per_s);
    let mut gains = Gains::default();
    for ms in 1..=400 {
        let pose: Pose = [links, links, links, spread.truth().counts, 0.0, 0.0, 0.0];
        spread.set_objects(&scene.contacts(&pose)[SPREAD]);
        while spread.now_us() < 1_000 * ms {
            spread.advance(Bridge::Off, false, 1_000 * ms);
        }
        gains.now(&spread);
    }
    gains.share(counts_per_s)
}

#[test]
fn undriven_spread_gains_no_energy_from_objects() {
    let (mut touched, mut worst, mut unbounded) = (0, 0.0_f64, 0.0_f64);
    for seed in 0..60 {
        let (scene, counts_per_s) = case(seed);
        // Closed further, fingers 1 and 2 also meet finger 3.
        let links = 20.0 * (2 + seed % 10) as f64;
        let pose: Pose = [links, links, links, 1.0, 0.0, 0.0, 0.0];
        if scene.overlap(&pose).is_some() {
            continue;
        }
        let (share, back) = swing(&scene, links, counts_per_s);
        touched += u32::from(back);
        worst = worst.max(share);
        unbounded = unbounded.max(unbounded_swing(&scene, links, counts_per_s));
        assert!(share <= 1e-6, "seed {seed}: gains {share} of its energy");
    }
    println!(
        "figure: {touched} spreads thrown back, gains at most {worst:.1e} of their energy; {unbounded:.3} if unbounded"
    );
    assert!(touched >= 10, "posts are in the way: {touched}");
    assert!(unbounded > 1e-3, "springs that are replaced add energy: {unbounded}");
}
