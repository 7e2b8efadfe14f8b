//! Time of the whole mapper per point, with and without the counters of the structure
//! function, and per side of the map.
//!
//! `cargo bench -p rugosa` prints the tables. The scene is that of a published measurement
//! of FastDEM, a C++ elevation mapper: 60 rings × 500 (125 × 1000) beams at −50 … −4.5°
//! over smooth ground 1 m below, range noise 1 cm, cells of 0.1 m; its medians, one
//! thread, were 1.7 and 7.6 ms for mapping and 8.6 and 14.4 ms for its features. They come
//! from another machine, so the ratios (columns `(m+c)/F`, mapping and counters, and
//! `(r+c)/F`, roughness and costs) are an orientation.

use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use rugosa::traversability::CellCost;
use rugosa::{Config, Mapper, Memory, TileGround, tiles_of};
use rugosa_fractal::roughness::{Block, TileSums};
use rugosa_grid::Sample;
use rugosa_terrain::grid::View;
use rugosa_terrain::{GroundCell, Noise};

struct Planes {
    cells: Vec<GroundCell>,
    samples: Vec<Sample>,
    tiles: Vec<TileSums>,
    ground: Vec<TileGround>,
    costs: Vec<CellCost>,
    block: Box<Block>,
}

impl Planes {
    fn new(side: usize) -> Self {
        Planes {
            cells: vec![GroundCell::EMPTY; side * side],
            samples: vec![Sample::UNKNOWN; side * side],
            tiles: vec![TileSums::EMPTY; tiles_of(side)],
            ground: vec![TileGround::EMPTY; tiles_of(side)],
            costs: vec![CellCost::UNKNOWN; side * side],
            block: Box::default(),
        }
    }

    fn mapper(&mut self) -> Mapper<'_> {
        let memory = Memory {
            cells: &mut self.cells,
            samples: &mut self.samples,
            tiles: &mut self.tiles,
            ground: &mut self.ground,
            costs: &mut self.costs,
            solver: &mut [],
            block: &mut self.block,
            columns: &mut [],
            lines: &mut [],
            received: &mut [],
        };
        Mapper::new(Config::default(), memory).unwrap()
    }
}

/// Height of the ground \[m\] below a sensor at the origin.
fn ground(x: f64, y: f64) -> f64 {
    0.15 * (0.8 * x + 0.3).sin() * (0.6 * y).cos()
        + 0.08 * (1.7 * x - 1.1 * y).sin()
        + 0.04 * (4.1 * y + 2.3 * x).sin()
        + 0.02 * (9.0 * x).sin() * (8.0 * y).sin()
        - 1.0
}

