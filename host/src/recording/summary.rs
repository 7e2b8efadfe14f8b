//! What a recording holds, without mapping it.

use super::{Ending, Recording};
use crate::error::Result;
use rugosa_wire::{BeamModel, Message, Role, ScannerDescription};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

/// Counts and extremes over all messages of a recording.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// from the first message to the last \[s\]
    pub seconds: f64,
    /// messages by topic, as `/scanner/line`
    pub messages: BTreeMap<String, u64>,
    /// bytes of the frames
    pub bytes: u64,
    /// sweeps that ended
    pub sweeps: u64,
    /// returns in all scan lines, whatever became of them
    pub returns: u64,
    /// the last description of the scanner
    pub scanner: Option<Scanner>,
    /// messages of other programs, skipped
    pub foreign: u64,
    /// false where the writer was stopped before it closed the file
    pub complete: bool,
}

/// What the scanner said of itself.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scanner {
    /// `spherical` or `perceptron`
    pub model: &'static str,
    /// lines of a sweep
    pub lines: u16,
    /// columns of a line
    pub columns: u16,
    /// shortest and longest valid range \[m\]
    pub range_m: [f32; 2],
}

impl Scanner {
    fn new(description: &ScannerDescription) -> Self {
        Scanner {
            model: match description.model {
                BeamModel::Spherical => "spherical",
                BeamModel::Perceptron { .. } => "perceptron",
            },
            lines: description.lines,
            columns: description.columns,
            range_m: [description.range_min_m, description.range_max_m],
        }
    }
}

impl Summary {
    /// Reads the whole recording; `progress` hears of the messages so far.
    pub fn of(path: &Path, mut progress: impl FnMut(u64)) -> Result<Self> {
        let mut recording = Recording::open(path)?;
        let mut summary = Summary::default();
        let (mut first, mut count) = (None, 0);
        while let Some(entry) = recording.next().transpose()? {
            let begin = *first.get_or_insert(entry.time_us);
            summary.seconds = entry.time_us.saturating_sub(begin) as f64 * 1e-6;
            summary.bytes += entry.bytes.len() as u64;
            summary.count(entry.from, &entry.frame.message);
            count += 1;
            progress(count);
        }
        summary.foreign = recording.foreign();
        summary.complete = recording.ending() == Some(Ending::Complete);
        Ok(summary)
    }

    fn count(&mut self, from: Role, message: &Message) {
        let topic = format!("/{}/{}", from.name(), message.kind());
        *self.messages.entry(topic).or_default() += 1;
        match message {
            Message::Line(line) => self.returns += u64::from(line.returns),
            Message::SweepEnd(_) => self.sweeps += 1,
            Message::Scanner(description) => self.scanner = Some(Scanner::new(description)),
            _ => {}
        }
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ending = if self.complete {
            "complete"
        } else {
            "ends early: the writer was stopped"
        };
        writeln!(
            f,
            "recording  {:.1} s, {} bytes of frames, {ending}",
            self.seconds, self.bytes
        )?;
        match &self.scanner {
            Some(s) => writeln!(
                f,
                "scanner    {}, {} lines × {} columns, {} … {} m",
                s.model, s.lines, s.columns, s.range_m[0], s.range_m[1]
            )?,
            None => writeln!(f, "scanner    no description")?,
        }
        write!(
            f,
            "sweeps     {} ended, {} returns in lines",
            self.sweeps, self.returns
        )?;
        for (topic, count) in &self.messages {
            write!(f, "\n{count:>10}  {topic}")?;
        }
        if self.foreign > 0 {
            write!(f, "\n{:>10}  of other programs, skipped", self.foreign)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Recorder;
    use rugosa_wire::{Frame, Header, SweepEnd};

    #[test]
    fn messages_are_counted_by_topic_and_a_cut_is_seen() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sweeps.mcap");
        let mut recorder = Recorder::create(&path).unwrap();
        for (sequence, message) in [
            Message::SweepEnd(SweepEnd {
                sweep: 1,
                lines: 2,
                stamp_us: 3,
            }),
            Message::Refresh,
            Message::Refresh,
        ]
        .into_iter()
        .enumerate()
        {
            let header = Header {
                session: 1,
                sequence: sequence as u16,
            };
            let time_us = 1_000_000 * (1 + sequence as u64);
            let frame = Frame { header, message };
            recorder.record(Role::Scanner, time_us, &frame).unwrap();
        }
        recorder.finish().unwrap();
        let mut heard = 0;
        let summary = Summary::of(&path, |n| heard = n).unwrap();
        assert_eq!((heard, summary.sweeps, summary.seconds), (3, 1, 2.0));
        assert_eq!(summary.messages["/scanner/sweep_end"], 1);
        assert_eq!(summary.messages["/scanner/refresh"], 2);
        assert!(summary.complete);

        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() - 40]).unwrap();
        let summary = Summary::of(&path, |_| {}).unwrap();
        assert!(!summary.complete);
        assert!(summary.to_string().contains("ends early"));
    }
}
