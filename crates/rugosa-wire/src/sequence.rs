//! Running numbers of frames: what is missing, what came twice.
//!
//! A serial line keeps order, so a number up to half the circle ahead means that the
//! frames between were lost, and any other that the frame was seen before (or that more
//! than 32,767 were lost at once; the next greeting sets the count right).

/// The next number expected of a peer.
///
/// ```
/// use rugosa_wire::sequence::{Order, Sequence};
/// let mut expected = Sequence::after(65534);
/// assert_eq!(expected.judge(65535), Order::New { lost: 0 });
/// assert_eq!(expected.missing(3), 3); // the numbers wrap: 0, 1 and 2
/// assert_eq!(expected.judge(3), Order::New { lost: 3 });
/// assert_eq!(expected.judge(3), Order::Duplicate);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sequence(u16);

/// Where a frame stands among those before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// new, and this many frames before it are missing
    New {
        /// frames lost
        lost: u16,
    },
    /// seen before
    Duplicate,
}

impl Sequence {
    /// Expects the number after `sequence`.
    pub fn after(sequence: u16) -> Self {
        Sequence(sequence.wrapping_add(1))
    }

    /// Frames that are missing before this one.
    pub fn missing(&self, sequence: u16) -> u16 {
        let lost = sequence.wrapping_sub(self.0);
        if lost > u16::MAX / 2 { 0 } else { lost }
    }

    /// Judges a frame; after a new one the number behind it is expected.
    pub fn judge(&mut self, sequence: u16) -> Order {
        let lost = sequence.wrapping_sub(self.0);
        if lost > u16::MAX / 2 {
            return Order::Duplicate;
        }
        *self = Sequence::after(sequence);
        Order::New { lost }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_and_duplicates_across_the_wrap() {
        let mut expected = Sequence::after(65_533);
        for (sequence, order) in [
            (65_534, Order::New { lost: 0 }),
            (65_534, Order::Duplicate),
            (1, Order::New { lost: 2 }),
            (65_535, Order::Duplicate),
            (2, Order::New { lost: 0 }),
            (32_770, Order::New { lost: 32_767 }),
            (3, Order::Duplicate),
        ] {
            assert_eq!(expected.judge(sequence), order, "{sequence}");
        }
    }
}
