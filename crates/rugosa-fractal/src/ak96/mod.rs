//! The reconstruction of 1996, as published: the reference the pyramid is measured by.
//!
//! Arakawa & Krotkov (1996), "Fractal modeling of natural terrain: analysis and surface
//! reconstruction with range data". The surface is a sum of layers, u = Σ_l I_l v_l, layer
//! l on every 2^l-th node, I_l bilinear interpolation (the *relative* multiresolution
//! representation). Its energy is
//!
//! ```text
//! E = ½ Σ c_i (d_i − u_i)² + Σ_l E_p(v_l) / T_l
//! ```
//!
//! with E_p a blend of membrane ½ Σ (v_x² + v_y²) and thin plate ½ Σ (v_xx² + 2 v_xy² +
//! v_yy²). Gauss–Seidel relaxation finds the minimum, the smooth surface of T = 0; the
//! Gibbs sampler draws every node from its conditional distribution N(u⁺, 1/a) instead,
//! u⁺ the Gauss–Seidel value and a the diagonal of the energy's matrix.
//!
//! Two ways to make the result as rough as the ground ([`Prior`]): one temperature for
//! all layers, the energy of layer l + 1 weighted by 2^{2(m + D − 4)} times that of layer
//! l (m = 1 membrane, 2 thin plate), found by trial (eq. 11); or a temperature per layer
//! by analogy with successive random addition, T_l = T_0 2^{2(3 − D) l} (eqs 12–13).
//!
//! Where the paper leaves a choice, this is it: membrane and thin plate weigh the same on
//! the finest layer; T_0 = κ S²(1), with S²(1) the variance of an elevation difference
//! over one cell (the temperatures of the paper's Table 4 are proportional to S²(1); their
//! unit is not stated). κ = [`KAPPA`] is a starting point, not a result: `docs/results.md` has
//! the temperature and the κ at which D comes out right, by trial.
//!
//! Cost: about 100 additions and multiplications per node and sweep, and it takes a
//! hundred sweeps and more: use [`crate::pyramid`] instead. Tested: that relaxation ends
//! in the minimum of the energy as written above, and that sampling has the conditional
//! variance. What it reaches beside the paper: `docs/results.md`.

mod terms;

use crate::pyramid::{Datum, Error};
use crate::synthesis::normal;
use rand_core::Rng;
use rugosa_grid::math;

/// T_0 over S²(1): not tuned. Eq. 11 finds a temperature by trial.
pub const KAPPA: f32 = 1.0;

/// Most layers.
const MAX_LAYERS: usize = 12;

/// Weights over temperatures of the layers, finest first.
///
/// ```
/// use rugosa_fractal::ak96::{Ak96, Prior};
/// use rugosa_fractal::pyramid::Datum;
/// // one cell 1 m high with a variance of 1 m² among flat ground; dimension 2.3
/// let datum = |i| Datum { height: if i == 144 { 1.0 } else { 0.0 }, variance: 1.0 };
/// let peak = |prior: Prior| {
///     let (mut memory, mut z) = (vec![0.0; Ak96::need(17).unwrap()], [0.0; 17 * 17]);
///     let mut ak96 = Ak96::new(17, &mut memory).unwrap();
///     ak96.observe(|i| Some(datum(i)), 0.0);
///     (0..50).for_each(|_| ak96.relax(&prior));
///     ak96.surface(&mut z);
///     z[144]
/// };
/// // a hot prior lets the surface follow its data, a cold one smooths
/// assert!(peak(Prior::empirical(2.3, 100.0)) > 0.9 && peak(Prior::empirical(2.3, 0.01)) < 0.1);
/// assert!(peak(Prior::from_dimension(2.3, 100.0)) > 0.9);
/// assert!(peak(Prior::from_dimension(2.3, 0.01)) < 0.1);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    membrane: [f32; MAX_LAYERS],
    plate: [f32; MAX_LAYERS],
}

impl Prior {
    /// One temperature, layers weighted by 2^{2(m + D − 4) l} (eq. 11).
    pub fn empirical(dimension: f32, temperature: f32) -> Self {
        let weight =
            |m: f32, l: usize| math::exp2(2.0 * (m + dimension - 4.0) * l as f32) / temperature;
        Prior {
            membrane: core::array::from_fn(|l| 0.5 * weight(1.0, l)),
            plate: core::array::from_fn(|l| 0.5 * weight(2.0, l)),
        }
    }

