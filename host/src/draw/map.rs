//! Maps: one panel per layer, side by side, each with title, axes in metres, scale bar,
//! colour bar with unit and unknown cells hatched.

use super::colour::{self, Palette};
use super::shade::hillshade;
use super::{Anchor, Area, INK, Picture, drawing, label, line, round_up, tick_step, ticks, write};
use crate::error::Result;
use crate::io::Raster;
use plotters::prelude::*;

/// Longest side of a map in pixels.
const SIDE: f64 = 520.0;
/// Room around the map: left, top, right, bottom.
const MARGIN: [u32; 4] = [66, 46, 104, 84];
const BAR_GAP: i32 = 14;
const BAR_WIDTH: i32 = 18;

/// What a panel shows.
#[derive(Clone, Copy, Debug)]
pub struct Layer<'a> {
    /// heading
    pub title: &'a str,
    /// what stands at the colour bar, e.g. `m`
    pub unit: &'a str,
    /// the values; NaN is unknown
    pub raster: &'a Raster,
    /// colours
    pub palette: Palette,
    /// ends of the colour bar; without it the 0.5 and 99.5 percentiles
    pub range: Option<(f64, f64)>,
    /// shade by the layer's own slope: for elevations
    pub shaded: bool,
    /// a way across the map, x and y \[m\]; empty for none
    pub path: &'a [[f64; 2]],
}

impl<'a> Layer<'a> {
    /// A shaded map of elevations.
    pub fn elevation(title: &'a str, raster: &'a Raster) -> Self {
        Layer {
            title,
            unit: "m",
            raster,
            palette: Palette::Viridis,
            range: None,
            shaded: true,
            path: &[],
        }
    }

    /// A map of fractal dimensions; the colour bar always goes from 2 to 3.
    pub fn dimension(title: &'a str, raster: &'a Raster) -> Self {
        Layer {
            title,
            unit: "",
            raster,
            palette: Palette::Cividis,
            range: Some((2.0, 3.0)),
            shaded: false,
            path: &[],
        }
    }

    /// A map of anything that is zero or more; the colour bar starts at zero.
    pub fn magnitude(title: &'a str, unit: &'a str, raster: &'a Raster) -> Self {
        let high = percentiles(raster).1.max(1e-9);
        Layer {
            title,
            unit,
            raster,
            palette: Palette::Magma,
            range: Some((0.0, high)),
            shaded: false,
            path: &[],
        }
    }

    /// Least and greatest value of the colour bar.
    pub fn ends(&self) -> (f64, f64) {
        let (low, high) = self.range.unwrap_or_else(|| percentiles(self.raster));
        if high - low > 1e-9 * (1.0 + low.abs()) {
            (low, high)
        } else {
            (low - 0.5, high + 0.5)
        }
    }
}

fn percentiles(raster: &Raster) -> (f64, f64) {
    let mut known: Vec<f32> = raster
        .values
        .iter()
        .copied()
        .filter(|v| v.is_finite())
        .collect();
    if known.is_empty() {
        return (0.0, 1.0);
    }
    known.sort_by(f32::total_cmp);
    let at = |q: f64| f64::from(known[(q * (known.len() - 1) as f64).round() as usize]);
    (at(0.005), at(0.995))
}

/// Where a panel lies in the picture, and metres to pixels.
struct Frame {
    left: i32,
    top: i32,
    width: i32,
    height: i32,
    /// x and y of the lower left corner \[m\]
    corner: [f64; 2],
    /// pixels per metre
    scale: f64,
}

impl Frame {
    fn of(raster: &Raster, left: u32) -> Self {
        let extent = [
            raster.columns as f64 * raster.spacing_x,
            raster.rows as f64 * raster.spacing_y,
        ];
        let scale = SIDE / extent[0].max(extent[1]);
        Frame {
            left: (left + MARGIN[0]) as i32,
            top: MARGIN[1] as i32,
            width: (extent[0] * scale).round().max(1.0) as i32,
            height: (extent[1] * scale).round().max(1.0) as i32,
            corner: [
                raster.origin[0] - raster.spacing_x / 2.0,
                raster.origin[1] - raster.spacing_y / 2.0,
            ],
            scale,
        }
    }

    fn right(&self) -> i32 {
        self.left + self.width
    }

    fn bottom(&self) -> i32 {
        self.top + self.height
    }

    fn panel_width(&self) -> u32 {
        self.width as u32 + MARGIN[0] + MARGIN[2]
    }

    fn panel_height(&self) -> u32 {
        self.height as u32 + MARGIN[1] + MARGIN[3]
    }

