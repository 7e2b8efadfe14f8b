//! From beams to cells: scanners over known ground, and the two ways to hand in returns.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use rugosa_grid::{Cell, Sample, State, Window};
use rugosa_terrain::grid::View;
use rugosa_terrain::{
    Beams, ElevationGrid, Fused, Geometry, GridConfig, GridError, GroundCell, LineTrig, Noise,
    PerceptronConstants, Point, Raster, SampleChoice, Tally, Trig,
};

const SIDE: usize = 65;

/// The planes of a grid.
struct Planes(Vec<GroundCell>, Vec<Sample>);

impl Planes {
    fn new() -> Self {
        let n = SIDE * SIDE;
        Planes(vec![GroundCell::default(); n], vec![Sample::default(); n])
    }

    fn grid(&mut self, config: GridConfig) -> ElevationGrid<'_> {
        let window = Window::around(SIDE, Cell::new(0, 0));
        ElevationGrid::new(config, window, &mut self.0, &mut self.1).unwrap()
    }
}

fn at(x: f32, y: f32, z: f32) -> Point {
    Point {
        position: [x, y, z],
        variance: 1e-4,
        depression: 0.4,
    }
}

/// Height of a sloping plane with no symmetry that could hide an exchange of axes.
fn plane(x: f64, y: f64) -> f64 {
    0.3 * x - 0.1 * y + 0.25
}

/// Where a ray in the map meets the plane: distance from its origin.
fn distance_to_plane(origin: [f64; 3], unit: [f64; 3]) -> f64 {
    let above = origin[2] - plane(origin[0], origin[1]);
    above / (0.3 * unit[0] - 0.1 * unit[1] - unit[2])
}

/// Scans the plane with a scanner of this geometry, twice turned and once moved.
fn scan_the_plane(geometry: Geometry) {
    let raster = Raster {
        azimuth: [0.6, -0.02],
        inclination: [-0.8, -0.02],
    };
    let (mut columns, mut lines) = ([Trig::default(); 61], [LineTrig::default(); 30]);
    let mut beams = Beams::new(geometry, raster, &mut columns, &mut lines);
    for line in 0..30 {
        beams.set_azimuth_offset(line, 0.003 * (line % 4) as f32);
    }
    let turn = UnitQuaternion::from_euler_angles(0.1, -0.15, 2.2);
    let pose = Isometry3::from_parts(Translation3::new(-0.7, 1.1, 1.6), turn);
    let noise = Noise::new(0.002, 0.0, 0.0);
    let mut planes = Planes::new();
    let mut grid = planes.grid(GridConfig::new(0.1));
    let mut tally = Tally::default();
    for line in 0..30 {
        let rays = beams.rays(line, &pose).unwrap();
        assert_eq!(rays.len(), 61);
        for column in 0..61 {
            // the length of the ray that hits the plane, and the range that has this length
            let nil = rays.ray(column, 0.0).unwrap();
            let length = distance_to_plane(nil.origin.map(f64::from), nil.direction.map(f64::from));
            let ray = rays.ray(column, length as f32 - nil.length).unwrap();
            assert!((f64::from(ray.length) - length).abs() < 1e-5 + 1e-6 * length);
            tally.add(&grid.fuse(&ray.measured(&noise), 3));
        }
    }
    let mut seen = 0;
    for cell in grid.window().cells() {
        let Some([x, y, z]) = grid.sample_position(cell) else {
            continue;
        };
        let ground = grid.ground(cell).unwrap();
        let (cx, cy) = grid.lattice().centre(cell);
        assert!((f64::from(z) - plane(f64::from(x), f64::from(y))).abs() < 1e-3);
        assert!((f64::from(ground.elevation) - plane(f64::from(cx), f64::from(cy))).abs() < 0.025);
        assert!(ground.min <= z && z <= ground.max && ground.last_sweep == 3);
        seen += 1;
    }
    assert!(seen > 200 && tally.used() > 1200, "{seen} {tally:?}");
    assert_eq!(
        (tally.invalid, tally.gated, tally.height_out_of_range),
        (0, 0, 0)
    );
}

