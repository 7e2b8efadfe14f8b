//! The simulated measurement: beams against terrain, then what a real sensor does to it.
//!
//! For a surface of albedo ρ met at incidence ι and range r the signal is
//! s = ρ cos ι · min(1, (r_ref / r)²), and
//!
//! - *noise*: σ² = noise_m² + (noise_per_m · r)² · 0.25 / (ρ cos ι), so it grows as the
//!   reflectance falls; the beam's direction has its own normal error;
//! - *mixed pixels*: beside a jump of range a beam is split into five; their echoes add
//!   as phasors s exp(2πi R / interval), as in a phase-measuring sensor, and the phase of
//!   the sum is the reading;
//! - *wrap*: readings start at 0 again after the ambiguity interval (where the device
//!   has one; a pulsed device returns nothing beyond its last count);
//! - *drop-outs*: a signal below the threshold, and a small part for no reason;
//! - *quantisation*: readings are whole counts; codes that are sentinels on the link
//!   cannot be readings and become `ERRONEOUS`.
//!
//! Each can be switched off ([`Effects`]) except quantisation. The random numbers of a
//! line depend on seed, sweep and line only.

use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::{Isometry3, Translation3};
use rugosa_wire::range_code;

use crate::device::{Device, TYPICAL_BRIGHTNESS};
use crate::geometry::Beam;
use crate::random::{Random, noise_at};
use crate::robot::Robot;
use crate::terrain::Ray;

/// Neighbouring readings farther apart than this are beside an edge \[m\].
const JUMP: f64 = 0.15;

/// What is simulated beyond geometry and counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Effects {
    /// normal errors of range and direction
    pub noise: bool,
    /// beams that straddle an edge
    pub mixed_pixels: bool,
    /// lost returns
    pub drop_outs: bool,
    /// the ambiguity interval
    pub wrap: bool,
}

impl Effects {
    /// Everything.
    pub const ALL: Effects = Effects {
        noise: true,
        mixed_pixels: true,
        drop_outs: true,
        wrap: true,
    };
    /// Geometry and counts only.
    pub const NONE: Effects = Effects {
        noise: false,
        mixed_pixels: false,
        drop_outs: false,
        wrap: false,
    };
}

/// How bright the ground is: patches of uniformly distributed albedo, smooth between.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Albedo {
    /// darkest and brightest
    pub between: [f64; 2],
    /// size of a patch \[m\]
    pub patch: f64,
}

impl Default for Albedo {
    fn default() -> Self {
        Albedo {
            between: [0.2, 0.8],
            patch: 0.5,
        }
    }
}

impl Albedo {
    /// Albedo at (x, y) \[m\].
    pub fn at(&self, x: f64, y: f64, seed: u64) -> f64 {
        let (u, v) = (x / self.patch, y / self.patch);
        let (i, j) = (u.floor(), v.floor());
        let node = |di: f64, dj: f64| noise_at((i + di) as i64, (j + dj) as i64, seed);
        let ease = |t: f64| t * t * (3.0 - 2.0 * t);
        let (s, t) = (ease(u - i), ease(v - j));
        let south = node(0.0, 0.0) * (1.0 - s) + node(1.0, 0.0) * s;
        let north = node(0.0, 1.0) * (1.0 - s) + node(1.0, 1.0) * s;
        let [dark, bright] = self.between;
        dark + (bright - dark) * (south * (1.0 - t) + north * t)
    }
}

/// What became of the beams. Every beam is counted once among the first four.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// beams that gave a range
    pub returns: u64,
    /// nothing came back, for whatever reason
    pub no_return: u64,
    /// closer than the scanner measures
    pub too_close: u64,
    /// the reading fell on a sentinel
    pub erroneous: u64,
    /// of `no_return`: surface was met, but the return was lost
    pub dropped: u64,
    /// of `returns`: shorter by whole ambiguity intervals
    pub wrapped: u64,
    /// of `returns`: made of more than one surface
    pub mixed: u64,
}

