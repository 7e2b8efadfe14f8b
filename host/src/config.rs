//! The configuration file: TOML, one line per parameter of [`rugosa::config::PARAMETERS`],
//! plus `side`, the cells along an edge of the map.

use crate::error::{Failure, Result};
use rugosa::Config;
use rugosa::config::PARAMETERS;
use std::fmt::Write;
use std::path::Path;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Cells along an edge without configuration.
pub const SIDE: usize = 257;
/// Sides a map can have.
pub const SIDES: [usize; 5] = [33, 65, 129, 257, 513];

/// What a configuration file sets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// cells along an edge of the map, one of [`SIDES`]
    pub side: usize,
    /// parameters of the mapper
    pub mapper: Config,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            side: SIDE,
            mapper: Config::default(),
        }
    }
}

impl Settings {
    /// Reads a file; `None` gives the defaults.
    pub fn read(path: Option<&Path>) -> Result<Self> {
        let Some(path) = path else {
            return Ok(Settings::default());
        };
        let text = std::fs::read_to_string(path).map_err(|e| Failure::file(path, e))?;
        Settings::parse(path, &text)
    }

    fn parse(path: &Path, text: &str) -> Result<Self> {
        let line = |at: usize| 1 + text[..at.min(text.len())].matches('\n').count() as u64;
        let table = DeTable::parse(text).map_err(|error| {
            let at = error.span().map_or(0, |span| span.start);
            Failure::line(path, line(at), error.message())
        })?;
        let mut settings = Settings::default();
        for (key, value) in table.get_ref() {
            let set = settings.set(key.get_ref(), value);
            set.map_err(|message| Failure::line(path, line(key.span().start), message))?;
        }
        settings
            .mapper
            .check()
            .map_err(|e| Failure::file(path, e))?;
        Ok(settings)
    }

    fn set(&mut self, name: &str, value: &Spanned<DeValue>) -> Result<(), String> {
        let number = number(value.get_ref()).ok_or_else(|| format!("{name}: not a number"))?;
        if name == "side" {
            self.side = side(number)?;
            return Ok(());
        }
        let index = Config::index_of(name).ok_or_else(|| unknown(name))?;
        self.mapper
            .set(index, number as f32)
            .map_err(|error| error.to_string())
    }

    /// The file that sets what is set here, with a comment for every line.
    pub fn to_toml(&self) -> String {
        let mut text = String::new();
        let sides = SIDES.map(|s| s.to_string()).join(", ");
        let mut put = |name: &str, value: f64, comment: String| {
            let assignment = format!("{name} = {value}");
            writeln!(text, "{assignment:<24} # {comment}").expect("a string takes everything");
        };
        put(
            "side",
            self.side as f64,
            format!("cells along an edge of the map: {sides}"),
        );
        for p in PARAMETERS {
            let unit = if p.unit.is_empty() {
                String::new()
            } else {
                format!("[{}] ", p.unit)
            };
            let comment = format!("{unit}{} ({} … {})", p.help, p.min, p.max);
            put(p.name, decimal(p.get(&self.mapper)), comment);
        }
        text
    }
}

/// The shortest decimal that stands for `value`: 0.1, not 0.10000000149.
pub fn decimal(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

fn number(value: &DeValue) -> Option<f64> {
    match value {
        DeValue::Integer(i) => i.as_str().replace('_', "").parse().ok(),
        DeValue::Float(f) => f.as_str().replace('_', "").parse().ok(),
        DeValue::Boolean(b) => Some(f64::from(u8::from(*b))),
        _ => None,
    }
}

fn side(number: f64) -> Result<usize, String> {
    let found = SIDES.into_iter().find(|&s| s as f64 == number);
    found.ok_or_else(|| format!("side = {number}: must be one of {SIDES:?}"))
}

fn unknown(name: &str) -> String {
    let names: Vec<&str> = PARAMETERS.iter().map(|p| p.name).collect();
    format!(
        "unknown parameter '{name}'; known are side, {}",
        names.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Settings> {
        Settings::parse(Path::new("a.toml"), text)
    }

    #[test]
    fn what_is_written_is_read_back() {
        let mut settings = Settings::default();
        settings.mapper.set(0, 0.05).unwrap();
        settings.side = 65;
        assert_eq!(parse(&settings.to_toml()).unwrap(), settings);
        assert_eq!(parse("").unwrap(), Settings::default());
    }

    #[test]
    fn errors_name_the_line_and_the_parameter() {
        let cases = [
            (
                "resolution = 0.1\ngate = 0\n",
                "a.toml:2: gate = 0: must lie in",
            ),
            (
                "\n\nresolutoin = 0.1\n",
                "a.toml:3: unknown parameter 'resolutoin'",
            ),
            ("side = 64", "a.toml:1: side = 64"),
            ("gate = \"three\"", "a.toml:1: gate: not a number"),
            ("gate = nan", "a.toml:1: gate = NaN"),
            ("gate = 3\ngate 4", "a.toml:2"),
            ("step_safe = 0.3", "a.toml: limit step"),
        ];
        for (text, expected) in cases {
            let message = parse(text).unwrap_err().message;
            assert!(message.starts_with(expected), "{message}");
        }
    }
}
