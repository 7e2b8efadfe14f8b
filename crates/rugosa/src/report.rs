//! What a sweep did to the map.

use rugosa_fractal::pyramid::Progress;
use rugosa_fractal::roughness::{Reason, Roughness};

/// The end of one sweep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SweepReport {
    /// running number of the sweep
    pub sweep: u32,
    /// line messages that were mapped in it
    pub lines: u32,
    /// cells whose sample changed
    pub samples: u32,
    /// tiles whose roughness was estimated anew
    pub tiles: u32,
    /// cells that hold a sample now
    pub measured: u32,
    /// how far the reconstruction came; `None` where none is kept
    pub reconstruction: Option<Progress>,
    /// roughness of the whole map, or why there is none
    pub roughness: Result<Roughness, Reason>,
}

/// Stages of [`crate::Mapper::commit`], for those who measure their cost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// new samples are in the counters
    Counters,
    /// roughness is refreshed
    Roughness,
    /// the mean is up to date
    Reconstruction,
    /// costs are refreshed
    Traversability,
}
