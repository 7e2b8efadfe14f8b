//! Fractal interpolation surfaces on a rectangular lattice of nodes.
//!
//! n_y × n_x tiles of t_y × t_x samples, node heights z. With b the piecewise bilinear
//! interpolant of the nodes and B a surface through the four corners of the whole domain D,
//! the attractor of the iterated functions is the fixed point of
//!
//! ```text
//! f(x) = b(x) + s(x) (f − B)(L⁻¹ x)
//! ```
//!
//! where L maps D onto each tile, mirrored in every second one, so that L⁻¹ is a triangle
//! wave per axis: r = k mod 2t, folded, times n. It always lands on a sample. f passes
//! through every node.
//!
//! - **Continuity**: with one s, with a continuous field s(x), or with the Coons base B
//!   (which equals f on the border of D) the surface is continuous for any data. With one s
//!   per tile and the bilinear base it jumps on tile edges by |s − s'| |f − chord|:
//!   [`Surface::largest_jump`] tells by how much.
//! - **Evaluation**: where every preimage is a node (t divides n) one pass is exact; if it
//!   takes k steps to reach a node, k passes are; otherwise the error after k passes is
//!   |s|^k × relief, and passes go on until that is below 1e-7 of it.
//! - **Roughness**: with n |s| > 1 the dimension is 3 + ln|s| / ln n, so s = n^−H
//!   ([`scale_for_hurst`]); with n |s| ≤ 1 it is 2: bilinear with a decoration.
//!
//! Cost: about two bilinear interpolations per sample and pass. Accuracy: rounding;
//! `tests/surfaces_rectangular.rs`.
//!
//! Not for: compression. The best s of real terrain gains under 0.01 dB over b, a free s
//! per tile 0.2–0.9 dB, where the same numbers spent on nodes gain 3–5 dB.
//!
//! Source: Drakopoulos & Manousopoulos, "One dimensional and rectangular fractal
//! interpolation surfaces", eqs 3 and 5 (their a, b, g, c are solved by the form above).

use super::{Shape, SurfaceError, check_finite, check_length};
use rugosa_grid::math;

/// The surface B that is taken from f before it is shrunk into a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Base {
    /// bilinear through the four corners of the domain (the published construction)
    #[default]
    Corners,
    /// Coons patch of the domain's border: tile edges stay straight, any s is continuous
    Coons,
}

/// The vertical scale s, |s| < 1.
#[derive(Clone, Copy, Debug)]
pub enum Scale<'a> {
    /// the same everywhere
    Constant(f32),
    /// one value per node, bilinear between them
    Nodes(&'a [f32]),
    /// one value per tile, row by row
    Tiles(&'a [f32]),
}

/// s = n^−H: the scale at which a lattice of n tiles per axis has the Hurst exponent H.
pub fn scale_for_hurst(tiles: f32, hurst: f32) -> f32 {
    math::powf(tiles, -hurst)
}

/// Fractal dimension of the surface for generic data: 3 + ln|s|/ln n, or 2 if n |s| ≤ 1.
pub fn dimension(tiles: f32, scale: f32) -> f32 {
    let product = tiles * math::abs(scale);
    if product <= 1.0 {
        2.0
    } else {
        2.0 + math::ln(product) / math::ln(tiles)
    }
}

/// How many applications of L⁻¹ bring every sample of an axis to a node; `None` if some
/// never arrive. `tiles` and `tile` are n and t.
pub fn passes_to_nodes(tiles: usize, tile: usize) -> Option<u32> {
    let steps = |start: usize| {
        let (mut k, mut count) = (start, 0);
        while !k.is_multiple_of(tile) {
            k = preimage(tiles, tile, k);
            count += 1;
            if count > 64 {
                return None;
            }
        }
        Some(count)
    };
    (0..2 * tile.min(tiles * tile))
        .map(steps)
        .try_fold(0, |most, c| c.map(|c| most.max(c)))
}

/// L⁻¹ on one axis: the sample of D whose image in its tile is sample k.
#[inline]
fn preimage(tiles: usize, tile: usize, k: usize) -> usize {
    let r = k % (2 * tile);
    (if r > tile { 2 * tile - r } else { r }) * tiles
}

/// A fractal interpolation surface.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    nodes: &'a [f32],
    lattice: Shape,
    tile: (usize, usize),
    scale: Scale<'a>,
    base: Base,
}

