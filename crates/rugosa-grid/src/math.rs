//! The one door to floating-point functions.
//!
//! Every function of the core that is not `+ − × ÷` goes through this module, by path.
//! Plain IEEE operations in a fixed order, so the host and a Cortex-M4F give the same
//! bits; most are `libm`'s. The methods of `std` on `f32` call the platform's library
//! instead and differ in the last place; they are not to be used in `crates/*`.
//!
//! Two groups are worked out here. Sine, cosine and what follows from them, because
//! `libm`'s do their arithmetic in double precision, which on a Cortex-M4F is software,
//! 7 kB of it. Exponential and natural logarithm, because `libm`'s branch for each
//! number: without branches the compiler takes those of several lags at once, in vectors.
//! (Those of the crate `wide` fuse products and sums where a processor can, which changes bits.)
//!
//! Accuracy: `libm`'s functions are within 1 unit in the last place, the square root is
//! correctly rounded; sine and cosine err by less than 1e-7, tangent and inverse sine by
//! less than 3e-7 of their value or 1e-7, the exponential by less than 2e-7 of its value, the
//! logarithm by less than 1e-7 of it or 1e-7.
//!
//! ```
//! use rugosa_grid::math;
//! assert_eq!((math::sqrt(2.25), math::floor(-0.5), math::abs(-3.0)), (1.5, -1.0, 3.0));
//! assert_eq!((math::log2(0.125), math::exp2(3.0), math::powf(4.0, 1.5)), (-3.0, 8.0, 8.0));
//! // a standard normal number lies beyond two deviations with a chance of 4.55 %
//! assert!((math::erfc(math::sqrt(2.0)) - 0.0455).abs() < 1e-5);
//! ```

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
///
/// ```
/// use rugosa_grid::math::floor_index;
/// assert_eq!([1.0, 0.5, -1e-6, -1.0].map(floor_index), [1, 0, -1, -1]);
/// assert_eq!((floor_index(1e20), floor_index(f32::NAN)), (i32::MAX, 0));
/// ```
#[inline]
pub fn floor_index(x: f32) -> i32 {
    let truncated = x as i32;
    truncated.saturating_sub(i32::from((truncated as f32) > x))
}

/// Nearest integer, ties away from zero; saturates, NaN gives 0.
///
/// ```
/// use rugosa_grid::math::round_index;
/// assert_eq!([0.4, 0.5, -0.5, -1.4].map(round_index), [0, 1, -1, -1]);
/// ```
#[inline]
pub fn round_index(x: f32) -> i32 {
    (x + if x < 0.0 { -0.5 } else { 0.5 }) as i32
}

/// Absolute value (a bit operation).
#[inline]
pub fn abs(x: f32) -> f32 {
    f32::from_bits(x.to_bits() & 0x7fff_ffff)
}

/// Sine of an angle in radians, |x| ≤ 1000; NaN where x is not finite. Not for the path of
/// single returns: use tables.
///
/// ```
/// use rugosa_grid::math::{FRAC_PI_2, PI, cos, sin, tan};
/// assert!((sin(PI / 6.0) - 0.5).abs() < 1e-7 && (cos(PI / 3.0) - 0.5).abs() < 1e-7);
/// assert!((tan(-PI / 4.0) + 1.0).abs() < 3e-7);
/// // the same after 100 turns, as far as the angle itself is exact
/// assert!((sin(FRAC_PI_2 + 200.0 * PI) - 1.0).abs() < 1e-6);
/// ```
pub fn sin(x: f32) -> f32 {
    sin_cos(x).0
}

/// Cosine of an angle in radians, as [`sin`].
pub fn cos(x: f32) -> f32 {
    sin_cos(x).1
}

/// Tangent of an angle in radians, as [`sin`].
pub fn tan(x: f32) -> f32 {
    let (sin, cos) = sin_cos(x);
    sin / cos
}

