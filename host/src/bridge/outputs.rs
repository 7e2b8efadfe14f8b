//! Files of a map: layers, pictures, the log–log plot and `summary.json`.

use super::summary::{Summary, Truth};
use crate::config::decimal;
use crate::draw::loglog::PowerLaw;
use crate::draw::{self, Picture, StructurePlot};
use crate::error::{Failure, Result};
use crate::export::picture::panel;
use crate::io::Raster;
use crate::io::atomic;
use crate::io::output::{Output, write_raster};
use crate::layers::{Layer, Layers};
use crate::plan::Planner;
use crate::saved::SavedMap;
use crate::view::{self, Data, Timings};
use rugosa::{LAYERS, Mapper};
use rugosa_fractal::roughness::Moment;
use rugosa_grid::Tiles;
use rugosa_hil_sim::terrain::Terrain;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Layers that are drawn, in the order of the panels.
const DRAWN: [&str; 7] = [
    "elevation",
    "dimension",
    "sigma",
    "traversability",
    "mean",
    "realisation",
    "standard_deviation",
];
/// Layers that stand side by side in `reconstruction.png`, after the original if known.
const RECONSTRUCTED: [&str; 4] = ["elevation", "mean", "realisation", "standard_deviation"];
/// Layers that stand side by side in `maps.png`.
const SIDE_BY_SIDE: usize = 3;

/// Cells around the known part of a map in a picture.
const MARGIN: usize = 8;

/// Where the results of a run go.
pub struct Outputs {
    output: Output,
    extras: Extras,
    /// the ground itself, where a simulation knows it
    pub original: Option<Arc<dyn Terrain>>,
}

/// What is written into a directory on request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Extras {
    /// `report.html`
    pub report: bool,
    /// `plan.png`: the way from the robot to the place that is hardest to reach
    pub plan: bool,
}

/// Radius of the robot for which a way is planned \[m\].
const ROBOT: f32 = 0.25;

impl Outputs {
    /// A directory, or a file whose extension picks what is written: `.json` the
    /// summary, `.npy` or `.asc` the elevation, `.png` the maps.
    pub fn new(path: &Path, extras: Extras) -> Result<Self> {
        let output = Output::of(path);
        output.check(&["json", "npy", "asc", "png"])?;
        if extras.report && matches!(output, Output::File(_)) {
            return Err(Failure::input("--report: --out must be a directory"));
        }
        Ok(Outputs {
            output,
            extras,
            original: None,
        })
    }

    /// Writes them and returns the files.
    pub fn save(&self, mapper: &Mapper, summary: &Summary) -> Result<Vec<PathBuf>> {
        let layers = layers_of(mapper);
        match &self.output {
            Output::File(path) => one(path, &layers, summary),
            Output::Directory(directory) => {
                let mut files = all(directory, mapper, &layers, summary)?;
                let known = known_part(&layers);
                if let Some(picture) = reconstruction(&known, self.original.as_deref())? {
                    files.push(directory.join("reconstruction.png"));
                    picture.save(&directory.join("reconstruction.png"))?;
                }
                if self.extras.report {
                    files.push(directory.join("report.html"));
                    let data = Data::of("Map", mapper, &known, summary, timings(summary));
                    view::report(&directory.join("report.html"), &data)?;
                }
                if self.extras.plan {
                    files.extend(save_plan(directory, mapper, &layers)?);
                }
                Ok(files)
            }
        }
    }
}

fn one(path: &Path, layers: &Layers, summary: &Summary) -> Result<Vec<PathBuf>> {
    match crate::io::extension(path).as_str() {
        "json" => save_json(path, summary)?,
        "png" => draw_maps(layers)?.save(path)?,
        _ => {
            let elevation = layers.get("elevation").expect("every map has elevations");
            write_raster(path, &layers.raster(elevation))?;
        }
    }
    Ok(vec![path.to_owned()])
}

fn all(
    directory: &Path,
    mapper: &Mapper,
    layers: &Layers,
    summary: &Summary,
) -> Result<Vec<PathBuf>> {
    let mut files = save_layers(directory, layers)?;
    let mut put = |name: &str| {
        let path = directory.join(name);
        files.push(path.clone());
        path
    };
    structure_plot(mapper, summary)
        .draw()?
        .save(&put("structure_function.png"))?;
    SavedMap::of(mapper).write(&put("map.rugosa"))?;
    save_json(&put("summary.json"), summary)?;
    Ok(files)
}

