//! Scaling range: the lags over which the structure function is a power law.
//!
//! Five ways behind one function, [`scaling_range`]. Input: x = ln d and y = ln E|Δz| (or
//! ½ ln V) of up to [`MOST_LAGS`] lags, ascending. Output: a [`ScalingRange`], or a
//! [`NoRange`] where no three points lie on a rising line.
//!
//! | method | source | good for |
//! |---|---|---|
//! | [`Method::Polyline`] | Kurozumi and Davis 1982, as in Arakawa and Krotkov 1996 § 2.5 | several segments (multifractals) |
//! | [`Method::LeastSquares`] | Arakawa and Krotkov 1996 § 2.5 | lags that fall out at either end |
//! | [`Method::Fang`] | Fang et al. 2004, eqs 6–9 | curves that are known to have a break |
//! | [`Method::Elongation`] | Yokoya et al. 1989, as stated by Fang et al. 2004 | comparison only |
//! | [`Method::Robust`] | line and joined polynomial, chosen by BIC | everything else; the default |
//!
//! Fang's rule finds a break within a point or so where there is one, and is meaningless
//! where there is none: on a pure power law with 1 % noise its choice is nearly uniform
//! over the lags. The first maximum of the elongation is driven by noise whatever the
//! curve (`docs/results-roughness.md` has the Monte Carlo table, made by the example
//! `scaling_range`).
//!
//! Offline mathematics in f64, without a heap. The on-board estimate uses its own
//! shortened least squares, see [`estimate()`](super::estimate()).

mod elongation;
mod fang;
mod iterative;
mod least_squares;
mod polyline;
mod robust;

pub use fang::{Fang, fang};
pub use polyline::{Segments, polyline};
pub use robust::{Candidate, Robust, robust};

/// No more lags than this.
pub const MOST_LAGS: usize = 64;

/// Fewest points of a line.
pub const LEAST_POINTS: usize = 3;

/// A flat line has a slope of rounding errors.
const LEAST_SLOPE: f64 = 1e-9;

/// How the range is found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// all lags
    Whole,
    /// the segment with most points of a polyline inside a strip of this half width \[ln\]
    Polyline {
        /// half width of the strip
        tolerance: f64,
    },
    /// lags dropped at the worse end until the rms residual is within this \[ln\]
    LeastSquares {
        /// largest rms residual
        tolerance: f64,
    },
    /// line and polynomial of order 1 to 3; `guarded` excludes the degenerate choices
    Fang {
        /// at least four points on the line and a polynomial with a residual
        guarded: bool,
    },
    /// first maximum of the elongation of the point cloud
    Elongation,
    /// joined line and polynomial, by BIC with this practical tolerance \[ln\]
    Robust {
        /// a misfit below this does not count
        tolerance: f64,
    },
}

impl Default for Method {
    fn default() -> Self {
        Method::Robust { tolerance: 0.02 }
    }
}

/// A line through the points `first ..= last`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScalingRange {
    /// index of the first point
    pub first: usize,
    /// index of the last point
    pub last: usize,
    /// slope of the line, the Hurst exponent
    pub slope: f64,
    /// value of the line at x = 0, ln of the value at 1 m
    pub intercept: f64,
    /// rms residual of the points around the line
    pub residual: f64,
}

impl ScalingRange {
    /// Number of points.
    pub fn points(&self) -> usize {
        self.last - self.first + 1
    }

    /// The least-squares line through the points `first ..= last`.
    pub(crate) fn of(x: &[f64], y: &[f64], first: usize, last: usize) -> Self {
        let fit = least_squares::line(&x[first..=last], &y[first..=last]);
        ScalingRange {
            first,
            last,
            slope: fit.coefficients[1],
            intercept: fit.coefficients[0],
            residual: libm::sqrt(fit.rss / (last - first + 1) as f64),
        }
    }
}

/// Why there is no range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoRange {
    /// fewer than three points
    TooFewPoints,
    /// the longest line found has fewer than three points
    NoLine,
    /// its slope lies outside (0, 1)
    Slope(f64),
}

/// The scaling range of the points (x, y), x ascending; points beyond [`MOST_LAGS`] are not
/// looked at.
///
/// ```
/// use rugosa_fractal::roughness::scaling_range::{Method, NoRange, scaling_range};
/// // σ(d) = 0.2 m · d^0.6 up to 8 m, level beyond
/// let x: Vec<f64> = (1..=16).map(|d| f64::from(d).ln()).collect();
/// let y: Vec<f64> = x.iter().map(|&x| 0.2f64.ln() + 0.6 * x.min(8f64.ln())).collect();
/// let range = scaling_range(&x, &y, Method::default()).unwrap();
/// assert_eq!((range.first, range.last, range.points()), (0, 7, 8));
/// assert!((range.slope - 0.6).abs() < 1e-6 && (range.intercept.exp() - 0.2).abs() < 1e-6);
/// let flat = scaling_range(&x[8..], &y[8..], Method::Whole);
/// assert!(matches!(flat, Err(NoRange::Slope(_))));
/// ```
pub fn scaling_range(x: &[f64], y: &[f64], method: Method) -> Result<ScalingRange, NoRange> {
    let count = x.len().min(y.len()).min(MOST_LAGS);
    if count < LEAST_POINTS {
        return Err(NoRange::TooFewPoints);
    }
    let (x, y) = (&x[..count], &y[..count]);
    let (first, last) = match method {
        Method::Whole => (0, count - 1),
        Method::Polyline { tolerance } => polyline(x, y, tolerance).longest(),
        Method::LeastSquares { tolerance } => {
            iterative::ends(x, y, tolerance).ok_or(NoRange::NoLine)?
        }
        Method::Fang { guarded } => (0, fang(x, y, guarded).points - 1),
        Method::Elongation => (0, elongation::first_maximum(x, y) - 1),
        Method::Robust { tolerance } => (0, robust(x, y, tolerance).points - 1),
    };
    if last + 1 < first + LEAST_POINTS {
        return Err(NoRange::NoLine);
    }
    let range = ScalingRange::of(x, y, first, last);
    if range.slope > LEAST_SLOPE && range.slope < 1.0 {
        Ok(range)
    } else {
        Err(NoRange::Slope(range.slope))
    }
}

#[cfg(test)]
mod tests;
