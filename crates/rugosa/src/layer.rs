//! The layers of the map: numbers, names and units.
//!
//! Names follow grid_map where it has one (`elevation`, `variance`, `upper_bound`,
//! `lower_bound`, `slope`, `roughness`, `step`, `traversability`); the others are ours
//! and documented here. The number is the one on the link.

/// One quantity of the map.
///
/// ```
/// use rugosa::{LAYERS, Layer};
/// let layer = Layer::from_name("dimension_error").unwrap();
/// assert_eq!(layer, Layer::DimensionError);
/// assert!(layer.description().per_tile);
/// assert_eq!(Layer::Slope.description().unit, "rad");
/// // the number on the link is the place in the list
/// assert_eq!(Layer::from_number(Layer::Mean as u8), Some(Layer::Mean));
/// assert_eq!(LAYERS[Layer::Mean as usize].name, "mean");
/// assert_eq!(Layer::from_number(200), None);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Layer {
    /// fused elevation of measured cells \[m\]
    Elevation = 0,
    /// variance of the fused elevation \[m²\]
    Variance,
    /// mean plus two standard deviations, of the fused elevation where no reconstruction
    /// is kept \[m\]
    UpperBound,
    /// the same below \[m\]
    LowerBound,
    /// lowest return \[m\]
    Lowest,
    /// highest return \[m\]
    Highest,
    /// number of fused returns
    Count,
    /// sweeps since the last return
    Age,
    /// 0 unknown, 1 measured, 2 seen through
    State,
    /// elevation of the point sample the statistics use \[m\]
    Sample,
    /// fractal dimension D
    Dimension,
    /// Hurst exponent H
    Hurst,
    /// standard deviation of an elevation difference at 1 m \[m\]
    Sigma,
    /// standard error of D
    DimensionError,
    /// shortest lag of the scaling range \[m\]
    RangeFrom,
    /// longest lag of the scaling range \[m\]
    RangeTo,
    /// residual of the log–log fit
    Residual,
    /// pairs behind the estimate
    Pairs,
    /// why there is no dimension, see `rugosa_fractal::roughness::Reason`
    Reason,
    /// posterior mean of the elevation, everywhere \[m\]
    Mean,
    /// how far the mean may be off: standard deviation \[m\]
    StandardDeviation,
    /// one surface with the ground's roughness that agrees with the returns \[m\]
    Realisation,
    /// 1 where the mean is inferred, 0 where it rests on returns
    Inferred,
    /// slope of the plane through the window of `Limits` \[rad\]
    Slope,
    /// greatest difference of elevation to the cell within the window \[m\]
    Step,
    /// σ(d) at the wheel base \[m\]
    Roughness,
    /// chance that a step within the window exceeds the critical one
    HiddenStep,
    /// 1 free … 0 impassable
    Traversability,
    /// number of the criterion behind the cost, see `traversability::Criterion`
    Criterion,
}

/// What a layer is called and measured in.
pub struct Description {
    /// the layer
    pub layer: Layer,
    /// its name in files and messages
    pub name: &'static str,
    /// its unit, empty for pure numbers
    pub unit: &'static str,
    /// one value per tile of 8 × 8 cells rather than per cell
    pub per_tile: bool,
}

macro_rules! layers {
    ($($layer:ident $name:literal $unit:literal $per_tile:literal),* $(,)?) => {
        &[$(Description { layer: Layer::$layer, name: $name, unit: $unit, per_tile: $per_tile }),*]
    };
}

/// All layers, in the order of their numbers.
pub const LAYERS: &[Description] = layers![
    Elevation "elevation" "m" false,
    Variance "variance" "m2" false,
    UpperBound "upper_bound" "m" false,
    LowerBound "lower_bound" "m" false,
    Lowest "lowest" "m" false,
    Highest "highest" "m" false,
    Count "count" "" false,
    Age "age" "sweeps" false,
    State "state" "" false,
    Sample "sample" "m" false,
    Dimension "dimension" "" true,
    Hurst "hurst" "" true,
    Sigma "sigma" "m" true,
    DimensionError "dimension_error" "" true,
    RangeFrom "range_from" "m" true,
    RangeTo "range_to" "m" true,
    Residual "residual" "" true,
    Pairs "pairs" "" true,
    Reason "reason" "" true,
    Mean "mean" "m" false,
    StandardDeviation "standard_deviation" "m" false,
    Realisation "realisation" "m" false,
    Inferred "inferred" "" false,
    Slope "slope" "rad" false,
    Step "step" "m" false,
    Roughness "roughness" "m" true,
    HiddenStep "hidden_step" "" false,
    Traversability "traversability" "" false,
    Criterion "criterion" "" false,
];

impl Layer {
    /// Its description.
    pub fn description(self) -> &'static Description {
        &LAYERS[self as usize]
    }

    /// The layer with this number on the link.
    pub fn from_number(number: u8) -> Option<Layer> {
        LAYERS.get(number as usize).map(|d| d.layer)
    }

    /// The layer of this name.
    pub fn from_name(name: &str) -> Option<Layer> {
        LAYERS.iter().find(|d| d.name == name).map(|d| d.layer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_names_find_their_layer() {
        for (i, d) in LAYERS.iter().enumerate() {
            assert_eq!(d.layer as usize, i);
            assert_eq!(Layer::from_number(i as u8), Some(d.layer));
            assert_eq!(Layer::from_name(d.name), Some(d.layer));
        }
        assert_eq!(Layer::from_number(LAYERS.len() as u8), None);
    }
}
