//! Colour maps (perceptually uniform) and what unknown cells look like.

use plotters::style::RGBColor;

/// Which colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Palette {
    /// dark blue to yellow: elevation
    Viridis,
    /// dark blue to yellow, the same for all eyes: dimension
    Cividis,
    /// black to white through purple and orange: roughness, standard deviation
    Magma,
}

/// Background of unknown cells.
const UNKNOWN: [u8; 3] = [225, 225, 225];
/// Lines across unknown cells.
const HATCH: [u8; 3] = [196, 196, 196];

impl Palette {
    /// Colour of `t` in 0 … 1; values outside take the nearest end.
    pub fn colour(self, t: f64) -> [u8; 3] {
        let t = t.clamp(0.0, 1.0);
        let c = match self {
            Palette::Viridis => colorous::VIRIDIS.eval_continuous(t),
            Palette::Cividis => colorous::CIVIDIS.eval_continuous(t),
            Palette::Magma => colorous::MAGMA.eval_continuous(t),
        };
        [c.r, c.g, c.b]
    }
}

/// Colour of an unknown cell at a pixel: grey, hatched, unlike any colour of a palette.
pub fn unknown(x: u32, y: u32) -> [u8; 3] {
    if (x + y) % 8 < 2 { HATCH } else { UNKNOWN }
}

/// Colours of the curves of a plot (Okabe and Ito 2008, distinguishable for all eyes).
pub const CURVES: [RGBColor; 4] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brightness_grows_along_every_palette() {
        let luma = |c: [u8; 3]| {
            0.2126 * f64::from(c[0]) + 0.7152 * f64::from(c[1]) + 0.0722 * f64::from(c[2])
        };
        for palette in [Palette::Viridis, Palette::Cividis, Palette::Magma] {
            let lumas: Vec<f64> = (0..=16)
                .map(|i| luma(palette.colour(f64::from(i) / 16.0)))
                .collect();
            assert!(
                lumas.windows(2).all(|w| w[1] > w[0]),
                "{palette:?} {lumas:?}"
            );
        }
    }
}
