//! The pipeline from messages to layers, on ground whose answer is known.

use rugosa::traversability::{Criterion, Footprint, Limits, Pair};
use rugosa::{Config, Layer, Mapper, Planes33, Planes65, Solver65, SweepReport};
use rugosa_fractal::roughness::{Block, Pool, StructureFunction, TileSums};
use rugosa_grid::{Cell, Tile};
use rugosa_wire::*;

const COLUMNS: u16 = 128;
const LINES: u16 = 64;

/// A lidar 2 m above the ground that looks down all around.
fn scanner() -> ScannerDescription {
    ScannerDescription {
        model: BeamModel::Spherical,
        columns: COLUMNS,
        lines: LINES,
        azimuth_first_urad: -3_141_593,
        azimuth_step_nrad: 49_087_385,
        inclination_first_urad: -1_500_000,
        inclination_step_nrad: 15_000_000,
        tables: 0,
        metres_per_count: 0.001,
        range_min_m: 0.3,
        range_max_m: 60.0,
        range_noise_m: 0.005,
        range_noise_per_m: 0.0,
        angle_noise_urad: 200,
        column_period_ns: 1000,
        line_period_us: 200,
        mount_position_m: [0.0, 0.0, 2.0],
        mount_orientation: [0.0, 0.0, 0.0, 1.0],
    }
}

/// The range in f64, by search along the beam.
fn range_to(ground: &dyn Fn(f64, f64) -> f64, at: [f64; 2], line: u16, column: u16) -> u16 {
    let azimuth = -std::f64::consts::PI + 0.049087385 * f64::from(column);
    let inclination = -1.5 + 0.015 * f64::from(line);
    let along = [
        inclination.cos() * azimuth.cos(),
        inclination.cos() * azimuth.sin(),
        inclination.sin(),
    ];
    let height = |r: f64| {
        let (x, y) = (at[0] + r * along[0], at[1] + r * along[1]);
        2.0 + r * along[2] - ground(x, y)
    };
    let mut r = 0.3;
    while height(r) > 0.0 && r < 60.0 {
        r += 0.02;
    }
    while height(r) <= 0.0 {
        r -= 0.001;
    }
    if r < 60.0 {
        (r * 1000.0) as u16
    } else {
        u16::MAX
    }
}

fn pose(stamp_us: u64, at: [f64; 2]) -> PoseStamp {
    PoseStamp {
        stamp_us,
        position_m: [at[0] as f32, at[1] as f32, 0.0],
        orientation: [0.0, 0.0, 0.0, 1.0],
    }
}

fn line(sweep: u32, line: u16, ranges: impl Iterator<Item = u16>) -> ScanLine {
    let ranges = Packing::Bits16.pack(ranges).unwrap();
    ScanLine {
        sweep,
        line,
        first_column: 0,
        stamp_us: 1_000_000 * u64::from(sweep) + 200 * u64::from(line),
        returns: (ranges.len() / 2) as u16,
        packing: Packing::Bits16,
        ranges,
        reflectances: Default::default(),
    }
}

fn sweep(
    mapper: &mut Mapper,
    number: u32,
    at: [f64; 2],
    ground: &dyn Fn(f64, f64) -> f64,
) -> SweepReport {
    let start = 1_000_000 * u64::from(number);
    mapper.pose(&pose(start, at));
    mapper.pose(&pose(start + 100_000, at));
    for l in 0..LINES {
        let ranges = (0..COLUMNS).map(|c| range_to(ground, at, l, c));
        assert_eq!(mapper.line(&line(number, l, ranges)), None);
    }
    let end = SweepEnd {
        sweep: number,
        stamp_us: start + 100_000,
        lines: LINES,
    };
    mapper.sweep_end(&end).expect("the sweep was open")
}

/// A bump east of the origin and a dip north of it, on a slope.
fn ground(x: f64, y: f64) -> f64 {
    let bump = |cx: f64, cy: f64| (-((x - cx).powi(2) + (y - cy).powi(2)) / 0.18).exp();
    0.05 * x - 0.02 * y + 0.4 * bump(1.5, 0.0) - 0.3 * bump(0.0, 2.0)
}

fn check_elevation(mapper: &Mapper) -> usize {
    let mut compared = 0;
    for cell in mapper.window().cells() {
        let elevation = mapper.value(Layer::Elevation, cell);
        if elevation.is_nan() {
            continue;
        }
        let (x, y) = mapper.lattice().centre(cell);
        let expected = ground(f64::from(x), f64::from(y)) as f32;
        assert!(
            (elevation - expected).abs() < 0.09,
            "{cell:?}: {elevation}, {expected}"
        );
        compared += 1;
    }
    compared
}

