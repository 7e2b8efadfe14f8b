//! The posterior of the pyramid prior by preconditioned conjugate gradients.
//!
//! Minimises |w − w₀|² + Σ c_i (d_i − (Pw)_i)² over the levels above the finest one and
//! the plane, c_i = 1 / (r_i + s_i²): the finest level's terms are independent of each
//! other, so it is taken out by hand and only adds its variance s_i² to the datum's r_i.
//! That makes the conditioning independent of the noise and the vectors a third as long.
//! w₀ = 0 gives the mean. A draw w₀ from the prior and data d_i + N(0, 1/c_i) give an
//! exact draw from the posterior ("perturb and optimise"); both scaled by √T give the
//! draw at temperature T.
//!
//! Heights and deviations in metres, cells in window order (row = y ascending, x
//! fastest). Memory is lent, `need(side)` elements: 76 KiB for 65 × 65 cells, the map
//! itself not included.
//!
//! Cost of an iteration: about 13 additions and multiplications per cell, no division.
//! Accuracy: `mean_is_as_good_as_exact_kriging`, `draws_are_honest` and
//! `realisations_have_the_grounds_roughness` in tests/reconstruction.rs.
//!
//! After [`Posterior::observe`] the solver continues from where it stood: a sweep
//! changes some data and a few iterations bring the mean up to date. When the window
//! moves, [`Posterior::shift`] takes the surface along approximately; what it gets wrong
//! the next iterations repair, since the residual is always worked out anew.

use super::{
    Error, Prior,
    operator::{add_noise, descend, expand, gather},
    refine::{ROWS, pass},
    shape::{PLANE, Shape},
    simd::{add_scaled, dot, scale_add, scale_add_dot, widest},
};
use crate::synthesis::normal;
use rand_core::Rng;
use rugosa_grid::math;

/// What is known of a cell: elevation \[m\] and its variance \[m²\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Datum {
    /// elevation \[m\]
    pub height: f32,
    /// its variance \[m²\]; 0 is allowed
    pub variance: f32,
}

impl Datum {
    fn is_sound(&self) -> bool {
        self.height.is_finite() && self.variance >= 0.0 && self.variance < f32::INFINITY
    }
}

/// What became of the data.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Intake {
    /// cells with a datum
    pub used: usize,
    /// data that are not numbers, or with a variance that is negative or not finite
    pub refused: usize,
}

/// How far the solver has come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// iterations done by this call
    pub iterations: usize,
    /// length of the residual (in the preconditioner's norm) relative to the energy norm of
    /// the solution; from nothing that is its length at w = 0
    pub residual: f32,
}

/// A reconstruction: the solver's state in lent memory.
///
/// ```
/// use rugosa_fractal::pyramid::{Datum, Levels, Posterior};
/// let prior = Levels::power_law(33, 0.7, 0.1).unwrap(); // 0.1 m over one cell
/// // 2 m in the west, 3 m in the east, 1 cm sure; nothing is known between
/// let data = |i: usize| match i % 33 {
///     0 => Some(Datum { height: 2.0, variance: 1e-4 }),
///     32 => Some(Datum { height: 3.0, variance: 1e-4 }),
///     _ => None,
/// };
/// # let (mut memory, mut mean) = (vec![0.0; Posterior::need(33).unwrap()], vec![0.0; 33 * 33]);
/// let mut posterior = Posterior::new(33, &mut memory).unwrap();
/// assert_eq!(posterior.observe(&prior, data).used, 2 * 33);
/// assert!(posterior.step(50).residual < 1e-3);
/// posterior.mean(&prior, data, &mut mean);
/// let [west, middle, east] = [0, 16, 32].map(|column| mean[16 * 33 + column]); // row 16
/// assert!((west - 2.0).abs() < 0.02 && (east - 3.0).abs() < 0.02);
/// assert!((middle - 2.5).abs() < 0.02);
/// ```
#[derive(Debug)]
pub struct Posterior<'m> {
    pub(super) shape: Shape,
    /// per cell: 1 / (r + s²), 0 without a datum
    pub(super) weights: &'m mut [f32],
    /// per number: the solution
    pub(super) x: &'m mut [f32],
    /// the residual
    pub(super) r: &'m mut [f32],
    /// the search direction
    pub(super) p: &'m mut [f32],
    /// the operator's image of `p`, then the preconditioned residual
    pub(super) z: &'m mut [f32],
    /// surfaces
    pub(super) u: &'m mut [f32],
    /// deviations
    pub(super) s: &'m mut [f32],
    /// 1 / (1 + s² c) and s c / (1 + s² c) of the preconditioner
    pub(super) inverse: &'m mut [f32],
    pub(super) coupling: &'m mut [f32],
    pub(super) rows: &'m mut [f32],
    pub(super) block: &'m mut [f32],
    /// height \[m\] that is taken off all data: single precision is for the relief
    pub(super) offset: f32,
    rz: f32,
    reference: f32,
    cold: bool,
}

