//! Power law with sensor noise, fitted to the moments of bins with correlated errors.
//!
//! Model of a raw second moment: S²_k = m_k + ν, m_k = σ² d_k^{2H}. Errors of neighbouring
//! bins are nearly the same error: a region that happens to be rough is rough at all lags.
//! What blurs the slope is how the error *changes* with the lag:
//!
//!   (S²_k − ν) / m_k − 1 = common + w_k + e_k,
//!   cov(w_j, w_k) = c/2 (u_j^b + u_k^b − |u_j − u_k|^b),   u = (d / L)^a,
//!   var e_k = s (1 + ν / m_k)² / pairs,
//!
//! with L the region's side: fractional Brownian motion over a power of the lag. On smooth
//! ground b is near 2, so the error is a smooth curve of the lag, and short lags hold far
//! more than independent errors would give them. a(H), b(H), c(H) were found by restricted
//! maximum likelihood from the moments of 120 simulated surfaces for each D = 2.1 … 2.9,
//! 13 107 points of 512² cells, lags 2–30. Against a plain random walk of the lag the
//! standard deviation of H falls by a quarter, and the stated errors come within about
//! 30 % where the noise is known (example `accuracy`).
//!
//! Noise and ground meet in all pairs of a point: one that noise lifts and that stands above
//! its surroundings anyway makes all its differences larger. (S²_k holds 4/N Σ n_i a_i(d_k),
//! a_i(d) being the height of point i above the mean of the circle d around it, and
//! E a(d)² = (1 − Γ(1 + 2H) / 2Γ²(1 + H)) m, ½ (1 − H²) m within 4 %; of two lags the
//! shorter one counts.) To the covariance of e_j and e_k that adds
//!
//!   4 (1 − H²) / N · ν / max(m_j, m_k).
//!
//! The noise moment ν = 2 n² is a third unknown, not below zero; the answers with and
//! without it are averaged (`average.rs`). Where n is known, ν of the points at hand still
//! scatters by √(2/N) of itself around it, as one error that all lags share; with much noise
//! on smooth ground that is more than the signal of short lags. The weights follow the
//! model, not the data; damped Gauss–Newton steps from several starts.
//!
//! A joint fit of noise is unsafe where H is small: d^{2H} then looks like a constant.
//! The standard error says so.

use super::Noise;
use super::average::{Answer, Peak, State, Whitened, average};
use super::pairs::Sums;
use crate::roughness::Reason;
use crate::roughness::estimate::Method;
use alloc::vec::Vec;
use nalgebra::{DMatrix, DVector};

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
    /// The moments of an annulus.
    ///
    /// ```
    /// use rugosa_fractal::roughness::Method;
    /// use rugosa_fractal::roughness::irregular::{pairs::Sums, power_law::Observation};
    /// // four pairs at 2 m with |Δz| = 0.3 m
    /// let sums = Sums { pairs: 4.0, absolute: 1.2, square: 0.36, distance: 16.0, quartic: 64.0 };
    /// let observation = Observation::new(&sums, Method::Pentland);
    /// assert_eq!((observation.distance, observation.spread), (2.0, 0.0));
    /// assert!((observation.raw - 0.09).abs() < 1e-12); // m²
    /// let first = Observation::new(&sums, Method::Yokoya).raw;
    /// assert!((first / observation.raw - core::f64::consts::FRAC_PI_2).abs() < 1e-12);
    /// ```
    pub fn new(sums: &Sums, method: Method) -> Self {
        let square = sums.distance / sums.pairs;
        let mean = sums.absolute / sums.pairs;
        let (raw, variance) = match method {
            Method::Pentland => (sums.square / sums.pairs, 2.0),
            Method::Yokoya => (core::f64::consts::FRAC_PI_2 * mean * mean, 2.283),
        };
        Observation {
            distance: libm::sqrt(square),
            spread: sums.quartic / (sums.pairs * square * square) - 1.0,
            raw,
            pairs: sums.pairs,
            scatter: OWN_SCATTER * variance / sums.pairs,
        }
    }

    fn effective(&self, hurst: f64) -> f64 {
        libm::log(self.distance) + 0.25 * (hurst.clamp(0.0, 1.0) - 1.0) * self.spread
    }
}

/// What w_k leaves of the scatter of independent pairs.
const OWN_SCATTER: f64 = 0.9;

