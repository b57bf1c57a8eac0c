//! How a program ended, whatever it was made of.

/// How a program ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Every frame was executed.
    Completed,
    /// At least one frame was refused.
    Rejected,
    /// A board failed.
    Faulted,
    /// Frames are left without an answer.
    Unanswered,
}

impl Outcome {
    /// The word for it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::Rejected => "rejected",
            Self::Faulted => "faulted",
            Self::Unanswered => "unanswered",
        }
    }
}
