//! MPE: when a move counts as arrived (manual 5.5 case 2, DESIGN 5).

/// Whether a move has arrived: the profile has ended, so the set-point rests at `end`, *and* the position is
/// within `mpe` counts of it. Entering the window later than the profile ends counts when it happens; entering
/// it earlier, still moving, does not.
#[must_use]
pub fn arrived(profile_done: bool, end: i32, position: i32, mpe: u16) -> bool {
    profile_done && end.wrapping_sub(position).unsigned_abs() <= u32::from(mpe)
}
