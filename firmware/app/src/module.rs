//! The module: receive → map → send, for ever.
//!
//! Timing contract: one turn of the loop takes at most one event from each port and
//! makes at most one frame for each. Nothing waits for a slow listener. What follows a
//! sweep (roughness, reconstruction) is done at one go; meanwhile the receive queue and
//! the scanner's credit bridge the gap, so that no line is lost however long it takes.

use crate::channel::Channel;
use crate::design_parameters::PORTS;
use crate::mapping::Costs;
use crate::platform::Platform;
use crate::report::Report;
use rugosa::Mapper;
use rugosa_wire::{
    Ack, Configure, Event, Frame, Hello, Message, Role, Verdict, capability, self_test,
};

const CAPABILITIES: u32 = capability::FLOW_CONTROL
    | capability::ROUGHNESS
    | capability::RECONSTRUCTION
    | capability::TRAVERSABILITY;

/// The whole state of the firmware.
pub struct Module<'m, P: Platform> {
    platform: P,
    channels: [Channel; PORTS],
    mapper: Mapper<'m>,
    costs: Costs,
    report: Report,
}

impl<'m, P: Platform> Module<'m, P> {
    /// A module on `platform`.
    pub fn new(mut platform: P, mapper: Mapper<'m>) -> Self {
        let mut hello = Hello::new(Role::Module, P::NAME, env!("CARGO_PKG_VERSION"));
        hello.capabilities = CAPABILITIES;
        hello.map_side = mapper.window().side() as u16;
        hello.resolution_um = (mapper.config().resolution * 1e6) as u32;
        let session = platform.session();
        let channels = core::array::from_fn(|_| Channel::new(hello.clone(), session));
        Module {
            platform,
            channels,
            mapper,
            costs: Costs::default(),
            report: Report::default(),
        }
    }

    /// For ever.
    pub fn run(mut self) -> ! {
        loop {
            let busy = (0..PORTS).fold(false, |busy, side| self.turn(side) | busy);
            self.platform.feed_watchdog();
            if !busy {
                self.platform.sleep();
            }
        }
    }

    /// One turn of one port; `false`: there was nothing to do.
    fn turn(&mut self, side: usize) -> bool {
        let channel = &mut self.channels[side];
        channel.flush(&mut self.platform.ports()[side]);
        if !channel.is_idle() {
            return false; // what could not be answered is not read
        }
        let busy = self.receive(side) | self.send(side);
        self.channels[side].flush(&mut self.platform.ports()[side]);
        busy
    }

    fn receive(&mut self, side: usize) -> bool {
        let (now, start) = (self.platform.now_us(), self.platform.count());
        let port = &mut self.platform.ports()[side];
        let event = self.channels[side].receive(port, now);
        let cost = self.platform.count().wrapping_sub(start);
        self.costs.receive = self.costs.receive.wrapping_add(cost);
        match event {
            None => return false,
            Some(Event::Message(frame)) => self.take(side, frame),
            Some(event) => self.note(side, &event),
        }
        true
    }

    fn note(&mut self, side: usize, event: &Event) {
        match event {
            Event::Connected { resumed } => self.connected(side, *resumed),
            Event::Silent => defmt::warn!("port {=usize}: the peer is silent", side),
            Event::Refused(_) => defmt::error!("port {=usize}: another protocol", side),
            Event::Broken(_) | Event::Message(_) => {} // the link counts them
        }
    }

    fn connected(&mut self, side: usize, resumed: bool) {
        let is = |role| self.channels[side].is_to(role);
        let (scanner, host) = (is(Role::Scanner), is(Role::Host));
        defmt::info!(
            "port {=usize}: connected (scanner {=bool}, resumed {=bool})",
            side,
            scanner,
            resumed
        );
        if scanner && !resumed {
            self.mapper.new_session();
            self.channels[side].offer_afresh();
        }
        if host {
            self.report.status_is_due();
        }
    }

    fn take(&mut self, side: usize, frame: Frame) {
        let sequence = frame.header.sequence;
        match &frame.message {
            Message::Configure(configure) => self.configure(side, sequence, configure),
            Message::Refresh => rugosa::outbox::refresh(&mut self.mapper),
            Message::Reset => {
                self.acknowledge(side, sequence, Verdict::Accepted);
                self.platform.restart()
            }
            message if self.channels[side].self_test.take(message) => {}
            message => {
                self.channels[side].offer(message);
                if self.costs.take(&self.platform, &mut self.mapper, message) {
                    self.report.status_is_due();
                }
            }
        }
    }

    fn configure(&mut self, side: usize, sequence: u16, configure: &Configure) {
        let test = (self_test::STALL..=self_test::HANG).contains(&configure.parameter);
        let verdict = if test {
            Verdict::Accepted
        } else {
            self.mapper.configure(configure)
        };
        self.acknowledge(side, sequence, verdict);
        match configure.parameter {
            self_test::STALL => self.stall(configure.value),
            self_test::PANIC => panic!("as asked for"),
            self_test::HANG => hang(),
            _ => {}
        }
    }

    /// As if a stage took so long: alive, but deaf.
    fn stall(&mut self, seconds: f32) {
        let end = self.platform.now_us() + (seconds * 1e6) as u64;
        while self.platform.now_us() < end {
            self.platform.feed_watchdog();
        }
    }

    fn acknowledge(&mut self, side: usize, sequence: u16, verdict: Verdict) {
        let now = self.platform.now_us();
        let ack = Message::Ack(Ack { sequence, verdict });
        let _ = self.channels[side].send(&ack, now); // without a connection nobody waits for it
        self.channels[side].flush(&mut self.platform.ports()[side]);
    }

    /// Makes the next frame for a port; `false`: none is due.
    fn send(&mut self, side: usize) -> bool {
        let now = self.platform.now_us();
        let channel = &mut self.channels[side];
        if !channel.is_idle() || channel.tend(now) {
            return true;
        }
        if !channel.is_to(Role::Host) {
            return false;
        }
        let start = self.platform.count();
        let message = self.next_message(now);
        if let Some(message) = &message {
            let _ = self.channels[side].send(message, now); // just seen to be connected
        }
        let cost = self.platform.count().wrapping_sub(start);
        self.costs.send = self.costs.send.wrapping_add(cost);
        message.is_some()
    }

    fn next_message(&mut self, now_us: u64) -> Option<Message> {
        if self.report.take_status(now_us) {
            self.enter_levels();
            return Some(self.report.status(&self.mapper, now_us));
        }
        self.report.patch(&mut self.mapper, now_us)
    }

    /// Writes what the mapper cannot know to the counters.
    fn enter_levels(&mut self) {
        let lines = self.channels.iter().position(|c| c.is_to(Role::Scanner));
        let side = lines.unwrap_or(0);
        let (restarts, stack) = (self.platform.restarts(), self.platform.stack_high_water());
        let port = &self.platform.ports()[side];
        crate::report::enter_levels(&mut self.mapper, &self.channels[side], port);
        crate::report::enter_health(&mut self.mapper, &restarts, stack);
    }
}

/// Until the watchdog bites. Without the processor's `yield`, for which an emulator
/// stops after every instruction.
fn hang() -> ! {
    loop {
        core::hint::black_box(());
    }
}
