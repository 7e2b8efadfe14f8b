//! What the reconstruction reaches on exact fBm, and what it does with bad input.

mod scene;

use rugosa_fractal::pyramid::{Datum, Draws, Error, Finest, Levels, Posterior, Prior};
use scene::{Scene, dimension, rng, structure};

/// Kriging with the true variogram and an unknown mean, in double precision: the
/// covariance of the surface relative to a point outside the map, Cholesky.
struct Kriging {
    hurst: f64,
    places: Vec<(f64, f64)>,
    factor: Vec<Vec<f64>>,
}

impl Kriging {
    fn new(scene: &Scene) -> Self {
        let side = scene.side;
        let seen = || {
            scene
                .data
                .iter()
                .enumerate()
                .filter_map(|(i, d)| d.map(|d| (i, d)))
        };
        let places: Vec<_> = seen().map(|(i, _)| place(i, side)).collect();
        let mut kriging = Kriging {
            hurst: scene.hurst,
            places,
            factor: Vec::new(),
        };
        let noise: Vec<f64> = seen().map(|(_, d)| f64::from(d.variance)).collect();
        for (row, r) in noise.iter().enumerate() {
            let mut line: Vec<f64> = (0..=row)
                .map(|c| kriging.covariance(kriging.places[row], kriging.places[c]))
                .collect();
            line[row] += r;
            for c in 0..=row {
                let sum: f64 = (0..c)
                    .map(|k| {
                        line[k]
                            * if c == row {
                                line[k]
                            } else {
                                kriging.factor[c][k]
                            }
                    })
                    .sum();
                let rest = line[c] - sum;
                line[c] = if c == row {
                    rest.sqrt()
                } else {
                    rest / kriging.factor[c][c]
                };
            }
            kriging.factor.push(line);
        }
        kriging
    }

    fn covariance(&self, a: (f64, f64), b: (f64, f64)) -> f64 {
        let power = |x: f64, y: f64| x.hypot(y).powf(2.0 * self.hurst);
        let between = power(a.0 - b.0, a.1 - b.1);
        0.5 * (power(a.0 + 1.0, a.1 + 1.0) + power(b.0 + 1.0, b.1 + 1.0) - between)
    }

    fn forward(&self, b: &[f64]) -> Vec<f64> {
        let mut x = Vec::with_capacity(b.len());
        for (row, value) in self.factor.iter().zip(b) {
            let sum: f64 = row.iter().zip(&x).map(|(l, x): (&f64, &f64)| l * x).sum();
            x.push((value - sum) / row[x.len()]);
        }
        x
    }

    /// Estimates of every cell.
    fn solve(&self, scene: &Scene) -> Vec<f32> {
        let heights: Vec<f64> = scene
            .data
            .iter()
            .flatten()
            .map(|d| f64::from(d.height))
            .collect();
        let ones = self.forward(&vec![1.0; heights.len()]);
        let values = self.forward(&heights);
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mean = dot(&ones, &values) / dot(&ones, &ones);
        let rest: Vec<f64> = values
            .iter()
            .zip(&ones)
            .map(|(v, o)| v - mean * o)
            .collect();
        (0..scene.truth.len())
            .map(|i| {
                let here = place(i, scene.side);
                let k: Vec<f64> = self
                    .places
                    .iter()
                    .map(|&p| self.covariance(here, p))
                    .collect();
                (mean + dot(&self.forward(&k), &rest)) as f32
            })
            .collect()
    }
}

fn place(i: usize, side: usize) -> (f64, f64) {
    ((i % side) as f64, (i / side) as f64)
}

#[test]
fn mean_is_as_good_as_exact_kriging() {
    for hurst in [0.8, 0.5, 0.2] {
        let (mut ours, mut best) = (0.0, 0.0);
        for seed in 0..6 {
            let scene = Scene::new(65, hurst, 0.05, 30.0, seed);
            ours += scene.error(&scene.mean(20).0).powi(2);
            best += scene.error(&Kriging::new(&scene).solve(&scene)).powi(2);
        }
        let ratio = (ours / best).sqrt();
        println!("H {hurst}: error {ratio:.4} of exact kriging's");
        assert!(ratio < 1.01, "H {hurst}: {ratio}");
    }
}

