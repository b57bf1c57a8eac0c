//! Everything that has happened in a session that is not over, in a file that has no name: whoever runs the session may
//! have it, or what is made of it, before the session ends.
//!
//! A recording that begins later than its session could not be repeated. So everything is kept from the start, up to a
//! number of bytes; what happens after that is not kept.

use std::fs::{File, OpenOptions};
use std::io::{self, BufReader, Read, Seek, Write};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use torno_engine::{Fact, Input};
use torno_protocol::time::Instant;
use torno_trace::{Damage, End, Header, Trace, Writer};

use crate::platform::{owner_only, remove_open_file};
use crate::rig::file::RigFile;

/// What happens in a session goes here.
#[derive(Debug)]
pub struct Spool {
    writer: Writer<File>,
    reader: Arc<Mutex<File>>,
    /// So many bytes are kept.
    room: u64,
    /// Nothing more is kept: there is no room, or the system has refused it.
    is_over: bool,
}

/// What has happened so far. It stays what it is while its session goes on.
#[derive(Clone, Debug)]
pub struct SoFar {
    reader: Arc<Mutex<File>>,
    length: u64,
    /// The block that ends it, unless something that happened later was not kept.
    end: Vec<u8>,
    /// It holds all that happened before this.
    pub until: Instant,
}

/// A new file that only this user can read, which is gone with the last that has it open: to write, and to read.
pub(crate) fn nameless(what: &str) -> io::Result<(File, File)> {
    let folder = std::env::temp_dir();
    let file = |n: u32| -> PathBuf { folder.join(format!("torno-{what}-{}-{n}", std::process::id())) };
    for n in 0..u32::MAX {
        let path = file(n);
        match owner_only(OpenOptions::new().write(true).create_new(true)).open(&path) {
            Ok(writer) => {
                let reader = File::open(&path);
                // Where an open file keeps its name, it stays.
                remove_open_file(&path).ok();
                return Ok((writer, reader?));
            }
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error),
        }
    }
    Err(io::ErrorKind::AlreadyExists.into())
}

impl Spool {
    /// Keeps what happens, up to `room` bytes, under this header. For a session that has not begun.
    ///
    /// # Errors
    /// If the system refuses the file.
    pub fn begin(header: &Header, room: u64) -> io::Result<Self> {
        let (writer, reader) = nameless("spool")?;
        let writer = Writer::new(writer, header)?;
        Ok(Self { writer, reader: Arc::new(Mutex::new(reader)), room, is_over: false })
    }

    /// How many bytes have been written, and how many may be.
    pub const fn size(&self) -> (u64, u64) {
        (self.writer.written(), self.room)
    }

    /// If nothing more is kept: up to where it is good.
    pub fn over(&self) -> Option<Instant> {
        self.is_over.then(|| self.writer.good())
    }

    /// Takes note of what came from outside, of what happened, and of how far anything is settled.
    pub fn note(&mut self, inputs: &[Input], facts: &[Fact], settled: Instant) {
        if self.is_over {
            return;
        }
        let noted = self.writer.note(inputs, facts, settled);
        let is_full = self.writer.written() >= self.room;
        self.check(noted);
        if is_full && !self.is_over {
            tracing::warn!("no more is kept for 'torno ctl save': it has grown to {} MiB", self.room >> 20);
            self.is_over = true;
        }
    }

    fn check(&mut self, written: io::Result<()>) {
        if let Err(error) = written {
            // The session goes on without it.
            tracing::warn!(%error, "no more is kept for 'torno ctl save'");
            self.is_over = true;
        }
    }

    /// What has been noted so far, in a session that would have this end.
    ///
    /// # Errors
    /// If the system refuses it.
    pub fn so_far(&mut self, end: &End) -> io::Result<SoFar> {
        if !self.is_over {
            let flushed = self.writer.flush();
            self.check(flushed);
        }
        let (until, end) = match self.is_over {
            true => (self.writer.good(), Vec::new()),
            false => (end.at.next(), self.writer.end_block(end)?),
        };
        Ok(SoFar { reader: Arc::clone(&self.reader), length: self.writer.written(), end, until })
    }
}

impl SoFar {
    /// Writes it: a trace. Whoever else writes it waits.
    ///
    /// # Errors
    /// Whatever reading and writing give.
    pub fn write(&self, mut to: impl Write) -> io::Result<()> {
        io::copy(&mut self.bytes(&mut self.file())?, &mut to)?;
        Ok(())
    }

    /// The trace itself.
    ///
    /// # Errors
    /// [`Damage`] if it cannot be read.
    pub fn trace(&self) -> Result<Trace, Damage> {
        let mut file = self.file();
        let bytes = BufReader::new(self.bytes(&mut file)?);
        torno_trace::read(bytes, RigFile::layout_of).map(|(trace, _)| trace)
    }

    fn file(&self) -> MutexGuard<'_, File> {
        self.reader.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn bytes<'a>(&'a self, file: &'a mut File) -> io::Result<impl Read + 'a> {
        file.rewind()?;
        Ok(Read::by_ref(file).take(self.length).chain(&self.end[..]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn telemetry(ns: u64, value: i64) -> Fact {
        Fact::Telemetry { node: 1, at: Instant::from_nanos(ns), signal: 0, value }
    }

    fn end(ns: u64) -> End {
        End { digest: "0".repeat(32), at: Instant::from_nanos(ns), outcome: "ended".to_owned() }
    }

    fn spool(room: u64) -> Spool {
        Spool::begin(&RigFile::load("lathe").unwrap().header("lathe", 0, None), room).unwrap()
    }

    #[test]
    fn what_is_had_of_a_session_stays_as_it_was() {
        let mut spool = spool(1 << 20);
        spool.note(&[], &[telemetry(5, 1)], Instant::from_nanos(6));
        let first = spool.so_far(&end(9)).unwrap();
        spool.note(&[], &[telemetry(20, 2)], Instant::from_nanos(21));
        let second = spool.so_far(&end(29)).unwrap();
        let facts = |so_far: &SoFar| {
            let trace = so_far.trace().unwrap();
            (trace.facts, trace.end.map(|end| end.at.as_nanos()))
        };
        assert_eq!(facts(&first), (vec![telemetry(5, 1)], Some(9)));
        assert_eq!(facts(&second), (vec![telemetry(5, 1), telemetry(20, 2)], Some(29)));
        let mut bytes = Vec::new();
        first.write(&mut bytes).unwrap();
        assert!(bytes.len() as u64 > first.length && spool.over().is_none());
    }

    #[test]
    fn it_grows_no_further_than_its_room_and_says_up_to_where_it_is_good() {
        let mut spool = spool(100_000);
        for n in 0..100_000 {
            spool.note(&[], &[telemetry(10 * n, n as i64)], Instant::from_nanos(10 * n + 1));
        }
        let (written, room) = spool.size();
        assert!(written >= room && written < room + (128 << 10), "{written}");
        let so_far = spool.so_far(&end(2_000_000)).unwrap();
        let trace = so_far.trace().unwrap();
        assert_eq!((spool.over(), trace.end.is_none()), (Some(so_far.until), true));
        let last = trace.facts.iter().map(Fact::at).max().unwrap();
        assert!(so_far.until <= trace.settled && trace.settled <= last.next(), "{last} {}", trace.settled);
    }

    #[cfg(unix)]
    #[test]
    fn no_one_else_can_read_it_and_it_has_no_name() {
        use std::os::unix::fs::MetadataExt;
        let (file, _) = nameless("test").unwrap();
        let about = file.metadata().unwrap();
        assert_eq!((about.mode() & 0o777, about.nlink()), (0o600, 0));
    }
}
