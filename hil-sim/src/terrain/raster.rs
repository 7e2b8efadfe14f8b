//! Terrain on a raster of nodes with bilinear patches between them.
//!
//! Node (row i, column j) stands at (origin_x + j · spacing, origin_y + i · spacing);
//! NaN is a hole, and the four patches around it have no surface. Outside of the
//! raster there is no surface either.
//!
//! A ray walks through a pyramid of maxima: a block of patches that lies wholly below
//! the ray is passed in one step, the others are opened, and a single patch is solved
//! as a quadratic (Tevs, Ihrke and Seidel 2008, "Maximum mipmaps for fast, accurate,
//! and scalable dynamic height field rendering"). The result is the exact intersection
//! with the bilinear surface; the cost is O(log side) where the ray is high above the
//! ground and grows with the number of crests that it grazes.

use super::{Hit, Ray, Terrain, upward_normal};
use anyhow::{Result, ensure};

/// A cut through the border of a hole is told from a rounding error by this \[m\].
const CUT: f64 = 1e-6;

/// Bilinear terrain on square patches.
pub struct Raster {
    columns: usize,
    rows: usize,
    spacing: f64,
    origin: [f64; 2],
    nodes: Vec<f32>,
    /// level 0 has one value per patch, each further level one per 2 × 2 of the last
    pyramid: Vec<Level>,
}

struct Level {
    columns: usize,
    maxima: Vec<f32>,
}

impl Level {
    fn rows(&self) -> usize {
        self.maxima.len() / self.columns
    }

    fn get(&self, x: usize, y: usize) -> f32 {
        self.maxima[y * self.columns + x]
    }

    fn coarser(&self) -> Level {
        let columns = self.columns.div_ceil(2);
        let rows = self.rows().div_ceil(2);
        let mut maxima = vec![f32::NEG_INFINITY; columns * rows];
        for (i, &value) in self.maxima.iter().enumerate() {
            let (x, y) = (i % self.columns, i / self.columns);
            let block = &mut maxima[y / 2 * columns + x / 2];
            *block = block.max(value);
        }
        Level { columns, maxima }
    }
}

impl Raster {
    /// A raster of `nodes` (row after row, y ascending) with `columns` nodes per row,
    /// `spacing` \[m\] apart; node (0, 0) at `origin` \[m\].
    pub fn new(nodes: Vec<f32>, columns: usize, spacing: f64, origin: [f64; 2]) -> Result<Self> {
        ensure!(
            columns >= 2,
            "a raster has at least 2 columns, not {columns}"
        );
        ensure!(
            nodes.len().is_multiple_of(columns) && nodes.len() / columns >= 2,
            "{} nodes are not 2 or more rows of {columns}",
            nodes.len()
        );
        ensure!(
            spacing > 0.0 && spacing.is_finite(),
            "the spacing is {spacing} m"
        );
        let rows = nodes.len() / columns;
        let pyramid = pyramid(&nodes, columns);
        Ok(Raster {
            columns,
            rows,
            spacing,
            origin,
            nodes,
            pyramid,
        })
    }

    /// The same raster with its middle over (x, y) \[m\].
    pub fn centred_on(mut self, x: f64, y: f64) -> Self {
        let [width, depth] = self.extent();
        self.origin = [x - width / 2.0, y - depth / 2.0];
        self
    }

    /// Nodes per row and rows.
    pub fn size(&self) -> (usize, usize) {
        (self.columns, self.rows)
    }

    /// Distance of two nodes \[m\].
    pub fn spacing(&self) -> f64 {
        self.spacing
    }

    /// Where node (0, 0) stands \[m\].
    pub fn origin(&self) -> [f64; 2] {
        self.origin
    }

    /// Edges along x and y \[m\].
    pub fn extent(&self) -> [f64; 2] {
        [
            (self.columns - 1) as f64 * self.spacing,
            (self.rows - 1) as f64 * self.spacing,
        ]
    }

    /// Elevations \[m\], row after row, y ascending, NaN in holes.
    pub fn nodes(&self) -> &[f32] {
        &self.nodes
    }

    /// z = a + b u + c v + d u v on patch (x, y), with u, v in \[0, 1\].
    fn patch(&self, x: usize, y: usize) -> [f64; 4] {
        let node = |x: usize, y: usize| f64::from(self.nodes[y * self.columns + x]);
        let (sw, se, nw, ne) = (
            node(x, y),
            node(x + 1, y),
            node(x, y + 1),
            node(x + 1, y + 1),
        );
        [sw, se - sw, nw - sw, ne - se - nw + sw]
    }

