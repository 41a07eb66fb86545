//! Prints random poses of the whole hand with its fingertips, as CSV, for comparison with other implementations (tests/host/kinematics.py).
//!
//! Usage: poses [COUNT] [SEED]. Motors in hall counts, fingertips in the frame of the palm in meters, and their Jacobians (linear part, by
//! rows), in m/rad. The same seed gives the same bytes on every machine.

use kinematics::{Finger, Hand};

/// SplitMix64 (Steele, Lea and Flood, 2014): uniform in 0..1.
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

fn argument(index: usize, otherwise: u64) -> Result<u64, String> {
    match std::env::args().nth(index) {
        None => Ok(otherwise),
        Some(text) => text
            .parse()
            .map_err(|error| format!("{text:?}: {error}; expected a number, as in: poses 10000 1")),
    }
}

fn main() -> Result<(), String> {
    let (count, mut state) = (argument(1, 10)?, argument(2, 1)?);
    let hand = Hand::default();
    let mut text = String::new();
    let motors = (1..=7).map(|motor| format!("motor_{motor}"));
    let tips = (1..=3).flat_map(|finger| ["x", "y", "z"].map(|axis| format!("finger_{finger}_{axis}")));
    let jacobians = (1..=3).flat_map(|finger| (1..=9).map(move |entry| format!("finger_{finger}_j{entry}")));
    text += &motors.chain(tips).chain(jacobians).collect::<Vec<_>>().join(",");
    for _ in 0..count {
        let drives = [hand.link, hand.link, hand.link, hand.spread, hand.tip, hand.tip, hand.tip];
        let motors = drives.map(|drive| {
            let [low, high] = drive.range_counts;
            low + random(&mut state) * (high - low)
        });
        let joints = hand.joints(motors);
        let mut row = motors.to_vec();
        for finger in Finger::ALL {
            row.extend(hand.fingertip(finger, joints.of(finger)).origin);
        }
        for finger in Finger::ALL {
            row.extend(hand.jacobian(finger, joints.of(finger)).linear.into_iter().flatten());
        }
        text += "\n";
        text += &row.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    }
    println!("{text}");
    Ok(())
}
