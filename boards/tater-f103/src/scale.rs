//! The scale of the 12-bit ADC codes: the board's analog front end, chosen by this project because the manual gives none.
//!
//! | input | front end |
//! |---|---|
//! | bus voltage | 100 k over 10 k: 0 to 36.3 V |
//! | bus current | 2 mohm in the supply line, amplified by 41.25 around 1.65 V and filtered at 1 kHz: the mean, -20 to 20 A |
//! | strain | amplified to 0 to 3.3 V |
//! | thermistors | 10 k at 25 °C, B = 3950 K, to ground under 10 k to 3.3 V |

use servo_core::units::{DeciCelsius, MilliAmps, MilliVolts};

/// Bus voltage of a code, 0..=4095.
#[must_use]
pub fn bus(code: u16) -> MilliVolts {
    let mv = (u32::from(code & 0xFFF) * 36_300 + 2048) >> 12;
    // At most 36,292.
    MilliVolts(u16::try_from(mv).unwrap_or(u16::MAX))
}

/// Bus current of a code, 0..=4095; positive into the bridge.
#[must_use]
pub fn current(code: u16) -> MilliAmps {
    let ma = ((i32::from(code & 0xFFF) - 2048) * 20_000) >> 11;
    // At most 20,000 either way.
    MilliAmps(i16::try_from(ma).unwrap_or(i16::MAX))
}

/// Strain of a code, 0..=4095: its upper eight bits.
#[must_use]
pub const fn strain(code: u16) -> u8 {
    (code >> 4 & 0xFF).to_le_bytes()[0]
}

/// Temperature in 0.1 °C of every 64th code: 1 / (1 / 298.15 K + ln(code / (4096 - code)) / 3950 K), within -50..=155 °C.
/// Straight lines between them are within 0.3 °C from 0 to 100 °C and within 1 °C from -20 to 120 °C.
#[rustfmt::skip]
const TEMPERATURES: [i16; 65] = [
    1550, 1550, 1293, 1127, 1016,  933,  866,  811,  763,  722,  685,  652,  621,  593,  567,  543,
     520,  498,  477,  458,  439,  421,  403,  386,  370,  354,  338,  323,  308,  293,  278,  264,
     250,  236,  222,  208,  194,  181,  167,  153,  139,  125,  111,   97,   83,   68,   53,   37,
      22,    5,  -11,  -29,  -47,  -66,  -87, -108, -132, -157, -186, -218, -256, -302, -364, -460,
    -500,
];

/// Temperature of a thermistor's code, 0..=4095. A broken wire reads -50 °C, a short 155 °C.
#[must_use]
pub fn temperature(code: u16) -> DeciCelsius {
    let code = code & 0xFFF;
    let at = |index: u16| TEMPERATURES.get(usize::from(index)).copied().unwrap_or(1550);
    let (index, rest) = (code >> 6, i32::from(code & 63));
    let (from, to) = (at(index), at(index + 1));
    let step = ((i32::from(to) - i32::from(from)) * rest) >> 6;
    // Between the two, so the upper half is sign.
    let [low, high, ..] = (i32::from(from) + step).to_le_bytes();
    DeciCelsius(i16::from_le_bytes([low, high]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_and_middles() {
        assert_eq!([0, 2048, 4095].map(|code| bus(code).0), [0, 18_150, 36_291]);
        assert_eq!([0, 2048, 4095].map(|code| current(code).0), [-20_000, 0, 19_990]);
        assert_eq!([0, 2048, 4095].map(strain), [0, 128, 255]);
        assert_eq!([0, 2048, 4095].map(|code| temperature(code).0), [1550, 250, -500]);
    }

    #[test]
    fn hotter_is_a_smaller_code() {
        for code in 1..4096 {
            assert!(temperature(code) <= temperature(code - 1), "{code}");
        }
    }
}
