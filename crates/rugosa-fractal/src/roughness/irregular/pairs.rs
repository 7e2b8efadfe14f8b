//! Sums over all pairs of irregular points, by a cell list.
//!
//! The points are sorted into square cells of a sixth of the greatest lag, row by row,
//! so all candidates for a point in one row of cells are one contiguous stretch of
//! memory: of its own row what follows it, of the rows above what lies within the lag.
//! The loop over a stretch has no branches: the annulus is looked up from d² in a table
//! that is exact after one comparison with the annulus' border, no square root is taken,
//! and pairs outside all annuli go to a bin that is thrown away.
//!
//! Annuli are half-open, [low + i·width, low + (i + 1)·width). Coordinates are taken
//! relative to the middle of the points and kept in f32; partial sums are f32 over at most
//! [`FLUSH`] pairs, then f64 (test `equals_all_pairs_in_f64`).
//!
//! Cost: N log-free sorting, then about 1.3 candidates per pair.

use super::Bin;
use alloc::vec;
use alloc::vec::Vec;

/// Annuli of equal width.
///
/// ```
/// use rugosa_fractal::roughness::irregular::pairs::Bins;
/// let bins = Bins { low: 1.5, width: 1.0, count: 29 }; // metres
/// assert_eq!((bins.centre(0), bins.high()), (2.0, 30.5));
/// // half-open annuli
/// assert_eq!([1.4, 1.5, 2.5, 30.5].map(|d| bins.of(d)), [None, Some(0), Some(1), None]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bins {
    /// inner radius of the first \[m\]
    pub low: f64,
    /// width of each \[m\]
    pub width: f64,
    /// number of annuli
    pub count: usize,
}

impl Bins {
    /// Middle of an annulus \[m\].
    pub fn centre(&self, bin: usize) -> f64 {
        self.low + (bin as f64 + 0.5) * self.width
    }

    fn edge(&self, i: usize) -> f64 {
        self.low + i as f64 * self.width
    }

    /// Outer radius of the last \[m\].
    pub fn high(&self) -> f64 {
        self.edge(self.count)
    }

    /// The annulus of a distance.
    pub fn of(&self, distance: f64) -> Option<usize> {
        (0..self.count).find(|&i| (self.edge(i)..self.edge(i + 1)).contains(&distance))
    }
}

/// Sums over the pairs of one annulus.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums {
    /// C
    pub pairs: f64,
    /// A = Σ |Δz| \[m\]
    pub absolute: f64,
    /// B = Σ Δz² \[m²\]
    pub square: f64,
    /// Q = Σ d² \[m²\]
    pub distance: f64,
    /// Σ d⁴ \[m⁴\]; of irregular points as if their distances filled the annulus evenly
    pub quartic: f64,
}

impl Sums {
    pub(super) fn bin(&self, centre: f64) -> Bin {
        let lag = if self.pairs > 0.0 {
            libm::sqrt(self.distance / self.pairs)
        } else {
            centre
        };
        Bin {
            lag,
            mean_abs_dz: self.absolute / self.pairs,
            rms_dz: libm::sqrt(self.square / self.pairs),
            pairs: self.pairs as u64,
        }
    }
}

/// Area of the points' bounding box \[m²\]; a line of points has the square of its length.
///
/// ```
/// use rugosa_fractal::roughness::irregular::pairs::area;
/// assert_eq!(area(&[[0.0, 1.0, 9.0], [3.0, -1.0, 0.0]]), 6.0); // m²
/// assert_eq!(area(&[[0.0, 0.0, 0.0], [0.0, 5.0, 1.0]]), 25.0); // a line
/// ```
pub fn area(points: &[[f64; 3]]) -> f64 {
    let [w, h] = [0, 1].map(|axis| {
        let (low, high) = extent(points, axis);
        high - low
    });
    if w.min(h) > 1e-6 * w.max(h) {
        w * h
    } else {
        w.max(h) * w.max(h)
    }
}

fn extent(points: &[[f64; 3]], axis: usize) -> (f64, f64) {
    points
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| {
            (low.min(p[axis]), high.max(p[axis]))
        })
}

/// The sums of all annuli.
///
/// ```
/// use rugosa_fractal::roughness::irregular::pairs::{Bins, sums};
/// // 5 m and 10 m from the first to the others, 0.5 m up and 0.25 m down
/// let points = [[0.0, 0.0, 0.0], [3.0, 4.0, 0.5], [0.0, -10.0, -0.25]];
/// let [at_5, at_10] = sums(&points, &Bins { low: 2.5, width: 5.0, count: 2 })[..] else {
///     panic!("two bins");
/// };
/// assert_eq!((at_5.pairs, at_5.absolute, at_5.square), (1.0, 0.5, 0.25));
/// assert!((at_5.distance - 25.0).abs() < 1e-4 && at_10.pairs == 1.0); // m²
/// ```
pub fn sums(points: &[[f64; 3]], bins: &Bins) -> Vec<Sums> {
    if points.len() < 2 || bins.count == 0 {
        return vec![Sums::default(); bins.count];
    }
    let list = CellList::new(points, bins.high());
    let mut counter = Counter::new(bins);
    for row in 0..list.rows {
        list.visit_row(row, bins.high() as f32, &mut counter);
    }
    counter.finish(bins.count, bins.width)
}

