//! All layers in one NumPy archive, with `resolution` and `corner` (x, y of the lower left
//! cell's corner) beside them; row = y ascending, column = x ascending, NaN unknown.

use crate::error::Result;
use crate::io::{archive, atomic, npy};
use crate::layers::Layers;
use std::path::Path;

/// Writes the archive.
pub fn write(path: &Path, layers: &Layers) -> Result<()> {
    atomic::write(path, |writer| {
        let mut archive = archive::Writer::new(writer);
        let shape = [layers.rows as u64, layers.columns as u64];
        for layer in &layers.layers {
            let name = format!("{}.npy", layer.name);
            archive.add(&name, |w| npy::encode(w, &shape, &layer.values))?;
        }
        let resolution = [layers.resolution];
        archive.add("resolution.npy", |w| npy::encode(w, &[], &resolution))?;
        archive.add("corner.npy", |w| npy::encode(w, &[2], &layers.corner))?;
        archive.finish()
    })
}
