//! Which neighbours of a cell make the pairs of which lag.
//!
//! Eight lags of nominally 1, 2, 3, 4, 6, 8, 12 and 16 cells; the offsets of lag d lie in
//! the annulus | |offset| − d | < ½. Each unordered pair of cells is met once: offsets
//! lie in the half-plane y > 0, or y = 0 and x > 0, and point from the *lower* member of
//! the pair to the *upper* one. Together with their opposites the offsets of a lag are
//! invariant under quarter turns and reflections, so no direction is preferred (test
//! `the_offsets_of_a_lag_prefer_no_direction`).
//!
//! The true distance of a pair comes from the samples' places inside their cells; the
//! lag only decides which pairs are summed together (Arakawa and Krotkov 1996, § 2.4,
//! use annuli in the same way).

/// Number of lags.
pub const LAGS: usize = 8;

/// So many lags are short: up to 4 cells.
pub const NEAR_LAGS: usize = 4;

/// Nominal lags, in cells.
pub const LAG_CELLS: [u8; LAGS] = [1, 2, 3, 4, 6, 8, 12, 16];

/// No offset reaches further than this in x or y, in cells.
pub const REACH: i32 = 16;

/// Offsets of all lags together.
pub const OFFSETS: usize = START[LAGS] as usize;

/// One (a, b), a ≥ b ≥ 0, stands for all offsets that quarter turns and reflections make of it.
const ORBITS: [&[(i8, i8)]; LAGS] = [
    &[(1, 0), (1, 1)],
    &[(2, 0), (2, 1)],
    &[(3, 0), (3, 1), (2, 2)],
    &[(4, 0), (4, 1), (3, 2), (3, 3)],
    &[(6, 0), (6, 1), (5, 3), (4, 4)],
    &[(8, 0), (8, 2), (7, 4), (6, 5)],
    &[(12, 0), (12, 3), (11, 5), (10, 7), (9, 8)],
    &[(16, 0), (16, 3), (15, 6), (13, 9), (12, 11)],
];

const START: [u8; LAGS + 1] = starts();
static TABLE: [(i8, i8); OFFSETS] = OFFSET_TABLE;
const OFFSET_TABLE: [(i8, i8); OFFSETS] = table();

/// The offsets (x, y) of lag number `lag`, in cells.
///
/// ```
/// use rugosa_fractal::roughness::offsets::offsets;
/// // east, north, and the two diagonals to the north: every pair is met once
/// assert_eq!(offsets(0), [(1, 0), (0, 1), (1, 1), (-1, 1)]);
/// ```
#[inline]
pub fn offsets(lag: usize) -> &'static [(i8, i8)] {
    &TABLE[START[lag] as usize..START[lag + 1] as usize]
}

/// The columns (bit x + [`REACH`]) of the partners of a cell `rows` = 0 … [`REACH`] rows away, of
/// all lags: upper ones lie to the north and, in its own row, to the east; lower ones to the south
/// and west.
///
/// ```
/// use rugosa_fractal::roughness::offsets::{lag_of, partners};
/// let columns = |rows, is_upper| -> Vec<i32> {
///     (-16..=16).filter(|x| partners(rows, is_upper) >> (x + 16) & 1 == 1).collect()
/// };
/// assert_eq!(columns(0, true), [1, 2, 3, 4, 6, 8, 12, 16]);
/// assert_eq!(columns(0, false), [-16, -12, -8, -6, -4, -3, -2, -1]);
/// assert_eq!(columns(15, true), [-6, 6]);
/// assert_eq!(columns(15, true).into_iter().map(|x| lag_of(x, 15)).max(), Some(7));
/// ```
#[inline(always)]
pub fn partners(rows: usize, is_upper: bool) -> u64 {
    let columns = COLUMNS.get(rows).map_or(0, |columns| *columns);
    const WEST: u64 = (1 << REACH) - 1;
    match (rows, is_upper) {
        (0, true) => columns & !WEST,
        (0, false) => columns & WEST,
        _ => columns,
    }
}

/// Number of the lag to which the offset (x, y) or its opposite belongs.
#[inline(always)]
pub fn lag_of(x: i32, y: i32) -> usize {
    let place = y.unsigned_abs() as usize * SIDE + x.unsigned_abs() as usize;
    LAG_TABLE.get(place).map_or(0, |lag| usize::from(*lag))
}

/// Offsets reach so many rows, and columns to each side, the own one among them.
const SIDE: usize = REACH as usize + 1;
static COLUMNS: [u64; SIDE] = columns();
static LAG_TABLE: [u8; SIDE * SIDE] = lag_table();

const fn columns() -> [u64; SIDE] {
    let (mut columns, mut at) = ([0; SIDE], 0);
    while at < OFFSETS {
        let (x, y) = OFFSET_TABLE[at];
        columns[y as usize] |= 1 << (x as i32 + REACH) | 1 << (REACH - x as i32);
        at += 1;
    }
    columns
}

const fn lag_table() -> [u8; SIDE * SIDE] {
    let (mut table, mut lag) = ([0; SIDE * SIDE], 0);
    while lag < LAGS {
        let mut at = START[lag] as usize;
        while at < START[lag + 1] as usize {
            let (x, y) = OFFSET_TABLE[at];
            table[y as usize * SIDE + x.unsigned_abs() as usize] = lag as u8;
            at += 1;
        }
        lag += 1;
    }
    table
}

