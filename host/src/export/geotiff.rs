//! GeoTIFF: one float32 band, row 0 = greatest y, NaN declared as no data.
//!
//! The coordinates are the map's own metres (a local engineering system), so the keys
//! say "user-defined" and give the linear unit only.

use crate::error::{Failure, Result};
use crate::io::{Raster, atomic};
use std::io::Cursor;
use std::path::Path;
use tiff::TiffResult;
use tiff::encoder::{Compression, DeflateLevel, TiffEncoder, colortype::Gray32Float};
use tiff::tags::Tag;

/// GeoKeys: version, then GTModelType = user-defined, GTRasterType = pixel is area,
/// projected linear unit = metre.
const KEYS: [u16; 16] = [
    1, 1, 0, 3, 1024, 0, 1, 32767, 1025, 0, 1, 1, 3076, 0, 1, 9001,
];

/// Writes a raster.
pub fn write(path: &Path, raster: &Raster) -> Result<()> {
    let bytes = encode(raster).map_err(|e| Failure::write(path, e))?;
    atomic::write(path, |writer| writer.write_all(&bytes))
}

fn encode(raster: &Raster) -> TiffResult<Vec<u8>> {
    let mut bytes = Cursor::new(Vec::new());
    let mut tiff = TiffEncoder::new(&mut bytes)?
        .with_compression(Compression::Deflate(DeflateLevel::Balanced));
    let mut image = tiff.new_image::<Gray32Float>(raster.columns as u32, raster.rows as u32)?;
    let (dx, dy) = (raster.spacing_x, raster.spacing_y);
    let left = raster.origin[0] - dx / 2.0;
    let top = raster.origin[1] + (raster.rows as f64 - 0.5) * dy;
    let tags = image.encoder();
    tags.write_tag(Tag::ModelPixelScaleTag, &[dx, dy, 0.0][..])?;
    tags.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, left, top, 0.0][..])?;
    tags.write_tag(Tag::GeoKeyDirectoryTag, &KEYS[..])?;
    tags.write_tag(Tag::GdalNodata, "nan")?;
    let rows = raster.values.chunks(raster.columns).rev();
    let values: Vec<f32> = rows.flatten().copied().collect();
    image.write_data(&values)?;
    Ok(bytes.into_inner())
}
