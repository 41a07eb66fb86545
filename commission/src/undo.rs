//! The file beside an applied one that keeps what boards held before, for `apply --undo`.
//!
//! It is written before the first SET, and removed when all of it is back on the boards. Until then it keeps the values from before the
//! *first* apply: a second one adds boards and properties to it, and changes none that it has.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use tater_wire::{Node as Id, Property};

use super::adapter::Adapter;
use super::apply::{Board, Broken, Present, State, compare, meet, write};
use super::excite::{Failure, Link};
use programs::files;
use traces::input::{self, BadInput};

const FORMAT: u64 = 1;

/// The file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Undo {
    format: u64,
    /// How the boards were reached.
    pub adapter: Adapter,
    /// What they held.
    pub boards: Vec<Kept>,
}

/// What one board held.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Kept {
    node: u8,
    /// The kind of its motor, for a reader.
    motor: String,
    /// SN.
    serial: i64,
    old: BTreeMap<String, i64>,
    /// The other stored properties before a write that has not ended well: a damaged frame may have meant one of them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    others: BTreeMap<String, i64>,
}

impl Kept {
    /// The board's number on the bus.
    pub fn node(&self) -> Id {
        Id::new(self.node).unwrap_or(Id::HOST)
    }

    /// The properties and their values, in the order of the names.
    pub fn values(&self) -> Vec<(Property, i64)> {
        self.old.iter().filter_map(|(name, value)| Some((Property::named(name)?, *value))).collect()
    }

    /// # Errors
    /// The board is another one with the same number.
    pub fn check(&self, path: &Path, found: &Present) -> Result<(), BadInput> {
        if found.serial == self.serial {
            return Ok(());
        }
        Err(BadInput::new(
            path.display().to_string(),
            format!("node {} is another board than the one whose old values are kept here", self.node),
        )
        .found(format!("SN {}", found.serial))
        .expected(format!("SN {}", self.serial))
        .next("connect that board, or move this file away if nobody needs its old values"))
    }
}

/// The file for an applied one: `tuned.json.undo.json` beside `tuned.json`.
pub fn path_of(file: &Path) -> PathBuf {
    let mut name = file.file_name().unwrap_or_default().to_owned();
    name.push(".undo.json");
    file.with_file_name(name)
}

impl Undo {
    /// With no board yet.
    pub const fn new(adapter: Adapter) -> Self {
        Self { format: FORMAT, adapter, boards: Vec::new() }
    }

    /// Reads a file; `None` if there is none.
    ///
    /// # Errors
    /// It cannot be read or has another form.
    pub fn load(path: &Path) -> Result<Option<Self>, BadInput> {
        let bad = |line: usize, problem: &str, found: &str| {
            BadInput::new(
                if line > 0 { format!("{}:{line}", path.display()) } else { path.display().to_string() },
                problem,
            )
            .found(input::shorten(found))
            .expected("old values as `apply` keeps them (docs/tuning.md)")
            .next("correct the file; it has what the boards held before")
        };
        let text = match files::read_text(path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            read => read.map_err(|error| bad(0, "cannot be read", &error.to_string()))?,
        };
        let undo: Self = serde_json::from_str(&text)
            .map_err(|error| bad(error.line(), "has another form", &error.to_string()))?;
        if undo.format != FORMAT {
            return Err(bad(0, "has another format", &undo.format.to_string()));
        }
        for kept in &undo.boards {
            if Id::new(kept.node).is_none() {
                return Err(bad(0, "has a node that no bus has", &kept.node.to_string()));
            }
            for (name, value) in kept.old.iter().chain(&kept.others) {
                let row = Property::named(name);
                if !row.is_some_and(|property| property.rules().admits(*value)) {
                    return Err(bad(
                        0,
                        "has no such property, or a value out of its range",
                        &format!("{name}: {value}"),
                    ));
                }
            }
        }
        Ok(Some(undo))
    }

