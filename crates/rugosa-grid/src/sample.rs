//! The point sample of a cell: one return, kept as integers.
//!
//! Statistics of elevation differences must not be taken from averages over a cell
//! (averaging smooths, and more so where the returns are dense). Each cell therefore
//! keeps one return with its true position inside the cell. All fields are integers, so
//! that sums over pairs of samples are exact and can be taken back without drift.

/// What is known of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum State {
    /// no beam has told anything of it
    #[default]
    Unknown,
    /// it holds a sample
    Measured,
    /// a beam passed below its former elevation and nothing was measured there since
    SeenThrough,
}

/// Parts of a cell edge that [`Sample::east`] and [`Sample::north`] count in.
pub const PARTS: i32 = 64;

/// One return in a cell, 8 bytes.
///
/// ```
/// use rugosa_grid::{Sample, State};
/// assert_eq!(Sample::UNKNOWN.state(), State::Unknown);
/// // 120 height steps high, a quarter of a cell to the west, half a cell to the north
/// let mut sample = Sample::measured(120, 4, -16, 32, 255);
/// assert_eq!((sample.state(), sample.is_counted()), (State::Measured, false));
/// assert_eq!(sample.eccentricity(), 16 * 16 + 32 * 32); // (1/64 cell)²
/// sample.set_counted(true);
/// assert!(sample.is_counted() && sample.is_measured());
/// assert_eq!(Sample::seen_through().state(), State::SeenThrough);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct Sample {
    /// height above the map's datum, in height steps
    pub height: i16,
    /// variance of the height, in height steps²; saturates
    pub variance: u16,
    /// offset from the cell's centre to the east, in 1/64 cell, −32 … 32
    pub east: i8,
    /// offset from the cell's centre to the north, in 1/64 cell, −32 … 32
    pub north: i8,
    /// sine of the depression of the beam that made it, times 255: 0 = level or upward,
    /// 255 = straight down
    pub depression: u8,
    flags: u8,
}

const MEASURED: u8 = 1;
const SEEN_THROUGH: u8 = 2;
const COUNTED: u8 = 4;

impl Sample {
    /// An unknown cell.
    pub const UNKNOWN: Sample = Sample {
        height: 0,
        variance: 0,
        east: 0,
        north: 0,
        depression: 0,
        flags: 0,
    };

    /// A measured sample, not counted yet.
    pub fn measured(height: i16, variance: u16, east: i8, north: i8, depression: u8) -> Self {
        Sample {
            height,
            variance,
            east,
            north,
            depression,
            flags: MEASURED,
        }
    }

    /// A cell that was seen through.
    pub fn seen_through() -> Self {
        Sample {
            flags: SEEN_THROUGH,
            ..Sample::default()
        }
    }

    /// Unknown, measured or seen through.
    pub fn state(&self) -> State {
        match self.flags & (MEASURED | SEEN_THROUGH) {
            0 => State::Unknown,
            SEEN_THROUGH => State::SeenThrough,
            _ => State::Measured,
        }
    }

    /// Does it hold a return?
    #[inline]
    pub fn is_measured(&self) -> bool {
        self.flags & MEASURED != 0
    }

    /// Was the cell seen through, and holds no return?
    #[inline]
    pub fn is_seen_through(&self) -> bool {
        self.flags & SEEN_THROUGH != 0
    }

    /// Are its pairs in the counters of the structure function?
    #[inline]
    pub fn is_counted(&self) -> bool {
        self.flags & COUNTED != 0
    }

    /// Marks its pairs as counted or not.
    #[inline]
    pub fn set_counted(&mut self, counted: bool) {
        self.flags = (self.flags & !COUNTED) | if counted { COUNTED } else { 0 };
    }

    /// Squared distance from the cell's centre, in (1/64 cell)².
    #[inline]
    pub fn eccentricity(&self) -> u16 {
        let (e, n) = (i32::from(self.east), i32::from(self.north));
        (e * e + n * n) as u16
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_is_eight_bytes_and_knows_its_state() {
        assert_eq!(core::mem::size_of::<Sample>(), 8);
        assert_eq!(Sample::default().state(), State::Unknown);
        assert_eq!(Sample::seen_through().state(), State::SeenThrough);
        let mut s = Sample::measured(-3, 4, -32, 32, 9);
        assert_eq!(s.state(), State::Measured);
        assert!(!s.is_counted());
        s.set_counted(true);
        assert!(s.is_counted() && s.is_measured());
        assert_eq!(s.eccentricity(), 2048);
    }
}
