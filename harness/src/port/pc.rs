use std::io;
use std::path::{Path, PathBuf};

use super::attendant::{Attendant, Desk};
use super::clients::Clients;
use super::link::Link;
use super::pty::Pty;
use super::{LineSettings, LinkPath, PortError};

/// Something that happened at the PC's port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PortEvent {
    /// A client opened the port, which nobody had open.
    Opened,
    /// The client that opened the port has written for the first time; its bytes follow those that the one before
    /// has left, unless these are [forgotten](PcPort::forget_leftover).
    Began,
    /// Bytes that a client has written at a speed.
    Data {
        /// The bytes; never empty.
        bytes: Vec<u8>,
        /// The speed that the line was set to when they were written, in baud.
        baud: u32,
    },
    /// The client has flushed its output: whatever it wrote before and has not left yet is to be forgotten.
    Flushed,
    /// The client has set another speed, or turned XON/XOFF on or off: see [`PcPort::settings`].
    Set,
    /// The last client has closed the port. What it has left still comes, before the bytes of the next.
    Closed,
}

/// The emulated rig's side of the PC's serial port, for as long as it lives. Dropped, it hangs up whoever has the port
/// open, as when an adapter is pulled out, and removes its link.
#[derive(Debug)]
pub struct PcPort {
    // First, so that the link goes before the pty it points to.
    link: Link,
    path: PathBuf,
    attendant: Attendant,
}

impl PcPort {
    /// Opens a port at the rig's speed of `baud` (in baud, from 1), 8N1, raw, and then announces it at `link`. Only the
    /// current user may open it.
    ///
    /// # Errors
    ///
    /// If the link is taken or cannot be made, or the system has no pty to give.
    pub fn open(link: LinkPath, baud: u32) -> Result<PcPort, PortError> {
        let pty = Pty::open(baud)?;
        let path = pty.path().to_owned();
        let clients = Clients::watch(&path).map_err(PortError::watch)?;
        let attendant = Desk::new(clients, pty).and_then(Attendant::start).map_err(PortError::watch)?;
        Ok(PcPort { link: Link::make(link, &path)?, path, attendant })
    }

    /// The device that clients open, `/dev/pts/N`.
    pub fn path(&self) -> &Path {
        &self.path
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
        self.attendant.desk().settings()
    }

    /// The speed at which the next byte that has not been taken was written; without one, what the line is set to.
    pub fn next_baud(&self) -> u32 {
        self.attendant.desk().next_baud()
    }

    /// Waits for the next event, and takes at most `max` bytes of data; with a `baud`, only such as were written at
    /// that speed. Data that are not taken stay where they are: the client fills the kernel's buffer, and its writes
    /// then block, as with a driver whose queue is full. Other events come even so.
    ///
    /// Cancel-safe: an event that was not returned comes from the next call.
    ///
    /// # Errors
    ///
    /// If the system refuses.
    pub async fn event(&mut self, max: usize, baud: Option<u32>) -> io::Result<PortEvent> {
        loop {
            // News that comes after the try is kept, and ends the wait.
            if let Some(event) = self.try_event(max, baud)? {
                return Ok(event);
            }
            self.attendant.news().await;
        }
    }

    /// The next event, if it is there already: see [`PcPort::event`].
    ///
    /// # Errors
    ///
    /// As there.
    pub fn try_event(&mut self, max: usize, baud: Option<u32>) -> io::Result<Option<PortEvent>> {
        self.attendant.event(max, baud)
    }

    /// Writes replies towards the client without waiting; XON and XOFF among them act on a client that has IXON on.
    ///
    /// Returns how many bytes were lost because the client does not read (the kernel holds about 22 KB for it). With no
    /// client they go nowhere, as on a cable that nobody listens to, and 0 is returned.
    #[must_use = "bytes may have been lost"]
    pub fn write(&mut self, bytes: &[u8]) -> usize {
        self.attendant.desk().write(bytes)
    }

    /// How many bytes clients have left that have closed the port.
    pub fn leftover(&self) -> usize {
        self.attendant.desk().leftover()
    }

    /// Forgets those that are older than the client that [has begun](PortEvent::Began). Says how many there were.
    pub fn forget_leftover(&mut self) -> usize {
        self.attendant.desk().forget_leftover()
    }

    /// Keeps the port from noticing anything, for as long as what this gives is held.
    #[cfg(test)]
    pub(super) fn unattended(&self) -> std::sync::MutexGuard<'_, Desk> {
        self.attendant.desk()
    }
}
