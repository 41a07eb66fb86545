//! Frames of a host that changes who a board is: ID, groups, KIND, ROLE and WIRING, with LOCK's sequence where it is needed.

use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use tater_wire::{Destination, Frame, Message, Node, Property};

use super::lines::one;

/// LOCK's sequence (docs/properties.md).
pub const KEYS: [i64; 5] = [18384, 23, 3145, 1024, 1];

/// What is changed. ID is drawn more often: it takes a board away from its number.
const PROPERTIES: [Property; 9] = [
    Property::ID,
    Property::ID,
    Property::ID,
    Property::KIND,
    Property::WIRING,
    Property::ROLE,
    Property::GRPA,
    Property::GRPB,
    Property::GRPC,
];

/// Such frames to a board: mostly with LOCK's sequence, often stored, and often started anew, which a new number wants.
pub fn frames(rng: &mut Pcg64Mcg, to: Node) -> Vec<Frame> {
    let property = *one(rng, &PROPERTIES);
    let value = match property {
        Property::ID if rng.random() => rng.random_range(1..=7),
        // Unknown. Another value would state a wiring that there is not, which the board must believe.
        Property::WIRING => 0,
        _ => rng.random_range(property.row().min..=property.row().max),
    };
    let mut orders = Vec::new();
    if rng.random_ratio(7, 8) {
        orders.extend(KEYS.map(|key| (Property::LOCK, key)));
    }
    orders.push((property, value));
    if rng.random_ratio(3, 4) {
        orders.push((Property::SAVE, property.id().into()));
    }
    if rng.random_ratio(3, 4) {
        orders.push((Property::STAT, 0));
    }
    let set = |(property, value)| Message::set(Destination::Node(to), property, value);
    orders.into_iter().filter_map(set).map(|message| message.frame()).collect()
}
