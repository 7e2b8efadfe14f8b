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
//! doubles it at most. The last line is the roughness map at work: E|Δz| = σ d^H √(2/π), so
//! rough ground is more likely to hide a step in what was not seen. The maximum over j is a
//! lower bound of the chance that any step exceeds the limit; neighbouring cells are far from
//! independent, so the product of their chances would be no better.
//!
//! The cells of a tile and its margin are unpacked once. The disc of four neighbouring cells
//! is summed row by row, whether the cells in it were measured or not. A row of the map belongs
//! to the discs of many rows of the tile, wider in some than in others: its sums are made once,
//! from the middle outwards, those of each width on the way, and given to all of them, where
//! they are multiplied with y. That gives slope and step. The step and the greatest variance of
//! all tell whether a neighbour might be likelier to hide a step than the unseen ground is, and
//! only then the neighbours are asked one by one. Of the unseen ones the farthest counts: the
//! bits of a row tell of eight cells at once. What a disc looks like is the same for all tiles,
//! the powers d^{2H} for all cells of a tile. A slope needs at least [`LEAST`] measured cells
//! that do not lie on a line; otherwise it is NaN.
//!
//! Cost, for four cells: 24 operations for each pair of columns of a row, 17 for each row of a
//! disc that has a measured cell; some 300 for each measured cell, whatever the size of the
//! map. `cargo bench -p rugosa` prints the time.
//!
//! Rejected: each disc on its own (twice the instructions); one cell's neighbours four at a
//! time (three times the instructions on a sweep of rings), one measured neighbour after another
//! (twice the time: each end of a run of bits is a branch that the processor cannot foresee).

use super::Limits;
use rugosa_fractal::roughness::Roughness;
use rugosa_grid::tile::places_of;
use rugosa_grid::{TILE, Tile, TileBits, math};
use rugosa_terrain::ElevationGrid;
use wide::f32x4;

/// Fewest measured cells of a slope, its own among them.
pub const LEAST: f32 = 4.0;
/// Greatest radius of the disc in cells.
pub const REACH: i32 = 8;

/// Keeps variances positive \[m²\].
const TINY: f32 = 1e-12;

/// Cells along an edge of a tile.
const EDGE: usize = TILE as usize;
/// Side of a tile with its margin.
const SIDE: usize = (TILE + 2 * REACH) as usize;

/// What the ground around a cell is like. Roots, arcs and chances are worked out when asked
/// for: most ground is known to cost nothing without them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Features {
    /// squared gradient \[(m/m)²\]; NaN where too little was measured
    pub(super) gradient_square: f32,
    /// greatest difference of elevation to the cell \[m\]
    pub step: f32,
    /// variance of the cell's elevation \[m²\]
    pub(super) variance: f32,
    /// the neighbour most likely to hide a step
    pub(super) worst: Worst,
    /// the step that must not be exceeded \[m\]
    pub(super) limit: f32,
}

impl Features {
    /// Slope \[rad\]; NaN where too little was measured.
    pub fn slope(&self) -> f32 {
        math::atan(math::sqrt(self.gradient_square))
    }

    /// Chance that a step exceeds the limit.
    pub fn hidden_step(&self) -> f32 {
        exceeds(self.worst.margin, self.worst.spread, self.limit)
    }

    /// Is that chance at most e^(−doubt / 2)? By Chernoff's bound, erfc(x) ≤ e^(−x²).
    #[inline(always)]
    pub(super) fn hides_less(&self, doubt: f32) -> bool {
        self.worst.margin >= doubt * self.worst.spread
    }

    /// Standard deviation of the cell's elevation \[m\].
    pub fn uncertainty(&self) -> f32 {
        math::sqrt(self.variance)
    }
}

/// Elevations and variances of a tile and its margin, row by row.
pub(crate) struct Patch {
    strips: [Strip; SIDE],
    /// elevation that those of the strips are relative to \[m\]
    datum: f32,
    /// greatest variance \[m²\]
    variance: f32,
}

/// A row of them.
#[derive(Clone, Copy)]
struct Strip {
    /// above the datum; 0 where not measured \[m\]
    elevation: [f32; SIDE],
    /// above 0 where measured, else anything \[m²\]
    variance: [f32; SIDE],
    /// 1 where measured, else 0
    count: [f32; SIDE],
    /// bit x: measured?
    measured: u32,
}

/// Farther than any elevation.
const FAR: f32 = 1e30;

