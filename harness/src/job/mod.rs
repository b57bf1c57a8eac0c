//! What the PC plays on a rig: what it sends, what it makes of the answers, and when it is over.

mod frames;
mod lines;
mod outcome;
mod tally;

use torno_bus::Conversation;
use torno_protocol::time::Instant;

pub use frames::{Careful, FrameJob};
pub use lines::{Counting, LineJob};
pub use outcome::Outcome;
pub use tally::Tally;

/// What the PC plays.
pub trait Job {
    /// What answers for it in virtual time.
    type Program: Conversation + Send + 'static;

    /// What the program is made of, a word.
    const UNIT: &'static str;

    /// The states that the board at the PC's port tells, by their numbers, if it is a controller.
    const STATES: &'static [&'static str] = &[];

    /// What it writes at the start.
    fn first(&self) -> Vec<u8>;

    /// What answers for it in virtual time.
    fn program(&self) -> Self::Program;

    /// A byte has gone onto the line.
    fn sent(&mut self, at: Instant, byte: u8);

    /// A byte has come.
    fn received(&mut self, byte: u8);

    /// How much of the program has been accepted.
    fn accepted(&self) -> usize;

    /// How much of what the user wrote has been accepted, and how much there is.
    fn reached(&self) -> (usize, usize);

    /// Whether all of it is done, as far as the PC can know.
    fn is_over(&self) -> bool;

    /// How it ended.
    fn outcome(&self) -> Outcome;
}
