//! What was compared to find a scaling range: the BIC table of the robust method and the
//! segments of the minimax polyline, on the structure function with the noise taken off.

use rugosa_fractal::roughness::scaling_range::{MOST_LAGS, polyline, robust};
use serde::Serialize;
use std::fmt;

/// Everything that was compared.
#[derive(Debug, Serialize)]
pub struct Candidates {
    /// lines that go on as a polynomial, or not; the least BIC is the robust range
    pub bic: Vec<Bic>,
    /// straight pieces of the log–log plot, in order; several long ones: a multifractal
    pub segments: Vec<Segment>,
}

/// A line up to a lag, continued by a polynomial.
#[derive(Debug, Serialize)]
pub struct Bic {
    /// degree of the polynomial; 0: a line to the end
    pub degree: usize,
    /// last lag of the line \[m\]
    pub to_m: f64,
    /// root mean square residual \[ln σ\]
    pub residual: f64,
    /// Bayesian information criterion
    pub bic: f64,
}

/// A straight piece of the log–log plot.
#[derive(Debug, Serialize)]
pub struct Segment {
    /// its first and last lag \[m\]
    pub lags_m: [f64; 2],
    /// number of lags
    pub points: usize,
    /// its slope
    pub hurst: f64,
}

impl Candidates {
    /// From pairs (lag \[m\], rms difference \[m\] without noise), both positive, lags ascending.
    pub fn new(measured: &[(f64, f64)], tolerance: f64) -> Candidates {
        let measured = &measured[..measured.len().min(MOST_LAGS)];
        if measured.len() < 2 {
            return Candidates {
                bic: Vec::new(),
                segments: Vec::new(),
            };
        }
        let (x, y): (Vec<f64>, Vec<f64>) = measured.iter().map(|(d, s)| (d.ln(), s.ln())).unzip();
        let compared = robust(&x, &y, tolerance).table;
        let bic = compared.iter().flatten().map(|c| Bic {
            degree: c.degree,
            to_m: measured[c.points - 1].0,
            residual: (c.rss / x.len() as f64).sqrt(),
            bic: c.bic,
        });
        let pieces = polyline(&x, &y, tolerance);
        let segments = pieces.lines(&x, &y).map(|line| Segment {
            lags_m: [measured[line.first].0, measured[line.last].0],
            points: line.points(),
            hurst: line.slope,
        });
        Candidates {
            bic: bic.collect(),
            segments: segments.collect(),
        }
    }
}

impl fmt::Display for Candidates {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "robust     line to [m]   then of degree   residual   BIC"
        )?;
        for c in &self.bic {
            let (to, residual) = (c.to_m, 100.0 * c.residual);
            writeln!(
                f,
                "           {to:<13.4} {:<16} {residual:6.2} %   {:.1}",
                c.degree, c.bic
            )?;
        }
        write!(f, "polyline   from [m]      to [m]           lags       H")?;
        for s in &self.segments {
            let [from, to] = s.lags_m;
            write!(
                f,
                "\n           {from:<13.4} {to:<16.4} {:<10} {:.3}",
                s.points, s.hurst
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_break_is_in_both_tables() {
        let measured: Vec<(f64, f64)> = (1..=40)
            .map(|i| f64::from(i) * 0.1)
            .map(|d| (d, d.min(1.3).powf(0.8)))
            .collect();
        let found = Candidates::new(&measured, 0.02);
        let least = found.bic.iter().min_by(|a, b| a.bic.total_cmp(&b.bic));
        assert!((least.unwrap().to_m - 1.3).abs() < 1e-9);
        assert_eq!((found.bic.len(), found.bic[0].degree), (4, 0));
        assert!((found.segments[0].hurst - 0.8).abs() < 0.02);
        assert!(found.segments.last().unwrap().hurst.abs() < 0.02);
        assert!(Candidates::new(&measured[..1], 0.02).bic.is_empty());
    }
}
