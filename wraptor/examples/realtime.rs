//! Measures RealTime: `realtime HOST:PORT [BLOCKS_A_SECOND [SECONDS [MOTORS]]]`. Wakes and homes the hand, closes and opens its motors slowly.

use std::error::Error;
use std::ops::ControlFlow;
use std::time::Duration;

use wraptor::{Control, Format, Hand, no_progress};

/// Hall counts/s.
const VELOCITY: i32 = 40;

/// Motors turn back after so many blocks.
const TURN: u64 = 300;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument = |index: usize, or: &'static str| arguments.get(index).map_or(or, String::as_str);
    let address = argument(0, "127.0.0.1:11001");
    let rate: f64 = argument(1, "300").parse()?;
    let blocks = (rate * argument(2, "10").parse::<f64>()?) as u64;
    let motors = argument(3, "G");
    let mut hand = Hand::connect(address, Duration::from_secs(5))?;
    hand.init(Duration::from_secs(60), &mut no_progress)?;
    let mut realtime = hand.realtime(motors, Format::default(), Duration::from_secs(2))?;
    let axes = realtime.axes();
    let statistics = realtime.run(rate, Duration::from_secs(1), |number, _| {
        let velocity = if (number / TURN).is_multiple_of(2) { VELOCITY } else { -VELOCITY };
        match number < blocks {
            true => ControlFlow::Continue(vec![Control { velocity, gain: 0 }; axes]),
            false => ControlFlow::Break(()),
        }
    })?;
    realtime.end(Duration::from_secs(2))?;
    let [p50, p99, max] = statistics.jitter;
    println!("{motors}: {:.1} blocks/s of {rate}, {} missed", statistics.rate, statistics.missed);
    println!("  sent late by: median {p50:?}, 99 % {p99:?}, maximum {max:?}");
    let [p50, p99, max] = statistics.round_trip;
    println!("  round trip: median {p50:?}, 99 % {p99:?}, maximum {max:?}");
    Ok(())
}
