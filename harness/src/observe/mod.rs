//! What is made of the facts: a digest, the last telemetry, a log, a waveform dump. None of it touches the rig.

mod digest;
pub mod log;
mod telemetry;
mod waveform;

pub use digest::{Digest, Sum};
pub use telemetry::Telemetry;
pub use waveform::Waveforms;
