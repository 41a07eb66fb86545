//! Six-step commutation by the table of decision 0003, apart from the servo's. The record of the world drives with it too.

use hil_world::rig::Leg;

/// The legs that drive a hall code's sector closing or opening; none at a code that is impossible.
pub fn legs(code: u8, closes: bool) -> [Leg; 3] {
    use Leg::{Float, Low, Pwm};
    let (one, other) = if closes { (Pwm, Low) } else { (Low, Pwm) };
    match code {
        2 => [one, other, Float],
        6 => [one, Float, other],
        4 => [Float, one, other],
        5 => [other, one, Float],
        1 => [other, Float, one],
        3 => [Float, other, one],
        _ => [Float; 3],
    }
}