#[test]
fn elevations_are_where_the_ground_is_also_after_moves() {
    let mut planes = Box::new(Planes65::new());
    let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    mapper.describe(&scanner());
    for (number, at) in [[0.0, 0.0], [0.5, 0.0], [1.7, -0.6], [-0.9, 1.1]]
        .iter()
        .enumerate()
    {
        let report = sweep(&mut mapper, number as u32 + 1, *at, &ground);
        assert_eq!(report.lines, u32::from(LINES));
        assert!(check_elevation(&mapper) > 1500);
    }
    assert_eq!(mapper.counters().get(counter::MAP_MOVES), 2);
    assert_eq!(mapper.window().centre(), Cell::new(-9, 11));
    // a beam lies in one cell only: swapped axes or a wrong sign move the bump
    let at = |x, y| mapper.value(Layer::Elevation, mapper.lattice().locate(x, y).0);
    assert!(at(1.5, 0.0) > 0.35 && at(0.0, 2.0) < -0.25);
    assert!(at(-1.5, 0.0) < 0.0 && at(0.0, -1.9) > 0.0);
}

#[test]
fn every_return_has_one_cause() {
    let mut planes = Box::new(Planes33::new());
    let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    mapper.describe(&scanner());
    mapper.pose(&pose(0, [0.0, 0.0]));
    mapper.pose(&pose(2_000_000, [0.0, 0.0]));
    let codes = [2000, 65_535, 65_534, 65_533, 65_000, 100, 0];
    mapper.line(&line(1, 3, codes.into_iter()));
    let got = |index| mapper.counters().get(index);
    assert_eq!(got(counter::RETURNS_RECEIVED), 7);
    assert_eq!(got(counter::RETURNS_USED), 1);
    assert_eq!(got(counter::RETURNS_NO_RETURN), 1);
    assert_eq!(got(counter::RETURNS_TOO_CLOSE), 3);
    assert_eq!(got(counter::RETURNS_ERRONEOUS), 1);
    assert_eq!(got(counter::RETURNS_OUT_OF_RANGE), 1);
}

#[test]
fn every_line_has_one_cause() {
    let mut planes = Box::new(Planes33::new());
    let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    let good = |number, l| line(number, l, [2000; 64].into_iter());
    mapper.line(&good(5, 0));
    mapper.describe(&scanner());
    mapper.line(&good(5, 0));
    mapper.pose(&pose(0, [0.0, 0.0]));
    mapper.pose(&pose(9_000_000, [0.0, 0.0]));
    let mut malformed = good(5, 0);
    malformed.returns = 63;
    let mut wide = good(5, 0);
    wide.first_column = COLUMNS - 63;
    let mut early = good(5, 2);
    early.stamp_us -= 1000;
    let lines = [
        good(5, 0),
        good(5, 0),
        malformed,
        wide,
        good(5, LINES),
        early,
        good(4, 1),
    ];
    for line in &lines {
        mapper.line(line);
    }
    let got = |index| mapper.counters().get(index);
    for (index, count) in [
        (counter::LINES_RECEIVED, 9),
        (counter::LINES_USED, 1),
        (counter::LINES_NO_DESCRIPTION, 1),
        (counter::LINES_NO_POSE, 1),
        (counter::LINES_DUPLICATES, 1),
        (counter::LINES_MALFORMED, 1),
        (counter::LINES_UNKNOWN_PLACE, 2),
        (counter::LINES_TIME_BACKWARDS, 1),
        (counter::LINES_STALE, 1),
    ] {
        assert_eq!(got(index), count, "{}", counter::name(index).unwrap());
    }
}

#[test]
fn a_sweep_without_an_end_is_closed_by_the_next() {
    let mut planes = Box::new(Planes33::new());
    let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    mapper.describe(&scanner());
    mapper.pose(&pose(0, [0.0, 0.0]));
    mapper.pose(&pose(9_000_000, [0.0, 0.0]));
    assert_eq!(mapper.line(&line(1, 0, [2000; 64].into_iter())), None);
    let report = mapper.line(&line(2, 0, [2000; 64].into_iter())).unwrap();
    assert_eq!((report.sweep, report.lines), (1, 1));
    let end = SweepEnd {
        sweep: 2,
        stamp_us: 0,
        lines: 3,
    };
    assert_eq!(mapper.sweep_end(&end).unwrap().lines, 1);
    assert_eq!(mapper.sweep_end(&end), None);
    assert_eq!(mapper.counters().get(counter::LINES_LOST), 2);
    assert_eq!(mapper.counters().get(counter::SWEEPS_INCOMPLETE), 2);
}

