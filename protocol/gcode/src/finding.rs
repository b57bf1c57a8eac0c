//! What is wrong with a program, and where.

use std::borrow::Cow;
use std::fmt;

/// Whether a program can be used in spite of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// The program is used; a word of it has no effect, or another than its author may expect.
    Warning,
    /// The program is refused.
    Error,
}

/// Something that a program's author has to know.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// From 1.
    pub line: usize,
    /// From 1, in characters.
    pub column: usize,
    /// Whether the program is refused for it.
    pub severity: Severity,
    /// What is wrong.
    pub message: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { line, column, severity, message } = self;
        let word = if *severity == Severity::Warning { "warning: " } else { "" };
        write!(f, "{line}:{column}: {word}{message}")
    }
}

/// What is wrong with a line, and at which of its bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Fault {
    pub(crate) at: usize,
    pub(crate) message: Cow<'static, str>,
}

/// What is read from a line. The fault is boxed: it is rare, and what is read is small.
pub(crate) type Read<T> = Result<T, Box<Fault>>;

pub(crate) fn fault<T>(at: usize, message: impl Into<Cow<'static, str>>) -> Read<T> {
    Err(Box::new(Fault { at, message: message.into() }))
}

/// The column of a byte of a line: from 1, in characters.
pub(crate) fn column(line: &[u8], at: usize) -> usize {
    let before = &line[..at.min(line.len())];
    String::from_utf8_lossy(before).chars().count() + 1
}
