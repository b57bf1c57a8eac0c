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
    // Who writes `km` means `km_rad_per_s_volt`: what only lacks its end is nearer than any misspelling.
    let begins = |other: &&&str| !name.is_empty() && other.starts_with(name);
    let distance = |other: &&&str| strsim::damerau_levenshtein(name, other);
    let near = known.iter().min_by_key(|other| (!begins(other), distance(other)));
    match near {
        Some(near) if begins(&near) || distance(&near) <= 1 + near.len() / 3 => format!(": did you mean '{near}'?"),
        Some(_) => format!(": expected one of {}", known.join(", ")),
        None => String::new(),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_name_is_a_misspelt_one_or_one_that_is_cut_short() {
        let known = ["k", "km_rad_per_s_volt", "alpha"];
        let found = ["alhpa", "km", "kk", "x", "nothing_like_it"].map(|name| nearest(name, &known));
        let mean = |name: &str| format!(": did you mean '{name}'?");
        let all = ": expected one of k, km_rad_per_s_volt, alpha".to_owned();
        assert_eq!(found, [mean("alpha"), mean("km_rad_per_s_volt"), mean("k"), mean("k"), all]);
    }
}
