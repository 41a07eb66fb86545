//! MPE: when a move counts as arrived (manual 5.5 case 2, decision 0007).

/// Whether the profile is complete, so that the set-point rests at `end`, and the position is within `mpe` counts of it.
#[must_use]
pub fn arrived(profile_done: bool, end: i32, position: i32, mpe: u16) -> bool {
    profile_done && end.abs_diff(position) <= u32::from(mpe)
}

#[cfg(test)]
mod tests {
    use super::arrived;

    #[test]
    fn at_rest_and_inside_the_window() {
        assert!(arrived(true, 100, 96, 4) && arrived(true, 100, 104, 4));
        assert!(!arrived(true, 100, 95, 4) && !arrived(true, 100, 105, 4));
        assert!(!arrived(false, 100, 100, 4), "the profile still moves");
        assert!(arrived(true, 7, 7, 0));
        assert!(!arrived(true, i32::MAX, i32::MIN, 0), "a wrapped difference is no arrival");
    }
}
