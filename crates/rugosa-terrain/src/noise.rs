//! Variance of a return's elevation.
//!
//! A return at range r along the unit direction u (map frame, u_z its upward component)
//! errs along the beam by the range noise σ_r and across it by r σ_a, the angular noise.
//! What of it points upward:
//!
//! ```text
//! var z = u_z² σ_r² + (1 − u_z²) r² σ_a²,     σ_r² = c² + (p r)²
//! ```
//!
//! c is the constant part of the range noise, p the part that grows with the range; the
//! two are independent, so their squares add (and no square root is needed).
//!
//! Not in it: the uncertainty of the pose, which all returns of a sweep share, and the
//! footprint of the beam on sloping ground. Cost: 6 operations. First-order propagation:
//! the second-order term is r² σ_a⁴, far below a micrometre² for any lidar. Checked
//! against random draws in `the_formula_agrees_with_draws`.

/// Standard deviations of a scanner's measurements, kept as variances.
///
/// ```
/// use rugosa_terrain::Noise;
/// // 2 cm, 0.1 % of the range, 2 mrad
/// let noise = Noise::new(0.02, 0.001, 0.002);
/// // straight down only the range counts, level only the angle [m²]
/// let down = noise.elevation_variance(-1.0, 30.0);
/// assert!((down - (0.02f32.powi(2) + 0.03f32.powi(2))).abs() < 1e-7);
/// let level = noise.elevation_variance(0.0, 30.0);
/// assert!((level - 0.06f32.powi(2)).abs() < 1e-7);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    constant: f32,
    proportional: f32,
    angular: f32,
}

impl Noise {
    /// Range noise: `constant` \[m\] and `proportional` \[m per m\]; `angular` \[rad\].
    /// All are standard deviations.
    pub fn new(constant: f32, proportional: f32, angular: f32) -> Self {
        Noise {
            constant: constant * constant,
            proportional: proportional * proportional,
            angular: angular * angular,
        }
    }

    /// Variance \[m²\] of the elevation of a return at `range` \[m\] whose unit direction
    /// has the upward component `up`.
    #[inline]
    pub fn elevation_variance(&self, up: f32, range: f32) -> f32 {
        self.variance_of_squares(up * up, range * range)
    }

    /// The same from `up²` and `range²`.
    #[inline]
    pub(crate) fn variance_of_squares(&self, up2: f32, range2: f32) -> f32 {
        let level2 = if up2 < 1.0 { 1.0 - up2 } else { 0.0 };
        let growing = up2 * self.proportional + level2 * self.angular;
        up2 * self.constant + range2 * growing
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// Standard normal numbers by Box and Muller from a small congruential generator.
    fn normals(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed;
        let mut uniform = move || {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            ((state >> 11) as f64 + 0.5) / (1u64 << 53) as f64
        };
        move || (-2.0 * uniform().ln()).sqrt() * (2.0 * PI * uniform()).cos()
    }

    #[test]
    fn the_formula_agrees_with_draws() {
        let noise = Noise::new(0.02, 0.005, 0.01);
        let mut normal = normals(7);
        for (inclination, range) in [(-0.1f64, 12.0), (-0.7, 3.0), (-1.5, 8.0), (0.3, 5.0)] {
            let draws = 40_000;
            let mut sum2 = 0.0;
            for _ in 0..draws {
                let r = range + 0.02 * normal() + 0.005 * range * normal();
                let z = r * (inclination + 0.01 * normal()).sin() - range * inclination.sin();
                sum2 += z * z;
            }
            let drawn = sum2 / draws as f64;
            let stated = noise.elevation_variance(inclination.sin() as f32, range as f32);
            let ratio = f64::from(stated) / drawn;
            assert!((ratio - 1.0).abs() < 0.03, "{inclination} {range}: {ratio}");
        }
    }

    #[test]
    fn level_and_vertical_beams() {
        let noise = Noise::new(0.02, 0.0, 0.001);
        assert!((noise.elevation_variance(0.0, 10.0) - 1e-4).abs() < 1e-9);
        assert!((noise.elevation_variance(-1.0, 10.0) - 4e-4).abs() < 1e-9);
    }
}