/// Beyond this many passes the surface is taken as it is (|s| > 0.98).
const MOST_PASSES: u32 = 1000;

impl<'a> Surface<'a> {
    /// A surface through `nodes` (`lattice.rows × lattice.columns`, at least 2 × 2), tiles of
    /// `tile` = (t_y, t_x) samples.
    ///
    /// # Errors
    /// Wrong lengths, non-finite nodes, a scale with |s| ≥ 1.
    pub fn new(
        nodes: &'a [f32],
        lattice: Shape,
        tile: (usize, usize),
        scale: Scale<'a>,
    ) -> Result<Self, SurfaceError> {
        if lattice.rows < 2 || lattice.columns < 2 || tile.0 == 0 || tile.1 == 0 {
            return Err(SurfaceError::Size(lattice));
        }
        check_length(lattice, nodes.len())?;
        check_finite(nodes)?;
        check_scale(scale, lattice)?;
        Ok(Surface {
            nodes,
            lattice,
            tile,
            scale,
            base: Base::Corners,
        })
    }

    /// The same on another base.
    pub fn on(mut self, base: Base) -> Self {
        self.base = base;
        self
    }

    /// The same with another scale.
    ///
    /// # Errors
    /// |s| ≥ 1 or a wrong length.
    pub fn with(mut self, scale: Scale<'a>) -> Result<Self, SurfaceError> {
        check_scale(scale, self.lattice)?;
        self.scale = scale;
        Ok(self)
    }

    /// Samples of the whole surface.
    pub fn shape(&self) -> Shape {
        let (rows, columns) = self.tiles();
        Shape::new(rows * self.tile.0 + 1, columns * self.tile.1 + 1)
    }

    /// Tiles per axis (n_y, n_x).
    pub fn tiles(&self) -> (usize, usize) {
        (self.lattice.rows - 1, self.lattice.columns - 1)
    }

    /// Writes the surface, row by row; returns the passes it took.
    ///
    /// # Errors
    /// A slice shorter than [`Surface::shape`] asks for.
    pub fn evaluate(&self, out: &mut [f32]) -> Result<u32, SurfaceError> {
        let shape = self.shape();
        check_length(shape, out.len())?;
        let (rows, columns) = self.tiles();
        let exact = (
            passes_to_nodes(rows, self.tile.0),
            passes_to_nodes(columns, self.tile.1),
        );
        if let (Some(0..=1), Some(0..=1)) = exact {
            (0..shape.rows).for_each(|y| self.row_from_nodes(y, out));
            return Ok(1);
        }
        let passes = match exact {
            (Some(y), Some(x)) => y.max(x),
            _ => passes_to_rounding(self.largest_scale()),
        };
        self.write_bilinear(out);
        (0..passes).for_each(|_| self.pass(out));
        Ok(passes)
    }

    /// Writes the bilinear interpolant b of the nodes alone (s = 0).
    pub fn write_bilinear(&self, out: &mut [f32]) {
        let shape = self.shape();
        for y in 0..shape.rows {
            let row = &mut out[y * shape.columns..][..shape.columns];
            let (node, v) = self.split(y, 0);
            for tile in 0..self.tiles().1 {
                let (left, right) = self.edges(node, v, tile);
                let slope = (right - left) / self.tile.1 as f32;
                for (k, out) in row[tile * self.tile.1..][..self.tile.1]
                    .iter_mut()
                    .enumerate()
                {
                    *out = left + slope * k as f32;
                }
            }
            row[shape.columns - 1] = self.edges(node, v, self.tiles().1 - 1).1;
        }
    }

    /// The largest jump of height on a tile edge; 0 where the construction is continuous.
    /// `surface` is the evaluated surface.
    pub fn largest_jump(&self, surface: &[f32]) -> f32 {
        let Scale::Tiles(scales) = self.scale else {
            return 0.0;
        };
        if self.base == Base::Coons {
            return 0.0;
        }
        let (rows, columns) = self.tiles();
        let mut largest = 0.0f32;
        for (i, j) in (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
            let here = scales[i * columns + j];
            if j + 1 < columns {
                let step = math::abs(here - scales[i * columns + j + 1]);
                largest = largest.max(step * self.bulge(surface, false, j % 2 == 0));
            }
            if i + 1 < rows {
                let step = math::abs(here - scales[(i + 1) * columns + j]);
                largest = largest.max(step * self.bulge(surface, true, i % 2 == 0));
            }
        }
        largest
    }

