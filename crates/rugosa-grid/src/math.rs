//! The one door to floating-point functions.
//!
//! Every function of the core that is not `+ − × ÷` goes through this module, by path.
//! The implementations are `libm`'s: plain IEEE operations in a fixed order, so the
//! host and a Cortex-M4F give the same bits. The methods of `std` on `f32` call the
//! platform's library instead and differ in the last place; they are not to be used in
//! `crates/*`.
//!
//! Accuracy: all functions here are within 1 unit in the last place; the square root is
//! correctly rounded.

pub use core::f32::consts::{FRAC_PI_2, PI, TAU};

/// Square root, correctly rounded; NaN below zero.
#[inline]
pub fn sqrt(x: f32) -> f32 {
    libm::sqrtf(x)
}

/// Largest integer not above `x`.
#[inline]
pub fn floor(x: f32) -> f32 {
    libm::floorf(x)
}

/// Largest integer not above `x` as a cell index; saturates, NaN gives 0.
///
/// Truncation and one comparison: exact for negative numbers and borders.
#[inline]
pub fn floor_index(x: f32) -> i32 {
    let truncated = x as i32;
    truncated.saturating_sub(i32::from((truncated as f32) > x))
}

/// Nearest integer, ties away from zero; saturates, NaN gives 0.
#[inline]
pub fn round_index(x: f32) -> i32 {
    (x + if x < 0.0 { -0.5 } else { 0.5 }) as i32
}

/// Absolute value (a bit operation).
#[inline]
pub fn abs(x: f32) -> f32 {
    f32::from_bits(x.to_bits() & 0x7fff_ffff)
}

/// Sine of an angle in radians. Not for the path of single returns: use tables.
pub fn sin(x: f32) -> f32 {
    libm::sinf(x)
}

/// Cosine of an angle in radians. Not for the path of single returns: use tables.
pub fn cos(x: f32) -> f32 {
    libm::cosf(x)
}

/// Tangent of an angle in radians.
pub fn tan(x: f32) -> f32 {
    libm::tanf(x)
}

/// Angle of the vector (x, y) in radians, in (−π, π].
pub fn atan2(y: f32, x: f32) -> f32 {
    libm::atan2f(y, x)
}

/// Inverse sine in radians.
pub fn asin(x: f32) -> f32 {
    libm::asinf(x)
}

/// Natural logarithm.
pub fn ln(x: f32) -> f32 {
    libm::logf(x)
}

/// Binary logarithm.
pub fn log2(x: f32) -> f32 {
    libm::log2f(x)
}

/// e to the power `x`.
pub fn exp(x: f32) -> f32 {
    libm::expf(x)
}

/// 2 to the power `x`.
pub fn exp2(x: f32) -> f32 {
    libm::exp2f(x)
}

/// `x` to the power `y`, x ≥ 0.
pub fn powf(x: f32, y: f32) -> f32 {
    libm::powf(x, y)
}

/// Complementary error function.
pub fn erfc(x: f32) -> f32 {
    libm::erfcf(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn floor_index_at_negative_numbers_and_borders() {
        for (x, i) in [
            (0.0, 0),
            (-0.0, 0),
            (0.999, 0),
            (1.0, 1),
            (-0.001, -1),
            (-1.0, -1),
            (-1.001, -2),
        ] {
            assert_eq!(floor_index(x), i, "{x}");
        }
        assert_eq!(floor_index(f32::NAN), 0);
        assert_eq!(floor_index(1e20), i32::MAX);
        assert_eq!(floor_index(-1e20), i32::MIN);
        assert_eq!(floor_index(f32::NEG_INFINITY), i32::MIN);
    }

    #[test]
    fn round_index_is_symmetric() {
        for (x, i) in [(0.4, 0), (0.5, 1), (-0.5, -1), (-1.4, -1), (2.6, 3)] {
            assert_eq!(round_index(x), i, "{x}");
        }
    }
}
