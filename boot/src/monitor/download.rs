//! A download: requests characters, checks the records, and writes their data to staging.
//!
//! The processor stalls while a page is erased, and the CAN controller buffers three frames meanwhile. So a page is erased only
//! when no requested frame is still to come. Programming a half-word takes less than a frame, so frames may arrive meanwhile.

use crate::chip::{Flash, MOST_UNIT, unit};
use heapless::{Deque, Vec};
use servo_core::units::Micros;
use tater_wire::download::{CHARACTERS, before, unpack};
use tater_wire::tek::{Decoder, MAX_DATA, Record, TekErrorKind};
use tater_wire::{Body, FaultCode, Property};

/// A request is repeated after this time without an answer. A character by the slowest route (GOD, serial,
/// device server) takes up to 100 ms; twice that, so that a repeat is rare: it makes an old host send twice.
pub(super) const REPEAT: Micros = Micros(200_000);

/// Timeout without a character.
pub(super) const TIMEOUT: Micros = Micros(10_000_000);

/// Frames granted by one request to a host that numbers them: 128 characters, so that a request costs 1/20 of its answer.
pub(super) const GRANT: u8 = 16;
const _: () = assert!(GRANT == 16, "GRANTED says the same");

/// Characters buffered until their records are processed: a grant, and another that is requested while the
/// first is processed. An old host whose frames were lost for 10 s owes 50 at most.
const RING: usize = 2 * GRANTED;

const GRANTED: usize = 16 * CHARACTERS;

/// A host that sends nothing for this long after a refusal has finished: five requests.
pub(super) const FINISHED: Micros = Micros(1_000_000);

/// Maximum drain time after a refusal. [`since`] counts up to 35 minutes.
pub(super) const DRAIN: Micros = Micros(1_800_000_000);

#[derive(Debug, PartialEq, Eq)]
pub(super) enum Step {
    Working,
    Ask(Body),
    /// A refused download's host has finished.
    Dropped,
    /// The termination record has arrived, and staging holds this many bytes, including gaps.
    Whole(u32),
}

#[derive(Debug)]
pub(super) struct Download {
    numbered: bool,
    frames: u32,
    /// Frames requested that have not arrived, as far as known.
    awaited: u8,
    /// A frame has arrived since the last request.
    answered: bool,
    /// Time of the last request or received frame, and of the last frame.
    last: Micros,
    heard: Micros,
    ring: Deque<u8, RING>,
    decoder: Decoder,
    ended: bool,
    /// When it was refused.
    refused: Option<Micros>,
    /// Bytes of the last record still to be written, in reverse, and the offset in staging of the next.
    bytes: Vec<u8, MAX_DATA>,
    at: u32,
    /// An incomplete unit, and its offset.
    open: Option<(u32, [u8; 2 * MOST_UNIT])>,
    erased: u32,
}

/// 0 if `then` is after `now`: an interrupt may stamp a frame after the step has read the time.
const fn since(then: Micros, now: Micros) -> Micros {
    let since = now.wrapping_since(then);
    if since.0 < 1 << 31 { since } else { Micros(0) }
}

impl Download {
    /// A fault ends the download. Returns whether its host waits for requests: an old one sends its whole file, a character for each
    /// request, without a time limit (btutil). Then the rest is requested and dropped.
    pub(super) fn refuse(&mut self, error: FaultCode, now: Micros) -> bool {
        self.refused = Some(now);
        self.heard = now;
        !self.numbered && !self.ended && error != FaultCode::DownloadTimeout
    }

    /// The first step erases the first page of staging, which holds the header of the old content.
    pub(super) fn new(numbered: bool, now: Micros) -> Self {
        Self {
            numbered,
            frames: 0,
            awaited: 0,
            answered: false,
            last: now,
            heard: now,
            ring: Deque::new(),
            decoder: Decoder::default(),
            ended: false,
            refused: None,
            bytes: Vec::new(),
            at: 0,
            open: None,
            erased: 0,
        }
    }

    /// Returns whether a frame belongs to the download. Frames out of turn and characters without room are dropped.
    pub(super) fn take(&mut self, data: &[u8], now: Micros) -> bool {
        if self.numbered {
            let Some((number, characters)) = unpack(data) else { return false };
            let expected = self.frames.to_le_bytes().first() == Some(&number);
            if expected && self.ring.len() <= RING - CHARACTERS {
                for character in characters.into_iter().take_while(|&character| character != 0) {
                    // There is room: see the granted frames above.
                    let _ = self.ring.push_back(character);
                }
                self.taken(now);
            }
            return true;
        }
        let [character @ b'0'..=0x7F] = *data else { return false };
        if self.refused.is_none() {
            // If it is lost, the record's checksum or length will not match.
            let _ = self.ring.push_back(character);
        }
        self.taken(now);
        true
    }

    fn taken(&mut self, now: Micros) {
        self.frames = self.frames.saturating_add(1);
        self.awaited = self.awaited.saturating_sub(1);
        self.answered = true;
        self.last = now;
        self.heard = now;
    }

