//! Traversability: can the robot stand and drive here?
//!
//! | file | what it does |
//! |---|---|
//! | `features` | slope, step height and the chance of a hidden step, from elevations |
//! | `cost` | features and roughness → one cost and the criterion behind it; scales |
//! | `query` | a footprint at a pose, a path of poses |
//!
//! Each criterion has a *safe* and a *critical* value in its own unit: cost 0 up to the
//! safe one, 1 from the critical one on, linear between. The cost of a cell is that of its
//! worst criterion, so a planner can be told which. What was not seen has no cost (it is
//! unknown, never free); what was seen through is a hole (a negative obstacle).

mod cost;
mod features;
mod query;

pub(crate) use cost::Costs;
pub use cost::{CellCost, Criterion, grid_map, nav2, occupancy};
pub use features::Features;
pub(crate) use features::{Around, Patch};
pub use query::{Footprint, FootprintCost};

/// A criterion's safe and critical value, in its unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// no cost up to here
    pub safe: f32,
    /// impassable from here on
    pub critical: f32,
}

impl Pair {
    /// Cost of a value: 0 … 1; NaN has none.
    ///
    /// ```
    /// let step = rugosa::traversability::Pair { safe: 0.1, critical: 0.3 };
    /// assert_eq!(step.cost(0.05), 0.0);
    /// assert!((step.cost(0.2) - 0.5).abs() < 1e-6);
    /// assert_eq!(step.cost(9.0), 1.0);
    /// ```
    #[inline]
    pub fn cost(&self, value: f32) -> f32 {
        if value >= self.critical {
            1.0
        } else if value > self.safe {
            (value - self.safe) / (self.critical - self.safe)
        } else {
            0.0
        }
    }
}

/// What the robot can do; the defaults are those of a walking or tracked robot of 0.7 m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// slope of the plane through the window \[rad\]
    pub slope: Pair,
    /// greatest difference of elevation to the cell within the window \[m\]
    pub step: Pair,
    /// σ(d) at the wheel base: standard deviation of elevation differences \[m\]
    pub roughness: Pair,
    /// fractal dimension
    pub dimension: Pair,
    /// standard deviation of the elevation \[m\]
    pub uncertainty: Pair,
    /// chance that a step within the window exceeds the critical step
    pub hidden_step: Pair,
    /// radius of the window around a cell \[m\]; at most 8 cells
    pub window: f32,
    /// distance between the contacts with the ground \[m\]
    pub wheel_base: f32,
}

impl Default for Limits {
    fn default() -> Self {
        Limits {
            slope: Pair {
                safe: 0.26,
                critical: 0.61,
            },
            step: Pair {
                safe: 0.1,
                critical: 0.25,
            },
            roughness: Pair {
                safe: 0.05,
                critical: 0.2,
            },
            dimension: Pair {
                safe: 2.8,
                critical: 3.4,
            },
            uncertainty: Pair {
                safe: 0.1,
                critical: 0.3,
            },
            hidden_step: Pair {
                safe: 0.1,
                critical: 0.9,
            },
            window: 0.3,
            wheel_base: 0.5,
        }
    }
}

/// A limit that cannot be used, by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LimitError(pub &'static str);

impl core::fmt::Display for LimitError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(
            f,
            "limit {} is out of range: 0 <= safe < critical, lengths positive",
            self.0
        )
    }
}

impl core::error::Error for LimitError {}

impl Limits {
    /// The pairs by name, in the order of their criteria.
    pub fn pairs(&self) -> [(&'static str, Pair); 6] {
        [
            ("slope", self.slope),
            ("step", self.step),
            ("roughness", self.roughness),
            ("dimension", self.dimension),
            ("uncertainty", self.uncertainty),
            ("hidden_step", self.hidden_step),
        ]
    }

    /// The first limit that cannot be used.
    ///
    /// ```
    /// use rugosa::traversability::{LimitError, Limits, Pair};
    /// let mut limits = Limits::default();
    /// assert_eq!(limits.check(), Ok(()));
    /// limits.dimension = Pair { safe: 2.9, critical: 2.5 };
    /// assert_eq!(limits.check(), Err(LimitError("dimension")));
    /// ```
    pub fn check(&self) -> Result<(), LimitError> {
        let sound = |pair: &Pair| {
            pair.safe >= 0.0 && pair.critical > pair.safe && pair.critical.is_finite()
        };
        for (name, pair) in self.pairs() {
            if !sound(&pair) {
                return Err(LimitError(name));
            }
        }
        for (name, length) in [("window", self.window), ("wheel_base", self.wheel_base)] {
            if !(length > 0.0 && length.is_finite()) {
                return Err(LimitError(name));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_is_a_ramp() {
        let pair = Pair {
            safe: 0.1,
            critical: 0.3,
        };
        for (value, cost) in [(0.0, 0.0), (0.1, 0.0), (0.2, 0.5), (0.3, 1.0), (9.0, 1.0)] {
            assert!((pair.cost(value) - cost).abs() < 1e-6, "{value}");
        }
        assert_eq!(pair.cost(f32::NAN), 0.0);
    }

    #[test]
    fn the_bad_limit_is_named() {
        assert_eq!(Limits::default().check(), Ok(()));
        let mut limits = Limits::default();
        limits.step.critical = 0.05;
        assert_eq!(limits.check(), Err(LimitError("step")));
        let limits = Limits {
            window: f32::NAN,
            ..Limits::default()
        };
        assert_eq!(limits.check(), Err(LimitError("window")));
    }
}
