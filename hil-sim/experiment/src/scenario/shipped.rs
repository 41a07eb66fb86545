//! The scenarios built into the program.

/// A built-in scenario.
pub struct Shipped {
    /// Its name: the file's name without `.toml`.
    pub name: &'static str,
    /// The file's path, for errors.
    pub file: &'static str,
    /// Its text.
    pub text: &'static str,
}

macro_rules! shipped {
    ($($name:literal)*) => {
        /// The shipped scenarios.
        pub const SHIPPED: &[Shipped] = &[$(Shipped {
            name: $name,
            file: concat!("hil-sim/scenarios/", $name, ".toml"),
            text: include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../scenarios/", $name, ".toml")),
        }),*];
    };
}

shipped! {
    "spread-full-travel"
    "link-full-travel"
    "tip-full-travel"
    "link-fast"
    "tip-fast"
    "stall-on-object"
    "stall-hold"
    "spread-hold-disturbance"
    "slow-crawl"
    "replan-midway"
    "realtime-velocity"
    "torque-close"
    "strain-stop"
    "breakaway-link"
    "hall-glitch"
    "overtemp"
    "homing"
    "homing-link"
    "homing-spread"
    "homing-tip"
    "homing-jammed"
    "coast-low-ke"
    "low-bus"
}