    /// Temperatures from the dimension, T_l = T_0 2^{2(3 − D) l} (eqs 12–13).
    pub fn from_dimension(dimension: f32, temperature: f32) -> Self {
        let share = core::array::from_fn(|l| {
            0.5 * math::exp2(-2.0 * (3.0 - dimension) * l as f32) / temperature
        });
        Prior {
            membrane: share,
            plate: share,
        }
    }
}

/// The state of the relaxation, in lent memory.
///
/// ```
/// use rand_core::SeedableRng;
/// use rugosa_fractal::ak96::{Ak96, Prior};
/// use rugosa_fractal::pyramid::Datum;
/// # let mut memory = vec![0.0; Ak96::need(17).unwrap()];
/// let mut ak96 = Ak96::new(17, &mut memory).unwrap();
/// // the first column is 2 m high, the last one 4 m; nothing is known between
/// let height = |i: usize| 2.0 + (i % 17 / 16) as f32 * 2.0;
/// let datum = |i| Datum { height: height(i), variance: 1e-4 };
/// assert_eq!(ak96.observe(|i| (i % 17 % 16 == 0).then(|| datum(i)), 1e-6), 2 * 17);
/// let prior = Prior::from_dimension(2.5, 0.01);
/// (0..500).for_each(|_| ak96.relax(&prior));
/// let (mut smooth, mut rough) = ([0.0; 17 * 17], [0.0; 17 * 17]);
/// ak96.surface(&mut smooth);
/// assert!((smooth[8 * 17] - 2.0).abs() < 0.05 && (smooth[8 * 17 + 8] - 3.0).abs() < 0.05);
/// ak96.sample(&prior, &mut rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(1));
/// ak96.surface(&mut rough);
/// let square = |z: &[f32]| z.windows(2).map(|p| (p[1] - p[0]).powi(2)).sum::<f32>();
/// assert!(square(&rough) > square(&smooth));
/// ```
#[derive(Debug)]
pub struct Ak96<'m> {
    side: usize,
    layers: usize,
    /// the layers, finest first
    nodes: &'m mut [f32],
    /// d − u of the cells with a datum
    error: &'m mut [f32],
    /// 1 / variance; 0 without a datum
    weight: &'m mut [f32],
    offset: f32,
}

/// Nodes per edge of layer `l`.
const fn edge(side: usize, l: usize) -> usize {
    ((side - 1) >> l) + 1
}

/// Where layer `l` begins.
fn start(side: usize, l: usize) -> usize {
    (0..l).map(|l| edge(side, l) * edge(side, l)).sum()
}

impl<'m> Ak96<'m> {
    /// Elements of f32 needed for side × side cells.
    ///
    /// # Errors
    /// A side that is not 2^k + 1, from 5 to 4097.
    pub fn need(side: usize) -> Result<usize, Error> {
        if !(5..=4097).contains(&side) || !(side - 1).is_power_of_two() {
            return Err(Error::Side(side));
        }
        Ok(start(side, layers(side)) + 2 * side * side)
    }

    /// A flat surface.
    ///
    /// # Errors
    /// A side that is not 2^k + 1; less memory than [`Ak96::need`].
    pub fn new(side: usize, memory: &'m mut [f32]) -> Result<Self, Error> {
        let need = Self::need(side)?;
        let memory = memory.get_mut(..need).ok_or(Error::Memory(need))?;
        memory.fill(0.0);
        let (nodes, cells) = memory.split_at_mut(start(side, layers(side)));
        let (error, weight) = cells.split_at_mut(side * side);
        Ok(Ak96 {
            side,
            layers: layers(side),
            nodes,
            error,
            weight,
            offset: 0.0,
        })
    }

    /// Takes the data in; the surface starts flat at their mean. Variances below
    /// `least_variance` \[m²\] count as that. Returns how many were used.
    pub fn observe(&mut self, data: impl Fn(usize) -> Option<Datum>, least_variance: f32) -> usize {
        self.nodes.fill(0.0);
        let sound = |i| data(i).filter(|d| d.height.is_finite() && d.variance >= 0.0);
        let (mut sum, mut used, mut first) = (0.0, 0, None);
        for d in (0..self.side * self.side).filter_map(sound) {
            sum += d.height - *first.get_or_insert(d.height);
            used += 1;
        }
        self.offset = first.map_or(0.0, |first| first + sum / used as f32);
        for (i, (e, w)) in self
            .error
            .iter_mut()
            .zip(self.weight.iter_mut())
            .enumerate()
        {
            (*e, *w) = match sound(i) {
                Some(d) => (d.height - self.offset, 1.0 / d.variance.max(least_variance)),
                None => (0.0, 0.0),
            };
        }
        used
    }