/// Fewer, and more candidates lie outside; more, and the stretches become short.
const CELLS_PER_REACH: f64 = 6.0;

/// Points sorted by cell, row by row.
struct CellList {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    starts: Vec<u32>,
    columns: usize,
    rows: usize,
    edge: f32,
}

impl CellList {
    fn new(points: &[[f64; 3]], reach: f64) -> Self {
        let (west, east) = extent(points, 0);
        let (south, north) = extent(points, 1);
        let mean = points.iter().map(|p| p[2]).sum::<f64>() / points.len() as f64;
        let most = 2.0 * points.len() as f64 + 1024.0;
        let spread = libm::sqrt((east - west) * (north - south) / most)
            .max((east - west).max(north - south) / most);
        let edge = (reach / CELLS_PER_REACH).max(spread);
        let columns = ((east - west) / edge) as usize + 1;
        let rows = ((north - south) / edge) as usize + 1;
        let place = |p: &[f64; 3]| {
            let column = (((p[0] - west) / edge) as usize).min(columns - 1);
            (((p[1] - south) / edge) as usize).min(rows - 1) * columns + column
        };
        let mut starts = vec![0u32; columns * rows + 1];
        let places: Vec<u32> = points.iter().map(|p| place(p) as u32).collect();
        places
            .iter()
            .for_each(|&cell| starts[cell as usize + 1] += 1);
        (0..columns * rows).for_each(|cell| starts[cell + 1] += starts[cell]);
        let mut next = starts.clone();
        let [mut x, mut y, mut z] = [(); 3].map(|()| vec![0.0; points.len()]);
        for (p, &cell) in points.iter().zip(&places) {
            let at = next[cell as usize] as usize;
            next[cell as usize] += 1;
            (x[at], y[at], z[at]) = (
                (p[0] - west) as f32,
                (p[1] - south) as f32,
                (p[2] - mean) as f32,
            );
        }
        CellList {
            x,
            y,
            z,
            starts,
            columns,
            rows,
            edge: edge as f32,
        }
    }

    fn start(&self, row: usize, column: usize) -> usize {
        self.starts[row * self.columns + column] as usize
    }

    /// All pairs whose first member lies in this row of cells.
    fn visit_row(&self, row: usize, reach: f32, counter: &mut Counter) {
        // a little wider, against rounding of the coordinates to f32
        let reach = reach * 1.000_01;
        let last = (row + (reach / self.edge) as usize + 1).min(self.rows - 1);
        for i in self.start(row, 0)..self.start(row, self.columns) {
            let end = self.column(self.x[i] + reach) + 1;
            self.visit(i, i + 1..self.start(row, end).max(i + 1), counter);
            for above in row + 1..=last {
                let up = (above as f32 * self.edge - self.y[i]).max(0.0);
                let half = libm::sqrtf((reach * reach - up * up).max(0.0));
                let (from, to) = (self.column(self.x[i] - half), self.column(self.x[i] + half));
                self.visit(
                    i,
                    self.start(above, from)..self.start(above, to + 1),
                    counter,
                );
            }
        }
    }

    fn column(&self, x: f32) -> usize {
        ((x / self.edge) as usize).min(self.columns - 1)
    }

    #[inline]
    fn visit(&self, i: usize, stretch: core::ops::Range<usize>, counter: &mut Counter) {
        let (x, y, z) = (
            &self.x[stretch.clone()],
            &self.y[stretch.clone()],
            &self.z[stretch],
        );
        let from = [self.x[i], self.y[i], self.z[i]];
        for ((&x, &y), &z) in x.iter().zip(y).zip(z) {
            counter.add(from, [x, y, z]);
        }
        counter.pending += x.len();
        if counter.pending >= FLUSH {
            counter.flush();
        }
    }
}

/// Pairs between two flushes of the f32 partial sums.
pub const FLUSH: usize = 4096;

/// Steps of d²: fine enough that no step holds two borders of 64 annuli.
const TABLE: usize = 8192;

/// Bins that an 8-bit index reaches: it needs no check of bounds.
const BINS: usize = 256;

/// 2²³: adding it to a number below rounds that to an integer in the low bits.
const ROUNDING: f32 = 8_388_608.0;

/// Annulus sums in the making. Bin 0 and the last one take what lies outside.
struct Counter {
    /// partial sums: 1, |Δz|, Δz², d²
    partial: [[f32; 4]; BINS],
    total: [[f64; 4]; BINS],
    pending: usize,
    /// squared outer border of each bin
    border: [f32; BINS],
    /// bin at the lower end of each step of d²
    table: [u8; TABLE],
    steps: f32,
}

