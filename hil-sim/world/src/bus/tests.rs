use super::*;
use tater_wire::{Body, Destination, Message, Node, Property};

/// Answers every GET with the value of its request; transmits the frames of `plan`, which is in order of time.
#[derive(Clone, Default)]
struct Toy {
    node: u8,
    now_us: u64,
    busy_until_us: u64,
    plan: VecDeque<(u64, Frame)>,
    mailboxes: Vec<Frame>,
    heard: Heard,
}

impl Station for Toy {
    fn now_us(&self) -> u64 {
        self.now_us
    }

    fn advance(&mut self, until_us: u64) {
        assert!(until_us >= self.now_us, "time goes on");
        self.now_us = until_us;
        while let Some((_, frame)) = self.plan.pop_front_if(|(at, _)| *at <= until_us) {
            self.mailboxes.push(frame);
        }
    }

    fn next_us(&self) -> u64 {
        self.plan.front().map_or(u64::MAX, |(at, _)| *at)
    }

    fn busy_until_us(&self) -> u64 {
        self.busy_until_us
    }

    fn receive(&mut self, frame: &Frame) {
        self.heard.push((self.now_us, *frame));
        let node = Node::new(self.node).expect("a node");
        if let Some(Message { to, body: Body::Get(id), .. }) = Message::parse(frame)
            && to == Destination::Node(node)
            && let Some(reply) = Message::reply(node, Property::STAT, i64::from(id))
        {
            self.mailboxes.push(reply.frame());
        }
    }

    fn pending(&self) -> &[Frame] {
        &self.mailboxes
    }

    fn sent(&mut self, frame: &Frame) {
        if let Some(at) = self.mailboxes.iter().position(|pending| pending == frame) {
            self.mailboxes.remove(at);
        }
    }
}

fn toys(nodes: std::ops::RangeInclusive<u8>) -> Vec<Toy> {
    nodes.map(|node| Toy { node, ..Toy::default() }).collect()
}

fn frame(id: u16, data: &[u8]) -> Frame {
    Frame::from_raw(id, data).expect("a classic frame")
}

fn bus(nodes: std::ops::RangeInclusive<u8>) -> Bus<Toy> {
    let mut bus = Bus::new(toys(nodes));
    bus.plug_host("test", Adapter::default()).expect("the first host");
    bus
}

fn ids(toy: &Toy) -> Vec<u16> {
    toy.heard.iter().map(|(_, frame)| frame.raw_id()).collect()
}

fn received(bus: &mut Bus<Toy>, until_us: u64) -> Vec<(u64, u16)> {
    std::iter::from_fn(|| bus.wait(until_us)).map(|s| (s.at_us, s.frame.raw_id())).collect()
}

#[test]
fn request_and_answer_take_their_bit_times_and_the_board_delay() {
    let mut bus = bus(4..=4);
    let get = frame(4, &[5]);
    bus.send(get).expect("plugged");
    let answer = bus.wait(10_000).expect("an answer");
    let reply = frame(0x406 | 4 << 5, &[0x85, 0, 5, 0]);
    assert_eq!(answer.frame, reply);
    // The intermission ends within `BOARD_US`.
    assert_eq!(answer.at_us, bits(&get) + BOARD_US + bits(&reply));
    bus.run_until(20_000);
    let stats = bus.stats();
    assert_eq!((stats.frames, stats.errors, stats.overruns), (2, 0, 0));
    assert_eq!(stats.busy_us, bits(&get) + bits(&reply) + 2 * INTERMISSION);
    assert_eq!(stats.by_id, BTreeMap::from([(4, 1), (0x486, 1)]));
}

