//! The hand's parameters: PSET, PGET, PLOAD, PSAVE, PDEF and their lists; and the two that GOD keeps by itself, PTEMP and UPSECS.

use core::convert::Infallible;

use super::{Rule, describe, is_listed, names, pairs};
use crate::god::God;
use crate::memory::OfHand;
use crate::parameter::{self, BAUDS, GLOBAL, Global, GlobalRow};
use crate::status::Status;
use crate::words::Arguments;

/// How often UPSECS is stored, us: so much of it is lost with the power.
const STORE_US: u64 = 60_000_000;

const SECOND_US: u64 = 1_000_000;

const fn rule(row: &GlobalRow) -> Rule {
    Rule { writable: row.writable, min: row.min, max: row.max }
}

// --- one parameter --------------------------------------------------------------------------------------

/// The value of one.
fn value(god: &God<'_>, global: Global) -> i64 {
    let hand = god.parameters.borrow().hand;
    match global {
        Global::Baud => hand.baud.into(),
        Global::Lft => hand.lft.into(),
        Global::Otemp => hand.otemp.into(),
        Global::Temp => god.io.temperature().into(),
        Global::Ptemp => god.memory.look(|stored| stored.peak_temperature.into()),
        Global::Upsecs => {
            let stored = god.memory.look(|stored| stored.up_seconds);
            stored.wrapping_add(uncounted_seconds(god)).into()
        }
        Global::Sn => god.memory.look(|stored| stored.serial.into()),
        Global::Lfdpd => hand.lfdpd.into(),
    }
}

/// Sets one to a value in its range.
fn put(hand: &mut OfHand, global: Global, value: i64) {
    match global {
        Global::Baud => hand.baud = value.try_into().unwrap_or(hand.baud),
        Global::Lft => hand.lft = value != 0,
        Global::Otemp => hand.otemp = value.try_into().unwrap_or(hand.otemp),
        Global::Lfdpd => hand.lfdpd = value != 0,
        Global::Temp | Global::Ptemp | Global::Upsecs | Global::Sn => {}
    }
}

// --- the commands ---------------------------------------------------------------------------------------

pub(super) fn set(god: &God<'_>, arguments: Arguments<'_>) -> Status {
    let mut hand = god.parameters.borrow().hand;
    for pair in pairs(arguments, parameter::global, rule) {
        match pair {
            Err(status) => return status,
            Ok((row, value)) if row.global == Global::Baud && !BAUDS.contains(&value) => {
                return Status::INVALID_VALUE;
            }
            Ok((row, value)) => put(&mut hand, row.global, value),
        }
    }
    god.io.set_baud(hand.baud);
    god.parameters.borrow_mut().hand = hand;
    Status::OK
}

pub(super) async fn get(god: &God<'_>, arguments: Arguments<'_>) -> Status {
    let rows = match names(arguments, parameter::global) {
        Ok(rows) => rows,
        Err(status) => return status,
    };
    let mut before = crate::god::LINE_END;
    for row in rows {
        god.io.print(format_args!("{before}{}", value(god, row.global))).await;
        before = " ";
    }
    Status::OK
}

pub(super) fn load(god: &God<'_>) -> Status {
    let hand = god.memory.look(|stored| stored.parameters.hand);
    god.io.set_baud(hand.baud);
    god.parameters.borrow_mut().hand = hand;
    Status::OK
}

pub(super) fn save(god: &God<'_>) -> Status {
    let hand = god.parameters.borrow().hand;
    god.memory.change(|stored| stored.parameters.hand = hand);
    Status::OK
}

pub(super) fn default(god: &God<'_>) -> Status {
    let hand = OfHand::default();
    god.io.set_baud(hand.baud);
    god.parameters.borrow_mut().hand = hand;
    Status::OK
}

pub(super) async fn list(god: &God<'_>, all: bool) -> Status {
    for row in GLOBAL.iter().filter(|row| is_listed(row.category, all)) {
        describe(god, row.name, rule(row), row.help).await;
    }
    Status::OK
}

pub(super) async fn list_values(god: &God<'_>, all: bool) -> Status {
    for row in GLOBAL.iter().filter(|row| is_listed(row.category, all)) {
        god.answer(format_args!("{} {}", row.name, value(god, row.global))).await;
    }
    Status::OK
}

// --- what GOD keeps by itself ---------------------------------------------------------------------------

/// Whole seconds since UPSECS was counted last.
fn uncounted_seconds(god: &God<'_>) -> u32 {
    let us = god.io.now_us().saturating_sub(god.counted_us.get());
    u32::try_from(us / SECOND_US).unwrap_or(u32::MAX)
}

/// Stores UPSECS and PTEMP.
pub(crate) fn count(god: &God<'_>) {
    let seconds = uncounted_seconds(god);
    god.counted_us.set(god.counted_us.get().saturating_add(u64::from(seconds) * SECOND_US));
    god.memory.change(|stored| {
        // 136 years, and from 0 again (manual 5.4.2).
        stored.up_seconds = stored.up_seconds.wrapping_add(seconds);
        stored.peak_temperature = stored.peak_temperature.max(god.io.temperature());
    });
}

/// Stores UPSECS now and then, and PTEMP as it rises: in a hand's life not often. Never ends.
pub(crate) async fn keep(god: &God<'_>) -> Infallible {
    loop {
        let due_us = god.counted_us.get().saturating_add(STORE_US);
        let peak = god.memory.look(|stored| stored.peak_temperature);
        god.io.wait_until(due_us, || (god.io.temperature() > peak).then_some(())).await;
        count(god);
    }
}
