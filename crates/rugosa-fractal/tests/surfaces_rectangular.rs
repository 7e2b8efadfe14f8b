//! Rectangular fractal interpolation surfaces against independent values, their theorems
//! and a real DEM.

mod common;
use common::{bilinear, crop, oracle, psnr, values};
use rugosa_fractal::surfaces::Shape;
use rugosa_fractal::surfaces::rectangular::*;

fn evaluate(surface: &Surface) -> (Vec<f32>, u32) {
    let mut out = vec![f32::NAN; surface.shape().len()];
    let passes = surface.evaluate(&mut out).unwrap();
    (out, passes)
}

#[test]
fn iterated_surfaces_are_the_published_ones() {
    let table = oracle("fis_constant_s.json");
    let nodes = values(&table["nodes"]);
    for (scale, expected) in table["surfaces"].as_object().unwrap() {
        let s: f32 = scale.parse().unwrap();
        let surface = Surface::new(&nodes, Shape::new(4, 5), (3, 4), Scale::Constant(s)).unwrap();
        let (out, _) = evaluate(&surface);
        let worst = common::max_error(&out, &values(expected));
        assert!(worst < 1e-5, "s {scale}: {worst}");
    }
}

#[test]
fn one_pass_is_exact_where_tiles_divide_the_lattice() {
    let table = oracle("fis_one_pass.json");
    let nodes = values(&table["nodes"]);
    let surface = Surface::new(&nodes, Shape::new(5, 5), (4, 4), Scale::Constant(0.3)).unwrap();
    let (out, passes) = evaluate(&surface);
    assert_eq!(passes, 1);
    assert!(common::max_error(&out, &values(&table["surface"])) < 1e-5);
    assert_eq!(passes_to_nodes(32, 8), Some(1));
    assert_eq!(passes_to_nodes(16, 16), Some(1));
    assert_eq!(passes_to_nodes(8, 32), Some(2));
    assert_eq!(passes_to_nodes(4, 64), Some(3));
    assert_eq!(passes_to_nodes(5, 4), None);
}

fn random(count: usize, seed: u64) -> Vec<f32> {
    let mut normal = common::normal(seed);
    (0..count).map(|_| normal()).collect()
}

/// f = b + s (f - B)(L⁻¹) evaluated from the two tiles that share an edge: the fixed-point
/// equation written out with explicit maps, as an oracle of continuity.
fn edge_jump(
    z: &[f32],
    lattice: Shape,
    t: usize,
    s: &dyn Fn(usize, usize) -> f32,
    out: &[f32],
) -> f32 {
    let shape = lattice.finer(t);
    let (ny, nx) = (lattice.rows - 1, lattice.columns - 1);
    let at = |y: usize, x: usize| out[y * shape.columns + x];
    let corner = |i: usize, j: usize| z[i * ny * lattice.columns + j * nx];
    let base = |y: usize, x: usize| {
        let (u, v) = (y as f32 / (ny * t) as f32, x as f32 / (nx * t) as f32);
        (1.0 - u) * ((1.0 - v) * corner(0, 0) + v * corner(0, 1))
            + u * ((1.0 - v) * corner(1, 0) + v * corner(1, 1))
    };
    // preimage of the local sample k of tile i: mirrored in odd tiles
    let pre = |i: usize, k: usize, n: usize| {
        if i.is_multiple_of(2) {
            k * n
        } else {
            (t - k) * n
        }
    };
    let detail = |i: usize, j: usize, ky: usize, kx: usize| {
        let (y, x) = (pre(i, ky, ny), pre(j, kx, nx));
        s(i, j) * (at(y, x) - base(y, x))
    };
    let mut worst = 0f32;
    for i in 0..ny {
        for j in 0..nx {
            for k in 0..=t {
                if j + 1 < nx {
                    worst = worst.max((detail(i, j, k, t) - detail(i, j + 1, k, 0)).abs());
                }
                if i + 1 < ny {
                    worst = worst.max((detail(i, j, t, k) - detail(i + 1, j, 0, k)).abs());
                }
            }
        }
    }
    worst
}

