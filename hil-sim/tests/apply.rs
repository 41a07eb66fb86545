//! `hil-sim export` and `apply` from the command line, with boards of `hil-sim bus`.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::thread::{JoinHandle, spawn};

use serde_json::Value;

use crate::served::{Served, damaging, serve};

/// A folder with the result of a tune.
fn folder(name: &str, motors: &[(&str, &str)]) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(folder.join("out")).expect("a folder for the test");
    write_result(&folder, motors, "");
    let (code, _, errors) = hil_sim(&folder, "export out --to tuned.json");
    assert_eq!(code, Some(0), "{errors}");
    folder
}

fn write_result(folder: &Path, motors: &[(&str, &str)], broken: &str) {
    let passed = broken.is_empty();
    let motor = |(motor, properties): &(&str, &str)| {
        format!(
            r#"{{"motor":"{motor}","passed":{passed},"properties":{{{properties}}},"start":{{"KP":120}},"set":{{}},
            "validation":{{"plants":1000,"first_seed":524288,"cost_start":0.5,"cost_tuned":0.4,"broken":[{broken}]}}}}"#
        )
    };
    let motors: Vec<String> = motors.iter().map(motor).collect();
    let text = format!(
        r#"{{"commit":"unknown","passed":{passed},"reproduce":"hil-sim tune","motors":[{}]}}"#,
        motors.join(",")
    );
    std::fs::write(folder.join("out").join("tuned.json"), text).expect("ours");
}

fn hil_sim(folder: &Path, line: &str) -> (Option<i32>, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
    let Output { status, stdout, stderr } =
        command.args(line.split(' ')).current_dir(folder).output().expect("the binary starts");
    let text = |bytes| String::from_utf8(bytes).expect("text");
    (status.code(), text(stdout), text(stderr))
}

/// Runs `apply` with `--json`: its exit code, its object, and standard error.
fn apply(folder: &Path, line: &str) -> (Option<i32>, Value, String) {
    let (code, out, errors) = hil_sim(folder, &format!("apply {line} --json"));
    (code, serde_json::from_str(&out).unwrap_or_else(|e| panic!("{e}: {out}{errors}")), errors)
}

/// Old and new value of a property on the board at an index.
fn change(object: &Value, board: usize, property: &str) -> (i64, i64) {
    let changes = object["boards"][board]["changes"].as_array().expect("changes");
    let change = changes.iter().find(|change| change["property"] == property).expect(property);
    (change["old"].as_i64().expect("a number"), change["new"].as_i64().expect("a number"))
}

