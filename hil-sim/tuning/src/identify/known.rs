//! What is known of a motor before it is identified.

use hil_experiment::motor_file::MotorFile;
use hil_world::plant::PlantParams;
use servo_core::motor::Motor;
use tater_wire::MotorKind;

/// What is known of a motor before its recording.
#[derive(Clone, Debug)]
pub struct Known {
    /// First guess of what is identified. L within 10 %, heat, diodes and dead time are taken from it, and the counts of a revolution.
    pub(crate) plant: PlantParams,
    /// Volts of a torque unit of its board.
    pub(crate) unit_v: f64,
}

impl Known {
    /// A motor of the hand.
    #[must_use]
    pub fn hands() -> Self {
        Self::new(PlantParams::for_motor(MotorKind::Link), &Motor::HAND)
    }

    /// A motor that a file describes.
    #[must_use]
    pub fn described(file: &MotorFile) -> Self {
        Self::new(file.plant(MotorKind::Link, &PlantParams::for_motor(MotorKind::Link)), file.motor())
    }

    fn new(plant: PlantParams, motor: &Motor) -> Self {
        Self { plant, unit_v: f64::from(motor.full_mv()) / 1_024_000.0 }
    }
}