    /// What a board held.
    ///
    /// # Errors
    /// It is another board than the one with this number.
    pub fn values(&self, path: &Path, present: &Present) -> Result<Vec<(Property, i64)>, BadInput> {
        let Some(kept) = self.boards.iter().find(|kept| kept.node == present.node.number()) else {
            return Ok(Vec::new());
        };
        kept.check(path, present)?;
        Ok(kept.values())
    }

    /// Takes the other properties of boards from before a write that has not ended well, and keeps them until [`Self::settled`].
    pub fn keep_others(&mut self, boards: &mut [Board]) {
        for Board { present, rest, .. } in boards {
            let Some(kept) = self.boards.iter_mut().find(|kept| kept.node == present.node.number()) else {
                continue;
            };
            for (property, value) in rest {
                let before = kept.others.entry(property.row().name.to_owned()).or_insert(*value);
                *value = *before;
            }
        }
    }

    /// These boards hold what they are said to hold.
    pub fn settled(&mut self, boards: &[Board]) {
        let is_settled = |kept: &Kept| boards.iter().any(|board| board.present.node.number() == kept.node);
        self.boards.iter_mut().filter(|kept| is_settled(kept)).for_each(|kept| kept.others.clear());
    }

    /// Keeps what the boards hold now, except what is kept already.
    ///
    /// # Errors
    /// Another board has the number of a kept one.
    pub fn keep(&mut self, path: &Path, boards: &[Board]) -> Result<(), BadInput> {
        for Board { present, changes, .. } in boards {
            let node = present.node.number();
            let place = match self.boards.iter().position(|kept| kept.node == node) {
                Some(place) => place,
                None => {
                    let motor = present.kind.name().to_owned();
                    self.boards.push(Kept {
                        node,
                        motor,
                        serial: present.serial,
                        old: BTreeMap::new(),
                        others: BTreeMap::new(),
                    });
                    self.boards.len() - 1
                }
            };
            let kept = &mut self.boards[place];
            kept.check(path, present)?;
            for change in changes {
                kept.old.entry(change.property.row().name.to_owned()).or_insert(change.old);
            }
        }
        Ok(())
    }

    /// Writes the file, or removes it if no board is left in it.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), BadInput> {
        let text = serde_json::to_string_pretty(self).unwrap_or_default() + "\n";
        let done = match self.boards.is_empty() {
            false => files::replace(path, text.as_bytes()),
            true => std::fs::remove_file(path).or_else(|error| match error.kind() {
                ErrorKind::NotFound => Ok(()),
                _ => Err(error),
            }),
        };
        done.map_err(|error| {
            BadInput::new(path.display().to_string(), "the old values cannot be kept")
                .found(error.to_string())
                .expected("a file that can be written beside the applied one")
                .next("free space, or copy the file into a folder of yours and apply it there")
        })
    }
}

/// The values that a board shall have.
pub type Values<'a> = dyn Fn(&Present) -> Result<Vec<(Property, i64)>, BadInput> + 'a;

/// Meets boards and reads what they hold.
///
/// # Errors
/// Those of [`meet`], [`compare`] and `values`; what the link has not carried is then part of the progress.
pub fn read_boards(
    link: &mut dyn Link,
    nodes: &[Id],
    values: &Values,
    progress: &mut dyn FnMut(&str),
) -> Result<Vec<Board>, Failure> {
    let read = nodes.iter().map(|node| {
        let present = meet(link, *node, progress)?;
        compare(link, present, &values(&present)?)
    });
    let boards = read.collect();
    if let (Err(_), Some(remark)) = (&boards, link.remark()) {
        progress(&remark);
    }
    boards
}

