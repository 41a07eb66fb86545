//! Allowed dependencies of each crate, including development dependencies.

use toml::{Table, Value};

use super::{Source, Violation, assert_none, files};

struct Arrows {
    package: &'static str,
    ours: &'static [&'static str],
    /// External crates, each with a reason; `None`: any.
    others: Option<&'static [&'static str]>,
}

/// What ARCHITECTURE.md calls "all libraries".
const LIBRARIES: &[&str] = &[
    "servo-core",
    "tater-wire",
    "boot",
    "tater-fw",
    "bsp-stm32f1",
    "tater-f103",
    "god",
    "kinematics",
    "traces",
    "charts",
    "wraptor",
    "programs",
    "commission",
    "hil-world",
    "hil-experiment",
    "hil-torture",
    "hil-tuning",
    "hil-sim",
    "board-emu",
];

const ARROWS: [Arrows; 26] = [
    Arrows {
        package: "servo-core",
        ours: &[],
        // fixed: the Q-formats, no_std, integer only. heapless: bounded queues without a heap. defmt: Format for what a
        // firmware logs, only with the feature of that name. proptest: tests.
        others: Some(&["defmt", "fixed", "heapless", "proptest (dev)"]),
    },
    Arrows {
        package: "tater-wire",
        ours: &[],
        // embedded-can: its Frame trait, so that any CAN driver takes our frames. heapless: bounded buffers without a heap.
        // defmt: as above. crc, proptest: tests.
        others: Some(&["defmt", "embedded-can", "heapless", "crc (dev)", "proptest (dev)"]),
    },
    // servo-core: its clock. embedded-storage: what a NOR flash's errors are.
    Arrows {
        package: "boot",
        ours: &["servo-core", "tater-wire"],
        others: Some(&["defmt", "embedded-storage", "heapless", "proptest (dev)"]),
    },
    Arrows {
        package: "tater-fw",
        ours: &["servo-core", "tater-wire", "boot"],
        others: Some(&["defmt", "heapless", "proptest (dev)"]),
    },
    // bxcan, cortex-m(-rt), stm32f1xx-hal: registers. embedded-storage: traits for NOR flash.
    Arrows {
        package: "bsp-stm32f1",
        ours: &["servo-core", "tater-wire", "boot"],
        others: Some(&["bxcan", "cortex-m", "cortex-m-rt", "embedded-storage", "stm32f1xx-hal"]),
    },
    // cortex-m-rtic: interrupts. embedded-hal: pins. stm32f1xx-hal: which pins and peripherals a chip has. defmt(-rtt): logs. To build: tater-wire, for the
    // memory map in the linker scripts.
    Arrows {
        package: "tater-f103",
        ours: &["servo-core", "tater-wire", "boot", "tater-fw", "bsp-stm32f1"],
        others: Some(&[
            "cortex-m",
            "cortex-m-rt",
            "cortex-m-rtic",
            "defmt",
            "defmt-rtt",
            "embedded-hal",
            "stm32f1xx-hal",
        ]),
    },
    // heapless: its bus. cortex-m(-rt): its cores.
    Arrows {
        package: "stub",
        ours: &["servo-core", "tater-wire", "boot", "tater-fw", "god"],
        others: Some(&["cortex-m", "cortex-m-rt", "heapless"]),
    },
    // heapless: bounded buffers without a heap. defmt: as above. proptest: tests.
    Arrows { package: "god", ours: &["tater-wire"], others: Some(&["defmt", "heapless", "proptest (dev)"]) },
    // libm: sines without std. proptest: tests.
    Arrows { package: "kinematics", ours: &["tater-wire"], others: Some(&["libm", "proptest (dev)"]) },
    // The host library. god: its tables, and GOD itself for a hand by CAN. rustix: serial ports, poll. socketcan: CAN interfaces
    // of Linux. socket2: a listener with a full backlog, for tests.
    Arrows {
        package: "wraptor",
        ours: &["tater-wire", "tater-f103", "god"],
        others: Some(&["rustix", "socket2 (dev)", "socketcan"]),
    },
    // Tables and their formats: csv, parquet with bytes, mcap. strsim: misspelt names. serde(_json): what formats keep beside the rows.
    Arrows {
        package: "traces",
        ours: &[],
        others: Some(&["bytes", "csv", "mcap", "parquet", "serde", "serde_json", "strsim"]),
    },
    // serde(_json): charts for their program in the page.
    Arrows { package: "charts", ours: &[], others: Some(&["serde", "serde_json"]) },
    // ctrlc: ^C. tempfile: names of temporary files.
    Arrows { package: "programs", ours: &[], others: Some(&["ctrlc", "tempfile"]) },
    // Real boards, never the simulator. programs: the file of old values, which serde(_json) reads. wraptor: buses.
    Arrows {
        package: "commission",
        ours: &["tater-wire", "traces", "wraptor", "programs"],
        others: Some(&["rand", "rand_pcg", "serde", "serde_json"]),
    },
    // libm: the same bits on every platform. flate2: a checksum. serde: figures by name. rand(_pcg): noise and scatter from a seed.
    Arrows {
        package: "hil-world",
        ours: &["servo-core", "tater-wire", "boot", "tater-fw", "tater-f103", "god", "kinematics"],
        others: Some(&["fixed (dev)", "flate2", "libm", "proptest (dev)", "rand", "rand_pcg", "serde"]),
    },
    // toml: scenarios. flate2: recordings. fixed, heapless: the estimator of a replay.
    Arrows {
        package: "hil-experiment",
        ours: &[
            "servo-core",
            "tater-wire",
            "boot",
            "tater-fw",
            "tater-f103",
            "god",
            "kinematics",
            "traces",
            "charts",
            "hil-world",
        ],
        others: Some(&[
            "fixed",
            "flate2",
            "libm",
            "heapless",
            "proptest (dev)",
            "rand",
            "rand_pcg",
            "serde",
            "serde_json",
            "toml",
        ]),
    },
    // wraptor: lines of SLCAN.
    Arrows {
        package: "hil-torture",
        ours: &[
            "servo-core",
            "tater-wire",
            "boot",
            "tater-fw",
            "tater-f103",
            "god",
            "wraptor",
            "hil-world",
            "hil-experiment",
        ],
        others: Some(&["libm", "rand", "rand_pcg", "serde"]),
    },
    // cmaes: the search. num-complex: frequency responses. rayon: threads, with results in order.
    Arrows {
        package: "hil-tuning",
        ours: &["servo-core", "tater-wire", "tater-fw", "traces", "charts", "hil-world", "hil-experiment"],
        others: Some(&["cmaes", "num-complex", "rand", "rand_pcg", "rayon", "serde", "serde_json", "toml"]),
    },
    Arrows {
        package: "hil-sim",
        ours: &[
            "servo-core",
            "tater-wire",
            "boot",
            "tater-fw",
            "tater-f103",
            "god",
            "traces",
            "charts",
            "wraptor",
            "programs",
            "commission",
            "hil-world",
            "hil-experiment",
            "hil-torture",
            "hil-tuning",
        ],
        others: None,
    },
    // The Python wheel. pyo3, numpy: its module and arrays. serde_json: results of runs on their way to dictionaries.
    Arrows {
        package: "wraptor-py",
        ours: &["tater-wire", "god", "traces", "wraptor", "hil-world", "hil-experiment"],
        others: Some(&["numpy", "pyo3", "serde_json"]),
    },
    // The C library.
    Arrows { package: "wraptor-c", ours: &["tater-wire", "tater-f103", "wraptor"], others: Some(&[]) },
    // The terminal program. god: the tables of commands and parameters. programs: ^C. rustyline: entries with history and completion. rustix: keys
    // one by one, and a terminal for tests.
    Arrows {
        package: "wraptor-cli",
        ours: &["tater-wire", "tater-f103", "god", "wraptor", "programs"],
        others: Some(&["clap", "rustix", "rustyline", "serde_json"]),
    },
    // board-emu gets the program as bytes: of ours it needs only the simulated world, what runs and torments it, and options of sockets.
    Arrows {
        package: "board-emu",
        ours: &[
            "tater-wire",
            "tater-f103",
            "wraptor",
            "programs",
            "hil-world",
            "hil-experiment",
            "hil-torture",
        ],
        others: None,
    },
    Arrows { package: "system-tests", ours: LIBRARIES, others: None },
    Arrows {
        package: "tater-fuzz",
        ours: &["servo-core", "tater-wire", "boot", "tater-fw", "tater-f103", "god", "hil-world", "hil-sim"],
        others: None,
    },
    // xtask is compiled first on a new machine: few dependencies, the rest by `cargo run`. tater-wire: images.
    // wraptor: downloads. kinematics: robot models. programs: atomic files. indicatif: progress. object, rustc-demangle: ELF.
    Arrows {
        package: "xtask",
        ours: &["tater-wire", "tater-f103", "kinematics", "wraptor", "programs"],
        others: Some(&["clap", "indicatif", "object", "rustc-demangle", "serde_json"]),
    },
];

