//! The height-field codec: bounds, holes, prefixes, damage, and its figures against JPEG 2000
//! and zstd.

mod common;
#[path = "common/hostile.rs"]
mod hostile;
use common::{crop, psnr};
use proptest::prelude::*;
use rugosa_fractal::codec::*;
use rugosa_fractal::surfaces::Shape;

fn square(side: usize) -> Shape {
    Shape::new(side, side)
}

struct Bench {
    work: Vec<i32>,
    out: Vec<u8>,
    back: Vec<f32>,
}

impl Bench {
    fn new(shape: Shape) -> Self {
        Bench {
            work: vec![0; shape.len()],
            out: vec![0; shape.len() * 6 + 200],
            back: vec![0.0; shape.len()],
        }
    }

    fn encode(&mut self, heights: &[f32], shape: Shape, precision: Precision) -> Encoded {
        encode(heights, shape, precision, (&mut self.work, &mut self.out)).unwrap()
    }

    fn decode(&mut self, bytes: usize) -> Result<Decoded, CodecError> {
        self.work.fill(-7);
        decode(&self.out[..bytes], (&mut self.work, &mut self.back))
    }
}

/// The three ways to write a map.
const PROFILES: [fn(f32) -> Precision; 3] = [Precision::Within, Precision::Step, Precision::Quick];
/// The one that promises no bound.
const LOSSY: usize = 1;