/// Largest |f - b - s (f - B)(L⁻¹)| over all samples inside tiles, with explicit maps.
fn fixed_point_error(z: &[f32], lattice: Shape, t: usize, scales: &[f32], out: &[f32]) -> f32 {
    let shape = lattice.finer(t);
    let (ny, nx) = (lattice.rows - 1, lattice.columns - 1);
    let flat = |y: f32, x: f32, i: usize, j: usize, step: usize| {
        let at =
            |a: usize, b: usize| z[(i + a * step.min(ny)) * lattice.columns + j + b * step.min(nx)];
        (1.0 - y) * ((1.0 - x) * at(0, 0) + x * at(0, 1))
            + y * ((1.0 - x) * at(1, 0) + x * at(1, 1))
    };
    let far = usize::MAX;
    let mut worst = 0f32;
    for y in 0..ny * t {
        for x in 0..nx * t {
            let (i, j, ky, kx) = (y / t, x / t, y % t, x % t);
            let b = flat(ky as f32 / t as f32, kx as f32 / t as f32, i, j, 1);
            let py = ny * if i % 2 == 0 { ky } else { t - ky };
            let px = nx * if j % 2 == 0 { kx } else { t - kx };
            let base = flat(
                py as f32 / (ny * t) as f32,
                px as f32 / (nx * t) as f32,
                0,
                0,
                far,
            );
            let expected = b + scales[i * nx + j] * (out[py * shape.columns + px] - base);
            worst = worst.max((out[y * shape.columns + x] - expected).abs());
        }
    }
    worst
}

#[test]
fn equal_scales_never_jump_and_unequal_ones_by_the_formula() {
    for (rows, columns, t) in [(4, 4, 4), (3, 5, 6), (8, 8, 8), (5, 4, 3)] {
        let lattice = Shape::new(rows + 1, columns + 1);
        let nodes = random(lattice.len(), 7);
        for s in [0.02, 0.3, -0.5, 0.9] {
            let surface = Surface::new(&nodes, lattice, (t, t), Scale::Constant(s)).unwrap();
            let (out, _) = evaluate(&surface);
            assert_eq!(edge_jump(&nodes, lattice, t, &|_, _| s, &out), 0.0);
            assert_eq!(surface.largest_jump(&out), 0.0);
            for (i, z) in nodes.iter().enumerate() {
                let (r, c) = (i / lattice.columns * t, i % lattice.columns * t);
                assert_eq!(out[r * surface.shape().columns + c], *z, "a node moved");
            }
        }
        let scales: Vec<f32> = random(rows * columns, 8)
            .iter()
            .map(|v| (0.3 * v).clamp(-0.5, 0.5))
            .collect();
        let surface = Surface::new(&nodes, lattice, (t, t), Scale::Tiles(&scales)).unwrap();
        let (out, _) = evaluate(&surface);
        let jump = edge_jump(&nodes, lattice, t, &|i, j| scales[i * columns + j], &out);
        assert!(jump > 0.1);
        // the samples of an edge see only some of the border that maps onto it
        let told = surface.largest_jump(&out);
        assert!(
            jump <= told * 1.00001 && jump > 0.5 * told,
            "{jump} against {told}"
        );
        assert!((fixed_point_error(&nodes, lattice, t, &scales, &out)) < 2e-5);
    }
}

#[test]
fn coons_base_keeps_edges_straight_for_any_scales() {
    let lattice = Shape::new(9, 9);
    let nodes = random(81, 3);
    let scales: Vec<f32> = random(64, 4)
        .iter()
        .map(|v| (0.4 * v).clamp(-0.9, 0.9))
        .collect();
    let surface = Surface::new(&nodes, lattice, (8, 8), Scale::Tiles(&scales))
        .unwrap()
        .on(Base::Coons);
    let (out, _) = evaluate(&surface);
    assert_eq!(surface.largest_jump(&out), 0.0);
    let flat = bilinear(&nodes, 9, 8);
    let mut inside = 0f32;
    for i in 0..65 * 65 {
        let difference = (out[i] - flat[i]).abs();
        if (i / 65) % 8 == 0 || (i % 65) % 8 == 0 {
            assert!(difference < 2e-6, "edge moved by {difference}");
        }
        inside = inside.max(difference);
    }
    assert!(inside > 0.5);
}

#[test]
fn a_continuous_field_of_scales_is_the_constant_one_when_it_is_constant() {
    let lattice = Shape::new(5, 5);
    let nodes = random(25, 5);
    let field = [0.4; 25];
    let a = evaluate(&Surface::new(&nodes, lattice, (4, 4), Scale::Nodes(&field)).unwrap()).0;
    let b = evaluate(&Surface::new(&nodes, lattice, (4, 4), Scale::Constant(0.4)).unwrap()).0;
    assert!(common::max_error(&a, &b) < 1e-6);
}

