//! What property ERROR says: the servo's latched fault, or else that the flash has failed.

use super::Tater;
use crate::board::Board;
use servo_core::guard::fault::Fault;
use tater_wire::FaultCode;

/// The row of a fault of the servo.
#[must_use]
pub const fn code(fault: Fault) -> FaultCode {
    match fault {
        Fault::Halls => FaultCode::Halls,
        Fault::OverCurrent => FaultCode::OverCurrent,
        Fault::OverTemperature => FaultCode::OverTemperature,
        Fault::OverVoltage => FaultCode::OverVoltage,
        Fault::UnderVoltage => FaultCode::UnderVoltage,
        Fault::Bridge => FaultCode::Bridge,
        Fault::HostLost => FaultCode::HostLost,
    }
}

impl<B: Board> Tater<B> {
    /// The latched fault. A fault of the servo goes before one of the flash, which does not stop the motor; STAT 2 clears
    /// both.
    pub(super) fn error(&self) -> Option<FaultCode> {
        let storage = self.storage_error.then_some(FaultCode::Storage);
        self.servo.telemetry().fault.map(code).or(storage)
    }
}
