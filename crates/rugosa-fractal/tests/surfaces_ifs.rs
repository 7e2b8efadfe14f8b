//! Projected IFS against independent values, exact recovery and a real DEM.
#![cfg(feature = "alloc")]

mod common;
use common::{crop, oracle, values64};
use rugosa_fractal::surfaces::Shape;
use rugosa_fractal::surfaces::ifs::*;

fn close(a: f64, b: f64, tolerance: f64) {
    assert!(
        (a - b).abs() <= tolerance * b.abs().max(1.0),
        "{a} against {b}"
    );
}

fn published() -> (Ifs, serde_json::Value) {
    let table = oracle("pifs_tabulate.json");
    (
        Ifs::from_parameters(Variant::Tied, values64(&table["params"])).unwrap(),
        table,
    )
}

#[test]
fn tables_are_the_published_ones() {
    let (ifs, table) = published();
    for (a, b) in ifs.tabulate(2).iter().zip(values64(&table["p2"])) {
        close(*a, b, 1e-12);
    }
    let p3 = ifs.tabulate(3);
    for (a, b) in p3[5 * 28..6 * 28].iter().zip(values64(&table["p3_row5"])) {
        close(*a, b, 1e-12);
    }
    close(p3.iter().sum(), table["p3_sum"].as_f64().unwrap(), 1e-11);
    close(
        p3.iter().map(|z| z * z).sum(),
        table["p3_sumsq"].as_f64().unwrap(),
        1e-11,
    );
    let p4 = ifs.tabulate(4);
    close(p4.iter().sum(), table["p4_sum"].as_f64().unwrap(), 1e-11);
    for sample in values64(&table["p4_samples"]).chunks(3) {
        close(
            p4[sample[0] as usize * 82 + sample[1] as usize],
            sample[2],
            1e-12,
        );
    }
}

#[test]
fn the_jacobian_is_the_published_one() {
    let (ifs, table) = published();
    let (_, rows) = ifs.jacobian(3);
    let expected = values64(&table["jac_p3_row"]);
    let index = values64(&table["jac_p3_row_index"]);
    let row = if index.len() == 1 {
        index[0] as usize
    } else {
        index[0] as usize * 28 + index[1] as usize
    };
    for (a, b) in rows[row * 232..][..232].iter().zip(expected) {
        close(*a, b, 1e-11);
    }
    let norm = rows.iter().map(|v| v * v).sum::<f64>().sqrt();
    close(norm, table["jac_p3_fro"].as_f64().unwrap(), 1e-11);
    let jacobian = nalgebra::DMatrix::from_row_slice(28 * 28, 232, &rows);
    let squares = jacobian.tr_mul(&jacobian).symmetric_eigenvalues();
    let expected = values64(&table["jac_p3_sv_max_min"]);
    close(squares.max().sqrt(), expected[0], 1e-9);
    close(squares.min().sqrt(), expected[1], 1e-7);
}

#[test]
fn contractivity_is_the_published_one() {
    let (ifs, table) = published();
    let found = contractivity(&ifs);
    for (a, b) in found.tau.iter().zip(values64(&table["tau_1_2_3"])) {
        close(*a, b, 1e-9);
    }
    close(
        found.radius,
        table["rho_lower_words2"].as_f64().unwrap(),
        1e-8,
    );
    let bilinear = contractivity(&Ifs::bilinear(Variant::Tied, &[0.0; 16]));
    assert_eq!(bilinear.verdict, Verdict::Proved);
    close(bilinear.tau[1], 0.556, 1e-3);
    close(bilinear.tau[2], 0.210, 2e-3);
}

/// Bilinear weights plus noise, z ~ N(0, 1): the model's own surfaces.
fn random(variant: Variant, seed: u64, spread: f64) -> Ifs {
    let mut normal = common::normal(seed);
    let mut draw = move || f64::from(normal());
    let z = core::array::from_fn(|_| draw());
    let bilinear = Ifs::bilinear(variant, &z);
    let disturbed = |(i, p): (usize, &f64)| if i < 16 { *p } else { p + spread * draw() };
    Ifs::from_parameters(
        variant,
        bilinear
            .parameters()
            .iter()
            .enumerate()
            .map(disturbed)
            .collect(),
    )
    .unwrap()
}

#[test]
fn coarser_tables_are_decimations_and_heights_scale() {
    for variant in [Variant::Tied, Variant::Mirrored] {
        let ifs = random(variant, 1, 0.1);
        let (fine, coarse) = (ifs.tabulate(4), ifs.tabulate(3));
        for (i, z) in coarse.iter().enumerate() {
            assert_eq!(fine[(i / 28) * 3 * 82 + (i % 28) * 3], *z);
        }
        assert_eq!(ifs.tabulate(1), ifs.parameters()[..16]);
        for (a, b) in ifs.scaled(-3.0, 7.0).tabulate(4).iter().zip(&fine) {
            close(*a, 7.0 - 3.0 * b, 1e-12);
        }
    }
}

