//! Surfaces from few numbers: three published constructions, each with what it is good
//! for and what it is not.
//!
//! | module | model | use it for |
//! |---|---|---|
//! | [`midpoint`] | midpoint interpolation of fractional Brownian terrain | denser maps with the right roughness |
//! | [`rectangular`] | fractal interpolation surfaces on a rectangular lattice | deterministic detail between nodes |
//! | [`ifs`] | projected iterated function systems (feature `alloc`) | a surface that can be tabulated to any depth |
//!
//! None of them compresses heights well; that is the work of [`crate::codec`].

#[cfg(feature = "alloc")]
pub mod ifs;
pub mod midpoint;
pub mod rectangular;

use core::fmt;

/// Rows and columns of a grid stored row by row.
///
/// ```
/// use rugosa_fractal::surfaces::Shape;
/// let shape = Shape::new(9, 17);
/// assert_eq!(shape.len(), 153);
/// let every_fourth = shape.coarser(4);
/// assert_eq!(every_fourth, Some(Shape::new(3, 5)));
/// assert_eq!(every_fourth.map(|coarse| coarse.finer(4)), Some(shape));
/// assert_eq!(shape.coarser(3), None); // the last row would be left out
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// samples per column
    pub rows: usize,
    /// samples per row
    pub columns: usize,
}

impl Shape {
    /// A grid of `rows × columns` samples.
    pub const fn new(rows: usize, columns: usize) -> Self {
        Shape { rows, columns }
    }

    /// Samples in all.
    pub const fn len(&self) -> usize {
        self.rows * self.columns
    }

    /// Does it hold no sample?
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Every `step`-th row and column, if the last ones are among them.
    pub const fn coarser(&self, step: usize) -> Option<Shape> {
        if step == 0
            || self.rows == 0
            || self.columns == 0
            || !(self.rows - 1).is_multiple_of(step)
            || !(self.columns - 1).is_multiple_of(step)
        {
            return None;
        }
        Some(Shape::new(
            (self.rows - 1) / step + 1,
            (self.columns - 1) / step + 1,
        ))
    }

    /// `step − 1` new samples between two neighbours.
    pub const fn finer(&self, step: usize) -> Shape {
        Shape::new((self.rows - 1) * step + 1, (self.columns - 1) * step + 1)
    }
}

/// What a surface model refuses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SurfaceError {
    /// the grid's sides do not suit the model; they are given
    Size(Shape),
    /// a slice is shorter than the grid it should hold: needed, given
    Length(usize, usize),
    /// NaN or infinity at this index where every sample must be finite
    NotFinite(usize),
    /// a vertical scale with |s| ≥ 1: the surface would not be bounded
    Scale(f32),
    /// H outside (0, 1), or σ negative or not finite
    Roughness(f32),
    /// too few samples for the estimate that was asked for
    TooFew(usize),
}

impl fmt::Display for SurfaceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SurfaceError::Size(s) => {
                write!(
                    f,
                    "{} × {} samples do not suit this model",
                    s.rows, s.columns
                )
            }
            SurfaceError::Length(needed, given) => {
                write!(f, "{needed} elements are needed, {given} were given")
            }
            SurfaceError::NotFinite(i) => write!(f, "sample {i} is not finite"),
            SurfaceError::Scale(s) => write!(f, "vertical scale {s} is not within (−1, 1)"),
            SurfaceError::Roughness(v) => write!(f, "roughness parameter {v} is out of range"),
            SurfaceError::TooFew(n) => write!(f, "{n} samples are too few"),
        }
    }
}

impl core::error::Error for SurfaceError {}

/// Refuses slices that cannot hold `shape`.
fn check_length(shape: Shape, given: usize) -> Result<(), SurfaceError> {
    if given < shape.len() {
        return Err(SurfaceError::Length(shape.len(), given));
    }
    Ok(())
}

/// Refuses NaN and infinity.
fn check_finite(values: &[f32]) -> Result<(), SurfaceError> {
    match values.iter().position(|v| !v.is_finite()) {
        Some(i) => Err(SurfaceError::NotFinite(i)),
        None => Ok(()),
    }
}
