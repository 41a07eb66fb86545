//! What a board's memory map is. The maps themselves are the boards' (`boards/`): linker scripts, monitor and host programs go by
//! them.
//!
//! The monitor copies the application from staging, so both have the same size.

/// A part of an address space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Area {
    /// First address.
    pub start: u32,
    /// Bytes.
    pub len: u32,
}

impl Area {
    /// The first address after it.
    #[must_use]
    pub const fn end(self) -> u32 {
        self.start + self.len
    }

    /// Whether `len` bytes from `address` are inside.
    #[must_use]
    pub const fn holds(self, address: u64, len: u64) -> bool {
        let (start, end) = (self.start as u64, self.end() as u64);
        address >= start && address <= end && len <= end - address
    }

    /// What follows it, of that length.
    const fn then(self, len: u32) -> Self {
        Self { start: self.end(), len }
    }
}

/// What a chip has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Memories {
    /// Its flash.
    pub flash: Area,
    /// Bytes that are erased together.
    pub page: u32,
    /// Bytes that are programmed together: 2, 4, 8 or 16.
    pub unit: u32,
    /// Its RAM.
    pub ram: Area,
}

impl Memories {
    /// Half-words of a page.
    #[must_use]
    pub const fn page_words(self) -> usize {
        self.page as usize / 2
    }

    /// Half-words of a unit.
    #[must_use]
    pub const fn unit_words(self) -> usize {
        self.unit as usize / 2
    }
}

/// A board's memory map: flash and RAM, filled without gaps in the order of the fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Map {
    /// What it divides.
    pub of: Memories,
    /// The monitor, entered at reset; never written in the field.
    pub monitor: Area,
    /// The application, with its image header in its vector table.
    pub application: Area,
    /// Staging: gathers a download until it is verified.
    pub staging: Area,
    /// Properties and counters: [`STORAGE_PAGES`] pages.
    pub storage: Area,
    /// The stack, growing down. It is at the bottom, so that an overflow is a fault and overwrites nothing (decision 0024).
    pub stack: Area,
    /// Variables.
    pub statics: Area,
    /// Survives a reset: the reason for it. No program clears it at its start.
    pub kept: Area,
    /// The word of [`Self::kept`] behind that reason: the application's model of the winding (decision 0051).
    pub heat: Area,
}

/// Pages of the journal of properties and counters.
pub const STORAGE_PAGES: u32 = 8;

/// Bytes that survive a reset.
const KEPT: u32 = 16;

impl Map {
    /// Divides the memories of a chip by the lengths of monitor and stack; application and staging share what is left of the
    /// flash.
    #[must_use]
    pub const fn new(of: Memories, monitor: u32, stack: u32) -> Self {
        let Memories { flash, page, ram, .. } = of;
        let monitor = Area { start: flash.start, len: monitor };
        let application = monitor.then((flash.len - monitor.len - STORAGE_PAGES * page) / 2);
        let staging = application.then(application.len);
        let storage = staging.then(STORAGE_PAGES * page);
        let stack = Area { start: ram.start, len: stack };
        let statics = stack.then(ram.len - stack.len - KEPT);
        let kept = statics.then(KEPT);
        let heat = Area { start: kept.end() - 4, len: 4 };
        Self { of, monitor, application, staging, storage, stack, statics, kept, heat }
    }

    /// Whether the areas are of whole pages, and fill the flash. What goes by a map asserts it when it is compiled.
    #[must_use]
    pub const fn is_whole(&self) -> bool {
        let Memories { flash, page, unit, .. } = self.of;
        let fits = (unit == 2 || unit == 4 || unit == 8 || unit == 16) && page.is_multiple_of(unit);
        let begins = flash.start.is_multiple_of(page) && self.monitor.len.is_multiple_of(page);
        fits && begins && self.application.len.is_multiple_of(page) && self.storage.end() == flash.end()
    }

    /// Number of pages of an area.
    #[must_use]
    pub const fn pages(&self, area: Area) -> u32 {
        area.len / self.of.page
    }

    /// First address of a page of an area.
    #[must_use]
    pub const fn page(&self, area: Area, index: u32) -> u32 {
        area.start + index * self.of.page
    }
}

