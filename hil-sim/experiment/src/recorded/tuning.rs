//! The estimator's constants.

use super::real::Real;

/// Constants of the estimator. Other settings than the default serve to show how much depends on them.
#[derive(Clone, Copy, Debug)]
pub struct Tuning {
    /// q of the four models, (counts/s²)²·s.
    pub accelerations: [Real; 4],
    /// r of the four models, counts.
    pub deviations: [Real; 4],
    /// Probability that a model stays itself at an edge.
    pub stay: Real,
    /// Time after which stopped and running are as likely, seconds.
    pub run: Real,
    /// Deviation of the velocity at the first edge, counts/s; half of it is the mean.
    pub first_speed: Real,
    /// Variance of a cell's width before it is learned, counts².
    pub width_variance: Real,
    /// Variance of a cell's cogging before it is learned, (counts/s)^4.
    pub cogging_variance: Real,
    /// Growth of that variance with each visit.
    pub cogging_growth: Real,
    /// k, by which residuals of a lap count as noise.
    pub residual_factor: Real,
    /// R, the memory of residuals in edges.
    pub residual_memory: Real,
    /// The memory of scores in edges.
    pub score_memory: Real,
    /// A pattern is used if it scores better than a shorter one or none by this factor.
    pub better: Real,
}

impl Tuning {
    /// The one setting of all figures in `docs/estimation.md`.
    pub(crate) const DEFAULT: Self = Self {
        accelerations: [real!("1700"), real!("40000"), real!("1700"), real!("2000000")],
        deviations: [real!("0.0125"), real!("0.0125"), real!("0.2"), real!("0.2")],
        stay: real!("0.995"),
        run: real!("0.5"),
        first_speed: real!("56"),
        width_variance: real!("0.0324"),
        cogging_variance: real!("90000"),
        cogging_growth: real!("4200"),
        residual_factor: real!("8"),
        residual_memory: real!("300"),
        score_memory: real!("90"),
        better: real!("0.87"),
    };
}
