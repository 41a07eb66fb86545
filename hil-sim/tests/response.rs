//! `hil-sim margins` and `hil-sim bode` for a person or a program.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

fn hil_sim(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hil-sim")).args(args).output().expect("the binary starts")
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).expect("text")
}

fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("response-{name}"));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder for the test");
    folder
}

fn file(folder: &Path, name: &str, text: &str) -> String {
    let path = folder.join(name);
    std::fs::write(&path, text).expect("a file for the test");
    path.to_string_lossy().into_owned()
}

#[track_caller]
fn json(args: &[&str]) -> Value {
    let output = hil_sim(args);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    serde_json::from_slice(&output.stdout).expect("one JSON object and nothing else")
}

#[track_caller]
fn assert_near(found: &Value, wanted: f64, tolerance: f64) {
    let number = found.as_f64().unwrap_or(f64::NAN);
    assert!((number - wanted).abs() <= tolerance, "{found}, want {wanted} ± {tolerance}");
}

/// 25/(s³ + 10s² + 10s + 10) in 121 points: frequency, magnitude and unwrapped phase in degrees.
fn third_order() -> Vec<(f64, f64, f64)> {
    let point = |i: i32| {
        let hz = 0.01 * 10f64.powf(f64::from(i) / 40.0);
        let w = TAU * hz;
        let (re, im) = (10.0 - 10.0 * w * w, 10.0 * w - w * w * w);
        (hz, 25.0 / re.hypot(im), -im.atan2(re).to_degrees().rem_euclid(360.0))
    };
    (0..=120).map(point).collect()
}

fn text(header: &str, end: &str, row: impl Fn((f64, f64, f64)) -> String) -> String {
    let rows = third_order().into_iter().map(|point| row(point) + end);
    format!("{header}{end}") + &rows.collect::<String>()
}

#[test]
fn margins_reads_every_form_of_a_response() {
    let folder = folder("forms");
    let parts =
        |(f, m, p): (f64, f64, f64)| format!("{f},{},{}", m * p.to_radians().cos(), m * p.to_radians().sin());
    let wrapped = |p: f64| p - 360.0 * (p / 360.0).round();
    for (name, text) in [
        ("parts.csv", text("freq_hz,re,im", "\n", parts)),
        ("unwrapped.csv", text("freq_hz,mag,phase_deg", "\n", |(f, m, p)| format!("{f},{m},{p}"))),
        ("wrapped.csv", text("freq_hz,mag,phase_deg", "\n", |(f, m, p)| format!("{f},{m},{}", wrapped(p)))),
        (
            "decibels.csv",
            text("freq_hz,mag_db,phase_deg", "\n", |(f, m, p)| format!("{f},{},{p}", 20.0 * m.log10())),
        ),
        (
            "order.csv",
            text("# a loop\n\nnote, Phase_Deg , \"MAG\",freq_hz", "\r\n", |(f, m, p)| {
                format!(" good , {p} , {m} , {f} ")
            }),
        ),
        ("bom.csv", format!("\u{feff}{}# end\n", text("freq_hz,re,im", "\r\n", parts))),
        ("zero.csv", text("freq_hz,re,im\n0,2.5,0", "\n", parts)),
    ] {
        let found = json(&["margins", &file(&folder, name, &text), "--json"]);
        assert_near(&found["phase_margin_deg"], 29.11, 0.02);
        assert_near(&found["gain_margin"], 3.600, 0.002);
        assert_near(&found["ms"], 2.487, 0.002);
        assert_eq!((&found["closed_loop_stable"], &found["points"]), (&true.into(), &121.into()), "{name}");
    }
}

#[test]
fn margins_that_do_not_exist_are_null_with_a_reason() {
    let folder = folder("infinite");
    let rows: String = (1..=50).map(|i| format!("{i},{},-90\n", 2.0 / f64::from(i))).collect();
    let path = file(&folder, "integrator.csv", &format!("freq_hz,mag,phase_deg\n{rows}"));
    let found = json(&["margins", &path, "--json"]);
    assert_near(&found["phase_margin_deg"], 90.0, 1e-6);
    assert_eq!(found["gain_margin"], Value::Null);
    assert!(found["reasons"]["gain_margin"].as_str().is_some_and(|why| why.contains("-180")), "{found}");
    let output = hil_sim(&["margins", &path]);
    assert!(stderr(&output).contains("no gain_margin"), "{}", stderr(&output));
    let text = String::from_utf8(output.stdout).expect("text");
    assert!(text.contains("phase_margin_deg") && text.contains("90.0000 deg"), "{text}");
}

