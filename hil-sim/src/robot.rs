//! Where the robot walks and how it stands.
//!
//! A [`Path`] gives position and heading over time at constant speed; [`Robot::pose`]
//! sets the body on the terrain: z is the mean elevation under the footprint, and with
//! [`Posture::Tilted`] roll and pitch follow the plane fitted to it by least squares.

use std::sync::Arc;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rugosa_wire::PoseStamp;

use crate::terrain::Terrain;

/// Positions in metres, headings in radians (0 along x), speeds in m/s.
#[derive(Clone, Debug, PartialEq)]
pub enum Path {
    /// stands still
    Still {
        /// where
        at: [f64; 2],
        /// looking where
        heading: f64,
    },
    /// straight ahead for ever
    Straight {
        /// where it starts
        from: [f64; 2],
        /// looking and going where
        heading: f64,
        /// how fast
        speed: f64,
    },
    /// round a centre, starting east of it and going counter-clockwise
    Circle {
        /// the centre
        centre: [f64; 2],
        /// the radius \[m\]
        radius: f64,
        /// how fast; negative goes clockwise
        speed: f64,
    },
    /// from point to point, turning on the spot at once, standing at the last
    Waypoints {
        /// two or more
        points: Vec<[f64; 2]>,
        /// how fast
        speed: f64,
    },
}

/// How the body is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Posture {
    /// as a walking robot does
    Level,
    /// as a wheeled robot does
    Tilted,
}

/// A robot on a terrain.
#[derive(Clone)]
pub struct Robot {
    /// what it walks on
    pub terrain: Arc<dyn Terrain>,
    /// where it goes
    pub path: Path,
    /// how it stands
    pub posture: Posture,
    /// edge of the square under it that carries it \[m\]
    pub footprint: f64,
}

impl Path {
    /// x, y and heading after `seconds`.
    pub fn at(&self, seconds: f64) -> (f64, f64, f64) {
        match self {
            Path::Still { at, heading } => (at[0], at[1], *heading),
            Path::Straight {
                from,
                heading,
                speed,
            } => {
                let way = speed * seconds;
                (
                    from[0] + way * heading.cos(),
                    from[1] + way * heading.sin(),
                    *heading,
                )
            }
            Path::Circle {
                centre,
                radius,
                speed,
            } => {
                let angle = speed * seconds / radius;
                let heading = angle + std::f64::consts::FRAC_PI_2.copysign(*speed);
                (
                    centre[0] + radius * angle.cos(),
                    centre[1] + radius * angle.sin(),
                    heading,
                )
            }
            Path::Waypoints { points, speed } => along(points, speed * seconds),
        }
    }
}

/// The place `way` metres along a polyline.
fn along(points: &[[f64; 2]], way: f64) -> (f64, f64, f64) {
    let (mut left, mut place) = (way, (0.0, 0.0, 0.0));
    for leg in points.windows(2) {
        let (dx, dy) = (leg[1][0] - leg[0][0], leg[1][1] - leg[0][1]);
        let length = dx.hypot(dy);
        let part = if length > 0.0 {
            (left / length).clamp(0.0, 1.0)
        } else {
            1.0
        };
        place = (leg[0][0] + part * dx, leg[0][1] + part * dy, dy.atan2(dx));
        if left < length {
            break;
        }
        left -= length;
    }
    place
}

/// Places along an edge of the footprint.
const FEET: i32 = 5;

impl Robot {
    /// A level robot of 0.8 m.
    pub fn new(terrain: Arc<dyn Terrain>, path: Path) -> Self {
        Robot {
            terrain,
            path,
            posture: Posture::Level,
            footprint: 0.8,
        }
    }

    /// The body in the map frame after `seconds`.
    pub fn pose(&self, seconds: f64) -> Isometry3<f64> {
        let (x, y, heading) = self.path.at(seconds);
        let [z, slope_x, slope_y] = self.ground(x, y);
        let up = match self.posture {
            Posture::Level => Vector3::z(),
            Posture::Tilted => Vector3::new(-slope_x, -slope_y, 1.0).normalize(),
        };
        let ahead = Vector3::new(heading.cos(), heading.sin(), 0.0);
        let left = up.cross(&ahead).normalize();
        let axes = Matrix3::from_columns(&[left.cross(&up), left, up]);
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        Isometry3::from_parts(Translation3::new(x, y, z), turn)
    }

