//! GeoTIFF: one band of heights with its place.
//!
//! The upper row of the file is the greatest y. Pixels are areas unless the file says
//! that they are points; the nodes of the raster are their centres. `GDAL_NODATA` and
//! NaN are unknown. Rotated images, geographic coordinates (degrees) and linear units
//! other than the metre are refused. An image without a place needs `--spacing`; its
//! lower left node then lies at the origin.

use super::{Raster, Spacing, open};
use crate::error::{Failure, Result};
use std::io::{Read, Seek};
use std::path::Path;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;

/// Most bytes of a decoded image.
const MOST_BYTES: usize = 2 << 30;
/// Geo keys: model type, raster type, linear unit.
const MODEL: u16 = 1024;
const RASTER: u16 = 1025;
const UNIT: u16 = 3076;

/// Reads the first image of the file.
pub fn read(path: &Path, spacing: Option<Spacing>) -> Result<Raster> {
    let (file, _) = open(path)?;
    let damaged = |e: tiff::TiffError| Failure::file(path, e);
    let mut limits = Limits::default();
    limits.decoding_buffer_size = MOST_BYTES;
    let mut tiff = Decoder::new(file).map_err(damaged)?.with_limits(limits);
    let (columns, rows) = tiff.dimensions().map_err(damaged)?;
    let (columns, rows) = (columns as usize, rows as usize);
    let place = Place::of(&mut tiff, spacing, rows).map_err(|e| Failure::file(path, e))?;
    let nodata = tiff.get_tag_ascii_string(Tag::GdalNodata).ok();
    let nodata = nodata.and_then(|text| text.trim_matches(['\0', ' ']).parse::<f64>().ok());
    let values = heights(tiff.read_image().map_err(damaged)?);
    let values = values.ok_or_else(|| Failure::file(path, "pixels are not plain numbers"))?;
    if values.len() != rows * columns || rows < 2 || columns < 2 {
        let message = format_args!(
            "{rows} × {columns} pixels, {} values: one band of at least 2 × 2 is needed",
            values.len()
        );
        return Err(Failure::file(path, message));
    }
    let known = |&v: &f64| match nodata {
        _ if !v.is_finite() => f32::NAN,
        Some(nodata) if v == nodata || v as f32 == nodata as f32 => f32::NAN,
        _ => v as f32,
    };
    Ok(Raster {
        rows,
        columns,
        spacing_x: place.spacing[0],
        spacing_y: place.spacing[1],
        origin: place.origin,
        values: values.chunks(columns).rev().flatten().map(known).collect(),
    })
}

/// Where the raster lies.
struct Place {
    spacing: [f64; 2],
    /// the lower left node
    origin: [f64; 2],
}

impl Place {
    fn of<R: Read + Seek>(
        tiff: &mut Decoder<R>,
        spacing: Option<Spacing>,
        rows: usize,
    ) -> Result<Self, String> {
        let keys = Keys(
            tiff.get_tag_u16_vec(Tag::GeoKeyDirectoryTag)
                .unwrap_or_default(),
        );
        if keys.get(MODEL) == Some(2) {
            return Err("geographic coordinates (degrees): reproject to metres first".into());
        }
        if let Some(unit) = keys.get(UNIT).filter(|&unit| unit != 9001) {
            return Err(format!(
                "linear unit {unit}, not 9001 (metre): reproject first"
            ));
        }
        let Some(([left, top], [dx, dy])) = corner(tiff)? else {
            let spacing =
                spacing.ok_or("no place in the file: give --spacing DX[,DY] in metres")?;
            return Ok(Place {
                spacing: [spacing.x, spacing.y],
                origin: [0.0, 0.0],
            });
        };
        if let Some(spacing) = spacing {
            let off = |ours: f64, theirs: f64| (ours - theirs).abs() > 1e-6 * theirs;
            if off(spacing.x, dx) || off(spacing.y, dy) {
                return Err(format!("--spacing differs from the file's {dx} × {dy} m"));
            }
        }
        let half = if keys.get(RASTER) == Some(2) {
            0.0
        } else {
            0.5
        };
        Ok(Place {
            spacing: [dx, dy],
            origin: [left + half * dx, top - (rows as f64 - 1.0 + half) * dy],
        })
    }
}

/// Model coordinates of raster point (0, 0), and the pixels' size.
type Corner = ([f64; 2], [f64; 2]);

fn corner<R: Read + Seek>(tiff: &mut Decoder<R>) -> Result<Option<Corner>, String> {
    let scale = tiff.get_tag_f64_vec(Tag::ModelPixelScaleTag).ok();
    let tie = tiff.get_tag_f64_vec(Tag::ModelTiepointTag).ok();
    let matrix = tiff.get_tag_f64_vec(Tag::ModelTransformationTag).ok();
    let (corner, size) = match (scale.as_deref(), tie.as_deref(), matrix.as_deref()) {
        (Some([dx, dy, ..]), Some([i, j, _, x, y, ..]), _) => {
            ([x - i * dx, y + j * dy], [*dx, *dy])
        }
        (_, _, Some([a, b, _, x, d, e, _, y, ..])) => {
            if *b != 0.0 || *d != 0.0 {
                return Err("a rotated image: warp it first".into());
            }
            ([*x, *y], [*a, -e])
        }
        _ => return Ok(None),
    };
    let sound = |v: f64| v.is_finite() && v > 0.0;
    if !(size.into_iter().all(sound) && corner.iter().all(|v: &f64| v.is_finite())) {
        return Err("pixel sizes must be positive, coordinates finite".into());
    }
    Ok(Some((corner, size)))
}

