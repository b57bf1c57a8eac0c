//! A failure: the one line that explains it, and what a person needs to look into it.

use std::fmt;

use torno_protocol::time::Instant;

/// Why a scenario failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// The step in which it failed (from 1) and its description; none for what is checked throughout or at the end.
    pub step: Option<(usize, String)>,
    /// What was expected.
    pub expected: String,
    /// What came.
    pub came: String,
    /// When.
    pub at: Instant,
    /// The board that it is about.
    pub board: Option<String>,
    /// What was said and what happened before it, oldest first.
    pub context: Vec<String>,
    /// Whether it shows that something does not hold. A fault that has not fired shows nothing.
    pub conclusive: bool,
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some((number, does)) = &self.step {
            writeln!(f, "  step {number}    {does}")?;
        }
        writeln!(f, "  expected  {}", self.expected)?;
        writeln!(f, "  came      {}", self.came)?;
        write!(f, "  at        {}", self.at)?;
        if let Some(board) = &self.board {
            write!(f, "\n  board     {board}")?;
        }
        for (n, line) in self.context.iter().enumerate() {
            write!(f, "\n  {}  {line}", if n == 0 { "before  " } else { "        " })?;
        }
        Ok(())
    }
}
