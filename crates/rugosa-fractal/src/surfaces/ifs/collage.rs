//! The collage fit: every combination regressed on the data by itself.
//!
//! The data of depth p contain the tables of depth 1 … p by decimation. If they were a
//! projected IFS, each new point of depth k + 1 would be its combination of points of depth
//! k; so each triple of weights is one 3 × 3 least-squares problem over all places where it
//! occurs. Exact on noise-free surfaces of the model; on terrain it is a start for [`fit`],
//! not a result (16–21 dB on 82² samples where the fit reaches 22–27).
//!
//! Cost: one pass over the data. Source: the "collage" step of fractal coding.
//!
//! [`fit`]: super::fit()

use super::stencil::Stencil;
use super::tabulate::{Patch, side_of};
use super::{Ifs, Variant};
use alloc::{vec, vec::Vec};
use nalgebra::{Matrix3, Vector3};

/// Normal equations of one triple of weights, around the bilinear ones.
#[derive(Clone, Copy)]
struct Triple {
    matrix: Matrix3<f64>,
    right: Vector3<f64>,
}

/// Fits control heights (copied) and weights to `data`, (3^p + 1)² samples.
///
/// ```
/// use rugosa_fractal::surfaces::ifs::{Ifs, Variant, collage};
/// // a surface of the model itself, 28 × 28 samples
/// let heights = core::array::from_fn(|i| (i * i % 11) as f64);
/// let mut parameters = Ifs::bilinear(Variant::Tied, &heights).parameters().to_vec();
/// parameters[16..].iter_mut().for_each(|weight| *weight *= 0.8);
/// let data = Ifs::from_parameters(Variant::Tied, parameters).unwrap().tabulate(3);
/// let found = collage(&data, 3, Variant::Tied).tabulate(3);
/// assert!(data.iter().zip(found).all(|(z, found)| (z - found).abs() < 1e-3));
/// ```
pub fn collage(data: &[f64], depth: u32, variant: Variant) -> Ifs {
    let levels: Vec<Vec<f64>> = (1..=depth).map(|k| decimated(data, depth, k)).collect();
    let heights = core::array::from_fn(|i| levels[0][i]);
    let mut ifs = Ifs::bilinear(variant, &heights);
    let stencil = Stencil::new(variant);
    let mut triples = vec![
        Triple {
            matrix: Matrix3::zeros(),
            right: Vector3::zeros()
        };
        ifs.parameters.len()
    ];
    for (level, pair) in levels.windows(2).enumerate() {
        let side = side_of(level as u32 + 1);
        for patch in Patch::all(variant, side) {
            let z = patch.heights(&pair[0], side);
            for point in stencil.points.iter().filter(|p| p.weight > 0) {
                let place = patch.fine(point.target, 3 * side - 2);
                let share = patch.share(point.target, side);
                let first = z[point.sources[0]];
                let differences = Vector3::from_fn(|c, _| z[point.sources[c + 1]] - first);
                let bilinear =
                    Vector3::from_column_slice(&ifs.parameters[point.weight..point.weight + 3]);
                let rest = pair[1][place] - first - differences.dot(&bilinear);
                let triple = &mut triples[point.weight];
                triple.matrix += share * differences * differences.transpose();
                triple.right += share * rest * differences;
            }
        }
    }
    for (weight, triple) in triples
        .iter()
        .enumerate()
        .filter(|(_, t)| t.matrix.trace() > 0.0)
    {
        let damped = triple.matrix + Matrix3::identity() * (1e-12 * triple.matrix.trace());
        if let Some(step) = damped.cholesky().map(|c| c.solve(&triple.right)) {
            (0..3).for_each(|c| ifs.parameters[weight + c] += step[c]);
        }
    }
    ifs
}

/// Every 3^(p − k)-th sample.
fn decimated(data: &[f64], depth: u32, level: u32) -> Vec<f64> {
    let (side, step, whole) = (side_of(level), 3usize.pow(depth - level), side_of(depth));
    (0..side * side)
        .map(|i| data[(i / side) * step * whole + (i % side) * step])
        .collect()
}
