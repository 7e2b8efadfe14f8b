//! Beams in double precision: where a beam leaves the scanner and where it goes.
//!
//! Azimuth is positive to the left, inclination positive up, the sensor frame has x
//! forward, y left, z up. A range reading R \[m\] puts the target at
//! `origin + (R + shift) · direction`.
//!
//! *Spherical*: direction (cos φ cos θ, cos φ sin θ, sin φ), no origin, no shift.
//!
//! *Perceptron* (two mirrors; conversion published with the range image collection of
//! the University of South Florida). With azimuth α, inclination β, mirror offsets h1,
//! h2, mirror slopes γ, θ and the standoff r0, in a frame X left, Y up, Z forward:
//!
//! ```text
//! dz = −h1 (1 − cos α) / tan γ     dy = dz tan(θ + β/2)     dx = (h2 + dy) tan α
//! shift = r0 − (dz − h2) − √(dx² + (h2 + dy)²)
//! point = (dx, dy, dz) + (R + shift) (sin α, cos α sin β, cos α cos β)
//! ```
//!
//! This file shares nothing with the mapping crates, so that an error of sign there or
//! here shows.

use nalgebra::Vector3;
use rugosa_wire::BeamModel;

/// A beam of the scanner, sensor frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// where the reading's straight part starts \[m\]
    pub origin: Vector3<f64>,
    /// unit vector
    pub direction: Vector3<f64>,
    /// distance from `origin` = reading + shift \[m\]
    pub shift: f64,
}

impl Beam {
    /// The point of a range reading \[m\].
    pub fn point(&self, reading: f64) -> Vector3<f64> {
        self.origin + (reading + self.shift) * self.direction
    }
}

/// Lengths in metres, angles in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mirrors {
    /// mirror offset h1
    pub h1: f64,
    /// mirror offset h2
    pub h2: f64,
    /// mirror slope γ
    pub gamma: f64,
    /// mirror slope θ
    pub theta: f64,
    /// standoff r0
    pub standoff: f64,
}

impl Mirrors {
    /// The beam at azimuth `alpha` and inclination `beta` \[rad\].
    pub fn beam(&self, alpha: f64, beta: f64) -> Beam {
        let dz = -self.h1 * (1.0 - alpha.cos()) / self.gamma.tan();
        let dy = dz * (self.theta + beta / 2.0).tan();
        let dx = (self.h2 + dy) * alpha.tan();
        let direction = [
            alpha.sin(),
            alpha.cos() * beta.sin(),
            alpha.cos() * beta.cos(),
        ];
        Beam {
            origin: forward_left_up([dx, dy, dz]),
            direction: forward_left_up(direction),
            shift: self.standoff - (dz - self.h2) - dx.hypot(self.h2 + dy),
        }
    }
}

/// From (left, up, forward) to (forward, left, up).
fn forward_left_up([left, up, forward]: [f64; 3]) -> Vector3<f64> {
    Vector3::new(forward, left, up)
}

/// The beam at an azimuth and an inclination \[rad\] of a scanner whose counts are
/// `metres_per_count` long.
pub fn beam(model: &BeamModel, metres_per_count: f64, azimuth: f64, inclination: f64) -> Beam {
    match *model {
        BeamModel::Spherical => Beam {
            origin: Vector3::zeros(),
            direction: Vector3::new(
                inclination.cos() * azimuth.cos(),
                inclination.cos() * azimuth.sin(),
                inclination.sin(),
            ),
            shift: 0.0,
        },
        BeamModel::Perceptron {
            h1_m,
            h2_m,
            gamma_urad,
            theta_urad,
            standoff_counts,
        } => Mirrors {
            h1: f64::from(h1_m),
            h2: f64::from(h2_m),
            gamma: f64::from(gamma_urad) * 1e-6,
            theta: f64::from(theta_urad) * 1e-6,
            standoff: f64::from(standoff_counts) * metres_per_count,
        }
        .beam(azimuth, inclination),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// (row, column, count) → published X left, Y up, Z forward \[cm\]
    const PUBLISHED: [([f64; 3], [f64; 3]); 6] = [
        ([0.0, 0.0, 1000.0], [163.573962, 104.516381, 316.439269]),
        ([0.0, 511.0, 1000.0], [-163.573962, 104.516381, 316.439269]),
        ([255.0, 255.0, 0.0], [0.152755, 0.105185, 168.019409]),
        ([256.0, 256.0, 2048.0], [-0.517595, -0.364637, 582.452447]),
        ([511.0, 0.0, 4095.0], [435.910639, -282.445238, 851.632097]),
        ([100.0, 400.0, 1500.0], [-120.091075, 88.184509, 447.694143]),
    ];

    #[test]
    fn the_published_conversion_is_reproduced() {
        let metres_per_count = 0.0020236;
        let mirrors = Mirrors {
            h1: 0.03,
            h2: 0.055,
            gamma: 45f64.to_radians(),
            theta: 45f64.to_radians(),
            standoff: 830.3 * metres_per_count,
        };
        for ([row, column, count], [left, up, forward]) in PUBLISHED {
            let alpha = 51.65f64.to_radians() * (255.5 - column) / 512.0;
            let beta = 36.73f64.to_radians() * (255.5 - row) / 512.0;
            let point = mirrors.beam(alpha, beta).point(count * metres_per_count);
            let wanted = Vector3::new(forward, left, up) / 100.0;
            assert!(
                (point - wanted).norm() < 1e-8,
                "{row} {column}: {point} {wanted}"
            );
        }
    }

    #[test]
    fn spherical_beams_go_forward_left_and_up() {
        let close = |a: f64, b: f64, to: [f64; 3]| {
            let point = beam(&BeamModel::Spherical, 1.0, a, b).point(2.0);
            assert!((point - 2.0 * Vector3::from(to)).norm() < 1e-15);
        };
        let half = core::f64::consts::FRAC_1_SQRT_2;
        close(0.0, 0.0, [1.0, 0.0, 0.0]);
        close(core::f64::consts::FRAC_PI_4, 0.0, [half, half, 0.0]);
        close(0.0, core::f64::consts::FRAC_PI_4, [half, 0.0, half]);
    }
}
