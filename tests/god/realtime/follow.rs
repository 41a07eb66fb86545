//! A finger in RealTime: its tip follows its link by the ratio (decision 0030).

use super::Host;
use crate::god::Session;
use crate::god::movement::with_object;

/// Time between two blocks, us.
const BLOCK_US: u64 = 10_000;

/// Greatest distance of a tip from its share of its link's travel, counts. At 1000 counts/s the tip has to reach 265 counts/s first, which
/// takes it 4.9; at 80 it is 2.9.
const LAG: f64 = 6.0;

/// The same at rest.
const AT_REST: f64 = 2.0;

impl Host {
    /// Sends the same block for a while; calls `check` after each.
    fn repeat(&mut self, block: &[u8], answer: usize, for_us: u64, mut check: impl FnMut(&mut Self)) {
        for _ in 0..for_us / BLOCK_US {
            self.block(block, answer);
            self.session.wait_us(BLOCK_US);
            check(self);
        }
    }

    fn counts(&self, motor: usize) -> f64 {
        self.truth()[motor - 1].1
    }
}

/// Distance of each finger's tip from its share of its link's travel since `from`, counts.
fn lags(host: &Host, from: &[(f64, f64)]) -> [f64; 3] {
    [1, 2, 3].map(|link| {
        let moved = |motor: usize| host.counts(motor) - from[motor - 1].1;
        moved(link) * 13.0 / 49.0 - moved(link + 4)
    })
}

fn block(velocity: i8, fingers: usize) -> Vec<u8> {
    std::iter::once(b'c').chain([velocity.cast_unsigned(), 32].repeat(fingers)).collect()
}

#[test]
fn tip_follows_its_link_by_the_ratio_at_any_velocity() {
    for velocity in [5_i8, 10, 25, 60, 125] {
        let mut host = Host::new("G");
        let (from, mut most) = (host.truth(), 0.0_f64);
        let travel_us = 200 * 1_000_000 / (8 * u64::from(velocity.unsigned_abs()) + 40);
        for turn in [velocity, 0, -velocity, 0, velocity, 0, -velocity, 0] {
            let for_us = if turn == 0 { 500_000 } else { travel_us };
            host.repeat(&block(turn, 3), 1, for_us, |host| {
                most = lags(host, &from).iter().fold(most, |most, lag| most.max(lag.abs()));
            });
            if turn == velocity && velocity > 5 {
                assert!((1..=3).all(|link| host.counts(link) > 40.0), "{velocity}: {:?}", host.truth());
            }
            if turn == 0 {
                let lags = lags(&host, &from);
                assert!(lags.iter().all(|lag| lag.abs() < AT_REST), "{velocity}: {lags:?}");
            }
        }
        println!(
            "figure: LOOP at {} counts/s: a tip is {most:.1} counts from its share at most",
            8 * i32::from(velocity)
        );
        assert!(most < LAG, "{velocity}: {most}");
    }
}

/// The figure: 80 counts/s for a second; the tip stood.
#[test]
fn tip_at_80_counts_per_s_reaches_its_share() {
    let mut host = Host::new("1");
    host.repeat(&block(10, 1), 1, 1_000_000, |_| {});
    let (link, tip) = (host.counts(1), host.counts(5));
    println!(
        "figure: LOOP at 80 counts/s for 1 s: link {:.0} GCL counts, tip {:.0}",
        55.0 * link,
        55.0 * tip
    );
    assert!(link > 40.0 && (tip - link * 13.0 / 49.0).abs() < 3.0, "{link} {tip}");
}

/// Control blocks with a gain only, with a velocity only, and with both.
#[test]
fn tip_follows_with_every_layout_of_control_blocks() {
    for (layout, drive) in [("LCV 1 LCPG 0", &[b'c', 25][..]), ("LCV 1 LCPG 1", &[b'c', 25, 16])] {
        let mut session = Session::new();
        session.run(&format!("1FSET {layout}"));
        let mut host = Host::from_session(session, "1");
        let from = host.truth();
        host.repeat(drive, 1, 800_000, |_| {});
        assert!(host.counts(1) > 50.0, "{layout}: {:?}", host.truth());
        assert!(lags(&host, &from)[0].abs() < LAG, "{layout}: {:?}", host.truth());
    }
    let mut session = Session::new();
    session.run("1FSET LCV 0");
    let mut host = Host::from_session(session, "1");
    host.repeat(&[b'c', 200], 1, 500_000, |_| {});
    assert!(
        host.truth().iter().all(|(_, counts)| counts.abs() < 2.0),
        "a gain moves nothing: {:?}",
        host.truth()
    );
}

/// Other commands leave a tip elsewhere: LOOP keeps its lead.
#[test]
fn lead_of_a_tip_is_kept() {
    let mut session = Session::new();
    assert_eq!(session.run("HI"), "");
    assert_eq!(session.run("X5M 5500"), "");
    let mut host = Host::enter(session, "1");
    let from = host.truth();
    host.repeat(&block(25, 1), 1, 1_000_000, |_| {});
    assert!(lags(&host, &from)[0].abs() < LAG, "{:?}", host.truth());
}

/// The tip's stop is at 350.
#[test]
fn tip_at_its_stop_follows_back_from_there() {
    let mut session = Session::new();
    assert_eq!(session.run("HI"), "");
    assert_eq!(session.run("X5M 18700"), "");
    let mut host = Host::enter(session, "1");
    host.repeat(&block(25, 1), 1, 1_500_000, |host| assert!(host.counts(5) < 352.0));
    assert!(host.counts(1) > 200.0 && host.counts(5) > 348.0, "{:?}", host.truth());
    let from = host.truth();
    host.repeat(&block(-25, 1), 1, 1_000_000, |_| {});
    assert!(host.counts(1) < 120.0 && lags(&host, &from)[0].abs() < 2.0 * LAG, "{:?}", host.truth());
}

/// As after a breakaway.
#[test]
fn tip_of_a_link_that_meets_an_object_goes_on() {
    let mut host = Host::enter(with_object(1, 60.0), "1");
    // Full torque, so that the link stalls.
    host.repeat(&block(100, 1), 1, 2_000_000, |_| {});
    assert!(host.counts(1) < 65.0 && host.counts(5) > 60.0, "{:?}", host.truth());
    host.session.hand.push_rx(b"\x03");
    assert_eq!(host.session.read_to_prompt(), "\r\n\r=> ");
}

/// A tip that is not enabled stands, and a link that is not moves nothing.
#[test]
fn finger_without_both_motors_enabled_is_not_coupled() {
    for (disabled, axes) in [("X5", 1), ("X1", 1), ("X15", 0)] {
        let mut session = Session::new();
        assert_eq!(session.run("HI"), "");
        session.run("X23467FSET EN 0");
        session.run(&format!("{disabled}FSET EN 0"));
        if axes == 0 {
            assert_eq!(session.run("LOOP"), "ERR 2");
            continue;
        }
        let mut host = Host::enter(session, "");
        assert_eq!(host.block(b"A", 1 + 7 * axes)[0], b'*');
        host.repeat(&block(25, axes), 1, 500_000, |_| {});
        let (moves, stands) = if disabled == "X5" { (1, 5) } else { (5, 1) };
        assert!(host.counts(moves) > 40.0 && host.counts(stands).abs() < 2.0, "{:?}", host.truth());
    }
}
