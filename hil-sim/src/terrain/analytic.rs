//! Any smooth surface given as a function.
//!
//! The ray advances by gap ÷ (fastest possible closing speed), where the gap is the
//! height above the surface and the surface climbs no faster than `steepness`: such a
//! step can touch the surface but never pass through it (sphere tracing, Hart 1996,
//! with the Lipschitz bound of a height field). It stops at a gap of 1 nm.

use super::{Hit, Ray, Terrain, upward_normal};

const GAP: f64 = 1e-9;
const MOST_STEPS: usize = 100_000;
const DIFFERENCE: f64 = 1e-5;

/// z = `height`(x, y), nowhere steeper than `steepness`.
pub struct Analytic<F> {
    /// elevation \[m\]
    pub height: F,
    /// bound on |∇z|
    pub steepness: f64,
}

/// z = amplitude · sin(2πx/wavelength) · cos(2πy/wavelength).
pub fn egg_carton(amplitude: f64, wavelength: f64) -> Analytic<impl Fn(f64, f64) -> f64> {
    let k = core::f64::consts::TAU / wavelength;
    Analytic {
        height: move |x: f64, y: f64| amplitude * (k * x).sin() * (k * y).cos(),
        steepness: amplitude.abs() * k,
    }
}

impl<F: Fn(f64, f64) -> f64> Analytic<F> {
    fn slope(&self, x: f64, y: f64) -> (f64, f64) {
        let z = &self.height;
        let d = DIFFERENCE;
        (
            (z(x + d, y) - z(x - d, y)) / (2.0 * d),
            (z(x, y + d) - z(x, y - d)) / (2.0 * d),
        )
    }
}

impl<F: Fn(f64, f64) -> f64 + Send + Sync> Terrain for Analytic<F> {
    fn elevation(&self, x: f64, y: f64) -> Option<f64> {
        Some((self.height)(x, y))
    }

    fn cast(&self, ray: &Ray, reach: f64) -> Option<Hit> {
        let u = ray.direction;
        let closing = self.steepness * u.x.hypot(u.y) - u.z;
        let mut distance = 0.0;
        for _ in 0..MOST_STEPS {
            let p = ray.at(distance);
            let gap = p.z - (self.height)(p.x, p.y);
            if gap < -GAP || distance > reach || closing <= 0.0 {
                return None;
            }
            if gap < GAP {
                let (slope_x, slope_y) = self.slope(p.x, p.y);
                let normal = upward_normal(slope_x, slope_y);
                return Some(Hit { distance, normal });
            }
            distance += gap / closing;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn the_first_of_several_crossings_is_found() {
        let hills = egg_carton(0.5, 2.0);
        for slant in [0.2, 0.4, 0.8, 1.6] {
            let ray = Ray {
                origin: Vector3::new(-7.0, 0.3, 2.0),
                direction: Vector3::new(1.0, 0.1, -slant).normalize(),
            };
            let gap = |t: f64| ray.at(t).z - hills.elevation(ray.at(t).x, ray.at(t).y).unwrap();
            let hit = hills.cast(&ray, 50.0).unwrap().distance;
            assert!(gap(hit).abs() < 2e-9);
            let steps = (hit / 1e-3) as usize;
            assert!(
                (0..steps).all(|i| gap(i as f64 * 1e-3) > 0.0),
                "slant {slant}"
            );
        }
    }

    #[test]
    fn a_ray_over_the_crests_meets_nothing() {
        let ray = Ray {
            origin: Vector3::new(0.0, 0.0, 0.51),
            direction: Vector3::x(),
        };
        assert_eq!(egg_carton(0.5, 2.0).cast(&ray, 40.0), None);
    }
}
