//! Movement commands (manual 5.2.1, 5.5), from what is typed to where the seven rotors really are.

use super::Session;

/// Where the motors really are, hall counts, rounded.
fn counts(session: &Session) -> [i32; 7] {
    let mut counts = [0; 7];
    for (count, station) in counts.iter_mut().zip(session.hand.bus().stations()) {
        *count = station.board().rig().truth().counts.round() as i32;
    }
    counts
}

#[test]
fn try_it() {
    let mut session = Session::new();
    for line in [
        "HI",
        "C",
        "O",
        "GM 10000",
        "SM 3000",
        "GPTM 2000",
        "12WM 5000",
        "IO 500",
        "IC",
        "MDEG 30",
        "MPER 20",
        "HOME",
        "SC",
        "STO",
        "GTC",
        "GTO",
        "T",
    ] {
        let from = session.hand.now_us();
        let said = session.line(line);
        println!("{line:10} {said:10} {:?} {} ms", counts(&session), (session.hand.now_us() - from) / 1000);
    }
    panic!();
}
