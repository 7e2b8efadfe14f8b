//! Every number of the firmware that is a choice, with the arithmetic behind it.

use rugosa_wire::MAX_FRAME;

/// Serial ports. They are equal; what a port is used for is decided by who greets on it.
pub const PORTS: usize = 2;

/// Bytes taken from a port at a time: 22 ms of a line at 115,200 Bd.
pub const CHUNK: usize = 256;

/// Scan lines that may be under way to us or wait in the receive queue, however long.
pub const LINES_GRANTED: u16 = 6;

/// The same at most, when lines are short.
const MOST_LINES_GRANTED: usize = 16;

/// Bytes of poses and the like that may come with each line.
const BESIDE_A_LINE: usize = 96;

/// Bytes a board's receive queue must hold: [`LINES_GRANTED`] lines never overrun it.
pub const RECEIVE_QUEUE: usize = LINES_GRANTED as usize * (MAX_FRAME + BESIDE_A_LINE);

/// Lines of which none is longer than `longest` bytes that fit the queue. Should a scanner
/// send longer ones later, those that find no room are counted as overrun. The work after
/// the first sweep takes 0.5 s in the emulator; at 24 lines a second twelve are under way for
/// so long, and of 256 returns each the queue holds thirteen.
pub fn lines_granted(longest: usize) -> u16 {
    let fit = RECEIVE_QUEUE / (longest + BESIDE_A_LINE);
    fit.clamp(LINES_GRANTED.into(), MOST_LINES_GRANTED) as u16
}

/// Time between two status messages while nothing happens.
pub const STATUS_US: u64 = 1_000_000;

/// Least time between two map patches: 200 of about 90 bytes a second. A slower line
/// spreads them further, since a patch is made only when the last one is on its way.
pub const PATCH_US: u64 = 5_000;

/// Cells of the map along an edge: 6.5 m at the default resolution.
pub const SIDE: usize = 65;

/// Most columns of a scanner.
pub const COLUMNS: usize = rugosa::memory::COLUMNS;

/// Most lines of a scanner.
pub const LINES: usize = 256;