/// A fractal surface's largest increment falls with depth; a seam's does not.
#[test]
fn children_meet_at_every_depth() {
    for variant in [Variant::Tied, Variant::Mirrored] {
        let ifs = random(variant, 2, 0.05);
        let largest = |depth: u32| {
            let (table, side) = (ifs.tabulate(depth), side_of(depth));
            (0..side * (side - 1))
                .map(|i| {
                    let (p, q) = (i / (side - 1), i % (side - 1));
                    let across = (table[p * side + q] - table[p * side + q + 1]).abs();
                    across.max((table[q * side + p] - table[(q + 1) * side + p]).abs())
                })
                .fold(0.0, f64::max)
        };
        let falls: Vec<f64> = (2..7).map(|d| largest(d + 1) / largest(d)).collect();
        println!("{variant:?}: {falls:.3?}");
        assert!(falls.iter().all(|f| *f < 0.8), "{variant:?}: {falls:?}");
    }
}

#[test]
fn own_surfaces_are_recovered_in_ten_iterations() {
    let exact = |ridge| Options {
        iterations: 10,
        ridge,
        tolerance: 0.0,
        ..Options::default()
    };
    for seed in 0..4 {
        for depth in [3, 4] {
            for start in [Start::Bilinear, Start::Collage] {
                let truth = random(Variant::Tied, 10 + seed, 0.2);
                let data = truth.tabulate(depth);
                let found = fit(
                    &data,
                    &Options {
                        start,
                        ..exact(0.0)
                    },
                    &[],
                    &mut |_| {},
                )
                .unwrap();
                let worst = found
                    .ifs
                    .parameters()
                    .iter()
                    .zip(truth.parameters())
                    .map(|(a, b)| (a - b).abs())
                    .fold(0.0, f64::max);
                assert!(
                    worst < 1e-9,
                    "seed {seed} depth {depth} {start:?}: {worst} after {:?}",
                    found.psnr
                );
            }
        }
    }
}

#[test]
fn fits_reach_the_published_psnr() {
    let table = oracle("pifs_fit.json");
    for case in table["cases"].as_array().unwrap() {
        let data = match case["data"].as_array() {
            Some(_) => values64(&case["data"]),
            None => (0..784)
                .map(|i| {
                    let (s, t) = ((i / 28) as f64 / 27.0, (i % 28) as f64 / 27.0);
                    1.0 - ((s - 0.5) / 0.7f64).powi(2) - ((t - 0.5) / 0.5f64).powi(2)
                })
                .collect(),
        };
        for (ridge, expected) in case["lm_psnr_per_iteration"].as_object().unwrap() {
            let ridge: f64 = ridge.parse().unwrap();
            let options = Options {
                ridge,
                iterations: 10,
                tolerance: 0.0,
                ..Options::default()
            };
            let found = fit(&data, &options, &[], &mut |_| {}).unwrap();
            let expected = values64(expected);
            println!("{} ridge {ridge}: {:.3?}", case["name"], found.psnr);
            close(
                found.psnr[0],
                case["psnr_bilinear_start"].as_f64().unwrap(),
                1e-4,
            );
            let last = *found.psnr.last().unwrap();
            if expected[0] > 22.0 && ridge == 0.0 {
                assert!(last >= 37.0, "{last}");
            } else if expected[0] > 22.0 {
                assert!(last > expected[10] - 1.0, "{last} for {}", expected[10]);
            } else {
                assert!(
                    (last - expected[10]).abs() <= 0.2,
                    "{last} for {}",
                    expected[10]
                );
            }
        }
        let start = collage(&data, 3, Variant::Tied);
        let table = start.tabulate(3);
        let found = psnr64(&table, &data);
        let expected = case["psnr_collage"].as_f64().unwrap();
        println!("collage {found:.3} for {expected:.3}");
        assert!((found - expected).abs() < 0.2);
    }
}

fn psnr64(a: &[f64], b: &[f64]) -> f64 {
    let (low, high) = b
        .iter()
        .fold((f64::MAX, f64::MIN), |m, v| (m.0.min(*v), m.1.max(*v)));
    let squares: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
    10.0 * ((high - low).powi(2) * b.len() as f64 / squares).log10()
}

fn terrain(row: usize, column: usize, side: usize) -> Vec<f64> {
    crop(row, column, side).into_iter().map(f64::from).collect()
}

