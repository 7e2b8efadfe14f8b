//! Ranges and reflectances as packed by the scanner: 12 or 16 bits each.
//!
//! | packing | bytes |
//! |---|---|
//! | 16 bits | `v & ff`, `v >> 8` |
//! | 12 bits | of each pair (a, b): `a & ff`, `a >> 8 \| (b & f) << 4`, `b >> 4`; an odd last one: `a & ff`, `a >> 8` |

use heapless::Vec;

use crate::message::{MAX_RANGE_BYTES, Packing, ScanLine, range_code};

/// What one range sample says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// a range, in counts
    Counts(u16),
    /// nothing came back
    NoReturn,
    /// closer than the scanner can measure
    TooClose,
    /// not a measurement
    Erroneous,
}

impl Packing {
    /// Largest number that fits, 4095 or 65535.
    pub const fn max(self) -> u16 {
        match self {
            Packing::Bits12 => 0xfff,
            Packing::Bits16 => 0xffff,
        }
    }

    /// Bytes of `count` values.
    ///
    /// ```
    /// use rugosa_wire::Packing;
    /// assert_eq!([1, 2, 256].map(|count| Packing::Bits12.bytes(count)), [2, 3, 384]);
    /// assert_eq!(Packing::Bits16.bytes(256), 512);
    /// ```
    pub const fn bytes(self, count: usize) -> usize {
        match self {
            Packing::Bits12 => (count * 3).div_ceil(2),
            Packing::Bits16 => count * 2,
        }
    }

    /// What a range sample of this packing says.
    ///
    /// ```
    /// use rugosa_wire::{Packing, Reading};
    /// assert_eq!(Packing::Bits12.reading(4095), Reading::NoReturn);
    /// assert_eq!(Packing::Bits12.reading(4094), Reading::TooClose);
    /// assert_eq!(Packing::Bits12.reading(4093), Reading::Erroneous);
    /// assert_eq!(Packing::Bits16.reading(4095), Reading::Counts(4095));
    /// ```
    pub const fn reading(self, value: u16) -> Reading {
        match self.max().wrapping_sub(value) {
            range_code::NO_RETURN => Reading::NoReturn,
            range_code::TOO_CLOSE => Reading::TooClose,
            range_code::ERRONEOUS => Reading::Erroneous,
            _ => Reading::Counts(value),
        }
    }

    /// The number that stands for a reading; a range that collides with a code becomes
    /// [`Reading::NoReturn`], as it is beyond the scanner's reach.
    ///
    /// ```
    /// use rugosa_wire::{Packing, Reading};
    /// use Reading::*;
    /// for reading in [Counts(17), NoReturn, TooClose, Erroneous] {
    ///     assert_eq!(Packing::Bits12.reading(Packing::Bits12.code(reading)), reading);
    /// }
    /// // beyond the reach of 12 bits
    /// assert_eq!(Packing::Bits12.code(Reading::Counts(5000)), 4095);
    /// ```
    pub const fn code(self, reading: Reading) -> u16 {
        match reading {
            Reading::Counts(value) if value < self.max() - range_code::ERRONEOUS => value,
            Reading::Counts(_) | Reading::NoReturn => self.max() - range_code::NO_RETURN,
            Reading::TooClose => self.max() - range_code::TOO_CLOSE,
            Reading::Erroneous => self.max() - range_code::ERRONEOUS,
        }
    }

    /// Packs values (each at most [`Packing::max`]; higher bits are cut off). `None`
    /// where they do not fit into one line.
    ///
    /// ```
    /// use rugosa_wire::Packing;
    /// assert_eq!(Packing::Bits12.pack([0xabc, 0x123]).unwrap(), [0xbc, 0x3a, 0x12]);
    /// assert_eq!(Packing::Bits16.pack([0xabc, 0x123]).unwrap(), [0xbc, 0x0a, 0x23, 0x01]);
    /// assert_eq!(Packing::Bits16.pack([0; 257]), None); // more than one line holds
    /// ```
    pub fn pack(self, values: impl IntoIterator<Item = u16>) -> Option<Vec<u8, MAX_RANGE_BYTES>> {
        let mut bytes = Vec::new();
        for (i, value) in values.into_iter().enumerate() {
            let value = value & self.max();
            if self == Packing::Bits12 && i % 2 == 1 {
                *bytes.last_mut()? |= (value as u8) << 4;
                bytes.push((value >> 4) as u8).ok()?;
            } else {
                bytes.extend_from_slice(&value.to_le_bytes()).ok()?;
            }
        }
        Some(bytes)
    }

    /// The values in `bytes`, without a copy. `None` unless `bytes` holds exactly `count`.
    ///
    /// ```
    /// use rugosa_wire::Packing;
    /// let values = Packing::Bits12.unpack(&[0xbc, 0x3a, 0x12, 0xff, 0x0f], 3).unwrap();
    /// assert_eq!(values.len(), 3);
    /// assert!(values.eq([0xabc, 0x123, 0xfff]));
    /// assert!(Packing::Bits12.unpack(&[0xbc, 0x3a, 0x12], 3).is_none()); // a byte is missing
    /// ```
    pub fn unpack(self, bytes: &[u8], count: usize) -> Option<Unpacked<'_>> {
        (bytes.len() == self.bytes(count)).then_some(Unpacked {
            bytes,
            packing: self,
            is_second: false,
        })
    }
}

