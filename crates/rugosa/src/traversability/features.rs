//! Slope, step height and the chance of a hidden step around each cell of a tile.
//!
//! Within a disc of radius r around a cell, from the elevations z_j (variance v_j) of its
//! measured cells at offsets (x_j, y_j) from it, relative to the cell's own elevation:
//!
//! ```text
//! slope   atan |∇|, ∇ from the least-squares plane through the z_j
//! step    max_j |z_j − z_0|
//! hidden  max_j P(|z_j − z_0| > limit),  z_j − z_0 ~ N(Δ_j, s_j²)
//!         measured j: Δ_j = z_j − z_0, s_j² = v_0 + v_j
//!         unseen j:   Δ_j = 0,         s_j² = v_0 + σ² d_j^{2H}
//! ```
//!
//! The greatest chance is that of the least (limit − |Δ_j|) / s_j, up to the far tail, which
//! doubles it at most. The last line is the roughness map at work: E|Δz| = σ d^H √(2/π), so rough ground is
//! more likely to hide a step in what was not seen. The maximum over j is a lower bound of
//! the chance that any step exceeds the limit; neighbouring cells are far from independent,
//! so the product of their chances would be no better.
//!
//! The cells of a tile and its margin are unpacked once; then each measured cell looks at the
//! rows of its disc, four neighbours at a time, passing over fours of which none is measured.
//! Sums over a column of the disc come first, their products with x last. Of the unseen
//! neighbours the farthest counts, which bits tell. What a disc looks like, and the powers
//! d^{2H}, are the same for all cells of a tile. A slope needs at least [`LEAST`] measured cells
//! that do not lie on a line; otherwise it is NaN.
//!
//! Cost: about 20 operations per neighbour (56 at 3 cells where all are measured).
//! `cargo bench -p rugosa` prints the time.

use super::Limits;
use rugosa_fractal::roughness::Roughness;
use rugosa_grid::{TILE, Tile, math};
use rugosa_terrain::ElevationGrid;
use wide::f32x4;

/// Fewest measured cells of a slope.
pub const LEAST: f32 = 4.0;
/// Greatest radius of the disc in cells.
pub const REACH: i32 = 8;

/// Keeps variances positive \[m²\].
const TINY: f32 = 1e-12;

/// Neighbours that are looked at together.
const LANES: usize = 4;
/// Side of a tile with its margin; rows are longer, so that the last four can be read.
const SIDE: usize = (TILE + 2 * REACH) as usize;
/// Columns of the widest disc, in fours.
const WIDTH: usize = (2 * REACH as usize + 1).next_multiple_of(LANES);
const LONG: usize = TILE as usize + WIDTH;

/// What the ground around a cell is like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Features {
    /// slope \[rad\]; NaN where too little was measured
    pub slope: f32,
    /// greatest difference of elevation to the cell \[m\]
    pub step: f32,
    /// chance that a step exceeds the limit
    pub hidden_step: f32,
    /// standard deviation of the cell's elevation \[m\]
    pub uncertainty: f32,
}

/// Elevations and variances of a tile and its margin, row by row.
pub(crate) struct Patch([Strip; SIDE]);

/// A row of them.
#[derive(Clone, Copy)]
struct Strip {
    elevation: [f32; LONG],
    /// above 0 where measured, else 0
    variance: [f32; LONG],
    /// bit x: measured?
    measured: u32,
}

/// Squared distances in cells that occur in a disc.
const SQUARES: usize = (REACH * REACH + 2) as usize;

/// What the features of a tile depend on besides its elevations: the disc around a cell, by
/// the distance of its rows, from its first column on.
pub(crate) struct Around {
    /// cell edge \[m\]
    resolution: f32,
    /// radius of the disc in cells
    radius: i32,
    /// the step that must not be exceeded \[m\]
    limit: f32,
    rows: [DiscRow; REACH as usize + 1],
    /// σ² d^{2H} by squared distance in cells; 0 where the roughness is not known
    hidden: [f32; SQUARES],
}

/// A row of the disc, without its middle.
#[derive(Clone, Copy)]
struct DiscRow {
    /// 1 in the disc, 0 beside it
    within: [f32; WIDTH],
    /// bit x: in the disc?
    bits: u32,
}

