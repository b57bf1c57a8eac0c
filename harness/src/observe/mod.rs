//! What is made of the facts: a digest, the last telemetry, a log, a waveform dump, the tool's way. None of it touches
//! the rig.

mod digest;
pub mod log;
mod path;
mod telemetry;
mod waveform;

pub use digest::{Digest, Sum};
pub use path::{ToolPath, Turned};
pub use telemetry::Telemetry;
pub use waveform::Waveforms;
