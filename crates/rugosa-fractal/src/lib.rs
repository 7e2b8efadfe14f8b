//! Fractal roughness, reconstruction and surfaces of natural terrain
#![no_std]
#![forbid(unsafe_code)]
