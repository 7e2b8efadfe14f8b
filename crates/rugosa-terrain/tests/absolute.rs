//! Any sequence of returns, moves, changes of the datum and beams leaves the grid equal
//! to a map addressed by absolute cells: a naive one, in f64, that never moves.

use proptest::prelude::*;
use proptest::strategy::ValueTree;
use rugosa_grid::{Cell, Sample, State, Window};
use rugosa_terrain::{ElevationGrid, Fused, GridConfig, GroundCell, Point, Ray, SampleChoice};
use std::collections::HashMap;

const SIDE: usize = 17;
const RESOLUTION: f64 = 0.1;
const STEP: f64 = 0.0005;

/// One thing that happens to a map.
#[derive(Clone, Debug)]
enum Event {
    /// a return in `cell`, `part` 1/64 cells from its centre
    Return {
        cell: [i32; 2],
        part: [i32; 2],
        steps: i32,
        variance: f32,
    },
    /// a return with one broken number
    Broken { which: usize, value: f32 },
    /// the window goes to this cell
    Move { centre: [i32; 2] },
    /// the datum goes to this step
    Rebase { datum: i32 },
    /// a beam, metres
    Beam { from: [f32; 3], to: [f32; 3] },
    /// the next sweep begins
    Sweep,
}

/// What the naive map knows of a cell; heights in steps above the map's zero.
#[derive(Clone, Debug)]
struct Node {
    elevation: f64,
    variance: f64,
    min: i32,
    max: i32,
    count: u16,
    run: u8,
    sweep: u16,
    height: i32,
    part: [i32; 2],
}

/// The naive map.
struct Absolute {
    config: GridConfig,
    centre: [i32; 2],
    datum: i32,
    measured: HashMap<[i32; 2], Node>,
    seen_through: HashMap<[i32; 2], ()>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Outcome {
    Invalid,
    Outside,
    HeightOutOfRange,
    Gated,
    Merged,
    Sampled,
    Restarted,
}

impl Absolute {
    fn holds(&self, cell: [i32; 2]) -> bool {
        (0..2).all(|i| (cell[i] - self.centre[i]).abs() <= SIDE as i32 / 2)
    }

    fn fits(&self, steps: i32) -> bool {
        (-32768..=32767).contains(&(steps - self.datum))
    }

    fn take(
        &mut self,
        cell: [i32; 2],
        part: [i32; 2],
        steps: i32,
        variance: f64,
        sweep: u16,
    ) -> Outcome {
        if !self.holds(cell) {
            return Outcome::Outside;
        }
        if !self.fits(steps) {
            return Outcome::HeightOutOfRange;
        }
        let z = f64::from(steps) * STEP;
        let fresh = Node {
            elevation: z,
            variance: variance.max(STEP * STEP / 12.0),
            min: steps,
            max: steps,
            count: 1,
            run: 0,
            sweep,
            height: steps,
            part,
        };
        let Some(node) = self.measured.get_mut(&cell) else {
            self.seen_through.remove(&cell);
            self.measured.insert(cell, fresh);
            return Outcome::Sampled;
        };
        let distance = (z - node.elevation).abs();
        let (gate, relief) = (f64::from(self.config.gate), f64::from(self.config.relief));
        if distance > gate * (node.variance + variance + relief * relief).sqrt() {
            node.run += 1;
            if node.run < self.config.restart_after {
                return Outcome::Gated;
            }
            *node = fresh;
            return Outcome::Restarted;
        }
        let weight = 1.0 / node.variance + 1.0 / variance;
        node.elevation = (node.elevation / node.variance + z / variance) / weight;
        node.variance = (1.0 / weight).max(STEP * STEP / 12.0);
        node.min = node.min.min(steps);
        node.max = node.max.max(steps);
        node.count += 1;
        node.run = 0;
        node.sweep = sweep;
        let eccentricity = |p: [i32; 2]| p[0] * p[0] + p[1] * p[1];
        let better = match self.config.sample {
            SampleChoice::Nearest => {
                let old = eccentricity(node.part);
                old > 16 * 16 && 2 * eccentricity(part) < old
            }
            SampleChoice::Lowest => steps < node.height,
        };
        if !better {
            return Outcome::Merged;
        }
        (node.height, node.part) = (steps, part);
        Outcome::Sampled
    }

