//! What a Tater says: answers, the servo's reports, and the frames that wait for the CAN controller.

use super::{EVENTS, OUTBOX, Refused, Tater};
use crate::board::Board;
use crate::codes::{end_code, mode_code};
use servo_core::Event;
use tater_wire::{Message, Node, Property};

/// LFLAGS: ends of moves are reported.
const REPORT_ENDS: u8 = 1;

/// LFLAGS: breakaways are reported.
const REPORT_BREAKAWAYS: u8 = 2;

impl<B: Board> Tater<B> {
    /// Tells a node a value: the host by a reply, another board by a SET of VALUE.
    pub(super) fn say(&mut self, to: Node, property: Property, value: i64) -> Result<(), Refused> {
        if self.node == Node::HOST {
            return Ok(());
        }
        // Every value that is read fits 32 bits.
        let message =
            Message::answer(self.node, to, property.rules(), value).ok_or(Refused::Range(property))?;
        self.outbox.push_back(message.frame()).map_err(|_| {
            self.unsent = self.unsent.saturating_add(1);
            Refused::Busy(property)
        })
    }

    /// The bus is being served: tells what there is to report, and hands waiting frames to the CAN controller. To be called
    /// whenever it has room again, whenever [`Self::tick`] asks for it, and at least ten times a second.
    pub fn flush(&mut self) {
        self.bus_served = true;
        self.report();
        self.send();
    }

    pub(super) fn send(&mut self) {
        for _ in 0..OUTBOX {
            match self.outbox.front() {
                Some(frame) if self.board.transmit(frame) => self.outbox.pop_front(),
                _ => break,
            };
        }
    }

    /// Frames that were to be sent and found no room in the outbox.
    #[must_use]
    pub const fn unsent(&self) -> u32 {
        self.unsent
    }

    /// Tells the servo's reports, oldest first.
    pub(super) fn report(&mut self) {
        for _ in 0..EVENTS {
            let Some(event) = self.servo.event() else { break };
            self.tell(event);
        }
    }

    /// Tells a report: the host if it has asked for them, and whoever watches.
    fn tell(&mut self, event: Event) {
        let flags = self.kept.lflags;
        // Without room they are counted as unsent.
        match event {
            Event::Ended { reason, mode } if flags & REPORT_ENDS != 0 => {
                let _ = self.say(Node::HOST, Property::MODE, mode_code(mode).into());
                let _ = self.say(Node::HOST, Property::END, end_code(reason).into());
            }
            Event::Breakaway { position, .. } => {
                self.breakaway_position = position;
                if flags & REPORT_BREAKAWAYS != 0 {
                    let _ = self.say(Node::HOST, Property::BD, 1);
                }
            }
            Event::Ended { .. } | Event::Fault(_) | Event::Glitch(_) | Event::Homed => {}
        }
        if self.events.is_full() {
            self.events.pop_front();
        }
        // Room was made above.
        let _ = self.events.push_back(event);
    }

    /// What the servo reported, oldest first: for logs and simulations.
    pub fn event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }
}