impl Around {
    /// For cells of `resolution` \[m\], in the limits' window, on ground of this roughness.
    pub(crate) fn new(resolution: f32, limits: &Limits, roughness: Option<&Roughness>) -> Self {
        let radius = disc(limits.window / resolution);
        let mut around = Around {
            resolution,
            radius,
            limit: limits.step.critical,
            rows: [DiscRow {
                within: [0.0; WIDTH],
                bits: 0,
            }; REACH as usize + 1],
            hidden: variances(resolution, radius, roughness),
        };
        for y in 0..=radius {
            for x in (-radius..=radius).filter(|&x| is_within(radius, x, y)) {
                let (row, column) = (&mut around.rows[y as usize], (x + radius) as usize);
                row.within[column] = 1.0;
                row.bits |= 1 << column;
            }
        }
        around
    }

    /// Where the fours of columns begin.
    #[inline(always)]
    fn columns(&self) -> impl Iterator<Item = usize> + use<> {
        let fours = (2 * self.radius as usize + 1).div_ceil(LANES);
        (0..fours).map(|four| four * LANES)
    }

    /// Cells around a tile that its features depend on.
    pub(crate) fn margin(&self) -> i32 {
        self.radius
    }
}

/// σ² d^{2H} by squared distance in cells.
fn variances(resolution: f32, radius: i32, roughness: Option<&Roughness>) -> [f32; SQUARES] {
    let mut variances = [0.0; SQUARES];
    let Some(r) = roughness else {
        return variances;
    };
    for y in 1..=radius {
        for x in (0..=y).filter(|&x| is_within(radius, x, y)) {
            let square = (x * x + y * y) as usize;
            let metres = square as f32 * resolution * resolution;
            variances[square] = r.sigma * r.sigma * math::powf(metres, r.hurst);
        }
    }
    variances
}

/// Is the cell at this offset in the disc, and not its middle?
fn is_within(radius: i32, x: i32, y: i32) -> bool {
    (1..=radius * radius + 1).contains(&(x * x + y * y))
}

impl Patch {
    /// Nothing measured.
    pub(crate) const fn new() -> Self {
        let strip = Strip {
            elevation: [0.0; LONG],
            variance: [0.0; LONG],
            measured: 0,
        };
        Patch([strip; SIDE])
    }

    /// Unpacks a tile and `margin` cells around it into an empty patch.
    pub(crate) fn fill(&mut self, grid: &ElevationGrid, tile: Tile, margin: i32) {
        let corner = tile.origin().offset(-REACH, -REACH);
        let window = grid.window();
        let columns: [_; SIDE] =
            core::array::from_fn(|x| window.column_part(corner.x.wrapping_add(x as i32)));
        let reached = (REACH - margin) as usize..(TILE + REACH + margin) as usize;
        for y in reached.clone() {
            let Some(row) = window.row_part(corner.y.wrapping_add(y as i32)) else {
                continue;
            };
            for x in reached.clone() {
                if let Some(ground) = columns[x].and_then(|column| grid.elevation(row + column)) {
                    self.set([x, y], ground);
                }
            }
        }
    }

    fn set(&mut self, [x, y]: [usize; 2], [elevation, variance]: [f32; 2]) {
        let strip = &mut self.0[y];
        strip.elevation[x] = elevation;
        strip.variance[x] = variance + TINY;
        strip.measured |= 1 << x;
    }

    /// Features of the cells of one row of the tile; `None` where not measured.
    pub(crate) fn row(&self, row: usize, around: &Around) -> [Option<Features>; TILE as usize] {
        let measured = self.0[row + REACH as usize].measured >> REACH;
        core::array::from_fn(|column| {
            let is_measured = measured >> column & 1 > 0;
            is_measured.then(|| self.cell([row, column], around))
        })
    }

