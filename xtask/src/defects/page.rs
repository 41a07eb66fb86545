//! The results in docs/defects.md: a table, and the scores that it adds up to.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::list::{Defect, Origin, Plant};

pub const PAGE: &str = "docs/defects.md";

const BEGIN: &str = "<!-- made: defects -->\n";
const END: &str = "<!-- end -->\n";
const HEAD: &str = "| defect | origin | expected | caught by | seeds | simulated s | unit tests |\n|---|---|---|---|---|---|---|\n";
const NOTHING: &str = "**nothing**";

/// What has been measured of a defect; empty cells have not.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    /// An invariant, or [`NOTHING`].
    by: String,
    seeds: String,
    simulated_s: String,
    /// `yes` or `no`.
    units: String,
}

impl Row {
    pub fn tortured(self, by: Option<&str>, seeds: u64, is_long: bool, simulated_s: f64) -> Self {
        let by = by.unwrap_or(NOTHING).to_owned();
        let seeds = if is_long { format!("{seeds} long") } else { seeds.to_string() };
        Self { by, seeds, simulated_s: format!("{simulated_s:.0}"), ..self }
    }

    pub fn unit_tested(self, found: bool) -> Self {
        Self { units: if found { "yes" } else { "no" }.to_owned(), ..self }
    }

    fn is_found(&self) -> bool {
        !self.by.is_empty() && self.by != NOTHING
    }
}

pub type Rows = BTreeMap<String, Row>;

/// The rows of the page.
pub fn parse(page: &str) -> Rows {
    let table = page.split(HEAD).nth(1).unwrap_or_default();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let [_, name, _, _, by, seeds, simulated_s, units, _] = cells.try_into().ok()?;
        let [by, seeds, simulated_s, units] = [by, seeds, simulated_s, units].map(str::to_owned);
        Some((name.to_owned(), Row { by, seeds, simulated_s, units }))
    };
    table.lines().map_while(row).collect()
}

/// The page with other results.
///
/// # Errors
/// It has no place for them.
pub fn with(page: &str, made: &str) -> Result<String, String> {
    let (before, rest) = page.split_once(BEGIN).ok_or_else(|| format!("{PAGE}: expected {BEGIN}"))?;
    let (_, after) = rest.split_once(END).ok_or_else(|| format!("{PAGE}: expected {END}"))?;
    Ok([before, BEGIN, made, END, after].concat())
}

/// Scores and tables of these defects, as the page has them.
pub fn made(defects: &[&Defect], rows: &Rows) -> String {
    let mut text = score(defects, rows) + "\n" + HEAD;
    for defect in defects.iter().filter(|defect| !matches!(defect.origin, Origin::Equivalent(_))) {
        let row = rows.get(&defect.name).cloned().unwrap_or_default();
        let by = match &defect.plant {
            Plant::Elsewhere(tests) => format!("elsewhere: {tests}"),
            Plant::Texts(_) => row.by,
        };
        let origin = match &defect.origin {
            Origin::Drawn(area) => format!("drawn: {area}"),
            _ => "chosen".to_owned(),
        };
        let expected = defect.invariants.join(", ");
        let cells = [&defect.name, &origin, &expected, &by, &row.seeds, &row.simulated_s, &row.units];
        text += &format!("| {} |\n", cells.map(|cell| cell.replace('|', "\\|")).join(" | "));
    }
    text += "\n| missed | what is wrong | why nothing finds it |\n|---|---|---|\n";
    for defect in defects {
        if let Some(why) = &defect.missed {
            text += &format!("| {} | {} | {} |\n", defect.name, cell(&defect.what), cell(why));
        }
    }
    let mut head = "\n| drawn, but no defect | mutant | proof that nothing differs |\n|---|---|---|\n";
    for defect in defects {
        if let Origin::Equivalent(proof) = &defect.origin {
            text += &format!("{head}| {} | {} | {} |\n", defect.name, cell(&defect.what), cell(proof));
            head = "";
        }
    }
    text
}

fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}

/// How many defects were found by torture, of how many; and by unit tests.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Score {
    torture: usize,
    of: usize,
    units: usize,
    tested: usize,
}

impl Score {
    fn of(defects: &[&Defect], rows: &Rows, drawn: Option<bool>) -> Self {
        let mut score = Self::default();
        for defect in defects {
            let is_drawn = match &defect.origin {
                Origin::Chosen => false,
                Origin::Drawn(_) => true,
                Origin::Equivalent(_) => continue,
            };
            if matches!(defect.plant, Plant::Elsewhere(_)) || drawn.is_some_and(|drawn| drawn != is_drawn) {
                continue;
            }
            // What is not measured is not found.
            score.of += 1;
            let Some(row) = rows.get(&defect.name) else { continue };
            score.torture += usize::from(row.is_found());
            score.tested += usize::from(!row.units.is_empty());
            score.units += usize::from(row.units == "yes");
        }
        score
    }

    fn percent(hits: usize, of: usize) -> f64 {
        if of == 0 { 0.0 } else { 100.0 * hits as f64 / of as f64 }
    }
}

