//! Where results go: standard output, and files.

use std::fmt::Display;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use anstream::adapter::strip_str;
use anstream::{AutoStream, ColorChoice};
use anyhow::Context;
use serde::Serialize;
use torno::observe::stderr::say;
use torno_plot::{Colours, Figure, Format};

/// A result on standard output, as it is.
pub(super) fn print(text: &(impl AsRef<[u8]> + ?Sized)) -> anyhow::Result<()> {
    put(io::stdout().lock(), text.as_ref())
}

/// A result for people on standard output; with its colours where a terminal shows them.
pub(super) fn print_text(text: &impl Display) -> anyhow::Result<()> {
    put(anstream::stdout().lock(), text.to_string().as_bytes())
}

/// A result on standard output: as one line of JSON, or for people.
pub(super) fn print_result(json: bool, result: &(impl Serialize + Display)) -> anyhow::Result<()> {
    print_text(&written(json, result)?)
}

/// A result as one line of JSON, or for people.
pub(super) fn written(json: bool, result: &(impl Serialize + Display)) -> anyhow::Result<String> {
    Ok(if json { serde_json::to_string(result)? + "\n" } else { result.to_string() })
}

/// A result on standard output, or on standard error if one of `files` is standard output.
pub(super) fn print_beside(files: &[&Option<PathBuf>], text: &str) -> anyhow::Result<()> {
    if !files.iter().any(|file| file.as_deref().is_some_and(is_output)) {
        return print_text(&text);
    }
    let colour = AutoStream::choice(&io::stderr()) != ColorChoice::Never;
    say(&if colour { text.to_owned() } else { strip_str(text).to_string() });
    Ok(())
}

/// That no one reads it is no error.
fn put(mut output: impl Write, bytes: &[u8]) -> anyhow::Result<()> {
    match output.write_all(bytes).and_then(|()| output.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        written => written.context("cannot write the result"),
    }
}

/// The name that stands for standard output.
pub(super) fn is_output(path: &Path) -> bool {
    path == Path::new("-")
}

/// Whether standard output shows colours.
pub(super) fn colour() -> bool {
    AutoStream::choice(&io::stdout()) != ColorChoice::Never
}

/// A file for a result; `-` is standard output. It is opened before anything runs: a file that cannot be written must
/// not cost a run.
pub(super) struct OutputFile<'a> {
    path: &'a Path,
    file: Box<dyn Write>,
}

impl<'a> OutputFile<'a> {
    /// Empties a file that exists, before anything else: whatever becomes of this run, what stands there is not of it.
    pub(super) fn empty(path: &Path) {
        // A pipe would be at its end. One that cannot be written is told of when the result is to go there.
        if path.is_file() {
            drop(File::options().write(true).truncate(true).open(path));
        }
    }

    /// Empties the file or makes a new one.
    pub(super) fn create(path: &'a PathBuf) -> anyhow::Result<Self> {
        let file: Box<dyn Write> = if is_output(path) {
            Box::new(io::stdout())
        } else {
            Box::new(File::create(path).with_context(|| cannot_write(path))?)
        };
        Ok(Self { path, file })
    }

    /// Writes all of it.
    pub(super) fn write(self, bytes: impl AsRef<[u8]>) -> anyhow::Result<()> {
        self.write_by(|file| file.write_all(bytes.as_ref()))
    }

    /// The same, piece by piece.
    pub(super) fn write_by(self, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> anyhow::Result<()> {
        let mut file = BufWriter::new(self.file);
        write(&mut file).and_then(|()| file.flush()).with_context(|| cannot_write(self.path))
    }
}

/// Writes a file for a result; `-` is standard output.
pub(super) fn write_file(path: &Path, bytes: impl AsRef<[u8]>) -> anyhow::Result<()> {
    if is_output(path) {
        return print(&bytes);
    }
    std::fs::write(path, bytes).with_context(|| cannot_write(path))
}

/// Draws a figure, in the format that the file's name asks for.
pub(super) fn draw(path: &Path, figure: &Figure, colours: &Colours) -> anyhow::Result<()> {
    write_file(path, figure.encode(Format::of(path).unwrap_or(Format::Svg), colours)?)
}

fn cannot_write(path: &Path) -> String {
    format!("cannot write '{}'", path.display())
}
