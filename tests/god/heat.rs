//! OTEMP, PTEMP and LFT with the palm's own heat.

use super::{Session, assert_answers};

/// Presses all motors on their stops, ten seconds in all; each press ends after TSTOP.
fn press(session: &mut Session) {
    for _ in 0..6 {
        for line in ["X1234567TC", "X1234567TO"] {
            session.run(line);
        }
    }
}

fn tenths(session: &mut Session, parameter: &str) -> i64 {
    session.run(&format!("PGET {parameter}")).parse().expect("a number")
}

fn copper_j(session: &Session) -> f64 {
    session.hand.bus().stations().map(|node| node.board().rig().truth().ledger.copper_j).sum()
}

/// The constants are those of `hil_world::hand::palm`: 900 J/K, 1 K/W, 35.0 °C at rest.
#[test]
fn temperature_follows_the_copper_losses() {
    let mut session = Session::new();
    assert_eq!(tenths(&mut session, "TEMP"), 350, "at rest");
    assert_answers(&mut session, &[("HI", ""), ("GFSET TSTOP 1000", "")]);
    press(&mut session);
    let (warm, joules) = (tenths(&mut session, "TEMP"), copper_j(&session));
    // Of this little heat the air takes less than 5 % within the two minutes at most.
    let wanted = 350.0 + joules / 90.0;
    println!("figure: {joules:.0} J of copper losses warm the palm from 35.0 to {:.1} C", warm as f64 / 10.0);
    assert!(warm > 352 && (warm as f64 - wanted).abs() <= 0.15 * (wanted - 350.0) + 1.0, "{warm}, {wanted}");
    assert_eq!(tenths(&mut session, "PTEMP"), warm);
    // A time constant of 900 s.
    session.run("T");
    session.wait_us(90_000_000);
    let left = (tenths(&mut session, "TEMP") - 350) as f64;
    let wanted = (warm - 350) as f64 * (-0.1_f64).exp();
    assert!((left - wanted).abs() <= 2.0, "{left} of {}, {wanted}", warm - 350);
    // The motors warm the palm until T stops them.
    let peak = tenths(&mut session, "PTEMP");
    assert!((warm..=warm + 1).contains(&peak), "the peak stays: {peak}, {warm}");
}

#[test]
fn otemp_ends_motions_of_a_hand_that_has_become_hot() {
    let mut session = Session::new();
    assert_answers(
        &mut session,
        &[("HI", ""), ("GFSET TSTOP 1000", ""), ("PSET OTEMP 351", ""), ("SM 100", "")],
    );
    press(&mut session);
    assert!(tenths(&mut session, "TEMP") > 351);
    for line in ["SM 200", "C", "HI", "4LOOP", "4 S M 5"] {
        assert_eq!(session.run(line), "ERR 8192", "{line}");
    }
    // T is no order to move, and says what is the matter.
    assert_answers(&mut session, &[("ST", "ERR 8192"), ("PSET OTEMP 400", ""), ("SM 200", "")]);
    // 6.0 °C, the manual's example, trips at once; -551 is no limit.
    assert_answers(
        &mut session,
        &[("PSET OTEMP 60", ""), ("SM 100", "ERR 8192"), ("PSET OTEMP -551", ""), ("SM 100", "")],
    );
}

/// An over-temperature ends LOOP, and S says what holds when it is read: of every motor, and no longer once the hand is cool.
#[test]
fn otemp_ends_loop_and_s_is_recomputed() {
    for header in [&b"A"[..], b"a", b"C\x14\x20", b"c\x14\x20"] {
        let mut session = Session::new();
        assert_answers(&mut session, &[("HI", ""), ("PSET OTEMP 400", "")]);
        session.start("SLOOP");
        session.hand.push_rx(b"c\x14\x20");
        session.wait_us(50_000);
        assert_eq!(session.hand.take_tx(), b"*");
        session.hand.fix_temperature(Some(40.1));
        session.hand.push_rx(header);
        assert_eq!(session.read_to_prompt(), "\r\n\rERR 8192\r\n\r=> ", "{header:?}");
        session.wait_us(300_000);
        let speed = session.hand.bus().stations().nth(3).expect("motor 4").board().rig().truth().counts_per_s;
        assert!(speed.abs() < 1.0, "{speed}");
        assert_answers(
            &mut session,
            &[
                ("SFGET S", "8192"),
                ("FGET S", "8192 8192 8192 8192"),
                ("1M 100", "ERR 8192"),
                ("SLOOP", "ERR 8192"),
            ],
        );
        session.hand.fix_temperature(Some(40.0));
        assert_answers(&mut session, &[("FGET S", "0 0 0 0"), ("1M 100", "")]);
        // Nor does a limit that is taken away hold.
        assert_answers(&mut session, &[("PSET OTEMP 60", ""), ("1C", "ERR 8192"), ("1FGET S", "8192")]);
        assert_answers(&mut session, &[("PSET OTEMP -551", ""), ("1FGET S", "0"), ("1C", "")]);
    }
}

#[test]
fn lft_feeds_the_palms_temperature_back() {
    for (compat, size) in [(0, 2), (262, 1)] {
        let mut session = Session::new();
        session.run("HI");
        press(&mut session);
        let flags = "4FSET LCV 0 LCPG 0 LFV 0 LFS 0 LFAP 0 LFDP 0";
        session.run(&format!("PSET COMPAT {compat} LFT 1"));
        assert_eq!(session.run(flags), "");
        let temperature = tenths(&mut session, "TEMP");
        assert!(temperature > 350);
        session.start("4LOOP");
        session.hand.push_rx(b"A");
        session.wait_us(20_000);
        let block = session.hand.take_tx();
        assert_eq!(block.len(), 1 + size, "COMPAT {compat}: {block:?}");
        // It has gone on since PGET.
        let found = match block[1..] {
            [high, low] => i64::from(i16::from_be_bytes([high, low])),
            [degrees] => 10 * i64::from(degrees),
            _ => panic!("{block:?}"),
        };
        assert!(
            (found - temperature).abs() <= if size == 2 { 1 } else { 6 },
            "COMPAT {compat}: {found}, {temperature}"
        );
    }
}
