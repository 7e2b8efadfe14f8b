//! Level variances: what makes the pyramid a fractional Brownian surface.
//!
//! The prior is a sum over scales, u = Σ_l P_l (s_l ∘ w_l) + plane, w_l white standard
//! normal, P_l repeated refinement. White noise `j` refinements above the finest level
//! has the structure function
//!
//! ```text
//! V_j(h) = 2 (ρ_j(0)² − ρ_j(h_x) ρ_j(h_y)),   ρ_j(h) = 2^{−j} Σ_x k_j(x) k_j(x + h)
//! ```
//!
//! with k_j the composite kernel; a random plane adds τ²|h|². [`Levels::power_law`] uses
//! the s_j² and τ² that bring Σ s_j² V_j + τ²|h|² nearest to |h|^{2H} (relative error,
//! non-negative least squares, lags up to a quarter of the grid, axes and diagonals).
//! They are tabulated over H when the crate is built and interpolated after division by
//! their own power of the scale. Without the plane the fit fails for H > 0.7 (8–24 %).
//!
//! [`Levels::measured`] does the same fit on board against any structure function: real
//! terrain changes its dimension with scale.
//!
//! Accuracy for power laws, every H from 0.05 to 0.95: within 3 % of the power law, see
//! `the_structure_function_is_a_power_law` in `synthesis::pyramid`.

use super::{Error, nnls, shape::Shape};
use rugosa_grid::math;

include!(concat!(env!("OUT_DIR"), "/pyramid.rs"));

/// The variances of a prior's levels and of its plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Levels {
    /// of the white noise, finest level first \[m²\]
    variance: [f32; MAX_LEVELS],
    /// of the plane's slope \[m² per cell²\]
    slope: f32,
    /// of the mean level: broad \[m²\]
    mean: f32,
}

/// A prior whose level variances may depend on the place.
pub trait Prior {
    /// Variance \[m²\] of the noise `refinements` above the finest level, at a cell.
    fn variance(&self, refinements: usize, row: usize, column: usize) -> f32;
    /// Variance of the plane's slope \[m² per cell²\] and of the mean level \[m²\].
    fn plane(&self) -> (f32, f32);
}

impl Prior for Levels {
    #[inline(always)]
    fn variance(&self, refinements: usize, _: usize, _: usize) -> f32 {
        self.variance[refinements]
    }

    fn plane(&self) -> (f32, f32) {
        (self.slope, self.mean)
    }
}

/// Where the entries for this many levels begin in `POWER`: row by row of H, one number
/// per level and one for the plane.
const fn first_of(levels: usize) -> usize {
    (STEPS + 1) * (levels * (levels + 1) - MIN_LEVELS * (MIN_LEVELS + 1)) / 2
}

/// Largest share of the broad mean level: this many times the relief to be expected.
const BROAD: f32 = 10.0;
/// The finest level keeps this share of the lag-1 variance, so that no weight is infinite.
const FINEST_SHARE: f32 = 1e-3;

impl Levels {
    /// fBm on side × side cells: E Δz² = σ² d^{2H}, d in cells, `sigma` \[m\] the
    /// deviation of an elevation difference over one cell.
    ///
    /// ```
    /// use rugosa_fractal::pyramid::{Error, Levels};
    /// // 0.1 m from one cell to the next, hurst 0.7
    /// let levels = Levels::power_law(65, 0.7, 0.1).unwrap();
    /// let ratio = |lag: u16| levels.structure(lag).unwrap() / (0.01 * f32::from(lag).powf(1.4));
    /// assert!((ratio(1) - 1.0).abs() < 0.03 && (ratio(8) - 1.0).abs() < 0.03);
    /// assert_eq!(Levels::power_law(64, 0.7, 0.1), Err(Error::Side(64)));
    /// ```
    ///
    /// # Errors
    /// A side that is not 2^k + 1, `hurst` outside (0, 1), `sigma` not positive.
    pub fn power_law(side: usize, hurst: f32, sigma: f32) -> Result<Levels, Error> {
        let count = Shape::new(side).ok_or(Error::Side(side))?.levels();
        if !(hurst > 0.0 && hurst < 1.0) {
            return Err(Error::Hurst(hurst));
        }
        if !(sigma > 1e-9 && sigma < 1e9) {
            return Err(Error::Sigma(sigma));
        }
        let table = &POWER[first_of(count)..];
        let at = hurst * STEPS as f32;
        let step = (at as usize).min(STEPS - 1);
        let part = at - step as f32;
        let at = |step: usize, j: usize| table[step * (count + 1) + j];
        let between = |j: usize| at(step, j) + part * (at(step + 1, j) - at(step, j));
        let square = sigma * sigma;
        let mut variance = [0f32; MAX_LEVELS];
        for (j, v) in variance.iter_mut().enumerate().take(count) {
            *v = square * between(j) * math::exp2(2.0 * hurst * j as f32);
        }
        let flat = 2.0 * (hurst - 1.0) * count as f32;
        Ok(Levels {
            variance,
            slope: square * between(count) * math::exp2(flat),
            mean: BROAD * BROAD * square * math::powf(side as f32, 2.0 * hurst),
        })
    }

