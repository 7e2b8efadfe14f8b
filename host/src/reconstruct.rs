//! From points or a raster with holes to a full raster: the grid, the data in it, the
//! prior, the solve.
//!
//! A grid of any size is reconstructed as the corner of the next square of 2^k + 1 cells;
//! the cells beyond are unknown. Points belong to the nearest node; several at one node
//! are averaged, and their variance with them.

use crate::error::{Failure, Result};
use crate::io::{Points, Raster};
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;
use rugosa_fractal::pyramid::{
    Datum, Draws, Field, Intake, Levels, MAX_SIDE, MIN_SIDE, Posterior, Prior, Progress,
};
use rugosa_fractal::roughness::irregular::{
    self as roughness, Bin, Estimate, Noise, Options, estimate_points, estimate_raster,
};

/// Nodes of the result: node (row i, column j) at origin + (j, i) · resolution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// x, y of node (0, 0) \[m\]
    pub origin: [f64; 2],
    /// distance of nodes \[m\]
    pub resolution: f64,
    /// rows, y ascending
    pub rows: usize,
    /// columns, x ascending
    pub columns: usize,
}

impl Grid {
    /// The grid that covers the points.
    pub fn covering(points: &Points, resolution: f64) -> Self {
        let (low, high) = points.bounds();
        let nodes = |axis: usize| ((high[axis] - low[axis]) / resolution).round() as usize + 1;
        Grid {
            origin: [low[0], low[1]],
            resolution,
            rows: nodes(1),
            columns: nodes(0),
        }
    }

    /// Side of the pyramid that holds the grid.
    ///
    /// # Errors
    /// More than [`MAX_SIDE`] rows or columns, or none.
    pub fn side(&self) -> Result<usize> {
        let most = self.rows.max(self.columns);
        if self.rows == 0 || self.columns == 0 || most > MAX_SIDE {
            return Err(Failure::input(format_args!(
                "a grid of {} rows and {} columns; between 1 and {MAX_SIDE} are possible",
                self.rows, self.columns
            )));
        }
        Ok((most.saturating_sub(1).next_power_of_two() + 1).max(MIN_SIDE))
    }

    /// A raster of this grid.
    pub fn raster(&self, values: Vec<f32>) -> Raster {
        Raster::square(
            self.rows,
            self.columns,
            self.resolution,
            self.origin,
            values,
        )
    }

    fn node(&self, point: &[f64; 3]) -> Option<(usize, usize)> {
        let at = |axis: usize, count: usize| {
            let node = ((point[axis] - self.origin[axis]) / self.resolution).round();
            (node >= 0.0 && node < count as f64).then_some(node as usize)
        };
        Some((at(1, self.rows)?, at(0, self.columns)?))
    }
}

/// The data in the square of the pyramid, and what became of the points.
#[derive(Clone, Debug)]
pub struct Seen {
    /// the square's side
    pub side: usize,
    /// per cell, row by row
    pub data: Vec<Option<Datum>>,
    /// cells with a datum
    pub known: usize,
    /// points outside the grid
    pub outside: usize,
    /// points that share their node with an earlier one
    pub shared: usize,
}

impl Seen {
    /// Sorts points into the grid. Heights are taken relative to `level`, the mean.
    ///
    /// # Errors
    /// A grid that is too large; no point inside.
    pub fn new(points: &[[f64; 3]], grid: &Grid, noise: f64) -> Result<(Seen, f64)> {
        let side = grid.side()?;
        let level = points.iter().map(|p| p[2]).sum::<f64>() / points.len().max(1) as f64;
        let mut sums = vec![(0.0, 0u32); side * side];
        let mut outside = 0;
        for point in points {
            match grid.node(point) {
                Some((row, column)) => {
                    let (sum, count) = &mut sums[row * side + column];
                    *sum += point[2] - level;
                    *count += 1;
                }
                None => outside += 1,
            }
        }
        let mean = |&(sum, count): &(f64, u32)| {
            (count > 0).then(|| Datum {
                height: (sum / f64::from(count)) as f32,
                variance: (noise * noise / f64::from(count)) as f32,
            })
        };
        let data: Vec<_> = sums.iter().map(mean).collect();
        let known = data.iter().flatten().count();
        if known == 0 {
            return Err(Failure::input(format_args!(
                "none of the {outside} points lies on the grid"
            )));
        }
        let shared = points.len() - outside - known;
        let seen = Seen {
            side,
            data,
            known,
            outside,
            shared,
        };
        Ok((seen, level))
    }
}

