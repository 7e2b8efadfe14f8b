//! The log of the firmware: defmt frames to lines with file and line number.

use anyhow::{Context, Result};
use defmt_decoder::{DecodeError, Locations, StreamDecoder, Table};
use std::path::Path;

/// One entry of the log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// `info`, `warn`, `error`, …; empty for a print without a level
    pub level: &'static str,
    /// what it says
    pub text: String,
    /// `file:line` of the firmware's source, where the image tells
    pub place: String,
}

impl std::fmt::Display for Entry {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:<5} {} ({})", self.level, self.text, self.place)
    }
}

/// A decoder for the log of one image.
pub struct Log {
    decoder: Box<dyn StreamDecoder + 'static>,
    locations: Option<Locations>,
    /// frames that could not be decoded
    pub malformed: u32,
}

impl Log {
    /// Reads the table of messages from an ELF image. It lives as long as the program.
    pub fn of(image: &Path) -> Result<Self> {
        let elf =
            std::fs::read(image).with_context(|| format!("cannot read {}", image.display()))?;
        let table = Table::parse(&elf)
            .and_then(|table| table.context("there is no table of log messages in it"))
            .with_context(|| format!("{} is no image of the firmware", image.display()))?;
        let locations = table.get_locations(&elf).ok();
        let table: &'static Table = Box::leak(Box::new(table)); // the decoder borrows it
        Ok(Log {
            decoder: table.new_stream_decoder(),
            locations,
            malformed: 0,
        })
    }

    /// Takes bytes of the log; returns the entries that are complete.
    pub fn take(&mut self, bytes: &[u8]) -> Vec<Entry> {
        self.decoder.received(bytes);
        let mut entries = Vec::new();
        loop {
            match self.decoder.decode() {
                Ok(frame) => {
                    let location = self
                        .locations
                        .as_ref()
                        .and_then(|all| all.get(&frame.index()));
                    entries.push(Entry {
                        level: frame.level().map_or("", |level| level.as_str()),
                        text: frame.display_message().to_string(),
                        place: location.map_or_else(String::new, |at| {
                            format!("{}:{}", short(&at.file), at.line)
                        }),
                    });
                }
                Err(DecodeError::UnexpectedEof) => return entries,
                Err(DecodeError::Malformed) => self.malformed += 1,
            }
        }
    }
}

/// The part of a path that starts at `firmware/`, if it does.
fn short(path: &Path) -> String {
    let text = path.display().to_string();
    text.rfind("firmware/")
        .map_or(text.clone(), |at| text[at..].to_owned())
}
