//! Figures of a program, and their limits.

use std::collections::BTreeMap;

use serde_json::{Value, json};
use tater_f103::map::{APPLICATION, MONITOR};

use super::crates;
use super::stack::{Deepest, Worst};

/// Limits of a production program in bytes; RAM without the stack.
pub struct Limits {
    pub program: &'static str,
    pub flash: u32,
    pub ram: u32,
}

/// Part of each program's area that stays free, bytes (decision 0082): the monitor is never written in the field, and an application that fills its
/// area could not be mended.
const RESERVE: u32 = 2 * 1024;

/// Variables may take 8 of their 12 KiB.
pub const LIMITS: [Limits; 3] = [
    Limits { program: "tater", flash: APPLICATION.len - RESERVE, ram: 8 * 1024 },
    Limits { program: "monitor", flash: MONITOR.len - RESERVE, ram: 8 * 1024 },
    // On the stub board, with its state on the stack.
    Limits { program: "god", flash: 112 * 1024, ram: 1024 },
];

/// What a poll of GOD may take of the stack, bytes, beside its state.
pub const MOST_OF_A_POLL: u32 = 6 * 1024;

pub struct Figures {
    pub name: &'static str,
    /// Sections: name, bytes, in flash, in RAM.
    pub sections: Vec<(String, u32, bool, bool)>,
    /// Bytes of flash from the first to the last, gaps included.
    pub flash: u32,
    /// .data, .bss, .uninit.
    pub ram: u32,
    pub flash_by_crate: BTreeMap<String, u32>,
    pub ram_by_crate: BTreeMap<String, u32>,
    /// Name and bytes.
    pub largest: Vec<(String, u32)>,
    pub forbidden: Vec<Forbidden>,
    /// Or why it is unknown.
    pub stack: Result<Worst, String>,
}

pub struct Forbidden {
    pub name: String,
    pub family: &'static str,
    /// Call chain to it; it is the last.
    pub chain: Vec<String>,
}

impl Figures {
    /// Figures with a stack only.
    pub fn new(name: &'static str, stack: Result<Worst, String>) -> Self {
        Self {
            name,
            sections: Vec::new(),
            flash: 0,
            ram: 0,
            flash_by_crate: BTreeMap::new(),
            ram_by_crate: BTreeMap::new(),
            largest: Vec::new(),
            forbidden: Vec::new(),
            stack,
        }
    }

    /// What a poll of GOD takes of the stack at worst; `None` of another program.
    pub fn poll(&self) -> Option<u32> {
        let main = self.stack.as_ref().ok()?.levels.iter().find(|level| level.name == "main")?;
        let path = &main.deepest.path;
        let from = path.iter().position(|frame| frame.function.starts_with("stub_god::poll"))?;
        path.get(from..).map(|frames| frames.iter().map(|frame| frame.bytes).sum())
    }

    /// Adds the alignment and padding that make the flashed image longer than its sections.
    pub fn fill(&mut self, flashed: u32) {
        *self.flash_by_crate.entry(crates::ALIGNMENT.into()).or_default() +=
            flashed.saturating_sub(self.flash);
        self.flash = flashed.max(self.flash);
    }

    pub fn object(&self) -> Value {
        let named = |pairs: &[(String, u32)]| -> Vec<Value> {
            pairs.iter().map(|(name, bytes)| json!({ "name": name, "bytes": bytes })).collect()
        };
        let families: Vec<Value> = self
            .forbidden
            .iter()
            .map(|found| json!({ "name": found.name, "family": found.family, "chain": found.chain }))
            .collect();
        json!({
            "sections": self.sections.iter().map(|(name, bytes, flash, ram)| json!({
                "name": name, "bytes": bytes, "flash": flash, "ram": ram,
            })).collect::<Vec<_>>(),
            "flash_bytes": self.flash,
            "ram_bytes": self.ram,
            "flash_bytes_by_crate": self.flash_by_crate,
            "ram_bytes_by_crate": self.ram_by_crate,
            "largest": named(&self.largest),
            "forbidden": families,
            "stack": match &self.stack {
                Ok(worst) => stack_object(worst),
                Err(error) => json!({ "unknown": error }),
            },
        })
    }
}

fn stack_object(worst: &Worst) -> Value {
    let deepest = |deepest: &Deepest| {
        let path: Vec<Value> = deepest
            .path
            .iter()
            .map(|frame| json!({ "function": frame.function, "bytes": frame.bytes }))
            .collect();
        json!({ "bytes": deepest.bytes, "path": path })
    };
    let levels: Vec<Value> = worst
        .levels
        .iter()
        .map(|level| json!({ "name": level.name, "pushed_bytes": level.pushed, "deepest": deepest(&level.deepest) }))
        .collect();
    json!({
        "area_bytes": tater_f103::map::STACK.len,
        "worst_bytes": worst.bytes(),
        "margin_bytes": worst.margin(),
        "margin_percent": (worst.margin_percent() * 10.0).round() / 10.0,
        "levels": levels,
        "start": deepest(&worst.start),
        "called_by_register": worst.by_register,
        "unreached": worst.unreached,
    })
}
