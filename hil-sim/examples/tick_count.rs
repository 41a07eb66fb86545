//! The control ticks of one move, replayed as often as requested. `cargo xtask bench` counts instructions under valgrind
//! with one replay and with two; the difference is the servo's ticks.

use std::hint::black_box;

use servo_core::sense::hall::{HallDecoder, HallEvent, Wiring};
use servo_core::units::{Counts, DeciCelsius, Micros, MilliAmps, MilliVolts};
use servo_core::{Command, Config, Drive, Sense, Servo};
use tater_fw::motion::defaults;
use tater_wire::MotorKind;

struct Tick {
    now: Micros,
    halls: Vec<HallEvent>,
}

/// A link's full travel near the speed limit: as many edges per tick as a real move has.
const TRAVEL: i32 = 338;

fn servo() -> Servo {
    let config = Config { accel: 60, mv: 750, ..defaults(MotorKind::Link) };
    let mut servo = Servo::new(config, 0);
    servo.command(Command::Move(TRAVEL)).expect("an idle motor takes a move");
    servo
}

fn run(servo: &mut Servo, tick: &Tick) -> Drive {
    for event in &tick.halls {
        servo.hall(event);
    }
    servo.tick(&Sense {
        now: tick.now,
        bus: MilliVolts(24_000),
        current: MilliAmps(500),
        motor_temp: DeciCelsius(300),
        strain: 128,
        host_lost: false,
    })
}

/// Cells that a rotor enters while moving upwards, and when, in the millisecond before `now`.
fn crossings(from: Counts, to: Counts, now: Micros) -> impl Iterator<Item = (i32, Micros)> {
    let (from_bits, to_bits) = (i64::from(from.0.to_bits()), i64::from(to.0.to_bits()));
    (from.round() + 1..=to.round()).map(move |count| {
        // Cell k begins at k - 1/2; 1024 bits a count.
        let boundary = i64::from(count) * 1024 - 512;
        let into_tick = 1000 * (boundary - from_bits) / (to_bits - from_bits).max(1);
        let into_tick = u32::try_from(into_tick.clamp(0, 1000)).expect("clamped");
        (count, Micros(now.0 - 1000 + into_tick))
    })
}

fn code(count: i32) -> u8 {
    Wiring::STANDARD.code(u8::try_from(count.rem_euclid(6)).expect("0 to 5"))
}

/// The inputs of one move by a rotor that follows its set-point exactly.
fn record() -> Vec<Tick> {
    let mut servo = servo();
    let mut decoder = HallDecoder::new(Wiring::STANDARD, code(0), 0);
    let (mut ticks, mut from, mut now) = (Vec::new(), Counts::ZERO, Micros(0));
    while servo.telemetry().end.is_none() {
        now = now.wrapping_add(Micros(1000));
        let to = servo.telemetry().setpoint;
        let halls =
            crossings(from, to, now).filter_map(|(count, at)| decoder.sample(code(count), at)).collect();
        let tick = Tick { now, halls };
        run(&mut servo, &tick);
        ticks.push(tick);
        from = to;
        assert!(ticks.len() < 2000, "the move does not end: {:?}", servo.telemetry());
    }
    assert_eq!(servo.telemetry().position.round(), TRAVEL, "{:?}", servo.telemetry());
    ticks
}

fn main() {
    let replays = std::env::args().nth(1).and_then(|word| word.parse().ok());
    let Some(replays) = replays else {
        eprintln!("usage: tick_count REPLAYS\n  REPLAYS: how often to replay the move, a whole number");
        std::process::exit(2);
    };
    let ticks = record();
    for _ in 0..replays {
        let mut servo = black_box(servo());
        for tick in &ticks {
            black_box(run(&mut servo, black_box(tick)));
        }
    }
    println!("ticks {}", ticks.len());
}
