//! The quick profile: what interpolation does not tell, packed in as many bits as the
//! greatest of a few numbers needs.
//!
//! Nodes of every lattice are predicted from the next coarser one by the wavelet's own
//! interpolation, without its means (`lifting.rs`), and the differences, always integers,
//! written row by row. A block of up to 32 of one row, each folded to 2 |d| − [d < 0]:
//!
//! | size | field |
//! |---|---|
//! | 1 | bits of a number, 0 … 32 |
//! | ⌈count · bits / 8⌉ | numbers, the lowest bit first |
//!
//! No arithmetic coder and no contexts, so a number costs a few instructions; the bits that
//! these would save, a fifth on natural ground, are the price. Unknown cells come first, as
//! lengths of runs (known, unknown, known, …) in groups of seven bits.

use super::band::Band;
use super::lifting;
use crate::surfaces::Shape;

/// Numbers of a block.
const BLOCK: usize = 32;
/// Bytes of a block's numbers and as many as one reading reaches beyond them.
const WINDOW: usize = 4 * BLOCK + 8;

/// The samples of the coarsest lattice, as a band.
fn coarsest(shape: Shape, levels: u32) -> Band {
    let step = 1 << levels;
    Band {
        level: levels,
        rows_high: false,
        columns_high: false,
        rows: lifting::on(shape.rows, step),
        columns: lifting::on(shape.columns, step),
        first: 0,
        down: step * shape.columns,
        right: step,
    }
}

/// Bytes into lent memory.
pub(super) struct Writer<'a> {
    out: &'a mut [u8],
    length: usize,
}

impl<'a> Writer<'a> {
    pub fn new(out: &'a mut [u8]) -> Self {
        Writer { out, length: 0 }
    }

    /// Bytes written; `None` if there was no room for all.
    pub fn finish(self) -> Option<usize> {
        (self.length <= self.out.len()).then_some(self.length)
    }

    fn push(&mut self, bytes: &[u8]) {
        let end = self.length + bytes.len();
        if let Some(to) = self.out.get_mut(self.length..end) {
            to.copy_from_slice(bytes);
        }
        self.length = end;
    }

    /// Where cells are unknown.
    pub fn unknown(&mut self, cells: impl Iterator<Item = bool>) {
        let (mut run, mut state) = (0, false);
        for cell in cells {
            if cell != state {
                self.length_of_run(run);
                (run, state) = (0, cell);
            }
            run += 1;
        }
        self.length_of_run(run);
    }

    fn length_of_run(&mut self, mut run: usize) {
        while run > 127 {
            self.push(&[run as u8 | 128]);
            run >>= 7;
        }
        self.push(&[run as u8]);
    }

    /// All lattices of `grid`, the coarsest first.
    pub fn levels(&mut self, grid: &[i32], shape: Shape, levels: u32) {
        self.band(grid, &coarsest(shape, levels));
        for level in (1..=levels).rev() {
            for band in Band::of_level(shape, level) {
                self.band(grid, &band);
            }
        }
    }

    fn band(&mut self, grid: &[i32], band: &Band) {
        for row in 0..band.rows {
            for column in (0..band.columns).step_by(BLOCK) {
                let count = BLOCK.min(band.columns - column);
                let cells = grid[band.at(row, column)..].iter().step_by(band.right);
                let mut numbers = [0; BLOCK];
                for (number, &cell) in numbers[..count].iter_mut().zip(cells) {
                    *number = folded(cell);
                }
                self.block(&numbers, count);
            }
        }
    }

    fn block(&mut self, numbers: &[u32; BLOCK], count: usize) {
        let bits = 32 - numbers.iter().fold(0, |all, n| all | n).leading_zeros();
        let mut bytes = [0; 1 + WINDOW];
        bytes[0] = bits as u8;
        let (mut pending, mut held, mut at) = (0u64, 0, 1);
        for &number in numbers {
            pending |= u64::from(number) << held;
            held += bits;
            if held >= 32 {
                bytes[at..at + 4].copy_from_slice(&(pending as u32).to_le_bytes());
                (pending, held, at) = (pending >> 32, held - 32, at + 4);
            }
        }
        bytes[at..at + 4].copy_from_slice(&(pending as u32).to_le_bytes());
        self.push(&bytes[..1 + size(count, bits)]);
    }
}

/// Bytes of `count` numbers.
fn size(count: usize, bits: u32) -> usize {
    (count * bits as usize).div_ceil(8)
}

/// The sign in the lowest bit, so that small numbers have few bits.
fn folded(number: i32) -> u32 {
    (number << 1 ^ number >> 31) as u32
}

fn unfolded(number: u32) -> i32 {
    (number >> 1) as i32 ^ -((number & 1) as i32)
}

/// Bytes that end somewhere.
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
}

