//! Standard error, which never holds anything up: where somebody has to read it, a thread of its own writes.

use std::io::{self, Write};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

use crate::backlog::Backlog;
use crate::platform::{Stderr, stderr_is_file};

/// So many bytes wait for a reader. (Ours: some 10 000 lines.)
const ROOM: usize = 1 << 20;
/// So many bytes are written at once: a pipe takes them whole or not at all.
const PIECE: usize = 4096;
/// At the end, a reader who takes nothing for so long is not waited for.
const PATIENCE: Duration = Duration::from_millis(500);

static STDERR: OnceLock<Lines> = OnceLock::new();

/// Where lines go, one with each write. It never waits; what no one reads is lost and counted.
#[derive(Clone)]
pub(super) struct Lines(Arc<Shared>);

struct Shared {
    state: Mutex<State>,
    /// There is something to write.
    news: Condvar,
    /// Something has been written.
    written: Condvar,
}

struct State {
    backlog: Backlog,
    /// Where lines go, until the thread that writes them has started with the first of them.
    output: Option<Box<dyn Write + Send>>,
    /// They go there at once, without a thread.
    at_once: bool,
    /// Some of what has been taken from the backlog is not written yet.
    writing: bool,
    /// How often something has been written.
    pieces: u64,
}

/// Standard error for the log, where a line from `note` stands for so many lost ones.
pub(super) fn for_log(note: fn(u64) -> String) -> Lines {
    let lines = || {
        let lines = Lines::to(Stderr, ROOM, note);
        // A file takes all at once, and whoever looks into it finds what has been said.
        lines.state().at_once = stderr_is_file();
        lines
    };
    STDERR.get_or_init(lines).clone()
}

/// Says something on standard error that is no part of the log, behind what has been logged.
pub fn say(text: &str) {
    let mut lines = for_log(|lost| format!("torno: {lost} lines dropped\n"));
    text.split_inclusive('\n').for_each(|line| lines.push(line.as_bytes()));
}

/// Waits until all has been read that was said, as long as anything is read.
pub fn flush() {
    if let Some(lines) = STDERR.get() {
        lines.wait(PATIENCE);
    }
}

impl Lines {
    /// Lines that go to `output`.
    fn to(output: impl Write + Send + 'static, room: usize, note: fn(u64) -> String) -> Self {
        let backlog = Backlog::new(room, note);
        let state = State { backlog, output: Some(Box::new(output)), at_once: false, writing: false, pieces: 0 };
        Self(Arc::new(Shared { state: Mutex::new(state), news: Condvar::new(), written: Condvar::new() }))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn push(&mut self, line: &[u8]) {
        let mut state = self.state();
        if let State { at_once: true, output: Some(output), .. } = &mut *state {
            // That nothing can be written, as where a disk is full, is no error of what is logged.
            output.write_all(line).ok();
            return;
        }
        state.backlog.push(line);
        if let Some(mut output) = state.output.take() {
            let writer = self.clone();
            let thread = std::thread::Builder::new().name("stderr".to_owned());
            // Where there can be no thread, nothing can be said without waiting for a reader.
            thread.spawn(move || writer.write_to(&mut *output)).ok();
        }
        self.0.news.notify_one();
    }

    fn write_to(&self, output: &mut dyn Write) {
        let mut state = self.state();
        loop {
            if let Some(piece) = state.backlog.take(PIECE) {
                state.writing = true;
                drop(state);
                // That there is no standard error is no error.
                output.write_all(&piece).and_then(|()| output.flush()).ok();
                state = self.state();
                state.writing = false;
                state.pieces += 1;
                self.0.written.notify_all();
            } else {
                state = self.0.news.wait(state).unwrap_or_else(PoisonError::into_inner);
            }
        }
    }

    /// Waits until all is written, or nothing has been for so long.
    fn wait(&self, patience: Duration) {
        let mut state = self.state();
        while state.writing || !state.backlog.is_empty() {
            let before = state.pieces;
            let waited = self.0.written.wait_timeout_while(state, patience, |state| state.pieces == before);
            let (now, timeout) = waited.unwrap_or_else(PoisonError::into_inner);
            if timeout.timed_out() {
                return;
            }
            state = now;
        }
    }
}

impl Write for Lines {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        self.push(line);
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;

    #[test]
    fn lines_that_nobody_reads_are_counted_and_hold_nothing_up() {
        let (mut reader, writer) = io::pipe().unwrap();
        let mut lines = Lines::to(writer, 1_000, |lost| format!("{lost} dropped\n"));
        let line = [&[b'x'; 99][..], b"\n"].concat();
        // More than a pipe holds.
        let many = 5_000;
        (0..many).for_each(|_| lines.write_all(&line).unwrap());
        lines.wait(Duration::from_millis(10));
        let (mut read, mut lost, mut buffer) = (0, 0, Vec::new());
        while read + lost < many {
            let mut piece = [0; 4096];
            let n = reader.read(&mut piece).unwrap();
            buffer.extend_from_slice(&piece[..n]);
            while let Some(end) = buffer.iter().position(|byte| *byte == b'\n') {
                let line = String::from_utf8(buffer.drain(..=end).collect()).unwrap();
                match line.strip_suffix(" dropped\n") {
                    Some(count) => lost += count.parse::<usize>().unwrap(),
                    None => read += 1,
                }
            }
        }
        assert_eq!(read + lost, many);
        // As many as there is room for, and more as the thread and the pipe have taken some.
        assert!(read >= 10 && lost > 1_000, "{read} {lost}");
        lines.wait(Duration::from_secs(60));
        lines.write_all(b"the last\n").unwrap();
        let mut last = [0; 9];
        reader.read_exact(&mut last).unwrap();
        assert_eq!(&last, b"the last\n");
    }
}