    /// One Gauss–Seidel sweep over all layers, coarse to fine: towards T = 0.
    pub fn relax(&mut self, prior: &Prior) {
        self.sweep(prior, || 0.0);
    }

    /// One sweep of the Gibbs sampler.
    pub fn sample(&mut self, prior: &Prior, rng: &mut impl Rng) {
        self.sweep(prior, || normal(rng));
    }

    fn sweep(&mut self, prior: &Prior, mut noise: impl FnMut() -> f32) {
        for l in (0..self.layers).rev() {
            let n = edge(self.side, l);
            for i in 0..n * n {
                self.update((l, i / n, i % n), prior, noise());
            }
        }
    }

    /// Sets a node to the minimum of its energy plus `noise` conditional deviations.
    fn update(&mut self, (l, row, column): (usize, usize, usize), prior: &Prior, noise: f32) {
        let at = start(self.side, l);
        let n = edge(self.side, l);
        let layer = &self.nodes[at..at + n * n];
        let old = layer[row * n + column];
        let (mut a, mut b) = terms::pull(layer, n, (row, column), prior.of(l));
        self.around((l, row, column), |share, error, weight| {
            a += weight * share * share;
            b += weight * share * (*error + share * old);
        });
        if a <= 0.0 {
            return;
        }
        let new = b / a + noise / math::sqrt(a);
        self.nodes[at + row * n + column] = new;
        self.around((l, row, column), |share, error, _| {
            *error -= share * (new - old)
        });
    }

    /// Calls `f(share, error, weight)` for every datum under the hat of a node.
    fn around(
        &mut self,
        (l, row, column): (usize, usize, usize),
        mut f: impl FnMut(f32, &mut f32, f32),
    ) {
        let (step, side) = (1usize << l, self.side);
        let scale = 1.0 / step as f32;
        let span = |node: usize| {
            let middle = node * step;
            (
                middle.saturating_sub(step - 1)..(middle + step).min(side),
                middle,
            )
        };
        let ((ys, y0), (xs, x0)) = (span(row), span(column));
        for y in ys {
            let share_y = 1.0 - scale * y.abs_diff(y0) as f32;
            for x in xs.clone() {
                let i = y * side + x;
                if self.weight[i] > 0.0 {
                    let share = share_y * (1.0 - scale * x.abs_diff(x0) as f32);
                    f(share, &mut self.error[i], self.weight[i]);
                }
            }
        }
    }

    /// The surface \[m\], row by row.
    pub fn surface(&self, out: &mut [f32]) {
        out.fill(self.offset);
        let side = self.side;
        for l in 0..self.layers {
            let (at, n, step) = (start(side, l), edge(side, l), 1usize << l);
            let layer = &self.nodes[at..at + n * n];
            for (i, z) in out.iter_mut().enumerate().take(side * side) {
                *z += bilinear(layer, n, step, (i / side, i % side));
            }
        }
    }
}

impl Prior {
    fn of(&self, l: usize) -> (f32, f32) {
        (self.membrane[l], self.plate[l])
    }
}

/// Layers down to the one of 3 × 3 nodes.
fn layers(side: usize) -> usize {
    (side - 1).trailing_zeros() as usize
}

/// A layer at a cell.
fn bilinear(layer: &[f32], n: usize, step: usize, (y, x): (usize, usize)) -> f32 {
    let (row, column) = ((y / step).min(n - 2), (x / step).min(n - 2));
    let share = |at: usize, node: usize| (at - node * step) as f32 / step as f32;
    let (v, u) = (share(y, row), share(x, column));
    let at = |r: usize, c: usize| layer[(row + r) * n + column + c];
    (1.0 - v) * ((1.0 - u) * at(0, 0) + u * at(0, 1)) + v * ((1.0 - u) * at(1, 0) + u * at(1, 1))
}

#[cfg(test)]
mod tests;
