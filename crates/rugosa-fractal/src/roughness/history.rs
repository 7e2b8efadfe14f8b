//! Property test: any history of the map leaves the sums of a pass over all pairs.

extern crate std;
use super::*;
use proptest::prelude::*;
use rugosa_grid::{Cell, Sample, Tile, Tiles, Window};
use std::collections::{BTreeMap, BTreeSet};
use std::vec;
use std::vec::Vec;

const SIDE: usize = 33;

/// Sums without bounds, over samples addressed by absolute cells.
type Oracle = BTreeMap<(Tile, usize), [i128; 10]>;

fn all_pairs(map: &BTreeMap<Cell, Sample>) -> Oracle {
    let mut sums = Oracle::new();
    let lags: Vec<BTreeSet<_>> = (0..LAGS)
        .map(|l| offsets::offsets(l).iter().collect())
        .collect();
    for (a, lower) in map {
        for (b, upper) in map {
            let Ok(step) = i8::try_from(b.x - a.x).and_then(|x| Ok((x, i8::try_from(b.y - a.y)?)))
            else {
                continue;
            };
            if let Some(lag) = lags.iter().position(|lag| lag.contains(&step)) {
                let dz = i128::from(upper.height) - i128::from(lower.height);
                let dx =
                    i128::from(64 * (b.x - a.x) + i32::from(upper.east) - i32::from(lower.east));
                let dy =
                    i128::from(64 * (b.y - a.y) + i32::from(upper.north) - i32::from(lower.north));
                let noise = i128::from(lower.variance) + i128::from(upper.variance);
                let (x, y) = (i128::from(b.x - a.x), i128::from(b.y - a.y));
                let excess = if lag < 4 {
                    dx * dx + dy * dy - 4096 * (x * x + y * y)
                } else {
                    0
                };
                let pair = [
                    dz.abs(),
                    dz * dz,
                    1,
                    noise,
                    excess,
                    dz * x,
                    dz * y,
                    x * x,
                    x * y,
                    y * y,
                ];
                let entry = sums.entry((Tile::of(*a), lag)).or_default();
                entry.iter_mut().zip(pair).for_each(|(s, p)| *s += p);
            }
        }
    }
    sums
}

fn as_oracle(window: &Window, tiles: &[TileSums]) -> Oracle {
    let mut sums = Oracle::new();
    for tile in Tiles::of(window).tiles() {
        for (lag, s) in tiles[Tiles::of(window).slot(tile).unwrap()]
            .lags
            .iter()
            .enumerate()
        {
            let [tx, ty] = s.trend;
            let [xx, xy, yy] = s.spread;
            let all = [
                s.absolute as i128,
                s.square.into(),
                s.pairs.into(),
                s.noise.into(),
                s.excess.into(),
                tx.into(),
                ty.into(),
                xx.into(),
                xy.into(),
                yy.into(),
            ];
            if all != [0; 10] {
                sums.insert((tile, lag), all);
            }
        }
    }
    sums
}

/// A map that does everything by absolute addresses, beside the one under test.
struct Bench<'m> {
    window: Window,
    samples: Vec<Sample>,
    structure: StructureFunction<'m>,
    map: BTreeMap<Cell, Sample>,
    recomputed: u32,
}

impl Bench<'_> {
    fn put(&mut self, cell: Cell, sample: Sample) {
        let Some(slot) = self.window.slot(cell) else {
            return;
        };
        let old = core::mem::replace(&mut self.samples[slot], sample);
        let (structure, samples) = (&mut self.structure, &self.samples);
        match sample.is_measured() {
            true => {
                structure.sampled(&self.window, samples, cell, &old);
                self.map.insert(cell, sample);
            }
            false => {
                structure.replaced(&self.window, samples, cell, &old);
                self.map.remove(&cell);
            }
        }
    }

    fn go(&mut self, dx: i32, dy: i32) {
        let next = Window::new(SIDE, self.window.origin().offset(dx, dy));
        for cell in self.window.leaving(&next) {
            self.put(cell, Sample::default());
        }
        self.window = next;
    }

    fn commit(&mut self) {
        self.recomputed += self
            .structure
            .commit(&self.window, &mut self.samples)
            .recomputed;
    }
}

#[derive(Clone, Debug)]
enum Act {
    Put(i32, i32, i16, u16, i8, i8),
    Clear(i32, i32),
    Patch(i32, i32, i16),
    Go(i32, i32),
    Commit,
}

fn acts() -> impl Strategy<Value = Act> {
    let (x, y) = (0..SIDE as i32, 0..SIDE as i32);
    prop_oneof![
        20 => (x.clone(), y.clone(), any::<i16>(), any::<u16>(), -32..=32i8, -32..=32i8)
            .prop_map(|(x, y, h, v, e, n)| Act::Put(x, y, h, v, e, n)),
        20 => (x.clone(), y.clone(), -300..300i16, 0..90u16, -32..=32i8, -32..=32i8)
            .prop_map(|(x, y, h, v, e, n)| Act::Put(x, y, h, v, e, n)),
        6 => (x.clone(), y.clone()).prop_map(|(x, y)| Act::Clear(x, y)),
        3 => (x, y, any::<i16>()).prop_map(|(x, y, h)| Act::Patch(x, y, h)),
        1 => (-40..40, -40..40).prop_map(|(x, y)| Act::Go(x, y)),
        3 => (-3..3, -3..3).prop_map(|(x, y)| Act::Go(x, y)),
        3 => Just(Act::Commit),
    ]
}

fn patch(bench: &mut Bench, x: i32, y: i32, height: i16) {
    for i in 0..60 {
        let at = bench.window.origin().offset(x + i % 10, y + i / 10);
        let sample = Sample::measured(
            height.wrapping_add((i * i) as i16),
            i as u16,
            (i % 32) as i8,
            -5,
            0,
        );
        bench.put(at, sample);
    }
}

