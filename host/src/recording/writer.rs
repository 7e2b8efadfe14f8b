//! Writing recordings.

use crate::error::{Failure, Result};
use mcap::records::MessageHeader;
use mcap::{McapError, WriteOptions, Writer};
use rugosa_wire::{Frame, MAX_FRAME, Role, SCHEMA, encode};
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Longest time before what was recorded is in the file.
const FLUSH_INTERVAL: Duration = Duration::from_secs(1);

/// A recording being written. Dropping it completes the file too, but hides errors.
pub struct Recorder {
    path: PathBuf,
    writer: Writer<File>,
    schema: u16,
    channels: BTreeMap<String, u16>,
    flushed: Instant,
    messages: u64,
}

impl Recorder {
    /// Creates the file; one that exists is left alone and is an error.
    pub fn create(path: &Path) -> Result<Self> {
        let file = OpenOptions::new().write(true).create_new(true).open(path);
        let file = file.map_err(|error| match error.kind() {
            ErrorKind::AlreadyExists => {
                Failure::file(path, "exists already; recordings are not overwritten")
            }
            _ => Failure::write(path, error),
        })?;
        Recorder::begin(path, file)
    }

    fn begin(path: &Path, file: File) -> Result<Self> {
        let mut writer = options().create(file).map_err(|e| failed(path, e))?;
        let schema = writer
            .add_schema(
                super::SCHEMA_NAME,
                super::SCHEMA_ENCODING,
                SCHEMA.as_bytes(),
            )
            .map_err(|e| failed(path, e))?;
        Ok(Recorder {
            path: path.to_owned(),
            writer,
            schema,
            channels: BTreeMap::new(),
            flushed: Instant::now(),
            messages: 0,
        })
    }

    /// Adds a frame that came from `from`, `time_us` microseconds after the recording
    /// began.
    pub fn record(&mut self, from: Role, time_us: u64, frame: &Frame) -> Result<()> {
        let mut buffer = [0; MAX_FRAME];
        let length = encode(&frame.header, &frame.message, &mut buffer)
            .map_err(|e| Failure::write(&self.path, e))?;
        self.add(from, time_us, frame, &buffer[..length])
            .map_err(|e| failed(&self.path, e))
    }

    /// Makes sure that all of it is in the file, as one more chunk. [`Recorder::record`]
    /// does so every second.
    pub fn flush(&mut self) -> Result<()> {
        self.flushed = Instant::now();
        self.writer.flush().map_err(|e| failed(&self.path, e))
    }

    /// Messages recorded so far.
    pub fn messages(&self) -> u64 {
        self.messages
    }

    /// Completes the file with its index.
    pub fn finish(mut self) -> Result<()> {
        self.writer.finish().map_err(|e| failed(&self.path, e))?;
        let path = self.path;
        let file = self.writer.into_inner();
        file.sync_all().map_err(|e| Failure::write(&path, e))
    }

    fn add(
        &mut self,
        from: Role,
        time_us: u64,
        frame: &Frame,
        bytes: &[u8],
    ) -> mcap::McapResult<()> {
        let stamp_us = frame.message.stamp_us().unwrap_or(time_us);
        let header = MessageHeader {
            channel_id: self.channel(from, frame.message.kind())?,
            sequence: frame.header.sequence.into(),
            log_time: time_us.saturating_mul(1000),
            publish_time: stamp_us.saturating_mul(1000),
        };
        self.writer.write_to_known_channel(&header, bytes)?;
        self.messages += 1;
        if self.flushed.elapsed() >= FLUSH_INTERVAL {
            self.flushed = Instant::now();
            self.writer.flush()?;
        }
        Ok(())
    }

    fn channel(&mut self, from: Role, kind: &str) -> mcap::McapResult<u16> {
        let topic = format!("/{}/{kind}", from.name());
        if let Some(&id) = self.channels.get(&topic) {
            return Ok(id);
        }
        let encoding = super::MESSAGE_ENCODING;
        let id = self
            .writer
            .add_channel(self.schema, &topic, encoding, &BTreeMap::new())?;
        self.channels.insert(topic, id);
        Ok(id)
    }
}

/// Chunks are put together in memory and written whole; no threads.
fn options() -> WriteOptions {
    WriteOptions::new()
        .library(concat!("rugosa ", env!("CARGO_PKG_VERSION")))
        .chunk_size(Some(super::CHUNK_BYTES))
        .compression_threads(0)
        .disable_seeking(true)
}

fn failed(path: &Path, error: McapError) -> Failure {
    match error {
        McapError::Io(error) => Failure::write(path, error),
        other => Failure::write(path, other),
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use crate::error::Kind;
    use rugosa_wire::{Header, Message};

    /// `/dev/full` is a disk without space.
    #[test]
    fn a_full_disk_is_one_clear_error() {
        let full = OpenOptions::new().write(true).open("/dev/full").unwrap();
        let frame = Frame {
            header: Header::default(),
            message: Message::Refresh,
        };
        let path = Path::new("sweeps.mcap");
        let failure = Recorder::begin(path, full)
            .and_then(|mut recorder| {
                recorder.record(rugosa_wire::Role::Host, 0, &frame)?;
                recorder.flush()
            })
            .unwrap_err();
        assert_eq!(failure.kind, Kind::Runtime);
        assert!(
            failure
                .message
                .starts_with("cannot write sweeps.mcap: No space left")
        );
    }
}
