//! The rig's side of the control socket.

use std::future::poll_fn;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::pin::pin;
use std::sync::{Arc, OnceLock};

use bytes::Bytes;
use futures_core::Stream;
use serde::Serialize;
use serde_json::json;
use tokio::io::AsyncWriteExt;
use tokio::net::UnixStream;
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;

use super::backlog::{ROOM, Rows, backlog, lost};
use super::lines::{LINE_MAX, lines};
use super::{File, PartState, Request, State};
use crate::saving::Saved;
use crate::socket::{OwnSocket, Purpose, SocketError};

/// What is answered when no one answers.
const ENDED: &str = "the rig has ended";
/// So many bytes of a file are sent at once.
const PIECE: usize = 64 << 10;
/// Requests that wait for the rig.
const WAITING: usize = 16;
/// What the socket is for.
const STEERING: Purpose =
    Purpose { busy: "a rig is already steered", option: "--control", failing: "no one new can steer the rig for now" };

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
pub struct Answer(oneshot::Sender<Reply>);

/// What is answered.
#[derive(Debug)]
pub struct Reply {
    /// A line of JSON, without its end.
    pub line: String,
    /// The file whose bytes follow on it.
    pub file: Option<Saved>,
}

impl Answer {
    /// Answers. That the client has gone is no error.
    pub fn give<T: Serialize>(self, result: Result<T, String>) {
        let answer = match result {
            Ok(value) => done(&value),
            Err(why) => refused(&why),
        };
        self.0.send(Reply { line: answer, file: None }).ok();
    }

    /// Answers with a file, of what happened before this instant.
    pub fn hand(self, ns: u64, file: Saved) {
        let about = File { ns, name: file.name.clone(), bytes: file.bytes };
        self.0.send(Reply { line: done(&about), file: Some(file) }).ok();
    }
}

impl Reply {
    fn refused(why: &str) -> Self {
        Self { line: refused(why), file: None }
    }
}

/// The bytes of a file, as fast as they are taken; fewer than there are, if it cannot be read on.
pub(crate) fn pieces(saved: Saved) -> mpsc::Receiver<Bytes> {
    let (sender, pieces) = mpsc::channel(1);
    std::thread::spawn(move || {
        let mut file = saved.file.take(saved.bytes);
        let mut piece = vec![0; PIECE];
        while let Ok(read @ 1..) = file.read(&mut piece) {
            if sender.blocking_send(Bytes::copy_from_slice(&piece[..read])).is_err() {
                return;
            }
        }
    });
    pieces
}

/// By what a rig that runs is asked. Dropped, it is gone.
#[derive(Debug)]
pub struct Control {
    calls: mpsc::Receiver<Call>,
    asker: Asker,
    socket: Option<Socket>,
}

#[derive(Debug)]
struct Socket {
    path: PathBuf,
    accepting: JoinHandle<()>,
}

/// Whatever carries requests to the rig.
#[derive(Clone, Debug)]
pub struct Asker {
    calls: mpsc::Sender<Call>,
    ending: Arc<OnceLock<Ending>>,
}

/// How a rig was at its end: answers as they would have been given.
#[derive(Debug)]
pub struct Ending {
    /// To [`Request::State`].
    pub state: String,
    /// To [`Request::Part`], if a part was cut.
    pub part: Option<String>,
}

impl Asker {
    /// Asks for something; rows that follow on the answer go to `rows`. None, if the rig has ended.
    async fn begin(&self, request: Request, rows: &Rows) -> Option<oneshot::Receiver<Reply>> {
        let (answer, answered) = oneshot::channel();
        let call = Call { request, answer: Answer(answer), rows: rows.clone() };
        self.calls.send(call).await.ok().map(|()| answered)
    }

    /// Waits until the rig has ended. Cancel-safe.
    pub async fn ended(&self) {
        self.calls.closed().await;
    }

    /// Whether the rig has ended.
    pub fn is_over(&self) -> bool {
        self.calls.is_closed()
    }

    /// How the rig was at its end, if it has come to that.
    pub fn ending(&self) -> Option<&Ending> {
        self.ending.get()
    }

    /// Asks for something, and waits for the answer.
    async fn reply(&self, request: Request, rows: &Rows) -> Reply {
        match self.begin(request, rows).await {
            Some(answered) => answered.await.unwrap_or_else(|_| Reply::refused(ENDED)),
            None => Reply::refused(ENDED),
        }
    }

