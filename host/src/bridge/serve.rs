//! Hands a module what comes through a serial port, until told to stop.

use super::Module;
use crate::console::Console;
use crate::error::{Failure, Result};
use crate::link::{Arrival, Connection, News, Settings};
use rugosa_wire::{Ack, Event, Frame, Message, Role, Verdict};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How often progress is shown and the end is asked for.
const TICK: Duration = Duration::from_millis(50);

/// A port at which a module is served.
pub struct Bridge {
    connection: Connection,
    peer: Role,
    console: Console,
    port: String,
}

impl Bridge {
    /// Opens the port; it must be there now.
    pub fn open(settings: Settings, console: &Console) -> Result<Self> {
        let port = settings.port.to_string();
        Ok(Bridge {
            connection: Connection::open(settings)?,
            peer: Role::Scanner,
            console: *console,
            port,
        })
    }

    /// Serves `module` until `stop` is set or `done` says so; `done` is asked every
    /// 50 ms. A port that disappears is waited for.
    pub fn serve(
        &mut self,
        module: &mut Module,
        stop: &AtomicBool,
        mut done: impl FnMut(&Module) -> bool,
    ) -> Result<()> {
        let mut asked = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            if let Some(arrival) = self.connection.next(TICK) {
                self.arrival(&arrival, module)?;
            }
            if asked.elapsed() >= TICK {
                asked = Instant::now();
                module.link_state(&self.connection.state());
                if done(module) {
                    break;
                }
            }
        }
        module.link_state(&self.connection.state());
        Ok(())
    }

    fn arrival(&mut self, arrival: &Arrival, module: &mut Module) -> Result<()> {
        match &arrival.news {
            News::Link(Event::Message(frame)) => {
                self.answer(frame);
                module.record(self.peer, arrival.time_us, frame)?;
                module.take(&frame.message, arrival.time_us);
            }
            News::Link(Event::Connected { resumed }) => self.connected(*resumed, module),
            News::Link(Event::Refused(refusal)) => return Err(Failure::runtime(refusal)),
            News::Link(Event::Silent) => self
                .console
                .note("the scanner has fallen silent; greeting it again"),
            News::Link(Event::Broken(_)) => {} // counted by the link
            News::PortLost(why) => self.console.note(format_args!(
                "{} has disappeared ({why}); waiting for it",
                self.port
            )),
            News::PortFound => self
                .console
                .note(format_args!("{} is there again", self.port)),
        }
        Ok(())
    }

    fn connected(&mut self, resumed: bool, module: &mut Module) {
        if let Some(hello) = self.connection.state().peer {
            self.peer = hello.role;
            self.console.note(format_args!(
                "connected to {} {}",
                hello.device, hello.version
            ));
        }
        if !resumed {
            module.new_session();
        }
    }

    /// A host's map is configured by its file, not over the link.
    fn answer(&self, frame: &Frame) {
        if matches!(frame.message, Message::Configure(_)) {
            let ack = Ack {
                sequence: frame.header.sequence,
                verdict: Verdict::Unsupported,
            };
            let _ = self.connection.send(Message::Ack(ack));
        }
    }
}
