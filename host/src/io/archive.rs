//! ZIP archives of NumPy arrays (`.npz`), read without trusting what they say.
//!
//! Nothing is unpacked onto the disk. Names that lead out of the archive, members that
//! claim or unpack to more than [`MOST_BYTES`], and encrypted members are refused.

use super::{npy, open};
use crate::error::{Failure, Result};
use std::fs::File;
use std::io::{self, BufReader, Cursor, Read, Write};
use std::path::{Path, PathBuf};
use zip::result::ZipError;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// Most bytes of a member, unpacked.
pub const MOST_BYTES: u64 = 1 << 30;
/// Most members of an archive.
const MOST_MEMBERS: usize = 1000;

/// An archive being read.
pub struct Archive {
    path: PathBuf,
    zip: ZipArchive<BufReader<File>>,
}

impl Archive {
    /// Opens the archive and looks at the name and size of every member.
    pub fn open(path: &Path) -> Result<Self> {
        let (file, _) = open(path)?;
        let failed = |e: ZipError| Failure::file(path, e);
        let mut zip = ZipArchive::new(file).map_err(|e| match e {
            ZipError::InvalidArchive(_) => Failure::file(
                path,
                format_args!("cut short, or no archive of arrays ({e})"),
            ),
            e => failed(e),
        })?;
        if zip.len() > MOST_MEMBERS {
            let message = format_args!("{} members; {MOST_MEMBERS} are possible", zip.len());
            return Err(Failure::file(path, message));
        }
        for i in 0..zip.len() {
            let member = zip.by_index_raw(i).map_err(failed)?;
            let problem = if member.enclosed_name().is_none() {
                "its name leads out of the archive"
            } else if member.size() > MOST_BYTES {
                "larger than 1 GiB"
            } else if member.encrypted() {
                "encrypted"
            } else {
                continue;
            };
            let name = member.name().map_err(failed)?.escape_debug().to_string();
            return Err(Failure::file(
                path,
                format_args!("member '{name}': {problem}"),
            ));
        }
        Ok(Archive {
            path: path.to_owned(),
            zip,
        })
    }

    /// The names of the arrays.
    pub fn names(&self) -> Vec<String> {
        let names = self.zip.file_names();
        let mut names: Vec<String> = names
            .filter_map(|n| Some(n.ok()?.strip_suffix(".npy")?.to_owned()))
            .collect();
        names.sort();
        names
    }

    /// The bytes of a member; `None` where there is none of this name.
    pub fn bytes(&mut self, name: &str) -> Result<Option<Vec<u8>>> {
        let failed = |e: String| Failure::file(&self.path, format_args!("member '{name}': {e}"));
        let member = match self.zip.by_name(name) {
            Err(ZipError::FileNotFound) => return Ok(None),
            member => member.map_err(|e| failed(e.to_string()))?,
        };
        let mut bytes = Vec::new();
        member
            .take(MOST_BYTES + 1)
            .read_to_end(&mut bytes)
            .map_err(|e| failed(e.to_string()))?;
        if bytes.len() as u64 > MOST_BYTES {
            return Err(failed("larger than 1 GiB".into()));
        }
        Ok(Some(bytes))
    }

    /// An array of floats or integers as f64; `None` where there is none of this name.
    pub fn array(&mut self, name: &str) -> Result<Option<npy::Array>> {
        let Some(bytes) = self.bytes(&format!("{name}.npy"))? else {
            return Ok(None);
        };
        let place = self.path.join(name);
        npy::parse(&place, Cursor::new(&bytes), bytes.len() as u64).map(Some)
    }
}

/// An archive being written.
pub struct Writer<'w>(ZipWriter<Cursor<Vec<u8>>>, &'w mut dyn Write);

impl<'w> Writer<'w> {
    /// An archive that will go into `to`.
    pub fn new(to: &'w mut dyn Write) -> Self {
        Writer(ZipWriter::new(Cursor::new(Vec::new())), to)
    }

    /// Adds a member; always with the same time, so that equal maps are equal files.
    pub fn add(
        &mut self,
        name: &str,
        fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> io::Result<()> {
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Deflated)
            .compression_level(Some(1))
            .last_modified_time(zip::DateTime::default());
        self.0.start_file(name, options).map_err(io::Error::other)?;
        let mut buffer = io::BufWriter::with_capacity(1 << 16, &mut self.0);
        fill(&mut buffer)?;
        buffer.flush()
    }

    /// Completes the archive.
    pub fn finish(self) -> io::Result<()> {
        let bytes = self.0.finish().map_err(io::Error::other)?;
        self.1.write_all(bytes.get_ref())
    }
}
