//! Motor boards on their bus, by SLCAN over TCP or a serial port, by a CAN interface of Linux, or by packets through a hand's GOD.
//!
//! The program is the bus's one host, node 0. A board that a host has put into mode 2 or 4 idles after HOSTMS, 2 s, without a frame.

use std::ops::ControlFlow;
use std::time::Duration;

use tater_wire::download::DownloadError;
use tater_wire::property::Access;
use tater_wire::{Cmd, Destination, FaultCode, Frame, Group, Message, ModeCode, Node, Property};

use crate::adapter::{Adapter, Health};
use crate::deadline::Deadline;
use crate::download::{self, Link, OnDownload};
use crate::error::{CallError, Cause, ConnectError, Failure};
use crate::firmware::Firmware;
use crate::hand::{BoardState, Hand, OnProgress, Progress, name, settable};

/// After so long without an answer a question is repeated: a board answers within 0.5 ms, 41 ms while it erases flash (docs/wire.md).
const REPEAT: Duration = Duration::from_millis(60);

/// A board that has not answered for so long is silent: some repetitions.
const LATE: Duration = Duration::from_millis(200);

/// After so long without an answer the adapter is closed and opened once: several repetitions, so that boards that are busy with their flash are no reason.
const SILENT: Duration = Duration::from_millis(300);

/// Times that a value is set until it reads back.
const SETS: u32 = 3;

/// Time between two readings during a motion, also the keep-alive of its board.
const POLL: Duration = Duration::from_millis(20);

/// Time for the stop order of a motion that is given up.
const STOP: Duration = Duration::from_millis(20);

enum Line {
    Adapter(Adapter),
    Hand(Box<Hand>),
}

/// A bus of motor boards.
pub struct Bus {
    line: Line,
    place: String,
}

impl Bus {
    /// Connects to an SLCAN adapter over TCP, `HOST:PORT`, and opens it at 1 Mbit/s.
    ///
    /// # Errors
    /// The cause and the next step, within the limit.
    pub fn slcan(address: &str, limit: Duration) -> Result<Self, ConnectError> {
        let deadline = Deadline::after(limit);
        Self::open(address, || Adapter::slcan(address, &deadline))
    }

    /// The same on a serial port, such as `/dev/ttyACM0`.
    ///
    /// # Errors
    /// The same.
    #[cfg(unix)]
    pub fn slcan_serial(path: &str, baud: u32, limit: Duration) -> Result<Self, ConnectError> {
        let deadline = Deadline::after(limit);
        Self::open(path, || Adapter::slcan_serial(path, baud, &deadline))
    }

    /// Opens a CAN interface of Linux, such as `can0`, which is up at 1 Mbit/s.
    ///
    /// # Errors
    /// There is none.
    #[cfg(target_os = "linux")]
    pub fn can(interface: &str) -> Result<Self, ConnectError> {
        Self::open(interface, || Adapter::can(interface))
    }

    /// Speaks to a hand's boards by packets.
    ///
    /// # Errors
    /// Those of every call.
    pub fn through(mut hand: Hand, limit: Duration) -> Result<Self, CallError> {
        hand.set_packets(true, limit)?;
        let place = hand.place().to_owned();
        Ok(Self { line: Line::Hand(Box::new(hand)), place })
    }

    fn open(place: &str, adapter: impl FnOnce() -> Result<Adapter, Cause>) -> Result<Self, ConnectError> {
        match adapter() {
            Ok(adapter) => Ok(Self { line: Line::Adapter(adapter), place: place.to_owned() }),
            Err(cause) => Err(ConnectError { place: place.to_owned(), cause }),
        }
    }

    /// Sends a frame.
    ///
    /// # Errors
    /// The connection is lost, or takes nothing within the limit.
    pub fn send(&mut self, frame: &Frame, limit: Duration) -> Result<(), CallError> {
        let call = || format!("send {:03X}", frame.raw_id());
        self.try_send(frame, &Deadline::after(limit)).map_err(|failure| CallError { call: call(), failure })
    }

