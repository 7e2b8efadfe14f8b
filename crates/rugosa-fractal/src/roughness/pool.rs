//! Sums of several tiles together, and the moments of elevation differences from them.
//!
//! One tile holds too few independent pairs for a dimension; a block of 3 × 3 tiles
//! (24 × 24 cells) is the smallest that is worth one. Sums are pooled as integers, noise
//! is taken off as an integer, and only then become floating-point moments:
//!
//! * raw second moment S² = B / C, first moment E = A / C;
//! * sensor noise n = N / C;
//! * trend: the plane g = (Σ G)⁻¹ Σ T over all lags, its part of B is 2 gᵀT − gᵀG g;
//! * squared distance q = (Gxx + Gyy + X) / C and its relative variance κ. κ follows from q
//!   and the lag's nominal offsets, because the samples' places inside their cells add
//!   equally in x and y: var d² = var d₀² + 2 E d₀² s² + s⁴, s² = q − E d₀². For the same reason
//!   the places add |g|² X / 2 to the trend. Beyond the lags up to [`NEAR_LAGS`], of which X is
//!   kept, X / C is the mean of those.
//!
//! Cost: 5 tiles × 8 lags × 10 additions for each of a row of tiles ([`Pools`]), 11 for one alone.

use super::offsets::{LAGS, NEAR_LAGS, nominal_moments};
use super::sums::{LagSums, TileSums};
use rugosa_grid::{TILE, Tile, Tiles, math, sample::PARTS};

/// Sums over several tiles.
///
/// ```
/// use rugosa_fractal::roughness::{LagSums, Pool, TileSums};
/// # use rugosa_grid::Sample;
/// // 3 height steps up to the east, none to the north
/// let [here, east, north] = [0, 3, 0].map(|z| Sample::measured(z, 1, 0, 0, 255));
/// let mut tile = TileSums::EMPTY;
/// tile.lags[0] += &LagSums::of_pair(0, &here, &east, (1, 0));
/// tile.lags[0] += &LagSums::of_pair(0, &here, &north, (0, 1));
/// let mut pool = Pool::new();
/// pool.add(&tile);
/// // cells of 0.5 m, steps of 1 cm
/// let (moments, [to_the_east, to_the_north]) = pool.moments_and_slope(0.5, 0.01);
/// assert_eq!((moments[0].pairs, moments[0].distance()), (2, 0.5));
/// assert!((moments[0].mean_square - 0.03f32.powi(2) / 2.0).abs() < 1e-8);
/// assert!((moments[0].noise - 0.0002).abs() < 1e-8); // two variances of 1 step²
/// assert!((to_the_east - 0.06).abs() < 1e-6 && to_the_north.abs() < 1e-6);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pool {
    lags: [WideSums; LAGS],
    tiles: u32,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct WideSums {
    square: u64,
    trend: [i64; 2],
    absolute: u64,
    pairs: u32,
    noise: u64,
    excess: i64,
    /// Gxx and Gyy, enough for 29,000 full tiles
    squares: [u32; 2],
    /// Gxy
    mixed: i32,
}

/// What one lag says: moments of elevation differences in metres.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moment {
    /// number of pairs
    pub pairs: u32,
    /// mean squared distance \[m²\]
    pub square_distance: f32,
    /// relative variance of the squared distance
    pub spread: f32,
    /// mean |Δz| \[m\], sensor noise included
    pub mean_absolute: f32,
    /// mean Δz² \[m²\], sensor noise included
    pub mean_square: f32,
    /// the sensor noise in it \[m²\]
    pub noise: f32,
    /// what the plane of the pool contributes to it \[m²\]
    pub trend: f32,
}

impl Pool {
    /// Nothing.
    pub fn new() -> Self {
        Pool::default()
    }

