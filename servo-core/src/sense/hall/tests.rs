use super::*;

const W: Wiring = Wiring::STANDARD;

/// Arrives at cell `count` by four steps, 1 ms apart.
fn running(count: i32, sign: i32) -> (HallDecoder, u32) {
    let mut d = HallDecoder::new(W, code_at(count - 4 * sign), count - 4 * sign);
    let mut now = 0_u32;
    for k in (0..4).rev() {
        now += 1000;
        assert!(matches!(d.sample(code_at(count - k * sign), Micros(now)), Some(HallEvent::Step(_))));
    }
    assert_eq!(d.count(), count);
    (d, now)
}

fn code_at(count: i32) -> u8 {
    W.code(u8::try_from(count.rem_euclid(6)).unwrap())
}

/// Valid codes of `cells` cells from `from` on at 1000 counts/s, each with a control tick after 300 µs.
fn turn(d: &mut HallDecoder, now: &mut u32, from: i32, sign: i32, cells: i32) {
    for k in 0..cells {
        let code = code_at(from + k * sign);
        d.sample(code, Micros(*now));
        d.sample(code, Micros(*now + 300));
        *now += 1000;
    }
}

#[test]
fn standard_wiring_has_the_codes_of_decision_0003() {
    assert_eq!([0, 1, 2, 3, 4, 5].map(|sector| W.code(sector)), [2, 6, 4, 5, 1, 3]);
    for k in 0..6 {
        assert_eq!(W.sector(W.code(k)), Some(k));
    }
    assert_eq!((W.sector(0), W.sector(7), W.sector(0b1010)), (None, None, Some(0)));
}

#[test]
fn edge_has_count_direction_time_and_slope() {
    // STANDARD upwards: 2 → 6 rises, 6 → 4 falls.
    let mut d = HallDecoder::new(W, 2, 0);
    let edge = |count, way, at, rising| {
        let at = Micros(at);
        Some(HallEvent::Step(HallEdge { count, steps: 1, way, at, rising, bounce: false, uncertain: false }))
    };
    assert_eq!(d.sample(6, Micros(500)), edge(1, Way::Closing, 500, true));
    assert_eq!(d.sample(4, Micros(1500)), edge(2, Way::Closing, 1500, false));
    assert_eq!(d.sample(6, Micros(1700)), edge(1, Way::Opening, 1700, true));
    assert_eq!(d.sample(2, Micros(1900)), edge(0, Way::Opening, 1900, false));
    assert_eq!(d.sample(2, Micros(2900)), None);
}

/// In each sector and direction, any pair of codes `a`, `b` for less than `CONFIRM`. Then the codes are valid again: where
/// the rotor was, one cell on (the glitch hid an edge), or one cell back (it reversed).
#[test]
fn glitch_of_any_two_codes_leaves_no_count_error() {
    let mut pairs = 0;
    for start in 0..6 {
        for sign in [-1, 1] {
            for (a, b, moved) in (0..64).flat_map(|ab| [-1, 0, 1].map(|m| (ab / 8, ab % 8, m))) {
                let (mut d, mut now) = running(start, sign);
                now += 400;
                d.sample(a, Micros(now));
                d.sample(b, Micros(now + 60));
                now += 120;
                let from = start + moved * sign;
                let sign = if moved < 0 { -sign } else { sign };
                turn(&mut d, &mut now, from, sign, 5);
                assert_eq!(d.count(), from + 4 * sign, "cell {start} {sign:+}: {a}, {b}, moved {moved}");
                pairs += 1;
            }
        }
    }
    assert_eq!(pairs, 6 * 2 * 64 * 3);
}

