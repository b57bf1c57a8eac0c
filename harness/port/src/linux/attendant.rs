//! What attends to the port: a thread that takes in at once what clients do, however busy the rig is.
//!
//! Everything is done under one lock, by whoever comes first: the thread, or the rig that asks for events.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use rustix::event::{EventfdFlags, eventfd};
use rustix::fd::OwnedFd;
use tokio::sync::Notify;

use super::clients::{Change, Clients};
use super::event::{LineCoding, LineSettings, PortEvent};
use super::order::{self, Mark, Waited};
use super::pty::{ClientAction, Pty};
use super::queue::Queue;

/// So many bytes are taken from a client before they are wanted, as by a serial driver: for these it is known at which
/// speed they were written, and whether a flush is for them. Others stay in the kernel.
const AHEAD: usize = 256;
/// So many are taken if they have to leave the kernel at once: what it holds, several times.
const MOST: usize = 1 << 16;
/// So often the port is looked at in a row, if there is always something new.
const AT_ONCE: usize = 16;

/// The port as it is attended to.
#[derive(Debug)]
pub(super) struct Desk {
    clients: Clients,
    pub(super) pty: Pty,
    queue: Queue,
    /// Whether a client has set the line, and no one has been told.
    set: bool,
    /// Whether there is more to take in than was taken in at once.
    more: bool,
    /// After how long the thread means to ask again who is there.
    asks_after: Option<Duration>,
    failed: Option<io::Error>,
}

impl Desk {
    pub(super) fn new(clients: Clients, pty: Pty) -> io::Result<Desk> {
        pty.order().watch(clients.notices(), Mark::Noticed)?;
        let queue = Queue::default();
        Ok(Desk { clients, pty, queue, set: false, more: false, asks_after: None, failed: None })
    }

    /// The next event, if it is there already. Data only if they were written in `coding`, if that is given.
    pub(super) fn event(&mut self, max: usize, coding: Option<LineCoding>) -> io::Result<Option<PortEvent>> {
        self.failed.take().map_or(Ok(()), Err)?;
        self.attend()?;
        Ok(match self.clients.changes().pop_front() {
            Some(Change::FirstOpened) => Some(PortEvent::Opened),
            Some(Change::LastClosed) => Some(PortEvent::Closed),
            None if core::mem::take(&mut self.set) => Some(PortEvent::Set),
            None => self.queue.next(max, coding),
        })
    }

    /// Writes towards the client, if the rig has been told of it: what comes earlier is not for this one. Returns how
    /// many bytes were lost.
    pub(super) fn write(&mut self, bytes: &[u8]) -> usize {
        // A failure here comes again at the next event.
        let _ = self.attend();
        if self.clients.is_unsure() {
            let _ = self.ask_again();
        }
        let is_new = self.clients.changes().contains(&Change::FirstOpened);
        if is_new || self.clients.nobody() { 0 } else { bytes.len() - self.pty.write(bytes) }
    }

    /// What the line was last set to.
    pub(super) fn settings(&mut self) -> io::Result<LineSettings> {
        self.attend()?;
        Ok(self.pty.line())
    }

    /// What the first byte that no one has taken was written in, or what the line is set to.
    pub(super) fn next_coding(&self) -> LineCoding {
        self.queue.next_coding().unwrap_or(self.pty.line().coding)
    }

    /// How many bytes clients have left that have closed the port.
    pub(super) fn leftover(&self) -> usize {
        self.queue.leftover()
    }

    /// Whether these are to be held by XON/XOFF. None if there are none.
    pub(super) fn leftover_ixon(&self) -> Option<bool> {
        self.queue.leftover_ixon()
    }

    /// How many bytes are held of the client that has the port open.
    #[cfg(test)]
    pub(super) fn held(&self) -> usize {
        self.queue.held()
    }

    pub(super) fn forget_leftover(&mut self) -> usize {
        self.queue.forget_leftover()
    }

    /// Takes in what has happened.
    fn attend(&mut self) -> io::Result<()> {
        self.more = false;
        self.pty.note_order()?;
        for _ in 0..AT_ONCE {
            self.notice_clients()?;
            let held = self.queue.held();
            if self.listen(AHEAD.saturating_sub(held), MOST.saturating_sub(held))? {
                self.clients.hear();
            }
            if !self.pty.note_order()? {
                return Ok(());
            }
        }
        self.more = true;
        Ok(())
    }

    /// Makes sure who is there.
    fn ask_again(&mut self) -> io::Result<()> {
        self.clients.ask_again();
        self.attend()
    }

