//! Scaling range by a minimax polyline (Kurozumi and Davis 1982; first approach of Arakawa
//! and Krotkov 1996, § 2.5).
//!
//! From the first point on, each segment takes as many points as fit into a strip of the
//! given half width in y around some line; the next segment starts at its last point. The
//! segment with the most points is the scaling range (ties: the first); the others are
//! reported too, since a multifractal has several.
//!
//! A strip fits if the smallest possible largest deviation (Chebyshev's line) is within
//! the half width. That deviation is a convex function of the slope with its minimum at
//! a slope between two of the points, so those are tried: n³ per segment, n ≤ 64.

use super::{MOST_LAGS, ScalingRange};

/// The segments, in order.
#[derive(Clone, Copy, Debug)]
pub struct Segments {
    ends: [(usize, usize); MOST_LAGS],
    count: usize,
}

impl Segments {
    /// First and last point of each segment.
    pub fn ends(&self) -> &[(usize, usize)] {
        &self.ends[..self.count]
    }

    /// The least-squares line of each segment.
    pub fn lines<'a>(
        &'a self,
        x: &'a [f64],
        y: &'a [f64],
    ) -> impl Iterator<Item = ScalingRange> + 'a {
        self.ends()
            .iter()
            .map(move |&(first, last)| ScalingRange::of(x, y, first, last))
    }

    /// The segment with the most points.
    pub(super) fn longest(&self) -> (usize, usize) {
        let longer =
            |a: (usize, usize), b: (usize, usize)| if b.1 - b.0 > a.1 - a.0 { b } else { a };
        self.ends().iter().copied().fold((0, 0), longer)
    }
}

/// Splits a curve of 2 … [`MOST_LAGS`] points into segments inside strips of this half width.
///
/// ```
/// use rugosa_fractal::roughness::scaling_range::polyline;
/// // slope 0.6 on the points 0 … 7, 0.1 beyond
/// let x: Vec<f64> = (0..16).map(f64::from).collect();
/// let y: Vec<f64> = x.iter().map(|&x| 0.6 * x.min(7.0) + 0.1 * (x - 7.0).max(0.0)).collect();
/// let segments = polyline(&x, &y, 0.01);
/// assert_eq!(segments.ends(), [(0, 7), (7, 15)]);
/// let slopes: Vec<f64> = segments.lines(&x, &y).map(|line| line.slope).collect();
/// assert!((slopes[0] - 0.6).abs() < 1e-9 && (slopes[1] - 0.1).abs() < 1e-9);
/// ```
pub fn polyline(x: &[f64], y: &[f64], half_width: f64) -> Segments {
    let mut segments = Segments {
        ends: [(0, 0); MOST_LAGS],
        count: 0,
    };
    let mut first = 0;
    while first + 1 < x.len() {
        let fits = |last: &usize| deviation(&x[first..=*last], &y[first..=*last]) <= half_width;
        let last = (first + 2..x.len())
            .take_while(fits)
            .last()
            .unwrap_or(first + 1);
        segments.ends[segments.count] = (first, last);
        segments.count += 1;
        first = last;
    }
    segments
}

/// The smallest possible largest |deviation| from a line.
fn deviation(x: &[f64], y: &[f64]) -> f64 {
    let mut least = f64::INFINITY;
    for i in 0..x.len() {
        for j in i + 1..x.len() {
            least = least.min(spread(x, y, (y[j] - y[i]) / (x[j] - x[i])));
        }
    }
    least / 2.0
}

/// Extent of the points across lines of this slope.
fn spread(x: &[f64], y: &[f64], slope: f64) -> f64 {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for (x, y) in x.iter().zip(y) {
        let across = y - slope * x;
        (low, high) = (low.min(across), high.max(across));
    }
    high - low
}