    /// Largest |f − B| on one side of D: the last row or column if `far`, else the first.
    fn bulge(&self, surface: &[f32], along_row: bool, far: bool) -> f32 {
        let shape = self.shape();
        let (count, fixed) = match along_row {
            true => (shape.columns, if far { shape.rows - 1 } else { 0 }),
            false => (shape.rows, if far { shape.columns - 1 } else { 0 }),
        };
        (0..count)
            .map(|k| if along_row { (fixed, k) } else { (k, fixed) })
            .map(|(y, x)| math::abs(surface[y * shape.columns + x] - self.base_at(y, x)))
            .fold(0.0, f32::max)
    }

    /// (node row or column, fraction of a tile) of sample k on axis 0 (y) or 1 (x).
    #[inline]
    fn split(&self, k: usize, axis: usize) -> (usize, f32) {
        let (tile, tiles) = match axis {
            0 => (self.tile.0, self.tiles().0),
            _ => (self.tile.1, self.tiles().1),
        };
        let node = (k / tile).min(tiles - 1);
        (node, (k - node * tile) as f32 / tile as f32)
    }

    #[inline]
    fn node(&self, row: usize, column: usize) -> f32 {
        self.nodes[row * self.lattice.columns + column]
    }

    /// Heights of b on the left and the right edge of a tile, at fraction v of its height.
    #[inline]
    fn edges(&self, row: usize, v: f32, tile: usize) -> (f32, f32) {
        if v == 0.0 {
            return (self.node(row, tile), self.node(row, tile + 1));
        }
        (
            blend(self.node(row, tile), self.node(row + 1, tile), v),
            blend(self.node(row, tile + 1), self.node(row + 1, tile + 1), v),
        )
    }

    /// b along a border of D, at sample k: row 0 or last, column 0 or last.
    fn border(&self, axis: usize, far: bool, k: usize) -> f32 {
        let (node, v) = self.split(k, axis);
        let at = |n: usize| match (axis, far) {
            (0, false) => self.node(n, 0),
            (0, true) => self.node(n, self.lattice.columns - 1),
            (_, false) => self.node(0, n),
            (_, true) => self.node(self.lattice.rows - 1, n),
        };
        blend(at(node), at(node + 1), v)
    }

    /// B at a sample of D.
    fn base_at(&self, y: usize, x: usize) -> f32 {
        let shape = self.shape();
        let u = y as f32 / (shape.rows - 1) as f32;
        let v = x as f32 / (shape.columns - 1) as f32;
        let (last_row, last_column) = (self.lattice.rows - 1, self.lattice.columns - 1);
        let top = blend(self.node(0, 0), self.node(0, last_column), v);
        let bottom = blend(self.node(last_row, 0), self.node(last_row, last_column), v);
        let corners = blend(top, bottom, u);
        match self.base {
            Base::Corners => corners,
            Base::Coons => {
                let across = blend(self.border(0, false, y), self.border(0, true, y), v);
                let down = blend(self.border(1, false, x), self.border(1, true, x), u);
                across + down - corners
            }
        }
    }

    /// s at a sample.
    #[inline]
    fn scale_at(&self, (row, u): (usize, f32), (column, v): (usize, f32)) -> f32 {
        match self.scale {
            Scale::Constant(s) => s,
            Scale::Tiles(s) => s[row * self.tiles().1 + column],
            Scale::Nodes(s) => {
                let at = |r: usize, c: usize| s[r * self.lattice.columns + c];
                blend(
                    blend(at(row, column), at(row, column + 1), v),
                    blend(at(row + 1, column), at(row + 1, column + 1), v),
                    u,
                )
            }
        }
    }

