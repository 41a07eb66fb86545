//! Activities of a board at the time of a power cut.

use super::script::{Act, run, stored};
use boot::Flash;
use boot::storage::{Counters, Store};
use hil_world::rig::flash::SimFlash;
use rand::RngExt;
use tater_f103::map::{MAP, STORAGE};
use tater_wire::Property;

const FINISH: Act = Act::Steps { most: 3000, bridge_on: false };

const DRIVEN: Act = Act::Steps { most: 3000, bridge_on: true };

pub struct Scenario {
    pub name: &'static str,
    pub flash: SimFlash,
    pub script: Vec<Act>,
}

fn after(mut flash: SimFlash, script: &[Act]) -> SimFlash {
    run(script, &mut Store::open(&flash), &mut flash);
    flash
}

/// A flash with the pages prepared, every property stored, and counters.
pub fn used() -> SimFlash {
    let mut script: Vec<Act> = stored().map(|property| Act::Set(property, property.row().min)).collect();
    script.extend([Act::Count(counted(5000)), FINISH]);
    after(SimFlash::default(), &script)
}

fn nearly_full(left: usize) -> SimFlash {
    let (mut flash, mut value) = (used(), 0);
    let last = MAP.page(STORAGE, 1) - 2 * (left as u32 + 8);
    while flash.half_word(last) == u16::MAX {
        value += 1;
        flash = after(flash, &[Act::Set(Property::X5, value), FINISH]);
    }
    flash
}

fn noise() -> SimFlash {
    let mut rng = rand_pcg::Pcg64Mcg::new(7);
    let mut flash = SimFlash::default();
    let noise: Vec<u8> = (0..STORAGE.len).map(|_| rng.random()).collect();
    flash.load(STORAGE.start, &noise);
    flash
}

/// Counters of a board that moves much, after so many seconds.
fn counted(seconds: u32) -> Counters {
    let ptemp = i16::try_from(seconds / 100).unwrap_or(i16::MAX);
    Counters { upsecs: seconds, odometer: 18 * seconds, ptemp }
}

fn one_by_one(values: fn(Property) -> i64, how_many: usize, store: Act) -> Vec<Act> {
    stored().take(how_many).flat_map(|property| [Act::Set(property, values(property)), store]).collect()
}

fn together(values: fn(Property) -> i64) -> Vec<Act> {
    stored().map(|property| Act::Set(property, values(property))).chain([FINISH]).collect()
}

fn highest(property: Property) -> i64 {
    property.row().max
}

fn middle(property: Property) -> i64 {
    (property.row().min + property.row().max) / 2
}

/// A position saved, consumed, saved again, with other saves between, and consumed while it is being written.
fn trust() -> Vec<Act> {
    let few = |most| Act::Steps { most, bridge_on: false };
    let (save, other) = (Act::SavePosition(-12, 3), Act::Set(Property::X1, 77));
    let mut script = vec![save, FINISH, other, FINISH, Act::Distrust, Act::Set(Property::X1, 78), FINISH];
    script.extend([
        Act::SavePosition(40, 5),
        FINISH,
        Act::SavePosition(41, 1),
        few(4),
        Act::Distrust,
        FINISH,
    ]);
    script.extend([
        Act::SavePosition(42, 2),
        FINISH,
        Act::Set(Property::P, 9),
        few(3),
        Act::Distrust,
        FINISH,
    ]);
    script
}

/// FIND's record of a wiring, and that of its mirror image with the direction confirmed; the position is not trusted any more.
fn wiring() -> Vec<Act> {
    let learned = Act::Set(Property::WIRING, 1 + 2 * 17);
    let confirmed = Act::Set(Property::WIRING, 2 + 2 * 65);
    vec![Act::SavePosition(7, 3), FINISH, learned, Act::Distrust, FINISH, confirmed, Act::Distrust, FINISH]
}

fn interleaved() -> Vec<Act> {
    let step = |most| Act::Steps { most, bridge_on: false };
    let mut script = Vec::new();
    for round in 0..6 {
        for (i, property) in [Property::X0, Property::X1, Property::MT, Property::CT].into_iter().enumerate()
        {
            script.extend([Act::Set(property, 10 * round + 1), step(i + 2), Act::Set(Property::X2, round)]);
        }
        script.extend([step(5), Act::Forget(Property::X1), step(2)]);
    }
    script.push(FINISH);
    script
}

pub fn all() -> Vec<Scenario> {
    let scenario = |name, flash, script| Scenario { name, flash, script };
    let counting = |seconds: std::ops::Range<u32>| {
        seconds.flat_map(|second| [Act::Count(counted(second)), DRIVEN]).chain([FINISH]).collect()
    };
    let reset = Counters { upsecs: 3, odometer: 0, ptemp: -20 };
    vec![
        scenario("first save, erased flash", SimFlash::default(), vec![Act::Set(Property::MT, 500), FINISH]),
        scenario("first save, random flash", noise(), vec![Act::Set(Property::MT, 500), FINISH]),
        scenario("all together", used(), [together(highest), together(middle)].concat()),
        scenario("all together, next page", nearly_full(60), together(highest)),
        scenario("one by one", used(), one_by_one(highest, 44, FINISH)),
        scenario("one by one, next page", nearly_full(30), one_by_one(middle, 12, FINISH)),
        scenario(
            "one by one, bridge on",
            nearly_full(20),
            [one_by_one(highest, 9, DRIVEN), vec![FINISH]].concat(),
        ),
        scenario("sets during records", used(), interleaved()),
        scenario("sets during records, next page", nearly_full(40), interleaved()),
        scenario("trust", used(), trust()),
        scenario("trust, next page", nearly_full(25), trust()),
        scenario("wiring", used(), wiring()),
        scenario("wiring, next page", nearly_full(20), wiring()),
        scenario("counters", used(), counting(5000..5900)),
        scenario("counters, next page", nearly_full(20), counting(5000..5900)),
        scenario(
            "counters set back",
            nearly_full(17),
            vec![Act::ResetCounters(reset), FINISH, Act::ResetCounters(counted(9)), FINISH],
        ),
    ]
}
