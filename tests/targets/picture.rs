//! `docs/servo.svg`: what the servo does, on the nominal motor and on 40 scattered plants.

use hil_world::node::Sample;
use tater_wire::Property;

use super::figures::{each, torque_error};
use super::optimum::{PEAK_A, optimum_path};
use super::rig::{Motor, Setup};
use crate::chart::{self, BLUE, ORANGE, Panel, Points};

/// Plants of an envelope, which shows 5 to 95 % of them.
const PLANTS: u64 = 40;

/// A figure of each ms of a run: of the nominal motor, and the 5 and 95 % of the scattered plants.
fn envelope(run: impl Fn(Option<u64>) -> Vec<f64> + Sync) -> (Points, (Points, Points)) {
    let runs = each(0..PLANTS, |seed| run(Some(seed)));
    let of_ms =
        |values: Vec<f64>| values.into_iter().enumerate().map(|(ms, value)| (ms as f64, value)).collect();
    let nominal = run(None);
    let share = |percent: usize| {
        let at = |ms: usize| {
            let mut values: Vec<f64> = runs.iter().map(|run| run[ms]).collect();
            values.sort_by(f64::total_cmp);
            values[(values.len() - 1) * percent / 100]
        };
        of_ms((0..nominal.len()).map(at).collect())
    };
    let band = (share(5), share(95));
    (of_ms(nominal.clone()), band)
}

fn counts(samples: &[Sample]) -> Vec<f64> {
    samples.iter().map(|sample| sample.truth.counts).collect()
}

/// A step, a slow move and the fastest one.
fn moves() -> Vec<Panel> {
    let step = Setup::new("link", "ACCEL = 1000, MV = 4080, HOLD = 1", 0.0);
    let (stepped, step_band) = envelope(|seed| {
        let mut motor = Motor::new(&step, seed);
        motor.set(Property::M, 10);
        counts(&motor.run(120))
    });
    let slow = Setup::new("link", "MV = 16", 0.0);
    let (slowly, slow_band) = envelope(|seed| {
        let mut motor = Motor::new(&slow, seed);
        motor.set(Property::M, 100);
        motor.run(1_500).iter().map(|sample| sample.truth.counts_per_s).collect()
    });
    let travel = Setup::new("link", "ACCEL = 1000, MV = 4080", -25.0);
    let (travelled, travel_band) = envelope(|seed| {
        let mut motor = Motor::new(&travel, seed);
        motor.set(Property::M, 338);
        counts(&motor.run(700))
    });
    let nominal = Motor::new(&travel, None);
    let optimum: Points = optimum_path(nominal.node.board().rig().plant(), PEAK_A, 363.0)
        .into_iter()
        .map(|(ms, counts)| (ms, counts - 25.0))
        .collect();
    vec![
        Panel {
            title: "A link's step of 10 counts: counts over ms. Line: the nominal motor; area: 5 to 95 % of 40 plants of ±30 %".to_owned(),
            x: (0.0, 120.0, 20.0),
            y: (0.0, 12.0, 2.0),
            band: Some(step_band),
            lines: vec![(BLUE, stepped)],
        },
        Panel {
            title: "A link's move at MV 16: true velocity in counts/s over ms".to_owned(),
            x: (0.0, 1_500.0, 250.0),
            y: (0.0, 32.0, 8.0),
            band: Some(slow_band),
            lines: vec![(BLUE, slowly)],
        },
        Panel {
            title: "A link's full travel, ACCEL 1000, MV 4080: counts over ms. Orange: the shortest time that the nominal motor allows".to_owned(),
            x: (0.0, 700.0, 100.0),
            y: (-50.0, 350.0, 50.0),
            band: Some(travel_band),
            lines: vec![(ORANGE, optimum), (BLUE, travelled)],
        },
    ]
}

/// A load on a joint that is held, and the torque.
fn forces() -> Vec<Panel> {
    let load = Setup::new("spread", "", 0.0);
    let (loaded, load_band) = envelope(|seed| {
        let mut motor = Motor::new(&load, seed);
        motor.set(Property::MODE, 3);
        motor.run(250);
        motor.node.rig_mut().set_disturbance(0.2);
        counts(&motor.run(200))
    });
    let torques: Vec<i64> = (1..=15).map(|step| 50 * step).collect();
    let errors = |turning: bool| -> Points {
        torques
            .iter()
            .filter(|&&t| !turning || t >= 100)
            .map(|&t| (t as f64, torque_error(None, t, turning, 25.0)))
            .collect()
    };
    vec![
        Panel {
            title: "0.2 N m on a spread that holds its position, from 0 ms on: counts over ms".to_owned(),
            x: (0.0, 200.0, 25.0),
            y: (-1.0, 4.0, 1.0),
            band: Some(load_band),
            lines: vec![(BLUE, loaded)],
        },
        Panel {
            title: "Error of the torque in mode 2, % over T. Blue: against a stop; orange: turning at 100 counts/s".to_owned(),
            x: (0.0, 750.0, 50.0),
            y: (-10.0, 10.0, 5.0),
            band: None,
            lines: vec![(BLUE, errors(false)), (ORANGE, errors(true))],
        },
    ]
}

#[test]
fn picture_of_the_servo_is_current() {
    let panels: Vec<Panel> = moves().into_iter().chain(forces()).collect();
    chart::keep("servo.svg", "MAKE_SERVO_PICTURE", "targets::picture", &panels);
}