    fn cell(&self, [row, column]: [usize; 2], around: &Around) -> Features {
        let [row, column] = [row, column].map(|i| i + REACH as usize);
        let (elevation, variance) = (self.0[row].elevation[column], self.0[row].variance[column]);
        let radius = around.radius as usize;
        let (rows, left) = (&self.0[row - radius..][..2 * radius + 1], column - radius);
        let mut measured = [0; 2 * REACH as usize + 1];
        let mut farthest = 0;
        for ((strip, y), measured) in rows.iter().zip(-around.radius..).zip(&mut measured) {
            let disc = around.rows[y.unsigned_abs() as usize].bits;
            *measured = strip.measured >> left & disc;
            farthest = farthest.max(farthest_square(disc & !*measured, around.radius, y));
        }
        let unseen = around.hidden[farthest as usize];
        let mut sums = Sums::default();
        let mut worst = Worst::unseen(around.limit, variance + unseen);
        for first in around.columns() {
            let mut columns = Columns::new([elevation, variance]);
            for ((strip, y), measured) in rows.iter().zip(-around.radius..).zip(&measured) {
                if measured >> first & ALL_LANES == 0 {
                    continue;
                }
                let near = Neighbours {
                    elevation: four(&strip.elevation, left + first),
                    variance: four(&strip.variance, left + first),
                    within: four(&around.rows[y.unsigned_abs() as usize].within, first),
                };
                columns.add(&near, y as f32, around.limit);
            }
            sums.add(&columns, first as f32 - around.radius as f32);
            worst.meet(&columns);
        }
        let (step, [margin, spread]) = worst.of_all();
        Features {
            slope: sums.slope(around.resolution),
            step,
            hidden_step: exceeds(margin, spread, around.limit),
            uncertainty: math::sqrt(variance),
        }
    }
}

/// Squared distance of the farthest of some cells of row `y`; 0 if there is none.
#[inline(always)]
fn farthest_square(bits: u32, radius: i32, y: i32) -> i32 {
    if bits == 0 {
        return 0;
    }
    let left = radius - bits.trailing_zeros() as i32;
    let right = 31 - bits.leading_zeros() as i32 - radius;
    let x = left.max(right);
    x * x + y * y
}

/// Radius in whole cells, 1 … [`REACH`].
fn disc(cells: f32) -> i32 {
    math::round_index(cells).clamp(1, REACH)
}

/// One number for each of four columns of a disc.
type Lanes = f32x4;

/// Four numbers of a row.
#[inline(always)]
fn four<const N: usize>(row: &[f32; N], first: usize) -> Lanes {
    // one check of the bounds for all
    let four = row[first..].first_chunk::<LANES>();
    Lanes::from(four.copied().unwrap_or_default())
}

/// One bit for each.
const ALL_LANES: u32 = (1 << LANES) - 1;

/// Four cells of a row of the disc.
struct Neighbours {
    elevation: Lanes,
    /// 0 where not measured
    variance: Lanes,
    within: Lanes,
}

/// Sums over the rows of the disc, for four columns.
struct Columns {
    elevation: Lanes,
    variance: Lanes,
    count: Lanes,
    y: Lanes,
    yy: Lanes,
    z: Lanes,
    yz: Lanes,
    step: Lanes,
    /// (limit − |Δ|) |limit − |Δ|| and s² of the neighbour most likely to exceed the limit:
    /// that of their least quotient
    margin: Lanes,
    spread: Lanes,
}

/// Greater than any numerator.
const FAR: f32 = 1e30;

impl Columns {
    /// Around a cell of this elevation and variance.
    fn new([elevation, variance]: [f32; 2]) -> Self {
        Columns {
            elevation: Lanes::splat(elevation),
            variance: Lanes::splat(variance),
            count: Lanes::ZERO,
            y: Lanes::ZERO,
            yy: Lanes::ZERO,
            z: Lanes::ZERO,
            yz: Lanes::ZERO,
            step: Lanes::ZERO,
            margin: Lanes::splat(FAR),
            spread: Lanes::splat(1.0),
        }
    }

