use super::*;
use hil_world::board::SimBoard;
use hil_world::plant::Model;
use hil_world::rig::Bridge;
use tater_wire::Node;

fn rig() -> Rig {
    SimBoard::standard(Node::new(1).unwrap(), Model::Averaged, 1).rig().clone()
}

fn current(front_end: &mut FrontEnd, milliamps: i16, dt: f64) -> u16 {
    let mut seen = rig().analog();
    seen.current.0 = milliamps;
    front_end.codes(&seen, dt)[CURRENT]
}

#[test]
fn board_at_rest_reads_known_codes() {
    let inputs = FrontEnd::new().sample(&mut rig());
    // 24 V / 11 is 2.18 V of 3.3 V; 0 A is mid-scale; half a code of noise, and one more for the rig's
    // rounding.
    assert!(inputs[VOLTAGE].abs_diff(2708) <= 2, "{}", inputs[VOLTAGE]);
    assert!(inputs[CURRENT].abs_diff(2048) <= 2, "{}", inputs[CURRENT]);
    // The housing has 25 degrees: the thermistor equals its pull-up. A code is 0.02 degrees, the rig's step
    // 0.05.
    assert!(inputs[MOTOR_TEMP].abs_diff(2048) <= 4, "{}", inputs[MOTOR_TEMP]);
    // The board is 10 degrees warmer: 6.5 k.
    assert!(inputs[BOARD_TEMP].abs_diff(1610) <= 40, "{}", inputs[BOARD_TEMP]);
    assert_eq!(inputs[0], 0, "nothing is connected");
}

#[test]
fn current_passes_a_low_pass_of_1_khz() {
    // 12.5 A is 1.03 V above mid-scale: 1280 codes. After one time constant, 159 us: 1 - 1/e of it.
    let tau = 1.0 / (std::f64::consts::TAU * 1000.0);
    assert_eq!(current(&mut FrontEnd::new(), 12_500, 100.0 * tau), 2048 + 1280);
    assert_eq!(current(&mut FrontEnd::new(), -12_500, 100.0 * tau), 2048 - 1280);
    assert_eq!(current(&mut FrontEnd::new(), 12_500, tau), 2048 + 809);
    let mut front_end = FrontEnd::new();
    current(&mut front_end, 12_500, tau / 2.0);
    assert_eq!(current(&mut front_end, 12_500, tau / 2.0), 2048 + 809);
    assert_eq!(current(&mut FrontEnd::new(), 30_000, 1.0), 4095);
}

#[test]
fn thermistor_codes_match_the_beta_equation() {
    // Resistances of 10 k, B 3950 K, at 0, 25 and 60 degrees, in ohm: 33621, 10000, 2486.
    for (tenths, ohms) in [(0, 33_621.0), (250, 10_000.0), (600, 2_486.0)] {
        let expected = 4096.0 * ohms / (ohms + 10_000.0);
        assert!((f64::from(thermistor(tenths)) - expected).abs() < 1.0, "{tenths}");
    }
}

#[test]
fn largest_phase_current_is_kept_until_read() {
    use hil_world::rig::{Leg, duty};
    let (mut rig, mut front_end) = (rig(), FrontEnd::new());
    let bridge = Bridge::On { legs: [Leg::Pwm, Leg::Low, Leg::Float], duty: duty(900, 1800) };
    rig.advance(bridge, false, 300);
    front_end.sample(&mut rig);
    let peak = rig.truth().peak_phase_a;
    assert!(peak > 0.5, "{peak} A");
    while rig.now_us() < 2_000 {
        rig.advance(Bridge::Off, false, 2_000);
    }
    front_end.sample(&mut rig);
    while rig.now_us() < 2_050 {
        rig.advance(Bridge::Off, false, 2_050);
    }
    front_end.sample(&mut rig);
    assert!(rig.truth().peak_phase_a < peak);
    assert!(front_end.take_peak() >= peak);
    assert!(front_end.take_peak() < peak);
}