    fn x(&self, x_m: f64) -> i32 {
        self.left + ((x_m - self.corner[0]) * self.scale).round() as i32
    }

    fn y(&self, y_m: f64) -> i32 {
        self.bottom() - ((y_m - self.corner[1]) * self.scale).round() as i32
    }
}

/// Draws the layers side by side.
pub fn maps(layers: &[Layer]) -> Result<Picture> {
    let mut frames: Vec<Frame> = Vec::new();
    for layer in layers {
        let left = frames.iter().map(Frame::panel_width).sum();
        frames.push(Frame::of(layer.raster, left));
    }
    let width = frames.iter().map(Frame::panel_width).sum();
    let height = frames.iter().map(Frame::panel_height).max().unwrap_or(1);
    let mut picture = Picture::new(width, height);
    for (layer, frame) in layers.iter().zip(&frames) {
        paint(&mut picture, layer, frame);
    }
    let area = picture.area();
    for (layer, frame) in layers.iter().zip(&frames) {
        annotate(&area, layer, frame)?;
    }
    area.present().map_err(drawing)?;
    drop(area);
    Ok(picture)
}

fn paint(picture: &mut Picture, layer: &Layer, frame: &Frame) {
    let raster = layer.raster;
    let (low, high) = layer.ends();
    let shade = layer.shaded.then(|| hillshade(raster));
    for y in 0..frame.height {
        let row = raster.rows - 1 - (y as usize * raster.rows / frame.height as usize);
        for x in 0..frame.width {
            let column = x as usize * raster.columns / frame.width as usize;
            let value = f64::from(raster.at(row, column));
            let (px, py) = ((frame.left + x) as u32, (frame.top + y) as u32);
            let colour = if value.is_finite() {
                let brightness = shade
                    .as_ref()
                    .map_or(1.0, |s| s[row * raster.columns + column]);
                dim(
                    layer.palette.colour((value - low) / (high - low)),
                    brightness,
                )
            } else {
                colour::unknown(px, py)
            };
            picture.set(px, py, colour);
        }
    }
    paint_bar(picture, layer.palette, frame);
    paint_unknown(picture, frame);
}

fn dim(colour: [u8; 3], brightness: f64) -> [u8; 3] {
    colour.map(|c| (f64::from(c) * brightness).round() as u8)
}

fn paint_bar(picture: &mut Picture, palette: Palette, frame: &Frame) {
    for y in 0..frame.height {
        let t = 1.0 - f64::from(y) / f64::from(frame.height - 1).max(1.0);
        for x in 0..BAR_WIDTH {
            let px = (frame.right() + BAR_GAP + x) as u32;
            picture.set(px, (frame.top + y) as u32, palette.colour(t));
        }
    }
}

/// The swatch that explains the hatching.
fn paint_unknown(picture: &mut Picture, frame: &Frame) {
    let (left, top) = swatch(frame);
    for y in top..top + 16 {
        for x in left..left + 24 {
            picture.set(x as u32, y as u32, colour::unknown(x as u32, y as u32));
        }
    }
}

fn swatch(frame: &Frame) -> (i32, i32) {
    (frame.right() + BAR_GAP, frame.bottom() + 44)
}

fn annotate(area: &Area, layer: &Layer, frame: &Frame) -> Result<()> {
    let middle = (frame.left + frame.right()) / 2;
    write(
        area,
        layer.title,
        (middle, frame.top - 12),
        22,
        Anchor::Above,
    )?;
    outline(area, frame.left, frame.right(), frame)?;
    let bar = frame.right() + BAR_GAP;
    outline(area, bar, bar + BAR_WIDTH, frame)?;
    axes(area, frame)?;
    scale_bar(area, frame)?;
    bar_labels(area, layer, frame)?;
    draw_path(area, layer.path, frame)?;
    let (left, top) = swatch(frame);
    write(area, "unknown", (left + 28, top + 8), 14, Anchor::Right)
}

/// The way, with a ring where it begins and a disc where it ends.
fn draw_path(area: &Area, path: &[[f64; 2]], frame: &Frame) -> Result<()> {
    let points: Vec<_> = path
        .iter()
        .map(|p| (frame.x(p[0]), frame.y(p[1])))
        .collect();
    let (Some(&first), Some(&last)) = (points.first(), points.last()) else {
        return Ok(());
    };
    for (colour, width) in [(WHITE, 6), (RGBColor(200, 30, 30), 3)] {
        let way = PathElement::new(points.clone(), colour.stroke_width(width));
        area.draw(&way).map_err(drawing)?;
        let ring = Circle::new(first, 7, colour.stroke_width(width));
        area.draw(&ring).map_err(drawing)?;
        let disc = Circle::new(last, 5 + width as i32 / 2, colour.filled());
        area.draw(&disc).map_err(drawing)?;
    }
    Ok(())
}

