use super::{Flow, PairFlow, Terminal, Winding};
use proptest::prelude::*;

const GROUND: Terminal = Terminal::Held { v: 0.0, bus_share: 0.0 };

fn winding() -> Winding {
    Winding::new(1.2, 0.4e-3, 24.0, 0.8)
}

/// Currents after `dt` and the copper heat, by Euler steps of 10 ns; independent of the exact solution.
fn by_small_steps(mut i: [f64; 3], held: &[Terminal; 3], e: [f64; 3], dt: f64) -> ([f64; 3], f64) {
    let step = 1e-8;
    let mut copper = 0.0;
    for _ in 0..(dt / step).round() as usize {
        let mut v: [Option<f64>; 3] = [None; 3];
        for k in 0..3 {
            v[k] = match held[k] {
                Terminal::Held { v, .. } => Some(v),
                Terminal::Open if i[k] > 1e-9 => Some(-0.8),
                Terminal::Open if i[k] < -1e-9 => Some(24.8),
                Terminal::Open => None,
            };
        }
        if v.iter().all(Option::is_none) {
            let top = (0..3).max_by(|&a, &b| e[a].total_cmp(&e[b])).unwrap();
            let bottom = (0..3).min_by(|&a, &b| e[a].total_cmp(&e[b])).unwrap();
            if e[top] - e[bottom] > 25.6 {
                (v[top], v[bottom]) = (Some(24.8), Some(-0.8));
            }
        }
        for _ in 0..2 {
            let tied: Vec<f64> = (0..3).filter_map(|k| v[k].map(|v| v - e[k])).collect();
            if tied.is_empty() {
                break;
            }
            let star = tied.iter().sum::<f64>() / tied.len() as f64;
            for k in 0..3 {
                if v[k].is_none() && star + e[k] < -0.8 {
                    v[k] = Some(-0.8);
                    break;
                } else if v[k].is_none() && star + e[k] > 24.8 {
                    v[k] = Some(24.8);
                    break;
                }
            }
        }
        let tied: Vec<f64> = (0..3).filter_map(|k| v[k].map(|v| v - e[k])).collect();
        if tied.len() < 2 {
            return ([0.0; 3], copper);
        }
        let star = tied.iter().sum::<f64>() / tied.len() as f64;
        for k in 0..3 {
            let before = i[k];
            i[k] = match v[k] {
                Some(v) => before + step / 0.4e-3 * (v - e[k] - star - 1.2 * before),
                None => 0.0,
            };
            // A diode does not conduct backwards.
            if held[k] == Terminal::Open && before * i[k] < 0.0 {
                i[k] = 0.0;
            }
            copper += 1.2 * before * before * step;
        }
        let error = (i[0] + i[1] + i[2]) / tied.len() as f64;
        for k in 0..3 {
            if v[k].is_some() && i[k] != 0.0 {
                i[k] -= error;
            }
        }
    }
    (i, copper)
}

fn any_terminal() -> impl Strategy<Value = Terminal> {
    prop_oneof![
        Just(GROUND),
        Just(Terminal::Held { v: 24.0, bus_share: 1.0 }),
        (0.0..1.0_f64).prop_map(|share| Terminal::Held { v: 24.0 * share, bus_share: share }),
        Just(Terminal::Open),
        Just(Terminal::Open),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn exact_solution_matches_small_euler_steps(
        held in [any_terminal(), any_terminal(), any_terminal()],
        (a, b) in (-9.0..9.0_f64, -9.0..9.0_f64),
        // Beyond what the motor does at 24 V, so that every diode conducts at some time.
        e in [-18.0..18.0_f64, -18.0..18.0_f64, -18.0..18.0_f64],
        dt in 5e-6..100e-6_f64,
    ) {
        let w = winding();
        let dt = (dt * 1e8).round() * 1e-8;
        let start = [a, b, -a - b];
        let mut i = start;
        let mut flow = Flow::default();
        w.advance(&mut i, &held, e, dt, libm::exp(-dt / w.tau), &mut flow);
        let (want, copper) = by_small_steps(start, &held, e, dt);
        for k in 0..3 {
            // 10 ns at 60 V over 0.4 mH are 1.5 mA at every event; Euler's own error is as small.
            prop_assert!((i[k] - want[k]).abs() < 0.01, "{i:?}, small steps {want:?}");
        }
        prop_assert!((flow.copper_j - copper).abs() < 2e-3 * copper + 1e-6, "{} {copper}", flow.copper_j);
        prop_assert!(flow.charge.iter().sum::<f64>().abs() < 1e-12);
        // Energy from the terminals is heat, work on the EMF, and magnetic energy.
        let magnetic = |i: [f64; 3]| 0.5 * w.phase_l * i.iter().map(|i| i * i).sum::<f64>();
        let given = flow.bus_charge * w.bus_v - flow.drop_j;
        let emf: f64 = (0..3).map(|k| e[k] * flow.charge[k]).sum();
        let kept = flow.copper_j + emf + magnetic(i) - magnetic(start);
        prop_assert!((given - kept).abs() < 1e-9, "{given} {kept}");
    }

    #[test]
    fn two_phase_shortcut_matches_general_solution_or_declines(
        share in 0.0..1.0_f64,
        open in any::<bool>(),
        start in -9.0..9.0_f64,
        e in [-18.0..18.0_f64, -18.0..18.0_f64, -18.0..18.0_f64],
        dt in 1e-6..100e-6_f64,
    ) {
        let w = winding();
        let first = if open { Terminal::Open } else { Terminal::Held { v: 24.0 * share, bus_share: share } };
        let decay = libm::exp(-dt / w.tau);
        let mut current = start;
        let mut pair = PairFlow::default();
        let mut i = [start, -start, 0.0];
        let mut want = Flow::default();
        w.advance(&mut i, &[first, GROUND, Terminal::Open], e, dt, decay, &mut want);
        if w.advance_pair(&mut current, first, e, dt, decay, &mut pair) {
            let mut flow = Flow::default();
            flow.add_pair(0, 1, &pair, w.phase_r);
            prop_assert!((i[0] - current).abs() < 1e-9 && (i[1] + current).abs() < 1e-9 && i[2] == 0.0);
            prop_assert!((flow.charge[0] - want.charge[0]).abs() < 1e-12);
            prop_assert!((flow.bus_charge - want.bus_charge).abs() < 1e-12);
            prop_assert!((flow.copper_j - want.copper_j).abs() < 1e-9);
            prop_assert!((flow.drop_j - want.drop_j).abs() < 1e-9);
        } else {
            prop_assert_eq!(current, start);
        }
    }
}
