//! `--out PATH`: a directory, or a file whose extension picks the format.

use super::{Raster, asc, extension, npy};
use crate::error::{Failure, Result};
use std::path::{Path, PathBuf};

/// Where results go.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Output {
    /// any number of files, named by what they hold
    Directory(PathBuf),
    /// one file
    File(PathBuf),
}

impl Output {
    /// A path with an extension is a file, unless it is an existing directory.
    pub fn of(path: &Path) -> Self {
        if path.extension().is_none() || path.is_dir() {
            Output::Directory(path.to_owned())
        } else {
            Output::File(path.to_owned())
        }
    }

    /// The file for what is called `name` (with its extension in a directory).
    pub fn file(&self, name: &str) -> PathBuf {
        match self {
            Output::Directory(directory) => directory.join(name),
            Output::File(file) => file.clone(),
        }
    }

    /// Refuses a file name whose extension is not one of `known`, before any work is done.
    pub fn check(&self, known: &[&str]) -> Result<()> {
        match self {
            Output::File(path) if !known.contains(&extension(path).as_str()) => {
                Err(Failure::input(format_args!(
                    "--out {}: unknown file type; known are .{}",
                    path.display(),
                    known.join(" .")
                )))
            }
            _ => Ok(()),
        }
    }
}

/// Writes a raster as `.npy` or `.asc`.
pub fn write_raster(path: &Path, raster: &Raster) -> Result<()> {
    match extension(path).as_str() {
        "npy" => npy::write(path, raster.rows, raster.columns, &raster.values),
        "asc" => asc::write(path, raster),
        other => Err(Failure::file(
            path,
            format_args!("cannot write '.{other}' files; known are .npy .asc"),
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_extension_makes_a_file() {
        assert_eq!(
            Output::of(Path::new("a/b")),
            Output::Directory("a/b".into())
        );
        assert_eq!(
            Output::of(Path::new("a/b.npy")),
            Output::File("a/b.npy".into())
        );
        let directory = tempfile::tempdir().unwrap();
        let dotted = directory.path().join("v1.2");
        std::fs::create_dir(&dotted).unwrap();
        assert_eq!(Output::of(&dotted).file("d.npy"), dotted.join("d.npy"));
        assert!(
            Output::of(Path::new("b.gif"))
                .check(&["npy", "asc"])
                .is_err()
        );
    }
}