    #[inline(always)]
    fn add(&mut self, near: &Neighbours, y: f32, limit: f32) {
        let (y, limit) = (Lanes::splat(y), Lanes::splat(limit));
        let is_measured = near.variance.simd_gt(Lanes::ZERO);
        let count = near.within & is_measured;
        let rise = (near.elevation - self.elevation) * count;
        self.count += count;
        self.y += y * count;
        self.yy += y * y * count;
        self.z += rise;
        self.yz += y * rise;
        let rise = rise.abs();
        self.step = self.step.fast_max(rise);
        // 0 where nothing is measured and beside the disc, so never the worst
        let spread = (self.variance + near.variance) * count;
        let rest = limit - rise;
        let margin = rest * rest.abs();
        // a / b < c / d without a division, b and d being positive
        let worse = (margin * self.spread).simd_lt(self.margin * spread);
        self.margin = worse.select(margin, self.margin);
        self.spread = worse.select(spread, self.spread);
    }
}

/// Sum of four, in this order on every machine.
fn total(lanes: Lanes) -> f32 {
    let [a, b, c, d] = lanes.to_array();
    (a + c) + (b + d)
}

/// Sums over the cells of the disc without its middle, in four parts.
#[derive(Default)]
struct Sums {
    count: Lanes,
    /// Σx, Σy, Σz
    first: [Lanes; 3],
    /// Σxx, Σxy, Σyy, Σxz, Σyz
    second: [Lanes; 5],
}

impl Sums {
    /// Adds four columns, the first of them at `first`.
    #[inline(always)]
    fn add(&mut self, columns: &Columns, first: f32) {
        const STEPS: [f32; LANES] = [0.0, 1.0, 2.0, 3.0];
        let x = Lanes::splat(first) + Lanes::from(STEPS);
        let across = x * columns.count;
        self.count += columns.count;
        let first = [across, columns.y, columns.z];
        let second = [
            x * across,
            x * columns.y,
            columns.yy,
            x * columns.z,
            columns.yz,
        ];
        self.first
            .iter_mut()
            .zip(first)
            .for_each(|(s, of)| *s += of);
        self.second
            .iter_mut()
            .zip(second)
            .for_each(|(s, of)| *s += of);
    }

    /// Slope of the plane; x, y and z are counted from the middle, which is one cell more.
    fn slope(&self, resolution: f32) -> f32 {
        let n = 1.0 + total(self.count);
        let [x, y, z] = self.first.map(total);
        let [xx, xy, yy, xz, yz] = self.second.map(total);
        let (xx, xy, yy) = (xx - x * x / n, xy - x * y / n, yy - y * y / n);
        let (xz, yz) = (xz - x * z / n, yz - y * z / n);
        let det = xx * yy - xy * xy;
        if n < LEAST || det < 0.1 {
            return f32::NAN;
        }
        let east = (xz * yy - yz * xy) / det;
        let north = (yz * xx - xz * xy) / det;
        math::atan2(math::sqrt(east * east + north * north), resolution)
    }
}

/// The highest steps, and the neighbours most likely to exceed the limit, in four parts.
struct Worst {
    step: Lanes,
    /// as of [`Columns`]
    margin: Lanes,
    spread: Lanes,
}

impl Worst {
    /// Nothing but a cell whose elevation differs by 0, with this variance.
    fn unseen(limit: f32, spread: f32) -> Self {
        Worst {
            step: Lanes::ZERO,
            margin: Lanes::splat(limit * limit),
            spread: Lanes::splat(spread),
        }
    }

    #[inline(always)]
    fn meet(&mut self, columns: &Columns) {
        self.step = self.step.fast_max(columns.step);
        let worse = (columns.margin * self.spread).simd_lt(self.margin * columns.spread);
        self.margin = worse.select(columns.margin, self.margin);
        self.spread = worse.select(columns.spread, self.spread);
    }

    /// The highest step; margin and spread of the worst neighbour.
    fn of_all(&self) -> (f32, [f32; 2]) {
        let [steps, margins, spreads] = [self.step, self.margin, self.spread].map(Lanes::to_array);
        let step = steps
            .into_iter()
            .fold(0.0, |a, b| if b > a { b } else { a });
        let worse = |a: [f32; 2], b: [f32; 2]| if b[0] * a[1] < a[0] * b[1] { b } else { a };
        let of = |i: usize| [margins[i], spreads[i]];
        (step, worse(worse(of(0), of(1)), worse(of(2), of(3))))
    }
}