    /// The 3 × 3 tiles around `tile`, as far as they exist.
    ///
    /// ```
    /// use rugosa_fractal::roughness::{LagSums, Pool, TileSums};
    /// use rugosa_grid::{Cell, Sample, Tile, Tiles, Window};
    /// let tiles = Tiles::of(&Window::new(33, Cell::new(0, 0)));
    /// let mut sums = [TileSums::EMPTY; 25];
    /// let sample = Sample::measured(0, 0, 0, 0, 255);
    /// for tile in tiles.tiles() {
    ///     sums[tiles.slot(tile).unwrap()].lags[0] = LagSums::of_pair(0, &sample, &sample, (1, 0));
    /// }
    /// let pairs = |x, y| Pool::around(&sums, &tiles, Tile::new(x, y)).pairs();
    /// assert_eq!((pairs(2, 2), pairs(0, 2), pairs(0, 0)), (9, 6, 4)); // inside, border, corner
    /// assert_eq!(Pool::of_all(&sums).pairs(), 25);
    /// ```
    pub fn around(sums: &[TileSums], tiles: &Tiles, tile: Tile) -> Self {
        Pools::new(sums, tiles).around(tile)
    }

    /// All tiles of a map.
    pub fn of_all(sums: &[TileSums]) -> Self {
        let mut pool = Pool::new();
        sums.iter().for_each(|tile| pool.add(tile));
        pool
    }

    /// One tile more.
    pub fn add(&mut self, tile: &TileSums) {
        if tile.lags.iter().all(|lag| lag.pairs == 0) {
            return;
        }
        for (wide, sums) in self.lags.iter_mut().zip(&tile.lags) {
            wide.add(sums);
        }
        self.tiles += 1;
    }

    /// All tiles of another pool more.
    fn join(&mut self, other: &Pool) {
        for (wide, sums) in self.lags.iter_mut().zip(&other.lags) {
            wide.join(sums);
        }
        self.tiles += other.tiles;
    }

    /// Pairs of all lags.
    pub fn pairs(&self) -> u32 {
        self.lags.iter().map(|lag| lag.pairs).sum()
    }

    /// Edge of a square as large as the tiles that hold pairs \[cells\].
    pub fn side(&self) -> f32 {
        TILE as f32 * math::sqrt(self.tiles as f32)
    }

    /// The moments of all lags, for cells of `resolution` \[m\] and heights in steps of
    /// `height_step` \[m\].
    pub fn moments(&self, resolution: f32, height_step: f32) -> [Moment; LAGS] {
        self.moments_and_slope(resolution, height_step).0
    }

    /// The moments, and the plane that explains most of the pool's differences: (east,
    /// north), rise over run.
    pub fn moments_and_slope(
        &self,
        resolution: f32,
        height_step: f32,
    ) -> ([Moment; LAGS], [f32; 2]) {
        let gradient = self.gradient();
        let places = self.places();
        let moment = |lag: usize| {
            let excess = if lag < NEAR_LAGS {
                signed(self.lags[lag].excess) / (PARTS * PARTS) as f32
            } else {
                places * self.lags[lag].pairs as f32
            };
            self.lags[lag].moment(lag, gradient, excess, resolution, height_step)
        };
        let scale = height_step / resolution;
        (core::array::from_fn(moment), gradient.map(|g| g * scale))
    }

    /// What the places of the samples in their cells add to a squared distance \[cells²\].
    fn places(&self) -> f32 {
        let (mut excess, mut pairs) = (0, 0);
        for lag in &self.lags[..NEAR_LAGS] {
            excess += lag.excess;
            pairs += lag.pairs;
        }
        signed(excess).max(0.0) / (pairs.max(1) as f32 * (PARTS * PARTS) as f32)
    }

    /// g = (Σ G)⁻¹ Σ T in height steps per cell.
    fn gradient(&self) -> [f32; 2] {
        let mut t = [0; 2];
        let [mut xx, mut xy, mut yy] = [0.0; 3];
        for lag in &self.lags {
            t = [t[0] + lag.trend[0], t[1] + lag.trend[1]];
            let spread = lag.spread();
            (xx, xy, yy) = (xx + spread[0], xy + spread[1], yy + spread[2]);
        }
        let [tx, ty] = t.map(signed);
        let determinant = xx * yy - xy * xy;
        if determinant <= 1e-3 * xx * yy {
            return [0.0; 2];
        }
        [
            (yy * tx - xy * ty) / determinant,
            (xx * ty - xy * tx) / determinant,
        ]
    }
}

