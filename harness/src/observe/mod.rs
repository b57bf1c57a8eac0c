//! What is made of the facts: a digest, the last telemetry, a log, a waveform dump, what the buses cost. None of it
//! touches the rig.

mod digest;
mod ledger;
pub mod log;
mod telemetry;
mod waveform;

pub use digest::{Digest, Sum};
pub use ledger::{Account, Axis, Ledger, Spread};
pub use telemetry::Telemetry;
pub use waveform::Waveforms;
