use std::io;

use super::PortError;
use super::event::{LineCoding, LineSettings, PortEvent};
use super::link::LinkPath;
use super::tcp::TcpPort;
use super::terminal::PtyPort;
use crate::Transport;

/// The emulated rig's side of the PC's serial port, for as long as it lives, whatever clients reach it by.
#[derive(Debug)]
pub enum PcPort {
    /// A pseudo-terminal.
    Pty(PtyPort),
    /// A TCP socket.
    Tcp(Box<TcpPort>),
}

impl PcPort {
    /// Opens a port at the rig's speed of `baud` (in baud, from 1), 8N1. A pty is announced at `link`.
    ///
    /// # Errors
    ///
    /// If the link is taken or cannot be made, or the system has no pty or socket to give.
    pub fn open(transport: Transport, link: LinkPath, baud: u32) -> Result<PcPort, PortError> {
        let tcp = |address, controls| TcpPort::open(address, controls, baud).map(|port| Self::Tcp(Box::new(port)));
        match transport {
            Transport::Pty => PtyPort::open(link, baud).map(Self::Pty),
            Transport::Tcp(address) => tcp(address, false),
            Transport::Rfc2217(address) => tcp(address, true),
        }
    }

    /// The pty, if it is one.
    pub const fn pty(&self) -> Option<&PtyPort> {
        match self {
            Self::Pty(port) => Some(port),
            Self::Tcp(_) => None,
        }
    }

    /// Where clients find it, as pyserial's `serial_for_url` takes it: a path or a URL.
    pub fn url(&self) -> String {
        match self {
            Self::Pty(port) => port.link().display().to_string(),
            Self::Tcp(port) => port.url(),
        }
    }

    /// Whether it reports DTR. Others have it risen when a client opens them.
    pub fn tells_dtr(&self) -> bool {
        match self {
            Self::Pty(_) => false,
            Self::Tcp(port) => port.controls(),
        }
    }

    /// What a client has set the line to by now. As with a serial adapter, it stays so when the client closes.
    ///
    /// # Errors
    ///
    /// If the system refuses, which it has no reason to.
    pub fn settings(&self) -> io::Result<LineSettings> {
        match self {
            Self::Pty(port) => port.settings(),
            Self::Tcp(port) => Ok(port.settings()),
        }
    }

    /// What the next byte that has not been taken was written in; without one, what the line is set to.
    pub fn next_coding(&self) -> LineCoding {
        match self {
            Self::Pty(port) => port.next_coding(),
            Self::Tcp(port) => port.next_coding(),
        }
    }

    /// Waits for the next event, and takes at most `max` bytes of data; with a `coding`, only such as were written in
    /// that. Data that are not taken stay where they are: the client fills the system's buffers, and its writes then
    /// block, as with a driver whose queue is full. Other events come even so.
    ///
    /// Cancel-safe: an event that was not returned comes from the next call.
    ///
    /// # Errors
    ///
    /// If the system refuses.
    pub async fn event(&mut self, max: usize, coding: Option<LineCoding>) -> io::Result<PortEvent> {
        match self {
            Self::Pty(port) => port.event(max, coding).await,
            Self::Tcp(port) => port.event(max, coding).await,
        }
    }

    /// The next event, if it is there already: see [`PcPort::event`].
    ///
    /// # Errors
    ///
    /// As there.
    pub fn try_event(&mut self, max: usize, coding: Option<LineCoding>) -> io::Result<Option<PortEvent>> {
        match self {
            Self::Pty(port) => port.try_event(max, coding),
            Self::Tcp(port) => port.try_event(max, coding),
        }
    }

    /// Writes replies towards the client without waiting.
    ///
    /// Returns how many bytes were lost because the client does not read. With no client they go nowhere, as on a cable
    /// that no one listens to, and 0 is returned.
    #[must_use = "bytes may have been lost"]
    pub fn write(&mut self, bytes: &[u8]) -> usize {
        match self {
            Self::Pty(port) => port.write(bytes),
            Self::Tcp(port) => port.write(bytes),
        }
    }

    /// A character has come with an error, or a break: tells the client, if there is a way to.
    pub fn tell_line_error(&mut self, is_break: bool) {
        match self {
            Self::Pty(_) => {}
            Self::Tcp(port) => port.tell_line_error(is_break),
        }
    }

    /// How many bytes clients have left that have closed the port.
    pub fn leftover(&self) -> usize {
        match self {
            Self::Pty(port) => port.leftover(),
            Self::Tcp(port) => port.leftover(),
        }
    }

    /// Whether these are to be held by XON/XOFF, as was set when they were left. None if there are none.
    pub fn leftover_ixon(&self) -> Option<bool> {
        match self {
            Self::Pty(port) => port.leftover_ixon(),
            Self::Tcp(port) => port.leftover_ixon(),
        }
    }

    /// Forgets those that are older than the client that [has begun](PortEvent::Began). Says how many there were.
    pub fn forget_leftover(&mut self) -> usize {
        match self {
            Self::Pty(port) => port.forget_leftover(),
            Self::Tcp(port) => port.forget_leftover(),
        }
    }
}
