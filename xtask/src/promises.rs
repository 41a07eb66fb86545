//! The last column of the promises in docs/safety.md against what the seeds of `ci` have reached.

use serde_json::Value;

use crate::{files, program::root};

const PAGE: &str = "docs/safety.md";

/// A stated value may be so much above the measured one: rounded up to a tenth, or to two digits.
const ROUNDED: f64 = 0.1;
const SHARE: f64 = 1.1;

/// Compares the page with the JSON object of `hil-sim torture`.
///
/// # Errors
/// A value is missing, was passed, or is far above what was reached.
pub fn compare(json: &str) -> Result<(), String> {
    let page = String::from_utf8_lossy(&files::read(&root().join(PAGE))?).into_owned();
    differences(&page, json).and_then(|lines| if lines.is_empty() { Ok(()) } else { Err(lines.join("\n")) })
}

fn differences(page: &str, json: &str) -> Result<Vec<String>, String> {
    let value: Value = serde_json::from_str(json).map_err(|error| format!("torture --json: {error}"))?;
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
    use super::*;

    #[test]
    fn stated_value_is_reached_and_not_passed() {
        let page = "| promise | at most |\n| x (`a`) | 12 | `r` | `t` | 4.3 |\n";
        let found = |name: &str, reached: f64| {
            differences(page, &format!(r#"{{ "worst": {{ "{name}": {reached} }} }}"#))
                .map(|lines| lines.len())
        };
        assert_eq!(found("a", 4.3), Ok(0));
        assert_eq!(found("a", 4.25), Ok(0));
        assert_eq!(found("a", 4.31), Ok(1), "passed");
        assert_eq!(found("a", 2.0), Ok(1), "far above");
        assert_eq!(found("b", 1.0), Ok(1), "no row");
        assert!(differences(page, "{}").is_err());
    }
}