/// What was sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// edge of the square of the same area \[m\]
    pub side: f64,
    /// number of points
    pub points: usize,
}

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
}

const ROUNDS: usize = 40;

/// Differences that grow so little with distance are noise, if noise may be: natural ground
/// has H of 0.1 and more.
const FLAT: f64 = 0.03;

/// Of H in a round; longer steps are shortened whole, or the search runs away.
const LONGEST_STEP: f64 = 0.2;

/// The shared errors are computed anew where H has changed by more.
const SAME_SHAPE: f64 = 0.003;
/// Where the search for a noise begins, as parts of the least moment: nearly all of it is noise
/// where smooth ground is seen at 13 dB.
const STARTS: [f64; 4] = [0.0, 0.5, 0.9, 0.98];

impl Fit {
    /// The best fit to the bins of a region; at least three bins.
    ///
    /// ```
    /// use rugosa_fractal::roughness::{Method, Reason, irregular::Noise};
    /// use rugosa_fractal::roughness::irregular::pairs::Sums;
    /// use rugosa_fractal::roughness::irregular::power_law::{Fit, Observation, Region};
    /// // σ = 0.1 m at 1 m, hurst 0.6, and a sensor noise of 0.05 m in both heights of a pair
    /// let bin = |d: f64| {
    ///     let (pairs, raw) = (1e6, 0.01 * d.powf(1.2) + 2.0 * 0.05f64.powi(2));
    ///     let (square, distance, quartic) = (pairs * raw, pairs * d * d, pairs * d.powi(4));
    ///     let sums = Sums { pairs, absolute: 0.0, square, distance, quartic };
    ///     Observation::new(&sums, Method::Pentland)
    /// };
    /// let bins: Vec<_> = (1..=10).map(|d| bin(f64::from(d))).collect();
    /// let region = Region { side: 100.0, points: 10_000 };
    /// let fit = Fit::new(&bins, &region, Noise::Known(0.05)).unwrap();
    /// assert!((fit.hurst - 0.6).abs() < 1e-3 && ((0.5 * fit.level).exp() - 0.1).abs() < 1e-3);
    /// assert_eq!(Fit::new(&bins[..2], &region, Noise::Known(0.05)), Err(Reason::TooFewPairs));
    /// ```
    pub fn new(bins: &[Observation], region: &Region, noise: Noise) -> Result<Self, Reason> {
        if bins.len() < 3 {
            return Err(Reason::TooFewPairs);
        }
        let best = match noise {
            Noise::Known(std) => known_noise(bins, region, std),
            Noise::Fitted => fitted_noise(bins, region),
        };
        let fit = |Answer {
                       state,
                       standard_error,
                   }| Fit {
            level: state.level,
            hurst: state.hurst,
            noise: 0.5 * state.nu,
            standard_error,
            residual: residual(bins, &state),
        };
        best.map(fit).ok_or(Reason::Noise)
    }

    /// Does this bin's scatter leave its corrected moment known within 10 %?
    pub fn is_sure_of(&self, bin: &Observation) -> bool {
        let value = bin.raw - 2.0 * self.noise;
        value > 0.0 && bin.scatter * bin.raw * bin.raw < 0.1 * 0.1 * value * value
    }

    /// rms of ln σ(d) that the error model expects around the true line.
    pub fn expected_residual(&self, bins: &[Observation], side: f64) -> f64 {
        let shared = Shared::new(self.hurst, bins[0].distance, side);
        let lags: Vec<f64> = bins.iter().map(|bin| shared.warped(bin.distance)).collect();
        let variance = |(bin, &lag): (&Observation, &f64)| {
            let model = libm::exp(self.level + 2.0 * self.hurst * bin.effective(self.hurst));
            let noisy = 1.0 + 2.0 * self.noise / model;
            shared.difference(lag, lags[0]) + bin.scatter * noisy * noisy
        };
        let sum: f64 = bins.iter().zip(&lags).map(variance).sum();
        0.5 * libm::sqrt(sum / bins.len() as f64)
    }
}

/// The moment of a known noise scatters around what is known.
fn known_noise(bins: &[Observation], region: &Region, std: f64) -> Option<Answer> {
    let nu = 2.0 * std * std;
    let problem = Problem {
        bins,
        region,
        known: nu * libm::sqrt(2.0 / region.points as f64),
    };
    problem.solve(nu)?.answer()
}

