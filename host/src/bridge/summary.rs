//! `summary.json`: what was measured, what was lost, and what came out.

use super::traffic::{Extent, Traffic};
use rugosa::Mapper;
use rugosa::report::SweepReport;
use rugosa_fractal::roughness::{Reason, Roughness};
use rugosa_wire::counter::{self, NAMES};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;

/// What the simulated terrain was made with.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Truth {
    /// fractal dimension
    pub dimension: f64,
    /// rms elevation difference at 1 m \[m\]
    pub sigma: f64,
}

/// Roughness of the whole map.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// fractal dimension
    pub dimension: f32,
    /// Hurst exponent
    pub hurst: f32,
    /// rms elevation difference at 1 m \[m\]
    pub sigma: f32,
    /// standard error of dimension and Hurst exponent
    pub standard_error: f32,
    /// shortest and longest distance of the power law \[m\]
    pub scaling_range_m: [f32; 2],
    /// rms residual of ln σ(d)
    pub residual: f32,
    /// pairs behind it
    pub pairs: u32,
    /// the tilt of the map was taken off
    pub detrended: bool,
}

impl From<Roughness> for Estimate {
    fn from(r: Roughness) -> Self {
        Estimate {
            dimension: r.dimension,
            hurst: r.hurst,
            sigma: r.sigma,
            standard_error: r.standard_error,
            scaling_range_m: r.range,
            residual: r.residual,
            pairs: r.pairs,
            detrended: r.detrended,
        }
    }
}

/// Line messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Lines {
    /// sent, as the sender counts them; from a scanner elsewhere: received and lost
    pub sent: u64,
    /// received
    pub received: u64,
    /// sent and not received
    pub lost: u64,
    /// received and not mapped
    pub rejected: u64,
}

/// Returns of the lines that were mapped.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Returns {
    /// fused into the map
    pub used: u32,
    /// all others, by cause
    pub by_cause: BTreeMap<&'static str, u32>,
}

/// Cells of the map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Cells {
    /// that hold a sample
    pub measured: u32,
    /// of the map
    pub total: usize,
}

/// Latencies \[ms\].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Latency {
    /// of lines, beyond that of the quickest line
    pub line: Extent,
    /// from the arrival of a sweep's end to its roughness
    pub sweep: Extent,
    /// mean round trip over the link; `None` where none was measured
    pub round_trip: Option<f64>,
}

/// The whole run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// what a simulated terrain was made with
    pub truth: Option<Truth>,
    /// roughness of the whole map
    pub estimate: Option<Estimate>,
    /// why there is no estimate
    pub reason: Option<String>,
    /// the same as it was estimated
    #[serde(skip)]
    pub roughness: Option<Result<Roughness, Reason>>,
    /// complete sweeps
    pub sweeps: u32,
    /// line messages
    pub lines: Lines,
    /// returns
    pub returns: Returns,
    /// cells
    pub cells: Cells,
    /// latencies \[ms\]
    pub latency_ms: Latency,
    /// all counters by name
    pub counters: BTreeMap<&'static str, u32>,
    /// the configuration
    pub config: BTreeMap<&'static str, f32>,
    /// duration of the run
    pub seconds: f64,
}

/// Lines that were received and not mapped, by cause.
const REJECTED: [usize; 7] = [
    counter::LINES_NO_DESCRIPTION,
    counter::LINES_NO_POSE,
    counter::LINES_UNKNOWN_PLACE,
    counter::LINES_MALFORMED,
    counter::LINES_TIME_BACKWARDS,
    counter::LINES_DUPLICATES,
    counter::LINES_STALE,
];

const CAUSES: [usize; 7] = [
    counter::RETURNS_NO_RETURN,
    counter::RETURNS_TOO_CLOSE,
    counter::RETURNS_ERRONEOUS,
    counter::RETURNS_OUT_OF_RANGE,
    counter::RETURNS_OUTSIDE_MAP,
    counter::RETURNS_HEIGHT,
    counter::RETURNS_GATED,
];

