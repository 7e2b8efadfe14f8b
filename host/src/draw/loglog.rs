//! Log–log plot of the structure function: the bins, the scaling range, the power law
//! fitted in it and, where known, the truth.

use super::colour::CURVES;
use super::{FONT, GREY, INK, Picture, drawing};
use crate::error::Result;
use plotters::coord::cartesian::Cartesian2d;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::ops::Range;

const SIZE: (u32, u32) = (900, 640);

/// S(d) = σ (d / 1 m)^H.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PowerLaw {
    /// H
    pub hurst: f64,
    /// rms elevation difference at 1 m \[m\]
    pub sigma: f64,
}

impl PowerLaw {
    fn at(&self, lag: f64) -> f64 {
        self.sigma * lag.powf(self.hurst)
    }
}

/// What the plot shows.
#[derive(Clone, Debug, Default)]
pub struct StructurePlot {
    /// heading
    pub title: String,
    /// lag \[m\] and rms elevation difference \[m\] as measured
    pub measured: Vec<(f64, f64)>,
    /// lag \[m\] and rms elevation difference \[m\] with the sensor noise taken off
    pub corrected: Vec<(f64, f64)>,
    /// the fitted power law
    pub fit: Option<PowerLaw>,
    /// least and greatest lag of the scaling range \[m\]
    pub scaling_range: Option<(f64, f64)>,
    /// the power law the surface was made with
    pub truth: Option<PowerLaw>,
}

/// A logarithmic axis with labels at 1, 2, 5 · 10ᵏ.
#[derive(Clone, Copy)]
struct Decades {
    low: f64,
    high: f64,
}

impl Decades {
    /// An axis around all `values`, which are positive.
    fn around(values: impl Iterator<Item = f64>) -> Self {
        let (low, high) = values.fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
        if low > high {
            return Decades {
                low: 0.1,
                high: 10.0,
            };
        }
        Decades {
            low: low / 1.4,
            high: high * 1.4,
        }
    }
}

impl Ranged for Decades {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let t = (value / self.low).ln() / (self.high / self.low).ln();
        limit.0 + (t * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        let decades = self.low.log10().floor() as i32..=self.high.log10().ceil() as i32;
        let all = decades.flat_map(|k| [1.0, 2.0, 5.0].map(|m| m * 10f64.powi(k)));
        all.filter(|v| (self.low..=self.high).contains(v)).collect()
    }

    fn range(&self) -> Range<f64> {
        self.low..self.high
    }
}

impl ValueFormatter<f64> for Decades {
    fn format_ext(&self, value: &f64) -> String {
        let digits = (-value.log10().floor()).clamp(0.0, 9.0) as usize;
        format!("{value:.digits$}")
    }
}

impl StructurePlot {
    /// Draws it.
    pub fn draw(&self) -> Result<Picture> {
        let mut picture = Picture::new(SIZE.0, SIZE.1);
        let area = picture.area();
        let (x, y) = self.axes();
        let mut chart = ChartBuilder::on(&area)
            .caption(&self.title, (FONT, 24).into_font().color(&INK))
            .margin(16)
            .x_label_area_size(52)
            .y_label_area_size(76)
            .build_cartesian_2d(x, y)
            .map_err(drawing)?;
        if let Some((low, high)) = self.scaling_range {
            let band = Rectangle::new(
                [(low, y.low), (high, y.high)],
                RGBColor(232, 240, 248).filled(),
            );
            chart.draw_series([band]).map_err(drawing)?;
            let style = TextStyle::from((FONT, 16).into_font())
                .color(&GREY)
                .pos(Pos::new(HPos::Left, VPos::Top));
            let at = (low * 1.02, y.high / 1.03);
            chart
                .draw_series([Text::new("scaling range", at, style)])
                .map_err(drawing)?;
        }
        mesh(&mut chart)?;
        for (law, name, colour) in self.laws() {
            let text = format!(
                "{name}: H {:.3}, D {:.3}, σ {:.4} m",
                law.hurst,
                3.0 - law.hurst,
                law.sigma
            );
            let ends = [x.low, x.high].map(|d| (d, law.at(d)));
            chart
                .draw_series(LineSeries::new(ends, colour.stroke_width(2)))
                .map_err(drawing)?
                .label(text)
                .legend(move |(x, y)| {
                    PathElement::new([(x, y), (x + 22, y)], colour.stroke_width(2))
                });
        }
        for (points, name, colour) in self.series() {
            let style = if name == "measured" {
                ShapeStyle::from(&colour).stroke_width(2)
            } else {
                colour.filled()
            };
            let dots = points.iter().map(|&p| Circle::new(p, 4, style));
            chart
                .draw_series(dots)
                .map_err(drawing)?
                .label(name)
                .legend(move |(x, y)| Circle::new((x + 11, y), 4, style));
        }
        legend(&mut chart)?;
        area.present().map_err(drawing)?;
        drop(chart);
        drop(area);
        Ok(picture)
    }

