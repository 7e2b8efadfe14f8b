//! Configuration: a dozen parameters in SI units, none of which needs tuning, and the limits
//! of the robot.
//!
//! [`Config`] is a value that is checked once; [`PARAMETERS`] is the one list of names,
//! units, ranges and defaults, read by the command line, by the TOML reader and by the
//! link (`Configure { parameter, value }` carries the index into this list).

use crate::traversability::{LimitError, Limits};

/// Which return stands for a cell in the statistics.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SampleRule {
    /// a return near the cell's centre
    #[default]
    Nearest,
    /// the lowest return, for ground under vegetation
    Lowest,
}

/// Which moment of the elevation differences the Hurst exponent is taken from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Moment {
    /// E|Δz| (Yokoya 1989)
    First,
    /// E Δz² (Pentland 1984); the noise of the sensor can be taken off exactly
    #[default]
    Second,
}

/// Parameters of the mapper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// cell edge \[m\]
    pub resolution: f32,
    /// step of the integer heights \[m\]; 0 means resolution / 200
    pub height_step: f32,
    /// Mahalanobis distance beyond which a return does not belong to a cell's surface
    pub gate: f32,
    /// which return stands for a cell in the statistics
    pub sample: SampleRule,
    /// every how many returns a beam is followed to clear ghosts; 0 = never
    pub ghost_stride: f32,
    /// how far below the stored elevation a beam must pass to clear it \[m\]
    pub ghost_margin: f32,
    /// distance of the robot from the map's centre at which the map moves \[m\]
    pub move_distance: f32,
    /// how long the last pose stays valid \[s\]
    pub pose_hold: f32,
    /// Hurst exponent from E|Δz| or E Δz²
    pub moment: Moment,
    /// remove a significant tilt from the elevation differences
    pub detrend: bool,
    /// fewest pairs in a lag that is used
    pub min_pairs: f32,
    /// iterations of the reconstruction per sweep; 0 = no reconstruction
    pub iterations: f32,
    /// what the robot can do
    pub limits: Limits,
}

impl Default for Config {
    fn default() -> Self {
        let mut config = Config {
            resolution: 0.0,
            height_step: 0.0,
            gate: 0.0,
            sample: SampleRule::Nearest,
            ghost_stride: 0.0,
            ghost_margin: 0.0,
            move_distance: 0.0,
            pose_hold: 0.0,
            moment: Moment::Second,
            detrend: true,
            min_pairs: 0.0,
            iterations: 0.0,
            limits: Limits::default(),
        };
        for parameter in PARAMETERS {
            (parameter.write)(&mut config, parameter.default);
        }
        config
    }
}

/// One parameter: its name, meaning, unit, range and default.
pub struct Parameter {
    /// name in files and on the command line
    pub name: &'static str,
    /// unit, empty for pure numbers
    pub unit: &'static str,
    /// what it does, one line
    pub help: &'static str,
    /// least value
    pub min: f32,
    /// greatest value
    pub max: f32,
    /// value without configuration
    pub default: f32,
    /// can it be changed while a map is kept?
    pub live: bool,
    read: fn(&Config) -> f32,
    write: fn(&mut Config, f32),
}

impl Parameter {
    /// Its value in `config`.
    ///
    /// ```
    /// use rugosa::{Config, PARAMETERS};
    /// let config = Config { gate: 5.0, ..Config::default() };
    /// let gate = PARAMETERS.iter().find(|p| p.name == "gate").unwrap();
    /// assert_eq!((gate.get(&config), gate.default), (5.0, 3.0));
    /// assert!(gate.live && !PARAMETERS[0].live); // the resolution is fixed
    /// ```
    pub fn get(&self, config: &Config) -> f32 {
        (self.read)(config)
    }
}

macro_rules! parameter {
    ($name:ident, $unit:literal, $min:literal ..= $max:literal, $default:literal, $live:literal, $help:literal) => {
        Parameter {
            name: stringify!($name),
            unit: $unit,
            help: $help,
            min: $min,
            max: $max,
            default: $default,
            live: $live,
            read: |config| config.$name,
            write: |config, value| config.$name = value,
        }
    };
}

