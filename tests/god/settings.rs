//! Parameters of motors and of the hand (manual 5.2.2, 5.2.3; 5.3, 5.4).

use boot::Chip;
use god::Memory;
use god::memory::Stored;

use super::{Exchange, Session, assert_answers};

pub const COMMANDS: &[Exchange] = &[
    ("FGET DS", "1400 1400 1400 800"),
    ("SFSET DS 100", ""),
    ("FGET DS", "1400 1400 1400 100"),
    ("SFSAVE", ""),
    ("SFSET DS 200", ""),
    ("SFLOAD", ""),
    ("SFGET DS", "100"),
    ("SFDEF", ""),
    ("SFGET DS", "800"),
    ("SFLOAD", ""),
    ("SFGET DS", "100"),
    ("PSET OTEMP 60 LFT 1", ""),
    ("PGET OTEMP LFT", "60 1"),
    ("PSAVE", ""),
    ("PDEF", ""),
    ("PGET OTEMP LFT", "-551 0"),
    ("PLOAD", ""),
    ("PGET OTEMP LFT", "60 1"),
    // The lists are in golden/*.txt, whole.
    ("FLIST 1", "ERR 1024"),
    ("FLISTV 1", "ERR 1024"),
    ("FLISTA 1", "ERR 1024"),
    ("FLISTAV 1", "ERR 1024"),
    ("PLIST 1", "ERR 1024"),
    ("PLISTV 1", "ERR 1024"),
    ("PLISTA 1", "ERR 1024"),
    ("PLISTAV 1", "ERR 1024"),
    ("FSAVE 1", "ERR 1024"),
    ("PDEF LFT", "ERR 1024"),
    ("1FLIST", "ERR 4096"),
    ("1PGET LFT", "ERR 4096"),
    ("FSET", "ERR 64"),
    ("FGET", "ERR 64"),
    ("PSET", "ERR 64"),
    ("PGET", "ERR 64"),
    ("FSET FROB 1", "ERR 64"),
    ("FGET DS FROB", "ERR 64"),
    ("PGET LFT DS", "ERR 64"),
    ("FSET DS", "ERR 128"),
    ("PSET LFT", "ERR 128"),
    ("FSET DS x", "ERR 128"),
    ("FSET DS 1.5", "ERR 128"),
    ("FSET DS 99999999999999999999", "ERR 128"),
    ("FSET DS 100 200", "ERR 1024"),
    ("FSET DS 100 DP 1 CT", "ERR 1024"),
    ("PSET LFT 1 0", "ERR 1024"),
    ("FSET P 1", "ERR 256"),
    ("PSET SN 0", "ERR 128"),
    ("PSET BAUD 95", "ERR 128"),
    ("XFSET DS 1", "ERR 2"),
    // One invalid pair: none is set.
    ("1FSET DP 1 FROB 2", "ERR 64"),
    ("1FSET DP 1 CT 40000", "ERR 128"),
    ("PSET LFDPD 1 BAUD 97", "ERR 128"),
    ("1FGET DP CT", "8500 18200"),
    ("PGET LFDPD BAUD", "0 96"),
    ("  12 fset  dp 7   dp  8 ", ""),
    ("12fget  dp   ct", "8 8 18200 18200"),
];

#[test]
fn parameter_commands_have_their_answers() {
    assert_answers(&mut Session::new(), COMMANDS);
}

