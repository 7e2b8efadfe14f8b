//! Fractal roughness, reconstruction and surfaces of natural terrain
#![no_std]
#![forbid(unsafe_code)]

#[cfg(feature = "alloc")]
extern crate alloc;
#[cfg(any(test, feature = "std"))]
extern crate std;

pub mod ak96;
pub mod codec;
pub mod pyramid;
pub mod roughness;
pub mod surfaces;
pub mod synthesis;