fn score(defects: &[&Defect], rows: &Rows) -> String {
    let [all, chosen, drawn] = [None, Some(false), Some(true)].map(|drawn| Score::of(defects, rows, drawn));
    let numbers = |found: bool| {
        let rows = defects.iter().filter_map(|defect| rows.get(&defect.name));
        rows.filter(move |row| row.is_found() == found).filter_map(|row| row.seeds.parse::<u64>().ok())
    };
    let share = |hits, of| format!("{hits} of {of} ({:.1} %)", Score::percent(hits, of));
    format!(
        "**Torture alone finds {}** of the defects: {} that were chosen, {} that were drawn. It needs {} seeds at most; what it misses was \
         played with {} seeds or more.\nOf the {} that unit tests can reach they find {}: {} of those chosen, {} of those drawn.\n",
        share(all.torture, all.of),
        share(chosen.torture, chosen.of),
        share(drawn.torture, drawn.of),
        numbers(true).max().unwrap_or(0),
        numbers(false).min().unwrap_or(0),
        all.tested,
        share(all.units, all.tested),
        share(chosen.units, chosen.tested),
        share(drawn.units, drawn.tested),
    )
}

/// The same as one JSON object.
pub fn json(defects: &[&Defect], rows: &Rows) -> Value {
    let all = Score::of(defects, rows, None);
    let drawn = Score::of(defects, rows, Some(true));
    let row = |defect: &&Defect| {
        let row = rows.get(&defect.name)?;
        let caught_by = row.is_found().then_some(row.by.as_str());
        let number = |text: &str| text.parse::<u64>().ok();
        Some(json!({
            "name": defect.name,
            "drawn": matches!(defect.origin, Origin::Drawn(_)),
            "expected": defect.invariants,
            "caught_by": caught_by,
            "seeds": number(&row.seeds),
            "simulated_s": number(&row.simulated_s),
            "unit_tests": match row.units.as_str() { "yes" => Some(true), "no" => Some(false), _ => None },
            "missed": defect.missed,
        }))
    };
    json!({
        "defects": all.of, "found": all.torture, "drawn": drawn.of, "drawn_found": drawn.torture,
        "unit_tested": all.tested, "unit_tests_found": all.units,
        "rows": defects.iter().filter_map(row).collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::defects::list;
    use crate::program::root;

    fn committed() -> (Vec<Defect>, String) {
        let page = std::fs::read_to_string(root().join(PAGE)).expect("there");
        (list::read(&root().join(list::LIST)).expect("complete"), page)
    }

    #[test]
    fn page_is_what_its_table_and_the_list_say() {
        let (all, page) = committed();
        let all: Vec<&Defect> = all.iter().collect();
        let expected = with(&page, &made(&all, &parse(&page))).expect("a place");
        let difference = crate::table::difference(&page, &expected);
        assert_eq!(difference, None, "cargo xtask defects --write makes the page");
    }

    #[test]
    fn each_result_is_what_the_list_says_and_each_miss_explained() {
        let (all, page) = committed();
        let rows = parse(&page);
        for defect in all.iter().filter(|defect| !matches!(defect.origin, Origin::Equivalent(_))) {
            let Plant::Texts(_) = defect.plant else { continue };
            let row = rows.get(&defect.name).filter(|row| !row.by.is_empty());
            let row = row.unwrap_or_else(|| {
                panic!("{} is not measured: cargo xtask defects --write {0}", defect.name)
            });
            assert_eq!(row.is_found(), defect.missed.is_none(), "{}: {}", defect.name, row.by);
            if row.is_found() && defect.invariants != [list::ANY] {
                assert!(defect.invariants.contains(&row.by), "{}: {}", defect.name, row.by);
            }
        }
    }

    fn defects() -> Vec<Defect> {
        let text = r#"[{"name":"x","invariants":["a","b"],"elsewhere":"t","what":"w"},
            {"name":"y","invariants":["b"],"file":"f","from":"1","to":"2","what":"w"},
            {"name":"z","drawn":"limits","file":"f","from":"1","to":"2","what":"v | w","missed":"m"},
            {"name":"e","drawn":"limits","file":"f","from":"1","to":"2","what":"w","equivalent":"p"}]"#;
        list::parse(text).expect("four")
    }

    #[test]
    fn table_reads_back_and_adds_up() {
        let all = defects();
        let all: Vec<&Defect> = all.iter().collect();
        let mut rows = Rows::new();
        rows.insert("y".into(), Row::default().tortured(Some("b"), 7, false, 99.6).unit_tested(false));
        rows.insert("z".into(), Row::default().tortured(None, 300, false, 4000.0).unit_tested(true));
        let text = made(&all, &rows);
        for line in [
            "| x | chosen | a, b | elsewhere: t |  |  |  |",
            "| y | chosen | b | b | 7 | 100 | no |",
            "| z | drawn: limits | any | **nothing** | 300 | 4000 | yes |",
            "| z | v \\| w | m |",
            "| e | w | p |",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}\n{text}");
        }
        assert!(text.starts_with(
            "**Torture alone finds 1 of 2 (50.0 %)** of the defects: 1 of 1 (100.0 %) that were chosen, 0 of 1 (0.0 %) that were drawn. \
             It needs 7 seeds at most; what it misses was played with 300 seeds or more.\nOf the 2 that"
        ), "{text}");
        let page = with(&format!("a\n{BEGIN}old\n{END}b\n"), &text).expect("a place");
        let again = parse(&page);
        assert_eq!((again.get("y"), again.get("z")), (rows.get("y"), rows.get("z")));
        assert!(with("a\n", &text).is_err());
        let json = json(&all, &rows);
        assert_eq!((json["found"].as_u64(), json["rows"][0]["caught_by"].as_str()), (Some(1), Some("b")));
    }
}
