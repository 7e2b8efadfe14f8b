//! Roughness of irregular points and of rasters, offline.
//!
//! ```
//! use rugosa_fractal::roughness::irregular::{Options, estimate_points};
//! let points: Vec<[f64; 3]> = (0..4000)
//!     .map(|i| (f64::from(i % 63), f64::from(i / 63)))
//!     .map(|(x, y)| [x, y, (0.13 * x * y).sin()])
//!     .collect();
//! let estimate = estimate_points(&points, &Options { min_lag: Some(1.0), max_lag: Some(12.0), ..Options::default() });
//! assert_eq!(estimate.bins.len(), 23);
//! ```
//!
//! All pairs of points between the least and the greatest lag are met once, by a cell
//! list ([`pairs`]); rasters go by offsets ([`raster`]). The power law is then fitted to
//! the corrected moments of the bins ([`power_law`]), with the sensor noise known or
//! fitted along, over the [scaling range](super::scaling_range). Units: metres.
//!
//! Needs the feature `alloc`; f64 where it costs nothing.

mod average;
pub mod gaussianity;
pub mod pairs;
pub mod power_law;
pub mod raster;
#[cfg(all(test, feature = "std"))]
mod tests;

use super::Reason;
use super::estimate::Method;
use super::scaling_range::{self, MOST_LAGS, NoRange};
use alloc::vec::Vec;
use pairs::{Bins, Sums};
use power_law::{Fit, Observation, Region};
pub use raster::{Raster, estimate_raster};

/// What is known of the sensor noise of the heights.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Noise {
    /// fitted together with the power law
    #[default]
    Fitted,
    /// known standard deviation \[m\]; 0 for none
    Known(f64),
}

/// How to estimate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// centre of the first bin \[m\]; default: half the mean distance of neighbours
    pub min_lag: Option<f64>,
    /// centre of the last bin \[m\]; default: a tenth of the region's side
    pub max_lag: Option<f64>,
    /// sensor noise
    pub noise: Noise,
    /// moment to fit
    pub method: Method,
    /// how the scaling range is found
    pub range: scaling_range::Method,
}

/// One annulus of lags.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bin {
    /// root mean square distance of its pairs \[m\]; the annulus' centre where it has none
    pub lag: f64,
    /// mean |Δz| \[m\], sensor noise included; NaN without pairs
    pub mean_abs_dz: f64,
    /// root mean square Δz \[m\], sensor noise included; NaN without pairs
    pub rms_dz: f64,
    /// number of pairs
    pub pairs: u64,
}

/// A power law σ(d) = sigma · (d / 1 m)^hurst and how sure it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Law {
    /// Hurst exponent, in \[0, 1\]
    pub hurst: f64,
    /// dimension, 3 − hurst
    pub dimension: f64,
    /// standard deviation of elevation differences at 1 m \[m\]
    pub sigma: f64,
    /// standard error of hurst and dimension
    pub standard_error: f64,
    /// shortest and longest lag of the scaling range \[m\]
    pub range: [f64; 2],
    /// rms residual of ln σ(d) over the range
    pub residual: f64,
    /// pairs in the range
    pub pairs: u64,
    /// the slope lay outside \[0, 1\], not significantly, and was set to the border
    pub clamped: bool,
}

/// The structure function and the power law in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// all bins, ascending
    pub bins: Vec<Bin>,
    /// standard deviation of the sensor noise \[m\], as given or fitted
    pub noise_std: f64,
    /// the power law, or why there is none
    pub law: Result<Law, Reason>,
}

/// Structure function and power law of points (x, y, z) \[m\]; all must be finite.
///
/// Time: the pairs within the greatest lag, about 4 ns each.
///
/// ```
/// use rugosa_fractal::roughness::irregular::{Noise, Options, estimate_points};
/// # use rand_core::SeedableRng;
/// # use rugosa_fractal::pyramid::{Levels, Posterior};
/// # let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(1);
/// # let (mut memory, mut z) = (vec![0.0; Posterior::need(65).unwrap()], vec![0.0; 65 * 65]);
/// # let prior = Levels::power_law(65, 0.6, 0.3).unwrap();
/// # rugosa_fractal::synthesis::pyramid((65, &prior), &mut rng, &mut memory, &mut z).unwrap();
/// // heights z of dimension 2.4, 1 m apart, σ = 0.3 m at 1 m
/// let point = |i: usize| [(i % 65) as f64, (i / 65) as f64, f64::from(z[i])];
/// let points: Vec<_> = (0..65 * 65).map(point).collect();
/// let options = Options { noise: Noise::Known(0.0), ..Options::default() };
/// let law = estimate_points(&points, &options).law.unwrap();
/// assert!((law.dimension - 2.4).abs() < 0.1 && (law.sigma - 0.3).abs() < 0.05);
/// ```
pub fn estimate_points(points: &[[f64; 3]], options: &Options) -> Estimate {
    let area = pairs::area(points);
    let region = Region {
        side: libm::sqrt(area),
        points: points.len(),
    };
    let spacing = region.side / libm::sqrt(points.len().max(1) as f64);
    let bins = bins(options, spacing, region.side);
    fit(&pairs::sums(points, &bins), &bins, &region, options)
}