/// Squared distances in cells that occur in a disc.
const SQUARES: usize = (REACH * REACH + 2) as usize;

/// What the features of a tile depend on besides its elevations: the disc around a cell.
pub(crate) struct Around {
    /// cell edge \[m\]
    resolution: f32,
    /// radius of the disc in cells
    radius: i32,
    /// the step that must not be exceeded \[m\]
    limit: f32,
    /// the disc without its middle, by the distance of its rows; bit x: is the cell x − radius
    /// in it?
    rows: [u32; REACH as usize + 1],
    /// half the width of its rows
    widths: [usize; REACH as usize + 1],
    /// by half a width; bit i: is the row radius − i of the disc at least as wide?
    as_wide: [u32; REACH as usize + 1],
    /// where its cells begin in [`FARTHEST_FIRST`]
    first: usize,
    /// 2 ln d \[m\] by squared distance in cells
    logarithms: [f32; SQUARES],
    /// σ² d^{2H} by squared distance in cells; 0 where the roughness is not known
    hidden: [f32; SQUARES],
}

impl Around {
    /// For cells of `resolution` \[m\], in the limits' window, on ground of unknown roughness.
    pub(crate) fn new(resolution: f32, limits: &Limits) -> Self {
        let radius = disc(limits.window / resolution);
        let mut around = Around {
            resolution,
            radius,
            limit: limits.step.critical,
            rows: [0; REACH as usize + 1],
            widths: [0; REACH as usize + 1],
            as_wide: [0; REACH as usize + 1],
            first: FARTHEST_FIRST
                .iter()
                .take_while(|&&(x, y)| !is_within(radius, x.into(), y.into()))
                .count(),
            logarithms: core::array::from_fn(|square| {
                math::ln(square as f32 * resolution * resolution)
            }),
            hidden: [0.0; SQUARES],
        };
        for y in 0..=radius {
            let row = y as usize;
            for x in (-radius..=radius).filter(|&x| is_within(radius, x, y)) {
                around.rows[row] |= 1 << (x + radius);
                around.widths[row] = x.unsigned_abs() as usize;
            }
            for width in 0..=around.widths[row] {
                around.as_wide[width] |= 1 << (radius - y) | 1 << (radius + y);
            }
        }
        around
    }

    /// The same ground, this rough.
    pub(crate) fn set_roughness(&mut self, roughness: Option<&Roughness>) {
        let (sigma, hurst) = roughness.map_or((0.0, 0.0), |r| (r.sigma, r.hurst));
        let of_disc = 1..(self.radius * self.radius + 2) as usize;
        let logarithms = &self.logarithms[of_disc.clone()];
        for (hidden, logarithm) in self.hidden[of_disc].iter_mut().zip(logarithms) {
            *hidden = sigma * sigma * math::exp(hurst * logarithm);
        }
    }
}

/// Is the cell at this offset in the disc, and not its middle?
fn is_within(radius: i32, x: i32, y: i32) -> bool {
    (1..=radius * radius + 1).contains(&(x * x + y * y))
}

impl Strip {
    const EMPTY: Strip = Strip {
        elevation: [0.0; SIDE],
        variance: [0.0; SIDE],
        count: [0.0; SIDE],
        measured: 0,
    };

    /// From four cells at a column to the nearest one that is measured \[columns\].
    #[inline(always)]
    fn nearest(&self, column: usize) -> usize {
        if self.measured >> column & ALL_LANES != 0 {
            return 0;
        }
        let east = (self.measured >> (column + LANES)).trailing_zeros();
        let west = (self.measured << (u32::BITS as usize - column)).leading_zeros();
        1 + east.min(west) as usize
    }

    /// The sums for the four cells at a column, by the width of the row of a disc.
    #[inline(always)]
    fn sum(&self, column: usize, sums: &mut [Row]) {
        let seen = |column: usize| Seen {
            count: lanes(&self.count[column..]),
            z: lanes(&self.elevation[column..]),
        };
        let mut row = Row::of(seen(column));
        for (width, sum) in sums.iter_mut().enumerate() {
            if width > 0 {
                let x = Lanes::splat(width as f32);
                row.widen(x, seen(column - width), seen(column + width));
            }
            *sum = row;
        }
    }
}

impl Patch {
    /// Nothing measured.
    pub(crate) const fn new() -> Self {
        Patch {
            strips: [Strip::EMPTY; SIDE],
            datum: 0.0,
            variance: 0.0,
        }
    }

