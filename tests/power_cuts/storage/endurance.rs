//! The effect of years of use on the counters and on the flash.

use super::{Counters, LOSS, Progress, Property, SimFlash, Store, scenarios, step, stored};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use tater_f103::map::{FLASH, MAP, PAGE, STORAGE};

/// Erase endurance of a page (STM32F103 data sheet, minimum).
const ENDURANCE: u32 = 10_000;

/// Erases of the most and of the least erased page of the storage.
fn wear(flash: &SimFlash) -> (u32, u32) {
    let first = ((STORAGE.start - FLASH.start) / PAGE) as usize;
    let pages = &flash.erases()[first..first + MAP.pages(STORAGE) as usize];
    let sorted = pages.iter().copied().collect::<std::collections::BTreeSet<_>>();
    sorted.last().copied().zip(sorted.first().copied()).expect("eight pages")
}

fn finish(store: &mut Store, flash: &mut SimFlash) {
    assert_eq!(step(store, flash, 5000, false), Progress::Done);
}

/// A board from one power-up to the next: its true counts, as passed to `count`.
struct Board {
    counted: Counters,
    /// Counts of an incomplete revolution.
    rest: u32,
    tenths: u32,
}

impl Board {
    /// Advances a tenth of a second at a speed, in counts/s.
    fn run(&mut self, speed: u32, temperature: i16) {
        self.tenths += 1;
        self.counted.upsecs += u32::from(self.tenths.is_multiple_of(10));
        self.rest += speed / 10;
        self.counted.odometer += self.rest / 18;
        self.rest %= 18;
        self.counted.ptemp = self.counted.ptemp.max(temperature);
    }
}

/// Seconds, revolutions, 0.1 °C.
type Amounts = [i64; 3];

fn amounts(counters: Counters) -> Amounts {
    [counters.upsecs.into(), counters.odometer.into(), counters.ptemp.into()]
}

fn loss(of: Counters, left: Counters) -> Amounts {
    let (of, left) = (amounts(of), amounts(left));
    std::array::from_fn(|i| of[i] - left[i])
}

#[derive(Default)]
struct Life {
    /// Lower bound of the flash's counters: their values after the last cut, or those stored exactly since.
    kept: Counters,
    /// Seconds and revolutions in all cycles, as if none had been lost.
    counted: [i64; 2],
    cuts: i64,
    /// The largest loss in a cycle, in seconds, counts and 0.1 °C.
    worst: Amounts,
}

/// Runs until the power fails, in an operation or between two; or, in one case of eight, until everything is stored.
fn cycle(flash: &mut SimFlash, rng: &mut Pcg64Mcg, life: &mut Life) {
    let mut store = Store::open(flash);
    let start = store.counters();
    assert!(loss(life.kept, start).iter().all(|lost| *lost <= 0), "{start:?} is less than {:?}", life.kept);
    let mut board = Board { counted: start, rest: 0, tenths: 0 };
    if rng.random() {
        flash.cut_at(flash.operations() + rng.random_range(0..80), rng.random());
    }
    // Up to five minutes, standing or at full speed (1,057 counts/s). One day in forty is the hottest so far.
    let speed = [0, 500, 1057][rng.random_range(0..3)];
    let (mut temperature, hottest) =
        (start.ptemp - 20, start.ptemp + [5, -5][usize::from(rng.random_range(0..40) > 0)]);
    for _ in 0..rng.random_range(0..3000) {
        temperature = (temperature + rng.random_range(-3..=5)).min(hottest);
        board.run(speed, temperature);
        store.count(board.counted);
        if rng.random_range(0..200) == 0 {
            store.set(Property::X0, rng.random_range(-9..9));
        }
        step(&mut store, flash, 100, false);
        if flash.is_dead() {
            break;
        }
    }
    let [seconds, turns, _] = loss(board.counted, start);
    life.counted = [life.counted[0] + seconds, life.counted[1] + turns];
    if !flash.is_dead() && rng.random_range(0..4) == 0 {
        store.reset_counters(board.counted);
        finish_or_cut(&mut store, flash);
        if !flash.is_dead() {
            life.kept = board.counted;
            return;
        }
    }
    flash.power_up();
    let left = Store::open(flash).counters();
    let lost = loss(board.counted, left);
    // The bound that `storage` states: 60 s, 9,000 counts, 1.0 °C.
    assert!(std::iter::zip(lost, amounts(LOSS)).all(|(lost, most)| lost <= most), "lost {lost:?}");
    let lost = [lost[0], 18 * lost[1] + i64::from(board.rest), lost[2]];
    life.worst = std::array::from_fn(|i| life.worst[i].max(lost[i]));
    life.cuts += 1;
    life.kept = left;
}

fn finish_or_cut(store: &mut Store, flash: &mut SimFlash) {
    let progress = step(store, flash, 5000, false);
    assert!(flash.is_dead() || progress == Progress::Done);
}

