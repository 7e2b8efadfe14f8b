//! From messages in raw device units to SI: the only file where units change.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use rugosa_grid::math;
use rugosa_terrain::{
    Beams, Geometry, LineTrig, Noise, PerceptronConstants, RangeLimits, Raster, Trig,
};
use rugosa_wire::{BeamModel, BeamTable, PoseStamp, Reading, ScannerDescription, TableKind};

const MICRO: f32 = 1e-6;
const NANO: f32 = 1e-9;

/// The scanner as it described itself.
pub(crate) struct Scanner<'m> {
    pub(crate) beams: Beams<'m>,
    pub(crate) noise: Noise,
    pub(crate) limits: RangeLimits,
    /// body ← sensor
    pub(crate) mount: Isometry3<f32>,
    description: Option<ScannerDescription>,
    /// table entries that have come, by kind
    arrived: [u16; 3],
}

/// Why a description or a table was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DescriptionError {
    /// more columns or lines than the tables hold, or none
    Raster,
    /// a number that is not finite, not positive where it must be, or no rotation
    Value,
    /// a piece of a table out of turn or outside the raster
    Table,
}

impl<'m> Scanner<'m> {
    pub(crate) fn unknown(columns: &'m mut [Trig], lines: &'m mut [LineTrig]) -> Self {
        Scanner {
            beams: Beams::unknown(columns, lines),
            noise: Noise::new(0.0, 0.0, 0.0),
            limits: RangeLimits { min: 0.0, max: 0.0 },
            mount: Isometry3::identity(),
            description: None,
            arrived: [0; 3],
        }
    }

    /// The description, once all tables it announced are complete.
    pub(crate) fn ready(&self) -> Option<&ScannerDescription> {
        let description = self.description.as_ref()?;
        let complete = KINDS.iter().enumerate().all(|(i, &kind)| {
            description.tables & (1 << i) == 0 || self.arrived[i] >= entries(description, kind)
        });
        complete.then_some(description)
    }

    /// Takes a description; the same one again changes nothing.
    pub(crate) fn describe(&mut self, new: &ScannerDescription) -> Result<(), DescriptionError> {
        if self.description.as_ref() == Some(new) {
            return Ok(());
        }
        let mount = pose(&new.mount_position_m, &new.mount_orientation);
        let mount = mount.ok_or(DescriptionError::Value)?;
        if !values_are_sound(new) {
            return Err(DescriptionError::Value);
        }
        let size = [usize::from(new.columns), usize::from(new.lines)];
        if size.contains(&0) || !self.beams.describe(geometry(new), raster(new), size) {
            return Err(DescriptionError::Raster);
        }
        self.mount = mount;
        self.noise = Noise::new(
            new.range_noise_m,
            new.range_noise_per_m,
            new.angle_noise_urad as f32 * MICRO,
        );
        self.limits = RangeLimits {
            min: new.range_min_m,
            max: new.range_max_m,
        };
        self.description = Some(new.clone());
        self.arrived = [0; 3];
        Ok(())
    }

    /// Takes a piece of a table; pieces come in order and may come again.
    pub(crate) fn table(&mut self, table: &BeamTable) -> Result<(), DescriptionError> {
        let description = self.description.as_ref().ok_or(DescriptionError::Table)?;
        let kind = table.kind as usize;
        let end = usize::from(table.first) + table.angles_urad.len();
        let fits = end <= usize::from(entries(description, table.kind));
        if !fits || table.first > self.arrived[kind] {
            return Err(DescriptionError::Table);
        }
        for (i, &angle_urad) in table.angles_urad.iter().enumerate() {
            let at = usize::from(table.first) + i;
            let angle = angle_urad as f32 * MICRO;
            match table.kind {
                TableKind::Inclination => self.beams.set_inclination(at, angle),
                TableKind::AzimuthOffset => self.beams.set_azimuth_offset(at, angle),
                TableKind::Azimuth => self.beams.set_azimuth(at, angle),
            };
        }
        self.arrived[kind] = self.arrived[kind].max(end as u16);
        Ok(())
    }
}

const KINDS: [TableKind; 3] = [
    TableKind::Inclination,
    TableKind::AzimuthOffset,
    TableKind::Azimuth,
];

fn entries(description: &ScannerDescription, kind: TableKind) -> u16 {
    match kind {
        TableKind::Azimuth => description.columns,
        _ => description.lines,
    }
}

fn geometry(description: &ScannerDescription) -> Geometry {
    match description.model {
        BeamModel::Spherical => Geometry::Spherical,
        BeamModel::Perceptron {
            h1_m,
            h2_m,
            gamma_urad,
            theta_urad,
            standoff_counts,
        } => Geometry::Perceptron(PerceptronConstants {
            h1: h1_m,
            h2: h2_m,
            gamma: gamma_urad as f32 * MICRO,
            theta: theta_urad as f32 * MICRO,
            standoff: standoff_counts * description.metres_per_count,
        }),
    }
}

fn raster(description: &ScannerDescription) -> Raster {
    let (azimuth, inclination) = (
        description.azimuth_first_urad as f32 * MICRO,
        description.inclination_first_urad as f32 * MICRO,
    );
    Raster {
        azimuth: [azimuth, description.azimuth_step_nrad as f32 * NANO],
        inclination: [inclination, description.inclination_step_nrad as f32 * NANO],
    }
}

fn values_are_sound(d: &ScannerDescription) -> bool {
    let positive = [d.metres_per_count, d.range_max_m];
    let not_negative = [d.range_min_m, d.range_noise_m, d.range_noise_per_m];
    positive.iter().all(|x| x.is_finite() && *x > 0.0)
        && not_negative.iter().all(|x| x.is_finite() && *x >= 0.0)
        && d.range_min_m < d.range_max_m
}

/// The pose of these numbers, where they are one.
pub(crate) fn pose(position_m: &[f32; 3], orientation: &[f32; 4]) -> Option<Isometry3<f32>> {
    let [x, y, z, w] = *orientation;
    let length2 = x * x + y * y + z * z + w * w;
    let sound = position_m.iter().all(|p| p.is_finite()) && math::abs(length2 - 1.0) < 0.02;
    sound.then(|| {
        let scale = 1.0 / math::sqrt(length2);
        let turn = Quaternion::new(w * scale, x * scale, y * scale, z * scale);
        Isometry3::from_parts(
            Translation3::new(position_m[0], position_m[1], position_m[2]),
            UnitQuaternion::new_unchecked(turn),
        )
    })
}

/// The pose of a stamp, where its numbers are one.
pub(crate) fn pose_of(stamp: &PoseStamp) -> Option<Isometry3<f32>> {
    pose(&stamp.position_m, &stamp.orientation)
}

/// A range sample in metres; sentinels after REP-117.
#[inline]
pub(crate) fn range(reading: Reading, metres_per_count: f32) -> f32 {
    match reading {
        Reading::Counts(counts) => f32::from(counts) * metres_per_count,
        Reading::NoReturn => f32::INFINITY,
        Reading::TooClose => f32::NEG_INFINITY,
        Reading::Erroneous => f32::NAN,
    }
}