#[test]
fn margins_names_what_is_wrong_with_a_file() {
    let folder = folder("bad");
    let good = "1,1,0\n2,0.5,-90\n3,0.3,-120\n4,0.2,-170\n";
    for (text, line, word) in [
        ("", ":1", "a header and rows"),
        ("freq_hz,mag,phase_deg\n1,1,0\n2,1,0\n3,1,0\n", "", "too few points"),
        ("hz,mag,phase\n1,1,0\n", ":1", "no column freq_hz"),
        ("freq_hz,mag\n1,1\n", ":1", "no column phase_deg"),
        ("freq_hz,re\n1,1\n", ":1", "no column im"),
        ("freq_hz,mag,mag,phase_deg\n1,1,1,1\n", ":1", "the same name"),
        (&format!("freq_hz,mag,phase_deg\n{good}5,NaN,0\n"), ":6", "mag: no number"),
        (&format!("freq_hz,mag,phase_deg\n{good}inf,1,0\n"), ":6", "freq_hz: no number"),
        (&format!("freq_hz,mag,phase_deg\n{good}5,,0\n"), ":6", "mag: an empty cell"),
        (&format!("freq_hz,mag,phase_deg\n{good}5,1;0\n"), ":6", "2 columns"),
        (&format!("freq_hz,mag,phase_deg\n{good}5,many,0\n"), ":6", "mag: no number"),
        (&format!("freq_hz,mag,phase_deg\n{good}4,1,0\n"), ":6", "not above the one before"),
        (&format!("freq_hz,mag,phase_deg\n{good}3.5,1,0\n"), ":6", "not above the one before"),
        (&format!("freq_hz,mag,phase_deg\n-1,1,0\n{good}"), ":2", "not above 0"),
        (&format!("freq_hz,mag,phase_deg\n{good}5,-1,0\n"), ":6", "mag: negative"),
        (&format!("freq_hz,mag,phase_deg\n{good}5,0,0\n"), ":6", "without magnitude"),
    ] {
        let path = file(&folder, "bad.csv", text);
        let output = hil_sim(&["margins", &path, "--json"]);
        let error = stderr(&output);
        assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{text}: {error}");
        assert!(error.contains(&format!("{path}{line}: ")) && error.contains(word), "{text}: {error}");
        assert!(error.contains("next:"), "{error}");
    }
    let missing = hil_sim(&["margins", "no-such-file.csv"]);
    assert_eq!(missing.status.code(), Some(2));
    assert!(stderr(&missing).contains("cannot be read"));
    let binary = folder.join("binary.csv");
    std::fs::write(&binary, [0xff, 0xfe, 0]).expect("a file for the test");
    assert!(stderr(&hil_sim(&["margins", &binary.to_string_lossy()])).contains("no text"));
}

#[test]
fn bode_measures_a_loop_and_its_file_has_the_same_margins() {
    let folder = folder("bode");
    let out = folder.join("out").to_string_lossy().into_owned();
    let args =
        ["bode", "--motor", "tip", "--mode", "position", "--realizations", "4", "--out", &out, "--json"];
    let found = json(&args);
    // docs/response.md.
    assert_near(&found["phase_margin_deg"], 75.0, 6.0);
    assert_near(&found["crossover_hz"], 46.5, 4.0);
    for key in ["disk_margin", "bandwidth_hz", "ms", "noise_level", "nonlinear_level", "phase_margin_std_deg"]
    {
        assert!(found[key].as_f64().is_some_and(|number| number > 0.0), "{key} in {found}");
    }
    assert!(found["noise_level"].as_f64() < found["nonlinear_level"].as_f64(), "halls and friction: {found}");
    let again = json(&["margins", &format!("{out}/frf.csv"), "--json"]);
    for key in ["phase_margin_deg", "crossover_hz", "ms", "disk_margin", "bandwidth_hz"] {
        assert_near(&again[key], found[key].as_f64().expect(key), 1e-9);
    }
    let html = std::fs::read_to_string(format!("{out}/bode.html")).expect("a page");
    assert!(html.contains("<svg") && html.contains("bode --motor tip") && !html.contains("NaN"), "{html}");
    assert_eq!(json(&args), found, "the same seed, the same numbers");
}

