//! HSG and LSG: the strain outside which a move ends (manual 5.3.1).

/// From this value on, HSG and LSG are disabled (manual: "a value of 255 or 256 disables").
pub const DISABLED: u16 = 255;

/// Whether `strain` ends a move: above `hsg` or below `lsg`.
#[must_use]
pub fn outside(strain: u8, hsg: u16, lsg: u16) -> bool {
    let strain = u16::from(strain);
    (hsg < DISABLED && strain > hsg) || (lsg < DISABLED && strain < lsg)
}

#[cfg(test)]
mod tests {
    use super::outside;

    #[test]
    fn between_lsg_and_hsg_and_never_when_disabled() {
        let rows = [
            (200, 199, 256, true),
            (199, 199, 256, false),
            (255, 255, 256, false),
            (10, 256, 11, true),
            (11, 256, 11, false),
            (0, 256, 255, false),
            (255, 254, 0, true),
        ];
        for (strain, hsg, lsg, ends) in rows {
            assert_eq!(outside(strain, hsg, lsg), ends, "strain {strain}, HSG {hsg}, LSG {lsg}");
        }
    }
}
