//! The counters of a [`crate::Status`], by index and by name.
//!
//! New counters go to the end of the list: a receiver that knows fewer shows the rest by
//! number. Counters wrap; levels (`cells`, `stack`, `queue`) are what they are now.

use crate::message::COUNTERS;

macro_rules! counters {
    ($($index:ident $name:literal $meaning:literal)*) => {
        #[allow(non_camel_case_types, clippy::upper_case_acronyms)]
        enum Index { $($index),* }

        $(#[doc = $meaning] pub const $index: usize = Index::$index as usize;)*

        /// Names of all counters, in the order of their indices.
        pub const NAMES: &[&str] = &[$($name),*];

        /// What each counter counts.
        pub const MEANINGS: &[&str] = &[$($meaning),*];
    };
}

counters! {
    LINK_BYTES "link.bytes" "bytes received"
    LINK_FRAMES "link.frames" "frames received that passed all checks"
    LINK_BAD_COBS "link.bad_cobs" "frames with bad byte stuffing"
    LINK_BAD_CRC "link.bad_crc" "frames whose CRC-32 differs"
    LINK_BAD_MESSAGE "link.bad_message" "intact frames without a known message"
    LINK_OVER_LONG "link.over_long" "frames without a delimiter in time"
    LINK_UNKNOWN_VERSION "link.unknown_version" "greetings of peers with another protocol"
    LINK_LOST "link.lost" "frames missing in the running numbers"
    LINK_DUPLICATES "link.duplicates" "frames received twice"
    LINK_STALE "link.stale" "frames of a session that has not greeted or has ended"
    LINK_OVERRUN "link.overrun" "bytes dropped because a receive queue was full"
    LINK_BYTES_SENT "link.bytes_sent" "bytes sent"
    LINK_FRAMES_SENT "link.frames_sent" "frames sent"
    LINK_UNSENT "link.unsent" "messages given up because a send queue was full"
    LINK_SESSIONS "link.sessions" "handshakes completed"
    LINK_SILENCES "link.silences" "times the peer fell silent"
    LINES_RECEIVED "lines.received" "line messages received"
    LINES_USED "lines.used" "line messages mapped"
    LINES_NO_DESCRIPTION "lines.rejected.no_description" "lines before a complete scanner description"
    LINES_NO_POSE "lines.rejected.no_pose" "lines without a pose at their time"
    LINES_UNKNOWN_PLACE "lines.rejected.unknown_place" "lines outside the described raster"
    LINES_MALFORMED "lines.rejected.malformed" "lines whose bytes do not match their returns"
    LINES_TIME_BACKWARDS "lines.rejected.time_backwards" "lines older than one before"
    LINES_DUPLICATES "lines.rejected.duplicates" "line segments that came twice in a sweep"
    LINES_STALE "lines.rejected.stale" "lines of a sweep that had ended"
    LINES_LOST "lines.lost" "lines a sweep end counted and that never came"
    DESCRIPTIONS_REFUSED "descriptions.refused" "scanner descriptions and tables that could not be used"
    POSES_RECEIVED "poses.received" "poses received"
    POSES_INVALID "poses.rejected.invalid" "poses that are not finite or not rotations"
    POSES_TIME_BACKWARDS "poses.rejected.time_backwards" "poses not newer than the one before"
    RETURNS_RECEIVED "returns.received" "returns in the lines that were mapped"
    RETURNS_USED "returns.used" "returns fused into a cell"
    RETURNS_NO_RETURN "returns.no_return" "samples where nothing came back"
    RETURNS_TOO_CLOSE "returns.too_close" "samples below the scanner's reach"
    RETURNS_ERRONEOUS "returns.erroneous" "samples marked as no measurement"
    RETURNS_OUT_OF_RANGE "returns.out_of_range" "ranges outside the described limits"
    RETURNS_OUTSIDE_MAP "returns.outside_map" "points outside the map's window"
    RETURNS_HEIGHT "returns.height_out_of_range" "points too high or too low for the map"
    RETURNS_GATED "returns.gated" "points too far from their cell's elevation"
    SWEEPS "sweeps" "sweeps completed"
    SWEEPS_INCOMPLETE "sweeps.incomplete" "completed sweeps with lines missing"
    CELLS_MEASURED "cells.measured" "cells that hold a sample now"
    CELLS_SEEN_THROUGH "cells.seen_through" "cells that were seen through and not measured since"
    MAP_MOVES "map.moves" "moves of the map's window"
    MAP_REBASES "map.rebases" "shifts of the map's height datum"
    CONFIGURE_ACCEPTED "configure.accepted" "parameters set"
    CONFIGURE_REFUSED "configure.refused" "parameters refused"
    PATCHES_SENT "patches.sent" "map patches sent"
    CREDIT_LIMIT "credit.limit" "lines and tables granted in this session"
    RESTARTS "restarts" "starts since power was applied"
    PANICS "restarts.panic" "starts after a panic"
    WATCHDOGS "restarts.watchdog" "starts after the watchdog bit"
    STACK_PEAK "stack.peak" "deepest use of the stack, bytes"
    QUEUE_PEAK "queue.peak" "fullest state of the receive queue, bytes"
    COST_RECEIVE "cost.receive" "cost of decoding the last sweep, instructions or cycles"
    COST_LINES "cost.lines" "cost of mapping the lines of the last sweep"
    COST_ROUGHNESS "cost.roughness" "cost of refreshing roughness after the last sweep"
    COST_RECONSTRUCTION "cost.reconstruction" "cost of the reconstruction after the last sweep"
    COST_TRAVERSABILITY "cost.traversability" "cost of traversability after the last sweep"
    COST_SEND "cost.send" "cost of encoding what was sent since the last sweep"
    COST_COUNTERS "cost.counters" "cost of bringing the last sweep's samples into the pair counters"
    MAP_DIGEST "map.digest" "fingerprint of the map after the last sweep, see rugosa::Mapper::digest"
}

const _: () = assert!(NAMES.len() <= COUNTERS);

/// Name of a counter; `None` for one this version does not know.
///
/// ```
/// use rugosa_wire::counter;
/// assert_eq!(counter::name(counter::LINK_BAD_CRC), Some("link.bad_crc"));
/// assert_eq!(counter::name(counter::NAMES.len()), None);
/// ```
pub fn name(index: usize) -> Option<&'static str> {
    NAMES.get(index).copied()
}

/// Index of a counter by name.
///
/// ```
/// use rugosa_wire::counter;
/// let index = counter::index("returns.gated");
/// assert_eq!(index, Some(counter::RETURNS_GATED));
/// assert_eq!(counter::index("returns.green"), None);
/// ```
pub fn index(name: &str) -> Option<usize> {
    NAMES.iter().position(|&known| known == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_belong_to_their_index() {
        for (i, &each) in NAMES.iter().enumerate() {
            assert_eq!(index(each), Some(i));
            assert_eq!(name(i), Some(each));
        }
        assert_eq!(name(RETURNS_GATED), Some("returns.gated"));
        assert_eq!(name(MAP_DIGEST), NAMES.last().copied());
        assert_eq!(name(NAMES.len()), None);
    }
}
