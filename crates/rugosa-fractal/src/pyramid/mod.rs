//! The pyramid prior and its posterior: reconstruction from sparse elevations.
//!
//! A surface is a sum over scales (successive random addition as a model, not as an
//! algorithm): u = Σ_l P_l (s_l ∘ w_l) + plane. With elevations d_i of variance r_i in
//! some cells, the posterior of w is Gaussian; its mean minimises
//! |w|² + Σ (d_i − u_i)² / r_i.
//!
//! | file | what |
//! |---|---|
//! | `shape` | sizes and addresses of the levels |
//! | `refine` | cubic B-spline refinement and its transpose |
//! | `levels` | level variances from H and σ, from a map of them, from a measured structure function |
//! | `operator` | packed vectors ↔ surfaces |
//! | `tree` | the preconditioner |
//! | `posterior` | conjugate gradients with a budget, warm starts, moves |
//! | `output` | mean, realisation, standard deviation |
//! | `spread` | deviation and a draw from the preconditioner, for a target that solves once |
//!
//! All memory is lent: [`Posterior::need`] states how much.

mod levels;
mod nnls;
mod operator;
mod output;
mod posterior;
mod refine;
mod shape;
mod simd;
mod spread;
mod tree;

pub use levels::{Field, Levels, MAX_LEVELS, Prior};
pub use output::Draws;
pub use posterior::{Datum, Intake, Posterior, Progress};
pub use shape::{MAX_SIDE, MIN_SIDE};
pub use spread::Finest;

/// What can be wrong with a request.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Error {
    /// the side is not 2^k + 1 between [`MIN_SIDE`] and [`MAX_SIDE`]
    Side(usize),
    /// the Hurst exponent is not inside (0, 1)
    Hurst(f32),
    /// σ or a structure function is not positive and finite
    Sigma(f32),
    /// tiles that do not form full rows
    Tiles,
    /// the lent memory is too small: elements needed
    Memory(usize),
}

impl core::fmt::Display for Error {
    fn fmt(&self, f: &mut core::fmt::Formatter) -> core::fmt::Result {
        match self {
            Error::Side(n) => write!(f, "side {n} is not 2^k + 1 from {MIN_SIDE} to {MAX_SIDE}"),
            Error::Hurst(h) => write!(f, "hurst {h} is not between 0 and 1"),
            Error::Sigma(s) => write!(f, "sigma {s} is not positive and finite"),
            Error::Tiles => write!(f, "the tiles of a roughness map must form full rows"),
            Error::Memory(n) => write!(f, "{n} elements of memory are needed"),
        }
    }
}

impl core::error::Error for Error {}