    fn try_send(&mut self, frame: &Frame, deadline: &Deadline) -> Result<(), Failure> {
        match &mut self.line {
            Line::Adapter(adapter) => adapter.send(frame, deadline),
            Line::Hand(hand) => hand.send(frame, deadline.remaining()).map_err(|error| error.failure),
        }
    }

    /// The next frame; `None` if none comes within the limit.
    ///
    /// # Errors
    /// The connection is lost.
    pub fn receive(&mut self, limit: Duration) -> Result<Option<Frame>, CallError> {
        let outcome = self.try_receive(&Deadline::after(limit));
        outcome.map_err(|failure| CallError { call: "receive".to_owned(), failure })
    }

    fn try_receive(&mut self, deadline: &Deadline) -> Result<Option<Frame>, Failure> {
        match &mut self.line {
            Line::Adapter(adapter) => adapter.receive(deadline),
            Line::Hand(hand) => hand.receive(deadline.remaining()).map_err(|error| error.failure),
        }
    }

    /// A property of a board, in the units of docs/properties.md.
    ///
    /// # Errors
    /// [`Failure::Silent`] if no answer comes within the limit; [`Failure::Refused`]; those of every call.
    pub fn get(&mut self, node: Node, property: Property, limit: Duration) -> Result<i64, CallError> {
        let outcome = self.try_get(node, property, &Deadline::after(limit));
        let call = || format!("node {}: GET {}", node.number(), name(property));
        outcome.map_err(|failure| CallError { call: call(), failure })
    }

    fn try_get(&mut self, node: Node, property: Property, deadline: &Deadline) -> Result<i64, Failure> {
        self.get_with(node, property, deadline, &mut || ControlFlow::Continue(()))
    }

    /// The same; `on_wait` is called while an answer is late, and may end the wait.
    fn get_with(
        &mut self,
        node: Node,
        property: Property,
        deadline: &Deadline,
        on_wait: &mut dyn FnMut() -> ControlFlow<()>,
    ) -> Result<i64, Failure> {
        if property.rules().access == Access::WriteOnly {
            return Err(Failure::Invalid("a property that can be read".to_owned()));
        }
        let get = Message::get(Destination::Node(node), property).frame();
        self.set_refused(false);
        let (mut damaged, mut is_reopened) = (None, false);
        loop {
            self.try_send(&get, deadline)?;
            let repeat = deadline.within(REPEAT);
            while let Some(frame) = self.try_receive(&repeat)? {
                match reply(&frame, node, property) {
                    Some(Some(value)) => return Ok(value),
                    Some(None) => damaged = Some(frame),
                    None => {}
                }
            }
            if on_wait().is_break() {
                return Err(Failure::Cancelled);
            }
            if deadline.is_over() {
                return Err(match (self.set_refused(false), damaged) {
                    (true, _) => Failure::Refused,
                    // Each time, so it is no damage on the way.
                    (false, Some(frame)) => Failure::Unexpected(format!("{frame:?}")),
                    (false, None) => Failure::Silent(vec![node]),
                });
            }
            // An adapter that has left the bus may say nothing of it.
            if deadline.elapsed() > SILENT && damaged.is_none() && !std::mem::replace(&mut is_reopened, true)
            {
                self.reopen(deadline)?;
            }
        }
    }

    const fn stream(&mut self, is_streaming: bool) {
        if let Line::Adapter(adapter) = &mut self.line {
            adapter.stream(is_streaming);
        }
    }

    fn reopen(&mut self, deadline: &Deadline) -> Result<(), Failure> {
        match &mut self.line {
            Line::Adapter(adapter) => adapter.reopen(deadline),
            Line::Hand(_) => Ok(()),
        }
    }

