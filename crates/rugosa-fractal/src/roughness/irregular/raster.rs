//! Structure function of a raster with holes and unequal spacing.
//!
//! Pairs are met offset by offset, a row at a time. A dense raster has far more pairs than
//! it has information, so each annulus uses at most [`MOST_OFFSETS`] offsets, taken evenly
//! around the half circle.
//!
//! Cost: 64 annuli × 48 offsets × number of nodes at most, about 0.5 ns each.

use super::pairs::{Bins, Sums};
use super::power_law::Region;
use super::{Estimate, Options, bins, fit};
use alloc::vec;
use alloc::vec::Vec;

/// Heights on the nodes of a rectangular lattice.
#[derive(Clone, Copy, Debug)]
pub struct Raster<'a> {
    /// heights \[m\], row by row; NaN where unknown
    pub values: &'a [f32],
    /// nodes per row
    pub columns: usize,
    /// distance of columns and of rows \[m\]
    pub spacing: [f64; 2],
}

/// Offsets per annulus, at most.
pub const MOST_OFFSETS: usize = 48;

/// Structure function and power law of a raster. Default lags: from the finer spacing to a
/// tenth of the side.
///
/// ```
/// use rugosa_fractal::roughness::irregular::{Noise, Options, Raster, estimate_raster};
/// # use rand_core::SeedableRng;
/// # use rugosa_fractal::pyramid::{Levels, Posterior};
/// # let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(1);
/// # let (mut memory, mut z) = (vec![0.0; Posterior::need(129).unwrap()], vec![0.0; 129 * 129]);
/// # let prior = Levels::power_law(129, 0.5, 0.3).unwrap();
/// # rugosa_fractal::synthesis::pyramid((129, &prior), &mut rng, &mut memory, &mut z).unwrap();
/// // 129 × 129 heights z of dimension 2.5, nodes 2 m apart, a tenth of them unknown
/// z.iter_mut().step_by(10).for_each(|z| *z = f32::NAN);
/// let raster = Raster { values: &z, columns: 129, spacing: [2.0, 2.0] };
/// let options = Options { noise: Noise::Known(0.0), ..Options::default() };
/// let law = estimate_raster(&raster, &options).law.unwrap();
/// assert!((law.dimension - 2.5).abs() < 0.1);
/// assert!((law.sigma - 0.3 / 2f64.sqrt()).abs() < 0.03); // 0.3 m at 2 m
/// ```
pub fn estimate_raster(raster: &Raster, options: &Options) -> Estimate {
    let rows = raster.values.len() / raster.columns.max(1);
    let side =
        libm::sqrt(raster.spacing[0] * raster.columns as f64 * raster.spacing[1] * rows as f64);
    let finest = raster.spacing[0].min(raster.spacing[1]);
    let bins = bins(options, 2.0 * finest, side);
    let region = Region {
        side,
        points: raster.values.iter().filter(|z| z.is_finite()).count(),
    };
    fit(&sums(raster, &bins), &bins, &region, options)
}

/// The sums of all annuli.
///
/// ```
/// use rugosa_fractal::roughness::irregular::{Raster, pairs::Bins, raster::sums};
/// // two rows, columns 1 m apart, rows 3 m apart; one step of 0.5 m to the right
/// let values = [0.0, 0.5, 0.5, 0.0, 0.5, f32::NAN];
/// let raster = Raster { values: &values, columns: 3, spacing: [1.0, 3.0] };
/// let near = sums(&raster, &Bins { low: 0.5, width: 1.0, count: 1 })[0];
/// assert_eq!((near.pairs, near.absolute, near.distance), (3.0, 1.0, 3.0));
/// ```
pub fn sums(raster: &Raster, bins: &Bins) -> Vec<Sums> {
    let offsets = offsets(raster, bins);
    let sum = |offsets: &Vec<(isize, usize)>| {
        let mut sums = Sums::default();
        let step = offsets.len().div_ceil(MOST_OFFSETS).max(1);
        offsets
            .iter()
            .step_by(step)
            .for_each(|&offset| add_offset(raster, offset, &mut sums));
        sums
    };
    offsets.iter().map(sum).collect()
}

