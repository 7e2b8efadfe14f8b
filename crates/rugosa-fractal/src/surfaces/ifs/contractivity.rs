//! Does the surface exist at infinite depth?
//!
//! The nine maps of a patch to its subpatches are 16 × 16 matrices T whose rows sum to one.
//! On differences of heights the natural norm of a product is
//! τ = ½ max over pairs of rows ‖row_i − row_j‖₁. If τ < 1 for all products of some length
//! k, the attractor exists and is continuous: *proved*. The largest |λ₂|^{1/k} over
//! products of length k is a lower bound of the joint spectral radius: at 1 or above, some
//! sequence of subdivisions grows and deeper tables *diverge*. Between the two nothing is
//! decided.
//!
//! Nothing in the model forces contractivity: unregularised fits of natural terrain
//! diverge when tabulated deeper than they were fitted. The ridge of the fit cures that.
//!
//! Cost: 9 + 81 + 729 products of 16 × 16 and 90 spectral radii of 15 × 15.

use super::stencil::{COARSE, FINE, Stencil, turned};
use super::{Ifs, Variant};
use alloc::vec::Vec;
use nalgebra::SMatrix;

type Map = SMatrix<f64, 16, 16>;

/// What is known about deeper tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// τ < 1 for words of some length up to 3: tables of any depth converge
    Proved,
    /// neither proved nor disproved
    NotDisproved,
    /// some subdivision sequence grows: do not tabulate deeper than the fit
    Diverges,
}

impl Verdict {
    /// "proved", "not disproved" or "diverges".
    ///
    /// ```
    /// use rugosa_fractal::surfaces::ifs::Verdict;
    /// assert_eq!(Verdict::NotDisproved.as_str(), "not disproved");
    /// ```
    pub fn as_str(self) -> &'static str {
        match self {
            Verdict::Proved => "proved",
            Verdict::NotDisproved => "not disproved",
            Verdict::Diverges => "diverges",
        }
    }
}

/// The figures behind a verdict.
#[derive(Clone, Copy, Debug)]
pub struct Contractivity {
    /// largest τ of words of length 1, 2, 3
    pub tau: [f64; 3],
    /// lower bound of the joint spectral radius, from words of length 1 and 2
    pub radius: f64,
    /// the verdict
    pub verdict: Verdict,
}

/// Examines a surface.
///
/// ```
/// use rugosa_fractal::surfaces::ifs::{Ifs, Variant, Verdict, contractivity};
/// let bilinear = Ifs::bilinear(Variant::Tied, &[0.0; 16]);
/// let tame = contractivity(&bilinear);
/// // one subdivision may keep two heights apart, two bring all of them together
/// assert!((tame.tau[0] - 1.0).abs() < 1e-9 && tame.tau[1] < 0.9);
/// assert_eq!(tame.verdict, Verdict::Proved);
/// // weights three times as large let every subdivision grow
/// let mut parameters = bilinear.parameters().to_vec();
/// parameters[16..].iter_mut().for_each(|weight| *weight *= 3.0);
/// let wild = contractivity(&Ifs::from_parameters(Variant::Tied, parameters).unwrap());
/// assert!(wild.verdict == Verdict::Diverges && wild.radius > 1.0);
/// ```
pub fn contractivity(ifs: &Ifs) -> Contractivity {
    let maps = maps(ifs);
    let pairs = products(&maps, &maps);
    let triples = products(&pairs, &maps);
    let largest = |words: &[Map]| words.iter().map(tau).fold(0.0, f64::max);
    let tau = [largest(&maps), largest(&pairs), largest(&triples)];
    let single = maps.iter().map(second_eigenvalue).fold(0.0, f64::max);
    let double = pairs.iter().map(second_eigenvalue).fold(0.0, f64::max);
    let radius = single.max(libm::sqrt(double));
    let verdict = if tau.iter().any(|t| *t < 1.0) {
        Verdict::Proved
    } else if radius < 1.0 {
        Verdict::NotDisproved
    } else {
        Verdict::Diverges
    };
    Contractivity {
        tau,
        radius,
        verdict,
    }
}

/// The maps of a patch to its nine subpatches: heights of the subpatch = T · heights.
fn maps(ifs: &Ifs) -> Vec<Map> {
    let stencil = Stencil::new(ifs.variant());
    let mut rows = [[0.0; 16]; FINE * FINE];
    for point in &stencil.points {
        let weights = Stencil::weights(point, ifs.parameters());
        for (w, &source) in weights.iter().zip(&point.sources) {
            rows[point.target][source] += w;
        }
    }
    (0..9)
        .map(|child| Map::from_fn(|i, j| rows[place(ifs.variant(), child, i)][j]))
        .collect()
}

/// Point i of a subpatch in the 10 × 10 grid. A subpatch is mirrored against its parent
/// when its own index is odd, whichever way the parent lies.
fn place(variant: Variant, child: usize, i: usize) -> usize {
    let row = 3 * (child / 3) + turned(variant, child / 3, i / COARSE, 3);
    row * FINE + 3 * (child % 3) + turned(variant, child % 3, i % COARSE, 3)
}

fn products(a: &[Map], b: &[Map]) -> Vec<Map> {
    a.iter()
        .flat_map(|a| b.iter().map(move |b| a * b))
        .collect()
}

/// ½ max ‖row_i − row_j‖₁.
fn tau(map: &Map) -> f64 {
    let mut largest = 0.0f64;
    for i in 0..16 {
        for j in 0..i {
            largest = largest.max((map.row(i) - map.row(j)).abs().sum());
        }
    }
    0.5 * largest
}

/// Largest |eigenvalue| on differences: the map of d_j = z_j − z_0 has T_ij − T_0j. By
/// repeated squaring, |λ| = ‖M^k‖^{1/k} with k = 2³⁰: no case without convergence, unlike the
/// QR iteration, and the norm's constant is gone to 1e-8.
fn second_eigenvalue(map: &Map) -> f64 {
    let mut power = SMatrix::<f64, 15, 15>::from_fn(|i, j| map[(i + 1, j + 1)] - map[(0, j + 1)]);
    let (mut logarithm, mut share) = (0.0, 1.0);
    for _ in 0..30 {
        let norm = power.norm();
        if norm == 0.0 || !norm.is_finite() {
            return norm;
        }
        logarithm += share * libm::log(norm);
        share *= 0.5;
        power /= norm;
        power *= power.clone_owned();
    }
    libm::exp(logarithm)
}