#[test]
fn natural_crops_of_82_reach_the_table_after_seven_iterations() {
    for (row, column, expected) in [(20, 20, 24.02), (130, 180, 27.47), (250, 300, 22.34)] {
        let data = terrain(row, column, 82);
        let seven = |ridge| Options {
            iterations: 7,
            ridge,
            ..Options::default()
        };
        let free = fit(&data, &seven(0.0), &[], &mut |_| {}).unwrap();
        let ridged = fit(&data, &seven(1e-5), &[], &mut |_| {}).unwrap();
        println!(
            "[{row}, {column}]: {:.2?}\n  ridge: {:.2?} {:?}",
            free.psnr, ridged.psnr, ridged.contractivity
        );
        assert!(
            free.psnr.last().unwrap() > &(expected - 0.3),
            "{:?}",
            free.psnr
        );
        assert!(
            ridged.psnr.last().unwrap() > &(expected - 0.3),
            "{:?}",
            ridged.psnr
        );
        assert_ne!(ridged.contractivity.verdict, Verdict::Diverges);
        let mirrored = fit(
            &data,
            &Options {
                variant: Variant::Mirrored,
                iterations: 15,
                ..Options::default()
            },
            &[],
            &mut |_| {},
        )
        .unwrap();
        println!("  mirrored: {:.2}", mirrored.psnr.last().unwrap());
    }
}

#[test]
fn patches_join_without_a_seam() {
    for variant in [Variant::Tied, Variant::Mirrored] {
        let (shape, data) = (Shape::new(55, 55), terrain(60, 60, 55));
        let options = Options {
            variant,
            iterations: 4,
            ridge: 1e-4,
            ..Options::default()
        };
        let mut heard = 0;
        let (mosaic, fits) =
            Mosaic::fit(&data, shape, 3, &options, &mut |_, _| heard += 1).unwrap();
        assert_eq!((mosaic.lattice(), fits.len()), (Shape::new(2, 2), 4));
        assert!(heard >= 16);
        for (a, b) in [(0, 1), (2, 3)] {
            let (left, right) = (
                mosaic.patches()[a].tabulate(5),
                mosaic.patches()[b].tabulate(5),
            );
            for row in 0..244 {
                assert_eq!(left[row * 244 + 243], right[row * 244], "{variant:?}");
            }
        }
        for (a, b) in [(0, 2), (1, 3)] {
            let (above, below) = (
                mosaic.patches()[a].tabulate(5),
                mosaic.patches()[b].tabulate(5),
            );
            assert_eq!(above[243 * 244..], below[..244], "{variant:?}");
        }
        let (table, shape) = mosaic.tabulate(3);
        assert_eq!(shape, Shape::new(55, 55));
        let found = psnr64(&table, &data);
        println!("{variant:?}: mosaic {found:.2} dB");
        assert!(found > 20.0);
    }
}

#[test]
fn files_have_the_documented_size_and_damage_is_noticed() {
    let mosaic = Mosaic::single(random(Variant::Tied, 3, 0.1), 4);
    let bytes = mosaic.to_bytes();
    assert_eq!(bytes.len(), 948);
    let back = Mosaic::from_bytes(&bytes).unwrap();
    assert_eq!(back.depth(), 4);
    assert_eq!(back.to_bytes(), bytes);
    for (a, b) in back.patches()[0]
        .parameters()
        .iter()
        .zip(mosaic.patches()[0].parameters())
    {
        assert_eq!(*a, f64::from(*b as f32));
    }
    for i in 0..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[i] ^= 1 << (i % 8);
        assert!(Mosaic::from_bytes(&damaged).is_err(), "byte {i}");
        assert!(Mosaic::from_bytes(&bytes[..i]).is_err());
    }
}

#[test]
fn odd_data_give_a_defined_result() {
    let quiet = &mut |_| {};
    let flat = fit(&vec![5.0; 784], &Options::default(), &[], quiet).unwrap();
    assert_eq!(flat.ifs, Ifs::bilinear(Variant::Tied, &[5.0; 16]));
    assert_eq!(flat.contractivity.verdict, Verdict::Proved);
    let plane: Vec<f64> = (0..784)
        .map(|i| (i / 28) as f64 + 2.0 * (i % 28) as f64)
        .collect();
    assert!(fit(&plane, &Options::default(), &[], quiet).unwrap().psnr[0] > 200.0);
    assert!(
        fit(&vec![0.0; 100], &Options::default(), &[], quiet).is_err(),
        "p = 2"
    );
    assert!(fit(&vec![0.0; 785], &Options::default(), &[], quiet).is_err());
    let mut holes = vec![0.0; 784];
    holes[3] = f64::NAN;
    assert!(fit(&holes, &Options::default(), &[], quiet).is_err());
}
