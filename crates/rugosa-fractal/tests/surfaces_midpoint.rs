//! Midpoint interpolation against independent values, exact statistics and real terrain.

mod common;
use common::{crop, oracle, values};
use rugosa_fractal::surfaces::Shape;
use rugosa_fractal::surfaces::midpoint::*;

const SMOOTH: Roughness = Roughness {
    hurst: 0.8,
    sigma: 1.0,
};

fn everywhere(_: usize, _: usize) -> Roughness {
    SMOOTH
}

fn settings(stencil: Stencil, noise: Noise) -> Midpoint<'static> {
    Midpoint {
        stencil,
        noise,
        roughness: &everywhere,
        resolution: 1.0,
    }
}

fn densify(
    grid: &mut [f32],
    side: usize,
    levels: u32,
    settings: &Midpoint,
    normal: &mut dyn FnMut() -> f32,
) -> Counts {
    let mut cache = [Blend::default(); 64];
    settings
        .densify(grid, Shape::new(side, side), levels, (normal, &mut cache))
        .unwrap()
}

/// Coarse samples on every 2^levels-th node, the rest unknown.
fn spread(coarse: &[f32], side: usize, levels: u32) -> (Vec<f32>, usize) {
    let step = 1 << levels;
    let fine = (side - 1) * step + 1;
    let mut grid = vec![f32::NAN; fine * fine];
    for i in 0..side * side {
        grid[(i / side) * step * fine + (i % side) * step] = coarse[i];
    }
    (grid, fine)
}

#[test]
fn weights_are_the_published_ones() {
    let table = oracle("midpoint_weights.json");
    for (hurst, row) in table["H"].as_object().unwrap() {
        let h: f32 = hurst.parse().unwrap();
        let of = |stencil, step| Blend::new(stencil, step, u16::MAX, h).unwrap();
        let close = |a: f32, b: &serde_json::Value| {
            let b = b.as_f64().unwrap();
            assert!(
                (f64::from(a) - b).abs() < 3e-6,
                "H {hurst}: {a} against {b}"
            );
        };
        let square = of(Stencil::Kriged16, Step::Square);
        close(square.weights[0], &row["square"]["1,1"]);
        close(square.weights[4], &row["square"]["1,3"]);
        close(square.weights[12], &row["square"]["3,3"]);
        close(square.variance, &row["square_var"]);
        let diamond = of(Stencil::Kriged16, Step::Diamond);
        close(diamond.weights[0], &row["diamond"]["0,1"]);
        close(diamond.weights[4], &row["diamond"]["1,2"]);
        close(diamond.weights[12], &row["diamond"]["0,3"]);
        close(diamond.variance, &row["diamond_var"]);
        close(
            of(Stencil::Four, Step::Square).variance,
            &row["four_nbr_square_var"],
        );
        close(
            of(Stencil::Four, Step::Diamond).variance,
            &row["four_nbr_diamond_var"],
        );
        let fang = Stencil::Fang2004(Distance::Chessboard);
        close(of(fang, Step::Square).variance, &row["fang_factor_1d"]);
    }
}

#[test]
fn the_papers_distances_change_the_amplitude_by_half_the_hurst_exponent() {
    let deviation = |d| {
        Blend::new(Stencil::Fang2004(d), Step::Square, u16::MAX, 0.6)
            .unwrap()
            .variance
            .sqrt()
    };
    let euclid = deviation(Distance::Euclidean);
    assert!((deviation(Distance::Street) / euclid - 2f32.powf(0.3)).abs() < 1e-5);
    assert!((deviation(Distance::Chessboard) / euclid - 2f32.powf(-0.3)).abs() < 1e-5);
    // on a border the line's own variance, with three neighbours 1 - (4^H + 2 2^H)/9
    let line = Blend::new(Stencil::Four, Step::Diamond, 0b1100, 0.6)
        .unwrap()
        .variance;
    assert!((line - (1.0 - 2f32.powf(-0.8))).abs() < 1e-6);
    let three = Blend::new(Stencil::Four, Step::Diamond, 0b0111, 0.6)
        .unwrap()
        .variance;
    assert!((three - (1.0 - (4f32.powf(0.6) + 2.0 * 2f32.powf(0.6)) / 9.0)).abs() < 1e-6);
}

#[test]
fn means_are_the_published_ones() {
    let table = oracle("midpoint_means.json");
    let input = values(&table["input"]);
    let check = |stencil, hurst: f32, expected: &serde_json::Value| {
        let roughness = |_: usize, _: usize| Roughness { hurst, sigma: 1.0 };
        let settings = Midpoint {
            roughness: &roughness,
            ..settings(stencil, Noise::None)
        };
        let (mut grid, side) = spread(&input, 5, 1);
        let counts = densify(&mut grid, side, 1, &settings, &mut || {
            panic!("a mean needs no noise")
        });
        assert_eq!(
            counts,
            Counts {
                filled: 56,
                unknown: 0
            }
        );
        let worst = common::max_error(&grid, &values(expected));
        assert!(worst < 2e-5, "{stencil:?}, H {hurst}: {worst}");
    };
    check(Stencil::Four, 0.5, &table["four_neighbour"]);
    for hurst in ["0.3", "0.8"] {
        check(
            Stencil::Kriged16,
            hurst.parse().unwrap(),
            &table["krig16"][hurst],
        );
    }
}