    /// Unpacks what a tile's features depend on; `measured` tells which cells are, of the tiles
    /// of [`Tile::around`].
    pub(crate) fn fill(
        &mut self,
        grid: &ElevationGrid,
        tile: Tile,
        around: &Around,
        measured: &[TileBits; 9],
    ) {
        let corner = tile.origin().offset(-REACH, -REACH);
        let window = grid.window();
        let columns: [usize; SIDE] = core::array::from_fn(|x| {
            let column = window.column_part(corner.x.wrapping_add(x as i32));
            column.unwrap_or_default()
        });
        let radius = around.radius as usize;
        let reached = ((1 << (EDGE + 2 * radius)) - 1) << (REACH as usize - radius);
        let mut is_first = true;
        self.variance = 0.0;
        for y in REACH as usize - radius..EDGE + REACH as usize + radius {
            let row = |i: usize| (measured[y / 8 * 3 + i] >> (8 * (y % 8))) as u32 & 0xff;
            let of_row = (row(0) | row(1) << 8 | row(2) << 16) & reached;
            self.strips[y].measured = of_row;
            if of_row == 0 {
                continue;
            }
            self.strips[y].elevation = Strip::EMPTY.elevation;
            self.strips[y].count = Strip::EMPTY.count;
            let start = window
                .row_part(corner.y.wrapping_add(y as i32))
                .unwrap_or_default();
            for x in places_of(u64::from(of_row)) {
                let ground = grid.elevation(start + columns[x]);
                if core::mem::take(&mut is_first) {
                    self.datum = ground[0];
                }
                self.set([x, y], ground);
            }
        }
    }

    #[inline(always)]
    fn set(&mut self, [x, y]: [usize; 2], [elevation, variance]: [f32; 2]) {
        let strip = &mut self.strips[y];
        strip.elevation[x] = elevation - self.datum;
        strip.variance[x] = variance + TINY;
        if variance + TINY > self.variance {
            self.variance = variance + TINY;
        }
        strip.count[x] = 1.0;
    }

    /// Calls `each` with the place in the tile (8 row + column) and the features of each
    /// measured cell.
    pub(crate) fn each_cell(&self, around: &Around, each: &mut dyn FnMut(usize, Features)) {
        let unseen = core::array::from_fn(|row| self.farthest_unseen(row, around));
        for first in (0..EDGE).step_by(LANES) {
            self.each_of_four(first, around, &unseen, each);
        }
    }

    /// The same for four columns; `unseen` holds the squared distances of the farthest cells
    /// that are not measured.
    fn each_of_four(
        &self,
        first: usize,
        around: &Around,
        unseen: &[[u8; EDGE]; EDGE],
        each: &mut dyn FnMut(usize, Features),
    ) {
        let column = first + REACH as usize;
        let measured: [u32; EDGE] =
            core::array::from_fn(|row| self.strip_of(row).measured >> column & ALL_LANES);
        if measured == [0; EDGE] {
            return;
        }
        let mut discs = [Discs::EMPTY; EDGE];
        self.add_discs(column, around, &measured, &mut discs);
        for (row, disc) in discs
            .iter()
            .enumerate()
            .filter(|(row, _)| measured[*row] != 0)
        {
            let own = self.strip_of(row);
            let squares = disc.gradient_squares(around.resolution).to_array();
            let steps = disc.steps(lanes(&own.elevation[column..])).to_array();
            for lane in places_of(u64::from(measured[row])) {
                let place = [row + REACH as usize, column + lane];
                let hidden = around.hidden[usize::from(unseen[row][first + lane])];
                let features = Features {
                    gradient_square: squares[lane],
                    step: steps[lane],
                    variance: own.variance[place[1]],
                    worst: self.worst(place, around, steps[lane], hidden),
                    limit: around.limit,
                };
                each(EDGE * row + first + lane, features);
            }
        }
    }

    /// The strip of a row of the tile.
    #[inline(always)]
    fn strip_of(&self, row: usize) -> &Strip {
        &self.strips[row + REACH as usize]
    }