/// Hurst exponent, σ at 1 m and sensor noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Roughness {
    /// H
    pub hurst: f64,
    /// standard deviation of an elevation difference at 1 m \[m\]
    pub sigma: f64,
    /// standard deviation of the noise of a height \[m\]
    pub noise: f64,
}

/// Hurst exponents of an estimate are kept this far from 0 and 1.
const MARGIN: f64 = 0.02;

impl Roughness {
    /// What is not given is estimated from the points.
    ///
    /// # Errors
    /// Points whose structure function is not a power law.
    pub fn given_or_estimated(
        (hurst, sigma, noise): (Option<f64>, Option<f64>, Option<f64>),
        estimate: impl FnOnce() -> Estimate,
    ) -> Result<Self> {
        if let (Some(hurst), Some(sigma)) = (hurst, sigma) {
            let noise = noise.unwrap_or(0.0);
            return Ok(Roughness {
                hurst,
                sigma,
                noise,
            });
        }
        let estimate = estimate();
        let noise = noise.unwrap_or(estimate.noise_std);
        let found = match (hurst, &estimate.law) {
            (Some(hurst), _) => hurst,
            (None, Ok(law)) => law.hurst.clamp(MARGIN, 1.0 - MARGIN),
            (None, Err(reason)) => {
                return Err(Failure::input(format_args!(
                    "the points show no power law ({reason:?}): give --hurst and --sigma"
                )));
            }
        };
        let sigma = match (sigma, hurst, &estimate.law) {
            (Some(sigma), ..) => sigma,
            (None, None, Ok(law)) => law.sigma,
            _ => level(&estimate.bins, found, noise)?,
        };
        Ok(Roughness {
            hurst: found,
            sigma,
            noise,
        })
    }

    /// σ over one cell of `resolution`.
    fn per_cell(&self, resolution: f64) -> f32 {
        (self.sigma * resolution.powf(self.hurst)) as f32
    }

    /// Levels of a power law.
    pub fn levels(&self, side: usize, resolution: f64) -> Result<Levels> {
        let per_cell = self.per_cell(resolution);
        Levels::power_law(side, self.hurst as f32, per_cell).map_err(Failure::input)
    }

    /// Levels of the structure function in `bins`; H extrapolates beyond them.
    pub fn measured(&self, bins: &[Bin], side: usize, resolution: f64) -> Result<Levels> {
        let known: Vec<(f64, f64)> = bins
            .iter()
            .map(|b| (b.lag, b.rms_dz * b.rms_dz - 2.0 * self.noise * self.noise))
            .filter(|&(_, square)| square > 0.0)
            .collect();
        if known.len() < 2 {
            return Err(Failure::input(
                "fewer than two lags rise above the noise: --prior measured is not possible",
            ));
        }
        let at = |cells: f32| self.square(&known, f64::from(cells) * resolution) as f32;
        Levels::measured(side, at).map_err(Failure::input)
    }

    /// S² \[m²\] at a distance: log–log interpolation, H beyond the ends.
    fn square(&self, known: &[(f64, f64)], distance: f64) -> f64 {
        let after = known.partition_point(|k| k.0 < distance);
        let power = |k: (f64, f64)| k.1 * (distance / k.0).powf(2.0 * self.hurst);
        match (after.checked_sub(1).map(|i| known[i]), known.get(after)) {
            (Some(a), Some(&b)) => {
                let part = (distance / a.0).ln() / (b.0 / a.0).ln();
                a.1 * (b.1 / a.1).powf(part)
            }
            (Some(a), None) => power(a),
            (None, _) => power(known[0]),
        }
    }
}