    /// Takes in who opened and closed the port, and cleans up behind the last client at once: the next must find
    /// neither its replies nor its stops.
    fn notice_clients(&mut self) -> io::Result<()> {
        let known = self.clients.changes().len();
        if self.clients.look(&mut self.pty)? {
            if self.clients.nobody() {
                self.pty.clear_exclusive()?;
            }
            self.pty.forget_replies_and_restart()?;
            // The next may be there already, but has hardly written yet.
            self.listen(MOST, MOST)?;
            self.queue.leave(self.pty.line().ixon);
        }
        if self.clients.changes().len() > known && self.clients.changes().back() == Some(&Change::FirstOpened) {
            self.queue.forget_beginnings();
        }
        Ok(())
    }

    /// Takes what the client has done, at most `room` bytes, or `most` of which the speed would be lost.
    /// Says whether it has written.
    fn listen(&mut self, room: usize, most: usize) -> io::Result<bool> {
        let mut wrote = false;
        for said in self.pty.look(room, most.max(room))? {
            match said {
                ClientAction::Set => self.set = true,
                ClientAction::Flushed => self.queue.flush(),
                ClientAction::Data(bytes, baud) => {
                    wrote = true;
                    self.queue.put(bytes, LineCoding::at(baud));
                }
            }
        }
        Ok(wrote)
    }
}

/// The port, and the thread that attends to it for as long as this lives.
#[derive(Debug)]
pub(super) struct Attendant {
    shared: Arc<Shared>,
    call: Arc<OwnedFd>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Shared {
    desk: Mutex<Desk>,
    /// Told whenever the thread has taken something in.
    news: Notify,
    /// The thread is to end.
    over: AtomicBool,
}

impl Shared {
    fn desk(&self) -> MutexGuard<'_, Desk> {
        self.desk.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Attendant {
    pub(super) fn start(desk: Desk) -> io::Result<Attendant> {
        let order = desk.pty.order().descriptor()?;
        let call = Arc::new(eventfd(0, EventfdFlags::CLOEXEC)?);
        let shared = Arc::new(Shared { desk: Mutex::new(desk), news: Notify::new(), over: AtomicBool::new(false) });
        let (for_thread, called) = (Arc::clone(&shared), Arc::clone(&call));
        let thread = thread::Builder::new().name("port".to_owned());
        let thread = thread.spawn(move || attend_to(&for_thread, &order, &called))?;
        Ok(Attendant { shared, call, thread: Some(thread) })
    }

    pub(super) fn desk(&self) -> MutexGuard<'_, Desk> {
        self.shared.desk()
    }

    /// The next event, as [there](Desk::event).
    pub(super) fn event(&self, max: usize, coding: Option<LineCoding>) -> io::Result<Option<PortEvent>> {
        let mut desk = self.desk();
        let event = desk.event(max, coding);
        // Only the thread can go on by itself, and wait for it to be time to ask again.
        let asks_after = desk.clients.ask_after();
        if core::mem::replace(&mut desk.asks_after, asks_after) != asks_after || desk.more {
            self.call();
        }
        event
    }

    /// Has the thread attend to the port.
    fn call(&self) {
        // It fails only if the thread has been called so often that it comes anyway.
        let _ = rustix::io::write(&*self.call, &1_u64.to_ne_bytes());
    }

    /// Waits until there may be an event. Cancel-safe.
    pub(super) async fn news(&self) {
        self.shared.news.notified().await;
    }
}

impl Drop for Attendant {
    fn drop(&mut self) {
        // The thread ends as well if it has failed. The pty goes only with it.
        self.shared.over.store(true, Ordering::Release);
        self.call();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn attend_to(shared: &Shared, order: &OwnedFd, call: &OwnedFd) {
    let (mut more, mut asks_after) = (false, None);
    loop {
        let waited = order::wait(order, call, if more { Some(Duration::ZERO) } else { asks_after });
        let mut desk = shared.desk();
        let looked = match waited {
            Ok(Waited::Called) if shared.over.load(Ordering::Acquire) => return,
            Ok(Waited::InVain) if !more => desk.ask_again(),
            Ok(waited) => {
                if waited == Waited::Called {
                    let _ = rustix::io::read(call, &mut [0u8; 8]);
                }
                desk.attend()
            }
            Err(errno) => Err(errno.into()),
        };
        (more, asks_after) = (desk.more, desk.clients.ask_after());
        desk.asks_after = asks_after;
        let failed = looked.is_err();
        if let Err(error) = looked {
            desk.failed = Some(error);
        }
        drop(desk);
        shared.news.notify_one();
        if failed {
            return;
        }
    }
}
