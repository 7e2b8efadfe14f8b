//! Patches side by side without a seam, and their file.
//!
//! Two surfaces meet at every depth if they share the heights of the common border and the
//! weights of the line that it is (C\[0\] for left and right, R\[0\] for above and below).
//! A mosaic is fitted patch by patch, row by row, with what the left and the upper
//! neighbour have decided held fixed. In the tied model all patches of a row of patches
//! thereby share C\[0\] and all of a column share R\[0\].
//!
//! File, little-endian, 20 + 4 · patches · parameters bytes (948 for one tied patch):
//!
//! | offset | size | field |
//! |---|---|---|
//! | 0 | 4 | "RIFS" |
//! | 4 | 1 | version, 1 |
//! | 5 | 1 | variant: 0 tied (232), 1 mirrored (268) |
//! | 6 | 1 | depth the patches were fitted at |
//! | 7 | 1 | 0 |
//! | 8 | 4, 4 | rows and columns of patches |
//! | 16 | | parameters of each patch, f32 |
//! | end − 4 | 4 | CRC-32 (ISO-HDLC) of everything before |

use super::stencil::Stencil;
use super::{Fit, Ifs, Iteration, Options, Variant, fit, side_of};
use crate::surfaces::{Shape, SurfaceError};
use alloc::{vec, vec::Vec};
use core::fmt;

const CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
const MAGIC: &[u8; 4] = b"RIFS";
const VERSION: u8 = 1;
const HEADER: usize = 16;
/// Most patches that a file may hold.
const MOST_PATCHES: usize = 1 << 16;

/// A rectangle of patches.
///
/// ```
/// use rugosa_fractal::surfaces::ifs::{FileError, Ifs, Mosaic, Variant};
/// let ifs = Ifs::bilinear(Variant::Tied, &core::array::from_fn(|i| (i * i % 11) as f64));
/// let bytes = Mosaic::single(ifs.clone(), 3).to_bytes();
/// assert_eq!(bytes.len(), 948);
/// let read = Mosaic::from_bytes(&bytes).unwrap();
/// // parameters are kept as f32
/// let (table, _) = read.tabulate(2);
/// assert!(table.iter().zip(ifs.tabulate(2)).all(|(a, b)| (a - b).abs() < 1e-5));
/// let mut damaged = bytes;
/// damaged[100] ^= 1;
/// assert_eq!(Mosaic::from_bytes(&damaged), Err(FileError::Checksum));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Mosaic {
    rows: usize,
    columns: usize,
    depth: u32,
    patches: Vec<Ifs>,
}

/// Which neighbours a patch must join.
///
/// ```
/// use rugosa_fractal::surfaces::ifs::{Ifs, Joins, Variant};
/// let left = Ifs::bilinear(Variant::Tied, &core::array::from_fn(|i| i as f64));
/// let fixed = Joins { left: Some(&left), above: None }.fixed(Variant::Tied);
/// // four heights and the 18 weights of the border; the first heights of the rows of this
/// // patch are the last ones of the rows of its neighbour
/// assert_eq!(fixed.len(), 4 + 18);
/// assert_eq!(fixed[..4], [(0, 3.0), (4, 7.0), (8, 11.0), (12, 15.0)]);
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct Joins<'a> {
    /// the patch on its left
    pub left: Option<&'a Ifs>,
    /// the patch above it (in row order)
    pub above: Option<&'a Ifs>,
}

impl Joins<'_> {
    /// The parameters that joining decides, and their values.
    pub fn fixed(&self, variant: Variant) -> Vec<(usize, f64)> {
        let mut fixed = Vec::new();
        for (axis, neighbour) in [self.above, self.left].into_iter().enumerate() {
            let Some(neighbour) = neighbour else { continue };
            let along = |i: usize, at: usize| if axis == 0 { 4 * at + i } else { 4 * i + at };
            fixed.extend((0..4).map(|i| (along(i, 0), neighbour.parameters[along(i, 3)])));
            let (here, there) = (line(variant, axis, 0), line(variant, axis, 3));
            fixed.extend((0..18).map(|k| (here + k, neighbour.parameters[there + k])));
        }
        fixed
    }
}

