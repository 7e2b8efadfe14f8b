//! Seeded random numbers: xoshiro256++, the normals of [`rugosa_fractal::synthesis`].

use rand_core::{Rng, SeedableRng};
use rand_xoshiro::{SplitMix64, Xoshiro256PlusPlus};
use rugosa_fractal::synthesis::normal;

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub struct Random(Xoshiro256PlusPlus);

impl Random {
    /// The stream of a seed.
    pub fn new(seed: u64) -> Self {
        Random(Xoshiro256PlusPlus::seed_from_u64(seed))
    }

    /// The stream of one part of a larger whole, e.g. of one line of one sweep: the same
    /// whatever was drawn for the other parts.
    pub fn part(seed: u64, a: u64, b: u64) -> Self {
        Random::new(key(seed, a, b))
    }

    /// Uniform in \[0, 1).
    pub fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (0.5f64).powi(53)
    }

    /// Normal with mean 0 and variance 1.
    pub fn normal(&mut self) -> f64 {
        f64::from(normal(&mut self.0))
    }

    /// True with the given probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        probability > 0.0 && self.uniform() < probability
    }

    /// Uniform 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }
}

/// Uniform in \[0, 1), belonging to a place on a lattice.
pub fn noise_at(i: i64, j: i64, seed: u64) -> f64 {
    let bits = SplitMix64::seed_from_u64(key(seed, i as u64, j as u64)).next_u64();
    (bits >> 11) as f64 * (0.5f64).powi(53)
}

/// Odd multipliers keep (a, b) apart; what is seeded with the key mixes the bits.
fn key(seed: u64, a: u64, b: u64) -> u64 {
    let key = a.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ b.wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
    seed ^ key.rotate_left(17)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lattice_noise_is_uniform_and_neighbours_are_independent() {
        let (mut mean, mut square, mut product) = (0.0, 0.0, 0.0);
        for i in 0..10_000 {
            let (x, y) = (i % 100 - 50, i / 100 - 50);
            let value = noise_at(x, y, 3) - 0.5;
            mean += value;
            square += value * value;
            product +=
                value * (noise_at(x + 1, y, 3) - 0.5) + value * (noise_at(x, y + 1, 3) - 0.5);
        }
        // standard deviations: 0.0029, 0.00075, 0.0012
        assert!((mean / 1e4f64).abs() < 0.012, "{mean}");
        assert!((square / 1e4 - 1.0 / 12.0f64).abs() < 0.003, "{square}");
        assert!((product / 1e4f64).abs() < 0.005, "{product}");
    }
}
