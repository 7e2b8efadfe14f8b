//! Time of the elevation grid, per return.
//!
//! `cargo bench -p rugosa-terrain` prints the table; `cargo bench -p rugosa-terrain -- WHAT N`
//! runs one of `points`, `rays`, `clear` N times on 60 × 50 beams, or a number of cells
//! per side on 100000 points, and prints nothing: for counting instructions
//! (`valgrind --tool=callgrind`); the difference of two runs is the work.
//!
//! The scene is that of a published measurement of FastDEM, a C++ elevation mapper:
//! 60 rings × 500 (125 × 1000) beams at −50 … −4.5°, ground near z = −1 m, range noise
//! 1 cm, cells of 0.1 m. Its medians there, one thread: 1.7 and 7.6 ms for mapping, 9.8
//! and 24.2 ms with clearing by rays. They come from another machine (an AMD EPYC, Zen 4),
//! so the ratio is an orientation; the times per return of this program compare among
//! themselves.

use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use rugosa_grid::{Cell, Sample, Window};
use rugosa_terrain::grid::View;
use rugosa_terrain::{
    Beams, ElevationGrid, Geometry, GridConfig, GroundCell, LineTrig, Noise, Raster, Ray, Tally,
    Trig,
};

const SIDE: usize = 257;
const RESOLUTION: f32 = 0.1;

/// A sweep over the scene, in the sensor frame.
struct Scan {
    rings: usize,
    columns: usize,
    points: Vec<[f32; 3]>,
    ranges: Vec<f32>,
}

/// Height of the ground \[m\] below a sensor at the origin.
fn ground(x: f64, y: f64) -> f64 {
    0.15 * (0.8 * x + 0.3).sin() * (0.6 * y).cos()
        + 0.08 * (1.7 * x - 1.1 * y).sin()
        + 0.04 * (4.1 * y + 2.3 * x).sin()
        + 0.02 * (9.0 * x).sin() * (8.0 * y).sin()
        - 1.0
}

/// Uniform numbers in [0, 1).
struct Uniform(u64);

impl Uniform {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.next()).ln()).sqrt() * (std::f64::consts::TAU * self.next()).cos()
    }
}

const LOWEST: f64 = -50.0;
const HIGHEST: f64 = -4.5;

fn inclination(ring: usize, rings: usize) -> f64 {
    (LOWEST + (HIGHEST - LOWEST) * ring as f64 / (rings - 1) as f64).to_radians()
}

/// First range at which a beam is below the ground.
fn range_to_ground(unit: [f64; 3]) -> f64 {
    let below = |r: f64| r * unit[2] < ground(r * unit[0], r * unit[1]);
    let mut far = 0.5;
    while !below(far) {
        far += 0.05;
    }
    let mut near = far - 0.05;
    for _ in 0..20 {
        let middle = 0.5 * (near + far);
        if below(middle) {
            far = middle
        } else {
            near = middle
        }
    }
    far
}

impl Scan {
    fn new(rings: usize, columns: usize) -> Self {
        let mut uniform = Uniform(1);
        let (mut points, mut ranges) = (vec![], vec![]);
        for ring in 0..rings {
            let (sin, cos) = inclination(ring, rings).sin_cos();
            for column in 0..columns {
                let azimuth = std::f64::consts::TAU * column as f64 / columns as f64;
                let unit = [cos * azimuth.cos(), cos * azimuth.sin(), sin];
                let range = range_to_ground(unit) + 0.01 * uniform.normal();
                points.push(unit.map(|u| (u * range) as f32));
                ranges.push(range as f32);
            }
        }
        Scan {
            rings,
            columns,
            points,
            ranges,
        }
    }
}

/// The planes of a grid.
struct Planes {
    side: usize,
    cells: Vec<GroundCell>,
    samples: Vec<Sample>,
}

impl Planes {
    fn new(side: usize) -> Self {
        Planes {
            side,
            cells: vec![GroundCell::default(); side * side],
            samples: vec![Sample::default(); side * side],
        }
    }

    fn grid(&mut self) -> ElevationGrid<'_> {
        let window = Window::around(self.side, Cell::new(0, 0));
        let config = GridConfig::new(RESOLUTION);
        ElevationGrid::new(config, window, &mut self.cells, &mut self.samples).unwrap()
    }
}

fn pose() -> Isometry3<f32> {
    let rotation = UnitQuaternion::from_euler_angles(0.01, -0.02, 0.4);
    Isometry3::from_parts(Translation3::new(0.02, 0.03, 1.0), rotation)
}

fn noise() -> Noise {
    Noise::new(0.01, 0.001, 0.0005)
}

/// Points of the sensor frame, in a block.
fn points(grid: &mut ElevationGrid, scan: &Scan, sweep: u16) -> Tally {
    let view = View {
        map_from_sensor: &pose(),
        noise: &noise(),
        sweep,
    };
    grid.fuse_points(&scan.points, &view, |_, _, _, _| {})
}

/// Ranges line by line through the beam tables.
fn rays(grid: &mut ElevationGrid, beams: &Beams, scan: &Scan, sweep: u16) -> Tally {
    let (pose, noise) = (pose(), noise());
    let mut tally = Tally::default();
    for (line, ranges) in scan.ranges.chunks(scan.columns).enumerate() {
        let rays = beams.rays(line, &pose).unwrap();
        for (column, &range) in ranges.iter().enumerate() {
            let ray = rays.ray(column, range).unwrap();
            tally.add(&grid.fuse(&ray.measured(&noise), sweep));
        }
    }
    tally
}

