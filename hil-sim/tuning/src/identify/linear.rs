//! Least squares of a few unknowns: normal equations and their inverse.

/// Sums of a weighted least-squares problem in groups (clusters) of rows that share their errors.
#[derive(Clone, Debug)]
pub struct Normal {
    size: usize,
    /// Aᵀ·W·A, row by row.
    square: Vec<f64>,
    /// Aᵀ·W·y.
    right: Vec<f64>,
    /// Rows of A with weight and y, by group.
    groups: Vec<Vec<(Vec<f64>, f64, f64)>>,
}

/// A solution.
#[derive(Clone, Debug)]
pub struct Solution {
    /// The unknowns.
    pub x: Vec<f64>,
    /// Their covariance, row by row: the sandwich estimator over the groups, so that errors may be correlated and of any size within a
    /// group.
    pub covariance: Vec<f64>,
}

impl Normal {
    /// No rows yet; `size` unknowns.
    pub fn new(size: usize) -> Self {
        Self { size, square: vec![0.0; size * size], right: vec![0.0; size], groups: Vec::new() }
    }

    /// Adds `weight`·(y − row·x)² to what is minimized.
    fn count(&mut self, row: &[f64], weight: f64, y: f64) {
        for (i, a) in row.iter().enumerate() {
            self.right[i] += weight * a * y;
            for (j, b) in row.iter().enumerate() {
                self.square[i * self.size + j] += weight * a * b;
            }
        }
    }

    /// Adds a group of rows: coefficients, weight and y.
    pub fn group(&mut self, rows: Vec<(Vec<f64>, f64, f64)>) {
        for (row, weight, y) in &rows {
            self.count(row, *weight, *y);
        }
        self.groups.push(rows);
    }

    /// Adds a prior on an unknown: it is `y` ± `sigma`.
    pub(crate) fn prior(&mut self, index: usize, y: f64, sigma: f64) {
        let mut row = vec![0.0; self.size];
        row[index] = 1.0;
        self.count(&row, 1.0 / (sigma * sigma), y);
    }

    /// The solution; `None` if the rows do not determine the unknowns.
    pub(crate) fn solve(&self) -> Option<Solution> {
        let n = self.size;
        let inverse = inverse(&self.square, n)?;
        let x: Vec<f64> = (0..n).map(|i| (0..n).map(|j| inverse[i * n + j] * self.right[j]).sum()).collect();
        let mut meat = vec![0.0; n * n];
        for group in &self.groups {
            let mut score = vec![0.0; n];
            for (row, weight, y) in group {
                let residual = y - row.iter().zip(&x).map(|(a, x)| a * x).sum::<f64>();
                for (sum, a) in score.iter_mut().zip(row) {
                    *sum += weight * residual * a;
                }
            }
            for i in 0..n {
                for j in 0..n {
                    meat[i * n + j] += score[i] * score[j];
                }
            }
        }
        // The usual correction for few groups.
        let groups = self.groups.len() as f64;
        let factor = groups / (groups - n as f64).max(1.0);
        let product = |a: &[f64], b: &[f64]| -> Vec<f64> {
            (0..n * n).map(|at| (0..n).map(|k| a[at / n * n + k] * b[k * n + at % n]).sum()).collect()
        };
        let sandwich = product(&product(&inverse, &meat), &inverse);
        Some(Solution { x, covariance: sandwich.iter().map(|value| value * factor).collect() })
    }
}

impl Solution {
    /// Standard deviation of an unknown.
    pub fn sigma(&self, index: usize) -> f64 {
        self.covariance[index * self.x.len() + index].max(0.0).sqrt()
    }

    /// Variance of a linear combination of the unknowns.
    pub fn variance(&self, of: &[f64]) -> f64 {
        let n = self.x.len();
        let sum: f64 = (0..n * n).map(|at| of[at / n] * of[at % n] * self.covariance[at]).sum();
        sum.max(0.0)
    }
}

/// Inverse of a symmetric positive definite matrix by Gauss-Jordan elimination of the matrix scaled to a unit diagonal; `None` if it is
/// nearly singular.
fn inverse(matrix: &[f64], n: usize) -> Option<Vec<f64>> {
    let scale: Vec<f64> = (0..n).map(|i| matrix[i * n + i].sqrt()).collect();
    // A root of a negative number is no number.
    if scale.iter().any(|scale| scale.is_nan() || *scale <= 0.0) {
        return None;
    }
    let mut a: Vec<f64> = (0..n * n).map(|at| matrix[at] / (scale[at / n] * scale[at % n])).collect();
    let mut b: Vec<f64> = (0..n * n).map(|at| f64::from(u8::from(at / n == at % n))).collect();
    for column in 0..n {
        let pivot = (column..n).max_by(|i, j| a[i * n + column].abs().total_cmp(&a[j * n + column].abs()))?;
        let value = a[pivot * n + column];
        if value.abs() < 1e-12 {
            return None;
        }
        for k in 0..n {
            a.swap(pivot * n + k, column * n + k);
            b.swap(pivot * n + k, column * n + k);
            a[column * n + k] /= value;
            b[column * n + k] /= value;
        }
        for row in (0..n).filter(|row| *row != column) {
            let factor = a[row * n + column];
            for k in 0..n {
                a[row * n + k] -= factor * a[column * n + k];
                b[row * n + k] -= factor * b[column * n + k];
            }
        }
    }
    Some((0..n * n).map(|at| b[at] / (scale[at / n] * scale[at % n])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn line_through_points_is_found_with_its_error() {
        let mut normal = Normal::new(2);
        for group in 0..10 {
            let rows = (0..10).map(|point| {
                let t = f64::from(10 * group + point);
                // Errors of a group have one sign.
                let error = if group % 2 == 0 { 0.1 } else { -0.1 };
                (vec![1.0, t], 1.0, 3.0 + 0.5 * t + error)
            });
            normal.group(rows.collect());
        }
        let solution = normal.solve().expect("determined");
        assert!((solution.x[1] - 0.5).abs() < 2e-3 && (solution.x[0] - 3.0).abs() < 0.1, "{solution:?}");
        // Independent errors would give 0.1 / (100 * 29²)^(1/2).
        assert!(solution.sigma(1) > 3.4e-4 && solution.sigma(1) < 3e-3, "{}", solution.sigma(1));
    }

    #[test]
    fn unknown_without_effect_is_not_determined() {
        let mut normal = Normal::new(2);
        normal.group((0..10).map(|t| (vec![f64::from(t), 2.0 * f64::from(t)], 1.0, 1.0)).collect());
        assert!(normal.solve().is_none());
    }
}
