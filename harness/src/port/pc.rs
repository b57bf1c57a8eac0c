use std::collections::VecDeque;
use std::io;
use std::path::Path;

use super::clients::{Change, Clients};
use super::link::Link;
use super::pty::{Look, Pty};
use super::{LineSettings, LinkPath, PortError};

/// Something that happened at the PC's port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PortEvent {
    /// A client opened the port, which nobody had open.
    Opened,
    /// The client that opened the port has written for the first time; its bytes follow those that the one before
    /// has left, unless these are [forgotten](PcPort::forget_leftover).
    Began,
    /// Bytes the client has written; never empty.
    Data(Vec<u8>),
    /// The client has flushed its output: whatever it wrote before and has not left yet is to be forgotten.
    Flushed,
    /// The client has turned XON/XOFF on or off: see [`PcPort::settings`].
    FlowControl,
    /// The last client has closed the port. What it has left still comes, before the bytes of the next.
    Closed,
}

/// The emulated rig's side of the PC's serial port, for as long as it lives. Dropped, it hangs up whoever has the port
/// open, as when an adapter is pulled out, and removes its link.
#[derive(Debug)]
pub struct PcPort {
    // First, so that the link goes before the pty it points to.
    link: Link,
    clients: Clients,
    pty: Pty,
    /// Whether the client that has the port open has written.
    began: bool,
    /// What clients that have closed the port still had to say.
    leftover: VecDeque<PortEvent>,
    /// So much of it is older than the client that was last told to have begun.
    older: usize,
}

impl PcPort {
    /// Opens a port at the rig's speed of `baud` (in baud, from 1), 8N1, raw, and then announces it at `link`. Only the
    /// current user may open it.
    ///
    /// # Errors
    ///
    /// If the link is taken or cannot be made, or the system has no pty to give.
    ///
    /// # Panics
    ///
    /// Outside a tokio runtime with I/O enabled.
    pub fn open(link: LinkPath, baud: u32) -> Result<PcPort, PortError> {
        let pty = Pty::open(baud)?;
        let clients = Clients::watch(pty.path()).map_err(PortError::watch)?;
        let link = Link::make(link, pty.path())?;
        Ok(PcPort { link, clients, pty, began: false, leftover: VecDeque::new(), older: 0 })
    }

    /// The device that clients open, `/dev/pts/N`.
    pub fn path(&self) -> &Path {
        self.pty.path()
    }

    /// The symbolic link to it, which stays the same from run to run.
    pub fn link(&self) -> &Path {
        self.link.path()
    }

    /// What a client has set the line to by now. As with a serial adapter, it stays so when the client closes: that is
    /// why `stty -F PORT` works.
    ///
    /// # Errors
    ///
    /// If the system refuses, which it has no reason to.
    pub fn settings(&self) -> io::Result<LineSettings> {
        self.pty.settings()
    }

    /// Waits for the next event, and takes at most `max` bytes of data. With 0, data stay where they are: the client
    /// fills the kernel's buffer (9 to 18 KB), and its writes then block, as with a driver whose queue is full. Other
    /// events come even so.
    ///
    /// Cancel-safe: an event that was not returned comes from the next call.
    ///
    /// # Errors
    ///
    /// If the system refuses, or if so many terminals came and went between two calls (thousands) that the port lost
    /// count of its clients.
    pub async fn event(&mut self, max: usize) -> io::Result<PortEvent> {
        loop {
            // Readiness is cleared before each try, so whatever comes after the try ends the wait.
            if let Some(event) = self.try_event(max)? {
                return Ok(event);
            }
            tokio::select! {
                ready = self.clients.ready() => ready?,
                ready = self.pty.ready() => ready?,
            }
        }
    }

    /// Writes replies towards the client without waiting; XON and XOFF among them act on a client that has IXON on.
    ///
    /// Returns how many bytes were lost because the client does not read (the kernel holds about 22 KB for it). With no
    /// client they go nowhere, as on a cable that nobody listens to, and 0 is returned.
    #[must_use = "bytes may have been lost"]
    pub fn write(&mut self, bytes: &[u8]) -> usize {
        // A failure here comes again at the next event.
        let _ = self.notice_clients();
        if self.clients.nobody() {
            return 0;
        }
        bytes.len() - self.pty.write(bytes)
    }

