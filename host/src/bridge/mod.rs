//! The bridge: a scanner's bytes in, a map out, and everything that was said recorded.
//!
//! [`Module`] is mapper and recording without a port or a clock; [`Bridge`] serves it at a
//! serial port, real or virtual, and waits for the port to come back when it disappears;
//! [`outputs`] turns the map into files.

pub mod module;
pub mod outputs;
pub mod serve;
pub mod summary;
pub mod traffic;

pub use module::Module;
pub use outputs::{Extras, Outputs, draw_way, known_part, layers_of, structure_plot, timings};
pub use serve::Bridge;
pub use summary::{Summary, Truth};
pub use traffic::Traffic;