#[test]
fn counters_survive_ten_thousand_power_cycles() {
    let (mut flash, mut rng) = (SimFlash::default(), Pcg64Mcg::new(6));
    let mut life = Life::default();
    for _ in 0..10_000 {
        cycle(&mut flash, &mut rng, &mut life);
    }
    let Life { counted, cuts, worst, .. } = life;
    let left = Store::open(&flash).counters();
    let lost = [counted[0] - i64::from(left.upsecs), counted[1] - i64::from(left.odometer)];
    println!(
        "figure: power cycles: 10000, {cuts} of them cut; lost at most {} s, {} counts, {} tenths of a degree in one; in all \
         {} of {} s, {} of {} revolutions",
        worst[0], worst[1], worst[2], lost[0], counted[0], lost[1], counted[1]
    );
    let stated = [i64::from(LOSS.upsecs), i64::from(18 * (LOSS.odometer + 1)), LOSS.ptemp.into()];
    assert_eq!(stated, [60, 9000, 10], "the module's text says so");
    assert!(worst[0] <= stated[0] && worst[1] < stated[1] && worst[2] <= stated[2]);
    // The bound is tight: the worst case comes near it.
    assert!(worst[0] >= 57 && worst[1] >= 8100 && worst[2] >= 1, "{worst:?}");
    // On average a cut costs half of the 58 s and of the 450 revolutions between updates of the flash; 10 % for chance.
    assert!(10 * lost[0] <= 11 * cuts * 29 && 10 * lost[1] <= 11 * cuts * 225, "{lost:?} in {cuts} cuts");
}

#[test]
fn five_thousand_saves_of_each_property_wear_no_page_out() {
    let mut flash = SimFlash::default();
    let mut store = Store::open(&flash);
    for save in 0..5000 {
        for property in stored() {
            // A prime that is no range's length, so that every save changes every property.
            let row = property.row();
            let value = match property {
                Property::HOSTUNITS => (save % 2) * row.max,
                _ => row.min + save * 7919 % (row.max - row.min + 1),
            };
            store.set(property, value);
            finish(&mut store, &mut flash);
        }
    }
    let (most, least) = wear(&flash);
    println!(
        "figure: 5,000 FSAVEs, of each property one by one: {most} erases of the most erased page, {least} of the least"
    );
    assert!(most <= 870, "more than the module says: {most}");
    assert!(most - least <= 1, "not spread: {least} to {most}");
}

/// Erases after years of counting, with calls so many seconds apart that the flash gets the same half-words.
fn years(years: u64, counts_per_s: u64, stride: usize) -> (u32, u32) {
    let mut flash = SimFlash::default();
    let mut store = Store::open(&flash);
    stored().for_each(|property| store.set(property, property.row().max));
    finish(&mut store, &mut flash);
    let whole = |number: u64| u32::try_from(number).expect("fits");
    let seconds = years * 31_557_600;
    for second in (0..seconds).step_by(stride) {
        let odometer = whole(second * counts_per_s / 18);
        store.count(Counters { upsecs: whole(second), odometer, ptemp: 400 });
        finish(&mut store, &mut flash);
    }
    assert!(Store::open(&flash).counters().upsecs + LOSS.upsecs >= whole(seconds) - stride as u32);
    wear(&flash)
}

#[test]
fn ten_years_of_counting_wear_no_page_out() {
    let standing = years(10, 0, 29);
    // As the module states: 315.6 million s / 58 s / 364 half-words / 8 pages.
    assert!((1800..=1890).contains(&standing.0), "{standing:?}");
    // A year of continuous movement at a finger's top speed stands for ten years of use.
    let moving = years(1, 500, 2);
    println!(
        "figure: erases of the most erased page: {} in ten years standing, {} in a year of moving all the time",
        standing.0, moving.0
    );
    // 9,240 in 9.9 years, as the module states.
    assert!(99 * moving.0 < 10 * 9_240 && 9_240 < ENDURANCE, "{moving:?}");
}

#[test]
fn day_with_the_bridge_on_loses_no_more_than_stated() {
    let mut flash = scenarios::used();
    let mut store = Store::open(&flash);
    finish(&mut store, &mut flash);
    let start = store.counters();
    let mut hours = 0;
    'driven: for hour in 1.. {
        for second in (hour - 1) * 3600..hour * 3600 {
            store.count(Counters { upsecs: start.upsecs + second, ..start });
            // Once a millisecond; a complete record takes up to 104.
            if step(&mut store, &mut flash, 1000, true) != Progress::Done {
                break 'driven;
            }
            if second % 10 == 0 && start.upsecs + second - Store::open(&flash).counters().upsecs > LOSS.upsecs
            {
                break 'driven;
            }
        }
        hours = hour;
    }
    println!("figure: with the bridge on and nothing erased, the stated loss holds for {hours} h");
    assert!(hours >= 32, "{hours}");
    assert_eq!(flash.erased_while_driven(), 0);
}
