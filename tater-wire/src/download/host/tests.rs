use std::string::{String, ToString};
use std::vec::Vec;

use super::*;
use crate::Value;
use crate::download::unpack;

const FILE: &[u8] = b"%0A6ABCDEFG\r\n%098xyz.notsent\r\n\r\n%12";
const SENT: &str = "0A6ABCDEFG098xyz12";

struct Toy {
    node: Node,
    /// STAT, or no board at all.
    stat: Option<i64>,
    styles: &'static [u16],
    error: i64,
    numbered: bool,
    got: String,
    frames: u32,
    due: u8,
    lose: Vec<u32>,
    silent_after: usize,
    heard: Vec<Frame>,
}

impl Toy {
    fn new(styles: &'static [u16]) -> Self {
        Self {
            node: Node::new(4).expect("a node"),
            stat: Some(2),
            styles,
            error: 0,
            numbered: false,
            got: String::new(),
            frames: 0,
            due: 0,
            lose: Vec::new(),
            silent_after: usize::MAX,
            heard: Vec::new(),
        }
    }

    fn reply(&self, property: Property, value: i64) -> Frame {
        Message::reply(self.node, property, value).expect("fits").frame()
    }

    fn request(&self) -> Option<Frame> {
        if self.got.len() >= SENT.len() || self.got.len() >= self.silent_after {
            return None;
        }
        let received = self.frames * if self.numbered { 8 } else { 1 };
        let body = if self.numbered { Body::More { frames: 2, received } } else { Body::Get(0) };
        Some(Message { from: self.node, to: Destination::Node(Node::HOST), body }.frame())
    }

    fn characters(&mut self, data: &[u8]) -> Option<Frame> {
        if let Some(at) = self.lose.iter().position(|lost| *lost == self.frames) {
            self.lose.remove(at);
            return None;
        }
        if self.numbered {
            let (number, characters) = unpack(data).expect("a numbered frame");
            if u32::from(number) != self.frames % 256 {
                return None;
            }
            self.got.extend(characters.iter().filter(|c| **c != 0).map(|c| char::from(*c)));
        } else {
            assert_eq!(data.len(), 1);
            self.got.push(char::from(data[0]));
        }
        self.frames += 1;
        self.due -= 1;
        if self.due > 0 {
            return None;
        }
        self.due = if self.numbered { 2 } else { 1 };
        self.request()
    }

    fn hear(&mut self, frame: &Frame) -> Option<Frame> {
        self.heard.push(*frame);
        let stat = self.stat?;
        if frame.data().len() == 8 || (frame.data().len() == 1 && frame.data()[0] >= b'0') {
            return self.characters(frame.data());
        }
        match Message::parse(frame).expect("a message").body {
            Body::Get(id) if id == Property::STAT.id() => Some(self.reply(Property::STAT, stat)),
            Body::Get(id) if id == Property::ERROR.id() => Some(self.reply(Property::ERROR, self.error)),
            Body::Set { property, value: Value::Short(value) } if property == Property::STAT.id() => {
                self.stat = Some(if stat == 1 { 1 } else { i64::from(value) });
                None
            }
            Body::Set { property: 0, value: Value::Short(style) } if self.styles.contains(&style) => {
                self.numbered = style == START_NUMBERED;
                self.due = if self.numbered { 2 } else { 1 };
                self.request()
            }
            _ => None,
        }
    }

    /// Frames take 100 µs, and a waiting board repeats its request after 200 ms.
    fn download(&mut self) -> (Result<(), DownloadError>, u64) {
        let mut host = Downloader::new(self.node, FILE, 0);
        let (mut now, mut repeat) = (0, u64::MAX);
        let all = SENT.len() as u32;
        assert_eq!(host.progress(), (0, all));
        // Neither a request nor an answer to this host.
        let of_board = |to, body| Message { from: self.node, to: Destination::Node(to), body }.frame();
        let third = Node::new(5).expect("a node");
        let others = [
            of_board(Node::HOST, Body::Get(Property::STAT.id())),
            of_board(third, Body::Get(0)),
            of_board(third, Body::More { frames: 9, received: 0 }),
            of_board(third, Body::Set { property: Property::ERROR.id(), value: Value::Short(18) }),
        ];
        loop {
            others.iter().for_each(|other| host.receive(other, now));
            let answer = match host.next(now) {
                Next::Done => {
                    assert_eq!(host.progress(), (all, all));
                    return (Ok(()), now);
                }
                Next::Failed(error) => return (Err(error), now),
                Next::Send(frame) => {
                    now += 100;
                    repeat = now + 200_000;
                    self.hear(&frame)
                }
                Next::Wait(until) => {
                    assert!(until > now, "time goes on");
                    now = until.min(repeat);
                    if now < until {
                        repeat = now + 200_000;
                        if self.due > 0 { self.request() } else { None }
                    } else {
                        None
                    }
                }
            };
            if let Some(answer) = answer {
                now += 100;
                host.receive(&answer, now);
            }
            assert!(now < 100_000_000, "it ends");
        }
    }
}

