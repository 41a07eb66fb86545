//! The kinds of fault: a row for each, with what it does, how the hand reports it, and what clears it.

use serde::Serialize;

/// Bits of the kinds of fault.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Kinds(u64);

impl Kinds {
    /// No kind.
    pub const NONE: Self = Self(0);

    /// These kinds.
    #[must_use]
    pub const fn of(kinds: &[FaultKind]) -> Self {
        let (mut bits, mut rest) = (0, kinds);
        while let [kind, others @ ..] = rest {
            bits |= 1 << *kind as u64;
            rest = others;
        }
        Self(bits)
    }

    /// Both.
    #[must_use]
    pub const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Adds a kind.
    pub const fn insert(&mut self, kind: FaultKind) {
        self.0 |= 1 << kind as u64;
    }

    /// Whether they share a kind.
    #[must_use]
    pub const fn meets(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// The rows of these kinds.
    pub fn rows(self) -> impl Iterator<Item = &'static Row> {
        ROWS.iter().filter(move |row| self.meets(Self::of(&[row.kind])))
    }

    /// Whether there is none.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }
}

impl FromIterator<FaultKind> for Kinds {
    fn from_iter<I: IntoIterator<Item = FaultKind>>(kinds: I) -> Self {
        let mut all = Self::NONE;
        kinds.into_iter().for_each(|kind| all.insert(kind));
        all
    }
}

/// The part of the hand that a fault of a kind hits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Place {
    /// One motor and its board.
    Motor,
    /// The bus, the supply, GOD.
    Hand,
    /// The host.
    Host,
}

/// A kind of fault.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// The kind.
    pub kind: FaultKind,
    /// Its name on the command line.
    pub name: &'static str,
    /// Where it hits.
    pub place: Place,
    /// What it does.
    pub what: &'static str,
    /// What the hand reports, with the cause and the next step in the tables of ERROR and of the status codes.
    pub report: &'static str,
    /// What clears the report, once the fault has healed.
    pub clear: &'static str,
}