/// At standstill. A wrong code of a sector that is not a neighbor must be reported as a glitch at least once.
#[test]
fn single_wrong_code_of_any_length_is_undone() {
    for start in 0..6 {
        for (sign, code, length) in
            (0..8).flat_map(|c| [(-1, c, 50), (1, c, 50), (-1, c, 5000), (1, c, 5000)])
        {
            let (mut d, now) = running(start, sign);
            let mut named = false;
            let mut see = |event: Option<HallEvent>| match event {
                None => {}
                Some(HallEvent::Step(edge)) => named |= edge.bounce,
                Some(HallEvent::Glitch(_)) => named = true,
                Some(HallEvent::Fault(f)) => assert_eq!(f, HallFault::Illegal),
            };
            for tick in 0..=length / 1000 {
                see(d.sample(code, Micros(now + 400 + 1000 * tick)));
            }
            for tick in 0..4 {
                see(d.sample(code_at(start), Micros(now + 400 + length + 1000 * tick)));
            }
            assert_eq!(d.count(), start, "{sign:+}: code {code} for {length} µs");
            let next_door = [-1, 0, 1].iter().any(|d| code_at(start + d) == code);
            let same = code == code_at(start);
            assert_eq!(named, !same && (!next_door || length < 100), "{sign:+}: code {code} for {length} µs");
        }
    }
}

#[test]
fn lost_edges_are_recovered() {
    for start in 0..6 {
        for (sign, lost, steps) in [(-1, 1, 2), (1, 1, 2), (-1, 2, 3), (1, 2, 3)] {
            let (mut d, now) = running(start, sign);
            let seen = start + (lost + 1) * sign;
            let jump = d.sample(code_at(seen), Micros(now + 3000));
            assert_eq!(jump, Some(HallEvent::Glitch(Glitch::Jump)));
            assert_eq!(d.count(), start, "held");
            // At standstill the tick confirms it, with the time of the line's change.
            let mut still = d;
            let Some(HallEvent::Step(edge)) = still.sample(code_at(seen), Micros(now + 3500)) else {
                panic!("not confirmed")
            };
            assert_eq!((edge.count, edge.steps, edge.at), (seen, steps, Micros(now + 3000)));
            // At speed the next edge confirms it and gives the direction.
            for turn in [sign, if lost == 2 { -sign } else { sign }] {
                let mut d = d;
                let on = start + (lost + 1) * turn + turn;
                let Some(HallEvent::Step(edge)) = d.sample(code_at(on), Micros(now + 3900)) else {
                    panic!("not chained")
                };
                assert_eq!((edge.count, edge.steps), (on, steps + 1));
                assert_eq!(edge.at, Micros(now + 3900));
            }
        }
    }
}

#[test]
fn short_jump_is_not_confirmed() {
    let (mut d, now) = running(2, 1);
    assert_eq!(d.sample(code_at(4), Micros(now + 400)), Some(HallEvent::Glitch(Glitch::Jump)));
    assert_eq!(d.sample(code_at(4), Micros(now + 400 + CONFIRM.0 - 1)), None);
    assert_eq!(d.count(), 2);
    assert!(matches!(d.sample(code_at(4), Micros(now + 400 + CONFIRM.0)), Some(HallEvent::Step(_))));
    assert_eq!(d.count(), 4);
}

/// From 10 to 1000 counts/s, with ticks at any phase.
#[test]
fn stuck_line_is_detected_within_three_electrical_revolutions() {
    for (line, high) in (0..3).flat_map(|line| [(line, false), (line, true)]) {
        for (sign, cell_us, phase) in
            [(1, 1000, 0), (-1, 1000, 700), (1, 1333, 100), (-1, 20_000, 500), (1, 100_000, 0)]
        {
            for start in 0..6 {
                let (mut d, begin) = running(start, sign);
                let lie = |code: u8| if high { code | 1 << line } else { code & !(1 << line) };
                let mut found = None;
                for at in begin..begin + 19 * cell_us {
                    let cells = i32::try_from((at - begin) / cell_us).unwrap();
                    let edge = (at - begin) % cell_us == 0;
                    let tick = at % 1000 == phase;
                    if (edge || tick)
                        && let Some(HallEvent::Fault(fault)) =
                            d.sample(lie(code_at(start + cells * sign)), Micros(at))
                        && fault != HallFault::Illegal
                    {
                        found = Some((fault, cells));
                        break;
                    }
                }
                let Some((fault, cells)) = found else {
                    panic!("line {line} {high} {sign:+}, {cell_us} µs a cell from {start}: not found")
                };
                assert_eq!(fault, HallFault::Stuck(line), "{high} {sign:+} {cell_us} {start}");
                assert!(cells <= 18);
            }
        }
    }
}

