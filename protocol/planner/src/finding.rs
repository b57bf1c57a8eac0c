//! What the planner has to say about a program.

use std::borrow::Cow;

pub use torno_gcode::Severity;

/// Something that a program's author has to know.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The line of the program, from 1.
    pub line: usize,
    /// The letter of the word that it is about, in lower case: it may stand in an earlier line.
    pub word: u8,
    /// Whether the program is refused for it.
    pub severity: Severity,
    /// What is wrong.
    pub message: String,
    /// It may follow from another error before it.
    pub follows: bool,
}

/// So many errors are kept, and so many warnings.
const FINDINGS_MAX: usize = 20;

/// What is told once, wherever else it is so.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Once {
    InfeedSpeed,
    FeedRounded,
    FeedClamped,
    SpindleClamped,
    SpindleRaised,
    Dwell,
    Stop,
    Tool,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Findings {
    list: Vec<Finding>,
    told: Vec<Once>,
    refused: usize,
}

impl Findings {
    pub(crate) fn refuse(&mut self, line: usize, word: u8, message: impl Into<Cow<'static, str>>) {
        self.add(line, word, message.into().into_owned(), false);
    }

    /// The same, where the error may follow from another one.
    pub(crate) fn refuse_what_follows(&mut self, line: usize, word: u8, message: String) {
        self.add(line, word, message, true);
    }

    fn add(&mut self, line: usize, word: u8, message: String, follows: bool) {
        self.refused += 1;
        if self.refused <= FINDINGS_MAX {
            self.list.push(Finding { line, word, severity: Severity::Error, message, follows });
        }
    }

    pub(crate) fn warn(&mut self, once: Once, line: usize, word: u8, message: impl FnOnce() -> String) {
        if !self.told.contains(&once) {
            self.told.push(once);
            self.list.push(Finding { line, word, severity: Severity::Warning, message: message(), follows: false });
        }
    }

    /// More would not be shown.
    pub(crate) const fn are_enough(&self) -> bool {
        self.refused >= FINDINGS_MAX
    }

    pub(crate) const fn refused(&self) -> bool {
        self.refused > 0
    }

    pub(crate) fn list(self) -> Vec<Finding> {
        self.list
    }
}
