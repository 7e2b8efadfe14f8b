//! Files in and out: points and rasters.
//!
//! A reader either returns everything or one [`Failure`] that names the file and the
//! place in it; a writer writes the whole file or leaves what was there ([`atomic`]).

pub mod archive;
pub mod asc;
pub mod atomic;
pub mod bag;
pub mod geotiff;
pub mod las;
pub mod npy;
pub mod npz;
pub mod output;
pub mod pcd;
pub mod perceptron;
pub mod ply;
pub mod text;

use crate::error::{Failure, Result};
use std::fs::File;
use std::io::{BufReader, Read};
use std::panic::{self, AssertUnwindSafe};
use std::path::Path;
use std::str::FromStr;
use std::sync::Mutex;

/// Points anywhere in space, metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Points {
    /// x, y, z
    pub xyz: Vec<[f64; 3]>,
    /// points of the file that were left out because a coordinate was NaN or infinite
    pub skipped: usize,
}

impl Points {
    /// Keeps the finite ones of `xyz` and counts the others; none left is an error.
    pub fn of(path: &Path, mut xyz: Vec<[f64; 3]>) -> Result<Self> {
        let total = xyz.len();
        xyz.retain(|p| p.iter().all(|v| v.is_finite()));
        let skipped = total - xyz.len();
        match (xyz.is_empty(), skipped) {
            (true, 0) => Err(Failure::file(path, "holds no points")),
            (true, n) => Err(Failure::file(
                path,
                format_args!("all {n} points have a coordinate that is not finite"),
            )),
            _ => Ok(Points { xyz, skipped }),
        }
    }

    /// Least and greatest x, y, z.
    pub fn bounds(&self) -> ([f64; 3], [f64; 3]) {
        let start = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        self.xyz.iter().fold(start, |(mut low, mut high), p| {
            for axis in 0..3 {
                low[axis] = low[axis].min(p[axis]);
                high[axis] = high[axis].max(p[axis]);
            }
            (low, high)
        })
    }
}

/// Elevations on a regular lattice, metres.
///
/// Node (row i, column j) lies at x = origin\[0\] + j · spacing_x,
/// y = origin\[1\] + i · spacing_y: row 0 is the least y. NaN is unknown.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster {
    /// rows (y)
    pub rows: usize,
    /// columns (x)
    pub columns: usize,
    /// distance between columns \[m\]
    pub spacing_x: f64,
    /// distance between rows \[m\]
    pub spacing_y: f64,
    /// where node (0, 0) lies \[m\]
    pub origin: [f64; 2],
    /// `rows × columns` elevations, row by row
    pub values: Vec<f32>,
}

impl Raster {
    /// A raster with square cells.
    pub fn square(
        rows: usize,
        columns: usize,
        spacing: f64,
        origin: [f64; 2],
        values: Vec<f32>,
    ) -> Self {
        assert_eq!(values.len(), rows * columns);
        Raster {
            rows,
            columns,
            spacing_x: spacing,
            spacing_y: spacing,
            origin,
            values,
        }
    }

    /// Elevation of the node (row, column).
    pub fn at(&self, row: usize, column: usize) -> f32 {
        self.values[row * self.columns + column]
    }

    /// Nodes that are known.
    pub fn known(&self) -> usize {
        self.values.iter().filter(|v| v.is_finite()).count()
    }

    /// Least and greatest known value; `None` where nothing is known.
    pub fn range(&self) -> Option<(f32, f32)> {
        let known = self.values.iter().copied().filter(|v| v.is_finite());
        known.fold(None, |range, v| match range {
            None => Some((v, v)),
            Some((low, high)) => Some((f32::min(low, v), f32::max(high, v))),
        })
    }

    /// The known nodes as points.
    pub fn points(&self) -> Vec<[f64; 3]> {
        let point = |i: usize| {
            let [x, y] = self.node(i);
            [x, y, f64::from(self.values[i])]
        };
        let known = (0..self.values.len()).filter(|&i| self.values[i].is_finite());
        known.map(point).collect()
    }

    /// x and y of node `i`, counted row by row \[m\].
    pub fn node(&self, i: usize) -> [f64; 2] {
        let (row, column) = (i / self.columns, i % self.columns);
        [
            self.origin[0] + column as f64 * self.spacing_x,
            self.origin[1] + row as f64 * self.spacing_y,
        ]
    }
}

/// What a file of heights holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Dataset {
    /// irregular points
    Points(Points),
    /// a regular lattice
    Raster(Raster),
}

/// Distances between columns and rows, `DX` or `DX,DY` on the command line \[m\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spacing {
    /// between columns
    pub x: f64,
    /// between rows
    pub y: f64,
}

impl FromStr for Spacing {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let (x, y) = text.split_once(',').unwrap_or((text, text));
        let parse = |t: &str| match t.trim().parse::<f64>() {
            Ok(v) if v.is_finite() && v > 0.0 => Ok(v),
            _ => Err(format!("'{t}' is not a positive number of metres")),
        };
        Ok(Spacing {
            x: parse(x)?,
            y: parse(y)?,
        })
    }
}

/// Reads points or a raster, whichever the file holds. `spacing` is needed for a 2-D
/// array of NumPy or an image, where it does not carry its own.
///
/// ```
/// use rugosa_host::io::{self, Dataset};
/// # fn main() -> rugosa_host::error::Result<()> {
/// # let folder = tempfile::tempdir().unwrap();
/// let path = folder.path().join("points.csv");
/// std::fs::write(&path, "x,y,z\n1,2,0.5\n3,4,nan\n").unwrap();
/// let Dataset::Points(points) = io::read(&path, None)? else {
///     panic!("a raster")
/// };
/// assert_eq!(points.xyz, [[1.0, 2.0, 0.5]]);
/// assert_eq!(points.skipped, 1);
/// # Ok(()) }
/// ```
pub fn read(path: &Path, spacing: Option<Spacing>) -> Result<Dataset> {
    guarded(path, || read_any(path, spacing))
}