#[test]
fn lowest_identifier_wins_and_host_keeps_its_order_back_to_back() {
    let mut bus = Bus::new(toys(1..=4));
    bus.plug_host("test", Adapter::default()).expect("the first host");
    // Begins at 0 and keeps the bus busy while all the rest becomes pending.
    let first = frame(0x7F0, &[0; 8]);
    bus.station_mut(0).expect("there").mailboxes = vec![first];
    let plan = |ids: &[u16]| ids.iter().map(|&id| (10, frame(id, &[1]))).collect::<VecDeque<_>>();
    bus.station_mut(1).expect("there").plan = plan(&[0x300, 0x100, 0x200]);
    bus.station_mut(2).expect("there").plan = plan(&[0x180]);
    bus.run_until(5);
    // A host's queue is not sorted: 0x010 waits behind 0x280, which waits for 0x100 to 0x200.
    bus.send(frame(0x280, &[])).expect("plugged");
    bus.send(frame(0x010, &[])).expect("plugged");
    bus.run_until(2_000);
    let station = bus.stations().nth(3).expect("there");
    assert_eq!(ids(station), [0x7F0, 0x100, 0x180, 0x200, 0x280, 0x010, 0x300]);
    let mut end = 0;
    for (at, frame) in &station.heard {
        end += bits(frame);
        assert_eq!(*at, end + BOARD_US, "{frame:?}");
        end += INTERMISSION;
    }
    assert_eq!(bus.stats().busy_us, end);
}

#[test]
fn equal_identifiers_send_the_first_mailbox_first() {
    let mut bus = bus(1..=1);
    let frames = [frame(0x406, &[1]), frame(0x406, &[2]), frame(0x403, &[3])];
    bus.station_mut(0).expect("there").mailboxes = frames.to_vec();
    let order: Vec<u8> = std::iter::from_fn(|| bus.wait(1_000)).map(|s| s.frame.data()[0]).collect();
    assert_eq!(order, [3, 1, 2]);
}

/// Two stations that send these at the same time.
fn twins(one: &[Frame], other: &[Frame]) -> Bus<Toy> {
    let mut bus = bus(1..=2);
    for (index, frames) in [one, other].into_iter().enumerate() {
        bus.station_mut(index).expect("there").mailboxes = frames.to_vec();
    }
    bus
}

#[test]
fn equal_frames_of_two_stations_are_one_frame() {
    let same = frame(0x426, &[0x85, 0, 2, 0]);
    let mut bus = twins(&[same], &[same]);
    bus.run_until(10_000);
    assert_eq!(std::iter::from_fn(|| bus.receive()).map(|s| s.frame).collect::<Vec<_>>(), [same]);
    assert!(bus.stations().all(|toy| toy.mailboxes.is_empty()), "both have sent it");
    assert_eq!((bus.stats().frames, bus.stats().errors, bus.stats().conflicts), (1, 0, 0));
    // A cut cable does not break what the other one sends as well.
    let mut bus = twins(&[same], &[same]);
    bus.run_until(20);
    bus.cut(1, true);
    bus.run_until(10_000);
    assert_eq!((bus.stats().frames, bus.stats().errors), (1, 0));
}

#[test]
fn different_frames_of_one_identifier_destroy_each_other_until_their_senders_are_error_passive() {
    let (low, high) = (frame(0x426, &[0x85, 0, 0, 0]), frame(0x426, &[0x85, 0, 2, 0]));
    let mut bus = twins(&[high], &[low]);
    let received: Vec<Stamped> = std::iter::from_fn(|| bus.wait(10_000)).collect();
    // The dominant bit survives first.
    assert_eq!(received.iter().map(|s| s.frame).collect::<Vec<_>>(), [low, high]);
    // 16 errors of 8 make 128.
    assert_eq!((bus.stats().errors, bus.stats().conflicts, bus.stats().bus_offs), (16, 17, 0));
    let (at_bit, _) = length::difference(&low, &high).expect("they differ");
    assert_eq!(received[0].at_us, 16 * (at_bit + ERROR_FRAME + INTERMISSION) + bits(&low));
}

#[test]
fn two_stations_of_one_identifier_go_bus_off_now_and_then_and_lose_nothing() {
    let answers = |value: u8| vec![frame(0x426, &[0x85, 0, value, 0]); 200];
    let mut bus = twins(&answers(0), &answers(2));
    let received = received(&mut bus, 1_000_000);
    assert_eq!(received.len(), 400);
    assert!(bus.stats().bus_offs > 0, "{:?}", bus.stats());
    assert_eq!(bus.stats().frames, 400);
}

