//! Fractal roughness: structure function, scaling range, Hurst exponent and dimension.
//!
//! samples of a map → [`StructureFunction`] (integer counters per tile and lag) →
//! [`Pool`] (3 × 3 tiles, or all) → [`estimate()`] → [`Roughness`] or a [`Reason`].

pub mod block;
pub mod estimate;
mod fit;
#[cfg(feature = "alloc")]
pub mod irregular;
mod nearby;
pub mod offsets;
pub mod pool;
pub mod scaling_range;
pub mod structure;
pub mod sums;

pub use block::Block;
pub use estimate::{Method, Reason, Roughness, Settings, Trend, estimate};
pub use offsets::{LAG_CELLS, LAGS, OFFSETS};
pub use pool::{Moment, Pool, Pools};
pub use structure::{Committed, StructureFunction};
pub use sums::{LagSums, TileSums};

#[cfg(test)]
mod history;
#[cfg(all(test, feature = "std"))]
mod surfaces;