fn read_any(path: &Path, spacing: Option<Spacing>) -> Result<Dataset> {
    match extension(path).as_str() {
        "csv" => text::read_csv(path).map(Dataset::Points),
        "xyz" | "txt" => text::read_xyz(path).map(Dataset::Points),
        "ply" => ply::read(path).map(Dataset::Points),
        "pcd" => pcd::read(path).map(Dataset::Points),
        "las" | "laz" => las::read(path).map(Dataset::Points),
        "mcap" => bag::read(path).map(Dataset::Points),
        "asc" => asc::read(path).map(Dataset::Raster),
        "tif" | "tiff" => geotiff::read(path, spacing).map(Dataset::Raster),
        "npy" => npy::read(path, spacing),
        "npz" => npz::read(path, spacing),
        "perc" => perceptron::read(path).map(Dataset::Points),
        _ if starts_as_perceptron(path) => perceptron::read(path).map(Dataset::Points),
        other => Err(Failure::file(path, unknown_extension(other))),
    }
}

/// Runs a reader. The libraries below some of them panic on damaged files; that becomes
/// an error like any other, without a trace on standard error.
fn guarded<T>(path: &Path, read: impl FnOnce() -> Result<T>) -> Result<T> {
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(()); // there is one hook per process
    let guard = ONE_AT_A_TIME.lock();
    let hook = panic::take_hook();
    panic::set_hook(Box::new(|_| {}));
    let read = panic::catch_unwind(AssertUnwindSafe(read));
    panic::set_hook(hook);
    drop(guard);
    read.unwrap_or_else(|_| Err(Failure::file(path, "damaged")))
}

/// Reads points; the known nodes of a raster are points too.
pub fn read_points(path: &Path, spacing: Option<Spacing>) -> Result<Points> {
    match read(path, spacing)? {
        Dataset::Points(points) => Ok(points),
        Dataset::Raster(raster) => Points::of(path, raster.points()),
    }
}

/// Reads a raster; a file of points is an error.
pub fn read_raster(path: &Path, spacing: Option<Spacing>) -> Result<Raster> {
    match read(path, spacing)? {
        Dataset::Raster(raster) => Ok(raster),
        Dataset::Points(_) => Err(Failure::file(
            path,
            "holds points; a raster (.asc, .tif or 2-D .npy) is needed here",
        )),
    }
}

/// The images of the range image database have no common extension.
fn starts_as_perceptron(path: &Path) -> bool {
    let mut start = [0; 8];
    let read = File::open(path).and_then(|mut file| file.read_exact(&mut start));
    read.is_ok() && perceptron::is_one(&start)
}

fn unknown_extension(extension: &str) -> String {
    let known = "known are .csv .xyz .txt .ply .pcd .las .laz .mcap .npy .npz .asc .tif .perc";
    if extension == "rugosa" {
        "a saved map: for `rugosa map`, `rugosa merge`, `rugosa info` and --resume only".into()
    } else if extension.is_empty() {
        format!("a file name without an extension; {known}")
    } else {
        format!("unknown file type '.{extension}'; {known}")
    }
}

/// The extension in lower case, without the dot.
pub fn extension(path: &Path) -> String {
    let extension = path.extension().and_then(|e| e.to_str());
    extension.unwrap_or_default().to_ascii_lowercase()
}

/// Opens a regular file for reading and tells its length.
fn open(path: &Path) -> Result<(BufReader<File>, u64)> {
    let file = File::open(path).map_err(|e| Failure::file(path, e))?;
    let metadata = file.metadata().map_err(|e| Failure::file(path, e))?;
    if metadata.is_dir() {
        return Err(Failure::file(path, "is a directory"));
    }
    Ok((BufReader::new(file), metadata.len()))
}

/// Reads a whole text file.
fn read_text(path: &Path) -> Result<String> {
    let (mut file, _) = open(path)?;
    let mut text = String::new();
    match file.read_to_string(&mut text) {
        Ok(_) => Ok(text),
        Err(error) => Err(Failure::file(path, error)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spacing_is_one_number_or_two() {
        assert_eq!("0.1".parse(), Ok(Spacing { x: 0.1, y: 0.1 }));
        assert_eq!("92.7, 74".parse(), Ok(Spacing { x: 92.7, y: 74.0 }));
        for bad in ["", "0", "-1", "nan", "inf", "1,", "a,1"] {
            assert!(bad.parse::<Spacing>().is_err(), "{bad}");
        }
    }

    #[test]
    fn points_of_a_raster_lie_on_its_nodes() {
        let raster = Raster {
            rows: 2,
            columns: 3,
            spacing_x: 2.0,
            spacing_y: 5.0,
            origin: [10.0, 100.0],
            values: vec![0.0, 1.0, 2.0, f32::NAN, 4.0, 5.0],
        };
        let points = raster.points();
        assert_eq!(points.len(), 5);
        assert_eq!(points[1], [12.0, 100.0, 1.0]);
        assert_eq!(points[3], [12.0, 105.0, 4.0]);
        assert_eq!(raster.range(), Some((0.0, 5.0)));
        assert_eq!(raster.known(), 5);
    }
}
