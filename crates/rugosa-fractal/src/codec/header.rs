//! The header of a coded map: 25 bytes, with a checksum of its own so that a prefix can be
//! relied on. The layout is in the module above.

use super::{CodecError, LONGEST_SIDE};
use crate::surfaces::Shape;

/// Bytes before the stream.
pub const HEADER: usize = 25;
/// Bytes after it.
pub(super) const TRAILER: usize = 4;

const MAGIC: [u8; 2] = *b"RZ";
const VERSION: u8 = 1;

const CRC16: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);

pub(super) const HAS_UNKNOWN: u8 = 1;
pub(super) const LOSSY: u8 = 2;
pub(super) const NOTHING_KNOWN: u8 = 4;
pub(super) const QUICK: u8 = 8;

/// What the header says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Header {
    /// size of the map
    pub shape: Shape,
    /// lowest height \[m\]
    pub offset: f32,
    /// unit of the integers \[m\]
    pub quantum: f32,
    /// largest error of a known height, measured by the encoder \[m\]
    pub max_error: f32,
    /// bytes of the whole
    pub length: usize,
    pub(super) flags: u8,
}

impl Header {
    /// Reads and checks a header; what follows it may be missing.
    ///
    /// ```
    /// use rugosa_fractal::codec::{CodecError, HEADER, Header, Precision, encode};
    /// use rugosa_fractal::surfaces::Shape;
    /// let heights: [f32; 81] = core::array::from_fn(|i| 100.0 + i as f32);
    /// let (mut work, mut bytes) = ([0; 81], [0; 600]);
    /// let lent = (&mut work[..], &mut bytes[..]);
    /// let told = encode(&heights, Shape::new(9, 9), Precision::Step(0.5), lent).unwrap();
    /// // the first bytes are enough
    /// let header = Header::read(&bytes[..HEADER]).unwrap();
    /// assert_eq!((header.shape, header.length), (Shape::new(9, 9), told.bytes));
    /// assert_eq!((header.offset, header.max_error), (100.0, told.max_error)); // metres
    /// assert!(header.is_lossy());
    /// bytes[8] ^= 1;
    /// assert_eq!(Header::read(&bytes), Err(CodecError::Header));
    /// ```
    ///
    /// # Errors
    /// Too short, another magic or version, damage.
    pub fn read(bytes: &[u8]) -> Result<Header, CodecError> {
        if bytes.len() >= 2 && bytes[..2] != MAGIC {
            return Err(CodecError::Magic);
        }
        let h: &[u8; HEADER] = bytes.first_chunk().ok_or(CodecError::Truncated)?;
        if h[2] >> 4 != VERSION {
            return Err(CodecError::Version(h[2] >> 4));
        }
        if CRC16.checksum(&h[..23]).to_le_bytes() != h[23..] {
            return Err(CodecError::Header);
        }
        let float = |at: usize| f32::from_le_bytes([h[at], h[at + 1], h[at + 2], h[at + 3]]);
        let short = |at: usize| usize::from(u16::from_le_bytes([h[at], h[at + 1]]));
        let header = Header {
            shape: Shape::new(short(3), short(5)),
            offset: float(7),
            quantum: float(11),
            max_error: float(15),
            length: u32::from_le_bytes([h[19], h[20], h[21], h[22]]) as usize,
            flags: h[2] & 15,
        };
        let sane = header.offset.is_finite() && header.quantum > 0.0 && header.quantum.is_finite();
        check_shape(header.shape)?;
        if !sane || header.length < HEADER + TRAILER {
            return Err(CodecError::Header);
        }
        Ok(header)
    }

    pub(super) fn write(&self, out: &mut [u8]) {
        out[..2].copy_from_slice(&MAGIC);
        out[2] = VERSION << 4 | self.flags;
        out[3..5].copy_from_slice(&(self.shape.rows as u16).to_le_bytes());
        out[5..7].copy_from_slice(&(self.shape.columns as u16).to_le_bytes());
        out[7..11].copy_from_slice(&self.offset.to_le_bytes());
        out[11..15].copy_from_slice(&self.quantum.to_le_bytes());
        out[15..19].copy_from_slice(&self.max_error.to_le_bytes());
        out[19..23].copy_from_slice(&(self.length as u32).to_le_bytes());
        let sum = CRC16.checksum(&out[..23]);
        out[23..25].copy_from_slice(&sum.to_le_bytes());
    }

    pub(super) fn has(&self, flag: u8) -> bool {
        self.flags & flag != 0
    }

    /// Was precision given as a step, so that only the measured error bounds it?
    pub fn is_lossy(&self) -> bool {
        self.has(LOSSY)
    }

    #[inline]
    pub(super) fn height(&self, integer: i32) -> f32 {
        self.offset + self.quantum * integer as f32
    }
}

pub(super) fn check_shape(shape: Shape) -> Result<(), CodecError> {
    let good = |side: usize| (1..=LONGEST_SIDE).contains(&side);
    if good(shape.rows) && good(shape.columns) {
        Ok(())
    } else {
        Err(CodecError::Size(shape))
    }
}
