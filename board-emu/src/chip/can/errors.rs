//! Error counters (RM0008 24.7.6; ISO 11898-1).

/// Bits of ESR (RM0008 24.9.2).
const EWGF: u32 = 1;
const EPVF: u32 = 1 << 1;
const BOFF: u32 = 1 << 2;
const LEC: u32 = 7 << 4;

/// Enable bits of IER: error warning, error passive, bus-off, last error code.
const EWGIE: u32 = 1 << 8;
const EPVIE: u32 = 1 << 9;
const BOFIE: u32 = 1 << 10;
const LECIE: u32 = 1 << 11;

const WARNING: u16 = 96;
/// Above this: error passive.
const PASSIVE: u16 = 127;
/// Above this: bus-off.
const OFF: u16 = 255;

/// Codes of LEC: stuff error (a corrupted frame) and missing acknowledge.
const STUFF: u32 = 1;
const ACKNOWLEDGE: u32 = 3;

#[derive(Clone, Debug, Default)]
pub(super) struct Errors {
    transmit: u16,
    receive: u16,
    last: u32,
}

impl Errors {
    pub(super) const fn is_bus_off(&self) -> bool {
        self.transmit > OFF
    }

    pub(super) const fn is_passive(&self) -> bool {
        self.transmit > PASSIVE || self.receive > PASSIVE
    }

    pub(super) fn transmit(&mut self) -> u32 {
        self.count(STUFF, |errors| errors.transmit += 8)
    }

    pub(super) fn receive(&mut self) -> u32 {
        // 8 bits; values above 127 mean no more than 128.
        self.count(STUFF, |errors| errors.receive = (errors.receive + 1).min(OFF))
    }

    pub(super) fn unacknowledged(&mut self) -> u32 {
        self.count(ACKNOWLEDGE, |errors| {
            if errors.transmit <= PASSIVE {
                errors.transmit += 8;
            }
        })
    }

    /// Returns the enable bits of the requested interrupts.
    fn count(&mut self, code: u32, change: impl Fn(&mut Self)) -> u32 {
        let before = self.status();
        change(self);
        self.last = code;
        let risen = self.status() & !before;
        let flags = [(EWGF, EWGIE), (EPVF, EPVIE), (BOFF, BOFIE)];
        // LECIE: at each error.
        flags.into_iter().filter(|(flag, _)| risen & flag != 0).map(|(_, enable)| enable).sum::<u32>() | LECIE
    }

    pub(super) const fn sent(&mut self) {
        self.transmit = self.transmit.saturating_sub(1);
        self.last = 0;
    }

    pub(super) const fn received(&mut self) {
        // Error passive recovers to between 119 and 127.
        self.receive = if self.receive > PASSIVE { PASSIVE } else { self.receive.saturating_sub(1) };
        self.last = 0;
    }

    /// ESR.
    pub(super) fn status(&self) -> u32 {
        let most = self.transmit.max(self.receive);
        let flags = [(EWGF, most >= WARNING), (EPVF, most > PASSIVE), (BOFF, self.is_bus_off())];
        let flags: u32 = flags.into_iter().filter(|&(_, on)| on).map(|(flag, _)| flag).sum();
        flags | self.last << 4 | u32::from(self.transmit.min(OFF)) << 16 | u32::from(self.receive) << 24
    }

    /// Only LEC can be written.
    pub(super) const fn write_status(&mut self, value: u32) {
        self.last = (value & LEC) >> 4;
    }
}