/// Σ over lags of the increments' products, averaged over all positions on both axes.
fn increment_products(a: &[f32], b: &[f32], side: usize, lag: usize) -> f64 {
    let (mut total, mut count) = (0f64, 0f64);
    let mut pair = |i: usize, j: usize| {
        total += f64::from(a[i] - a[j]) * f64::from(b[i] - b[j]);
        count += 1.0;
    };
    for p in 0..side {
        for q in 0..side - lag {
            pair(p * side + q, p * side + q + lag);
            pair(q * side + p, (q + lag) * side + p);
        }
    }
    total / count
}

/// The structure function of the densified surface over that of the model, exactly: the
/// surface is linear in the coarse heights and in every draw of noise.
fn structure_ratio(stencil: Stencil, hurst: f32, levels: u32, lags: &[usize]) -> Vec<f64> {
    let side = 5;
    let roughness = |_: usize, _: usize| Roughness { hurst, sigma: 1.0 };
    let run = |coarse: &[f32], noise, normal: &mut dyn FnMut() -> f32| {
        let settings = Midpoint {
            roughness: &roughness,
            ..settings(stencil, noise)
        };
        let (mut grid, fine) = spread(coarse, side, levels);
        densify(&mut grid, fine, levels, &settings, normal);
        grid
    };
    let (n, step) = (side * side, 1 << levels);
    let fine = (side - 1) * step + 1;
    let mut sums = vec![0f64; lags.len()];
    let mut add = |a: &[f32], b: &[f32], factor: f64| {
        for (&lag, sum) in lags.iter().zip(&mut sums) {
            *sum += factor * increment_products(a, b, fine, lag);
        }
    };
    let unit = |k: usize| {
        (0..n)
            .map(|i| f32::from(u8::from(i == k)))
            .collect::<Vec<f32>>()
    };
    let responses: Vec<_> = (0..n)
        .map(|k| run(&unit(k), Noise::None, &mut || 0.0))
        .collect();
    for i in 0..n {
        for j in 0..i {
            let rows = ((i / side) as f64 - (j / side) as f64) * f64::from(step as u32);
            let columns = ((i % side) as f64 - (j % side) as f64) * f64::from(step as u32);
            // the weights of an increment sum to 0, so its variance is -1/2 Σ Σ w w' D
            add(
                &responses[i],
                &responses[j],
                -rows.hypot(columns).powf(2.0 * f64::from(hurst)),
            );
        }
    }
    for draw in 1..=fine * fine - n {
        let mut count = 0;
        let one = run(&vec![0.0; n], Noise::Fbm, &mut || {
            count += 1;
            f32::from(u8::from(count == draw))
        });
        add(&one, &one, 1.0);
    }
    lags.iter()
        .zip(sums)
        .map(|(&lag, v)| v / (lag as f64).powf(2.0 * f64::from(hurst)))
        .collect()
}

#[test]
fn kriged_doublings_keep_the_structure_function() {
    for (hurst, tolerance) in [(0.2, 0.031), (0.5, 0.011), (0.8, 0.011)] {
        let ratios = structure_ratio(Stencil::Kriged16, hurst, 3, &[1, 2, 3, 4, 6, 8]);
        println!("H {hurst}: {ratios:.4?}");
        for ratio in ratios {
            assert!((ratio - 1.0).abs() <= tolerance, "H {hurst}: {ratio}");
        }
    }
}

#[test]
fn four_neighbours_do_not() {
    let ratios = structure_ratio(Stencil::Four, 0.8, 3, &[1, 4]);
    println!("four neighbours, H 0.8: {ratios:.3?}");
    assert!(
        ratios[0] < 0.97 && (ratios[1] - 0.82).abs() < 0.01,
        "{ratios:?}"
    );
}

#[test]
fn measured_nodes_are_not_touched_and_holes_stay_holes() {
    let roughness = |_: usize, column: usize| Roughness {
        hurst: if column < 9 { 0.3 } else { 0.8 },
        sigma: 2.0,
    };
    let settings = Midpoint {
        roughness: &roughness,
        resolution: 0.5,
        ..settings(Stencil::Kriged16, Noise::Fbm)
    };
    let coarse: Vec<f32> = (0..25)
        .map(|i| (i as f32 * 1.7).sin() * 3.0 + 1000.0)
        .collect();
    let (mut grid, side) = spread(&coarse, 5, 2);
    grid[17 * 3 + 5] = 777.0; // measured between the coarse nodes
    for row in [8, 12, 16] {
        for column in [8, 12, 16] {
            grid[row * 17 + column] = f32::NAN; // a corner that nobody saw
        }
    }
    let before = grid.clone();
    let counts = densify(&mut grid, side, 2, &settings, &mut common::normal(5));
    for (old, new) in before.iter().zip(&grid) {
        assert!(old.is_nan() || old.to_bits() == new.to_bits());
    }
    assert!(counts.unknown > 0 && counts.filled > 100, "{counts:?}");
    assert_eq!(
        grid.iter().filter(|z| z.is_nan()).count(),
        counts.unknown + 9
    );
    assert!(
        grid.iter()
            .filter(|z| z.is_finite() && **z != 777.0)
            .all(|z| (z - 1000.0).abs() < 100.0)
    );
}