/// The counters after a history of sweeps, moves and cleared ghosts equal those of one
/// pass over the samples that are left.
#[test]
fn counters_equal_a_batch_pass() {
    let mut planes = Box::new(Planes33::new());
    let config = Config {
        ghost_stride: 3.0,
        ..Config::default()
    };
    let mut mapper = Mapper::new(config, planes.lend()).unwrap();
    mapper.describe(&scanner());
    let wall = |x: f64, y: f64| ground(x, y) + if (x - 1.0).abs() < 0.1 { 2.5 } else { 0.0 };
    sweep(&mut mapper, 1, [0.0, 0.0], &wall);
    let highest = |mapper: &Mapper| {
        let elevations = mapper
            .window()
            .cells()
            .map(|c| mapper.value(Layer::Elevation, c));
        elevations.fold(f32::MIN, f32::max)
    };
    assert!(highest(&mapper) > 0.7);
    for number in 2..7 {
        let at = [0.4 * f64::from(number), -0.3 * f64::from(number)];
        sweep(&mut mapper, number, at, &ground);
    }
    assert!(highest(&mapper) < 0.6, "the wall is gone");
    assert!(mapper.counters().get(counter::MAP_MOVES) > 1);

    let mut samples = mapper.grid().samples().to_vec();
    let mut tiles = vec![TileSums::EMPTY; StructureFunction::tiles_needed(33)];
    let mut block = Block::new();
    let mut batch = StructureFunction::new(33, &mut tiles, &mut block);
    let window = *mapper.window();
    for cell in window.cells() {
        let slot = window.slot(cell).unwrap();
        samples[slot].set_counted(false);
        batch.replaced(&window, &samples, cell, &rugosa_grid::Sample::UNKNOWN);
    }
    batch.commit(&window, &mut samples);
    assert_eq!(Pool::of_all(batch.tiles()), mapper.pool());
    assert!(mapper.pool().pairs() > 10_000);
}

#[test]
fn a_map_of_65_cells_fits_192_kibibytes() {
    let bytes = size_of::<Planes65>() + size_of::<Mapper>();
    println!(
        "a 65 x 65 mapper with 8 lags: {bytes} bytes, of which tables of the scanner {}",
        rugosa::memory::COLUMNS * 8 + rugosa::memory::LINES * 22
    );
    assert!(bytes <= 192 * 1024, "{bytes} bytes");
}

#[test]
fn patches_carry_the_map() {
    let mut planes = Box::new(Planes33::new());
    let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    mapper.describe(&scanner());
    sweep(&mut mapper, 1, [0.0, 0.0], &ground);
    let mut outbox = rugosa::Outbox::new();
    let (mut patches, mut compared) = (0, 0);
    while let Some(patch) = outbox.next(&mut mapper) {
        patches += 1;
        let layer = Layer::from_number(patch.layer).unwrap();
        for (i, &number) in patch.values.iter().enumerate() {
            let (i, width) = (i as i32, i32::from(patch.width));
            let stride = i32::from(patch.stride);
            let cell = Cell::new(patch.x + i % width * stride, patch.y + i / width * stride);
            let (sent, held) = (
                rugosa::outbox::value_of(&patch, number),
                mapper.value(layer, cell),
            );
            if mapper.window().contains(cell) {
                assert_eq!(sent.is_nan(), held.is_nan(), "{layer:?} {cell:?}");
                assert!(sent.is_nan() || (sent - held).abs() <= 0.51 * patch.scale + 1e-6);
                compared += 1;
            }
        }
    }
    assert!(
        patches >= 75 && compared > 3 * 33 * 33,
        "{patches} patches, {compared} values"
    );
    assert!(outbox.next(&mut mapper).is_none());
}

#[test]
fn the_same_messages_give_the_same_bits() {
    let run = || {
        let mut planes = Box::new(Planes33::new());
        let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
        mapper.describe(&scanner());
        sweep(&mut mapper, 1, [0.0, 0.0], &ground);
        sweep(&mut mapper, 2, [1.0, 0.3], &ground);
        let bits = |layer| {
            mapper
                .window()
                .cells()
                .map(|c| mapper.value(layer, c).to_bits())
                .collect::<Vec<_>>()
        };
        [
            Layer::Elevation,
            Layer::Variance,
            Layer::Dimension,
            Layer::Sigma,
        ]
        .map(bits)
    };
    assert_eq!(run(), run());
}

#[test]
fn parameters_are_checked_when_set_over_the_link() {
    let mut planes = Box::new(Planes33::new());
    let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    let mut set = |name: &str, value| {
        let parameter = Config::index_of(name).unwrap_or(200);
        mapper.configure(&Configure { parameter, value })
    };
    assert_eq!(set("gate", 5.0), Verdict::Accepted);
    assert_eq!(set("gate", 0.0), Verdict::OutOfRange);
    assert_eq!(set("resolution", 0.2), Verdict::Unsupported);
    assert_eq!(set("no such", 0.2), Verdict::UnknownParameter);
    assert_eq!(mapper.config().gate, 5.0);
    assert_eq!(mapper.counters().get(counter::CONFIGURE_REFUSED), 3);
    assert!(mapper.tile(Tile::new(0, 0)).is_some());
}