/// The same, and every beam clears what it passed below.
fn clear(grid: &mut ElevationGrid, beams: &Beams, scan: &Scan, sweep: u16) -> Tally {
    let tally = rays(grid, beams, scan, sweep);
    let pose = pose();
    for (line, ranges) in scan.ranges.chunks(scan.columns).enumerate() {
        let rays = beams.rays(line, &pose).unwrap();
        for (column, &range) in ranges.iter().enumerate() {
            let ray: Ray = rays.ray(column, range).unwrap();
            grid.see_through(&ray, sweep, |_, _, _, _| {});
        }
    }
    tally
}

/// Processor time of this thread \[ns\]: what other programs do to the machine counts
/// only through the caches.
#[cfg(unix)]
fn now() -> f64 {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    t.tv_sec as f64 * 1e9 + t.tv_nsec as f64
}

#[cfg(not(unix))]
fn now() -> f64 {
    static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    START
        .get_or_init(std::time::Instant::now)
        .elapsed()
        .as_nanos() as f64
}

/// Median and least of many runs \[ns\].
fn time<R>(runs: usize, mut run: impl FnMut(u16) -> R) -> (f64, f64) {
    let mut times: Vec<f64> = (0..runs)
        .map(|sweep| {
            let start = now();
            std::hint::black_box(run(sweep as u16));
            now() - start
        })
        .collect();
    times.sort_by(f64::total_cmp);
    (times[runs / 2], times[0])
}

fn report(name: &str, (median, least): (f64, f64), count: usize, published_ms: Option<f64>) {
    let n = count as f64;
    print!(
        "  {name:<28} {:8.3} ms  {:6.1} ns per return, least {:6.1}",
        median / 1e6,
        median / n,
        least / n
    );
    match published_ms {
        Some(ms) => println!("   {:.2} of FastDEM's {ms} ms", median / 1e6 / ms),
        None => println!(),
    }
}

fn with_beams<R>(scan: &Scan, run: impl FnOnce(&Beams) -> R) -> R {
    let mut columns = vec![Trig::default(); scan.columns];
    let mut lines = vec![LineTrig::default(); scan.rings];
    let raster = Raster {
        azimuth: [0.0, std::f32::consts::TAU / scan.columns as f32],
        inclination: [
            inclination(0, scan.rings) as f32,
            (inclination(1, scan.rings) - inclination(0, scan.rings)) as f32,
        ],
    };
    run(&Beams::new(
        Geometry::Spherical,
        raster,
        &mut columns,
        &mut lines,
    ))
}

fn scene(rings: usize, columns: usize, published: [f64; 2]) {
    let scan = Scan::new(rings, columns);
    let n = scan.points.len();
    let runs = 3_000_000 / n;
    let mut planes = Planes::new(SIDE);
    let mut grid = planes.grid();
    let tally = points(&mut grid, &scan, 0);
    let seen = grid.samples().iter().filter(|s| s.is_measured()).count();
    println!("{n} points, {SIDE}² cells of {RESOLUTION} m, {seen} of them seen; {tally:?}");
    let repeat = time(runs, |sweep| points(&mut grid, &scan, sweep));
    let mut fresh = vec![];
    for _ in 0..runs {
        let mut grid = planes.grid();
        fresh.push(time(1, |sweep| points(&mut grid, &scan, sweep)).0);
    }
    fresh.sort_by(f64::total_cmp);
    report(
        "points, empty map",
        (fresh[runs / 2], fresh[0]),
        n,
        Some(published[0]),
    );
    report("points, next sweeps", repeat, n, Some(published[0]));
    with_beams(&scan, |beams| {
        let mut grid = planes.grid();
        let t = time(runs, |sweep| rays(&mut grid, beams, &scan, sweep));
        report("ranges through beam tables", t, n, Some(published[0]));
        let t = time(runs / 10, |sweep| clear(&mut grid, beams, &scan, sweep));
        report("the same with clearing", t, n, Some(published[1]));
    });
}

/// Points spread evenly over a whole map of `side` cells.
fn spread(side: usize) -> Scan {
    let mut uniform = Uniform(5);
    let half = f64::from(RESOLUTION) * side as f64 * 0.499;
    let point = |_| {
        let mut place = || ((2.0 * uniform.next() - 1.0) * half) as f32;
        [place(), place(), (0.02 * uniform.normal()) as f32 - 1.0]
    };
    Scan {
        rings: 1,
        columns: 1,
        points: (0..100_000).map(point).collect(),
        ranges: vec![],
    }
}

fn sizes() {
    println!("100000 points all over a map of");
    for side in [65usize, 129, 257, 513] {
        let scan = spread(side);
        let mut planes = Planes::new(side);
        let mut grid = planes.grid();
        let t = time(30, |sweep| points(&mut grid, &scan, sweep));
        report(&format!("{side}² cells"), t, scan.points.len(), None);
    }
}

/// One kind of work, N times, for counting instructions.
fn count(what: &str, times: u16) {
    let side = what.parse().ok();
    let scan = side.map_or_else(|| Scan::new(60, 50), spread);
    let mut planes = Planes::new(side.unwrap_or(SIDE));
    let mut grid = planes.grid();
    with_beams(&scan, |beams| {
        for sweep in 0..times {
            let tally = match what {
                _ if side.is_some() || what == "points" => points(&mut grid, &scan, sweep),
                "rays" => rays(&mut grid, beams, &scan, sweep),
                "clear" => clear(&mut grid, beams, &scan, sweep),
                _ => Tally::default(),
            };
            std::hint::black_box(tally);
        }
    });
}

fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with('-'))
        .collect();
    if let [what, times] = &words[..] {
        return count(what, times.parse().expect("N must be a number"));
    }
    scene(60, 500, [1.7, 9.8]);
    scene(125, 1000, [7.6, 24.2]);
    sizes();
}