/// Manual 5.3: defaults of link, spread and tip, minimum and maximum. The coefficients' minimum is 1 (decision 0001).
pub const SET: &[(&str, [i64; 3], i64, i64)] = &[
    ("BS", [0, 0, 0], 0, 1),
    ("DP", [8500, 1575, 8500], -32_767, 32_767),
    ("DS", [1400, 800, 1400], -32_767, 32_767),
    ("HSG", [256, 256, 256], 0, 256),
    ("LSG", [256, 256, 256], 0, 256),
    ("MOV", [1000, 1000, 1000], 16, 4080),
    ("MCV", [1000, 1000, 1000], 16, 4080),
    ("MSG", [256, 256, 256], 0, 256),
    ("LCV", [1, 1, 1], 0, 1),
    ("LCVC", [8, 8, 8], 1, 255),
    ("LCPG", [1, 1, 1], 0, 1),
    ("LFV", [1, 1, 1], 0, 1),
    ("LFVC", [8, 8, 8], 1, 255),
    ("LFS", [1, 1, 1], 0, 1),
    ("LFAP", [1, 1, 1], 0, 2),
    ("LFDP", [1, 1, 1], 0, 1),
    ("LFDPC", [1, 1, 1], 1, 255),
    ("ACCEL", [40, 30, 30], 0, 65_535),
    ("CT", [18_200, 9300, 18_200], -32_767, 32_767),
    ("EN", [1, 1, 1], 0, 1),
    ("HOLD", [0, 1, 0], 0, 1),
    ("MPE", [200, 200, 200], -32_767, 32_767),
    ("OT", [0, 0, 0], -32_767, 32_767),
    ("TSTOP", [300, 400, 300], 0, 65_535),
    // Parameters of later hands, which clients set on every hand (decision 0001).
    ("LCT", [0, 0, 0], 0, 0),
    ("LFBP", [0, 0, 0], 0, 0),
    ("LFAIN", [0, 0, 0], 0, 0),
];

pub const READ_ONLY: &[(&str, i64)] =
    &[("BD", 0), ("BP", 0), ("OD", 0), ("P", 0), ("S", 4), ("SG", 128), ("SAMPLE", 31)];

/// Writable parameters of the hand (manual 5.4): default, minimum and maximum.
pub const SET_HAND: &[(&str, i64, i64, i64)] = &[
    ("BAUD", 96, 6, 384),
    ("LFT", 0, 0, 1),
    ("OTEMP", -551, -551, 1250),
    ("LFDPD", 0, 0, 1),
    ("COMPAT", 0, 0, 262),
];

pub const READ_ONLY_HAND: &[(&str, i64)] = &[("TEMP", 350), ("PTEMP", 350), ("UPSECS", 0)];

fn seven(of: [i64; 3]) -> String {
    let [link, spread, tip] = of;
    format!("{link} {link} {link} {spread} {tip} {tip} {tip}")
}

#[test]
fn each_motor_parameter_can_be_set_and_read() {
    let mut session = Session::new();
    for &(name, defaults, min, max) in SET {
        assert_eq!(session.run(&format!("X1234567FGET {name}")), seven(defaults), "{name}");
        for value in [max, min] {
            assert_eq!(session.run(&format!("X246FSET {name} {value}")), "", "{name} {value}");
            assert_eq!(session.run(&format!("X246FGET {name}")), [value; 3].map(|v| v.to_string()).join(" "));
        }
        for beyond in [min - 1, max + 1] {
            assert_eq!(session.run(&format!("X246FSET {name} {beyond}")), "ERR 128", "{name} {beyond}");
        }
        let [link, spread, tip] = defaults;
        let expected = format!("{link} {min} {link} {min} {tip} {min} {tip}");
        assert_eq!(session.run(&format!("X1234567FGET {name}")), expected, "{name} {spread}");
        // Restore the defaults: HSG and MSG are one property, and EN selects motors.
        assert_eq!(session.run(&format!("X26FSET {name} {link}")), "");
        assert_eq!(session.run(&format!("X4FSET {name} {spread}")), "");
        assert_eq!(session.run(&format!("X6FSET {name} {tip}")), "");
    }
    for (name, value) in READ_ONLY {
        assert_eq!(session.run(&format!("X1234567FGET {name}")), [value.to_string().as_str(); 7].join(" "));
        assert_eq!(session.run(&format!("X1FSET {name} {value}")), "ERR 256", "{name}");
    }
}

#[test]
fn each_hand_parameter_can_be_set_and_read() {
    let mut session = Session::new();
    for (name, default, min, max) in SET_HAND {
        assert_eq!(session.run(&format!("PGET {name}")), default.to_string(), "{name}");
        for value in [min, max] {
            assert_eq!(session.run(&format!("PSET {name} {value}")), "", "{name} {value}");
            assert_eq!(session.run(&format!("PGET {name}")), value.to_string());
        }
        for beyond in [min - 1, max + 1] {
            assert_eq!(session.run(&format!("PSET {name} {beyond}")), "ERR 128", "{name} {beyond}");
        }
    }
    for (name, value) in READ_ONLY_HAND {
        assert_eq!(session.run(&format!("PGET {name}")), value.to_string(), "{name}");
        assert_eq!(session.run(&format!("PSET {name} {value}")), "ERR 256", "{name}");
    }
    for baud in ["6", "12", "24", "48", "96", "192", "384"] {
        assert_eq!(session.run(&format!("PSET BAUD {baud}")), "");
    }
}

