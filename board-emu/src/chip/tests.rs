use super::*;
use crate::time::US;

fn register(chip: &mut Chip, address: u32, value: Option<u32>) -> u32 {
    let read = match value {
        Some(value) => chip.write(address, Size::Word, value).map(|()| 0),
        None => chip.read(address, Size::Word),
    };
    read.unwrap()
}

/// The alias of a bit (PM0056 2.2.5).
const fn bit(address: u32, bit: u32) -> u32 {
    (address & 0xF000_0000) + 0x0200_0000 + (address & 0x000F_FFFF) * 32 + bit * 4
}

#[test]
fn bit_band_alias_reads_and_writes_ram() {
    let mut chip = Chip::new(1, [0; 3]);
    chip.write(0x2000_4FFC, Size::Word, 0x8000_0001).unwrap();
    assert_eq!(bit(0x2000_0300, 2), 0x2200_6008, "the manual's example");
    let seen = [0, 1, 31].map(|b| chip.read(bit(0x2000_4FFC, b), Size::Word).unwrap());
    assert_eq!(seen, [1, 0, 1]);
    chip.write(bit(0x2000_4FFC, 1), Size::Word, 0xFF).unwrap();
    chip.write(bit(0x2000_4FFC, 31), Size::Word, 0xFE).unwrap();
    assert_eq!(chip.read(0x2000_4FFC, Size::Word), Ok(3), "only bit 0 of what is written counts");
    // A bit of the upper byte, by the address of that byte.
    assert_eq!(bit(0x2000_4FFF, 7), bit(0x2000_4FFC, 31));
}

/// TIM3, counting to an update at once.
fn flagged() -> Chip {
    let mut chip = Chip::new(1, [0; 3]);
    // Its clock, where that is modeled.
    let _ = chip.write(0x4002_101C, Size::Word, 1 << 1);
    register(&mut chip, 0x4000_042C, Some(9));
    register(&mut chip, 0x4000_0414, Some(1));
    chip
}

#[test]
fn bit_band_write_is_a_read_modify_write() {
    let mut chip = flagged();
    assert_eq!(register(&mut chip, 0x4000_0410, None), 1);
    // Writing a bit of SR reads the whole and writes it back: ones leave the flags as they are.
    register(&mut chip, bit(0x4000_0410, 6), Some(0));
    assert_eq!(register(&mut chip, 0x4000_0410, None), 1);
    register(&mut chip, bit(0x4000_0410, 0), Some(0));
    assert_eq!(register(&mut chip, 0x4000_0410, None), 0);
    register(&mut chip, bit(0x4000_0400, 0), Some(1));
    // Two clocks of 8 MHz, the clock after a reset.
    chip.now += 2 * chip.rcc.timer_cycle();
    assert_eq!(chip.rcc.timer_cycle(), 18);
    assert_eq!(register(&mut chip, 0x4000_0424, None), 2);
    assert_eq!(register(&mut chip, bit(0x4000_0424, 1), None), 1);
}

#[test]
fn bit_band_read_has_the_side_effects_of_the_register() {
    let mut chip = Chip::new(1, [0; 3]);
    // A regular conversion is done: reading DR clears EOC.
    chip.adc.write(0x08, 1, 0).unwrap();
    chip.now = 10 * US;
    chip.adc.write(0x08, 1 | 7 << 17 | 1 << 20 | 1 << 22, chip.now).unwrap();
    chip.now = 20 * US;
    let _ = chip.write(0x4002_1018, Size::Word, 1 << 9);
    assert_eq!(register(&mut chip, 0x4001_2400, None) & 2, 2);
    register(&mut chip, bit(0x4001_244C, 0), None);
    assert_eq!(register(&mut chip, 0x4001_2400, None) & 2, 0);
}

#[test]
fn tim1_trigger_starts_the_converter() {
    let mut chip = Chip::new(1, [0; 3]);
    chip.pins_changed();
    chip.adc.write(0x08, 1 | 1 << 15, 0).unwrap();
    // Channel 4 in PWM mode 1, OC4REF as TRGO, centered, 20 kHz.
    for (offset, value) in
        [(0, 1 << 5), (4, 7 << 4), (0x1C, 0x6000), (0x2C, 1800), (0x40, 85), (0, 1 << 5 | 1)]
    {
        chip.tim1.write(offset, value, 0).unwrap();
    }
    chip.tim1.take_trigger();
    chip.set_analog([77; 18]);
    let due = (3600 - 85) * chip.rcc.timer1_cycle();
    assert_eq!(chip.tim1.next_event(), due);
    chip.advance(due);
    // JEOC after a conversion of 1.5 + 12.5 of its cycles.
    let done = due + 14 * chip.rcc.adc_cycle();
    assert_eq!(chip.adc.read(0, done - 1).unwrap() & 4, 0);
    assert_eq!((chip.adc.read(0, done).unwrap() & 4, chip.adc.read(0x3C, done)), (4, Ok(77)));
}

#[test]
fn low_break_input_acts_without_an_instruction() {
    let mut chip = Chip::new(1, [0; 3]);
    chip.pins_changed();
    chip.tim1.write(0x44, 1 << 15 | 1 << 12, 0).unwrap();
    chip.tim1.write(0x0C, 1 << 7, 0).unwrap();
    assert!(chip.tim1.is_on());
    chip.set_pin((1, 12), Some(false));
    assert!(!chip.tim1.is_on());
    assert_eq!(chip.interrupts(), 1 << irq::TIM1_BRK);
}

#[test]
fn edges_at_pins_interrupt_by_their_lines() {
    let mut chip = Chip::new(1, [0; 3]);
    for line in 0..16 {
        chip.set_pin((1, line), Some(false));
    }
    for exticr in [0x08, 0x0C, 0x10, 0x14] {
        chip.afio.write(exticr, 0x1111, 0).unwrap();
    }
    chip.exti.write(0x00, 0xFFFF, 0).unwrap();
    chip.exti.write(0x08, 0xFFFF, 0).unwrap();
    chip.pins_changed();
    for (line, number) in [(0, 6), (4, 10), (5, 23), (9, 23), (10, 40), (15, 40)] {
        chip.set_pin((1, line), Some(true));
        assert_eq!(chip.interrupts(), 1 << number, "line {line}");
        chip.exti.write(0x14, 0xFFFF, 0).unwrap();
        chip.set_pin((0, line), Some(true));
        assert_eq!(chip.interrupts(), 0, "another port");
    }
}