    /// The cells that a beam clears, and those it is too close to call.
    fn ghosts(&self, from: [f64; 3], to: [f64; 3], sweep: u16) -> Vec<([i32; 2], bool)> {
        let hit = [0, 1].map(|i| (to[i] / RESOLUTION).floor() as i32);
        let mut found = vec![];
        for (&cell, node) in &self.measured {
            if node.sweep == sweep {
                continue;
            }
            let (mut t, mut near) = ([0.0f64, 1.0f64], false);
            for i in 0..2 {
                let reach = to[i] - from[i];
                let borders = [0.0, 1.0].map(|b| (f64::from(cell[i]) + b) * RESOLUTION - from[i]);
                let (a, b) = (borders[0] / reach, borders[1] / reach);
                t = [t[0].max(a.min(b)), t[1].min(a.max(b))];
                near |= (to[i] - f64::from(cell[i]) * RESOLUTION).abs() < 1e-4;
                near |= (to[i] - f64::from(cell[i] + 1) * RESOLUTION).abs() < 1e-4;
            }
            let length = t[1] - t[0];
            if length < -1e-4 || (cell == hit && !near) {
                continue;
            }
            let height = |t: f64| from[2] + t * (to[2] - from[2]);
            let highest = height(t[0]).max(height(t[1]));
            let gap = node.elevation - highest - f64::from(self.config.clearing_margin);
            let needed = f64::from(self.config.gate) * node.variance.sqrt();
            let close_call = length < 1e-4 || (gap - needed).abs() < 1e-3 || gap.abs() < 1e-3;
            if close_call || near {
                found.push((cell, false));
            } else if gap > needed && gap > 0.0 {
                found.push((cell, true));
            }
        }
        found
    }
}

/// Runs the same events through both.
struct Pair<'m> {
    grid: ElevationGrid<'m>,
    naive: Absolute,
    sweep: u16,
    seen: Seen,
}

/// What the events brought about.
#[derive(Debug, Default)]
struct Seen {
    outcomes: HashMap<Outcome, usize>,
    cleared: usize,
    close_calls: usize,
    left: usize,
    dropped: usize,
}

impl Seen {
    fn add(&mut self, other: &Seen) {
        for (&outcome, n) in &other.outcomes {
            *self.outcomes.entry(outcome).or_default() += n;
        }
        self.cleared += other.cleared;
        self.close_calls += other.close_calls;
        self.left += other.left;
        self.dropped += other.dropped;
    }
}

/// A cell that was given up, as the grid told it.
type Gone = (Cell, Sample);

/// Collects what the grid tells about samples that went away.
fn collect(gone: &mut Vec<Gone>) -> impl FnMut(&Window, &[Sample], Cell, &Sample) {
    |window, samples, cell, old| {
        let held = samples[window
            .slot(cell)
            .expect("told of a cell outside the window")];
        assert!(!held.is_measured() && old.is_measured());
        gone.push((cell, *old));
    }
}