/// Annuli of equal width between the lags asked for: half the least lag wide, so that
/// lags 2 … 30 make the 29 annuli 1.5 … 2.5, …, 29.5 … 30.5; wider where that would make
/// more than 64.
fn bins(options: &Options, spacing: f64, side: f64) -> Bins {
    let low = options
        .min_lag
        .unwrap_or(0.5 * spacing)
        .max(1e-6 * side)
        .max(f64::MIN_POSITIVE);
    let high = options.max_lag.unwrap_or(0.1 * side).max(4.0 * low);
    let steps = libm::round((high - low) / (0.5 * low)).clamp(3.0, MOST_LAGS as f64 - 1.0);
    let width = (high - low) / steps;
    Bins {
        low: (low - 0.5 * width).max(0.0),
        width,
        count: steps as usize + 1,
    }
}

/// Fewest pairs of a bin that counts.
const LEAST_PAIRS: f64 = 20.0;

/// From sums to the answer.
fn fit(sums: &[Sums], bins: &Bins, region: &Region, options: &Options) -> Estimate {
    let observations: Vec<Observation> = sums
        .iter()
        .filter(|sums| sums.pairs >= LEAST_PAIRS)
        .map(|sums| Observation::new(sums, options.method))
        .collect();
    let bins = sums
        .iter()
        .enumerate()
        .map(|(i, sums)| sums.bin(bins.centre(i)))
        .collect();
    let whole = Fit::new(&observations, region, options.noise);
    let law = whole.and_then(|fit| law(&fit, &observations, region, options));
    let noise = law
        .as_ref()
        .map(|(fit, _)| fit.noise)
        .or(whole.map(|fit| fit.noise));
    Estimate {
        bins,
        noise_std: libm::sqrt(noise.unwrap_or_default()),
        law: law.map(|(_, law)| law),
    }
}

fn law(
    whole: &Fit,
    observations: &[Observation],
    region: &Region,
    options: &Options,
) -> Result<(Fit, Law), Reason> {
    let (first, last) = range(whole, observations, region.side, options)?;
    let used = &observations[first..=last];
    let fit = if used.len() == observations.len() {
        *whole
    } else {
        // the noise is known best from all bins
        let mut fit = Fit::new(used, region, Noise::Known(libm::sqrt(whole.noise)))?;
        fit.standard_error = fit.standard_error.max(whole.standard_error);
        fit
    };
    let outside = (-fit.hurst).max(fit.hurst - 1.0);
    if outside > 2.0 * fit.standard_error {
        return Err(Reason::Slope);
    }
    let hurst = fit.hurst.clamp(0.0, 1.0);
    let law = Law {
        hurst,
        dimension: 3.0 - hurst,
        sigma: libm::exp(0.5 * fit.level),
        standard_error: fit.standard_error,
        range: [used[0].distance, used[used.len() - 1].distance],
        residual: fit.residual,
        pairs: used.iter().map(|o| o.pairs as u64).sum(),
        clamped: outside > 0.0,
    };
    Ok((fit, law))
}

/// First and last observation of the scaling range, found on ½ ln V with the noise of the
/// fit over all bins taken off. Bins whose V the noise leaves uncertain have no say; where
/// the range reaches the first or last that has, those beyond it belong to it.
fn range(
    whole: &Fit,
    observations: &[Observation],
    side: f64,
    options: &Options,
) -> Result<(usize, usize), Reason> {
    let sure: Vec<usize> = (0..observations.len())
        .filter(|&i| whole.is_sure_of(&observations[i]))
        .collect();
    let value = |&i: &usize| observations[i].raw - 2.0 * whole.noise;
    let x: Vec<f64> = sure
        .iter()
        .map(|&i| libm::log(observations[i].distance))
        .collect();
    let y: Vec<f64> = sure.iter().map(|i| 0.5 * libm::log(value(i))).collect();
    if options.range == scaling_range::Method::Whole || sure.len() < scaling_range::LEAST_POINTS {
        return Ok((0, observations.len() - 1));
    }
    let chance = whole.expected_residual(observations, side);
    match scaling_range::scaling_range(&x, &y, widened(options.range, chance)) {
        Ok(range) if range.residual <= MOST_RESIDUAL.max(3.0 * chance) => {
            let first = if range.first == 0 {
                0
            } else {
                sure[range.first]
            };
            let end = range.last + 1 == sure.len();
            Ok((
                first,
                if end {
                    observations.len() - 1
                } else {
                    sure[range.last]
                },
            ))
        }
        Ok(_) | Err(NoRange::NoLine) => Err(Reason::NoLine),
        Err(NoRange::TooFewPoints) => Err(Reason::TooFewPairs),
        Err(NoRange::Slope(slope)) if slope > 1.0 || slope < -2.0 * whole.standard_error => {
            Err(Reason::Slope)
        }
        Err(NoRange::Slope(_)) => Ok((0, observations.len() - 1)),
    }
}

/// A line whose ln σ(d) scatters more than this is none.
const MOST_RESIDUAL: f64 = 0.15;

/// Tolerances are about the curve; what chance alone does to it is added.
fn widened(method: scaling_range::Method, chance: f64) -> scaling_range::Method {
    use scaling_range::Method;
    let wider = |tolerance: f64| libm::sqrt(tolerance * tolerance + chance * chance);
    match method {
        Method::Robust { tolerance } => Method::Robust {
            tolerance: wider(tolerance),
        },
        Method::LeastSquares { tolerance } => Method::LeastSquares {
            tolerance: wider(tolerance),
        },
        other => other,
    }
}
