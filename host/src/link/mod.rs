//! Serial ports: found by name or by USB serial number, kept open, read in a thread.
//!
//! ```no_run
//! use rugosa_host::link::{Connection, News, Settings};
//! use rugosa_wire::{Event, Hello, Role};
//! use std::time::Duration;
//! # fn main() -> rugosa_host::error::Result<()> {
//! let hello = Hello::new(Role::Host, "rugosa", env!("CARGO_PKG_VERSION"));
//! let connection = Connection::open(Settings::new("/dev/ttyACM0", hello))?;
//! while let Some(arrival) = connection.next(Duration::from_secs(3)) {
//!     match arrival.news {
//!         News::Link(Event::Message(frame)) => println!("{}", frame.message.kind()),
//!         other => eprintln!("{:9} us {other:?}", arrival.time_us),
//!     }
//! }
//! # Ok(()) }
//! ```
//!
//! - [`port`]: names of ports, opening, clear errors
//! - [`connection`]: the thread around [`rugosa_wire::Link`]: handshake, heartbeat,
//!   credit, counters, round-trip time, and opening the port again after it disappeared
//!
//! Pseudo-terminals are ports like any other.

pub mod connection;
pub mod port;
mod worker;

pub use connection::{Arrival, Connection, Latency, News, Settings, State};
pub use port::{BAUD_RATES, PortName};
