//! `report.html` of `hil-sim tune --out`: the result, the candidates, and what the ensemble does before and after.

use serde_json::Value;

use charts::{Alarm, Chart, Explore, Field, Marked, Series, Sheet, escape, trade_off};
use hil_tuning::bode::page;
use hil_tuning::tune::{
    Axis, Bands, Candidate, Envelope, Found, Goal, LEAST_PHASE_DEG, MOST_MS, Point, Term,
};

/// Candidates in the chart: the best ones.
const MOST_SHOWN: usize = 2000;

/// Plants whose bands are drawn.
pub const PLANTS: u64 = 40;

/// What the page shows of a motor beside its part of the JSON object.
pub struct Drawn<'a> {
    pub found: &'a Found,
    pub axes: &'a [Axis],
    pub goals: &'a [Goal],
    pub envelopes: &'a [Envelope],
}

/// The page of a result; `object` is that of `--json`, with the motors in the same order.
pub fn html(object: &Value, motors: &[Drawn]) -> String {
    let mut sheet = Sheet::new("Tuning");
    let (badge, verdict) = badge(&object["passed"]);
    sheet.push(&format!(
        "<header><h1>Tuning <span class=\"badge {badge}\">{verdict}</span></h1>\n<p><code>{}</code></p></header>\n",
        escape(object["reproduce"].as_str().unwrap_or_default())
    ));
    sheet.help();
    let all = object["motors"].as_array().map_or(&[][..], Vec::as_slice);
    for (json, drawn) in all.iter().zip(motors) {
        motor(&mut sheet, json, drawn);
    }
    sheet.finish()
}

fn badge(passed: &Value) -> (&'static str, &'static str) {
    if passed == true { ("good", "passed") } else { ("bad", "refused") }
}

fn motor(sheet: &mut Sheet, json: &Value, drawn: &Drawn) {
    let name = json["motor"].as_str().unwrap_or_default();
    let (class, verdict) = badge(&json["passed"]);
    sheet.push(&format!("<h2>{} <span class=\"badge {class}\">{verdict}</span></h2>\n", escape(name)));
    let validation = &json["validation"];
    let tile = |value: String, unit: &str, label: &str| {
        format!("<div class=\"tile\"><b>{value}</b> <span>{unit}</span><br><small>{label}</small></div>\n")
    };
    let percent = validation["improvement_percent"].as_f64();
    let edge = json["stability"]["edge_factor"].as_f64();
    let back = json["stability"]["backed_off_by"].as_f64().unwrap_or(1.0);
    let tiles = [
        tile(
            percent.map_or_else(|| "–".to_owned(), |percent| format!("{percent:.1}")),
            "%",
            "less cost on unseen plants",
        ),
        tile(count(&validation["plants"]), "", "unseen plants"),
        tile(validation["broken"].as_array().map_or(0, Vec::len).to_string(), "", "broken limits there"),
        tile(
            edge.map_or_else(|| "> 4".to_owned(), |edge| format!("{edge:.2}")),
            "×",
            "all gains until the edge",
        ),
        tile(format!("{back:.2}"), "×", "backed off"),
        tile(count(&json["candidates"]), "", "candidates"),
        tile(count(&json["runs"]), "", "runs"),
    ];
    sheet.push(&format!("<div class=\"tiles\">\n{}</div>\n", tiles.concat()));
    let rows: Vec<Vec<String>> = drawn
        .axes
        .iter()
        .map(|axis| {
            let of = |key: &str| count(&json[key][axis.property.name]);
            vec![axis.property.name.to_owned(), of("start"), of("best_before_back_off"), of("properties")]
        })
        .collect();
    sheet.push("<h3>Properties</h3>\n");
    sheet.table(&["", "before", "best", "tuned"], &rows, 1);
    for broken in validation["broken"].as_array().into_iter().flatten().take(5) {
        sheet.push(&format!(
            "<p class=\"note\">plant {}, {}: {}</p>\n",
            broken["seed"],
            escape(broken["objective"].as_str().unwrap_or_default()),
            escape(broken["what"].as_str().unwrap_or_default())
        ));
    }
    terms(sheet, &json["terms"]);
    sheet.push("<h3>Before and after</h3>\n");
    for envelope in drawn.envelopes {
        bands(sheet, name, envelope);
    }
    loops(sheet, name, drawn.found);
    guards(sheet, drawn.found);
    candidates(sheet, drawn);
}