/// The linker script of a program in an area of a map, for a board's build script: the memories of cortex-m-rt, and the symbols by which a fatal error finds
/// stack and kept words. The stack lies below the variables: one that overflows leaves the RAM, which is a fault, and overwrites nothing.
#[derive(Clone, Copy, Debug)]
pub struct Script {
    /// The map.
    pub map: Map,
    /// The program's part of the flash.
    pub program: Area,
}

impl core::fmt::Display for Script {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Map { stack, statics, kept, heat, .. } = self.map;
        writeln!(f, "MEMORY\n{{")?;
        for (name, Area { start, len }) in [("FLASH", self.program), ("RAM", statics)] {
            writeln!(f, "  {name} : ORIGIN = {start:#010x}, LENGTH = {len:#x}")?;
        }
        writeln!(f, "}}\n_stack_start = {:#010x};\n_stack_end = {:#010x};", stack.end(), stack.start)?;
        writeln!(f, "_kept = {:#010x};\n_heat = {:#010x};", kept.start, heat.start)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;

    #[test]
    fn script_places_a_program_and_its_variables_between_stack_and_kept_words() {
        let flash = Area { start: 0x0800_0000, len: 128 * 1024 };
        let ram = Area { start: 0x2000_0000, len: 20 * 1024 };
        let map = Map::new(Memories { flash, page: 1024, unit: 2, ram }, 16 * 1024, 8 * 1024);
        let script = Script { map, program: map.application }.to_string();
        assert_eq!(
            script,
            "MEMORY\n{\n  FLASH : ORIGIN = 0x08004000, LENGTH = 0xd000\n  RAM : ORIGIN = 0x20002000, LENGTH = 0x2ff0\n}\n\
             _stack_start = 0x20002000;\n_stack_end = 0x20000000;\n_kept = 0x20004ff0;\n_heat = 0x20004ffc;\n"
        );
    }

    #[test]
    fn holds_is_true_for_what_is_inside_to_the_last_byte() {
        let area = Area { start: 0x100, len: 0x40 };
        for (address, len) in [(0x100, 0), (0x100, 0x40), (0x13F, 1), (0x120, 0x20), (0x140, 0)] {
            assert!(area.holds(address, len), "{len} from {address:#x}");
        }
        for (address, len) in [(0xFF, 1), (0x100, 0x41), (0x13F, 2), (0x120, 0x21), (0x140, 1), (0x141, 0)] {
            assert!(!area.holds(address, len), "{len} from {address:#x}");
        }
        assert!(!area.holds(0x1_0000_0100, 1) && !area.holds(0x100, u64::MAX), "beyond 32 bits");
    }

    #[test]
    fn areas_follow_each_other_and_fill_the_memories() {
        let flash = Area { start: 0x0800_0000, len: 256 * 1024 };
        let ram = Area { start: 0x2000_0000, len: 48 * 1024 };
        let map = Map::new(Memories { flash, page: 2048, unit: 8, ram }, 16 * 1024, 8 * 1024);
        let starts = [map.monitor, map.application, map.staging, map.storage].map(|area| area.start);
        assert_eq!(starts, [0x0800_0000, 0x0800_4000, 0x0802_0000, 0x0803_C000]);
        assert_eq!((map.pages(map.application), map.page(map.storage, 7)), (56, 0x0803_F800));
        let starts = [map.stack, map.statics, map.kept, map.heat].map(|area| area.start);
        assert_eq!(starts, [0x2000_0000, 0x2000_2000, 0x2000_BFF0, 0x2000_BFFC]);
        assert!(map.is_whole());
        assert!(
            !Map::new(Memories { page: 2048, unit: 3, ..map.of }, 16 * 1024, 8 * 1024).is_whole(),
            "no such unit"
        );
        assert!(!Map::new(map.of, 15 * 1024, 8 * 1024).is_whole(), "half a page");
        assert!(
            !Map::new(map.of, 18 * 1024, 8 * 1024).is_whole(),
            "application and staging share an odd number of pages"
        );
        assert_eq!((map.storage.end(), map.kept.end(), map.heat.end()), (flash.end(), ram.end(), ram.end()));
    }
}