/// Vectors of packed length in a [`Posterior`].
const VECTORS: usize = 8;

/// The solver has converged to rounding when the squared residual is below this share.
const ROUNDING: f32 = 1e-12;

impl<'m> Posterior<'m> {
    /// Elements of f32 that a reconstruction of side × side cells needs (4 bytes each).
    ///
    /// # Errors
    /// A side that is not 2^k + 1.
    pub const fn need(side: usize) -> Result<usize, Error> {
        let Some(shape) = Shape::new(side) else {
            return Err(Error::Side(side));
        };
        let order = shape.block();
        let block = order * (order + 1) / 2;
        Ok(side * side + VECTORS * shape.packed() + ROWS * (side + 2) + block)
    }

    /// A reconstruction of side × side cells that knows nothing yet.
    ///
    /// # Errors
    /// A side that is not 2^k + 1; less memory than [`Posterior::need`].
    pub fn new(side: usize, memory: &'m mut [f32]) -> Result<Self, Error> {
        let shape = Shape::new(side).ok_or(Error::Side(side))?;
        let need = Self::need(side)?;
        let mut rest = memory.get_mut(..need).ok_or(Error::Memory(need))?;
        rest.fill(0.0);
        let mut take = |count| {
            let (head, tail) = core::mem::take(&mut rest).split_at_mut(count);
            rest = tail;
            head
        };
        let n = shape.packed();
        Ok(Posterior {
            shape,
            weights: take(side * side),
            x: take(n),
            r: take(n),
            p: take(n),
            z: take(n),
            u: take(n),
            s: take(n),
            inverse: take(n),
            coupling: take(n),
            rows: take(ROWS * (side + 2)),
            block: take(shape.block() * (shape.block() + 1) / 2),
            offset: 0.0,
            rz: 0.0,
            reference: 0.0,
            cold: true,
        })
    }

    /// Cells per edge.
    pub fn side(&self) -> usize {
        self.shape.side
    }

    /// Forgets the solution: the next [`Posterior::observe`] starts from the prior mean.
    ///
    /// ```
    /// use rugosa_fractal::pyramid::{Datum, Levels, Posterior};
    /// let prior = Levels::power_law(33, 0.7, 0.1).unwrap();
    /// let data = |i| Some(Datum { height: (i % 33) as f32 * 0.1, variance: 0.01 });
    /// let mut memory = vec![0.0; Posterior::need(33).unwrap()];
    /// let mut posterior = Posterior::new(33, &mut memory).unwrap();
    /// posterior.observe(&prior, data);
    /// posterior.step(50);
    /// posterior.observe(&prior, data); // goes on from the solution
    /// assert!(posterior.step(0).residual < 1e-3);
    /// posterior.restart();
    /// posterior.observe(&prior, data); // from nothing
    /// assert!(posterior.step(0).residual > 0.1);
    /// ```
    pub fn restart(&mut self) {
        self.x.fill(0.0);
        self.cold = true;
    }

