//! What the pages say of the seeds 1 to 1000 against what these reach: the last column of the promises in docs/safety.md, and README's hours.

use serde_json::Value;

use crate::{files, program::root};

const PAGE: &str = "docs/safety.md";
const README: &str = "README.md";

/// A stated value may be so much above the measured one: rounded up to a tenth, or to two digits.
const ROUNDED: f64 = 0.1;
const SHARE: f64 = 1.1;

/// Compares the pages with the JSON object of `hil-sim torture`.
///
/// # Errors
/// A value is missing, was passed, or is far above what was reached.
pub fn compare(json: &str) -> Result<(), String> {
    let page =
        |name| Ok::<_, String>(String::from_utf8_lossy(&files::read(&root().join(name))?).into_owned());
    let value: Value = serde_json::from_str(json).map_err(|error| format!("torture --json: {error}"))?;
    let mut lines = differences(&page(PAGE)?, &value)?;
    lines.extend(played(&page(README)?, &value)?);
    if lines.is_empty() { Ok(()) } else { Err(lines.join("\n")) }
}

/// README states the seeds and their whole hours: returns what it should say, unless it does.
fn played(readme: &str, value: &Value) -> Result<Option<String>, String> {
    let missing = |key| format!("torture --json: no \"{key}\"");
    let seeds = value["seeds"].as_u64().ok_or_else(|| missing("seeds"))?;
    let hours = value["board_hours"].as_f64().ok_or_else(|| missing("board_hours"))?;
    let words = format!("the seeds 1 to {seeds}, {} board-hours:", hours.floor());
    Ok((!readme.contains(&words)).then(|| format!("{README}: expected \"{words}\"")))
}

fn differences(page: &str, value: &Value) -> Result<Vec<String>, String> {
    let worst =
        value["worst"].as_object().filter(|worst| !worst.is_empty()).ok_or("torture --json: no \"worst\"")?;
    let line = |(name, reached): (&String, &Value)| {
        let reached = reached.as_f64().unwrap_or(f64::NAN);
        match stated(page, name) {
            Some(stated) if reached <= stated && stated <= (SHARE * reached).max(reached + ROUNDED) => None,
            Some(stated) => Some(format!("{PAGE}: {name} says {stated}, the seeds reach {reached:.3}")),
            None => Some(format!("{PAGE}: {name} has no row, the seeds reach {reached:.3}")),
        }
    };
    Ok(worst.iter().filter_map(line).collect())
}

/// The number in the last cell of the row with this name.
fn stated(page: &str, name: &str) -> Option<f64> {
    let row = page.lines().find(|line| line.starts_with('|') && line.contains(&format!("(`{name}`)")))?;
    row.trim_end().trim_end_matches('|').rsplit('|').next()?.trim().parse().ok()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn stated_value_is_reached_and_not_passed() {
        let page = "| promise | at most |\n| x (`a`) | 12 | `r` | `t` | 4.3 |\n";
        let found = |name: &str, reached: f64| {
            differences(page, &json!({ "worst": { name: reached } })).map(|lines| lines.len())
        };
        assert_eq!(found("a", 4.3), Ok(0));
        assert_eq!(found("a", 4.25), Ok(0));
        assert_eq!(found("a", 4.31), Ok(1), "passed");
        assert_eq!(found("a", 2.0), Ok(1), "far above");
        assert_eq!(found("b", 1.0), Ok(1), "no row");
        assert!(differences(page, &json!({})).is_err());
    }

    #[test]
    fn readme_states_seeds_and_hours() {
        let page = "| random programs | the seeds 1 to 1000, 31 board-hours: no invariant broken |";
        let differs = |value: Value| played(page, &value).map(|line| line.is_some());
        assert_eq!(differs(json!({ "seeds": 1000, "board_hours": 31.9 })), Ok(false));
        assert_eq!(differs(json!({ "seeds": 1000, "board_hours": 32.1 })), Ok(true));
        assert_eq!(differs(json!({ "seeds": 100, "board_hours": 31.9 })), Ok(true));
        assert!(differs(json!({ "seeds": 1000 })).is_err());
    }
}