/// Reduction to |r| ≤ π/4 with π/2 in three pieces (Cody & Waite 1980), then the minimax
/// polynomials of the Cephes library (Moshier 1989).
fn sin_cos(x: f32) -> (f32, f32) {
    let quadrant = round_index(x * core::f32::consts::FRAC_2_PI);
    let k = quadrant as f32;
    let r = ((x - k * 1.570_312_5) - k * 4.837_513e-4) - k * 7.549_79e-8;
    let q = r * r;
    let sin = ((-1.951_529_6e-4 * q + 8.332_161e-3) * q - 0.166_666_55) * q * r + r;
    let cos = ((2.443_315_7e-5 * q - 1.388_731_6e-3) * q + 4.166_664_6e-2) * q * q - 0.5 * q + 1.0;
    match quadrant & 3 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// Angle of the vector (x, y) in radians, in (−π, π].
///
/// ```
/// use rugosa_grid::math::{FRAC_PI_2, PI, atan2};
/// assert_eq!(atan2(1.0, 0.0), FRAC_PI_2); // to the left
/// assert!((atan2(-1.0, -1.0) + 0.75 * PI).abs() < 1e-6); // behind on the right
/// ```
pub fn atan2(y: f32, x: f32) -> f32 {
    libm::atan2f(y, x)
}

/// Inverse tangent in radians.
pub fn atan(x: f32) -> f32 {
    libm::atanf(x)
}

/// Inverse sine in radians.
///
/// ```
/// use rugosa_grid::math::{PI, asin};
/// assert!((asin(-0.5) + PI / 6.0).abs() < 3e-7);
/// assert!(asin(1.01).is_nan());
/// ```
pub fn asin(x: f32) -> f32 {
    atan2(x, sqrt((1.0 - x) * (1.0 + x)))
}

/// Natural logarithm; NaN where x is not above zero. For what is normal: it takes infinity for
/// 2¹²⁸ and what is below 2⁻¹²⁶ for something near that.
///
/// The mantissa m is brought between √½ and √2; ln m = 2 artanh s, s = (m − 1) / (m + 1), as in
/// the FreeBSD library (`e_logf.c`), whose coefficients these are.
///
/// ```
/// use rugosa_grid::math::{exp, ln};
/// assert_eq!(ln(1.0), 0.0);
/// assert!((ln(10.0) - 2.302585).abs() < 3e-7 && (ln(exp(-2.0)) + 2.0).abs() < 3e-7);
/// assert!(ln(0.0).is_nan() && ln(-1.0).is_nan());
/// ```
#[cfg_attr(target_arch = "arm", inline(never))] // no vectors, little flash
#[cfg_attr(not(target_arch = "arm"), inline(always))]
pub fn ln(x: f32) -> f32 {
    const MANTISSA: u32 = 23;
    const SQRT_HALF: i32 = core::f32::consts::FRAC_1_SQRT_2.to_bits() as i32;
    let exponent = (x.to_bits() as i32).wrapping_sub(SQRT_HALF) >> MANTISSA;
    let mantissa = (x.to_bits() as i32).wrapping_sub(exponent << MANTISSA);
    let (k, f) = (exponent as f32, f32::from_bits(mantissa as u32) - 1.0);
    let s = f / (2.0 + f);
    let (z, half) = (s * s, 0.5 * f * f);
    let w = z * z;
    let rest = w * (0.400_009_72 + w * 0.242_790_79) + z * (0.666_666_6 + w * 0.284_987_87);
    let y = s * (half + rest) + k * LN_2_LOW - half + f + k * LN_2_HIGH;
    if x > 0.0 { y } else { f32::NAN }
}

/// Binary logarithm.
pub fn log2(x: f32) -> f32 {
    libm::log2f(x)
}

/// e to the power `x`, |x| ≤ 87; beyond it is e^±87.
///
/// Reduction to |r| ≤ ½ ln 2, then e^r = 1 + r + r c / (2 − c), c = r − r² (P₁ + P₂ r²), as in the
/// FreeBSD library (`e_expf.c`), whose coefficients these are.
///
/// ```
/// use rugosa_grid::math::exp;
/// assert_eq!((exp(0.0), exp(-100.0)), (1.0, exp(-87.0)));
/// assert!((exp(1.0) - core::f32::consts::E).abs() < 3e-7 && exp(f32::NAN).is_nan());
/// ```
#[cfg_attr(target_arch = "arm", inline(never))] // no vectors, little flash
#[cfg_attr(not(target_arch = "arm"), inline(always))]
pub fn exp(x: f32) -> f32 {
    let x = x.clamp(-87.0, 87.0);
    // adding 1.5 · 2²³ rounds to the nearest integer and leaves it in the last bits
    const ROUND: f32 = 12_582_912.0;
    let rounded = x * core::f32::consts::LOG2_E + ROUND;
    let k = rounded - ROUND;
    let (high, low) = (x - k * LN_2_HIGH, k * LN_2_LOW);
    let r = high - low;
    let square = r * r;
    let c = r - square * (0.166_666_25 - square * 2.766_733_3e-3);
    let power = 1.0 + (r * c / (2.0 - c) - low + high);
    power * f32::from_bits((rounded.to_bits() << 23).wrapping_add(1.0f32.to_bits()))
}

/// ln 2 in two pieces, the first of so few bits that k times it is exact.
const LN_2_HIGH: f32 = 0.693_138_1;
const LN_2_LOW: f32 = 9.058_001e-6;

/// 2 to the power `x`.
pub fn exp2(x: f32) -> f32 {
    libm::powf(2.0, x) // exp2f works in double precision
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
    fn angles_against_double_precision() {
        for i in -200_000..=200_000 {
            let x = i as f32 * 0.005;
            let exact = f64::from(x);
            assert!((f64::from(sin(x)) - libm::sin(exact)).abs() < 1e-7, "{x}");
            assert!((f64::from(cos(x)) - libm::cos(exact)).abs() < 1e-7, "{x}");
            let t = x * 1e-3;
            let (found, exact) = (f64::from(tan(t)), libm::tan(f64::from(t)));
            assert!((found - exact).abs() < 3e-7 * exact.abs() + 1e-7, "{t}");
            let (found, exact) = (f64::from(asin(t)), libm::asin(f64::from(t)));
            assert!((found - exact).abs() < 3e-7 || t.abs() > 1.0, "{t}");
        }
        for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(sin(x).is_nan() && cos(x).is_nan() && tan(x).is_nan());
        }
        assert!(asin(1.5).is_nan() && asin(1.0) == FRAC_PI_2);
    }

    #[test]
    fn exponential_and_logarithm_against_double_precision() {
        for i in -870_000..=870_000 {
            let x = i as f32 * 1e-4;
            let exact = libm::exp(f64::from(x));
            assert!((f64::from(exp(x)) / exact - 1.0).abs() < 2e-7, "{x}");
            let y = exp(x);
            let exact = libm::log(f64::from(y));
            let error = (f64::from(ln(y)) - exact).abs();
            assert!(error < 1e-7 * exact.abs().max(1.0), "{y}: {error}");
        }
        let y = f32::MIN_POSITIVE;
        assert!((f64::from(ln(y)) - libm::log(f64::from(y))).abs() < 1e-5);
        assert!((f64::from(ln(f32::MAX)) - libm::log(f64::from(f32::MAX))).abs() < 1e-5);
        assert_eq!(
            [exp(f32::INFINITY), exp(f32::NEG_INFINITY)],
            [exp(87.0), exp(-87.0)]
        );
        assert!(exp(f32::NAN).is_nan() && ln(f32::NAN).is_nan());
    }

    #[test]
    fn round_index_is_symmetric() {
        for (x, i) in [(0.4, 0), (0.5, 1), (-0.5, -1), (-1.4, -1), (2.6, 3)] {
            assert_eq!(round_index(x), i, "{x}");
        }
    }
}