/// Original, samples, mean, realisation and standard deviation side by side; `None` where
/// no reconstruction is kept. Heights have the same colours in all panels.
fn reconstruction(known: &Layers, original: Option<&dyn Terrain>) -> Result<Option<Picture>> {
    let named = RECONSTRUCTED.map(|name| known.get(name));
    let layers: Vec<&Layer> = named.into_iter().flatten().collect();
    if layers.len() < RECONSTRUCTED.len() {
        return Ok(None);
    }
    let mut rasters: Vec<(&str, Raster)> = Vec::new();
    if let Some(ground) = original {
        let raster = known.raster(layers[0]);
        let at = |i: usize| {
            let [x, y] = raster.node(i);
            ground.elevation(x, y).map_or(f32::NAN, |z| z as f32)
        };
        let values = (0..raster.values.len()).map(at).collect();
        rasters.push((
            "The ground itself",
            Raster {
                values,
                ..raster.clone()
            },
        ));
    }
    let titles = [
        "What was seen",
        "Mean",
        "A realisation",
        "Standard deviation",
    ];
    for (title, layer) in titles.into_iter().zip(layers) {
        rasters.push((title, known.raster(layer)));
    }
    let (deviation, heights) = rasters.split_last().expect("five or four");
    let all = heights.iter().flat_map(|(_, raster)| &raster.values);
    let finite = all.filter(|z| z.is_finite()).map(|&z| f64::from(z));
    let range = finite.fold((f64::MAX, f64::MIN), |(a, b), z| (a.min(z), b.max(z)));
    let mut panels: Vec<draw::Layer> = heights
        .iter()
        .map(|(title, raster)| draw::Layer {
            range: Some(range),
            ..draw::Layer::elevation(title, raster)
        })
        .collect();
    panels.push(draw::Layer::magnitude(deviation.0, "m", &deviation.1));
    Ok(Some(draw::maps(&panels)?))
}

/// Writes every layer as `.npy`, the usual ones as pictures too, and `maps.png`.
pub fn save_layers(directory: &Path, layers: &Layers) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    let known = known_part(layers);
    for layer in &layers.layers {
        let path = directory.join(format!("{}.npy", layer.name));
        write_raster(&path, &layers.raster(layer))?;
        files.push(path);
    }
    for layer in known
        .layers
        .iter()
        .filter(|l| DRAWN.contains(&l.name.as_str()))
    {
        let path = directory.join(format!("{}.png", layer.name));
        crate::export::picture::write(&path, layer, &known.raster(layer))?;
        files.push(path);
    }
    if layers.get("elevation").is_some() {
        let path = directory.join("maps.png");
        draw_maps(layers)?.save(&path)?;
        files.push(path);
    }
    Ok(files)
}

/// Durations of a run, for the report.
pub fn timings(summary: &Summary) -> Timings {
    let latency = &summary.latency_ms;
    let mut all = vec![
        ("run [s]".to_owned(), summary.seconds),
        (
            "line, beyond the quickest, mean [ms]".into(),
            latency.line.mean,
        ),
        ("line, the same, greatest [ms]".into(), latency.line.max),
        (
            "sweep end to roughness, mean [ms]".into(),
            latency.sweep.mean,
        ),
        (
            "sweep end to roughness, greatest [ms]".into(),
            latency.sweep.max,
        ),
    ];
    let round_trip = latency
        .round_trip
        .map(|ms| ("round trip, mean [ms]".into(), ms));
    all.extend(round_trip);
    all
}

/// The way to the place that is hardest to reach; nothing where there is none.
fn save_plan(directory: &Path, mapper: &Mapper, layers: &Layers) -> Result<Option<PathBuf>> {
    let mut planner = Planner::new(mapper, ROBOT);
    let robot = mapper.last_pose().map(|(_, body)| body.translation.vector);
    let from = robot.and_then(|p| planner.nearest([p.x, p.y]));
    let to = from.and_then(|from| planner.farthest(from));
    let (Some(from), Some(to)) = (from, to) else {
        return Ok(None);
    };
    let Some(plan) = planner.plan(from, to) else {
        return Ok(None);
    };
    let path = directory.join("plan.png");
    draw_way(&known_part(layers), &plan.points)?.save(&path)?;
    Ok(Some(path))
}

/// A way across elevation and traversability.
pub fn draw_way(layers: &Layers, way: &[[f64; 2]]) -> Result<draw::Picture> {
    let drawn = ["elevation", "traversability"].map(|name| layers.get(name));
    let drawn: Vec<_> = drawn.into_iter().flatten().collect();
    let rasters: Vec<_> = drawn.iter().map(|layer| layers.raster(layer)).collect();
    let way: Vec<[f64; 2]> = way
        .iter()
        .map(|p| [p[0] + layers.shift[0], p[1] + layers.shift[1]])
        .collect();
    let pairs = drawn.iter().zip(&rasters);
    let panels: Vec<_> = pairs
        .map(|(layer, raster)| draw::Layer {
            path: &way,
            ..panel(layer, raster)
        })
        .collect();
    draw::maps(&panels)
}

fn save_json(path: &Path, summary: &Summary) -> Result<()> {
    atomic::write(path, |writer| {
        serde_json::to_writer_pretty(&mut *writer, summary)?;
        writeln!(writer)
    })
}