#[test]
fn sent_characters_match_barretts_hosts() {
    let sent = |file: &'static [u8]| Characters::new(file).map(char::from).collect::<String>();
    assert_eq!(sent(FILE), SENT);
    // The first character of a line is skipped; the first one below '0' ends it.
    assert_eq!(sent(b"ABC\nD E\n%%X\n\n%Z"), "BCZ");
    assert_eq!(sent(b""), "");
    assert_eq!(sent(b"\n\n%\n"), "");
}

#[test]
fn numbering_board_gets_eight_characters_a_frame_and_is_woken() {
    let mut toy = Toy::new(&[START_NUMBERED, START]);
    let (end, now) = toy.download();
    assert_eq!(end, Ok(()));
    assert_eq!((toy.got.as_str(), toy.stat), (SENT, Some(2)));
    assert_eq!(toy.heard.iter().filter(|frame| frame.data().len() == 8).count(), 3);
    // One wait of `QUIET_US` at the end, no other.
    assert!((QUIET_US..2 * QUIET_US).contains(&now), "{now}");
}

#[test]
fn other_board_gets_a_character_a_frame() {
    let mut toy = Toy::new(&[START]);
    let (end, now) = toy.download();
    assert_eq!((end, toy.got.as_str()), (Ok(()), SENT));
    assert!(now > BEGIN_US);
}

#[test]
fn lost_frames_are_sent_again() {
    for lost in 0..3 {
        let mut toy = Toy::new(&[START_NUMBERED]);
        toy.lose = [lost].into();
        assert_eq!((toy.download().0, toy.got.as_str()), (Ok(()), SENT), "frame {lost}");
    }
}

#[test]
fn board_of_single_characters_is_asked_nothing_that_it_could_take_for_one() {
    let mut toy = Toy { silent_after: 5, ..Toy::new(&[START]) };
    assert_eq!(toy.download().0, Err(DownloadError::Gone { sent: 5, len: 18 }));
    let question = Message::get(Destination::Node(toy.node), Property::ERROR).frame();
    assert!(!toy.heard.contains(&question));
}

#[test]
fn failure_has_a_cause_and_a_next_step() {
    let failed = |mut toy: Toy| {
        let error = toy.download().0.expect_err("it cannot succeed");
        assert!(!error.next_step().is_empty() && !error.to_string().contains("next"), "{error}");
        error
    };
    let node = Node::new(4).expect("a node");
    assert_eq!(failed(Toy { stat: None, ..Toy::new(&[START]) }), DownloadError::NoBoard { node });
    assert_eq!(failed(Toy { stat: Some(1), ..Toy::new(&[START]) }), DownloadError::NotReset { stat: 1 });
    assert_eq!(failed(Toy::new(&[])), DownloadError::NoRequest);
    let silent = |styles, after| Toy { silent_after: after, ..Toy::new(styles) };
    assert_eq!(failed(silent(&[START_NUMBERED], 16)), DownloadError::Gone { sent: 16, len: 18 });
    assert_eq!(failed(silent(&[START], 5)), DownloadError::Gone { sent: 5, len: 18 });
    let refused = failed(Toy { error: 18, ..silent(&[START_NUMBERED], 16) });
    assert_eq!(refused, DownloadError::Refused { error: 18 });
    assert!(refused.to_string().contains("BadChecksum"), "{refused}");
    let at_the_end = Toy { error: 22, ..Toy::new(&[START_NUMBERED]) };
    assert_eq!(failed(at_the_end), DownloadError::Refused { error: 22 });
    assert!(DownloadError::Refused { error: 999 }.to_string().contains("none that is known"));
}

#[test]
fn late_frames_and_frames_of_others_change_nothing() {
    let toy = Toy::new(&[START_NUMBERED]);
    let mut host = Downloader::new(toy.node, FILE, 0);
    let other = Node::new(5).expect("a node");
    for frame in [
        Message::reply(other, Property::STAT, 0).expect("fits").frame(),
        // No request before the start, and no unrequested answer.
        Message { from: toy.node, to: Destination::Node(Node::HOST), body: Body::Get(0) }.frame(),
        Message { from: toy.node, to: Destination::Node(other), body: Body::More { frames: 9, received: 0 } }
            .frame(),
        toy.reply(Property::ERROR, 18),
        Frame::EMPTY,
    ] {
        host.receive(&frame, 1);
    }
    let first: Vec<Next> = (0..3).map(|_| host.next(2)).collect();
    let get = Message::get(Destination::Node(toy.node), Property::STAT).frame();
    assert_eq!(first, [Next::Send(get), Next::Wait(2 + POLL_US), Next::Wait(2 + POLL_US)]);
}

/// SET VERS ends the download of a host that is gone. A reset would drop SET VERS, and single characters would take ten times as long.
#[test]
fn board_in_its_monitor_is_not_reset() {
    let mut toy = Toy { stat: Some(0), ..Toy::new(&[START, START_NUMBERED]) };
    assert_eq!(toy.download().0, Ok(()));
    let reset = Message::set(Destination::Node(toy.node), Property::STAT, 0).expect("fits").frame();
    assert!(toy.numbered && !toy.heard.contains(&reset));
    let mut awake = Toy::new(&[START, START_NUMBERED]);
    assert_eq!(awake.download().0, Ok(()));
    assert!(awake.numbered && awake.heard.contains(&reset));
}
