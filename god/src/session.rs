//! State that outlives a command: activities, the boards' own values of overridden properties, results, positions that the host knows.

use core::cell::Cell;

use tater_wire::Property;

use crate::boards::Answers;
use crate::motors::{COUNT, Motor, Motors};
use crate::status::Status;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Activity {
    /// GOD has nothing to stop or to report.
    #[default]
    Idle,
    /// A command moves it; ^C stops it.
    Moving {
        /// HOLD: when stopped it holds its position, else its power goes off.
        holds: bool,
    },
    /// TC or TO has left it pressing in mode 4, because of HOLD: its board needs a keep-alive.
    Pressing,
    /// A line of the walk-through's grammar moves it: its end is reported to the host.
    Watched,
    /// A packet of the host moves it; ^C stops it.
    Steered,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Stopping {
    pub motors: Motors,
    /// Those of `motors` that hold their position.
    pub holding: Motors,
}

/// Properties that a motion may override for its own time: velocities and BT; RealTime overrides KPV.
pub(crate) const OVERRIDABLE: [Property; 5] =
    [Property::MV, Property::MCV, Property::MOV, Property::BT, Property::KPV];

/// The state.
#[derive(Debug, Default)]
pub struct Session {
    activities: Cell<[Activity; COUNT]>,
    /// The boards' own values of [`OVERRIDABLE`] where a motion has overridden them.
    overridden: [Cell<Answers>; OVERRIDABLE.len()],
    /// Result of each motor's last motion (parameter S).
    results: Cell<[Status; COUNT]>,
    /// The position of each motor that the host knows, GCL counts: FGET P or RealTime stated it (manual 6.2.3).
    reported: Cell<[i32; COUNT]>,
    recording: Cell<Option<u8>>,
    /// REPLY of the walk-through's grammar: answers are packets.
    packets: Cell<bool>,
    /// The host has sent packets: what boards send to it is passed on.
    passes: Cell<bool>,
    /// Answers to the host's packets that are missing, and until when to wait for them, µs.
    awaited: Cell<(u8, u64)>,
}

impl Session {
    pub(crate) fn begin_motion(&self, motors: Motors, holding: Motors) {
        self.change(motors, |motor, _| Activity::Moving { holds: holding.has(motor) });
    }

    pub(crate) fn end_motion(&self, motors: Motors) {
        self.change(motors, |_, activity| match activity {
            Activity::Moving { .. } => Activity::Idle,
            other => other,
        });
    }

    /// The motors that a command moves.
    pub(crate) fn moving(&self) -> Stopping {
        let motors = self.filter(|activity| matches!(activity, Activity::Moving { .. }));
        let holding = self.filter(|activity| activity == Activity::Moving { holds: true });
        Stopping { motors, holding }
    }

    pub(crate) fn press(&self, motors: Motors) {
        self.change(motors, |_, _| Activity::Pressing);
    }

    pub(crate) fn cease_pressing(&self, motors: Motors) {
        self.change(motors, |_, activity| match activity {
            Activity::Pressing => Activity::Idle,
            other => other,
        });
    }

    pub(crate) fn pressing(&self) -> Motors {
        self.filter(|activity| activity == Activity::Pressing)
    }

    pub(crate) fn watch(&self, motors: Motors) {
        self.change(motors, |_, _| Activity::Watched);
    }

    pub(crate) fn unwatch(&self, motors: Motors) {
        self.change(motors, |_, activity| match activity {
            Activity::Watched => Activity::Idle,
            other => other,
        });
    }

    pub(crate) fn steer(&self, motors: Motors) {
        self.change(motors, |_, _| Activity::Steered);
    }

    pub(crate) fn steered(&self) -> Motors {
        self.filter(|activity| activity == Activity::Steered)
    }

    /// The motors that the host moves itself, by lines of the walk-through's grammar or by packets; none is from now on.
    pub(crate) fn take_host_moved(&self) -> Motors {
        let is = |activity| matches!(activity, Activity::Watched | Activity::Steered);
        let motors = self.filter(is);
        self.change(motors, |_, _| Activity::Idle);
        motors
    }

    pub(crate) fn watched(&self) -> Motors {
        self.filter(|activity| activity == Activity::Watched)
    }

    fn filter(&self, is: impl Fn(Activity) -> bool) -> Motors {
        let activities = self.activities.get();
        Motors::ALL.iter().filter(|motor| activities.get(motor.index()).copied().is_some_and(&is)).collect()
    }

    fn change(&self, motors: Motors, to: impl Fn(Motor, Activity) -> Activity) {
        let mut activities = self.activities.get();
        for motor in motors.iter() {
            if let Some(activity) = activities.get_mut(motor.index()) {
                *activity = to(motor, *activity);
            }
        }
        self.activities.set(activities);
    }
}

impl Session {
    pub(crate) fn overridden(&self, property: Property) -> &Cell<Answers> {
        let [first, ..] = &self.overridden;
        let place = OVERRIDABLE.iter().position(|&overridable| overridable == property);
        place.and_then(|place| self.overridden.get(place)).unwrap_or(first)
    }

    pub(crate) fn set_result(&self, motor: Motor, status: Status) {
        set(&self.results, motor, status);
    }

    pub(crate) fn result(&self, motor: Motor) -> Status {
        get(&self.results, motor)
    }

    pub(crate) fn set_reported(&self, motor: Motor, position: i32) {
        set(&self.reported, motor, position);
    }

    pub(crate) fn reported(&self, motor: Motor) -> i32 {
        get(&self.reported, motor)
    }

    pub(crate) fn set_recording(&self, sequence: Option<u8>) {
        self.recording.set(sequence);
    }

    pub(crate) const fn recording(&self) -> Option<u8> {
        self.recording.get()
    }

    pub(crate) fn set_packets(&self, packets: bool) {
        self.packets.set(packets);
    }

    pub(crate) const fn packets(&self) -> bool {
        self.packets.get()
    }

    /// The host has sent a packet that so many boards answer until a time.
    pub(crate) fn passes_packet(&self, answers: u8, until_us: u64) {
        self.passes.set(true);
        if answers > 0 {
            let (missing, _) = self.awaited.get();
            self.awaited.set((missing.saturating_add(answers), until_us));
        }
    }

    pub(crate) const fn passes(&self) -> bool {
        self.passes.get()
    }

    pub(crate) const fn awaited(&self) -> (u8, u64) {
        self.awaited.get()
    }

    /// The missing answers do not come.
    pub(crate) fn give_up_answers(&self) {
        self.awaited.set((0, 0));
    }

    pub(crate) fn answered(&self) {
        let (missing, until) = self.awaited.get();
        self.awaited.set((missing.saturating_sub(1), until));
    }

    /// The host has disconnected: the next one begins with text, and finds no recording.
    pub(crate) fn forget_host(&self) {
        self.recording.set(None);
        self.packets.set(false);
        self.passes.set(false);
        self.give_up_answers();
    }
}

fn set<T: Copy>(all: &Cell<[T; COUNT]>, motor: Motor, value: T) {
    let mut values = all.get();
    if let Some(place) = values.get_mut(motor.index()) {
        *place = value;
    }
    all.set(values);
}

fn get<T: Copy + Default>(all: &Cell<[T; COUNT]>, motor: Motor) -> T {
    all.get().get(motor.index()).copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    type Call = fn(&Session);

    const LINK: Motors = Motors::LINKS;
    const TIP: Motors = Motors::TIPS;
    const NONE: Motors = Motors::NONE;

    /// Moving, of these holding, pressing, watched, steered.
    fn all(session: &Session) -> [Motors; 5] {
        let Stopping { motors, holding } = session.moving();
        [motors, holding, session.pressing(), session.watched(), session.steered()]
    }

    #[test]
    fn each_activity_ends_by_its_own_call_alone() {
        let begun: [(Call, [Motors; 5]); 5] = [
            (|of| of.begin_motion(LINK, NONE), [LINK, NONE, NONE, NONE, NONE]),
            (|of| of.begin_motion(LINK, Motors::ALL), [LINK, LINK, NONE, NONE, NONE]),
            (|of| of.press(LINK), [NONE, NONE, LINK, NONE, NONE]),
            (|of| of.watch(LINK), [NONE, NONE, NONE, LINK, NONE]),
            (|of| of.steer(LINK), [NONE, NONE, NONE, NONE, LINK]),
        ];
        let ended: [(Call, &[usize]); 4] = [
            (|of| of.end_motion(Motors::ALL), &[0, 1]),
            (|of| of.cease_pressing(Motors::ALL), &[2]),
            (|of| of.unwatch(Motors::ALL), &[3]),
            (|of| _ = of.take_host_moved(), &[3, 4]),
        ];
        for (at, (begin, expected)) in begun.iter().enumerate() {
            for (end, ends) in &ended {
                let session = Session::default();
                begin(&session);
                assert_eq!(all(&session), *expected);
                end(&session);
                let left = if ends.contains(&at) { [NONE; 5] } else { *expected };
                assert_eq!(all(&session), left, "{at}");
            }
        }
        let session = Session::default();
        session.begin_motion(Motors::ALL, LINK);
        session.watch(Motors::SPREAD);
        session.steer(Motors::only(Motor::SPREAD).union(TIP));
        session.watch(Motors::SPREAD);
        assert_eq!(all(&session), [LINK, LINK, NONE, Motors::SPREAD, TIP]);
        assert_eq!(session.take_host_moved(), Motors::SPREAD.union(TIP));
    }

    #[test]
    fn values_belong_to_one_motor_or_property() {
        let session = Session::default();
        let [first, last] = [1, 7].map(|number| Motor::new(number).expect("a motor"));
        session.set_result(last, Status::FAULT);
        session.set_reported(first, -5);
        assert_eq!([first, last].map(|motor| session.result(motor)), [Status::OK, Status::FAULT]);
        assert_eq!([first, last].map(|motor| session.reported(motor)), [-5, 0]);
        for (value, property) in (1..).zip(OVERRIDABLE) {
            session.overridden(property).set(Answers::uniform(Motors::ALL, value));
        }
        for (value, property) in (1..).zip(OVERRIDABLE) {
            assert_eq!(session.overridden(property).get().get(last), Some(value), "{property:?}");
        }
    }

    #[test]
    fn host_that_disconnects_is_forgotten() {
        let session = Session::default();
        assert!(!session.packets() && !session.passes());
        session.passes_packet(0, 5);
        assert_eq!((session.passes(), session.awaited()), (true, (0, 0)));
        session.passes_packet(2, 7);
        session.passes_packet(1, 9);
        session.passes_packet(0, 11);
        assert_eq!(session.awaited(), (3, 9));
        session.answered();
        assert_eq!(session.awaited(), (2, 9));
        session.set_packets(true);
        session.set_recording(Some(3));
        assert_eq!((session.packets(), session.recording()), (true, Some(3)));
        session.forget_host();
        assert_eq!((session.packets(), session.passes(), session.recording()), (false, false, None));
        assert_eq!(session.awaited(), (0, 0));
        session.answered();
        assert_eq!(session.awaited(), (0, 0), "an answer that nobody awaits");
    }
}