    fn walk(&self, ray: &Ray, reach: f64) -> Option<Hit> {
        let mut walk = Walk::enter(self, ray, reach)?;
        loop {
            match walk.step() {
                Progress::On => {}
                Progress::Gone => return None,
                Progress::At(hit) => return Some(hit),
            }
        }
    }
}

fn pyramid(nodes: &[f32], columns: usize) -> Vec<Level> {
    let rows = nodes.len() / columns;
    let patch = |i: usize| {
        let (x, y) = (i % (columns - 1), i / (columns - 1));
        let sw = y * columns + x;
        let corners = [
            nodes[sw],
            nodes[sw + 1],
            nodes[sw + columns],
            nodes[sw + columns + 1],
        ];
        match corners.iter().any(|z| z.is_nan()) {
            true => f32::NEG_INFINITY,
            false => corners.into_iter().fold(f32::NEG_INFINITY, f32::max),
        }
    };
    let mut levels = vec![Level {
        columns: columns - 1,
        maxima: (0..(columns - 1) * (rows - 1)).map(patch).collect(),
    }];
    while levels[levels.len() - 1].maxima.len() > 1 {
        levels.push(levels[levels.len() - 1].coarser());
    }
    levels
}

impl Terrain for Raster {
    fn elevation(&self, x: f64, y: f64) -> Option<f64> {
        let u = (x - self.origin[0]) / self.spacing;
        let v = (y - self.origin[1]) / self.spacing;
        let (last_u, last_v) = ((self.columns - 1) as f64, (self.rows - 1) as f64);
        if !(0.0..=last_u).contains(&u) || !(0.0..=last_v).contains(&v) {
            return None;
        }
        let (i, j) = (
            (u as usize).min(self.columns - 2),
            (v as usize).min(self.rows - 2),
        );
        let [a, b, c, d] = self.patch(i, j);
        let (u, v) = (u - i as f64, v - j as f64);
        let z = a + b * u + c * v + d * u * v;
        (!z.is_nan()).then_some(z)
    }

    fn cast(&self, ray: &Ray, reach: f64) -> Option<Hit> {
        self.walk(ray, reach)
    }
}

enum Progress {
    On,
    Gone,
    At(Hit),
}

/// One ray on its way through the pyramid; x and y in patches, z and t in metres.
struct Walk<'r> {
    raster: &'r Raster,
    origin: [f64; 3],
    slope: [f64; 3],
    /// distance covered, and distance at which the ray leaves the raster
    t: f64,
    end: f64,
    level: usize,
    patch: [i64; 2],
}

impl<'r> Walk<'r> {
    fn enter(raster: &'r Raster, ray: &Ray, reach: f64) -> Option<Self> {
        let scale = 1.0 / raster.spacing;
        let origin = [
            (ray.origin.x - raster.origin[0]) * scale,
            (ray.origin.y - raster.origin[1]) * scale,
            ray.origin.z,
        ];
        let slope = [
            ray.direction.x * scale,
            ray.direction.y * scale,
            ray.direction.z,
        ];
        let patches = [raster.columns - 1, raster.rows - 1];
        let (mut t, mut end) = (0.0f64, reach);
        for axis in 0..2 {
            let (near, far) = crossing(origin[axis], slope[axis], patches[axis] as f64)?;
            t = t.max(near);
            end = end.min(far);
        }
        let at = |axis: usize| {
            let cell = (origin[axis] + slope[axis] * t).floor() as i64;
            cell.clamp(0, patches[axis] as i64 - 1)
        };
        (t <= end).then(|| Walk {
            raster,
            origin,
            slope,
            t,
            end,
            level: raster.pyramid.len() - 1,
            patch: [at(0), at(1)],
        })
    }

    fn step(&mut self) -> Progress {
        let (leave, axis) = self.exit();
        let low = self.z(self.t).min(self.z(leave));
        let block = [self.patch[0] >> self.level, self.patch[1] >> self.level];
        let level = &self.raster.pyramid[self.level];
        if low <= f64::from(level.get(block[0] as usize, block[1] as usize)) {
            if self.level > 0 {
                self.level -= 1;
                return Progress::On;
            }
            match self.meet(leave) {
                Progress::On => {}
                end => return end,
            }
        }
        self.advance(leave, axis)
    }

    fn z(&self, t: f64) -> f64 {
        self.origin[2] + self.slope[2] * t
    }