/// The average over what there is of no noise and some noise.
fn fitted_noise(bins: &[Observation], region: &Region) -> Option<Answer> {
    let answer = match (no_noise(bins, region), some_noise(bins, region)) {
        (Some(none), Some(some)) => average(&none, &some),
        (none, some) => none.or(some)?.answer(),
    };
    answer.filter(|answer| answer.state.hurst > FLAT)
}

fn no_noise(bins: &[Observation], region: &Region) -> Option<Peak> {
    let problem = Problem {
        bins,
        region,
        known: 0.0,
    };
    problem.solve(0.0)
}

/// The best of the searches from several noises.
fn some_noise(bins: &[Observation], region: &Region) -> Option<Peak> {
    let problem = Problem {
        bins,
        region,
        known: f64::INFINITY,
    };
    let raw = bins.iter().map(|bin| bin.raw);
    let least = raw.fold(f64::INFINITY, f64::min);
    let found = STARTS
        .iter()
        .filter_map(|share| problem.solve(share * least));
    found.reduce(|a, b| if b.cost < a.cost { b } else { a })
}

/// The error that neighbouring lags share, for one Hurst exponent.
struct Shared {
    side: f64,
    warp: f64,
    exponent: f64,
    size: f64,
}

impl Shared {
    /// The size was found where the side is 244 first lags; at other sides it follows the
    /// variance of moments over a region, which falls like side^−min(2, 4 − 4H).
    fn new(hurst: f64, first_lag: f64, side: f64) -> Self {
        let h = hurst.clamp(0.05, 0.95);
        let warp = 0.60 * libm::exp(-1.67 * (h - 0.5).max(0.0));
        let exponent = 2.0 - libm::exp(0.38 - 4.88 * h).clamp(0.01, 1.0);
        let further = (4.0 - 4.0 * h).min(2.0) - warp * exponent;
        Shared {
            side,
            warp,
            exponent,
            size: libm::exp(-6.83 + 14.66 * h - 8.32 * h * h)
                * libm::pow(244.0 * first_lag / side, further.max(0.0)),
        }
    }

    /// u
    fn warped(&self, distance: f64) -> f64 {
        libm::pow(distance / self.side, self.warp)
    }

    /// Variance of the difference of the errors at two warped lags.
    fn difference(&self, a: f64, b: f64) -> f64 {
        self.size * libm::pow((a - b).abs(), self.exponent)
    }

    /// Covariances relative to the first lag's error, which is common to all.
    fn covariance(&self, bins: &[Observation]) -> DMatrix<f64> {
        let lags: Vec<f64> = bins.iter().map(|bin| self.warped(bin.distance)).collect();
        let first: Vec<f64> = lags.iter().map(|&u| self.difference(u, lags[0])).collect();
        let mut matrix = DMatrix::zeros(bins.len(), bins.len());
        for i in 0..bins.len() {
            for j in 0..=i {
                let shared = 0.5 * (first[i] + first[j] - self.difference(lags[i], lags[j]));
                matrix[(i, j)] = shared;
                matrix[(j, i)] = shared;
            }
        }
        matrix
    }
}

struct Problem<'a> {
    bins: &'a [Observation],
    region: &'a Region,
    /// standard deviation of ν around its start: 0 where it is fixed, ∞ where it is free
    known: f64,
}

