//! Figures that must not get worse unseen: the simulator's speed and the cost of a control tick.

use serde_json::{Value, json};

use crate::Outcome;
use crate::program::{output, program, root, run, succeeds, target, typed};

/// Twenty seconds of moves with the servo in the loop: long enough for a clock, short enough to repeat.
const SPEED_SCENARIO: &str = "xtask/bench-speed.toml";

/// Runs per figure. The median: a busy machine only ever makes a run slower.
const RUNS: usize = 5;

/// Measures, and writes `bench.json` in the root of the project.
///
/// # Errors
/// A program fails, or says something unexpected.
pub fn bench(json: bool) -> Outcome {
    run(program("cargo build --quiet --release --package hil-sim --bins --examples"))?;
    let figures = json!({
        "sim_averaged_x": speed("averaged")?,
        "sim_switched_x": speed("switched")?,
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
        "instructions a control tick, on this machine's processor: {}",
        figures["tick_instructions_host"]
    );
    println!("written to {}", path.display());
    Ok(())
}

/// Simulated seconds a wall second, the median of some runs.
fn speed(model: &str) -> Result<Value, String> {
    let mut speeds = Vec::new();
    for _ in 0..RUNS {
        let line = format!(
            "cargo run --quiet --release --package hil-sim -- run {SPEED_SCENARIO} --json --model {model}"
        );
        let text = output(program(&line))?;
        let result: Value =
            serde_json::from_str(&text).map_err(|error| format!("{line} said {text}: {error}"))?;
        let seconds =
            |key: &str| result[key].as_f64().ok_or_else(|| format!("{line} gives no {key}: {text}"));
        speeds.push(seconds("sim_s")? / seconds("wall_s")?);
    }
    speeds.sort_by(f64::total_cmp);
    Ok(json!(speeds[RUNS / 2].round()))
}

/// Instructions of one `Servo::tick` in a move: valgrind counts a program that replays the same recorded
/// ticks once and twice, so that what is common to both cancels. `null` where there is no valgrind.
fn tick_instructions() -> Result<Value, String> {
    if !succeeds("valgrind --version") {
        eprintln!(
            "tick_instructions_host is null: valgrind is not installed. Debian, Ubuntu: apt-get install valgrind"
        );
        return Ok(Value::Null);
    }
    let (_, once) = count(1)?;
    let (ticks, twice) = count(2)?;
    let per_tick = (twice - once) / ticks;
    Ok(json!((per_tick * 10.0).round() / 10.0))
}

/// Ticks a replay, and the instructions of a program that does `replays` of them.
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
