//! The serial port: a pty that PC software opens as if it were a serial adapter, or a socket. [`PcPort`] is either.
//!
//! A pty differs from a serial port where it hurts; [`PtyPort`] takes care of these:
//!
//! - A fresh pty echoes, and acts on XON/XOFF. The rig's speed, 8N1 and raw mode are set before the link is announced.
//! - Once the last client has closed, reads on the master side fail with EIO for ever. The port keeps a slave
//!   descriptor of its own, so a port without a client costs nothing.
//! - Because of that descriptor the tty is never closed and a client's state would outlive it: exclusive mode gives the
//!   next one EBUSY, stopped output EAGAIN, and old replies reach it. When the last client closes, these three are
//!   cleared.
//! - Nothing tells the master side of opens and closes. inotify does, but it merges equal notices that follow each
//!   other unread, so a plain count of them is wrong: see `clients.rs`.
//! - Nothing tells it whether a client has first written and then set another speed, or flushed: see `order.rs`.
//! - `tcflush` by a client is known from packet mode only, and the kernel leaves what had already reached the master
//!   side: see `pty.rs`.
//! - All this is to be done at once, however busy the rig is. A thread attends to the port: see `attendant.rs`.
//! - With IXON, XOFF stops the client's *next* write. What it has written before stays readable here: whoever reads
//!   the port must stop by itself too.
//!
//! Like a serial driver, and like a pty: the kernel takes 9 to 18 KB from a client that no one reads (and the port 256
//! bytes more), and about 22 KB for a client that does not read. Speed and flow control outlive the client that has
//! set them, so `stty -F PORT` works. Unlike with a driver, `tcdrain` and `close` return at once, and `TIOCOUTQ` is 0.
//!
//! **What a pty cannot carry**: parity and other frames than 8 data bits (the kernel clears `PARENB`), the modem lines
//! (`TIOCMGET` and `TIOCMSET` fail with ENOTTY: no DTR, RTS, CTS, DSR, DCD) and break (silently lost). Software that
//! needs them needs another attachment: a null-modem module in the kernel, CUSE, or a pair of real adapters.

mod attendant;
mod clients;
mod error;
mod event;
mod link;
mod order;
mod pc;
mod pty;
mod queue;
pub mod rfc2217;
mod tcp;
mod terminal;
#[cfg(test)]
mod tests;

pub use error::PortError;
pub use event::{LineCoding, LineSettings, PortEvent};
pub use link::{LinkPath, default_folder, made_folder};
pub use pc::PcPort;
pub use tcp::TcpPort;
pub use terminal::PtyPort;
