//! Counts the clients that have the port open.
//!
//! Only the port's own device is watched. inotify merges a notice into the one before it if both are equal and the
//! older is unread: two opens in a row count as one, and the first close then looks like the last. If the queue is
//! full, notices are lost. So the count is a guess, and after each close `/proc` is asked whether anybody is there.
//!
//! Without root's rights `/proc` does not show what root has open. Such a client counts as gone when another one closes
//! the port, until it writes.
//!
//! There is another way to ask: a pty that nobody has open tells its master side that it is hung up. But the port would
//! have to close its own slave descriptor for this, and could not open it again if a client set exclusive mode then.

use std::collections::VecDeque;
use std::io;
use std::mem::MaybeUninit;
use std::path::Path;

use rustix::fd::OwnedFd;
use rustix::fs::inotify::{self, CreateFlags, ReadFlags, Reader, WatchFlags};
use rustix::io::Errno;

use super::pty::Pty;

/// What became of the port's clients as a whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    /// A client opened the port, which nobody had open.
    FirstOpened,
    /// The last client closed the port.
    LastClosed,
}

#[derive(Debug)]
pub(super) struct Clients {
    notices: OwnedFd,
    /// As the notices say: `/proc` says whether it is 0.
    count: u32,
    changes: VecDeque<Change>,
    /// Whether somebody has closed the port, or notices were lost, since `/proc` was asked.
    doubtful: bool,
    /// Whether it is to be asked once more.
    unsure: bool,
    /// Whether it is asked once more.
    again: bool,
}

impl Clients {
    /// Watches `slave`, which nobody but the caller has open, and nobody else is told of yet.
    pub(super) fn watch(slave: &Path) -> io::Result<Clients> {
        let notices = inotify::init(CreateFlags::NONBLOCK | CreateFlags::CLOEXEC)?;
        inotify::add_watch(&notices, slave, WatchFlags::OPEN | WatchFlags::CLOSE)?;
        Ok(Clients { notices, count: 0, changes: VecDeque::new(), doubtful: false, unsure: false, again: false })
    }

    /// Can be read when [`look`](Clients::look) may find something new.
    pub(super) fn notices(&self) -> &OwnedFd {
        &self.notices
    }

    /// Takes in what has happened up to now. True if the last client closed meanwhile, even if the next is there.
    pub(super) fn look(&mut self, pty: &Pty) -> io::Result<bool> {
        let known = self.changes.len();
        let again = core::mem::take(&mut self.again);
        self.read_notices()?;
        // Who has the port for itself lets nobody else in, so the guess is good, and the next has not to wait.
        if core::mem::take(&mut self.doubtful) && !(self.count == 0 && pty.is_exclusive()?) {
            self.correct(pty.is_held(), known, again);
        }
        Ok(self.changes.range(known..).any(|change| *change == Change::LastClosed))
    }

    /// Somebody has the port open, or nobody, if that is known. `known` of the changes are certain.
    fn correct(&mut self, held: Option<bool>, known: usize, again: bool) {
        let Some(held) = held.filter(|held| *held != (self.count > 0)) else { return };
        // A process that is being started has a copy of everything until it runs its program.
        self.unsure = !again;
        if !held {
            self.count = 0;
            self.changes.push_back(Change::LastClosed);
            return;
        }
        self.count = 1;
        if self.changes.len() > known && self.changes.back() == Some(&Change::LastClosed) {
            self.changes.pop_back();
        } else {
            self.changes.push_back(Change::FirstOpened);
        }
    }

    fn read_notices(&mut self) -> io::Result<()> {
        let mut buffer = [MaybeUninit::uninit(); 4096];
        let mut reader = Reader::new(&self.notices, &mut buffer);
        let mut notices = Vec::new();
        loop {
            match reader.next() {
                Ok(notice) => notices.push(notice.events()),
                Err(Errno::AGAIN) => break,
                Err(Errno::INTR) => {}
                Err(errno) => return Err(errno.into()),
            }
        }
        for events in notices {
            if events.contains(ReadFlags::QUEUE_OVERFLOW) {
                self.doubtful = true;
            } else if events.contains(ReadFlags::OPEN) {
                self.open();
            } else if events.intersects(ReadFlags::CLOSE_WRITE | ReadFlags::CLOSE_NOWRITE) {
                self.doubtful = true;
                if self.count > 0 {
                    self.count -= 1;
                    if self.count == 0 {
                        self.changes.push_back(Change::LastClosed);
                    }
                }
            }
        }
        Ok(())
    }

    fn open(&mut self) {
        self.count += 1;
        if self.count == 1 {
            self.changes.push_back(Change::FirstOpened);
        }
    }

    /// Somebody has written: there is a client.
    pub(super) fn hear(&mut self) {
        if self.count == 0 {
            self.open();
        }
    }

    /// Whether `/proc` is to be [asked once more](Clients::ask_again) whether anybody is there.
    pub(super) fn is_unsure(&self) -> bool {
        self.unsure
    }

    /// Asks it, with the next look.
    pub(super) fn ask_again(&mut self) {
        (self.doubtful, self.again, self.unsure) = (true, true, false);
    }

    /// Whether nobody has the port open.
    pub(super) fn nobody(&self) -> bool {
        self.count == 0
    }

    /// The changes that nobody has been told of, oldest first.
    pub(super) fn changes(&mut self) -> &mut VecDeque<Change> {
        &mut self.changes
    }
}