/// P(|Δ| > limit) for Δ ~ N(mean, variance), where `margin` is (limit − mean) |limit − mean|;
/// 0 below 10⁻⁸.
fn exceeds(margin: f32, variance: f32, limit: f32) -> f32 {
    let rest = math::sqrt(math::abs(margin));
    let mean = if margin < 0.0 {
        limit + rest
    } else {
        limit - rest
    };
    let scale = 1.0 / math::sqrt(2.0 * variance);
    let tail = |x: f32| if x > 4.0 { 0.0 } else { math::erfc(x) };
    0.5 * (tail((limit - mean) * scale) + tail((limit + mean) * scale))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn patch(height: impl Fn(f32, f32) -> Option<f32>) -> Patch {
        let mut patch = Patch::new();
        for y in 0..SIDE {
            for x in 0..SIDE {
                if let Some(z) = height(x as f32 * 0.1, y as f32 * 0.1) {
                    patch.set([x, y], [z, 1e-6]);
                }
            }
        }
        patch
    }

    fn around(roughness: Option<&Roughness>) -> Around {
        let mut limits = Limits::default();
        limits.step.critical = 0.2;
        Around::new(0.1, &limits, roughness)
    }

    #[test]
    fn a_plane_has_its_slope_and_the_step_of_its_window() {
        let patch = patch(|x, y| Some(5.0 + 0.3 * x - 0.4 * y));
        for features in patch.row(3, &around(None)).map(Option::unwrap) {
            assert!((features.slope - 0.5f32.atan()).abs() < 1e-4);
            assert!((features.step - 0.15).abs() < 0.01, "{}", features.step);
            assert!(features.hidden_step < 1e-6);
        }
    }

    #[test]
    fn a_step_is_seen_from_its_neighbourhood_only() {
        let patch = patch(|x, _| Some(if x > 1.15 { 0.5 } else { 0.0 }));
        let row = patch.row(0, &around(None)).map(Option::unwrap);
        // the tile begins at column 8; the wall stands between columns 11 and 12
        assert_eq!(row[0].step, 0.0);
        assert!((row[1].step - 0.5).abs() < 1e-6 && (row[6].step - 0.5).abs() < 1e-6);
        assert_eq!(row[7].step, 0.0);
        assert!(row[3].hidden_step > 0.999 && row[0].hidden_step < 1e-6);
    }

    #[test]
    fn rough_ground_hides_steps_where_nothing_was_seen() {
        let patch = patch(|x, y| (x + y < 2.25).then_some(0.0));
        let rough = |sigma| Roughness {
            hurst: 0.5,
            sigma,
            ..Roughness::default()
        };
        let chance = |sigma| {
            patch.row(4, &around(Some(&rough(sigma))))[2]
                .unwrap()
                .hidden_step
        };
        assert!(chance(0.05) < 1e-4);
        // σ(0.3 m) = 0.5 √0.3 = 0.274: P(|Δ| > 0.2) = erfc(0.2 / (0.274 √2)) = 0.465
        assert!((chance(0.5) - 0.465).abs() < 0.03, "{}", chance(0.5));
        assert!(
            patch.row(0, &around(Some(&rough(0.5))))[0]
                .unwrap()
                .hidden_step
                < 1e-4
        );
    }

    /// Slope, step and quotient of the worst neighbour by their definitions, in f64.
    fn defined(
        z: impl Fn(i32, i32) -> Option<[f64; 2]>,
        [x0, y0]: [i32; 2],
        around: &Around,
    ) -> [f64; 3] {
        let Some([z0, v0]) = z(x0, y0) else {
            panic!("measured");
        };
        let (mut sums, mut rest) = ([0.0f64; 9], f64::INFINITY);
        let mut step = 0.0f64;
        let reach = around.radius;
        let disc = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| [x, y]));
        for [x, y] in disc.filter(|[x, y]| x * x + y * y <= reach * reach + 1) {
            let (dx, dy) = (f64::from(x), f64::from(y));
            let (rise, spread) = match z(x0 + x, y0 + y) {
                Some([z1, v1]) => {
                    let dz = z1 - z0;
                    let terms = [1.0, dx, dy, dz, dx * dx, dx * dy, dy * dy, dx * dz, dy * dz];
                    sums.iter_mut().zip(terms).for_each(|(s, t)| *s += t);
                    step = step.max(dz.abs());
                    (dz.abs(), v0 + v1)
                }
                None => {
                    let hidden = around.hidden[(x * x + y * y) as usize];
                    (0.0, v0 + f64::from(hidden))
                }
            };
            if [x, y] != [0, 0] {
                let limit = f64::from(around.limit);
                rest = rest.min((limit - rise) / (spread + 2.0 * f64::from(TINY)).sqrt());
            }
        }
        let [n, x, y, z, xx, xy, yy, xz, yz] = sums;
        let (xx, xy, yy) = (xx - x * x / n, xy - x * y / n, yy - y * y / n);
        let (xz, yz) = (xz - x * z / n, yz - y * z / n);
        let det = xx * yy - xy * xy;
        let slope = ((xz * yy - yz * xy) / det).hypot((yz * xx - xz * xy) / det);
        let slope = (slope / f64::from(around.resolution)).atan();
        let is_plane = n >= f64::from(LEAST) && det >= 0.1;
        [if is_plane { slope } else { f64::NAN }, step, rest]
    }

    proptest! {
        #[test]
        fn features_are_those_of_the_definition(
            seed: u32, seen in 1u32..=8, window in 0.05f32..0.9, sigma in 0.0f32..0.6, noisy: bool
        ) {
            let noise = |x: i32, y: i32, salt: u32| {
                let mut h = (x as u32).wrapping_mul(0x9e37_79b9) ^ (y as u32).wrapping_mul(0x85eb_ca6b) ^ seed ^ salt;
                h = (h ^ h >> 15).wrapping_mul(0x2c1b_3c6d);
                h = (h ^ h >> 12).wrapping_mul(0x297a_2d39);
                h ^ h >> 15
            };
            let unit = |h: u32| (h >> 8) as f32 / 16_777_216.0;
            // variance 0 is allowed
            let at = |x: i32, y: i32| (noise(x, y, 1) % 8 < seen).then(|| {
                let variance = if noisy { 0.01 * unit(noise(x, y, 2)) } else { 0.0 };
                [3.0 + 0.03 * x as f32 + 0.2 * unit(noise(x, y, 3)), variance]
            });
            let limits = Limits { window, ..Limits::default() };
            let rough = Roughness { hurst: 0.6, sigma, ..Roughness::default() };
            let around = Around::new(0.1, &limits, Some(&rough));
            let mut patch = Patch::new();
            let (low, high) = (REACH - around.margin(), TILE + REACH + around.margin());
            for (y, x) in (low..high).flat_map(|y| (low..high).map(move |x| (y, x))) {
                if let Some(ground) = at(x, y) {
                    patch.set([x as usize, y as usize], ground);
                }
            }
            for row in 0..TILE {
                for (column, found) in patch.row(row as usize, &around).into_iter().enumerate() {
                    let place = [column as i32 + REACH, row + REACH];
                    prop_assert_eq!(found.is_some(), at(place[0], place[1]).is_some());
                    let Some(found) = found else { continue };
                    let exact = |x, y| at(x, y).map(|ground| ground.map(f64::from));
                    let [slope, step, rest] = defined(exact, place, &around);
                    prop_assert_eq!(found.slope.is_nan(), slope.is_nan());
                    prop_assert!(slope.is_nan() || (f64::from(found.slope) - slope).abs() < 1e-3, "{} {slope}", found.slope);
                    prop_assert!((f64::from(found.step) - step).abs() < 1e-5);
                    let tail = |x: f64| 0.5 * f64::from(math::erfc((x / 2f64.sqrt()) as f32));
                    // the tail beyond −limit is less than the one beyond the limit
                    let (least, most) = (tail(rest), 2.0 * tail(rest));
                    let chance = f64::from(found.hidden_step);
                    prop_assert!((least - 1e-3..=most + 1e-3).contains(&chance), "{chance}: {least} {most}");
                }
            }
        }
    }

    #[test]
    fn too_little_is_no_slope() {
        let patch = patch(|x, y| ((y - 1.2).abs() < 0.05 && x < 1.25).then_some(x));
        assert!(patch.row(4, &around(None))[2].unwrap().slope.is_nan());
    }
}
