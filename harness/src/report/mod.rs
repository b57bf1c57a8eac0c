//! What a person, or a program, is told at the end of a run and on the way.

pub mod plot;
mod progress;
mod stats;
mod summary;
mod tested;

pub use progress::{Bar, Status};
pub use stats::{BytesPerTurn, Shares, Stats};
pub use summary::{BoardSummary, Frames, Summary, failures};
pub use tested::{TestReport, Tested};