fn run(acts: &[Act]) -> u32 {
    let mut tiles = vec![TileSums::default(); StructureFunction::tiles_needed(SIDE)];
    let mut block = Block::new();
    let mut bench = Bench {
        window: Window::new(SIDE, Cell::new(-11, 5)),
        samples: vec![Sample::default(); SIDE * SIDE],
        structure: StructureFunction::new(SIDE, &mut tiles, &mut block),
        map: BTreeMap::new(),
        recomputed: 0,
    };
    for act in acts {
        let origin = bench.window.origin();
        match *act {
            Act::Put(x, y, h, v, e, n) => {
                bench.put(origin.offset(x, y), Sample::measured(h, v, e, n, 7))
            }
            Act::Clear(x, y) => bench.put(origin.offset(x, y), Sample::seen_through()),
            Act::Patch(x, y, h) => patch(&mut bench, x, y, h),
            Act::Go(x, y) => bench.go(x, y),
            Act::Commit => bench.commit(),
        }
    }
    bench.commit();
    assert_eq!(
        as_oracle(&bench.window, bench.structure.tiles()),
        all_pairs(&bench.map)
    );
    bench.recomputed
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn any_history_equals_a_pass_over_all_pairs(acts in prop::collection::vec(acts(), 1..700)) {
        run(&acts);
    }
}

#[test]
fn blocks_equal_single_pairs() {
    let level: Vec<_> = (0..20)
        .map(|i| Act::Patch(i % 5 * 7, i / 5 * 6, 50 * i as i16))
        .collect();
    assert!(run(&level) > 10);
    let steep: Vec<_> = (0..20)
        .map(|i| Act::Patch(i % 5 * 7, i / 5 * 6, 1500 * i as i16))
        .collect();
    assert!(run(&steep) > 10);
    // positions are kept modulo 1024 cells
    let far = [Act::Go(500, -1040)].into_iter().chain(level);
    assert!(run(&far.collect::<Vec<_>>()) > 10);
}

/// The last tile of one commit is the western neighbour of the first one of the next, and its
/// samples have been left behind in between.
#[test]
fn a_block_forgets_at_the_next_commit() {
    let fill = |x| (0..64).map(move |i| Act::Put(x + i % 8, i / 8, 3 * i as i16, 1, 0, 0));
    let mut acts = vec![Act::Go(10, -5), Act::Commit]; // cells −1 … 31 × 0 … 32
    acts.extend(fill(25));
    acts.extend([Act::Commit, Act::Go(33, 0)]); // cells 32 … 64
    acts.extend(fill(0));
    assert!(run(&acts) > 1);
}

/// The greatest sums that 32 bits hold: a wall of the greatest relief for which rows are summed
/// as vectors, its samples as far apart as they can be, the variances saturated.
#[test]
fn the_greatest_relief_does_not_overflow() {
    let side = SIDE as i32;
    let cells = (0..side * side).map(|i| (i % side, i / side));
    for (low, high) in [(0, 4_095), (-2_047, 2_048), (-2_047, 2_049)] {
        for wall in [8, 16, 24] {
            let upper = |at: i32| at >= wall;
            let eastward = |(x, y)| match upper(x) {
                true => Act::Put(x, y, high, u16::MAX, 32, 32),
                false => Act::Put(x, y, low, u16::MAX, -32, -32),
            };
            let northward = |(x, y)| match upper(y) {
                true => Act::Put(x, y, low, u16::MAX, 32, 32),
                false => Act::Put(x, y, high, u16::MAX, -32, -32),
            };
            assert!(run(&cells.clone().map(eastward).collect::<Vec<_>>()) > 10);
            assert!(run(&cells.clone().map(northward).collect::<Vec<_>>()) > 10);
        }
    }
}

#[test]
fn an_emptied_map_has_no_pairs() {
    let acts = [
        Act::Patch(3, 3, 9),
        Act::Commit,
        Act::Go(100, -60),
        Act::Commit,
    ];
    run(&acts);
}

/// The lowest height of all stands for none in a block.
#[test]
fn the_lowest_height_is_a_height() {
    let side = SIDE as i32;
    let put = |i| Act::Put(i % side, i / side, i16::MIN + (i % 5) as i16, 3, 1, -2);
    assert!(run(&(0..side * side).map(put).collect::<Vec<_>>()) > 10);
}

/// A sample that leaves changes the sums of the tiles that it had pairs with.
#[test]
fn what_leaves_is_news_to_its_partners() {
    let mut tiles = vec![TileSums::default(); StructureFunction::tiles_needed(SIDE)];
    let mut block = Block::new();
    let mut bench = Bench {
        window: Window::new(SIDE, Cell::new(0, 0)),
        samples: vec![Sample::default(); SIDE * SIDE],
        structure: StructureFunction::new(SIDE, &mut tiles, &mut block),
        map: BTreeMap::new(),
        recomputed: 0,
    };
    let changed = |bench: &mut Bench, tile| {
        let slot = Tiles::of(&bench.window).slot(tile).unwrap();
        bench.structure.tiles_mut()[slot].take_changed()
    };
    for x in [23, 24] {
        bench.put(Cell::new(x, 0), Sample::measured(0, 0, 0, 0, 0));
    }
    bench.commit();
    assert!(changed(&mut bench, Tile::new(2, 0)) && !changed(&mut bench, Tile::new(2, 0)));
    bench.go(-9, 0); // cells −9 … 23
    bench.commit();
    assert!(changed(&mut bench, Tile::new(2, 0)));
}
