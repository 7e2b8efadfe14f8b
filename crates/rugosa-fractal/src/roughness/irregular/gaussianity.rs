//! Are elevation differences Gaussian? Chi-square test (Arakawa and Krotkov 1996, § 2.6).
//!
//! The differences at one lag, divided by their standard deviation, are counted in
//! [`CLASSES`] classes of equal probability; χ² = Σ (count − expected)² / expected. For
//! *independent* Gaussian differences χ² has [`CLASSES`] − 2 degrees of freedom (one for
//! the total, one for the estimated deviation; the mean is zero). Differences of one
//! surface are correlated, which makes χ² larger than that: the test is fair if the pairs
//! are disjoint and far apart, so each point takes part in at most one pair.

use super::pairs::Bins;
use alloc::vec;
use alloc::vec::Vec;

/// Classes of equal probability.
pub const CLASSES: usize = 16;

/// 95 % quantile of χ² with [`CLASSES`] − 2 = 14 degrees of freedom.
pub const CRITICAL_95: f64 = 23.685;

/// Upper borders of the classes of a standard normal variable, in its positive half.
const BORDERS: [f64; 7] = [
    0.157_310_684_6,
    0.318_639_363_97,
    0.488_776_411_1,
    0.674_489_750_2,
    0.887_146_559_0,
    1.150_349_380_4,
    1.534_120_544_4,
];

/// Result of the test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChiSquare {
    /// the statistic
    pub chi_square: f64,
    /// disjoint pairs used
    pub pairs: usize,
}

impl ChiSquare {
    /// Is the statistic below its 95 % quantile?
    pub fn is_gaussian(&self) -> bool {
        self.chi_square < CRITICAL_95
    }
}

/// χ² of the differences of disjoint pairs of points at distances in [low, high) \[m\];
/// `None` with fewer than five pairs per class. Cost: all pairs, N².
///
/// ```
/// use rand_core::SeedableRng;
/// use rugosa_fractal::roughness::irregular::gaussianity::chi_square;
/// let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(1);
/// let mut normal = || f64::from(rugosa_fractal::synthesis::normal(&mut rng));
/// // independent Gaussian heights, 1 m apart on a line
/// let points: Vec<_> = (0..1000).map(|i| [f64::from(i), 0.0, normal()]).collect();
/// let test = chi_square(&points, 0.5, 1.5).unwrap();
/// assert_eq!(test.pairs, 500); // disjoint: each point in one pair
/// assert!(test.is_gaussian());
/// assert!(chi_square(&points, 0.1, 0.9).is_none()); // no pair at such a distance
/// ```
pub fn chi_square(points: &[[f64; 3]], low: f64, high: f64) -> Option<ChiSquare> {
    let differences = disjoint_differences(
        points,
        &Bins {
            low,
            width: high - low,
            count: 1,
        },
    );
    of_differences(&differences)
}

/// χ² of independent zero-mean differences.
///
/// ```
/// use rugosa_fractal::roughness::irregular::gaussianity::of_differences;
/// // evenly from −1 to 1 m: the tails of a Gaussian are missing
/// let even: Vec<f64> = (0..1000).map(|i| (f64::from(i) - 499.5) / 500.0).collect();
/// let test = of_differences(&even).unwrap();
/// assert!(test.pairs == 1000 && !test.is_gaussian());
/// assert_eq!(of_differences(&even[..50]), None); // too few
/// ```
pub fn of_differences(differences: &[f64]) -> Option<ChiSquare> {
    let count = differences.len();
    if count < 5 * CLASSES {
        return None;
    }
    let square = differences.iter().map(|d| d * d).sum::<f64>() / count as f64;
    let deviation = libm::sqrt(square);
    let mut counts = [0.0; CLASSES];
    for difference in differences {
        counts[class(difference / deviation)] += 1.0;
    }
    let expected = count as f64 / CLASSES as f64;
    let chi_square = counts
        .iter()
        .map(|c| (c - expected) * (c - expected) / expected)
        .sum();
    Some(ChiSquare {
        chi_square,
        pairs: count,
    })
}

fn class(standard: f64) -> usize {
    let half = BORDERS
        .iter()
        .filter(|&&border| standard.abs() >= border)
        .count();
    if standard < 0.0 {
        CLASSES / 2 - 1 - half
    } else {
        CLASSES / 2 + half
    }
}

fn disjoint_differences(points: &[[f64; 3]], bins: &Bins) -> Vec<f64> {
    let mut free = vec![true; points.len()];
    let mut differences = Vec::new();
    for i in 0..points.len() {
        let partner = |j: &usize| {
            let d = libm::hypot(points[*j][0] - points[i][0], points[*j][1] - points[i][1]);
            free[*j] && bins.of(d).is_some()
        };
        if let Some(j) = free[i]
            .then(|| (i + 1..points.len()).find(partner))
            .flatten()
        {
            (free[i], free[j]) = (false, false);
            differences.push(points[j][2] - points[i][2]);
        }
    }
    differences
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sum of twelve uniforms, or a uniform: Gaussian enough, or not.
    fn draws(gaussian: bool) -> Vec<f64> {
        let mut seed = 17u64;
        let mut uniform = || {
            seed = seed
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        let terms = if gaussian { 12 } else { 1 };
        (0..3000)
            .map(|_| (0..terms).map(|_| uniform()).sum())
            .collect()
    }

    #[test]
    fn tells_gaussian_from_uniform_differences() {
        assert!(of_differences(&draws(true)).unwrap().is_gaussian());
        assert!(!of_differences(&draws(false)).unwrap().is_gaussian());
        assert_eq!(of_differences(&[1.0; 9]), None);
    }

    #[test]
    fn pairs_are_disjoint() {
        let points: Vec<[f64; 3]> = (0..400)
            .map(|i| [f64::from(i % 20), f64::from(i / 20), f64::from(i * i % 7)])
            .collect();
        let result = chi_square(&points, 0.5, 1.5).unwrap();
        assert!(result.pairs > 150 && result.pairs <= 200);
    }
}