impl Pair<'_> {
    fn run(&mut self, event: &Event) {
        match *event {
            Event::Return {
                cell,
                part,
                steps,
                variance,
            } => self.fuse(cell, part, steps, variance),
            Event::Broken { which, value } => self.broken(which, value),
            Event::Move { centre } => self.shift(centre),
            Event::Rebase { datum } => self.rebase(datum),
            Event::Beam { from, to } => self.beam(from, to),
            Event::Sweep => self.sweep = self.sweep.wrapping_add(1),
        }
    }

    fn fuse(&mut self, cell: [i32; 2], part: [i32; 2], steps: i32, variance: f32) {
        let coordinate =
            |i: usize| (f64::from(cell[i]) + 0.5 + f64::from(part[i]) / 64.0) * RESOLUTION;
        let point = Point {
            position: [coordinate(0), coordinate(1), f64::from(steps) * STEP].map(|c| c as f32),
            variance,
            depression: 0.303,
        };
        let before = self.grid.sample(Cell::new(cell[0], cell[1]));
        let fused = self.grid.fuse(&point, self.sweep);
        let outcome = match fused {
            Fused::Invalid => Outcome::Invalid,
            Fused::Outside => Outcome::Outside,
            Fused::HeightOutOfRange => Outcome::HeightOutOfRange,
            Fused::Gated => Outcome::Gated,
            Fused::Merged => Outcome::Merged,
            Fused::Sampled { .. } => Outcome::Sampled,
            Fused::Restarted { .. } => Outcome::Restarted,
        };
        let expected = self
            .naive
            .take(cell, part, steps, f64::from(variance), self.sweep);
        assert_eq!(outcome, expected);
        *self.seen.outcomes.entry(outcome).or_default() += 1;
        if let Fused::Sampled { cell: found, old } | Fused::Restarted { cell: found, old } = fused {
            assert_eq!(found, Cell::new(cell[0], cell[1]));
            assert_eq!(old, before);
        }
    }

    fn broken(&mut self, which: usize, value: f32) {
        let mut numbers = [0.05, 0.05, 0.0, 1e-4];
        numbers[which] = value;
        let point = Point {
            position: [numbers[0], numbers[1], numbers[2]],
            variance: numbers[3],
            depression: 0.0,
        };
        assert_eq!(self.grid.fuse(&point, self.sweep), Fused::Invalid);
    }

    fn shift(&mut self, centre: [i32; 2]) {
        let mut gone = vec![];
        self.grid
            .move_to(Cell::new(centre[0], centre[1]), collect(&mut gone));
        self.naive.centre = centre;
        self.seen.left += gone.len();
        let holds = |c: &[i32; 2]| (0..2).all(|i| (c[i] - centre[i]).abs() <= SIDE as i32 / 2);
        let mut expected: Vec<_> = self
            .naive
            .measured
            .keys()
            .copied()
            .filter(|c| !holds(c))
            .collect();
        self.naive.measured.retain(|c, _| holds(c));
        self.naive.seen_through.retain(|c, _| holds(c));
        assert_same_cells(&gone, &mut expected);
    }

    fn rebase(&mut self, datum: i32) {
        let mut gone = vec![];
        let dropped = self.grid.rebase(datum, collect(&mut gone));
        self.naive.datum = datum;
        let misfits = |n: &Node| {
            [n.min, n.max, n.height]
                .iter()
                .any(|h| !(-32768..=32767).contains(&(h - datum)))
        };
        let mut expected: Vec<_> = self
            .naive
            .measured
            .iter()
            .filter(|(_, n)| misfits(n))
            .map(|(c, _)| *c)
            .collect();
        self.naive.measured.retain(|_, n| !misfits(n));
        assert_eq!(dropped as usize, gone.len());
        self.seen.dropped += gone.len();
        assert_same_cells(&gone, &mut expected);
    }

    fn beam(&mut self, from: [f32; 3], to: [f32; 3]) {
        let reach: [f32; 3] = std::array::from_fn(|i| to[i] - from[i]);
        let length = reach.iter().map(|c| c * c).sum::<f32>().sqrt();
        let ray = Ray {
            origin: from,
            direction: reach.map(|c| c / length),
            length,
        };
        let mut gone = vec![];
        let cleared = self.grid.see_through(&ray, self.sweep, collect(&mut gone));
        assert_eq!(cleared as usize, gone.len());
        self.seen.cleared += gone.len();
        let gone: Vec<_> = gone.iter().map(|(c, _)| [c.x, c.y]).collect();
        let expected = self
            .naive
            .ghosts(from.map(f64::from), to.map(f64::from), self.sweep);
        for cell in &gone {
            assert!(
                expected.iter().any(|(c, _)| c == cell),
                "{cell:?} should stay"
            );
        }
        for (cell, sure) in expected {
            assert!(gone.contains(&cell) || !sure, "{cell:?} should be cleared");
            self.seen.close_calls += usize::from(!sure);
        }
        for cell in gone {
            self.naive.measured.remove(&cell);
            self.naive.seen_through.insert(cell, ());
        }
    }

    /// Every cell of the window, and a border around it.
    fn compare(&self) {
        let states = self.grid.samples().iter().map(Sample::state);
        let count = |wanted| states.clone().filter(|state| *state == wanted).count() as u32;
        let census = self.grid.census();
        let counted = [State::Measured, State::SeenThrough].map(count);
        assert_eq!([census.measured, census.seen_through], counted);
        let half = SIDE as i32 / 2 + 2;
        let [x, y] = self.naive.centre;
        for cell in (-half..=half).flat_map(|i| (-half..=half).map(move |j| [x + i, y + j])) {
            self.compare_cell(cell);
        }
    }

    fn compare_cell(&self, cell: [i32; 2]) {
        let at = Cell::new(cell[0], cell[1]);
        let Some(node) = self.naive.measured.get(&cell) else {
            let seen = self.naive.seen_through.contains_key(&cell);
            let state = if seen {
                State::SeenThrough
            } else {
                State::Unknown
            };
            assert_eq!(self.grid.state(at), state, "{cell:?}");
            assert!(self.grid.ground(at).is_none() && self.grid.sample_position(at).is_none());
            return;
        };
        let ground = self
            .grid
            .ground(at)
            .unwrap_or_else(|| panic!("{cell:?} is missing"));
        let sample = self.grid.sample(at);
        let metres = |steps: i32| (f64::from(steps) * STEP) as f32;
        assert!(
            (f64::from(ground.elevation) - node.elevation).abs()
                < 1e-5 * (1.0 + node.elevation.abs())
        );
        assert!((f64::from(ground.variance) / node.variance - 1.0).abs() < 1e-3);
        assert_eq!((ground.count, ground.last_sweep), (node.count, node.sweep));
        assert!(
            (ground.min - metres(node.min)).abs() < 1e-5
                && (ground.max - metres(node.max)).abs() < 1e-5
        );
        assert_eq!(i32::from(sample.height) + self.grid.datum(), node.height);
        assert_eq!([i32::from(sample.east), i32::from(sample.north)], node.part);
        assert_eq!(sample.depression, 77);
    }
}

