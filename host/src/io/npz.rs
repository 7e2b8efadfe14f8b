//! NumPy archives: one array of points or heights among others.
//!
//! Of several arrays the first called `elevation`, `dem`, `z`, `xyz` or `points` is taken.
//! Where the archive also holds `resolution` (m) and `corner` (x, y of the lower left
//! cell's corner), as those that rugosa writes do, it needs no `--spacing`.

use super::archive::Archive;
use super::{Dataset, Spacing, npy};
use crate::error::{Failure, Result};
use std::path::Path;

/// Names of arrays that are taken, in this order.
const NAMES: [&str; 5] = ["elevation", "dem", "z", "xyz", "points"];

/// Reads points or a raster.
pub fn read(path: &Path, spacing: Option<Spacing>) -> Result<Dataset> {
    let mut archive = Archive::open(path)?;
    let names = archive.names();
    let known = NAMES
        .into_iter()
        .find(|n| names.iter().any(|name| name == n));
    let name = match (known, names.as_slice()) {
        (Some(name), _) => name.to_owned(),
        (None, [only]) => only.clone(),
        (None, several) => {
            let message = format_args!(
                "which array? one of {} is needed, there are: {}",
                NAMES.join(", "),
                several.join(", ")
            );
            return Err(Failure::file(path, message));
        }
    };
    let resolution = numbers::<1>(&mut archive, "resolution")?;
    let corner = numbers::<2>(&mut archive, "corner")?.unwrap_or([0.0; 2]);
    let array = archive
        .array(&name)?
        .ok_or_else(|| Failure::file(path, format_args!("no array {name}")))?;
    let own = resolution
        .filter(|_| array.shape.len() == 2)
        .map(|[r]| Spacing { x: r, y: r });
    if own.is_some_and(|s| !(s.x.is_finite() && s.x > 0.0)) {
        return Err(Failure::file(
            path,
            "array resolution: not a positive number",
        ));
    }
    let mut dataset = npy::dataset(path, &array, own.or(spacing))?;
    if let (Dataset::Raster(raster), Some(own)) = (&mut dataset, own) {
        raster.origin = corner.map(|c| c + 0.5 * own.x);
    }
    Ok(dataset)
}

/// A small array of exactly `N` finite numbers.
fn numbers<const N: usize>(archive: &mut Archive, name: &str) -> Result<Option<[f64; N]>> {
    let Some(array) = archive.array(name)? else {
        return Ok(None);
    };
    let values: Option<[f64; N]> = array.values.try_into().ok();
    let values = values.filter(|v| v.iter().all(|v| v.is_finite()));
    let error = || Failure::input(format_args!("array {name}: {N} finite numbers are needed"));
    values.ok_or_else(error).map(Some)
}

#[cfg(test)]
mod tests {
    use super::super::archive::Writer;
    use super::*;
    use std::fs;

    fn file(arrays: &[(&str, &[u64], &[f32])]) -> (tempfile::TempDir, std::path::PathBuf) {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.npz");
        let mut bytes = Vec::new();
        let mut writer = Writer::new(&mut bytes);
        for (name, shape, values) in arrays {
            writer.add(name, |w| npy::encode(w, shape, values)).unwrap();
        }
        writer.finish().unwrap();
        fs::write(&path, bytes).unwrap();
        (directory, path)
    }

    #[test]
    fn points_rasters_and_their_place() {
        let z = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0];
        let (_d, path) = file(&[("xyz.npy", &[2, 3], &z), ("other.npy", &[1], &[1.0])]);
        assert!(matches!(read(&path, None).unwrap(), Dataset::Points(p) if p.xyz.len() == 2));
        let (_d, path) = file(&[
            ("elevation.npy", &[2, 3], &z),
            ("resolution.npy", &[], &[0.5]),
            ("corner.npy", &[2], &[10.0, 20.0]),
        ]);
        let Dataset::Raster(raster) = read(&path, None).unwrap() else {
            panic!("not a raster")
        };
        assert_eq!((raster.origin, raster.spacing_x), ([10.25, 20.25], 0.5));
        let (_d, path) = file(&[("a.npy", &[2, 3], &z)]);
        let raster = read(&path, Some("2".parse().unwrap())).unwrap();
        assert!(matches!(raster, Dataset::Raster(_)));
    }

    #[test]
    fn archives_that_cannot_be_trusted_are_refused() {
        let one: (&[u64], &[f32]) = (&[1], &[1.0]);
        let cases = [
            (vec![("../a.npy", one.0, one.1)], "leads out"),
            (
                vec![("a.npy", one.0, one.1), ("b.npy", one.0, one.1)],
                "which array",
            ),
            (vec![], "which array"),
        ];
        for (arrays, expected) in cases {
            let (_d, path) = file(&arrays);
            let error = read(&path, None).unwrap_err();
            assert!(error.message.contains(expected), "{error}");
        }
        let (_d, path) = file(&[("xyz.npy", &[2, 3], &[0.0; 6])]);
        let bytes = fs::read(&path).unwrap();
        for length in [0, 10, bytes.len() - 10] {
            fs::write(&path, &bytes[..length]).unwrap();
            assert!(read(&path, None).unwrap_err().message.contains("a.npz"));
        }
        // the size that the directory states, four bytes at offset 24 of its entry
        let mut huge = bytes.clone();
        let entry = bytes.windows(4).position(|w| w == b"PK\x01\x02").unwrap();
        huge[entry + 24..entry + 28].copy_from_slice(&0xfff0_0000u32.to_le_bytes());
        fs::write(&path, huge).unwrap();
        let error = read(&path, None).unwrap_err();
        assert!(error.message.contains("larger than 1 GiB"), "{error}");
    }
}
