//! The simulated scanner and the mapper share no geometry: whatever the one measures on
//! known ground, the other must put back there. A wrong sign, a swapped axis or a pose
//! of another time shows as decimetres.

use std::sync::Arc;

use rugosa::{Config, Mapper, Planes65};
use rugosa_hil_sim::device::Device;
use rugosa_hil_sim::robot::{Path, Posture, Robot};
use rugosa_hil_sim::scanner::{Effects, Scanner};
use rugosa_hil_sim::stream::Simulation;
use rugosa_hil_sim::terrain::{Analytic, Terrain};
use rugosa_wire::counter;

/// Different along x and y, and neither even nor odd in them.
fn ground() -> Analytic<impl Fn(f64, f64) -> f64> {
    Analytic {
        height: |x: f64, y: f64| {
            0.12 * (1.3 * x + 0.4).sin() - 0.08 * (0.9 * y - 0.2).cos() + 0.05 * x * (0.5 * y).sin()
        },
        steepness: 0.6,
    }
}

fn simulation(device: Device, posture: Posture, effects: Effects) -> Simulation {
    let path = Path::Circle {
        centre: [-1.0, 0.5],
        radius: 3.0,
        speed: 0.6,
    };
    let mut robot = Robot::new(Arc::new(ground()), path);
    robot.posture = posture;
    let mut scanner = Scanner::new(device, robot, 1);
    scanner.effects = effects;
    let mut simulation = Simulation::new(scanner);
    simulation.sweeps = Some(5);
    simulation
}

/// Distances of the samples from the ground \[m\], in ascending order.
fn errors(mapper: &Mapper) -> Vec<f64> {
    let error = |cell| {
        let [x, y, z] = mapper.grid().sample_position(cell)?;
        let truth = ground().elevation(f64::from(x), f64::from(y))?;
        Some((f64::from(z) - truth).abs())
    };
    let mut errors: Vec<f64> = mapper.window().cells().filter_map(error).collect();
    errors.sort_by(f64::total_cmp);
    errors
}

fn map(simulation: &Simulation) -> Vec<f64> {
    let mut planes = Box::new(Planes65::new());
    let mut mapper = Mapper::new(Config::default(), planes.lend()).expect("a mapper");
    for message in simulation.description() {
        mapper.message(&message);
    }
    let (mut reports, mut lines) = (0, 0);
    for stamped in simulation.messages() {
        lines += u32::from(matches!(stamped.message, rugosa_wire::Message::Line(_)));
        reports += usize::from(mapper.message(&stamped.message).is_some());
    }
    assert_eq!(reports, 5);
    assert_eq!(mapper.counters().get(counter::LINES_USED), lines);
    let errors = errors(&mapper);
    assert!(errors.len() > 600, "{} cells", errors.len());
    errors
}

fn check(simulation: &Simulation, rms: f64) {
    let errors = map(simulation);
    let square = errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64;
    let (off, largest) = (square.sqrt(), errors[errors.len() - 1]);
    assert!(
        off < rms && largest < 10.0 * rms,
        "{off} m rms, {largest} m"
    );
}

#[test]
fn the_perceptron_measures_what_is_there() {
    for posture in [Posture::Level, Posture::Tilted] {
        let device = Device::perceptron().thinned(128, 128);
        check(&simulation(device, posture, Effects::NONE), 0.006);
    }
}

#[test]
fn the_lidar_measures_what_is_there() {
    for posture in [Posture::Level, Posture::Tilted] {
        let device = Device::lidar().thinned(64, 256);
        check(&simulation(device, posture, Effects::NONE), 0.02);
    }
}

/// Mixed pixels and wrapped ranges put some samples into the air; most cells are as good
/// as the scanner.
#[test]
fn with_all_errors_most_of_the_map_is_as_good_as_the_scanner() {
    let device = Device::perceptron().thinned(128, 128);
    let errors = map(&simulation(device, Posture::Tilted, Effects::ALL));
    let median = errors[errors.len() / 2];
    let wild = errors.iter().filter(|&&e| e > 0.1).count() as f64 / errors.len() as f64;
    assert!(median < 0.015, "median error {median} m");
    assert!(
        wild < 0.05,
        "{wild} of the samples are off by more than 0.1 m"
    );
}
