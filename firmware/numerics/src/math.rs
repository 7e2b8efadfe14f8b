//! The functions of [`rugosa_grid::math`].

use crate::fold::over;
use rugosa_grid::math;

const N: u32 = 3000;

pub fn sqrt() -> u32 {
    over(-1.0, 1e6, N, |fold, x| {
        fold.float(math::sqrt(x));
        fold.float(math::sqrt(x * 1e-40)); // subnormal numbers
    })
}

pub fn circular() -> u32 {
    over(-50.0, 50.0, N, |fold, x| {
        fold.float(math::sin(x));
        fold.float(math::cos(x));
        fold.float(math::tan(x));
    })
}

pub fn arcs() -> u32 {
    over(-1.1, 1.1, N, |fold, x| {
        fold.float(math::asin(x));
        fold.float(math::atan2(x, 0.3 - x * x));
    })
}

pub fn logarithms() -> u32 {
    over(0.0, 1e4, N, |fold, x| {
        fold.float(math::ln(x));
        fold.float(math::log2(1.0 / (1.0 + x)));
    })
}

pub fn exponentials() -> u32 {
    over(-110.0, 90.0, N, |fold, x| {
        fold.float(math::exp(x));
        fold.float(math::exp2(x));
    })
}

pub fn powers() -> u32 {
    over(0.0, 64.0, N, |fold, x| {
        fold.float(math::powf(x, 1.7));
        fold.float(math::powf(x, -0.6));
        fold.float(math::powf(2.0, x - 32.0));
    })
}

pub fn error_function() -> u32 {
    over(-6.0, 12.0, N, |fold, x| fold.float(math::erfc(x)))
}

pub fn rounding() -> u32 {
    over(-3e9, 3e9, N, |fold, x| {
        let small = x * 1e-7;
        fold.word(math::floor_index(x) as u32);
        fold.word(math::floor_index(small) as u32);
        fold.word(math::round_index(small) as u32);
        fold.float(math::floor(small));
        fold.float(math::abs(small));
    })
}
