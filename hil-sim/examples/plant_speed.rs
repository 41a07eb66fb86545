//! Speed of the plant alone: simulated seconds per wall second, open loop, both models.
use hil_world::plant::{Heat, Model, PlantParams, Start};
use hil_world::rig::{Rig, RigParams};
use servo_core::sense::commutation::Bridge;
use servo_core::units::Duty;
use std::time::Instant;
use tater_wire::MotorKind;

#[path = "../world/tests/plant/six_step.rs"]
mod six_step;

fn bridge(code: u8, bits: i16) -> Bridge {
    Bridge::On { legs: six_step::legs(code, true), duty: Duty(fixed(bits)) }
}

fn fixed(bits: i16) -> fixed::types::I1F15 {
    fixed::types::I1F15::from_bits(bits)
}

fn main() {
    let models: &[Model] = match std::env::args().nth(1).as_deref() {
        Some("averaged") => &[Model::Averaged],
        Some("switched") => &[Model::Switched],
        _ => &[Model::Averaged, Model::Switched],
    };
    for &model in models {
        for bits in [8192, 16384, 32767] {
            let mut plant = PlantParams::for_motor(MotorKind::Spread);
            plant.max_count = 1e6;
            let heat = Heat { winding_c: 25.0, housing_c: 25.0 };
            let start = Start { count: 0.0, counts_per_s: 0.0, heat };
            let mut rig = Rig::new(plant, RigParams::default(), &[], model, start, 1).expect("valid");
            let clock = Instant::now();
            let ms = 20_000;
            for tick in 1..=ms {
                while rig.advance(bridge(rig.halls(), bits), true, tick * 1000).is_some() {}
                rig.analog();
            }
            let wall = clock.elapsed().as_secs_f64();
            let t = rig.truth();
            println!(
                "{model:?} duty {:.2}: {:.0} x real time ({:.0} counts/s, {:.3} A bus, rms {:.3} A, residual {:.2e} of {:.1} J)",
                f64::from(bits) / 32768.0,
                ms as f64 * 1e-3 / wall,
                t.counts_per_s,
                t.bus_charge_c / (ms as f64 * 1e-3),
                (t.ledger.copper_j / 2.405 / (ms as f64 * 1e-3)).sqrt(),
                t.ledger.residual_j(),
                t.ledger.turnover_j(),
            );
        }
    }
}
