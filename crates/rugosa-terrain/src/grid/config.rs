//! Parameters of the grid, and what can be wrong with them.

use super::cell::{Gate, RUN_MAX};

/// Which return of a cell becomes its point sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SampleChoice {
    /// one near the cell's centre: the first within a quarter of a cell, before that each at
    /// less than half of the squared distance of the last. The choice is independent of the
    /// height, so differences of samples are unbiased
    #[default]
    Nearest,
    /// the lowest one: the ground under vegetation; lowers and smooths bare ground
    Lowest,
}

/// Parameters of an [`super::ElevationGrid`].
///
/// ```
/// use rugosa_terrain::{GridConfig, GridError, SampleChoice};
/// let config = GridConfig::new(0.2);
/// assert_eq!((config.relief, config.clearing_margin), (0.1, 0.2)); // metres
/// // under vegetation, heights in centimetres
/// let config = GridConfig { sample: SampleChoice::Lowest, height_step: 0.01, ..config };
/// assert_eq!(config.validate(), Ok(()));
/// let never = GridConfig { restart_after: 0, ..config };
/// assert_eq!(never.validate(), Err(GridError::Parameter("restart_after")));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridConfig {
    /// cell edge \[m\]
    pub resolution: f32,
    /// unit of the stored integer heights \[m\]; ±32767 of them must span the terrain
    pub height_step: f32,
    /// gate of the fusion, in standard deviations
    pub gate: f32,
    /// standard deviation of true heights inside one cell \[m\]
    pub relief: f32,
    /// gated returns in a row after which a cell starts afresh, 1 … 7
    pub restart_after: u8,
    /// which return becomes the point sample
    pub sample: SampleChoice,
    /// how far below a cell's elevation a beam must pass to clear it \[m\]
    pub clearing_margin: f32,
}

impl GridConfig {
    /// The defaults for cells of `resolution` metres: heights in half millimetres, 3 σ,
    /// the relief of a slope of 60° (tan 60° / √12 = half a cell), 4 returns, the nearest
    /// return, a clearing margin of one cell.
    pub fn new(resolution: f32) -> Self {
        GridConfig {
            resolution,
            height_step: 0.0005,
            gate: 3.0,
            relief: 0.5 * resolution,
            restart_after: 4,
            sample: SampleChoice::Nearest,
            clearing_margin: resolution,
        }
    }

    /// The first parameter that cannot be used, by name.
    pub fn validate(&self) -> Result<(), GridError> {
        let not_negative = |x: f32| x >= 0.0 && x.is_finite();
        let positive = |x: f32| x > 0.0 && x.is_normal() && (1.0 / x).is_finite();
        let checks = [
            ("resolution", positive(self.resolution)),
            ("height_step", positive(self.height_step)),
            ("gate", positive(self.gate)),
            ("relief", not_negative(self.relief)),
            ("restart_after", (1..=RUN_MAX).contains(&self.restart_after)),
            ("clearing_margin", not_negative(self.clearing_margin)),
        ];
        match checks.iter().find(|(_, good)| !good) {
            Some((name, _)) => Err(GridError::Parameter(name)),
            None => Ok(()),
        }
    }

    pub(super) fn gate(&self) -> Gate {
        Gate {
            sigmas2: self.gate * self.gate,
            relief2: self.relief * self.relief,
            floor: self.height_step * self.height_step / 12.0,
            restart_after: u16::from(self.restart_after),
        }
    }
}

/// Why a grid cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GridError {
    /// this parameter is not finite, not positive or out of range
    Parameter(&'static str),
    /// both planes must hold this many cells
    PlaneLength(usize),
}

impl core::fmt::Display for GridError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            GridError::Parameter(name) => write!(f, "{name} is out of range"),
            GridError::PlaneLength(n) => write!(f, "the planes of the grid must hold {n} cells"),
        }
    }
}

impl core::error::Error for GridError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bad_parameter_is_named() {
        let good = GridConfig::new(0.1);
        assert_eq!(good.validate(), Ok(()));
        let cases = [
            (
                "resolution",
                GridConfig {
                    resolution: 0.0,
                    ..good
                },
            ),
            (
                "resolution",
                GridConfig {
                    resolution: f32::NAN,
                    ..good
                },
            ),
            (
                "height_step",
                GridConfig {
                    height_step: -1.0,
                    ..good
                },
            ),
            (
                "gate",
                GridConfig {
                    gate: f32::INFINITY,
                    ..good
                },
            ),
            (
                "relief",
                GridConfig {
                    relief: -0.1,
                    ..good
                },
            ),
            (
                "restart_after",
                GridConfig {
                    restart_after: 8,
                    ..good
                },
            ),
            (
                "restart_after",
                GridConfig {
                    restart_after: 0,
                    ..good
                },
            ),
            (
                "clearing_margin",
                GridConfig {
                    clearing_margin: f32::NAN,
                    ..good
                },
            ),
        ];
        for (name, config) in cases {
            assert_eq!(config.validate(), Err(GridError::Parameter(name)));
        }
    }
}
