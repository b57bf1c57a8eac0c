//! What is made of the facts: a digest, the last telemetry, a log, a waveform dump, the tool's way, what the buses
//! cost. None of it touches the rig.

mod digest;
mod ledger;
pub mod log;
mod path;
mod telemetry;
mod waveform;

pub use digest::{Digest, Sum};
pub use ledger::{Account, Axis, Ledger, Spread};
pub use path::{ToolPath, Turned};
pub use telemetry::Telemetry;
pub use waveform::Waveforms;
