//! The memory map of the tests: that of a board with an STM32F103CB.

use tater_wire::map::{Area, Map, Memories};

pub const FLASH: Area = Area { start: 0x0800_0000, len: 128 * 1024 };
pub const PAGE: u32 = 1024;
/// Half-words of a page.
pub const PAGE_WORDS: usize = MAP.of.page_words();
pub const RAM: Area = Area { start: 0x2000_0000, len: 20 * 1024 };
pub const MAP: Map = Map::new(Memories { flash: FLASH, page: PAGE, unit: 2, ram: RAM }, 16 * 1024, 8 * 1024);
pub const APPLICATION: Area = MAP.application;
pub const STAGING: Area = MAP.staging;
pub const STORAGE: Area = MAP.storage;
