//! Hillshade: how bright a sloping cell is under a light from the north-west.

use crate::io::Raster;

/// Direction to the light: north-west, 45° up (x east, y north, z up).
const LIGHT: [f64; 3] = [-0.5, 0.5, std::f64::consts::FRAC_1_SQRT_2];
/// Brightness of a face turned away.
const AMBIENT: f64 = 0.35;

/// Brightness in 0 … 1 of every cell of `elevation`, from central differences (one-sided
/// beside unknown cells and at the border). Flat ground has 0.81.
pub fn hillshade(elevation: &Raster) -> Vec<f64> {
    let cells = 0..elevation.values.len();
    let at = |i: usize| (i / elevation.columns, i % elevation.columns);
    cells
        .map(|i| brightness(gradient(elevation, at(i))))
        .collect()
}

fn brightness([gx, gy]: [f64; 2]) -> f64 {
    let length = (1.0 + gx * gx + gy * gy).sqrt();
    let cosine = (-gx * LIGHT[0] - gy * LIGHT[1] + LIGHT[2]) / length;
    AMBIENT + (1.0 - AMBIENT) * cosine.max(0.0)
}

fn gradient(raster: &Raster, (row, column): (usize, usize)) -> [f64; 2] {
    let here = raster.at(row, column);
    let along_x = |j: usize| raster.at(row, j);
    let along_y = |i: usize| raster.at(i, column);
    let gx = slope(along_x, column, raster.columns, here);
    let gy = slope(along_y, row, raster.rows, here);
    [gx / raster.spacing_x, gy / raster.spacing_y]
}

/// Rise per cell at `i` of `count`, from the known neighbours; 0 without any.
fn slope(at: impl Fn(usize) -> f32, i: usize, count: usize, here: f32) -> f64 {
    let known = |j: usize| Some(f64::from(at(j))).filter(|v| v.is_finite());
    let before = if i > 0 { known(i - 1) } else { None };
    let after = if i + 1 < count { known(i + 1) } else { None };
    let here = f64::from(here);
    match (before, after) {
        (Some(a), Some(b)) => (b - a) / 2.0,
        (Some(a), None) => here - a,
        (None, Some(b)) => b - here,
        (None, None) => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tilted(gx: f32, gy: f32) -> Raster {
        let values = (0..25)
            .map(|i| gx * (i % 5) as f32 + gy * (i / 5) as f32)
            .collect();
        Raster::square(5, 5, 1.0, [0.0, 0.0], values)
    }

    #[test]
    fn faces_towards_the_north_west_are_bright() {
        let of = |gx, gy| hillshade(&tilted(gx, gy));
        let flat = of(0.0, 0.0)[12];
        // rising to the east = facing west; rising to the south = facing north
        assert!(of(0.5, 0.0).iter().all(|&b| b > flat));
        assert!(of(0.0, -0.5).iter().all(|&b| b > flat));
        assert!(of(-0.5, 0.0).iter().all(|&b| b < flat));
        assert!(of(0.0, 0.5).iter().all(|&b| b < flat));
    }
}
