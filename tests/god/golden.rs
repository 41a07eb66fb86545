//! Transcripts of the manual's examples: `golden/*.txt`. An empty prompt waits for the next one. BLESS_GOD=1 rewrites them.
//!
//! After LOOP's `*` a line is a control block, its data in hexadecimal, and the next line is the hand's answer; `^C` ends LOOP.

use std::path::{Path, PathBuf};

use super::Session;

const PROMPT: &str = "=> ";

const ABORT: &str = "^C";

/// Time between two control blocks, us; the hand answers in a few milliseconds.
const BLOCK_US: u64 = 20_000;

/// Temperature of GOD's board, 0.1 °C; its two bytes differ, so their order shows.
const TEMPERATURE: i16 = 312;

/// The examples of chapter 5.2 by section. 5.3 and 5.4 have none.
const EXAMPLES: &[(&str, &[&str])] = &[
    (
        "5.2.1",
        &[
            "SC",
            "HI",
            "SGHOME",
            "12IO 5000",
            "GIC 5000",
            "LOOP",
            "13M 1000",
            "13MDEG 90",
            "13MPER 50",
            "GO",
            "X567PTM -5000",
            "ST",
            "STC",
            "STO",
            "12WM 12000",
        ],
    ),
    ("5.2.2", &["SFSET DS 100", "SFGET DS", "3FLOAD", "123FSAVE", "SFDEF", "FLIST", "3FLISTV"]),
    ("5.2.3", &["PSET OTEMP 60", "PGET TEMP", "PLOAD", "PSAVE", "PDEF", "PLIST", "PLISTV"]),
    ("5.2.4", &["GMAC 3", "MACSET 3", "REC", "PLAY", "WAIT 5000"]),
    ("5.2.5", &["?HI", "RESET", "ERR 3", "VERS"]),
    ("5.2.6", &["A?", "FLISTA", "3FLISTAV", "PLISTA", "PLISTAV"]),
];

/// The example of 6.4 verbatim, including its repeated lines.
const REALTIME: &[&str] = &[
    "12FSET LCV 1",
    "12FSET LCVC 1",
    "12FSET LCPG 0",
    "12FSET LFV 0",
    "12FSET LFS 1",
    "12FSET LFAP 0",
    "12FSET LFDPC 1",
    "12FSET LFDPC 1",
    "4FSET LCV 0",
    "4FSET LCPG 0",
    "4FSET LFV 0",
    "4FSET LFS 0",
    "4FSET LFAP 0",
    "4FSET LFDPC 1",
    "4FSET LFDPC 1",
    "PSET LFT 1",
    "124LOOP",
];

/// `name = "file";` makes a test that replays a transcript, and lists all files.
macro_rules! transcripts {
    ($($name:ident = $file:literal;)*) => {
        $(
            #[test]
            fn $name() {
                verbatim($file, &played(&read($file)));
            }
        )*

        const PLAYED: &[&str] = &[$($file),*];
    };
}

transcripts! {
    movement = "movement";
    motor_parameters = "motor-parameters";
    parameters_of_the_hand = "hand-parameters";
    sequences = "sequences";
    administration = "administration";
    realtime = "realtime";
    two_grammars = "two-grammars";
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("god/golden")
}

fn path(name: &str) -> PathBuf {
    folder().join(name).with_extension("txt")
}

fn read(name: &str) -> String {
    let path = path(name);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn verbatim(name: &str, found: &str) {
    if std::env::var_os("BLESS_GOD").is_some() {
        std::fs::write(path(name), found).expect("it can be written");
    } else {
        assert!(found == read(name), "{name}: if the change is intended, BLESS_GOD=1 rewrites it\n{found}");
    }
}

fn typed(transcript: &str) -> Vec<&str> {
    let lines = transcript.lines().filter_map(|line| line.strip_prefix(PROMPT));
    lines.map(|line| line.strip_suffix('*').unwrap_or(line)).collect()
}

fn played(expected: &str) -> String {
    let mut session = Session::new();
    session.hand.fix_temperature(Some(f64::from(TEMPERATURE) / 10.0));
    let mut prompts = typed(expected);
    assert_eq!(prompts.pop(), Some(""), "a transcript ends with a prompt");
    let mut lines = expected.lines();
    for typed in prompts {
        // Skip to that prompt; the blocks follow it.
        lines.by_ref().find(|line| line.starts_with(PROMPT));
        if typed.is_empty() {
            session.read_to_prompt();
        } else if typed.ends_with("LOOP") {
            session.start(typed);
            let blocks =
                lines.by_ref().take_while(|line| *line != ABORT).filter(|line| !line.starts_with('*'));
            blocks.for_each(|block| exchange(&mut session, block));
            session.transcript.push_str(&format!("\r\n\r{ABORT}"));
            session.hand.push_rx(b"\x03");
            session.read_to_prompt();
        } else {
            session.run(typed);
        }
    }
    // The banner's own line end is LF CR.
    session.transcript.replace("\r\n\r", "\n").replace("\n\r", "\n").trim_start().to_owned() + "\n"
}

/// Sends a control block, such as `C 0a f6`, and records its answer.
fn exchange(session: &mut Session, block: &str) {
    let (header, data) = block.split_at(1);
    let data = data.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).expect("hexadecimal"));
    let bytes: Vec<u8> = header.bytes().chain(data).collect();
    session.hand.push_rx(&bytes);
    session.wait_us(BLOCK_US);
    let answer = session.hand.take_tx();
    let (star, data) = answer.split_first().expect("an answer");
    let data: String = data.iter().map(|byte| format!(" {byte:02x}")).collect();
    session.transcript.push_str(&format!("\r\n\r{block}\r\n\r{}{data}", char::from(*star)));
}

#[test]
fn transcripts_cover_the_manuals_examples() {
    let transcripts: Vec<String> = PLAYED.iter().map(|name| read(name)).collect();
    let all: Vec<&str> = transcripts.iter().flat_map(|transcript| typed(transcript)).collect();
    for (section, examples) in EXAMPLES {
        for example in *examples {
            assert!(all.contains(example), "{section}: {example}");
        }
    }
    assert!(all.windows(REALTIME.len()).any(|lines| lines == REALTIME), "6.4");
}

#[test]
fn every_transcript_is_replayed() {
    let files = std::fs::read_dir(folder()).expect("it can be read");
    let mut names: Vec<String> = files
        .map(|file| {
            file.expect("an entry").path().file_stem().expect("a name").to_string_lossy().into_owned()
        })
        .collect();
    names.sort();
    let mut played = PLAYED.to_vec();
    played.sort_unstable();
    assert_eq!(names, played);
}