/// σ at 1 m of bins whose Hurst exponent is known.
fn level(bins: &[Bin], hurst: f64, noise: f64) -> Result<f64> {
    let (mut above, mut below) = (0.0, 0.0);
    for bin in bins.iter().filter(|b| b.pairs > 0) {
        above += bin.pairs as f64 * (bin.rms_dz * bin.rms_dz - 2.0 * noise * noise);
        below += bin.pairs as f64 * bin.lag.powf(2.0 * hurst);
    }
    if above > 0.0 {
        return Ok((above / below).sqrt());
    }
    Err(Failure::input(
        "the points do not rise above the noise: give --sigma",
    ))
}

/// Longest lag of an estimate, in mean distances of neighbours: more would cost more
/// pairs than they are worth.
const LONGEST: f64 = 30.0;

/// Structure function and power law of points.
pub fn estimate(points: &[[f64; 3]], noise: Option<f64>) -> Estimate {
    let area = area(points);
    let spacing = (area / points.len().max(1) as f64).sqrt();
    let longest = (0.1 * area.sqrt()).min(LONGEST * spacing);
    estimate_points(points, &options(noise, longest))
}

/// Structure function and power law of a raster.
pub fn estimate_of_raster(raster: &Raster, noise: Option<f64>) -> Estimate {
    let spacing = [raster.spacing_x, raster.spacing_y];
    let coarsest = spacing[0].max(spacing[1]);
    let longest = 0.1 * raster.rows.min(raster.columns) as f64 * coarsest;
    let values = roughness::Raster {
        values: &raster.values,
        columns: raster.columns,
        spacing,
    };
    let longest = longest.clamp(8.0 * coarsest, LONGEST * coarsest);
    estimate_raster(&values, &options(noise, longest))
}

fn options(noise: Option<f64>, longest: f64) -> Options {
    Options {
        noise: noise.map_or(Noise::Fitted, Noise::Known),
        max_lag: Some(longest),
        ..Options::default()
    }
}

/// Area of the points' bounding box \[m²\].
fn area(points: &[[f64; 3]]) -> f64 {
    let extent = |axis: usize| {
        let (low, high) = points.iter().fold((f64::MAX, f64::MIN), |(low, high), p| {
            (low.min(p[axis]), high.max(p[axis]))
        });
        (high - low).max(0.0)
    };
    extent(0) * extent(1)
}

/// A map of roughness: tiles of the pyramid's square.
#[derive(Clone, Debug)]
pub struct Tiles {
    levels: Vec<Levels>,
    columns: usize,
    edge: usize,
    /// tiles that had enough points for a roughness of their own
    pub local: usize,
}

/// Tiles along an edge of the square, and the least number of points and greatest
/// standard error of H of a tile's own roughness.
const TILES: usize = 8;
const LEAST_POINTS: usize = 300;
const GREATEST_ERROR: f64 = 0.15;

impl Tiles {
    /// Roughness of each tile from the points in a square of twice its edge; where they
    /// are few or show no power law, the roughness of the whole.
    pub fn new(points: &[[f64; 3]], grid: &Grid, side: usize, whole: &Roughness) -> Result<Self> {
        let edge = side.div_ceil(TILES);
        let mut tiles = Tiles {
            levels: Vec::new(),
            columns: TILES,
            edge,
            local: 0,
        };
        for tile in 0..TILES * TILES {
            let centre = |axis: usize, i: usize| {
                grid.origin[axis] + (i as f64 + 0.5) * edge as f64 * grid.resolution
            };
            let middle = [centre(0, tile % TILES), centre(1, tile / TILES)];
            let reach = edge as f64 * grid.resolution;
            let near: Vec<_> = points
                .iter()
                .filter(|p| (0..2).all(|a| (p[a] - middle[a]).abs() <= reach))
                .copied()
                .collect();
            let own = local(&near, whole.noise);
            tiles.local += usize::from(own.is_some());
            tiles
                .levels
                .push(own.unwrap_or(*whole).levels(side, grid.resolution)?);
        }
        Ok(tiles)
    }

    /// The prior.
    pub fn field(&self) -> Result<Field<'_>> {
        Field::new(&self.levels, self.columns, self.edge).map_err(Failure::input)
    }
}

fn local(points: &[[f64; 3]], noise: f64) -> Option<Roughness> {
    if points.len() < LEAST_POINTS {
        return None;
    }
    let law = estimate(points, Some(noise)).law.ok()?;
    (law.standard_error < GREATEST_ERROR && law.sigma > 0.0).then(|| Roughness {
        hurst: law.hurst.clamp(MARGIN, 1.0 - MARGIN),
        sigma: law.sigma,
        noise,
    })
}