/// Without X a finger is one axis: set on both motors, read from the link.
#[test]
fn finger_is_one_axis() {
    let rows = [
        ("2FSET DP 1000 ACCEL 20 LFVC 3", ""),
        ("X26FGET DP ACCEL LFVC", "1000 1000 20 20 3 3"),
        ("X15FGET DP ACCEL LFVC", "8500 8500 40 30 8 8"),
        ("X6FSET DP 2000", ""),
        ("2FGET DP", "1000"),
        // Without a prefix EN selects: motors 1 and 7 are without their finger.
        ("X3FSET EN 0", ""),
        ("X5FSET EN 0", ""),
        ("FGET DS", "1400 1400 800 1400"),
        ("3FGET EN", "0"),
    ];
    assert_answers(&mut Session::new(), &rows);
}

/// GOD keeps a position as it was set while the board holds its rounding (decision 0027): a hall count is 55 GCL counts.
#[test]
fn board_stores_the_nearest_hall_count() {
    let rows = [
        ("X1FSET CT 10000", ""),
        ("1 G CT", "1 CT=182"),
        ("X1FSET CT 10010", ""),
        ("X1FGET CT", "10010"),
        ("1 S CT 100", ""),
        ("X1FGET CT", "5500"),
        ("1 S CT 182", ""),
        ("X1FGET CT", "10010"),
        ("X1FSET MPE -32767", ""),
        ("1 G MPE", "1 MPE=0"),
        ("X1FGET MPE", "-32767"),
        ("X1FSET OT -28", ""),
        ("1 G OT", "1 OT=-1"),
    ];
    assert_answers(&mut Session::new(), &rows);
}

/// FSAVE and FLOAD store and restore the parameters' properties and no others. FDEF changes the current values, not the stored ones.
#[test]
fn saved_parameters_survive_reset() {
    let mut session = Session::new();
    let rows = [
        ("1 S KP 77", "ERR 1"),
        ("WAKE", ""),
        ("123 S KP 77", ""),
        ("12FSET CT 10010 LFVC 5 TSTOP 900", ""),
        ("3FSET CT 10010 LFVC 5 TSTOP 900", ""),
        ("1FSAVE", ""),
        ("2FDEF", ""),
        ("2FSAVE", ""),
        ("1FSET CT 7", ""),
        ("1FDEF", ""),
        ("123FGET CT LFVC TSTOP", "18200 18200 10010 8 8 5 300 300 900"),
        ("123G KP", "1 KP=77\n2 KP=77\n3 KP=77"),
        ("123FLOAD", ""),
        ("123FGET CT LFVC TSTOP", "10010 18200 18200 5 8 8 900 300 300"),
        ("123G KP", "1 KP=77\n2 KP=77\n3 KP=77"),
    ];
    assert_answers(&mut session, &rows[1..]);
    session.run("RESET");
    assert_answers(&mut session, &[("123FGET CT LFVC TSTOP", "10010 18200 18200 5 8 8 900 300 300")]);
    assert_answers(&mut session, &[("1 G KP", "1 KP=120"), ("X5FGET CT", "10010")]);
    let stored = session.hand.memory().changed().expect("GOD's part");
    let of = |motor: usize| stored.parameters.motors[motor - 1].as_set;
    assert_eq!((of(1), of(5)), (of(5), of(1)));
    assert_ne!(of(1), of(2));
}

#[test]
fn parameters_of_a_missing_board_are_err_1() {
    let mut session = Session::new();
    session.run("WAKE");
    session.hand.bus_mut().cut(1, true);
    let rows = [
        ("2FGET DS", "ERR 1"),
        ("FSET DS 1", "ERR 1"),
        ("13FSET DS 1", ""),
        ("13FGET DS", "1 1"),
        ("2FSAVE", "ERR 1"),
        ("2FLOAD", "ERR 1"),
        ("2FDEF", "ERR 1"),
        ("2FLISTV", "ERR 1"),
    ];
    assert_answers(&mut session, &rows);
    session.hand.push_rx(b"3FDEF\r");
    session.wait_us(2_000);
    session.hand.bus_mut().cut(2, true);
    assert_eq!(session.read_to_prompt(), "3FDEF\r\n\rERR 1\r\n\r=> ");
}