/// The GeoKey directory: four numbers of head, then four per key.
struct Keys(Vec<u16>);

impl Keys {
    fn get(&self, key: u16) -> Option<u16> {
        let entries = self.0.chunks_exact(4).skip(1);
        let mut found = entries.filter(|e| e[0] == key && e[1] == 0);
        found.next().map(|e| e[3])
    }
}

fn heights(image: DecodingResult) -> Option<Vec<f64>> {
    fn all<T: Into<f64>>(values: Vec<T>) -> Option<Vec<f64>> {
        Some(values.into_iter().map(Into::into).collect())
    }
    match image {
        DecodingResult::F32(v) => all(v),
        DecodingResult::F64(v) => Some(v),
        DecodingResult::I8(v) => all(v),
        DecodingResult::I16(v) => all(v),
        DecodingResult::I32(v) => all(v),
        DecodingResult::U8(v) => all(v),
        DecodingResult::U16(v) => all(v),
        DecodingResult::U32(v) => all(v),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::geotiff::write;
    use std::path::PathBuf;
    use tiff::encoder::{TiffEncoder, colortype};

    fn raster() -> Raster {
        let mut values: Vec<f32> = (0..12).map(|v| v as f32).collect();
        values[5] = f32::NAN;
        Raster::square(3, 4, 0.5, [100.25, -20.75], values)
    }

    #[test]
    fn what_is_exported_comes_back() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.tif");
        write(&path, &raster()).unwrap();
        let back = read(&path, None).unwrap();
        assert_eq!((back.rows, back.columns), (3, 4));
        assert_eq!((back.origin, back.spacing_x), ([100.25, -20.75], 0.5));
        let bits = |r: &Raster| r.values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&back), bits(&raster()));
        let error = read(&path, Some("0.4".parse().unwrap())).unwrap_err();
        assert!(error.message.contains("--spacing differs"), "{error}");
    }

    fn encoded(keys: &[u16], nodata: Option<&str>) -> (tempfile::TempDir, PathBuf) {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.tif");
        let mut tiff = TiffEncoder::new(std::fs::File::create(&path).unwrap()).unwrap();
        let mut image = tiff.new_image::<colortype::GrayI16>(2, 2).unwrap();
        let tags = image.encoder();
        if !keys.is_empty() {
            tags.write_tag(Tag::ModelPixelScaleTag, &[2.0, 3.0, 0.0][..])
                .unwrap();
            tags.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, 10.0, 20.0, 0.0][..])
                .unwrap();
            tags.write_tag(Tag::GeoKeyDirectoryTag, keys).unwrap();
        }
        if let Some(nodata) = nodata {
            tags.write_tag(Tag::GdalNodata, nodata).unwrap();
        }
        image.write_data(&[1, 2, 3, -9999]).unwrap();
        (directory, path)
    }

    #[test]
    fn points_and_areas_integers_and_holes() {
        let point = [1, 1, 0, 1, RASTER, 0, 1, 2];
        let (_directory, path) = encoded(&point, Some("-9999"));
        let raster = read(&path, None).unwrap();
        assert_eq!(raster.origin, [10.0, 17.0]);
        assert_eq!((raster.at(0, 0), raster.at(1, 1)), (3.0, 2.0));
        assert!(raster.at(0, 1).is_nan());
        let (_directory, path) = encoded(&[1, 1, 0, 1, RASTER, 0, 1, 1], None);
        assert_eq!(read(&path, None).unwrap().origin, [11.0, 15.5]);
    }

    #[test]
    fn what_is_not_in_metres_or_has_no_place_is_refused() {
        let cases: [(&[u16], &str); 3] = [
            (&[1, 1, 0, 1, MODEL, 0, 1, 2], "degrees"),
            (&[1, 1, 0, 1, UNIT, 0, 1, 9003], "9003"),
            (&[], "--spacing"),
        ];
        for (keys, expected) in cases {
            let (_directory, path) = encoded(keys, None);
            let error = read(&path, None).unwrap_err();
            assert!(error.message.contains(expected), "{error}");
        }
        let (_directory, path) = encoded(&[], None);
        let raster = read(&path, Some("2".parse().unwrap())).unwrap();
        assert_eq!(raster.origin, [0.0, 0.0]);
    }

    #[test]
    fn damaged_files_are_refused() {
        let (_directory, path) = encoded(&[1, 1, 0, 1, RASTER, 0, 1, 2], None);
        let bytes = std::fs::read(&path).unwrap();
        for length in [0, 6, bytes.len() / 2] {
            std::fs::write(&path, &bytes[..length]).unwrap();
            assert!(read(&path, None).unwrap_err().message.contains("a.tif"));
        }
    }
}