impl Tally {
    /// Adds another tally.
    pub fn add(&mut self, other: &Tally) {
        self.returns += other.returns;
        self.no_return += other.no_return;
        self.too_close += other.too_close;
        self.erroneous += other.erroneous;
        self.dropped += other.dropped;
        self.wrapped += other.wrapped;
        self.mixed += other.mixed;
    }
}

/// A complete line of one sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// running number of the sweep
    pub sweep: u32,
    /// line within it
    pub line: u16,
    /// time of column 0 \[µs\]
    pub stamp_us: u64,
    /// counts and sentinels as sent
    pub ranges: Vec<u16>,
    /// reflectances as sent
    pub reflectances: Vec<u16>,
    /// true readings \[m\], NaN where the beam meets nothing
    pub truth: Vec<f64>,
    /// what became of the beams
    pub tally: Tally,
}

/// A scanner on a robot on a terrain.
#[derive(Clone)]
pub struct Scanner {
    /// the device
    pub device: Device,
    /// who carries it
    pub robot: Robot,
    /// what is simulated
    pub effects: Effects,
    /// how bright the ground is
    pub albedo: Albedo,
    /// decides everything random
    pub seed: u64,
    mount: Isometry3<f64>,
    beams: Arc<[Beam]>,
}

/// One sub-beam's echo.
#[derive(Clone, Copy, Debug)]
struct Echo {
    reading: f64,
    /// cosine of incidence
    cosine: f64,
    /// where, on the map
    place: [f64; 2],
}

/// What the nominal beams of a line meet.
struct Met {
    line: u16,
    echoes: Vec<Option<Echo>>,
}

impl Met {
    /// True reading \[m\], NaN for nothing.
    fn truth(&self, column: usize) -> f64 {
        self.echoes[column].map_or(f64::NAN, |echo| echo.reading)
    }
}

/// A reading before it becomes a count.
struct Reading {
    range: f64,
    /// part of the full scale
    signal: f64,
    mixed: bool,
}

/// Why there is none.
enum Lost {
    Nothing,
    Dropped,
}

impl Scanner {
    /// A scanner with all effects.
    pub fn new(device: Device, robot: Robot, seed: u64) -> Self {
        let d = &device.description;
        let all = (0..d.lines).flat_map(|line| (0..d.columns).map(move |column| (line, column)));
        let beams = all.map(|(line, column)| {
            let (azimuth, inclination) = device.angles(line, column);
            device.beam(azimuth, inclination)
        });
        Scanner {
            mount: device.mount(),
            beams: beams.collect(),
            device,
            robot,
            effects: Effects::ALL,
            albedo: Albedo::default(),
            seed,
        }
    }

    /// The lines of one sweep, in the order of time.
    pub fn sweep(&self, sweep: u32) -> impl Iterator<Item = Line> + use<> {
        let scanner = self.clone();
        let last = self.device.description.lines - 1;
        let (mut above, mut next) = (None, Some(self.meet(sweep, 0)));
        std::iter::from_fn(move || {
            let this = next.take()?;
            next = (this.line < last).then(|| scanner.meet(sweep, this.line + 1));
            let line = scanner.measure(sweep, &this, [&above, &next]);
            above = Some(this);
            Some(line)
        })
    }

    /// Time of a line's first column \[µs\].
    pub fn line_stamp_us(&self, sweep: u32, line: u16) -> u64 {
        u64::from(sweep) * self.device.physics.sweep_period_us
            + u64::from(line) * u64::from(self.device.description.line_period_us)
    }

    /// Sensor in the map at a line's first column and at its end.
    fn sensor(&self, sweep: u32, line: u16) -> [Isometry3<f64>; 2] {
        let d = &self.device.description;
        let start = self.line_stamp_us(sweep, line) as f64 * 1e-6;
        let lasts = f64::from(d.columns) * f64::from(d.column_period_ns) * 1e-9;
        [start, start + lasts].map(|t| self.robot.pose(t) * self.mount)
    }

    fn sensor_at(&self, ends: &[Isometry3<f64>; 2], column: usize) -> Isometry3<f64> {
        let part = column as f64 / f64::from(self.device.description.columns);
        let [a, b] = ends;
        Isometry3::from_parts(
            Translation3::from(a.translation.vector.lerp(&b.translation.vector, part)),
            a.rotation.nlerp(&b.rotation, part),
        )
    }

