//! Is a range a measurement?
//!
//! Sentinels follow REP-117: +∞ nothing came back, −∞ closer than the scanner can
//! measure, NaN an erroneous return. Zero and finite values outside the scanner's limits
//! are sorted to the cause they stand for. Nothing else reaches the beam model.

/// Why a range is not a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RangeFault {
    /// +∞: nothing came back
    NoReturn,
    /// −∞, zero, negative or below the limit
    TooClose,
    /// beyond the limit
    TooFar,
    /// NaN
    Erroneous,
}

/// The ranges that a scanner can measure \[m\], both included.
///
/// ```
/// use rugosa_terrain::{RangeFault, RangeLimits};
/// let limits = RangeLimits { min: 0.3, max: 60.0 }; // metres
/// assert_eq!(limits.check(12.5), Ok(12.5));
/// assert_eq!(limits.check(f32::INFINITY), Err(RangeFault::NoReturn));
/// assert_eq!(limits.check(f32::NEG_INFINITY), Err(RangeFault::TooClose));
/// assert_eq!(limits.check(0.0), Err(RangeFault::TooClose));
/// assert_eq!(limits.check(60.1), Err(RangeFault::TooFar));
/// assert_eq!(limits.check(f32::NAN), Err(RangeFault::Erroneous));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeLimits {
    /// shortest, positive
    pub min: f32,
    /// longest
    pub max: f32,
}

impl RangeLimits {
    /// The range itself \[m\] where it is a measurement.
    #[inline]
    pub fn check(&self, range: f32) -> Result<f32, RangeFault> {
        if range >= self.min && range <= self.max && range > 0.0 && range < f32::INFINITY {
            return Ok(range);
        }
        Err(self.fault(range))
    }

    fn fault(&self, range: f32) -> RangeFault {
        if range.is_nan() {
            RangeFault::Erroneous
        } else if range == f32::INFINITY {
            RangeFault::NoReturn
        } else if range > self.max {
            RangeFault::TooFar
        } else {
            RangeFault::TooClose
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_sentinel_has_its_cause() {
        let limits = RangeLimits {
            min: 0.5,
            max: 40.0,
        };
        for (range, expected) in [
            (0.5, Ok(0.5)),
            (40.0, Ok(40.0)),
            (f32::INFINITY, Err(RangeFault::NoReturn)),
            (f32::NEG_INFINITY, Err(RangeFault::TooClose)),
            (0.0, Err(RangeFault::TooClose)),
            (-3.0, Err(RangeFault::TooClose)),
            (0.499, Err(RangeFault::TooClose)),
            (40.001, Err(RangeFault::TooFar)),
            (f32::NAN, Err(RangeFault::Erroneous)),
        ] {
            assert_eq!(limits.check(range), expected, "{range}");
        }
        let careless = RangeLimits {
            min: -1.0,
            max: f32::INFINITY,
        };
        assert_eq!(careless.check(0.0), Err(RangeFault::TooClose));
        assert_eq!(careless.check(f32::INFINITY), Err(RangeFault::NoReturn));
    }
}
