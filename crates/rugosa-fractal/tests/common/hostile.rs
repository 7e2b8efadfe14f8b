//! Bytes from outside for the codec's decoder; shared with the fuzz target `heights`.

use rugosa_fractal::codec::{self, CodecError, HEADER, Header};

/// Most nodes for which memory is lent.
const MOST: usize = 1 << 16;

/// Any bytes: an error or a map within the lent memory, never a panic.
pub fn anything(bytes: &[u8]) {
    let nodes = Header::read(bytes).map_or(0, |h| h.shape.len());
    let (mut work, mut out) = (vec![0; nodes.min(MOST)], vec![0.0; nodes.min(MOST)]);
    match codec::decode(bytes, (&mut work, &mut out)) {
        Ok(told) => assert!(told.step >= 1 && told.shape.len() <= nodes),
        Err(CodecError::Memory(needed, given)) => assert!(needed == nodes && given < needed),
        Err(_) => {}
    }
}

/// The same bytes with the magic, the length and both checksums made right, so that damage
/// is seen by everything behind them.
pub fn with_right_checksums(bytes: &[u8]) {
    let mut bytes = bytes.to_vec();
    bytes.resize(bytes.len().max(HEADER + 4), 0);
    let length = bytes.len();
    bytes[..2].copy_from_slice(b"RZ");
    bytes[2] = 0x10 | bytes[2] & 15;
    bytes[19..23].copy_from_slice(&(length as u32).to_le_bytes());
    let sum = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740).checksum(&bytes[..23]);
    bytes[23..25].copy_from_slice(&sum.to_le_bytes());
    anything(&bytes[..length - 4]);
    let sum = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&bytes[..length - 4]);
    bytes[length - 4..].copy_from_slice(&sum.to_le_bytes());
    anything(&bytes);
}