    /// Adds what the discs around four cells of each row add up to, where there are `measured`
    /// ones: every strip is summed once and given to all rows that it is near to.
    #[inline(always)]
    fn add_discs(
        &self,
        column: usize,
        around: &Around,
        measured: &[u32; EDGE],
        discs: &mut [Discs; EDGE],
    ) {
        const FIRST: usize = 2 * REACH as usize;
        let rows = (0..EDGE).fold(0, |rows, row| {
            rows | u32::from(measured[row] != 0) << (FIRST + row)
        });
        let mut sums = [Row::EMPTY; REACH as usize + 1];
        let radius = around.radius as usize;
        let reached = REACH as usize - radius..FIRST + radius;
        for (y, strip) in reached.clone().zip(&self.strips[reached]) {
            let nearest = strip.nearest(column);
            if nearest > radius {
                continue;
            }
            let southmost = y + REACH as usize - radius;
            let asked = rows >> southmost & around.as_wide[nearest];
            if asked == 0 {
                continue;
            }
            strip.sum(column, &mut sums[..=radius]);
            for i in places_of(u64::from(asked)) {
                let dy = radius as i32 - i as i32;
                let width = around.widths[dy.unsigned_abs() as usize];
                discs[southmost + i - FIRST].add(&sums[width], Lanes::splat(dy as f32));
            }
        }
    }

    /// Squared distances of the farthest cells of the discs around the measured cells of a row
    /// that are not measured; 0 where all are.
    fn farthest_unseen(&self, row: usize, around: &Around) -> [u8; EDGE] {
        let mut farthest = 0;
        let mut asked = self.strip_of(row).measured >> REACH & ((1 << EDGE) - 1);
        for &(x, y) in &FARTHEST_FIRST[around.first..] {
            if asked == 0 {
                break;
            }
            let strip = &self.strips[(row as i32 + REACH + i32::from(y)) as usize];
            let unseen = asked & !(strip.measured >> (REACH + i32::from(x)));
            if unseen != 0 {
                asked &= !unseen;
                farthest |= bytes_of(unseen) * u64::from(square(x, y));
            }
        }
        farthest.to_le_bytes()
    }

    /// The neighbour most likely to hide a step at a cell whose highest step is this one, where
    /// what was not seen varies by `unseen`.
    #[inline(always)]
    fn worst(&self, place: [usize; 2], around: &Around, step: f32, unseen: f32) -> Worst {
        let (own, limit) = (self.strips[place[0]].variance[place[1]], around.limit);
        let mut worst = Worst {
            margin: limit * limit,
            spread: own + unseen,
        };
        // no neighbour's quotient is less than this one
        let (rest, spread) = (limit - step, own + self.variance);
        let least = rest * math::abs(rest);
        if worst.is_less(least, spread) && !is_beyond_doubt(least, spread) {
            self.ask_neighbours(place, around, &mut worst);
        }
        worst
    }

    fn ask_neighbours(&self, [row, column]: [usize; 2], around: &Around, worst: &mut Worst) {
        let own = &self.strips[row];
        let (elevation, variance) = (own.elevation[column], own.variance[column]);
        let (radius, left) = (around.radius, column - around.radius as usize);
        let rows = &self.strips[row - radius as usize..][..2 * radius as usize + 1];
        for (strip, y) in rows.iter().zip(-radius..) {
            let disc = around.rows[y.unsigned_abs() as usize];
            for x in places_of(u64::from(strip.measured >> left & disc)).map(|i| left + i) {
                let rest = around.limit - math::abs(strip.elevation[x] - elevation);
                worst.meet(rest * math::abs(rest), variance + strip.variance[x]);
            }
        }
    }
}

/// A byte for each of eight bits.
fn bytes_of(bits: u32) -> u64 {
    const ONES: u64 = u64::MAX / 0xff;
    // byte i is 0 or 1 << i, and carries into its highest bit where it is not 0
    let apart = (u64::from(bits) * ONES) & 0x8040_2010_0804_0201;
    ((apart + 0x7f * ONES) >> 7) & ONES
}

/// The cells of the greatest disc, without its middle, the farthest first.
static FARTHEST_FIRST: [(i8, i8); DISC] = farthest_first();
const DISC: usize = cells_within(SQUARES as i32 - 1);

const fn square(x: i8, y: i8) -> u8 {
    (x as i32 * x as i32 + y as i32 * y as i32) as u8
}

/// How many cells lie at most √`most` from another one.
const fn cells_within(most: i32) -> usize {
    let (mut count, mut i) = (0, 0);
    while i < (2 * REACH + 1) * (2 * REACH + 1) {
        let (x, y) = (i % (2 * REACH + 1) - REACH, i / (2 * REACH + 1) - REACH);
        let square = x * x + y * y;
        count += (1 <= square && square <= most) as usize;
        i += 1;
    }
    count
}

