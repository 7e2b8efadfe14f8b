//! Recognising a scan line.

use rugosa_wire::{Header, MAX_FRAME, Message, ScanLine, encode};
use std::hash::{DefaultHasher, Hash, Hasher};

/// A number for all that a line says: the hash of its frame.
pub fn of_line(line: &ScanLine) -> u64 {
    let mut buffer = [0; MAX_FRAME];
    let message = Message::Line(line.clone());
    let length = encode(&Header::default(), &message, &mut buffer).unwrap_or(0);
    let mut hasher = DefaultHasher::new();
    buffer[..length].hash(&mut hasher);
    hasher.finish()
}