    /// A prior with a given structure function: `structure(d)` \[m²\] is E Δz² at `d`
    /// cells, d from 1 to half the side.
    ///
    /// ```
    /// use rugosa_fractal::pyramid::Levels;
    /// // smooth up to 4 cells, rough beyond [m²]
    /// let rough = |d: f32| 4f32.powf(1.2) * d.powf(0.4);
    /// let ground = |d: f32| 0.01 * if d < 4.0 { d.powf(1.6) } else { rough(d) };
    /// let levels = Levels::measured(65, ground).unwrap();
    /// for lag in [1, 2, 4, 8, 16] {
    ///     let ratio = levels.structure(lag).unwrap() / ground(f32::from(lag));
    ///     assert!((0.85..1.15).contains(&ratio), "{lag} cells: {ratio}");
    /// }
    /// ```
    ///
    /// # Errors
    /// A side that is not 2^k + 1; values that are not positive and finite.
    pub fn measured(side: usize, structure: impl Fn(f32) -> f32) -> Result<Levels, Error> {
        let count = Shape::new(side).ok_or(Error::Side(side))?.levels();
        let n = count + 1;
        let mut gram = [[0.0; nnls::MAX]; nnls::MAX];
        let mut right = [0.0; nnls::MAX];
        let lags = LAGS.iter().take_while(|&&d| 2 * usize::from(d) < side);
        for (lag, &d) in lags.enumerate() {
            let d = f32::from(d);
            let target = structure(d);
            if !(target > 1e-18 && target < 1e18) {
                return Err(Error::Sigma(target));
            }
            let column = |j: usize| if j < count { STRUCTURE[j][lag] } else { d * d };
            for (a, row) in gram.iter_mut().enumerate().take(n) {
                right[a] += column(a) / target;
                for (b, g) in row.iter_mut().enumerate().take(n) {
                    *g += column(a) / target * (column(b) / target);
                }
            }
        }
        for (a, row) in gram.iter_mut().enumerate().take(n) {
            // a touch of ridge: neighbouring levels are nearly alike in single precision
            row[a] *= 1.0 + 1e-5;
        }
        let fit = nnls::solve(&gram, &right, n);
        let mut variance = [0f32; MAX_LEVELS];
        variance[..count].copy_from_slice(&fit[..count]);
        variance[0] = variance[0].max(FINEST_SHARE * structure(1.0));
        let relief = structure(0.25 * side as f32);
        Ok(Levels {
            variance,
            slope: fit[count],
            mean: 4.0 * BROAD * BROAD * relief,
        })
    }

    /// The model's own structure function Σ s_j² V_j + τ²d² \[m²\] at `lag` cells along
    /// an axis; `None` for a lag that is not tabulated.
    pub fn structure(&self, lag: u16) -> Option<f32> {
        let at = LAGS.iter().position(|&d| d == lag)?;
        let d = f32::from(lag);
        let levels = self.variance.iter().zip(&STRUCTURE);
        Some(levels.map(|(s, v)| s * v[at]).sum::<f32>() + self.slope * d * d)
    }
}

/// A prior that changes in space: the levels of square tiles, interpolated bilinearly
/// between the tiles' centres.
#[derive(Clone, Copy, Debug)]
pub struct Field<'a> {
    tiles: &'a [Levels],
    columns: usize,
    edge: usize,
}

impl<'a> Field<'a> {
    /// `tiles` row by row, `columns` in a row, each `edge` × `edge` cells; cells beyond
    /// the last tile take its values.
    ///
    /// ```
    /// use rugosa_fractal::pyramid::{Field, Levels, Prior};
    /// // calm ground in the west, rough ground in the east, 8 × 8 cells each
    /// let tiles = [0.01, 0.09].map(|sigma| Levels::power_law(17, 0.5, sigma).unwrap());
    /// let field = Field::new(&tiles, 2, 8).unwrap();
    /// let finest = |column| field.variance(0, 3, column);
    /// assert_eq!(finest(0), tiles[0].variance(0, 0, 0));
    /// assert_eq!(finest(16), tiles[1].variance(0, 0, 0));
    /// assert!(finest(4) < finest(8) && finest(8) < finest(11)); // between the tiles' centres
    /// ```
    ///
    /// # Errors
    /// No tile, or rows that are not full.
    pub fn new(tiles: &'a [Levels], columns: usize, edge: usize) -> Result<Self, Error> {
        if columns == 0 || edge == 0 || tiles.is_empty() || !tiles.len().is_multiple_of(columns) {
            return Err(Error::Tiles);
        }
        Ok(Field {
            tiles,
            columns,
            edge,
        })
    }