/// Iterator over packed values.
#[derive(Clone, Debug)]
pub struct Unpacked<'a> {
    bytes: &'a [u8],
    packing: Packing,
    is_second: bool,
}

impl Iterator for Unpacked<'_> {
    type Item = u16;

    #[inline]
    fn next(&mut self) -> Option<u16> {
        let (&[low, high], _) = self.bytes.split_first_chunk()?;
        let pair = u16::from_le_bytes([low, high]);
        let is_first_of_12 = self.packing == Packing::Bits12 && !self.is_second;
        // the first of a pair leaves its second byte to the other; an odd last one does not
        let is_shared = is_first_of_12 && self.bytes.len() > 2;
        self.bytes = &self.bytes[if is_shared { 1 } else { 2 }..];
        let value = match self.packing {
            Packing::Bits16 => pair,
            Packing::Bits12 if self.is_second => pair >> 4,
            Packing::Bits12 => pair & 0xfff,
        };
        self.is_second = is_first_of_12;
        Some(value)
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = match self.packing {
            Packing::Bits12 => self.bytes.len() * 2 / 3,
            Packing::Bits16 => self.bytes.len() / 2,
        };
        (left, Some(left))
    }
}

impl ExactSizeIterator for Unpacked<'_> {}

impl ScanLine {
    /// Range samples of this segment; `None` where their bytes do not match `returns`.
    ///
    /// ```
    /// use rugosa_wire::{Packing, Reading, ScanLine};
    /// let line = ScanLine {
    ///     sweep: 1,
    ///     line: 0,
    ///     first_column: 0,
    ///     stamp_us: 0,
    ///     returns: 2,
    ///     packing: Packing::Bits16,
    ///     ranges: Packing::Bits16.pack([1414, 65535]).unwrap(),
    ///     reflectances: Packing::Bits16.pack([20, 0]).unwrap(),
    /// };
    /// assert!(line.readings().unwrap().eq([Reading::Counts(1414), Reading::NoReturn]));
    /// assert!(line.reflectance_counts().unwrap().eq([20, 0]));
    /// let cut = ScanLine { returns: 3, ..line };
    /// assert!(cut.readings().is_none() && cut.reflectance_counts().is_none());
    /// ```
    pub fn readings(&self) -> Option<impl ExactSizeIterator<Item = Reading> + Clone + '_> {
        let packing = self.packing;
        let values = packing.unpack(&self.ranges, usize::from(self.returns))?;
        Some(values.map(move |value| packing.reading(value)))
    }

    /// Reflectances of this segment, none where the scanner has none; `None` where their
    /// bytes do not match `returns`.
    pub fn reflectance_counts(&self) -> Option<Unpacked<'_>> {
        let count = match self.reflectances.len() {
            0 => 0,
            _ => usize::from(self.returns),
        };
        self.packing.unpack(&self.reflectances, count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_documented_bytes() {
        let packed = Packing::Bits12.pack([0x123, 0xabc, 0xfff]).unwrap();
        assert_eq!(packed[..], [0x23, 0xc1, 0xab, 0xff, 0x0f]);
        let packed = Packing::Bits16.pack([0x1234, 0xabcd]).unwrap();
        assert_eq!(packed[..], [0x34, 0x12, 0xcd, 0xab]);
    }

    #[test]
    fn sentinels() {
        for packing in [Packing::Bits12, Packing::Bits16] {
            for reading in [Reading::NoReturn, Reading::TooClose, Reading::Erroneous] {
                assert_eq!(packing.reading(packing.code(reading)), reading);
            }
            let longest = packing.max() - 3;
            assert_eq!(packing.reading(longest), Reading::Counts(longest));
            assert_eq!(packing.code(Reading::Counts(longest)), longest);
            assert_eq!(packing.code(Reading::Counts(longest + 1)), packing.max());
        }
        assert_eq!(Packing::Bits16.reading(4095), Reading::Counts(4095));
    }

    #[test]
    fn wrong_lengths_are_refused() {
        assert!(Packing::Bits12.unpack(&[0; 4], 3).is_none());
        assert!(Packing::Bits12.unpack(&[0; 5], 4).is_none());
        assert!(Packing::Bits16.unpack(&[0; 5], 2).is_none());
        assert_eq!(Packing::Bits12.unpack(&[], 0).unwrap().count(), 0);
        assert!(Packing::Bits16.pack([0; 257]).is_none());
    }

    proptest! {
        #[test]
        fn values_come_back(values in prop::collection::vec(any::<u16>(), 0..256), wide: bool) {
            let packing = if wide { Packing::Bits16 } else { Packing::Bits12 };
            let bytes = packing.pack(values.iter().copied()).unwrap();
            let unpacked = packing.unpack(&bytes, values.len()).unwrap();
            prop_assert_eq!(unpacked.len(), values.len());
            let kept: Vec<u16, 256> = values.iter().map(|v| v & packing.max()).collect();
            prop_assert_eq!(unpacked.collect::<Vec<u16, 256>>(), kept);
        }
    }
}