#[test]
fn realisations_have_the_grounds_roughness() {
    let (side, surfaces) = (257, 4);
    for tenth in 1..=9 {
        let hurst = f64::from(tenth) / 10.0;
        for decibel in [40.0, 20.0] {
            let (mut error, mut ratio) = (0.0, [0.0; 4]);
            for seed in 0..surfaces {
                let scene = Scene::new(side, hurst, 0.05, decibel, seed);
                let z = scene.realisation(20, &mut rng(seed + 100));
                error += (dimension(&z, side) - dimension(&scene.truth, side)).abs();
                for (r, lag) in ratio.iter_mut().zip([1, 2, 4, 8]) {
                    *r += structure(&z, side, lag) / structure(&scene.truth, side, lag);
                }
            }
            let share = 1.0 / surfaces as f64;
            let ratio = ratio.map(|r| r * share);
            println!(
                "H {hurst} {decibel} dB: |D − D| {:.4}, S² {ratio:.3?}",
                error * share
            );
            assert!(
                error * share <= 0.008,
                "H {hurst} {decibel} dB: {}",
                error * share
            );
            assert!(
                ratio.iter().all(|r| (r - 1.0).abs() < 0.05),
                "H {hurst}: {ratio:?}"
            );
        }
    }
}

#[test]
fn draws_are_honest() {
    let side = 129;
    for hurst in [0.8, 0.5, 0.2] {
        let (mut squares, mut variance, mut inside, mut count) = (0.0, 0.0, 0.0, 0.0);
        for seed in 0..12 {
            let scene = Scene::new(side, hurst, 0.05, 20.0, 50 + seed);
            let deviation = deviation(&scene, 48);
            let mean = scene.mean(20).0;
            for i in (0..deviation.len()).filter(|&i| scene.data[i].is_none()) {
                let error = f64::from(mean[i] - scene.truth[i]);
                let sd = f64::from(deviation[i]);
                squares += error * error;
                variance += sd * sd;
                inside += f64::from(u8::from(error.abs() < 1.96 * sd));
                count += 1.0;
            }
        }
        let (honesty, coverage) = (squares / variance, inside / count);
        println!("H {hurst}: error² / variance {honesty:.3}, coverage {coverage:.3}");
        assert!((0.95..=1.05).contains(&honesty), "H {hurst}: {honesty}");
        assert!((0.93..=0.97).contains(&coverage), "H {hurst}: {coverage}");
    }
}

fn deviation(scene: &Scene, count: usize) -> Vec<f32> {
    let mut memory = vec![0.0; Posterior::need(scene.side).unwrap()];
    let mut posterior = Posterior::new(scene.side, &mut memory).unwrap();
    let mut out = vec![0.0; scene.side * scene.side];
    let draws = Draws {
        count,
        iterations: 12,
    };
    posterior.standard_deviation(
        (&scene.levels(), scene.datum()),
        draws,
        &mut rng(5),
        &mut out,
    );
    out
}

/// Deviation and mean plus deviation as drawn, both without solving again.
fn spread(scene: &Scene) -> (Vec<f32>, Vec<f32>) {
    let mut memory = vec![0.0; Posterior::need(scene.side).unwrap()];
    let mut posterior = Posterior::new(scene.side, &mut memory).unwrap();
    let levels = scene.levels();
    posterior.observe(&levels, scene.datum());
    posterior.step(20);
    let mut mean = vec![0.0; scene.side * scene.side];
    posterior.mean(&levels, scene.datum(), &mut mean);
    let mut rng = rng(3);
    posterior.spread(&mut rng);
    let finest = |i: usize| Finest {
        variance: levels.variance(0, 0, 0),
        datum: scene.data[i],
    };
    let cells = 0..mean.len();
    let deviation = cells.clone().map(|i| posterior.deviation_at(i, finest(i)));
    let deviation = deviation.collect();
    let draw = cells.map(|i| mean[i] + posterior.draw_at(i, finest(i), &mut rng));
    (deviation, draw.collect())
}

