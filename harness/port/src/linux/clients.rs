//! Counts the clients that have the port open.
//!
//! Only the port's own device is watched. inotify merges a notice into the one before it if both are equal and the
//! older is unread: two opens in a row count as one, and the first close then looks like the last. If the queue is
//! full, notices are lost. So the count is a guess, and after each close the kernel is asked whether anybody is there:
//! without the port's own slave descriptor, a pty that no one has open tells its master side that it is hung up.
//!
//! A close is noticed before the kernel has done it, and an opening after. So a kernel that says "somebody" when the
//! notices say no one is given time to agree.
//!
//! That descriptor is closed and opened again for this, which gives two notices. It is only for reading: so its close
//! is told apart from that of a client that writes. But a client that opens in these few microseconds goes unnoticed:
//! its notice is merged into that of the port's own opening. So after a close the kernel is asked again and again, at
//! ever longer intervals: no client goes unnoticed for much longer than the port was free.
//!
//! If a client takes the port for itself (`TIOCEXCL`), the port could not open it again, unless it is privileged. Such
//! a client also lets no one in whose notices could be merged. So once there has been one, the guess has to do.

use std::collections::VecDeque;
use std::io;
use std::mem::MaybeUninit;
use std::path::Path;
use std::time::Duration;

use rustix::fd::OwnedFd;
use rustix::fs::inotify::{self, CreateFlags, ReadFlags, Reader, WatchFlags};
use rustix::io::Errno;
use rustix::thread::{CapabilitySet, capabilities};

use super::pty::Pty;

/// So often the kernel is asked in a row, if clients come and go as fast: the next look goes on.
const ASKED: usize = 4;

/// So long, and so often, it has to finish a close that has been noticed. (Ours: some turns of a busy computer.)
const FINISHES: Duration = Duration::from_millis(5);

/// After a close, the kernel is asked again after this, and then each time after so many times as long.
const ASKED_AGAIN: Duration = Duration::from_millis(2);
const LATER: u32 = 4;
/// So long at the most.
const LATEST: Duration = Duration::from_secs(24 * 60 * 60);
/// If somebody is there, it is asked no later than this: the notices tell what happens then.
const LATEST_OF_SOMEBODY: Duration = Duration::from_millis(10);

/// What became of the port's clients as a whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    /// A client opened the port, which no one had open.
    FirstOpened,
    /// The last client closed the port.
    LastClosed,
}

#[derive(Debug)]
pub(super) struct Clients {
    notices: OwnedFd,
    /// As the notices say: the kernel says whether it is 0.
    count: u32,
    changes: VecDeque<Change>,
    /// Whether somebody has closed the port, or notices were lost, since the kernel was asked.
    doubtful: bool,
    /// Whether notices were lost.
    lost: bool,
    /// Whether the port itself has opened it since the last client was noticed to close it: the notice of another that
    /// came meanwhile is merged into that.
    hidden: bool,
    /// Whether a client has ever taken the port for itself, and kept others out.
    exclusive: bool,
    /// Whether that does not keep this process out.
    privileged: bool,
    /// After so long the kernel is to be asked again.
    ask_after: Option<Duration>,
    /// Whether this is when.
    again: bool,
}

/// Notices of the port's own descriptor, which are not to be counted.
#[derive(Default)]
struct Own {
    opened: bool,
    closed: bool,
}

impl Clients {
    /// Watches `slave`, which no one but the caller has open, and no one else is told of yet.
    pub(super) fn watch(slave: &Path) -> io::Result<Clients> {
        let notices = inotify::init(CreateFlags::NONBLOCK | CreateFlags::CLOEXEC)?;
        inotify::add_watch(&notices, slave, WatchFlags::OPEN | WatchFlags::CLOSE)?;
        let privileged = capabilities(None).is_ok_and(|sets| sets.effective.contains(CapabilitySet::SYS_ADMIN));
        let (count, changes) = (0, VecDeque::new());
        let (doubtful, lost, hidden, exclusive, again) = (false, false, false, false, false);
        Ok(Clients { notices, count, changes, doubtful, lost, hidden, exclusive, privileged, ask_after: None, again })
    }

    /// Can be read when [`look`](Clients::look) may find something new.
    pub(super) fn notices(&self) -> &OwnedFd {
        &self.notices
    }

