//! What a board keeps: counters, saved properties, and everything while it refuses.

use servo_core::mode::Mode;
use tater_fw::events::BoardEvent;
use tater_fw::storage::LOSS;
use tater_wire::property::{Access, ROWS, Stored};
use tater_wire::{FaultCode, Property};

use super::joint::{Joint, Keeping, Values, View};
use crate::experiment::torture::kinds::{FaultKind, Kinds};

/// Time without a flash operation after which everything queued is stored, ms: housekeeping queues ten times a second.
const QUIET_MS: u64 = 150;

/// Time from a start within which a loss must be reported, ms.
const REPORT_MS: u64 = 100;

/// Time from a start until its counters are stored, ms: the first PTEMP is far beyond what a board warms within the 0.2 s of decision 0018.
const COUNTED_MS: u64 = 500;

/// Faults that take what the flash holds.
const DAMAGE: Kinds = Kinds::of(&[FaultKind::BitFlip, FaultKind::WornPage, FaultKind::MarginalErase]);

/// Faults that end a program without its doing.
const CUTS: Kinds = Kinds::of(&[
    FaultKind::PowerCut,
    FaultKind::HandPowerCut,
    FaultKind::FlashCut,
    FaultKind::BoardReset,
    FaultKind::BoardHang,
    FaultKind::HallSwap,
]);

const COUNTERS: [Property; 3] = [Property::UPSECS, Property::OD, Property::PTEMP];

fn sets(event: &BoardEvent, properties: &[Property]) -> bool {
    matches!(event, BoardEvent::Order { property, .. } if properties.contains(property))
}

pub fn counters(joint: &mut Joint, view: &View) -> Option<String> {
    let keeping = &mut joint.keeping;
    keeping.damaged |= view.active.meets(DAMAGE);
    keeping.cut |= view.active.meets(CUTS);
    keeping.slept |= view
        .events
        .iter()
        .any(|event| matches!(event, BoardEvent::Order { property: Property::STAT, value: 0 }));
    let (tater, _) = view.application()?;
    let starts = view.node?.starts();
    let restarted = starts != keeping.starts;
    if !restarted && !view.ms.is_multiple_of(50) && view.events.is_empty() {
        return None;
    }
    let now = COUNTERS.map(|counter| tater.property(counter).unwrap_or(0));
    if restarted {
        keeping.since_ms = view.ms;
    } else if view.ms < keeping.since_ms + COUNTED_MS {
        return None;
    }
    let before = std::mem::replace(&mut keeping.counters, now);
    if view.events.iter().any(|event| sets(event, &COUNTERS) || sets(event, &[Property::DEF, Property::LOAD]))
    {
        return None;
    }
    // A start takes what was stored: a bounded loss (decision 0018), and nothing by STAT 0.
    let was_ordered = std::mem::take(&mut keeping.slept) && !std::mem::take(&mut keeping.cut);
    let most = [i64::from(LOSS.upsecs), i64::from(LOSS.odometer), i64::from(LOSS.ptemp)];
    let loss = if restarted && !was_ordered { most } else { [0; 3] };
    if restarted && std::mem::take(&mut keeping.damaged) {
        return None;
    }
    (0..3)
        .find(|&at| now[at] < before[at] - loss[at])
        .map(|at| format!("{} went from {} to {}", COUNTERS[at].row().name, before[at], now[at]))
}

/// DEF, as a property or a command. Forgetting too much only checks less.
fn forgets(event: &BoardEvent) -> bool {
    matches!(
        event,
        BoardEvent::Order { property: Property::DEF, .. }
            | BoardEvent::Order { property: Property::CMD, value: 3 }
    )
}

/// DEF, and a SAVE of the property whose value is not known because the program has ended since.
fn saves_or_forgets(event: &BoardEvent, property: Property) -> bool {
    forgets(event)
        || match event {
            BoardEvent::Order { property: Property::SAVE, value } => {
                *value == -1 || u8::try_from(*value).ok().and_then(Property::of) == Some(property)
            }
            BoardEvent::Order { property: Property::CMD, value } => *value == 1,
            _ => false,
        }
}

/// The properties that SAVE stores and that nothing but an order changes.
fn is_kept(property: Property) -> bool {
    let row = property.row();
    row.stored == Stored::Yes && row.access == Access::ReadWrite && property != Property::P
}

fn kept(
    tater: &tater_fw::Tater<crate::world::board::SimBoard>,
) -> impl Iterator<Item = (Property, i64)> + '_ {
    let properties = ROWS.iter().map(|row| row.property).filter(|&property| is_kept(property));
    properties.filter_map(|property| Some((property, tater.property(property)?)))
}

