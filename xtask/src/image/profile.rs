//! The two builds of the application.

use clap::ValueEnum;

/// Build of the application. The monitor is the same in both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Profile {
    /// With log strings, for a debug probe
    Release,
    /// Without
    Production,
}

impl Profile {
    pub const fn name(self) -> &'static str {
        match self {
            Self::Release => "release",
            Self::Production => "production",
        }
    }
}
