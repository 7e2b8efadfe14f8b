//! One layer as a PNG with title, legend and scale bar.

use crate::draw::{self, Palette};
use crate::error::Result;
use crate::io::Raster;
use crate::layers::Layer;
use std::path::Path;

/// Draws the layer in the way that suits its meaning.
pub fn write(path: &Path, layer: &Layer, raster: &Raster) -> Result<()> {
    draw::maps(&[panel(layer, raster)])?.save(path)
}

/// How a layer is drawn, by its name.
pub fn panel<'a>(layer: &'a Layer, raster: &'a Raster) -> draw::Layer<'a> {
    let title = title(layer);
    match layer.name.as_str() {
        "elevation" | "mean" | "realisation" | "sample" | "lowest" | "highest" | "upper_bound"
        | "lower_bound" => draw::Layer::elevation(title, raster),
        "dimension" => draw::Layer::dimension(title, raster),
        "hurst" | "traversability" | "inferred" => draw::Layer {
            range: Some((0.0, 1.0)),
            palette: Palette::Cividis,
            ..draw::Layer::magnitude(title, &layer.unit, raster)
        },
        _ => draw::Layer::magnitude(title, &layer.unit, raster),
    }
}

fn title(layer: &Layer) -> &str {
    match layer.name.as_str() {
        "elevation" => "Elevation",
        "slope" => "Slope",
        "step" => "Step",
        "traversability" => "Traversability: 1 free, 0 impassable",
        "mean" => "Reconstruction: mean",
        "realisation" => "Reconstruction: realisation",
        "standard_deviation" => "Standard deviation of the reconstruction",
        "dimension" => "Fractal dimension D",
        "hurst" => "Hurst exponent H",
        "sigma" => "Roughness σ (1 m)",
        "dimension_error" => "Standard error of D",
        "pairs" => "Pairs behind the estimate",
        "count" => "Returns",
        other => other,
    }
}
