//! Hurst exponent, dimension and σ of a piece of the map.
//!
//! The corrected second moment V(d) = σ² d^{2H} is fitted by iterated weighted least
//! squares. V comes from the second moment (Pentland 1984: V = S² − n) or from the first
//! (Yokoya et al. 1989: V = π/2 E² − n, exact for Gaussian differences and less moved
//! by outliers); n is the known sensor noise, and the plane's part is taken off where the
//! tilt is significant. A V that noise made negative still counts. D = 3 − H.
//!
//! * Distances of a lag differ. (E d^{2H})^{1/2H} ≈ √q · exp((H − 1) κ / 4) stands for
//!   them, with q and κ of [`Moment`].
//! * Weights and the standard error come from a model of the errors, see `fit`.
//! * Scaling range: iterative least squares (Arakawa and Krotkov 1996, § 2.5, second
//!   approach): while the residual exceeds the tolerance the longest lag is dropped; a
//!   line needs three lags. Where there is none the answer is a [`Reason`], not a number.
//!
//! Input: a [`Pool`]; valid for pools of at least 3 × 3 tiles. Cost: about 5,000
//! instructions on x86-64. Not for lags beyond the map's reach or irregular points: see `irregular`.

use super::fit::{Fit, Lags};
use super::offsets::LAGS;
use super::pool::{Moment, Pool};
use rugosa_grid::math;

/// Which moment of the elevation differences is fitted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// first moment, E|Δz| (Yokoya et al. 1989)
    Yokoya,
    /// second moment, E Δz² (Pentland 1984)
    #[default]
    Pentland,
}

/// What happens to the tilt of a region.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Trend {
    /// it counts as roughness
    Keep,
    /// it is taken off where no fractal surface would have it
    #[default]
    RemoveSignificant,
    /// it is always taken off; smooth surfaces then look rougher than they are
    Remove,
}

/// How to estimate; all lengths in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// cell edge \[m\]
    pub resolution: f32,
    /// one step of the samples' heights \[m\]
    pub height_step: f32,
    /// moment to fit
    pub method: Method,
    /// treatment of the tilt
    pub trend: Trend,
    /// a lag with fewer pairs is left out
    pub least_pairs: u32,
    /// largest residual of a line, rms of ln σ(d)
    pub tolerance: f32,
}

impl Settings {
    /// The defaults for cells of `resolution` and heights in steps of `height_step` \[m\].
    pub fn new(resolution: f32, height_step: f32) -> Self {
        Settings {
            resolution,
            height_step,
            method: Method::default(),
            trend: Trend::default(),
            least_pairs: 20,
            tolerance: 0.15,
        }
    }
}

/// A piece of ground in the terms of fractional Brownian surfaces.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Roughness {
    /// Hurst exponent H, in \[0, 1\]
    pub hurst: f32,
    /// fractal dimension D = 3 − H, in \[2, 3\]
    pub dimension: f32,
    /// standard deviation of elevation differences at 1 m \[m\]
    pub sigma: f32,
    /// standard error of H and of D
    pub standard_error: f32,
    /// shortest and longest distance of the line \[m\]
    pub range: [f32; 2],
    /// weighted rms residual of ln σ(d)
    pub residual: f32,
    /// pairs that the fit used
    pub pairs: u32,
    /// the slope lay outside \[0, 1\], not significantly, and was set to the border
    pub clamped: bool,
    /// the region's tilt was taken off
    pub detrended: bool,
}

/// Why a region has no dimension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// fewer than three lags have enough pairs
    TooFewPairs,
    /// the differences are not larger than the sensor's noise
    Noise,
    /// no three lags lie on a line
    NoLine,
    /// the slope lies outside (0, 1) by more than its error
    Slope,
}

/// Roughness of a pool of tiles, or the reason why it has none.
///
/// ```
/// use rugosa_fractal::pyramid::{Levels, Posterior};
/// use rugosa_fractal::roughness::{Block, Pool, Settings, StructureFunction, TileSums, estimate};
/// # use rand_core::SeedableRng;
/// # use rugosa_fractal::synthesis::pyramid;
/// # use rugosa_grid::{Cell, Sample, Window};
/// // ground of dimension 2.3 in cells of 0.1 m, σ = 0.2 m at 1 m; heights in steps of 0.5 mm
/// let prior = Levels::power_law(65, 0.7, 0.2 * 0.1f32.powf(0.7)).unwrap();
/// # let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(2);
/// # let (mut memory, mut z) = (vec![0.0; Posterior::need(65).unwrap()], vec![0.0; 65 * 65]);
/// # pyramid((65, &prior), &mut rng, &mut memory, &mut z).unwrap();
/// # let sample = |z: &f32| Sample::measured((z / 0.0005) as i16, 0, 0, 0, 255);
/// # let mut samples: Vec<Sample> = z.iter().map(sample).collect();
/// # let window = Window::new(65, Cell::new(0, 0));
/// # let (mut tiles, mut block) = ([TileSums::EMPTY; 81], Block::new());
/// let mut structure = StructureFunction::new(65, &mut tiles, &mut block);
/// for cell in window.cells() {
///     structure.replaced(&window, &samples, cell, &Sample::UNKNOWN);
/// }
/// structure.commit(&window, &mut samples);
/// let pool = Pool::of_all(structure.tiles());
/// let roughness = estimate(&pool, &Settings::new(0.1, 0.0005)).unwrap();
/// assert!((roughness.dimension - 2.3).abs() < 2.0 * roughness.standard_error);
/// assert!(roughness.standard_error < 0.05 && (roughness.sigma - 0.2).abs() < 0.05); // m
/// ```
pub fn estimate(pool: &Pool, settings: &Settings) -> Result<Roughness, Reason> {
    let (moments, [east, north]) =
        pool.moments_and_slope(settings.resolution, settings.height_step);
    let side = pool.side() * settings.resolution;
    let (lags, count) = lags(&moments, settings);
    let tilt = east * east + north * north;
    let may_be_significant = tilt * side * side > LEAST_FACTOR * without_tilt(&moments);
    let as_it_is = || longest_line(&lags, count, false, side, settings);
    let levelled = || longest_line(&level(&lags), count, true, side, settings);
    match settings.trend {
        Trend::Remove => levelled(),
        Trend::RemoveSignificant if may_be_significant => match levelled() {
            Ok(flat) if tilt > largest_tilt(&flat, side) => Ok(flat),
            _ => as_it_is(),
        },
        _ => as_it_is(),
    }
}