fn outline(area: &Area, left: i32, right: i32, frame: &Frame) -> Result<()> {
    let corners = [(left - 1, frame.top - 1), (right, frame.bottom())];
    area.draw(&Rectangle::new(corners, INK)).map_err(drawing)
}

fn axes(area: &Area, frame: &Frame) -> Result<()> {
    let right_m = frame.corner[0] + f64::from(frame.width) / frame.scale;
    let top_m = frame.corner[1] + f64::from(frame.height) / frame.scale;
    let step = tick_step(frame.corner[0], right_m, 5);
    for x in ticks(frame.corner[0], right_m, 5) {
        let at = (frame.x(x), frame.bottom());
        line(area, at, (at.0, at.1 + 5))?;
        write(area, &label(x, step), (at.0, at.1 + 8), 14, Anchor::Below)?;
    }
    let step = tick_step(frame.corner[1], top_m, 5);
    for y in ticks(frame.corner[1], top_m, 5) {
        let at = (frame.left - 1, frame.y(y));
        line(area, at, (at.0 - 5, at.1))?;
        write(area, &label(y, step), (at.0 - 8, at.1), 14, Anchor::Left)?;
    }
    let middle = (frame.left + frame.right()) / 2;
    write(
        area,
        "x [m]",
        (middle, frame.bottom() + 26),
        14,
        Anchor::Below,
    )?;
    write(
        area,
        "y [m]",
        (frame.left - 4, frame.top - 14),
        14,
        Anchor::Left,
    )
}

fn scale_bar(area: &Area, frame: &Frame) -> Result<()> {
    let length_m = round_up(f64::from(frame.width) / frame.scale / 8.0);
    let length = (length_m * frame.scale).round() as i32;
    let (left, top) = (frame.left, frame.bottom() + 50);
    let bar = Rectangle::new([(left, top), (left + length, top + 5)], INK.filled());
    area.draw(&bar).map_err(drawing)?;
    let text = format!("{} m", label(length_m, length_m));
    write(area, &text, (left + length + 8, top + 2), 14, Anchor::Right)
}

fn bar_labels(area: &Area, layer: &Layer, frame: &Frame) -> Result<()> {
    let (low, high) = layer.ends();
    let x = frame.right() + BAR_GAP + BAR_WIDTH;
    for value in ticks(low, high, 6) {
        let t = (value - low) / (high - low);
        let y = frame.bottom() - (t * f64::from(frame.height)).round() as i32;
        line(area, (x, y), (x + 4, y))?;
        let text = label(value, tick_step(low, high, 6));
        write(area, &text, (x + 7, y), 14, Anchor::Right)?;
    }
    if layer.unit.is_empty() {
        return Ok(());
    }
    let unit = format!("[{}]", layer.unit);
    write(
        area,
        &unit,
        (x - BAR_WIDTH / 2, frame.top - 6),
        14,
        Anchor::Above,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The cell of the greatest x and y must be in the top right corner.
    #[test]
    fn the_greatest_y_is_at_the_top() {
        let mut values = vec![0.0; 12];
        values[11] = 1.0;
        let raster = Raster::square(3, 4, 1.0, [0.0, 0.0], values);
        let layer = Layer {
            shaded: false,
            range: Some((0.0, 1.0)),
            ..Layer::elevation("t", &raster)
        };
        let picture = maps(&[layer]).unwrap();
        let pixel = |x: u32, y: u32| {
            let at = ((y * picture.width + x) * 3) as usize;
            [
                picture.pixels[at],
                picture.pixels[at + 1],
                picture.pixels[at + 2],
            ]
        };
        let frame = Frame::of(&raster, 0);
        let (right, top) = ((frame.right() - 20) as u32, (frame.top + 20) as u32);
        let (left, bottom) = ((frame.left + 20) as u32, (frame.bottom() - 20) as u32);
        assert_eq!(pixel(right, top), Palette::Viridis.colour(1.0));
        for (x, y) in [(left, top), (left, bottom), (right, bottom)] {
            assert_eq!(pixel(x, y), Palette::Viridis.colour(0.0));
        }
    }

    #[test]
    fn a_raster_without_any_value_can_be_drawn() {
        let raster = Raster::square(2, 2, 1.0, [0.0, 0.0], vec![f32::NAN; 4]);
        maps(&[
            Layer::elevation("t", &raster),
            Layer::magnitude("s", "m", &raster),
        ])
        .unwrap();
    }
}
