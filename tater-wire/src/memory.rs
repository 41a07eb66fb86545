//! Layout of the 128 KiB of flash and 20 KiB of RAM of an STM32F103CB. The linker scripts are generated from
//! it.
//!
//! The monitor copies the application from staging, so both have the same size.

/// A part of the flash: whole pages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Area {
    /// First address.
    pub start: u32,
    /// Bytes.
    pub len: u32,
}

/// Bytes of an erase page (STM32F103, medium density).
pub const PAGE: u32 = 1024;

/// Half-words in a page, as the length of an array.
pub const PAGE_WORDS: usize = PAGE as usize / 2;

/// All of the flash.
pub const FLASH: Area = Area { start: 0x0800_0000, len: 128 * 1024 };

/// The monitor, entered at reset; never written in the field.
pub const MONITOR: Area = Area { start: FLASH.start, len: 16 * 1024 };

/// The application, with its image header in its vector table.
pub const APPLICATION: Area = Area { start: MONITOR.end(), len: 52 * 1024 };

/// Staging: gathers a download until it is verified.
pub const STAGING: Area = Area { start: APPLICATION.end(), len: APPLICATION.len };

/// Properties and counters.
pub const STORAGE: Area = Area { start: STAGING.end(), len: 8 * 1024 };

/// All of the RAM.
pub const RAM: Area = Area { start: 0x2000_0000, len: 20 * 1024 };
/// The stack, growing down. It is at the bottom, so that an overflow is a fault and overwrites nothing
/// (decision 0024).
pub const STACK: Area = Area { start: RAM.start, len: 8 * 1024 };
/// Variables.
pub const STATICS: Area = Area { start: STACK.end(), len: RAM.len - STACK.len - KEPT.len };
/// Survives a reset: the reason for it. No program clears it at its start.
pub const KEPT: Area = Area { start: RAM.end() - 16, len: 16 };
/// The word of [`KEPT`] behind that reason: the application's model of the winding (decision 0051).
pub const HEAT: Area = Area { start: KEPT.end() - 4, len: 4 };

// Each area begins where the one before it ends: no overlap, no gap.
const _: () = assert!(MONITOR.start == FLASH.start && APPLICATION.start == MONITOR.end());
const _: () = assert!(STAGING.start == APPLICATION.end() && STORAGE.start == STAGING.end());
const _: () = assert!(STORAGE.end() == FLASH.end(), "the areas fill the flash");
const _: () = assert!(STACK.start == RAM.start && STATICS.start == STACK.end());
const _: () = assert!(KEPT.start == STATICS.end() && KEPT.end() == RAM.end(), "the areas fill the RAM");
const _: () = assert!(STAGING.len == APPLICATION.len, "one is copied over the other");
const _: () = assert!(MONITOR.len.is_multiple_of(PAGE) && APPLICATION.len.is_multiple_of(PAGE));
const _: () = assert!(STORAGE.len.is_multiple_of(PAGE), "whole pages");

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

    /// Number of pages.
    #[must_use]
    pub const fn pages(self) -> u32 {
        self.len / PAGE
    }

    /// First address of a page.
    #[must_use]
    pub const fn page(self, index: u32) -> u32 {
        self.start + index * PAGE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn ram_is_that_of_the_data_sheet_and_its_end_is_kept() {
        assert_eq!((RAM.end(), STACK.end()), (0x2000_5000, 0x2000_2000));
        assert_eq!((KEPT.start, HEAT.start), (0x2000_4FF0, 0x2000_4FFC));
    }

    #[test]
    fn pages_follow_each_other_from_the_start() {
        assert_eq!((PAGE_WORDS, APPLICATION.pages(), STORAGE.pages()), (512, 52, 8));
        assert_eq!([0, 1, 7].map(|index| STORAGE.page(index)), [0x0801_E000, 0x0801_E400, 0x0801_FC00]);
    }
}
