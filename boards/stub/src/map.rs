//! The memory map: 512 KiB of flash in pages of 2 KiB and units of 8 bytes.

use tater_wire::map::{Area, Map, Memories};

const FLASH: Area = Area { start: 0x0800_0000, len: 512 * 1024 };
const RAM: Area = Area { start: 0x2000_0000, len: 544 * 1024 };

/// A monitor of 16 KiB and 8 KiB of stack.
pub const MAP: Map = Map::new(Memories { flash: FLASH, page: 2048, unit: 8, ram: RAM }, 16 * 1024, 8 * 1024);

/// Half-words of the flash.
pub const WORDS: usize = FLASH.len as usize / 2;
