//! Hurst exponent, dimension and σ of a piece of the map.
//!
//! The corrected second moment V(d) = σ² d^{2H} is fitted by iterated weighted least
//! squares. V comes from the second moment (Pentland 1984: V = S² − n) or from the first
//! (Yokoya et al. 1989: V = π/2 E² − n, exact for Gaussian differences and less moved
//! by outliers); n is the known sensor noise, and the plane's part is taken off where the
//! tilt is significant. With m the model, the linearised value ln m + (V/m − 1) is
//! regressed on 2 ln d, so a V that noise made negative still counts. D = 3 − H.
//!
//! * Distances of a lag differ. (E d^{2H})^{1/2H} ≈ √q · exp((H − 1) κ / 4) stands for
//!   them, with q and κ of [`Moment`].
//! * Weight of a lag: 1 / variance of V/m, with variance (2/C) (1 + n/m)² + c (d/L)²:
//!   the pairs' own scatter and that of the few independent places a region of side L
//!   has for long lags.
//! * Standard error: see [`standard_error`].
//! * Scaling range: iterative least squares (Arakawa and Krotkov 1996, § 2.5, second
//!   approach): while the residual exceeds the tolerance the longest lag is dropped; a
//!   line needs three lags. Where there is none the answer is a [`Reason`], not a number.
//!
//! Input: a [`Pool`]; valid for pools of at least 3 × 3 tiles. Cost: about 4 000 scalar
//! instructions. Not for lags beyond the map's reach or irregular points: see `irregular`.

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
pub fn estimate(pool: &Pool, settings: &Settings) -> Result<Roughness, Reason> {
    let moments = pool.moments(settings.resolution, settings.height_step);
    let side = pool.side() * settings.resolution;
    match settings.trend {
        Trend::Keep => longest_line(&moments, false, side, settings),
        Trend::Remove => longest_line(&moments, true, side, settings),
        Trend::RemoveSignificant => {
            let plain = longest_line(&moments, false, side, settings);
            let (east, north) = pool.slope(settings.resolution, settings.height_step);
            let tilt = east * east + north * north;
            match longest_line(&moments, true, side, settings) {
                Ok(flat) if tilt > TILT_LIMIT * expected_tilt(&flat, side) => Ok(flat),
                _ => plain,
            }
        }
    }
}

/// A tilt is significant where its square exceeds the expected one so many times.
const TILT_LIMIT: f32 = 12.0;

/// Expected squared gradient of a fractional Brownian surface over a region of side L:
/// σ² L^{2H−2}, up to a factor near 1.
fn expected_tilt(roughness: &Roughness, side: f32) -> f32 {
    let sigma = roughness.sigma;
    sigma * sigma * math::exp((2.0 * roughness.hurst - 2.0) * math::ln(side))
}

fn longest_line(
    moments: &[Moment; LAGS],
    detrend: bool,
    side: f32,
    settings: &Settings,
) -> Result<Roughness, Reason> {
    let mut points = [Point::default(); LAGS];
    let mut count = 0;
    for moment in moments
        .iter()
        .filter(|m| m.pairs >= settings.least_pairs.max(1))
    {
        points[count] = Point::new(moment, detrend, side, settings.method);
        count += 1;
    }
    if count < 3 {
        return Err(Reason::TooFewPairs);
    }
    for used in (3..=count).rev() {
        let fit = Fit::new(&points[..used])?;
        if fit.residual <= settings.tolerance {
            return fit.roughness(&points[..used], detrend);
        }
    }
    Err(Reason::NoLine)
}

/// One lag, ready for the fit.
#[derive(Clone, Copy, Debug, Default)]
struct Point {
    distance: f32,
    log_distance: f32,
    spread: f32,
    pairs: u32,
    /// V, corrected second moment \[m²\]
    value: f32,
    /// n, noise \[m²\]
    noise: f32,
    /// 2/C, variance of S²/E S² from the pairs' own scatter
    scatter: f32,
    /// c (d/L)², from the region's size
    common: f32,
}

/// c of the weights (test `stated_errors_are_right_within_30_percent`).
const COMMON: f32 = 3.0;

