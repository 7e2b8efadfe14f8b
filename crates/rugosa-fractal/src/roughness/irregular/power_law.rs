//! Power law with sensor noise, fitted to the moments of bins with correlated errors.
//!
//! Model of a raw second moment: S² = σ² d^{2H} + ν. The errors are those of the on-board
//! fit (a random walk over distance, common to neighbouring bins, plus the pairs' own
//! scatter; see `roughness/fit.rs`), with the bins' pair counts and the region's side. The
//! noise moment ν = 2 n² is known, or a third unknown, not below zero. Maximum likelihood
//! under that error model by damped Gauss–Newton steps from several starts.
//!
//! A joint fit of noise is unsafe where H is small: d^{2H} then looks like a constant.
//! The standard error says so.

use super::Noise;
use super::pairs::Sums;
use crate::roughness::Reason;
use crate::roughness::estimate::Method;

/// One bin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// root mean square distance \[m\]
    pub distance: f64,
    /// relative variance of the squared distances
    pub spread: f64,
    /// raw second moment, π/2 E² with Yokoya's method \[m²\]
    pub raw: f64,
    /// number of pairs
    pub pairs: f64,
    /// variance of raw / its mean from the pairs' own scatter
    scatter: f64,
}

impl Observation {
    /// The moments of an annulus of this width \[m\].
    pub fn new(sums: &Sums, width: f64, method: Method) -> Self {
        let square = sums.distance / sums.pairs;
        let mean = sums.absolute / sums.pairs;
        let (raw, variance) = match method {
            Method::Pentland => (sums.square / sums.pairs, 2.0),
            Method::Yokoya => (core::f64::consts::FRAC_PI_2 * mean * mean, 2.283),
        };
        Observation {
            distance: libm::sqrt(square),
            spread: width * width / (3.0 * square),
            raw,
            pairs: sums.pairs,
            scatter: SHARED_SAMPLES * variance / sums.pairs,
        }
    }

    fn effective(&self, hurst: f64) -> f64 {
        libm::log(self.distance) + 0.25 * (hurst.clamp(0.0, 1.0) - 1.0) * self.spread
    }
}

/// Pairs that share a point are not independent: their mean scatters this much more.
const SHARED_SAMPLES: f64 = 1.3;

/// ln(S² − ν) = level + 2 H ln d.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// ln σ²
    pub level: f64,
    /// H
    pub hurst: f64,
    /// n², the variance of a height by noise \[m²\]
    pub noise: f64,
    /// standard error of H
    pub standard_error: f64,
    /// rms of ln σ(d) around the line
    pub residual: f64,
    /// −2 ln likelihood
    cost: f64,
}

/// A fitted noise must raise 2 ln likelihood by this much, else it is none (one-sided 95 %):
/// a noise that can only be positive would otherwise bias rough surfaces.
const SIGNIFICANT: f64 = 2.7;

const ROUNDS: usize = 40;
const STARTS: [f64; 3] = [0.0, 0.5, 0.9];

impl Fit {
    /// The best fit to the bins of a region of `side` \[m\]; at least three bins.
    pub fn new(bins: &[Observation], side: f64, noise: Noise) -> Result<Self, Reason> {
        if bins.len() < 3 {
            return Err(Reason::TooFewPairs);
        }
        let least = bins
            .iter()
            .fold(f64::INFINITY, |least, bin| least.min(bin.raw));
        let fits = |free: bool, nu: f64| Problem { bins, side, free }.solve(nu);
        let best = match noise {
            Noise::Known(std) => fits(false, 2.0 * std * std),
            Noise::Fitted => STARTS.iter().map(|share| fits(true, share * least)).fold(
                fits(false, 0.0),
                |a, b| match (a, b) {
                    (Some(a), Some(b)) => Some(
                        if b.cost < a.cost - if a.noise == 0.0 { SIGNIFICANT } else { 0.0 } {
                            b
                        } else {
                            a
                        },
                    ),
                    (a, b) => a.or(b),
                },
            ),
        };
        best.ok_or(Reason::Noise)
    }

    /// Does this bin's scatter leave its corrected moment known within 10 %?
    pub fn is_sure_of(&self, bin: &Observation) -> bool {
        let value = bin.raw - 2.0 * self.noise;
        value > 0.0 && bin.scatter * bin.raw * bin.raw < 0.1 * 0.1 * value * value
    }

    /// rms of ln σ(d) that the error model expects around the true line.
    pub fn expected_residual(&self, bins: &[Observation], side: f64) -> f64 {
        let walk = |bin: &Observation| walk_variance(self.hurst, bin.distance / side);
        let variance = |bin: &Observation| {
            let model = libm::exp(self.level + 2.0 * self.hurst * bin.effective(self.hurst));
            let noisy = 1.0 + 2.0 * self.noise / model;
            walk(bin) - walk(&bins[0]) + bin.scatter * noisy * noisy
        };
        0.5 * libm::sqrt(bins.iter().map(variance).sum::<f64>() / bins.len() as f64)
    }
}

/// Variance of V/m at the distance d = part · side, beyond what is common to all.
fn walk_variance(hurst: f64, part: f64) -> f64 {
    let exponent = 1.5 - (hurst - 0.5).clamp(0.0, 0.45);
    (0.8 * hurst - 0.04).clamp(0.02, 0.58) * libm::pow(part, exponent)
}

struct Problem<'a> {
    bins: &'a [Observation],
    side: f64,
    /// is ν an unknown?
    free: bool,
}

#[derive(Clone, Copy)]
struct State {
    level: f64,
    hurst: f64,
    nu: f64,
}

