//! What is written about a run: the line that replays it, and the report of a replay.

use std::fmt::Write;

use super::case::{Case, Selection};
use super::invariant::excuse::{Excuse, Reach};
use super::invariant::promise::{PROMISES, Promise};
use super::invariant::{self, INVARIANTS, MAY_PRESS};
use super::kinds::{Place, ROWS, Row};
use super::session::Outcome;
use hil_experiment::events::Event;

fn numbers(numbers: &[usize]) -> String {
    if numbers.is_empty() {
        return "none".to_owned();
    }
    numbers.iter().map(usize::to_string).collect::<Vec<_>>().join(",")
}

/// The command that replays a selection of a seed's case.
#[must_use]
pub fn replay_line(case: &Case, selection: &Selection) -> String {
    let mut line = format!("hil-sim torture --seed {}", case.seed);
    if case.is_long {
        line += " --long";
    }
    if let Some(steps) = &selection.steps {
        let _ = write!(line, " --steps {}", numbers(steps));
    }
    if let Some(faults) = &selection.faults {
        let _ = write!(line, " --faults {}", numbers(faults));
    }
    if let Some(stop_ms) = selection.stop_ms {
        let _ = write!(line, " --stop-ms {stop_ms}");
    }
    line + " --replay"
}

/// The report of the replay of a `selection` of a seed's `case`: world, program, faults, failure, and the events of GOD and the boards. Steps
/// and faults have the seed's own numbers, as `--steps` and `--faults` take them.
#[must_use]
pub fn text(case: &Case, selection: &Selection, outcome: &Outcome, events: &[Event]) -> String {
    let mut text = format!("{}\n\n", replay_line(case, selection));
    let mut add = |line: String| {
        text.push_str(&line);
        text.push('\n');
    };
    match &outcome.violation {
        Some(found) => {
            add(format!("FAILED at {} ms: {}", found.ms, found.invariant));
            add(format!("  motor {}: {}", found.node, found.found));
            if let Some(invariant) = invariant::find(found.invariant) {
                add(format!("  demanded: {} ({})", invariant.demands, invariant.source));
            }
        }
        None => {
            let recovered =
                outcome.recovered_ms.map_or_else(String::new, |ms| format!("; recovered after {ms} ms"));
            add(format!("held for {} ms{recovered}", outcome.ms));
        }
    }
    let [winding_c, phase_a, bus_v] = outcome.peaks;
    add(format!("  peaks: winding {winding_c:.1} C, phase {phase_a:.1} A, bus {bus_v:.1} V"));
    let world = &case.world;
    add(format!(
        "\nworld: source {:.2} V, {:.1} A; starts {:?}",
        world.source.0, world.source.1, world.starts
    ));
    if let Some(object) = world.object {
        add(format!("  object: {}", object.lines().next().unwrap_or_default().trim_start_matches("# ")));
    }
    for (motor, (plant, rig)) in world.plants.iter().zip(&world.rigs).enumerate() {
        add(format!(
            "  motor {}: R {:.3} Ohm, Ke {:.4} V s, J {:.2e} kg m2, friction {:.4} N m, halls {:.1?} deg",
            motor + 1,
            plant.r_ohm,
            plant.ke_v_s,
            plant.j_kg_m2,
            plant.coulomb_n_m,
            rig.hall_error_deg
        ));
    }
    add(format!("\nprogram, {}, up to {} ms:", if case.is_plain { "plain" } else { "wild" }, case.stop_ms));
    let own = |chosen: &Option<Vec<usize>>, len: usize| {
        chosen.clone().unwrap_or_else(|| (0..len).collect()).into_iter()
    };
    for (number, step) in own(&selection.steps, case.steps.len()).zip(&case.steps) {
        add(format!("{number:>4} {:>8} ms  {:?}", step.at_ms, step.act));
    }
    add("\nfaults:".to_owned());
    for (number, fault) in own(&selection.faults, case.faults.len()).zip(&case.faults) {
        let Row { name, place, what, .. } = fault.kind.row();
        let place =
            if *place == Place::Motor { format!(" at motor {}", fault.motor + 1) } else { String::new() };
        add(format!("{number:>4} {:>8} ms  {name}{place} for {} ms: {what}", fault.from_ms, fault.for_ms));
    }
    add("\nevents of GOD and the boards, oldest first:".to_owned());
    events.iter().for_each(|event| add(event.to_string()));
    text
}

/// The table of docs/safety.md without its last column, which has what the seeds of ci reach: a promise, its bound, rule and test.
#[must_use]
pub fn promises() -> Vec<String> {
    let row = |promise: &Promise| {
        let Promise { name, what, most, rule, test, .. } = promise;
        format!("| {what} (`{name}`) | {most} | `{rule}` | `{test}` |")
    };
    PROMISES.iter().map(row).collect()
}

/// The tables of docs/torture.md: invariants, their excuses, who may press longer than TSTOP, and kinds of fault.
#[must_use]
pub fn tables() -> String {
    let mut text = String::from("| Invariant | Demands | Source |\n| --- | --- | --- |\n");
    for invariant in INVARIANTS {
        let _ = writeln!(text, "| {} | {} | {} |", invariant.name, invariant.demands, invariant.source);
    }
    let outside = INVARIANTS.iter().filter(|invariant| invariant.is_seen_from_outside());
    let names: Vec<&str> = outside.map(|invariant| invariant.name).collect();
    let _ = writeln!(text, "\nChecked on flashed images as well: {}.", names.join(", "));
    text.push_str("\n| Excused | With | Why, or what holds then |\n| --- | --- | --- |\n");
    for invariant in INVARIANTS {
        for Excuse { faults, reach, why } in invariant.excused_by {
            let part = if *reach == Reach::Part { ", in part" } else { "" };
            let place = if *reach == Reach::Anywhere { " at any motor" } else { "" };
            let kinds: Vec<&str> = faults.rows().map(|row| row.name).collect();
            let _ = writeln!(text, "| {}{part} | {}{place} | {why} |", invariant.name, kinds.join(", "));
        }
    }
    text.push_str("\n| May press longer than TSTOP | Why |\n| --- | --- |\n");
    for right in &MAY_PRESS {
        let _ = writeln!(text, "| {} | {} |", right.who, right.why);
    }
    text.push_str("\n| Fault | Does | Reported by | Cleared by |\n| --- | --- | --- | --- |\n");
    for row in ROWS {
        let _ = writeln!(text, "| {} | {} | {} | {} |", row.name, row.what, row.report, row.clear);
    }
    text
}