/// The offsets (columns, rows) of the half plane in each annulus, by direction.
fn offsets(raster: &Raster, bins: &Bins) -> Vec<Vec<(isize, usize)>> {
    let [dx, dy] = raster.spacing;
    let (across, up) = ((bins.high() / dx) as isize, (bins.high() / dy) as usize);
    let mut offsets = vec![Vec::new(); bins.count];
    for y in 0..=up {
        for x in if y == 0 { 1..=across } else { -across..=across } {
            let distance = libm::hypot(x as f64 * dx, y as f64 * dy);
            if let Some(bin) = bins.of(distance) {
                offsets[bin].push((x, y));
            }
        }
    }
    for list in &mut offsets {
        list.sort_by(|a, b| direction(a, raster).total_cmp(&direction(b, raster)));
    }
    offsets
}

fn direction(&(x, y): &(isize, usize), raster: &Raster) -> f64 {
    libm::atan2(y as f64 * raster.spacing[1], x as f64 * raster.spacing[0])
}

fn add_offset(raster: &Raster, (x, y): (isize, usize), sums: &mut Sums) {
    let columns = raster.columns;
    let rows = raster.values.len() / columns;
    let shift = x.unsigned_abs();
    if shift >= columns {
        return;
    }
    let (from, to) = if x < 0 { (shift, 0) } else { (0, shift) };
    let mut total = [0.0f64; 3];
    for row in 0..rows.saturating_sub(y) {
        let lower = &raster.values[row * columns + from..][..columns - shift];
        let upper = &raster.values[(row + y) * columns + to..][..columns - shift];
        let part = row_sums(lower, upper);
        (0..3).for_each(|k| total[k] += f64::from(part[k]));
    }
    let distance = libm::hypot(x as f64 * raster.spacing[0], y as f64 * raster.spacing[1]);
    sums.pairs += total[0];
    sums.absolute += total[1];
    sums.square += total[2];
    sums.distance += total[0] * distance * distance;
    sums.quartic += total[0] * libm::pow(distance, 4.0);
}

/// Pairs, Σ |Δz| and Σ Δz² of two rows; a NaN on either side is no pair.
fn row_sums(lower: &[f32], upper: &[f32]) -> [f32; 3] {
    const LANES: usize = 8;
    let mut lanes = [[0.0f32; LANES]; 3];
    for (a, b) in lower.chunks(LANES).zip(upper.chunks(LANES)) {
        for (k, (a, b)) in a.iter().zip(b).enumerate() {
            let difference = b - a;
            let (seen, difference) = if difference.is_nan() {
                (0.0, 0.0)
            } else {
                (1.0, difference)
            };
            lanes[0][k] += seen;
            lanes[1][k] += difference.abs();
            lanes[2][k] += difference * difference;
        }
    }
    lanes.map(|lane| lane.iter().sum())
}

#[cfg(test)]
mod tests {
    use super::super::pairs;
    use super::*;

    #[test]
    fn equals_the_points_of_the_raster() {
        let (columns, rows, spacing) = (37, 29, [0.5, 0.8]);
        let height = |i: usize| {
            if i % 11 == 3 {
                f32::NAN
            } else {
                (i * i % 101) as f32
            }
        };
        let values: Vec<f32> = (0..columns * rows).map(height).collect();
        let points: Vec<[f64; 3]> = (0..columns * rows)
            .filter(|&i| !values[i].is_nan())
            .map(|i| {
                [
                    (i % columns) as f64 * spacing[0],
                    (i / columns) as f64 * spacing[1],
                    f64::from(values[i]),
                ]
            })
            .collect();
        let bins = Bins {
            low: 0.45,
            width: 0.3,
            count: 8,
        };
        let by_raster = sums(
            &Raster {
                values: &values,
                columns,
                spacing,
            },
            &bins,
        );
        for (a, b) in by_raster.iter().zip(pairs::sums(&points, &bins)) {
            assert_eq!(a.pairs, b.pairs);
            assert!((a.absolute - b.absolute).abs() <= 1e-5 * b.absolute);
            assert!((a.square - b.square).abs() <= 1e-5 * b.square);
            assert!((a.distance - b.distance).abs() <= 1e-5 * b.distance);
        }
    }
}