/// First weight of a line (0 or 3) of row lines (axis 0) or column lines.
fn line(variant: Variant, axis: usize, line: usize) -> usize {
    let target = if axis == 0 {
        3 * line * 10 + 1
    } else {
        10 + 3 * line
    };
    let stencil = Stencil::new(variant);
    stencil
        .points
        .iter()
        .find(|p| p.target == target)
        .map_or(0, |p| p.weight)
}

impl Mosaic {
    /// A mosaic of one patch.
    pub fn single(ifs: Ifs, depth: u32) -> Mosaic {
        Mosaic {
            rows: 1,
            columns: 1,
            depth,
            patches: vec![ifs],
        }
    }

    /// Fits a grid of (rows · 3^p + 1) × (columns · 3^p + 1) samples; returns the fits, row by
    /// row, beside it. `progress` hears of the patch and its iteration.
    ///
    /// ```
    /// use rugosa_fractal::surfaces::{Shape, ifs::{Mosaic, Options}};
    /// // two patches side by side: 28 rows of 2 · 27 + 1 samples
    /// let shape = Shape::new(28, 55);
    /// let data: Vec<f64> = (0..shape.len())
    ///     .map(|i| (0.4 * (i % 55) as f64).sin() * (0.3 * (i / 55) as f64).cos())
    ///     .collect();
    /// let options = Options { iterations: 2, ..Options::default() };
    /// let (mosaic, fits) = Mosaic::fit(&data, shape, 3, &options, &mut |_, _| {}).unwrap();
    /// assert_eq!((mosaic.lattice(), fits.len()), (Shape::new(1, 2), 2));
    /// // no seam, deeper than the data too
    /// let [left, right] = [0, 1].map(|patch| mosaic.patches()[patch].tabulate(4));
    /// assert!((0..82).all(|row| left[row * 82 + 81] == right[row * 82]));
    /// ```
    ///
    /// # Errors
    /// Sides of another form, p < 3, non-finite data.
    pub fn fit(
        data: &[f64],
        shape: Shape,
        depth: u32,
        options: &Options,
        progress: &mut dyn FnMut(usize, Iteration),
    ) -> Result<(Mosaic, Vec<Fit>), SurfaceError> {
        let cells = side_of(depth) - 1;
        let lattice = shape.coarser(cells).ok_or(SurfaceError::Size(shape))?;
        let (rows, columns) = (lattice.rows - 1, lattice.columns - 1);
        if rows * columns == 0 || data.len() != shape.len() {
            return Err(SurfaceError::Size(shape));
        }
        let mut fits: Vec<Fit> = Vec::new();
        for index in 0..rows * columns {
            let (row, column) = (index / columns, index % columns);
            let joins = Joins {
                left: (column > 0).then(|| &fits[index - 1].ifs),
                above: (row > 0).then(|| &fits[index - columns].ifs),
            };
            let fixed = joins.fixed(options.variant);
            let part = window(data, shape, (row * cells, column * cells), cells + 1);
            fits.push(fit(&part, options, &fixed, &mut |i| progress(index, i))?);
        }
        let patches = fits.iter().map(|f| f.ifs.clone()).collect();
        Ok((
            Mosaic {
                rows,
                columns,
                depth,
                patches,
            },
            fits,
        ))
    }

    /// Rows and columns of patches.
    pub fn lattice(&self) -> Shape {
        Shape::new(self.rows, self.columns)
    }

    /// Depth that the patches were fitted at.
    pub fn depth(&self) -> u32 {
        self.depth
    }

    /// The patches, row by row.
    pub fn patches(&self) -> &[Ifs] {
        &self.patches
    }

    /// The table of depth p of the whole: (rows · 3^p + 1) × (columns · 3^p + 1) heights.
    pub fn tabulate(&self, depth: u32) -> (Vec<f64>, Shape) {
        let cells = side_of(depth) - 1;
        let shape = Shape::new(self.rows * cells + 1, self.columns * cells + 1);
        let mut out = vec![0.0; shape.len()];
        for (index, patch) in self.patches.iter().enumerate() {
            let from = (index / self.columns * cells, index % self.columns * cells);
            for (i, height) in patch.tabulate(depth).into_iter().enumerate() {
                let (row, column) = (from.0 + i / (cells + 1), from.1 + i % (cells + 1));
                out[row * shape.columns + column] = height;
            }
        }
        (out, shape)
    }