    /// Two neighbours along an axis of `count` tiles and the share of the second.
    fn between(&self, cell: usize, count: usize) -> (usize, usize, f32) {
        let at = (cell as f32 + 0.5) / self.edge as f32 - 0.5;
        let low = (at.max(0.0) as usize).min(count - 1);
        let part = (at - low as f32).clamp(0.0, 1.0);
        (low, (low + 1).min(count - 1), part)
    }
}

impl Prior for Field<'_> {
    fn variance(&self, refinements: usize, row: usize, column: usize) -> f32 {
        let (y0, y1, v) = self.between(row, self.tiles.len() / self.columns);
        let (x0, x1, u) = self.between(column, self.columns);
        let at = |y: usize, x: usize| self.tiles[y * self.columns + x].variance[refinements];
        let low = at(y0, x0) + u * (at(y0, x1) - at(y0, x0));
        let high = at(y1, x0) + u * (at(y1, x1) - at(y1, x0));
        low + v * (high - low)
    }

    fn plane(&self) -> (f32, f32) {
        let share = 1.0 / self.tiles.len() as f32;
        self.tiles.iter().fold((0.0, 0.0), |(slope, mean), t| {
            (slope + share * t.slope, mean + share * t.mean)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn model_is_within_three_percent_of_the_power_law() {
        for side in [33, 65, 129, 257, 1025] {
            for hurst in [0.05, 0.12, 0.2, 0.33, 0.5, 0.62, 0.75, 0.8, 0.9, 0.95] {
                let levels = Levels::power_law(side, hurst, 2.0).unwrap();
                for d in [1u16, 2, 3, 4, 6, 8, 12, 16, 32, 64, 128, 256] {
                    if 4 * usize::from(d) > side {
                        continue;
                    }
                    let ratio =
                        levels.structure(d).unwrap() / (4.0 * f32::from(d).powf(2.0 * hurst));
                    assert!(
                        (ratio - 1.0).abs() < 0.03,
                        "{side} H {hurst} lag {d}: {ratio}"
                    );
                }
            }
        }
    }

    /// Values of the formula worked out independently.
    #[test]
    fn structure_of_single_levels() {
        for (j, lag, expected) in [
            (0, 3, 2.0),
            (1, 1, 0.119_628_906),
            (1, 2, 0.358_886_7),
            (2, 4, 0.257_378_4),
            (3, 8, 0.238_771_6),
            (4, 48, 0.461_072),
            (5, 32, 0.233_377_7),
            (6, 1, 7.805e-5),
        ] {
            let at = LAGS.iter().position(|&d| d == lag).unwrap();
            assert!((STRUCTURE[j][at] - expected).abs() < 1e-6, "V_{j}({lag})");
        }
    }

    #[test]
    fn measured_reaches_a_bent_structure_function() {
        // H from 0.9 at one cell to 0.3 at 16
        let bent = |d: f32| d.powf(1.8) / (1.0 + (d / 5.0).powf(1.2));
        let levels = Levels::measured(257, bent).unwrap();
        for d in [1, 2, 4, 8, 16, 32, 64] {
            let ratio = levels.structure(d).unwrap() / bent(f32::from(d));
            assert!((ratio - 1.0).abs() < 0.04, "lag {d}: {ratio}");
        }
        let power = Levels::measured(257, |d| d).unwrap();
        for d in [1, 2, 4, 8, 16, 32, 64] {
            let ratio = power.structure(d).unwrap() / f32::from(d);
            assert!((ratio - 1.0).abs() < 0.03, "lag {d}: {ratio}");
        }
    }

    #[test]
    fn bad_parameters_are_named() {
        assert_eq!(Levels::power_law(64, 0.5, 1.0), Err(Error::Side(64)));
        assert_eq!(Levels::power_law(65, 1.0, 1.0), Err(Error::Hurst(1.0)));
        assert!(matches!(
            Levels::power_law(65, f32::NAN, 1.0),
            Err(Error::Hurst(_))
        ));
        assert_eq!(Levels::power_law(65, 0.5, 0.0), Err(Error::Sigma(0.0)));
        assert_eq!(Levels::measured(65, |_| 0.0), Err(Error::Sigma(0.0)));
        assert!(matches!(Field::new(&[], 1, 8), Err(Error::Tiles)));
    }

    #[test]
    fn a_field_interpolates_between_centres() {
        let one = Levels::power_law(65, 0.5, 1.0).unwrap();
        let two = Levels::power_law(65, 0.5, 2.0).unwrap();
        let tiles = [one, two];
        let field = Field::new(&tiles, 2, 8).unwrap();
        assert_eq!(field.variance(0, 3, 0), one.variance[0]);
        assert_eq!(field.variance(0, 60, 64), two.variance[0]);
        let middle = 0.5 * (field.variance(0, 0, 7) + field.variance(0, 0, 8));
        assert!((middle / one.variance[0] - 2.5).abs() < 1e-5);
    }
}