    /// What the adapter has not carried at the first attempt. Through a hand and on a CAN interface it is nothing.
    #[must_use]
    pub const fn health(&self) -> Health {
        match &self.line {
            Line::Adapter(adapter) => adapter.health(),
            Line::Hand(_) => Health { refusals: 0, damaged: 0 },
        }
    }

    /// Whether the adapter has refused a frame since the last call, and a new value of that.
    const fn set_refused(&mut self, to: bool) -> bool {
        match &mut self.line {
            Line::Adapter(adapter) => adapter.set_refused(to),
            Line::Hand(_) => false,
        }
    }

    /// Sets a property of a board and reads it back. Orders, and quantities that the board itself changes (STAT, MODE, P, V, T), are not read
    /// back: a SET is not acknowledged on the bus.
    ///
    /// # Errors
    /// A value out of range, before anything is sent; [`Failure::NotTaken`]; those of [`Self::get`].
    pub fn set(
        &mut self,
        node: Node,
        property: Property,
        value: i64,
        limit: Duration,
    ) -> Result<(), CallError> {
        let outcome = self.try_set(node, property, value, &Deadline::after(limit));
        let call = || format!("node {}: SET {} {value}", node.number(), name(property));
        outcome.map_err(|failure| CallError { call: call(), failure })
    }

    fn try_set(
        &mut self,
        node: Node,
        property: Property,
        value: i64,
        deadline: &Deadline,
    ) -> Result<(), Failure> {
        settable(property, value)?;
        let set = Message::set(Destination::Node(node), property, value);
        let set = set.ok_or_else(|| Failure::Invalid("a value of 32 bits".to_owned()))?.frame();
        let changes = [Property::STAT, Property::MODE, Property::P, Property::V, Property::T];
        let mut found = value;
        // A frame may be lost or damaged on its way.
        for _ in 0..SETS {
            self.try_send(&set, deadline)?;
            if property.rules().access == Access::WriteOnly || changes.contains(&property) {
                return Ok(());
            }
            found = self.try_get(node, property, deadline)?;
            if found != value {
                // The late answer to an earlier question that was repeated, unless the board says it again.
                let rest = deadline.within(REPEAT);
                while self.try_receive(&rest)?.is_some() {}
                found = self.try_get(node, property, deadline)?;
            }
            if found == value {
                return Ok(());
            }
        }
        Err(Failure::NotTaken { node, found })
    }

    /// The state of a board. One that does not answer within the limit is silent.
    ///
    /// # Errors
    /// Those of every call, [`Failure::Silent`] excepted.
    pub fn state(&mut self, node: Node, limit: Duration) -> Result<BoardState, CallError> {
        match self.get(node, Property::STAT, limit) {
            Ok(0) => Ok(BoardState::Asleep),
            Ok(2) => Ok(BoardState::Ready),
            Ok(_) => Ok(BoardState::Unusable),
            Err(CallError { failure: Failure::Silent(_), .. }) => Ok(BoardState::Silent),
            Err(error) => Err(error),
        }
    }

    /// Requires boards that answer and are awake. Each has the limit to itself.
    ///
    /// # Errors
    /// The cause, with the nodes: asleep, without power, or none answers.
    pub fn require(&mut self, nodes: &[Node], limit: Duration) -> Result<(), ConnectError> {
        let (mut silent, mut asleep) = (Vec::new(), Vec::new());
        let mut outcome = Ok(());
        for &node in nodes {
            match self.state(node, limit) {
                Ok(BoardState::Ready) => {}
                Ok(BoardState::Silent) => silent.push(node),
                Ok(BoardState::Asleep | BoardState::Unusable) => asleep.push(node),
                Err(CallError { failure: Failure::Refused, .. }) => {
                    let why = "the adapter refuses frames, because the bus has another host".to_owned();
                    outcome = Err(Cause::InUse(why));
                }
                Err(error) => outcome = Err(Cause::HungUp(error.failure.to_string())),
            }
        }
        let outcome = outcome.and(match (silent.len(), asleep.is_empty()) {
            (0, true) => Ok(()),
            (0, false) => Err(Cause::Asleep(asleep)),
            (len, _) if len == nodes.len() => Err(Cause::BusNotAcknowledged),
            _ => Err(Cause::WithoutPower(silent)),
        });
        outcome.map_err(|cause| ConnectError { place: self.place.clone(), cause })
    }

