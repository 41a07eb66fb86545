//! Straps and brake behind embedded-hal's digital pins. The brake's pin also lights the yellow LED; the board has no other.
//!
//! The legs of the bridge are not behind `SetDutyCycle`: a leg that floats has its complementary output disabled, which the
//! trait cannot say; three legs change in one order (`pwm.rs`), which three objects with one duty each do not keep; and a hall
//! edge would pay for `max_duty_cycle` and a `Result` for each leg.

use core::convert::Infallible;

use embedded_hal::digital::{InputPin, OutputPin};
use tater_wire::Node;

/// The node of three straps, lowest bit first. A strap to ground is 1; no strap is node 0.
pub fn node(straps: [&mut dyn InputPin<Error = Infallible>; 3]) -> Node {
    let bit = |strap: &mut dyn InputPin<Error = Infallible>| u8::from(strap.is_low() == Ok(true));
    let [a, b, c] = straps.map(bit);
    // Below 8.
    Node::new(a | b << 1 | c << 2).unwrap_or(Node::HOST)
}

/// Energizes the brake's coil, which frees the spread, or not.
pub fn set_brake<P: OutputPin<Error = Infallible>>(brake: &mut P, released: bool) {
    // A pin of this chip cannot fail.
    let _: Result<(), Infallible> = brake.set_state(released.into());
}

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_hal::digital::ErrorType;

    struct Pin(bool);

    impl ErrorType for Pin {
        type Error = Infallible;
    }

    impl InputPin for Pin {
        fn is_high(&mut self) -> Result<bool, Infallible> {
            Ok(self.0)
        }

        fn is_low(&mut self) -> Result<bool, Infallible> {
            Ok(!self.0)
        }
    }

    impl OutputPin for Pin {
        fn set_low(&mut self) -> Result<(), Infallible> {
            self.0 = false;
            Ok(())
        }

        fn set_high(&mut self) -> Result<(), Infallible> {
            self.0 = true;
            Ok(())
        }
    }

    #[test]
    fn straps_to_ground_are_the_node_in_binary() {
        for number in 0..8 {
            let [mut a, mut b, mut c] = [0, 1, 2].map(|bit| Pin(number >> bit & 1 == 0));
            assert_eq!(node([&mut a, &mut b, &mut c]).number(), number);
        }
    }

    #[test]
    fn released_brake_is_high() {
        let mut pin = Pin(false);
        for released in [true, false] {
            set_brake(&mut pin, released);
            assert_eq!(pin.0, released);
        }
    }
}
