//! The figures of one program, and the limits for them.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::crates;
use super::stack::{Deepest, Worst};

/// The largest that a program may be in production, in bytes; RAM without the stack.
pub struct Limits {
    pub program: &'static str,
    pub flash: u32,
    pub ram: u32,
}

/// Of 52 and 16 KiB of flash and 12 KiB for variables: room for what comes later.
pub const LIMITS: [Limits; 2] = [
    Limits { program: "tater", flash: 40 * 1024, ram: 8 * 1024 },
    Limits { program: "monitor", flash: 14 * 1024, ram: 8 * 1024 },
];

/// What is found out of one program.
pub struct Figures {
    pub name: &'static str,
    /// Bytes of each section, and whether in flash, in RAM or in both.
    pub sections: Vec<(String, u32, bool, bool)>,
    /// All that is written to flash: from its first byte to its last, what lies between sections included.
    pub flash: u32,
    /// .data, .bss, .uninit.
    pub ram: u32,
    pub flash_by_crate: BTreeMap<String, u32>,
    pub ram_by_crate: BTreeMap<String, u32>,
    /// Name, bytes.
    pub largest: Vec<(String, u32)>,
    pub forbidden: Vec<Forbidden>,
    /// Or why it cannot be said.
    pub stack: Result<Worst, String>,
}

/// A symbol that must not be there.
pub struct Forbidden {
    pub name: String,
    pub family: &'static str,
    /// How it is reached: functions, the last being the symbol.
    pub chain: Vec<String>,
}

impl Figures {
    /// Of nothing but a stack.
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

    /// What is flashed is longer than the sections together: by what aligns them, and fills up the last word.
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
        "area_bytes": tater_wire::memory::STACK.len,
        "worst_bytes": worst.bytes(),
        "margin_bytes": worst.margin(),
        "margin_percent": (worst.margin_percent() * 10.0).round() / 10.0,
        "levels": levels,
        "start": deepest(&worst.start),
        "called_by_register": worst.by_register,
        "unreached": worst.unreached,
    })
}
