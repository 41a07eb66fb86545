//! The values of FIND: one row each.

/// `NAME = value, "meaning";`
macro_rules! table {
    ($(#[$doc:meta])* $type:ident, $rows:ident: $($name:ident = $value:literal, $meaning:literal;)*) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u8)]
        pub enum $type {
            $(#[doc = $meaning] $name = $value,)*
        }

        /// Every value with its name and meaning, ascending.
        pub const $rows: &[(u8, &str, &str)] = &[$(($value, stringify!($name), $meaning),)*];

        impl $type {
            /// The meaning of a value; `None` if it has none.
            #[must_use]
            pub const fn of(value: i64) -> Option<Self> {
                match value {
                    $($value => Some(Self::$name),)*
                    _ => None,
                }
            }
        }

        impl From<$type> for i64 {
            fn from(value: $type) -> Self {
                Self::from(value as u8)
            }
        }
    };
}

table! {
    /// SET FIND.
    Order, ORDERS:
    Learn = 1, "learns the wiring: turns the motor by at most 6 counts around its place; the direction of closing is unknown afterwards";
    Test = 2, "test move: 6 counts in the positive direction";
    Closed = 3, "the positive direction closed the joint: keeps and stores the wiring, direction known";
    Opened = 4, "the positive direction opened the joint: stores the mirror image, direction known";
    TestBack = 5, "test move in the negative direction, for a joint at its stop";
}

table! {
    /// GET FIND.
    FindState, STATES:
    Unknown = 0, "nothing is known: SET 1";
    Learning = 1, "learning";
    Learned = 2, "the wiring is learned, the direction of closing is not known: SET 2, and look";
    Tested = 3, "the test move was made: SET 3 or 4";
    Known = 4, "wiring and direction are known";
    Blocked = 8, "refused: the rotor does not turn, though its phases take current (brake, obstacle on both sides)";
    Silent = 9, "refused: the hall lines are all high or all low (cable, sensor supply)";
    Unclear = 10, "refused: the hall codes contradict each other (noise, or something turned the joint): SET 1 again";
    AllOpen = 11, "refused: no more than one phase takes current (phase cable)";
    OpenA = 12, "refused: phase A takes no current";
    OpenB = 13, "refused: phase B takes no current";
    OpenC = 14, "refused: phase C takes no current";
    Low0 = 16, "refused: hall line 0 stays low";
    Low1 = 17, "refused: hall line 1 stays low";
    Low2 = 18, "refused: hall line 2 stays low";
    High0 = 20, "refused: hall line 0 stays high";
    High1 = 21, "refused: hall line 1 stays high";
    High2 = 22, "refused: hall line 2 stays high";
    Shorted12 = 24, "refused: hall lines 1 and 2 are shorted together";
    Shorted02 = 25, "refused: hall lines 0 and 2 are shorted together";
    Shorted01 = 26, "refused: hall lines 0 and 1 are shorted together";
}