/// A limit of traversability: its name, its place in [`Limits`], unit, range, default.
macro_rules! limit {
    ($name:ident, $($place:ident).+, $unit:literal, $min:literal ..= $max:literal, $default:literal, $help:literal) => {
        Parameter {
            name: stringify!($name),
            unit: $unit,
            help: $help,
            min: $min,
            max: $max,
            default: $default,
            live: true,
            read: |config| config.limits.$($place).+,
            write: |config, value| config.limits.$($place).+ = value,
        }
    };
}

macro_rules! switch {
    ($name:ident, $off:expr, $on:expr, $default:literal, $live:literal, $help:literal) => {
        Parameter {
            name: stringify!($name),
            unit: "",
            help: $help,
            min: 0.0,
            max: 1.0,
            default: $default,
            live: $live,
            read: |config| if config.$name == $on { 1.0 } else { 0.0 },
            write: |config, value| config.$name = if value >= 0.5 { $on } else { $off },
        }
    };
}

/// All parameters; the position in this list is the number on the link.
pub const PARAMETERS: &[Parameter] = &[
    parameter!(resolution, "m", 0.001..=1000.0, 0.1, false, "cell edge"),
    parameter!(
        height_step,
        "m",
        0.0..=10.0,
        0.0,
        false,
        "step of the integer heights, 0 = resolution / 200"
    ),
    parameter!(
        gate,
        "",
        1.0..=100.0,
        3.0,
        true,
        "Mahalanobis gate of the fusion"
    ),
    switch!(
        sample,
        SampleRule::Nearest,
        SampleRule::Lowest,
        0.0,
        false,
        "0 = return near the cell centre, 1 = lowest return"
    ),
    parameter!(
        ghost_stride,
        "returns",
        0.0..=10000.0,
        16.0,
        true,
        "every how many returns a beam is followed to clear ghosts, 0 = never"
    ),
    parameter!(
        ghost_margin,
        "m",
        0.001..=10.0,
        0.1,
        true,
        "how far below a cell a beam must pass to clear it"
    ),
    parameter!(
        move_distance,
        "m",
        0.0..=10000.0,
        0.8,
        true,
        "distance from the centre at which the map moves"
    ),
    parameter!(
        pose_hold,
        "s",
        0.0..=3600.0,
        0.0,
        true,
        "how long the last pose stays valid"
    ),
    switch!(
        moment,
        Moment::First,
        Moment::Second,
        1.0,
        true,
        "0 = E|dz| (Yokoya), 1 = E dz^2 (Pentland)"
    ),
    switch!(
        detrend,
        false,
        true,
        1.0,
        true,
        "1 = remove a significant tilt"
    ),
    parameter!(
        min_pairs,
        "",
        2.0..=10000.0,
        20.0,
        true,
        "fewest pairs in a lag that is used"
    ),
    parameter!(
        iterations,
        "",
        0.0..=200.0,
        10.0,
        true,
        "iterations of the reconstruction per sweep, 0 = none"
    ),
    limit!(
        slope_safe,
        slope.safe,
        "rad",
        0.0..=1.5,
        0.26,
        "slope up to which there is no cost"
    ),
    limit!(
        slope_critical,
        slope.critical,
        "rad",
        0.001..=1.57,
        0.61,
        "slope that is impassable"
    ),
    limit!(
        step_safe,
        step.safe,
        "m",
        0.0..=100.0,
        0.1,
        "step up to which there is no cost"
    ),
    limit!(
        step_critical,
        step.critical,
        "m",
        0.0001..=100.0,
        0.25,
        "step that is impassable"
    ),
    limit!(
        roughness_safe,
        roughness.safe,
        "m",
        0.0..=100.0,
        0.05,
        "rms difference at the wheel base up to which there is no cost"
    ),
    limit!(
        roughness_critical,
        roughness.critical,
        "m",
        0.0001..=100.0,
        0.2,
        "rms difference at the wheel base that is impassable"
    ),
    limit!(
        dimension_safe,
        dimension.safe,
        "",
        0.0..=4.0,
        2.8,
        "fractal dimension up to which there is no cost"
    ),
    limit!(
        dimension_critical,
        dimension.critical,
        "",
        2.0..=10.0,
        3.4,
        "fractal dimension that is impassable; above 3 none is"
    ),
    limit!(
        uncertainty_safe,
        uncertainty.safe,
        "m",
        0.0..=100.0,
        0.1,
        "standard deviation of the elevation up to which there is no cost"
    ),
    limit!(
        uncertainty_critical,
        uncertainty.critical,
        "m",
        0.0001..=100.0,
        0.3,
        "standard deviation of the elevation that is impassable"
    ),
    limit!(
        hidden_step_safe,
        hidden_step.safe,
        "",
        0.0..=1.0,
        0.1,
        "chance of a hidden step up to which there is no cost"
    ),
    limit!(
        hidden_step_critical,
        hidden_step.critical,
        "",
        0.001..=10.0,
        0.9,
        "chance of a hidden step that is impassable; above 1 none is"
    ),
    limit!(
        window,
        window,
        "m",
        0.001..=1000.0,
        0.3,
        "radius around a cell that slope and step are taken from, at most 8 cells"
    ),
    limit!(
        wheel_base,
        wheel_base,
        "m",
        0.001..=1000.0,
        0.5,
        "distance between the contacts with the ground"
    ),
];