#[test]
fn a_wall_is_impassable_and_the_unseen_is_never_free() {
    let mut planes = Box::new(Planes65::new());
    let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    mapper.describe(&scanner());
    // walls make the tiles around them rough: here only the geometry is to count
    let roughness = Pair {
        safe: 5.0,
        critical: 10.0,
    };
    let limits = Limits {
        roughness,
        ..Limits::default()
    };
    mapper.set_limits(limits).unwrap();
    let wall = |x: f64, y: f64| {
        if (x - 1.0).abs() < 0.15 && y.abs() < 1.0 {
            0.6
        } else {
            0.0
        }
    };
    for number in 1..4 {
        sweep(&mut mapper, number, [0.1 * f64::from(number), 0.0], &wall);
    }
    let circle = Footprint::Circle(0.25);
    let at = |x: f32, y: f32| mapper.footprint(&circle, [x, y, 0.0]);
    let blocked = at(1.0, 0.0);
    assert_eq!((blocked.cost, blocked.reason), (Some(1.0), Criterion::Step));
    assert!((mapper.lattice().centre(blocked.worst).0 - 1.0).abs() < 0.6);
    assert!(at(-1.0, 0.0).cost.unwrap() < 0.5, "{:?}", at(-1.0, 0.0));
    assert!(at(-1.5, 1.5).cost.unwrap() < 0.5, "{:?}", at(-1.5, 1.5));
    let unseen = at(100.0, 0.0);
    assert_eq!((unseen.cost, unseen.unknown), (None, unseen.cells));

    // a long robot that drives along x meets the wall, across it does not
    let long = Footprint::Polygon(&[[0.9, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.9, -0.2]]);
    assert_eq!(mapper.footprint(&long, [0.0, 0.0, 0.0]).cost, Some(1.0));
    let turned = mapper.footprint(&long, [0.0, 0.0, std::f32::consts::FRAC_PI_2]);
    assert!(turned.cost.unwrap() < 0.9, "{turned:?}");
    let poses = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
    let costs: Vec<_> = mapper.path(&circle, &poses).map(|c| c.cost).collect();
    assert!(costs[0] < costs[1]);

    // limits change over the link, and the costs follow
    for (name, value) in [
        ("step_critical", 3.0),
        ("step_safe", 2.0),
        ("slope_critical", 1.57),
    ] {
        let parameter = Config::index_of(name).unwrap();
        let verdict = mapper.configure(&Configure { parameter, value });
        assert_eq!(verdict, Verdict::Accepted, "{name}");
    }
    mapper.commit(&mut |_| {});
    let lenient = mapper.footprint(&circle, [1.0, 0.0, 0.0]);
    assert_ne!(lenient.reason, Criterion::Step);
    assert!(lenient.cost.unwrap() < 1.0, "{lenient:?}");

    // the plane of a layer holds the values of its cells
    let mut plane = vec![0.0; 65 * 65];
    for layer in [
        Layer::Slope,
        Layer::Step,
        Layer::Traversability,
        Layer::Dimension,
    ] {
        mapper.fill(layer, &mut plane);
        for (value, cell) in plane.iter().zip(mapper.window().cells()) {
            assert_eq!(value.to_bits(), mapper.value(layer, cell).to_bits());
        }
    }
}

#[test]
fn the_reconstruction_follows_the_map() {
    let mut planes = Box::new(Planes65::new());
    let mut solver = Box::new(Solver65::new());
    let config = Config {
        iterations: 20.0,
        ..Config::default()
    };
    let memory = planes.lend_with(&mut solver);
    let mut mapper = Mapper::new(config, memory).unwrap();
    mapper.describe(&scanner());
    for (number, at) in [[0.0, 0.0], [0.4, 0.1], [1.7, -0.6], [1.8, -0.5]]
        .iter()
        .enumerate()
    {
        let report = sweep(&mut mapper, number as u32 + 1, *at, &ground);
        assert!(report.reconstruction.unwrap().residual < 0.05, "{report:?}");
        let (mut inferred, mut square) = (0, 0.0);
        for cell in mapper.window().cells() {
            let mean = mapper.value(Layer::Mean, cell);
            assert!(mean.is_finite());
            let (x, y) = mapper.lattice().centre(cell);
            square += (mean - ground(f64::from(x), f64::from(y)) as f32).powi(2);
            inferred += (mapper.value(Layer::Inferred, cell) == 1.0) as u32;
            assert_eq!(
                mapper.value(Layer::Inferred, cell) == 0.0,
                mapper.grid().ground(cell).is_some()
            );
        }
        let rms = (square / 4225.0).sqrt();
        assert!(
            rms < 0.06 && inferred > 100,
            "rms {rms} m, {inferred} inferred"
        );
    }
}