#[test]
fn a_spherical_scanner_over_a_plane() {
    scan_the_plane(Geometry::Spherical);
}

#[test]
fn a_perceptron_over_a_plane() {
    scan_the_plane(Geometry::Perceptron(PerceptronConstants::PUBLISHED));
}

#[test]
fn cells_are_half_open_on_both_sides_of_zero() {
    let mut planes = Planes::new();
    // half a metre is exact in binary
    let mut grid = planes.grid(GridConfig::new(0.5));
    for (x, y, cell) in [
        (0.0, 0.0, [0, 0]),
        (-0.0, 0.5, [0, 1]),
        (0.5, -0.5, [1, -1]),
        (0.499_999, -0.500_01, [0, -2]),
        (-0.5, 1.0, [-1, 2]),
        (-1e-6, -1.0, [-1, -2]),
    ] {
        let fused = grid.fuse(&at(x, y, 0.0), 1);
        let cell = Cell::new(cell[0], cell[1]);
        assert!(
            matches!(fused, Fused::Sampled { cell: found, .. } if found == cell),
            "{x} {y}: {fused:?}"
        );
        assert_eq!(grid.state(cell), State::Measured);
    }
    assert_eq!(grid.fuse(&at(16.5, 0.0, 0.0), 1), Fused::Outside);
    assert_eq!(grid.fuse(&at(0.0, -16.01, 0.0), 1), Fused::Outside);
    assert_eq!(grid.fuse(&at(1e30, 0.0, 0.0), 1), Fused::Outside);
    assert_eq!(grid.fuse(&at(0.0, -1e30, 0.0), 1), Fused::Outside);
    assert_eq!(grid.fuse(&at(0.0, 0.0, 1e30), 1), Fused::HeightOutOfRange);
}

#[test]
fn the_sample_is_the_nearest_or_the_lowest() {
    for (choice, expected) in [(SampleChoice::Nearest, 0.02), (SampleChoice::Lowest, -0.03)] {
        let config = GridConfig {
            sample: choice,
            ..GridConfig::new(0.1)
        };
        let mut planes = Planes::new();
        let mut grid = planes.grid(config);
        for (x, z) in [(0.02, -0.01), (0.045, 0.02), (0.09, -0.03), (0.01, 0.03)] {
            grid.fuse(&at(x, 0.05, z), 1);
        }
        let [_, _, z] = grid.sample_position(Cell::new(0, 0)).unwrap();
        assert!((z - expected).abs() < 3e-4, "{choice:?}: {z}");
    }
}

#[test]
fn the_datum_follows_the_robot_up_a_hill() {
    let mut planes = Planes::new();
    let mut grid = planes.grid(GridConfig::new(0.1));
    grid.fuse(&at(0.05, 0.05, 10.0), 1);
    grid.fuse(&at(0.15, 0.05, 2.0), 1);
    assert_eq!(grid.fuse(&at(0.25, 0.05, 30.0), 1), Fused::HeightOutOfRange);
    assert_eq!(grid.follow_height(4.0, |_, _, _, _| {}), 0);
    assert_eq!(grid.datum(), 0);
    let mut gone = vec![];
    assert_eq!(grid.follow_height(20.0, |_, _, cell, _| gone.push(cell)), 1);
    assert_eq!((grid.datum(), gone), (40_000, vec![Cell::new(1, 0)]));
    assert_eq!(grid.sample(Cell::new(0, 0)).height, -20_000);
    assert_eq!(grid.sample_position(Cell::new(0, 0)).unwrap()[2], 10.0);
    assert!(matches!(
        grid.fuse(&at(0.25, 0.05, 30.0), 1),
        Fused::Sampled { .. }
    ));
    assert_eq!(grid.follow_height(f32::NAN, |_, _, _, _| {}), 0);
}

