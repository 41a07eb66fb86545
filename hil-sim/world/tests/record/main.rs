//! What happens in the world, bit by bit: `record.txt` holds for each scene what a reader compares, and a CRC-32 of every value at that time.
//! The same calls give the same bits on every platform, so any difference is a change of the world. `BLESS_RECORD=1` writes the file.
//!
//! Whether the physics is right is judged by the other tests; here nothing may change unseen, faults and rare paths included.

mod boards;
mod hands;
mod lines;
mod motors;
#[path = "../plant/six_step.rs"]
mod six_step;

use lines::Record;

#[test]
fn nothing_changes_unseen() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/record");
    lines::compare(vec![motors::scenes, boards::scenes, hands::scenes], folder, include_str!("record.txt"));
}