/// PTEMP is the highest TEMP and UPSECS the power-on time in the hand's life.
#[test]
fn peak_temperature_and_uptime_survive_reset() {
    let mut session = Session::new();
    session.hand.fix_temperature(Some(42.5));
    session.wait_us(1000);
    session.hand.fix_temperature(Some(-3.0));
    assert_answers(&mut session, &[("PGET TEMP PTEMP", "-30 425")]);
    let peak = session.hand.memory().changed().expect("at once");
    assert_eq!(peak.peak_temperature, 425);
    let seconds = |session: &mut Session| session.run("PGET UPSECS").parse::<u64>().expect("a number");
    // The prompt takes a millisecond, so wait until an absolute time.
    let until = |session: &mut Session, us: u64| session.wait_us(us - session.hand.now_us());
    until(&mut session, 100_500_000);
    assert_eq!(seconds(&mut session), 100);
    session.run("RESET");
    until(&mut session, 130_900_000);
    // RESET loses less than a second.
    assert!((129..=130).contains(&seconds(&mut session)));
    let stored = session.hand.memory().changed().expect("stored every minute, and by RESET");
    assert_eq!((stored.peak_temperature, stored.up_seconds), (425, 100));
    let mut next = Session::with_memory(Memory::new(Stored { up_seconds: u32::MAX, serial: 77, ..stored }));
    assert_answers(&mut next, &[("PGET UPSECS PTEMP SN", "4294967295 425 77")]);
    next.wait_us(1_000_000);
    assert_eq!(seconds(&mut next), 0, "it wraps after 136 years");
}

/// It is stored at once, and neither RESET, PDEF nor PLOAD changes it.
#[test]
fn serial_number_can_be_set_once() {
    let mut session = Session::new();
    let rows = [
        ("PGET SN", "0"),
        ("PSET SN 4294967296", "ERR 128"),
        // Nothing is set of a line with an error.
        ("PSET SN 7 LFT 2", "ERR 128"),
        ("PSET SN 7 SN 8", "ERR 256"),
        ("PGET SN", "0"),
        ("PSET LFT 1 SN 4711", ""),
        ("PGET SN", "4711"),
        ("PSET SN 4711", "ERR 256"),
        ("PSET LFT 0 SN 4712", "ERR 256"),
        ("PGET SN LFT", "4711 1"),
        ("PDEF", ""),
        ("PLOAD", ""),
        ("PGET SN", "4711"),
    ];
    assert_answers(&mut session, &rows);
    session.run("RESET");
    assert_answers(&mut session, &[("PGET SN", "4711"), ("PSET SN 1", "ERR 256")]);
    let kept = session.hand.memory().stored();
    let mut next = Session::with_memory(Memory::new(kept));
    assert_answers(&mut next, &[("PGET SN", "4711"), ("PSET SN 1", "ERR 256")]);
}

#[test]
fn status_of_a_finger_includes_its_tip() {
    let mut session = Session::new();
    assert_answers(
        &mut session,
        &[
            ("FGET S", "4 4 4 4"),
            ("HI", ""),
            // A negative MPE, which no position meets.
            ("X5FSET MPE -1", ""),
            ("1M 3000", "ERR 16"),
            ("FGET S", "16 0 0 0"),
            ("X15FGET S", "0 16"),
        ],
    );
}

/// Erase cycles of a page of an STM32F103's flash (data sheet, endurance).
const ENDURANCE: u32 = 10_000;

/// The manual allows 5,000 FSAVEs in a hand's life (5.2.2). The flash endures them, so GOD does not count them.
#[test]
fn flash_endures_5000_fsaves() {
    let mut session = Session::new();
    session.run("WAKE");
    for save in 0..500 {
        let counts = 1000 + 55 * (save % 2);
        assert_answers(&mut session, &[(&*format!("FSET DS {counts} DP {counts}"), ""), ("FSAVE", "")]);
    }
    let worst =
        session.hand.bus().stations().flat_map(|node| node.board().sim_flash().erases().to_vec()).max();
    let worst = 10 * worst.expect("there are pages");
    println!(
        "figure: 5,000 FSAVEs of the whole hand: the most erased page has {worst} erases of {ENDURANCE}"
    );
    assert!((1..=ENDURANCE).contains(&worst), "{worst}");
}