impl Summary {
    /// Of a map as it is now; `seconds` is the duration of the run.
    pub fn of(
        mapper: &Mapper,
        report: Option<&SweepReport>,
        traffic: &Traffic,
        seconds: f64,
    ) -> Self {
        let get = |index| mapper.counters().get(index);
        let roughness = report.map(|r| r.roughness);
        let sides = mapper.window().side();
        Summary {
            truth: None,
            estimate: roughness.and_then(Result::ok).map(Estimate::from),
            reason: match roughness {
                None => Some("no sweep is complete".into()),
                Some(Err(reason)) => Some(format!("{reason:?}")),
                Some(Ok(_)) => None,
            },
            roughness,
            sweeps: get(counter::SWEEPS),
            lines: lines(mapper),
            returns: Returns {
                used: get(counter::RETURNS_USED),
                by_cause: CAUSES
                    .into_iter()
                    .map(|i| (short(NAMES[i]), get(i)))
                    .collect(),
            },
            cells: Cells {
                measured: get(counter::CELLS_MEASURED),
                total: sides * sides,
            },
            latency_ms: Latency {
                line: traffic.delay,
                sweep: traffic.sweep,
                round_trip: traffic.round_trip.mean_us().map(|us| us as f64 / 1000.0),
            },
            counters: NAMES
                .iter()
                .enumerate()
                .map(|(i, &name)| (name, get(i)))
                .collect(),
            config: rugosa::PARAMETERS
                .iter()
                .map(|p| (p.name, p.get(mapper.config())))
                .collect(),
            seconds,
        }
    }

    /// The sender says how many lines it sent.
    pub fn sent(&mut self, sent: u64) {
        self.lines.sent = sent;
        self.lines.lost = sent.saturating_sub(self.lines.received);
    }
}

fn lines(mapper: &Mapper) -> Lines {
    let get = |index| u64::from(mapper.counters().get(index));
    let rejected: u64 = REJECTED.into_iter().map(get).sum();
    let received = get(counter::LINES_RECEIVED);
    // a sweep's end counts the lines that were not mapped; some of them were rejected
    let lost = get(counter::LINES_LOST).saturating_sub(rejected);
    Lines {
        sent: received + lost,
        received,
        lost,
        rejected,
    }
}

fn short(name: &'static str) -> &'static str {
    name.rsplit('.').next().unwrap_or(name)
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.estimate, &self.reason) {
            (Some(e), _) => {
                writeln!(
                    f,
                    "dimension  D = {:.3} ± {:.3}  (H = {:.3}), σ(1 m) = {:.4} m",
                    e.dimension, e.standard_error, e.hurst, e.sigma
                )?;
                writeln!(
                    f,
                    "           power law from {:.2} to {:.2} m, {} pairs",
                    e.scaling_range_m[0], e.scaling_range_m[1], e.pairs
                )?;
            }
            (None, reason) => writeln!(f, "dimension  none: {}", reason.as_deref().unwrap_or("?"))?,
        }
        if let Some(truth) = &self.truth {
            writeln!(
                f,
                "truth      D = {:.3}, σ(1 m) = {:.4} m",
                truth.dimension, truth.sigma
            )?;
        }
        let l = &self.lines;
        let is_of_a_link = l.sent + l.received + l.lost + l.rejected > 0;
        writeln!(f, "sweeps     {}", self.sweeps)?;
        if is_of_a_link {
            writeln!(
                f,
                "lines      {} sent, {} received, {} lost, {} rejected",
                l.sent, l.received, l.lost, l.rejected
            )?;
        }
        let others: Vec<String> = self
            .returns
            .by_cause
            .iter()
            .filter(|c| *c.1 > 0)
            .map(|(name, n)| format!(", {n} {}", name.replace('_', " ")))
            .collect();
        writeln!(
            f,
            "returns    {} used{}",
            self.returns.used,
            others.concat()
        )?;
        writeln!(
            f,
            "cells      {} of {} measured",
            self.cells.measured, self.cells.total
        )?;
        write!(f, "time       {:.2} s", self.seconds)?;
        if is_of_a_link {
            let latency = &self.latency_ms.sweep;
            write!(
                f,
                "; a sweep's map is ready {:.1} ms after its end (at most {:.1})",
                latency.mean, latency.max
            )?;
        }
        Ok(())
    }
}
