//! Reading text files.

use std::io;
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
