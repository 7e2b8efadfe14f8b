//! What the host is told, and when: status after each sweep and every second, patches
//! of the map at a bounded rate.

use crate::channel::Channel;
use crate::design_parameters::{PATCH_US, STATUS_US};
use crate::platform::{Port, Restarts};
use rugosa::{Mapper, Outbox};
use rugosa_wire::{Message, Status, counter};

/// When the next messages are due.
#[derive(Default)]
pub struct Report {
    outbox: Outbox,
    patches: u32,
    status_due: bool,
    status_us: u64,
    patch_us: u64,
}

impl Report {
    /// There is news: a sweep has ended, a host has come.
    pub fn status_is_due(&mut self) {
        self.status_due = true;
    }

    /// Is a status due? Then the next one is not until there is news or a second is over.
    pub fn take_status(&mut self, now_us: u64) -> bool {
        let due = self.status_due || now_us >= self.status_us;
        if due {
            (self.status_due, self.status_us) = (false, now_us + STATUS_US);
        }
        due
    }

    /// All counters.
    pub fn status(&self, mapper: &Mapper, now_us: u64) -> Message {
        let counters = mapper.counters().all();
        Message::Status(Status {
            sweep: mapper.sweep(),
            uptime_us: now_us,
            counters: counters.iter().copied().collect(),
        })
    }

    /// The next patch of the map, if one is waiting and it is time for one.
    pub fn patch(&mut self, mapper: &mut Mapper, now_us: u64) -> Option<Message> {
        if now_us < self.patch_us {
            return None;
        }
        let patch = self.outbox.next(mapper)?;
        self.patch_us = now_us + PATCH_US;
        self.patches = self.patches.wrapping_add(1);
        mapper
            .counters_mut()
            .set(counter::PATCHES_SENT, self.patches);
        Some(Message::Patch(patch))
    }
}

/// Writes the counters of a link and its port among all.
pub fn enter_levels(mapper: &mut Mapper, channel: &Channel, port: &impl Port) {
    let counters = mapper.counters_mut();
    channel.link.fill(counters.all_mut());
    counters.set(
        counter::LINK_OVERRUN,
        port.dropped().wrapping_add(channel.errors()),
    );
    counters.set(counter::QUEUE_PEAK, port.fullest());
}

/// Writes resets and the depth of the stack.
pub fn enter_health(mapper: &mut Mapper, restarts: &Restarts, stack: u32) {
    let counters = mapper.counters_mut();
    counters.set(counter::RESTARTS, restarts.total());
    counters.set(counter::PANICS, restarts.panic);
    counters.set(counter::WATCHDOGS, restarts.watchdog);
    counters.set(counter::STACK_PEAK, stack);
}
