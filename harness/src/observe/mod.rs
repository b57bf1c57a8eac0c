//! What is made of the facts: a digest, the last telemetry, a log, a waveform dump, the tool's way, what the buses
//! cost. None of it touches the rig.

mod ledger;
pub mod log;
pub mod stderr;
mod telemetry;

pub use ledger::{Account, Axis, Ledger, Spread};
pub use telemetry::Telemetry;