impl Problem<'_> {
    fn solve(&self, nu: f64) -> Option<Peak> {
        let free = self.known > 0.0;
        let mut state = self.start(nu)?;
        let (mut shared, mut at) = (self.shared(&state), state.hurst);
        for _ in 0..ROUNDS {
            if (state.hurst - at).abs() > SAME_SHAPE {
                (shared, at) = (self.shared(&state), state.hurst);
            }
            let step = self.normal(&state, &shared, nu)?.step(&state, free)?;
            let share = (LONGEST_STEP / step[1].abs()).min(1.0);
            state.level += share * step[0];
            state.hurst = (state.hurst + share * step[1]).clamp(-0.5, 1.5);
            if free {
                state.nu = (state.nu + share * step[2]).max(0.0);
            }
            if step[0].abs() + step[1].abs() < 1e-7 {
                break;
            }
        }
        let normal = self.normal(&state, &shared, nu)?;
        let step = if state.nu > 0.0 {
            [0.0; 3]
        } else {
            normal.solve(free)?
        };
        let gain: f64 = step.iter().zip(normal.right).map(|(s, r)| s * r).sum();
        let peak = Peak {
            state,
            step,
            covariance: normal.inverse(free)?,
            cost: normal.cost,
            gain,
            whitened: normal.whitened,
        };
        peak.answer().map(|_| peak)
    }

    fn shared(&self, state: &State) -> DMatrix<f64> {
        Shared::new(state.hurst, self.bins[0].distance, self.region.side).covariance(self.bins)
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

    /// Covariance where noise and ground meet × m of the longer lag \[m²\].
    fn crossed(&self, state: &State) -> f64 {
        let h = state.hurst.clamp(0.0, 1.0);
        4.0 * (1.0 - h * h) * state.nu / self.region.points as f64
    }

    /// Errors and derivatives, made independent of each other by the covariance's factor.
    /// A known ν is one more observation.
    fn normal(&self, state: &State, shared: &DMatrix<f64>, nu: f64) -> Option<Normal> {
        let mut covariance = shared.clone();
        let mut columns = DMatrix::zeros(self.bins.len(), 4);
        let mut models = DVector::zeros(self.bins.len());
        let mut cost = 0.0;
        let crossed = self.crossed(state);
        for (i, bin) in self.bins.iter().enumerate() {
            let x = 2.0 * bin.effective(state.hurst);
            let model = libm::exp(state.level + state.hurst * x);
            let noisy = 1.0 + state.nu / model;
            covariance[(i, i)] += bin.scatter * noisy * noisy;
            for j in 0..=i {
                covariance[(i, j)] += crossed / model;
            }
            let excess = ((bin.raw - state.nu) / model - 1.0).clamp(-2.0, 2.0);
            columns.set_row(i, &[excess, 1.0, x, 1.0 / model].into());
            models[i] = model;
            cost += 2.0 * libm::log(model);
        }
        let factor = covariance.cholesky()?.unpack();
        factor.solve_lower_triangular_mut(&mut columns);
        cost += 2.0 * factor.diagonal().iter().map(|&d| libm::log(d)).sum::<f64>();
        let whitened = Whitened {
            columns,
            factor,
            models,
        };
        let mut normal = Normal::new(whitened, cost);
        if self.known > 0.0 && self.known.is_finite() {
            normal.know_noise(nu - state.nu, self.known);
        }
        Some(normal)
    }
}

/// rms of ln σ(d) around the line of `state`.
fn residual(bins: &[Observation], state: &State) -> f64 {
    let square = |bin: &Observation| {
        let model = libm::exp(state.level + 2.0 * state.hurst * bin.effective(state.hurst));
        let part = model / (model + state.nu);
        let off = 0.5 * ((bin.raw - state.nu) / model - 1.0);
        (part * part * off * off, part * part)
    };
    let sums = bins
        .iter()
        .map(square)
        .fold((0.0, 0.0), |s, v| (s.0 + v.0, s.1 + v.1));
    libm::sqrt(sums.0 / sums.1)
}

/// Normal equations for the steps of level, hurst and ν.
struct Normal {
    matrix: [[f64; 3]; 3],
    right: [f64; 3],
    cost: f64,
    whitened: Whitened,
}

impl Normal {
    /// `cost` is that of the covariance.
    fn new(whitened: Whitened, cost: f64) -> Self {
        let products = whitened.columns.tr_mul(&whitened.columns);
        Normal {
            matrix: core::array::from_fn(|i| core::array::from_fn(|j| products[(i + 1, j + 1)])),
            right: core::array::from_fn(|i| products[(0, i + 1)]),
            cost: cost + products[(0, 0)],
            whitened,
        }
    }

    /// ν lies `off` above the state's, give or take `std`.
    fn know_noise(&mut self, off: f64, std: f64) {
        let weight = 1.0 / (std * std);
        self.matrix[2][2] += weight;
        self.right[2] += weight * off;
        self.cost += weight * off * off;
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

    /// The next step: along ν = 0 where noise would become negative.
    fn step(&self, state: &State, free: bool) -> Option<[f64; 3]> {
        let step = self.solve(free)?;
        if state.nu > 0.0 || step[2] >= 0.0 {
            Some(step)
        } else {
            self.solve(false)
        }
    }

    fn solve(&self, three: bool) -> Option<[f64; 3]> {
        let mut right = nalgebra::Vector3::from(self.right);
        right[2] *= f64::from(u8::from(three));
        let step = self.inverse(three)? * right;
        step.iter().all(|v| v.is_finite()).then(|| step.into())
    }
}

#[cfg(all(test, feature = "std"))]
mod tests {
    use super::super::pairs;
    use super::*;
    use rand_core::{Rng, SeedableRng};
    use rand_xoshiro::Xoshiro128PlusPlus;

