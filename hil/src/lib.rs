//! Hardware in the loop: the firmware runs in an emulator, a scanner streams into it
//! over a serial line with faults, and a twin on the host maps the same bytes.
//!
//! ```text
//!  messages → feeder → line (baud rate, faults) ─┬→ UART 0 of the emulator → module
//!                                                └→ twin: link and mapper of the host
//!  module → UART 1 → listener: status, map patches, answers
//! ```
//!
//! The twin gets exactly the bytes that the module gets, behind the faults. So whatever
//! was lost or broken on the way, module and twin have to agree in every bit: the digest
//! of the map after every sweep, all counters at the end, and the map that the module
//! has sent.
//!
//! One thread, no shared state: [`Bench::turn`] moves what can be moved and returns.

mod bench;
mod board_clock;
pub mod costs;
mod feeder;
mod fingerprint;
mod image;
mod listener;
mod log;
mod recorded;
mod scene;
mod schedule;
mod sent_map;
mod summary;
mod twin;

pub use bench::{Bench, Settings};
pub use feeder::Feeder;
pub use image::image;
pub use listener::Listener;
pub use log::{Entry, Log};
pub use recorded::split;
pub use scene::Scene;
pub use schedule::{ATTENDED_US, Lateness, Schedule};
pub use sent_map::{Extent, Sent, SentMap};
pub use summary::{Lines, Parity, Summary};
pub use twin::Twin;
