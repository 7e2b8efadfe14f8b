//! Pictures: maps with legend, scale bar and title, and the log–log plot of the structure
//! function. Drawn with an embedded font, so they are the same on every machine.

pub mod colour;
pub mod loglog;
pub mod map;
pub mod shade;

use crate::error::{Failure, Result};
use crate::io::atomic;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontStyle, register_font};
use std::io;
use std::path::Path;
use std::sync::Once;

pub use colour::Palette;
pub use loglog::{Curves, StructurePlot};
pub use map::{Layer, maps};

/// Name of the embedded font.
const FONT: &str = "rugosa";
const INK: RGBColor = RGBColor(32, 32, 32);
const GREY: RGBColor = RGBColor(120, 120, 120);

type Area<'a> = DrawingArea<BitMapBackend<'a>, Shift>;

/// An RGB picture; row 0 is the top.
#[derive(Clone, Debug)]
pub struct Picture {
    width: u32,
    height: u32,
    pixels: Vec<u8>,
}

impl Picture {
    fn new(width: u32, height: u32) -> Self {
        register();
        Picture {
            width,
            height,
            pixels: vec![255; (width * height * 3) as usize],
        }
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    fn set(&mut self, x: u32, y: u32, rgb: [u8; 3]) {
        let at = ((y * self.width + x) * 3) as usize;
        self.pixels[at..at + 3].copy_from_slice(&rgb);
    }

    fn area(&mut self) -> Area<'_> {
        BitMapBackend::with_buffer(&mut self.pixels, (self.width, self.height)).into_drawing_area()
    }

    /// Writes a PNG file.
    pub fn save(&self, path: &Path) -> Result<()> {
        atomic::write(path, |writer| {
            let encoder = PngEncoder::new(writer);
            let written = encoder.write_image(
                &self.pixels,
                self.width,
                self.height,
                ExtendedColorType::Rgb8,
            );
            written.map_err(io::Error::other)
        })
    }
}

fn register() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let font = epaint_default_fonts::UBUNTU_LIGHT;
        assert!(
            register_font(FONT, FontStyle::Normal, font).is_ok(),
            "the embedded font is valid"
        );
    });
}

/// Where a text stands relative to its point.
#[derive(Clone, Copy)]
enum Anchor {
    Above,
    Below,
    Left,
    Right,
}

fn write(area: &Area, text: &str, at: (i32, i32), size: i32, anchor: Anchor) -> Result<()> {
    let pos = match anchor {
        Anchor::Above => Pos::new(HPos::Center, VPos::Bottom),
        Anchor::Below => Pos::new(HPos::Center, VPos::Top),
        Anchor::Left => Pos::new(HPos::Right, VPos::Center),
        Anchor::Right => Pos::new(HPos::Left, VPos::Center),
    };
    let style = TextStyle::from((FONT, size).into_font())
        .color(&INK)
        .pos(pos);
    area.draw_text(text, &style, at).map_err(drawing)
}

fn line(area: &Area, from: (i32, i32), to: (i32, i32)) -> Result<()> {
    area.draw(&PathElement::new(vec![from, to], INK))
        .map_err(drawing)
}

fn drawing(error: impl std::fmt::Display) -> Failure {
    Failure::runtime(format_args!("drawing: {error}"))
}

/// Round numbers (1, 2, 5 · 10ᵏ apart) from `low` to `high`, about `most` at most.
fn ticks(low: f64, high: f64, most: usize) -> Vec<f64> {
    let step = tick_step(low, high, most);
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    (first..=last).map(|i| i as f64 * step).collect()
}

fn tick_step(low: f64, high: f64, most: usize) -> f64 {
    round_up(((high - low) / most as f64).max(1e-12))
}

/// The least of 1, 2, 5 · 10ᵏ that is not below `x`.
pub(crate) fn round_up(x: f64) -> f64 {
    let decade = 10f64.powf(x.log10().floor());
    [1.0, 2.0, 5.0]
        .into_iter()
        .map(|m| m * decade)
        .find(|&v| v >= x * 0.999_999)
        .unwrap_or(10.0 * decade)
}

/// A number with as many digits as `step` apart needs.
fn label(value: f64, step: f64) -> String {
    let digits = (-(step.abs().max(1e-9)).log10().floor()).clamp(0.0, 9.0) as usize;
    let text = format!("{value:.digits$}");
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(
            ticks(2.0, 3.0, 5),
            [2.0, 2.2, 2.4000000000000004, 2.6, 2.8000000000000003, 3.0]
        );
        for (low, high) in [(-3.2, 3.2), (0.0, 0.013), (1e-6, 5e4), (-1.0, -0.9)] {
            let ticks = ticks(low, high, 6);
            assert!((3..=7).contains(&ticks.len()), "{low} {high}: {ticks:?}");
            let slack = 1e-9 * (high - low);
            assert!(
                ticks
                    .iter()
                    .all(|t| (low - slack..=high + slack).contains(t))
            );
        }
    }

    #[test]
    fn labels_have_the_digits_of_the_step() {
        assert_eq!(label(2.4000000000000004, 0.2), "2.4");
        assert_eq!(label(-0.015, 0.005), "−0.015");
        assert_eq!(label(1200.0, 200.0), "1200");
    }

    #[test]
    fn every_sign_the_drawings_use_is_in_the_font() {
        let drawn = |sign: char| {
            let mut picture = Picture::new(40, 40);
            write(
                &picture.area(),
                &sign.to_string(),
                (20, 35),
                30,
                Anchor::Above,
            )
            .unwrap();
            picture.pixels
        };
        let missing = drawn('\u{10ffff}');
        for sign in "σΔ±−×·°–…²".chars() {
            assert_ne!(drawn(sign), missing, "'{sign}' is missing");
        }
    }
}
