//! The height-field codec: bytes out, heights back.

use crate::fold::Fold;
use rugosa_fractal::codec::{self, Precision};
use rugosa_fractal::surfaces::Shape;

const SIDE: usize = 17;
const NODES: usize = SIDE * SIDE;

/// Rugged ground without any function of the mathematics, with holes.
fn ground() -> [f32; NODES] {
    let mut state = 1u32;
    let mut height = 100.0;
    core::array::from_fn(|i| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        height += ((state >> 24) as f32 - 127.5) * 0.01;
        if i % 23 == 5 { f32::NAN } else { height }
    })
}

fn there_and_back(precision: Precision) -> u32 {
    let (heights, shape) = (ground(), Shape::new(SIDE, SIDE));
    let (mut work, mut bytes, mut back) = ([0; NODES], [0; 5 * NODES], [0.0; NODES]);
    let mut fold = Fold::new();
    let Ok(told) = codec::encode(&heights, shape, precision, (&mut work, &mut bytes)) else {
        return 0;
    };
    let bytes = &bytes[..told.bytes];
    bytes.iter().for_each(|&byte| fold.word(byte.into()));
    if codec::decode(bytes, (&mut work, &mut back)).is_ok() {
        back.iter().for_each(|&z| fold.float(z));
    }
    fold.finish()
}

pub fn exact() -> u32 {
    there_and_back(Precision::Within(0.01))
}

pub fn rounded() -> u32 {
    there_and_back(Precision::Step(0.3))
}

pub fn quick() -> u32 {
    there_and_back(Precision::Quick(0.01))
}