#[test]
fn guest_answers_beside_the_stations_until_it_is_unplugged() {
    let mut bus = bus(1..=2);
    bus.plug_guest(Toy { node: 2, ..Toy::default() });
    bus.send(frame(2, &[5])).expect("plugged");
    bus.run_until(10_000);
    assert_eq!((bus.stations().count(), bus.guests().count()), (2, 1));
    assert!(bus.guests().all(|toy| toy.heard.len() == 1 && toy.mailboxes.is_empty()));
    // In the middle of its frame.
    bus.station_mut(2).expect("the guest").mailboxes.push(frame(0x446, &[1]));
    bus.run_until(10_020);
    assert!(bus.unplug_guest().is_some() && bus.unplug_guest().is_none());
    bus.run_until(20_000);
    assert_eq!((bus.stats().errors, bus.guests().count()), (1, 0));
    assert_eq!(std::iter::from_fn(|| bus.receive()).count(), 1, "both gave the same answer");
}

#[test]
fn stalled_station_keeps_two_frames_and_the_newest_and_still_transmits() {
    let mut bus = bus(1..=2);
    let station = bus.station_mut(0).expect("there");
    station.busy_until_us = 40_000;
    station.mailboxes = vec![frame(0x426, &[9])];
    for id in 1..=5 {
        bus.send(frame(id << 5, &[0])).expect("plugged");
    }
    assert_eq!(received(&mut bus, 50_000).iter().map(|(_, id)| *id).collect::<Vec<_>>(), [0x426]);
    let heard = &bus.stations().next().expect("there").heard;
    let times: Vec<(u64, u16)> = heard.iter().map(|(at, frame)| (*at, frame.raw_id())).collect();
    assert_eq!(times, [(39_999, 1 << 5), (39_999, 2 << 5), (39_999, 5 << 5)]);
    assert_eq!(bus.stats().overruns, 2);
    assert_eq!(bus.stations().nth(1).expect("there").heard.len(), 6, "the other one hears all");
}

struct Breaks {
    left: u32,
    at_bit: u64,
}

impl Medium for Breaks {
    fn fate(&mut self, _: &Frame, _: u64, _: u64) -> Fate {
        if self.left == 0 {
            return Fate::Delivered;
        }
        self.left -= 1;
        Fate::Corrupted { at_bit: self.at_bit }
    }
}

#[test]
fn corrupted_frame_costs_an_error_frame_and_is_repeated() {
    let mut bus = bus(1..=1);
    bus.set_medium(Breaks { left: 2, at_bit: 17 });
    // No message: a board does not answer it.
    let sent = frame(1, &[0x81, 2, 3]);
    bus.send(sent).expect("plugged");
    bus.run_until(1_000);
    let station = bus.stations().next().expect("there");
    let begin = 2 * (17 + ERROR_FRAME + INTERMISSION);
    assert_eq!(station.heard, [(begin + bits(&sent) + BOARD_US, sent)]);
    assert_eq!((bus.stats().errors, bus.stats().frames), (2, 1));
    assert_eq!(bus.stats().busy_us, begin + bits(&sent) + INTERMISSION);
}

#[test]
fn more_urgent_frame_precedes_a_repetition() {
    let mut bus = bus(1..=2);
    bus.set_medium(Breaks { left: 1, at_bit: 40 });
    bus.station_mut(0).expect("there").mailboxes = vec![frame(0x500, &[])];
    bus.station_mut(1).expect("there").plan = VecDeque::from([(30, frame(0x400, &[]))]);
    assert_eq!(received(&mut bus, 1_000).iter().map(|(_, id)| *id).collect::<Vec<_>>(), [0x400, 0x500]);
}

#[test]
fn cut_cable_silences_one_station_and_lone_station_waits() {
    let mut bus = bus(1..=1);
    bus.cut(0, true);
    bus.station_mut(0).expect("there").mailboxes = vec![frame(0x426, &[])];
    bus.send(frame(1, &[0])).expect("plugged");
    assert_eq!(received(&mut bus, 5_000), []);
    assert_eq!(bus.stats(), &Stats::default(), "nobody acknowledges");
    bus.cut(0, false);
    assert_eq!(received(&mut bus, 6_000).len(), 2, "what it had to say, and the answer");
}