impl Counter {
    fn new(bins: &Bins) -> Self {
        let mut border = [f32::INFINITY; BINS];
        for (i, border) in border.iter_mut().enumerate().take(bins.count + 1) {
            let edge = bins.edge(i).max(0.0);
            *border = (edge * edge) as f32;
        }
        let steps = (TABLE - 2) as f32 / border[bins.count];
        let mut table = [0; TABLE];
        let mut bin = 0;
        for (i, entry) in table.iter_mut().enumerate() {
            while bin <= bins.count && (i as f32 - 0.51) / steps >= border[bin] {
                bin += 1;
            }
            *entry = bin as u8;
        }
        let (partial, total) = ([[0.0; 4]; BINS], [[0.0; 4]; BINS]);
        Counter {
            partial,
            total,
            pending: 0,
            border,
            table,
            steps,
        }
    }

    #[inline(always)]
    fn add(&mut self, from: [f32; 3], to: [f32; 3]) {
        let [dx, dy, dz] = [to[0] - from[0], to[1] - from[1], to[2] - from[2]];
        let square = dx * dx + dy * dy;
        let step = (square * self.steps).min((TABLE - 1) as f32) + ROUNDING;
        let guess = self.table[step.to_bits() as usize % TABLE];
        let outside = square >= self.border[usize::from(guess)];
        let sums = &mut self.partial[usize::from(guess.wrapping_add(u8::from(outside)))];
        let terms = [1.0, dz.abs(), dz * dz, square];
        sums.iter_mut()
            .zip(terms)
            .for_each(|(sum, term)| *sum += term);
    }

    fn flush(&mut self) {
        for (total, partial) in self.total.iter_mut().zip(&mut self.partial) {
            for (total, partial) in total.iter_mut().zip(partial) {
                *total += f64::from(core::mem::take(partial));
            }
        }
        self.pending = 0;
    }

    fn finish(mut self, count: usize, width: f64) -> Vec<Sums> {
        self.flush();
        let sums = |&[pairs, absolute, square, distance]: &[f64; 4]| Sums {
            pairs,
            absolute,
            square,
            distance,
            quartic: quartic(pairs, distance, width),
        };
        self.total[1..=count].iter().map(sums).collect()
    }
}

/// Σ d⁴ of `pairs` distances, Σ d² given, that fill an annulus of this width evenly.
fn quartic(pairs: f64, squares: f64, width: f64) -> f64 {
    squares * (squares / pairs.max(1.0) + width * width / 3.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random(seed: &mut u64) -> f64 {
        *seed = seed
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (*seed >> 11) as f64 / (1u64 << 53) as f64
    }

    fn all_pairs(points: &[[f64; 3]], bins: &Bins) -> Vec<Sums> {
        let mut sums = vec![Sums::default(); bins.count];
        for (i, p) in points.iter().enumerate() {
            for q in &points[..i] {
                let d2 = (p[0] - q[0]) * (p[0] - q[0]) + (p[1] - q[1]) * (p[1] - q[1]);
                if let Some(bin) = bins.of(libm::sqrt(d2)) {
                    let dz = (p[2] - q[2]).abs();
                    sums[bin].pairs += 1.0;
                    sums[bin].absolute += dz;
                    sums[bin].square += dz * dz;
                    sums[bin].distance += d2;
                }
            }
        }
        for sums in &mut sums {
            sums.quartic = quartic(sums.pairs, sums.distance, bins.width);
        }
        sums
    }

    #[test]
    fn equals_all_pairs_in_f64() {
        let mut seed = 3;
        for (width, height, shift) in [
            (40.0, 40.0, 0.0),
            (300.0, 2.0, -700.0),
            (1.0, 900.0, 5e5),
            (9.0, 7.0, 0.0),
        ] {
            let points: Vec<[f64; 3]> = (0..900)
                .map(|_| {
                    [
                        shift + width * random(&mut seed),
                        height * random(&mut seed) - shift,
                        9.0 * random(&mut seed),
                    ]
                })
                .collect();
            let bins = Bins {
                low: 0.75,
                width: 0.5,
                count: 20,
            };
            for (fast, slow) in sums(&points, &bins).iter().zip(all_pairs(&points, &bins)) {
                // a pair on a border may fall to either side in f32
                assert!(
                    (fast.pairs - slow.pairs).abs() <= 1e-3 * slow.pairs + 2.0,
                    "{fast:?} {slow:?}"
                );
                assert!((fast.absolute - slow.absolute).abs() <= 1e-3 * slow.absolute + 18.0);
                assert!((fast.square - slow.square).abs() <= 1e-3 * slow.square + 162.0);
            }
        }
    }

    #[test]
    fn lattice_points_fall_into_the_right_annuli_exactly() {
        let points: Vec<[f64; 3]> = (0..900)
            .map(|i| [f64::from(i % 30), f64::from(i / 30), f64::from(i * i % 17)])
            .collect();
        let bins = Bins {
            low: 1.5,
            width: 1.0,
            count: 12,
        };
        assert_eq!(sums(&points, &bins), all_pairs(&points, &bins));
    }

    #[test]
    fn degenerate_points_have_no_pairs() {
        let bins = Bins {
            low: 0.5,
            width: 1.0,
            count: 3,
        };
        assert!(sums(&[], &bins).iter().all(|s| s.pairs == 0.0));
        assert!(sums(&[[1.0; 3]; 50], &bins).iter().all(|s| s.pairs == 0.0));
    }
}