    /// Asks for something that no file follows on, and waits for the answer: a line of JSON, without its end.
    pub async fn ask(&self, request: Request, rows: &Rows) -> String {
        self.reply(request, rows).await.line
    }

    /// The same for a line of JSON, which need not be a request.
    pub async fn ask_line(&self, line: &str, rows: &Rows) -> Reply {
        match request(line) {
            Ok(request) => self.reply(request, rows).await,
            Err(why) => Reply::refused(&why),
        }
    }
}

impl Control {
    /// Opens the socket for the current user. One that no one listens to is replaced.
    ///
    /// # Errors
    /// [`SocketError`]: what to do.
    ///
    /// # Panics
    /// Outside a tokio runtime with I/O enabled.
    pub fn open(path: &Path) -> Result<Self, SocketError> {
        let socket = OwnSocket::open(path, STEERING)?;
        let path = socket.path().to_owned();
        let control = Self::within();
        let accepting = tokio::spawn(accept(socket, control.asker()));
        Ok(Self { socket: Some(Socket { path, accepting }), ..control })
    }

    /// One that nobody outside this program can reach.
    pub fn within() -> Self {
        let (sender, calls) = mpsc::channel(WAITING);
        Self { calls, asker: Asker { calls: sender, ending: Arc::default() }, socket: None }
    }

    /// Where its socket is, if it has one.
    pub fn path(&self) -> Option<&Path> {
        self.socket.as_ref().map(|socket| socket.path.as_path())
    }

    /// The rig has ended: this is how it was.
    pub fn end(&self, state: &State, part: Option<&PartState>) {
        let ending = Ending { state: done(state), part: part.map(|part| done(&part)) };
        self.asker.ending.set(ending).ok();
    }

    /// Another way to ask.
    pub fn asker(&self) -> Asker {
        self.asker.clone()
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

impl Drop for Socket {
    fn drop(&mut self) {
        self.accepting.abort();
    }
}

async fn accept(socket: OwnSocket, asker: Asker) {
    loop {
        let stream = socket.accept().await;
        let asker = asker.clone();
        tokio::spawn(async move {
            if let Err(error) = serve(stream, asker).await {
                tracing::debug!(%error, "a client of the control socket is lost");
            }
        });
    }
}

/// The request in a line.
fn request(line: &str) -> Result<Request, String> {
    if line.trim().is_empty() {
        return Err("expected a request, found an empty line".to_owned());
    }
    serde_json::from_str(line).map_err(|error| format!("expected a request: {error}"))
}

fn done(what: &impl Serialize) -> String {
    json!({ "ok": what }).to_string()
}

fn refused(why: &str) -> String {
    json!({ "error": why }).to_string()
}

async fn serve(stream: UnixStream, asker: Asker) -> io::Result<()> {
    let (reading, mut writing) = stream.into_split();
    let mut lines = pin!(lines(reading, LINE_MAX));
    let (rows, mut to_tell) = backlog(ROOM, lost);
    loop {
        let line = tokio::select! {
            line = poll_fn(|context| lines.as_mut().poll_next(context)) => line,
            rows = to_tell.next() => {
                writing.write_all(&rows).await?;
                continue;
            }
        };
        let Some(line) = line.transpose()? else { return Ok(()) };
        let request = line.map_err(|bad| bad.to_string()).and_then(|line| request(&line));
        let answer = match request {
            Ok(request) => {
                let watches = matches!(request, Request::Watch { .. });
                let Some(mut answered) = asker.begin(request, &rows).await else { return Ok(()) };
                let answered = loop {
                    tokio::select! {
                        biased;
                        // What has happened before the answer comes before it; a watch begins with its answer.
                        rows = to_tell.next(), if !watches => writing.write_all(&rows).await?,
                        answered = &mut answered => break answered,
                    }
                };
                answered.unwrap_or_else(|_| Reply::refused(ENDED))
            }
            Err(why) => Reply::refused(&why),
        };
        writing.write_all((answer.line + "\n").as_bytes()).await?;
        if let Some(file) = answer.file {
            let mut pieces = pieces(file);
            while let Some(piece) = pieces.recv().await {
                writing.write_all(&piece).await?;
            }
        }
    }
}
