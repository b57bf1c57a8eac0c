//! Unix sockets that serve only the user who runs the rig.

use std::io;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::fd::OwnedFd;
use rustix::fs::{Mode, OFlags, Stat};
use rustix::net::{AddressFamily, SocketAddrUnix, SocketFlags, SocketType};
use rustix::process::geteuid;
use tokio::net::{UnixListener, UnixStream};

/// Clients that have been accepted by the kernel and not by us.
const BACKLOG: i32 = 16;
/// Where no client can be accepted, as for want of a file descriptor, the next attempt is made so much later.
const AGAIN: Duration = Duration::from_millis(100);

/// Why there is no socket.
#[derive(Debug, thiserror::Error)]
pub enum SocketError {
    /// Another rig has it.
    #[error("{busy} at {}: choose another place with {option}", path.display())]
    Busy {
        /// The socket.
        path: PathBuf,
        /// What another rig does there.
        busy: &'static str,
        /// The option that sets the path.
        option: &'static str,
    },
    /// Something else is there.
    #[error("{} already exists and is no socket: remove it or choose another place with {option}", path.display())]
    Exists {
        /// What is there.
        path: PathBuf,
        /// The option that sets the path.
        option: &'static str,
    },
    /// The system refuses it.
    #[error("cannot make the socket {}: {cause}; choose another place with {option}", path.display())]
    Refused {
        /// The socket.
        path: PathBuf,
        /// What the system said.
        cause: io::Error,
        /// The option that sets the path.
        option: &'static str,
    },
}

/// What a socket is for, in the messages about it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Purpose {
    /// What a rig does that has it.
    pub(crate) busy: &'static str,
    /// The option that sets the path.
    pub(crate) option: &'static str,
    /// What cannot be done where no client can be accepted.
    pub(crate) failing: &'static str,
}

/// A listening socket with mode 0600. Dropped, it is gone.
#[derive(Debug)]
pub(crate) struct OwnSocket {
    path: PathBuf,
    /// The file that it is, held so that no other one is taken for it: another one may be there by the end.
    file: OwnedFd,
    listener: UnixListener,
    purpose: Purpose,
}

impl OwnSocket {
    /// Opens the socket for the current user. One that no one listens to is replaced.
    ///
    /// # Errors
    /// [`SocketError`]: what to do.
    ///
    /// # Panics
    /// Outside a tokio runtime with I/O enabled.
    pub(crate) fn open(path: &Path, purpose: Purpose) -> Result<Self, SocketError> {
        let Purpose { busy, option, .. } = purpose;
        let refused = |cause: io::Error| SocketError::Refused { path: path.to_owned(), cause, option };
        // Absolute, so that it is still found when it is to be removed.
        let path = std::path::absolute(path).map_err(refused)?;
        if let Ok(there) = std::fs::symlink_metadata(&path) {
            if !there.file_type().is_socket() {
                return Err(SocketError::Exists { path, option });
            }
            if std::os::unix::net::UnixStream::connect(&path).is_ok() {
                return Err(SocketError::Busy { path, busy, option });
            }
            std::fs::remove_file(&path).map_err(refused)?;
        }
        let socket = std::os::unix::net::UnixListener::from(bound(&path).map_err(refused)?);
        let listener = UnixListener::from_std(socket).map_err(refused)?;
        let file = rustix::fs::open(&path, OFlags::PATH | OFlags::NOFOLLOW | OFlags::CLOEXEC, Mode::empty());
        let file = file.map_err(|error| refused(error.into()))?;
        Ok(Self { path, file, listener, purpose })
    }

    /// Where it is.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Waits for the next client of the same user, or of root. Cancel-safe.
    pub(crate) async fn accept(&self) -> UnixStream {
        let mut failing = false;
        loop {
            let accepted = self.listener.accept().await;
            let failed = core::mem::replace(&mut failing, accepted.is_err());
            match accepted {
                Ok((stream, _)) if is_ours(&stream) => return stream,
                Ok(_) => tracing::warn!("another user at {} is turned away", self.path.display()),
                Err(error) => {
                    if !failed {
                        tracing::warn!(%error, "{}", self.purpose.failing);
                    }
                    tokio::time::sleep(AGAIN).await;
                }
            }
        }
    }
}

impl Drop for OwnSocket {
    fn drop(&mut self) {
        // No one is left to tell if this fails; the next rig replaces a socket that no one listens to.
        let identity = |file: Stat| (file.st_dev, file.st_ino);
        let [ours, found] =
            [rustix::fs::fstat(&self.file), rustix::fs::lstat(&self.path)].map(|file| file.map(identity));
        if ours.is_ok() && ours == found {
            std::fs::remove_file(&self.path).ok();
        }
    }
}

/// A listening socket that has its mode before it has its name.
fn bound(path: &Path) -> io::Result<OwnedFd> {
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let socket = rustix::net::socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None)?;
    rustix::fs::fchmod(&socket, Mode::RUSR | Mode::WUSR)?;
    rustix::net::bind(&socket, &SocketAddrUnix::new(path)?)?;
    rustix::net::listen(&socket, BACKLOG)?;
    Ok(socket)
}

fn is_ours(stream: &UnixStream) -> bool {
    let ours = geteuid().as_raw();
    stream.peer_cred().is_ok_and(|peer| peer.uid() == ours || peer.uid() == 0)
}
