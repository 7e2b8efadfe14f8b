use super::*;
use crate::robot::Path;
use crate::terrain::{Plane, Step, Terrain, egg_carton};
use nalgebra::Vector3;
use rugosa_wire::Packing;

fn still(terrain: impl Terrain + 'static) -> Robot {
    let path = Path::Still {
        at: [0.0, 0.0],
        heading: 0.0,
    };
    Robot::new(Arc::new(terrain), path)
}

fn small() -> Device {
    Device::perceptron().thinned(64, 64)
}

fn scanner(terrain: impl Terrain + 'static, effects: Effects) -> Scanner {
    Scanner {
        effects,
        ..Scanner::new(small(), still(terrain), 1)
    }
}

/// Points of a line's true readings, map frame.
fn points(scanner: &Scanner, line: &Line, readings: &[f64]) -> Vec<Vector3<f64>> {
    let sensor = scanner.robot.pose(line.stamp_us as f64 * 1e-6) * scanner.mount;
    let beam = |column: usize| {
        let (azimuth, inclination) = scanner.device.angles(line.line, column as u16);
        scanner.device.beam(azimuth, inclination)
    };
    let point = |(c, &r): (usize, &f64)| sensor * nalgebra::Point3::from(beam(c).point(r));
    readings
        .iter()
        .enumerate()
        .map(point)
        .map(|p| p.coords)
        .collect()
}

#[test]
fn true_readings_put_points_on_a_plane() {
    let ramp = Plane {
        height: 0.2,
        slope_x: 0.1,
        slope_y: 0.05,
    };
    let scanner = scanner(ramp, Effects::NONE);
    let mut met = 0;
    for line in scanner.sweep(0) {
        for p in points(&scanner, &line, &line.truth) {
            if p.x.is_finite() {
                let z = ramp.elevation(p.x, p.y).unwrap();
                assert!((p.z - z).abs() < 1e-9, "{p}");
                met += 1;
            }
        }
    }
    assert!(met > 3000, "{met}");
}

#[test]
fn counts_are_the_rounded_truth_and_every_beam_is_counted_once() {
    let mut device = small();
    device.set_mount([0.0, 0.0, 2.2], 20.0);
    let mut scanner = Scanner::new(device, still(egg_carton(0.1, 1.5)), 1);
    scanner.effects = Effects::NONE;
    let count = scanner.device.metres_per_count();
    let mut tally = Tally::default();
    for line in scanner.sweep(3) {
        for (&code, &truth) in line.ranges.iter().zip(&line.truth) {
            match code {
                4095 => assert!(truth.is_nan() || truth > 39.9, "{truth}"),
                _ => assert!((f64::from(code) * count - truth).abs() <= count / 2.0 + 1e-9),
            }
        }
        tally.add(&line.tally);
    }
    let Tally {
        returns,
        no_return,
        too_close,
        erroneous,
        ..
    } = tally;
    assert_eq!(returns + no_return + too_close + erroneous, 64 * 64);
    assert!(returns > 2000 && no_return > 0);
}

#[test]
fn far_readings_wrap_at_the_interval() {
    let effects = Effects {
        wrap: true,
        ..Effects::NONE
    };
    let mut scanner = scanner(Plane::FLAT, effects);
    scanner.device.set_mount([0.0, 0.0, 12.0], 25.0);
    scanner = Scanner {
        effects,
        ..Scanner::new(scanner.device, scanner.robot, 1)
    };
    let (count, mut wrapped) = (scanner.device.metres_per_count(), 0);
    for line in scanner.sweep(0) {
        for (&code, &truth) in line.ranges.iter().zip(&line.truth) {
            if code < scanner.device.first_sentinel() {
                let off = (truth - f64::from(code) * count) / 40.0;
                assert!((off - off.round()).abs() * 40.0 <= count / 2.0 + 1e-9);
                wrapped += u64::from(off.round() >= 1.0);
            }
        }
        assert!(line.tally.wrapped <= line.tally.returns);
    }
    let tallied: u64 = scanner.sweep(0).map(|line| line.tally.wrapped).sum();
    assert!(wrapped > 100 && wrapped == tallied, "{wrapped} {tallied}");
}

#[test]
fn noise_is_as_stated_and_grows_as_the_ground_gets_darker() {
    // a wall straight ahead: every beam's own error of direction shifts it by a known part
    let mut spread = [0.0; 2];
    for (i, albedo) in [0.8, 0.05].into_iter().enumerate() {
        let effects = Effects {
            noise: true,
            ..Effects::NONE
        };
        let mut scanner = scanner(Plane::FLAT, effects);
        scanner.albedo.between = [albedo, albedo];
        scanner.device.physics.angle_noise = 0.0;
        scanner.device.set_mount([0.0, 0.0, 8.0], 90.0);
        let scanner = Scanner {
            albedo: scanner.albedo,
            effects,
            ..Scanner::new(scanner.device, scanner.robot, 5)
        };
        let (physics, count) = (scanner.device.physics, scanner.device.metres_per_count());
        let (mut sum, mut squares, mut n) = (0.0, 0.0, 0.0);
        for line in (0..6).flat_map(|k| scanner.sweep(k)) {
            for (&code, &truth) in line.ranges.iter().zip(&line.truth) {
                let cosine = 8.0 / truth;
                let growing = physics.noise_per_m * truth;
                let variance = physics.noise_m.powi(2)
                    + growing.powi(2) * TYPICAL_BRIGHTNESS / (albedo * cosine)
                    + count * count / 12.0;
                let error = f64::from(code) * count - truth;
                sum += error / variance.sqrt();
                squares += error * error / variance;
                spread[i] += error * error;
                n += 1.0;
            }
        }
        // n = 24576: the mean scatters by 0.0064, the mean square by 0.009
        assert!((sum / n).abs() < 0.03, "mean {}", sum / n);
        assert!(
            (squares / n - 1.0f64).abs() < 0.04,
            "mean square {}",
            squares / n
        );
    }
    assert!(spread[1] > 3.0 * spread[0], "{spread:?}");
}