    /// Wakes boards: SET STAT 2, then waits up to the limit; one takes up to 1 s.
    ///
    /// # Errors
    /// [`Failure::Silent`] with those that are not awake in time; those of every call.
    pub fn wake(&mut self, nodes: &[Node], limit: Duration) -> Result<(), CallError> {
        let deadline = Deadline::after(limit);
        for &node in nodes {
            self.set(node, Property::STAT, 2, deadline.remaining())?;
        }
        let mut waiting = nodes.to_vec();
        while !waiting.is_empty() && !deadline.is_over() {
            let mut asleep = Vec::new();
            for &node in &waiting {
                if self.state(node, REPEAT.min(deadline.remaining()))? != BoardState::Ready {
                    asleep.push(node);
                }
            }
            waiting = asleep;
        }
        match waiting.is_empty() {
            true => Ok(()),
            false => Err(CallError { call: "wake".to_owned(), failure: Failure::Silent(waiting) }),
        }
    }

    /// Moves a board's motor to a hall count and waits for the end, with the position as progress.
    ///
    /// # Errors
    /// [`Failure::NotReached`]; cancelled or not done within the limit, and then the motor is idled; those of [`Self::get`].
    pub fn move_to(
        &mut self,
        node: Node,
        halls: i64,
        limit: Duration,
        progress: OnProgress,
    ) -> Result<(), CallError> {
        self.motion(node, (Property::M, halls), limit, progress)
    }

    /// Finds a motor's stop (CMD HI) and waits for the end.
    ///
    /// # Errors
    /// The same.
    pub fn find_zero(&mut self, node: Node, limit: Duration, progress: OnProgress) -> Result<(), CallError> {
        self.motion(node, (Property::CMD, Cmd::Hi.into()), limit, progress)
    }

    fn motion(
        &mut self,
        node: Node,
        (property, value): (Property, i64),
        limit: Duration,
        progress: OnProgress,
    ) -> Result<(), CallError> {
        let deadline = Deadline::after(limit);
        let outcome = self
            .try_set(node, property, value, &deadline)
            .and_then(|()| self.follow(node, &deadline, progress));
        if matches!(outcome, Err(Failure::Cancelled | Failure::TimedOut(_) | Failure::Silent(_))) {
            // A lost connection is reported already by the call's own failure.
            let _ = self.try_set(node, Property::MODE, ModeCode::Idle.into(), &Deadline::after(STOP));
        }
        let call = || format!("node {}: {} {value}", node.number(), name(property));
        outcome.map_err(|failure| CallError { call: call(), failure })
    }

    /// Waits for END.
    fn follow(&mut self, node: Node, deadline: &Deadline, progress: OnProgress) -> Result<(), Failure> {
        let mut is_answering = Deadline::after(LATE);
        loop {
            let mut get = |property| {
                let on_wait = &mut || progress(&Progress { elapsed: deadline.elapsed(), values: Vec::new() });
                self.get_with(node, property, deadline, on_wait).map_err(|failure| match failure {
                    // Its answer to the last question was still to come.
                    Failure::Silent(_) if !is_answering.is_over() => Failure::TimedOut(deadline.limit()),
                    failure => failure,
                })
            };
            let (position, end) = (get(Property::P)?, get(Property::END)?);
            is_answering = Deadline::after(LATE);
            let seen = Progress { elapsed: deadline.elapsed(), values: vec![(node, position)] };
            let is_cancelled = progress(&seen) == ControlFlow::Break(());
            match end {
                0 if is_cancelled => return Err(Failure::Cancelled),
                0 if deadline.is_over() => return Err(Failure::TimedOut(deadline.limit())),
                0 => {}
                // Arrived, or met an object.
                1 | 5 => return Ok(()),
                end => {
                    let error = self.try_get(node, Property::ERROR, deadline)?;
                    let fault = FaultCode::of(error);
                    return Err(Failure::NotReached { node, end, fault, stop: None });
                }
            }
            let rest = deadline.within(POLL);
            while self.try_receive(&rest)?.is_some() {}
        }
    }

