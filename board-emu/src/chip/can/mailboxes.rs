//! Three transmit mailboxes and their order (RM0008 24.7.1, 24.7.2).

use super::super::RegisterResult;
use tater_wire::Frame;

const COUNT: usize = 3;

/// Bits of TSR for mailbox 0; those of the next are 8 bits higher (RM0008 24.9.2).
const RQCP: u32 = 1;
const TXOK: u32 = 1 << 1;
const TERR: u32 = 1 << 3;
const ABRQ: u32 = 1 << 7;

/// Bits of TIxR.
const TXRQ: u32 = 1;
const RTR: u32 = 1 << 1;
const IDE: u32 = 1 << 2;

#[derive(Clone, Debug, Default)]
struct Mailbox {
    /// TIxR without TXRQ, TDTxR, TDLxR, TDHxR.
    registers: [u32; 4],
    /// The requested frame, and the number of the request.
    waiting: Option<(Frame, u64)>,
    /// RQCP, TXOK, TERR.
    flags: u32,
}

impl Mailbox {
    fn frame(&self) -> RegisterResult<Frame> {
        let [id, control, low, high] = self.registers;
        if id & (RTR | IDE) != 0 {
            return Err(format!("CAN_TIxR = {id:#010x}: remote and extended frames are not spoken here"));
        }
        let bytes = (u64::from(high) << 32 | u64::from(low)).to_le_bytes();
        // A length code above 8 means 8.
        let len = (control as usize & 0xF).min(8);
        let id = u16::try_from(id >> 21).unwrap_or(0);
        bytes.get(..len).and_then(|data| Frame::from_raw(id, data)).ok_or_else(|| "no such frame".to_owned())
    }
}

#[derive(Clone, Debug, Default)]
pub(super) struct Mailboxes {
    boxes: [Mailbox; COUNT],
    requests: u64,
}

impl Mailboxes {
    /// Mailboxes with a request, in order of transmission: by identifier and number, or with TXFP by request.
    fn order(&self, by_request: bool) -> Vec<usize> {
        let waiting = |i: &usize| self.boxes[*i].waiting;
        let mut order: Vec<usize> = (0..COUNT).filter(|i| waiting(i).is_some()).collect();
        order.sort_by_key(|i| {
            waiting(i).map(|(frame, request)| if by_request { request } else { frame.raw_id().into() })
        });
        order
    }

    /// Frames to offer: all in the order of mailboxes, of which the bus takes the lowest identifier, or with
    /// TXFP only the oldest request.
    pub(super) fn offer(&self, by_request: bool, to: &mut Vec<Frame>) {
        let mut order = self.order(by_request);
        if by_request {
            order.truncate(1);
        } else {
            order.sort_unstable();
        }
        to.extend(order.iter().filter_map(|&i| Some(self.boxes[i].waiting?.0)));
    }

    /// Returns whether a mailbox held the frame.
    pub(super) fn sent(&mut self, frame: &Frame) -> bool {
        // Equal frames are indistinguishable.
        let hit = |mailbox: &&mut Mailbox| mailbox.waiting.is_some_and(|(waiting, _)| waiting == *frame);
        let Some(mailbox) =
            self.boxes.iter_mut().filter(hit).min_by_key(|mailbox| mailbox.waiting.map(|(_, at)| at))
        else {
            return false;
        };
        mailbox.waiting = None;
        mailbox.flags = RQCP | TXOK;
        true
    }

    /// The request stays unless NART forbids repetition.
    pub(super) fn failed(&mut self, by_request: bool, once: bool) {
        let Some(&first) = self.order(by_request).first() else { return };
        let mailbox = &mut self.boxes[first];
        mailbox.flags = TERR;
        if once {
            mailbox.waiting = None;
            mailbox.flags |= RQCP;
        }
    }

    pub(super) fn is_any_complete(&self) -> bool {
        self.boxes.iter().any(|mailbox| mailbox.flags & RQCP != 0)
    }

    /// TSR.
    pub(super) fn status(&self, by_request: bool) -> u32 {
        let order = self.order(by_request);
        let mut status = 0;
        for (i, mailbox) in self.boxes.iter().enumerate() {
            status |= mailbox.flags << (8 * i);
            status |= u32::from(mailbox.waiting.is_none()) << (26 + i);
        }
        // CODE: the next empty mailbox, or the last in the order. LOW: the last in the order, if there are
        // several.
        let last = order.last().copied().unwrap_or(0);
        let empty = (0..COUNT).find(|i| !order.contains(i));
        status |= (empty.unwrap_or(last) as u32) << 24;
        if order.len() > 1 {
            status |= 1 << (29 + last);
        }
        status
    }

    /// Writes TSR: RQCP clears a mailbox's flags, ABRQ aborts its request. A frame in transmission is aborted
    /// too, because the controller does not know that the bus carries it; [`Self::sent`] then ignores it.
    pub(super) fn write_status(&mut self, value: u32) {
        for (i, mailbox) in self.boxes.iter_mut().enumerate() {
            let bits = value >> (8 * i);
            if bits & RQCP != 0 {
                mailbox.flags = 0;
            }
            if bits & ABRQ != 0 && mailbox.waiting.take().is_some() {
                mailbox.flags = RQCP;
            }
        }
    }

    pub(super) fn read(&self, offset: u32) -> u32 {
        let (mailbox, register) = place(offset);
        let mailbox = &self.boxes[mailbox];
        let requested = TXRQ * u32::from(register == 0 && mailbox.waiting.is_some());
        mailbox.registers[register] | requested
    }

    /// Fails for a frame that this bus cannot carry.
    pub(super) fn write(&mut self, offset: u32, value: u32) -> RegisterResult<()> {
        let (mailbox, register) = place(offset);
        let mailbox = &mut self.boxes[mailbox];
        if mailbox.waiting.is_some() {
            return Ok(());
        }
        mailbox.registers[register] = if register == 0 { value & !TXRQ } else { value };
        if register == 0 && value & TXRQ != 0 {
            mailbox.waiting = Some((mailbox.frame()?, self.requests));
            mailbox.flags = 0;
            self.requests += 1;
        }
        Ok(())
    }
}

const fn place(offset: u32) -> (usize, usize) {
    (offset as usize / 16, offset as usize / 4 % 4)
}