/// The pools around tiles that are asked for from west to east: the columns of three tiles that
/// two neighbours share are added up once.
///
/// ```
/// use rugosa_fractal::roughness::{LagSums, Pool, Pools, TileSums};
/// use rugosa_grid::{Cell, Sample, Tile, Tiles, Window};
/// let tiles = Tiles::of(&Window::new(33, Cell::new(-9, 5)));
/// let mut sums = [TileSums::EMPTY; 25];
/// for (i, sums) in (0..).zip(&mut sums) {
///     let [lower, upper] = [0, i].map(|z| Sample::measured(z, 0, 0, 0, 255));
///     sums.lags[0] = LagSums::of_pair(0, &lower, &upper, (1, 0));
/// }
/// let mut pools = Pools::new(&sums, &tiles);
/// let [east, north_east] = [(0, 2), (1, 3)].map(|(x, y)| Tile::new(x, y));
/// for tile in tiles.tiles().filter(|tile| tile.x != 0).chain([east, north_east]) {
///     let mut pool = Pool::new();
///     tiles.around(tile).iter().filter_map(|&slot| sums.get(slot)).for_each(|near| pool.add(near));
///     assert_eq!(pools.around(tile), pool);
/// }
/// ```
pub struct Pools<'a> {
    sums: &'a [TileSums],
    tiles: &'a Tiles,
    /// those of column x of tiles at x mod 3
    columns: [Pool; 3],
    /// the tile that they are around
    at: Option<Tile>,
}

impl<'a> Pools<'a> {
    /// Of the tiles of a map.
    pub fn new(sums: &'a [TileSums], tiles: &'a Tiles) -> Self {
        Pools {
            sums,
            tiles,
            columns: [Pool::new(); 3],
            at: None,
        }
    }

    /// The 3 × 3 tiles around `tile`, as far as they exist.
    pub fn around(&mut self, tile: Tile) -> Pool {
        let is_next = self.at == Some(Tile::new(tile.x - 1, tile.y));
        let first = if is_next { 1 } else { -1 };
        for x in tile.x + first..=tile.x + 1 {
            self.add_up(Tile::new(x, tile.y - 1));
        }
        self.at = Some(tile);
        let mut pool = self.columns[0];
        for column in &self.columns[1..] {
            pool.join(column);
        }
        pool
    }

    /// The column of three tiles from `lowest` to the north.
    fn add_up(&mut self, lowest: Tile) {
        let column = &mut self.columns[lowest.x.rem_euclid(3) as usize];
        *column = Pool::new();
        let slots = self.tiles.rectangle::<1, 3>(lowest);
        for tile in slots.iter().filter_map(|[slot]| self.sums.get(*slot)) {
            column.add(tile);
        }
    }
}

impl Moment {
    /// Root mean square distance \[m\].
    pub fn distance(&self) -> f32 {
        math::sqrt(self.square_distance)
    }
}

impl WideSums {
    #[inline(always)]
    fn add(&mut self, sums: &LagSums) {
        self.square += sums.square;
        self.absolute += u64::from(sums.absolute);
        self.pairs += sums.pairs;
        self.noise += u64::from(sums.noise);
        self.excess += i64::from(sums.excess);
        let ([tx, ty], [xx, xy, yy]) = (sums.trend.map(i64::from), sums.spread);
        self.trend = [self.trend[0] + tx, self.trend[1] + ty];
        self.squares = [self.squares[0] + xx as u32, self.squares[1] + yy as u32];
        self.mixed += xy;
    }

