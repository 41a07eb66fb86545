//! The values of ERROR: one row for each fault, with its cause and the next step. A recoverable fault keeps
//! STAT 2, idles the motor (bridge off, brake engaged) and refuses motion until SET STAT 2 clears it.

use crate::property::Property;

/// `NAME = code, property, "cause", "next step";`
macro_rules! table {
    ($($name:ident = $code:literal, $property:expr, $cause:literal, $next:literal;)*) => {
        /// A value of ERROR other than 0.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u8)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub enum FaultCode {
            $(#[doc = $cause] $name = $code,)*
        }

        /// Every fault, by ascending code.
        pub const ROWS: &[FaultSpec] = &[$(*FaultCode::$name.row(),)*];

        impl FaultCode {
            /// The row.
            #[must_use]
            pub const fn row(self) -> &'static FaultSpec {
                match self {
                    $(Self::$name => {
                        const ROW: FaultSpec = FaultSpec {
                            code: FaultCode::$name,
                            name: stringify!($name),
                            property: $property,
                            cause: $cause,
                            next: $next,
                        };
                        &ROW
                    })*
                }
            }
        }
    };
}

/// A fault's row.
#[derive(Clone, Copy, Debug)]
pub struct FaultSpec {
    /// The fault.
    pub code: FaultCode,
    /// Its name.
    pub name: &'static str,
    /// The property that controls or shows it, if any.
    pub property: Option<Property>,
    /// The cause.
    pub cause: &'static str,
    /// The user's next step.
    pub next: &'static str,
}

table! {
    Halls = 1, Some(Property::HALLS),
        "the hall lines gave impossible codes or one of them is stuck",
        "check the motor's hall cable and its supply; run HI again, the position may have slipped";
    OverCurrent = 2, Some(Property::IMOTOR),
        "phase current above what a working motor can draw, for 5 ms",
        "check the motor's winding and phase cable for a short";
    OverTemperature = 3, Some(Property::OTEMP),
        "the motor's thermistor is at OTEMP, or its wire is broken (THERM at -40 C or less)",
        "let the motor cool, or mend the wire; lower MT or TSTOP, or raise OTEMP if the motor may be hotter";
    OverVoltage = 4, Some(Property::VBUS),
        "bus above 32 V for 10 ms",
        "check the supply; a motor that is braked hard pumps the bus up";
    UnderVoltage = 5, Some(Property::VBUS),
        "bus below 16 V for 10 ms",
        "check the supply and its cable; fewer motors at once draw less";
    Bridge = 6, Some(Property::IMOTOR),
        "the gate driver or the over-current comparator switched the bridge off",
        "check the phase cable for a short; the board's bridge may be broken";
    HostLost = 7, Some(Property::HOSTMS),
        "no frame to this board or its groups for HOSTMS while in mode 2 or 4 set by a host; the next MODE or CMD clears it",
        "check the CAN cable; a host in mode 2 or 4 must send something more often than HOSTMS, or set HOSTMS to 0";
    Storage = 8, Some(Property::SAVE),
        "the flash did not take what was written, or a stored value cannot be read any more; the motor only stands still if it would make a stored position untrue",
        "compare the stored values with what you saved, and SAVE again; if it comes back, the board's flash is worn out";
    Wiring = 9, Some(Property::FIND),
        "the motor ran against its own torque: phases or hall lines are connected in another order than WIRING says",
        "correct the wiring, or let FIND learn it; a spread that was pushed more slowly than 5 counts/s gives this too";
    Jammed = 10, Some(Property::IHIT),
        "HI met no stop, or could not leave it by 12 counts and return to it within one",
        "free the joint, its brake and the way to its stop, and run HI again; if it comes back, raise IHIT; if it still does, turn the motor by hand until it is loose, or check it";
    NoApplication = 16, Some(Property::STAT),
        "there is no whole application to start",
        "download a sealed .tek file";
    BadRecord = 17, Some(Property::VERS),
        "a record of the download is not Extended Tektronix hex",
        "verify the file, and download it again";
    BadChecksum = 18, Some(Property::VERS),
        "the checksum of a record of the download is wrong",
        "download it again; if it comes back, verify the file";
    AddressRange = 19, Some(Property::VERS),
        "a record of the download lies outside the application",
        "build the image for the application's address";
    Overlap = 20, Some(Property::VERS),
        "a record of the download starts below the end of the one before it",
        "the records must rise: decode the file and encode it again";
    FlashWrite = 21, Some(Property::VERS),
        "the flash did not take what was downloaded",
        "download it again; if it comes back, the board's flash is worn out";
    BadImage = 22, Some(Property::VERS),
        "the image has no header, or its length or CRC-32 is wrong",
        "seal the image when encoding it, and download it again";
    DownloadTimeout = 23, Some(Property::VERS),
        "the host stopped sending in the middle of a download",
        "download it again; the old application is still there";
    Watchdog = 24, None,
        "the program hung, and the watchdog reset the board",
        "wake it by SET STAT 2; if it comes back, note what the hand was doing and report it";
    Panic = 25, None,
        "the program found a mistake of its own, and reset the board",
        "wake it by SET STAT 2; if it comes back, note what the hand was doing and report it";
    HardFault = 26, None,
        "the processor could not go on (HardFault), and reset the board",
        "wake it by SET STAT 2; if it comes back, download the application again, and check the supply";
    Clock = 27, None,
        "the 8 MHz crystal failed while the program ran, and the board was reset",
        "wake it by SET STAT 2; if it comes back, the crystal or its solder joints are broken";
}

impl FaultCode {
    /// The value of ERROR.
    #[must_use]
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The fault of a value of ERROR.
    #[must_use]
    pub fn of(code: i64) -> Option<Self> {
        ROWS.iter().find(|row| i64::from(row.code.code()) == code).map(|row| row.code)
    }
}

impl From<FaultCode> for i64 {
    fn from(code: FaultCode) -> Self {
        code.code().into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_codes_ascend_and_every_row_has_a_next_step() {
        for pair in ROWS.windows(2) {
            assert!(pair[0].code.code() < pair[1].code.code());
        }
        for row in ROWS {
            assert!(row.code.code() > 0 && !row.cause.is_empty() && !row.next.is_empty(), "{}", row.name);
            assert_eq!(row.code.row().name, row.name);
            assert_eq!(FaultCode::of(i64::from(row.code.code())), Some(row.code));
            assert_eq!(i64::from(row.code), i64::from(row.code.code()));
        }
        assert_eq!(FaultCode::of(0), None);
    }
}
