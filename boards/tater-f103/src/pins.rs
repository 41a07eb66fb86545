//! The pin table. The programs set the pins up from its rows, and `docs/board.md` shows them.

/// A pin's row.
#[derive(Clone, Copy, Debug)]
pub struct Pin {
    /// Name.
    pub name: &'static str,
    /// Port and number, as in the data sheet.
    pub pin: &'static str,
    /// Configuration.
    pub mode: &'static str,
    /// The peripheral's name for it.
    pub signal: &'static str,
    /// Function, and level while no program runs.
    pub what: &'static str,
}

/// `name: pin mode = port.pin.set-up(register) "signal" "what";` for the pins of both programs, and for the application's.
macro_rules! pins {
    (
        $gpioa:ident $gpiob:ident
        both { $($b:ident: $b_pin:ident [$($b_mode:tt)+] = $b_port:ident.$b_id:ident.$b_set:ident($b_cr:ident) $b_signal:literal $b_what:literal;)* }
        application { $($a:ident: $a_pin:ident [$($a_mode:tt)+] = $a_port:ident.$a_id:ident.$a_set:ident($a_cr:ident) $a_signal:literal $a_what:literal;)* }
    ) => {
        /// The pins that both programs use.
        pub const BUS: &[Pin] = &[$(Pin {
            name: stringify!($b), pin: stringify!($b_pin), mode: stringify!($($b_mode)+), signal: $b_signal, what: $b_what,
        },)*];

        /// The pins that only the application touches: in the monitor they stay inputs, as reset leaves them.
        pub const MOTOR: &[Pin] = &[$(Pin {
            name: stringify!($a), pin: stringify!($a_pin), mode: stringify!($($a_mode)+), signal: $a_signal, what: $a_what,
        },)*];

        /// Set up: the pins that both programs use.
        #[cfg(target_os = "none")]
        pub struct BusPins {
            $(#[doc = $b_what] pub $b: gpio::$b_pin<$($b_mode)+>,)*
        }

        /// Set up: the pins that only the application touches.
        #[cfg(target_os = "none")]
        pub struct MotorPins {
            $(#[doc = $a_what] pub $a: gpio::$a_pin<$($a_mode)+>,)*
        }

        /// Sets up the monitor's pins.
        #[cfg(target_os = "none")]
        #[must_use]
        pub fn bus(mut $gpioa: gpio::gpioa::Parts, mut $gpiob: gpio::gpiob::Parts) -> BusPins {
            BusPins { $($b: $b_port.$b_id.$b_set(&mut $b_port.$b_cr),)* }
        }

        /// Sets up the application's pins.
        #[cfg(target_os = "none")]
        #[must_use]
        pub fn all(mut $gpioa: gpio::gpioa::Parts, mut $gpiob: gpio::gpiob::Parts) -> (BusPins, MotorPins) {
            (
                BusPins { $($b: $b_port.$b_id.$b_set(&mut $b_port.$b_cr),)* },
                MotorPins { $($a: $a_port.$a_id.$a_set(&mut $a_port.$a_cr),)* },
            )
        }
    };
}

#[cfg(target_os = "none")]
use stm32f1xx_hal::gpio::{self, Alternate, Analog, Input, Output, PullUp};

#[rustfmt::skip]
pins! { gpioa gpiob
both {
    can_rx: PA11 [Input<PullUp>] = gpioa.pa11.into_pull_up_input(crh) "CAN_RX" "from the transceiver";
    can_tx: PA12 [Alternate] = gpioa.pa12.into_alternate_push_pull(crh) "CAN_TX" "to the transceiver, which pulls it up";
    strap_1: PB0 [Input<PullUp>] = gpiob.pb0.into_pull_up_input(crl) "GPIO" "to ground: 1 in the node's number";
    strap_2: PB1 [Input<PullUp>] = gpiob.pb1.into_pull_up_input(crl) "GPIO" "to ground: 2";
    strap_4: PB10 [Input<PullUp>] = gpiob.pb10.into_pull_up_input(crh) "GPIO" "to ground: 4";
}
application {
    a_high: PA8 [Alternate] = gpioa.pa8.into_alternate_push_pull(crh) "TIM1_CH1" "high side of phase A; the gate driver pulls it down";
    b_high: PA9 [Alternate] = gpioa.pa9.into_alternate_push_pull(crh) "TIM1_CH2" "high side of phase B, the same";
    c_high: PA10 [Alternate] = gpioa.pa10.into_alternate_push_pull(crh) "TIM1_CH3" "high side of phase C, the same";
    a_low: PB13 [Alternate] = gpiob.pb13.into_alternate_push_pull(crh) "TIM1_CH1N" "low side of phase A, the same";
    b_low: PB14 [Alternate] = gpiob.pb14.into_alternate_push_pull(crh) "TIM1_CH2N" "low side of phase B, the same";
    c_low: PB15 [Alternate] = gpiob.pb15.into_alternate_push_pull(crh) "TIM1_CH3N" "low side of phase C, the same";
    stop: PB12 [Input<PullUp>] = gpiob.pb12.into_pull_up_input(crh) "TIM1_BKIN" "low: gate driver's fault or over-current comparator, both open drain";
    hall_1: PB6 [Input<PullUp>] = gpiob.pb6.into_pull_up_input(crl) "TIM4_CH1" "bit 0 of the hall code; open collector";
    hall_2: PB7 [Input<PullUp>] = gpiob.pb7.into_pull_up_input(crl) "TIM4_CH2" "bit 1, the same";
    hall_3: PB8 [Input<PullUp>] = gpiob.pb8.into_pull_up_input(crh) "TIM4_CH3" "bit 2, the same";
    current: PA5 [Analog] = gpioa.pa5.into_analog(crl) "ADC1_IN5" "supply current";
    voltage: PA1 [Analog] = gpioa.pa1.into_analog(crl) "ADC1_IN1" "supply voltage";
    strain: PA2 [Analog] = gpioa.pa2.into_analog(crl) "ADC1_IN2" "strain gauge: SG, ANA0";
    motor_temp: PA3 [Analog] = gpioa.pa3.into_analog(crl) "ADC1_IN3" "thermistor on the motor's housing: THERM, ANA1";
    board_temp: PA4 [Analog] = gpioa.pa4.into_analog(crl) "ADC1_IN4" "thermistor beside the bridge: TEMP";
    brake: PB5 [Output] = gpiob.pb5.into_push_pull_output(crl) "GPIO" "high: coil on, spread free, yellow LED lit; pulled down";
}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pins_and_names_are_unique() {
        let pins: std::vec::Vec<&Pin> = BUS.iter().chain(MOTOR).collect();
        assert!(pins.len() > 20);
        for (i, pin) in pins.iter().enumerate() {
            for other in pins.iter().skip(i + 1) {
                assert!(pin.pin != other.pin && pin.name != other.name, "{} and {}", pin.name, other.name);
            }
        }
    }
}
