//! The winding of an emulated board over resets and a power cut (decision 0051).

use servo_core::guard::thermal::DISABLED;
use tater_wire::{Cmd, Property};

use super::bench::{Bench, production};
use crate::heat::MOST_C;

/// Stalls at full torque, ms; the has 3 s. Three of them without a model that is kept reach 165 °C.
const STALL_MS: u64 = 2500;

impl Bench {
    fn winding_c(&self) -> f64 {
        self.board().rig().truth().winding_c
    }

    /// Off the stop and back, against it at full torque; returns the highest temperature, °C.
    fn stall(&mut self) -> f64 {
        for (property, value) in [
            (Property::MT, 990),
            (Property::TSTOP, 0),
            (Property::OTEMP, DISABLED.into()),
            (Property::MODE, 2),
            (Property::T, 990),
        ] {
            self.set(property, value);
        }
        let mut hottest = self.winding_c();
        for at in 0..STALL_MS / 100 {
            self.set(Property::T, if at < 3 { 990 } else { -990 });
            self.wait_ms(100);
            hottest = hottest.max(self.winding_c());
        }
        hottest
    }
}

#[test]
fn stalls_with_resets_and_a_power_cut_stay_below_the_winding_limit() {
    let Some(programs) = production() else { return };
    let mut bench = Bench::awake(&programs);
    let mut hottest = 0.0_f64;
    for round in 0..4 {
        hottest = hottest.max(bench.stall());
        if round == 2 {
            // The RAM is lost; the mark in the flash is not.
            bench.board_mut().power_off();
            bench.wait_ms(20);
            bench.board_mut().power_on();
        } else {
            bench.set(Property::CMD, Cmd::Reset.number().into());
        }
        bench.wait_ms(100);
        assert_eq!(bench.get(Property::STAT), Some(0), "in the monitor");
        bench.wake();
    }
    println!("figure: emulated: four stalls of 2.5 s, three resets, a power cut: {hottest:.1} °C");
    // The model starts at 100 °C, so the true winding, which starts at 25, stays far below.
    assert!(hottest > 60.0 && hottest <= MOST_C, "{hottest:.1} °C");
}
