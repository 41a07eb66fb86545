//! One motor without a board: its bridge driven open loop, and everything done to it that a rig allows.

use crate::Record;
use crate::six_step::legs;
use hil_world::hand::person;
use hil_world::plant::{Contact, Heat, Model, PlantParams, RAD_PER_COUNT, SharedSupply, Start, Supply};
use hil_world::rig::{
    Bridge, HallGlitch, Input, InputFault, Leg, Object, Rig, RigParams, Side, StuckLine, duty,
};
use tater_wire::MotorKind;

const KINDS: [MotorKind; 3] = [MotorKind::Link, MotorKind::Spread, MotorKind::Tip];

/// A stretch of each scene, and the distance of its lines, ms.
const PART_MS: u64 = 40;
const LINE_MS: u64 = 10;

/// Sensors with every error that they may have.
fn sensors() -> RigParams {
    RigParams {
        hall_error_deg: [6.0, -6.0, 0.0, 12.0, -3.0, 1.0],
        rise_delay_us: 40,
        glitches: vec![
            HallGlitch { at_us: 30_000, code: 0, duration_us: 400 },
            HallGlitch { at_us: 95_000, code: 7, duration_us: 90 },
        ],
        ..RigParams::default()
    }
}

fn objects() -> [Object; 2] {
    [
        Object { from_count: 130.0, stiffness_n_m_rad: 0.3, damping_n_m_s: 2e-4, side: Side::Closing },
        Object { from_count: 70.0, stiffness_n_m_rad: 2.0, damping_n_m_s: 0.0, side: Side::Opening },
    ]
}

fn rig(kind: MotorKind, model: Model, sensors: RigParams, objects: &[Object]) -> Rig {
    let plant = PlantParams::for_motor(kind).scattered(kind as u64 + 1, 0.3);
    let start = Start { count: 100.0, counts_per_s: 40.0, heat: Heat { winding_c: 60.0, housing_c: 40.0 } };
    Rig::new(plant, sensors, objects, model, start, 3).expect("in range")
}

/// Six-step commutation at a hall code, closing or, with a negative compare value, opening.
fn six_step(code: u8, compare: i32) -> Bridge {
    Bridge::On { legs: legs(code, compare >= 0), duty: duty(compare.unsigned_abs(), 1800) }
}

/// Drives for `ms` as `bridge` says at each hall code, and notes what is seen every [`LINE_MS`].
fn drive(
    record: &mut Record,
    what: &str,
    rig: &mut Rig,
    ms: u64,
    released: bool,
    bridge: impl Fn(u8) -> Bridge,
) {
    let mut edges = Vec::new();
    let end_us = rig.now_us() + 1000 * ms;
    while rig.now_us() < end_us {
        let line_us = (rig.now_us() + 1000 * LINE_MS).min(end_us);
        while rig.now_us() < line_us {
            edges.extend(rig.advance(bridge(rig.halls()), released, line_us));
        }
        let (truth, analog) = (rig.truth(), rig.analog());
        let energy = (truth.ledger.residual_j(), truth.ledger.turnover_j());
        let seen = (&edges, rig.truth(), energy, analog, rig.supply(), rig.joint_counts(), rig.objects_j());
        let more = (
            rig.settled_counts(),
            rig.hall_cell(),
            rig.last_edge_us(),
            rig.tripped(),
            rig.next_exchange_us(),
        );
        record.note(
            format!(
                "{what} {} ms: {:.3} counts, {:.2} counts/s, {:.4} N m, {} edges, {} mA",
                truth.t_us / 1000,
                truth.counts,
                truth.counts_per_s,
                truth.torque_n_m,
                edges.len(),
                analog.current.0
            ),
            &(seen, more),
        );
        edges.clear();
    }
}

