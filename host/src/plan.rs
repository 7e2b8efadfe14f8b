//! A path across the costs of a map: A* (Hart, Nilsson and Raphael 1968) over the poses'
//! cells.
//!
//! A step to one of the eight neighbours costs its length times 1 + [`COST_WEIGHT`] times
//! the cost of the footprint there; where the footprint is impassable or stands on nothing
//! known, there is no step. The straight distance never exceeds the cost of a way, so the
//! path found is the cheapest.
//!
//! This is an example of a planner on rugosa's costs, not a motion planner: the robot is a
//! circle, turns cost nothing.

use pathfinding::prelude::{astar, dijkstra_reach};
use rugosa::Mapper;
use rugosa::traversability::{Criterion, Footprint};
use rugosa_grid::Cell;
use std::collections::HashMap;

/// How much longer a way is worth to avoid the worst passable ground.
pub const COST_WEIGHT: f32 = 9.0;
/// Costs of steps are whole numbers; a step to a free neighbour costs so much.
const STEP: f32 = 1000.0;
/// The same for a diagonal step.
const DIAGONAL: f32 = 1414.0;

/// A way from one cell to another.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// cells, from the start to the goal
    pub cells: Vec<Cell>,
    /// their centres, x and y \[m\]
    pub points: Vec<[f64; 2]>,
    /// length \[m\]
    pub length: f64,
    /// greatest cost of the footprint along it, and what made it
    pub worst: (f32, Criterion),
}

/// A planner on the map as it is now.
pub struct Planner<'a, 'm> {
    mapper: &'a Mapper<'m>,
    footprint: Footprint<'a>,
    known: HashMap<Cell, Option<(f32, Criterion)>>,
}

impl<'a, 'm> Planner<'a, 'm> {
    /// For a robot whose outline is a circle of `radius` \[m\].
    pub fn new(mapper: &'a Mapper<'m>, radius: f32) -> Self {
        Planner {
            mapper,
            footprint: Footprint::Circle(radius),
            known: HashMap::new(),
        }
    }

    /// The cheapest path from `from` to `to` (x, y \[m\]); `None` where there is none.
    ///
    /// ```
    /// use rugosa::Mapper;
    /// use rugosa_host::{config::Settings, plan::Planner, planes::HeapPlanes};
    /// let settings = Settings::default();
    /// let mut planes = HeapPlanes::new(settings.side);
    /// let mapper = Mapper::new(settings.mapper, planes.lend()).unwrap();
    /// // nothing is known of an empty map, so there is no way across it
    /// assert_eq!(Planner::new(&mapper, 0.3).plan([0.0, 0.0], [1.0, 0.0]), None);
    /// ```
    pub fn plan(&mut self, from: [f32; 2], to: [f32; 2]) -> Option<Plan> {
        let [start, goal] = [from, to].map(|[x, y]| self.mapper.lattice().locate(x, y).0);
        self.cost(start)?;
        self.cost(goal)?;
        let far = |cell: &Cell| {
            let (x, y) = (cell.x.abs_diff(goal.x), cell.y.abs_diff(goal.y));
            STEP as u32 * x.abs_diff(y) + DIAGONAL as u32 * x.min(y)
        };
        let found = astar(&start, |cell| self.steps(*cell), far, |cell| *cell == goal);
        found.map(|(cells, _)| self.describe(cells))
    }

    /// The reachable cell that is the most expensive to reach, as x, y \[m\]: a goal for
    /// demonstrations.
    pub fn farthest(&mut self, from: [f32; 2]) -> Option<[f32; 2]> {
        let (start, ..) = self.mapper.lattice().locate(from[0], from[1]);
        self.cost(start)?;
        let reached: Vec<_> = dijkstra_reach(&start, |cell| self.steps(*cell)).collect();
        let last = reached.into_iter().max_by_key(|r| (r.total_cost, r.node))?;
        let (x, y) = self.mapper.lattice().centre(last.node);
        Some([x, y])
    }

    /// The passable cell nearest to a point, as x, y \[m\].
    pub fn nearest(&mut self, [x, y]: [f32; 2]) -> Option<[f32; 2]> {
        let (wanted, ..) = self.mapper.lattice().locate(x, y);
        let window = *self.mapper.window();
        let mut cells: Vec<Cell> = window.cells().collect();
        let far = |c: &Cell| {
            let (dx, dy) = (i64::from(c.x - wanted.x), i64::from(c.y - wanted.y));
            (dx * dx + dy * dy, c.y, c.x)
        };
        cells.sort_by_key(far);
        let cell = cells.into_iter().find(|&cell| self.cost(cell).is_some())?;
        let (x, y) = self.mapper.lattice().centre(cell);
        Some([x, y])
    }