#[test]
fn stated_noise_is_that_of_typical_ground() {
    let device = Device::perceptron();
    let (d, p) = (&device.description, &device.physics);
    assert_eq!(d.range_noise_per_m, p.noise_per_m as f32);
    let floor = p.noise_m.hypot(device.metres_per_count() / 12f64.sqrt());
    assert!((f64::from(d.range_noise_m) - floor).abs() < 1e-6);
}

#[test]
fn drop_outs_come_as_often_as_set_and_where_the_signal_is_weak() {
    let effects = Effects {
        drop_outs: true,
        ..Effects::NONE
    };
    let mut scanner = scanner(Plane::FLAT, effects);
    scanner.device.set_mount([0.0, 0.0, 8.0], 90.0);
    scanner.device.physics.drop_out = 0.1;
    let mut scanner = Scanner {
        effects,
        ..Scanner::new(scanner.device, scanner.robot, 5)
    };
    let dropped = |scanner: &Scanner| -> u64 {
        (0..4)
            .flat_map(|k| scanner.sweep(k))
            .map(|line| line.tally.dropped)
            .sum()
    };
    // binomial: 0.1 · 16384 = 1638 ± 38
    assert!((dropped(&scanner) as i64 - 1638).abs() < 160);
    scanner.device.physics.drop_out = 0.0;
    assert_eq!(dropped(&scanner), 0);
    scanner.device.physics.threshold = 0.81;
    assert_eq!(dropped(&scanner), 4 * 64 * 64);
}

#[test]
fn mixed_pixels_lie_between_the_surfaces_of_an_edge() {
    let effects = Effects {
        mixed_pixels: true,
        ..Effects::NONE
    };
    let step = Step {
        x: 2.5,
        height: -0.8,
    };
    let mut scanner = scanner(step, effects);
    scanner.device.physics.beam_width = 5e-3;
    let mut mixed = 0;
    for line in scanner.sweep(0) {
        let count = scanner.device.metres_per_count();
        let off = |(&code, &truth): (&u16, &f64)| (f64::from(code) * count - truth).abs() > 0.05;
        let both = line.ranges.iter().zip(&line.truth);
        let displaced = both.filter(|pair| *pair.0 < 4093 && off(*pair)).count() as u64;
        assert!(displaced <= line.tally.mixed);
        mixed += displaced;
    }
    assert!(mixed > 20, "{mixed}");
    scanner.effects.mixed_pixels = false;
    assert_eq!(
        scanner.sweep(0).map(|line| line.tally.mixed).sum::<u64>(),
        0
    );
}

#[test]
fn the_seed_decides_and_lines_do_not_depend_on_each_other() {
    let make = |seed| Scanner::new(small(), still(egg_carton(0.1, 1.5)), seed);
    let all = |seed| make(seed).sweep(2).collect::<Vec<_>>();
    assert_eq!(all(1), all(1));
    assert_ne!(all(1), all(2));
    let codes = |sweep| {
        make(1)
            .sweep(sweep)
            .map(|line| line.ranges)
            .collect::<Vec<_>>()
    };
    assert_ne!(codes(2), codes(3));
}

#[test]
fn a_walking_robot_sees_the_ground_at_rest() {
    let path = Path::Circle {
        centre: [0.0, 0.0],
        radius: 2.0,
        speed: 1.0,
    };
    let robot = Robot::new(Arc::new(Plane::FLAT), path);
    let scanner = Scanner {
        effects: Effects::NONE,
        ..Scanner::new(small(), robot, 1)
    };
    for line in scanner.sweep(1) {
        let ends = scanner.sensor(1, line.line);
        for (column, &truth) in line.truth.iter().enumerate().filter(|(_, r)| r.is_finite()) {
            let (azimuth, inclination) = scanner.device.angles(line.line, column as u16);
            let point = scanner.device.beam(azimuth, inclination).point(truth);
            let pose = scanner.sensor_at(&ends, column);
            assert!((pose * nalgebra::Point3::from(point)).z.abs() < 1e-9);
        }
    }
}

#[test]
fn the_lidar_looks_all_around() {
    let robot = still(Plane::FLAT);
    let scanner = Scanner {
        effects: Effects::NONE,
        ..Scanner::new(Device::lidar(), robot, 1)
    };
    assert_eq!(scanner.device.packing, Packing::Bits16);
    let line = scanner.sweep(0).nth(50).unwrap();
    let points = points(&scanner, &line, &line.truth);
    for side in [Vector3::x(), Vector3::y(), -Vector3::x(), -Vector3::y()] {
        assert!(points.iter().any(|p| p.dot(&side) > 0.8), "{side}");
    }
    assert!(points.iter().all(|p| p.z.abs() < 1e-9));
}