/// A parameter that cannot be set so.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ConfigError {
    /// no parameter has this number
    UnknownParameter(u8),
    /// the value lies outside the parameter's range
    OutOfRange {
        /// position in [`PARAMETERS`]
        parameter: u8,
        /// what was asked for
        value: f32,
    },
    /// the parameter cannot change while a map is kept
    Fixed(u8),
    /// the side is not 2^k + 1 between 33 and 1025
    Side(usize),
    /// a plane of memory has the wrong length
    Memory(&'static str),
    /// limits of traversability that contradict each other
    Limit(LimitError),
}

impl core::fmt::Display for ConfigError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let name = |i: u8| PARAMETERS.get(i as usize).map_or("?", |p| p.name);
        match *self {
            ConfigError::UnknownParameter(i) => write!(f, "there is no parameter number {i}"),
            ConfigError::OutOfRange { parameter, value } => {
                let p = &PARAMETERS[parameter as usize];
                write!(
                    f,
                    "{} = {value}: must lie in {} … {} {}",
                    p.name, p.min, p.max, p.unit
                )
            }
            ConfigError::Fixed(i) => write!(f, "{} cannot change while a map is kept", name(i)),
            ConfigError::Side(n) => {
                write!(f, "a map of {n} cells a side: must be 2^k + 1, 33 … 1025")
            }
            ConfigError::Limit(error) => error.fmt(f),
            ConfigError::Memory(what) => write!(f, "memory for {what} has the wrong length"),
        }
    }
}

impl core::error::Error for ConfigError {}

impl Config {
    /// Sets parameter number `index` of [`PARAMETERS`]; leaves everything on an error.
    ///
    /// ```
    /// use rugosa::{Config, ConfigError};
    /// let mut config = Config::default();
    /// let step = Config::index_of("step_critical").unwrap();
    /// config.set(step, 0.4).unwrap();
    /// assert_eq!(config.limits.step.critical, 0.4);
    /// assert!(matches!(config.set(step, -1.0), Err(ConfigError::OutOfRange { .. })));
    /// ```
    pub fn set(&mut self, index: u8, value: f32) -> Result<(), ConfigError> {
        let parameter = PARAMETERS
            .get(index as usize)
            .ok_or(ConfigError::UnknownParameter(index))?;
        if !(parameter.min..=parameter.max).contains(&value) {
            return Err(ConfigError::OutOfRange {
                parameter: index,
                value,
            });
        }
        (parameter.write)(self, value);
        Ok(())
    }

    /// Sets a parameter that may change while a map is kept. Of a pair of limits the one
    /// that widens it has to come first: safe stays below critical.
    ///
    /// ```
    /// use rugosa::{Config, ConfigError};
    /// let mut config = Config::default();
    /// let step = Config::index_of("step_critical").unwrap();
    /// config.set_live(step, 0.4).unwrap();
    /// assert_eq!(config.limits.step.critical, 0.4); // metres
    /// // below the safe step of 0.1 m; nothing changes
    /// assert!(matches!(config.set_live(step, 0.05), Err(ConfigError::Limit(_))));
    /// assert_eq!(config.limits.step.critical, 0.4);
    /// let resolution = Config::index_of("resolution").unwrap();
    /// assert_eq!(config.set_live(resolution, 0.2), Err(ConfigError::Fixed(resolution)));
    /// ```
    pub fn set_live(&mut self, index: u8, value: f32) -> Result<(), ConfigError> {
        let mut changed = *self;
        match PARAMETERS.get(index as usize) {
            Some(parameter) if !parameter.live => return Err(ConfigError::Fixed(index)),
            _ => changed.set(index, value)?,
        }
        changed.limits.check().map_err(ConfigError::Limit)?;
        *self = changed;
        Ok(())
    }