/// The loops with the tuned values, each on the plant on which it is nearest to instability.
fn loops(sheet: &mut Sheet, motor: &str, found: &Found) {
    for margins in &found.margins {
        let Some(response) = &margins.response else { continue };
        let phase =
            margins.phase_margin_deg.map_or_else(|| "none".to_owned(), |deg| format!("{deg:.1} degrees"));
        sheet.push(&format!(
            "<h3>The {} loop</h3>\n<p class=\"note\">Drawn on plant {}, which has the largest Ms of {}: {:.2}. Least phase margin of \
             all: {phase}; wanted are {LEAST_PHASE_DEG} degrees and an Ms of {MOST_MS} at most.</p>\n",
            margins.of.name(),
            margins.seed,
            margins.plants,
            margins.ms
        ));
        page::charts(sheet, &format!("{motor} {} loop", margins.of.name()), response);
    }
}

/// What TSTOP and BT trade.
fn guards(sheet: &mut Sheet, found: &Found) {
    let curves: Vec<(String, Vec<Alarm>)> = found
        .trade_offs
        .iter()
        .map(|trade| {
            let alarm = |point: &Point| {
                let (delay_ms, _) = point.delay_ms?;
                let setting = format!("{}={}", trade.property.name, point.value);
                Some(Alarm { setting, delay_ms, alarms: point.alarms, hours: point.motion_s / 3600.0 })
            };
            (trade.property.name.to_owned(), trade.points.iter().filter_map(alarm).collect())
        })
        .collect();
    if !curves.is_empty() {
        trade_off(sheet, "False alarms against delay", &curves);
    }
}

/// The terms of the cost on the unseen plants: distance from the target over its scale, as numbers and bars.
fn terms(sheet: &mut Sheet, terms: &Value) {
    let terms = terms.as_array().map_or(&[][..], Vec::as_slice);
    let cost = |term: &Value, when: &str| {
        let scale = term["scale"].as_f64().unwrap_or(1.0);
        term[when]["mean"].as_f64().unwrap_or(0.0) / scale
    };
    let most = terms.iter().flat_map(|term| [cost(term, "start"), cost(term, "tuned")]).fold(0.0, f64::max);
    let bar = |class: &str, cost: f64| {
        let width = 100.0 * cost / most.max(f64::MIN_POSITIVE);
        format!("<span class=\"bar {class}\" style=\"width:{width:.1}%\"></span>")
    };
    sheet.push(
        "<h3>Terms of the cost on unseen plants</h3>\n<p class=\"note\">Distance from the target; the bars are means over the term's \
         scale: <span class=\"key c2\"></span>before, <span class=\"key c1\"></span>tuned.</p>\n\
         <div class=\"table\"><table>\n<tr><th>term</th><th></th><th class=\"n\">mean before</th><th class=\"n\">tuned</th>\
         <th class=\"n\">worst before</th><th class=\"n\">tuned</th></tr>\n",
    );
    for term in terms {
        let better = |key: &str| {
            let [before, after] = ["start", "tuned"].map(|when| term[when][key].as_f64().unwrap_or(0.0));
            match after.total_cmp(&before) {
                std::cmp::Ordering::Less => " better",
                std::cmp::Ordering::Greater => " worse",
                std::cmp::Ordering::Equal => "",
            }
        };
        let from = term["from_ms"].as_u64().filter(|from| *from > 0);
        let from = from.map_or_else(String::new, |ms| format!(", from {ms} ms"));
        sheet.push(&format!(
            "<tr><td>{} {}{from}</td><td class=\"bars\">{}{}</td><td class=\"n\">{}</td><td class=\"n{}\">{}</td>\
             <td class=\"n\">{}</td><td class=\"n{}\">{}</td></tr>\n",
            escape(term["objective"].as_str().unwrap_or_default()),
            escape(term["metric"].as_str().unwrap_or_default()),
            bar("c2", cost(term, "start")),
            bar("c1", cost(term, "tuned")),
            number(&term["start"]["mean"]),
            better("mean"),
            number(&term["tuned"]["mean"]),
            number(&term["start"]["worst"]),
            better("worst"),
            number(&term["tuned"]["worst"]),
        ));
    }
    sheet.push("</table></div>\n");
}

