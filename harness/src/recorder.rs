//! Records a session into a file.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek};
use std::path::{Path, PathBuf};
use std::time::Duration;

use torno_protocol::time::Instant;

use crate::pace::Lapse;
use crate::platform::{owner_only, remove_open_file};
use torno_engine::{Fact, Input};
use torno_trace::{End, Header, MAGIC, Writer};

/// What has been noted is written within this, in wall time.
const SECOND: Duration = Duration::from_secs(1);
/// At a pace, boards that nothing reaches are asked so often for what they have to tell, in wall time: so that it is
/// noted before the second is over.
pub const RECORDED: Duration = Duration::from_millis(500);
/// Notes between two looks at the wall clock.
const NOTES_PER_LOOK: u32 = 64;

/// Why a recording cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum CreateError {
    /// The system refuses the file.
    #[error("cannot record to '{path}'", path = path.display())]
    Refused {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// There is something else in it.
    #[error(
        "'{path}' is no trace, and is left as it is: expected a trace to overwrite, or a name that is not taken",
        path = path.display()
    )]
    Taken {
        /// The file.
        path: PathBuf,
    },
    /// Another session is being recorded into it.
    #[error("'{path}' is being recorded to by another torno: expected another name", path = path.display())]
    Busy {
        /// The file.
        path: PathBuf,
    },
}

/// A recording that cannot go on.
#[derive(Debug, thiserror::Error)]
#[error("the recording in '{path}' cannot go on; it is good {}", up_to(*good), path = path.display())]
pub struct RecordingError {
    path: PathBuf,
    good: Instant,
    source: io::Error,
}

fn up_to(good: Instant) -> String {
    if good == Instant::START { "for nothing yet".to_owned() } else { format!("up to {good}") }
}

/// Records a session into a file. What has been noted is written within a second of wall time, as long as it is told
/// of [waits](Self::before_wait). Dropped, it writes what it still has: then the trace lacks only its end.
#[derive(Debug)]
pub struct Recorder {
    path: PathBuf,
    writer: Writer<File>,
    /// Since what was noted has been written.
    second: Lapse,
    /// Notes since the last look at the clock.
    notes: u32,
    /// It has ended, well or not.
    over: bool,
}

impl Recorder {
    /// Opens the file for a recording: a new one (mode 0600), also in the place of an empty one or of a trace, or a
    /// device. Nothing is written yet.
    ///
    /// # Errors
    /// [`CreateError`]: anything else is left as it is.
    pub fn open(path: &Path) -> Result<File, CreateError> {
        let refused = |source| CreateError::Refused { path: path.to_owned(), source };
        let mut options = OpenOptions::new();
        let mut file = match options.read(true).write(true).open(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return create(path).map_err(refused),
            // What can be written but not read: a device, or nothing that may be overwritten.
            Err(error) if error.kind() == io::ErrorKind::PermissionDenied => options.read(false).open(path),
            opened => opened,
        }
        .map_err(refused)?;
        if !file.metadata().map_err(refused)?.is_file() {
            return Ok(file);
        }
        if let Err(TryLockError::WouldBlock) = file.try_lock() {
            return Err(CreateError::Busy { path: path.to_owned() });
        }
        let mut start = Vec::new();
        let read = Read::by_ref(&mut file).take(MAGIC.len() as u64).read_to_end(&mut start);
        if read.is_err() || !(start.is_empty() || start == MAGIC) {
            return Err(CreateError::Taken { path: path.to_owned() });
        }
        // Whoever reads the old one may go on, and file systems are slow to write what was emptied just before.
        let replaced = path.canonicalize().and_then(|path| remove_open_file(&path).and_then(|()| create(&path)));
        match replaced {
            Ok(new) => Ok(new),
            // In a folder that is not ours, or on a system where an open file keeps its name.
            Err(_) => file.set_len(0).and_then(|()| file.rewind()).map(|()| file).map_err(refused),
        }
    }

    /// Begins a recording in a file that was [opened](Self::open) for it.
    ///
    /// # Errors
    /// [`RecordingError`] if it cannot be written.
    pub fn begin(path: &Path, file: File, header: &Header) -> Result<Self, RecordingError> {
        let path = path.to_owned();
        match Writer::new(file, header) {
            Ok(writer) => Ok(Self { path, writer, second: Lapse::begin(SECOND), notes: 0, over: false }),
            Err(source) => Err(RecordingError { path, good: Instant::START, source }),
        }
    }

    /// Takes note of what came from outside, of what happened, and of how far anything is settled.
    ///
    /// # Errors
    /// [`RecordingError`] if it cannot be written.
    pub fn note(&mut self, inputs: &[Input], facts: &[Fact], settled: Instant) -> Result<(), RecordingError> {
        let noted = self.writer.note(inputs, facts, settled);
        self.check(noted)?;
        self.notes += 1;
        if self.notes >= NOTES_PER_LOOK { self.before_wait(Duration::ZERO) } else { Ok(()) }
    }

    /// Nothing is noted for so long, in wall time: writes what has been noted, if a second will have passed by then
    /// since the last time.
    ///
    /// # Errors
    /// [`RecordingError`] if it cannot be written.
    pub fn before_wait(&mut self, wait: Duration) -> Result<(), RecordingError> {
        self.notes = 0;
        if !self.second.is_over(wait) {
            return Ok(());
        }
        let flushed = self.writer.flush();
        self.check(flushed)
    }

    /// Ends the recording.
    ///
    /// # Errors
    /// [`RecordingError`] if it cannot be written.
    pub fn finish(&mut self, end: &End) -> Result<(), RecordingError> {
        let finished = self.writer.finish(end);
        self.over = true;
        self.check(finished)
    }

    fn check(&mut self, written: io::Result<()>) -> Result<(), RecordingError> {
        written.map_err(|source| {
            self.over = true;
            RecordingError { path: self.path.clone(), good: self.writer.good(), source }
        })
    }
}

/// A new file, which no other recording may take.
fn create(path: &Path) -> io::Result<File> {
    let file = owner_only(OpenOptions::new().write(true).create_new(true)).open(path)?;
    // Where a file system has no locks, there is none.
    file.try_lock().ok();
    Ok(file)
}

impl Drop for Recorder {
    fn drop(&mut self) {
        if !self.over {
            // Whatever ends the session is told already.
            self.writer.flush().ok();
        }
        // Not left to the close: a process being started has a copy of the descriptor until it runs its program.
        self.writer.output().unlock().ok();
    }
}
