//! Local roughness of a raster: an estimate in every window of a lattice of windows.
//!
//! Holes cost pairs, not windows: a window has an estimate as soon as enough pairs of
//! known nodes are left. What the estimate rests on is the structure function of the
//! window alone ([`estimate_raster`]), so neighbouring windows that overlap are not
//! independent.
//!
//! R² is the squared correlation of ln lag and ln σ(lag) (noise taken off) over the
//! scaling range; it tells how straight the plot is, not how sure D is: for that there is
//! the standard error.

use crate::io::Raster;
use rugosa_fractal::roughness::irregular::{self, Estimate, Options, estimate_raster};

/// Size and distance of the windows, in nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Windows {
    /// nodes along an edge
    pub side: usize,
    /// nodes from one window to the next
    pub step: usize,
}

/// What a window says; NaN where it says nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Local {
    /// fractal dimension
    pub dimension: f32,
    /// Hurst exponent
    pub hurst: f32,
    /// rms elevation difference at 1 m \[m\]
    pub sigma: f32,
    /// standard error of dimension and Hurst exponent
    pub standard_error: f32,
    /// squared correlation in the log–log plot
    pub r2: f32,
}

impl Local {
    const NONE: Local = Local {
        dimension: f32::NAN,
        hurst: f32::NAN,
        sigma: f32::NAN,
        standard_error: f32::NAN,
        r2: f32::NAN,
    };
}

impl Windows {
    /// Windows that fit along `nodes`.
    pub fn along(&self, nodes: usize) -> usize {
        nodes
            .checked_sub(self.side)
            .map_or(0, |rest| rest / self.step + 1)
    }

    /// Estimates all windows, row by row of windows; `watch` is told how many are done.
    pub fn estimate(
        &self,
        raster: &Raster,
        options: &Options,
        mut watch: impl FnMut(usize),
    ) -> Vec<Local> {
        let (rows, columns) = (self.along(raster.rows), self.along(raster.columns));
        let mut locals = Vec::with_capacity(rows * columns);
        for row in 0..rows {
            let places = (0..columns).map(|column| [row * self.step, column * self.step]);
            locals.extend(places.map(|place| self.local(raster, place, options)));
            watch(locals.len());
        }
        locals
    }

    /// The raster of one quantity; its nodes are the centres of the windows.
    pub fn raster(
        &self,
        of: &Raster,
        locals: &[Local],
        quantity: impl Fn(&Local) -> f32,
    ) -> Raster {
        let middle = 0.5 * (self.side - 1) as f64;
        Raster {
            rows: self.along(of.rows),
            columns: self.along(of.columns),
            spacing_x: of.spacing_x * self.step as f64,
            spacing_y: of.spacing_y * self.step as f64,
            origin: [
                of.origin[0] + middle * of.spacing_x,
                of.origin[1] + middle * of.spacing_y,
            ],
            values: locals.iter().map(quantity).collect(),
        }
    }

    fn local(&self, raster: &Raster, [row, column]: [usize; 2], options: &Options) -> Local {
        let rows = (row..row + self.side)
            .map(|i| &raster.values[i * raster.columns + column..][..self.side]);
        let values: Vec<f32> = rows.flatten().copied().collect();
        let window = irregular::Raster {
            values: &values,
            columns: self.side,
            spacing: [raster.spacing_x, raster.spacing_y],
        };
        let estimate = estimate_raster(&window, options);
        let Ok(law) = &estimate.law else {
            return Local::NONE;
        };
        Local {
            dimension: law.dimension as f32,
            hurst: law.hurst as f32,
            sigma: law.sigma as f32,
            standard_error: law.standard_error as f32,
            r2: r2(&estimate, law.range) as f32,
        }
    }
}

/// Squared correlation of ln lag and ln σ over the lags from `low` to `high`.
fn r2(estimate: &Estimate, [low, high]: [f64; 2]) -> f64 {
    let noise = 2.0 * estimate.noise_std * estimate.noise_std;
    let inside = estimate
        .bins
        .iter()
        .filter(|b| (low..=high).contains(&b.lag));
    let points = inside.map(|b| (b.lag.ln(), 0.5 * (b.rms_dz * b.rms_dz - noise).ln()));
    let points: Vec<(f64, f64)> = points.filter(|p| p.1.is_finite()).collect();
    let n = points.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / n;
    let (mx, my) = (mean(|p| p.0), mean(|p| p.1));
    let sum =
        |of: &dyn Fn(f64, f64) -> f64| points.iter().map(|p| of(p.0 - mx, p.1 - my)).sum::<f64>();
    let (xx, xy, yy) = (sum(&|x, _| x * x), sum(&|x, y| x * y), sum(&|_, y| y * y));
    xy * xy / (xx * yy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rugosa_fractal::roughness::irregular::Noise;
    use rugosa_fractal::synthesis::exact_fbm;

    #[test]
    fn a_rough_half_and_a_smooth_half_are_told_apart_across_a_hole() {
        let side = 129;
        let (smooth, rough) = (exact_fbm(side, 0.8, 1), exact_fbm(side, 0.2, 2));
        let pick = |i: usize| {
            if i % side < side / 2 {
                smooth[i]
            } else {
                rough[i]
            }
        };
        let mut values: Vec<f32> = (0..side * side).map(pick).collect();
        for row in 20..40 {
            values[row * side + 10..row * side + 30].fill(f32::NAN);
        }
        let raster = Raster::square(side, side, 1.0, [100.0, 200.0], values);
        let windows = Windows { side: 48, step: 8 };
        let options = Options {
            min_lag: Some(1.0),
            max_lag: Some(8.0),
            noise: Noise::Known(0.0),
            ..Options::default()
        };
        let locals = windows.estimate(&raster, &options, |_| {});
        let map = windows.raster(&raster, &locals, |l| l.dimension);
        assert_eq!((map.rows, map.columns, map.spacing_x), (11, 11, 8.0));
        assert_eq!(map.origin, [123.5, 223.5]);
        for row in 0..11 {
            let (left, right) = (map.at(row, 0), map.at(row, 10));
            assert!(
                (left - 2.2).abs() < 0.25 && (right - 2.8).abs() < 0.15,
                "{left} {right}"
            );
        }
        assert!(
            locals
                .iter()
                .all(|l| l.dimension.is_nan() || (0.0..=1.0).contains(&l.r2))
        );
    }

    #[test]
    fn windows_that_do_not_fit_are_none() {
        let windows = Windows { side: 48, step: 8 };
        assert_eq!(
            (windows.along(47), windows.along(48), windows.along(63)),
            (0, 1, 2)
        );
    }
}