const fn farthest_first() -> [(i8, i8); DISC] {
    let mut cells = [(0, 0); DISC];
    let (mut at, mut wanted) = (0, SQUARES as u8 - 1);
    while wanted > 0 {
        let mut i = 0;
        while i < (2 * REACH + 1) * (2 * REACH + 1) {
            let x = (i % (2 * REACH + 1) - REACH) as i8;
            let y = (i / (2 * REACH + 1) - REACH) as i8;
            if square(x, y) == wanted {
                cells[at] = (x, y);
                at += 1;
            }
            i += 1;
        }
        wanted -= 1;
    }
    cells
}

/// Radius in whole cells, 1 … [`REACH`].
fn disc(cells: f32) -> i32 {
    math::round_index(cells).clamp(1, REACH)
}

/// One number for each of four neighbouring cells.
type Lanes = f32x4;
const LANES: usize = 4;
/// One bit for each.
const ALL_LANES: u32 = (1 << LANES) - 1;

/// Four numbers.
#[inline(always)]
fn lanes(four: &[f32]) -> Lanes {
    Lanes::from(four.first_chunk::<LANES>().copied().unwrap_or_default())
}

/// What the measured cells of a strip, as far as a row of the disc reaches, add up to, for
/// four cells.
#[derive(Clone, Copy)]
struct Row {
    count: Lanes,
    x: Lanes,
    xx: Lanes,
    z: Lanes,
    xz: Lanes,
    /// elevation
    highest: Lanes,
    lowest: Lanes,
}

impl Row {
    const EMPTY: Row = Row {
        count: Lanes::ZERO,
        x: Lanes::ZERO,
        xx: Lanes::ZERO,
        z: Lanes::ZERO,
        xz: Lanes::ZERO,
        highest: Lanes::splat(-FAR),
        lowest: Lanes::splat(FAR),
    };

    /// The middle alone.
    #[inline(always)]
    fn of(middle: Seen) -> Self {
        Row {
            count: middle.count,
            z: middle.z,
            highest: middle.z - middle.gap(),
            lowest: middle.z + middle.gap(),
            ..Row::EMPTY
        }
    }

    /// Adds the cells x columns to the west and to the east.
    #[inline(always)]
    fn widen(&mut self, x: Lanes, west: Seen, east: Seen) {
        let (count, z) = (west.count + east.count, west.z + east.z);
        self.count += count;
        self.x += x * (east.count - west.count);
        self.xx += x * x * count;
        self.z += z;
        self.xz += x * (east.z - west.z);
        self.meet(west);
        self.meet(east);
    }

    #[inline(always)]
    fn meet(&mut self, seen: Seen) {
        let gap = seen.gap();
        self.highest = self.highest.fast_max(seen.z - gap);
        self.lowest = self.lowest.fast_min(seen.z + gap);
    }
}

/// Four cells of a strip.
#[derive(Clone, Copy)]
struct Seen {
    count: Lanes,
    z: Lanes,
}

impl Seen {
    /// What was not measured is neither highest nor lowest.
    #[inline(always)]
    fn gap(&self) -> Lanes {
        Lanes::splat(FAR) - Lanes::splat(FAR) * self.count
    }
}

/// What the measured cells of the disc, its middle among them, add up to, for four cells.
#[derive(Clone, Copy)]
struct Discs {
    row: Row,
    y: Lanes,
    xy: Lanes,
    yy: Lanes,
    yz: Lanes,
}

impl Discs {
    const EMPTY: Discs = Discs {
        row: Row::EMPTY,
        y: Lanes::ZERO,
        xy: Lanes::ZERO,
        yy: Lanes::ZERO,
        yz: Lanes::ZERO,
    };

    /// Adds a row of the discs, y north of their middles.
    #[inline(always)]
    fn add(&mut self, row: &Row, y: Lanes) {
        let up = y * row.count;
        self.row.count += row.count;
        self.row.x += row.x;
        self.row.xx += row.xx;
        self.row.z += row.z;
        self.row.xz += row.xz;
        self.row.highest = self.row.highest.fast_max(row.highest);
        self.row.lowest = self.row.lowest.fast_min(row.lowest);
        self.y += up;
        self.yy += y * up;
        self.xy += y * row.x;
        self.yz += y * row.z;
    }