    /// The pose as it goes over the link, at `stamp_us` µs.
    pub fn stamp(&self, stamp_us: u64) -> PoseStamp {
        let pose = self.pose(stamp_us as f64 * 1e-6);
        let (t, q) = (pose.translation.vector, pose.rotation.coords);
        PoseStamp {
            stamp_us,
            position_m: [t.x as f32, t.y as f32, t.z as f32],
            orientation: [q.x as f32, q.y as f32, q.z as f32, q.w as f32],
        }
    }

    /// Elevation and slopes of the plane under the footprint; the feet stand on a
    /// square raster, so the least squares fall apart into three sums.
    fn ground(&self, x: f64, y: f64) -> [f64; 3] {
        let spacing = self.footprint / f64::from(FEET - 1);
        let (mut n, mut z_sum, mut zx, mut zy, mut squares) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for i in 0..FEET * FEET {
            let dx = f64::from(i % FEET - FEET / 2) * spacing;
            let dy = f64::from(i / FEET - FEET / 2) * spacing;
            let Some(z) = self.terrain.elevation(x + dx, y + dy) else {
                continue;
            };
            n += 1.0;
            z_sum += z;
            zx += z * dx;
            zy += z * dy;
            squares += dx * dx;
        }
        match n == f64::from(FEET * FEET) && squares > 0.0 {
            true => [z_sum / n, zx / squares, zy / squares],
            // beside the edge or over a hole: no plane
            false => [if n > 0.0 { z_sum / n } else { 0.0 }, 0.0, 0.0],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terrain::Plane;

    #[test]
    fn paths_keep_their_speed_and_look_ahead() {
        let paths = [
            Path::Straight {
                from: [1.0, 2.0],
                heading: 0.7,
                speed: 0.5,
            },
            Path::Circle {
                centre: [0.0, 1.0],
                radius: 3.0,
                speed: 0.5,
            },
            Path::Circle {
                centre: [0.0, 1.0],
                radius: 3.0,
                speed: -0.5,
            },
            Path::Waypoints {
                points: vec![[0.0, 0.0], [2.0, 0.0], [2.0, 5.0]],
                speed: 0.5,
            },
        ];
        for path in paths {
            for t in [0.5, 3.0, 7.3] {
                let ((x0, y0, heading), (x1, y1, _)) = (path.at(t), path.at(t + 1e-4));
                let (vx, vy) = ((x1 - x0) * 1e4, (y1 - y0) * 1e4);
                assert!((vx.hypot(vy) - 0.5).abs() < 1e-6, "{path:?}");
                assert!((vx - 0.5 * heading.cos()).abs() < 1e-4, "{path:?} {t}");
                assert!((vy - 0.5 * heading.sin()).abs() < 1e-4, "{path:?} {t}");
            }
        }
    }

    #[test]
    fn the_last_waypoint_is_kept() {
        let path = Path::Waypoints {
            points: vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]],
            speed: 1.0,
        };
        assert_eq!(path.at(99.0), (1.0, 1.0, std::f64::consts::FRAC_PI_2));
    }

    #[test]
    fn the_body_stands_on_a_ramp() {
        let ramp = Plane {
            height: 1.0,
            slope_x: 0.2,
            slope_y: -0.1,
        };
        let path = Path::Still {
            at: [2.0, 3.0],
            heading: 0.4,
        };
        let mut robot = Robot::new(Arc::new(ramp), path);
        let level = robot.pose(0.0);
        assert!((level.translation.z - (1.0 + 0.4 - 0.3)).abs() < 1e-12);
        assert!((level * Vector3::z() - Vector3::z()).norm() < 1e-12);
        robot.posture = Posture::Tilted;
        let up = robot.pose(0.0).rotation * Vector3::z();
        assert!((up - Vector3::new(-0.2, 0.1, 1.0).normalize()).norm() < 1e-12);
        let ahead = robot.pose(0.0).rotation * Vector3::x();
        assert!((ahead.y.atan2(ahead.x) - 0.4).abs() < 0.05 && ahead.z > 0.0);
    }
}
