use super::*;

fn parse(text: &str) -> Result<Sweep, BadInput> {
    Sweep::parse("x.toml", text, None, &mut |name| Scenario::text(name))
}

const ALL: &str = r#"
scenario = ["spread-full-travel", "tip-fast"]
seed = 10
repeats = 2
samples = 5

[grid]
set.KP = [100, 120, 140]
supply.volts = { from = 22, to = 26, steps = 2 }

[random]
plant.inertia = { from = "0.5x", to = "2x", scale = "log" }

[latin]
plant.friction = { from = "0.5x", to = "1x" }
set.KD = { from = 100, to = 104 }
"#;

#[test]
fn runs_are_the_product_of_their_sets() {
    let sweep = parse(ALL).expect("valid");
    assert_eq!(sweep.rows(), 2 * 6 * 5 * 2);
    let seen: Vec<Run> = (0..sweep.rows()).map(|index| sweep.run(index)).collect();
    let mut grid: Vec<(usize, u64, u64)> =
        seen.iter().map(|run| (run.entry, run.values[0] as u64, run.values[1] as u64)).collect();
    grid.dedup();
    let of_entry = |entry| [100, 120, 140].into_iter().flat_map(move |kp| [(entry, kp, 22), (entry, kp, 26)]);
    assert_eq!(grid, of_entry(0).chain(of_entry(1)).collect::<Vec<_>>());
    // The draws and seeds of a sample are those of every grid point and scenario.
    for (number, run) in seen.iter().enumerate() {
        let first = &seen[number % 10];
        assert_eq!((&run.values[2..], run.seed), (&first.values[2..], first.seed));
        assert_eq!(run.seed, 10 + number as u64 % 10);
        let [inertia, friction, kd] = run.values[2..] else { panic!("five parameters") };
        assert!((0.5..=2.0).contains(&inertia) && (0.5..=1.0).contains(&friction));
        assert!((100.0..=104.0).contains(&kd) && kd == kd.trunc());
    }
    let mut strata: Vec<u64> = (0..5).map(|sample| seen[2 * sample].values[4] as u64).collect();
    strata.sort_unstable();
    assert_eq!(strata, [100, 101, 102, 103, 104], "each whole number is a stratum");
}

#[test]
fn parameter_has_the_same_draws_beside_others() {
    let alone =
        parse("scenario = 'tip-fast'\nsamples = 4\n[latin]\nplant.inertia = { from = '0.5x', to = '2x' }");
    let beside = parse(
        "scenario = 'tip-fast'\nsamples = 4\n[latin]\nset.KP = { from = 1, to = 9 }\nplant.j_kg_m2 = { from = '0.5x', to = '2x' }",
    );
    let (alone, beside) = (alone.expect("valid"), beside.expect("valid"));
    for index in 0..4 {
        assert_eq!(alone.run(index).values[0], beside.run(index).values[1]);
    }
}

#[test]
fn shards_are_all_runs_once() {
    for (rows, of) in [(10, 3), (2, 5), (u64::MAX >> 1, 7)] {
        let shards: Vec<_> = (1..=of).map(|shard| shard_of(rows, shard, of)).collect();
        assert_eq!((shards[0].start, shards.last().map(|shard| shard.end)), (0, Some(rows)));
        assert!(shards.windows(2).all(|pair| pair[0].end == pair[1].start));
    }
}

#[test]
fn lines_are_the_same_for_any_number_of_threads() {
    let sweep = parse(ALL).expect("valid");
    let lines = |jobs, range| {
        let mut all = String::new();
        let whole = execute(&sweep, range, jobs, "c", &mut |_, line| {
            all.push_str(line);
            Flow::Continue
        });
        assert!(whole.expect("threads"));
        all
    };
    let one = lines(1, 0..24);
    assert_eq!(one.lines().count(), 24);
    assert_eq!(one, lines(3, 0..24));
    assert_eq!(one, lines(2, 0..7) + &lines(2, 7..24));
    let columns = sweep.columns().len();
    for (number, line) in one.lines().enumerate() {
        let fields = fields(line).expect("whole");
        assert_eq!((fields.len(), fields[0].as_str()), (columns, number.to_string().as_str()));
        assert_eq!(fields[2], "", "{line}");
    }
}

#[test]
fn sink_that_stops_gets_no_more_lines() {
    let sweep = parse(ALL).expect("valid");
    let mut seen = 0;
    let whole = execute(&sweep, 0..sweep.rows(), 2, "c", &mut |_, _| {
        seen += 1;
        if seen == 3 { Flow::Stop } else { Flow::Continue }
    });
    assert_eq!((whole.expect("threads"), seen), (false, 3));
}

/// The line of a run gives the scenario that the run has.
#[test]
fn line_of_a_run_reproduces_its_parameters() {
    let sweep = parse(ALL).expect("valid");
    let run = sweep.run(41);
    let line = sweep.line(&run, &str::to_owned, &str::to_owned);
    assert!(
        line.starts_with("hil-sim run spread-full-travel --set KP=140 --supply volts=22 --plant j_kg_m2=")
    );
    let words: Vec<&str> = line.split(' ').collect();
    let mut scenario = Scenario::find(words[2]).expect("shipped");
    for pair in words[3..].chunks(2) {
        match pair {
            ["--set", value] => scenario.set(value).expect("valid"),
            ["--seed", seed] => assert_eq!(seed.parse(), Ok(run.seed)),
            ["--model", model] => assert_eq!(*model, "averaged"),
            [option, value] => scenario.override_figures(&[(&option[2..], value)]).expect("valid"),
            _ => panic!("{line}"),
        }
    }
    let options = Options { seed: run.seed, model: Model::Averaged, trace: false };
    let outcome = hil_experiment::run::run(&scenario, &options).map_err(|e| panic!("{e:?}"));
    let direct = sweep.csv_line(&run, &outcome, "c");
    assert_eq!(direct, sweep.csv_line(&run, &sweep.simulate(&run), "c"));
}

