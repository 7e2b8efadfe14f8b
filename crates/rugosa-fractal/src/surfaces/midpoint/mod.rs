//! Midpoint interpolation: doubles a map's resolution, again and again, with the
//! roughness that the terrain has.
//!
//! One doubling fills the centre of every square of known nodes (square step), then the
//! middle of every edge (diamond step). A new node is the blend of its neighbours
//! ([`stencil`]) plus noise of the blend's residual variance σ² h^{2H} v, h the new
//! spacing \[m\]. With the right variance and weights the result has the structure function
//! V(d) = σ² d^{2H} of the model; without noise it is the kriged mean, too smooth but
//! with the least error.
//!
//! Nodes that are known (finite) are never written; unknown ones are NaN. So a measured
//! node in the middle of a square stays what it is and serves as a neighbour of the next
//! steps. A node none of whose four nearest neighbours is known stays unknown, and is
//! counted.
//!
//! Accuracy: the structure function of densified exact statistics is within 1 % of the
//! model after three doublings (3 % at H 0.2): `tests/surfaces_midpoint.rs`,
//! `kriged_doublings_keep_the_structure_function`. The four-neighbour stencils of the
//! papers are off by 4–36 % (tables in `docs/surfaces.md`).
//!
//! Cost: 16 multiplications per new node (4 with the four-neighbour stencils).
//!
//! Not for: least error (noise doubles the squared error of the mean), terrain
//! whose H changes with scale unless the noise is [`calibrated`](Calibration).
//!
//! Source: Fang et al. 2004 eqs 4–5, Yokoya et al. 1989, the local parameters of "adaptive
//! local stationary fractal subdivision" (ISPRS Archives XXXI-B4, 1996).

mod calibration;
pub mod stencil;

pub use calibration::{Calibration, Detail};
pub use stencil::{Blend, Cache, Distance, Stencil, Step};

use super::{Shape, SurfaceError, check_length};
use rugosa_grid::math;
use stencil::{HORIZONTAL, VERTICAL};

/// Roughness at a place: V(d) = σ² d^{2H}, d in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Roughness {
    /// Hurst exponent, in (0, 1)
    pub hurst: f32,
    /// standard deviation of an elevation difference at 1 m \[m\]
    pub sigma: f32,
}

/// What is added to the blend.
#[derive(Clone, Copy, Debug)]
pub enum Noise {
    /// nothing: the kriged mean
    None,
    /// the residual of fractional Brownian terrain with the local (H, σ)
    Fbm,
    /// the residuals measured on the map itself, extrapolated to the new scale
    Calibrated(Calibration),
}

/// How a map is densified.
///
/// ```
/// use rugosa_fractal::surfaces::{Shape, midpoint::{Blend, Midpoint, Noise, Roughness, Stencil}};
/// // a slope of 1 m per column, known on every second node
/// let known = |i: usize| i / 5 % 2 == 0 && i % 5 % 2 == 0;
/// let mut grid: [f32; 25] =
///     core::array::from_fn(|i| if known(i) { (i % 5) as f32 } else { f32::NAN });
/// let settings = Midpoint {
///     stencil: Stencil::Four,
///     noise: Noise::None,
///     roughness: &|_, _| Roughness { hurst: 0.8, sigma: 0.1 },
///     resolution: 1.0,
/// };
/// let (mut cache, shape) = ([Blend::default(); 64], Shape::new(5, 5));
/// let counts = settings.densify(&mut grid, shape, 1, (&mut || 0.0, &mut cache)).unwrap();
/// assert_eq!((counts.filled, counts.unknown), (16, 0));
/// assert!((0..25).all(|i| (grid[i] - (i % 5) as f32).abs() < 1e-6));
/// ```
pub struct Midpoint<'a> {
    /// how midpoints are blended
    pub stencil: Stencil,
    /// what is added
    pub noise: Noise,
    /// local roughness at (row, column) of the fine grid; a constant closure for a
    /// stationary map
    pub roughness: &'a dyn Fn(usize, usize) -> Roughness,
    /// distance of two nodes of the fine grid \[m\]
    pub resolution: f32,
}

/// What happened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// nodes that were filled
    pub filled: usize,
    /// nodes that stay unknown because none of their nearest neighbours is known
    pub unknown: usize,
}

impl Midpoint<'_> {
    /// Fills the unknown (NaN) nodes of `grid`, whose nodes at multiples of 2^`levels`
    /// (both ways) carry the coarse map. `normal` draws standard normal numbers (not called
    /// without noise), `cache` is working memory: 64 entries for one H; roughness that
    /// changes should do so by regions, each new H asks for a few new solves.
    ///
    /// # Errors
    /// Sides that are not a multiple of 2^`levels` plus one; a slice too short; roughness
    /// out of range at a node that has to be filled.
    pub fn densify(
        &self,
        grid: &mut [f32],
        shape: Shape,
        levels: u32,
        (normal, cache): (&mut dyn FnMut() -> f32, &mut [Blend]),
    ) -> Result<Counts, SurfaceError> {
        check_length(shape, grid.len())?;
        let stride = 1usize.checked_shl(levels).unwrap_or(0);
        shape.coarser(stride).ok_or(SurfaceError::Size(shape))?;
        let mut pass = Pass {
            settings: self,
            map: Map { grid, shape },
            normal,
            cache: Cache::new(cache, self.stencil),
            counts: Counts::default(),
        };
        for level in 1..=levels {
            let half = stride >> level;
            pass.step(Step::Square, half, level)?;
            pass.step(Step::Diamond, half, level)?;
        }
        Ok(pass.counts)
    }

    /// Standard deviation of the noise \[m\].
    fn deviation(&self, step: Step, level: u32, variance: f32, local: (Roughness, f32)) -> f32 {
        match self.noise {
            Noise::None => 0.0,
            Noise::Fbm => {
                let (roughness, spacing) = local;
                roughness.sigma * math::powf(spacing, roughness.hurst) * math::sqrt(variance)
            }
            Noise::Calibrated(calibration) => calibration.of(step).deviation(level),
        }
    }
}