#[test]
fn abort_pending_drops_all_but_the_frame_on_the_wire() {
    let mut bus = bus(1..=1);
    let frames: Vec<Frame> = (0..3).map(|data| frame(1, &[data])).collect();
    frames.iter().for_each(|&frame| bus.send(frame).expect("plugged"));
    bus.run_until(20);
    bus.abort_pending();
    bus.run_until(5_000);
    let heard = |bus: &Bus<Toy>| {
        bus.stations().flat_map(|toy| toy.heard.clone()).map(|(_, frame)| frame).collect::<Vec<_>>()
    };
    assert_eq!(heard(&bus), frames[..1]);
    // Without a receiver no frame starts.
    bus.cut(0, true);
    frames.iter().for_each(|&frame| bus.send(frame).expect("plugged"));
    bus.run_until(10_000);
    bus.abort_pending();
    bus.cut(0, false);
    bus.run_until(20_000);
    assert_eq!(heard(&bus), frames[..1]);
}

#[test]
fn station_behind_a_cut_receives_nothing() {
    let mut bus = bus(1..=2);
    bus.cut(0, true);
    bus.send(frame(2, &[0])).expect("plugged");
    assert_eq!(received(&mut bus, 5_000).len(), 1, "the other one answers");
    assert_eq!(bus.stations().map(|toy| toy.heard.len()).collect::<Vec<_>>(), [0, 1]);
}

#[test]
fn cable_cut_within_a_frame_destroys_it() {
    let mut bus = bus(1..=2);
    bus.station_mut(0).expect("there").mailboxes = vec![frame(0x426, &[])];
    bus.run_until(20);
    bus.cut(0, true);
    assert_eq!(received(&mut bus, 5_000), []);
    assert_eq!(bus.stats().errors, 1);
    bus.cut(0, false);
    assert_eq!(received(&mut bus, 6_000).len(), 1);
}

#[test]
fn second_host_is_refused_until_the_first_unplugs() {
    let mut bus = bus(1..=1);
    let refused = bus.plug_host("GOD", Adapter::default()).expect_err("one too many");
    assert_eq!((refused.present.as_str(), refused.refused.as_str()), ("test", "GOD"));
    assert!(refused.to_string().contains("node 0"));
    bus.send(frame(1, &[0])).expect("plugged");
    bus.run_until(10);
    bus.unplug_host();
    assert_eq!(bus.send(frame(1, &[0])), Err(NoHost));
    bus.plug_host("GOD", Adapter::default()).expect("the place is free");
    assert_eq!(received(&mut bus, 5_000), [], "the other host's frame was cut off, and is not repeated");
    assert_eq!(bus.stats().errors, 1);
}

#[test]
fn adapter_adds_its_delays() {
    let mut bus = Bus::new(toys(4..=4));
    bus.plug_host("test", Adapter { out_us: 125, in_us: 1_000 }).expect("the first host");
    let (get, reply) = (frame(4, &[5]), frame(0x486, &[0x85, 0, 5, 0]));
    bus.send(get).expect("plugged");
    let answer = bus.wait(5_000).expect("an answer");
    assert_eq!(answer.at_us, 125 + bits(&get) + BOARD_US + bits(&reply) + 1_000);
    assert_eq!(bus.now_us(), answer.at_us);
}

type Heard = Vec<(u64, Frame)>;

fn noisy(seed: u64) -> (Stats, Vec<(u64, u16)>, Vec<Heard>) {
    let mut bus = bus(1..=7);
    bus.set_medium(Noise::new(seed, 0.05, 0.1));
    let mut answers = Vec::new();
    for round in 1..=200 {
        for node in 1..=7 {
            bus.send(frame(node, &[5])).expect("plugged");
        }
        answers.extend(received(&mut bus, round * 5_000));
    }
    let heard = bus.stations().map(|toy| toy.heard.clone()).collect();
    (bus.stats().clone(), answers, heard)
}

#[test]
fn same_seed_repeats_the_bus_and_noise_has_its_rate() {
    let (stats, answers, heard) = noisy(7);
    assert_eq!((&stats, &answers, &heard), (&noisy(7).0, &noisy(7).1, &noisy(7).2));
    assert_ne!(stats, noisy(8).0);
    // 1,400 requests, each lost by its board with 5 %, and each answer by the host with 5 %: 1,263.5 +- 11 (one sigma).
    assert!((1_208..=1_319).contains(&answers.len()), "{}: five sigma", answers.len());
    // A frame is destroyed with 10 %, so there are 1/9 errors per frame: for about 2,730 frames 303 +- 18.
    assert!((213..=393).contains(&stats.errors), "{}: five sigma", stats.errors);
    assert_eq!(stats.frames, stats.by_id.values().sum::<u64>());
}
