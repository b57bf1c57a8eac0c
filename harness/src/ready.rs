//! File descriptors that tell when they can be read, or written.

use std::io;
use std::os::fd::OwnedFd;

use tokio::io::Interest;
use tokio::io::unix::AsyncFd;

/// Registers a descriptor with the runtime, with read interest only: with write interest, every read at the other end
/// of a socket would wake this one.
///
/// # Errors
/// If the system refuses.
///
/// # Panics
/// Outside a tokio runtime with I/O enabled.
pub(crate) fn readable(fd: impl Into<OwnedFd>) -> io::Result<AsyncFd<OwnedFd>> {
    registered(fd.into(), Interest::READABLE)
}

/// The same with write interest only.
///
/// # Errors
/// If the system refuses.
///
/// # Panics
/// Outside a tokio runtime with I/O enabled.
pub(crate) fn writable(fd: impl Into<OwnedFd>) -> io::Result<AsyncFd<OwnedFd>> {
    registered(fd.into(), Interest::WRITABLE)
}

#[allow(unsafe_code)]
fn registered(fd: OwnedFd, interest: Interest) -> io::Result<AsyncFd<OwnedFd>> {
    // SAFETY: the `AsyncFd` owns the descriptor from here on; an `OwnedFd` is the same open descriptor all its life.
    let registered = unsafe { AsyncFd::register_with_interest(fd, interest) };
    Ok(registered?)
}
