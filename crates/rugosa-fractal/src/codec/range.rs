//! Adaptive binary range coder.
//!
//! A decision with probability p of being true splits the range in proportion; 32-bit range,
//! carries propagate through pending bytes. The decoder never reads past its input: missing
//! bytes are zeros, counted. Probabilities adapt like counts at first (1/n), then
//! exponentially, so that a few hundred decisions already code well.
//!
//! Cost: two multiplications and at most two renormalisation steps per decision, a division
//! per 16 bits without a model.
//! Source: Martin 1979 (range coding); the carry handling is that of Schindler and of LZMA.

/// Probability that a decision is true, and how often it was asked.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chance {
    p: u16,
    count: u8,
}

/// Decisions after which adaptation is no longer a running mean.
const MEMORY: usize = 120;

impl Chance {
    /// A chance of `p`/65536 to begin with.
    pub const fn new(p: u16) -> Self {
        Chance { p, count: 0 }
    }

    /// Probability of true, in 65536ths.
    #[inline]
    pub fn of_true(&self) -> u32 {
        u32::from(self.p)
    }

    #[inline]
    fn learn(&mut self, bit: bool) {
        let target = if bit { 65_535 - 16 } else { 16 };
        let rate = i32::from(RATES[usize::from(self.count)]);
        let step = (target - i32::from(self.p)) * rate;
        self.p = (i32::from(self.p) + (step >> 16)) as u16;
        self.count = self.count.saturating_add(1);
    }
}

/// 65536 / (n + 16): the first guess weighs as much as 15 decisions.
const RATES: [u16; 256] = {
    let mut rates = [0; 256];
    let mut n = 0;
    while n < rates.len() {
        let seen = if n < MEMORY { n } else { MEMORY };
        rates[n] = (65_536 / (seen + 16)) as u16;
        n += 1;
    }
    rates
};

/// Most bits that are coded at once without a model.
const CHUNK: u32 = 16;

/// What coding needs of either direction: the same code drives both.
pub(super) trait Coder {
    /// Is this an encoder?
    const ENCODES: bool;
    /// Codes one decision; returns it.
    fn bit(&mut self, chance: &mut Chance, bit: bool) -> bool;
    /// Codes the low `count` bits of `value` at one bit each; returns them.
    fn raw(&mut self, value: u32, count: u32) -> u32;
}

/// Writes decisions into a slice.
pub(super) struct Encoder<'a> {
    low: u64,
    range: u32,
    held: Option<u8>,
    pending: usize,
    out: &'a mut [u8],
    length: usize,
}

impl<'a> Encoder<'a> {
    pub fn new(out: &'a mut [u8]) -> Self {
        Encoder {
            low: 0,
            range: u32::MAX,
            held: None,
            pending: 0,
            out,
            length: 0,
        }
    }

    /// Has more been written than there is room for?
    pub fn is_full(&self) -> bool {
        self.length > self.out.len()
    }

    /// Ends the stream; the number of bytes, `None` if they did not fit.
    pub fn finish(mut self) -> Option<usize> {
        // the shortest number within the range
        for zeros in [31, 24, 16, 8, 0] {
            let rounded = ((self.low >> zeros) + 1) << zeros;
            if rounded < self.low + u64::from(self.range) {
                self.low = rounded;
                break;
            }
        }
        (0..5).for_each(|_| self.shift());
        if self.length > self.out.len() {
            return None;
        }
        while self.length > 0 && self.out[self.length - 1] == 0 {
            self.length -= 1;
        }
        Some(self.length)
    }

    fn put(&mut self, byte: u8) {
        if let Some(slot) = self.out.get_mut(self.length) {
            *slot = byte;
        }
        self.length += 1;
    }

    fn shift(&mut self) {
        if self.low < 0xff00_0000 || self.low > 0xffff_ffff {
            let carry = (self.low >> 32) as u8;
            if let Some(byte) = self.held {
                self.put(byte.wrapping_add(carry));
            }
            for _ in 0..self.pending {
                self.put(0xff_u8.wrapping_add(carry));
            }
            self.pending = 0;
            self.held = Some((self.low >> 24) as u8);
        } else {
            self.pending += 1;
        }
        self.low = (self.low & 0x00ff_ffff) << 8;
    }