#[test]
fn bad_input_is_refused() {
    let bad = |_: usize, _: usize| Roughness {
        hurst: 1.0,
        sigma: 1.0,
    };
    let mut cache = [Blend::default(); 4];
    let mut run = |settings: &Midpoint, shape, grid: &mut [f32]| {
        settings.densify(grid, shape, 2, (&mut || 0.0, &mut cache))
    };
    let good = settings(Stencil::Four, Noise::Fbm);
    let mut grid = [0.0; 30];
    assert!(run(&good, Shape::new(6, 5), &mut grid).is_err());
    assert!(run(&good, Shape::new(9, 9), &mut grid).is_err());
    grid[6] = f32::NAN;
    assert!(
        run(
            &Midpoint {
                roughness: &bad,
                ..good
            },
            Shape::new(5, 5),
            &mut grid
        )
        .is_err()
    );
    assert!(
        run(
            &settings(Stencil::Four, Noise::None),
            Shape::new(5, 5),
            &mut grid
        )
        .is_ok()
    );
}

/// (H, σ at 1 sample) from the mean absolute increments at lags 1 … 16.
fn increments(grid: &[f32], side: usize) -> (f64, f64) {
    let points: Vec<(f64, f64)> = (1..=16)
        .map(|lag| {
            let (mut sum, mut count) = (0f64, 0f64);
            for p in 0..side {
                for q in 0..side - lag {
                    sum += f64::from((grid[p * side + q] - grid[p * side + q + lag]).abs());
                    sum += f64::from((grid[q * side + p] - grid[(q + lag) * side + p]).abs());
                    count += 2.0;
                }
            }
            ((lag as f64).ln(), (sum / count).ln())
        })
        .collect();
    let n = points.len() as f64;
    let (mx, my) = points
        .iter()
        .fold((0.0, 0.0), |m, p| (m.0 + p.0 / n, m.1 + p.1 / n));
    let slope = points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum::<f64>()
        / points.iter().map(|p| (p.0 - mx).powi(2)).sum::<f64>();
    (
        slope,
        (my - slope * mx).exp() * (std::f64::consts::PI / 2.0).sqrt(),
    )
}

/// Fang et al. 2004, Tables 1 and 2, on real terrain: sample every second node, densify,
/// compare H and σ with the original's.
#[test]
fn calibrated_noise_beats_linear_on_real_terrain() {
    let crops = [
        ("full", 0, 0, 343),
        ("A", 0, 0, 257),
        ("B", 87, 146, 257),
        ("C", 40, 80, 257),
        ("[20:149,20:149]", 20, 20, 129),
        ("[200:329,250:379]", 200, 250, 129),
    ];
    for (name, row, column, side) in crops {
        let truth = crop(row, column, side);
        let half = side / 2 + 1;
        let coarse: Vec<f32> = (0..half * half)
            .map(|i| truth[(i / half) * 2 * side + (i % half) * 2])
            .collect();
        let mut entries = [Blend::default(); 64];
        let mut cache = Cache::new(&mut entries, Stencil::Kriged16);
        let calibration =
            Calibration::measure(&coarse, Shape::new(half, half), 0.8, &mut cache).unwrap();
        let (mut dense, _) = spread(&coarse, half, 1);
        densify(
            &mut dense,
            side,
            1,
            &settings(Stencil::Kriged16, Noise::Calibrated(calibration)),
            &mut common::normal(1),
        );
        let linear = common::bilinear(&coarse, half, 2);
        let (h, s) = increments(&truth, side);
        let error = |grid: &[f32]| {
            let (hh, ss) = increments(grid, side);
            (hh - h, ss - s, common::rmse(grid, &truth))
        };
        let (l, d) = (error(&linear), error(&dense));
        println!(
            "{name}: H {h:.3} sigma {s:.2}; linear {l:+.3?}; calibrated {d:+.3?}; {calibration:?}"
        );
        assert!(
            d.0.abs() < l.0.abs(),
            "{name}: dH {} against linear's {}",
            d.0,
            l.0
        );
        assert!(
            d.1.abs() < l.1.abs(),
            "{name}: dσ {} against linear's {}",
            d.1,
            l.1
        );
    }
}