impl Point {
    fn new(moment: &Moment, detrend: bool, side: f32, method: Method) -> Self {
        let (raw, excess) = match method {
            Method::Pentland => (moment.mean_square, 2.0),
            Method::Yokoya => {
                let mean = moment.mean_absolute;
                (math::FRAC_PI_2 * mean * mean, 2.283)
            }
        };
        let trend = if detrend { moment.trend } else { 0.0 };
        let part = moment.distance / side;
        Point {
            distance: moment.distance,
            log_distance: math::ln(moment.distance),
            spread: moment.spread,
            pairs: moment.pairs,
            value: raw - moment.noise - trend,
            noise: moment.noise,
            scatter: excess / moment.pairs as f32,
            common: COMMON * part * part,
        }
    }

    /// ln of the distance that stands for the lag's distances at exponent `hurst`.
    fn effective(&self, hurst: f32) -> f32 {
        self.log_distance + 0.25 * (hurst - 1.0) * self.spread
    }

    /// 1 / variance of V/m where the model says `model`.
    fn weight(&self, model: f32) -> f32 {
        let noisy = 1.0 + self.noise / model;
        1.0 / (self.scatter * noisy * noisy + self.common)
    }
}

/// ln V = level + 2 H ln d.
struct Fit {
    level: f32,
    hurst: f32,
    residual: f32,
    standard_error: f32,
}

const ROUNDS: usize = 4;

impl Fit {
    fn new(points: &[Point]) -> Result<Self, Reason> {
        let mut fit = Fit::first(points)?;
        for _ in 0..ROUNDS {
            fit = fit.improved(points)?;
        }
        Ok(fit)
    }

    /// A line of slope ½ through the point of most weight that stands out of the noise.
    fn first(points: &[Point]) -> Result<Self, Reason> {
        let mut line = Line::default();
        for point in points.iter().filter(|p| p.value > 0.0) {
            let x = point.effective(0.5);
            line.add(2.0 * x, math::ln(point.value), point.weight(point.value));
        }
        if line.count < 2 {
            return Err(Reason::Noise);
        }
        let (level, hurst) = line.solve();
        Ok(Fit {
            level,
            hurst: hurst.clamp(0.02, 1.2),
            residual: 0.0,
            standard_error: 0.0,
        })
    }

    fn improved(&self, points: &[Point]) -> Result<Self, Reason> {
        let mut line = Line::default();
        for point in points {
            let x = 2.0 * point.effective(self.hurst);
            let model = math::exp(self.level + self.hurst * x);
            let excess = (point.value / model - 1.0).clamp(-1.0, 2.0);
            line.add(x, excess, point.weight(model));
        }
        let (level, hurst) = line.solve();
        if !hurst.is_finite() || !level.is_finite() {
            return Err(Reason::Noise);
        }
        let residual = 0.5 * math::sqrt(line.residual(level, hurst) / line.weight);
        Ok(Fit {
            level: self.level + level,
            hurst: self.hurst + hurst,
            residual,
            standard_error: math::sqrt(line.weight / line.determinant()),
        })
    }

    fn roughness(&self, points: &[Point], detrended: bool) -> Result<Roughness, Reason> {
        let outside = (-self.hurst).max(self.hurst - 1.0);
        if outside > 2.0 * self.standard_error {
            return Err(Reason::Slope);
        }
        let hurst = self.hurst.clamp(0.0, 1.0);
        Ok(Roughness {
            hurst,
            dimension: 3.0 - hurst,
            sigma: math::exp(0.5 * self.level),
            standard_error: self.standard_error,
            range: [points[0].distance, points[points.len() - 1].distance],
            residual: self.residual,
            pairs: points.iter().map(|p| p.pairs).sum(),
            clamped: outside > 0.0,
            detrended,
        })
    }
}

/// Weighted sums of a straight-line fit y = level + slope · x.
#[derive(Default)]
struct Line {
    count: u32,
    weight: f32,
    x: f32,
    y: f32,
    xx: f32,
    xy: f32,
    yy: f32,
}

impl Line {
    fn add(&mut self, x: f32, y: f32, weight: f32) {
        self.count += 1;
        self.weight += weight;
        self.x += weight * x;
        self.y += weight * y;
        self.xx += weight * x * x;
        self.xy += weight * x * y;
        self.yy += weight * y * y;
    }

    fn determinant(&self) -> f32 {
        self.weight * self.xx - self.x * self.x
    }

    fn solve(&self) -> (f32, f32) {
        let slope = (self.weight * self.xy - self.x * self.y) / self.determinant();
        ((self.y - slope * self.x) / self.weight, slope)
    }

    fn residual(&self, level: f32, slope: f32) -> f32 {
        let fitted = level * self.y + slope * self.xy;
        (self.yy - fitted).max(0.0)
    }
}
