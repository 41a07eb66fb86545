//! The hand's parameters: PSET, PGET, PLOAD, PSAVE, PDEF and their lists; and the two that GOD maintains itself, PTEMP and UPSECS.

use core::convert::Infallible;

use super::arguments::{Rule, describe, is_listed, names, pairs};
use crate::god::{God, LINE_END};
use crate::grammar::Arguments;
use crate::memory::HandParameters;
use crate::parameter::{self, BAUDS, COMPATS, HAND, HandParameter, HandParameterSpec};
use crate::status::Status;
use crate::words::words;

/// Interval of storing UPSECS, µs: a power failure loses up to this much.
const STORE_US: u64 = 60_000_000;

const SECOND_US: u64 = 1_000_000;

const fn rule(row: &HandParameterSpec) -> Rule {
    Rule { writable: row.writable, min: row.min, max: row.max }
}

fn value(god: &God<'_>, parameter: HandParameter) -> i64 {
    let hand = god.memory.parameters().hand;
    match parameter {
        HandParameter::Baud => hand.baud.into(),
        HandParameter::Lft => hand.lft.into(),
        HandParameter::Otemp => hand.otemp.into(),
        HandParameter::Temp => god.io.temperature().into(),
        HandParameter::Ptemp => god.memory.read(|stored| stored.peak_temperature.into()),
        HandParameter::Upsecs => {
            let stored = god.memory.read(|stored| stored.up_seconds);
            stored.wrapping_add(uncounted_seconds(god)).into()
        }
        HandParameter::Sn => god.memory.read(|stored| stored.serial.into()),
        HandParameter::Lfdpd => hand.lfdpd.into(),
        HandParameter::Compat => {
            if hand.compat_262 {
                262
            } else {
                0
            }
        }
    }
}

/// Whether a value in a row's range is one of the parameter's.
fn admits(parameter: HandParameter, value: i64) -> bool {
    match parameter {
        HandParameter::Baud => BAUDS.contains(&value),
        HandParameter::Compat => COMPATS.contains(&value),
        _ => true,
    }
}

fn put(hand: &mut HandParameters, parameter: HandParameter, value: i64) {
    match parameter {
        HandParameter::Baud => hand.baud = value.try_into().unwrap_or(hand.baud),
        HandParameter::Lft => hand.lft = value != 0,
        HandParameter::Otemp => hand.otemp = value.try_into().unwrap_or(hand.otemp),
        HandParameter::Lfdpd => hand.lfdpd = value != 0,
        HandParameter::Compat => hand.compat_262 = value != 0,
        HandParameter::Temp | HandParameter::Ptemp | HandParameter::Upsecs | HandParameter::Sn => {}
    }
}

pub(super) fn set(god: &God<'_>, arguments: Arguments<'_>) -> Status {
    let mut hand = god.memory.parameters().hand;
    let own_serial = god.memory.read(|stored| stored.serial);
    let mut serial = own_serial;
    for pair in pairs(arguments, parameter::hand, rule) {
        match pair {
            Err(status) => return status,
            Ok((row, value)) if !admits(row.parameter, value) => return Status::INVALID_VALUE,
            // Once in the hand's life, 0 being none: nothing resets it (manual 5.4.2).
            Ok((row, _)) if row.parameter == HandParameter::Sn && serial != 0 => return Status::READ_ONLY,
            Ok((row, value)) if row.parameter == HandParameter::Sn => {
                serial = value.try_into().unwrap_or(serial);
            }
            Ok((row, value)) => put(&mut hand, row.parameter, value),
        }
    }
    if serial != own_serial {
        god.memory.update(|stored| stored.serial = serial);
    }
    god.io.set_baud(hand.baud);
    god.memory.change_parameters(|parameters| parameters.hand = hand);
    Status::OK
}

pub(super) async fn get(god: &God<'_>, arguments: Arguments<'_>) -> Status {
    let rows = match names(arguments, parameter::hand) {
        Ok(rows) => rows,
        Err(status) => return status,
    };
    let mut before = LINE_END;
    for row in rows {
        god.io.print(words![before, value(god, row.parameter)]).await;
        before = " ";
    }
    Status::OK
}

pub(super) fn load(god: &God<'_>) -> Status {
    let hand = god.memory.read(|stored| stored.parameters.hand);
    god.io.set_baud(hand.baud);
    god.memory.change_parameters(|parameters| parameters.hand = hand);
    Status::OK
}

pub(super) fn save(god: &God<'_>) -> Status {
    let hand = god.memory.parameters().hand;
    god.memory.update(|stored| stored.parameters.hand = hand);
    Status::OK
}

pub(super) fn reset_to_defaults(god: &God<'_>) -> Status {
    let hand = HandParameters::default();
    god.io.set_baud(hand.baud);
    god.memory.change_parameters(|parameters| parameters.hand = hand);
    Status::OK
}

pub(super) async fn list(god: &God<'_>, all: bool) -> Status {
    for row in HAND.iter().filter(|row| is_listed(row.category, all)) {
        describe(god, row.name, rule(row), row.help).await;
    }
    Status::OK
}

pub(super) async fn list_values(god: &God<'_>, all: bool) -> Status {
    for row in HAND.iter().filter(|row| is_listed(row.category, all)) {
        god.print_line(words![row.name, " ", value(god, row.parameter)]).await;
    }
    Status::OK
}

fn uncounted_seconds(god: &God<'_>) -> u32 {
    let us = god.io.now_us().saturating_sub(god.counted_us.get());
    u32::try_from(us / SECOND_US).unwrap_or(u32::MAX)
}

pub(crate) fn update_statistics(god: &God<'_>) {
    let seconds = uncounted_seconds(god);
    god.counted_us.set(god.counted_us.get().saturating_add(u64::from(seconds) * SECOND_US));
    god.memory.note(|stored| {
        // It wraps after 136 years (manual 5.4.2).
        stored.up_seconds = stored.up_seconds.wrapping_add(seconds);
        stored.peak_temperature = stored.peak_temperature.max(god.io.temperature());
    });
}

/// Stores UPSECS each minute, and PTEMP as it rises. Never ends.
pub(crate) async fn maintain_statistics(god: &God<'_>) -> Infallible {
    loop {
        let due_us = god.counted_us.get().saturating_add(STORE_US);
        let peak = god.memory.read(|stored| stored.peak_temperature);
        god.io.wait_until(due_us, || (god.io.temperature() > peak).then_some(())).await;
        update_statistics(god);
    }
}