#[test]
fn planes_of_a_wrong_length_are_refused() {
    let (mut cells, mut samples) = (
        vec![GroundCell::default(); 10],
        vec![Sample::default(); SIDE * SIDE],
    );
    let window = Window::around(SIDE, Cell::new(0, 0));
    let grid = ElevationGrid::new(GridConfig::new(0.1), window, &mut cells, &mut samples);
    let error = grid.err().unwrap();
    assert_eq!(error, GridError::PlaneLength(4225));
    assert_eq!(
        error.to_string(),
        "the planes of the grid must hold 4225 cells"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// A block of points does what its points do one by one, and what f64 says.
    #[test]
    fn a_block_equals_its_points(
        points in prop::collection::vec((-4f32..4.0, -4f32..4.0, -1.3f32..-0.9), 1..300),
        euler in prop::array::uniform3(-0.3f32..0.3), broken in 0..300usize
    ) {
        let mut points: Vec<[f32; 3]> = points.into_iter().map(|(x, y, z)| [x, y, z]).collect();
        if let Some(point) = points.get_mut(broken) {
            point[broken % 3] = f32::NAN;
        }
        let turn = UnitQuaternion::from_euler_angles(euler[0], euler[1], 3.0 * euler[2]);
        let pose = Isometry3::from_parts(Translation3::new(0.3, -0.2, 1.0), turn);
        let noise = Noise::new(0.01, 0.002, 0.003);
        let view = View { map_from_sensor: &pose, noise: &noise, sweep: 9 };

        let (mut block, mut single) = (Planes::new(), Planes::new());
        let mut block = block.grid(GridConfig::new(0.1));
        let (mut forgotten, mut told) = (0, 0);
        let tally = block.fuse_points(&points, &view, |window, samples, cell, old| {
            assert!(samples[window.slot(cell).unwrap()].is_measured());
            told += 1;
            forgotten += u32::from(old.is_measured());
        });
        let mut single = single.grid(GridConfig::new(0.1));
        let (mut expected, mut replaced) = (Tally::default(), 0);
        for &point in &points {
            let exact = Vector3::from(point).cast::<f64>();
            let map = pose.cast::<f64>() * Point3::from(exact);
            let up = (map.z - f64::from(pose.translation.z)) / exact.norm();
            let fused = single.fuse(&Point {
                position: [map.x as f32, map.y as f32, map.z as f32],
                variance: noise.elevation_variance(up as f32, exact.norm() as f32),
                depression: -up as f32,
            }, 9);
            if let Fused::Sampled { old, .. } | Fused::Restarted { old, .. } = fused {
                replaced += u32::from(old.is_measured());
            }
            expected.add(&fused);
        }
        prop_assert_eq!(told, tally.sampled + tally.restarted);
        prop_assert_eq!(tally.invalid, u32::from(broken < points.len()));
        // a point within rounding of a border may fall on the other side
        let differing = block.window().cells().filter(|&cell| {
            let same = match (block.ground(cell), single.ground(cell)) {
                (Some(a), Some(b)) => {
                    let (p, q) = (block.sample(cell), single.sample(cell));
                    a.count == b.count
                        && (a.elevation - b.elevation).abs() < 1e-5
                        && (a.variance / b.variance - 1.0).abs() < 1e-3
                        && p.height.abs_diff(q.height) <= 1
                        && p.depression.abs_diff(q.depression) <= 1
                        && p.east.abs_diff(q.east) <= 1 && p.north.abs_diff(q.north) <= 1
                }
                (a, b) => a.is_none() && b.is_none(),
            };
            !same
        });
        prop_assert!(differing.count() <= 2);
        prop_assert!(tally.used().abs_diff(expected.used()) <= 2);
        prop_assert!(forgotten.abs_diff(replaced) <= 2);
    }
}
