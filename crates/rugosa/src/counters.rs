//! All counters of a mapper, by the indices of [`rugosa_wire::counter`].

use rugosa_terrain::{RangeFault, Tally};
use rugosa_wire::{COUNTERS, counter};

/// Counts by cause; wraps at 2³².
///
/// ```
/// use rugosa::{Config, Mapper, Planes33};
/// use rugosa_wire::counter;
/// # let mut planes = Box::new(Planes33::new());
/// let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
/// let counters = mapper.counters_mut();
/// counters.count(counter::PANICS);
/// counters.set(counter::STACK_PEAK, 9000); // bytes
/// assert_eq!((counters.get(counter::PANICS), counters.get(counter::STACK_PEAK)), (1, 9000));
/// assert_eq!(counters.all().len(), counter::NAMES.len());
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Counters([u32; COUNTERS]);

impl Counters {
    pub(crate) const fn new() -> Self {
        Counters([0; COUNTERS])
    }

    /// The counter with this index of [`rugosa_wire::counter`]; 0 where there is none.
    pub fn get(&self, index: usize) -> u32 {
        self.0.get(index).copied().unwrap_or(0)
    }

    /// Sets a counter or level that somebody else keeps (link, stack, costs).
    pub fn set(&mut self, index: usize, value: u32) {
        self.0[index] = value;
    }

    /// All places, for those who keep several counters (the link).
    ///
    /// ```
    /// use rugosa::{Config, Mapper, Planes33};
    /// use rugosa_wire::{Hello, Link, MAX_FRAME, Role, counter};
    /// # let mut planes = Box::new(Planes33::new());
    /// let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    /// let mut link = Link::new(Hello::new(Role::Module, "rugosa", "0.1.0"), 5);
    /// link.tend(0, &mut [0; MAX_FRAME]); // greets
    /// link.fill(mapper.counters_mut().all_mut());
    /// assert_eq!(mapper.counters().get(counter::LINK_FRAMES_SENT), 1);
    /// ```
    pub fn all_mut(&mut self) -> &mut [u32] {
        &mut self.0
    }

    /// Counts one more.
    pub fn count(&mut self, index: usize) {
        self.add(index, 1);
    }

    pub(crate) fn add(&mut self, index: usize, more: u32) {
        self.0[index] = self.0[index].wrapping_add(more);
    }

    /// All of them, in the order of their indices.
    pub fn all(&self) -> &[u32] {
        &self.0[..counter::NAMES.len()]
    }
}

/// What became of the returns of a line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Returns {
    pub(crate) no_return: u32,
    pub(crate) too_close: u32,
    pub(crate) out_of_range: u32,
    pub(crate) erroneous: u32,
    pub(crate) fused: Tally,
}

impl Returns {
    pub(crate) fn fault(&mut self, fault: RangeFault) {
        let counter = match fault {
            RangeFault::NoReturn => &mut self.no_return,
            RangeFault::TooClose => &mut self.too_close,
            RangeFault::TooFar => &mut self.out_of_range,
            RangeFault::Erroneous => &mut self.erroneous,
        };
        *counter += 1;
    }

    /// Adds them to the counters; every return has exactly one cause.
    pub(crate) fn enter(&self, counters: &mut Counters) {
        let fused = &self.fused;
        for (index, count) in [
            (counter::RETURNS_NO_RETURN, self.no_return),
            (counter::RETURNS_TOO_CLOSE, self.too_close),
            (counter::RETURNS_OUT_OF_RANGE, self.out_of_range),
            (counter::RETURNS_ERRONEOUS, self.erroneous + fused.invalid),
            (counter::RETURNS_OUTSIDE_MAP, fused.outside),
            (counter::RETURNS_HEIGHT, fused.height_out_of_range),
            (counter::RETURNS_GATED, fused.gated),
            (counter::RETURNS_USED, fused.used()),
        ] {
            counters.add(index, count);
            counters.add(counter::RETURNS_RECEIVED, count);
        }
    }
}
