//! Rough-terrain module: roughness, reconstruction and traversability on board
#![no_std]
#![forbid(unsafe_code)]

pub mod config;
pub use config::{Config, ConfigError};