#[test]
fn parameters_that_do_not_fit_together_are_an_error_of_their_run() {
    let sweep =
        parse("scenario = 'tip-fast'\n[grid]\nplant.friction = ['1x', '2x']\nplant.stiction = ['1x', '3x']");
    let sweep = sweep.expect("each is in range");
    let errors: Vec<bool> = (0..4).map(|index| sweep.simulate(&sweep.run(index)).is_err()).collect();
    // Twice the friction is above the stiction, unless that is raised too.
    assert_eq!(errors, [false, false, true, false]);
    let line = sweep.csv_line(&sweep.run(2), &sweep.simulate(&sweep.run(2)), "c");
    assert!(line.starts_with("2,0,") && line.contains("out of range"), "{line}");
    assert_eq!(fields(line.trim_end()).map(|fields| fields.len()), Some(sweep.columns().len()));
}

#[test]
fn bad_sweeps_name_line_problem_and_next_step() {
    let head = "scenario = 'tip-fast'\n";
    for (text, place, problem, next) in [
        ("", "x.toml:1", "scenario is missing", "add scenario"),
        ("scenario = []", "x.toml:1", "empty list", "hil-sim list"),
        ("scenario = 3", "x.toml:1", "no text", "hil-sim list"),
        ("scenario = 'tip-fats'", "x.toml:1", "no scenario", "did you mean tip-fast?"),
        ("scenario = ['tip-fast', 'tip-fast']", "x.toml:1", "named twice", ""),
        (&format!("{head}repeats = 0"), "x.toml:2", "repeats is below 1", ""),
        (&format!("{head}samples = 3"), "x.toml:2", "draw nothing", "use repeats"),
        (&format!("{head}model = 'exact'"), "x.toml:2", "model is unknown", ""),
        (&format!("{head}grids = 1"), "x.toml:2", "unknown field", "did you mean grid"),
        (&format!("{head}[grid]\nset.KQ = 1"), "x.toml:3", "set has no KQ", "use one of those"),
        (&format!("{head}[grid]\nplant.inertai = 1"), "x.toml:3", "no inertai", "did you mean inertia?"),
        (&format!("{head}[grid]\nset.KP = []"), "x.toml:3", "empty list", "give a value"),
        (&format!("{head}[grid]\nset.KP = [1, 1]"), "x.toml:3", "twice", ""),
        (&format!("{head}[grid]\nset.KP = ['2x']"), "x.toml:3", "no whole number", "round"),
        (&format!("{head}[grid]\nset.KP = 1e9"), "x.toml:3", "out of range", ""),
        (&format!("{head}[grid]\nsupply.volts = [20, 99]"), "x.toml:3", "out of range", ""),
        (
            &format!("{head}[grid]\nplant.friction = '2x'"),
            "x.toml:3",
            "out of range",
            "override that as well",
        ),
        (&format!("{head}[grid]\nplant.inertia = [1e-5, '1x']"), "x.toml:3", "mixes", "1x"),
        (&format!("{head}[grid]\nplant.inertia = true"), "x.toml:3", "no number", ""),
        (&format!("{head}[grid]\nset.KP = {{ from = 1, to = 2 }}"), "x.toml:3", "lacks steps", ""),
        (&format!("{head}[grid]\nset.KP = {{ from = 1, to = 2, steps = 9 }}"), "x.toml:3", "twice", ""),
        (
            &format!("{head}[random]\nset.KP = {{ from = 1, to = 2 }}"),
            "x.toml:3",
            "need samples",
            "samples =",
        ),
        (&format!("{head}samples = 2\n[random]\nset.KP = 1"), "x.toml:4", "no interval", "[grid]"),
        (
            &format!("{head}samples = 2\n[random]\nset.KP = {{ from = 2, to = 1 }}"),
            "x.toml:4",
            "not below",
            "",
        ),
        (
            &format!("{head}samples = 2\n[latin]\nset.KP = {{ from = 0, to = 1, scale = 'log' }}"),
            "x.toml:4",
            "log",
            "linear",
        ),
        (
            &format!("{head}samples = 2\n[grid]\nset.KP = 1\n[latin]\nset.kp = {{ from = 0, to = 1 }}"),
            "x.toml:6",
            "varied twice",
            "",
        ),
        (
            &format!(
                "{head}samples = 9000000000000000000\nrepeats = 9\n[latin]\nset.KP = {{ from = 0, to = 1 }}"
            ),
            "x.toml:1",
            "above 2^63",
            "",
        ),
    ] {
        let error = parse(text).expect_err(text).to_string();
        assert!(error.starts_with(place), "{text}\n{error}");
        assert!(error.contains(problem) && error.contains(next), "{text}\n{error}");
    }
    let low = parse("scenario = 'coast-low-ke'\n[grid]\nsupply.volts = 24");
    assert!(low.is_ok());
}