    /// Where the ray leaves the present block, and through which side.
    fn exit(&self) -> (f64, usize) {
        let along = |axis: usize| {
            let block = self.patch[axis] >> self.level;
            let side = block + i64::from(self.slope[axis] > 0.0);
            match self.slope[axis] {
                0.0 => f64::INFINITY,
                slope => ((side << self.level) as f64 - self.origin[axis]) / slope,
            }
        };
        let (x, y) = (along(0), along(1));
        let (t, axis) = if x <= y { (x, 0) } else { (y, 1) };
        (t.clamp(self.t, self.end), axis)
    }

    /// Goes to `leave` and into the next block, and tries a coarser level there.
    fn advance(&mut self, leave: f64, axis: usize) -> Progress {
        if leave >= self.end {
            return Progress::Gone;
        }
        let patches = [self.raster.columns - 1, self.raster.rows - 1];
        let (size, other) = (1i64 << self.level, 1 - axis);
        let block = self.patch[axis] >> self.level;
        self.patch[axis] = match self.slope[axis] > 0.0 {
            true => (block + 1) * size,
            false => block * size - 1,
        };
        let first = (self.patch[other] >> self.level) * size;
        let across = (self.origin[other] + self.slope[other] * leave).floor() as i64;
        self.patch[other] = across
            .clamp(first, first + size - 1)
            .min(patches[other] as i64 - 1);
        self.t = leave;
        if self.patch[axis] < 0 || self.patch[axis] >= patches[axis] as i64 {
            return Progress::Gone;
        }
        self.level = (self.level + 1).min(self.raster.pyramid.len() - 1);
        Progress::On
    }

    /// Solves the patch between the present place and `leave`.
    fn meet(&self, leave: f64) -> Progress {
        let [a, b, c, d] = self
            .raster
            .patch(self.patch[0] as usize, self.patch[1] as usize);
        let [su, sv, sz] = self.slope;
        let u = self.origin[0] + su * self.t - self.patch[0] as f64;
        let v = self.origin[1] + sv * self.t - self.patch[1] as f64;
        // height above the patch after a further s metres: gap + rate s + bend s²
        let gap = self.z(self.t) - (a + b * u + c * v + d * u * v);
        let rate = sz - (b * su + c * sv + d * (u * sv + v * su));
        let bend = -d * su * sv;
        if gap < -CUT {
            return Progress::Gone;
        }
        let Some(s) = first_root(gap.max(0.0), rate, bend, leave - self.t) else {
            return Progress::On;
        };
        let (u, v) = (u + su * s, v + sv * s);
        let scale = 1.0 / self.raster.spacing;
        Progress::At(Hit {
            distance: self.t + s,
            normal: upward_normal((b + d * v) * scale, (c + d * u) * scale),
        })
    }
}

/// Where origin + slope · t lies in \[0, size\].
fn crossing(origin: f64, slope: f64, size: f64) -> Option<(f64, f64)> {
    if slope == 0.0 {
        return (0.0..=size)
            .contains(&origin)
            .then_some((f64::NEG_INFINITY, f64::INFINITY));
    }
    let (a, b) = (-origin / slope, (size - origin) / slope);
    Some((a.min(b), a.max(b)))
}

