//! The charts of a shipped scenario as one SVG file, for documents:
//! `cargo run --release -p hil-sim --example picture -- spread-full-travel Position Velocity > docs/spread-full-travel.svg`

use hil_experiment::page;
use hil_experiment::run::{Options, run};
use hil_experiment::scenario::Scenario;
use hil_world::plant::Model;

fn between<'a>(text: &'a str, start: &str, end: &str) -> Option<&'a str> {
    let from = text.find(start)? + start.len();
    Some(&text[from..from + text[from..].find(end)?])
}

fn picture(name: &str, charts: &[String]) -> Result<String, Box<dyn std::error::Error>> {
    let scenario = Scenario::find(name)?;
    let outcome = run(&scenario, &Options { seed: 1, model: Model::Averaged, trace: true })?;
    let page = page::html(&scenario, &outcome);
    let style = between(&page, "<style>", "</style>").ok_or("the report has no style")?;
    let (mut body, mut y) = (String::new(), 0.0);
    for chart in charts {
        let start = page
            .match_indices("<svg viewBox=\"0 0 ")
            .map(|(at, _)| &page[at..])
            .find(|svg| between(svg, "aria-label=\"", "\"") == Some(chart))
            .ok_or_else(|| format!("the report of {name} has no chart {chart}"))?;
        let size = between(start, "viewBox=\"0 0 ", "\"").ok_or("a chart has no size")?;
        let (width, height) = size.split_once(' ').ok_or("a chart's size is two numbers")?;
        let inside = between(start, ">", "</svg>").ok_or("a chart does not end")?;
        body += &format!(
            "<svg y=\"{y}\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {size}\">{inside}</svg>\n"
        );
        y += height.parse::<f64>()? + 10.0;
    }
    Ok(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 1060 {y}\" \
         font-family=\"system-ui, 'DejaVu Sans', sans-serif\">\n<style>{style}</style>\n\
         <rect width=\"100%\" height=\"100%\" fill=\"var(--card)\"/>\n{body}</svg>"
    ))
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let Some((name, charts)) = words.split_first().filter(|(_, charts)| !charts.is_empty()) else {
        eprintln!("usage: picture SCENARIO CHART...\n  CHART: a chart's title, such as Position");
        std::process::exit(2);
    };
    match picture(name, charts) {
        Ok(svg) => println!("{svg}"),
        Err(error) => {
            eprintln!("{error}");
            std::process::exit(2);
        }
    }
}