    const REGION: Region = Region {
        side: 512.0,
        points: 13_107,
    };

    /// Annuli at 2 … 30 m of a law without errors.
    fn bins(state: &State) -> Vec<Observation> {
        let bin = |lag: u32| {
            let d = f64::from(lag);
            let raw = libm::exp(state.level + 2.0 * state.hurst * libm::log(d)) + state.nu;
            let pairs = 2_050.0 * d;
            let sums = Sums {
                pairs,
                absolute: 0.0,
                square: pairs * raw,
                distance: pairs * d * d,
                quartic: pairs * libm::pow(d, 4.0),
            };
            Observation::new(&sums, Method::Pentland)
        };
        (2..=30).map(bin).collect()
    }

    /// Bins of the law with errors that follow the model.
    fn drawn(state: &State, random: &mut Xoshiro128PlusPlus) -> Vec<Observation> {
        let mut bins = bins(state);
        let problem = Problem {
            bins: &bins,
            region: &REGION,
            known: f64::INFINITY,
        };
        let normal = problem.normal(state, &problem.shared(state), state.nu);
        let Whitened { factor, models, .. } = normal.unwrap().whitened;
        let independent = DVector::from_fn(bins.len(), |_, _| {
            f64::from(crate::synthesis::normal(random))
        });
        let errors = (&factor * independent).component_mul(&models);
        for (bin, error) in bins.iter_mut().zip(&errors) {
            bin.raw += error;
        }
        bins
    }

    /// Stated over true deviation of H where the data follows the model.
    fn stated_over_true(state: &State, draws: usize) -> f64 {
        let mut random = Xoshiro128PlusPlus::seed_from_u64(1);
        let mut draw = || Fit::new(&drawn(state, &mut random), &REGION, Noise::Fitted).unwrap();
        let fits: Vec<Fit> = (0..draws).map(|_| draw()).collect();
        let mean = |value: &dyn Fn(&Fit) -> f64| fits.iter().map(value).sum::<f64>() / draws as f64;
        let hurst = mean(&|fit| fit.hurst);
        let variance = mean(&|fit| (fit.hurst - hurst) * (fit.hurst - hurst));
        let stated = mean(&|fit| fit.standard_error * fit.standard_error);
        libm::sqrt(stated / variance)
    }

    /// The derivative by the data is that of small errors: where some draws are taken for noise
    /// and some are not, it is too careful.
    #[test]
    fn stated_errors_are_right_where_data_follows_the_model() {
        for hurst in [0.2, 0.5, 0.8] {
            for share in [0.0, 0.1, 0.5, 2.0] {
                // of the moment at 2 m
                let nu = share * libm::pow(2.0, 2.0 * hurst);
                let level = 0.0;
                let ratio = stated_over_true(&State { level, hurst, nu }, 400);
                std::println!("H {hurst}, noise {share}: stated / true {ratio:.2}");
                assert!((0.85..1.4).contains(&ratio), "{ratio:.2}");
            }
        }
    }

    /// "No noise" is one of the noises: the search for the best one must not end far above it. (It
    /// ends where the derivative by the data vanishes, not that of the errors' covariance.)
    #[test]
    fn some_noise_fits_no_worse_than_none() {
        let mut random = Xoshiro128PlusPlus::seed_from_u64(2);
        for i in 0..300 {
            let (hurst, level) = (0.1 + 0.1 * f64::from(i % 8), 0.0);
            let nu = [0.0, 0.05, 0.3][i as usize % 3];
            let bins = drawn(&State { level, hurst, nu }, &mut random);
            let [none, some] = [no_noise, some_noise].map(|search| search(&bins, &REGION).unwrap());
            let worse = some.cost - none.cost;
            assert!(worse < 2.0, "H {hurst}, noise {nu}: {worse}");
        }
    }