/// With n = 2 and s = 2^−H, increments on the level lattices grow with exponent H.
#[test]
fn scale_from_hurst_gives_the_exponent() {
    for hurst in [0.2, 0.4, 0.6] {
        let nodes = [0.0, 1.0, 0.3, -0.7, 0.2, 0.9, 0.4, -0.8, 0.1];
        let t = 1 << 9;
        let s = scale_for_hurst(2.0, hurst);
        let surface = Surface::new(&nodes, Shape::new(3, 3), (t, t), Scale::Constant(s)).unwrap();
        let (out, _) = evaluate(&surface);
        let side = 2 * t + 1;
        let mean = |lag: usize| {
            let (mut sum, mut count) = (0f64, 0f64);
            for y in (0..side).step_by(lag) {
                for x in (0..side - lag).step_by(lag) {
                    sum += f64::from((out[y * side + x] - out[y * side + x + lag]).abs());
                    count += 1.0;
                }
            }
            sum / count
        };
        let exponent = (mean(16).ln() - mean(1).ln()) / 16f64.ln();
        println!("H {hurst}: {exponent:.4}");
        assert!(
            (exponent - f64::from(hurst)).abs() < 0.01,
            "{exponent} for H {hurst}"
        );
        assert!((dimension(2.0, s) - (3.0 - hurst)).abs() < 1e-5);
    }
    assert_eq!(dimension(32.0, 0.02), 2.0);
}