    /// Cost of standing on a cell; `None` where the robot cannot.
    fn cost(&mut self, cell: Cell) -> Option<(f32, Criterion)> {
        let (mapper, footprint) = (self.mapper, &self.footprint);
        *self.known.entry(cell).or_insert_with(|| {
            let known = mapper.cost(cell).cost().is_some();
            let (x, y) = mapper.lattice().centre(cell);
            let under = known.then(|| mapper.footprint(footprint, [x, y, 0.0]))?;
            let cost = under.cost.filter(|&cost| cost < 1.0)?;
            Some((cost, under.reason))
        })
    }

    fn steps(&mut self, cell: Cell) -> Vec<(Cell, u32)> {
        let neighbours = (-1..=1).flat_map(|y| (-1..=1).map(move |x| (x, y)));
        let step = |(x, y)| {
            let next = cell.offset(x, y);
            let (cost, _) = self.cost(next).filter(|_| (x, y) != (0, 0))?;
            let length = if x != 0 && y != 0 { DIAGONAL } else { STEP };
            Some((next, (length * (1.0 + COST_WEIGHT * cost)) as u32))
        };
        neighbours.filter_map(step).collect()
    }

    fn describe(&mut self, cells: Vec<Cell>) -> Plan {
        let centre = |cell: &Cell| {
            let (x, y) = self.mapper.lattice().centre(*cell);
            [f64::from(x), f64::from(y)]
        };
        let points: Vec<[f64; 2]> = cells.iter().map(centre).collect();
        let length = points
            .windows(2)
            .map(|p| (p[1][0] - p[0][0]).hypot(p[1][1] - p[0][1]))
            .sum();
        let free = (0.0, Criterion::Free);
        let costs = cells.iter().filter_map(|&cell| self.cost(cell));
        let worst = costs.fold(
            free,
            |worst, cost| if cost.0 > worst.0 { cost } else { worst },
        );
        Plan {
            cells,
            points,
            length,
            worst,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planes::HeapPlanes;
    use nalgebra::Isometry3;
    use rugosa::Config;
    use rugosa_terrain::Noise;
    use rugosa_terrain::grid::View;

    /// A wall along x = 1 m with a gate at y = 1.5 m; the roughness of its tiles is not to
    /// count.
    fn walled() -> (Config, Vec<[f32; 3]>) {
        let mut config = Config::default();
        for name in ["roughness_critical", "roughness_safe"] {
            let index = Config::index_of(name).unwrap();
            config
                .set(index, if name.ends_with("safe") { 50.0 } else { 90.0 })
                .unwrap();
        }
        let wall = |x: f32, y: f32| x.abs() < 0.1 && (y - 1.0).abs() > 0.6;
        let at = |i: i32| (i as f32 + 0.5) * 0.05;
        let grid = (-60..60).flat_map(|i| (-60..60).map(move |j| (at(i), at(j))));
        let points = grid.map(|(x, y)| [x, y, if wall(x, y) { 0.8 } else { 0.0 } - 20.0]);
        (config, points.collect())
    }

    #[test]
    fn the_path_goes_through_the_gate_and_not_through_the_wall() {
        let (config, points) = walled();
        let mut planes = HeapPlanes::new(65);
        let mut mapper = Mapper::new(config, planes.lend()).unwrap();
        let view = View {
            map_from_sensor: &Isometry3::translation(0.0, 0.0, 20.0),
            noise: &Noise::new(0.005, 0.0, 0.0),
            sweep: 1,
        };
        mapper.points(&points, &view);
        mapper.commit(&mut |_| {});
        let mut planner = Planner::new(&mapper, 0.15);
        let plan = planner.plan([-1.5, -1.0], [1.5, -1.0]).unwrap();
        let [first, last] = [plan.points[0], plan.points[plan.points.len() - 1]];
        assert!((first[0] + 1.45).abs() < 0.06 && (last[0] - 1.55).abs() < 0.06);
        let crossing = plan.points.iter().find(|p| p[0].abs() < 0.06).unwrap();
        assert!((crossing[1] - 1.0).abs() < 0.6, "{crossing:?}");
        assert!(plan.length > 4.0 && plan.worst.0 < 1.0, "{plan:?}");
        assert_eq!(planner.plan([-1.5, -1.0], [0.0, -1.0]), None);
        assert_eq!(planner.plan([-1.5, -1.0], [99.0, 0.0]), None);
        let far = planner.farthest([-1.5, -1.0]).unwrap();
        assert!(far[0] > 0.0 && far[1] < 0.0, "behind the wall: {far:?}");
        let near = planner.nearest([0.0, -1.0]).unwrap();
        assert!(
            near[0].abs() > 0.3 && (near[1] + 1.0).abs() < 0.2,
            "{near:?}"
        );
    }
}