    #[inline(never)]
    pub(super) fn step<F: Flash>(&mut self, flash: &mut F, now: Micros) -> Result<Step, FaultCode> {
        let silent = since(self.heard, now).0;
        let quiet = self.awaited == 0 || since(self.last, now).0 >= REPEAT.0;
        if let Some(refused) = self.refused {
            return Ok(if silent >= FINISHED.0 || since(refused, now).0 >= DRAIN.0 {
                Step::Dropped
            } else if quiet {
                Step::Ask(self.ask(now))
            } else {
                Step::Working
            });
        }
        if silent >= TIMEOUT.0 {
            return Err(FaultCode::DownloadTimeout);
        }
        self.decode::<F>()?;
        if self.erased == 0 || self.erased.saturating_mul(F::MAP.of.page) < self.end() {
            if quiet {
                flash.erase(F::MAP.page(F::MAP.staging, self.erased)).map_err(|_| FaultCode::FlashWrite)?;
                self.erased = self.erased.saturating_add(1);
            }
            return Ok(Step::Working);
        }
        if quiet && !self.ended && self.ring.len() <= self.fill() {
            return Ok(Step::Ask(self.ask(now)));
        }
        // After the termination wait for the rest of a grant: nothing may follow.
        if self.write(flash)? || !self.ended || !quiet {
            return Ok(Step::Working);
        }
        Ok(Step::Whole(self.at))
    }

    fn end(&self) -> u32 {
        // At most 124 bytes, inside the application.
        self.at.wrapping_add(u32::try_from(self.bytes.len()).unwrap_or(0))
    }

    /// Fill level of the ring up to which the next request may be sent.
    const fn fill(&self) -> usize {
        if self.numbered { RING - GRANTED } else { 0 }
    }

    const fn ask(&mut self, now: Micros) -> Body {
        self.last = now;
        if self.numbered {
            self.awaited = GRANT;
            // A file has at most 24 bits of characters: 52 KiB are some 130,000.
            return Body::More { frames: GRANT, received: before(self.frames) };
        }
        // Every request makes an old host send one more, sooner or later. A silence after an answer means
        // that the requests before it were lost. A silence without an answer means that the host is slow and
        // still owes an answer to each.
        self.awaited = if self.answered { 1 } else { self.awaited.saturating_add(1) };
        self.answered = false;
        Body::Get(Property::VERS.id())
    }

    /// Decodes the next record, if the one before is written.
    fn decode<F: Flash>(&mut self) -> Result<(), FaultCode> {
        while self.bytes.is_empty()
            && let Some(character) = self.ring.pop_front()
        {
            match self.decoder.push(character) {
                Ok(None | Some(Record::Symbols)) => {}
                Ok(Some(Record::End { .. })) => self.ended = true,
                Ok(Some(Record::Data { address, bytes })) => {
                    let inside = |address: &u32| {
                        F::MAP
                            .application
                            .holds((*address).into(), bytes.len().try_into().unwrap_or(u64::MAX))
                    };
                    let address =
                        u32::try_from(address).ok().filter(inside).ok_or(FaultCode::AddressRange)?;
                    let offset = address.wrapping_sub(F::MAP.application.start);
                    if offset < self.at {
                        return Err(FaultCode::Overlap);
                    }
                    self.at = offset;
                    // Same capacity as a record's.
                    let _ = self.bytes.extend_from_slice(bytes);
                    self.bytes.reverse();
                }
                Err(error) if matches!(error.kind, TekErrorKind::Checksum { .. }) => {
                    return Err(FaultCode::BadChecksum);
                }
                Err(_) => return Err(FaultCode::BadRecord),
            }
        }
        Ok(())
    }

    /// Programs the next unit; `false` if there is none.
    fn write<F: Flash>(&mut self, flash: &mut F) -> Result<bool, FaultCode> {
        let size = F::MAP.of.unit;
        while let Some(&byte) = self.bytes.last() {
            let inside = self.at % size;
            let start = self.at - inside;
            let (open, bytes) = self.open.get_or_insert((start, [u8::MAX; 2 * MOST_UNIT]));
            if *open != start {
                break;
            }
            if let Some(place) = usize::try_from(inside).ok().and_then(|at| bytes.get_mut(at)) {
                *place = byte;
            }
            self.at = self.at.wrapping_add(1);
            self.bytes.pop();
            if self.at.is_multiple_of(size) {
                break;
            }
        }
        // A unit stays open while the rest of it may still come.
        let may_grow = |&(start, _): &(u32, _)| self.at - self.at % size == start;
        if self.bytes.is_empty() && !self.ended && self.open.as_ref().is_some_and(may_grow) {
            return Ok(false);
        }
        let Some((at, bytes)) = self.open.take() else { return Ok(false) };
        let (pairs, _) = bytes.as_chunks();
        let mut words = [0; MOST_UNIT];
        words.iter_mut().zip(pairs).for_each(|(word, pair)| *word = u16::from_le_bytes(*pair));
        let words = words.get(..unit::<F>()).unwrap_or_default();
        flash.program(F::MAP.staging.start.wrapping_add(at), words).map_err(|_| FaultCode::FlashWrite)?;
        Ok(true)
    }
}