    /// Takes in what has happened up to now. True if the last client closed meanwhile, even if the next is there.
    pub(super) fn look(&mut self, pty: &mut Pty) -> io::Result<bool> {
        let known = self.changes.len();
        let again = core::mem::take(&mut self.again);
        let later = self.ask_after.filter(|_| again).map(|after| after.saturating_mul(LATER).min(LATEST));
        for _ in 0..ASKED {
            self.read_notices(&mut Own::default())?;
            let exclusive = pty.is_exclusive()?;
            self.exclusive |= exclusive && !self.privileged;
            let lost = core::mem::take(&mut self.lost);
            if !core::mem::take(&mut self.doubtful) {
                break;
            }
            if self.exclusive && !lost {
                self.ask_after = None;
                break;
            }
            self.ask_after = Some(later.unwrap_or(ASKED_AGAIN));
            if exclusive {
                pty.clear_exclusive()?;
            }
            self.ask(pty, known)?;
            if exclusive && self.count > 0 {
                pty.make_exclusive()?;
            }
        }
        Ok(self.changes.range(known..).any(|change| *change == Change::LastClosed))
    }

    /// Asks the kernel whether anybody has the port open. `known` of the changes are certain.
    fn ask(&mut self, pty: &mut Pty, known: usize) -> io::Result<()> {
        pty.let_go();
        let mut own = Own { closed: true, opened: false };
        self.read_notices(&mut own)?;
        // After that: what the notice of another close was merged into is part of the answer.
        let mut nobody = pty.is_hung_up(None)?;
        if nobody && self.count > 0 {
            self.leave();
        }
        // Before the port's own opening, into which another is merged.
        self.read_notices(&mut own)?;
        for _ in 0..ASKED {
            if nobody || self.count > 0 {
                break;
            }
            nobody = pty.is_hung_up(Some((&self.notices, FINISHES)))?;
            self.read_notices(&mut own)?;
        }
        // A process that is being started has a copy until it runs its program; then the notice comes, and the guess
        // holds until then.
        let unclear = own.closed || self.doubtful;
        if !nobody && self.count == 0 && !unclear {
            if !self.hidden && self.changes.len() > known && self.changes.back() == Some(&Change::LastClosed) {
                self.changes.pop_back();
                self.count = 1;
            } else {
                self.open();
            }
        }
        let opened = pty.take_up()?;
        self.read_notices(&mut Own { closed: false, opened })
    }

    fn read_notices(&mut self, own: &mut Own) -> io::Result<()> {
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
        // If a client closes just before the port does, the next may have opened it in between.
        let closes = |events: &ReadFlags| events.contains(ReadFlags::CLOSE_NOWRITE);
        let closed = notices.iter().rposition(closes).filter(|_| core::mem::take(&mut own.closed));
        for (place, events) in notices.into_iter().enumerate() {
            if events.contains(ReadFlags::QUEUE_OVERFLOW) {
                (self.doubtful, self.lost) = (true, true);
            } else if events.contains(ReadFlags::OPEN) {
                if core::mem::take(&mut own.opened) {
                    self.hidden = true;
                } else {
                    self.open();
                }
            } else if closed == Some(place) {
            } else if events.intersects(ReadFlags::CLOSE_WRITE | ReadFlags::CLOSE_NOWRITE) {
                self.doubtful = true;
                match self.count {
                    0 => {}
                    1 => self.leave(),
                    _ => self.count -= 1,
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

    fn leave(&mut self) {
        self.count = 0;
        self.hidden = false;
        self.changes.push_back(Change::LastClosed);
    }

    /// Somebody has written: there is a client.
    pub(super) fn hear(&mut self) {
        if self.count == 0 {
            self.open();
        }
    }

    /// After so long the kernel is to be [asked again](Clients::ask_again) whether anybody is there.
    pub(super) fn ask_after(&self) -> Option<Duration> {
        self.ask_after.filter(|after| self.count == 0 || *after <= LATEST_OF_SOMEBODY)
    }

    /// Whether the last close has only just been noticed: the kernel has not been asked again since.
    pub(super) fn is_unsure(&self) -> bool {
        self.count == 0 && self.ask_after == Some(ASKED_AGAIN)
    }

    /// Asks it, with the next look.
    pub(super) fn ask_again(&mut self) {
        (self.doubtful, self.again) = (true, true);
    }

    /// Whether no one has the port open.
    pub(super) fn nobody(&self) -> bool {
        self.count == 0
    }

    /// The changes that no one has been told of, oldest first.
    pub(super) fn changes(&mut self) -> &mut VecDeque<Change> {
        &mut self.changes
    }
}