impl<'a> Reader<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        Reader { bytes }
    }

    /// Tells of every one of `count` cells whether it is unknown; `None` if the bytes end or
    /// the runs do not fit.
    pub fn unknown(&mut self, count: usize, mut mark: impl FnMut(usize, bool)) -> Option<()> {
        let (mut at, mut state) = (0, false);
        while at < count {
            let run = self.length_of_run()?;
            let end = at.checked_add(run).filter(|end| *end <= count)?;
            (at..end).for_each(|cell| mark(cell, state));
            (at, state) = (end, !state);
        }
        Some(())
    }

    fn length_of_run(&mut self) -> Option<usize> {
        let mut run = 0;
        for shift in [0, 7, 14, 21] {
            let (&byte, rest) = self.bytes.split_first()?;
            self.bytes = rest;
            run |= usize::from(byte & 127) << shift;
            if byte < 128 {
                return Some(run);
            }
        }
        None
    }

    /// The coarsest lattice; `None` if the bytes end before it does.
    pub fn coarsest(&mut self, grid: &mut [i32], shape: Shape, levels: u32) -> Option<()> {
        self.band(grid, &coarsest(shape, levels))
    }

    /// What a level adds; `None` if the bytes end before it does.
    pub fn level(&mut self, grid: &mut [i32], shape: Shape, level: u32) -> Option<()> {
        let bands = Band::of_level(shape, level);
        bands.iter().try_for_each(|band| self.band(grid, band))
    }

    fn band(&mut self, grid: &mut [i32], band: &Band) -> Option<()> {
        for row in 0..band.rows {
            for column in (0..band.columns).step_by(BLOCK) {
                let count = BLOCK.min(band.columns - column);
                let numbers = self.block(count)?;
                spread(
                    &numbers[..count],
                    &mut grid[band.at(row, column)..],
                    band.right,
                );
            }
        }
        Some(())
    }

    #[inline(always)]
    fn block(&mut self, count: usize) -> Option<[i32; BLOCK]> {
        let (&bits, rest) = self.bytes.split_first()?;
        let bits = u32::from(bits.min(32));
        let size = size(count, bits);
        let (own, after) = rest.split_at_checked(size)?;
        self.bytes = after;
        Some(match rest.first_chunk::<WINDOW>() {
            Some(window) => unpacked(window, bits),
            None => {
                let mut window = [0; WINDOW];
                window[..size].copy_from_slice(own);
                unpacked(&window, bits)
            }
        })
    }
}

/// Numbers to every `right`-th cell.
#[inline(always)]
fn spread(numbers: &[i32], cells: &mut [i32], right: usize) {
    // the finest level, three quarters of all, without a check for each
    if right == 2
        && let Some(numbers) = numbers.first_chunk::<BLOCK>()
        && let Some(pairs) = cells.as_chunks_mut::<2>().0.first_chunk_mut::<BLOCK>()
    {
        for (pair, &number) in pairs.iter_mut().zip(numbers) {
            pair[0] = number;
        }
        return;
    }
    for (cell, &number) in cells.iter_mut().step_by(right).zip(numbers) {
        *cell = number;
    }
}

#[inline(always)]
fn unpacked(window: &[u8; WINDOW], bits: u32) -> [i32; BLOCK] {
    let mask = (1u64 << bits) - 1;
    let from = |number: usize| {
        let at = number * bits as usize;
        let eight = window[at / 8..].first_chunk().copied().unwrap_or([0; 8]);
        u64::from_le_bytes(eight) >> (at % 8)
    };
    if bits > FOUR_AT_ONCE {
        return core::array::from_fn(|i| unfolded((from(i) & mask) as u32));
    }
    let mut numbers = [0; BLOCK];
    for (i, four) in numbers.as_chunks_mut::<4>().0.iter_mut().enumerate() {
        let word = from(4 * i);
        let cut: [u32; 4] = core::array::from_fn(|k| (word >> (k as u32 * bits) & mask) as u32);
        *four = cut.map(unfolded);
    }
    numbers
}

/// Most bits of which four numbers, and the place in a byte where they begin, fit 64.
const FOUR_AT_ONCE: u32 = 15;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec;
    use std::vec::Vec;

    proptest! {
        #[test]
        fn numbers_of_any_size_come_back(
            rows in 1usize..40, columns in 1usize..80, shift in 0u32..32, seed: u32
        ) {
            let shape = Shape::new(rows, columns);
            let number = |i: usize| (i as u32 ^ seed).wrapping_mul(2654435761) as i32 >> shift;
            let grid: Vec<i32> = (0..shape.len()).map(number).collect();
            let levels = lifting::levels(shape);
            let mut bytes = vec![0; 8 * shape.len() + 64];
            let mut writer = Writer::new(&mut bytes);
            writer.levels(&grid, shape, levels);
            let length = writer.finish().unwrap();
            let (mut back, mut reader) = (vec![0; shape.len()], Reader::new(&bytes[..length]));
            reader.coarsest(&mut back, shape, levels).unwrap();
            for level in (1..=levels).rev() {
                reader.level(&mut back, shape, level).unwrap();
            }
            prop_assert_eq!(back, grid);
            prop_assert!(reader.bytes.is_empty());
        }

        #[test]
        fn runs_come_back(cells in prop::collection::vec(any::<bool>(), 1..600), stretch in 1usize..300) {
            let cells: Vec<bool> = cells.iter().flat_map(|&c| core::iter::repeat_n(c, stretch)).collect();
            let mut bytes = vec![0; cells.len() + 8];
            let mut writer = Writer::new(&mut bytes);
            writer.unknown(cells.iter().copied());
            let length = writer.finish().unwrap();
            let mut back = vec![false; cells.len()];
            let told = Reader::new(&bytes[..length]).unknown(cells.len(), |i, c| back[i] = c);
            prop_assert_eq!(told, Some(()));
            prop_assert_eq!(back, cells);
        }
    }
}
