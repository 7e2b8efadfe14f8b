//! A recorded scan of a forest floor by a lidar of 128 × 1024 beams, as messages.
//!
//! The scan is the raw two-angle data of a spinning lidar: each ring has an inclination
//! and an azimuth offset of its own, each column an encoder angle. The robot stood still.

use crate::data_file;
use anyhow::{Context, Result};
use npyz::npz::NpzArchive;
use rugosa_wire::{
    BeamModel, BeamTable, MAX_RETURNS, MAX_TABLE, Message, Packing, PoseStamp, Reading, ScanLine,
    ScannerDescription, SweepEnd, TableKind, table_bit,
};

const RINGS: usize = 128;
const COLUMNS: usize = 1024;
/// Height of the sensor above the body's origin \[m\], and its yaw \[rad\].
const MOUNT_HEIGHT: f32 = 0.41;
const MOUNT_YAW: f32 = 0.75 * std::f32::consts::PI;
const COLUMN_PERIOD_NS: u32 = 97_656;

/// The scan, ring by ring.
pub struct RealScan {
    range_mm: Vec<u16>,
    inclination_deg: Vec<f64>,
    azimuth_offset_deg: Vec<f64>,
    azimuth_deg: Vec<f64>,
}

impl RealScan {
    /// Reads the scan; `None`, after a loud line, where the data is not at hand.
    pub fn read() -> Result<Option<RealScan>> {
        let Some(path) = data_file("scan_ctu_marv_os0_128/ctu_marv_os0_128_sensor.npz") else {
            return Ok(None);
        };
        let mut archive = NpzArchive::open(path)?;
        let mut angles = |name: &str| -> Result<Vec<f64>> {
            let array = archive.by_name(name)?.context("array missing")?;
            match array.dtype().descr().as_str() {
                "'<f4'" => Ok(array
                    .into_vec::<f32>()?
                    .into_iter()
                    .map(f64::from)
                    .collect()),
                _ => Ok(array.into_vec::<f64>()?),
            }
        };
        Ok(Some(RealScan {
            inclination_deg: angles("ring_elevation_deg")?,
            azimuth_offset_deg: angles("ring_azimuth_offset_deg")?,
            azimuth_deg: angles("column_encoder_deg")?,
            range_mm: archive
                .by_name("range_mm")?
                .context("range_mm missing")?
                .into_vec::<u16>()?,
        }))
    }

    /// What a receiver must know before the first line.
    pub fn description(&self) -> Vec<Message> {
        let half = 0.5 * MOUNT_YAW;
        let scanner = ScannerDescription {
            model: BeamModel::Spherical,
            columns: COLUMNS as u16,
            lines: RINGS as u16,
            azimuth_first_urad: 0,
            azimuth_step_nrad: 0,
            inclination_first_urad: 0,
            inclination_step_nrad: 0,
            tables: table_bit::INCLINATION | table_bit::AZIMUTH_OFFSET | table_bit::AZIMUTH,
            metres_per_count: 0.001,
            range_min_m: 0.3,
            range_max_m: 60.0,
            range_noise_m: 0.01,
            range_noise_per_m: 0.001,
            angle_noise_urad: 200,
            column_period_ns: COLUMN_PERIOD_NS,
            line_period_us: 0,
            mount_position_m: [0.0, 0.0, MOUNT_HEIGHT],
            mount_orientation: [0.0, 0.0, half.sin(), half.cos()],
        };
        let mut messages = vec![Message::Scanner(scanner)];
        for (kind, angles) in [
            (TableKind::Inclination, &self.inclination_deg),
            (TableKind::AzimuthOffset, &self.azimuth_offset_deg),
            (TableKind::Azimuth, &self.azimuth_deg),
        ] {
            for (piece, angles) in angles.chunks(MAX_TABLE).enumerate() {
                messages.push(Message::BeamTable(BeamTable {
                    kind,
                    first: (piece * MAX_TABLE) as u16,
                    angles_urad: angles
                        .iter()
                        .map(|a| (a.to_radians() * 1e6).round() as i32)
                        .collect(),
                }));
            }
        }
        messages
    }

    /// One sweep: poses before and after, all rings in segments, the end.
    pub fn sweep(&self, number: u32) -> Vec<Message> {
        let start_us = 100_000 * u64::from(number);
        let mut messages = vec![pose(start_us), pose(start_us + 100_001)];
        for column in (0..COLUMNS).step_by(MAX_RETURNS) {
            for ring in 0..RINGS {
                messages.push(Message::Line(self.segment(number, ring, column)));
            }
        }
        messages.push(Message::SweepEnd(SweepEnd {
            sweep: number,
            stamp_us: start_us + 100_000,
            lines: (RINGS * COLUMNS / MAX_RETURNS) as u16,
        }));
        messages
    }

    fn segment(&self, sweep: u32, ring: usize, column: usize) -> ScanLine {
        let first = ring * COLUMNS + column;
        let counts = self.range_mm[first..first + MAX_RETURNS].iter();
        let code = |&mm: &u16| match mm {
            0 => Packing::Bits16.code(Reading::NoReturn),
            mm => Packing::Bits16.code(Reading::Counts(mm)),
        };
        ScanLine {
            sweep,
            line: ring as u16,
            first_column: column as u16,
            stamp_us: 100_000 * u64::from(sweep)
                + column as u64 * u64::from(COLUMN_PERIOD_NS) / 1000,
            returns: MAX_RETURNS as u16,
            packing: Packing::Bits16,
            ranges: Packing::Bits16.pack(counts.map(code)).unwrap_or_default(),
            reflectances: Default::default(),
        }
    }
}

fn pose(stamp_us: u64) -> Message {
    Message::Pose(PoseStamp {
        stamp_us,
        position_m: [0.0; 3],
        orientation: [0.0, 0.0, 0.0, 1.0],
    })
}
