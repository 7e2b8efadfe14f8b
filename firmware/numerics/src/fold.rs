//! Folding bits into one number, and inputs to take them from.

/// FNV-1a over 32-bit words.
#[derive(Clone, Copy)]
pub struct Fold(u32);

impl Fold {
    /// The fingerprint of nothing.
    pub const fn new() -> Self {
        Fold(0x811c_9dc5)
    }

    /// Takes an integer in.
    pub fn word(&mut self, word: u32) {
        self.0 = (self.0 ^ word).wrapping_mul(0x0100_0193);
        self.0 ^= self.0 >> 15;
    }

    /// Takes a number in, bit by bit; all NaN are one, as processors sign theirs
    /// differently.
    pub fn float(&mut self, x: f32) {
        self.word(if x.is_nan() { 0x7fc0_0000 } else { x.to_bits() });
    }

    /// The fingerprint.
    pub fn finish(self) -> u32 {
        self.0
    }
}

impl Default for Fold {
    fn default() -> Self {
        Self::new()
    }
}

/// Folds `function` of `n` inputs spread over `from … to`.
pub fn over(from: f32, to: f32, n: u32, function: impl Fn(&mut Fold, f32)) -> u32 {
    let mut fold = Fold::new();
    let step = (to - from) / n as f32;
    for i in 0..n {
        // a little off the raster, so that no input is a round number
        let x = from + (i as f32 + (i % 7) as f32 * 0.1327) * step;
        function(&mut fold, x);
    }
    fold.finish()
}