    /// The file's bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        let variant = self.patches.first().map_or(Variant::Tied, Ifs::variant);
        bytes.extend([
            VERSION,
            u8::from(variant == Variant::Mirrored),
            self.depth as u8,
            0,
        ]);
        bytes.extend((self.rows as u32).to_le_bytes());
        bytes.extend((self.columns as u32).to_le_bytes());
        for patch in &self.patches {
            bytes.extend(
                patch
                    .parameters()
                    .iter()
                    .flat_map(|p| (*p as f32).to_le_bytes()),
            );
        }
        let sum = CRC.checksum(&bytes);
        bytes.extend(sum.to_le_bytes());
        bytes
    }

    /// Reads a file.
    ///
    /// # Errors
    /// See [`FileError`]; nothing is allocated before size and checksum agree.
    pub fn from_bytes(bytes: &[u8]) -> Result<Mosaic, FileError> {
        let header = bytes
            .get(..HEADER)
            .ok_or(FileError::Length(HEADER, bytes.len()))?;
        if &header[..4] != MAGIC {
            return Err(FileError::Magic);
        }
        if header[4] != VERSION {
            return Err(FileError::Version(header[4]));
        }
        let word = |at: usize| {
            u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]])
                as usize
        };
        let (rows, columns, depth) = (word(8), word(12), u32::from(header[6]));
        let variant = match header[5] {
            0 => Variant::Tied,
            1 => Variant::Mirrored,
            _ => return Err(FileError::Field("variant")),
        };
        if rows == 0 || columns == 0 || rows.saturating_mul(columns) > MOST_PATCHES {
            return Err(FileError::Field("number of patches"));
        }
        if !(1..=11).contains(&depth) {
            return Err(FileError::Field("depth"));
        }
        let each = variant.parameters();
        let needed = HEADER + 4 * each * rows * columns + 4;
        if bytes.len() != needed {
            return Err(FileError::Length(needed, bytes.len()));
        }
        let (body, sum) = bytes.split_at(needed - 4);
        if CRC.checksum(body).to_le_bytes() != sum {
            return Err(FileError::Checksum);
        }
        let (values, _) = body[HEADER..].as_chunks::<4>();
        let patch = |p: &[[u8; 4]]| {
            let parameters = p
                .iter()
                .map(|b| f64::from(f32::from_le_bytes(*b)))
                .collect();
            Ifs::from_parameters(variant, parameters).ok_or(FileError::Field("parameter"))
        };
        let patches = values.chunks(each).map(patch).collect::<Result<_, _>>()?;
        Ok(Mosaic {
            rows,
            columns,
            depth,
            patches,
        })
    }
}

fn window(data: &[f64], shape: Shape, from: (usize, usize), side: usize) -> Vec<f64> {
    let row = |i: usize| &data[(from.0 + i) * shape.columns + from.1..][..side];
    (0..side).flat_map(|i| row(i).iter().copied()).collect()
}

/// Why a file is not a projected IFS.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileError {
    /// needed, given
    Length(usize, usize),
    /// it does not begin with "RIFS"
    Magic,
    /// a version this program does not know
    Version(u8),
    /// an impossible value in this field
    Field(&'static str),
    /// the checksum is wrong: bytes were damaged
    Checksum,
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            FileError::Length(needed, given) => {
                write!(
                    f,
                    "projected IFS: {needed} bytes are needed, {given} were given"
                )
            }
            FileError::Magic => write!(f, "not a projected IFS file (no \"RIFS\")"),
            FileError::Version(v) => write!(f, "projected IFS: unknown version {v}"),
            FileError::Field(name) => write!(f, "projected IFS: impossible {name}"),
            FileError::Checksum => write!(f, "projected IFS: wrong checksum, the file is damaged"),
        }
    }
}

impl core::error::Error for FileError {}
