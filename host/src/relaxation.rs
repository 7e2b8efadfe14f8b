//! The reconstruction of 1996 on the command line, as a reference for the pyramid.

use crate::error::{Failure, Result};
use crate::reconstruct::{Roughness, Seen, Solve};
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;
use rugosa_fractal::ak96::{Ak96, KAPPA, Prior};
use rugosa_fractal::pyramid::{Draws, Progress};

/// Data count as uncertain by at least this share of S²(1), or relaxation stands still.
const LEAST_VARIANCE: f32 = 1e-4;
/// Before it samples, the surface is relaxed for this share of the sweeps.
const RELAXED: usize = 4;
/// Sweeps between two samples of a standard deviation.
const APART: usize = 5;

/// Relative multiresolution, relaxed or sampled.
pub struct Relaxation<'a> {
    seen: &'a Seen,
    dimension: f32,
    /// S²(1) \[m²\]
    lag1: f32,
    memory: Vec<f32>,
    refused: usize,
}

impl<'a> Relaxation<'a> {
    /// For ground of this roughness on cells of `resolution` \[m\].
    pub fn new(seen: &'a Seen, roughness: &Roughness, resolution: f64) -> Result<Self> {
        let need = Ak96::need(seen.side).map_err(Failure::input)?;
        let per_cell = roughness.sigma * resolution.powf(roughness.hurst);
        Ok(Relaxation {
            seen,
            dimension: (3.0 - roughness.hurst) as f32,
            lag1: (per_cell * per_cell) as f32,
            memory: vec![0.0; need],
            refused: 0,
        })
    }

    fn start(&mut self) -> Result<Ak96<'_>> {
        let seen = self.seen;
        let mut state = Ak96::new(seen.side, &mut self.memory).map_err(Failure::input)?;
        let used = state.observe(|i| seen.data[i], LEAST_VARIANCE * self.lag1);
        self.refused = seen.known - used;
        Ok(state)
    }

    /// Temperatures from the dimension (eqs 12–13).
    fn prior(&self, temperature: f32) -> Prior {
        Prior::from_dimension(self.dimension, temperature * KAPPA * self.lag1)
    }
}

impl Solve for Relaxation<'_> {
    fn mean(&mut self, sweeps: usize, done: &mut dyn FnMut()) -> Result<(Vec<f32>, Progress)> {
        let prior = self.prior(1.0);
        let side = self.seen.side;
        let mut state = self.start()?;
        let (mut before, mut out) = (vec![0.0; side * side], vec![0.0; side * side]);
        for sweep in 0..sweeps {
            if sweep + 1 == sweeps {
                state.surface(&mut before);
            }
            state.relax(&prior);
            done();
        }
        state.surface(&mut out);
        let progress = Progress {
            iterations: sweeps,
            residual: change(&before, &out),
        };
        Ok((out, progress))
    }

    fn realisation(
        &mut self,
        (temperature, seed): (f32, u64),
        sweeps: usize,
        done: &mut dyn FnMut(),
    ) -> Result<(Vec<f32>, Progress)> {
        if temperature == 0.0 {
            return self.mean(sweeps, done);
        }
        let prior = self.prior(temperature);
        let side = self.seen.side;
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(seed);
        let mut state = self.start()?;
        burn_in(&mut state, &prior, sweeps, &mut rng, done);
        let mut out = vec![0.0; side * side];
        state.surface(&mut out);
        let progress = Progress {
            iterations: sweeps,
            residual: 0.0, // a sampler does not come to rest
        };
        Ok((out, progress))
    }

    fn deviation(&mut self, draws: Draws, seed: u64) -> Result<Vec<f32>> {
        let (mean, _) = self.mean(draws.iterations, &mut || {})?;
        let prior = self.prior(1.0);
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(seed);
        let mut state = self.start()?;
        burn_in(&mut state, &prior, draws.iterations, &mut rng, &mut || {});
        let (mut squares, mut sample) = (vec![0.0; mean.len()], vec![0.0; mean.len()]);
        for _ in 0..draws.count {
            (0..APART).for_each(|_| state.sample(&prior, &mut rng));
            state.surface(&mut sample);
            for (square, (z, mean)) in squares.iter_mut().zip(sample.iter().zip(&mean)) {
                *square += (z - mean) * (z - mean);
            }
        }
        let share = 1.0 / draws.count as f32;
        Ok(squares
            .iter()
            .map(|square| (share * square).sqrt())
            .collect())
    }

    fn refused(&self) -> usize {
        self.refused
    }
}

/// Relaxes, then samples.
fn burn_in(
    state: &mut Ak96,
    prior: &Prior,
    sweeps: usize,
    rng: &mut Xoshiro128PlusPlus,
    done: &mut dyn FnMut(),
) {
    for sweep in 0..sweeps {
        if sweep < sweeps / RELAXED {
            state.relax(prior);
        } else {
            state.sample(prior, rng);
        }
        done();
    }
}

/// Root mean square change relative to the surface's own relief.
fn change(before: &[f32], after: &[f32]) -> f32 {
    let mean = after.iter().sum::<f32>() / after.len() as f32;
    let sum = |f: &dyn Fn(usize) -> f32| (0..after.len()).map(|i| f(i) * f(i)).sum::<f32>();
    let relief = sum(&|i| after[i] - mean);
    match relief > 0.0 {
        true => (sum(&|i| after[i] - before[i]) / relief).sqrt(),
        false => 0.0,
    }
}