    /// What a moment changes in H, as the standard error takes it and by trying.
    #[test]
    fn the_standard_error_is_that_of_the_derivative_by_the_data() {
        let mut random = Xoshiro128PlusPlus::seed_from_u64(3);
        for (hurst, nu) in [
            (0.1, 0.0),
            (0.2, 0.0),
            (0.3, 0.1),
            (0.3, 0.6),
            (0.6, 0.2),
            (0.8, 1.0),
        ] {
            let bins = drawn(
                &State {
                    level: 0.0,
                    hurst,
                    nu,
                },
                &mut random,
            );
            let [none, some] = [no_noise, some_noise].map(|search| search(&bins, &REGION).unwrap());
            let hurst_of = |i: usize, change: f64| {
                let mut bins = bins.clone();
                bins[i].raw += change;
                fitted_noise(&bins, &REGION).unwrap().state.hurst
            };
            let by_raw = DVector::from_fn(bins.len(), |i, _| {
                let change = 1e-5 * bins[i].raw;
                (hurst_of(i, change) - hurst_of(i, -change)) / (2.0 * change)
            });
            let tried = [&none, &some].map(|peak| libm::sqrt(peak.whitened.variance(&by_raw)));
            let stated = fitted_noise(&bins, &REGION).unwrap().standard_error;
            let [low, high] = [tried[0].min(tried[1]), tried[0].max(tried[1])];
            std::println!("H {hurst}, noise {nu}: {stated:.4}, tried {low:.4} to {high:.4}");
            assert!((0.93 * low..1.07 * high).contains(&stated), "{hurst} {nu}");
        }
    }

    /// Moments of the points (an eighth of a surface) under one noise after another.
    fn under_noises(hurst: f64, std: f64, draws: usize) -> (usize, Vec<DVector<f64>>) {
        let bins = pairs::Bins {
            low: 1.5,
            width: 1.0,
            count: 16,
        };
        let mut random = Xoshiro128PlusPlus::seed_from_u64(4);
        let [ground, _] = crate::synthesis::exact_fbm_pair(256, hurst, 7);
        let nodes: Vec<usize> = (0..256 * 256)
            .filter(|_| random.next_u32() % 8 == 0)
            .collect();
        let mut moments = || {
            let mut point = |&i: &usize| {
                let noise = std * f64::from(crate::synthesis::normal(&mut random));
                [
                    (i % 256) as f64,
                    (i / 256) as f64,
                    f64::from(ground[i]) + noise,
                ]
            };
            let points: Vec<[f64; 3]> = nodes.iter().map(&mut point).collect();
            let sums = pairs::sums(&points, &bins);
            DVector::from_fn(bins.count, |i, _| sums[i].square / sums[i].pairs)
        };
        (nodes.len(), (0..draws).map(|_| moments()).collect())
    }

    /// The covariance of moments where the noise is so small that only its products with the
    /// ground count.
    #[test]
    fn noise_and_ground_meet_in_all_pairs_of_a_point() {
        const DRAWS: usize = 200;
        for hurst in [0.2, 0.5, 0.8] {
            let std = 0.05;
            let (points, moments) = under_noises(hurst, std, DRAWS);
            let mean = moments.iter().sum::<DVector<f64>>() / DRAWS as f64;
            let state = State {
                level: 0.0,
                hurst,
                nu: 2.0 * std * std,
            };
            let region = Region {
                side: 256.0,
                points,
            };
            let problem = Problem {
                bins: &[],
                region: &region,
                known: f64::INFINITY,
            };
            let crossed = problem.crossed(&state);
            let pairs = [(3, 6), (4, 9), (5, 15), (8, 14), (12, 13)];
            let ratio = |(short, long): (usize, usize)| {
                let products = moments
                    .iter()
                    .map(|m| (m[short] - mean[short]) * (m[long] - mean[long]));
                let covariance = products.sum::<f64>() / (DRAWS - 1) as f64;
                covariance / (crossed * (mean[short] - state.nu))
            };
            let ratios = pairs.map(ratio);
            std::println!("H {hurst}: {ratios:.2?}");
            assert!(ratios.iter().all(|ratio| (0.7..1.4).contains(ratio)));
            let mean = ratios.iter().sum::<f64>() / pairs.len() as f64;
            assert!((0.9..1.2).contains(&mean), "{mean:.2}");
        }
    }
}
