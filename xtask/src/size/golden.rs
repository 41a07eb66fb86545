//! The committed figures, and differences from them.

use serde_json::{Value, json};

use super::Figures;
use crate::program::root;
use crate::{Failure, files};

const GOLDEN: &str = "xtask/size.json";

const ABOUT: &str = "Figures of the production images, in bytes. Written by `cargo xtask size --bless`, compared exactly by \
                     `cargo xtask size --check`: compiler and dependencies are pinned and the build is reproducible, so that only a \
                     change of ours can change them, and its reviewer sees here what it costs.";

/// The committed part of the figures: no names of functions, which would change with each refactoring.
fn committed(all: &[Figures]) -> Value {
    let mut object = serde_json::Map::from_iter([("about".to_owned(), json!(ABOUT))]);
    for figures in all {
        let sections: serde_json::Map<String, Value> =
            figures.sections.iter().map(|(name, bytes, ..)| (name.clone(), json!(bytes))).collect();
        let stack = figures.stack.as_ref().map_or_else(
            |_| json!("unknown"),
            |worst| {
                if let Some(poll) = figures.poll() {
                    return json!({ "poll": poll });
                }
                let levels = worst.levels.iter().map(|level| (level.name.clone(), json!(level.bytes())));
                json!({
                    "worst": worst.bytes(),
                    "start": worst.start.bytes,
                    "levels": levels.collect::<serde_json::Map<String, Value>>(),
                })
            },
        );
        let program = json!({
            "flash": figures.flash,
            "ram": figures.ram,
            "sections": sections,
            "flash_by_crate": figures.flash_by_crate,
            "ram_by_crate": figures.ram_by_crate,
            "stack": stack,
        });
        object.insert(figures.name.into(), program);
    }
    Value::Object(object)
}

/// # Errors
/// The stack of a program is unknown, or the file cannot be written.
pub fn bless(all: &[Figures]) -> Result<(), Failure> {
    let figures = blessed(all).map_err(Failure::Judged)?;
    files::replace(&root().join(GOLDEN), figures.as_bytes()).map_err(Failure::Unusable)
}

fn blessed(all: &[Figures]) -> Result<String, String> {
    for Figures { name, stack, .. } in all {
        if let Err(error) = stack {
            return Err(format!("{GOLDEN} stays as it is\n  {name}: its stack is unknown: {error}"));
        }
    }
    Ok(format!("{:#}\n", committed(all)))
}

/// Lines of a table of differences; empty if there are none.
///
/// # Errors
/// The file is missing or no JSON object.
pub fn differences(all: &[Figures]) -> Result<Vec<String>, String> {
    let text = std::fs::read(root().join(GOLDEN)).map_err(|error| error.to_string());
    let golden = text.and_then(|text| object(&text)).map_err(|error| {
        format!("{GOLDEN}: {error}\n  next: cargo xtask size --bless, and review the change of the file")
    })?;
    let rows = table(&golden, &committed(all));
    if rows.is_empty() {
        return Ok(rows);
    }
    let head =
        format!("{GOLDEN}: {} figures differ\n    {:>8} {:>8}  figure", rows.len(), "found", "expected");
    let next = "next: if that is meant, cargo xtask size --bless, and review the change of the file";
    Ok(vec![format!("{head}\n    {}\n    {next}", rows.join("\n    "))])
}

fn object(text: &[u8]) -> Result<Value, String> {
    match serde_json::from_slice(text) {
        Ok(object @ Value::Object(_)) => Ok(object),
        Ok(_) => Err("found another value of JSON, expected an object".into()),
        Err(error) => Err(error.to_string()),
    }
}

/// A row for each difference: found, expected, path.
fn table(expected: &Value, found: &Value) -> Vec<String> {
    let (mut expected_leaves, mut found_leaves) = (Vec::new(), Vec::new());
    leaves("", expected, &mut expected_leaves);
    leaves("", found, &mut found_leaves);
    let value = |leaves: &[(String, String)], place: &str| {
        leaves
            .iter()
            .find(|(name, _)| name == place)
            .map_or_else(|| "none".to_owned(), |(_, value)| value.clone())
    };
    let mut places: Vec<&String> =
        expected_leaves.iter().chain(&found_leaves).map(|(place, _)| place).collect();
    places.sort();
    places.dedup();
    let rows = places.into_iter().filter(|place| *place != "about").filter_map(|place| {
        let (found, expected) = (value(&found_leaves, place), value(&expected_leaves, place));
        (found != expected).then(|| format!("{found:>8} {expected:>8}  {place}"))
    });
    rows.collect()
}

/// The numbers of an object with their paths: `tater / stack / worst`.
fn leaves(place: &str, value: &Value, into: &mut Vec<(String, String)>) {
    let Value::Object(object) = value else {
        into.push((place.to_owned(), value.to_string()));
        return;
    };
    for (key, value) in object {
        let place = if place.is_empty() { key.clone() } else { format!("{place} / {key}") };
        leaves(&place, value, into);
    }
}

#[cfg(test)]
mod tests {

    use super::super::stack::{Deepest, Worst};
    use super::*;

    #[test]
    fn equal_figures_give_no_rows() {
        let figures = |about| json!({ "about": about, "tater": { "flash": 1, "sections": { ".text": 2 } } });
        assert_eq!(table(&figures("a"), &figures("b")), [""; 0]);
    }

    #[test]
    fn changed_missing_and_new_figures_give_rows() {
        let expected = json!({ "tater": { "flash": 1, "ram": 5, "gone": 3 } });
        let found = json!({ "tater": { "flash": 2, "ram": 5, "new": 4 } });
        let rows = [
            "       2        1  tater / flash",
            "    none        3  tater / gone",
            "       4     none  tater / new",
        ];
        assert_eq!(table(&expected, &found), rows);
    }

    #[test]
    fn committed_file_is_an_object() {
        assert_eq!(object(b"{}"), Ok(json!({})));
        for (text, what) in [("[1, 2]", "expected an object"), ("7", "expected an object"), ("", "EOF")] {
            let error = object(text.as_bytes()).expect_err(text);
            assert!(error.contains(what), "{text}: {error}");
        }
    }

    #[test]
    fn unknown_stack_is_not_committed() {
        let figures = |stack| Figures::new("tater", stack);
        let known =
            Worst { levels: vec![], start: Deepest::default(), by_register: vec![], unreached: vec![] };
        assert!(blessed(&[figures(Ok(known.clone()))]).is_ok());
        let error = blessed(&[figures(Ok(known)), figures(Err("found SVC".into()))]).unwrap_err();
        assert!(error.contains("stays as it is") && error.contains("found SVC"), "{error}");
    }
}