    /// Takes the data in and makes ready to solve for the mean, from the present
    /// solution. `data(i)` is the datum of cell `i`, row by row, x fastest. Without any
    /// datum the mean is 0.
    pub fn observe(&mut self, prior: &impl Prior, data: impl Fn(usize) -> Option<Datum>) -> Intake {
        let intake = self.prepare(prior, &data);
        if self.cold {
            self.offset = self.mean_height(&data);
        }
        let offset = self.offset;
        let target = |i| height(&data, i) - offset;
        widest(|| self.begin(target));
        self.cold = false;
        intake
    }

    /// Takes the data in and makes ready to solve for a draw from the posterior at a
    /// temperature ≥ 0 (0: the mean, 1: the posterior). The present solution is lost.
    ///
    /// ```
    /// use rand_core::SeedableRng;
    /// use rugosa_fractal::pyramid::{Datum, Levels, Posterior};
    /// let prior = Levels::power_law(33, 0.7, 0.1).unwrap();
    /// let data = |i| (i % 33 == 0).then_some(Datum { height: 2.0, variance: 1e-6 });
    /// # let (mut memory, mut z) = (vec![0.0; Posterior::need(33).unwrap()], vec![0.0; 33 * 33]);
    /// let mut posterior = Posterior::new(33, &mut memory).unwrap();
    /// # let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(1);
    /// posterior.draw((&prior, data), 1.0, &mut rng);
    /// posterior.step(50);
    /// posterior.realisation((&prior, data), 1.0, &mut rng, &mut z);
    /// // where it was measured it is 2 m, elsewhere as rough as the prior
    /// assert!((z[16 * 33] - 2.0).abs() < 0.01);
    /// let square: f32 = z.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum();
    /// assert!(square / (33.0 * 33.0) > 0.005); // of 0.01 m²
    /// ```
    pub fn draw(
        &mut self,
        (prior, data): (&impl Prior, impl Fn(usize) -> Option<Datum>),
        temperature: f32,
        rng: &mut impl Rng,
    ) -> Intake {
        let intake = self.prepare(prior, &data);
        self.offset = self.mean_height(&data);
        self.perturb(&data, math::sqrt(temperature), rng);
        intake
    }

    /// Starts a draw with the weights as they are.
    pub(super) fn perturb(
        &mut self,
        data: impl Fn(usize) -> Option<Datum>,
        amplitude: f32,
        rng: &mut impl Rng,
    ) {
        self.x.fill_with(|| amplitude * normal(rng));
        // the mean level's broad prior stands for ignorance: nothing to draw
        self.x[PLANE - 1] = 0.0;
        let (offset, weights) = (self.offset, core::mem::take(&mut self.weights));
        self.residual(weights, |i, c, v| {
            height(&data, i) - offset + amplitude * normal(rng) / math::sqrt(c) - v
        });
        self.weights = weights;
        widest(|| self.launch());
        self.reference = self.rz;
        self.cold = true;
    }

    /// Deviations, weights and the preconditioner.
    pub(super) fn prepare(
        &mut self,
        prior: &impl Prior,
        data: impl Fn(usize) -> Option<Datum>,
    ) -> Intake {
        self.deviations(prior);
        let side = self.shape.side;
        let mut intake = Intake::default();
        for (i, c) in self.weights.iter_mut().enumerate() {
            *c = 0.0;
            match data(i) {
                Some(d) if d.is_sound() => {
                    *c = 1.0 / (d.variance + prior.variance(0, i / side, i % side));
                    intake.used += 1;
                }
                Some(_) => intake.refused += 1,
                None => {}
            }
        }
        widest(|| self.factor());
        intake
    }

