//! Time of the whole mapper per point, with and without the counters of the structure
//! function, and per side of the map.
//!
//! `cargo bench -p rugosa` prints the tables. The scene is that of a published measurement
//! of FastDEM, a C++ elevation mapper: 60 rings × 500 (125 × 1000) beams at −50 … −4.5°
//! over smooth ground 1 m below, range noise 1 cm, cells of 0.1 m; its medians, one
//! thread, were 1.7 and 7.6 ms for mapping and 8.6 and 14.4 ms for its features. They come
//! from another machine, so that ratio is an orientation.

use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use rugosa::traversability::CellCost;
use rugosa::{Config, Mapper, Memory, Stage, TileGround, tiles_of};
use rugosa_fractal::roughness::{Block, TileSums};
use rugosa_grid::Sample;
use rugosa_terrain::grid::View;
use rugosa_terrain::{GroundCell, Noise};
use std::time::Instant;

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

fn scan(rings: usize, columns: usize) -> Vec<[f32; 3]> {
    let mut state = 1u64;
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

struct Times {
    points_ms: f64,
    commit_ms: f64,
    /// of it: slope, step, hidden step, cost; and the roughness of tiles
    features_ms: f64,
    roughness_ms: f64,
    measured: u32,
}

/// Least times of several runs, each on an empty map.
fn measure(side: usize, points: &[[f32; 3]], runs: usize) -> Times {
    let pose = Isometry3::from_parts(
        Translation3::new(0.02, 0.03, 1.0),
        UnitQuaternion::from_euler_angles(0.01, -0.02, 0.4),
    );
    let noise = Noise::new(0.01, 0.001, 0.0005);
    let view = View {
        map_from_sensor: &pose,
        noise: &noise,
        sweep: 1,
    };
    let mut best = Times {
        points_ms: f64::MAX,
        commit_ms: f64::MAX,
        features_ms: f64::MAX,
        roughness_ms: f64::MAX,
        measured: 0,
    };
    for _ in 0..runs {
        let mut planes = Planes::new(side);
        let mut mapper = planes.mapper();
        let start = Instant::now();
        mapper.points(points, &view);
        let points_ms = start.elapsed().as_secs_f64() * 1e3;
        let (mut last, mut stages) = (start, Vec::new());
        let report = mapper.commit(&mut |stage| {
            let now = Instant::now();
            stages.push((stage, (now - last).as_secs_f64() * 1e3));
            last = now;
        });
        let of = |wanted| stages.iter().find(|s| s.0 == wanted).map_or(0.0, |s| s.1);
        best.features_ms = best.features_ms.min(of(Stage::Traversability));
        best.roughness_ms = best.roughness_ms.min(of(Stage::Roughness));
        let total_ms = start.elapsed().as_secs_f64() * 1e3;
        best.points_ms = best.points_ms.min(points_ms);
        best.commit_ms = best.commit_ms.min(total_ms - points_ms);
        best.measured = report.measured;
    }
    best
}

fn main() {
    // `-- N`: N runs of the first scene and no table, to count instructions
    if let Some(runs) = std::env::args().nth(1).and_then(|n| n.parse().ok()) {
        measure(257, &scan(60, 500), runs);
        return;
    }
    println!("scene of FastDEM, 257 x 257 cells of 0.1 m, empty map, one thread, least of 30 runs");
    println!("points   cells   points [ms]  [ns/point]  commit [ms]  sum / FastDEM");
    let mut features = Vec::new();
    for (rings, columns, fastdem, its_features) in [(60, 500, 1.7, 8.6), (125, 1000, 7.6, 14.4)] {
        let points = scan(rings, columns);
        let t = measure(257, &points, 30);
        let sum = t.points_ms + t.commit_ms;
        println!(
            "{:>6}  {:>6}  {:>11.2}  {:>10.1}  {:>11.2}  {:>13.2}",
            points.len(),
            t.measured,
            t.points_ms,
            t.points_ms * 1e6 / points.len() as f64,
            t.commit_ms,
            sum / fastdem
        );
        features.push((t, its_features));
    }
    println!(
        "\nfeatures of the same maps: slope, step, hidden step, cost; D, H, sigma of the tiles"
    );
    println!("cells   features [ms]  [ns/cell]  D, H, sigma [ms]  sum / FastDEM's features");
    for (t, fastdem) in features {
        println!(
            "{:>6}  {:>12.2}  {:>9.1}  {:>16.2}  {:>24.2}",
            t.measured,
            t.features_ms,
            t.features_ms * 1e6 / f64::from(t.measured),
            t.roughness_ms,
            (t.features_ms + t.roughness_ms) / fastdem
        );
    }
    println!("\nthe same 30,000 points on maps of other sides: work per point does not grow");
    println!("side   points [ms]  [ns/point in the map]  counters + D [us/cell]");
    let points = scan(60, 500);
    for side in [65, 129, 257, 513] {
        let half = side as f32 * 0.05;
        let inside = |p: &&[f32; 3]| p[0].hypot(p[1]) < half;
        let near: Vec<[f32; 3]> = points.iter().filter(inside).copied().collect();
        let t = measure(side, &near, 30);
        println!(
            "{side:>4}  {:>11.3}  {:>21.1}  {:>22.3}",
            t.points_ms,
            t.points_ms * 1e6 / near.len() as f64,
            t.commit_ms * 1e3 / f64::from(t.measured)
        );
    }
}
