//! Terrains to walk on, and where a beam meets them.
//!
//! A terrain is a surface z(x, y) over the map plane, metres, x east, y north, z up.
//! [`Terrain::cast`] is exact where the surface has a closed form (planes, steps, the
//! bilinear patches of a raster) and within 1 nm of height on the others.

mod analytic;
mod fractal;
mod raster;
mod simple;

pub use analytic::{Analytic, egg_carton};
pub use fractal::{Fractal, FractalSettings, fractal};
pub use raster::Raster;
pub use simple::{Plane, Step};

use nalgebra::Vector3;

/// A half line: from `origin` \[m\] along the unit vector `direction`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// where it starts \[m\]
    pub origin: Vector3<f64>,
    /// where it goes, unit length
    pub direction: Vector3<f64>,
}

impl Ray {
    /// The point at `distance` \[m\].
    pub fn at(&self, distance: f64) -> Vector3<f64> {
        self.origin + distance * self.direction
    }
}

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// distance along the ray \[m\]
    pub distance: f64,
    /// unit normal of the surface there, pointing to the side of the ray's origin
    pub normal: Vector3<f64>,
}

/// A surface z(x, y) over the map plane.
pub trait Terrain: Send + Sync {
    /// Elevation \[m\] at (x, y) \[m\]; `None` where there is no surface.
    fn elevation(&self, x: f64, y: f64) -> Option<f64>;

    /// The first point of the surface on the ray, no farther than `reach` \[m\];
    /// `None` where it meets none or starts below the surface.
    fn cast(&self, ray: &Ray, reach: f64) -> Option<Hit>;
}

/// Unit normal of a surface with the gradient (∂z/∂x, ∂z/∂y), pointing up.
fn upward_normal(slope_x: f64, slope_y: f64) -> Vector3<f64> {
    Vector3::new(-slope_x, -slope_y, 1.0).normalize()
}
