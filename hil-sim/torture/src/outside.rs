//! What other hosts send on the bus beside GOD: the frame sequences of Barrett's API, libbarrett, OWD and cisst (tests/host), with their pauses, to the nodes and the group of
//! a hand alone. They take a BH8-280's units for granted: what is out of range here is refused. A serial adapter may stand between: SLCAN has no
//! checksum, so that a damaged line is refused by its grammar, or another frame.

use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use tater_wire::{Body, Destination, Frame, Group, Identifier, Message, Node, Property, Torques};
use wraptor::slcan::line as slcan;

use super::lines::one;

/// Frames that are sent together, and the pause after them, ms.
pub type Burst = (Vec<Frame>, u64);

/// Commands of the API by their numbers (docs/properties.md): RESET, HI, C, O.
const RESET: i64 = 2;
const HI: i64 = 13;
const C: i64 = 18;
const O: i64 = 20;

/// A host, by what it sends.
type Host = fn(&mut Pcg64Mcg) -> Vec<Burst>;

/// Every host.
pub const HOSTS: [Host; 4] = [barretts_api, libbarrett, owd, cisst];

/// The bursts of one of the hosts.
pub(crate) fn bursts(rng: &mut Pcg64Mcg) -> Vec<Burst> {
    let host = one(rng, &HOSTS);
    host(rng)
}

/// One line in so many is damaged on the way to the adapter.
const DAMAGE: u32 = 10;

/// What an adapter sends of the bursts, when a serial line loses, doubles or changes some of their characters.
pub(crate) fn through_adapter(rng: &mut Pcg64Mcg, bursts: Vec<Burst>) -> Vec<Burst> {
    let mut sent = |frame: Frame| {
        let mut line = slcan::format(&frame, None).into_bytes();
        if rng.random_ratio(1, DAMAGE) {
            damage(rng, &mut line);
        }
        slcan::frame(&line)
    };
    bursts
        .into_iter()
        .map(|(frames, pause_ms)| (frames.into_iter().filter_map(&mut sent).collect(), pause_ms))
        .collect()
}

/// Loses, doubles or changes a character of the line.
fn damage(rng: &mut Pcg64Mcg, line: &mut Vec<u8>) {
    let at = rng.random_range(0..line.len());
    match rng.random_range(0..3) {
        0 => drop(line.remove(at)),
        1 => line.insert(at, line[at]),
        // The grammar refuses any other character.
        _ => line[at] = *one(rng, b"0123456789ABCDEF"),
    }
}

fn nodes() -> impl Iterator<Item = Destination> {
    (1..=7).filter_map(Node::new).map(Destination::Node)
}

const ALL: Destination = Destination::Group(Group::TATERS);

fn set(from: Node, to: Destination, property: Property, value: i64) -> Option<Frame> {
    Message::set(to, property, value).map(|message| Message { from, ..message }.frame())
}

fn get(from: Node, to: Destination, property: Property) -> Option<Frame> {
    Frame::new(Identifier { from, to }, &[property.id()])
}

fn each(order: impl Fn(Destination) -> Vec<Option<Frame>>) -> Vec<Frame> {
    nodes().flat_map(order).flatten().collect()
}

fn polls(from: Node, property: Property, times: u32, pause_ms: u64) -> impl Iterator<Item = Burst> {
    (0..times).map(move |_| (get(from, ALL, property).into_iter().collect(), pause_ms))
}

/// Node 6, so that answers come as a SET of VALUE: RESET, STAT, HI, its defaults, C and O.
fn barretts_api(rng: &mut Pcg64Mcg) -> Vec<Burst> {
    let from = Node::new(6).unwrap_or(Node::HOST);
    let command = |cmd| each(|to| vec![set(from, to, Property::CMD, cmd)]);
    let defaults = [
        (Property::CT, 195_000),
        (Property::MT, 3300),
        (Property::MV, 200),
        (Property::TSTOP, 250),
        (Property::IVEL, -75),
        (Property::KP, 500),
        (Property::KD, 5000),
        (Property::HSG, 0),
        (Property::SAVE, -1),
    ];
    let mut bursts = vec![
        (command(RESET), 1000),
        (each(|to| vec![get(from, to, Property::STAT), set(from, to, Property::STAT, 2)]), 1000),
        (command(HI), 100),
    ];
    bursts.extend(polls(from, Property::MODE, rng.random_range(1..=40), 100));
    bursts.extend(defaults.map(|(property, value)| (each(|to| vec![set(from, to, property, value)]), 1)));
    bursts.push((command(*one(rng, &[C, O])), 50));
    bursts.extend(polls(from, Property::MODE, rng.random_range(1..=20), 50));
    bursts
}