fn draw_maps(layers: &Layers) -> Result<draw::Picture> {
    let layers = &known_part(layers);
    let drawn: Vec<_> = DRAWN[..SIDE_BY_SIDE]
        .iter()
        .filter_map(|name| layers.get(name))
        .collect();
    let rasters: Vec<_> = drawn.iter().map(|layer| layers.raster(layer)).collect();
    let panels: Vec<_> = drawn
        .iter()
        .zip(&rasters)
        .map(|(layer, raster)| panel(layer, raster))
        .collect();
    draw::maps(&panels)
}

/// The part of the map where something is known, and one tile around it.
pub fn known_part(layers: &Layers) -> Layers {
    let known = layers.get("elevation").map_or(&[][..], |l| &l.values);
    let at = |i: usize| (i / layers.columns, i % layers.columns);
    let cells = (0..known.len()).filter(|&i| known[i].is_finite()).map(at);
    let bounds = cells.fold(
        None,
        |bounds: Option<[usize; 4]>, (row, column)| match bounds {
            None => Some([row, row, column, column]),
            Some([a, b, c, d]) => Some([row.min(a), row.max(b), column.min(c), column.max(d)]),
        },
    );
    let Some([bottom, top, left, right]) = bounds else {
        return layers.clone();
    };
    let rows = bottom.saturating_sub(MARGIN)..(top + MARGIN + 1).min(layers.rows);
    let columns = left.saturating_sub(MARGIN)..(right + MARGIN + 1).min(layers.columns);
    layers.part(rows, columns)
}

/// All layers of the map that hold anything.
pub fn layers_of(mapper: &Mapper) -> Layers {
    let window = mapper.window();
    let resolution = decimal(mapper.config().resolution);
    let origin = window.origin();
    let mut layers = Layers {
        rows: window.side(),
        columns: window.side(),
        resolution,
        corner: [
            f64::from(origin.x) * resolution,
            f64::from(origin.y) * resolution,
        ],
        shift: [0.0; 2],
        layers: Vec::new(),
    };
    let mut features = features_of(mapper);
    for d in LAYERS {
        let mut values = vec![f32::NAN; window.len()];
        match FEATURES.iter().position(|&f| f == d.layer) {
            Some(i) => std::mem::swap(&mut values, &mut features[i]),
            None => mapper.fill(d.layer, &mut values),
        }
        if d.name == "elevation" || values.iter().any(|v| v.is_finite()) {
            layers.add(d.name, d.unit, values);
        }
    }
    layers
}

/// Layers that are worked out together.
const FEATURES: [rugosa::Layer; 3] = [
    rugosa::Layer::Slope,
    rugosa::Layer::Step,
    rugosa::Layer::HiddenStep,
];

/// The planes of [`FEATURES`], in one pass over the tiles.
fn features_of(mapper: &Mapper) -> [Vec<f32>; 3] {
    let window = mapper.window();
    let mut planes = [(); 3].map(|()| vec![f32::NAN; window.len()]);
    for tile in Tiles::of(window).tiles() {
        let features = mapper.features_of(tile);
        let rows = features.iter().flatten();
        for (cell, features) in tile.cells().zip(rows) {
            let Some(features) = features.filter(|_| window.contains(cell)) else {
                continue;
            };
            let (x, y) = (cell.x - window.origin().x, cell.y - window.origin().y);
            let place = y as usize * window.side() + x as usize;
            planes[0][place] = features.slope();
            planes[1][place] = features.step;
            planes[2][place] = features.hidden_step();
        }
    }
    planes
}

/// The structure function of the whole map.
pub fn structure_plot(mapper: &Mapper, summary: &Summary) -> StructurePlot {
    let config = mapper.config();
    let moments = mapper
        .pool()
        .moments(config.resolution, config.height_step());
    let detrended = summary.estimate.is_some_and(|e| e.detrended);
    let trend = |m: &Moment| if detrended { m.trend } else { 0.0 };
    let used = || {
        moments
            .iter()
            .filter(|m| m.pairs as f32 >= config.min_pairs)
    };
    let point = |d: f32, square: f32| (f64::from(d), f64::from(square.max(0.0)).sqrt());
    let truth = |t: Truth| PowerLaw {
        hurst: 3.0 - t.dimension,
        sigma: t.sigma,
    };
    StructurePlot {
        title: "Structure function of the map".into(),
        measured: used().map(|m| point(m.distance(), m.mean_square)).collect(),
        corrected: used()
            .map(|m| point(m.distance(), m.mean_square - m.noise - trend(m)))
            .filter(|p| p.1 > 0.0)
            .collect(),
        fit: summary.estimate.map(|e| PowerLaw {
            hurst: e.hurst.into(),
            sigma: e.sigma.into(),
        }),
        scaling_range: summary
            .estimate
            .map(|e| e.scaling_range_m.map(f64::from).into()),
        truth: summary.truth.map(truth),
    }
}
