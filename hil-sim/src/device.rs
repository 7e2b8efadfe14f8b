//! What a simulated scanner is: its description on the link, and the physics behind it.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rugosa_wire::{BeamModel, Packing, ScannerDescription, TableKind, range_code, table_bit};

use crate::geometry::{Beam, beam};

/// Most likely product of albedo and cosine of incidence on natural ground; the stated
/// noise is that of such a return.
pub const TYPICAL_BRIGHTNESS: f64 = 0.25;

/// What the description does not tell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Physics {
    /// standard deviation of a range, constant part \[m\]
    pub noise_m: f64,
    /// standard deviation of a range per metre of range, at [`TYPICAL_BRIGHTNESS`]
    pub noise_per_m: f64,
    /// standard deviation of a beam's azimuth and inclination \[rad\]
    pub angle_noise: f64,
    /// full width of a beam \[rad\]
    pub beam_width: f64,
    /// range up to which a white surface seen head-on fills the reflectance scale \[m\]
    pub reference_range: f64,
    /// smallest signal (1 = full scale) that makes a return
    pub threshold: f64,
    /// part of the returns that are lost for no reason
    pub drop_out: f64,
    /// readings start at 0 again after the longest count (phase measurement)
    pub wraps: bool,
    /// time from sweep to sweep \[µs\]
    pub sweep_period_us: u64,
}

/// A scanner.
#[derive(Clone, Debug, PartialEq)]
pub struct Device {
    /// name for the greeting
    pub name: &'static str,
    /// as sent over the link
    pub description: ScannerDescription,
    /// angles that are not on the raster, µrad, complete
    pub tables: Vec<(TableKind, Vec<i32>)>,
    /// bits per count
    pub packing: Packing,
    /// what the description does not tell
    pub physics: Physics,
}

impl Device {
    /// Phase-measuring scanner with two mirrors as on walking robots of the early
    /// 1990s: 60° × 60°, 256 × 256, two images a second, ambiguity interval 40 m, 12 bits
    /// of range and of reflectance; 2.2 m above the ground, 35° nose down.
    pub fn perceptron() -> Self {
        let metres_per_count = 40.0 / 4096.0;
        let physics = Physics {
            noise_m: 0.005,
            noise_per_m: 0.001,
            angle_noise: 200e-6,
            beam_width: 2e-3,
            reference_range: 10.0,
            threshold: 0.002,
            drop_out: 0.001,
            wraps: true,
            sweep_period_us: 500_000,
        };
        let model = BeamModel::Perceptron {
            h1_m: 0.03,
            h2_m: 0.055,
            gamma_urad: 785_398,
            theta_urad: 785_398,
            standoff_counts: 0.0,
        };
        let raster = Raster::centred(256, 256, 60.0, 60.0);
        let mut description = raster.describe(model, metres_per_count, &physics);
        description.range_min_m = 0.5;
        description.range_max_m = (4092.0 * metres_per_count) as f32;
        description.column_period_ns = 7_600;
        description.line_period_us = 1_953;
        let mut device = Device {
            name: "simulated Perceptron",
            description,
            tables: Vec::new(),
            packing: Packing::Bits12,
            physics,
        };
        device.set_mount([0.0, 0.0, 2.2], 35.0);
        device
    }

    /// Spinning pulsed lidar: 64 rings × 1024 columns, ±45°, 10 revolutions a second,
    /// 16 bits of 1 mm, rings unevenly spaced and staggered in azimuth; 0.8 m up, level.
    pub fn lidar() -> Self {
        let physics = Physics {
            noise_m: 0.008,
            noise_per_m: 0.0005,
            angle_noise: 150e-6,
            beam_width: 3e-3,
            reference_range: 15.0,
            threshold: 0.01,
            drop_out: 0.002,
            wraps: false,
            sweep_period_us: 100_000,
        };
        let raster = Raster {
            columns: 1024,
            lines: 64,
            azimuth: [180.0, -360.0 / 1024.0],
            inclination: [44.3, -88.6 / 63.0],
        };
        let mut description = raster.describe(BeamModel::Spherical, 0.001, &physics);
        description.tables = table_bit::INCLINATION | table_bit::AZIMUTH_OFFSET;
        description.range_min_m = 0.3;
        description.range_max_m = 60.0;
        description.column_period_ns = 97_656;
        let uneven = |ring: i32| {
            let bow = f64::from((ring - 32) * (ring - 32) - 341) * 0.002;
            ((44.3 - 88.6 / 63.0 * f64::from(ring) + bow).to_radians() * 1e6) as i32
        };
        let stagger = |ring: i32| (f64::from(3 - 2 * (ring % 4)).to_radians() * 1e6) as i32;
        let mut device = Device {
            name: "simulated lidar",
            description,
            tables: vec![
                (TableKind::Inclination, (0..64).map(uneven).collect()),
                (TableKind::AzimuthOffset, (0..64).map(stagger).collect()),
            ],
            packing: Packing::Bits16,
            physics,
        };
        device.set_mount([0.0, 0.0, 0.8], 0.0);
        device
    }

