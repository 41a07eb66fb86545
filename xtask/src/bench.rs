//! Figures that should not regress unnoticed: simulator speed and instructions of a control tick.

use serde_json::{Value, json};

use crate::Outcome;
use crate::program::{output, program, root, run, succeeds, target, typed};
use programs::output::warn;

/// Twenty seconds of moves: long enough for a clock, short enough to repeat.
const SPEED_SCENARIO: &str = "xtask/bench-speed.toml";

/// A script for the whole hand (GOD, bus, seven boards): home, close, open.
const HAND_SCRIPT: &str = "xtask/bench-hand.gcl";

/// Runs for each figure. The median, because a busy machine only makes a run slower.
const RUNS: usize = 5;

/// # Errors
/// A program fails, or prints unexpected output.
pub fn bench(json: bool) -> Outcome {
    run(program("cargo build --quiet --release --package hil-sim --bins --examples"))?;
    let figures = json!({
        "sim_averaged_x": median(|| motor_speed("averaged"))?,
        "sim_switched_x": median(|| motor_speed("switched"))?,
        "hand_averaged_x": median(hand_speed)?,
        "tick_instructions_host": tick_instructions()?,
    });
    let text = format!("{figures:#}\n");
    let path = root().join("bench.json");
    std::fs::write(&path, &text).map_err(|error| format!("{}: {error}", path.display()))?;
    if json {
        print!("{text}");
        return Ok(());
    }
    println!("simulated seconds a wall second, one motor board with its servo, one core:");
    println!("  averaged inverter  {}", figures["sim_averaged_x"]);
    println!("  switched inverter  {}", figures["sim_switched_x"]);
    println!(
        "the same, a whole hand that a host talks to, averaged inverter: {}",
        figures["hand_averaged_x"]
    );
    println!(
        "instructions a control tick, on this machine's processor: {}",
        figures["tick_instructions_host"]
    );
    println!("written to {}", path.display());
    Ok(())
}

fn median(run: impl Fn() -> Result<f64, String>) -> Result<Value, String> {
    let mut speeds = (0..RUNS).map(|_| run()).collect::<Result<Vec<_>, _>>()?;
    speeds.sort_by(f64::total_cmp);
    Ok(json!(speeds[RUNS / 2].round()))
}

/// Simulated seconds per wall-clock second, for moves of one motor.
fn motor_speed(model: &str) -> Result<f64, String> {
    let said = simulator(&format!("run {SPEED_SCENARIO} --json --model {model}"))?;
    Ok(said("sim_s")? / said("wall_s")?)
}

fn hand_speed() -> Result<f64, String> {
    simulator(&format!("gcl --script {HAND_SCRIPT} --json"))?("realtime_x")
}

fn simulator(line: &str) -> Result<impl Fn(&str) -> Result<f64, String> + use<>, String> {
    let line = format!("cargo run --quiet --release --package hil-sim -- {line}");
    let text = output(program(&line))?;
    let result: Value =
        serde_json::from_str(&text).map_err(|error| format!("{line} printed {text}: {error}"))?;
    Ok(move |key: &str| result[key].as_f64().ok_or_else(|| format!("{line} gives no {key}: {text}")))
}

/// Instructions of one `Servo::tick` during a move. valgrind counts a program that replays the same recorded
/// ticks once and twice; the difference cancels the rest. `null` without valgrind.
fn tick_instructions() -> Result<Value, String> {
    if !succeeds("valgrind --version") {
        warn(
            "tick_instructions_host is null: valgrind is not installed. Debian, Ubuntu: apt-get install valgrind",
        );
        return Ok(Value::Null);
    }
    let (_, once) = count(1)?;
    let (ticks, twice) = count(2)?;
    let per_tick = (twice - once) / ticks;
    Ok(json!((per_tick * 10.0).round() / 10.0))
}

/// Ticks of a replay, and instructions of a program with this number of replays.
fn count(replays: u32) -> Result<(f64, f64), String> {
    let mut valgrind = program("valgrind --tool=cachegrind --cache-sim=no --cachegrind-out-file=/dev/null");
    valgrind.arg("--log-fd=1").arg(target().join("release/examples/tick_count")).arg(replays.to_string());
    let line = typed(&valgrind);
    let text = output(valgrind)?;
    // valgrind: `==123== I   refs:      1,234`; the program: `ticks 880`.
    let number = |mark: &str| {
        let line = text.lines().find(|line| line.contains(mark))?;
        let digits: String = line.rsplit(' ').next()?.chars().filter(char::is_ascii_digit).collect();
        digits.parse::<f64>().ok()
    };
    match (number("ticks "), number("refs:")) {
        (Some(ticks), Some(instructions)) => Ok((ticks, instructions)),
        _ => Err(format!("{line} gives no count:\n{text}")),
    }
}