    fn cast(&self, sensor: &Isometry3<f64>, beam: &Beam) -> Option<Echo> {
        let physics = &self.device.physics;
        let reach = physics.reference_range / physics.threshold.sqrt();
        let ray = Ray {
            origin: sensor.translation.vector + sensor.rotation * beam.origin,
            direction: sensor.rotation * beam.direction,
        };
        let hit = self.robot.terrain.cast(&ray, reach)?;
        let place = ray.at(hit.distance);
        Some(Echo {
            reading: hit.distance - beam.shift,
            cosine: (-hit.normal.dot(&ray.direction)).max(0.0),
            place: [place.x, place.y],
        })
    }

    /// Part of the full scale that an echo contributes.
    fn signal(&self, echo: &Echo) -> f64 {
        let albedo = self.albedo.at(echo.place[0], echo.place[1], self.seed);
        albedo * echo.cosine * self.falloff(echo.reading)
    }

    fn meet(&self, sweep: u32, line: u16) -> Met {
        let ends = self.sensor(sweep, line);
        let columns = usize::from(self.device.description.columns);
        let beams = &self.beams[usize::from(line) * columns..][..columns];
        let echo = |(column, beam)| self.cast(&self.sensor_at(&ends, column), beam);
        Met {
            line,
            echoes: beams.iter().enumerate().map(echo).collect(),
        }
    }

    fn measure(&self, sweep: u32, this: &Met, beside: [&Option<Met>; 2]) -> Line {
        let mut random = Random::part(self.seed, u64::from(sweep), u64::from(this.line));
        let ends = self.sensor(sweep, this.line);
        let mut line = Line {
            sweep,
            line: this.line,
            stamp_us: self.line_stamp_us(sweep, this.line),
            ranges: Vec::with_capacity(this.echoes.len()),
            reflectances: Vec::with_capacity(this.echoes.len()),
            truth: (0..this.echoes.len()).map(|c| this.truth(c)).collect(),
            tally: Tally::default(),
        };
        for (column, nominal) in this.echoes.iter().enumerate() {
            let split = self.effects.mixed_pixels && beside_edge(this, beside, column);
            let reading = if split || self.effects.noise {
                let sensor = self.sensor_at(&ends, column);
                let beam = (this.line, column as u16);
                let echoes = self.echoes(&sensor, beam, split, &mut random);
                self.read(&echoes, &mut random)
            } else {
                self.read(&[*nominal], &mut random)
            };
            self.note(reading, &mut line);
        }
        line
    }

    /// The echoes of one beam, or of its five parts.
    fn echoes(
        &self,
        sensor: &Isometry3<f64>,
        (line, column): (u16, u16),
        split: bool,
        random: &mut Random,
    ) -> Vec<Option<Echo>> {
        let physics = &self.device.physics;
        let nominal = self.device.angles(line, column);
        let mut error = || match self.effects.noise {
            true => physics.angle_noise * random.normal(),
            false => 0.0,
        };
        let (azimuth, inclination) = (nominal.0 + error(), nominal.1 + error());
        let half = physics.beam_width / 2.0;
        let parts = [
            (0.0, 0.0),
            (half, 0.0),
            (-half, 0.0),
            (0.0, half),
            (0.0, -half),
        ];
        let parts = &parts[..if split { 5 } else { 1 }];
        let part = |&(a, b): &(f64, f64)| {
            self.cast(sensor, &self.device.beam(azimuth + a, inclination + b))
        };
        parts.iter().map(part).collect()
    }

    fn falloff(&self, range: f64) -> f64 {
        (self.device.physics.reference_range / range)
            .powi(2)
            .min(1.0)
    }

