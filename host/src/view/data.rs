//! The map as the page wants it: layers with colours, structure functions by region,
//! tables.
//!
//! Great maps are thinned: a layer has at most [`MOST_CELLS`] cells along an edge, each the
//! mean of the known ones it stands for. Regions are the 3 × 3 tiles whose pairs a tile's
//! roughness rests on; of great maps every n-th, at most [`MOST_REGIONS`] along an edge.

use crate::bridge::Summary;
use crate::config::decimal;
use crate::export::picture::panel;
use crate::io::Raster;
use crate::layers::{Layer, Layers};
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use rugosa::{Mapper, PARAMETERS};
use rugosa_fractal::roughness::{Moment, Pool, Reason, Roughness};
use rugosa_grid::{TILE, Tile, Tiles};
use serde::Serialize;

/// Most cells of a layer along an edge.
pub const MOST_CELLS: usize = 384;
/// Most regions along an edge.
const MOST_REGIONS: i32 = 40;
/// Layers that are shown, where they are there.
const SHOWN: [&str; 10] = [
    "elevation",
    "dimension",
    "sigma",
    "traversability",
    "slope",
    "step",
    "dimension_error",
    "mean",
    "realisation",
    "standard_deviation",
];
/// Colours of a scale.
const STOPS: u32 = 16;

/// What took how long \[s\].
pub type Timings = Vec<(String, f64)>;

