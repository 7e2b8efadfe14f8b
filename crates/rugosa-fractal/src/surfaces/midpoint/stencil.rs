//! How a midpoint is blended from its known neighbours, and how uncertain it then is.
//!
//! For increments with V(d) = σ² d^{2H} a weighted mean with Σ w = 1 has the residual
//! variance σ² h^{2H} (w·d − ½ wᵀ D w), where d_i = |p_i|^{2H} and D_ij = |p_i − p_j|^{2H} in
//! units of the new spacing h. The kriged weights minimise it (ordinary kriging):
//! (D 1; 1ᵀ 0)(w; μ) = (d; 1). Any subset of the neighbours may be known: borders and
//! unknown cells simply have fewer.
//!
//! Cost: one 17 × 17 solve per pattern of known neighbours, kept in a cache that the
//! caller lends; inside a map there are two patterns. In f64, because the
//! system is badly conditioned for H near 1.
//!
//! Source: Fang et al. 2004 eqs 4–5; Yokoya et al. 1989; the 16-point form is ordinary
//! kriging of the same model. Checked by `weights_are_the_published_ones`.

use nalgebra::{SMatrix, SVector};

/// Offset of a neighbour from the midpoint, in new spacings (rows, columns).
pub type Offset = (i8, i8);

/// Neighbours of the centre of four known corners, nearest four first.
const SQUARE: [Offset; 16] = [
    (-1, -1),
    (-1, 1),
    (1, -1),
    (1, 1),
    (-3, -1),
    (-3, 1),
    (-1, -3),
    (-1, 3),
    (1, -3),
    (1, 3),
    (3, -1),
    (3, 1),
    (-3, -3),
    (-3, 3),
    (3, -3),
    (3, 3),
];

/// Neighbours of the middle of an edge: |a| + |b| ≤ 3 and odd, nearest four first
/// (vertical pair, horizontal pair).
const DIAMOND: [Offset; 16] = [
    (-1, 0),
    (1, 0),
    (0, -1),
    (0, 1),
    (-2, -1),
    (-2, 1),
    (-1, -2),
    (-1, 2),
    (1, -2),
    (1, 2),
    (2, -1),
    (2, 1),
    (-3, 0),
    (3, 0),
    (0, -3),
    (0, 3),
];

/// The nearest four in a mask of known neighbours.
pub(super) const NEAREST: u16 = 0b1111;
/// The two nearest above and below the middle of an edge.
pub(super) const VERTICAL: u16 = 0b0011;
/// The two nearest beside it.
pub(super) const HORIZONTAL: u16 = 0b1100;

/// Which of the two steps of a doubling.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// centres of squares of four known corners
    Square,
    /// middles of the edges, between corners and new centres
    Diamond,
}

impl Step {
    /// The sixteen neighbours, nearest four first.
    ///
    /// ```
    /// use rugosa_fractal::surfaces::midpoint::Step;
    /// // rows, columns
    /// assert_eq!(Step::Square.offsets()[..4], [(-1, -1), (-1, 1), (1, -1), (1, 1)]);
    /// assert_eq!(Step::Diamond.offsets()[..4], [(-1, 0), (1, 0), (0, -1), (0, 1)]);
    /// ```
    pub fn offsets(self) -> &'static [Offset; 16] {
        match self {
            Step::Square => &SQUARE,
            Step::Diamond => &DIAMOND,
        }
    }
}

/// Length that the papers' variance formulas put for ‖Δx‖ of a centre and its corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Distance {
    /// √2 h
    Euclidean,
    /// h
    Chessboard,
    /// 2 h
    Street,
}

/// How midpoints are blended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Stencil {
    /// 16 neighbours, kriged; truncated stencils at borders and beside unknown cells
    #[default]
    Kriged16,
    /// mean of the nearest four with its true variance; on a border the two along it
    Four,
    /// mean of the nearest four with the variances of Fang et al. 2004, eqs 4–5, which
    /// are those of a line (too large on a surface by 11–15 % in amplitude)
    Fang2004(Distance),
}

/// Weights for one pattern of known neighbours.
#[derive(Clone, Copy, Debug, Default)]
pub struct Blend {
    key: u64,
    /// weight per neighbour, 0 where it is unknown; they sum to 1
    pub weights: [f32; 16],
    /// residual variance in units of σ² h^{2H}
    pub variance: f32,
}

impl Blend {
    /// Weights of `stencil` for the neighbours in `known`, Hurst exponent `hurst`.
    /// `None` when none of the nearest four is known.
    ///
    /// ```
    /// use rugosa_fractal::surfaces::midpoint::{Blend, Stencil, Step};
    /// let all = |stencil| Blend::new(stencil, Step::Square, u16::MAX, 0.5).unwrap();
    /// let four = all(Stencil::Four);
    /// assert_eq!(four.weights[..5], [0.25, 0.25, 0.25, 0.25, 0.0]);
    /// // √2 − ½ (1 + ½ √2) at hurst ½, in units of σ² h
    /// assert!((four.variance - 0.56066).abs() < 1e-5);
    /// let kriged = all(Stencil::Kriged16);
    /// assert!(kriged.variance < four.variance);
    /// assert!((kriged.weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
    /// // none of the nearest four is known
    /// assert!(Blend::new(Stencil::Four, Step::Square, 0xfff0, 0.5).is_none());
    /// ```
    pub fn new(stencil: Stencil, step: Step, known: u16, hurst: f32) -> Option<Blend> {
        if known & NEAREST == 0 {
            return None;
        }
        let known = if stencil == Stencil::Kriged16 {
            known
        } else {
            known & NEAREST
        };
        let model = Model {
            offsets: step.offsets(),
            known,
            exponent: 2.0 * f64::from(hurst),
        };
        let weights = match stencil {
            Stencil::Kriged16 => model.kriged(),
            _ => model.equal(),
        };
        let variance = match stencil {
            Stencil::Fang2004(distance) => fang_variance(distance, step, known, f64::from(hurst)),
            _ => model.variance(&weights),
        };
        Some(Blend {
            key: key(step, known, hurst),
            weights: core::array::from_fn(|i| weights[i] as f32),
            variance: variance.max(0.0) as f32,
        })
    }
}

