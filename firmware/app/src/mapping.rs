//! The mapper, with what its stages cost.

use crate::platform::Platform;
use rugosa::{Mapper, Stage};
use rugosa_wire::{Message, counter};

/// Counts of the platform's counter since the last sweep, by stage.
#[derive(Clone, Copy, Default)]
pub struct Costs {
    /// bytes to messages
    pub receive: u32,
    /// lines to cells
    pub lines: u32,
    /// messages to bytes
    pub send: u32,
}

impl Costs {
    /// Takes a message of the scanner; `true`: it ended a sweep.
    pub fn take<P: Platform>(
        &mut self,
        platform: &P,
        mapper: &mut Mapper,
        message: &Message,
    ) -> bool {
        let start = platform.count();
        let ended = match message {
            Message::SweepEnd(end) => {
                let mut stages = Stages::start(platform);
                let ended = mapper.sweep_end_observed(end, &mut |stage| stages.note(stage));
                stages.enter(mapper);
                ended.is_some()
            }
            message => {
                let ended = mapper.message(message).is_some();
                self.lines = self
                    .lines
                    .wrapping_add(platform.count().wrapping_sub(start));
                ended
            }
        };
        if ended {
            self.enter(platform, mapper);
            let digest = mapper.digest();
            mapper.counters_mut().set(counter::MAP_DIGEST, digest);
        }
        ended
    }

    /// Writes them to the counters and starts afresh.
    fn enter<P: Platform>(&mut self, platform: &P, mapper: &mut Mapper) {
        let counters = mapper.counters_mut();
        counters.set(counter::COST_RECEIVE, platform.cost(self.receive));
        counters.set(counter::COST_LINES, platform.cost(self.lines));
        counters.set(counter::COST_SEND, platform.cost(self.send));
        *self = Costs::default();
    }
}

/// Costs of what follows a sweep.
struct Stages<'p, P> {
    platform: &'p P,
    last: u32,
    costs: [u32; 4],
}

impl<'p, P: Platform> Stages<'p, P> {
    fn start(platform: &'p P) -> Self {
        Stages {
            platform,
            last: platform.count(),
            costs: [0; 4],
        }
    }

    fn note(&mut self, stage: Stage) {
        let count = self.platform.count();
        let index = match stage {
            Stage::Counters => 0,
            Stage::Roughness => 1,
            Stage::Reconstruction => 2,
            Stage::Traversability => 3,
        };
        self.costs[index] = self.platform.cost(count.wrapping_sub(self.last));
        self.last = count;
    }

    fn enter(&self, mapper: &mut Mapper) {
        let counters = mapper.counters_mut();
        let [pairs, roughness, reconstruction, traversability] = self.costs;
        counters.set(counter::COST_COUNTERS, pairs);
        counters.set(counter::COST_ROUGHNESS, roughness);
        counters.set(counter::COST_RECONSTRUCTION, reconstruction);
        counters.set(counter::COST_TRAVERSABILITY, traversability);
    }
}
