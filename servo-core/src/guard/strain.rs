//! HSG and LSG: the strain outside which a move ends (manual 5.3.1).

/// From this value on, HSG and LSG are disabled (manual: "a value of 255 or 256 disables").
pub const DISABLED: u16 = 255;

/// Whether `strain` ends a move: above `hsg` or below `lsg`.
#[must_use]
pub fn outside(strain: u8, hsg: u16, lsg: u16) -> bool {
    let strain = u16::from(strain);
    (hsg < DISABLED && strain > hsg) || (lsg < DISABLED && strain < lsg)
}
