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
//! Cost: in one pass under three bilinear interpolations (`evaluate.rs`). Accuracy: rounding;
//! `tests/surfaces_rectangular.rs`.
//!
//! Not for: compression. The best s of real terrain gains under 0.01 dB over b, a free s
//! per tile 0.2–0.9 dB, where the same numbers spent on nodes gain 3–5 dB.
//!
//! Source: Drakopoulos & Manousopoulos, "One dimensional and rectangular fractal
//! interpolation surfaces", eqs 3 and 5 (their a, b, g, c are solved by the form above).

mod evaluate;
mod least_squares;

pub use least_squares::Equation;

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
///
/// ```
/// use rugosa_fractal::surfaces::rectangular::{dimension, scale_for_hurst};
/// let scale = scale_for_hurst(4.0, 0.5); // 4 tiles per axis
/// assert_eq!(scale, 0.5);
/// assert!((dimension(4.0, scale) - 2.5).abs() < 1e-6);
/// ```
pub fn scale_for_hurst(tiles: f32, hurst: f32) -> f32 {
    math::powf(tiles, -hurst)
}

/// Fractal dimension of the surface for generic data: 3 + ln|s|/ln n, or 2 if n |s| ≤ 1.
///
/// ```
/// use rugosa_fractal::surfaces::rectangular::dimension;
/// assert!((dimension(4.0, -0.5) - 2.5).abs() < 1e-6);
/// assert_eq!(dimension(4.0, 0.2), 2.0); // too flat to be fractal
/// ```
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
///
/// ```
/// use rugosa_fractal::surfaces::rectangular::passes_to_nodes;
/// assert_eq!(passes_to_nodes(8, 4), Some(1)); // every preimage is a node
/// assert_eq!(passes_to_nodes(4, 8), Some(2));
/// assert_eq!(passes_to_nodes(3, 4), None);
/// ```
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
///
/// ```
/// use rugosa_fractal::surfaces::{Shape, SurfaceError, rectangular::{Scale, Surface}};
/// // 2 × 2 tiles of 2 × 2 samples; flat but for a peak of 1 m in the middle
/// let nodes = [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0];
/// let lattice = Shape::new(3, 3);
/// let surface = Surface::new(&nodes, lattice, (2, 2), Scale::Constant(0.4)).unwrap();
/// assert_eq!(surface.shape(), Shape::new(5, 5));
/// let (mut plain, mut fractal) = ([0.0; 25], [0.0; 25]);
/// surface.write_bilinear(&mut plain);
/// assert_eq!(surface.evaluate(&mut fractal), Ok(1)); // one pass is exact
/// assert_eq!(fractal[2 * 5 + 2], 1.0); // through the node
/// // a small copy of the peak in the middle of every tile
/// assert!((plain[6] - 0.25).abs() < 1e-6 && (fractal[6] - (0.25 + 0.4)).abs() < 1e-6);
/// let unbounded = Surface::new(&nodes, lattice, (2, 2), Scale::Constant(1.0));
/// assert_eq!(unbounded.err(), Some(SurfaceError::Scale(1.0)));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    nodes: &'a [f32],
    lattice: Shape,
    tile: (usize, usize),
    scale: Scale<'a>,
    base: Base,
}

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

    /// The largest jump of height on a tile edge; 0 where the construction is continuous.
    /// `surface` is the evaluated surface.
    ///
    /// ```
    /// use rugosa_fractal::surfaces::{Shape, rectangular::{Base, Scale, Surface}};
    /// let nodes = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
    /// let scales = [0.4, 0.1, 0.4, 0.1]; // per tile, row by row
    /// let tiles = Scale::Tiles(&scales);
    /// let surface = Surface::new(&nodes, Shape::new(3, 3), (2, 2), tiles).unwrap();
    /// let mut z = [0.0; 25];
    /// surface.evaluate(&mut z).unwrap();
    /// assert!((surface.largest_jump(&z) - 0.3).abs() < 1e-6); // metres, |0.4 − 0.1| · 1 m
    /// // on the Coons base any scales are continuous
    /// assert_eq!(surface.on(Base::Coons).largest_jump(&z), 0.0);
    /// ```
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

    fn largest_scale(&self) -> f32 {
        let largest = |s: &[f32]| s.iter().fold(0.0f32, |most, s| most.max(math::abs(*s)));
        match self.scale {
            Scale::Constant(s) => math::abs(s),
            Scale::Nodes(s) | Scale::Tiles(s) => largest(s),
        }
    }
}

#[inline]
fn blend(a: f32, b: f32, t: f32) -> f32 {
    if t == 1.0 { b } else { a + (b - a) * t }
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