    /// One row where every preimage is a node.
    fn row_from_nodes(&self, y: usize, out: &mut [f32]) {
        let width = self.shape().columns;
        let (rows, columns) = self.tiles();
        let detail = self.node_details(preimage(rows, self.tile.0, y) / self.tile.0);
        let (node, u) = self.split(y, 0);
        let row = &mut out[y * width..][..width];
        let stride = columns / self.tile.1.min(columns);
        for tile in 0..columns {
            let (left, right) = self.edges(node, u, tile);
            let slope = (right - left) / self.tile.1 as f32;
            for (k, out) in row[tile * self.tile.1..][..self.tile.1]
                .iter_mut()
                .enumerate()
            {
                let folded = if tile % 2 == 0 { k } else { self.tile.1 - k };
                let s = match self.scale {
                    Scale::Constant(s) => s,
                    _ => self.scale_at((node, u), (tile, k as f32 / self.tile.1 as f32)),
                };
                *out = left + slope * k as f32 + s * detail(folded * stride);
            }
        }
        let last = columns - 1;
        let end = if last % 2 == 0 { columns } else { 0 };
        let s = self.scale_at((node, u), (last, 1.0));
        row[width - 1] = self.edges(node, u, last).1 + s * detail(end);
        self.restore_nodes(y, out);
    }

    /// f − B at the nodes of one row of nodes.
    fn node_details(&self, row: usize) -> impl Fn(usize) -> f32 + '_ {
        let (last_row, last) = (self.lattice.rows - 1, self.lattice.columns - 1);
        let u = row as f32 / last_row as f32;
        let left = blend(self.node(0, 0), self.node(last_row, 0), u);
        let right = blend(self.node(0, last), self.node(last_row, last), u);
        let slope = (right - left) / last as f32;
        let nodes = &self.nodes[row * self.lattice.columns..][..self.lattice.columns];
        let coons = self.base == Base::Coons;
        move |column| {
            let corners = left + slope * column as f32;
            if !coons {
                return nodes[column] - corners;
            }
            let v = column as f32 / last as f32;
            let down = blend(self.node(0, column), self.node(last_row, column), u);
            nodes[column] - (blend(nodes[0], nodes[last], v) + down - corners)
        }
    }

    /// One pass in place: f ← b + s (f − B)(L⁻¹). Samples already renewed are only nearer to
    /// the fixed point, so the bound of a pass on a copy holds.
    fn pass(&self, out: &mut [f32]) {
        let shape = self.shape();
        let (rows, columns) = self.tiles();
        for y in 0..shape.rows {
            let source_y = preimage(rows, self.tile.0, y);
            let (node, u) = self.split(y, 0);
            for x in 0..shape.columns {
                let source_x = preimage(columns, self.tile.1, x);
                let (tile, v) = self.split(x, 1);
                let (left, right) = self.edges(node, u, tile);
                let detail =
                    out[source_y * shape.columns + source_x] - self.base_at(source_y, source_x);
                let s = self.scale_at((node, u), (tile, v));
                out[y * shape.columns + x] = blend(left, right, v) + s * detail;
            }
            self.restore_nodes(y, out);
        }
    }

    /// Nodes are met exactly, not to rounding.
    fn restore_nodes(&self, y: usize, out: &mut [f32]) {
        if y.is_multiple_of(self.tile.0) {
            let row = &mut out[y * self.shape().columns..];
            for j in 0..self.lattice.columns {
                row[j * self.tile.1] = self.node(y / self.tile.0, j);
            }
        }
    }

    fn largest_scale(&self) -> f32 {
        let largest = |s: &[f32]| s.iter().fold(0.0f32, |most, s| most.max(math::abs(*s)));
        match self.scale {
            Scale::Constant(s) => math::abs(s),
            Scale::Nodes(s) | Scale::Tiles(s) => largest(s),
        }
    }
}