/// Looks at each board, wakes it, HI of the group, a move, a speed, and packed torques at 500 Hz.
fn libbarrett(rng: &mut Pcg64Mcg) -> Vec<Burst> {
    let from = Node::HOST;
    let look = [Property::ROLE, Property::VERS, Property::STAT];
    let mut bursts: Vec<Burst> = nodes()
        .map(|to| {
            let looks = look.map(|property| get(from, to, property));
            (looks.into_iter().chain([set(from, to, Property::STAT, 2)]).flatten().collect(), 50)
        })
        .collect();
    bursts.push((set(from, ALL, Property::CMD, HI).into_iter().collect(), 100));
    bursts.extend(polls(from, Property::MODE, rng.random_range(1..=40), 100));
    let (goal, speed) = (rng.random_range(-60..=360), rng.random_range(-300..=300));
    for (property, value, mode) in [(Property::E, goal, 5), (Property::V, speed, 4)] {
        let mut frames = each(|to| vec![set(from, to, property, value)]);
        frames.extend(set(from, ALL, Property::MODE, mode));
        bursts.push((frames, 500));
    }
    bursts.push((set(from, ALL, Property::MODE, 2).into_iter().collect(), 2));
    bursts.extend((0..rng.random_range(1..=100)).map(|_| {
        let torques: [i16; 4] = std::array::from_fn(|_| rng.random_range(-990..=990));
        let groups = [Group::LOW, Group::HIGH];
        let packed = |group| {
            let body = Body::Torques(Torques::new(&torques)?);
            Some(Message { from, to: Destination::Group(group), body }.frame())
        };
        (groups.into_iter().filter_map(packed).collect(), 2)
    }));
    bursts.push((set(from, ALL, Property::MODE, 0).into_iter().collect(), 10));
    bursts
}

/// Puts each board into its own groups, HI of one after the other, its gains, a move.
fn owd(rng: &mut Pcg64Mcg) -> Vec<Burst> {
    let from = Node::HOST;
    let groups = [(Property::GRPA, 0), (Property::GRPB, 5), (Property::GRPC, 5)];
    let mut bursts: Vec<Burst> =
        nodes().map(|to| (set(from, to, Property::STAT, 2).into_iter().collect(), 100)).collect();
    bursts.push((each(|to| groups.map(|(property, group)| set(from, to, property, group)).to_vec()), 100));
    for to in nodes() {
        bursts.push((set(from, to, Property::CMD, HI).into_iter().collect(), rng.random_range(50..=500)));
    }
    let goal = rng.random_range(-60..=360);
    let order = [
        (Property::TSTOP, 50),
        (Property::HOLD, 0),
        (Property::KP, 125),
        (Property::KD, 1250),
        (Property::HSG, 0),
        (Property::E, goal),
        (Property::MODE, 5),
    ];
    bursts.push((each(|to| order.map(|(property, value)| set(from, to, property, value)).to_vec()), 50));
    bursts.extend(polls(from, Property::THERM, rng.random_range(1..=20), 50));
    bursts
}

/// Wakes and idles each motor, HI of all, positions of the group, goals of mode 3 every 40 ms.
fn cisst(rng: &mut Pcg64Mcg) -> Vec<Burst> {
    let from = Node::HOST;
    let mut bursts = vec![
        (each(|to| vec![set(from, to, Property::STAT, 2)]), 1000),
        (each(|to| vec![set(from, to, Property::MODE, 0), get(from, to, Property::GRPA)]), 10),
        (each(|to| vec![set(from, to, Property::CMD, HI)]), 1000),
    ];
    bursts.extend(polls(from, Property::P, rng.random_range(1..=40), 100));
    bursts.push((set(from, ALL, Property::MODE, 3).into_iter().collect(), 10));
    let step = rng.random_range(-8..=8);
    bursts.extend((1..=25).map(|at| (each(|to| vec![set(from, to, Property::P, at * step)]), 40)));
    bursts
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn adapter_refuses_what_damage_makes_no_frame_and_sends_other_frames_too() {
        let mut rng = Pcg64Mcg::seed_from_u64(1);
        let frames: Vec<Frame> =
            (0..100).flat_map(|_| each(|to| vec![set(Node::HOST, to, Property::E, 1234)])).collect();
        let sent = through_adapter(&mut rng, vec![(frames.clone(), 5)]);
        let [(sent, 5)] = &sent[..] else { panic!("one burst: {sent:?}") };
        let refused = frames.len() - sent.len();
        let changed = sent.iter().filter(|frame| !frames.contains(frame)).count();
        // A tenth of 700 are damaged; two thirds of these have another length.
        assert!(
            (30..70).contains(&refused) && (5..40).contains(&changed),
            "{refused} refused, {changed} changed"
        );
    }

    #[test]
    fn each_host_wakes_homes_and_moves_all_seven_boards() {
        for (number, host) in HOSTS.into_iter().enumerate() {
            let frames: Vec<Frame> =
                host(&mut Pcg64Mcg::seed_from_u64(1)).into_iter().flat_map(|(frames, _)| frames).collect();
            let orders: Vec<(Destination, u8)> = frames
                .iter()
                .filter_map(Message::parse)
                .filter_map(|message| match message.body {
                    Body::Set { property, .. } => Some((message.to, property)),
                    _ => None,
                })
                .collect();
            let reaches = |to, property: Property| {
                orders.contains(&(to, property.id())) || orders.contains(&(ALL, property.id()))
            };
            for property in [Property::STAT, Property::CMD] {
                assert!(nodes().all(|to| reaches(to, property)), "host {number}: {property:?}");
            }
        }
    }
}
