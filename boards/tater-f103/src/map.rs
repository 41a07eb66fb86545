//! The memory map: 128 KiB of flash and 20 KiB of RAM of an STM32F103CB. The linker scripts are written from it.

use tater_wire::map::{Area, Map, Memories};

/// All of the flash.
pub const FLASH: Area = Area { start: 0x0800_0000, len: 128 * 1024 };
/// Bytes of an erase page (medium density).
pub const PAGE: u32 = 1024;
/// All of the RAM.
pub const RAM: Area = Area { start: 0x2000_0000, len: 20 * 1024 };

/// A monitor of 16 KiB and 8 KiB of stack; application and staging have 52 KiB each.
pub const MAP: Map = Map::new(Memories { flash: FLASH, page: PAGE, unit: 2, ram: RAM }, 16 * 1024, 8 * 1024);

/// See [`Map::monitor`].
pub const MONITOR: Area = MAP.monitor;
/// See [`Map::application`].
pub const APPLICATION: Area = MAP.application;
/// See [`Map::storage`].
pub const STORAGE: Area = MAP.storage;
/// See [`Map::stack`].
pub const STACK: Area = MAP.stack;
/// See [`Map::heat`].
pub const HEAT: Area = MAP.heat;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn map_is_that_of_every_image_in_the_field() {
        let starts = [MONITOR, APPLICATION, MAP.staging, STORAGE].map(|area| area.start);
        assert_eq!(starts, [0x0800_0000, 0x0800_4000, 0x0801_1000, 0x0801_E000]);
        assert_eq!(
            (APPLICATION.len, MAP.pages(APPLICATION), MAP.page(STORAGE, 7)),
            (52 * 1024, 52, 0x0801_FC00)
        );
        assert_eq!((RAM.end(), STACK.end()), (0x2000_5000, 0x2000_2000));
        assert_eq!((MAP.kept.start, HEAT.start), (0x2000_4FF0, 0x2000_4FFC));
    }
}
