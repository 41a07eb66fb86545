//! Numbers of properties and modes, and the list of their values (the manual's propertyList).

use std::ffi::c_long;
use std::sync::atomic::Ordering;

use tater_wire::Property;
use wraptor::Node;

/// A property of a motor board, by its name in docs/properties.md, with its unit.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum wraptor_property {
    /// firmware version; in the monitor the monitor's; there SET 170 starts a download
    WRAPTOR_PROPERTY_VERS = 0,
    /// 3 (this hand's motor board) | 0x0800 (has a strain gauge); unit: bits
    WRAPTOR_PROPERTY_ROLE = 1,
    /// serial number
    WRAPTOR_PROPERTY_SN = 2,
    /// the board's node on the bus; the straps' until set; a new one is heard from the next start on
    WRAPTOR_PROPERTY_ID = 3,
    /// latched fault, see the fault table; 0 none; SET STAT 2 clears it; unit: code
    WRAPTOR_PROPERTY_ERROR = 4,
    /// 0 in the monitor, waiting for firmware; 1 must not be used; 2 ready. SET 0 resets into the monitor, SET 2 wakes, or clears ERROR
    WRAPTOR_PROPERTY_STAT = 5,
    /// control mode, see the mode table; 1 is refused; a move that 5 orders ends in 3
    WRAPTOR_PROPERTY_MODE = 8,
    /// temperature of the board; unit: 0.1 C
    WRAPTOR_PROPERTY_TEMP = 9,
    /// highest TEMP ever; kept through power loss; unit: 0.1 C
    WRAPTOR_PROPERTY_PTEMP = 10,
    /// the motor's temperature limit: torque derates over the 8 C below it and is cut at it; -551 disables it and the check for a broken thermistor wire (decision 0014); -550 to 199 is refused; unit: 0.1 C
    WRAPTOR_PROPERTY_OTEMP = 11,
    /// 18384, 23, 3145, 1024, 1 in this order unlock the next SET of a locked property, once
    WRAPTOR_PROPERTY_LOCK = 13,
    /// brake output: 1 energized, the spread is free
    WRAPTOR_PROPERTY_B = 16,
    /// raw analog input 0: strain gauge; unit: ADC
    WRAPTOR_PROPERTY_ANA0 = 18,
    /// raw analog input 1: motor thermistor; unit: ADC
    WRAPTOR_PROPERTY_ANA1 = 19,
    /// motor temperature; unit: 0.1 C
    WRAPTOR_PROPERTY_THERM = 20,
    /// bus voltage; unit: 0.1 V
    WRAPTOR_PROPERTY_VBUS = 21,
    /// bus current; phase current is this over the duty; unit: mA
    WRAPTOR_PROPERTY_IMOTOR = 22,
    /// strain gauge
    WRAPTOR_PROPERTY_SG = 25,
    /// first group listened to; group 0 is always heard
    WRAPTOR_PROPERTY_GRPA = 26,
    /// second group listened to: 1 for nodes 1 to 4, 2 for 5 to 7, 7 for 11 to 17 as in Barrett's hands
    WRAPTOR_PROPERTY_GRPB = 27,
    /// third group listened to: 4, or 5 for nodes 11 to 17
    WRAPTOR_PROPERTY_GRPC = 28,
    /// does what the command table says
    WRAPTOR_PROPERTY_CMD = 29,
    /// stores the present value of the property of this number; -1: of all; unit: id
    WRAPTOR_PROPERTY_SAVE = 30,
    /// takes the stored value, or the default, of the property of this number; -1: of all; unit: id
    WRAPTOR_PROPERTY_LOAD = 31,
    /// resets the property of this number, and its stored value, to its default; -1: all; unit: id
    WRAPTOR_PROPERTY_DEF = 32,
    /// SET: learns how the motor is wired, see the table of FIND; GET: what is known, or why it was refused
    WRAPTOR_PROPERTY_FIND = 33,
    /// the host's to use; means nothing to the board
    WRAPTOR_PROPERTY_X0 = 34,
    /// the host's to use; means nothing to the board
    WRAPTOR_PROPERTY_X1 = 35,
    /// the host's to use; means nothing to the board
    WRAPTOR_PROPERTY_X2 = 36,
    /// the host's to use; means nothing to the board
    WRAPTOR_PROPERTY_X3 = 37,
    /// the host's to use; means nothing to the board
    WRAPTOR_PROPERTY_X4 = 38,
    /// the host's to use; means nothing to the board
    WRAPTOR_PROPERTY_X5 = 39,
    /// the host's to use; means nothing to the board
    WRAPTOR_PROPERTY_X6 = 40,
    /// the host's to use; means nothing to the board
    WRAPTOR_PROPERTY_X7 = 41,
    /// SET: torque of mode 2; GET: in mode 2 the torque commanded, after every limit, else the torque applied. Packed torques saturate at MT; unit: 1/1024 peak
    WRAPTOR_PROPERTY_T = 42,
    /// torque limit; unit: 1/1024 peak
    WRAPTOR_PROPERTY_MT = 43,
    /// SET: velocity of mode 4, until a motion ends (VSET shows it); GET: in mode 4 the velocity commanded, else the measured one; unit: counts/s
    WRAPTOR_PROPERTY_V = 44,
    /// cruise velocity of trapezoidal moves, together with MCV and MOV; unit: counts/s
    WRAPTOR_PROPERTY_MV = 45,
    /// cruise velocity when closing; unit: counts/s
    WRAPTOR_PROPERTY_MCV = 46,
    /// cruise velocity when opening; unit: counts/s
    WRAPTOR_PROPERTY_MOV = 47,
    /// position; set in idle it says what the present position is called, in mode 3 where to go; within the goals of KIND; GET is answered by the 22-bit position frame; unit: counts
    WRAPTOR_PROPERTY_P = 48,
    /// motor: resistance line to line at 25 C; MKT, MJ and ML stay; unit: mOhm
    WRAPTOR_PROPERTY_MR = 49,
    /// default position: where CMD M goes; ends at the goals of KIND; unit: counts
    WRAPTOR_PROPERTY_DP = 50,
    /// motor: peak current of a phase, which gives T 1024; MKT, MJ and ML stay; unit: mA
    WRAPTOR_PROPERTY_MPK = 51,
    /// where a trapezoidal move ends; during a move it re-plans; beyond the goals of KIND it is refused; unit: counts
    WRAPTOR_PROPERTY_E = 52,
    /// motor: torque constant, which is the EMF in uV.s/rad; a view of MKE, which stores it; unit: uN.m/A
    WRAPTOR_PROPERTY_MKT = 53,
    /// open target: where CMD O goes; ends at the goals of KIND; unit: counts
    WRAPTOR_PROPERTY_OT = 54,
    /// motor: inertia with its load, at the motor; a view of MKA, which stores it; unit: 1e-11 kg.m2
    WRAPTOR_PROPERTY_MJ = 55,
    /// close target: where CMD C goes; ends at the goals of KIND; unit: counts
    WRAPTOR_PROPERTY_CT = 56,
    /// motor: inductance line to line; a view of MTE, which stores it; unit: 0.1 uH
    WRAPTOR_PROPERTY_ML = 57,
    /// E and a move to it in one, HOLD says how it ends; beyond the goals of KIND it is refused; unit: counts
    WRAPTOR_PROPERTY_M = 58,
    /// nominal voltage of the supply; unit: 0.1 V
    WRAPTOR_PROPERTY_MVN = 59,
    /// default step of CMD IC and IO, which end at the goals of KIND; unit: counts
    WRAPTOR_PROPERTY_DS = 60,
    /// time with power on, ever; unit: s
    WRAPTOR_PROPERTY_UPSECS = 63,
    /// odometer: way of the motor in both directions, ever; CTS counts a revolution; unit: revolutions
    WRAPTOR_PROPERTY_OD = 64,
    /// position within one motor revolution; unit: counts
    WRAPTOR_PROPERTY_MECH = 66,
    /// motor: highest temperature of the winding; unit: 0.1 C
    WRAPTOR_PROPERTY_MWX = 67,
    /// counts a motor revolution: three times POLES; unit: counts
    WRAPTOR_PROPERTY_CTS = 68,
    /// motor: heat capacity of the winding; unit: 0.01 J/K
    WRAPTOR_PROPERTY_MWJ = 69,
    /// the board's slot in packed-torque frames
    WRAPTOR_PROPERTY_PIDX = 70,
    /// strain above which a move ends; 0, 255 and 256 disable
    WRAPTOR_PROPERTY_HSG = 71,
    /// strain below which a move ends; 0, 255 and 256 disable
    WRAPTOR_PROPERTY_LSG = 72,
    /// velocity towards the stop in HI (tips home on their closed stop); unit: counts/s
    WRAPTOR_PROPERTY_IVEL = 73,
    /// way from the stop to zero in HI; at most the joint's width and 8 in either direction; unit: counts
    WRAPTOR_PROPERTY_IOFF = 74,
    /// motor: thermal resistance from winding to housing; unit: 0.01 K/W
    WRAPTOR_PROPERTY_MWR = 75,
    /// arrival window; unit: counts
    WRAPTOR_PROPERTY_MPE = 76,
    /// after a motion: 1 holds the position, 0 idles; a move that MODE 5 orders holds with either, but not with HOSTUNITS 280
    WRAPTOR_PROPERTY_HOLD = 77,
    /// no count for this long while driven is a stall; 0 never; unit: ms
    WRAPTOR_PROPERTY_TSTOP = 78,
    /// position gain; unit: 1/1024 peak per count
    WRAPTOR_PROPERTY_KP = 79,
    /// derivative gain, beyond the EMF's own damping; unit: 1/256 of 1/1024 peak per count/s
    WRAPTOR_PROPERTY_KD = 80,
    /// integral gain; loads are carried without it; unit: 1/1024 peak per count s
    WRAPTOR_PROPERTY_KI = 81,
    /// acceleration is (ACCEL/1024)^2 counts/ms^2; useful up to about 60; 0 cannot move; unit: sqrt(counts)/ms/1024
    WRAPTOR_PROPERTY_ACCEL = 82,
    /// joint index
    WRAPTOR_PROPERTY_JIDX = 85,
    /// torque units per newton meter at the motor; unit: 1/N.m
    WRAPTOR_PROPERTY_IPNM = 86,
    /// present hall code; unit: bits
    WRAPTOR_PROPERTY_HALLS = 87,
    /// the last ten hall codes, the newest in the low three bits; bit 30: the position is known (HI, or stored and not moved since); unit: bits
    WRAPTOR_PROPERTY_HALLH = 88,
    /// bandwidth of the position loop, from which the gains are computed for the motor as it is described; 0: KP, KD and KPV hold. 166 is theirs; unit: 0.1 Hz
    WRAPTOR_PROPERTY_KBW = 89,
    /// motor: poles of the rotor, an even number; MKT, MJ and ML stay
    WRAPTOR_PROPERTY_POLES = 90,
    /// whether the hand's commands without a motor prefix act on this motor; GOD's to obey
    WRAPTOR_PROPERTY_EN = 94,
    /// whether the board can drive the motor as it is described: 0 it can; else why not, see the table of FIT, and nothing moves; unit: code
    WRAPTOR_PROPERTY_FIT = 95,
    /// joint: lowest whole count; goals go 8 beyond; unit: counts
    WRAPTOR_PROPERTY_JLO = 97,
    /// joint: highest whole count; goals go 8 beyond; unit: counts
    WRAPTOR_PROPERTY_JHI = 99,
    /// RealTime velocity bytes are multiplied by this; GOD's to obey
    WRAPTOR_PROPERTY_LCVC = 105,
    /// torque limit in HI; unit: 1/1024 peak
    WRAPTOR_PROPERTY_IHIT = 108,
    /// velocity gain of mode 4 (RealTime's proportional gain); unit: 1/16 of 1/1024 peak per count/s
    WRAPTOR_PROPERTY_KPV = 109,
    /// a breakaway stops the finger's tip too; GOD's to obey
    WRAPTOR_PROPERTY_BS = 110,
    /// a breakaway has been detected; CMD O clears it
    WRAPTOR_PROPERTY_BD = 111,
    /// position of the last breakaway; unit: counts
    WRAPTOR_PROPERTY_BP = 112,
    /// load torque at which a link breaks away; 0 never; unit: 1/1024 peak
    WRAPTOR_PROPERTY_BT = 114,
    /// why the last motion ended, see the end table; 0 it has not
    WRAPTOR_PROPERTY_END = 115,
    /// bit 0: report ends of moves unasked (MODE, then END); bit 1: report breakaways (BD); unit: bits
    WRAPTOR_PROPERTY_LFLAGS = 116,
    /// the measured velocity in any mode: what RealTime feeds back, whose V is the command; unit: counts/s
    WRAPTOR_PROPERTY_VEL = 117,
    /// 0 unknown: the motor does not move; else 1 + 2 x the wiring's number, plus 1 if the direction of closing is known. 2 as shipped; FIND stores it
    WRAPTOR_PROPERTY_WIRING = 118,
    /// in mode 2 or 4 set by a host, no frame to this board or its groups for this long ends the motion with ERROR 7; 0 never; unit: ms
    WRAPTOR_PROPERTY_HOSTMS = 119,
    /// kind of motor: 1 link, 2 spread, 3 tip; goals are -33 to 346, -8 to 174, -166 to 358; by the straps, or without straps by the node, until set; a new one counts from the next start on
    WRAPTOR_PROPERTY_KIND = 120,
    /// V as set: mode 4 runs at it, or will when it starts; 0 once any motion has ended; unit: counts/s
    WRAPTOR_PROPERTY_VSET = 121,
    /// motor model: acceleration of motor and joint by torque; unit: 1/16 count/s2 per 1/1024 peak
    WRAPTOR_PROPERTY_MKA = 122,
    /// motor model: EMF; 1024 torque units are the voltage MR MPK, 24 V; unit: 1/4096 of 1/1024 peak per count/s
    WRAPTOR_PROPERTY_MKE = 123,
    /// motor model: friction in motion; unit: 1/1024 peak
    WRAPTOR_PROPERTY_MFC = 124,
    /// motor model: friction at rest; at least MFC counts; unit: 1/1024 peak
    WRAPTOR_PROPERTY_MFS = 125,
    /// motor model: electrical time constant; unit: us
    WRAPTOR_PROPERTY_MTE = 126,
    /// units of values on the bus: 0 those of this table; 280 those of a BH8-280, for its hosts (decision 0070); nothing between
    WRAPTOR_PROPERTY_HOSTUNITS = 127,
}