fn driven(kind: MotorKind, model: Model) -> Record {
    let mut record = Record::new(&format!("{kind:?}, {model:?}"));
    let rig = &mut rig(kind, model, sensors(), &objects());
    let mut part = |what: &str, rig: &mut Rig, released, bridge: &dyn Fn(u8) -> Bridge| {
        drive(&mut record, what, rig, PART_MS, released, bridge);
    };
    part("closing", rig, true, &|code| six_step(code, 700));
    part("opening", rig, true, &|code| six_step(code, -1300));
    part("full duty", rig, true, &|code| six_step(code, 1800));
    part("braked by the winding", rig, true, &|_| Bridge::On { legs: [Leg::Low; 3], duty: duty(0, 1800) });
    part("coasting", rig, true, &|_| Bridge::Off);
    part("all legs", rig, true, &|_| Bridge::On {
        legs: [Leg::Pwm, Leg::Low, Leg::Low],
        duty: duty(300, 1800),
    });
    part("two PWM legs", rig, true, &|_| Bridge::On {
        legs: [Leg::Pwm, Leg::Pwm, Leg::Low],
        duty: duty(300, 1800),
    });
    rig.set_disturbance(0.2);
    part("load", rig, true, &|_| Bridge::Off);
    rig.set_disturbance(0.0);
    rig.set_shaft_torque(-0.15);
    part("turned by hand", rig, true, &|_| Bridge::Off);
    rig.set_shaft_torque(0.0);
    part("brake", rig, false, &|_| Bridge::Off);
    rig.stick_brake(Some(true));
    part("brake stuck", rig, true, &|code| six_step(code, 900));
    rig.stick_brake(None);
    rig.jam(0.3);
    part("jammed", rig, true, &|code| six_step(code, 900));
    rig.jam(0.0);
    let at = rig.joint_counts();
    rig.set_finger(Some(person::gives_way(kind, person::N_PER_MM, at + 2.0, 1.0)));
    part("against a finger", rig, true, &|code| six_step(code, 600));
    rig.set_finger(None);
    rig.set_objects(&[Contact {
        from: (at - 3.0) * RAD_PER_COUNT,
        side: -1.0,
        stiffness: 1.0,
        damping: 1e-4,
    }]);
    part("against a new object", rig, true, &|code| six_step(code, -600));
    rig.set_bus(12.0);
    part("12 V", rig, true, &|code| six_step(code, 1500));
    rig.set_max_step_us(7);
    part("short steps", rig, true, &|code| six_step(code, -1500));
    record
}

/// Faults of the sensors, lines and phases.
fn broken(model: Model) -> Record {
    let mut record = Record::new(&format!("broken, {model:?}"));
    let free =
        RigParams { strain_zero: 90.0, adc_noise_lsb: 2.0, thermistor_lag_s: 0.05, ..RigParams::default() };
    let mut part =
        |what: &str, rig: &mut Rig| drive(&mut record, what, rig, PART_MS, true, |code| six_step(code, 500));
    let turning = &mut rig(MotorKind::Spread, model, free.clone(), &[]).starting_at(7_000);
    part("whole", turning);
    turning.break_hall_lines([None, Some(true), None]);
    part("line 1 high", turning);
    turning.break_hall_lines([None; 3]);
    turning.add_glitch(HallGlitch { at_us: turning.now_us() + 5_000, code: 7, duration_us: 3_000 });
    part("glitch", turning);
    turning.override_thermistor(Some(155.0));
    turning.disturb_input(Input::Bus, InputFault { offset: 0.01, noise_lsb: 8.0, ..InputFault::default() });
    turning.disturb_input(Input::Current, InputFault { stuck_at: Some(0.75), ..InputFault::default() });
    turning.disturb_input(Input::Strain, InputFault { offset: 0.1, ..InputFault::default() });
    part("inputs", turning);
    turning.override_thermistor(None);
    turning.trip();
    part("tripped", turning);
    turning.guard_outside();
    turning.trip();
    part("guarded outside", turning);
    let _ = turning.advance(Bridge::Off, true, turning.now_us() + 300_000);
    turning.rewire([1, 2, 0], [2, 0, 1], [true, false, true]).expect("an order");
    part("rewired", turning);
    for (what, sensors) in [
        ("open leg", RigParams { open: [false, true, false], ..free.clone() }),
        ("two open legs", RigParams { open: [true, true, false], ..free.clone() }),
        ("shorted lines", RigParams { shorted: Some([0, 2]), ..free.clone() }),
        (
            "stuck low",
            RigParams { stuck: Some(StuckLine { line: 0, high: false, from_us: 9_000 }), ..free.clone() },
        ),
        (
            "late lines",
            RigParams { rise_delay_us: 900, hall_jitter_deg: 1.0, hall_hysteresis_deg: 9.0, ..free },
        ),
    ] {
        let turned = &mut rig(MotorKind::Tip, model, sensors, &[]);
        turned.set_shaft_torque(0.2);
        part(what, turned);
    }
    record
}