    /// Fills `s` from the prior.
    fn deviations(&mut self, prior: &impl Prior) {
        let (slope, mean) = prior.plane();
        let slope = math::sqrt(slope);
        self.s[..PLANE].copy_from_slice(&[slope, slope, math::sqrt(mean)]);
        for l in 0..=self.shape.top {
            let refinements = self.shape.top + 1 - l;
            let n = Shape::size(l);
            for (i, s) in self.s[Shape::level(l)].iter_mut().enumerate() {
                let cell =
                    |node: usize| (node.saturating_sub(1) << refinements).min(self.shape.side - 1);
                *s = math::sqrt(prior.variance(refinements, cell(i / n), cell(i % n)));
            }
        }
    }

    /// Weighted mean of the data; 0 without any.
    fn mean_height(&self, data: impl Fn(usize) -> Option<Datum>) -> f32 {
        let (mut sum, mut weight, mut first) = (0.0, 0.0, None);
        for (i, &c) in self.weights.iter().enumerate().filter(|(_, c)| **c > 0.0) {
            let h = height(&data, i);
            let origin = *first.get_or_insert(h);
            sum += c * (h - origin);
            weight += c;
        }
        first.map_or(0.0, |origin| origin + sum / weight)
    }

    /// Residual, reference and first direction of a solve for the mean. The reference is the
    /// energy xᵀ A x of the solution so far and that of what is missing, rᵀ M r ≈ eᵀ A e: from
    /// nothing that of the solution to come.
    #[inline(always)]
    fn begin(&mut self, target: impl Fn(usize) -> f32) {
        let weights = core::mem::take(&mut self.weights);
        let mut energy = dot(self.x, self.x);
        self.residual(weights, |i, c, v| {
            energy += c * v * v;
            target(i) - v
        });
        self.weights = weights;
        for (r, x) in self.r.iter_mut().zip(self.x.iter()) {
            *r -= x;
        }
        self.launch();
        self.reference = self.rz + energy;
    }

    /// r = Pᵀ c (target − P x): the data's part of the residual. `off(i, c, v)` is what cell
    /// `i` of weight `c` lies above its value `v`.
    #[cfg_attr(feature = "simd", inline(always))]
    fn residual(&mut self, weights: &mut [f32], mut off: impl FnMut(usize, f32, f32) -> f32) {
        let (shape, top) = (self.shape, self.shape.top);
        expand(&shape, self.s, self.x, self.u, top);
        add_noise(self.s, self.x, self.u, top);
        let from = (&self.u[Shape::level(top)], Shape::size(top));
        let to = &mut self.r[Shape::level(top)];
        pass(from, self.rows, to, weights, |i, c, v| {
            if *c > 0.0 { *c * off(i, *c, v) } else { 0.0 }
        });
        gather(&shape, self.s, self.r, top, self.rows);
    }

    /// First direction.
    #[cfg_attr(feature = "simd", inline(always))]
    fn launch(&mut self) {
        self.precondition();
        self.p.copy_from_slice(self.z);
        self.rz = dot(self.r, self.z);
    }

    /// At most `iterations` of conjugate gradients; fewer when converged to rounding.
    pub fn step(&mut self, iterations: usize) -> Progress {
        let done = widest(|| (0..iterations).take_while(|_| self.iterate()).count());
        Progress {
            iterations: done,
            residual: self.relative(),
        }
    }

    /// Leaves nothing to iterate on.
    pub(super) fn end(&mut self) {
        self.rz = 0.0;
    }

    /// Length of the residual relative to the solution's; 0 when there is nothing to solve.
    fn relative(&self) -> f32 {
        if self.reference > 0.0 {
            math::sqrt(self.rz / self.reference)
        } else {
            0.0
        }
    }

    /// One iteration; `false` when there was nothing left to do.
    #[inline(always)]
    fn iterate(&mut self) -> bool {
        if self.rz <= ROUNDING * self.reference {
            return false;
        }
        let curvature = self.apply();
        if curvature <= 0.0 {
            return false;
        }
        let alpha = self.rz / curvature;
        add_scaled(self.x, alpha, self.p);
        add_scaled(self.r, -alpha, self.z);
        self.precondition();
        let rz = dot(self.r, self.z);
        let beta = rz / self.rz;
        scale_add(self.p, beta, self.z);
        self.rz = rz;
        true
    }