#[test]
fn the_spread_is_near_that_of_exact_draws() {
    for (side, seen, hurst) in [
        (65, 0.05, 0.8),
        (65, 0.05, 0.5),
        (65, 0.05, 0.2),
        (65, 0.3, 0.8),
        (65, 0.3, 0.5),
        (65, 0.3, 0.2),
        (129, 0.05, 0.5),
    ] {
        let (mut squares, mut variance, mut inside, mut count) = (0.0, 0.0, 0.0, 0.0);
        let (mut apart, mut off, mut lag1) = (0.0, 0.0, 0.0);
        let surfaces = 4;
        for seed in 0..surfaces {
            let scene = Scene::new(side, hurst, seen, 20.0, 70 + seed);
            let exact = deviation(&scene, 100);
            let (spread, draw) = spread(&scene);
            let mean = scene.mean(20).0;
            off += (dimension(&draw, side) - dimension(&scene.truth, side)).abs();
            lag1 += structure(&draw, side, 1) / structure(&scene.truth, side, 1);
            for i in (0..spread.len()).filter(|&i| scene.data[i].is_none()) {
                let (error, sd) = (f64::from(mean[i] - scene.truth[i]), f64::from(spread[i]));
                squares += error * error;
                variance += sd * sd;
                inside += f64::from(u8::from(error.abs() < 1.96 * sd));
                apart += (sd / f64::from(exact[i])).ln().powi(2);
                count += 1.0;
            }
        }
        let (honesty, coverage) = (squares / variance, inside / count);
        let (apart, share) = (f64::sqrt(apart / count), 1.0 / surfaces as f64);
        println!(
            "{side}², {seen} seen, H {hurst}: error² / variance {honesty:.3}, coverage \
             {coverage:.3}, {apart:.3} from exact; draw: D {:.4} off, S²(1) {:.3}",
            off * share,
            lag1 * share
        );
        assert!((0.9..=1.2).contains(&honesty), "{honesty}");
        assert!((0.92..=0.965).contains(&coverage), "{coverage}");
        assert!(apart < 0.12, "{apart}");
        assert!(off * share < 0.02 && (lag1 * share - 1.0).abs() < 0.08);
    }
}

/// A reconstruction of side 33 from the given data.
fn mean_of(data: impl Fn(usize) -> Option<Datum>) -> Vec<f32> {
    let mut memory = vec![0.0; Posterior::need(33).unwrap()];
    let mut posterior = Posterior::new(33, &mut memory).unwrap();
    let levels = Levels::power_law(33, 0.5, 0.1).unwrap();
    posterior.observe(&levels, &data);
    posterior.step(40);
    let mut out = vec![f32::NAN; 33 * 33];
    posterior.mean(&levels, &data, &mut out);
    out
}

fn datum(height: f32, variance: f32) -> Option<Datum> {
    Some(Datum { height, variance })
}

#[test]
fn bad_input_has_a_defined_answer() {
    assert!(mean_of(|_| None).iter().all(|&z| z == 0.0));
    let one = mean_of(|i| {
        (i == 500).then_some(Datum {
            height: 7.0,
            variance: 0.0,
        })
    });
    assert!((one[500] - 7.0).abs() < 1e-5 && one.iter().all(|z| (z - 7.0).abs() < 1.0));
    let exact = mean_of(|i| datum((i % 33) as f32, 0.0));
    assert!(
        exact
            .iter()
            .enumerate()
            .all(|(i, z)| (z - (i % 33) as f32).abs() < 1e-3)
    );
    let flat = mean_of(|_| datum(1e4, 1e-6));
    assert!(flat.iter().all(|z| (z - 1e4).abs() < 1e-2));
    let holes = mean_of(|i| {
        if i % 3 == 0 {
            datum(f32::NAN, 1.0)
        } else {
            datum(2.0, -1.0)
        }
    });
    assert!(holes.iter().all(|&z| z == 0.0));
    let vague = mean_of(|_| datum(1.0, 1e30));
    assert!(vague.iter().all(|z| z.is_finite()));
}

