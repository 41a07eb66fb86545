//! Transcripts of the manual's examples, as the host sees them: `golden/*.txt`. What follows a prompt there is typed; a prompt with
//! nothing after it waits for the next one. BLESS_GOD=1 writes them anew.

use std::path::Path;

use super::Session;

const PROMPT: &str = "=> ";

/// Types what a transcript types, and tells how it went.
fn played(expected: &str) -> String {
    let mut session = Session::new();
    let mut prompts: Vec<&str> = expected.lines().filter_map(|line| line.strip_prefix(PROMPT)).collect();
    // The last one is where it ends.
    assert_eq!(prompts.pop(), Some(""), "a transcript ends with a prompt");
    for typed in prompts {
        if typed.is_empty() {
            session.until_prompt();
        } else {
            session.line(typed);
        }
    }
    session.heard.replace("\r\n\r", "\n").trim_start().to_owned() + "\n"
}

fn verbatim(name: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("god/golden").join(name).with_extension("txt");
    let expected =
        std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let found = played(&expected);
    if std::env::var_os("BLESS_GOD").is_some() {
        std::fs::write(&path, found).expect("it can be written");
    } else {
        assert!(found == expected, "{name}: if that is meant, BLESS_GOD=1 writes it\n{found}");
    }
}

#[test]
fn motor_parameters() {
    verbatim("motor-parameters");
}

#[test]
fn parameters_of_the_hand() {
    verbatim("hand-parameters");
}

#[test]
fn sequences() {
    verbatim("sequences");
}

#[test]
fn administration() {
    verbatim("administration");
}

#[test]
fn walk_through() {
    verbatim("walk-through");
}