    /// Squared gradients of the planes \[(m/m)²\]; NaN where too little was measured.
    #[inline(always)]
    fn gradient_squares(&self, resolution: f32) -> Lanes {
        let Row {
            count,
            x,
            xx,
            z,
            xz,
            ..
        } = &self.row;
        let share = Lanes::ONE / *count;
        let (mean_x, mean_y) = (*x * share, self.y * share);
        let xx = *xx - *x * mean_x;
        let xy = self.xy - *x * mean_y;
        let yy = self.yy - self.y * mean_y;
        let (xz, yz) = (*xz - mean_x * *z, self.yz - mean_y * *z);
        let det = xx * yy - xy * xy;
        let (east, north) = (xz * yy - yz * xy, yz * xx - xz * xy);
        let scale = det * Lanes::splat(resolution);
        let is_plane = count.simd_ge(Lanes::splat(LEAST)) & det.simd_ge(Lanes::splat(0.1));
        let square = (east * east + north * north) / (scale * scale);
        is_plane.select(square, Lanes::splat(f32::NAN))
    }

    /// Greatest differences of elevation to the cells.
    #[inline(always)]
    fn steps(&self, own: Lanes) -> Lanes {
        (self.row.highest - own).fast_max(own - self.row.lowest)
    }
}

/// The neighbour most likely to exceed the limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Worst {
    /// (limit − |Δ|) |limit − |Δ|| and s²: their quotient is the least
    margin: f32,
    spread: f32,
}

impl Worst {
    /// Is this quotient less?
    #[inline(always)]
    fn is_less(&self, margin: f32, spread: f32) -> bool {
        // a / b < c / d without a division, b and d being positive
        margin * self.spread < self.margin * spread
    }

    #[inline(always)]
    fn meet(&mut self, margin: f32, spread: f32) {
        if self.is_less(margin, spread) {
            (self.margin, self.spread) = (margin, spread);
        }
    }
}

/// Is a chance less than 10⁻⁸, x = √(margin / 2 s²) being more than 4?
#[inline(always)]
fn is_beyond_doubt(margin: f32, spread: f32) -> bool {
    margin > 32.0 * spread
}