/// PSNR of 257² crops from every 8th and 16th node, dB: bilinear, s = −.1, −.02, .02, .05,
/// .1, .2, .3 and the best s.
type Row = (&'static str, usize, usize, usize, [f64; 8], f64);
const TABLE: [Row; 6] = [
    (
        "A",
        0,
        0,
        8,
        [
            26.309, 25.440, 26.259, 26.287, 26.125, 25.557, 23.784, 21.840,
        ],
        0.0040,
    ),
    (
        "A",
        0,
        0,
        16,
        [
            21.326, 20.984, 21.299, 21.331, 21.298, 21.137, 20.480, 19.531,
        ],
        0.0149,
    ),
    (
        "B",
        87,
        146,
        8,
        [
            28.475, 27.669, 28.439, 28.441, 28.263, 27.679, 25.904, 23.974,
        ],
        0.0003,
    ),
    (
        "B",
        87,
        146,
        16,
        [
            23.632, 23.370, 23.631, 23.608, 23.524, 23.265, 22.403, 21.285,
        ],
        -0.0087,
    ),
    (
        "C",
        40,
        80,
        8,
        [
            27.307, 26.482, 27.266, 27.280, 27.111, 26.541, 24.783, 22.857,
        ],
        0.0020,
    ),
    (
        "C",
        40,
        80,
        16,
        [
            22.163, 21.819, 22.138, 22.165, 22.124, 21.944, 21.237, 20.238,
        ],
        0.0114,
    ),
];

#[test]
fn psnr_of_the_real_dem_is_the_table() {
    for (name, row, column, step, expected, best) in TABLE {
        let truth = crop(row, column, 257);
        let n = 256 / step + 1;
        let nodes: Vec<f32> = (0..n * n)
            .map(|i| truth[(i / n) * step * 257 + (i % n) * step])
            .collect();
        let surface =
            Surface::new(&nodes, Shape::new(n, n), (step, step), Scale::Constant(0.0)).unwrap();
        for (s, expected) in [0.0, -0.1, -0.02, 0.02, 0.05, 0.1, 0.2, 0.3]
            .into_iter()
            .zip(expected)
        {
            let found = psnr(
                &evaluate(&surface.with(Scale::Constant(s)).unwrap()).0,
                &truth,
            );
            assert!(
                (found - expected).abs() < 0.02,
                "{name} {step} s {s}: {found} for {expected}"
            );
        }
        let mut scratch = vec![0.0; 257 * 257];
        let found = f64::from(surface.best_scale(&truth, &mut scratch).unwrap());
        assert!(
            (found - best).abs() < 3e-4,
            "{name} {step}: best s {found} for {best}"
        );
        let mut scales = vec![0.0; (n - 1) * (n - 1)];
        let coons = surface.on(Base::Coons);
        coons
            .best_tile_scales(&truth, &mut scratch, &mut scales)
            .unwrap();
        let local = psnr(
            &evaluate(&coons.with(Scale::Tiles(&scales)).unwrap()).0,
            &truth,
        );
        println!(
            "{name} {step}: Coons per tile gains {:+.3} dB",
            local - expected[0]
        );
        assert!(local > expected[0] + 0.03 && local < expected[0] + 0.35);
    }
}

#[test]
fn bad_input_is_refused() {
    let nodes = [0.0, 1.0, 2.0, f32::NAN];
    let two = Shape::new(2, 2);
    assert!(Surface::new(&nodes, two, (4, 4), Scale::Constant(0.1)).is_err());
    let nodes = [0.0; 4];
    assert!(Surface::new(&nodes, two, (4, 4), Scale::Constant(1.0)).is_err());
    assert!(Surface::new(&nodes, two, (4, 4), Scale::Constant(f32::NAN)).is_err());
    assert!(Surface::new(&nodes, two, (4, 0), Scale::Constant(0.1)).is_err());
    assert!(Surface::new(&nodes, Shape::new(1, 4), (4, 4), Scale::Constant(0.1)).is_err());
    assert!(Surface::new(&nodes, two, (4, 4), Scale::Nodes(&[0.1; 3])).is_err());
    let good = Surface::new(&nodes, two, (4, 4), Scale::Constant(0.1)).unwrap();
    assert!(good.evaluate(&mut [0.0; 24]).is_err());
    let mut out = [1.0; 25];
    assert!(good.evaluate(&mut out).is_ok());
    assert_eq!(out, [0.0; 25]);
}

/// Data made with a known field give it back; with data that ask for more, the bound holds.
#[test]
fn the_field_of_scales_is_recovered() {
    let lattice = Shape::new(9, 9);
    let nodes = random(81, 11);
    let field: Vec<f32> = random(81, 12)
        .iter()
        .map(|v| (0.3 * v).clamp(-0.9, 0.9))
        .collect();
    let made = Surface::new(&nodes, lattice, (8, 8), Scale::Nodes(&field)).unwrap();
    let mut data = evaluate(&made).0;
    let (mut scratch, mut equations, mut found) = (vec![0.0; 65 * 65], [[0.0; 10]; 81], [0.0; 81]);
    let flat = made.with(Scale::Constant(0.0)).unwrap();
    flat.best_node_scales(&data, (&mut scratch, &mut equations), &mut found)
        .unwrap();
    let worst = common::max_error(&found, &field);
    assert!(worst < 1e-4, "{worst}");
    let plain = evaluate(&flat).0;
    for (z, b) in data.iter_mut().zip(&plain) {
        *z = b + 4.0 * (*z - b);
    }
    flat.best_node_scales(&data, (&mut scratch, &mut equations), &mut found)
        .unwrap();
    assert!(found.iter().all(|s| s.abs() <= 0.95) && found.iter().any(|s| s.abs() == 0.95));
}

/// Gains of the free scales over bilinear interpolation on the crops of the table, in dB.
#[test]
fn a_continuous_field_gains_what_the_table_says() {
    let gains = [0.46, 0.38, 0.37, 0.40, 0.32, 0.41];
    for ((name, row, column, step, expected, _), gain) in TABLE.into_iter().zip(gains) {
        let truth = crop(row, column, 257);
        let n = 256 / step + 1;
        let nodes: Vec<f32> = (0..n * n)
            .map(|i| truth[(i / n) * step * 257 + (i % n) * step])
            .collect();
        let lattice = Shape::new(n, n);
        let flat = Surface::new(&nodes, lattice, (step, step), Scale::Constant(0.0)).unwrap();
        let (mut scratch, mut equations) = (vec![0.0; 257 * 257], vec![[0.0; 10]; n * n]);
        let mut scales = vec![0.0; n * n];
        flat.best_node_scales(&truth, (&mut scratch, &mut equations), &mut scales)
            .unwrap();
        let field = flat.with(Scale::Nodes(&scales)).unwrap();
        let found = psnr(&evaluate(&field).0, &truth) - expected[0];
        println!("{name} {step}: a field of s gains {found:+.3} dB");
        assert!(
            (found - gain).abs() < 0.01,
            "{name} {step}: {found} for {gain}"
        );
    }
}