    #[cfg(test)]
    pub(super) fn master(&self) -> rustix::fd::BorrowedFd<'_> {
        self.pty.master()
    }

    /// The next event, if it is there already: see [`PcPort::event`].
    ///
    /// # Errors
    ///
    /// As there.
    pub fn try_event(&mut self, max: usize) -> io::Result<Option<PortEvent>> {
        self.notice_clients()?;
        Ok(match self.clients.changes().pop_front() {
            Some(Change::FirstOpened) => {
                if self.clients.changes().is_empty() {
                    self.leftover.retain(|event| *event != PortEvent::Began);
                }
                Some(PortEvent::Opened)
            }
            Some(Change::LastClosed) => Some(PortEvent::Closed),
            // While nobody has the port open there is nothing to read: an open is noticed before the bytes that follow.
            None if self.clients.nobody() => self.take_leftover(max),
            None => self.look(max)?,
        })
    }

    /// What the client that has the port open does, after what the one before has left.
    fn look(&mut self, max: usize) -> io::Result<Option<PortEvent>> {
        let wanted = if self.began && self.leftover.is_empty() { max } else { 0 };
        Ok(match self.pty.look(wanted)? {
            Look::Data(data) => Some(PortEvent::Data(data)),
            Look::Flushed => {
                self.leftover.clear();
                Some(PortEvent::Flushed)
            }
            Look::FlowControl => Some(PortEvent::FlowControl),
            Look::Unwanted if !self.began => {
                self.began = true;
                self.older = self.leftover.len();
                Some(PortEvent::Began)
            }
            Look::Unwanted | Look::Nothing => self.take_leftover(max),
        })
    }

    fn take_leftover(&mut self, max: usize) -> Option<PortEvent> {
        // That another client has begun is told even if nobody wants the bytes of the one before.
        if let Some(began) = self.leftover.iter().position(|event| *event == PortEvent::Began) {
            self.older = began;
            return self.leftover.remove(began);
        }
        match self.leftover.front_mut()? {
            PortEvent::Data(_) if max == 0 => None,
            PortEvent::Data(data) if data.len() > max => Some(PortEvent::Data(data.drain(..max).collect())),
            _ => {
                self.older = self.older.saturating_sub(1);
                self.leftover.pop_front()
            }
        }
    }

    /// How many bytes clients have left that have closed the port.
    pub fn leftover(&self) -> usize {
        self.leftover.iter().map(|event| if let PortEvent::Data(data) = event { data.len() } else { 0 }).sum()
    }

    /// Forgets those that are older than the client that [has begun](PortEvent::Began). Says how many there were.
    pub fn forget_leftover(&mut self) -> usize {
        let left = self.leftover();
        self.leftover.drain(..self.older.min(self.leftover.len()));
        self.older = 0;
        left - self.leftover()
    }

    /// The last client is gone: what it has left is set apart from what the next one will write.
    fn set_leftover_apart(&mut self) -> io::Result<()> {
        loop {
            let event = match self.pty.look(usize::MAX)? {
                Look::Data(data) => PortEvent::Data(data),
                Look::Flushed => {
                    self.leftover.clear();
                    PortEvent::Flushed
                }
                Look::FlowControl => PortEvent::FlowControl,
                Look::Nothing | Look::Unwanted => return Ok(()),
            };
            if !core::mem::replace(&mut self.began, true) {
                self.leftover.push_back(PortEvent::Began);
            }
            self.leftover.push_back(event);
        }
    }

    /// Takes in who opened and closed the port, and cleans up behind the last client at once: the next must find
    /// neither its replies nor its stops.
    fn notice_clients(&mut self) -> io::Result<()> {
        if self.clients.look()? {
            self.pty.forget_replies_and_restart()?;
            if self.clients.nobody() {
                self.pty.clear_exclusive()?;
            }
            // The next may be there already, but has hardly written yet.
            self.set_leftover_apart()?;
            self.began = false;
        }
        Ok(())
    }
}
