//! Is there noise? Two answers, weighed by how likely each is.
//!
//! On rough ground d^{2H} is nearly a constant, as noise is: "no noise" and "some noise" can
//! fit a structure function equally well with dimensions that are 0.06 apart. Choosing one
//! of them is wrong by that much now and then. The average over both, each with the
//! probability that the data gives it (Hoeting et al. 1999, *Bayesian model averaging: a
//! tutorial*, eqs 1 to 4), errs less.
//!
//! Each answer is taken as the normal distribution around its peak (Laplace), that with
//! noise cut off where noise would be negative.
//!
//! The standard error is how much the average itself would change with other data:
//!
//!   H = (1 − p) H₀ + p H₁,   var H = ∂H/∂y · cov y · ∂H/∂y,
//!
//! y being the data (Efron 2015, *Frequentist accuracy of Bayesian estimates*, theorem 1),
//! with the covariance that either answer gives it, weighted. The data moves the weight p,
//! too. The variance within and between the answers (Hoeting, eq. 3) is right on average
//! over all dimensions but not at one: at 20 dB and D 2.6 it is less than half of the true one.

use core::f64::consts::{FRAC_1_SQRT_2, PI};
use nalgebra::{DMatrix, DVector, Matrix3, MatrixXx3, Vector3};

/// Unknowns of the power law: S² = e^level d^{2H} + ν.
#[derive(Clone, Copy, Debug)]
pub struct State {
    /// ln σ²
    pub level: f64,
    /// H
    pub hurst: f64,
    /// moment of the noise \[m²\]
    pub nu: f64,
}

/// The unknowns and how sure H is.
pub struct Answer {
    pub state: State,
    /// of H
    pub standard_error: f64,
}

/// A standard error of H above this says nothing.
const WORST: f64 = 0.5;

impl Answer {
    /// Unless the standard error says nothing.
    fn new(state: State, variance: f64) -> Option<Self> {
        (variance > 0.0 && variance < WORST * WORST).then(|| Answer {
            state,
            standard_error: libm::sqrt(variance),
        })
    }
}

/// Raw moments relative to the model, made independent of each other with unit variance:
/// L⁻¹ (raw − ν − m) / m.
pub struct Whitened {
    /// the data and its derivatives by level, H and ν
    pub columns: DMatrix<f64>,
    /// L of the errors' covariance L Lᵀ
    pub factor: DMatrix<f64>,
    /// m \[m²\]
    pub models: DVector<f64>,
}

impl Whitened {
    /// A derivative by this data → by the raw moments.
    fn by_raw(&self, derivative: &DVector<f64>) -> DVector<f64> {
        let mut by_raw = derivative.clone();
        self.factor.tr_solve_lower_triangular_mut(&mut by_raw);
        by_raw.component_div(&self.models)
    }

    /// Variance of what has this derivative by the raw moments.
    pub fn variance(&self, by_raw: &DVector<f64>) -> f64 {
        let errors = by_raw.component_mul(&self.models);
        self.factor.tr_mul(&errors).norm_squared()
    }
}

/// A fit and the normal distribution around it.
pub struct Peak {
    /// where the search ended
    pub state: State,
    /// from there to the peak of the distribution, which may lie at a negative ν
    pub step: [f64; 3],
    /// of level, H and ν; 1 for a ν that is fixed
    pub covariance: Matrix3<f64>,
    /// −2 ln likelihood at `state`
    pub cost: f64,
    /// by which `step` would lower it
    pub gain: f64,
    /// data around `state`
    pub whitened: Whitened,
}

impl Peak {
    /// This fit alone.
    pub fn answer(&self) -> Option<Answer> {
        Answer::new(self.state, self.covariance[(1, 1)])
    }

    /// What the peak leaves of the data: half the derivative of its cost.
    fn residual(&self) -> DVector<f64> {
        let columns = &self.whitened.columns;
        columns.column(0) - columns.fixed_columns::<3>(1) * Vector3::from(self.step)
    }