pub const WORN: &[Exchange] = &[
    ("FSET DS 220", ""),
    ("GFSAVE", ""),
    ("SFSAVE", "ERR 512"),
    ("FSAVE", "ERR 512"),
    ("SAVE", "ERR 512"),
    // Its board cannot invalidate the saved position.
    ("SC", "ERR 512"),
    ("SFGET S", "512"),
];

#[test]
fn worn_flash_is_err_512() {
    let mut session = Session::new();
    assert_answers(&mut session, &[("SHI", ""), ("FSET DS 110", ""), ("FSAVE", ""), ("SAVE", "")]);
    let worn = |session: &mut Session, worn| {
        let node = session.hand.bus_mut().station_mut(3).expect("motor 4");
        node.board_mut().flash().set_worn(worn);
    };
    worn(&mut session, true);
    assert_answers(&mut session, WORN);
    // A board retries a failed page only after a restart.
    worn(&mut session, false);
    session.hand.push_rx(b"RESET\r");
    session.read_to_prompt();
    assert_answers(&mut session, &[("FSAVE", ""), ("SHI", ""), ("SC", "")]);
}

/// RealTime reports changes from the position that the host received last, by FGET P or by RealTime itself (manual 6.2.3).
#[test]
fn fget_p_sets_the_base_of_position_changes() {
    let mut session = Session::new();
    assert_answers(&mut session, &[("HI", ""), ("1M 5500", ""), ("1FSET LFV 0 LFS 0 LFAP 0 LFDPC 50", "")]);
    let change = |session: &mut Session| {
        session.hand.push_rx(b"1LOOP\r");
        session.wait_us(1_000_000);
        session.hand.take_tx();
        session.hand.push_rx(b"A");
        session.wait_us(100_000);
        let received = session.hand.take_tx();
        session.hand.push_rx(b"\x03");
        session.read_to_prompt();
        received
    };
    assert_answers(&mut session, &[("1FGET P", "5500"), ("1M 8250", "")]);
    assert_eq!(change(&mut session), [b'*', 55], "8250 - 5500, in fifties");
    assert_eq!(change(&mut session), [b'*', 0], "reported once");
    assert_answers(&mut session, &[("1M 2750", ""), ("1FGET P", "2750")]);
    assert_eq!(change(&mut session), [b'*', 0]);
}

/// Manual 5.3.2: the counts traveled, divided by 1000, in the language's counts, and kept for good.
#[test]
fn od_counts_thousands_of_counts_and_never_decreases() {
    let mut session = Session::new();
    assert_answers(&mut session, &[("1FGET OD", "0"), ("X1HI", "")]);
    let read = |session: &mut Session| {
        // Boards update it every 100 ms, in which a motor that arrives may go 400 counts.
        session.wait_us(100_000);
        session.run("X1FGET OD").parse::<i64>().expect("a number")
    };
    let mut read_so_far = vec![read(&mut session)];
    for round in 0..6 {
        assert_answers(&mut session, &[(if round % 2 == 0 { "X1M 18000" } else { "X1M 0" }, "")]);
        read_so_far.push(read(&mut session));
    }
    let way: Vec<i64> = read_so_far.windows(2).map(|pair| pair[1] - pair[0]).collect();
    // 18,000 counts within MPE at either end, and a count of the rest.
    assert!(way.iter().all(|way| (17..=19).contains(way)), "{read_so_far:?}");
    // HI: 12 counts from the stop and back, and 25 to zero: 49 hall counts of 55.
    assert!((2..=4).contains(&read_so_far[0]), "{read_so_far:?}");
    assert!((108..=112).contains(&read_so_far[6]), "{read_so_far:?}");
    // A motor that has rested for a minute loses none of it with its power.
    session.wait_us(61_000_000);
    let rested = read(&mut session);
    assert!(rested >= read_so_far[6]);
    let node = session.hand.bus_mut().station_mut(0).expect("motor 1");
    node.power_off();
    node.power_on();
    session.wait_us(100_000);
    assert_answers(&mut session, &[("WAKE", "")]);
    assert_eq!(read(&mut session), rested);
}