/// Writes boards, with their old values in a file meanwhile, and afterwards unless the boards hold them again. `before`: what was in the file.
///
/// # Errors
/// The file cannot be written.
pub fn write_kept(
    link: &mut dyn Link,
    path: &Path,
    (before, mut undo): (Option<Undo>, Undo),
    boards: &[Board],
    progress: &mut dyn FnMut(&str),
) -> Result<Result<(), Broken>, BadInput> {
    undo.save(path)?;
    let done = write(link, boards, progress);
    match &done {
        Ok(()) => {
            undo.settled(boards);
            undo.save(path)?;
        }
        Err(broken)
            if broken.states.iter().all(|state| matches!(state, State::Untouched | State::Restored)) =>
        {
            // What there was before is there again.
            let mut before = before.unwrap_or_else(|| Undo::new(undo.adapter));
            before.settled(boards);
            before.save(path)?;
        }
        Err(_) => {}
    }
    Ok(done)
}

/// Writes the old values of a file, and takes from the file what the boards then hold.
///
/// # Errors
/// The file cannot be written.
pub fn write_back(
    link: &mut dyn Link,
    path: &Path,
    undo: &mut Undo,
    boards: &[Board],
    progress: &mut dyn FnMut(&str),
) -> Result<Result<(), Broken>, BadInput> {
    undo.save(path)?;
    let done = write(link, boards, progress);
    if done.is_ok() {
        undo.boards.retain(|kept| boards.iter().all(|board| board.present.node != kept.node()));
        undo.save(path)?;
    }
    Ok(done)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::apply::Change;
    use tater_wire::MotorKind;

    fn board(node: u8, serial: i64, kp: i64) -> Board {
        let node = Id::new(node).expect("a node");
        let changes = vec![Change { property: Property::KP, old: kp, new: 150 }];
        Board { present: Present { node, kind: MotorKind::Link, serial }, changes, rest: Vec::new() }
    }

    #[test]
    fn first_old_value_stays_and_another_board_is_refused() {
        let path = Path::new("a.json.undo.json");
        let mut undo = Undo::new(Adapter::Can("can0".to_owned()));
        undo.keep(path, &[board(1, 7, 120)]).expect("new");
        undo.keep(path, &[board(1, 7, 150), board(2, 8, 130)]).expect("the same board");
        let values: Vec<_> = undo.boards.iter().map(|kept| (kept.node, kept.values())).collect();
        assert_eq!(values, [(1, vec![(Property::KP, 120)]), (2, vec![(Property::KP, 130)])]);
        let error = undo.keep(path, &[board(2, 9, 1)]).expect_err("another SN").to_string();
        assert!(error.contains("node 2 is another board") && error.contains("SN 8"), "{error}");
    }

    #[test]
    fn file_reads_back_and_vanishes_with_its_last_board() {
        let folder = std::env::temp_dir().join(format!("commission-undo-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("the temporary folder can be written");
        let path = path_of(&folder.join("tuned.json"));
        assert_eq!(path.file_name().and_then(|name| name.to_str()), Some("tuned.json.undo.json"));
        assert_eq!(Undo::load(&path), Ok(None));
        let mut undo = Undo::new(Adapter::Slcan("127.0.0.1:7100".to_owned()));
        undo.keep(&path, &[board(1, 7, 120)]).expect("new");
        undo.save(&path).expect("written");
        assert_eq!(Undo::load(&path), Ok(Some(undo.clone())));
        let text = std::fs::read_to_string(&path).expect("written");
        for (from, to) in [
            ("\"KP\": 120", "\"KP\": 99999"),
            ("\"KP\"", "\"KQ\""),
            ("\"node\": 1", "\"node\": 99"),
            ("\"old\"", "\"odl\""),
        ] {
            assert!(text.contains(from), "{text}");
            std::fs::write(&path, text.replace(from, to)).expect("ours");
            let error = Undo::load(&path).expect_err(to).to_string();
            assert!(error.contains("tuned.json.undo.json"), "{error}");
        }
        undo.boards.clear();
        undo.save(&path).expect("removed");
        undo.save(&path).expect("nothing to remove");
        assert_eq!(std::fs::read_dir(&folder).expect("ours").count(), 0);
        std::fs::remove_dir(&folder).expect("ours");
    }
}