/// The grid being filled.
struct Map<'a> {
    grid: &'a mut [f32],
    shape: Shape,
}

impl Map<'_> {
    fn neighbours(&self, step: Step, at: (usize, usize), half: usize) -> ([f32; 16], u16) {
        neighbours(self.grid, self.shape, step, (at, half))
    }
}

/// Heights of the neighbours of a midpoint and which of them are known.
fn neighbours(
    grid: &[f32],
    shape: Shape,
    step: Step,
    ((row, column), half): ((usize, usize), usize),
) -> ([f32; 16], u16) {
    let (mut heights, mut known) = ([0.0; 16], 0);
    for (i, &(down, right)) in step.offsets().iter().enumerate() {
        let r = row.wrapping_add_signed(isize::from(down) * half as isize);
        let c = column.wrapping_add_signed(isize::from(right) * half as isize);
        if r < shape.rows && c < shape.columns && grid[r * shape.columns + c].is_finite() {
            heights[i] = grid[r * shape.columns + c];
            known |= 1 << i;
        }
    }
    (heights, known)
}

/// The papers keep borders one-dimensional, so that maps which share a border match.
fn along_the_border(shape: Shape, (row, column): (usize, usize), known: u16) -> u16 {
    if row == 0 || row == shape.rows - 1 {
        known & HORIZONTAL
    } else if column == 0 || column == shape.columns - 1 {
        known & VERTICAL
    } else {
        known
    }
}

/// Nodes of one step, as (row, column), on a lattice of spacing `half`.
fn targets(shape: Shape, step: Step, half: usize) -> impl Iterator<Item = (usize, usize)> {
    let first = move |row: usize| match step {
        Step::Square => half,
        Step::Diamond => ((row / half + 1) % 2) * half,
    };
    let (start, by) = match step {
        Step::Square => (half, 2 * half),
        Step::Diamond => (0, half),
    };
    (start..shape.rows).step_by(by).flat_map(move |row| {
        (first(row)..shape.columns)
            .step_by(2 * half)
            .map(move |c| (row, c))
    })
}

struct Pass<'a, 'b> {
    settings: &'a Midpoint<'a>,
    map: Map<'b>,
    normal: &'b mut dyn FnMut() -> f32,
    cache: Cache<'b>,
    counts: Counts,
}

impl Pass<'_, '_> {
    fn step(&mut self, step: Step, half: usize, level: u32) -> Result<(), SurfaceError> {
        let shape = self.map.shape;
        for at in targets(shape, step, half) {
            let index = at.0 * shape.columns + at.1;
            if self.map.grid[index].is_finite() {
                continue;
            }
            match self.midpoint(step, at, (half, level))? {
                Some(height) => {
                    self.map.grid[index] = height;
                    self.counts.filled += 1;
                }
                None => self.counts.unknown += 1,
            }
        }
        Ok(())
    }

    fn midpoint(
        &mut self,
        step: Step,
        at: (usize, usize),
        (half, level): (usize, u32),
    ) -> Result<Option<f32>, SurfaceError> {
        let local = checked((self.settings.roughness)(at.0, at.1))?;
        let (heights, mut known) = self.map.neighbours(step, at, half);
        if step == Step::Diamond && self.settings.stencil != Stencil::Kriged16 {
            known = along_the_border(self.map.shape, at, known);
        }
        let Some(blend) = self.cache.blend(step, known, local.hurst) else {
            return Ok(None);
        };
        let mean = weighted(&blend.weights, &heights);
        let spacing = half as f32 * self.settings.resolution;
        let deviation = self
            .settings
            .deviation(step, level, blend.variance, (local, spacing));
        Ok(Some(if deviation > 0.0 {
            mean + deviation * (self.normal)()
        } else {
            mean
        }))
    }
}

/// Σ w (z − z₀) + z₀ with z₀ one of the known heights: keeps the digits of small relief on
/// high ground.
fn weighted(weights: &[f32; 16], heights: &[f32; 16]) -> f32 {
    let base = (0..16)
        .find(|&i| weights[i] != 0.0)
        .map_or(0.0, |i| heights[i]);
    let mut sum = 0.0;
    for i in 0..16 {
        if weights[i] != 0.0 {
            sum += weights[i] * (heights[i] - base);
        }
    }
    base + sum
}

/// H in (0, 1); σ finite and not negative.
fn checked(roughness: Roughness) -> Result<Roughness, SurfaceError> {
    let Roughness { hurst, sigma } = roughness;
    if !(hurst > 0.0 && hurst < 1.0) {
        return Err(SurfaceError::Roughness(hurst));
    }
    if !(sigma >= 0.0 && sigma.is_finite()) {
        return Err(SurfaceError::Roughness(sigma));
    }
    Ok(roughness)
}