fn bands(sheet: &mut Sheet, motor: &str, envelope: &Envelope) {
    let Envelope { objective, title, unit, plants, times, before, after } = envelope;
    let title = format!("{objective}: {title}");
    let mut chart = Chart::new(&title, &format!("{unit}, {plants} plants"), "ms");
    (chart.height, chart.least_span) = (260.0, 0.5);
    chart.x.group = Some(format!("{motor} {objective} over time"));
    let x = sheet.column(times.clone(), Some(0));
    for (name, class, bands) in [("before", "c2", before), ("tuned", "c1", after)] {
        let bands: &Bands = bands;
        let [least, lower, median, upper, most] =
            [0, 1, 2, 3, 4].map(|at| sheet.column(bands[at].clone(), Some(3)));
        chart.series.push(Series::band(&format!("{name}: all"), &format!("{class} faint"), x, least, most));
        chart.series.push(Series::band(&format!("{name}: half of them"), class, x, lower, upper));
        chart.series.push(Series::line(&format!("{name}: median"), class, x, median));
    }
    sheet.chart(&chart);
}

/// Every candidate: means of the terms and values of the properties, against each other.
fn candidates<'a>(sheet: &mut Sheet, drawn: &Drawn<'a>) {
    let Found { archive, start, tuned, .. } = drawn.found;
    let whole = archive.iter().filter(|candidate| candidate.judged.broken.is_empty());
    let mut shown: Vec<&Candidate> = whole.collect();
    let all = shown.len();
    shown.truncate(MOST_SHOWN);
    let mut place = |wanted: &'a Candidate| {
        let found = shown.iter().position(|candidate: &&Candidate| candidate.values == wanted.values);
        found.unwrap_or_else(|| {
            shown.push(wanted);
            shown.len() - 1
        })
    };
    let (start, tuned) = (place(start), place(tuned));
    let mut fields = Vec::new();
    let mut field = |name: String, unit: &str, axis: bool, of: &dyn Fn(&Candidate) -> Option<f64>| {
        let values = shown.iter().map(|candidate| of(candidate).map_or(f64::NAN, rounded)).collect();
        fields.push(Field { name, unit: unit.to_owned(), column: sheet.column(values, None), axis });
    };
    for (index, axis) in drawn.axes.iter().enumerate() {
        let value = |candidate: &Candidate| candidate.values.get(index).map(|value| *value as f64);
        field(axis.property.name.to_owned(), "", true, &value);
    }
    field("cost".to_owned(), "", false, &|candidate| Some(candidate.judged.cost));
    let terms: Vec<&Term> = drawn.goals.iter().flat_map(|goal| &goal.terms).collect();
    for (index, term) in terms.iter().enumerate() {
        let name = match term.window.from_ms {
            0 => format!("{} {}", term.objective, term.metric.name),
            from => format!("{} {} from {from} ms", term.objective, term.metric.name),
        };
        let mean = |candidate: &Candidate| candidate.judged.terms.get(index).map(|spread| spread.mean);
        field(name, term.metric.unit(), false, &mean);
    }
    let axes = drawn.axes.len();
    let of = |name: &str| terms.iter().position(|term| term.metric.name == name).map(|at| axes + 1 + at);
    let up = of("tracking_rms_counts").or_else(|| of("settling_ms")).unwrap_or(axes + 1);
    let x = of("chatter").filter(|x| *x != up).unwrap_or(axes);
    let (Some(across), Some(upwards)) = (fields.get(x), fields.get(up)) else { return };
    sheet.push(&format!(
        "<h3>Candidates</h3>\n<p class=\"note\">{} of {all} candidates that ran on the whole ensemble of the search and broke no limit; \
         means over its plants. Between two metrics the line joins the candidates of which no other is better in both.</p>\n",
        shown.len()
    ));
    let mut chart =
        Chart::new(&format!("{} against {}", upwards.name, across.name), &upwards.unit, &across.name);
    chart.height = 340.0;
    chart.series.push(Series::points("runs", "c4 small", across.column, upwards.column, Vec::new()));
    let marked = [(start, "before", "c2 large"), (tuned, "tuned", "c1 large")];
    let marked = marked.map(|(row, name, class)| Marked { row, name: name.to_owned(), class }).into();
    chart.explore = Some(Explore { fields, run: None, marked, x, y: up });
    sheet.chart(&chart);
}

/// To seven digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.6e}").parse().unwrap_or(value)
}

fn number(value: &Value) -> String {
    value.as_f64().map_or_else(|| "–".to_owned(), |value| format!("{value:.3}"))
}

fn count(value: &Value) -> String {
    if value.is_null() { "–".to_owned() } else { value.to_string() }
}
