//! `cargo xtask flash` with a probe-rs that only records its arguments.

use std::fs;

use super::Bench;

impl Bench {
    /// A probe-rs that records its arguments, and a board with a storage to read and write.
    fn probe(&self) {
        let here = self.0.display();
        self.program(
            "probe-rs",
            &format!(
                "[ \"$1\" = --version ] && exit 0\n\
                 echo \"$*\" >> '{here}/calls'\n\
                 [ \"$1\" = read ] && while [ $# -gt 0 ]; do [ \"$1\" = --output ] && cp '{here}/flash' \"$2\"; shift; done\n\
                 case \"$*\" in *--base-address*) for last; do :; done; cp \"$last\" '{here}/flash';; esac\n\
                 exit 0"
            ),
        );
    }

    fn flash(&self, arguments: &[&str]) -> (Option<i32>, String) {
        let mut command = self.chore(&["flash"]);
        command.args(arguments);
        let output = command.output().expect("xtask starts");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    }

    /// Recorded arguments, without folders.
    fn calls(&self) -> Vec<String> {
        let text = String::from_utf8(self.get("calls")).expect("it is text");
        let folder = format!("{}/", self.0.display());
        text.replace(&folder, "").lines().map(String::from).collect()
    }
}

#[test]
fn missing_probe_rs_is_reported_before_building() {
    let bench = Bench::new("absent");
    // A PATH without probe-rs.
    bench.program("probe-rs", "exit 127");
    let (code, said) = bench.flash(&[]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("cargo install probe-rs-tools"), "{said}");
    assert!(!bench.0.join("target").exists());
}

#[test]
fn monitor_is_flashed_first_and_reset_last() {
    let bench = Bench::new("order");
    bench.probe();
    let (code, said) = bench.flash(&["--probe", "0483:3748", "--profile", "release"]);
    assert_eq!(code, Some(0), "{said}");
    let chip = "--chip STM32F103CB --probe 0483:3748";
    let expected = [
        format!("read {chip} --format binary --output target/flash/storage.bin b8 0x0801e000 8192"),
        format!("download {chip} --verify target/image/release/monitor.elf"),
        format!("download {chip} --verify target/image/release/tater.elf"),
        format!(
            "download {chip} --verify --binary-format bin --base-address 0x0801e000 target/flash/storage-named.bin"
        ),
        format!("reset {chip}"),
    ];
    assert_eq!(bench.calls(), expected);
    // Sealed: the vector table has the magic word.
    let tater = bench.get("target/image/release/tater.elf");
    assert_eq!(&tater[84 + 0x1C..84 + 0x20], b"TatR");
}

#[test]
fn number_is_added_to_the_stored_properties() {
    let bench = Bench::new("node");
    bench.probe();
    let (code, said) = bench.flash(&["--node", "5"]);
    assert_eq!(code, Some(0), "{said}");
    let chip = "--chip STM32F103CB";
    let expected = [
        format!("read {chip} --format binary --output target/flash/storage.bin b8 0x0801e000 8192"),
        format!("download {chip} --verify target/image/production/monitor.elf"),
        format!("download {chip} --verify target/image/production/tater.elf"),
        format!(
            "download {chip} --verify --binary-format bin --base-address 0x0801e000 target/flash/storage-named.bin"
        ),
        format!("reset {chip}"),
    ];
    assert_eq!(bench.calls(), expected);
    let stored = bench.get("flash");
    assert!(stored.len() == 8192 && stored.iter().any(|&byte| byte != 0xFF));
    // It has this number already: do not wear out the flash.
    fs::remove_file(bench.0.join("calls")).expect("the probe wrote it");
    let (code, said) = bench.flash(&["--node", "5"]);
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(bench.calls().len(), 4, "{:?}", bench.calls());
    assert_eq!(bench.get("flash"), stored);
}

#[test]
fn unreadable_storage_leaves_the_board_unchanged() {
    let bench = Bench::new("short");
    bench.probe();
    bench.put("flash", &[0xFF; 100]);
    let (code, said) = bench.flash(&["--node", "5"]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("found 100 bytes, expected the storage's 8192"), "{said}");
    assert_eq!(bench.calls().len(), 1, "{:?}", bench.calls());
}

#[test]
fn probe_failure_ends_flashing() {
    let bench = Bench::new("fails");
    bench.program(
        "probe-rs",
        &format!("echo \"$*\" >> '{}/calls'\n[ \"$1\" = --version ]", bench.0.display()),
    );
    let (code, said) = bench.flash(&[]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("probe-rs list"), "{said}");
    assert_eq!(bench.calls().len(), 2, "the version and the storage: {:?}", bench.calls());
}