    /// Downloads firmware to a board and waits until it runs (docs/download.md): some 8 s. The board goes into its monitor by itself.
    ///
    /// # Errors
    /// [`Failure::Download`]; cancelled, or not done within the limit; [`Failure::Refused`]; those of every call. The board then has its old
    /// application.
    pub fn download(
        &mut self,
        node: Node,
        firmware: &Firmware,
        limit: Duration,
        progress: OnDownload,
    ) -> Result<(), CallError> {
        self.set_refused(false);
        let deadline = Deadline::after(limit);
        self.stream(true);
        let outcome = download::download(self, node, firmware, &deadline, progress);
        self.stream(false);
        let failure = match outcome {
            Ok(()) => return Ok(()),
            // No board has answered, and the adapter has sent nothing.
            Err(Failure::Download { error: DownloadError::NoBoard { .. }, .. })
                if self.set_refused(false) =>
            {
                Failure::Refused
            }
            Err(failure) => failure,
        };
        Err(CallError { call: format!("download to node {}", node.number()), failure })
    }

    /// The latched fault of a board.
    ///
    /// # Errors
    /// Those of [`Self::get`].
    pub fn fault(&mut self, node: Node, limit: Duration) -> Result<Option<FaultCode>, CallError> {
        self.get(node, Property::ERROR, limit).map(FaultCode::of)
    }

    /// Stops every board's motor: MODE 0 to all.
    ///
    /// # Errors
    /// Those of [`Self::send`].
    pub fn stop_all(&mut self, limit: Duration) -> Result<(), CallError> {
        let all = Destination::Group(Group::ALL);
        match Message::set(all, Property::MODE, ModeCode::Idle.into()) {
            Some(message) => self.send(&message.frame(), limit),
            None => Ok(()),
        }
    }
}

impl Link for Bus {
    fn send(&mut self, frame: &Frame, deadline: &Deadline) -> Result<(), Failure> {
        self.try_send(frame, deadline)
    }

    fn receive(&mut self, deadline: &Deadline) -> Result<Option<Frame>, Failure> {
        self.try_receive(deadline)
    }
}

/// The value of a property in a board's reply; without one if the reply is damaged.
fn reply(frame: &Frame, node: Node, property: Property) -> Option<Option<i64>> {
    let (from, of, value) = Message::parse(frame)?.answered()?;
    ((from, of) == (node, property)).then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reply_is_of_its_node_and_property() {
        let node = |number| Node::new(number).expect("a node");
        let stat = Message::reply(node(4), Property::STAT, 2).expect("it fits").frame();
        assert_eq!(reply(&stat, node(4), Property::STAT), Some(Some(2)));
        assert_eq!(reply(&stat, node(3), Property::STAT), None);
        assert_eq!(reply(&stat, node(4), Property::MODE), None);
        let place = Message::reply(node(4), Property::P, -5).expect("it fits").frame();
        assert_eq!(reply(&place, node(4), Property::P), Some(Some(-5)));
        let beyond = Frame::from_raw(0x486, &[0xCF, 0, 0x27, 0x80]).expect("a classic frame");
        assert_eq!(reply(&beyond, node(4), Property::KP), Some(None), "-32729");
        // A host's own SET is no answer.
        let set = Message::set(Destination::Node(node(4)), Property::STAT, 2).expect("it fits").frame();
        assert_eq!(reply(&set, node(4), Property::STAT), None);
    }
}
