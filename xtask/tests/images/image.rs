//! Files and output of `cargo xtask image`.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};
use tater_f103::map::MAP;
use tater_wire::image::{Crc32, Header};

use super::{Bench, elf};

/// Exit code, standard output and standard error.
fn run(mut command: Command) -> (Option<i32>, String, String) {
    let output = command.output().expect("xtask starts");
    let [out, error] =
        [output.stdout, output.stderr].map(|text| String::from_utf8(text).expect("it is text"));
    (output.status.code(), out, error)
}

fn crc(bytes: &[u8]) -> String {
    let mut crc = Crc32::default();
    crc.update(bytes);
    format!("{:#010x}", crc.finish())
}

fn says(line: &str) -> String {
    let words: Vec<&str> = line.split(' ').collect();
    let mut command = Command::new(words[0]);
    let output = command.args(&words[1..]).current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).output();
    String::from_utf8(output.expect("it starts").stdout).expect("it is text").trim().into()
}

#[test]
fn image_json_describes_the_files() {
    let bench = Bench::new("about");
    let (code, out, error) = run(bench.chore(&["image", "--json"]));
    assert_eq!(code, Some(0), "{error}");
    let about: Value = serde_json::from_str(&out).expect("one object, and nothing else");
    let folder = "target/image/production";
    let read = |name: &str| bench.get(&format!("{folder}/{name}"));
    assert_eq!(serde_json::from_slice::<Value>(&read("image.json")).expect("an object"), about);

    let keys: Vec<&String> = about.as_object().expect("an object").keys().collect();
    let expected = [
        "application",
        "commit",
        "dirty",
        "files",
        "log",
        "monitor",
        "profile",
        "rustc",
        "target",
        "version",
    ];
    assert_eq!(keys, expected);
    let names = ["conformance.bin", "monitor.bin", "monitor.elf", "tater.bin", "tater.elf", "tater.tek"];
    let files = names.map(|name| {
        let bytes = read(name);
        (name.to_owned(), json!({ "bytes": bytes.len(), "crc32": crc(&bytes) }))
    });
    assert_eq!(about["files"], Value::Object(files.into_iter().collect()));
    let entries = fs::read_dir(bench.0.join(folder)).expect("it was made");
    assert_eq!(entries.count(), names.len() + 1, "the files that are told, and image.json");

    let flat = read("tater.bin");
    let header = Header::verify(&flat, &MAP).expect("sealed");
    let application = json!({
        "address": "0x08004000", "bytes": flat.len(), "room": 0xD000, "crc32": format!("{:#010x}", header.crc),
    });
    assert_eq!((&about["application"], &about["version"]), (&application, &json!(header.version)));
    let flat = read("monitor.bin");
    let monitor =
        json!({ "address": "0x08000000", "bytes": flat.len(), "room": 0x4000, "crc32": crc(&flat) });
    assert_eq!((about["monitor"]["bytes"].as_u64(), &about["monitor"]), (Some(64), &monitor));
    assert_eq!(read("monitor.elf"), elf(0x0800_0000), "as it was linked");

    assert_eq!([&about["profile"], &about["log"]], [&json!("production"), &Value::Null]);
    assert_eq!(about["target"], "thumbv7m-none-eabi");
    assert_eq!(about["rustc"], says("rustc --version"));
    // Works in a checkout and in a source archive.
    let is_checkout = Path::new(env!("CARGO_MANIFEST_DIR")).with_file_name(".git").exists();
    let commit = is_checkout.then(|| says("git rev-parse HEAD"));
    assert_eq!((&about["commit"], about["dirty"].is_boolean()), (&json!(commit), is_checkout));
}

#[test]
fn out_is_relative_to_the_working_directory() {
    let bench = Bench::new("out");
    let mut command = bench.chore(&["image", "--profile", "release", "--out", "given/here"]);
    command.current_dir(&bench.0).env("DEFMT_LOG", "warn");
    let (code, out, error) = run(command);
    assert_eq!(code, Some(0), "{error}");
    assert!(
        out.contains("monitor     64 of 16384 bytes at 0x08000000") && out.contains("in given/here"),
        "{out}"
    );
    let about: Value = serde_json::from_slice(&bench.get("given/here/image.json")).expect("an object");
    assert_eq!([&about["profile"], &about["log"]], [&json!("release"), &json!("warn")]);
    assert!(bench.0.join("given/here/tater.tek").is_file());
    assert!(!bench.0.join("target/image").exists(), "nor anywhere else");
}

#[test]
fn unusable_folder_exits_2_with_empty_standard_output() {
    let bench = Bench::new("unusable");
    bench.put("file", b"mine");
    let out = bench.0.join("file").display().to_string();
    let (code, said, error) = run(bench.chore(&["image", "--json", "--out", &out]));
    assert_eq!((code, said.as_str()), (Some(2), ""), "{error}");
    assert!(error.contains(&out) && error.contains("next: give another folder with --out"), "{error}");
    assert_eq!(bench.get("file"), b"mine");
}

#[test]
fn failed_write_leaves_the_former_files() {
    let bench = Bench::new("mixed");
    assert_eq!(run(bench.chore(&["image"])).0, Some(0));
    let folder = bench.0.join("target/image/production");
    fs::remove_file(folder.join("tater.tek")).expect("it was made");
    fs::create_dir(folder.join("tater.tek")).expect("the target folder can be written");
    let names = ["tater.elf", "tater.bin", "monitor.elf", "monitor.bin", "conformance.bin", "image.json"];
    let all = || names.map(|name| fs::read(folder.join(name)).expect("it was made"));
    let before = all();
    let mut other = elf(0x0800_4000);
    other[84 + 60] = 1;
    bench.put("tater", &other);
    let (code, _, error) = run(bench.chore(&["image"]));
    assert_eq!(code, Some(2), "{error}");
    assert!(error.contains("tater.tek: cannot be written"), "{error}");
    assert!(all() == before, "none of the new ones");
    assert_eq!(fs::read_dir(&folder).expect("it was made").count(), names.len() + 1, "and no parts of them");
}
