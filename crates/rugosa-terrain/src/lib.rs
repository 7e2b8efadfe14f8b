//! Beams to points to a moving elevation grid
#![no_std]
#![forbid(unsafe_code)]
