//! The reconstruction that a mapper keeps up to date: the posterior mean everywhere, how
//! far it may be off, and one surface it may be.
//!
//! After each sweep the fused elevations of the measured cells are the data, the
//! roughness of the whole map is the prior, and a few iterations continue from the last
//! solution. When the window has moved the solution is shifted along first; what the
//! shift gets wrong the iterations repair, since the residual is worked out anew.
//!
//! The elevation layer stays what was measured; the mean is a layer of its own.

use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;
use rugosa_fractal::pyramid::{Datum, Finest, Levels, Posterior, Prior, Progress};
use rugosa_fractal::roughness::Roughness;
use rugosa_grid::{Cell, Window, math};
use rugosa_terrain::ElevationGrid;

/// Roughness of ground of which nothing is known: half a cell's relief at one cell.
const UNKNOWN_HURST: f32 = 0.5;
const UNKNOWN_SIGMA: f32 = 0.25;

/// Seed of the realisation's coarser levels. It is the same for every sweep, so that
/// ground of which nothing new is known does not flicker.
const SEED: u64 = 0x7275_676f_7361;

/// The solver in lent memory, which holds mean and spread between two sweeps; no memory
/// where no reconstruction is kept.
pub(crate) struct Reconstruction<'m> {
    posterior: Option<Posterior<'m>>,
    /// lowest cell of the window that the solution belongs to
    origin: Option<Cell>,
    /// variance of the finest level \[m²\]
    finest: f32,
}

impl<'m> Reconstruction<'m> {
    /// Without a reconstruction where the memory is too small.
    pub(crate) fn new(side: usize, solver: &'m mut [f32]) -> Self {
        Reconstruction {
            posterior: Posterior::new(side, solver).ok(),
            origin: None,
            finest: 0.0,
        }
    }

    /// Brings mean and spread up to date with at most `iterations`; `None` where nothing is kept
    /// or nothing measured.
    pub(crate) fn update(
        &mut self,
        grid: &ElevationGrid,
        roughness: Option<&Roughness>,
        iterations: usize,
    ) -> Option<Progress> {
        let posterior = self.posterior.as_mut()?;
        if iterations == 0 {
            return None;
        }
        let window = *grid.window();
        let prior = prior(grid, roughness)?;
        if let Some(old) = self.origin.filter(|&old| old != window.origin()) {
            shift(posterior, old, window.origin());
        }
        let data = |i| datum(grid, place(&window, i));
        if posterior.observe(&prior, data).used == 0 {
            posterior.restart();
            self.origin = None;
            return None;
        }
        let progress = posterior.step(iterations);
        posterior.spread(&mut Xoshiro128PlusPlus::seed_from_u64(SEED));
        posterior.mean_in_place(&prior, data);
        self.finest = prior.variance(0, 0, 0);
        self.origin = Some(window.origin());
        Some(progress)
    }

    /// The mean at a cell \[m\]; `None` where there is none.
    pub(crate) fn mean(&self, window: &Window, cell: Cell) -> Option<f32> {
        let (posterior, i) = self.at(window, cell)?;
        Some(posterior.heights()[i])
    }

    /// Standard deviation about the mean at a cell \[m\].
    pub(crate) fn deviation(&self, grid: &ElevationGrid, cell: Cell) -> Option<f32> {
        let (posterior, i) = self.at(grid.window(), cell)?;
        Some(posterior.deviation_at(i, self.finest(grid, cell)))
    }

    /// A surface drawn from the posterior at a cell \[m\]. Detail of the size of a cell
    /// belongs to the place, whatever the window.
    pub(crate) fn realisation(&self, grid: &ElevationGrid, cell: Cell) -> Option<f32> {
        let (posterior, i) = self.at(grid.window(), cell)?;
        let place = u64::from(cell.x as u32) << 32 | u64::from(cell.y as u32);
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(place);
        let deviation = posterior.draw_at(i, self.finest(grid, cell), &mut rng);
        Some(posterior.heights()[i] + deviation)
    }

    fn finest(&self, grid: &ElevationGrid, cell: Cell) -> Finest {
        Finest {
            variance: self.finest,
            datum: datum(grid, cell),
        }
    }

    /// The solver and the cell's place in it; `None` where nothing is known of it.
    fn at(&self, window: &Window, cell: Cell) -> Option<(&Posterior<'m>, usize)> {
        let (origin, posterior) = (self.origin?, self.posterior.as_ref()?);
        let (x, y) = (cell.x - origin.x, cell.y - origin.y);
        let side = window.side() as i32;
        let inside = (0..side).contains(&x) && (0..side).contains(&y) && window.contains(cell);
        inside.then(|| (posterior, (y * side + x) as usize))
    }
}

/// Cell `i` of the window, row by row.
fn place(window: &Window, i: usize) -> Cell {
    let side = window.side();
    window.origin().offset((i % side) as i32, (i / side) as i32)
}

/// What is measured in a cell.
fn datum(grid: &ElevationGrid, cell: Cell) -> Option<Datum> {
    grid.ground(cell).map(|ground| Datum {
        height: ground.elevation,
        variance: ground.variance,
    })
}

/// The prior of ground of this roughness, or of ground of which nothing is known.
///
/// ```
/// use rugosa::{Config, Mapper, Planes33, reconstruct::prior};
/// use rugosa_fractal::roughness::Roughness;
/// # let mut planes = Box::new(Planes33::new());
/// let mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
/// let known = Roughness { hurst: 0.8, sigma: 0.2, ..Roughness::default() };
/// let levels = prior(mapper.grid(), Some(&known)).unwrap();
/// // E Δz² = σ² d^2H at 4 cells of 0.1 m, to 3 %
/// let expected = 0.2f32.powi(2) * 0.4f32.powf(1.6);
/// assert!((levels.structure(4).unwrap() / expected - 1.0).abs() < 0.03);
/// ```
pub fn prior(grid: &ElevationGrid, roughness: Option<&Roughness>) -> Option<Levels> {
    let (side, resolution) = (grid.window().side(), grid.lattice().resolution());
    let known = roughness.map(|r| {
        let hurst = r.hurst.clamp(0.05, 0.95);
        (hurst, r.sigma * math::powf(resolution, hurst))
    });
    let (hurst, sigma) = known.unwrap_or((UNKNOWN_HURST, UNKNOWN_SIGMA * resolution));
    Levels::power_law(side, hurst, sigma).ok()
}

fn shift(posterior: &mut Posterior, old: Cell, new: Cell) {
    let side = posterior.side() as i32;
    let (x, y) = (new.x.wrapping_sub(old.x), new.y.wrapping_sub(old.y));
    if x.abs().max(y.abs()) < side {
        posterior.shift(x, y);
    } else {
        posterior.restart();
    }
}
