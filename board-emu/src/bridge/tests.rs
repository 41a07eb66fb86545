use super::*;
use crate::chip::{Chip, Peripheral};
use hil_world::board::SimBoard;
use hil_world::plant::Model;
use tater_wire::Node;

const TIM1: u32 = 0x4001_2C00;
const CR1: u32 = TIM1;
const CCMR1: u32 = TIM1 + 0x18;
const CCMR2: u32 = TIM1 + 0x1C;
const CCER: u32 = TIM1 + 0x20;
const ARR: u32 = TIM1 + 0x2C;
const CCR1: u32 = TIM1 + 0x34;
const BDTR: u32 = TIM1 + 0x44;
const GPIOA_CRH: u32 = 0x4001_0804;
const GPIOB_CRH: u32 = 0x4001_0C04;
/// OSSR, OSSI, MOE.
const HELD: u32 = 3 << 10;
const MOE: u32 = 1 << 15;
/// CCxE and CCxNE of channels 1 to 3.
const ALL: u32 = 0x0555;

/// Bypasses the clock enables.
fn write(chip: &mut Chip, address: u32, value: u32) {
    let now = chip.now;
    match address.checked_sub(TIM1) {
        Some(offset) => chip.tim1.write(offset, value, now),
        None => chip.gpio.write(address - 0x4001_0800, value, now),
    }
    .unwrap();
}

/// TIM1 on its pins, centered PWM at 20 kHz, `bdtr` with the dead time.
fn board(compares: [u32; 3], ccer: u32, bdtr: u32) -> Chip {
    let mut chip = Chip::new(1, [0; 3]);
    chip.gpio.driven[1][12] = Some(true);
    chip.pins_changed();
    write(&mut chip, GPIOA_CRH, 0x4444_4BBB);
    write(&mut chip, GPIOB_CRH, 0xBBB4_4444);
    write(&mut chip, CR1, 1 << 5);
    write(&mut chip, ARR, 1800);
    write(&mut chip, CCMR1, 0x6060);
    write(&mut chip, CCMR2, 0x6060);
    for (index, compare) in (0..).zip(compares) {
        write(&mut chip, CCR1 + 4 * index, compare);
    }
    write(&mut chip, CCER, ccer);
    write(&mut chip, BDTR, bdtr);
    write(&mut chip, CR1, 1 << 5 | 1);
    chip
}

fn problem(compares: [u32; 3], ccer: u32, bdtr: u32) -> String {
    of(&board(compares, ccer, bdtr)).expect_err("no bridge does that")
}

#[test]
fn six_vectors_and_off() {
    use Leg::{Float, Low, Pwm};
    let vectors = [
        [Pwm, Low, Float],
        [Pwm, Float, Low],
        [Float, Pwm, Low],
        [Low, Pwm, Float],
        [Low, Float, Pwm],
        [Float, Low, Pwm],
    ];
    for legs in vectors {
        let compares = legs.map(|leg| if leg == Pwm { 450 } else { 0 });
        let mut ccer = ALL;
        for (index, leg) in legs.into_iter().enumerate() {
            if leg == Float {
                ccer &= !(4 << (4 * index));
            }
        }
        let seen = of(&board(compares, ccer, MOE | HELD | 36));
        // A quarter of 32768.
        let expected = Bridge::On { legs, duty: duty(8192, 32768) };
        assert_eq!(seen, Ok(expected));
    }
    assert_eq!(of(&board([450, 0, 0], ALL, HELD | 36)), Ok(Bridge::Off));
    assert_eq!(of(&Chip::new(1, [0; 3])), Ok(Bridge::Off), "after a reset");
}

#[test]
fn compare_value_round_trips_through_duty() {
    for compare in 0..=1800 {
        let Bridge::On { duty, .. } = (Bridge::On { legs: [Leg::Pwm; 3], duty: duty(compare, 1800) }) else {
            panic!()
        };
        let steps = f64::from(duty.0.to_bits()) / 32768.0 * 1800.0;
        assert_eq!(steps.round(), f64::from(compare));
    }
}

#[test]
fn extreme_compare_values_lose_their_pulse() {
    let legs_of = |compare: u32| match of(&board([compare, 0, 0], ALL & !0x400, MOE | HELD | 36)) {
        Ok(Bridge::On { legs, duty: seen }) => (legs[0], seen),
        other => panic!("{other:?}"),
    };
    assert_eq!(legs_of(0), (Leg::Low, duty(0, 1)));
    // The dead time swallows it, in the model too.
    assert_eq!(legs_of(18), (Leg::Pwm, duty(18, 1800)));
    assert_eq!(legs_of(1800), (Leg::Pwm, duty(1, 1)));
}