/// P(|Δ| > limit) for Δ ~ N(mean, variance), where `margin` is (limit − mean) |limit − mean|;
/// 0 below 10⁻⁸.
fn exceeds(margin: f32, variance: f32, limit: f32) -> f32 {
    if is_beyond_doubt(margin, variance) {
        return 0.0;
    }
    let rest = math::sqrt(math::abs(margin));
    let mean = if margin < 0.0 {
        limit + rest
    } else {
        limit - rest
    };
    let scale = 1.0 / math::sqrt(2.0 * variance);
    let near = math::erfc((limit - mean) * scale);
    // what was not seen differs by 0 in the mean: both tails are one
    let far = if mean == 0.0 {
        near
    } else {
        math::erfc((limit + mean) * scale)
    };
    0.5 * (near + far)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    impl Features {
        pub(crate) const FLAT: Features = Features {
            gradient_square: 0.0,
            step: 0.0,
            variance: 0.0,
            worst: Worst {
                margin: 1.0,
                spread: TINY,
            },
            limit: 1.0,
        };

        /// The same with another worst neighbour.
        pub(crate) fn hiding(self, margin: f32, spread: f32) -> Self {
            let worst = Worst { margin, spread };
            Features { worst, ..self }
        }
    }

    impl Patch {
        fn put(&mut self, [x, y]: [usize; 2], ground: [f32; 2]) {
            self.set([x, y], ground);
            self.strips[y].measured |= 1 << x;
        }
    }

    fn patch(height: impl Fn(f32, f32) -> Option<f32>) -> Patch {
        let mut patch = Patch::new();
        for y in 0..SIDE {
            for x in 0..SIDE {
                if let Some(z) = height(x as f32 * 0.1, y as f32 * 0.1) {
                    patch.put([x, y], [z, 1e-6]);
                }
            }
        }
        patch
    }

    /// Features of a row of the tile; `None` where not measured.
    fn row(patch: &Patch, row: usize, around: &Around) -> [Option<Features>; 8] {
        let mut features = [None; 64];
        patch.each_cell(around, &mut |place, f| features[place] = Some(f));
        *features[8 * row..].first_chunk().unwrap()
    }

    fn on(roughness: Option<&Roughness>, mut around: Around) -> Around {
        around.set_roughness(roughness);
        around
    }

    fn around(roughness: Option<&Roughness>) -> Around {
        let mut limits = Limits::default();
        limits.step.critical = 0.2;
        on(roughness, Around::new(0.1, &limits))
    }

    #[test]
    fn a_plane_has_its_slope_and_the_step_of_its_window() {
        let patch = patch(|x, y| Some(5.0 + 0.3 * x - 0.4 * y));
        for features in row(&patch, 3, &around(None)).map(Option::unwrap) {
            assert!((features.slope() - 0.5f32.atan()).abs() < 1e-4);
            assert!((features.step - 0.15).abs() < 0.01, "{}", features.step);
            assert!(features.hidden_step() < 1e-6);
        }
    }

    #[test]
    fn a_step_is_seen_from_its_neighbourhood_only() {
        let patch = patch(|x, _| Some(if x > 1.15 { 0.5 } else { 0.0 }));
        let cells = row(&patch, 0, &around(None)).map(Option::unwrap);
        // the tile begins at column 8; the wall stands between columns 11 and 12
        assert_eq!(cells[0].step, 0.0);
        assert!((cells[1].step - 0.5).abs() < 1e-6 && (cells[6].step - 0.5).abs() < 1e-6);
        assert_eq!(cells[7].step, 0.0);
        assert!(cells[3].hidden_step() > 0.999 && cells[0].hidden_step() < 1e-6);
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
            row(&patch, 4, &around(Some(&rough(sigma))))[2]
                .unwrap()
                .hidden_step()
        };
        assert!(chance(0.05) < 1e-4);
        // σ(0.3 m) = 0.5 √0.3 = 0.274: P(|Δ| > 0.2) = erfc(0.2 / (0.274 √2)) = 0.465
        assert!((chance(0.5) - 0.465).abs() < 0.03, "{}", chance(0.5));
        assert!(
            row(&patch, 0, &around(Some(&rough(0.5))))[0]
                .unwrap()
                .hidden_step()
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
            seed: u32, seen in 1u32..=8, window in 0.05f32..0.9, sigma in 0.0f32..0.6, noisy: bool,
            is_below: bool
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
                let elevation = 3.0 + 0.03 * x as f32 + 0.2 * unit(noise(x, y, 3));
                [if is_below { -elevation } else { elevation }, variance]
            });
            let limits = Limits { window, ..Limits::default() };
            let rough = Roughness { hurst: 0.6, sigma, ..Roughness::default() };
            let around = on(Some(&rough), Around::new(0.1, &limits));
            let mut patch = Patch::new();
            let (low, high) = (REACH - around.radius, TILE + REACH + around.radius);
            for (y, x) in (low..high).flat_map(|y| (low..high).map(move |x| (y, x))) {
                if let Some(ground) = at(x, y) {
                    patch.put([x as usize, y as usize], ground);
                }
            }
            for y in 0..TILE {
                for (column, found) in row(&patch, y as usize, &around).into_iter().enumerate() {
                    let place = [column as i32 + REACH, y + REACH];
                    prop_assert_eq!(found.is_some(), at(place[0], place[1]).is_some());
                    let Some(found) = found else { continue };
                    let exact = |x, y| at(x, y).map(|ground| ground.map(f64::from));
                    let [slope, step, rest] = defined(exact, place, &around);
                    prop_assert_eq!(found.slope().is_nan(), slope.is_nan());
                    prop_assert!(slope.is_nan() || (f64::from(found.slope()) - slope).abs() < 1e-3, "{} {slope}", found.slope());
                    prop_assert!((f64::from(found.step) - step).abs() < 1e-5);
                    let tail = |x: f64| 0.5 * f64::from(math::erfc((x / 2f64.sqrt()) as f32));
                    // the tail beyond −limit is less than the one beyond the limit
                    let (least, most) = (tail(rest), 2.0 * tail(rest));
                    let chance = f64::from(found.hidden_step());
                    prop_assert!((least - 1e-3..=most + 1e-3).contains(&chance), "{chance}: {least} {most}");
                }
            }
        }
    }

    #[test]
    fn too_little_is_no_slope() {
        let patch = patch(|x, y| ((y - 1.2).abs() < 0.05 && x < 1.25).then_some(x));
        assert!(row(&patch, 4, &around(None))[2].unwrap().slope().is_nan());
    }
}