/// Weights already solved for, in memory lent by the caller (64 entries are plenty for one
/// Hurst exponent; 80 bytes each).
///
/// ```
/// use rugosa_fractal::surfaces::midpoint::{Blend, Cache, Stencil, Step};
/// let mut entries = [Blend::default(); 64];
/// let mut cache = Cache::new(&mut entries, Stencil::Kriged16);
/// // the neighbour in the north-west is not known
/// let known = u16::MAX & !1;
/// let solved = Blend::new(Stencil::Kriged16, Step::Square, known, 0.7).unwrap();
/// let cached = cache.blend(Step::Square, known, 0.7).unwrap();
/// assert_eq!((cached.weights, cached.weights[0]), (solved.weights, 0.0));
/// ```
pub struct Cache<'a> {
    entries: &'a mut [Blend],
    stencil: Stencil,
}

impl<'a> Cache<'a> {
    /// An empty cache in `entries` (at least one).
    pub fn new(entries: &'a mut [Blend], stencil: Stencil) -> Self {
        entries.fill(Blend::default());
        Cache { entries, stencil }
    }

    /// The blend for this pattern, from the cache or newly solved.
    pub fn blend(&mut self, step: Step, known: u16, hurst: f32) -> Option<&Blend> {
        let known = if self.stencil == Stencil::Kriged16 {
            known
        } else {
            known & NEAREST
        };
        let key = key(step, known, hurst);
        let slot = (key.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32) as usize % self.entries.len();
        if self.entries[slot].key != key {
            self.entries[slot] = Blend::new(self.stencil, step, known, hurst)?;
        }
        Some(&self.entries[slot])
    }
}

fn key(step: Step, known: u16, hurst: f32) -> u64 {
    let step = u64::from(step == Step::Diamond);
    u64::from(hurst.to_bits()) << 32 | 1 << 20 | step << 16 | u64::from(known)
}

/// V(d) = d^{2H} on one stencil.
struct Model {
    offsets: &'static [Offset; 16],
    known: u16,
    exponent: f64,
}

impl Model {
    fn is_known(&self, i: usize) -> bool {
        self.known >> i & 1 == 1
    }

    fn power(&self, rows: i8, columns: i8) -> f64 {
        let squared = f64::from(rows) * f64::from(rows) + f64::from(columns) * f64::from(columns);
        if squared == 0.0 {
            0.0
        } else {
            libm::pow(squared, 0.5 * self.exponent)
        }
    }

    fn to_target(&self, i: usize) -> f64 {
        self.power(self.offsets[i].0, self.offsets[i].1)
    }

    fn between(&self, i: usize, j: usize) -> f64 {
        let (a, b) = (self.offsets[i], self.offsets[j]);
        self.power(a.0 - b.0, a.1 - b.1)
    }

    fn equal(&self) -> [f64; 16] {
        let share = 1.0 / f64::from(self.known.count_ones());
        core::array::from_fn(|i| if self.is_known(i) { share } else { 0.0 })
    }

    /// Unknown neighbours become rows of the identity with a zero right side.
    fn kriged(&self) -> [f64; 16] {
        let both = |i: usize, j: usize| self.is_known(i) && self.is_known(j);
        let system = SMatrix::<f64, 17, 17>::from_fn(|i, j| match (i, j) {
            (16, 16) => 0.0,
            (16, k) | (k, 16) => f64::from(u8::from(self.is_known(k))),
            _ if both(i, j) => self.between(i, j),
            _ => f64::from(u8::from(i == j)),
        });
        let right = SVector::<f64, 17>::from_fn(|i, _| match i {
            16 => 1.0,
            _ if self.is_known(i) => self.to_target(i),
            _ => 0.0,
        });
        match system.lu().solve(&right) {
            Some(w) => core::array::from_fn(|i| w[i]),
            None => self.equal(),
        }
    }

    fn variance(&self, weights: &[f64; 16]) -> f64 {
        let pairs = |i: usize| {
            (0..16)
                .map(|j| weights[j] * self.between(i, j))
                .sum::<f64>()
        };
        (0..16)
            .map(|i| weights[i] * (self.to_target(i) - 0.5 * pairs(i)))
            .sum()
    }
}

/// Fang et al. 2004 eqs 4–5: (1 − 2^{2H−2}) ‖Δx‖^{2H}, times 2^{−H} for the diamond step;
/// on a border (two neighbours) the line's own variance.
fn fang_variance(distance: Distance, step: Step, known: u16, hurst: f64) -> f64 {
    let line = 1.0 - libm::pow(2.0, 2.0 * hurst - 2.0);
    if known.count_ones() == 2 {
        return line;
    }
    let squared_length = match distance {
        Distance::Euclidean => 2.0,
        Distance::Chessboard => 1.0,
        Distance::Street => 4.0,
    };
    let square = line * libm::pow(squared_length, hurst);
    match step {
        Step::Square => square,
        Step::Diamond => square * libm::pow(2.0, -hurst),
    }
}