    /// Fewer, equally spaced lines and columns over the same field of view; for tests
    /// and slow links. Devices with tables keep their lines.
    pub fn thinned(mut self, lines: u16, columns: u16) -> Self {
        let d = &mut self.description;
        let lines = if self.tables.is_empty() {
            lines
        } else {
            d.lines
        };
        let (by_line, by_column) = (
            f64::from(d.lines) / f64::from(lines),
            f64::from(d.columns) / f64::from(columns),
        );
        let stretch = |first: &mut i32, step: &mut i32, factor: f64| {
            let old = f64::from(*step);
            *step = (old * factor).round() as i32;
            *first += ((f64::from(*step) - old) * 0.5e-3).round() as i32;
        };
        stretch(
            &mut d.azimuth_first_urad,
            &mut d.azimuth_step_nrad,
            by_column,
        );
        stretch(
            &mut d.inclination_first_urad,
            &mut d.inclination_step_nrad,
            by_line,
        );
        d.column_period_ns = (f64::from(d.column_period_ns) * by_column) as u32;
        d.line_period_us = (f64::from(d.line_period_us) * by_line) as u32;
        (d.lines, d.columns) = (lines, columns);
        self
    }

    /// Sets where the sensor sits in the body frame \[m\] and how far it looks down \[°\].
    pub fn set_mount(&mut self, position: [f32; 3], nose_down_degrees: f64) {
        let turn =
            UnitQuaternion::from_axis_angle(&Vector3::y_axis(), nose_down_degrees.to_radians());
        let c = turn.coords;
        self.description.mount_position_m = position;
        self.description.mount_orientation = [c.x as f32, c.y as f32, c.z as f32, c.w as f32];
    }

    /// The sensor in the body frame.
    pub fn mount(&self) -> Isometry3<f64> {
        let [x, y, z] = self.description.mount_position_m.map(f64::from);
        let [i, j, k, w] = self.description.mount_orientation.map(f64::from);
        Isometry3::from_parts(
            Translation3::new(x, y, z),
            UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k)),
        )
    }

    /// Azimuth and inclination of a beam \[rad\], as the link describes them.
    pub fn angles(&self, line: u16, column: u16) -> (f64, f64) {
        let d = &self.description;
        let raster = |first: i32, step: i32, index: u16| {
            f64::from(first) * 1e-6 + f64::from(step) * 1e-9 * f64::from(index)
        };
        let table = |kind: TableKind, index: u16| {
            let (_, angles) = self.tables.iter().find(|(k, _)| *k == kind)?;
            Some(f64::from(angles[usize::from(index)]) * 1e-6)
        };
        let azimuth = table(TableKind::Azimuth, column)
            .unwrap_or_else(|| raster(d.azimuth_first_urad, d.azimuth_step_nrad, column));
        let inclination = table(TableKind::Inclination, line)
            .unwrap_or_else(|| raster(d.inclination_first_urad, d.inclination_step_nrad, line));
        let offset = table(TableKind::AzimuthOffset, line).unwrap_or(0.0);
        (azimuth + offset, inclination)
    }

    /// The beam at an azimuth and an inclination \[rad\].
    pub fn beam(&self, azimuth: f64, inclination: f64) -> Beam {
        beam(
            &self.description.model,
            self.metres_per_count(),
            azimuth,
            inclination,
        )
    }

    /// Length of a count \[m\].
    pub fn metres_per_count(&self) -> f64 {
        f64::from(self.description.metres_per_count)
    }

    /// The largest code, [`range_code::NO_RETURN`].
    pub fn largest_code(&self) -> u16 {
        match self.packing {
            Packing::Bits12 => 0xFFF,
            Packing::Bits16 => 0xFFFF,
        }
    }

    /// Readings that differ by this are the same phase \[m\].
    pub fn interval(&self) -> f64 {
        (f64::from(self.largest_code()) + 1.0) * self.metres_per_count()
    }

    /// The first code that is not a range.
    pub fn first_sentinel(&self) -> u16 {
        self.largest_code() - range_code::ERRONEOUS
    }
}