/// Three motors that share a weak source, and what their source has given.
fn shared() -> Record {
    let mut record = Record::new("one supply");
    let supply = SharedSupply::new(Supply::with(24.0, 3, 2.0, 300e-6));
    let mut rigs = KINDS.map(|kind| rig(kind, Model::Averaged, RigParams::default(), &[]));
    for rig in &mut rigs {
        rig.share(&supply);
    }
    for ms in 1..=240u64 {
        // Driven all together, then reversed one after the other, then off; the source fails on the way.
        match ms {
            90 => supply.set_source(18.0, 1.0),
            150 => supply.set_source(0.0, 0.0),
            180 => supply.set_source(27.0, 8.0),
            _ => {}
        }
        while rigs[0].now_us() < 1000 * ms {
            let until_us = rigs.iter().map(Rig::next_exchange_us).fold(1000 * ms, u64::min);
            for (index, rig) in (0u64..).zip(&mut rigs) {
                while rig.now_us() < until_us {
                    let compare = if ms > 60 + 20 * index { -1100 } else { 1400 };
                    let bridge = if ms > 220 { Bridge::Off } else { six_step(rig.halls(), compare) };
                    rig.advance(bridge, true, until_us);
                }
            }
        }
        if ms % LINE_MS == 0 {
            let truths = rigs.each_ref().map(Rig::truth);
            let now = supply.read();
            let speeds = truths.map(|truth| format!("{:.1}", truth.counts_per_s)).join(", ");
            let shown = format!("{ms} ms: {:.3} V, {:.3} A, {speeds} counts/s", now.volts(), now.source_a());
            record.note(shown, &(truths, now.ledger(), now.motors_a(), now));
        }
    }
    record
}

/// What the plants are made of.
fn figures() -> Record {
    let mut record = Record::new("plants");
    for kind in KINDS {
        for plant in [PlantParams::for_motor(kind), PlantParams::ideal(kind)] {
            let stiffness = person::stiffness_n_m_rad(kind, 2.0);
            let computed = (plant.stop_rad_n_m(), plant.longest_step_us(), plant.pair_ohm(100.0), stiffness);
            let shown = format!("{kind:?}: {computed:.5?}, lever {:.4} m", person::lever_m(kind));
            record.note(shown, &(&plant, computed, plant.scattered(9, 0.5)));
        }
    }
    for (field, plant) in [
        ("ke_v_s", PlantParams { ke_v_s: 0.0, ..PlantParams::ideal(MotorKind::Tip) }),
        ("static_n_m", PlantParams { static_n_m: 0.0, ..PlantParams::for_motor(MotorKind::Tip) }),
    ] {
        let error = plant.validate().expect_err(field);
        record.note(format!("{field}: {error}"), &error);
    }
    record
}

pub fn scenes() -> Vec<Record> {
    let models = [Model::Averaged, Model::Switched];
    let driven = KINDS.into_iter().flat_map(|kind| models.map(|model| driven(kind, model)));
    driven.chain(models.map(broken)).chain([shared(), figures()]).collect()
}
