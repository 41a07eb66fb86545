//! HSG and LSG: the strain outside which a move ends (manual 5.3.1).

/// Least value that disables HSG and LSG (manual 5.3.1: "a value of 255 or 256 disables"). HSG 0 disables as well: Barrett's hosts
/// write 0 for "no limit", and as a limit it would end every move. LSG 0 excludes nothing by itself.
pub const DISABLED: u16 = 255;

/// Range of strain that does not end a move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    low: u8,
    high: u8,
}

impl Window {
    /// From properties HSG and LSG.
    #[must_use]
    pub fn new(hsg: u16, lsg: u16) -> Self {
        let low = if lsg < DISABLED { u8::try_from(lsg).unwrap_or(0) } else { 0 };
        let high = if hsg == 0 { u8::MAX } else { u8::try_from(hsg).unwrap_or(u8::MAX) };
        Self { low, high }
    }

    /// Whether `strain` ends a move: above HSG or below LSG.
    #[must_use]
    pub const fn excludes(self, strain: u8) -> bool {
        strain > self.high || strain < self.low
    }
}

#[cfg(test)]
mod tests {
    use super::Window;

    #[test]
    fn strain_outside_lsg_to_hsg_is_excluded_unless_disabled() {
        let rows = [
            (200, 199, 256, true),
            (199, 199, 256, false),
            (255, 255, 256, false),
            (10, 256, 11, true),
            (11, 256, 11, false),
            (0, 256, 255, false),
            (255, 254, 0, true),
            (2, 1, 0, true),
            (0, 0, 0, false),
            (1, 0, 0, false),
            (255, 0, 256, false),
            (10, 0, 11, true),
        ];
        for (strain, hsg, lsg, ends) in rows {
            assert_eq!(Window::new(hsg, lsg).excludes(strain), ends, "strain {strain}, HSG {hsg}, LSG {lsg}");
        }
    }
}