/// 1 % of the edges with a glitch, of each of the eight codes in turn, must not fault in 100,000 edges.
#[test]
fn isolated_glitches_never_fault_and_dense_ones_do() {
    for (every, faults_expected) in [(100, false), (3, true)] {
        let (mut d, mut now) = running(0, 1);
        let mut faults = 0_u32;
        for count in 1..100_000_i32 {
            now = now.wrapping_add(1000);
            let wrong = u8::try_from(count / every % 8).unwrap();
            let glitch = (count % every == 0).then_some((wrong, 600));
            for (code, after) in [(code_at(count), 0), (code_at(count), 500)].into_iter().chain(glitch) {
                if let Some(HallEvent::Fault(_)) = d.sample(code, Micros(now.wrapping_add(after))) {
                    faults += 1;
                }
                assert!(after != 500 || d.count() == count, "cell {count}");
            }
        }
        assert_eq!(faults > 0, faults_expected, "{faults} faults");
    }
}

#[test]
fn fifth_glitch_in_a_row_is_a_fault() {
    let (mut d, _) = running(0, 1);
    d.score = 0;
    let events: [HallEvent; 6] = core::array::from_fn(|_| d.glitch(Glitch::Illegal, Micros(0)));
    let faults = events.map(|event| matches!(event, HallEvent::Fault(_)));
    assert_eq!(faults, [false, false, false, false, true, false]);
}

#[test]
fn rare_glitches_at_standstill_are_no_fault() {
    let (mut d, mut now) = running(0, 1);
    let (code, count) = (d.code, d.count());
    for glitch in 0..1000 {
        for ms in 0..500 {
            now = now.wrapping_add(1000);
            let wrong = (ms == 250).then_some(if glitch % 2 == 0 { 0 } else { 7 });
            for (code, after) in wrong.map(|wrong| (wrong, 0)).into_iter().chain([(code, 5)]) {
                let event = d.sample(code, Micros(now.wrapping_add(after)));
                assert!(!matches!(event, Some(HallEvent::Fault(_))), "glitch {glitch}: {event:?}");
            }
        }
    }
    assert_eq!(d.count(), count);
}

#[test]
fn broken_cable_is_detected_at_standstill() {
    let (mut d, now) = running(0, 1);
    assert_eq!(d.sample(7, Micros(now + 100)), Some(HallEvent::Glitch(Glitch::Illegal)));
    assert_eq!(d.sample(7, Micros(now + 1000)), None);
    assert_eq!(d.sample(7, Micros(now + 2000)), None);
    assert_eq!(d.sample(7, Micros(now + 2100)), Some(HallEvent::Fault(HallFault::Illegal)));
    // The fault repeats while the code lasts, also after the clock wraps.
    for later in [2101, 3000, 5000, u32::MAX / 2, u32::MAX, 100, 200] {
        let at = Micros(now.wrapping_add(later));
        assert_eq!(d.sample(7, at), Some(HallEvent::Fault(HallFault::Illegal)), "{later}");
    }
    assert_eq!(d.sample(W.code(0), Micros(now + 300)), None);
    let mut unplugged = HallDecoder::new(W, 0, 5);
    assert_eq!(unplugged.sector(), None);
    unplugged.sample(0, Micros(0));
    assert_eq!(unplugged.sample(0, Micros(2000)), Some(HallEvent::Fault(HallFault::Illegal)));
    assert_eq!(unplugged.sample(2, Micros(2100)), None);
    assert_eq!((unplugged.sector(), unplugged.count()), (Some(0), 5));
}