/// Everything on the page.
#[derive(Serialize)]
pub struct Data {
    title: String,
    summary: String,
    rows: usize,
    columns: usize,
    /// edge of a shown cell \[m\]
    cell: f64,
    corner: [f64; 2],
    layers: Vec<Shown>,
    whole: Curve,
    regions: Vec<Region>,
    counters: Vec<(&'static str, u32)>,
    parameters: Vec<(&'static str, f64, String)>,
    timings: Timings,
}

#[derive(Serialize)]
struct Shown {
    name: String,
    title: String,
    unit: String,
    range: (f64, f64),
    colours: Vec<(f64, String)>,
    /// float32, little-endian, base64
    values: String,
}

/// A structure function and the power law in it.
#[derive(Serialize)]
struct Curve {
    /// distance, rms difference as measured, the same with noise and tilt taken off \[m\];
    /// 0 where nothing is left
    lags: Vec<[f32; 3]>,
    law: Option<Law>,
    reason: Option<String>,
}

#[derive(Serialize)]
struct Law {
    hurst: f32,
    sigma: f32,
    error: f32,
    from: f32,
    to: f32,
}

#[derive(Serialize)]
struct Region {
    /// a click in here selects it: x0, y0, x1, y1 \[m\]
    #[serde(rename = "box")]
    area: [f64; 4],
    /// where its pairs come from
    reach: [f64; 4],
    #[serde(flatten)]
    curve: Curve,
}

impl Data {
    /// Of a map as it is now, or of a part of its layers.
    pub fn of(
        title: &str,
        mapper: &Mapper,
        layers: &Layers,
        summary: &Summary,
        timings: Timings,
    ) -> Self {
        let step = layers.rows.max(layers.columns).div_ceil(MOST_CELLS).max(1);
        let shown = SHOWN.iter().filter_map(|name| layers.get(name));
        let whole = summary.roughness.unwrap_or(Err(Reason::TooFewPairs));
        Data {
            title: title.into(),
            summary: summary.to_string(),
            rows: layers.rows.div_ceil(step),
            columns: layers.columns.div_ceil(step),
            cell: layers.resolution * step as f64,
            corner: layers.corner,
            layers: shown
                .map(|layer| shown_layer(layers, layer, step))
                .collect(),
            whole: Curve::of(mapper, &mapper.pool(), &whole),
            regions: regions(mapper, layers),
            counters: summary.counters.iter().map(|(&n, &v)| (n, v)).collect(),
            parameters: parameters(mapper),
            timings,
        }
    }
}

fn parameters(mapper: &Mapper) -> Vec<(&'static str, f64, String)> {
    let line = |p: &rugosa::config::Parameter| {
        let value = decimal(p.get(mapper.config()));
        (
            p.name,
            value,
            format!("{} {}", p.unit, p.help).trim().to_owned(),
        )
    };
    PARAMETERS.iter().map(line).collect()
}

fn shown_layer(layers: &Layers, layer: &Layer, step: usize) -> Shown {
    let raster = layers.raster(layer);
    let panel = panel(layer, &raster);
    let range = panel.ends();
    let stop = |i: u32| {
        let t = f64::from(i) / f64::from(STOPS);
        let [r, g, b] = panel.palette.colour(t);
        (t, format!("rgb({r},{g},{b})"))
    };
    let values: Vec<u8> = thinned(&raster, step)
        .into_iter()
        .flat_map(f32::to_le_bytes)
        .collect();
    Shown {
        name: layer.name.clone(),
        title: panel.title.into(),
        unit: layer.unit.clone(),
        range,
        colours: (0..=STOPS).map(stop).collect(),
        values: BASE64_STANDARD.encode(values),
    }
}

/// Means of the known values of `step × step` cells.
fn thinned(raster: &Raster, step: usize) -> Vec<f32> {
    let mut thin = Vec::new();
    for row in (0..raster.rows).step_by(step) {
        for column in (0..raster.columns).step_by(step) {
            let (mut sum, mut count) = (0.0, 0.0);
            for i in row..(row + step).min(raster.rows) {
                for j in column..(column + step).min(raster.columns) {
                    let value = f64::from(raster.at(i, j));
                    if value.is_finite() {
                        (sum, count) = (sum + value, count + 1.0);
                    }
                }
            }
            thin.push((sum / count) as f32);
        }
    }
    thin
}

/// The regions of which anything is known.
fn regions(mapper: &Mapper, layers: &Layers) -> Vec<Region> {
    let window = mapper.window();
    let tiles = Tiles::of(window);
    let per_side = Tiles::per_side(window.side()) as i32;
    let stride = (per_side + MOST_REGIONS - 1) / MOST_REGIONS;
    let edge =
        |tile: i32, axis: usize| layers.shift[axis] + f64::from(tile * TILE) * layers.resolution;
    let area = |tile: Tile, low: i32, high: i32| {
        let corner = |by: i32| [edge(tile.x + by, 0), edge(tile.y + by, 1)];
        let ([x0, y0], [x1, y1]) = (corner(low), corner(high));
        [x0, y0, x1, y1]
    };
    let every = |t: &Tile| t.x.rem_euclid(stride) == 0 && t.y.rem_euclid(stride) == 0;
    let mut regions = Vec::new();
    for tile in tiles.tiles().filter(every) {
        let pool = mapper.pool_around(tile);
        let Some(ground) = mapper.tile(tile).filter(|_| pool.pairs() > 0) else {
            continue;
        };
        let half = stride / 2;
        regions.push(Region {
            area: area(tile, -half, stride - half),
            reach: area(tile, -1, 2),
            curve: Curve::of(mapper, &pool, &ground.estimate),
        });
    }
    regions
}

impl Curve {
    fn of(mapper: &Mapper, pool: &Pool, roughness: &Result<Roughness, Reason>) -> Self {
        let config = mapper.config();
        let detrended = roughness.is_ok_and(|r| r.detrended);
        let moments = pool.moments(config.resolution, config.height_step());
        let root = |square: f32| square.max(0.0).sqrt();
        let lag = |m: &Moment| {
            let trend = if detrended { m.trend } else { 0.0 };
            let left = root(m.mean_square - m.noise - trend);
            [m.distance(), root(m.mean_square), left]
        };
        let used = moments
            .iter()
            .filter(|m| m.pairs as f32 >= config.min_pairs);
        Curve {
            lags: used.map(lag).collect(),
            law: roughness.ok().map(|r| Law {
                hurst: r.hurst,
                sigma: r.sigma,
                error: r.standard_error,
                from: r.range[0],
                to: r.range[1],
            }),
            reason: roughness.err().map(|r| format!("{r:?}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_takes_the_mean_of_what_is_known() {
        let nan = f32::NAN;
        let values = vec![1.0, 3.0, nan, nan, nan, 5.0, nan, nan, 7.0];
        let raster = Raster::square(3, 3, 1.0, [0.0; 2], values);
        let thin = thinned(&raster, 2);
        assert_eq!((thin[0], thin[1], thin[3]), (2.0, 5.0, 7.0));
        assert!(thin[2].is_nan());
    }
}
