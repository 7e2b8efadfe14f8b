//! Host side of rugosa.
