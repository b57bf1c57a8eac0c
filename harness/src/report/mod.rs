//! What a person, or a program, is told at the end of a run and on the way.

mod progress;
mod summary;

pub use progress::Bar;
pub use summary::{BoardSummary, Frames, Summary, failures};