/// A way from the data to a surface.
pub trait Solve {
    /// The surface of least error, of the whole square. `done` hears of every iteration.
    fn mean(&mut self, iterations: usize, done: &mut dyn FnMut()) -> Result<(Vec<f32>, Progress)>;

    /// A draw at a temperature, from a seed.
    fn realisation(
        &mut self,
        draw: (f32, u64),
        iterations: usize,
        done: &mut dyn FnMut(),
    ) -> Result<(Vec<f32>, Progress)>;

    /// Standard deviation from `draws`.
    fn deviation(&mut self, draws: Draws, seed: u64) -> Result<Vec<f32>>;

    /// Data that were refused.
    fn refused(&self) -> usize;
}

/// The pyramid with its memory.
pub struct Solver<'a, P> {
    seen: &'a Seen,
    prior: &'a P,
    memory: Vec<f32>,
    intake: Intake,
}

impl<'a, P: Prior> Solver<'a, P> {
    /// A solver for data under a prior.
    pub fn new(seen: &'a Seen, prior: &'a P) -> Result<Self> {
        let need = Posterior::need(seen.side).map_err(Failure::input)?;
        Ok(Solver {
            seen,
            prior,
            memory: vec![0.0; need],
            intake: Intake::default(),
        })
    }

    fn posterior(&mut self) -> Result<Posterior<'_>> {
        Posterior::new(self.seen.side, &mut self.memory).map_err(Failure::input)
    }
}

impl<P: Prior> Solve for Solver<'_, P> {
    fn mean(&mut self, iterations: usize, done: &mut dyn FnMut()) -> Result<(Vec<f32>, Progress)> {
        let (seen, prior) = (self.seen, self.prior);
        let data = |i: usize| seen.data[i];
        let mut posterior = self.posterior()?;
        let intake = posterior.observe(prior, data);
        let progress = steps(&mut posterior, iterations, done);
        let mut out = vec![0.0; seen.side * seen.side];
        posterior.mean(prior, data, &mut out);
        self.intake = intake;
        Ok((out, progress))
    }

    fn realisation(
        &mut self,
        (temperature, seed): (f32, u64),
        iterations: usize,
        done: &mut dyn FnMut(),
    ) -> Result<(Vec<f32>, Progress)> {
        let (seen, prior) = (self.seen, self.prior);
        let data = |i: usize| seen.data[i];
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(seed);
        let mut posterior = self.posterior()?;
        let intake = posterior.draw((prior, data), temperature, &mut rng);
        let progress = steps(&mut posterior, iterations, done);
        let mut out = vec![0.0; seen.side * seen.side];
        posterior.realisation((prior, data), temperature, &mut rng, &mut out);
        self.intake = intake;
        Ok((out, progress))
    }

    fn deviation(&mut self, draws: Draws, seed: u64) -> Result<Vec<f32>> {
        let (seen, prior) = (self.seen, self.prior);
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(seed);
        let mut out = vec![0.0; seen.side * seen.side];
        let mut posterior = self.posterior()?;
        posterior.standard_deviation((prior, |i: usize| seen.data[i]), draws, &mut rng, &mut out);
        Ok(out)
    }

    fn refused(&self) -> usize {
        self.intake.refused
    }
}

fn steps(posterior: &mut Posterior, iterations: usize, done: &mut dyn FnMut()) -> Progress {
    let mut total = posterior.step(0);
    for _ in 0..iterations {
        let progress = posterior.step(1);
        total.residual = progress.residual;
        if progress.iterations == 0 {
            break;
        }
        total.iterations += 1;
        done();
    }
    total
}

/// Cuts the grid out of the square and adds the level.
pub fn cut(square: &[f32], side: usize, grid: &Grid, level: f64) -> Raster {
    let rows = square.chunks_exact(side).take(grid.rows);
    let cells = rows.flat_map(|row| &row[..grid.columns]);
    grid.raster(cells.map(|&z| (f64::from(z) + level) as f32).collect())
}
