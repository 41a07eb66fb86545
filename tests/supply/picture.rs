//! `docs/supply.svg`: bus voltage and current of seven motors that stall, start and reverse at once.

use super::{Act, Hand, ORDER_US, Supply};
use crate::chart::{self, BLUE, ORANGE, Panel};

/// Shown from before the order to after it, µs, in steps.
const BEFORE_US: u64 = 20_000;
const AFTER_US: u64 = 120_000;
const STEP_US: u64 = 500;

/// Bus voltage and current into the motors, over ms after the order.
fn panels(title: &str, act: Act, torque: i64) -> [Panel; 2] {
    let mut hand = Hand::native([act; 7], None, Supply::new(24.0, 7));
    let (mut volts, mut amps) = (Vec::new(), Vec::new());
    hand.act([act; 7], torque, |at_us, supply| {
        let shown = (ORDER_US - BEFORE_US..=ORDER_US + AFTER_US).contains(&at_us);
        if shown && at_us.is_multiple_of(STEP_US) {
            let ms = (at_us as f64 - ORDER_US as f64) / 1e3;
            volts.push((ms, supply.volts()));
            amps.push((ms, supply.motors_a()));
        }
    });
    let x = (-20.0, 120.0, 20.0);
    [
        Panel {
            title: format!("{title}: bus in V over ms after the order (24 V, 30 A, 2.2 mF a board)"),
            x,
            y: (18.0, 32.0, 4.0),
            band: None,
            lines: vec![(BLUE, volts)],
        },
        Panel {
            title: "The same: current into the motors, A".to_owned(),
            x,
            y: (-30.0, 60.0, 30.0),
            band: None,
            lines: vec![(ORANGE, amps)],
        },
    ]
}

#[test]
fn picture_of_the_supply_is_current() {
    let rows = [
        ("Seven stalls, T 990 against the stop, from rest", Act::Stall, 990),
        ("Seven starts, T 990 from rest", Act::Start, 990),
        ("Seven reversals, T 990 at full speed the other way", Act::Reverse, 990),
        ("Seven reversals with T 300, which return the most", Act::Reverse, 300),
    ];
    let panels: Vec<Panel> =
        rows.into_iter().flat_map(|(title, act, torque)| panels(title, act, torque)).collect();
    chart::keep("supply.svg", "MAKE_SUPPLY_PICTURE", "supply::picture", &panels);
}
