//! The rig's side of the control socket.

use std::future::poll_fn;
use std::io;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};
use std::pin::pin;
use std::time::Duration;

use futures_core::Stream;
use rustix::fd::OwnedFd;
use rustix::fs::Mode;
use rustix::net::{AddressFamily, SocketAddrUnix, SocketFlags, SocketType};
use rustix::process::geteuid;
use serde::Serialize;
use serde_json::json;
use tokio::io::AsyncWriteExt;
use tokio::net::{UnixListener, UnixStream};
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;

use super::Request;
use super::backlog::{Rows, backlog};
use super::lines::lines;

/// Clients that have been accepted by the kernel and not by us.
const BACKLOG: i32 = 16;
/// Requests that wait for the rig.
const WAITING: usize = 16;
/// Where no client can be accepted, as for want of a file descriptor, the next attempt is made so much later.
const AGAIN: Duration = Duration::from_millis(100);

/// Why there is no control socket.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// Another rig has it.
    #[error("a rig is already steered at {}: choose another place with --control", path.display())]
    Busy {
        /// The socket.
        path: PathBuf,
    },
    /// Something else is there.
    #[error("{} already exists and is no socket: remove it or choose another place with --control", path.display())]
    Exists {
        /// What is there.
        path: PathBuf,
    },
    /// The system refuses it.
    #[error("cannot make the control socket {}: {cause}; choose another place with --control", path.display())]
    Refused {
        /// The socket.
        path: PathBuf,
        /// What the system said.
        cause: io::Error,
    },
}

/// A request, and where its answer goes.
#[derive(Debug)]
pub struct Call {
    /// What is asked.
    pub request: Request,
    /// Its answer; dropped, it says that the rig has ended.
    pub answer: Answer,
    /// Where lines go that follow on the answer.
    pub rows: Rows,
}

/// The way of an answer to the client.
#[derive(Debug)]
pub struct Answer(oneshot::Sender<String>);

impl Answer {
    /// Answers. That the client has gone is no error.
    pub fn give<T: Serialize, E: std::fmt::Display>(self, result: Result<T, E>) {
        let answer = match result {
            Ok(value) => json!({ "ok": value }),
            Err(error) => json!({ "error": error.to_string() }),
        };
        self.0.send(answer.to_string()).ok();
    }
}

/// The control socket of a rig that runs. Dropped, it is gone.
#[derive(Debug)]
pub struct Control {
    path: PathBuf,
    calls: mpsc::Receiver<Call>,
    accepting: JoinHandle<()>,
}

impl Control {
    /// Opens the socket for the current user. One that nobody listens to is replaced.
    ///
    /// # Errors
    /// [`ControlError`]: what to do.
    ///
    /// # Panics
    /// Outside a tokio runtime with I/O enabled.
    pub fn open(path: &Path) -> Result<Self, ControlError> {
        let refused = |cause: io::Error| ControlError::Refused { path: path.to_owned(), cause };
        // Absolute, so that it is still found when it is to be removed.
        let path = std::path::absolute(path).map_err(refused)?;
        if let Ok(there) = std::fs::symlink_metadata(&path) {
            if !there.file_type().is_socket() {
                return Err(ControlError::Exists { path });
            }
            if std::os::unix::net::UnixStream::connect(&path).is_ok() {
                return Err(ControlError::Busy { path });
            }
            std::fs::remove_file(&path).map_err(refused)?;
        }
        let socket = std::os::unix::net::UnixListener::from(bound(&path).map_err(refused)?);
        let listener = UnixListener::from_std(socket).map_err(refused)?;
        let (sender, calls) = mpsc::channel(WAITING);
        Ok(Self { path, calls, accepting: tokio::spawn(accept(listener, sender)) })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Waits for the next request. Cancel-safe.
    pub async fn call(&mut self) -> Call {
        match self.calls.recv().await {
            Some(call) => call,
            // It cannot end before we do.
            None => std::future::pending().await,
        }
    }

    /// A request that has come.
    pub fn try_call(&mut self) -> Option<Call> {
        self.calls.try_recv().ok()
    }
}

impl Drop for Control {
    fn drop(&mut self) {
        self.accepting.abort();
        // Nobody is left to tell if this fails; the next rig replaces a socket that nobody listens to.
        std::fs::remove_file(&self.path).ok();
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

async fn accept(listener: UnixListener, calls: mpsc::Sender<Call>) {
    let mut failing = false;
    loop {
        let accepted = listener.accept().await;
        let failed = core::mem::replace(&mut failing, accepted.is_err());
        match accepted {
            Ok((stream, _)) if is_ours(&stream) => {
                let calls = calls.clone();
                tokio::spawn(async move {
                    if let Err(error) = serve(stream, calls).await {
                        tracing::debug!(%error, "a client of the control socket is lost");
                    }
                });
            }
            Ok(_) => tracing::warn!("another user at the control socket is turned away"),
            Err(error) => {
                if !failed {
                    tracing::warn!(%error, "nobody new can steer the rig for now");
                }
                tokio::time::sleep(AGAIN).await;
            }
        }
    }
}

fn is_ours(stream: &UnixStream) -> bool {
    let ours = geteuid().as_raw();
    stream.peer_cred().is_ok_and(|peer| peer.uid() == ours || peer.uid() == 0)
}

async fn serve(stream: UnixStream, calls: mpsc::Sender<Call>) -> io::Result<()> {
    let (reading, mut writing) = stream.into_split();
    let mut lines = pin!(lines(reading));
    let (rows, mut to_tell) = backlog();
    loop {
        let line = tokio::select! {
            line = poll_fn(|context| lines.as_mut().poll_next(context)) => line,
            rows = to_tell.next() => {
                writing.write_all(rows.as_bytes()).await?;
                continue;
            }
        };
        let Some(line) = line.transpose()? else { return Ok(()) };
        if line.as_ref().is_ok_and(|line| line.trim().is_empty()) {
            continue;
        }
        let refused = |why: String| json!({ "error": why }).to_string();
        let request = line.map_err(|bad| bad.to_string()).and_then(|line| {
            serde_json::from_str::<Request>(&line).map_err(|error| format!("expected a request: {error}"))
        });
        let answer = match request {
            Ok(request) => {
                let watches = matches!(request, Request::Watch { .. });
                let (answer, mut answered) = oneshot::channel();
                let call = Call { request, answer: Answer(answer), rows: rows.clone() };
                if calls.send(call).await.is_err() {
                    return Ok(());
                }
                let answered = loop {
                    tokio::select! {
                        biased;
                        // What has happened before the answer comes before it; a watch begins with its answer.
                        rows = to_tell.next(), if !watches => writing.write_all(rows.as_bytes()).await?,
                        answered = &mut answered => break answered,
                    }
                };
                answered.unwrap_or_else(|_| refused("the rig has ended".to_owned()))
            }
            Err(why) => refused(why),
        };
        writing.write_all((answer + "\n").as_bytes()).await?;
    }
}
