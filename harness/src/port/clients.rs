//! Counts the clients that have the port open.
//!
//! inotify merges a notice into the one before it if both are equal and the older is unread: two opens in a row count
//! as one, and the first close then looks like the last. The folder is therefore watched along with the slave. Each
//! open gives two different notices, one per watch, so no two equal ones follow each other. The price: a wake-up
//! whenever a terminal on this machine is opened or closed.

use std::collections::VecDeque;
use std::io;
use std::mem::MaybeUninit;
use std::path::Path;

use rustix::fd::OwnedFd;
use rustix::fs::inotify::{self, CreateFlags, ReadFlags, Reader, WatchFlags};
use rustix::io::Errno;
use tokio::io::unix::AsyncFd;

use crate::ready::readable;

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
    notices: AsyncFd<OwnedFd>,
    slave: i32,
    count: u32,
    changes: VecDeque<Change>,
    /// Set once the kernel has dropped notices: the count is wrong from then on.
    lost_count: bool,
}

impl Clients {
    /// Watches `slave`, which nobody but the caller has open, and nobody else is told of yet.
    pub(super) fn watch(slave: &Path) -> io::Result<Clients> {
        let notices = inotify::init(CreateFlags::NONBLOCK | CreateFlags::CLOEXEC)?;
        let both = WatchFlags::OPEN | WatchFlags::CLOSE;
        let folder = slave.parent().ok_or(Errno::NOENT)?;
        inotify::add_watch(&notices, folder, both | WatchFlags::ONLYDIR)?;
        let slave = inotify::add_watch(&notices, slave, both)?;
        Ok(Clients { notices: readable(notices)?, slave, count: 0, changes: VecDeque::new(), lost_count: false })
    }

    #[cfg(test)]
    pub(super) fn assume_one(&mut self) {
        self.count = 1;
    }

    /// Takes in what has happened up to now. True if the last client closed meanwhile, even if the next is there.
    pub(super) fn look(&mut self) -> io::Result<bool> {
        let mut buffer = [MaybeUninit::uninit(); 4096];
        let mut reader = Reader::new(self.notices.get_ref(), &mut buffer);
        let mut all_left = false;
        while !self.lost_count {
            let notice = match reader.next() {
                Ok(notice) => notice,
                Err(Errno::AGAIN) => return Ok(all_left),
                Err(Errno::INTR) => continue,
                Err(errno) => return Err(errno.into()),
            };
            self.lost_count |= notice.events().contains(ReadFlags::QUEUE_OVERFLOW);
            if notice.wd() != self.slave {
                continue;
            }
            if notice.events().contains(ReadFlags::OPEN) {
                self.count += 1;
                if self.count == 1 {
                    self.changes.push_back(Change::FirstOpened);
                }
            } else if notice.events().intersects(ReadFlags::CLOSE_WRITE | ReadFlags::CLOSE_NOWRITE) && self.count > 0 {
                self.count -= 1;
                if self.count == 0 {
                    self.changes.push_back(Change::LastClosed);
                    all_left = true;
                }
            }
        }
        Err(io::Error::other(
            "lost count of the port's clients: the port was not attended to while terminals came and went",
        ))
    }

    /// Waits until [`look`](Clients::look) may find something new.
    pub(super) async fn ready(&self) -> io::Result<()> {
        self.notices.readable().await?.clear_ready();
        Ok(())
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
