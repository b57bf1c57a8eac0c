use std::io;
use std::path::{Path, PathBuf};

use super::PortError;
use super::attendant::{Attendant, Desk};
use super::clients::Clients;
use super::event::{LineCoding, LineSettings, PortEvent};
use super::link::{Link, LinkPath};
use super::pty::Pty;

/// The emulated rig's side of the PC's serial port, for as long as it lives. Dropped, it hangs up whoever has the port
/// open, as when an adapter is pulled out, and removes its link.
#[derive(Debug)]
pub struct PtyPort {
    // First, so that the link goes before the pty it points to.
    link: Link,
    path: PathBuf,
    attendant: Attendant,
}

impl PtyPort {
    /// Opens a port at the rig's speed of `baud` (in baud, from 1), 8N1, raw, and then announces it at `link`. Only the
    /// current user may open it.
    ///
    /// # Errors
    ///
    /// If the link is taken or cannot be made, or the system has no pty to give.
    pub fn open(link: LinkPath, baud: u32) -> Result<PtyPort, PortError> {
        let pty = Pty::open(baud)?;
        let path = pty.path().to_owned();
        let clients = Clients::watch(&path).map_err(PortError::watch)?;
        let attendant = Desk::new(clients, pty).and_then(Attendant::start).map_err(PortError::watch)?;
        Ok(PtyPort { link: Link::make(link, &path)?, path, attendant })
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

    /// What the next byte that has not been taken was written in; without one, what the line is set to.
    pub fn next_coding(&self) -> LineCoding {
        self.attendant.desk().next_coding()
    }

    /// Waits for the next event, and takes at most `max` bytes of data; with a `coding`, only such as were
    /// written in that. Data that are not taken stay where they are: the client fills the kernel's buffer, and its
    /// writes then block, as with a driver whose queue is full. Other events come even so.
    ///
    /// Cancel-safe: an event that was not returned comes from the next call.
    ///
    /// # Errors
    ///
    /// If the system refuses.
    pub async fn event(&mut self, max: usize, coding: Option<LineCoding>) -> io::Result<PortEvent> {
        loop {
            // News that comes after the try is kept, and ends the wait.
            if let Some(event) = self.try_event(max, coding)? {
                return Ok(event);
            }
            self.attendant.news().await;
        }
    }

    /// The next event, if it is there already: see [`PtyPort::event`].
    ///
    /// # Errors
    ///
    /// As there.
    pub fn try_event(&mut self, max: usize, coding: Option<LineCoding>) -> io::Result<Option<PortEvent>> {
        self.attendant.event(max, coding)
    }

    /// Writes replies towards the client without waiting; XON and XOFF among them act on a client that has IXON on.
    ///
    /// Returns how many bytes were lost because the client does not read (the kernel holds about 22 KB for it). With no
    /// client they go nowhere, as on a cable that no one listens to, and 0 is returned.
    #[must_use = "bytes may have been lost"]
    pub fn write(&mut self, bytes: &[u8]) -> usize {
        self.attendant.desk().write(bytes)
    }

    /// How many bytes clients have left that have closed the port.
    pub fn leftover(&self) -> usize {
        self.attendant.desk().leftover()
    }

    /// Whether these are to be held by XON/XOFF, as was set when they were left. None if there are none.
    pub fn leftover_ixon(&self) -> Option<bool> {
        self.attendant.desk().leftover_ixon()
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