/// Names in every dependency table of a manifest, marked `(dev)` or `(build)` if not linked into the crate.
fn dependencies(manifest: &Table) -> Vec<String> {
    let mut tables = vec![manifest];
    if let Some(targets) = manifest.get("target").and_then(Value::as_table) {
        tables.extend(targets.values().filter_map(Value::as_table));
    }
    let mut names = Vec::new();
    for table in tables {
        for (key, mark) in
            [("dependencies", ""), ("dev-dependencies", " (dev)"), ("build-dependencies", " (build)")]
        {
            for (name, spec) in table.get(key).and_then(Value::as_table).into_iter().flatten() {
                let package = spec.get("package").and_then(Value::as_str).unwrap_or(name);
                names.push(format!("{package}{mark}"));
            }
        }
    }
    names
}

fn arrows(source: &Source) -> Vec<Violation> {
    let manifest: Table = match source.text.parse() {
        Ok(manifest) => manifest,
        Err(error) => return vec![source.violation(1, format!("not TOML: {error}"))],
    };
    let Some(name) = manifest.get("package").and_then(|p| p.get("name")).and_then(Value::as_str) else {
        return Vec::new(); // the workspace's own manifest
    };
    let Some(rule) = ARROWS.iter().find(|rule| rule.package == name) else {
        return vec![
            source.violation(1, format!("crate {name} has no arrows: add them here, and to the map")),
        ];
    };
    let mut violations = Vec::new();
    for dependency in dependencies(&manifest) {
        let bare = dependency.split(' ').next().unwrap_or_default();
        let is_ours = ARROWS.iter().any(|rule| rule.package == bare);
        let allowed = if is_ours {
            rule.ours.contains(&bare)
        } else {
            rule.others.is_none_or(|others| others.contains(&dependency.as_str()))
        };
        if !allowed {
            let line = source.text.lines().position(|l| l.contains(bare)).map_or(1, |i| i + 1);
            violations.push(source.violation(line, format!("{name} may not depend on {dependency}")));
        }
    }
    violations
}

