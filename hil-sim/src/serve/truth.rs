//! `--truth`: the plant's true state for tests outside of this program, which compare with it what their host asked for.
//!
//! A line of a client, whatever it says, is answered by one line of JSON with the state at that time. Several clients may ask; none can
//! change anything.

use std::sync::mpsc::SyncSender;

use serde::Serialize;
use tater_wire::MotorKind;

use super::event::{Event, NewClient};
use super::link::Link;
use super::tcp::{self, Refusals};
use hil_world::bus::Bus;
use hil_world::node::Node;
use programs::output::warn;

/// Maximum number of clients.
const CLIENTS: usize = 4;

/// Smallest torque of a contact, N·m at the motor: less is the residue of the contact's last step.
const TOUCHES_N_M: f64 = 1e-6;

/// An answer. Quantities of the joint are those of the motor through a gear without play or loss.
#[derive(Serialize)]
struct Answer {
    /// Simulated time, µs.
    t_us: u64,
    motors: Vec<Motor>,
}

#[derive(Serialize)]
struct Motor {
    node: u8,
    motor: &'static str,
    /// Hall counts from the joint's zero; the stops stand half a count outside the joint's range.
    position_counts: f64,
    position_rad: f64,
    velocity_counts_per_s: f64,
    velocity_rad_per_s: f64,
    /// Of the motor; positive closes.
    torque_n_m: f64,
    /// The same at the joint.
    joint_torque_n_m: f64,
    /// Whether the joint presses a stop or an object.
    contact: bool,
    /// With what they press the joint; positive closes.
    contact_n_m: f64,
    brake_engaged: bool,
}

impl Motor {
    fn of(node: &Node) -> Self {
        let truth = node.board().rig().truth();
        let kind = MotorKind::of(node.straps());
        let gear = kind.gear_hundredths() as f64 / 100.0;
        let rad_per_count = std::f64::consts::TAU / (gear * MotorKind::COUNTS_PER_TURN as f64);
        Self {
            node: node.straps().number(),
            motor: kind.name(),
            position_counts: truth.counts,
            position_rad: truth.counts * rad_per_count,
            velocity_counts_per_s: truth.counts_per_s,
            velocity_rad_per_s: truth.counts_per_s * rad_per_count,
            torque_n_m: truth.torque_n_m,
            joint_torque_n_m: truth.torque_n_m * gear,
            contact: truth.load_n_m.abs() > TOUCHES_N_M,
            contact_n_m: truth.load_n_m * gear,
            brake_engaged: truth.brake_engaged,
        }
    }
}

/// The line that answers a request now.
pub fn line(bus: &Bus<Node>) -> String {
    let answer = Answer { t_us: bus.now_us(), motors: bus.stations().map(Motor::of).collect() };
    // Numbers and names always serialize.
    serde_json::to_string(&answer).unwrap_or_default() + "\n"
}

struct Client {
    link: Link,
    /// Requests that have not been answered.
    asked: usize,
    /// The last byte was a CR, which an LF belongs to.
    after_cr: bool,
    has_ended: bool,
    out: Vec<u8>,
}

impl Client {
    fn hear(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.asked += usize::from(byte == b'\r' || byte == b'\n' && !self.after_cr);
            self.after_cr = byte == b'\r';
        }
    }

    /// Answers while the client reads; its next bytes are read when all of these are answered.
    fn serve(&mut self, line: impl Fn() -> String) {
        loop {
            if self.out.is_empty() {
                if self.asked == 0 {
                    self.link.read_next();
                    return;
                }
                self.asked -= 1;
                self.out = line().into_bytes();
            }
            if !self.link.send(&mut self.out) {
                return;
            }
        }
    }

    fn is_done(&self) -> bool {
        self.has_ended && self.asked == 0 && self.out.is_empty() && self.link.is_flushed()
    }
}

/// The clients of `--truth`.
#[derive(Default)]
pub struct Clients(Vec<Client>);

impl Clients {
    pub fn connected(
        &mut self,
        client: NewClient,
        number: u64,
        events: SyncSender<Event>,
        refusals: &mut Refusals,
    ) {
        if self.0.len() >= CLIENTS {
            let why = format!("{CLIENTS} clients ask already");
            warn(&format!("{} refused: {why}", client.peer));
            refusals.refuse(client, &why);
            return;
        }
        if let Some(link) = tcp::accept(client, number, events, refusals) {
            self.0.push(Client { link, asked: 0, after_cr: false, has_ended: false, out: Vec::new() });
        }
    }

    /// Returns whether the event was one of these clients'.
    pub fn handle(&mut self, event: &Event) -> bool {
        let (Event::Bytes(number, _) | Event::InputEnded(number) | Event::Gone(number)) = event else {
            return false;
        };
        let Some(at) = self.0.iter().position(|client| client.link.number == *number) else { return false };
        match event {
            Event::Bytes(_, bytes) => {
                self.0[at].link.chunk_received();
                self.0[at].hear(bytes);
            }
            Event::InputEnded(_) => self.0[at].has_ended = true,
            _ => self.0.swap_remove(at).link.close(),
        }
        true
    }

    /// Answers, and closes the connections of clients that have everything.
    pub fn serve(&mut self, line: impl Fn() -> String) {
        for client in &mut self.0 {
            client.serve(&line);
        }
        for at in (0..self.0.len()).rev() {
            if self.0[at].is_done() {
                self.0.swap_remove(at).link.close();
            }
        }
    }
}
