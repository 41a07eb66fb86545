//! Pages with charts: one HTML file with style, script and numbers inside.
#![forbid(unsafe_code)]

mod alarms;
mod axis;
mod chart;
mod sheet;

pub use alarms::{Alarm, trade_off};
pub use chart::{Across, Chart, Column, Explore, Field, Kind, Level, Mark, Marked, Series, escape};
pub use sheet::Sheet;