#[test]
fn crates_have_only_allowed_dependencies() {
    assert_none(
        &files("toml").iter().filter(|f| f.path.ends_with("Cargo.toml")).flat_map(arrows).collect::<Vec<_>>(),
    );
}

/// A crate that is missing there would be linted and tested by nothing.
#[test]
fn default_members_are_all_but_the_wheel() {
    let manifests = files("toml");
    let manifest = manifests.iter().find(|file| file.path == "Cargo.toml").expect("the workspace");
    let manifest: Table = manifest.text.parse().expect("cargo reads it");
    let list = |key: &str| manifest["workspace"][key].as_array().expect("a list").clone();
    let mut members = list("members");
    members.retain(|member| member.as_str() != Some("wraptor/python"));
    assert_eq!(list("default-members"), members);
}

/// The rows of the table "Which crate may import which", each with its line, its crate and what that imports.
fn table(page: &Source) -> Vec<(usize, &str, Vec<&str>)> {
    let rows = page.text.lines().enumerate().skip_while(|(_, line)| *line != "| crate | imports |").skip(2);
    rows.map_while(|(index, line)| {
        let (name, ours) = line.strip_prefix("| ")?.strip_suffix(" |")?.split_once(" | ")?;
        let ours = match ours {
            "none" => Vec::new(),
            "all libraries" => LIBRARIES.to_vec(),
            ours => ours.split(", ").collect(),
        };
        Some((index + 1, name, ours))
    })
    .collect()
}

/// The table of ARCHITECTURE.md is the one above.
fn described(page: &Source) -> Vec<Violation> {
    let rows = table(page);
    let wrong = |(line, name, ours): &(usize, &str, Vec<&str>)| {
        let rule = ARROWS.iter().find(|rule| rule.package == *name);
        let holds = rule.is_some_and(|rule| {
            rule.ours.len() == ours.len() && rule.ours.iter().all(|name| ours.contains(name))
        });
        (!holds).then(|| {
            page.violation(
                *line,
                format!("{name}: tests/fences/arrows.rs has {:?}", rule.map(|rule| rule.ours)),
            )
        })
    };
    let missing = ARROWS.iter().filter(|rule| rows.iter().all(|(_, name, _)| *name != rule.package));
    let missing =
        missing.map(|rule| page.violation(1, format!("{}: not in the table of crates", rule.package)));
    rows.iter().filter_map(wrong).chain(missing).collect()
}

#[test]
fn table_of_crates_is_what_they_import() {
    let pages = files("md");
    let page = pages.iter().find(|page| page.path == "ARCHITECTURE.md").expect("the page");
    assert_none(&described(page));
    let wrong = |from: &str, to: &str| described(&Source::new("A.md", &page.text.replace(from, to))).len();
    assert_eq!(wrong("| god | tater-wire |", "| god | tater-wire, wraptor |"), 1, "an arrow too many");
    assert_eq!(wrong("| god | tater-wire |\n", ""), 1, "a crate that is missing");
}

#[test]
fn dependency_fence_finds_each_violation() {
    let core = "[package]\nname = \"servo-core\"\n";
    super::check_fence(
        arrows,
        "servo-core/Cargo.toml",
        &[
            &format!("{core}[dependencies]\nhil-sim.workspace = true"),
            &format!("{core}[dependencies]\nlibm = \"0.2\""),
            &format!("{core}[dependencies]\nproptest = \"1\""),
            &format!("{core}[dev-dependencies]\nhil-sim.workspace = true"),
            &format!("{core}[target.'cfg(unix)'.dev-dependencies]\nlibc = \"0.2\""),
            &format!("{core}[dependencies]\nfixed = {{ package = \"half\", version = \"2\" }}"),
            "[package]\nname = \"newcomer\"",
            "[package]\nname = \"xtask\"\n[dependencies]\nhil-sim.workspace = true",
            "[package",
        ],
        &[
            &format!("{core}[dependencies]\nfixed = \"1\"\n[dev-dependencies]\nproptest = \"1\""),
            "[package]\nname = \"hil-sim\"\n[dependencies]\nservo-core.workspace = true\nanything = \"1\"",
            "[workspace]\nmembers = []",
        ],
    );
}
