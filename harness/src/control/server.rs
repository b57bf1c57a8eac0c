//! The rig's side of the control socket.

use std::future::poll_fn;
use std::io;
use std::path::{Path, PathBuf};
use std::pin::pin;

use futures_core::Stream;
use serde::Serialize;
use serde_json::json;
use tokio::io::AsyncWriteExt;
use tokio::net::UnixStream;
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;

use super::Request;
use super::backlog::{Rows, backlog};
use super::lines::lines;
use crate::socket::{OwnSocket, Purpose, SocketError};

/// Requests that wait for the rig.
const WAITING: usize = 16;
/// What the socket is for.
const STEERING: Purpose =
    Purpose { busy: "a rig is already steered", option: "--control", failing: "nobody new can steer the rig for now" };

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
    /// [`SocketError`]: what to do.
    ///
    /// # Panics
    /// Outside a tokio runtime with I/O enabled.
    pub fn open(path: &Path) -> Result<Self, SocketError> {
        let socket = OwnSocket::open(path, STEERING)?;
        let path = socket.path().to_owned();
        let (sender, calls) = mpsc::channel(WAITING);
        Ok(Self { path, calls, accepting: tokio::spawn(accept(socket, sender)) })
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
    }
}

async fn accept(socket: OwnSocket, calls: mpsc::Sender<Call>) {
    loop {
        let stream = socket.accept().await;
        let calls = calls.clone();
        tokio::spawn(async move {
            if let Err(error) = serve(stream, calls).await {
                tracing::debug!(%error, "a client of the control socket is lost");
            }
        });
    }
}

async fn serve(stream: UnixStream, calls: mpsc::Sender<Call>) -> io::Result<()> {
    let (reading, mut writing) = stream.into_split();
    let mut lines = pin!(lines(reading));
    let (rows, mut to_tell) = backlog();
    loop {
        let line = tokio::select! {
            line = poll_fn(|context| lines.as_mut().poll_next(context)) => line,
            rows = to_tell.next() => {
                writing.write_all(&rows).await?;
                continue;
            }
        };
        let Some(line) = line.transpose()? else { return Ok(()) };
        let refused = |why: String| json!({ "error": why }).to_string();
        let request = line.map_err(|bad| bad.to_string()).and_then(|line| {
            if line.trim().is_empty() {
                return Err("expected a request, found an empty line".to_owned());
            }
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
                        rows = to_tell.next(), if !watches => writing.write_all(&rows).await?,
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
