//! Scratch.
use hil_sim::*;
use tater_wire::Node as Id;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    if a.len() == 2 && a[1].ends_with("csv") {
        return file(&a[1]);
    }
    let kind = match a.get(1).map(|s| s.as_str()) {
        Some("spread") => MotorKind::Spread,
        Some("tip") => MotorKind::Tip,
        _ => MotorKind::Link,
    };
    let from: u64 = a.get(2).and_then(|x| x.parse().ok()).unwrap_or(0);
    let n: u64 = a.get(3).and_then(|x| x.parse().ok()).unwrap_or(1);
    let mut cover = [0; 5];
    let mut worst = [0f64; 5];
    let mut sums = [0f64; 5];
    for seed in from..from + n {
        let plant = plant::PlantParams::for_motor(kind).scattered(seed, if seed == 0 { 0.0 } else { 0.3 });
        let plant = if seed == 0 { plant::PlantParams::for_motor(kind) } else { plant };
        let mut rigp = rig::RigParams::default();
        if seed > 0 {
            use rand::RngExt;
            let mut rng = rand_pcg::Pcg64Mcg::new(u128::from(seed) << 64 | 0xa11);
            for e in &mut rigp.hall_error_deg {
                *e = rng.random_range(-10.0..=10.0);
            }
        }
        let mean = rigp.hall_error_deg.iter().sum::<f64>() / 6.0;
        let heat = plant::Heat { winding_c: 25.0, housing_c: 25.0 };
        let start = plant::Start { count: 60.0, counts_per_s: 0.0, heat };
        let r = rig::Rig::new(plant.clone(), rigp.clone(), &[], Model::Averaged, start, seed).unwrap();
        let id = Id::new(node_of(kind)).unwrap();
        let node = node::Node::awake(board::SimBoard::new(r, id));
        let mut b = bus::Bus::new(vec![node]);
        b.plug_host("x", bus::Adapter::default()).unwrap();
        let mut link = Traced { bus: b, samples: vec![], last: 0 };
        let rows = match excite::excite(&mut link, id, &mut |_| {}) {
            Ok(r) => r,
            Err(e) => {
                println!("{seed}: {e:?}");
                continue;
            }
        };
        let csv = excite::csv(&rows);
        let rows = rows.rows;
        std::fs::write("/tmp/ident-trace.csv", &csv).unwrap();
        let mut tr = trace::Trace::new(kind, 19_000);
        for s in &link.samples {
            tr.record(s);
        }
        let mut out = vec![];
        trace::write_csv(&mut out, &[tr]).unwrap();
        std::fs::write("/tmp/ident-full.csv", &out).unwrap();
        let csv = if std::env::var("FULL").is_ok() { String::from_utf8(out).unwrap() } else { csv };
        let rec = identify::Recording::parse("x.csv", &csv, Some(kind)).unwrap_or_else(|e| panic!("{e}"));
        let t0 = std::time::Instant::now();
        let f = identify::identify(&rec);
        let truth = [plant.r_ohm, plant.ke_v_s, plant.j_kg_m2, plant.coulomb_n_m, plant.viscous_n_m_s];
        let est = [f.r_ohm, f.ke_v_s, f.j_kg_m2, f.coulomb_n_m, f.viscous_n_m_s];
        print!(
            "{seed} {:.1}s rows {} {:.1}s ",
            rows.last().unwrap().time_ms / 1e3,
            rows.len(),
            t0.elapsed().as_secs_f64()
        );
        for (i, (e, t)) in est.iter().zip(truth).enumerate() {
            let err = 100.0 * (e.value / t - 1.0);
            let inside = e.low <= t && t <= e.high;
            cover[i] += inside as u32;
            worst[i] = worst[i].max(err.abs());
            sums[i] += err;
            print!(" {err:+.2}%±{:.2}{}", 50.0 * (e.high - e.low) / t, if inside { "" } else { "!" });
        }
        let he: f64 = f
            .hall_error_deg
            .iter()
            .zip(rigp.hall_error_deg)
            .map(|(e, t)| (e.value - t + mean).abs())
            .fold(0.0, f64::max);
        println!(
            " delay {:.2}±{:.2} hall {he:.2}±{:.2} V{:.1}",
            f.delay_ms.value,
            f.delay_ms.high - f.delay_ms.value,
            f.hall_error_deg[0].high - f.hall_error_deg[0].value,
            plant.bus_v
        );
    }
    println!("cover {cover:?} worst {worst:.2?} mean {:.2?}", sums.map(|s| s / n as f64));
}
#[allow(dead_code)]
fn file(path: &str) {
    let csv = std::fs::read_to_string(path).unwrap();
    let rec = identify::Recording::parse("x.csv", &csv, None).unwrap_or_else(|e| panic!("{e}"));
    let f = identify::identify(&rec);
    for e in [f.r_ohm, f.ke_v_s, f.j_kg_m2, f.coulomb_n_m, f.viscous_n_m_s, f.delay_ms] {
        println!("{:.6e} {:.3e} {:.3e} {}", e.value, e.low, e.high, e.is_determined);
    }
    for r in &f.residuals.edge_counts {
        println!("edge {:.2} {:.3}", r.0, r.1);
    }
    for r in &f.residuals.bus_a {
        println!("bus {:.2} {:.4}", r.0, r.1);
    }
}
struct Traced {
    bus: bus::Bus<node::Node>,
    samples: Vec<node::Sample>,
    last: u64,
}
impl excite::Link for Traced {
    fn now_us(&self) -> u64 {
        self.bus.now_us()
    }
    fn send(&mut self, f: &tater_wire::Frame) -> Result<(), String> {
        self.bus.send(*f).map_err(|e| e.to_string())
    }
    fn receive(&mut self, until: u64) -> Result<Option<(u64, tater_wire::Frame)>, String> {
        loop {
            let next = (self.bus.now_us() / 1000 + 1) * 1000;
            let r = self.bus.wait(until.min(next));
            let ms = self.bus.now_us() / 1000;
            if ms > self.last && self.bus.now_us() % 1000 == 0 {
                self.last = ms;
                if let Some(s) = self.bus.stations().next().unwrap().sample() {
                    self.samples.push(s);
                }
            }
            if r.is_some() || self.bus.now_us() >= until {
                return Ok(r.map(|s| (s.at_us, s.frame)));
            }
        }
    }
    fn is_interrupted(&self) -> bool {
        false
    }
}