    /// z = p + S Pᵀ C P S p; returns pᵀ z.
    #[inline(always)]
    fn apply(&mut self) -> f32 {
        let (shape, top) = (self.shape, self.shape.top);
        expand(&shape, self.s, self.p, self.u, top);
        add_noise(self.s, self.p, self.u, top);
        let from = (&self.u[Shape::level(top)], Shape::size(top));
        let to = &mut self.z[Shape::level(top)];
        pass(from, self.rows, to, self.weights, |_, c, v| *c * v);
        descend(&shape, self.z, top, self.rows);
        scale_add_dot(self.z, self.s, self.p)
    }

    /// The window has moved by (columns, rows) cells: cell (x, y) of the new window is
    /// (x + columns, y + rows) of the old one. Numbers are interpolated between nodes
    /// and 0 where nothing was known. To be followed by [`Posterior::observe`].
    ///
    /// ```
    /// use rugosa_fractal::pyramid::{Datum, Levels, Posterior};
    /// let prior = Levels::power_law(33, 0.7, 0.1).unwrap();
    /// # let mut memory = vec![0.0; Posterior::need(33).unwrap()];
    /// let mut posterior = Posterior::new(33, &mut memory).unwrap();
    /// // a ridge in column 20, 1 m high, on flat ground
    /// let ridge = |column| {
    ///     let height = move |i: usize| if i % 33 == column { 1.0 } else { 0.0 };
    ///     move |i| Some(Datum { height: height(i), variance: 0.01 })
    /// };
    /// posterior.observe(&prior, ridge(20));
    /// posterior.step(50);
    /// // the window moves by four cells to the east: the ridge is now in column 16
    /// posterior.shift(4, 0);
    /// posterior.observe(&prior, ridge(16));
    /// assert!(posterior.step(0).residual < 0.5); // 1 without the shift
    /// ```
    pub fn shift(&mut self, columns: i32, rows: i32) {
        let drift = self.s[0] * self.x[0] * columns as f32 + self.s[1] * self.x[1] * rows as f32;
        if self.s[PLANE - 1] > 0.0 {
            self.x[PLANE - 1] += drift / self.s[PLANE - 1];
        }
        self.u.copy_from_slice(self.x);
        for l in 0..=self.shape.top {
            let share = 1.0 / (1u32 << (self.shape.top + 1 - l)) as f32;
            let by = (columns as f32 * share, rows as f32 * share);
            let at = Shape::level(l);
            shift_level(&self.u[at.clone()], &mut self.x[at], Shape::size(l), by);
        }
    }
}

/// Moves the n × n numbers of a level by a fraction of nodes, bilinearly.
fn shift_level(old: &[f32], new: &mut [f32], n: usize, (dx, dy): (f32, f32)) {
    let at = |y: i32, x: i32| {
        let inside = (0..n as i32).contains(&x) && (0..n as i32).contains(&y);
        if inside {
            old[y as usize * n + x as usize]
        } else {
            0.0
        }
    };
    let (ix, iy) = (math::floor_index(dx), math::floor_index(dy));
    let (fx, fy) = (dx - ix as f32, dy - iy as f32);
    for (i, v) in new.iter_mut().enumerate() {
        let (y, x) = ((i / n) as i32 + iy, (i % n) as i32 + ix);
        let low = (1.0 - fx) * at(y, x) + fx * at(y, x + 1);
        let high = (1.0 - fx) * at(y + 1, x) + fx * at(y + 1, x + 1);
        *v = (1.0 - fy) * low + fy * high;
    }
}

/// Height of a cell that has a sound datum.
fn height(data: &impl Fn(usize) -> Option<Datum>, i: usize) -> f32 {
    data(i).map_or(0.0, |d| d.height)
}