    /// Derivatives of the peak's level, H and ν by the data.
    fn influence(&self) -> MatrixXx3<f64> {
        self.whitened.columns.fixed_columns::<3>(1) * self.covariance
    }
}

/// Odds of noise where it explains the data no better. A free parameter raises the
/// likelihood by e^½ even where there is none, so that Akaike's weights (Burnham & Anderson
/// 2002, *Model selection and multimodel inference*, § 2.9) would have e^−1 = 0.37 here.
/// Sensors whose noise reaches what rough ground does from lag to lag are rarer: measured
/// over D = 2.1 … 2.9, 0.04 errs more where there is noise, 0.3 where there is none.
const ODDS_BEFORE: f64 = 0.1;

/// Mean over "no noise" and "some noise", and how sure it is.
pub fn average(none: &Peak, some: &Peak) -> Option<Answer> {
    let positive = Positive::new(some);
    if positive.share == 0.0 {
        return none.answer();
    }
    let odds = ODDS_BEFORE * positive.evidence(none);
    let weight = 1.0 / (1.0 + 1.0 / odds);
    let none_at = Vector3::new(none.state.level, none.state.hurst, 0.0);
    let apart = positive.mean - none_at;
    let mean = none_at + apart * weight;
    let state = State {
        level: mean[0],
        hurst: mean[1],
        nu: mean[2],
    };
    // derivative of H by the ln odds, which are half the difference of the costs
    let by_odds = weight * (1.0 - weight) * apart[1];
    let by_none = none.influence().column(1) * (1.0 - weight) + none.residual() * by_odds;
    let by_some =
        positive.hurst_influence * weight + (positive.share_influence - some.residual()) * by_odds;
    let [none, some] = [&none.whitened, &some.whitened];
    let by_raw = none.by_raw(&by_none) + some.by_raw(&by_some);
    let variance = none.variance(&by_raw) * (1.0 - weight) + some.variance(&by_raw) * weight;
    Answer::new(state, variance)
}

/// A peak that lies at a ν of so many standard deviations has no part where ν > 0.
const LEAST: f64 = -5.0;

/// The part of a normal distribution where ν > 0.
struct Positive {
    mean: Vector3<f64>,
    /// derivative of the mean H by the data
    hurst_influence: DVector<f64>,
    /// −2 ln likelihood of the peak, even where that is cut off
    cost: f64,
    /// of the uncut distribution
    share: f64,
    /// derivative of ln share by the data
    share_influence: DVector<f64>,
}

impl Positive {
    fn new(peak: &Peak) -> Self {
        let [level, hurst, nu] = peak.step;
        let step = Vector3::new(level, hurst, nu);
        let centre = step + Vector3::new(peak.state.level, peak.state.hurst, peak.state.nu);
        let full = peak.covariance;
        let std = libm::sqrt(full[(2, 2)]);
        let above = (centre[2] / std).max(LEAST);
        let share = 0.5 * libm::erfc(-above * FRAC_1_SQRT_2);
        let hazard = libm::exp(-0.5 * above * above) / (libm::sqrt(2.0 * PI) * share);
        // the other unknowns follow ν along the regression on it
        let along = full.column(2) / std;
        let influence = peak.influence();
        let above_influence = influence.column(2) / std;
        let hazard_slope = -hazard * (hazard + above);
        Positive {
            mean: centre + along * hazard,
            hurst_influence: influence.column(1) + &above_influence * (along[1] * hazard_slope),
            cost: peak.cost - peak.gain,
            share: if above > LEAST { share } else { 0.0 },
            share_influence: above_influence * hazard,
        }
    }

    /// Likelihood with noise / that without, by the best of each.
    fn evidence(&self, none: &Peak) -> f64 {
        libm::exp(0.5 * (none.cost - self.cost)) * self.share
    }
}
