//! The servo's modes, reasons and faults as the numbers of MODE, END and ERROR: the only place that knows both.

use servo_core::EndReason;
use servo_core::guard::fault::Fault;
use servo_core::mode::Mode;
use tater_wire::{EndCode, FaultCode, ModeCode};

/// `to_wire, from_wire: Servo = Wire { Variant, ... }`, for variants of the same name. `else None` where the wire has more.
macro_rules! one_to_one {
    ($(#[$doc:meta])* $to_wire:ident, $from_wire:ident: $servo:ident = $wire:ident
        { $($variant:ident),* } $(else $none:ident)?) => {
        $(#[$doc])*
        #[must_use]
        pub const fn $to_wire(of: $servo) -> $wire {
            match of {
                $($servo::$variant => $wire::$variant,)*
            }
        }

        /// The inverse; `None` if the servo has no such state.
        #[must_use]
        pub fn $from_wire(value: i64) -> Option<$servo> {
            match $wire::of(value)? {
                $($wire::$variant => Some($servo::$variant),)*
                $(_ => $none,)?
            }
        }
    };
}

one_to_one! {
    /// MODE of a mode.
    mode_code, mode: Mode = ModeCode { Idle, Torque, Pid, Velocity, Trapezoidal }
}

one_to_one! {
    /// END of a reason.
    end_code, end_reason: EndReason = EndCode { Arrived, Stalled, Aborted, Strain, Breakaway, Fault }
}

one_to_one! {
    /// ERROR of a fault.
    fault_code, fault: Fault = FaultCode
        { Halls, OverCurrent, OverTemperature, OverVoltage, UnderVoltage, Bridge, HostLost, Jammed, Wiring } else None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_number_of_mode_and_end_comes_back() {
        for number in -1..=7 {
            let back = mode(number).map(|mode| i64::from(mode_code(mode)));
            assert_eq!(back, ModeCode::of(number).map(i64::from), "MODE {number}");
            let back = end_reason(number).map(|reason| i64::from(end_code(reason)));
            assert_eq!(back, EndCode::of(number).map(i64::from), "END {number}");
        }
    }

    #[test]
    fn errors_of_the_servo_come_back_and_those_of_storage_and_monitor_are_none() {
        for row in tater_wire::fault::ROWS {
            let of_monitor = i64::from(row.code) >= i64::from(FaultCode::NoApplication);
            let is_servos = !of_monitor && row.code != FaultCode::Storage;
            assert_eq!(fault(row.code.into()).map(fault_code), is_servos.then_some(row.code), "{}", row.name);
        }
    }
}
