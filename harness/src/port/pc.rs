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
    /// Bytes the client has written; never empty.
    Data(Vec<u8>),
    /// The client has flushed its output: whatever it wrote before and has not left yet is to be forgotten.
    Flushed,
    /// The client has turned XON/XOFF on or off: see [`PcPort::settings`].
    FlowControl,
    /// The last client has closed the port. All its data came before this, unless the next client was there already:
    /// then what is left comes after that one's [`Opened`](PortEvent::Opened). Nothing is ever lost.
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
    /// Whether the last of `Opened` and `Closed` that was told is `Opened`.
    told_open: bool,
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
        Ok(PcPort { link, clients, pty, told_open: false })
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
    /// events come even so, but for `Closed`, which waits for the data before it.
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
        if self.told_open {
            // With the next client there, the old one's bytes cannot be told from its own: no use in waiting for them.
            let next_is_there = self.clients.changes().len() > 1;
            if !next_is_there {
                match self.pty.look(max)? {
                    Look::Data(data) => return Ok(Some(PortEvent::Data(data))),
                    Look::Flushed => return Ok(Some(PortEvent::Flushed)),
                    Look::FlowControl => return Ok(Some(PortEvent::FlowControl)),
                    Look::Unwanted => return Ok(None),
                    Look::Nothing => {}
                }
            }
        }
        // While nobody has the port open there is nothing to read: an open is noticed before the bytes that follow it.
        match self.clients.changes().pop_front() {
            Some(Change::FirstOpened) => {
                self.told_open = true;
                Ok(Some(PortEvent::Opened))
            }
            Some(Change::LastClosed) => {
                self.told_open = false;
                self.notice_clients()?;
                Ok(Some(PortEvent::Closed))
            }
            None => Ok(None),
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
        }
        Ok(())
    }
}