/// Least-squares scales against measured data.
impl Surface<'_> {
    /// The one s that fits `data` best: Σ r g / Σ g², r = data − b, g = (f − B)(L⁻¹). Exact
    /// where one pass is; otherwise f itself depends on s and the formula is repeated on the
    /// surface it gives. `scratch` is as large as `data`.
    ///
    /// # Errors
    /// Slices shorter than [`Surface::shape`], non-finite data.
    pub fn best_scale(&self, data: &[f32], scratch: &mut [f32]) -> Result<f32, SurfaceError> {
        check_length(self.shape(), data.len())?;
        check_finite(&data[..self.shape().len()])?;
        let mut scale = 0.0f32;
        for _ in 0..12 {
            let surface = self.with(Scale::Constant(scale))?;
            surface.evaluate(scratch)?;
            let (rg, gg) = surface.regress(data, scratch, |_, _| true);
            let next = bounded(rg, gg);
            let settled = math::abs(next - scale) < 1e-6;
            scale = next;
            if settled {
                break;
            }
        }
        Ok(scale)
    }

    /// The best s of every tile, against the surface with s = 0; `scales` holds one value per
    /// tile. Meant for the Coons base.
    ///
    /// # Errors
    /// As [`Surface::best_scale`].
    pub fn best_tile_scales(
        &self,
        data: &[f32],
        scratch: &mut [f32],
        scales: &mut [f32],
    ) -> Result<(), SurfaceError> {
        let (rows, columns) = self.tiles();
        check_length(self.shape(), data.len())?;
        check_length(Shape::new(rows, columns), scales.len())?;
        check_finite(&data[..self.shape().len()])?;
        let flat = self.with(Scale::Constant(0.0))?;
        flat.evaluate(scratch)?;
        for (index, scale) in scales[..rows * columns].iter_mut().enumerate() {
            let tile = (index / columns, index % columns);
            let (rg, gg) = flat.regress(data, scratch, |i, j| (i, j) == tile);
            *scale = bounded(rg, gg);
        }
        Ok(())
    }

    /// (Σ r g, Σ g²) over the tiles that `wanted` names.
    fn regress(
        &self,
        data: &[f32],
        surface: &[f32],
        wanted: impl Fn(usize, usize) -> bool,
    ) -> (f64, f64) {
        let width = self.shape().columns;
        let (rows, columns) = self.tiles();
        let (mut rg, mut gg) = (0.0f64, 0.0f64);
        for (i, j) in (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
            if !wanted(i, j) {
                continue;
            }
            let height = self.tile.0 + usize::from(i + 1 == rows);
            let breadth = self.tile.1 + usize::from(j + 1 == columns);
            for k in 0..height * breadth {
                let (y, x) = (i * self.tile.0 + k / breadth, j * self.tile.1 + k % breadth);
                let source = (
                    preimage(rows, self.tile.0, y),
                    preimage(columns, self.tile.1, x),
                );
                let (node, u) = self.split(y, 0);
                let (tile, v) = self.split(x, 1);
                let (left, right) = self.edges(node, u, tile);
                let r = f64::from(data[y * width + x] - blend(left, right, v));
                let g = surface[source.0 * width + source.1] - self.base_at(source.0, source.1);
                rg += r * f64::from(g);
                gg += f64::from(g) * f64::from(g);
            }
        }
        (rg, gg)
    }
}

/// The quotient, clipped to ±0.95; 0 where the data carry no information.
fn bounded(rg: f64, gg: f64) -> f32 {
    if gg > 0.0 {
        (rg / gg).clamp(-0.95, 0.95) as f32
    } else {
        0.0
    }
}

#[inline]
fn blend(a: f32, b: f32, t: f32) -> f32 {
    if t == 1.0 { b } else { a + (b - a) * t }
}

/// Passes until |s|^k < 1e-7.
fn passes_to_rounding(scale: f32) -> u32 {
    if scale == 0.0 {
        return 1;
    }
    let passes = math::ln(1e-7) / math::ln(scale);
    (passes as u32).saturating_add(1).min(MOST_PASSES)
}

fn check_scale(scale: Scale, lattice: Shape) -> Result<(), SurfaceError> {
    let check = |values: &[f32], needed: Shape| -> Result<(), SurfaceError> {
        check_length(needed, values.len())?;
        match values.iter().find(|s| !within(**s)) {
            Some(&s) => Err(SurfaceError::Scale(s)),
            None => Ok(()),
        }
    };
    match scale {
        Scale::Constant(s) => check(&[s], Shape::new(1, 1)),
        Scale::Nodes(s) => check(s, lattice),
        Scale::Tiles(s) => check(s, Shape::new(lattice.rows - 1, lattice.columns - 1)),
    }
}

fn within(scale: f32) -> bool {
    math::abs(scale) < 1.0
}