impl Problem<'_> {
    fn solve(&self, nu: f64) -> Option<Fit> {
        let mut state = self.start(nu)?;
        for _ in 0..ROUNDS {
            let step = self.normal(&state).solve(self.free)?;
            state.level += step[0];
            state.hurst = (state.hurst + step[1].clamp(-0.2, 0.2)).clamp(-0.5, 1.5);
            if self.free {
                state.nu = (state.nu + step[2]).max(0.0);
            }
            if step[0].abs() + step[1].abs() < 1e-9 {
                break;
            }
        }
        let normal = self.normal(&state);
        Some(Fit {
            level: state.level,
            hurst: state.hurst,
            noise: 0.5 * state.nu,
            standard_error: normal.standard_error(self.free && state.nu > 0.0)?,
            residual: self.residual(&state),
            cost: normal.cost,
        })
    }

    /// A line through the first and the last bin that stand out of the noise.
    fn start(&self, nu: f64) -> Option<State> {
        let mut above = self.bins.iter().filter(|bin| bin.raw > nu);
        let (first, last) = (above.next()?, above.next_back()?);
        let [y0, y1] = [first, last].map(|bin| libm::log(bin.raw - nu));
        let [x0, x1] = [first, last].map(|bin| bin.effective(0.5));
        let hurst = (0.5 * (y1 - y0) / (x1 - x0)).clamp(0.05, 0.95);
        Some(State {
            level: y1 - 2.0 * hurst * x1,
            hurst,
            nu,
        })
    }

    fn normal(&self, state: &State) -> Normal {
        let mut walk = Walk::default();
        let mut normal = Normal::default();
        let mut before = walk_variance(state.hurst, self.bins[0].distance / self.side);
        for bin in self.bins {
            let x = 2.0 * bin.effective(state.hurst);
            let model = libm::exp(state.level + state.hurst * x);
            let noisy = 1.0 + state.nu / model;
            let excess = ((bin.raw - state.nu) / model - 1.0).clamp(-2.0, 2.0);
            let series = [excess, 1.0, x, 1.0 / model];
            let variance = walk_variance(state.hurst, bin.distance / self.side);
            let (innovation, weight) =
                walk.innovation(series, variance - before, bin.scatter * noisy * noisy);
            before = variance;
            normal.add(innovation, weight, model);
        }
        normal
    }

    fn residual(&self, state: &State) -> f64 {
        let square = |bin: &Observation| {
            let model = libm::exp(state.level + 2.0 * state.hurst * bin.effective(state.hurst));
            let part = model / (model + state.nu);
            let off = 0.5 * ((bin.raw - state.nu) / model - 1.0);
            (part * part * off * off, part * part)
        };
        let sums = self
            .bins
            .iter()
            .map(square)
            .fold((0.0, 0.0), |s, v| (s.0 + v.0, s.1 + v.1));
        libm::sqrt(sums.0 / sums.1)
    }
}

/// The Kalman filter of a random walk seen with white noise, for four series at once.
#[derive(Default)]
struct Walk {
    mean: [f64; 4],
    variance: f64,
}

impl Walk {
    fn innovation(&mut self, series: [f64; 4], step: f64, scatter: f64) -> ([f64; 4], f64) {
        self.variance += step;
        let weight = 1.0 / (self.variance + scatter);
        let innovation = core::array::from_fn(|i| series[i] - self.mean[i]);
        let gain = self.variance * weight;
        for (mean, new) in self.mean.iter_mut().zip(innovation) {
            *mean += gain * new;
        }
        self.variance *= scatter * weight;
        (innovation, weight)
    }
}

/// A standard error of H above this says nothing.
const WORST: f64 = 0.5;

/// Normal equations for the steps of level, hurst and ν.
#[derive(Default)]
struct Normal {
    matrix: [[f64; 3]; 3],
    right: [f64; 3],
    cost: f64,
}

impl Normal {
    fn add(&mut self, [y, a, b, c]: [f64; 4], weight: f64, model: f64) {
        let row = [a, b, c];
        for i in 0..3 {
            self.right[i] += weight * row[i] * y;
            for j in 0..3 {
                self.matrix[i][j] += weight * row[i] * row[j];
            }
        }
        self.cost += weight * y * y - libm::log(weight) + 2.0 * libm::log(model);
    }

    /// The inverse, of the first two unknowns only if the third is fixed.
    fn inverse(&self, three: bool) -> Option<nalgebra::Matrix3<f64>> {
        let m = nalgebra::Matrix3::from_fn(|i, j| {
            let fixed = !three && (i == 2 || j == 2);
            if fixed {
                f64::from(u8::from(i == j))
            } else {
                self.matrix[i][j]
            }
        });
        // scaled to a unit diagonal: ν may be of any size
        let s = m.diagonal().map(|d| 1.0 / libm::sqrt(d));
        let scaled = nalgebra::Matrix3::from_fn(|i, j| m[(i, j)] * s[i] * s[j]);
        let inverse = scaled.try_inverse()?;
        Some(nalgebra::Matrix3::from_fn(|i, j| {
            inverse[(i, j)] * s[i] * s[j]
        }))
    }

    fn solve(&self, three: bool) -> Option<[f64; 3]> {
        let mut right = nalgebra::Vector3::from(self.right);
        right[2] *= f64::from(u8::from(three));
        let step = self.inverse(three)? * right;
        step.iter().all(|v| v.is_finite()).then(|| step.into())
    }

    fn standard_error(&self, three: bool) -> Option<f64> {
        let variance = self.inverse(three)?[(1, 1)];
        (variance > 0.0 && variance < WORST * WORST).then(|| libm::sqrt(variance))
    }
}