/// Angles in degrees: first and step.
struct Raster {
    columns: u16,
    lines: u16,
    azimuth: [f64; 2],
    inclination: [f64; 2],
}

impl Raster {
    /// Column 0 on the left, line 0 on top, the middle straight ahead.
    fn centred(columns: u16, lines: u16, width: f64, height: f64) -> Self {
        let axis = |n: u16, field: f64| {
            let n = f64::from(n);
            [field * (n - 1.0) / (2.0 * n), -field / n]
        };
        Raster {
            columns,
            lines,
            azimuth: axis(columns, width),
            inclination: axis(lines, height),
        }
    }

    fn describe(
        &self,
        model: BeamModel,
        metres_per_count: f64,
        physics: &Physics,
    ) -> ScannerDescription {
        let urad = |degrees: f64| (degrees.to_radians() * 1e6).round() as i32;
        let nrad = |degrees: f64| (degrees.to_radians() * 1e9).round() as i32;
        // rounding to whole counts is uniform noise of variance 1/12
        let noise = (physics.noise_m.powi(2) + metres_per_count.powi(2) / 12.0).sqrt();
        ScannerDescription {
            model,
            columns: self.columns,
            lines: self.lines,
            azimuth_first_urad: urad(self.azimuth[0]),
            azimuth_step_nrad: nrad(self.azimuth[1]),
            inclination_first_urad: urad(self.inclination[0]),
            inclination_step_nrad: nrad(self.inclination[1]),
            tables: 0,
            metres_per_count: metres_per_count as f32,
            range_min_m: 0.0,
            range_max_m: 0.0,
            range_noise_m: noise as f32,
            range_noise_per_m: physics.noise_per_m as f32,
            angle_noise_urad: (physics.angle_noise * 1e6).round() as u32,
            column_period_ns: 0,
            line_period_us: 0,
            mount_position_m: [0.0; 3],
            mount_orientation: [0.0, 0.0, 0.0, 1.0],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_raster_covers_its_field_evenly() {
        let device = Device::perceptron();
        let (left, top) = device.angles(0, 0);
        let (right, bottom) = device.angles(255, 255);
        let edge = (30.0 * 255.0 / 256.0f64).to_radians();
        for (angle, wanted) in [(left, edge), (top, edge), (right, -edge), (bottom, -edge)] {
            assert!((angle - wanted).abs() < 1e-6, "{angle} {wanted}");
        }
    }

    #[test]
    fn thinning_keeps_the_field() {
        let thin = Device::perceptron().thinned(64, 32);
        let (left, top) = thin.angles(0, 0);
        let (right, bottom) = thin.angles(63, 31);
        assert!((left + right).abs() < 2e-6 && (top + bottom).abs() < 2e-6);
        assert!((left - (30.0 * 31.0 / 32.0f64).to_radians()).abs() < 2e-6);
        assert!((top - (30.0 * 63.0 / 64.0f64).to_radians()).abs() < 2e-6);
    }

    #[test]
    fn the_mount_looks_down() {
        let ahead = Device::perceptron().mount() * Vector3::x();
        assert!((ahead.z + 35f64.to_radians().sin()).abs() < 1e-6 && ahead.x > 0.8);
    }

    #[test]
    fn tables_override_the_raster() {
        let lidar = Device::lidar();
        let (a0, i0) = lidar.angles(0, 5);
        let (a1, _) = lidar.angles(1, 5);
        assert!((a0 - a1 - 2f64.to_radians()).abs() < 1e-5);
        assert!(i0 > lidar.angles(1, 5).1 && i0.abs() < 1.0);
    }
}
