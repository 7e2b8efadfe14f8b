use super::*;
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;
use std::{vec, vec::Vec};

/// The energy, written out.
fn energy(layers: &[Vec<f64>], side: usize, data: &[Option<Datum>], prior: &Prior) -> f64 {
    let mut sum = 0.0;
    for (l, v) in layers.iter().enumerate() {
        let n = edge(side, l);
        let (w1, w2) = prior.of(l);
        let (w1, w2) = (f64::from(w1), f64::from(w2));
        let at = |y: usize, x: usize| v[y * n + x];
        for y in 0..n {
            for x in 0..n {
                if x + 1 < n {
                    sum += 0.5
                        * w1
                        * ((at(y, x + 1) - at(y, x)).powi(2) + (at(x + 1, y) - at(x, y)).powi(2));
                }
                if x + 2 < n {
                    let bend = |a: f64, b: f64, c: f64| (a - 2.0 * b + c).powi(2);
                    sum += 0.5 * w2 * bend(at(y, x), at(y, x + 1), at(y, x + 2));
                    sum += 0.5 * w2 * bend(at(x, y), at(x + 1, y), at(x + 2, y));
                }
                if x + 1 < n && y + 1 < n {
                    sum += w2 * (at(y, x) - at(y + 1, x) - at(y, x + 1) + at(y + 1, x + 1)).powi(2);
                }
            }
        }
    }
    for (i, d) in data.iter().enumerate() {
        if let Some(d) = d {
            let mut u = 0.0;
            for (l, v) in layers.iter().enumerate() {
                let v: Vec<f32> = v.iter().map(|&v| v as f32).collect();
                u += f64::from(bilinear(&v, edge(side, l), 1 << l, (i / side, i % side)));
            }
            sum += 0.5 * (f64::from(d.height) - u).powi(2) / f64::from(d.variance);
        }
    }
    sum
}

fn data(side: usize) -> Vec<Option<Datum>> {
    let mut rng = Xoshiro128PlusPlus::seed_from_u64(4);
    (0..side * side)
        .map(|i| {
            (i % 5 == 0).then(|| Datum {
                height: normal(&mut rng),
                variance: 0.1,
            })
        })
        .collect()
}

#[test]
fn relaxation_finds_the_minimum() {
    let side = 9;
    let data = data(side);
    let prior = Prior::empirical(2.4, 0.3);
    let mut memory = vec![0.0; Ak96::need(side).unwrap()];
    let mut state = Ak96::new(side, &mut memory).unwrap();
    state.observe(|i| data[i], 0.0);
    for _ in 0..2000 {
        state.relax(&prior);
    }
    let centred: Vec<_> = data
        .iter()
        .map(|d| {
            d.map(|d| Datum {
                height: d.height - state.offset,
                ..d
            })
        })
        .collect();
    let layers: Vec<Vec<f64>> = (0..state.layers)
        .map(|l| {
            let at = start(side, l);
            let nodes = &state.nodes[at..at + edge(side, l).pow(2)];
            nodes.iter().map(|&v| f64::from(v)).collect()
        })
        .collect();
    let best = energy(&layers, side, &centred, &prior);
    for l in 0..layers.len() {
        for i in 0..layers[l].len() {
            for step in [-0.02, 0.02] {
                let mut moved = layers.clone();
                moved[l][i] += step;
                let there = energy(&moved, side, &centred, &prior);
                assert!(
                    there > best - 1e-5 * best,
                    "layer {l} node {i}: {there} < {best}"
                );
            }
        }
    }
}

#[test]
fn errors_are_kept_up_to_date() {
    let side = 17;
    let data = data(side);
    let mut memory = vec![0.0; Ak96::need(side).unwrap()];
    let mut state = Ak96::new(side, &mut memory).unwrap();
    let used = state.observe(|i| data[i], 0.0);
    assert_eq!(used, data.iter().flatten().count());
    let mut rng = Xoshiro128PlusPlus::seed_from_u64(9);
    let prior = Prior::from_dimension(2.5, 0.5);
    for _ in 0..10 {
        state.sample(&prior, &mut rng);
    }
    let mut surface = vec![0.0; side * side];
    state.surface(&mut surface);
    for (i, d) in data.iter().enumerate() {
        if let Some(d) = d {
            assert!((d.height - surface[i] - state.error[i]).abs() < 1e-4);
        }
    }
}

#[test]
fn sampling_has_the_conditional_variance() {
    // one datum of unit variance, a prior that hardly binds: u − d is standard normal
    let mut memory = vec![0.0; Ak96::need(5).unwrap()];
    let mut state = Ak96::new(5, &mut memory).unwrap();
    let datum = Datum {
        height: 3.0,
        variance: 1.0,
    };
    state.observe(|i| (i == 12).then_some(datum), 0.0);
    let prior = Prior::from_dimension(2.5, 1e3);
    let mut rng = Xoshiro128PlusPlus::seed_from_u64(2);
    let (mut sum, mut squares, mut out) = (0.0, 0.0, vec![0.0; 25]);
    let count = 20_000;
    for _ in 0..count {
        state.sample(&prior, &mut rng);
        state.surface(&mut out);
        let z = f64::from(out[12] - 3.0);
        sum += z / f64::from(count);
        squares += z * z / f64::from(count);
    }
    assert!(
        sum.abs() < 0.15 && (squares - 1.0).abs() < 0.15,
        "{sum} {squares}"
    );
}

#[test]
fn bad_input_has_a_defined_answer() {
    assert_eq!(Ak96::need(64), Err(Error::Side(64)));
    let mut memory = vec![0.0; Ak96::need(17).unwrap()];
    assert!(Ak96::new(17, &mut memory[1..]).is_err());
    let mut state = Ak96::new(17, &mut memory).unwrap();
    let nan = Datum {
        height: f32::NAN,
        variance: 1.0,
    };
    assert_eq!(state.observe(|_| Some(nan), 0.0), 0);
    let prior = Prior::empirical(2.5, 1.0);
    state.relax(&prior);
    let mut out = vec![0.0; 17 * 17];
    state.surface(&mut out);
    assert!(out.iter().all(|&z| z == 0.0));
}