static MOMENTS: [(f32, f32); LAGS] = moments();

/// Mean of |offset|² and of |offset|⁴ over the offsets of a lag, in cells² and cells⁴.
///
/// ```
/// use rugosa_fractal::roughness::offsets::nominal_moments;
/// // 1, 1, 2 and 2 cells²
/// assert_eq!(nominal_moments(0), (1.5, 2.5));
/// ```
#[inline]
pub fn nominal_moments(lag: usize) -> (f32, f32) {
    MOMENTS[lag]
}

/// The members of an orbit in the half-plane; the second half may repeat the first.
const fn members((a, b): (i8, i8)) -> ([(i8, i8); 4], usize) {
    let all = [(a, b), (-b, a), (b, a), (-a, b)];
    (all, if b == 0 || a == b { 2 } else { 4 })
}

const fn starts() -> [u8; LAGS + 1] {
    let mut start = [0; LAGS + 1];
    let mut lag = 0;
    while lag < LAGS {
        start[lag + 1] = start[lag];
        let mut i = 0;
        while i < ORBITS[lag].len() {
            start[lag + 1] += members(ORBITS[lag][i]).1 as u8;
            i += 1;
        }
        lag += 1;
    }
    start
}

const fn table() -> [(i8, i8); OFFSETS] {
    let mut table = [(0, 0); OFFSETS];
    let (mut lag, mut at) = (0, 0);
    while lag < LAGS {
        let mut i = 0;
        while i < ORBITS[lag].len() {
            let (all, count) = members(ORBITS[lag][i]);
            let mut k = 0;
            while k < count {
                table[at] = all[k];
                at += 1;
                k += 1;
            }
            i += 1;
        }
        lag += 1;
    }
    table
}

const fn moments() -> [(f32, f32); LAGS] {
    let mut moments = [(0.0, 0.0); LAGS];
    let mut lag = 0;
    while lag < LAGS {
        let (mut sums, mut at) = ((0, 0), START[lag] as usize);
        while at < START[lag + 1] as usize {
            let (x, y) = (OFFSET_TABLE[at].0 as i32, OFFSET_TABLE[at].1 as i32);
            let square = x * x + y * y;
            sums = (sums.0 + square, sums.1 + square * square);
            at += 1;
        }
        let count = (START[lag + 1] - START[lag]) as f32;
        moments[lag] = (sums.0 as f32 / count, sums.1 as f32 / count);
        lag += 1;
    }
    moments
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::collections::BTreeSet;

    fn full(lag: usize) -> BTreeSet<(i8, i8)> {
        let both = offsets(lag).iter().flat_map(|&(x, y)| [(x, y), (-x, -y)]);
        both.collect()
    }

    #[test]
    fn the_offsets_of_a_lag_prefer_no_direction() {
        for lag in 0..LAGS {
            let full = full(lag);
            assert_eq!(full.len(), 2 * offsets(lag).len());
            assert!(
                full.iter()
                    .all(|&(x, y)| full.contains(&(-y, x)) && full.contains(&(-x, y)))
            );
        }
    }

    #[test]
    fn each_offset_lies_in_the_half_annulus_of_one_lag() {
        let mut seen = BTreeSet::new();
        for (lag, &nominal) in LAG_CELLS.iter().enumerate() {
            assert!(offsets(lag).len() <= 24);
            for &(x, y) in offsets(lag) {
                let distance = (f64::from(x) * f64::from(x) + f64::from(y) * f64::from(y)).sqrt();
                assert!((distance - f64::from(nominal)).abs() < 0.5);
                assert!(y > 0 || (y == 0 && x > 0));
                assert!(i32::from(x.abs()).max(i32::from(y)) <= REACH);
                assert!(seen.insert((x, y)));
            }
        }
        assert_eq!(seen.len(), OFFSETS);
        assert!((80..=110).contains(&OFFSETS));
    }

    #[test]
    fn rows_hold_the_offsets_and_their_opposites() {
        let all = |is_upper| -> BTreeSet<(usize, i32, i32)> {
            let row = |y: i32| {
                let columns = partners(y as usize, is_upper);
                let columns = (-REACH..=REACH).filter(move |x| columns >> (x + REACH) & 1 == 1);
                columns.map(move |x| (lag_of(x, y), x, if is_upper { y } else { -y }))
            };
            (0..=REACH).flat_map(row).collect()
        };
        let of_lag = |lag: usize| {
            let each = offsets(lag).iter();
            each.map(move |&(x, y)| (lag, i32::from(x), i32::from(y)))
        };
        let upper: BTreeSet<_> = (0..LAGS).flat_map(of_lag).collect();
        let lower = upper.iter().map(|&(lag, x, y)| (lag, -x, -y)).collect();
        assert_eq!((all(true), all(false)), (upper, lower));
    }

    #[test]
    fn nominal_moments_of_the_first_lag() {
        assert_eq!(nominal_moments(0), (1.5, 2.5));
    }
}
