//! The module's twin on the host: the same link and the same mapper, fed with the same
//! bytes.

use crate::fingerprint;
use rugosa::{Config, Layer, Mapper, Planes65, Solver65};
use rugosa_grid::Cell;
use rugosa_wire::{Event, Hello, Link, Message, Role, counter};
use std::collections::{BTreeMap, HashMap};

/// A link and a mapper of the host in the place of the module's.
pub struct Twin {
    link: Link,
    mapper: Mapper<'static>,
    digests: BTreeMap<u32, u32>,
    /// bits of what cells held when the last sweep was complete
    complete: HashMap<[i32; 2], [u32; 3]>,
    /// fingerprints of the lines that came through
    pub lines: Vec<u64>,
}

impl Twin {
    /// A twin of the module that has just started in `session`. Its map lives as long as
    /// the program (a quarter of a megabyte for each start of the module).
    pub fn new(session: u32) -> Self {
        let planes = Box::leak(Box::new(Planes65::new()));
        let solver = Box::leak(Box::new(Solver65::new()));
        let mapper = Mapper::new(Config::default(), planes.lend_with(solver));
        Twin {
            link: Link::new(Hello::new(Role::Module, "twin", ""), session),
            mapper: mapper.unwrap_or_else(|error| unreachable!("{error}")),
            digests: BTreeMap::new(),
            complete: HashMap::new(),
            lines: Vec::new(),
        }
    }

    /// Takes bytes that go to the module. For the twin no time passes: what the module
    /// takes does not depend on when it comes.
    pub fn receive(&mut self, mut bytes: &[u8]) {
        while let Some(event) = self.link.receive(&mut bytes, 0) {
            match event {
                Event::Message(frame) => self.take(&frame.message),
                Event::Connected { resumed: false } => self.mapper.new_session(),
                _ => {}
            }
        }
    }

    fn take(&mut self, message: &Message) {
        if let Message::Line(line) = message {
            self.lines.push(fingerprint::of_line(line));
        }
        if self.mapper.message(message).is_some() {
            let sweeps = self.mapper.counters().get(counter::SWEEPS);
            self.digests.insert(sweeps, self.mapper.digest());
            let cells = self.mapper.window().cells();
            self.complete = cells
                .map(|cell| ([cell.x, cell.y], self.bits(cell)))
                .collect();
        }
    }

    fn bits(&self, cell: Cell) -> [u32; 3] {
        [Layer::Elevation, Layer::Variance, Layer::State]
            .map(|layer| self.mapper.value(layer, cell).to_bits())
    }

    /// Is a cell as it was when the last sweep was complete? Where the end of a sweep got
    /// lost, what its lines changed is told after the next one.
    pub fn is_complete(&self, cell: Cell) -> bool {
        self.complete.get(&[cell.x, cell.y]) == Some(&self.bits(cell))
    }

    /// The digest of the map when so many sweeps were complete.
    pub fn digest(&self, sweeps: u32) -> Option<u32> {
        self.digests.get(&sweeps).copied()
    }

    /// Sweeps that are complete.
    pub fn sweeps(&self) -> u32 {
        self.mapper.counters().get(counter::SWEEPS)
    }

    /// The mapper.
    pub fn mapper(&self) -> &Mapper<'static> {
        &self.mapper
    }

    /// A counter, of the mapper or of the link.
    pub fn counter(&self, index: usize) -> u32 {
        let mut counters = self.mapper.counters().clone();
        self.link.fill(counters.all_mut());
        counters.get(index)
    }
}
