//! Is there noise? Two answers, weighed by how likely each is.
//!
//! On rough ground d^{2H} is nearly a constant, as noise is: "no noise" and "some noise" can
//! fit a structure function equally well with dimensions that are 0.06 apart. Choosing one
//! of them is wrong by that much now and then, and its standard error knows nothing of the
//! other. The average over both, each with the probability that the data gives it
//! (Hoeting et al. 1999, *Bayesian model averaging: a tutorial*, eqs 1 to 4), errs less,
//! and its variance holds their difference.
//!
//! Each answer is taken as the normal distribution around its peak (Laplace), that with
//! noise cut off where noise would be negative.

use core::f64::consts::{FRAC_1_SQRT_2, PI};
use nalgebra::{Matrix3, Vector3};

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
}

/// A standard error of H above this says nothing.
const WORST: f64 = 0.5;

impl Peak {
    /// Standard error of H, if it says anything.
    pub fn standard_error(&self) -> Option<f64> {
        let variance = self.covariance[(1, 1)];
        (variance > 0.0 && variance < WORST * WORST).then(|| libm::sqrt(variance))
    }
}

/// Odds of noise where it explains the data no better. A free parameter raises the
/// likelihood by e^½ even where there is none, so that Akaike's weights (Burnham & Anderson
/// 2002, *Model selection and multimodel inference*, § 2.9) would have e^−1 = 0.37 here.
/// Sensors whose noise reaches what rough ground does from lag to lag are rarer: measured
/// over D = 2.1 … 2.9, 0.04 errs more where there is noise, 0.3 where there is none.
const ODDS_BEFORE: f64 = 0.1;

/// Mean and covariance over "no noise" and "some noise".
pub fn average(none: &Peak, some: &Peak) -> Peak {
    let positive = Positive::new(some);
    let odds = ODDS_BEFORE * positive.evidence(none);
    let weight = 1.0 / (1.0 + 1.0 / odds);
    let none_at = Vector3::new(none.state.level, none.state.hurst, 0.0);
    let apart = positive.mean - none_at;
    let mean = none_at + apart * weight;
    let mut without = none.covariance;
    without[(2, 2)] = 0.0;
    Peak {
        state: State {
            level: mean[0],
            hurst: mean[1],
            nu: mean[2],
        },
        step: [0.0; 3],
        covariance: without * (1.0 - weight)
            + positive.covariance * weight
            + apart * apart.transpose() * (weight * (1.0 - weight)),
        cost: none.cost.min(some.cost),
        gain: 0.0,
    }
}

/// A peak that lies at a ν of so many standard deviations has no part where ν > 0.
const LEAST: f64 = -5.0;

/// The part of a normal distribution where ν > 0.
struct Positive {
    mean: Vector3<f64>,
    covariance: Matrix3<f64>,
    /// −2 ln likelihood of the peak, even where that is cut off
    cost: f64,
    /// of the uncut distribution
    share: f64,
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
        let left = 1.0 - hazard * (hazard + above);
        Positive {
            mean: centre + along * hazard,
            covariance: full - along * along.transpose() * (1.0 - left),
            cost: peak.cost - peak.gain,
            share: if above > LEAST { share } else { 0.0 },
        }
    }

    /// Likelihood with noise / that without, by the best of each.
    fn evidence(&self, none: &Peak) -> f64 {
        libm::exp(0.5 * (none.cost - self.cost)) * self.share
    }
}