fn scan(rings: usize, columns: usize, seed: u64) -> Vec<[f32; 3]> {
    let mut state = seed;
    let mut uniform = move || {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut points = Vec::new();
    for ring in 0..rings {
        let inclination = (-50.0 + 45.5 * ring as f64 / (rings - 1) as f64).to_radians();
        for column in 0..columns {
            let azimuth = std::f64::consts::TAU * column as f64 / columns as f64;
            let unit = [
                inclination.cos() * azimuth.cos(),
                inclination.cos() * azimuth.sin(),
                inclination.sin(),
            ];
            let mut range = 0.5;
            while range * unit[2] > ground(range * unit[0], range * unit[1]) {
                range += 0.01;
            }
            let normal =
                (-2.0 * (1.0 - uniform()).ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos();
            points.push(unit.map(|u| (u * (range + 0.01 * normal)) as f32));
        }
    }
    points
}

/// One sweep's times \[ms\].
#[derive(Clone, Copy, Default)]
struct Times {
    points: f64,
    counters: f64,
    roughness: f64,
    costs: f64,
    samples: u32,
    measured: u32,
}

/// Processor time of this thread \[ms\]; 0 where instructions are counted instead.
fn now() -> f64 {
    if is_counting() {
        return 0.0;
    }
    let t = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    t.tv_sec as f64 * 1e3 + t.tv_nsec as f64 / 1e6
}

/// `-- N` on the command line: N runs of the first scene and no table, to count instructions
/// (`valgrind --tool=callgrind`).
fn runs_to_count() -> Option<u32> {
    std::env::args().nth(1).and_then(|n| n.parse().ok())
}

fn is_counting() -> bool {
    static COUNTING: std::sync::OnceLock<bool> = std::sync::OnceLock::new();
    *COUNTING.get_or_init(|| runs_to_count().is_some())
}

fn sweep(mapper: &mut Mapper, points: &[[f32; 3]], number: u16) -> Times {
    let pose = Isometry3::from_parts(
        Translation3::new(0.02, 0.03, 1.0),
        UnitQuaternion::from_euler_angles(0.01, -0.02, 0.4),
    );
    let noise = Noise::new(0.01, 0.001, 0.0005);
    let view = View {
        map_from_sensor: &pose,
        noise: &noise,
        sweep: number,
    };
    let start = now();
    mapper.points(points, &view);
    let mut ends = vec![start, now()];
    let report = mapper.commit(&mut |_| ends.push(now()));
    Times {
        points: ends[1] - ends[0],
        counters: ends[2] - ends[1],
        roughness: ends[3] - ends[2],
        costs: ends[5] - ends[4],
        samples: report.samples,
        measured: report.measured,
    }
}

fn median(times: &[Times], of: impl Fn(&Times) -> f64) -> f64 {
    let mut values: Vec<f64> = times.iter().map(of).collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn print(name: &str, times: &[Times], published: [f64; 2]) {
    let [points, counters, roughness, costs, samples] = [
        median(times, |t| t.points),
        median(times, |t| t.counters),
        median(times, |t| t.roughness),
        median(times, |t| t.costs),
        median(times, |t| f64::from(t.samples)),
    ];
    println!(
        "  {name:<38} {samples:>6} {points:>8.2} {counters:>9.2} {roughness:>10.2} {costs:>7.2} \
         {:>7.2} {:>8.2}",
        (points + counters) / published[0],
        (roughness + costs) / published[1]
    );
}

const SWEEPS: usize = 30;

fn sweeps(rings: usize, columns: usize) -> Vec<Vec<[f32; 3]>> {
    (0..SWEEPS as u64)
        .map(|seed| scan(rings, columns, seed))
        .collect()
}

/// Writes the sweeps of both scenes, N x 3 float32 each, for other mappers.
fn write(folder: &std::path::Path) -> std::io::Result<()> {
    for (rings, columns) in SCENES {
        for (i, points) in sweeps(rings, columns).iter().enumerate() {
            let name = format!("{}_{i:02}.f32", points.len());
            let bytes = points.as_flattened().iter().flat_map(|v| v.to_le_bytes());
            std::fs::write(folder.join(name), bytes.collect::<Vec<u8>>())?;
        }
    }
    Ok(())
}

/// Rings and columns.
const SCENES: [(usize, usize); 2] = [(60, 500), (125, 1000)];

/// First sweeps on an empty map, and further ones with fresh noise, or the same again.
fn scene((rings, columns): (usize, usize), published: [f64; 2]) {
    let scans = sweeps(rings, columns);
    let mut planes = Planes::new(257);
    let first: Vec<Times> = (0..15)
        .map(|_| sweep(&mut planes.mapper(), &scans[0], 0))
        .collect();
    let mut mapper = planes.mapper();
    let next: Vec<Times> = scans
        .iter()
        .enumerate()
        .map(|(i, points)| sweep(&mut mapper, points, i as u16))
        .collect();
    let mut mapper = planes.mapper();
    let same: Vec<Times> = (0..SWEEPS)
        .map(|i| sweep(&mut mapper, &scans[0], i as u16))
        .collect();
    println!(
        "{} points, {} cells measured",
        scans[0].len(),
        first[0].measured
    );
    print("first sweep, empty map", &first, published);
    print("second to fifth sweep, fresh noise", &next[1..5], published);
    print(
        "sixth to thirtieth sweep, fresh noise",
        &next[5..],
        published,
    );
    print("the same points again", &same[1..], published);
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [command, folder, ..] = &arguments[..]
        && command == "write"
    {
        return write(folder.as_ref()).unwrap();
    }
    if let Some(runs) = runs_to_count() {
        let points = scan(60, 500, 1);
        let mut planes = Planes::new(257);
        for _ in 0..runs {
            sweep(&mut planes.mapper(), &points, 0);
        }
        return;
    }
    println!("scene of FastDEM, 257 x 257 cells of 0.1 m, one thread, medians [ms]");
    println!(
        "  {:<38} {:>6} {:>8} {:>9} {:>10} {:>7} {:>7} {:>8}",
        "", "new", "mapping", "counters", "roughness", "costs", "(m+c)/F", "(r+c)/F"
    );
    scene(SCENES[0], [1.7, 8.6]);
    scene(SCENES[1], [7.6, 14.4]);
    println!("\nthe 30,000 points on maps of other sides: work per point does not grow");
    println!("side  mapping [ns/point]  counters [us/new sample]");
    let points = scan(60, 500, 1);
    for side in [65, 129, 257, 513] {
        let half = side as f32 * 0.05;
        let inside = |p: &&[f32; 3]| p[0].hypot(p[1]) < half;
        let near: Vec<[f32; 3]> = points.iter().filter(inside).copied().collect();
        let mut planes = Planes::new(side);
        let times: Vec<Times> = (0..15)
            .map(|_| sweep(&mut planes.mapper(), &near, 0))
            .collect();
        println!(
            "{side:>4}  {:>18.1}  {:>24.3}",
            median(&times, |t| t.points) * 1e6 / near.len() as f64,
            median(&times, |t| t.counters * 1e3 / f64::from(t.samples))
        );
    }
}
