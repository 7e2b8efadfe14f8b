//! Least-squares scales against measured data.
//!
//! With r = data − b and g = (f − B)(L⁻¹) the surface is b + s g: linear in s. Where one pass
//! is exact g does not depend on s and the answers are exact; otherwise f depends on s, and
//! the formula is repeated on the surface that it gives.
//!
//! - one s: Σ r g / Σ g²;
//! - one per tile: the same over the tile;
//! - a continuous field, bilinear between node values s_j with hats φ_j: the normal equations
//!   Σ_k ⟨φ_j g, φ_k g⟩ s_k = ⟨φ_j g, r⟩ couple each node with its eight neighbours. They are
//!   solved under |s_j| ≤ 0.95 by projected Gauss–Seidel sweeps, which converge to the
//!   constrained optimum because the problem is convex. Without the bound real terrain asks for
//!   |s| up to 1.5.
//!
//! Cost: one evaluation and some 20 operations per sample; the field besides
//! 10 operations per node and sweep. Accuracy: rounding; the field to 1e-6 of s
//! (`the_field_of_scales_is_recovered`).

use super::{Scale, Surface, blend, preimage};
use crate::surfaces::{Shape, SurfaceError, check_finite, check_length};
use rugosa_grid::math;

/// Largest |s| of a fit.
const LARGEST: f64 = 0.95;

/// Most sweeps over the nodes of a field.
const SWEEPS: u32 = 300;

/// Repetitions where one pass is not exact.
const REPETITIONS: u32 = 12;

/// The normal equation of a node of a field of scales: coefficients of the 3 × 3 nodes around
/// it, row by row, and the right-hand side.
pub type Equation = [f64; 10];

/// One sample of the regression: where it lies, r and g.
struct Regressor {
    node: (usize, usize),
    fraction: (f32, f32),
    r: f64,
    g: f64,
}

