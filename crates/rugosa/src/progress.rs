//! Which lines of which sweep have come.
//!
//! A sweep is a transaction: it begins with the first line of a new number and ends with
//! its sweep end, or with the first line of a later one. Lines of a sweep that has ended
//! and segments that come twice are refused by cause.

use rugosa_wire::{ScanLine, counter};

/// Most segments of a line; each starts in a part of the line of its own.
const SEGMENTS: u16 = 16;

/// Where a line stands in the order of sweeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// of the sweep that is being mapped
    Current,
    /// of a sweep that has not begun
    Next,
}

/// The sweep that is being mapped.
pub(crate) struct Progress<'m> {
    sweep: Option<u32>,
    open: bool,
    start_us: u64,
    lines: u32,
    /// columns of the scanner
    columns: u16,
    received: &'m mut [u16],
}

impl<'m> Progress<'m> {
    pub(crate) fn new(received: &'m mut [u16]) -> Self {
        Progress {
            sweep: None,
            open: false,
            start_us: 0,
            lines: 0,
            columns: 1,
            received,
        }
    }

    /// Number of the sweep in progress or of the last one.
    pub(crate) fn sweep(&self) -> u32 {
        self.sweep.unwrap_or(0)
    }

    /// Is a sweep in progress?
    pub(crate) fn is_open(&self) -> bool {
        self.open
    }

    /// Lines taken of the sweep.
    pub(crate) fn lines(&self) -> u32 {
        self.lines
    }

    /// Where the line stands, or the counter of the cause why it is refused.
    pub(crate) fn place(&self, line: &ScanLine) -> Result<Place, usize> {
        let Some(sweep) = self.sweep else {
            return Ok(Place::Next);
        };
        match line.sweep.wrapping_sub(sweep) as i32 {
            0 if !self.open => Err(counter::LINES_STALE),
            0 if line.stamp_us < self.start_us => Err(counter::LINES_TIME_BACKWARDS),
            0 if self.has(line) => Err(counter::LINES_DUPLICATES),
            0 => Ok(Place::Current),
            ..0 => Err(counter::LINES_STALE),
            _ => Ok(Place::Next),
        }
    }

    pub(crate) fn begin(&mut self, line: &ScanLine, columns: u16) {
        self.columns = columns;
        self.sweep = Some(line.sweep);
        self.open = true;
        self.start_us = line.stamp_us;
        self.lines = 0;
        self.received.fill(0);
    }

    /// The line is taken; `false` where there is no such line.
    pub(crate) fn take(&mut self, line: &ScanLine) -> bool {
        let bit = self.bit_of(line);
        let entry = self.received.get_mut(usize::from(line.line));
        self.lines += u32::from(entry.is_some());
        entry.map(|entry| *entry |= bit).is_some()
    }

    /// A sweep end: lines that are missing, or `None` where it is not of this sweep.
    pub(crate) fn end(&mut self, sweep: u32, lines: u16) -> Option<u32> {
        if !self.open || self.sweep != Some(sweep) {
            return None;
        }
        self.open = false;
        Some(u32::from(lines).saturating_sub(self.lines))
    }

    /// Ends a sweep whose end never came.
    pub(crate) fn abandon(&mut self) {
        self.open = false;
    }

    /// The scanner counts afresh.
    pub(crate) fn forget(&mut self) {
        (self.sweep, self.open, self.lines) = (None, false, 0);
    }

    /// The map is that of an earlier run whose last sweep had this number.
    pub(crate) fn resume(&mut self, sweep: u32) {
        (self.sweep, self.open, self.lines) = (Some(sweep), false, 0);
    }

    fn has(&self, line: &ScanLine) -> bool {
        let entry = self.received.get(usize::from(line.line));
        entry.is_some_and(|entry| entry & self.bit_of(line) != 0)
    }

    /// The part of the line in which the segment starts.
    fn bit_of(&self, line: &ScanLine) -> u16 {
        1 << (line.first_column / self.columns.div_ceil(SEGMENTS)).min(SEGMENTS - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rugosa_wire::Packing;

    fn line(sweep: u32, line: u16, first_column: u16) -> ScanLine {
        ScanLine {
            sweep,
            line,
            first_column,
            stamp_us: 1000 + u64::from(line),
            returns: 64,
            packing: Packing::Bits12,
            ranges: Default::default(),
            reflectances: Default::default(),
        }
    }

    #[test]
    fn lines_are_sorted_by_cause() {
        let mut received = [0; 4];
        let mut progress = Progress::new(&mut received);
        let first = line(u32::MAX, 0, 0);
        assert_eq!(progress.place(&first), Ok(Place::Next));
        progress.begin(&first, 128);
        assert!(progress.take(&first));
        assert_eq!(progress.place(&first), Err(counter::LINES_DUPLICATES));
        assert_eq!(progress.place(&line(u32::MAX, 0, 64)), Ok(Place::Current));
        let mut early = line(u32::MAX, 1, 0);
        early.stamp_us = 999;
        assert_eq!(progress.place(&early), Err(counter::LINES_TIME_BACKWARDS));
        assert_eq!(
            progress.place(&line(u32::MAX - 1, 1, 0)),
            Err(counter::LINES_STALE)
        );
        assert_eq!(progress.place(&line(0, 1, 0)), Ok(Place::Next));
        assert!(!progress.take(&line(u32::MAX, 4, 0)));
        assert_eq!(progress.end(0, 3), None);
        assert_eq!(progress.end(u32::MAX, 3), Some(2));
        assert_eq!(
            progress.place(&line(u32::MAX, 2, 0)),
            Err(counter::LINES_STALE)
        );
    }

    #[test]
    fn segments_of_a_wide_line_are_told_apart() {
        let mut received = [0; 4];
        let mut progress = Progress::new(&mut received);
        progress.begin(&line(1, 0, 0), 4096);
        for first in (0..4096).step_by(256) {
            assert_eq!(progress.place(&line(1, 0, first)), Ok(Place::Current));
            progress.take(&line(1, 0, first));
            assert_eq!(
                progress.place(&line(1, 0, first)),
                Err(counter::LINES_DUPLICATES)
            );
        }
    }
}
