//! Can the robot stand at this pose? Along this path?
//!
//! Frame: the footprint in the body frame (x forward, y left), poses (x, y, yaw) in the
//! map frame. Every cell whose centre lies in the footprint, at least the one under the
//! robot's origin, is asked. Cost: the cells of the footprint's bounding box.

use super::{CellCost, Criterion};
use crate::Mapper;
use rugosa_grid::{Cell, math};

/// The outline of the robot on the ground.
///
/// ```
/// # use nalgebra::Isometry3;
/// use rugosa::traversability::{Criterion, Footprint};
/// # use rugosa::traversability::Pair;
/// # use rugosa::{Config, Mapper, Planes65};
/// # use rugosa_terrain::{Noise, grid::View};
/// # let mut planes = Box::new(Planes65::new());
/// # let mut config = Config::default();
/// # config.limits.roughness = Pair { safe: 5.0, critical: 9.0 }; // geometry only
/// # let mut mapper = Mapper::new(config, planes.lend()).unwrap();
/// # let (above, noise) = (Isometry3::translation(0.0, 0.0, 9.0), Noise::new(0.005, 0.0, 0.0));
/// # let view = View { map_from_sensor: &above, noise: &noise, sweep: 0 };
/// # let cells = mapper.window().cells().map(|cell| mapper.lattice().centre(cell));
/// # let wall = |y: f32| if (y - 1.0).abs() < 0.1 { 0.5 } else { 0.0 };
/// # let points: Vec<_> = cells.map(|(x, y)| [x, y, wall(y) - 9.0]).collect();
/// # mapper.points(&points, &view);
/// # mapper.commit(&mut |_| {});
/// // 0.8 m to the front and 0.2 m to each other side of the origin, by a wall at y = 1 m
/// let robot = Footprint::Polygon(&[[0.8, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.8, -0.2]]);
/// let at = |yaw: f32| mapper.footprint(&robot, [0.0, 0.3, yaw]);
/// let to_the_left = at(std::f32::consts::FRAC_PI_2);
/// assert_eq!((to_the_left.cost, to_the_left.reason), (Some(1.0), Criterion::Step));
/// assert!(at(-std::f32::consts::FRAC_PI_2).cost.unwrap() < 1.0);
/// assert!((35..=50).contains(&to_the_left.cells)); // 1 m × 0.4 m in cells of 0.1 m
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Footprint<'a> {
    /// a circle of this radius \[m\]
    Circle(f32),
    /// a simple polygon of corners \[m\], in either sense of rotation
    Polygon(&'a [[f32; 2]]),
}

/// What a footprint stands on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FootprintCost {
    /// greatest cost of a known cell, 0 … 1; `None` where all cells are unknown
    pub cost: Option<f32>,
    /// the cell with that cost, or the cell under the origin
    pub worst: Cell,
    /// what made the cost
    pub reason: Criterion,
    /// cells in the footprint
    pub cells: u32,
    /// cells of them that are unknown
    pub unknown: u32,
}

impl Footprint<'_> {
    fn radius(&self) -> f32 {
        match self {
            Footprint::Circle(radius) => *radius,
            Footprint::Polygon(corners) => corners
                .iter()
                .map(|[x, y]| math::sqrt(x * x + y * y))
                .fold(0.0, |a, b| if b > a { b } else { a }),
        }
    }

    /// Is the point \[m\] of the body frame inside?
    fn holds(&self, x: f32, y: f32) -> bool {
        match self {
            Footprint::Circle(radius) => x * x + y * y <= radius * radius,
            Footprint::Polygon(corners) => is_inside(corners, x, y),
        }
    }
}

/// Even–odd rule.
fn is_inside(corners: &[[f32; 2]], x: f32, y: f32) -> bool {
    let mut inside = false;
    for (i, [x1, y1]) in corners.iter().enumerate() {
        let [x2, y2] = corners[(i + 1) % corners.len()];
        if (*y1 > y) != (y2 > y) && x < x1 + (y - y1) / (y2 - y1) * (x2 - x1) {
            inside = !inside;
        }
    }
    inside
}