impl Keeping {
    fn saved(&mut self, view: &View) {
        let Some((tater, _)) = view.application() else { return };
        for (at, event) in view.events.iter().enumerate() {
            let BoardEvent::Order { property, value } = event else { continue };
            let id = u8::try_from(*value).ok();
            let one = id.and_then(Property::of).filter(|&property| is_kept(property));
            let all = *value == -1 || *property == Property::CMD;
            match (*property, *value) {
                (Property::SAVE, _) | (Property::CMD, 1) => {
                    // The values are those at the end of the tick. What was ordered after the SAVE is not what it saved: then no
                    // value of that property is known to be stored, nor is an earlier one.
                    let later = &view.events[at..];
                    for (property, value) in kept(tater).filter(|(property, _)| all || one == Some(*property))
                    {
                        if later.iter().any(|event| sets(event, &[property, Property::LOAD])) {
                            self.queued.remove(&property);
                            self.stored.remove(&property);
                        } else {
                            self.queued.insert(property, value);
                        }
                    }
                    self.quiet_ms = 0;
                }
                _ if forgets(event) => {
                    self.queued.clear();
                    self.stored.clear();
                }
                _ => {}
            }
        }
    }
}

pub fn saves(joint: &mut Joint, view: &View) -> Option<String> {
    let keeping = &mut joint.keeping;
    let node = view.node?;
    let operations = node.board().sim_flash().operations();
    let quiet = std::mem::replace(&mut keeping.operations, operations) == operations;
    keeping.quiet_ms = if quiet { keeping.quiet_ms + 1 } else { 0 };
    let Some((tater, _)) = view.application() else {
        // What was on its way may be there or not.
        for property in std::mem::take(&mut keeping.queued).keys() {
            keeping.stored.remove(property);
        }
        keeping
            .stored
            .retain(|property, _| !view.events.iter().any(|event| saves_or_forgets(event, *property)));
        keeping.missing = None;
        keeping.quiet_ms = 0;
        return None;
    };
    let error = tater.property(Property::ERROR)?;
    let reported = error == i64::from(FaultCode::Storage.code());
    if node.starts() != keeping.starts {
        keeping.starts = node.starts();
        keeping.present = None;
        let now: Values = kept(tater).collect();
        let missing: Values = keeping
            .stored
            .iter()
            .filter(|(property, value)| now.get(property) != Some(value))
            .map(|(p, v)| (*p, *v))
            .collect();
        if !missing.is_empty() {
            keeping.missing = Some((view.ms, missing));
        }
    }
    keeping.saved(view);
    if reported {
        keeping.queued.clear();
        keeping.stored.clear();
        keeping.missing = None;
    } else if keeping.quiet_ms >= QUIET_MS && !keeping.queued.is_empty() {
        let stored = std::mem::take(&mut keeping.queued);
        keeping.stored.extend(stored);
    }
    let (since_ms, missing) = keeping.missing.as_ref()?;
    if view.ms < since_ms + REPORT_MS {
        return None;
    }
    let list: Vec<String> = missing.iter().take(4).map(|(p, v)| format!("{} {v}", p.row().name)).collect();
    let found = format!("{} saved values are lost, and ERROR is {error}: {}", missing.len(), list.join(", "));
    keeping.missing = None;
    keeping.stored.clear();
    Some(found)
}

/// What an accepted SET may change, and nothing else does.
fn settings(view: &View) -> Option<Values> {
    let (tater, _) = view.application()?;
    let all = kept(tater);
    let more =
        [Property::E, Property::LFLAGS].map(|property| (property, tater.property(property).unwrap_or(0)));
    Some(all.chain(more).collect())
}

pub fn refusals(joint: &mut Joint, view: &View) -> Option<String> {
    let keeping = &mut joint.keeping;
    if view.sample.is_none() {
        keeping.present = None;
        return None;
    }
    let (tater, _) = view.application()?;
    let error = std::mem::replace(&mut keeping.error, tater.property(Property::ERROR)?);
    let mut orders = view.events.iter().filter(|event| matches!(event, BoardEvent::Order { .. }));
    let ordered = orders.clone().next().is_some();
    // One order alone: another may have cleared the fault before.
    if let (Some(BoardEvent::Order { property: Property::P, value }), None) = (orders.next(), orders.next())
        && error != 0
        && keeping.error == error
        && view.sample.as_ref()?.status.mode == Mode::Idle
    {
        return Some(format!("SET P {value} was obeyed with ERROR {error}"));
    }
    let refused = view.events.iter().any(|event| matches!(event, BoardEvent::Refused { .. }));
    // The ring holds 32 events: a burst may have pushed an order out.
    if keeping.present.is_none() || ordered || view.events.len() > 16 {
        keeping.present = settings(view);
        return None;
    }
    if !refused || view.active.meets(Kinds::of(&[FaultKind::FlashCut])) {
        return None;
    }
    let (now, before) = (settings(view)?, keeping.present.as_ref()?);
    let changed = now.iter().find(|(property, value)| before.get(property) != Some(value))?;
    Some(format!("a refused SET changed {} to {}", changed.0.row().name, changed.1))
}
