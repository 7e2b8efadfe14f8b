//! The chances of all decisions, and how a magnitude is told with them.
//!
//! 16 × the expected magnitude selects a class. A magnitude m is told as m >> shift (shift
//! is 0 but where values are large) and the low bits: "is it zero?", then the length in bits
//! of the excess over one, bit by bit, the bit below the leading one, and what is left,
//! with the sign, at one bit each.

use super::range::{Chance, Coder};

/// Classes of the expected magnitude.
const CLASSES: usize = 16;

/// Longest excess \[bits\].
const LONGEST: u32 = 25;

/// First guesses, in 65536ths, from fBm of H 0.5 … 0.8 and the DEM: a coefficient of this
/// class is not zero.
const NOT_ZERO: [u16; CLASSES] = [
    3276, 2621, 7208, 3276, 13107, 5898, 19660, 9830, 22937, 31457, 39321, 48496, 53739, 57016,
    60293, 61603,
];

/// First guesses: yet another bit, by class and bits so far.
const LONGER: [[u16; 6]; CLASSES] = {
    let first = [6, 6, 6, 6, 8, 8, 8, 9, 13, 19, 28, 40, 55, 68, 78, 84];
    let second = [
        10, 10, 10, 10, 10, 10, 10, 10, 10, 11, 13, 15, 24, 35, 55, 65,
    ];
    let third = [8, 8, 8, 8, 8, 8, 8, 8, 8, 8, 8, 8, 12, 20, 35, 44];
    let mut table = [[0; 6]; CLASSES];
    let mut class = 0;
    while class < CLASSES {
        let percent = [first[class], second[class], third[class], 20, 33, 40];
        let mut i = 0;
        while i < 6 {
            table[class][i] = (percent[i] as u32 * 655) as u16;
            i += 1;
        }
        class += 1;
    }
    table[0] = [10_000, 40_000, 50_000, 55_000, 55_000, 45_000];
    table
};

/// The chances of all decisions.
pub(super) struct Chances {
    pub not_zero: [Chance; CLASSES],
    longer: [[Chance; 6]; CLASSES],
    second_bit: [Chance; 6],
    pub band: Chance,
    pub square: [Chance; 8],
    pub unknown: [Chance; 16],
}

impl Chances {
    pub fn new() -> Self {
        Chances {
            not_zero: NOT_ZERO.map(Chance::new),
            longer: LONGER.map(|l| l.map(Chance::new)),
            second_bit: [21_000, 21_500, 18_000, 16_000, 20_000, 24_000].map(Chance::new),
            band: Chance::new(50_000),
            square: [
                2_000, 12_000, 12_000, 40_000, 25_000, 50_000, 50_000, 63_000,
            ]
            .map(Chance::new),
            unknown: [Chance::new(8_000); 16],
        }
    }

    /// Tells a coefficient of this class; returns it. A decoder's `value` is 0.
    #[inline(always)]
    pub fn code<C: Coder>(
        &mut self,
        coder: &mut C,
        (class, shift): (usize, u32),
        value: i32,
    ) -> i32 {
        let (magnitude, sign) = (value.unsigned_abs(), u32::from(value < 0));
        let high = magnitude >> shift;
        let low = magnitude & ((1 << shift) - 1);
        if coder.bit(&mut self.not_zero[class], high != 0) {
            let high = 1 + self.excess(coder, class, high.wrapping_sub(1));
            let told = coder.raw(low << 1 | sign, shift + 1);
            return signed(high << shift | told >> 1, told & 1);
        }
        let low = if shift > 0 { coder.raw(low, shift) } else { 0 };
        if low == 0 {
            return 0;
        }
        signed(low, coder.raw(sign, 1))
    }

    /// A number ≥ 0 as its length in bits, then its bits (Elias gamma of excess + 1).
    #[inline]
    fn excess<C: Coder>(&mut self, coder: &mut C, class: usize, excess: u32) -> u32 {
        let length = if C::ENCODES { (excess + 1).ilog2() } else { 0 };
        let longer = &mut self.longer[class];
        let mut count = 0;
        while count < LONGEST && coder.bit(&mut longer[(count as usize).min(5)], count < length) {
            count += 1;
        }
        if count == 0 {
            return 0;
        }
        let bits = if C::ENCODES { excess + 1 } else { 0 };
        let second = &mut self.second_bit[(count as usize).min(6) - 1];
        let second = coder.bit(second, bits >> (count - 1) & 1 == 1);
        let rest = match count {
            1 => 0,
            _ => coder.raw(bits & ((1 << (count - 1)) - 1), count - 1),
        };
        (1 << count | u32::from(second) << (count - 1) | rest) - 1
    }
}

/// No coefficient is larger.
const MOST: u32 = (1 << 27) - 1;

fn signed(magnitude: u32, sign: u32) -> i32 {
    let magnitude = (magnitude & MOST) as i32; // larger in damaged data only
    if sign == 1 { -magnitude } else { magnitude }
}

/// (class, low bits that are told raw) for 16 × the expected magnitude.
#[inline]
pub(super) fn class(expected: u32) -> (usize, u32) {
    if expected < 8 {
        return (expected as usize, 0);
    }
    let log = expected.ilog2();
    let half = (expected >> (log - 1) & 1) as usize;
    if log <= 6 {
        (8 + 2 * (log as usize - 3) + half, 0)
    } else {
        (14 + half, (log - 6).min(24))
    }
}