impl Surface<'_> {
    /// The one s that fits `data` best. `scratch` is as large as `data`.
    ///
    /// ```
    /// use rugosa_fractal::surfaces::{Shape, rectangular::{Scale, Surface}};
    /// let nodes: [f32; 25] = core::array::from_fn(|i| (i * i % 7) as f32);
    /// let flat = Surface::new(&nodes, Shape::new(5, 5), (4, 4), Scale::Constant(0.0)).unwrap();
    /// let (mut data, mut scratch) = ([0.0; 17 * 17], [0.0; 17 * 17]);
    /// flat.with(Scale::Constant(-0.3)).unwrap().evaluate(&mut data).unwrap();
    /// let scale = flat.best_scale(&data, &mut scratch).unwrap();
    /// assert!((scale + 0.3).abs() < 1e-5);
    /// ```
    ///
    /// # Errors
    /// Slices shorter than [`Surface::shape`], non-finite data.
    pub fn best_scale(&self, data: &[f32], scratch: &mut [f32]) -> Result<f32, SurfaceError> {
        self.check_data(data)?;
        let mut scale = 0.0f32;
        for _ in 0..REPETITIONS {
            let surface = self.with(Scale::Constant(scale))?;
            surface.evaluate(scratch)?;
            let (mut rg, mut gg) = (0.0, 0.0);
            surface.regressors(data, scratch, |s| {
                rg += s.r * s.g;
                gg += s.g * s.g;
            });
            let next = quotient(rg, gg) as f32;
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
    /// ```
    /// use rugosa_fractal::surfaces::{Shape, rectangular::{Base, Scale, Surface}};
    /// let nodes: [f32; 25] = core::array::from_fn(|i| (i * i % 7) as f32);
    /// let flat = Surface::new(&nodes, Shape::new(5, 5), (4, 4), Scale::Constant(0.0)).unwrap();
    /// let flat = flat.on(Base::Coons);
    /// let truth: [f32; 16] = core::array::from_fn(|tile| 0.05 * tile as f32 - 0.3);
    /// let (mut data, mut scratch, mut scales) = ([0.0; 17 * 17], [0.0; 17 * 17], [0.0; 16]);
    /// flat.with(Scale::Tiles(&truth)).unwrap().evaluate(&mut data).unwrap();
    /// flat.best_tile_scales(&data, &mut scratch, &mut scales).unwrap();
    /// assert!(scales.iter().zip(truth).all(|(found, s)| (found - s).abs() < 1e-4));
    /// ```
    ///
    /// # Errors
    /// As [`Surface::best_scale`].
    pub fn best_tile_scales(
        &self,
        data: &[f32],
        scratch: &mut [f32],
        scales: &mut [f32],
    ) -> Result<(), SurfaceError> {
        self.check_data(data)?;
        let (rows, columns) = self.tiles();
        check_length(Shape::new(rows, columns), scales.len())?;
        let flat = self.with(Scale::Constant(0.0))?;
        flat.evaluate(scratch)?;
        for (index, scale) in scales[..rows * columns].iter_mut().enumerate() {
            let (mut rg, mut gg) = (0.0, 0.0);
            let tile = (index / columns, index % columns);
            flat.tile_regressors(tile, (data, scratch), |s| {
                rg += s.r * s.g;
                gg += s.g * s.g;
            });
            *scale = quotient(rg, gg) as f32;
        }
        Ok(())
    }

    /// The continuous field that fits `data` best, |s| ≤ 0.95: `scales` receives one value per
    /// node. `equations` has one element per node, `scratch` is as large as `data`.
    ///
    /// ```
    /// use rugosa_fractal::surfaces::{Shape, rectangular::{Scale, Surface}};
    /// let nodes: [f32; 25] = core::array::from_fn(|i| (i * i % 7) as f32);
    /// let flat = Surface::new(&nodes, Shape::new(5, 5), (4, 4), Scale::Constant(0.0)).unwrap();
    /// let truth: [f32; 25] = core::array::from_fn(|node| 0.02 * node as f32 - 0.2);
    /// let (mut data, mut scratch) = ([0.0; 17 * 17], [0.0; 17 * 17]);
    /// let (mut equations, mut scales) = ([[0.0; 10]; 25], [0.0; 25]);
    /// flat.with(Scale::Nodes(&truth)).unwrap().evaluate(&mut data).unwrap();
    /// flat.best_node_scales(&data, (&mut scratch, &mut equations), &mut scales).unwrap();
    /// assert!(scales.iter().zip(truth).all(|(found, s)| (found - s).abs() < 1e-3));
    /// ```
    ///
    /// # Errors
    /// As [`Surface::best_scale`].
    pub fn best_node_scales(
        &self,
        data: &[f32],
        (scratch, equations): (&mut [f32], &mut [Equation]),
        scales: &mut [f32],
    ) -> Result<(), SurfaceError> {
        self.check_data(data)?;
        check_length(self.lattice, scales.len().min(equations.len()))?;
        let (scales, equations) = (
            &mut scales[..self.lattice.len()],
            &mut equations[..self.lattice.len()],
        );
        scales.fill(0.0);
        for _ in 0..REPETITIONS {
            let passes = Surface {
                scale: Scale::Nodes(scales),
                ..*self
            }
            .evaluate(scratch)?;
            self.normal_equations(data, scratch, equations);
            if solve(equations, self.lattice, scales) < 1e-6 || passes == 1 {
                break;
            }
        }
        Ok(())
    }

    fn check_data(&self, data: &[f32]) -> Result<(), SurfaceError> {
        check_length(self.shape(), data.len())?;
        check_finite(&data[..self.shape().len()])
    }

    fn normal_equations(&self, data: &[f32], surface: &[f32], equations: &mut [Equation]) {
        equations.fill([0.0; 10]);
        let width = self.lattice.columns;
        self.regressors(data, surface, |s| {
            let (u, v) = (f64::from(s.fraction.0), f64::from(s.fraction.1));
            let hats = [(1.0 - u) * (1.0 - v), (1.0 - u) * v, u * (1.0 - v), u * v];
            for (a, hat) in hats.iter().enumerate() {
                let weight = hat * s.g;
                let equation = &mut equations[(s.node.0 + a / 2) * width + s.node.1 + a % 2];
                for (b, other) in hats.iter().enumerate() {
                    // 4: the node itself; a row of neighbours is three further
                    equation[4 + 3 * (b / 2) + b % 2 - 3 * (a / 2) - a % 2] += weight * other * s.g;
                }
                equation[9] += weight * s.r;
            }
        });
    }

    /// Every sample, once.
    fn regressors(&self, data: &[f32], surface: &[f32], mut seen: impl FnMut(Regressor)) {
        let (rows, columns) = self.tiles();
        for tile in (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
            self.tile_regressors(tile, (data, surface), &mut seen);
        }
    }

    /// The samples of one tile; the last ones own the border of D.
    fn tile_regressors(
        &self,
        (i, j): (usize, usize),
        (data, surface): (&[f32], &[f32]),
        mut seen: impl FnMut(Regressor),
    ) {
        let width = self.shape().columns;
        let (rows, columns) = self.tiles();
        let height = self.tile.0 + usize::from(i + 1 == rows);
        let breadth = self.tile.1 + usize::from(j + 1 == columns);
        for y in (0..height).map(|k| i * self.tile.0 + k) {
            let source_y = preimage(rows, self.tile.0, y);
            let (node, u) = self.split(y, 0);
            let (left, right) = self.edges(node, u, j);
            for x in (0..breadth).map(|k| j * self.tile.1 + k) {
                let source_x = preimage(columns, self.tile.1, x);
                let v = self.split(x, 1).1;
                let detail =
                    surface[source_y * width + source_x] - self.base_at(source_y, source_x);
                seen(Regressor {
                    node: (node, j),
                    fraction: (u, v),
                    r: f64::from(data[y * width + x] - blend(left, right, v)),
                    g: f64::from(detail),
                });
            }
        }
    }
}

/// Gauss–Seidel sweeps within the bound; the largest change of any scale since the call.
fn solve(equations: &[Equation], lattice: Shape, scales: &mut [f32]) -> f64 {
    let mut moved = 0.0f64;
    for _ in 0..SWEEPS {
        let mut change = 0.0f64;
        for index in 0..lattice.len() {
            let next = relaxed(&equations[index], lattice, (index, scales));
            change = change.max((next - f64::from(scales[index])).abs());
            scales[index] = next as f32;
        }
        moved = moved.max(change);
        if change < 1e-7 {
            break;
        }
    }
    moved
}

/// The scale of one node that its equation asks for, the others being as they are.
fn relaxed(equation: &Equation, lattice: Shape, (index, scales): (usize, &[f32])) -> f64 {
    let (row, column) = (index / lattice.columns, index % lattice.columns);
    let mut rest = equation[9];
    for (k, coefficient) in equation[..9].iter().enumerate().filter(|(k, _)| *k != 4) {
        let (r, c) = (
            (row + k / 3).wrapping_sub(1),
            (column + k % 3).wrapping_sub(1),
        );
        if r < lattice.rows && c < lattice.columns {
            rest -= coefficient * f64::from(scales[r * lattice.columns + c]);
        }
    }
    quotient(rest, equation[4])
}

/// The quotient within the bound; 0 where the data carry no information.
fn quotient(rg: f64, gg: f64) -> f64 {
    if gg > 0.0 {
        (rg / gg).clamp(-LARGEST, LARGEST)
    } else {
        0.0
    }
}
