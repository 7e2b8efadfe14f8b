//! Projected iterated function systems: a surface as the projection of an attractor that
//! is affine in its 4 × 4 control heights.
//!
//! One subdivision sends every 4 × 4 patch to a 10 × 10 grid, nine overlapping 4 × 4 patches.
//! Of the 100 points 16 are copies, 48 lie on the patch's lines and are affine combinations
//! of the four aligned points, 36 lie inside a cell and are affine combinations of its four
//! corners. Every combination has three free weights (they sum to one); line 3 of a patch
//! uses the weights of line 0, which makes neighbours meet at every depth:
//! 16 + 3·36 + 3·36 = 232 parameters. The surface passes through the 16 control heights:
//! F(a/3, b/3) = z\[a\]\[b\].
//!
//! | item | what |
//! |---|---|
//! | [`Ifs`] | the parameters; tabulation to any depth p, (3^p + 1)² samples |
//! | [`fit`] | least squares to a grid: Levenberg–Marquardt with the structure used |
//! | [`collage()`] | the linear fit that needs no iteration (and is not enough) |
//! | [`contractivity()`] | does the surface exist at infinite depth? |
//! | [`Mosaic`] | patches side by side without a seam, and the file format |
//!
//! Use it for a compact surface with natural roughness that has no finest resolution. Do
//! not use it to compress: at 232 numbers a 15 × 15 sampled bilinear surface has
//! 0.5–5.2 dB less error (`docs/surfaces.md`).
//!
//! Offline mathematics: f64 and a heap.
//!
//! Source: Guérin, Tosan & Baskurt, "Modeling and approximation of fractal surfaces with
//! projected IFS attractors", Fractals 2001. The mirrored variant (268 parameters) is ours.

mod collage;
mod contractivity;
mod fit;
mod gram;
mod mosaic;
mod stencil;
mod tabulate;

pub use collage::collage;
pub use contractivity::{Contractivity, Verdict, contractivity};
pub use fit::{Fit, Iteration, Options, Start, fit};
pub use mosaic::{FileError, Joins, Mosaic};
pub use tabulate::{depth_of, side_of};

use alloc::{vec, vec::Vec};
use stencil::Stencil;

/// How neighbouring patches are made to meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Variant {
    /// line 3 has the weights of line 0: the published model, 232 parameters
    #[default]
    Tied,
    /// every second patch is mirrored, so that a line always meets itself: 268 parameters
    Mirrored,
}

impl Variant {
    /// Number of parameters: 16 heights, then the weights of row lines, column lines and
    /// cells.
    ///
    /// ```
    /// use rugosa_fractal::surfaces::ifs::Variant;
    /// assert_eq!((Variant::Tied.parameters(), Variant::Mirrored.parameters()), (232, 268));
    /// ```
    pub const fn parameters(self) -> usize {
        16 + 2 * 18 * self.lines() + 108
    }

    const fn lines(self) -> usize {
        match self {
            Variant::Tied => 3,
            Variant::Mirrored => 4,
        }
    }
}

/// A projected IFS: control heights and weights.
///
/// Parameter order: z\[4\]\[4\], R\[line\]\[edge\]\[k\]\[3\], C\[line\]\[edge\]\[k\]\[3\],
/// I\[a\]\[b\]\[k\]\[l\]\[3\]; the weight of the first point is 1 − Σ.
///
/// ```
/// use rugosa_fractal::surfaces::ifs::{Ifs, Variant};
/// let heights: [f64; 16] = core::array::from_fn(|i| (i * i % 11) as f64);
/// let mut ifs = Ifs::bilinear(Variant::Tied, &heights);
/// // 10 × 10 heights: every third is a control height, linear between
/// let table = ifs.tabulate(2);
/// assert_eq!((table[0], table[3], table[3 * 10]), (heights[0], heights[1], heights[4]));
/// assert!((table[1] - (2.0 * heights[0] + heights[1]) / 3.0).abs() < 1e-12);
/// // other weights, the same control heights
/// let mut parameters = ifs.parameters().to_vec();
/// parameters[16..].iter_mut().for_each(|weight| *weight *= 0.8);
/// ifs = Ifs::from_parameters(Variant::Tied, parameters).unwrap();
/// assert_eq!(ifs.tabulate(2)[3], heights[1]);
/// assert_ne!(ifs.tabulate(2)[1], table[1]);
/// assert!(Ifs::from_parameters(Variant::Tied, vec![0.0; 99]).is_none());
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Ifs {
    variant: Variant,
    parameters: Vec<f64>,
}

impl Ifs {
    /// A surface with the weights of bilinear interpolation.
    pub fn bilinear(variant: Variant, heights: &[f64; 16]) -> Ifs {
        let mut parameters = vec![0.0; variant.parameters()];
        parameters[..16].copy_from_slice(heights);
        Stencil::new(variant).set_bilinear(&mut parameters);
        Ifs {
            variant,
            parameters,
        }
    }

    /// From parameters in the order above; `None` if their number or a value is wrong.
    pub fn from_parameters(variant: Variant, parameters: Vec<f64>) -> Option<Ifs> {
        let good =
            parameters.len() == variant.parameters() && parameters.iter().all(|p| p.is_finite());
        good.then_some(Ifs {
            variant,
            parameters,
        })
    }

    /// The parameters, in the order above.
    pub fn parameters(&self) -> &[f64] {
        &self.parameters
    }

    /// Its variant.
    pub fn variant(&self) -> Variant {
        self.variant
    }

    /// Heights α z + β with the same weights: the surface changes in the same way.
    ///
    /// ```
    /// use rugosa_fractal::surfaces::ifs::{Ifs, Variant};
    /// let heights: [f64; 16] = core::array::from_fn(|i| (i * i % 11) as f64);
    /// let ifs = Ifs::bilinear(Variant::Tied, &heights);
    /// let (one, other) = (ifs.tabulate(3), ifs.scaled(-2.0, 5.0).tabulate(3));
    /// assert!(one.iter().zip(other).all(|(z, scaled)| (5.0 - 2.0 * z - scaled).abs() < 1e-9));
    /// ```
    pub fn scaled(&self, alpha: f64, beta: f64) -> Ifs {
        let mut scaled = self.clone();
        scaled.parameters[..16]
            .iter_mut()
            .for_each(|z| *z = alpha * *z + beta);
        scaled
    }
}
