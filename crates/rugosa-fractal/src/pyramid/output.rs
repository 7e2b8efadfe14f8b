//! What the posterior is asked for: mean, realisation, standard deviation.
//!
//! The finest level was taken out of the solve; here it comes back, cell by cell. With
//! m the coarser levels' surface, s² the finest level's variance and a datum d of
//! variance r, u given m has the mean m + a (d − m), a = s²/(s² + r), and the variance
//! a r; without a datum m and s². The mean takes the mean, a realisation draws.
//!
//! The standard deviation averages over K draws. Deviations of draws from the mean do
//! not depend on the heights of the data, so draws for data of height 0 are deviations
//! with the known mean 0, K of them give an unbiased variance without a sum of means,
//! and the finest level's variance is added exactly instead of being drawn.

use super::{
    Prior,
    operator::{add_noise, expand},
    posterior::{Datum, Posterior},
    refine::pass,
    shape::Shape,
    simd::widest,
};
use crate::synthesis::normal;
use rand_core::Rng;
use rugosa_grid::math;

/// How a standard deviation is to be worked out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Draws {
    /// realisations K; the relative error of the result is about 1/√(2K)
    pub count: usize,
    /// solver iterations for each
    pub iterations: usize,
}

impl Posterior<'_> {
    /// The posterior mean \[m\] of every cell, row by row; `out` takes side² elements.
    pub fn mean(
        &mut self,
        prior: &impl Prior,
        data: impl Fn(usize) -> Option<Datum>,
        out: &mut [f32],
    ) {
        self.surface(out);
        let side = self.shape.side;
        for (i, u) in out.iter_mut().enumerate().take(side * side) {
            if let Some((a, d)) = self.share(prior, &data, i) {
                *u += a * (d.height - *u);
            }
        }
    }

    /// The posterior mean \[m\] as [`Posterior::mean`] gives it, left in the memory of the
    /// data's weights, see [`Posterior::heights`]: for a target that has no memory to
    /// spare. Until the next [`Posterior::observe`] or [`Posterior::draw`] there is
    /// nothing to solve and nothing else to be asked for.
    ///
    /// ```
    /// use rugosa_fractal::pyramid::{Datum, Levels, Posterior};
    /// let prior = Levels::power_law(33, 0.7, 0.1).unwrap();
    /// let data = |i| (i % 9 == 0).then_some(Datum { height: (i % 33) as f32, variance: 1e-4 });
    /// let (mut memory, mut mean) = (vec![0.0; Posterior::need(33).unwrap()], vec![0.0; 33 * 33]);
    /// let mut posterior = Posterior::new(33, &mut memory).unwrap();
    /// posterior.observe(&prior, data);
    /// posterior.step(20);
    /// posterior.mean(&prior, data, &mut mean);
    /// posterior.mean_in_place(&prior, data);
    /// let pairs = posterior.heights().iter().zip(&mean);
    /// assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-4)); // metres
    /// ```
    pub fn mean_in_place(&mut self, prior: &impl Prior, data: impl Fn(usize) -> Option<Datum>) {
        let (offset, side) = (self.offset, self.shape.side);
        self.visit(|i, c, u| {
            let mut height = u + offset;
            if *c > 0.0
                && let Some(d) = data(i)
            {
                height += *c * prior.variance(0, i / side, i % side) * (d.height - height);
            }
            *c = height;
        });
        self.end();
    }

    /// What [`Posterior::mean_in_place`] has left, row by row.
    pub fn heights(&self) -> &[f32] {
        self.weights
    }

    /// The draw that [`Posterior::draw`] has begun, finest level included \[m\].
    pub fn realisation(
        &mut self,
        (prior, data): (&impl Prior, impl Fn(usize) -> Option<Datum>),
        temperature: f32,
        rng: &mut impl Rng,
        out: &mut [f32],
    ) {
        self.surface(out);
        let side = self.shape.side;
        for (i, u) in out.iter_mut().enumerate().take(side * side) {
            let mut variance = prior.variance(0, i / side, i % side);
            if let Some((a, d)) = self.share(prior, &data, i) {
                *u += a * (d.height - *u);
                variance = a * d.variance;
            }
            *u += math::sqrt(temperature * variance) * normal(rng);
        }
    }

    /// The posterior's standard deviation \[m\] of every cell, from `draws.count`
    /// realisations. The present solution is lost.
    ///
    /// ```
    /// use rand_core::SeedableRng;
    /// use rugosa_fractal::pyramid::{Datum, Draws, Levels, Posterior};
    /// let prior = Levels::power_law(33, 0.5, 0.1).unwrap();
    /// let data = |i| (i % 33 == 0).then_some(Datum { height: 2.0, variance: 1e-4 });
    /// let (mut memory, mut sd) = (vec![0.0; Posterior::need(33).unwrap()], vec![0.0; 33 * 33]);
    /// let mut posterior = Posterior::new(33, &mut memory).unwrap();
    /// let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(1);
    /// let draws = Draws { count: 50, iterations: 20 };
    /// posterior.standard_deviation((&prior, data), draws, &mut rng, &mut sd);
    /// let [at, near, far] = [0, 4, 32].map(|column| sd[16 * 33 + column]);
    /// // 1 cm where it was measured; more with the distance [m]
    /// assert!((at - 0.01).abs() < 0.001 && near > 0.1 && far > 1.5 * near);
    /// ```
    pub fn standard_deviation(
        &mut self,
        (prior, data): (&impl Prior, impl Fn(usize) -> Option<Datum>),
        draws: Draws,
        rng: &mut impl Rng,
        out: &mut [f32],
    ) {
        let side = self.shape.side;
        let out = &mut out[..side * side];
        out.fill(0.0);
        let flat = |i| data(i).map(|d| Datum { height: 0.0, ..d });
        self.prepare(prior, &data);
        self.offset = 0.0;
        for _ in 0..draws.count {
            self.perturb(flat, 1.0, rng);
            self.step(draws.iterations);
            self.visit(|at, _, u| out[at] += u * u);
        }
        let share = 1.0 / draws.count.max(1) as f32;
        for (i, v) in out.iter_mut().enumerate() {
            let fine = prior.variance(0, i / side, i % side);
            let coarse = *v * share;
            let variance = match self.share(prior, &data, i) {
                Some((a, d)) => (1.0 - a) * (1.0 - a) * coarse + a * d.variance,
                None => coarse + fine,
            };
            *v = math::sqrt(variance);
        }
    }

    /// Weight of a cell's datum against the coarser levels, and the datum.
    fn share(
        &self,
        prior: &impl Prior,
        data: impl Fn(usize) -> Option<Datum>,
        i: usize,
    ) -> Option<(f32, Datum)> {
        let c = self.weights[i];
        let side = self.shape.side;
        (c > 0.0)
            .then(|| data(i))
            .flatten()
            .map(|d| (c * prior.variance(0, i / side, i % side), d))
    }

    /// The coarser levels' surface \[m\].
    fn surface(&mut self, out: &mut [f32]) {
        let offset = self.offset;
        self.visit(|at, _, u| out[at] = u + offset);
    }

    /// Calls `f(cell, weight, height)` for the coarser levels' surface, without the offset.
    fn visit(&mut self, mut f: impl FnMut(usize, &mut f32, f32)) {
        let (shape, top) = (self.shape, self.shape.top);
        expand(&shape, self.s, self.x, self.u, top);
        add_noise(self.s, self.x, self.u, top);
        let from = (&self.u[Shape::level(top)], Shape::size(top));
        let (to, rows) = (&mut self.z[Shape::level(top)], &mut *self.rows);
        widest(|| {
            pass(from, rows, to, self.weights, |i, c, u| {
                f(i, c, u);
                0.0
            });
        });
    }
}
