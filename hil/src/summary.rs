//! What a run says in the end.

use crate::schedule::Lateness;
use rugosa_wire::counter;
use serde::Serialize;
use std::collections::BTreeMap;

/// Scan lines on their way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Lines {
    /// the scanner sent
    pub sent: u64,
    /// the module received
    pub received: u64,
    /// sent and not received
    pub lost: u64,
    /// received and not mapped, by all causes
    pub rejected: u64,
    /// how late they went out; `None`: the scanner had no rate of its own
    pub lateness: Option<Lateness>,
}

/// Module and twin, compared bit for bit.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Parity {
    /// nothing differs
    pub equal: bool,
    /// sweeps whose digests were compared
    pub sweeps: u32,
    /// values of the sent map that were compared
    pub values: u64,
    /// what differs, in words
    pub differences: Vec<String>,
}

/// The whole run.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// module against twin
    pub parity: Parity,
    /// scan lines
    pub lines: Lines,
    /// instructions of the last sweep, by stage
    pub instructions: BTreeMap<&'static str, u32>,
    /// instructions per return of the last sweep: decoding, mapping, pair counters
    pub instructions_per_return: f64,
    /// deepest use of the module's stack, bytes
    pub stack: u32,
    /// fullest state of its receive queue, bytes
    pub queue: u32,
    /// duration of the run
    pub seconds: f64,
    /// the same by the board's clock, where the scanner went by it
    #[serde(skip_serializing_if = "Option::is_none")]
    pub board_seconds: Option<f64>,
    /// all counters of the module by name
    pub counters: BTreeMap<&'static str, u32>,
    /// resets of the module during the run
    pub restarts: u32,
    /// entries of its log
    pub log_entries: usize,
}

/// The stages whose costs are counted.
pub const STAGES: [(&str, usize); 7] = [
    ("receive", counter::COST_RECEIVE),
    ("lines", counter::COST_LINES),
    ("counters", counter::COST_COUNTERS),
    ("roughness", counter::COST_ROUGHNESS),
    ("reconstruction", counter::COST_RECONSTRUCTION),
    ("traversability", counter::COST_TRAVERSABILITY),
    ("send", counter::COST_SEND),
];