fn assert_same_cells(gone: &[Gone], expected: &mut [[i32; 2]]) {
    let mut gone: Vec<_> = gone.iter().map(|(c, _)| [c.x, c.y]).collect();
    gone.sort_unstable();
    expected.sort_unstable();
    assert_eq!(gone, expected);
}

/// Heights that agree within a cell to 2 cm or contradict each other by half a metre and
/// more, some of them beyond 16 bits.
fn heights() -> impl Strategy<Value = i32> {
    let level = prop_oneof![
        8 => Just(0), 3 => Just(1000), 1 => Just(-3000), 1 => Just(33_500), 1 => Just(-34_000)
    ];
    (level, -20..=20i32).prop_map(|(level, jitter)| level + jitter)
}

fn events() -> impl Strategy<Value = Vec<Event>> {
    let near = || prop::array::uniform2(-12..14i32);
    let part = prop::array::uniform2(-31..=31i32);
    let variance = prop_oneof![Just(1e-4f32), Just(4e-4), Just(1.5e-5)];
    let single = prop_oneof![
        60 => (near(), part, heights(), variance)
            .prop_map(|(cell, part, steps, variance)| Event::Return { cell, part, steps, variance }),
        2 => (0..4usize, prop_oneof![Just(f32::NAN), Just(f32::INFINITY), Just(f32::NEG_INFINITY)])
            .prop_map(|(which, value)| Event::Broken { which, value }),
        4 => near().prop_map(|c| Event::Move { centre: c.map(|i| i / 2) }),
        1 => prop::array::uniform2(-1000..1000i32).prop_map(|centre| Event::Move { centre }),
        2 => (-3000..3000i32).prop_map(|datum| Event::Rebase { datum }),
        8 => (prop::array::uniform2(-1.1f32..1.3), prop::array::uniform2(-1.1f32..1.3), 0.01f32..0.6)
            .prop_map(|(a, b, z)| Event::Beam { from: [a[0], a[1], z], to: [b[0], b[1], 0.0] }),
        8 => Just(Event::Sweep),
    ];
    // most cells are visited again and again, so that they merge, are refused, restart
    let burst = (
        near(),
        prop::collection::vec((prop::array::uniform2(-31..=31i32), heights()), 1..12),
    )
        .prop_map(|(cell, list)| {
            list.into_iter()
                .map(|(part, steps)| Event::Return {
                    cell,
                    part,
                    steps,
                    variance: 2e-4,
                })
                .collect::<Vec<_>>()
        });
    let piece = prop_oneof![3 => single.prop_map(|event| vec![event]), 1 => burst];
    prop::collection::vec(piece, 1..400).prop_map(|pieces| pieces.concat())
}

fn run(events: &[Event], sample: SampleChoice) -> Seen {
    let config = GridConfig {
        sample,
        ..GridConfig::new(RESOLUTION as f32)
    };
    let mut cells = vec![GroundCell::default(); SIDE * SIDE];
    let mut samples = vec![Sample::default(); SIDE * SIDE];
    let window = Window::around(SIDE, Cell::new(0, 0));
    let grid = ElevationGrid::new(config, window, &mut cells, &mut samples).unwrap();
    let naive = Absolute {
        config,
        centre: [0, 0],
        datum: 0,
        measured: HashMap::new(),
        seen_through: HashMap::new(),
    };
    let mut pair = Pair {
        grid,
        naive,
        sweep: 0,
        seen: Seen::default(),
    };
    for event in events {
        pair.run(event);
    }
    pair.compare();
    pair.seen
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn any_history_equals_absolute_addressing(events in events()) {
        run(&events, SampleChoice::Nearest);
    }

    #[test]
    fn and_so_with_the_lowest_return(events in events()) {
        run(&events, SampleChoice::Lowest);
    }
}

/// The comparison would be empty if some things never happened.
#[test]
fn everything_happens_in_the_histories() {
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let mut seen = Seen::default();
    for _ in 0..200 {
        let events = events().new_tree(&mut runner).unwrap().current();
        seen.add(&run(&events, SampleChoice::Nearest));
    }
    assert_eq!(seen.outcomes.len(), 6, "{seen:?}");
    assert!(seen.outcomes.values().all(|&n| n > 100), "{seen:?}");
    assert!(
        seen.cleared > 100 && seen.left > 100 && seen.dropped > 20,
        "{seen:?}"
    );
    assert!(seen.close_calls * 10 < seen.cleared, "{seen:?}");
}