    /// Number of the parameter called `name`.
    ///
    /// ```
    /// use rugosa::{Config, PARAMETERS};
    /// let gate = Config::index_of("gate").unwrap();
    /// assert_eq!(PARAMETERS[usize::from(gate)].help, "Mahalanobis gate of the fusion");
    /// assert_eq!(Config::index_of("no such parameter"), None);
    /// ```
    pub fn index_of(name: &str) -> Option<u8> {
        PARAMETERS
            .iter()
            .position(|p| p.name == name)
            .map(|i| i as u8)
    }

    /// Step of the integer heights \[m\].
    ///
    /// ```
    /// use rugosa::Config;
    /// let cells_of_20_cm = Config { resolution: 0.2, ..Config::default() };
    /// assert_eq!(cells_of_20_cm.height_step(), 0.001); // metres
    /// let coarse = Config { height_step: 0.01, ..cells_of_20_cm };
    /// assert_eq!(coarse.height_step(), 0.01);
    /// ```
    pub fn height_step(&self) -> f32 {
        if self.height_step > 0.0 {
            self.height_step
        } else {
            self.resolution / 200.0
        }
    }

    /// Every parameter within its range, and no limits that contradict each other?
    ///
    /// ```
    /// use rugosa::{Config, ConfigError, traversability::LimitError};
    /// let mut config = Config::default();
    /// assert_eq!(config.check(), Ok(()));
    /// config.limits.slope.safe = 1.0; // above the critical slope of 0.61 rad
    /// assert_eq!(config.check(), Err(ConfigError::Limit(LimitError("slope"))));
    /// ```
    pub fn check(&self) -> Result<(), ConfigError> {
        let mut copy = *self;
        for (i, parameter) in PARAMETERS.iter().enumerate() {
            copy.set(i as u8, parameter.get(self))?;
        }
        self.limits.check().map_err(ConfigError::Limit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_valid_and_the_list_is_a_dozen_and_the_limits() {
        Config::default().check().unwrap();
        assert_eq!(PARAMETERS.len(), 12 + 14);
        assert_eq!(Config::default().limits, Limits::default());
        assert_eq!(Config::default().resolution, 0.1);
        assert_eq!(Config::default().moment, Moment::Second);
        assert!((Config::default().height_step() - 0.0005).abs() < 1e-9);
    }

    #[test]
    fn each_parameter_is_written_where_it_is_read() {
        for (i, p) in PARAMETERS.iter().enumerate() {
            let mut config = Config::default();
            let other = if p.default == p.max { p.min } else { p.max };
            config.set(i as u8, other).unwrap();
            assert_eq!(p.get(&config), other, "{}", p.name);
            assert_ne!(config, Config::default(), "{}", p.name);
            assert_eq!(Config::index_of(p.name), Some(i as u8));
        }
    }

    #[test]
    fn limits_stay_in_order_while_they_change() {
        let index = |name| Config::index_of(name).unwrap();
        let mut config = Config::default();
        let raised = config.set_live(index("step_safe"), 0.3);
        assert_eq!(raised, Err(ConfigError::Limit(LimitError("step"))));
        assert_eq!(config, Config::default());
        config.set_live(index("step_critical"), 0.4).unwrap();
        config.set_live(index("step_safe"), 0.3).unwrap();
        assert_eq!(
            (config.limits.step.safe, config.limits.step.critical),
            (0.3, 0.4)
        );
    }

    #[test]
    fn bad_values_are_named_and_change_nothing() {
        let mut config = Config::default();
        assert_eq!(config.set(99, 1.0), Err(ConfigError::UnknownParameter(99)));
        for bad in [f32::NAN, -1.0, f32::INFINITY] {
            assert!(matches!(
                config.set(0, bad),
                Err(ConfigError::OutOfRange { parameter: 0, .. })
            ));
        }
        assert_eq!(config, Config::default());
    }
}
