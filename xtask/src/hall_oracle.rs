//! Scores the hall estimator on recorded captures of real sensors, with the oracle that came with them.
//!
//! The oracle is not part of the project; it is in `shared/` beside the checkout, if present.

use std::path::Path;

use serde_json::Value;

use crate::Outcome;
use crate::program::{output, program, root, run, simulator, target};

/// Upper bounds for a capture: what the estimator reaches, and 5 %, or the aim where that is less
/// (`docs/estimation.md`).
struct Bounds {
    capture: &'static str,
    velocity_mse: f64,
    position_mse: f64,
}

/// (counts/s)² and counts²; one setting of the estimator for all captures.
const BOUNDS: [Bounds; 4] = [
    Bounds { capture: "20250616-back-and-forth", velocity_mse: 64.0, position_mse: 0.040 },
    Bounds { capture: "20250616-speed-cycle", velocity_mse: 148.0, position_mse: 0.052 },
    Bounds { capture: "20260618-spindle-hw", velocity_mse: 197.0, position_mse: 0.0020 },
    Bounds { capture: "20250615-new-slow", velocity_mse: 139.0, position_mse: 0.092 },
];

/// Largest bias of a steady speed, percent.
const BIAS_PERCENT: f64 = 0.3;

/// Replays and scores every capture; skipped with a message where there is no oracle.
///
/// # Errors
/// A capture misses its bounds, or a program fails.
pub fn check() -> Outcome {
    let oracle = root().join("../shared/tools/hall_oracle.py");
    if !oracle.exists() {
        println!("skipped: no oracle in ../shared beside the checkout; tests/halls.rs scores the recordings");
        return Ok(());
    }
    let out = target().join("hall-oracle");
    std::fs::create_dir_all(&out).map_err(|error| format!("{}: {error}", out.display()))?;
    let failures: Vec<String> = BOUNDS.iter().filter_map(|b| judge(b, &oracle, &out).err()).collect();
    if failures.is_empty() { Ok(()) } else { Err(failures.join("\n")) }
}

fn judge(bounds: &Bounds, oracle: &Path, out: &Path) -> Outcome {
    let capture = root().join("tests/captures").join(format!("{}.dat.gz", bounds.capture));
    let csv = out.join(format!("{}.csv", bounds.capture));
    let mut replay = simulator("replay-halls")?;
    replay.arg(&capture).args(["--counts-per-rev", "90", "--rate-hz", "30000", "--csv"]).arg(&csv);
    run(replay)?;
    let mut score = program("python3");
    score.arg(oracle).arg(&capture).arg(&csv).arg("--json");
    let text = output(score)?;
    let score = serde_json::from_str(&text).map_err(|error| format!("the oracle printed {text}: {error}"))?;
    println!("  {}", within(bounds, &score)?);
    Ok(())
}

fn within(bounds: &Bounds, score: &Value) -> Result<String, String> {
    let number = |key: &str| score[key].as_f64().ok_or_else(|| format!("the oracle gives no {key}: {score}"));
    let (velocity, position) = (number("velocity_mse")?, number("position_mse")?);
    let bias = number("worst_flat_bias_pct")?.abs();
    let line = format!(
        "{}: velocity MSE {velocity} (< {}), position MSE {position} (< {}), bias {bias} % (<= {BIAS_PERCENT})",
        bounds.capture, bounds.velocity_mse, bounds.position_mse
    );
    let holds = velocity < bounds.velocity_mse && position < bounds.position_mse && bias <= BIAS_PERCENT;
    if holds { Ok(line) } else { Err(format!("outside its bounds: {line}")) }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn score_beyond_any_bound_fails() {
        let bounds = Bounds { capture: "a", velocity_mse: 84.0, position_mse: 0.4 };
        let judged = |velocity: f64, position: f64, bias: f64| {
            let score =
                json!({"velocity_mse": velocity, "position_mse": position, "worst_flat_bias_pct": bias});
            within(&bounds, &score).is_ok()
        };
        assert!(judged(83.9, 0.39, -0.3));
        assert!(!judged(84.0, 0.39, 0.0));
        assert!(!judged(83.9, 0.4, 0.0));
        assert!(!judged(83.9, 0.39, -0.31));
        assert!(within(&bounds, &json!({"velocity_mse": 1.0})).is_err());
    }
}
