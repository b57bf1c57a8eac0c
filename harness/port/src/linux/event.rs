//! What a client does at a port, and what it sets.

use torno_protocol::uart::Format;

/// How the bytes of a client become characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineCoding {
    /// Speed at which the client sends, in baud; any number, not only the standard ones. 0 (`B0`) is a line hung up.
    pub baud: u32,
    /// The format of a character.
    pub format: Format,
}

impl LineCoding {
    /// 8N1 at this speed.
    pub const fn at(baud: u32) -> Self {
        Self { baud, format: Format::EIGHT_N_ONE }
    }
}

/// What the client has set its end of the line to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineSettings {
    /// Speed and format.
    pub coding: LineCoding,
    /// Whether XOFF and XON stop and restart the client's writes.
    pub ixon: bool,
}

/// Something that happened at the PC's port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PortEvent {
    /// A client opened the port, which no one had open.
    Opened,
    /// The client has raised DTR, where the port [tells](super::PcPort::tells_dtr) of it. Elsewhere it rises with the
    /// open.
    Ready,
    /// The client that opened the port has written for the first time; its bytes follow those that the one before
    /// has left, unless these are [forgotten](super::PcPort::forget_leftover).
    Began,
    /// Bytes that a client has written.
    Data {
        /// The bytes; never empty.
        bytes: Vec<u8>,
        /// What the line was set to when they were written.
        coding: LineCoding,
    },
    /// The client wants the line held low (`true`), or no longer. Comes behind what it has written before.
    Break(bool),
    /// The client has flushed its output: whatever it wrote before and has not left yet is to be forgotten.
    Flushed,
    /// The client has set another speed or format, or turned XON/XOFF on or off: see [`super::PcPort::settings`].
    Set,
    /// The last client has closed the port. What it has left still comes, before the bytes of the next.
    Closed,
}
