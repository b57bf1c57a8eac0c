//! In which order a client has written, set the line and flushed.
//!
//! The kernel does not tell the master side. But it wakes different waiters: a write wakes those that wait for room
//! (`EPOLLOUT`) at the slave, new settings wake all at the slave, and a flush wakes all at the master. epoll lists what
//! has become ready in the order in which it did, so an entry for each kind tells which came first.
//!
//! An entry that is listed already is not moved: of two writes between two looks, only the first is told.

use std::time::Duration;

use rustix::event::epoll::{self, CreateFlags, Event, EventData, EventFlags};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::{AsFd, OwnedFd};
use rustix::io::{Errno, retry_on_intr};

/// Something that has happened since the last look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mark {
    /// Somebody opened or closed the port.
    Noticed,
    /// The client wrote. Reading at the master side looks the same.
    Wrote,
    /// The client set the line.
    Set,
    /// Bytes came to where the master side reads them.
    Arrived,
    /// The master side is told a status: the client has flushed, for one.
    Told,
}

const MARKS: [Mark; 5] = [Mark::Noticed, Mark::Wrote, Mark::Set, Mark::Arrived, Mark::Told];

#[derive(Debug)]
pub(super) struct Order {
    epoll: OwnedFd,
}

impl Order {
    pub(super) fn new() -> rustix::io::Result<Order> {
        Ok(Order { epoll: epoll::create(CreateFlags::CLOEXEC)? })
    }

    /// Has `source` set `mark`. A descriptor can set one: for two of the same file, it takes a duplicate.
    pub(super) fn watch(&self, source: impl AsFd, mark: Mark) -> rustix::io::Result<()> {
        let flags = match mark {
            Mark::Noticed | Mark::Arrived => EventFlags::IN,
            Mark::Wrote => EventFlags::OUT,
            // No waker names it, so only those that wake all set this mark.
            Mark::Set => EventFlags::WRNORM,
            Mark::Told => EventFlags::PRI,
        };
        epoll::add(&self.epoll, source, EventData::new_u64(mark as u64), flags | EventFlags::ET)
    }

    /// The marks that have been set since they were last taken, first things first.
    pub(super) fn take(&self) -> rustix::io::Result<Vec<Mark>> {
        let mut seen: Vec<Event> = Vec::with_capacity(2 * MARKS.len());
        let at_once = Timespec { tv_sec: 0, tv_nsec: 0 };
        let spare = rustix::buffer::spare_capacity(&mut seen);
        match epoll::wait(&self.epoll, spare, Some(&at_once)) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(errno) => return Err(errno),
        }
        let mark = |event: &Event| MARKS.get(usize::try_from(event.data.u64()).ok()?).copied();
        Ok(seen.iter().filter_map(mark).collect())
    }

    /// Another descriptor of it, to [wait](wait) on.
    pub(super) fn descriptor(&self) -> std::io::Result<OwnedFd> {
        self.epoll.try_clone()
    }
}

/// How a wait has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Waited {
    /// There are marks to take.
    Marked,
    /// There are none, after all the time given.
    InVain,
    /// Somebody has called.
    Called,
}

/// Waits until there are marks to take, or `call` can be read, for as long as `most` if that is given.
pub(super) fn wait(order: &OwnedFd, call: &OwnedFd, most: Option<Duration>) -> rustix::io::Result<Waited> {
    let most = most.and_then(|most| Timespec::try_from(most).ok());
    let mut polled = [PollFd::new(order, PollFlags::IN), PollFd::new(call, PollFlags::IN)];
    retry_on_intr(|| poll(&mut polled, most.as_ref()))?;
    let [order, call] = polled.map(|polled| !polled.revents().is_empty());
    Ok(if call {
        Waited::Called
    } else if order {
        Waited::Marked
    } else {
        Waited::InVain
    })
}