/// A value of WRAPTOR_PROPERTY_MODE.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum wraptor_mode {
    /// Bridge off, brake engaged.
    WRAPTOR_MODE_IDLE = 0,
    /// Drives with torque T.
    WRAPTOR_MODE_TORQUE = 2,
    /// Holds or follows position P.
    WRAPTOR_MODE_PID = 3,
    /// Follows velocity V.
    WRAPTOR_MODE_VELOCITY = 4,
    /// Moves to E with a trapezoidal velocity profile.
    WRAPTOR_MODE_TRAPEZOIDAL = 5,
}

/// Rows of the list: nodes 0 to 7.
pub const WRAPTOR_NODES: usize = 8;

/// Columns of the list: properties.
pub const WRAPTOR_PROPERTIES: usize = 128;

#[cfg(windows)]
type Value = std::sync::atomic::AtomicI32;
#[cfg(not(windows))]
type Value = std::sync::atomic::AtomicIsize;

const _: () = assert!(size_of::<Value>() == size_of::<c_long>(), "C reads the list as long");

static LIST: [[Value; WRAPTOR_PROPERTIES]; WRAPTOR_NODES] =
    [const { [const { Value::new(0) }; WRAPTOR_PROPERTIES] }; WRAPTOR_NODES];

/// The list of the last known values of all boards, `list[node][property]` with nodes 1 to 7 (the manual's propertyList). Every function that reads
/// a property stores it here, and so does a report that the hand prints unasked. One list for all connections; other threads may change it at
/// any time, one value at once.
// SAFETY: no other symbol has this name.
#[unsafe(no_mangle)]
pub extern "C" fn wraptor_property_list() -> *const [c_long; WRAPTOR_PROPERTIES] {
    LIST.as_ptr().cast()
}

pub(crate) fn clear() {
    LIST.iter().flatten().for_each(|value| value.store(0, Ordering::Relaxed));
}

fn store(node: Node, property: Property, value: i64) {
    let row = LIST.get(usize::from(node.number()));
    if let Some(place) = row.and_then(|row| row.get(usize::from(property.id()))) {
        // Windows' long has 32 bits: counters wrap there.
        place.store(value as _, Ordering::Relaxed);
    }
}

pub(crate) fn record(property: Property, values: &[(Node, i64)]) {
    values.iter().for_each(|(node, value)| store(*node, property, *value));
}

/// Records lines such as `4 MODE=3`, and nothing of other lines.
pub(crate) fn record_lines(lines: &[String]) {
    for line in lines {
        let entry = line.split_once(' ').and_then(|(node, rest)| {
            let (name, value) = rest.split_once('=')?;
            Some((Node::new(node.parse().ok()?)?, Property::named(name)?, value.parse().ok()?))
        });
        if let Some((node, property, value)) = entry {
            store(node, property, value);
        }
    }
}
