//! What a person, or a program, is told at the end of a run and on the way.

mod comparison;
mod cut;
pub mod drawing;
mod loops;
pub mod page;
mod part;
mod progress;
mod readout;
pub mod series;
mod stats;
mod summary;
mod timeline;

pub use comparison::{Comparison, Side};
pub use cut::Cut;
pub use loops::{LoopComparison, LoopRow, cpu_percent};
pub use part::{EventSummary, Measure, PartSummary, Required, Worst};
pub use progress::{Bar, Status};
pub use readout::Readout;
pub use stats::{BytesPerGrant, Shares, Stats};
pub use summary::{BoardSummary, FaultSummary, Frames, Lines, Summary, failures};
