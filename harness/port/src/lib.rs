//! The PC's serial port, as PC software reaches it, and by what: a [`Transport`]. The ports themselves need Linux.

mod transport;

#[cfg(target_os = "linux")]
mod linux;

#[cfg(target_os = "linux")]
pub use linux::*;
pub use transport::{Transport, TransportError};
