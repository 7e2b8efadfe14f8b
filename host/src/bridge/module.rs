//! The module of the host: mapper, recording, rates. No port and no clock.

use super::traffic::Traffic;
use crate::error::Result;
use crate::link::State;
use crate::recording::Recorder;
use rugosa::{Mapper, SweepReport};
use rugosa_wire::{Frame, Hello, Message, Role, capability, counter};
use std::time::Instant;

/// Mapper, and where the messages are recorded.
pub struct Module<'m> {
    /// the map
    pub mapper: Mapper<'m>,
    /// rates and latencies
    pub traffic: Traffic,
    /// the last sweep that is complete
    pub report: Option<SweepReport>,
    recorder: Option<Recorder>,
    /// lines have been mapped since the last report
    open: bool,
}

impl<'m> Module<'m> {
    /// A module with an empty map.
    pub fn new(mapper: Mapper<'m>) -> Self {
        Module {
            mapper,
            traffic: Traffic::default(),
            report: None,
            recorder: None,
            open: false,
        }
    }

    /// From now on everything is recorded.
    pub fn record_into(&mut self, recorder: Recorder) {
        self.recorder = Some(recorder);
    }

    /// What it says of itself on a link.
    pub fn hello(&self) -> Hello {
        let mut hello = Hello::new(Role::Module, "rugosa host", env!("CARGO_PKG_VERSION"));
        hello.capabilities = capability::ROUGHNESS | capability::FLOW_CONTROL;
        hello.map_side = self.mapper.window().side() as u16;
        hello.resolution_um = (self.mapper.config().resolution * 1e6) as u32;
        hello
    }

    /// Records a frame, if a recording is being made.
    pub fn record(&mut self, from: Role, time_us: u64, frame: &Frame) -> Result<()> {
        match &mut self.recorder {
            Some(recorder) => recorder.record(from, time_us, frame),
            None => Ok(()),
        }
    }

    /// Maps a message that came at `now_us`.
    pub fn take(&mut self, message: &Message, now_us: u64) {
        if let Message::Line(line) = message {
            self.traffic.line(line.stamp_us, now_us);
            self.open = true;
        }
        let started = Instant::now();
        if let Some(report) = self.mapper.message(message) {
            self.reported(report, started);
        }
    }

    /// No more lines will come: what has come of a sweep in progress goes into the map.
    pub fn close(&mut self) {
        if self.open {
            let started = Instant::now();
            let report = self.mapper.commit(&mut |_| {});
            self.reported(report, started);
        }
    }

    fn reported(&mut self, report: SweepReport, started: Instant) {
        self.traffic.sweep.add(started.elapsed().as_micros() as u64);
        self.report = Some(report);
        self.open = false;
    }

    /// The scanner has started afresh: its clock too.
    pub fn new_session(&mut self) {
        self.mapper.new_session();
        self.traffic.new_session();
    }

    /// Takes over what the link counted.
    pub fn link_state(&mut self, state: &State) {
        let counters = self.mapper.counters_mut();
        let of_link = counter::LINK_BYTES..=counter::LINK_SILENCES;
        for index in of_link.chain([counter::CREDIT_LIMIT]) {
            counters.set(index, state.counters[index]);
        }
        self.traffic.round_trip = state.latency;
    }

    /// Completes the recording, if there is one.
    pub fn finish(&mut self) -> Result<()> {
        self.recorder.take().map_or(Ok(()), Recorder::finish)
    }
}