    fn axes(&self) -> (Decades, Decades) {
        let points = || {
            self.measured
                .iter()
                .chain(&self.corrected)
                .filter(|p| p.0 > 0.0 && p.1 > 0.0)
        };
        (
            Decades::around(points().map(|p| p.0)),
            Decades::around(points().map(|p| p.1)),
        )
    }

    fn laws(&self) -> impl Iterator<Item = (PowerLaw, &'static str, RGBColor)> {
        let fit = self.fit.map(|law| (law, "fit", CURVES[1]));
        let truth = self.truth.map(|law| (law, "truth", CURVES[2]));
        truth.into_iter().chain(fit)
    }

    fn series(&self) -> impl Iterator<Item = (&Vec<(f64, f64)>, &'static str, RGBColor)> {
        let measured = (&self.measured, "measured", CURVES[0]);
        let corrected = (&self.corrected, "noise taken off", CURVES[0]);
        [measured, corrected]
            .into_iter()
            .filter(|s| !s.0.is_empty())
    }
}

/// A set of structure functions in one plot.
#[derive(Clone, Debug, Default)]
pub struct Curves {
    /// heading
    pub title: String,
    /// name, lag and rms elevation difference of each; drawn as dots and lines in turn
    pub curves: Vec<(String, Vec<(f64, f64)>)>,
}

impl Curves {
    /// Draws it. Two curves that follow each other share a colour: the first as dots,
    /// the second as a line.
    pub fn draw(&self) -> Result<Picture> {
        let mut picture = Picture::new(SIZE.0, SIZE.1);
        let area = picture.area();
        let points = || self.curves.iter().flat_map(|(_, points)| points);
        let axes = (
            Decades::around(points().map(|p| p.0)),
            Decades::around(points().map(|p| p.1)),
        );
        let mut chart = ChartBuilder::on(&area)
            .caption(&self.title, (FONT, 24).into_font().color(&INK))
            .margin(16)
            .x_label_area_size(52)
            .y_label_area_size(76)
            .build_cartesian_2d(axes.0, axes.1)
            .map_err(drawing)?;
        mesh(&mut chart)?;
        for (i, (name, points)) in self.curves.iter().enumerate() {
            let colour = CURVES[i / 2 % CURVES.len()];
            if i % 2 == 0 {
                let dots = points.iter().map(|&p| Circle::new(p, 4, colour.filled()));
                let series = chart.draw_series(dots).map_err(drawing)?;
                series
                    .label(name)
                    .legend(move |(x, y)| Circle::new((x + 11, y), 4, colour.filled()));
            } else {
                let line = LineSeries::new(points.iter().copied(), colour.stroke_width(2));
                let series = chart.draw_series(line).map_err(drawing)?;
                series.label(name).legend(move |(x, y)| {
                    PathElement::new([(x, y), (x + 22, y)], colour.stroke_width(2))
                });
            }
        }
        legend(&mut chart)?;
        area.present().map_err(drawing)?;
        drop(chart);
        drop(area);
        Ok(picture)
    }
}

type Chart<'a, 'b> = ChartContext<'a, BitMapBackend<'b>, Cartesian2d<Decades, Decades>>;

fn mesh(chart: &mut Chart) -> Result<()> {
    chart
        .configure_mesh()
        .light_line_style(WHITE.mix(0.0))
        .bold_line_style(GREY.mix(0.25))
        .axis_style(INK)
        .x_desc("distance d [m]")
        .y_desc("rms elevation difference S(d) [m]")
        .label_style((FONT, 16).into_font().color(&INK))
        .axis_desc_style((FONT, 18).into_font().color(&INK))
        .draw()
        .map_err(drawing)
}

fn legend<'a, 'b: 'a>(chart: &mut Chart<'a, 'b>) -> Result<()> {
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .margin(14)
        .legend_area_size(30)
        .background_style(WHITE.mix(0.85))
        .border_style(GREY)
        .label_font((FONT, 17).into_font().color(&INK))
        .draw()
        .map_err(drawing)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_round_numbers_inside_the_axis() {
        let axis = Decades::around([0.2, 3.0].into_iter());
        let labels: Vec<String> = axis
            .key_points(8)
            .iter()
            .map(|v| axis.format_ext(v))
            .collect();
        assert_eq!(labels, ["0.2", "0.5", "1", "2"]);
        assert_eq!(
            (
                axis.map(&axis.low, (0, 100)),
                axis.map(&axis.high, (0, 100))
            ),
            (0, 100)
        );
    }

    #[test]
    fn an_empty_plot_can_be_drawn() {
        StructurePlot::default().draw().unwrap();
    }
}
