//! Standard normal numbers, the same bits on every platform.
//!
//! The ziggurat of Marsaglia & Tsang (2000) in the form of Doornik (2005, "An improved
//! ziggurat method", ZIGNOR): 128 layers of equal area v under f(x) = exp(−x²/2), edges
//! x_1 = r, f(x_{i+1}) = f(x_i) + v / x_i, x_0 = v / f(r). A point of layer i with
//! |u| < x_{i+1} / x_i is accepted at once, else the wedge or the tail decides.
//!
//! Cost: in 98.8 % of the cases one 32-bit number, one table look-up, one comparison and
//! one multiplication; otherwise two exponentials. Accuracy: `moments_and_tails` below.
//!
//! Not a library's: those sample in double precision and call the platform's `ln` and
//! `exp`, so their bits differ between platforms. The table comes from the formula
//! above (build.rs).

use rand_core::Rng;
use rugosa_grid::math;

include!(concat!(env!("OUT_DIR"), "/ziggurat.rs"));

/// A uniform number in (0, 1), a multiple of 2⁻²⁴ plus 2⁻²⁵.
///
/// ```
/// use rand_core::SeedableRng;
/// use rugosa_fractal::synthesis::uniform;
/// let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(1);
/// let numbers: Vec<f32> = (0..10_000).map(|_| uniform(&mut rng)).collect();
/// assert!(numbers.iter().all(|&x| x > 0.0 && x < 1.0));
/// assert!((numbers.iter().sum::<f32>() / 10_000.0 - 0.5).abs() < 0.01);
/// ```
#[inline]
pub fn uniform(rng: &mut impl Rng) -> f32 {
    ((rng.next_u32() >> 9) as f32 + 0.5) * (1.0 / 8_388_608.0)
}

/// A standard normal number.
///
/// ```
/// use rand_core::SeedableRng;
/// use rugosa_fractal::synthesis::normal;
/// let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(1);
/// let numbers: Vec<f32> = (0..10_000).map(|_| normal(&mut rng)).collect();
/// let mean = numbers.iter().sum::<f32>() / 10_000.0;
/// let square = numbers.iter().map(|x| x * x).sum::<f32>() / 10_000.0;
/// assert!(mean.abs() < 0.03 && (square - 1.0).abs() < 0.05);
/// ```
#[inline]
pub fn normal(rng: &mut impl Rng) -> f32 {
    loop {
        let bits = rng.next_u32();
        let layer = (bits & 127) as usize;
        // 25 bits with a sign, centred: (−1, 1)
        let u = (((bits as i32) >> 7) as f32 + 0.5) * (1.0 / 16_777_216.0);
        let x = u * EDGE[layer];
        if math::abs(x) < EDGE[layer + 1] {
            return x;
        }
        if let Some(x) = beyond(layer, x, rng) {
            return x;
        }
    }
}

/// What the fast test leaves: the tail under layer 0, the wedge of the others.
#[cold]
fn beyond(layer: usize, x: f32, rng: &mut impl Rng) -> Option<f32> {
    if layer == 0 {
        return Some(if x < 0.0 { -tail(rng) } else { tail(rng) });
    }
    let above = |edge: f32| math::exp(-0.5 * (edge * edge - x * x));
    let (low, high) = (above(EDGE[layer]), above(EDGE[layer + 1]));
    (high + uniform(rng) * (low - high) < 1.0).then_some(x)
}

/// A normal number beyond the last edge r (Marsaglia 1964).
fn tail(rng: &mut impl Rng) -> f32 {
    let edge = EDGE[1];
    loop {
        let x = -math::ln(uniform(rng)) / edge;
        if -2.0 * math::ln(uniform(rng)) > x * x {
            return edge + x;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::SeedableRng;
    use rand_xoshiro::Xoshiro128PlusPlus;

    #[test]
    fn moments_and_tails() {
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(1);
        let count = 2_000_000;
        let mut moment = [0f64; 5];
        let mut beyond = [0u32; 5];
        for _ in 0..count {
            let x = f64::from(normal(&mut rng));
            for (p, m) in moment.iter_mut().enumerate() {
                *m += x.powi(p as i32) / f64::from(count);
            }
            for (k, b) in beyond.iter_mut().enumerate() {
                *b += u32::from(x > k as f64);
            }
        }
        let four_deviations = 4.0 / f64::from(count).sqrt();
        for (p, (expected, spread)) in [(1.0, 0.0), (0.0, 1.0), (1.0, 1.42), (0.0, 3.9), (3.0, 9.8)]
            .into_iter()
            .enumerate()
        {
            let allowed = four_deviations * spread + 1e-9;
            assert!(
                (moment[p] - expected).abs() < allowed,
                "moment {p}: {}",
                moment[p]
            );
        }
        let q = [
            0.5,
            0.158_655_254,
            0.022_750_132,
            0.001_349_898,
            3.167_124e-5,
        ];
        for (k, q) in q.into_iter().enumerate() {
            let expected = q * f64::from(count);
            let error = (f64::from(beyond[k]) - expected).abs();
            assert!(
                error < 4.0 * expected.sqrt(),
                "P(x > {k}): {} of {expected}",
                beyond[k]
            );
        }
    }

    #[test]
    fn the_edges_close_at_zero() {
        assert!((EDGE[1] - 3.442_62).abs() < 1e-5);
        assert_eq!(EDGE[128], 0.0);
        assert!(EDGE.windows(2).all(|w| w[0] > w[1]));
    }

    #[test]
    fn the_same_bits_for_ever() {
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(42);
        let mut sum = 0u32;
        for _ in 0..100_000 {
            sum = sum.rotate_left(5) ^ normal(&mut rng).to_bits();
        }
        assert_eq!(sum, 0x1601_a732, "{sum:#x}");
    }
}