    #[inline(always)]
    fn join(&mut self, other: &WideSums) {
        self.square += other.square;
        self.absolute += other.absolute;
        self.pairs += other.pairs;
        self.noise += other.noise;
        self.excess += other.excess;
        self.trend = core::array::from_fn(|i| self.trend[i] + other.trend[i]);
        self.squares = core::array::from_fn(|i| self.squares[i] + other.squares[i]);
        self.mixed += other.mixed;
    }

    /// G: xx, xy, yy
    #[inline(always)]
    fn spread(&self) -> [f32; 3] {
        let [xx, yy] = self.squares.map(|square| square as f32);
        [xx, self.mixed as f32, yy]
    }

    /// `excess` is X \[cells²\].
    fn moment(
        &self,
        lag: usize,
        [gx, gy]: [f32; 2],
        excess: f32,
        resolution: f32,
        height_step: f32,
    ) -> Moment {
        if self.pairs == 0 {
            return Moment::default();
        }
        let share = 1.0 / self.pairs as f32;
        let ([tx, ty], [xx, xy, yy]) = (self.trend.map(signed), self.spread());
        let trend = gx * (2.0 * tx - gx * (xx - 0.5 * excess) - 2.0 * gy * xy)
            + gy * (2.0 * ty - gy * (yy - 0.5 * excess));
        let square = (xx + yy + excess) * share;
        let area = height_step * height_step * share;
        Moment {
            pairs: self.pairs,
            square_distance: resolution * resolution * square,
            spread: spread(lag, square),
            mean_absolute: float(self.absolute) * share * height_step,
            mean_square: float(self.square) * area,
            noise: float(self.noise) * area,
            trend: trend * area,
        }
    }
}

/// A wide integer, within 1.5 units in the last place, in halves: a processor without
/// 64-bit conversion takes ten times as long for the last half unit.
#[inline(always)]
fn float(n: u64) -> f32 {
    (n >> 32) as u32 as f32 * 4_294_967_296.0 + n as u32 as f32
}

#[inline(always)]
fn signed(n: i64) -> f32 {
    let size = float(n.unsigned_abs());
    if n < 0 { -size } else { size }
}

/// κ = var d² / (E d²)² for a mean squared distance \[cells²\].
fn spread(lag: usize, square: f32) -> f32 {
    let (second, fourth) = nominal_moments(lag);
    let inside = (square - second).max(0.0);
    let variance = fourth - second * second + 2.0 * second * inside + inside * inside;
    variance / (square * square)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rugosa_grid::Sample;

    /// A plane that rises by 2 steps per 1/64 cell to the east, its samples anywhere in their
    /// cells: at 1 and at 6 cells.
    #[test]
    fn places_in_cells_lengthen_all_lags_and_explain_a_plane() {
        let sample =
            |x: i16, east: i8| Sample::measured(2 * (64 * x + i16::from(east)), 0, east, 0, 255);
        let mut tile = TileSums::EMPTY;
        for (lower, upper) in [(-32, 32), (32, -32), (0, 0)] {
            for (lag, x) in [(0, 1), (4, 6)] {
                let (lower, upper) = (sample(0, lower), sample(x, upper));
                tile.lags[lag] += &LagSums::of_pair(lag, &lower, &upper, (x.into(), 0));
            }
        }
        let flat = Sample::measured(0, 0, 0, 0, 255);
        tile.lags[0] += &LagSums::of_pair(0, &flat, &flat, (0, 1));
        let mut pool = Pool::new();
        pool.add(&tile);
        let ([near, .., far, _, _, _], [east, north]) = pool.moments_and_slope(64.0, 1.0);
        assert!((east - 2.0).abs() < 1e-5 && north.abs() < 1e-5);
        // 0, 2, 1 and 1 cells long; X is 2 cells² for four pairs
        assert!((near.square_distance - 64.0 * 64.0 * 6.0 / 4.0).abs() < 0.1);
        assert!((far.square_distance - 64.0 * 64.0 * (36.0 + 0.5)).abs() < 0.5);
        // half of X counts for the east, which here is all of it
        assert!((near.trend - 4.0 * 64.0 * 64.0 * (3.0 + 1.0) / 4.0).abs() < 1.0);
    }
}