/// What the lags with enough pairs say, and how many these are.
fn lags(moments: &[Moment; LAGS], settings: &Settings) -> (Lags, usize) {
    let (mut lags, mut count) = (Lags::default(), 0);
    let least = settings.least_pairs.max(1);
    for moment in moments.iter().filter(|m| m.pairs >= least) {
        let mean = moment.mean_absolute;
        let (raw, variance) = match settings.method {
            Method::Pentland => (moment.mean_square, 2.0),
            Method::Yokoya => (math::FRAC_PI_2 * mean * mean, 2.283),
        };
        lags.square_distance[count] = moment.square_distance;
        lags.spread[count] = moment.spread;
        lags.pairs[count] = moment.pairs;
        lags.value[count] = raw - moment.noise;
        lags.trend[count] = moment.trend;
        lags.noise[count] = moment.noise;
        lags.scatter[count] = SHARED_SAMPLES * variance / moment.pairs as f32;
        count += 1;
    }
    lags.measure();
    (lags, count)
}

/// Takes the tilt off.
fn level(lags: &Lags) -> Lags {
    let mut flat = lags.clone();
    flat.value = core::array::from_fn(|i| lags.value[i] - lags.trend[i]);
    flat
}

/// V of the longest lag without the tilt \[m²\].
fn without_tilt(moments: &[Moment; LAGS]) -> f32 {
    let last = moments.iter().rev().find(|moment| moment.pairs > 0);
    last.map_or(0.0, |m| m.mean_square - m.noise - m.trend)
}

/// The factor e^1.5 of [`largest_tilt`] at H = 0, where it is least: below this the second
/// fit cannot find the tilt significant.
const LEAST_FACTOR: f32 = 4.48;

/// Largest squared gradient that a fractional Brownian surface has by chance over a region
/// of side L, given what is left when the tilt is taken off: σ² L^{2H−2} e^{1.5 + 3.6 H}.
///
/// The factor lies above the 99 % quantile of simulated surfaces with H from 0.2 to 0.9 (test
/// `the_tilt_of_smooth_surfaces_is_kept`). It grows with H because taking the tilt off a
/// smooth surface takes most of its roughness too.
fn largest_tilt(roughness: &Roughness, side: f32) -> f32 {
    let (sigma, hurst) = (roughness.sigma, roughness.hurst);
    sigma * sigma * math::exp((2.0 * hurst - 2.0) * math::ln(side) + 1.5 + 3.6 * hurst)
}

fn longest_line(
    lags: &Lags,
    count: usize,
    detrended: bool,
    side: f32,
    settings: &Settings,
) -> Result<Roughness, Reason> {
    if count < LEAST_LAGS {
        return Err(Reason::TooFewPairs);
    }
    for used in (LEAST_LAGS..=count).rev() {
        let fit = Fit::new(lags, used, side)?;
        if fit.residual <= settings.tolerance || fit.chi_square < CHI_SQUARE_LIMIT {
            return roughness(&fit, lags, used, detrended);
        }
    }
    Err(Reason::NoLine)
}

/// A line needs so many lags.
const LEAST_LAGS: usize = 3;

/// A residual above the tolerance may still be chance: χ² per degree of freedom below this.
const CHI_SQUARE_LIMIT: f32 = 4.0;

/// Pairs that share a sample are not independent: their mean scatters this much more.
const SHARED_SAMPLES: f32 = 1.3;

fn roughness(fit: &Fit, lags: &Lags, used: usize, detrended: bool) -> Result<Roughness, Reason> {
    let outside = (-fit.hurst).max(fit.hurst - 1.0);
    if outside > 2.0 * fit.standard_error {
        return Err(Reason::Slope);
    }
    let hurst = fit.hurst.clamp(0.0, 1.0);
    Ok(Roughness {
        hurst,
        dimension: 3.0 - hurst,
        sigma: math::exp(0.5 * fit.level),
        standard_error: fit.standard_error,
        range: [0, used - 1].map(|i| math::sqrt(lags.square_distance[i])),
        residual: fit.residual,
        pairs: lags.pairs[..used].iter().sum(),
        clamped: outside > 0.0,
        detrended,
    })
}
