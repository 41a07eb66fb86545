//! What a board keeps: counters, saved properties, and everything while it refuses.

use tater_wire::{Cmd, FaultCode, ModeCode, Property};

use super::excuse::{CUT, DAMAGED};
use super::joint::{Ground, Joint, Keeping, Seen, View};
use crate::shadow::{self, Values, is_setting};

/// Time without a flash operation after which everything queued is stored, ms: housekeeping queues ten times a second.
const QUIET_MS: u64 = 150;

/// Time from a start within which a loss must be reported, ms.
const REPORT_MS: u64 = 100;

/// Time from a start until its counters are stored, ms: the first PTEMP is far beyond what a board warms within the 0.2 s of decision 0018.
const COUNTED_MS: u64 = 500;

const COUNTERS: [Property; 3] = [Property::UPSECS, Property::OD, Property::PTEMP];

/// What a power cut may take of them: 60 s, 499 revolutions, 1.0 C (decision 0018).
const LOSS: [i64; 3] = [60, 499, 10];

/// A number of CMD.
fn is_command(value: i64, cmd: Cmd) -> bool {
    Cmd::of(value) == Some(cmd)
}

fn sets(seen: &Seen, properties: &[Property]) -> bool {
    seen.order().is_some_and(|(property, _)| properties.contains(&property))
}

pub fn counters(joint: &mut Joint, view: &View) -> Option<String> {
    let keeping = &mut joint.keeping;
    keeping.damaged |= DAMAGED.is_active(view);
    keeping.cut |= CUT.is_active(view);
    keeping.slept |= view.orders().any(|order| order == (Property::STAT, 0));
    if !view.runs() {
        return None;
    }
    let restarted = view.starts() != keeping.starts;
    if !restarted && !view.ms.is_multiple_of(50) && view.seen.is_empty() {
        return None;
    }
    let now = COUNTERS.map(|counter| view.property(counter).unwrap_or(0));
    if restarted {
        keeping.since_ms = view.ms;
    } else if view.ms < keeping.since_ms + COUNTED_MS {
        return None;
    }
    let before = std::mem::replace(&mut keeping.counters, now);
    if view.seen.iter().any(|seen| sets(seen, &COUNTERS) || sets(seen, &[Property::DEF, Property::LOAD])) {
        return None;
    }
    // A start takes what was stored: a bounded loss (decision 0018), and nothing by STAT 0.
    let was_ordered = std::mem::take(&mut keeping.slept) && !std::mem::take(&mut keeping.cut);
    let loss = if restarted && !was_ordered { LOSS } else { [0; 3] };
    if restarted && std::mem::take(&mut keeping.damaged) {
        return None;
    }
    (0..3)
        .find(|&at| now[at] < before[at] - loss[at])
        .map(|at| format!("{} went from {} to {}", COUNTERS[at].row().name, before[at], now[at]))
}

/// DEF, as a property or a command, and KIND: a value beyond the joint of another kind is its default. Forgetting too much only checks less.
fn forgets(property: Property, value: i64) -> bool {
    matches!(property, Property::DEF | Property::KIND)
        || property == Property::CMD && is_command(value, Cmd::Def)
}

/// DEF, and a SAVE of the property whose value is not known because the program has ended since.
fn saves_or_forgets((order, value): (Property, i64), property: Property) -> bool {
    forgets(order, value)
        || match order {
            Property::SAVE => {
                value == -1 || u8::try_from(value).ok().and_then(Property::of) == Some(property)
            }
            Property::CMD => is_command(value, Cmd::Save),
            _ => false,
        }
}

fn kept(view: &View) -> impl Iterator<Item = (Property, i64)> {
    shadow::settings().filter_map(|property| Some((property, view.property(property)?)))
}

impl Keeping {
    fn saved(&mut self, view: &View) {
        for (at, seen) in view.seen.iter().enumerate() {
            let Some((order, value)) = seen.order() else { continue };
            let one =
                u8::try_from(value).ok().and_then(Property::of).filter(|&property| is_setting(property));
            let all = value == -1 || order == Property::CMD;
            match order {
                _ if order == Property::SAVE || order == Property::CMD && is_command(value, Cmd::Save) => {
                    // The values are those at the end of the tick. What was ordered after the SAVE is not what it saved: then no
                    // value of that property is known to be stored, nor is an earlier one.
                    let later = &view.seen[at..];
                    for (property, value) in kept(view).filter(|(property, _)| all || one == Some(*property))
                    {
                        if later.iter().any(|seen| sets(seen, &[property, Property::LOAD])) {
                            self.queued.remove(&property);
                            self.stored.remove(&property);
                        } else {
                            self.queued.insert(property, value);
                        }
                    }
                    self.quiet_ms = 0;
                }
                _ if forgets(order, value) => {
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
    let Ground { starts, flash_operations: operations, .. } = view.ground?;
    let quiet = std::mem::replace(&mut keeping.operations, operations) == operations;
    keeping.quiet_ms = if quiet { keeping.quiet_ms + 1 } else { 0 };
    if !view.runs() {
        // What was on its way may be there or not.
        for property in std::mem::take(&mut keeping.queued).keys() {
            keeping.stored.remove(property);
        }
        keeping.stored.retain(|property, _| !view.orders().any(|order| saves_or_forgets(order, *property)));
        keeping.missing = None;
        keeping.quiet_ms = 0;
        return None;
    }
    let error = view.property(Property::ERROR)?;
    let reported = error == i64::from(FaultCode::Storage.code());
    if starts != keeping.starts {
        keeping.starts = starts;
        keeping.present = None;
        let now: Values = kept(view).collect();
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
    if !view.runs() {
        return None;
    }
    let more =
        [Property::E, Property::LFLAGS].map(|property| (property, view.property(property).unwrap_or(0)));
    Some(kept(view).chain(more).collect())
}

pub fn refusals(joint: &mut Joint, view: &View) -> Option<String> {
    let keeping = &mut joint.keeping;
    if !view.runs() {
        keeping.present = None;
        return None;
    }
    let error = std::mem::replace(&mut keeping.error, view.property(Property::ERROR)?);
    let mut orders = view.orders();
    let first = orders.next();
    // One order alone: another may have cleared the fault before.
    if let (Some((Property::P, value)), None) = (first, orders.next())
        && error != 0
        && keeping.error == error
        && view.mode() == Some(ModeCode::Idle)
    {
        return Some(format!("SET P {value} was obeyed with ERROR {error}"));
    }
    let refused = view.seen.contains(&Seen::Refused);
    // A board remembers 32: a burst may have pushed an order out.
    if keeping.present.is_none() || first.is_some() || view.seen.len() > 16 {
        keeping.present = settings(view);
        return None;
    }
    if !refused {
        return None;
    }
    let (now, before) = (settings(view)?, keeping.present.as_ref()?);
    let changed = now.iter().find(|(property, value)| before.get(property) != Some(value))?;
    Some(format!("a refused SET changed {} to {}", changed.0.row().name, changed.1))
}
