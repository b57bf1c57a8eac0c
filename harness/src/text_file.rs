//! Reading text files, whatever they are: a device can have no end.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

/// The longest text, in bytes. (Ours: an hour of data of a real motor, a thousand times a second.)
pub const LENGTH_MAX: u64 = 128 << 20;
/// The longest line of a text that is read line by line, in bytes.
const LINE_MAX: u64 = 1 << 20;
/// The byte-order mark, in UTF-8.
const MARK: &[u8] = "\u{feff}".as_bytes();

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

/// Reads a text file. A byte-order mark, with which some programs begin one, is no part of the text.
///
/// # Errors
/// [`TextError`] if it cannot be read, or is not text, or is longer than [`LENGTH_MAX`].
pub fn read(path: &Path) -> Result<String, TextError> {
    text(File::open(path)?)
}

fn text(input: impl Read) -> Result<String, TextError> {
    let mut bytes = Vec::new();
    input.take(LENGTH_MAX + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > LENGTH_MAX {
        return Err(too_long(LENGTH_MAX, "text").into());
    }
    if bytes.starts_with(MARK) {
        bytes.drain(..MARK.len());
    }
    String::from_utf8(bytes).map_err(|error| {
        let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        TextError::NotText { line: valid.iter().filter(|byte| **byte == b'\n').count() + 1 }
    })
}

/// The lines of a text file, of any length, one after the other.
///
/// # Errors
/// If it cannot be opened; an item, if it cannot be read on or a line is too long, which is the last then.
pub fn lines(path: &Path) -> io::Result<impl Iterator<Item = io::Result<String>>> {
    Ok(lines_of(BufReader::new(File::open(path)?)))
}

fn lines_of(mut input: impl BufRead) -> impl Iterator<Item = io::Result<String>> {
    let mut failed = false;
    core::iter::from_fn(move || {
        let mut line = String::new();
        if failed {
            return None;
        }
        let read = Read::by_ref(&mut input)
            .take(LINE_MAX + 1)
            .read_line(&mut line)
            .and_then(|read| if read as u64 > LINE_MAX { Err(too_long(LINE_MAX, "line")) } else { Ok(read) });
        failed = read.is_err();
        match read {
            Ok(0) => None,
            Ok(_) => Some(Ok(line.trim_end_matches(['\n', '\r']).to_owned())),
            Err(error) => Some(Err(error)),
        }
    })
}

fn too_long(most: u64, what: &str) -> io::Error {
    io::Error::other(format!("expected a {what} of no more than {} MiB, found a longer one", most >> 20))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::file::RigFile;
    use torno_protocol::lathe::Program;

    #[test]
    fn what_has_no_end_is_refused() {
        let error = text(io::repeat(0)).unwrap_err();
        assert_eq!(error.to_string(), "expected a text of no more than 128 MiB, found a longer one");
        let mut lines = lines_of(BufReader::new((&b"a\n\nb\r\n"[..]).chain(io::repeat(b'x'))));
        let next = |lines: &mut dyn Iterator<Item = io::Result<String>>| {
            lines.next().map(|line| line.map_err(|e| e.to_string()))
        };
        for expected in ["a", "", "b"] {
            assert_eq!(next(&mut lines), Some(Ok(expected.to_owned())));
        }
        let why = "expected a line of no more than 1 MiB, found a longer one".to_owned();
        assert_eq!((next(&mut lines), next(&mut lines)), (Some(Err(why)), None));
    }

    #[test]
    fn a_line_that_is_no_text_is_named() {
        assert_eq!(text(&b"a\nb\xff"[..]).unwrap_err().to_string(), "line 2: expected text (UTF-8)");
    }

    #[test]
    fn a_byte_order_mark_is_no_text() {
        let folder = tempfile::tempdir().unwrap();
        let marked = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, format!("\u{feff}{text}")).unwrap();
            let found = read(&path).unwrap();
            assert_eq!(found, text);
            found
        };
        let frames = "0A E1 00 E1 00 00 00 00\r\n";
        assert_eq!(Program::parse(&marked("a.frames", frames)).unwrap(), Program::parse(frames).unwrap());
        let rig = include_str!("../builtin/lathe.toml");
        assert!(RigFile::parse("a.toml", &marked("a.toml", rig)).is_ok());
        marked("a.csv", "time_s,input,counts\n");
        // Only the first is a mark.
        std::fs::write(folder.path().join("b"), "\u{feff}\u{feff}x").unwrap();
        assert_eq!(read(&folder.path().join("b")).unwrap(), "\u{feff}x");
    }
}