    #[inline]
    fn normalise(&mut self) {
        while self.range < 1 << 24 {
            self.range <<= 8;
            self.shift();
        }
    }
}

impl Coder for Encoder<'_> {
    const ENCODES: bool = true;

    #[inline]
    fn bit(&mut self, chance: &mut Chance, bit: bool) -> bool {
        let bound = (self.range >> 16) * chance.of_true();
        if bit {
            self.range = bound;
        } else {
            self.low += u64::from(bound);
            self.range -= bound;
        }
        chance.learn(bit);
        self.normalise();
        bit
    }

    #[inline]
    fn raw(&mut self, value: u32, count: u32) -> u32 {
        let mut left = count;
        while left > 0 {
            let chunk = left.min(CHUNK);
            left -= chunk;
            self.range >>= chunk;
            let bits = value >> left & ((1 << chunk) - 1);
            self.low += u64::from(self.range) * u64::from(bits);
            self.normalise();
        }
        value
    }
}

/// Reads decisions from a slice.
pub(super) struct Decoder<'a> {
    range: u32,
    code: u32,
    input: &'a [u8],
    position: usize,
}

impl<'a> Decoder<'a> {
    pub fn new(input: &'a [u8]) -> Self {
        let mut decoder = Decoder {
            range: u32::MAX,
            code: 0,
            input,
            position: 0,
        };
        (0..4).for_each(|_| decoder.take());
        decoder
    }

    /// Were bytes asked for that are not there?
    pub fn is_exhausted(&self) -> bool {
        self.position > self.input.len()
    }

    #[inline]
    fn take(&mut self) {
        let byte = self.input.get(self.position).copied().unwrap_or(0);
        self.position += 1;
        self.code = self.code << 8 | u32::from(byte);
    }

    #[inline]
    fn normalise(&mut self) {
        while self.range < 1 << 24 {
            self.range <<= 8;
            self.take();
        }
    }
}

impl Coder for Decoder<'_> {
    const ENCODES: bool = false;

    #[inline]
    fn bit(&mut self, chance: &mut Chance, _: bool) -> bool {
        let bound = (self.range >> 16) * chance.of_true();
        let bit = self.code < bound;
        if bit {
            self.range = bound;
        } else {
            self.code -= bound;
            self.range -= bound;
        }
        chance.learn(bit);
        self.normalise();
        bit
    }

    #[inline]
    fn raw(&mut self, _: u32, count: u32) -> u32 {
        let (mut value, mut left) = (0, count);
        while left > 0 {
            let chunk = left.min(CHUNK);
            left -= chunk;
            self.range >>= chunk;
            // damaged data may point beyond the range
            let bits = (self.code / self.range).min((1 << chunk) - 1);
            self.code -= bits * self.range;
            value = value << chunk | bits;
            self.normalise();
        }
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::{vec, vec::Vec};

    proptest! {
        #[test]
        fn what_goes_in_comes_out(bits in prop::collection::vec((any::<bool>(), 0usize..4, 0u32..9), 0..3000)) {
            let fresh = [60_000, 32_768, 3_000, 20].map(Chance::new);
            let mut out = vec![0; 8000];
            let mut encoder = Encoder::new(&mut out);
            let mut chances = fresh;
            for &(bit, which, raw) in &bits {
                encoder.bit(&mut chances[which], bit);
                encoder.raw(raw * 1234, 14);
            }
            let length = encoder.finish().unwrap();
            let mut decoder = Decoder::new(&out[..length]);
            let mut chances = fresh;
            for &(bit, which, raw) in &bits {
                prop_assert_eq!(decoder.bit(&mut chances[which], false), bit);
                prop_assert_eq!(decoder.raw(0, 14), raw * 1234);
            }
        }
    }

    #[test]
    fn rare_events_cost_little() {
        let mut out = [0; 1000];
        let mut encoder = Encoder::new(&mut out);
        let mut chance = Chance::new(1000);
        let bits: Vec<bool> = (0..20_000).map(|i| i % 200 == 7).collect();
        bits.iter().for_each(|&b| {
            encoder.bit(&mut chance, b);
        });
        let length = encoder.finish().unwrap();
        // entropy of 1/200: 0.0454 bits
        assert!(length < 20_000 * 54 / 8000, "{length}");
    }
}