    /// Adds the echoes up, and the noise.
    fn read(&self, echoes: &[Option<Echo>], random: &mut Random) -> Result<Reading, Lost> {
        let physics = &self.device.physics;
        let first = echoes.iter().flatten().next().ok_or(Lost::Nothing)?.reading;
        let (mut sine, mut cosine, mut mean) = (0.0, 0.0, 0.0);
        let mut mixed = false;
        let turn = TAU / self.device.interval();
        for echo in echoes.iter().flatten() {
            let signal = self.signal(echo) / echoes.len() as f64;
            let farther = echo.reading - first;
            let (s, c) = (turn * farther).sin_cos();
            (sine, cosine, mean) = (
                sine + signal * s,
                cosine + signal * c,
                mean + signal * farther,
            );
            mixed |= farther.abs() > JUMP;
        }
        // a phase measurement sees the phasor, a pulsed one the middle of the pulses
        let (signal, farther) = match physics.wraps {
            true => (sine.hypot(cosine), sine.atan2(cosine) / turn),
            false => (cosine, mean / cosine),
        };
        let lost = signal < physics.threshold || random.chance(physics.drop_out);
        if self.effects.drop_outs && lost {
            return Err(Lost::Dropped);
        }
        let farther = if signal > 0.0 { farther } else { 0.0 };
        let range = first + farther + self.range_error(first + farther, signal, random);
        Ok(Reading {
            range,
            signal,
            mixed,
        })
    }

    fn range_error(&self, range: f64, signal: f64, random: &mut Random) -> f64 {
        if !self.effects.noise {
            return 0.0;
        }
        let physics = &self.device.physics;
        let brightness = (signal / self.falloff(range)).max(1e-3);
        let growing = physics.noise_per_m * range;
        let variance = physics.noise_m.powi(2) + growing.powi(2) * TYPICAL_BRIGHTNESS / brightness;
        variance.sqrt() * random.normal()
    }

    /// Turns a reading into codes and counts it.
    fn note(&self, reading: Result<Reading, Lost>, line: &mut Line) {
        let largest = self.device.largest_code();
        let tally = &mut line.tally;
        let (range, reflectance) = match reading {
            Err(lost) => {
                tally.no_return += 1;
                tally.dropped += u64::from(matches!(lost, Lost::Dropped));
                (largest - range_code::NO_RETURN, 0)
            }
            Ok(reading) => {
                let reflectance = (reading.signal * f64::from(largest)).round();
                let code = self.code(&reading, tally);
                (code, reflectance.min(f64::from(largest)) as u16)
            }
        };
        line.ranges.push(range);
        line.reflectances.push(reflectance);
    }

    fn code(&self, reading: &Reading, tally: &mut Tally) -> u16 {
        let device = &self.device;
        let largest = device.largest_code();
        let wraps = device.physics.wraps && self.effects.wrap;
        if reading.range < f64::from(device.description.range_min_m) {
            tally.too_close += 1;
            return largest - range_code::TOO_CLOSE;
        }
        let farthest = f64::from(device.description.range_max_m);
        if !wraps && reading.range > farthest {
            tally.no_return += 1;
            return largest - range_code::NO_RETURN;
        }
        let (count, codes) = (
            (reading.range / device.metres_per_count()).round() as u64,
            u64::from(largest) + 1,
        );
        let code = (count % codes) as u16;
        if code >= device.first_sentinel() {
            tally.erroneous += 1;
            return largest - range_code::ERRONEOUS;
        }
        tally.returns += 1;
        tally.wrapped += u64::from(count >= codes);
        tally.mixed += u64::from(reading.mixed);
        code
    }
}

/// Does the true range jump between this beam and one of its four neighbours?
fn beside_edge(this: &Met, beside: [&Option<Met>; 2], column: usize) -> bool {
    let here = this.truth(column);
    let sides = [column.checked_sub(1), Some(column + 1)];
    let sides = sides
        .into_iter()
        .flatten()
        .filter(|&c| c < this.echoes.len());
    let along = sides.map(|c| this.truth(c));
    let across = beside.into_iter().flatten().map(|met| met.truth(column));
    // the end of the terrain (NaN on one side) is an edge too
    along
        .chain(across)
        .any(|there| here.is_nan() != there.is_nan() || (here - there).abs() > JUMP)
}

#[cfg(test)]
#[path = "scanner_tests.rs"]
mod tests;
