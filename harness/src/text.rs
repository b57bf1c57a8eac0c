//! Reading text files.

use std::io;
use std::ops::Range;
use std::path::Path;

/// Why a text cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum TextError {
    /// The file cannot be read.
    #[error(transparent)]
    Unreadable(#[from] io::Error),
    /// The file is not text.
    #[error("line {line}: expected text (UTF-8)")]
    NotText {
        /// From 1.
        line: usize,
    },
}

/// Reads a text file.
///
/// # Errors
/// [`TextError`] if it cannot be read, or is not text.
pub fn read(path: &Path) -> Result<String, TextError> {
    let bytes = std::fs::read(path)?;
    String::from_utf8(bytes).map_err(|error| {
        let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        TextError::NotText { line: valid.iter().filter(|byte| **byte == b'\n').count() + 1 }
    })
}

/// What is wrong with a text, and where: a range of its bytes.
pub type Complaint = (Range<usize>, String);

/// A text is not what it should be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{path}:{line}:{column}: {message}")]
pub struct Invalid {
    /// The file.
    pub path: String,
    /// From 1.
    pub line: usize,
    /// From 1, in characters.
    pub column: usize,
    /// What was expected, and what was found.
    pub message: String,
}

/// What a TOML parser complains about.
pub fn of_toml(error: &toml::de::Error) -> Complaint {
    (error.span().unwrap_or(0..0), error.message().to_owned())
}

impl Invalid {
    /// A complaint about the place `span` of `text`.
    pub fn at(path: &str, text: &str, span: Range<usize>, message: String) -> Self {
        let before = text.get(..span.start).unwrap_or(text);
        let line = before.matches('\n').count() + 1;
        let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
        Self { path: path.to_owned(), line, column, message }
    }
}

/// The known name that is nearest to `name`, as the end of a complaint; all of them, if none is near.
pub fn nearest(name: &str, known: &[&str]) -> String {
    let distance = |other: &&&str| strsim::damerau_levenshtein(name, other);
    match known.iter().min_by_key(distance) {
        Some(near) if distance(&near) <= 1 + near.len() / 3 => format!(": did you mean '{near}'?"),
        Some(_) => format!(": expected one of {}", known.join(", ")),
        None => String::new(),
    }
}