/// A recorded first-order lag, 100 Hz: y = 0.9·y₋₁ + 0.5·u₋₁, whose loop with gain 1 crosses 0 dB.
fn recording(rows: usize) -> String {
    let (mut state, mut random, mut text) = (0.0, 1_u64, "time_ms,T,V,setpoint\n".to_owned());
    for i in 0..rows {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let u = (random >> 40) as f64 / f64::from(1 << 23) - 1.0;
        // Closed around it with gain 1, u = r − y.
        text.push_str(&format!("{},{u},{state},{}\n", i * 10, u + state));
        state = 0.9 * state + 0.5 * u;
    }
    text
}

/// |L| = 1 where cos ω = (1 + 0.81 − 0.25)/1.8; then the phase of 1/(z − 0.9).
#[test]
fn bode_from_a_recording_takes_the_open_loop() {
    let folder = folder("recording");
    let path = file(&folder, "trace.csv", &recording(20_000));
    let w = ((1.0 + 0.81 - 0.25) / 1.8_f64).acos();
    let phase = -w.sin().atan2(w.cos() - 0.9).to_degrees();
    let open = json(&["bode", "--from", &path, "--input", "T", "--output", "v", "--json"]);
    // 3 degrees: segments of 2500 samples smear little, and the record is random.
    assert_near(&open["phase_margin_deg"], 180.0 + phase, 3.0);
    assert_near(&open["crossover_hz"], w * 100.0 / TAU, 0.3);
    assert_eq!(open["response"], "open");
    // The loop's set-point to its output is T: the margins are those of L all the same.
    let closed = json(&["bode", "--from", &path, "--input", "setpoint", "--output", "V", "--json"]);
    assert_near(&closed["phase_margin_deg"], 180.0 + phase, 3.0);
    assert_eq!(closed["response"], "closed");
    let twice = json(&["bode", "--from", &path, "--input", "T", "--output", "V", "--gain", "2", "--json"]);
    assert!(twice["crossover_hz"].as_f64() > open["crossover_hz"].as_f64(), "{twice}");
}

#[test]
fn bode_names_what_is_wrong_with_a_recording() {
    let folder = folder("bad-recording");
    let good = recording(600);
    let lines: Vec<&str> = good.lines().collect();
    let without = |rows: std::ops::Range<usize>| {
        lines.iter().enumerate().filter(|(i, _)| !rows.contains(i)).map(|(_, l)| format!("{l}\n")).collect()
    };
    let replaced = |at: usize, with: &str| {
        lines
            .iter()
            .enumerate()
            .map(|(i, l)| format!("{}\n", if i == at { with } else { l }))
            .collect::<String>()
    };
    let still = (0..600).map(|i| format!("{i},0,0\n")).collect::<String>();
    let cases: [(String, &str); 7] = [
        (without(300..324), "a gap of 250 after"),
        (replaced(300, "2980,0,0,0"), "not above the one before"),
        (replaced(300, "2990,NaN,0,0"), "T: no number"),
        (recording(100), "too few rows"),
        (good.replace("time_ms", "when"), "no column time_ms"),
        (good.replace(",T,", ",torque,"), "no column T"),
        (format!("time_ms,T,V\n{still}"), "too few frequencies"),
    ];
    for (text, word) in cases {
        let path = file(&folder, "trace.csv", &text);
        let output = hil_sim(&["bode", "--from", &path, "--input", "T", "--output", "V", "--json"]);
        let error = stderr(&output);
        assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{word}: {error}");
        assert!(error.contains(word) && error.contains(&path), "{word}: {error}");
    }
    for args in [
        &["bode", "--from", "x.csv"][..],
        &["bode", "--input", "T"],
        &["bode", "--amplitude", "0"],
        &["bode", "--amplitude", "NaN"],
        &["bode", "--realizations", "1"],
        &["bode", "--set", "KQ=1"],
        &["bode", "--set", "KPV=0"],
        &["bode", "--amplitude", "0.001"],
    ] {
        let output = hil_sim(args);
        assert_eq!(
            (output.status.code(), output.stdout.len()),
            (Some(2), 0),
            "{args:?}: {}",
            stderr(&output)
        );
    }
}