/// `Kind = "name", place, "what", "report", "clear";`
macro_rules! table {
    ($($kind:ident = $name:literal, $place:ident, $what:literal, $report:literal, $clear:literal;)*) => {
        /// A kind of fault.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
        #[serde(rename_all = "kebab-case")]
        pub enum FaultKind {
            $(#[doc = $what] $kind,)*
        }

        /// Every kind of fault.
        pub const ROWS: &[Row] = &[
            $(Row {
                kind: FaultKind::$kind,
                name: $name,
                place: Place::$place,
                what: $what,
                report: $report,
                clear: $clear,
            },)*
        ];
    };
}

table! {
    FrameLost = "frame-lost", Hand, "receivers lose up to a third of the frames that they acknowledged",
        "GOD asks again; ERR 1 after three questions without an answer", "the next command";
    FrameDuplicated = "frame-duplicated", Hand, "up to a half of the frames come twice (double reception)",
        "nothing: every order may come twice", "-";
    FrameCorrupted = "frame-corrupted", Hand, "up to a half of the frames are corrupted and sent again",
        "nothing while the bus carries the rest; else as frame-delayed", "-";
    FrameDelayed = "frame-delayed", Motor, "a board sends nothing for up to 0.3 s, then everything",
        "ERR 1 (no answer) from 180 ms on", "the next command";
    BusOff = "bus-off", Motor, "a board goes bus-off again and again",
        "ERR 1 if its answers are late", "its controller comes back by itself";
    Babble = "babbling-node", Hand, "a node fills the bus with frames of the highest priority",
        "ERR 1 (no answer)", "the next command";
    NoAck = "no-acknowledgement", Hand, "every cable is cut: nobody acknowledges GOD's frames",
        "ERR 1 (no answer); boards in modes 2 and 4: ERROR 7", "the next frame; the next order";
    CableCut = "cable-cut", Motor, "the cable of one board is cut",
        "ERR 1 (no answer); in modes 2 and 4 its ERROR 7", "the next command";
    HallStuck = "hall-stuck", Motor, "a hall line sticks at a level",
        "ERROR 1; a motor that cannot turn stalls: END 2", "STAT 2 and HI";
    HallOpen = "hall-open", Motor, "two hall lines are open: they read high",
        "ERROR 1", "STAT 2 and HI";
    HallGlitch = "hall-glitch", Motor, "wrong hall codes for 1 to 300 us, up to 100 a second",
        "nothing for single ones; ERROR 1 for many", "STAT 2 and HI";
    HallSwap = "hall-swapped", Motor, "the motor comes back from a repair with its hall lines in another order",
        "ERROR 9 or ERROR 1 within a third of a turn, or ERROR 10 from HI", "FIND 1 on the bus, or the right order; HI";
    AdcRail = "adc-rail", Motor, "an analog input sticks at a rail",
        "ERROR 3, 4 or 5 by thermistor or bus voltage; END 4 by strain; a current that is not measured is not reported",
        "STAT 2";
    AdcNoise = "adc-noise", Motor, "an analog input has noise of up to 10 % of its range",
        "as adc-rail, if the noise passes a limit for long enough", "STAT 2";
    AdcDrift = "adc-drift", Motor, "an analog input is off by up to 10 % of its range",
        "as adc-rail, if the offset passes a limit", "STAT 2";
    ThermistorOpen = "thermistor-open", Motor, "the thermistor's wire breaks",
        "ERROR 3", "STAT 2";
    BrakeStuckOn = "brake-stuck-on", Motor, "the brake does not release",
        "END 2 (stall); HI: ERROR 10", "STAT 2";
    BrakeStuckOff = "brake-stuck-off", Motor, "the brake does not engage",
        "nothing: no sensor sees it, and a motor that is pushed counts on", "-";
    Jam = "jam", Motor, "the joint is held by a friction beyond the motor's torque",
        "END 2 (stall); HI: ERROR 10", "STAT 2";
    Push = "push", Motor, "something pushes the joint, up to a third of the motor's torque",
        "nothing, or END 2 (stall), 4 (strain), 5 (breakaway)", "-";
    SupplySag = "supply-sag", Hand, "the source drops to 5 to 20 V, or to 1 to 10 A",
        "ERROR 5 below 16 V for 10 ms; torque is folded back before", "STAT 2";
    OverVoltage = "over-voltage", Hand, "the source rises to 30 to 36 V",
        "ERROR 4 above 32 V for 10 ms", "STAT 2";
    PowerCut = "power-cut", Motor, "a board loses its power for up to 1.5 s",
        "ERR 1 (no answer); then STAT 0 (asleep), HALLH bit 30 clear unless its position was saved at rest", "WAKE and HI";
    HandPowerCut = "hand-power-cut", Hand, "the whole hand loses its power for up to 1 s",
        "GOD's banner; boards asleep as after power-cut", "HI";
    FlashCut = "flash-cut", Motor, "a board's power fails in the middle of a flash operation",
        "as power-cut; ERROR 8 if a record was cut: what was not acknowledged keeps its last value", "WAKE, STAT 2, SAVE and HI";
    BitFlip = "flash-bit-flip", Motor, "bits of a board's stored values flip while it has no power",
        "ERROR 8: what the record held reads as stored before, or as the default", "STAT 2, and SAVE; FIND if WIRING was lost";
    WornPage = "worn-page", Motor, "some pages of the storage fail every operation",
        "ERROR 8 if no other page takes the record", "STAT 2, and SAVE";
    MarginalErase = "marginal-erase", Motor, "an erase is interrupted, and bits of its page read either way",
        "as power-cut", "WAKE and HI";
    ClockDrift = "clock-drift", Motor, "a board's clock is off by up to 2 %",
        "nothing: times and velocities are off by as much", "-";
    BoardReset = "board-reset", Motor, "a board is reset and joins again",
        "as power-cut; the winding's heat is kept", "WAKE and HI";
    BoardHang = "board-hang", Motor, "a board's program hangs, with its bridge as it is, until a watchdog bites",
        "as board-reset", "WAKE and HI";
    BridgeTrip = "bridge-trip", Motor, "the over-current comparator trips",
        "ERROR 6 within a tick", "STAT 2";
    HostSilent = "host-silent", Host, "the host neither reads nor sends for up to 1.5 s",
        "GOD waits; it stops the motors of LOOP itself", "-";
    PartialLine = "partial-line", Host, "the host sends half a line, and the rest up to 1.5 s later",
        "nothing: GOD waits for the end of the line", "-";
    HangUp = "hang-up", Host, "the host disconnects in the middle of anything",
        "GOD stops what the host began", "-";
    SecondHost = "second-host", Host, "another host writes properties and orders motions on the bus",
        "ends of motions as the boards report them", "-";
    GodHot = "god-hot", Hand, "GOD's temperature sensor reads 20 to 120 C",
        "ERR 8192 above the hand's OTEMP; TEMP and PTEMP", "-";
    SameNumber = "same-number", Motor, "a second board with the number of this one is on the bus, and obeys its orders",
        "ERR 1 from G STAT, WAKE, HI, and from motions once its answers differ; `ERR 1` names both", "unplugging it";
    Finger = "finger", Motor, "a person's finger, or something softer, is in the way of the joint",
        "END 2 (stall); HI may take it for the stop", "HI";
}

/// The kinds from which each seed draws its own. Later ones are drawn apart ([`super::case`]), so that the seeds before them stay what they were.
pub(crate) const DRAWN: &[Row] = ROWS.split_at(FaultKind::SameNumber as usize).0;

impl FaultKind {
    /// The row.
    #[must_use]
    pub const fn row(self) -> &'static Row {
        // The enumeration is in the order of the rows.
        &ROWS[self as usize]
    }
}
