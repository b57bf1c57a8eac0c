//! What is wrong with a text, and where.

use std::ops::Range;

use toml::Spanned;
use torno_protocol::time::Span;

use crate::{nearest, parse_span};

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

impl Invalid {
    /// A complaint about the place `span` of `text`.
    pub fn at(path: &str, text: &str, span: Range<usize>, message: String) -> Self {
        let before = text.get(..span.start).unwrap_or(text);
        let line = before.matches('\n').count() + 1;
        let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
        Self { path: path.to_owned(), line, column, message }
    }
}

/// What is wrong with TOML that does not fit: for an unknown name, with the nearest known one.
pub fn of_toml(error: &toml::de::Error) -> Complaint {
    let message = error.message();
    let quoted: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    let message = match (message.starts_with("unknown "), &quoted[..]) {
        (true, [name, known @ ..]) if !known.is_empty() => {
            let head = message.split(", expected").next().unwrap_or(message);
            format!("{head}{}", nearest(name, known))
        }
        _ => message.to_owned(),
    };
    (error.span().unwrap_or(0..0), message)
}

/// A time in a file.
///
/// # Errors
/// Where, and what was expected.
pub fn span(text: &Spanned<String>) -> Result<Span, Complaint> {
    parse_span(text.get_ref()).map_err(|message| (text.span(), message))
}