/// Three cells of a rotor at 1000 counts/s are lost while a line lies, and the way is guessed.
#[test]
fn jump_after_a_long_disturbance_is_uncertain() {
    for (long, uncertain) in [(100, false), (199, false), (200, true), (1999, true), (2000, false)] {
        let (mut d, now) = running(0, 1);
        d.sample(7, Micros(now + 400));
        d.sample(code_at(2), Micros(now + 400 + long));
        let Some(HallEvent::Step(edge)) = d.sample(code_at(2), Micros(now + 600 + long)) else {
            panic!("no step")
        };
        assert_eq!((edge.count, edge.steps, edge.uncertain), (2, 2, uncertain), "{long}");
    }
    let (mut d, now) = running(0, 1);
    d.sample(code_at(2), Micros(now + 400));
    let Some(HallEvent::Step(edge)) = d.sample(code_at(3), Micros(now + 600)) else { panic!("no step") };
    assert_eq!((edge.count, edge.steps, edge.uncertain), (3, 3, false), "no other glitch");
    let Some(HallEvent::Step(edge)) = d.sample(code_at(4), Micros(now + 1600)) else { panic!("no step") };
    assert!(!edge.uncertain, "a neighbor");
}

#[test]
fn count_and_clock_wrap() {
    let mut d = HallDecoder::new(W, 2, i32::MAX);
    d.sample(6, Micros(u32::MAX - 10));
    assert_eq!(d.count(), i32::MIN);
    let Some(HallEvent::Step(edge)) = d.sample(2, Micros(20)) else { panic!("no step") };
    assert!(edge.bounce, "31 µs across the wrap");
}

/// The clock returns to the time of the last step after 71.6 min.
#[test]
fn reversal_once_the_clock_has_wrapped_is_no_bounce() {
    let (mut d, now) = running(2, 1);
    let aged = |d: &mut HallDecoder| {
        (1..=71).for_each(|minutes| d.age(Micros(now.wrapping_add(minutes * 60_000_000))))
    };
    for (us, doubtful) in [(0, false), (31, false), (99, false), (150, false)] {
        let mut d = d;
        aged(&mut d);
        let Some(HallEvent::Step(edge)) = d.sample(code_at(1), Micros(now.wrapping_add(us))) else {
            panic!("no step")
        };
        assert_eq!((edge.bounce, d.doubtful), (false, doubtful), "{us} µs");
    }
    // A step that is not long ago keeps its time.
    d.age(Micros(now + 60));
    let Some(HallEvent::Step(edge)) = d.sample(code_at(1), Micros(now + 99)) else { panic!("no step") };
    assert!(edge.bounce);
}

proptest::proptest! {
    #[test]
    fn count_is_congruent_to_the_trusted_sector(samples in proptest::collection::vec((0..8_u8, 0..5000_u32), 0..200)) {
        let mut d = HallDecoder::new(W, 2, 0);
        let mut now = 0_u32;
        for (code, dt) in samples {
            now = now.wrapping_add(dt);
            let before = d.count();
            let event = d.sample(code, Micros(now));
            proptest::prop_assert_eq!(d.count().rem_euclid(6), i32::from(d.sector().unwrap()));
            if !matches!(event, Some(HallEvent::Step(_))) {
                proptest::prop_assert_eq!(d.count(), before);
            }
            proptest::prop_assert!((d.count() - before).abs() <= 4);
        }
    }
}

#[test]
fn decoder_is_settled_once_the_same_code_says_nothing_new() {
    let mut fresh = HallDecoder::new(W, 2, 0);
    let code = fresh.code;
    assert!(fresh.is_settled(code) == fresh.quiet && !fresh.is_settled(code ^ 1));
    let (mut d, mut now) = running(0, 1);
    assert!(d.is_settled(code_at(0)) && d.is_settled(code_at(0) | 8), "other lines do not matter");
    assert!(!d.is_settled(code_at(1)));
    // A code that is not confirmed yet, an illegal one, and a glitch that counts.
    now += 1000;
    d.sample(code_at(3), Micros(now));
    assert!(!d.is_settled(code_at(3)));
    d.sample(code_at(0), Micros(now + 50));
    assert!(!d.is_settled(code_at(0)), "the glitch has a score");
    let (mut d, now) = running(0, 1);
    d.sample(7, Micros(now + 1000));
    assert!(!d.is_settled(7));
    fresh.sample(6, Micros(500));
    assert!(fresh.is_settled(6));
}