/// Largest difference of known heights; panics where known and unknown differ.
fn difference(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).fold(0.0, |worst, (a, b)| {
        assert_eq!(a.is_nan(), b.is_nan());
        if a.is_nan() {
            worst
        } else {
            worst.max((a - b).abs())
        }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    #[test]
    fn any_map_comes_back_within_its_bound(
        rows in 1usize..40, columns in 1usize..40, seed in 0u64..1000, holes in 0u32..5, profile in 0usize..3, scale in 0.001f32..10.0
    ) {
        let shape = Shape::new(rows, columns);
        let mut normal = common::normal(seed);
        let mut z = 100.0;
        let heights: Vec<f32> = (0..shape.len()).map(|i| {
            z += normal();
            if (i as u32 / 7) % 5 < holes { f32::NAN } else { z }
        }).collect();
        let mut bench = Bench::new(shape);
        let precision = PROFILES[profile](scale);
        let told = bench.encode(&heights, shape, precision);
        let back = bench.decode(told.bytes).unwrap();
        prop_assert_eq!((back.step, back.shape), (1, shape));
        prop_assert_eq!(back.header.max_error, told.max_error);
        let found = difference(&bench.back, &heights);
        prop_assert_eq!(found, told.max_error, "decoder and encoder differ");
        if profile != LOSSY {
            prop_assert!(found <= scale * 1.0001 + 2e-5);
        }
    }

    /// Random bytes behind a good header, prefixes, flipped bits: an error or a map, never a
    /// panic, never more memory than was lent.
    #[test]
    fn damage_is_noticed(profile in 0usize..3, seed in 0u64..1000, byte in 0usize..1000, bit in 0u8..8, cut in 0usize..1000) {
        let shape = Shape::new(33, 29);
        let mut normal = common::normal(seed);
        let heights: Vec<f32> = (0..shape.len()).map(|i| if i % 11 == 3 { f32::NAN } else { normal() }).collect();
        let mut bench = Bench::new(shape);
        let n = bench.encode(&heights, shape, PROFILES[profile](0.3)).bytes;
        let good = bench.out[..n].to_vec();
        bench.out[byte % n] ^= 1 << bit;
        prop_assert!(bench.decode(n).is_err());
        // a damaged body without its end: nothing vouches for it, but nothing breaks
        let _ = bench.decode((cut % n).max(1));
        bench.out[..n].copy_from_slice(&good);
        match bench.decode(cut % n) {
            Ok(coarse) => prop_assert!(coarse.step >= 1 && coarse.shape.len() <= shape.len()),
            Err(error) => prop_assert!(error == CodecError::Truncated),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    /// Damage that the checksums do not see, down to random bytes: whatever comes out fits.
    #[test]
    fn nothing_breaks_behind_the_checksums(
        seed in 0u64..100, holes: bool, profile in 0usize..3, cut in 0usize..2000,
        changes in prop::collection::vec((0usize..2000, any::<u8>()), 0..20),
        noise in prop::collection::vec(any::<u8>(), 0..400)
    ) {
        let shape = Shape::new(33, 29);
        let mut normal = common::normal(seed);
        let heights: Vec<f32> = (0..shape.len()).map(|i| if holes && i % 11 == 3 { f32::NAN } else { normal() }).collect();
        let mut bench = Bench::new(shape);
        let n = bench.encode(&heights, shape, PROFILES[profile](0.05)).bytes;
        let mut bytes = bench.out[..n].to_vec();
        changes.iter().for_each(|&(at, byte)| bytes[at % n] = byte);
        hostile::with_right_checksums(&bytes);
        hostile::with_right_checksums(&bytes[..cut % n]);
        hostile::with_right_checksums(&noise);
        let body = [&bytes[..HEADER], &noise].concat();
        hostile::with_right_checksums(&body);
        hostile::anything(&bytes);
    }
}

#[test]
fn a_prefix_is_a_coarser_map() {
    let heights = crop(0, 0, 257);
    let mut bench = Bench::new(square(257));
    let told = bench.encode(&heights, square(257), Precision::Step(10.0));
    let mut steps = Vec::new();
    for percent in [5, 15, 30, 50, 80, 100] {
        let coarse = bench.decode(told.bytes * percent / 100).unwrap();
        steps.push(coarse.step);
        // local means of the original on the coarser nodes
        let side = coarse.shape.rows;
        assert_eq!(coarse.shape, square(256 / coarse.step + 1));
        let reach = coarse.step as isize / 2;
        let mean = |row: usize, column: usize| {
            let mut sum = (0.0, 0.0);
            for dy in -reach..=reach {
                for dx in -reach..=reach {
                    let (y, x) = (
                        (row * coarse.step) as isize + dy,
                        (column * coarse.step) as isize + dx,
                    );
                    if (0..257).contains(&y) && (0..257).contains(&x) {
                        sum = (sum.0 + heights[(y * 257 + x) as usize], sum.1 + 1.0);
                    }
                }
            }
            sum.0 / sum.1
        };
        let expected: Vec<f32> = (0..side * side).map(|i| mean(i / side, i % side)).collect();
        let found = common::rmse(&bench.back[..side * side], &expected);
        println!(
            "{percent} %: every {}th node, rms {found:.1} m from local means",
            coarse.step
        );
        assert!(found < 40.0, "{found}");
    }
    assert!(
        steps.windows(2).all(|s| s[0] >= s[1]) && steps[0] >= 8 && steps[5] == 1,
        "{steps:?}"
    );
}

/// Of the quick profile the nodes themselves, within the bound.
#[test]
fn a_quick_prefix_has_the_heights_of_coarser_nodes() {
    let heights = crop(0, 0, 257);
    let mut bench = Bench::new(square(257));
    let told = bench.encode(&heights, square(257), Precision::Quick(2.0));
    let mut steps = Vec::new();
    for percent in [3, 10, 40, 90, 100] {
        let coarse = bench.decode(told.bytes * percent / 100).unwrap();
        let side = coarse.shape.rows;
        assert_eq!(coarse.shape, square(256 / coarse.step + 1));
        let node = |i: usize| heights[i / side * coarse.step * 257 + i % side * coarse.step];
        let nodes: Vec<f32> = (0..side * side).map(node).collect();
        assert!(difference(&bench.back[..side * side], &nodes) <= 2.0);
        steps.push(coarse.step);
    }
    assert_eq!(steps, [16, 8, 2, 2, 1]);
}

/// Bytes to the millimetre: between the coded profile and the raw differences.
#[test]
fn a_quick_map_is_a_fifth_longer() {
    let heights = crop(0, 0, 257);
    let mut bench = Bench::new(square(257));
    let coded = bench.encode(&heights, square(257), Precision::Within(0.0005));
    let quick = bench.encode(&heights, square(257), Precision::Quick(0.0005));
    let ratio = quick.bytes as f64 / coded.bytes as f64;
    println!(
        "coded {}, quick {} bytes: {ratio:.3}",
        coded.bytes, quick.bytes
    );
    assert!((1.15..1.25).contains(&ratio), "{ratio}");
}

#[test]
fn exact_within_finds_the_common_divisor_and_keeps_the_bound() {
    let heights = crop(0, 0, 129);
    let mut bench = Bench::new(square(129));
    let millimetre = bench.encode(&heights, square(129), Precision::Within(0.0005));
    assert_eq!(millimetre.max_error, 0.0, "whole metres");
    let metre = bench.encode(&heights, square(129), Precision::Within(0.5));
    assert_eq!(millimetre.bytes, metre.bytes);
    for bound in [0.3, 2.0, 15.0, 60.0] {
        let told = encode_within(
            &heights,
            square(129),
            bound,
            (&mut bench.work, &mut bench.out),
        )
        .unwrap();
        bench.decode(told.bytes).unwrap();
        let found = difference(&bench.back, &heights);
        println!(
            "within {bound} m: {} bytes, largest error {found}, lossy {}",
            told.bytes,
            Header::read(&bench.out).unwrap().is_lossy()
        );
        assert!(found <= bound && found > 0.4 * bound || bound < 0.5);
    }
}

/// 257²: PSNR at the bytes of 33² and 17² samples as 16-bit numbers, against JPEG 2000 (OpenJPEG,
/// 16 bits, irreversible) at no fewer bytes: published figures for these two surfaces.
#[test]
fn more_than_jpeg_2000_at_its_sizes() {
    let heights = crop(0, 0, 257);
    let mut bench = Bench::new(square(257));
    for (bytes, jpeg) in [(2186, 35.5), (586, 27.5)] {
        let told = encode_to_size(
            &heights,
            square(257),
            bytes,
            (&mut bench.work, &mut bench.out),
        )
        .unwrap();
        assert!(told.bytes <= bytes);
        bench.decode(told.bytes).unwrap();
        let found = psnr(&bench.back, &heights);
        println!(
            "Jacksboro {bytes}: {found:.2} dB with {} bytes, largest error {:.1} m",
            told.bytes, told.max_error
        );
        assert!(found > jpeg + 1.0, "{found}");
    }
}

#[test]
fn small_maps_of_the_firmware() {
    for side in [1, 2, 3, 8, 9, 65] {
        let heights = crop(100, 100, side);
        let mut bench = Bench::new(square(side));
        let told = bench.encode(&heights, square(side), Precision::Within(1.0));
        bench.decode(told.bytes).unwrap();
        println!("{side}²: {} bytes", told.bytes);
        assert!(difference(&bench.back, &heights) <= 1.0);
    }
}

#[test]
fn bad_input_is_refused() {
    let mut work = [0; 16];
    let mut out = [0; 300];
    let mut run = |z: &[f32], shape, precision| encode(z, shape, precision, (&mut work, &mut out));
    let flat = [1.0; 16];
    assert!(run(&flat, Shape::new(0, 4), Precision::Within(1.0)).is_err());
    assert!(run(&flat, Shape::new(5, 4), Precision::Within(1.0)).is_err());
    for bad in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(run(&flat, square(4), Precision::Within(bad)).is_err());
    }
    let mut holes = flat;
    holes[5] = f32::INFINITY;
    assert_eq!(
        run(&holes, square(4), Precision::Within(1.0)),
        Err(CodecError::Infinite(5))
    );
    holes[5] = 1e9;
    assert_eq!(
        run(&holes, square(4), Precision::Within(0.001)),
        Err(CodecError::TooFine(0.001))
    );
    let told = run(&[f32::NAN; 16], square(4), Precision::Within(1.0)).unwrap();
    assert_eq!(told.bytes, 29);
    let mut back = [0.0; 16];
    decode(&out[..29], (&mut work, &mut back)).unwrap();
    assert!(back.iter().all(|z| z.is_nan()));
    let mut run = |z: &[f32], shape, precision| encode(z, shape, precision, (&mut work, &mut out));
    let told = run(&flat, square(4), Precision::Within(1.0)).unwrap();
    decode(&out[..told.bytes], (&mut work, &mut back)).unwrap();
    assert_eq!(back, flat);
    assert_eq!(
        encode(
            &flat,
            square(4),
            Precision::Within(1.0),
            (&mut work, &mut [0; 29])
        ),
        Err(CodecError::Full)
    );
    assert_eq!(
        encode_to_size(&flat, square(4), 10, (&mut work, &mut out)),
        Err(CodecError::Unreachable(10))
    );
}