/// Smallest s in \[0, limit\] with gap + rate · s + bend · s² ≤ 0, for gap ≥ 0.
fn first_root(gap: f64, rate: f64, bend: f64, limit: f64) -> Option<f64> {
    let discriminant = rate * rate - 4.0 * bend * gap;
    if gap == 0.0 && (rate < 0.0 || (rate == 0.0 && bend < 0.0)) {
        return Some(0.0);
    }
    // the numerically stable pair: of like signs first, then by the product of roots
    let sum = -0.5 * (rate + discriminant.max(0.0).sqrt().copysign(rate));
    let roots = [sum / bend, gap / sum];
    let smallest = roots
        .into_iter()
        .filter(|s| discriminant >= 0.0 && *s > 0.0 && *s <= limit)
        .fold(f64::INFINITY, f64::min);
    if smallest.is_finite() {
        return Some(smallest);
    }
    // rounding at the far side: the end is below, so the crossing is there
    let end = gap + rate * limit + bend * limit * limit;
    (end < 0.0).then_some(limit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn slanted(columns: usize, rows: usize, spacing: f64) -> Raster {
        let nodes = (0..rows * columns)
            .map(|i| 0.25 * (i % columns) as f32 - 0.125 * (i / columns) as f32)
            .collect();
        Raster::new(nodes, columns, spacing, [-1.0, -2.0]).unwrap()
    }

    /// Marches in small steps and halves the last one: slow and obvious.
    fn marched(raster: &Raster, ray: &Ray, reach: f64) -> Option<f64> {
        let below = |t: f64| {
            let p = ray.at(t);
            raster.elevation(p.x, p.y).is_some_and(|z| p.z <= z)
        };
        let step = 1e-3;
        let n = (0..(reach / step) as usize).find(|&i| below(i as f64 * step))?;
        let (mut a, mut b) = ((n as f64 - 1.0) * step, n as f64 * step);
        for _ in 0..60 {
            let m = 0.5 * (a + b);
            if below(m) { b = m } else { a = m }
        }
        Some(b)
    }

    fn bumpy() -> Raster {
        let mut random = crate::random::Random::new(7);
        let nodes = (0..37 * 23)
            .map(|_| 0.4 * random.uniform() as f32)
            .collect();
        Raster::new(nodes, 37, 0.1, [0.0, 0.0]).unwrap()
    }

    #[test]
    fn a_raster_of_a_plane_is_the_plane() {
        let raster = slanted(41, 33, 0.5);
        let plane = super::super::Plane {
            height: 0.5 - 0.5,
            slope_x: 0.5,
            slope_y: -0.25,
        };
        for (ax, ay) in [
            (0.3, 0.1),
            (-0.2, 0.5),
            (0.0, 0.4),
            (1.5, 0.0),
            (-0.01, -0.7),
        ] {
            let ray = Ray {
                origin: Vector3::new(4.0, 4.0, 5.0),
                direction: Vector3::new(ax, ay, -1.0).normalize(),
            };
            let (a, b) = (raster.cast(&ray, 50.0), plane.cast(&ray, 50.0));
            let (a, b) = (a.unwrap(), b.unwrap());
            assert!((a.distance - b.distance).abs() < 1e-11, "{a:?} {b:?}");
            assert!((a.normal - b.normal).norm() < 1e-6);
        }
    }

    #[test]
    fn rays_through_bumps_meet_what_marching_meets() {
        let raster = bumpy();
        let mut random = crate::random::Random::new(1);
        let mut met = 0;
        for _ in 0..300 {
            let mut spread = |a: f64, b: f64| a + (b - a) * random.uniform();
            let ray = Ray {
                origin: Vector3::new(spread(-0.5, 4.0), spread(-0.5, 2.5), 0.6),
                direction: Vector3::new(spread(-1.0, 1.0), spread(-1.0, 1.0), spread(-0.6, -0.05))
                    .normalize(),
            };
            let start_below = marched(&raster, &ray, 8.0);
            let fast = raster.cast(&ray, 8.0).map(|hit| hit.distance);
            // entering through the cut side of the raster is no hit
            let p = ray.at(start_below.unwrap_or(0.0) - 1e-2);
            if raster.elevation(p.x, p.y).is_none() {
                continue;
            }
            met += usize::from(fast.is_some());
            match (fast, start_below) {
                (Some(a), Some(b)) => assert!((a - b).abs() < 1e-6, "{a} {b} {ray:?}"),
                (a, b) => assert_eq!(a, b, "{ray:?}"),
            }
        }
        assert!(met > 100, "only {met} rays met the ground");
    }

    #[test]
    fn holes_have_no_surface() {
        let mut nodes = vec![0.0f32; 25];
        nodes[12] = f32::NAN;
        let raster = Raster::new(nodes, 5, 1.0, [0.0, 0.0]).unwrap();
        assert_eq!(raster.elevation(1.5, 1.5), None);
        assert_eq!(raster.elevation(0.5, 0.5), Some(0.0));
        assert_eq!(raster.elevation(4.0, 4.0), Some(0.0));
        assert_eq!(raster.elevation(4.1, 4.0), None);
        let down = |x, y| Ray {
            origin: Vector3::new(x, y, 1.0),
            direction: -Vector3::z(),
        };
        assert_eq!(raster.cast(&down(1.5, 1.5), 9.0), None);
        assert_eq!(raster.cast(&down(0.5, 1.5), 9.0).unwrap().distance, 1.0);
    }

    #[test]
    fn bad_rasters_are_refused() {
        assert!(Raster::new(vec![0.0; 7], 3, 1.0, [0.0; 2]).is_err());
        assert!(Raster::new(vec![0.0; 4], 2, 0.0, [0.0; 2]).is_err());
        assert!(Raster::new(vec![0.0; 4], 1, 1.0, [0.0; 2]).is_err());
    }
}