#[test]
fn refused_data_are_counted() {
    let mut memory = vec![0.0; Posterior::need(17).unwrap()];
    let mut posterior = Posterior::new(17, &mut memory).unwrap();
    let levels = Levels::power_law(17, 0.5, 0.1).unwrap();
    let intake = posterior.observe(&levels, |i| match i {
        0 => datum(f32::INFINITY, 1.0),
        1 => datum(1.0, f32::NAN),
        2..5 => datum(1.0, 0.1),
        _ => None,
    });
    assert_eq!((intake.used, intake.refused), (3, 2));
}

#[test]
fn sizes_and_memory_are_checked() {
    assert_eq!(Posterior::need(64), Err(Error::Side(64)));
    let need = Posterior::need(65).unwrap();
    assert!(4 * need <= 96 * 1024, "{} bytes", 4 * need);
    let mut memory = vec![0.0; need - 1];
    assert_eq!(
        Posterior::new(65, &mut memory).unwrap_err(),
        Error::Memory(need)
    );
}

/// Root mean square difference.
fn apart(a: &[f32], b: &[f32]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    (sum / a.len() as f64).sqrt()
}

#[test]
fn a_warm_start_needs_few_iterations() {
    let scene = Scene::new(65, 0.5, 0.2, 30.0, 1);
    let levels = scene.levels();
    let fresh = |i: usize| scene.data[i].filter(|_| i % 65 != 7 && i < 4000);
    let mut memory = vec![0.0; Posterior::need(65).unwrap()];
    let mut posterior = Posterior::new(65, &mut memory).unwrap();
    let best = scene.mean(60).0;
    let mut warm = |iterations| {
        posterior.restart();
        posterior.observe(&levels, fresh);
        posterior.step(30);
        posterior.observe(&levels, scene.datum());
        posterior.step(iterations);
        let mut mean = vec![0.0; 65 * 65];
        posterior.mean(&levels, scene.datum(), &mut mean);
        apart(&mean, &best)
    };
    let error = scene.error(&best);
    for (iterations, most) in [(1, 0.1), (2, 0.05), (4, 0.015)] {
        let (near, far) = (warm(iterations), apart(&scene.mean(iterations).0, &best));
        println!("after {iterations} iterations: warm {near:.5}, cold {far:.5}, error {error:.3}");
        assert!(near < 0.3 * far && near < most * error);
    }
}

#[test]
fn a_moved_window_gives_the_same_mean() {
    let scene = Scene::new(129, 0.5, 0.2, 30.0, 2);
    let levels = Levels::power_law(65, 0.5, 1.0).unwrap();
    let view = |x0: usize, y0: usize| {
        let data = &scene.data;
        move |i: usize| data[(y0 + i / 65) * 129 + x0 + i % 65]
    };
    let mut memory = vec![0.0; Posterior::need(65).unwrap()];
    let mut posterior = Posterior::new(65, &mut memory).unwrap();
    let (mut moved, mut still) = (vec![0.0; 65 * 65], vec![0.0; 65 * 65]);
    let mut cold = |iterations: usize, out: &mut [f32]| {
        posterior.restart();
        posterior.observe(&levels, view(25, 14));
        posterior.step(iterations);
        posterior.mean(&levels, view(25, 14), out);
    };
    cold(60, &mut still);
    cold(3, &mut moved);
    let far = apart(&moved, &still);
    posterior.restart();
    posterior.observe(&levels, view(20, 17));
    posterior.step(30);
    posterior.shift(5, -3);
    posterior.observe(&levels, view(25, 14));
    posterior.step(3);
    posterior.mean(&levels, view(25, 14), &mut moved);
    let near = apart(&moved, &still);
    println!("after 3 iterations: shifted {near:.4}, restarted {far:.4}");
    assert!(near < 0.7 * far);
    posterior.step(40);
    posterior.mean(&levels, view(25, 14), &mut moved);
    assert!(apart(&moved, &still) < 2e-4);
}