const LINK: [(&str, &str); 1] = [("link", r#""KP":150,"KI":7,"KD":700"#)];

#[test]
fn undo_after_two_applies_brings_back_the_values_before_the_first() {
    let folder = folder("apply-undo", &LINK);
    let served = serve("1-3");
    let to = format!("tuned.json --slcan {}", served.address);
    let undo_file = folder.join("tuned.json.undo.json");

    let (code, shown, errors) = apply(&folder, &format!("{to} --dry-run"));
    assert_eq!((code, shown["done"].as_bool()), (Some(0), Some(false)), "{errors}");
    assert!(errors.contains("node 1 is asleep") && !undo_file.exists(), "{errors}");
    assert_eq!(change(&shown, 2, "KP"), (120, 150));

    let (code, out, errors) = hil_sim(&folder, &format!("apply {to}"));
    assert_eq!(code, Some(0), "{errors}");
    for line in
        ["node 1, link", "  KP        120 -> 150", "take them back with: cargo xtask apply tuned.json --undo"]
    {
        assert!(out.contains(line), "{out}");
    }
    let kept = std::fs::read_to_string(&undo_file).expect("written");
    write_result(&folder, &[("link", r#""KP":180,"KPV":40"#)], "");
    let (code, _, errors) = hil_sim(&folder, "export out --to tuned.json");
    assert_eq!(code, Some(0), "{errors}");
    let (code, again, errors) = apply(&folder, &to);
    assert_eq!(code, Some(0), "{errors}");
    assert_eq!((change(&again, 0, "KP"), change(&again, 0, "KPV")), ((150, 180), (32, 40)));
    let more = std::fs::read_to_string(&undo_file).expect("written");
    assert_ne!(kept, more, "KPV is kept too");

    // The adapter is that of the apply.
    let (code, undone, errors) = apply(&folder, "--undo --node 2");
    assert_eq!(code, Some(0), "{errors}");
    assert_eq!((change(&undone, 0, "KP"), change(&undone, 0, "KPV")), ((180, 120), (40, 32)));
    let (code, undone, errors) = apply(&folder, "--undo");
    assert_eq!(code, Some(0), "{errors}");
    assert_eq!(undone["boards"].as_array().map(Vec::len), Some(2), "node 2 is done");
    assert!(!undo_file.exists());
    let (_, shown, _) = apply(&folder, &format!("{to} --dry-run"));
    for board in 0..3 {
        assert_eq!((change(&shown, board, "KP"), change(&shown, board, "KPV")), ((120, 180), (32, 40)));
    }
    let (code, _, errors) = hil_sim(&folder, "apply --undo");
    assert_eq!(code, Some(2), "{errors}");
    assert!(errors.contains("tuned.json.undo.json: there is nothing to take back"), "{errors}");
}

#[test]
fn missing_board_or_motor_is_named_and_nothing_is_written() {
    let folder = folder("apply-missing", &[LINK[0], ("tip", r#""KP":90"#)]);
    let served = serve("1,2,4");
    let to = format!("tuned.json --slcan {}", served.address);
    for (more, what) in [
        ("", "node 3: no answer about STAT"),
        (" --node 1 --node 5", "node 5: no answer"),
        (" --node 4", "no values for node 4"),
        (" --node 9", "node 9: no answer"),
    ] {
        let (code, out, errors) = hil_sim(&folder, &format!("apply {to}{more}"));
        assert_eq!(code, Some(2), "{errors}");
        assert!(errors.contains(what) && errors.contains("next:") && out.is_empty(), "{out}{errors}");
    }
    assert!(!folder.join("tuned.json.undo.json").exists());
    let (code, done, errors) = apply(&folder, &format!("{to} --node 1 --node 2"));
    assert_eq!(code, Some(0), "{errors}");
    assert_eq!(change(&done, 0, "KP"), (120, 150), "nothing was written before");
    assert!(errors.contains("tip is left out"), "{errors}");
}

#[test]
fn bad_files_are_refused_before_a_board_is_asked() {
    let folder = folder("apply-files", &LINK);
    let text = std::fs::read_to_string(folder.join("tuned.json")).expect("exported");
    let put = |name: &str, text: &str| std::fs::write(folder.join(name), text).expect("ours");
    put("cut.json", &text[..text.len() / 2]);
    put("range.json", &text.replace("150", "99999"));
    put("failed.json", &text.replace("\"passed\": true", "\"passed\": false"));
    for (file, what) in [
        ("cut.json", "ends too early"),
        ("range.json", "KP from 0 to 32767"),
        ("failed.json", "did not pass its validation"),
        ("out/tuned.json", "hil-sim export"),
        ("none.json", "cannot be read"),
    ] {
        // Nobody listens there: the file is read first.
        let (code, out, errors) = hil_sim(&folder, &format!("apply {file} --slcan 127.0.0.1:1"));
        assert_eq!(code, Some(2), "{errors}");
        assert!(errors.contains(what) && errors.contains(file) && out.is_empty(), "{out}{errors}");
    }
    let (code, _, errors) = hil_sim(&folder, "apply tuned.json --slcan 127.0.0.1:1");
    assert_eq!(code, Some(2), "{errors}");
    assert!(errors.contains("--slcan 127.0.0.1:1"), "{errors}");
    let (code, _, errors) = hil_sim(&folder, "apply tuned.json");
    assert!(code == Some(2) && errors.contains("--slcan"), "{errors}");
}

#[test]
fn export_refuses_what_did_not_pass_and_its_own_source() {
    let folder = folder("export", &LINK);
    let before = std::fs::read_to_string(folder.join("tuned.json")).expect("exported");
    write_result(&folder, &LINK, r#"{"objective":"move","seed":524300,"what":"a false stall"}"#);
    for (line, what) in [
        ("export out --to tuned.json", "link did not pass its validation"),
        ("export out --to tuned.json", "move on the plant of seed 524300: a false stall"),
        ("export nothing --to tuned.json", "nothing/tuned.json: cannot be read"),
    ] {
        let (code, out, errors) = hil_sim(&folder, line);
        assert_eq!(code, Some(2), "{errors}");
        assert!(errors.contains(what) && out.is_empty(), "{out}{errors}");
    }
    assert_eq!(std::fs::read_to_string(folder.join("tuned.json")).expect("kept"), before);
    write_result(&folder, &LINK, "");
    let (code, _, errors) = hil_sim(&folder, "export out --to out/tuned.json");
    assert!(code == Some(2) && errors.contains("would overwrite the result"), "{errors}");
}

/// Passes lines on between a client and a bus, until a frame that begins so: then both are cut off. Returns its address.
fn cut_at(bus: &str, frame: &'static str) -> (String, JoinHandle<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("bound").to_string();
    let bus = TcpStream::connect(bus).expect("the bus listens");
    let passing = spawn(move || {
        let (client, _) = listener.accept().expect("apply connects");
        let (mut from, mut to) = (bus.try_clone().expect("a stream"), client.try_clone().expect("a stream"));
        let back = spawn(move || std::io::copy(&mut from, &mut to));
        let (mut lines, mut bus) = (BufReader::new(client.try_clone().expect("a stream")), bus);
        let mut line = Vec::new();
        while lines.read_until(b'\r', &mut line).is_ok_and(|len| len > 0)
            && !line.starts_with(frame.as_bytes())
        {
            bus.write_all(&line).expect("the bus reads");
            line.clear();
        }
        let _ = bus.shutdown(std::net::Shutdown::Both);
        let _ = client.shutdown(std::net::Shutdown::Both);
        let _ = back.join();
    });
    (address, passing)
}

#[test]
fn power_cut_between_set_and_save_keeps_the_way_back() {
    let folder = folder("apply-power", &LINK);
    let served = serve("1-2");
    // Node 1's first SAVE: identifier 001, SET of property 30.
    let (address, passing) = cut_at(&served.address, "t00149E");
    let (code, object, errors) = apply(&folder, &format!("tuned.json --slcan {address} --node 1 --node 2"));
    passing.join().expect("no panic");
    assert_eq!((code, object["done"].as_bool()), (Some(1), Some(false)), "{errors}");
    assert!(object["problem"].as_str().is_some_and(|text| text.contains("adapter is lost")), "{object}");
    assert_eq!(object["boards"][0]["state"], "unknown");
    assert_eq!(object["boards"][1]["state"], "unknown, stored values old");
    assert!(errors.contains("node 2 may hold new values until its next reset"), "{errors}");
    assert!(errors.contains("cargo xtask apply tuned.json --undo"), "{errors}");
    let kept = std::fs::read_to_string(folder.join("tuned.json.undo.json")).expect("kept");
    assert!(kept.contains("\"KP\": 120") && !kept.contains("\"KP\": 150"), "{kept}");
    // The boards lose their power too.
    drop(served);
    let served = serve("1-2");
    let (code, object, errors) = apply(&folder, &format!("--undo --slcan {}", served.address));
    assert_eq!(code, Some(0), "{errors}");
    assert_eq!(change(&object, 0, "KP"), (120, 120), "nothing had been stored");
    assert!(!folder.join("tuned.json.undo.json").exists());
}

/// Sends a frame over a bus as another host, and waits for the adapter's acknowledgment.
fn send(served: &Served, frame: &str) {
    let mut stream = TcpStream::connect(&served.address).expect("connected");
    stream.write_all(format!("\rS8\rO\r{frame}\rV\r").as_bytes()).expect("written");
    let (mut text, mut byte) = (String::new(), [0]);
    while !text.ends_with("V0100\r") {
        assert_eq!(stream.read(&mut byte).expect("read"), 1, "hung up after {text:?}");
        text.push(char::from(byte[0]));
    }
}

#[test]
fn board_that_drives_its_motor_is_left_alone() {
    let folder = folder("apply-moves", &[("spread", r#""KP":150"#)]);
    let served = serve("4");
    let to = format!("tuned.json --slcan {}", served.address);
    let (code, _, errors) = apply(&folder, &format!("{to} --dry-run"));
    assert_eq!(code, Some(0), "{errors}");
    // MODE 3: it holds its position.
    send(&served, "t004488000300");
    let (code, out, errors) = hil_sim(&folder, &format!("apply {to}"));
    assert_eq!(code, Some(2), "{errors}");
    assert!(errors.contains("node 4: it drives its motor (MODE 3)") && out.is_empty(), "{out}{errors}");
    send(&served, "t004488000000");
    let (code, done, errors) = apply(&folder, &to);
    assert_eq!((code, change(&done, 0, "KP")), (Some(0), (120, 150)), "{errors}");
}

/// In the way back "old" would mean the wrong values.
#[test]
fn undo_that_is_cut_off_says_that_the_applied_values_are_stored() {
    let folder = folder("apply-undo-power", &LINK);
    let served = serve("1-2");
    let (code, _, errors) =
        apply(&folder, &format!("tuned.json --slcan {} --node 1 --node 2", served.address));
    assert_eq!(code, Some(0), "{errors}");
    let (address, passing) = cut_at(&served.address, "t00149E");
    let (code, object, errors) = apply(&folder, &format!("--undo --slcan {address}"));
    passing.join().expect("no panic");
    assert_eq!((code, &object["boards"][1]["state"]), (Some(1), &"unknown, stored values old".into()));
    for words in [
        "node 1 may hold and have stored some of the values from before the apply",
        "node 2 may hold values from before the apply until its next reset; its storage has the applied ones",
        "tuned.json.undo.json has the values from before the apply",
    ] {
        assert!(errors.contains(words), "{errors}");
    }
    let (code, object, errors) = apply(&folder, &format!("--undo --slcan {}", served.address));
    assert_eq!((code, change(&object, 1, "KP").1), (Some(0), 120), "{errors}");
}

#[test]
fn board_with_another_hands_units_is_named() {
    let folder = folder("apply-units", &LINK);
    let served = serve("1");
    let to = format!("tuned.json --slcan {} --node 1", served.address);
    let (code, _, errors) = apply(&folder, &format!("{to} --dry-run"));
    assert_eq!(code, Some(0), "{errors}");
    // HOSTUNITS 280.
    send(&served, "t0014FF001801");
    for line in [format!("apply {to}"), format!("log --slcan {} --seconds 0.1 --out log.csv", served.address)]
    {
        let (code, out, errors) = hil_sim(&folder, &line);
        assert!(code == Some(2) && out.is_empty() && errors.contains("HOSTUNITS"), "{line}: {out}{errors}");
    }
    assert!(!folder.join("tuned.json.undo.json").exists() && !folder.join("log.csv").exists());
}

/// KP 120 with a stray digit is −32729, which `apply` once kept as an old value, and its undo then refused.
#[test]
fn damaged_answers_are_neither_kept_nor_written() {
    let folder = folder("apply-damage", &LINK);
    let served = serve("1");
    let to = format!("tuned.json --slcan {} --node 1", damaging(&served.address));
    let undo_file = folder.join("tuned.json.undo.json");
    let (code, done, errors) = apply(&folder, &to);
    assert_eq!((code, change(&done, 0, "KP")), (Some(0), (120, 150)), "{errors}");
    let kept = std::fs::read_to_string(&undo_file).expect("written");
    assert!(kept.contains("\"KP\": 120"), "{kept}");
    let (code, undone, errors) = apply(&folder, "--undo");
    assert_eq!((code, change(&undone, 0, "KP")), (Some(0), (150, 120)), "{errors}");
    assert!(!undo_file.exists());
}