#[test]
fn shoot_through_is_an_error() {
    assert!(problem([450, 0, 0], ALL, MOE | HELD).contains("dead time of 0 ns"));
    assert!(problem([450, 0, 0], ALL, MOE | HELD | 17).contains("dead time of 236 ns"));
    assert!(of(&board([450, 0, 0], ALL, MOE | HELD | 18)).is_ok(), "250 ns are enough");
    // Inverted polarity of the low side: on together with the high side.
    assert!(problem([450, 0, 0], ALL | 8, MOE | HELD | 36).contains("both switches conduct"));
    assert!(problem([0, 0, 0], ALL | 2, MOE | HELD | 36).contains("leg A: both switches conduct"));
    // Both inverted: the intended dead time turns both on.
    assert!(problem([450, 0, 0], ALL | 2 | 8, MOE | HELD | 36).contains("both switches conduct"));
    // Idle levels that turn one side on are legal; the timer ignores those that turn on both; the ports do
    // not.
    let mut chip = board([0; 3], ALL, HELD | 36);
    write(&mut chip, GPIOA_CRH, 0x4444_4BB3);
    write(&mut chip, GPIOB_CRH, 0xBB34_4444);
    write(&mut chip, 0x4001_0810, 1 << 8);
    write(&mut chip, 0x4001_0C10, 1 << 13);
    assert!(of(&chip).unwrap_err().contains("leg A: both switches conduct"));
}

#[test]
fn states_unknown_to_the_motor_model_are_errors() {
    assert!(problem([450, 0, 0], ALL & !4, MOE | HELD | 36).contains("only its high side"));
    assert!(problem([450, 0, 0], ALL & !1, MOE | HELD | 36).contains("only its low side"));
    assert!(problem([450, 451, 0], ALL, MOE | HELD | 36).contains("different compare values [450, 451]"));
    let mut chip = board([450, 0, 0], ALL, MOE | HELD | 36);
    write(&mut chip, ARR, 900);
    assert!(of(&chip).unwrap_err().contains("1800 clocks"));
}

#[test]
fn undriven_gate_is_an_error_while_the_bridge_is_on() {
    let mut chip = board([450, 0, 0], ALL, MOE | HELD | 36);
    write(&mut chip, GPIOB_CRH, 0xBB44_4444);
    assert_eq!(of(&chip), Err("gate at PB13: not driven while the bridge is on".to_owned()));
    write(&mut chip, GPIOB_CRH, 0xBBF4_4444);
    assert!(of(&chip).unwrap_err().contains("not driven"), "open drain cannot switch it on");
    write(&mut chip, GPIOB_CRH, 0xBB34_4444);
    assert!(of(&chip).unwrap_err().contains("the port has it"));
    // OSSR 0: the timer releases the low side of a floating leg.
    assert!(problem([450, 0, 0], ALL & !0x400, MOE | 36).contains("gate at PB15: not driven"));
    // With the bridge off the pull-down holds it.
    write(&mut chip, GPIOB_CRH, 0xBB44_4444);
    write(&mut chip, BDTR, HELD | 36);
    assert_eq!(of(&chip), Ok(Bridge::Off));
    write(&mut chip, GPIOB_CRH, 0xBB84_4444);
    write(&mut chip, 0x4001_0C10, 1 << 13);
    assert!(of(&chip).unwrap_err().contains("pull-down"));
}

#[test]
fn break_switches_off_without_an_instruction() {
    let mut chip = board([450, 0, 0], ALL, MOE | HELD | 36 | 1 << 12);
    assert!(matches!(of(&chip), Ok(Bridge::On { .. })));
    chip.tim1.gates_changed = false;
    chip.now += 1;
    chip.gpio.driven[1][12] = Some(false);
    chip.pins_changed();
    assert!(chip.tim1.gates_changed);
    assert_eq!(of(&chip), Ok(Bridge::Off));
}

#[test]
fn dead_time_must_match_the_motor_model() {
    let standard = SimBoard::standard(Node::new(1).unwrap(), Model::Averaged, 1);
    let with = |dtg: u32| dead_time_agrees(&board([450, 0, 0], ALL, MOE | HELD | dtg), standard.rig());
    assert_eq!(with(36), Ok(()));
    let text = with(72).unwrap_err();
    assert_eq!(text, "dead time 1000 ns by TIM1 and 500 ns in the motor's model (dead_time_us)");
}
