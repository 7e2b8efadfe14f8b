//! Exact fractional Brownian terrain of a given dimension and roughness.
//!
//! E\[(z(p + h) − z(p))²\] = σ² |h|^{2H} with H = 3 − D and |h| in metres, so σ is the rms
//! elevation difference at 1 m. Nodes are drawn exactly
//! ([`rugosa_fractal::synthesis::exact_fbm`], unit variance at one node's distance) and
//! scaled by σ · spacing^H; between nodes the surface is bilinear, so the power law
//! holds down to the spacing.

use super::{Hit, Raster, Ray, Terrain};
use anyhow::{Result, ensure};
use rugosa_fractal::synthesis::exact_fbm;

/// What to draw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FractalSettings {
    /// nodes along an edge
    pub side: usize,
    /// distance of two nodes \[m\]
    pub spacing: f64,
    /// fractal dimension D, between 2 (smooth) and 3 (rough)
    pub dimension: f64,
    /// rms elevation difference at 1 m \[m\]
    pub sigma: f64,
    /// the same seed gives the same terrain
    pub seed: u64,
}

impl Default for FractalSettings {
    /// Rolling rubble: 20.5 m across at 2 cm, D 2.3, σ 8 cm.
    fn default() -> Self {
        FractalSettings {
            side: 1025,
            spacing: 0.02,
            dimension: 2.3,
            sigma: 0.08,
            seed: 1,
        }
    }
}

/// A fractal terrain, its middle over the origin, its mean elevation 0.
pub struct Fractal {
    raster: Raster,
    settings: FractalSettings,
}

/// Draws a terrain.
pub fn fractal(settings: FractalSettings) -> Result<Fractal> {
    let FractalSettings {
        side,
        spacing,
        dimension,
        sigma,
        seed,
    } = settings;
    ensure!(
        dimension > 2.0 && dimension < 3.0,
        "the dimension is {dimension}, not between 2 and 3"
    );
    ensure!(sigma >= 0.0 && sigma.is_finite(), "sigma is {sigma} m");
    ensure!(side >= 2, "the side is {side} nodes");
    let hurst = 3.0 - dimension;
    let scale = (sigma * spacing.powf(hurst)) as f32;
    let mut nodes = exact_fbm(side, hurst, seed);
    let mean = nodes.iter().map(|&z| f64::from(z)).sum::<f64>() / nodes.len() as f64;
    for z in &mut nodes {
        *z = scale * (*z - mean as f32);
    }
    let raster = Raster::new(nodes, side, spacing, [0.0; 2])?.centred_on(0.0, 0.0);
    Ok(Fractal { raster, settings })
}

impl Fractal {
    /// What was drawn: the truth about dimension and roughness.
    pub fn settings(&self) -> &FractalSettings {
        &self.settings
    }

    /// The nodes.
    pub fn raster(&self) -> &Raster {
        &self.raster
    }
}

impl Terrain for Fractal {
    fn elevation(&self, x: f64, y: f64) -> Option<f64> {
        self.raster.elevation(x, y)
    }

    fn cast(&self, ray: &Ray, reach: f64) -> Option<Hit> {
        self.raster.cast(ray, reach)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_have_the_rms_that_was_asked_for() {
        for (dimension, sigma) in [(2.2, 0.05), (2.5, 0.1), (2.8, 0.2)] {
            let settings = FractalSettings {
                side: 257,
                spacing: 0.05,
                dimension,
                sigma,
                seed: 3,
            };
            let terrain = fractal(settings).unwrap();
            for cells in [1usize, 4, 10] {
                let lag = cells as f64 * 0.05;
                let nodes = terrain.raster().nodes();
                let squares = (0..257 * 257).filter(|i| i % 257 + cells < 257);
                let squares = squares.map(|i| f64::from(nodes[i + cells] - nodes[i]).powi(2));
                let rms = (squares.clone().sum::<f64>() / squares.count() as f64).sqrt();
                let wanted = sigma * lag.powf(3.0 - dimension);
                assert!(
                    (rms / wanted - 1.0).abs() < 0.12,
                    "D {dimension}, {lag} m: {rms} {wanted}"
                );
            }
        }
    }

    #[test]
    fn the_seed_decides() {
        let draw = |seed| {
            let settings = FractalSettings {
                side: 65,
                seed,
                ..Default::default()
            };
            fractal(settings).unwrap().raster().nodes().to_vec()
        };
        assert_eq!(draw(1), draw(1));
        assert_ne!(draw(1), draw(2));
    }
}
