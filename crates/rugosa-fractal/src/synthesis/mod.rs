//! Surfaces drawn at random: fractional Brownian motion of a given Hurst exponent.
//!
//! | generator | when |
//! |---|---|
//! | [`pyramid`] | no heap, within 3 % of the power law at every lag, any level variances |
//! | [`classic`] | successive random addition as published: the comparison |
//! | [`exact_fbm`] | ground truth of tests and tables: the exact covariance, needs a heap and an FFT (feature `std`) |
//!
//! All are driven by [`rand_core`] generators through one normal generator,
//! [`normal`], so that a seed gives the same bits on every platform (the FFT of
//! [`exact_fbm`] excepted: its last bits depend on the machine).

mod classic;
#[cfg(feature = "std")]
mod exact;
mod normal;
mod pyramid;

pub use classic::classic;

#[cfg(feature = "std")]
pub use exact::{exact_fbm, exact_fbm_pair};
pub use normal::{normal, uniform};
pub use pyramid::pyramid;
