//! Packets: frames of the host, compiled by itself, and what boards send to it (manual 1.4, docs/wire.md, decision 0055).
//!
//! A packet is placed on the bus as it is, without echo, answer or prompt. From a host's first packet on, what boards send to the host while
//! no command runs is passed on: as packets with REPLY 1, otherwise as lines where they have a text.
//!
//! GOD stays responsible for the motors: it refuses to start one in a hot hand, and ^C or a disconnect stops those that packets have started.

use tater_wire::{Body, Destination, Frame, Group, Message, Node, Property};

use crate::boards::parse_report;
use crate::framing::Packet;
use crate::god::God;
use crate::motors::{Motor, Motors};
use crate::status::Status;
use crate::words::words;
use crate::{order, query};

/// Time for answers that are under way, µs: a group of seven takes 4 ms. One that a page's erase delays further is passed on.
const LATE_US: u64 = 10_000;

/// Places a packet of the host on the bus. Returns [`Status::INVALID_VALUE`] for an identifier that is not a host's,
/// [`Status::OVER_TEMPERATURE`] for an order to move in a hot hand, [`Status::NO_BOARD`] while the bus takes no frames.
pub(crate) async fn place(god: &God<'_>, packet: &Packet) -> Status {
    let Some(frame) = frame(packet).filter(|frame| frame.id().from == Node::HOST) else {
        return Status::INVALID_VALUE;
    };
    let message = Message::parse(&frame);
    let to = message.map_or(Motors::NONE, |message| motors_of(message.to));
    let order = message.and_then(set_of);
    let begins_motion = order.is_some_and(|(property, value)| order::begins_motion(property, value));
    if begins_motion && query::is_too_hot(god) {
        return Status::OVER_TEMPERATURE;
    }
    // On a dead bus the frame would wait in the CAN controller, and leave whenever the bus returns.
    if god.io.is_bus_down() && god.boards.get(to, Property::STAT).await.motors().is_empty() {
        return Status::NO_BOARD;
    }
    match (message.map(|message| message.body), order) {
        _ if begins_motion => god.session.steer(to),
        // The host moves them now, and has to keep their boards alive.
        (_, Some((property, value))) if order::changes_motion(property, value) => {
            god.session.cease_pressing(to)
        }
        (Some(Body::Torques(_)), _) => god.session.cease_pressing(to),
        _ => {}
    }
    let is_get = matches!(message.map(|message| message.body), Some(Body::Get(_)));
    let answers = if is_get { to.iter().map(|_| 1).sum() } else { 0 };
    god.session.passes_packet(answers, god.io.after_us(god.boards.answer_us()));
    if god.io.send(frame).await.is_err() {
        return Status::NO_BOARD;
    }
    if begins_motion {
        // With an answer the order has left; without one it is withdrawn with the questions.
        settle(god).await;
        if god.boards.get(to, Property::STAT).await.motors().is_empty() {
            return Status::NO_BOARD;
        }
    }
    Status::OK
}

/// The property that a message sets, and its value.
fn set_of(message: Message) -> Option<(Property, i64)> {
    let Body::Set { property, value } = message.body else { return None };
    let property = Property::of(property)?;
    Some((property, property.read(value)))
}

fn frame(packet: &Packet) -> Option<Frame> {
    match packet.as_slice() {
        [high, low, _, data @ ..] => Frame::from_raw(u16::from_be_bytes([*high, *low]), data),
        _ => None,
    }
}

/// The motors that a destination may reach; boards can have joined any group.
fn motors_of(to: Destination) -> Motors {
    match to {
        Destination::Node(node) => Motor::new(node.number()).map_or(Motors::NONE, Motors::only),
        Destination::Group(Group::LOW) => Motors::ALL.iter().filter(|motor| motor.number() <= 4).collect(),
        Destination::Group(Group::HIGH) => Motors::ALL.iter().filter(|motor| motor.number() > 4).collect(),
        Destination::Group(group) if !group.is_for_boards() => Motors::NONE,
        Destination::Group(_) => Motors::ALL,
    }
}

/// The next frame that a board has sent to the host, and not as the report of a motion that GOD reports itself. The others are noted.
pub(crate) fn next(god: &God<'_>) -> Option<Frame> {
    core::iter::from_fn(|| god.io.try_receive()).find(|frame| {
        god.boards.note(frame);
        is_for_host(god, frame)
    })
}

fn is_for_host(god: &God<'_>, frame: &Frame) -> bool {
    // The ends of motions are reported to the host that has started them: GOD has asked for the others.
    let is_end = match parse_report(frame) {
        Some((motor, Property::MODE | Property::END, _)) => !god.session.steered().has(motor),
        _ => false,
    };
    let (missing, _) = god.session.awaited();
    god.session.passes() && frame.id().from != Node::HOST && (missing > 0 || !is_end)
}

/// Passes a board's frame on to the host. Without REPLY 1 a frame that has no text is dropped.
pub(crate) async fn pass(god: &God<'_>, frame: &Frame) {
    god.session.answered();
    if god.session.packets() {
        write(god, frame).await;
    } else if let Some((motor, property, value)) = parse_report(frame) {
        reply(god, motor, property, value).await;
    }
}

/// Waits for the answers to the host's packets, so that a command does not take them for its own.
pub(crate) async fn settle(god: &God<'_>) {
    loop {
        let (missing, until_us) = god.session.awaited();
        if missing == 0 {
            return;
        }
        match god.io.wait_until(until_us, || next(god)).await {
            Some(frame) => pass(god, &frame).await,
            None => return god.session.give_up_answers(),
        }
    }
}

/// After ^C: waits for the answers to what was asked before it, and drops them, so that nothing but the prompt follows. Those to GOD's own
/// questions would look like news for the host.
pub(crate) async fn drop_late_answers(god: &God<'_>) {
    if god.session.passes() {
        god.boards.listen_until(god.io.after_us(LATE_US)).await;
        god.session.give_up_answers();
    }
}

/// Prints a board's value, or with REPLY 1 its frame.
pub(crate) async fn reply(god: &God<'_>, motor: Motor, property: Property, value: i64) {
    if !god.session.packets() {
        return god.print_line(words![motor.number(), " ", property.name(), "=", value]).await;
    }
    if let Some(message) = Message::reply(motor.node(), property, value) {
        write(god, &message.frame()).await;
    }
}

/// Writes a packet in one piece: ^C and a disconnect drop all of it or nothing.
async fn write(god: &God<'_>, frame: &Frame) {
    let [high, low] = frame.raw_id().to_be_bytes();
    let mut packet = Packet::new();
    let len = u8::try_from(frame.data().len()).unwrap_or(0);
    // A frame has at most eight bytes.
    let _ = packet.extend_from_slice(&[high, low, len]);
    let _ = packet.extend_from_slice(frame.data());
    god.io.write(&packet).await;
}
