//! What experiments give, bit by bit, as the record of the world (`hil-sim/world/tests/record`): `record.txt` holds what a reader compares, and a
//! CRC-32 of all of it. `BLESS_RECORD=1` writes the file.

mod files;
mod hosts;
#[path = "../../../world/tests/record/lines.rs"]
mod lines;
mod runs;
mod shafts;

use lines::Record;

#[test]
fn nothing_changes_unseen() {
    let scenes: Vec<lines::Scenes> =
        vec![runs::shipped, runs::own, hosts::scenes, files::scenes, shafts::scenes];
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/record");
    lines::compare(scenes, folder, include_str!("record.txt"));
}
