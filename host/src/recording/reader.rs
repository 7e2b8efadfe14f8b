//! Reading recordings, complete or not.

use crate::error::{Failure, Result};
use mcap::sans_io::linear_reader::LinearReaderOptions;
use mcap::sans_io::message_reader::{MessageReadEvent, MessageReader};
use mcap::{Channel, McapError};
use rugosa_wire::{Broken, Decoder, Frame, Role, SCHEMA};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Bytes that are read at a time.
const READ_BYTES: usize = 64 * 1024;

/// One recorded message.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// who sent it
    pub from: Role,
    /// when it was recorded, microseconds since the recording began
    pub time_us: u64,
    /// the message and its header
    pub frame: Frame,
    /// the frame as on the wire, delimiter included
    pub bytes: Vec<u8>,
}

/// How a recording ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// the writer completed it
    Complete,
    /// the writer was killed: what it had written before this byte was read
    Truncated {
        /// bytes in the file
        length: u64,
    },
}

/// A recording being read, in the order in which it was written.
///
/// The iterator gives an error, and then nothing more, where the file is damaged; a file
/// that merely stops early is not an error, see [`Recording::ending`].
pub struct Recording {
    path: PathBuf,
    file: File,
    reader: MessageReader,
    offset: u64,
    ending: Option<Ending>,
    entries: u64,
    foreign: u64,
    is_done: bool,
}

impl Recording {
    /// Opens a recording; an error says that there is no such file or that it is no MCAP
    /// file.
    pub fn open(path: &Path) -> Result<Self> {
        let mut file = File::open(path).map_err(|e| Failure::file(path, e))?;
        let mut magic = [0; mcap::MAGIC.len()];
        file.read_exact(&mut magic)
            .ok()
            .filter(|()| magic == *mcap::MAGIC)
            .ok_or_else(|| Failure::file(path, "not an MCAP file"))?;
        Ok(Recording {
            path: path.to_owned(),
            file,
            reader: MessageReader::new_with_options(options()),
            offset: magic.len() as u64,
            ending: None,
            entries: 0,
            foreign: 0,
            is_done: false,
        })
    }

    /// How the recording ends, once it has been read.
    pub fn ending(&self) -> Option<Ending> {
        self.ending
    }

    /// Messages that were skipped because they are not rugosa's.
    pub fn foreign(&self) -> u64 {
        self.foreign
    }

    fn read(&mut self, bytes: usize) -> Result<()> {
        let buffer = self.reader.insert(bytes.clamp(1, READ_BYTES));
        let n = self
            .file
            .read(buffer)
            .map_err(|e| Failure::file(&self.path, e))?;
        self.reader.notify_read(n);
        self.offset += n as u64;
        Ok(())
    }

    /// The next message of rugosa's.
    fn advance(&mut self) -> Result<Option<Entry>> {
        loop {
            match self.reader.next_event() {
                None => return self.end(Ending::Complete),
                Some(Err(McapError::UnexpectedEof)) => {
                    let length = self.offset;
                    return self.end(Ending::Truncated { length });
                }
                Some(Err(error)) => return Err(self.damaged(error)),
                Some(Ok(MessageReadEvent::ReadRequest(n))) => self.read(n)?,
                Some(Ok(MessageReadEvent::Message(message))) => {
                    if is_ours(&message.channel) {
                        return self.entry(message).map(Some);
                    }
                    self.foreign += 1;
                }
            }
        }
    }

    fn end(&mut self, ending: Ending) -> Result<Option<Entry>> {
        self.ending = Some(ending);
        if self.entries == 0 && self.foreign > 0 {
            return Err(Failure::file(&self.path, "no messages of rugosa in it"));
        }
        Ok(None)
    }

    fn entry(&mut self, message: mcap::Message<'static>) -> Result<Entry> {
        let channel = &message.channel;
        let schema = channel.schema.as_ref().map_or(&[][..], |s| &s.data);
        if schema != SCHEMA.as_bytes() {
            return Err(Failure::file(
                &self.path,
                "recorded with other message types (another version of rugosa)",
            ));
        }
        let from = sender(channel)
            .ok_or_else(|| self.damaged(format_args!("unknown topic {}", channel.topic)))?;
        let frame = sole_frame(&message.data).map_err(|e| self.damaged(e))?;
        self.entries += 1;
        Ok(Entry {
            from,
            time_us: message.log_time / 1000,
            frame,
            bytes: message.data.into_owned(),
        })
    }

    fn damaged(&self, what: impl std::fmt::Display) -> Failure {
        let before = self.offset;
        Failure::file(
            &self.path,
            format_args!(
                "damaged before byte {before}, after {} messages: {what}",
                self.entries
            ),
        )
    }
}

impl Iterator for Recording {
    type Item = Result<Entry>;

    fn next(&mut self) -> Option<Result<Entry>> {
        if self.is_done {
            return None;
        }
        let next = self.advance().transpose();
        self.is_done = !matches!(next, Some(Ok(_)));
        next
    }
}

fn options() -> LinearReaderOptions {
    LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(super::MAX_RECORD_BYTES)
}

fn is_ours(channel: &Channel) -> bool {
    let schema = channel.schema.as_ref();
    schema.is_some_and(|schema| schema.name == super::SCHEMA_NAME)
}

fn sender(channel: &Channel) -> Option<Role> {
    let name = channel.topic.split('/').nth(1)?;
    Role::ALL.into_iter().find(|role| role.name() == name)
}

/// The one frame that a recorded message is.
fn sole_frame(mut bytes: &[u8]) -> Result<Frame, Broken> {
    let frame = Decoder::new()
        .pull(&mut bytes)
        .unwrap_or(Err(Broken::Cobs))?;
    match bytes.is_empty() {
        true => Ok(frame),
        false => Err(Broken::Message),
    }
}