impl Mapper<'_> {
    /// What the footprint stands on at a pose (x \[m\], y \[m\], yaw \[rad\]).
    ///
    /// ```
    /// use nalgebra::Isometry3;
    /// use rugosa::traversability::{Criterion, Footprint};
    /// use rugosa::{Config, Mapper, Planes65};
    /// use rugosa_terrain::{Noise, grid::View};
    /// # let mut planes = Box::new(Planes65::new());
    /// let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    /// // flat ground with a wall at x = 1 m, seen from 10 m above
    /// let wall = |x: f32| if (x - 1.0).abs() < 0.1 { 0.5 } else { 0.0 };
    /// let at = |i: i32| (i as f32 + 0.5) * 0.05;
    /// let points: Vec<[f32; 3]> = (-1600..1600)
    ///     .map(|i| (at(i % 40), at(i / 40)))
    ///     .map(|(x, y)| [x, y, wall(x) - 10.0])
    ///     .collect();
    /// let view = View {
    ///     map_from_sensor: &Isometry3::translation(0.0, 0.0, 10.0),
    ///     noise: &Noise::new(0.005, 0.0, 0.0),
    ///     sweep: 1,
    /// };
    /// mapper.points(&points, &view);
    /// mapper.commit(&mut |_| {});
    ///
    /// let robot = Footprint::Circle(0.2);
    /// let at_the_wall = mapper.footprint(&robot, [1.0, 0.5, 0.0]);
    /// assert_eq!(at_the_wall.cost, Some(1.0));
    /// let far_away = mapper.footprint(&robot, [30.0, 0.0, 0.0]);
    /// assert_eq!((far_away.cost, far_away.reason), (None, Criterion::Unknown));
    /// ```
    pub fn footprint(&self, footprint: &Footprint, [x, y, yaw]: [f32; 3]) -> FootprintCost {
        let (sin, cos) = (math::sin(yaw), math::cos(yaw));
        let (origin, ..) = self.lattice().locate(x, y);
        let reach = math::floor_index(footprint.radius() / self.lattice().resolution()) + 1;
        let mut found = FootprintCost {
            cost: None,
            worst: origin,
            reason: Criterion::Unknown,
            cells: 0,
            unknown: 0,
        };
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let cell = origin.offset(dx, dy);
                let (cx, cy) = self.lattice().centre(cell);
                let (east, north) = (cx - x, cy - y);
                let (ahead, left) = (cos * east + sin * north, cos * north - sin * east);
                if cell == origin || footprint.holds(ahead, left) {
                    found.meet(cell, self.cost(cell));
                }
            }
        }
        found
    }

    /// The costs of a footprint along a path of poses, one by one.
    ///
    /// ```
    /// # use nalgebra::Isometry3;
    /// use rugosa::traversability::Footprint;
    /// # use rugosa::traversability::Pair;
    /// # use rugosa::{Config, Mapper, Planes65};
    /// # use rugosa_terrain::{Noise, grid::View};
    /// # let mut planes = Box::new(Planes65::new());
    /// # let mut config = Config::default();
    /// # config.limits.roughness = Pair { safe: 5.0, critical: 9.0 }; // geometry only
    /// # let mut mapper = Mapper::new(config, planes.lend()).unwrap();
    /// # let (above, noise) = (Isometry3::translation(0.0, 0.0, 9.0), Noise::new(0.005, 0.0, 0.0));
    /// # let view = View { map_from_sensor: &above, noise: &noise, sweep: 0 };
    /// # let cells = mapper.window().cells().map(|cell| mapper.lattice().centre(cell));
    /// # let wall = |x: f32| if (x - 1.0).abs() < 0.1 { 0.5 } else { 0.0 };
    /// # let points: Vec<_> = cells.map(|(x, y)| [x, y, wall(x) - 9.0]).collect();
    /// # mapper.points(&points, &view);
    /// # mapper.commit(&mut |_| {});
    /// // towards a wall at x = 1 m
    /// let poses = [-1.0, 0.0, 1.0].map(|x| [x, 0.0, 0.0]);
    /// let blocked = mapper
    ///     .path(&Footprint::Circle(0.2), &poses)
    ///     .position(|stand| stand.cost == Some(1.0));
    /// assert_eq!(blocked, Some(2));
    /// ```
    pub fn path<'p>(
        &'p self,
        footprint: &'p Footprint,
        poses: &'p [[f32; 3]],
    ) -> impl Iterator<Item = FootprintCost> + 'p {
        poses.iter().map(|pose| self.footprint(footprint, *pose))
    }
}

impl FootprintCost {
    fn meet(&mut self, cell: Cell, cost: CellCost) {
        self.cells += 1;
        let Some(value) = cost.cost() else {
            self.unknown += 1;
            return;
        };
        if self.cost.is_none_or(|worst| value > worst) {
            (self.cost, self.worst, self.reason) = (Some(value), cell, cost.criterion);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_polygon_knows_its_inside() {
        let corners = [[0.5, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.5, -0.2]];
        for sense in [corners, {
            let mut turned = corners;
            turned.reverse();
            turned
        }] {
            assert!(is_inside(&sense, 0.4, 0.1) && is_inside(&sense, -0.2, -0.1));
            assert!(!is_inside(&sense, -0.4, 0.0) && !is_inside(&sense, 0.0, 0.3));
        }
        assert!(!is_inside(&[], 0.0, 0.0));
        assert!((Footprint::Polygon(&corners).radius() - 0.5385).abs() < 1e-3);
    }
}
