//! Surfaces in closed form, for tests and first steps: plane (flat or a ramp), step.

use super::{Hit, Ray, Terrain, upward_normal};
use nalgebra::Vector3;

/// z = `height` + `slope_x` · x + `slope_y` · y.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Plane {
    /// elevation at the origin \[m\]
    pub height: f64,
    /// ∂z/∂x
    pub slope_x: f64,
    /// ∂z/∂y
    pub slope_y: f64,
}

impl Plane {
    /// Flat ground at z = 0.
    pub const FLAT: Plane = Plane {
        height: 0.0,
        slope_x: 0.0,
        slope_y: 0.0,
    };

    fn z(&self, x: f64, y: f64) -> f64 {
        self.height + self.slope_x * x + self.slope_y * y
    }
}

impl Terrain for Plane {
    fn elevation(&self, x: f64, y: f64) -> Option<f64> {
        Some(self.z(x, y))
    }

    fn cast(&self, ray: &Ray, reach: f64) -> Option<Hit> {
        let (o, u) = (ray.origin, ray.direction);
        let gap = o.z - self.z(o.x, o.y);
        let closing = self.slope_x * u.x + self.slope_y * u.y - u.z;
        let distance = gap / closing;
        (gap >= 0.0 && closing > 0.0 && distance <= reach).then(|| Hit {
            distance,
            normal: upward_normal(self.slope_x, self.slope_y),
        })
    }
}

/// Flat ground at z = 0 for x < `x`, at z = `height` beyond, with an upright riser.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// where the riser stands \[m\]
    pub x: f64,
    /// how high it is \[m\]; negative: a drop
    pub height: f64,
}

impl Step {
    fn level(&self, upper: bool) -> Plane {
        Plane {
            height: if upper { self.height } else { 0.0 },
            ..Plane::FLAT
        }
    }

    fn tread(&self, ray: &Ray, reach: f64, upper: bool) -> Option<Hit> {
        let hit = self.level(upper).cast(ray, reach)?;
        ((ray.at(hit.distance).x >= self.x) == upper).then_some(hit)
    }

    fn riser(&self, ray: &Ray, reach: f64) -> Option<Hit> {
        let distance = (self.x - ray.origin.x) / ray.direction.x;
        let faces_ray = ray.direction.x * self.height > 0.0;
        let z = ray.at(distance).z;
        let inside = z > self.height.min(0.0) && z < self.height.max(0.0);
        (faces_ray && inside && distance >= 0.0 && distance <= reach).then(|| Hit {
            distance,
            normal: Vector3::new(-ray.direction.x.signum(), 0.0, 0.0),
        })
    }
}

impl Terrain for Step {
    fn elevation(&self, x: f64, _y: f64) -> Option<f64> {
        Some(if x >= self.x { self.height } else { 0.0 })
    }

    fn cast(&self, ray: &Ray, reach: f64) -> Option<Hit> {
        let candidates = [
            self.tread(ray, reach, false),
            self.tread(ray, reach, true),
            self.riser(ray, reach),
        ];
        let first = |a: &Hit, b: &Hit| a.distance.total_cmp(&b.distance);
        candidates.into_iter().flatten().min_by(first)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ray(origin: [f64; 3], towards: [f64; 3]) -> Ray {
        Ray {
            origin: origin.into(),
            direction: (Vector3::from(towards) - Vector3::from(origin)).normalize(),
        }
    }

    #[test]
    fn a_ray_meets_a_ramp_where_it_was_aimed() {
        let ramp = Plane {
            height: 0.3,
            slope_x: 0.2,
            slope_y: -0.1,
        };
        let target = [5.0, -3.0, 0.3 + 1.0 + 0.3];
        let ray = ray([0.5, 1.0, 4.0], target);
        let hit = ramp.cast(&ray, 100.0).unwrap();
        assert!((ray.at(hit.distance) - Vector3::from(target)).norm() < 1e-12);
        assert!(hit.normal.dot(&ray.direction) < 0.0);
        assert_eq!(ramp.cast(&ray, hit.distance - 1e-6), None);
    }

    #[test]
    fn a_ray_that_climbs_or_starts_below_meets_nothing() {
        let up = ray([0.0, 0.0, 1.0], [1.0, 0.0, 1.1]);
        assert_eq!(Plane::FLAT.cast(&up, 100.0), None);
        let below = ray([0.0, 0.0, -1.0], [1.0, 0.0, -2.0]);
        assert_eq!(Plane::FLAT.cast(&below, 100.0), None);
    }

    #[test]
    fn a_step_has_two_treads_a_riser_and_a_shadow() {
        let step = Step {
            x: 2.0,
            height: 0.5,
        };
        let z_at = |to| {
            let ray = ray([0.0, 0.0, 2.0], to);
            ray.at(step.cast(&ray, 100.0).unwrap().distance)
        };
        assert!((z_at([1.0, 0.0, 0.0]).z).abs() < 1e-12);
        assert!((z_at([2.0, 0.0, 0.25]) - Vector3::new(2.0, 0.0, 0.25)).norm() < 1e-12);
        assert!((z_at([3.0, 0.0, 0.5]).z - 0.5).abs() < 1e-12);
        // a drop: the edge hides the ground behind it
        let drop = Step {
            x: 2.0,
            height: -0.5,
        };
        let over = ray([0.0, 0.0, 2.0], [2.0, 0.0, 0.001]);
        let hit = over.at(drop.cast(&over, 100.0).unwrap().distance);
        assert!(hit.x > 2.4 && (hit.z + 0.5).abs() < 1e-12);
        // seen from the low side the riser is a wall
        let wall = ray([4.0, 0.0, 1.0], [2.0, 0.0, -0.25]);
        let hit = drop.cast(&wall, 9.0).unwrap();
        assert!((wall.at(hit.distance) - Vector3::new(2.0, 0.0, -0.25)).norm() < 1e-12);
        assert_eq!(hit.normal, Vector3::x());
    }
}
