//! The laws of the estimator between hall edges (`servo-core/src/sense/observer.rs`) against their formulas.

use crate::fences::root;

/// The integers of a table in the observer's source, in their order.
fn table(name: &str) -> Vec<f64> {
    let text = std::fs::read_to_string(root().join("servo-core/src/sense/observer.rs")).expect("readable");
    let (_, rest) = text.split_once(&format!("const {name}: ")).expect("the table");
    let (_, rest) = rest.split_once(" = ").expect("its value");
    let (value, _) = rest.split_once(';').expect("its end");
    let digits = |c: char| !c.is_ascii_digit() && c != '_';
    value.split(digits).filter_map(|number| number.replace('_', "").parse().ok()).collect()
}

/// e and w of the module.
fn shapes(y: f64) -> (f64, f64) {
    let e = -(-y).exp_m1();
    // y − e of a small y has no digits left.
    (e, if y < 1e-3 { y * y / 2.0 } else { y - e })
}

#[test]
fn tables_are_those_of_their_formulas() {
    let slopes = table("SLOPES");
    assert_eq!(slopes.len(), 3 * 17);
    for (i, row) in slopes.chunks(3).enumerate() {
        let y = 0.0881 * 2_f64.powf(i as f64 / 2.0);
        let (e, w) = shapes(y);
        let exact = [4096.0 * e / w, 4096.0 / w, 65_536.0 * y / (1.0 + y)];
        for (found, exact) in row.iter().zip(exact) {
            // y is given with three digits, and 1/w goes by its square.
            assert!((found / exact - 1.0).abs() < 0.015, "entry {i}: {found} instead of {exact:.0}");
        }
    }
    let keep = table("KEEP");
    assert_eq!(keep.len(), 17);
    for (i, found) in keep.iter().enumerate() {
        let ms = 2_f64.powf(i as f64 / 2.0);
        let memory = (60.0 * (ms / 20.0).min(1.0)).max(8.0);
        let exact = 65_536.0 * (-ms / memory).exp();
        assert!((found - exact).abs() <= 2.0, "entry {i}: {found} instead of {exact:.0}");
    }
}

type Matrix = [[f64; 3]; 3];

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

/// The largest magnitude of an eigenvalue: what a high power of the matrix grows by.
fn radius(a: &Matrix) -> f64 {
    let power = (0..9).fold(*a, |power, _| product(&power, &power));
    let norm: f64 = power.iter().flatten().map(|x| x * x).sum::<f64>().sqrt();
    norm.powf(1.0 / 512.0)
}

/// What an edge leaves of an error of place, velocity and load (in units of an interval), with shares of the residual for the three.
fn left(y: f64, [place, speed, load]: [f64; 3]) -> f64 {
    let (e, w) = shapes(y);
    let drift: Matrix = [[1.0, e / y, w / (y * y)], [0.0, 1.0 - e, e / y], [0.0, 0.0, 1.0]];
    let edge: Matrix = [[1.0 - place, 0.0, 0.0], [-speed, 1.0, 0.0], [-load, 0.0, 1.0]];
    radius(&product(&edge, &drift))
}

/// The shares of the module: θ and y.
fn shares(theta: f64, y: f64) -> [f64; 3] {
    let (e, w) = shapes(y);
    let (gone, h) = (1.0 - theta, (1.0 - theta) / 2.0);
    [
        1.0 - theta.powi(3),
        gone * gone * (1.0 + theta / (2.0 * (1.0 + y))) * (e / w) * y,
        gone * gone * (h + (1.0 - h) * y / (1.0 + y)) / w * y * y,
    ]
}

/// What the module's documentation says of them.
#[test]
fn edges_damp_every_error_whatever_the_interval() {
    let intervals = || (0..40).map(|i| 0.01 * 800_f64.powf(f64::from(i) / 39.0));
    let memories = [0.3, 0.5, 0.7, 0.88];
    for (theta, y) in memories.iter().flat_map(|&theta| intervals().map(move |y| (theta, y))) {
        let radius = left(y, shares(theta, y));
        assert!(radius < 0.95, "θ {theta}, y {y:.2}: {radius:.3}");
        assert!(theta < 0.7 || radius > 0.69, "θ {theta}, y {y:.2}: {radius:.3} believes a misplaced sensor");
    }
    // Those of a motor without damping: exact for y near 0, and too slow beyond.
    let morrison = |theta: f64| {
        let gone = 1.0 - theta;
        [1.0 - theta.powi(3), 1.5 * gone * gone * (1.0 + theta), gone.powi(3)]
    };
    assert!((left(1e-9, morrison(0.7)) - 0.7).abs() < 0.03, "critically damped: all three are θ");
    assert!(left(1.0, morrison(0.88)) > 0.99);
}
