//! Where results go: standard output, and files.

use std::fmt::Display;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use anstream::{AutoStream, ColorChoice};
use anyhow::Context;
use serde::Serialize;

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
    if json { print(&(serde_json::to_string(result)? + "\n")) } else { print_text(result) }
}

/// That nobody reads it is no error.
fn put(mut output: impl Write, bytes: &[u8]) -> anyhow::Result<()> {
    match output.write_all(bytes).and_then(|()| output.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        written => written.context("cannot write the result"),
    }
}

/// Whether standard output shows colours.
pub(super) fn colour() -> bool {
    AutoStream::choice(&io::stdout()) != ColorChoice::Never
}

/// A file for a result. It is opened before anything runs: a file that cannot be written must not cost a run.
pub(super) struct OutputFile<'a> {
    path: &'a Path,
    file: File,
}

impl<'a> OutputFile<'a> {
    /// Empties the file or makes a new one.
    pub(super) fn create(path: &'a PathBuf) -> anyhow::Result<Self> {
        let file = File::create(path).with_context(|| cannot_write(path))?;
        Ok(Self { path, file })
    }

    /// Writes all of it.
    pub(super) fn write(self, bytes: impl AsRef<[u8]>) -> anyhow::Result<()> {
        self.write_by(|file| file.write_all(bytes.as_ref()))
    }

    /// The same, piece by piece.
    pub(super) fn write_by(self, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> anyhow::Result<()> {
        let mut file = BufWriter::new(self.file);
        write(&mut file).and_then(|()| file.flush()).with_context(|| cannot_write(self.path))
    }
}

/// Writes a file for a result.
pub(super) fn write_file(path: &Path, bytes: impl AsRef<[u8]>) -> anyhow::Result<()> {
    std::fs::write(path, bytes).with_context(|| cannot_write(path))
}

fn cannot_write(path: &Path) -> String {
    format!("cannot write '{}'", path.display())
}
