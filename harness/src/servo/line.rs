//! The serial line to the controller: of a rig, in virtual time, or of this computer.

use std::collections::VecDeque;
use std::io;
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio_serial::{ClearBuffer, SerialPort, SerialStream};
use torno_engine::Fact;
use torno_protocol::board::Stimulus;
use torno_protocol::servo::{BAUD, CHARACTER};
use torno_protocol::time::{Instant, Span};

use crate::pace::Pace;
use crate::rig::Driver;
use crate::rig::file::RigFile;
use crate::send::{SendError, open_port};
use crate::session::{Ended, Exchange, Happened, Session, SessionError};

/// Virtual time goes no further at once while an answer is awaited.
const SLICE: Span = Span::from_millis(20);
/// The PC begins so long after the rig has started: a receiver wants to see an idle line first.
const BEGIN: Span = Span::from_millis(10);
/// Bytes that are handed to a serial port at once, so that progress can be told.
const PORTION: usize = 64;
/// A serial port that takes nothing for so long will not. (Ours.)
const STUCK: Duration = Duration::from_secs(1);
/// How far a serial port's driver may be ahead of its line.
const AHEAD: Duration = Duration::from_millis(40);

/// Why nothing goes over the line.
#[derive(Debug, thiserror::Error)]
pub enum LineError {
    /// The serial port.
    #[error(transparent)]
    Serial(#[from] SendError),
    /// The rig broke, or what happens in it cannot be recorded any more.
    #[error(transparent)]
    Session(#[from] SessionError),
}

/// A serial line as seen from the PC.
pub trait ServoLine {
    /// Sends bytes, and reports each part that has gone; returns when all are on the line.
    fn send(&mut self, bytes: &[u8], gone: impl FnMut(usize)) -> impl Future<Output = Result<(), LineError>>;

    /// What has come; if nothing has, waits for it, but no longer than `patience`. Empty: nothing came.
    fn receive(&mut self, patience: Duration) -> impl Future<Output = Result<Vec<u8>, LineError>>;

    /// Lets time pass.
    fn rest(&mut self, time: Duration) -> impl Future<Output = Result<(), LineError>>;

    /// Where it goes, for people.
    fn name(&self) -> &str;
}

/// The line of a rig, in virtual time.
pub struct RigLine {
    session: Session,
    name: String,
    now: Instant,
    /// Bytes of the PC that are not on the line yet.
    queued: usize,
    received: VecDeque<u8>,
    /// The quantities of the boards, as telemetry has told them: board, quantity, value.
    watcher: Option<Watcher>,
}

/// Hears of every value that a board tells: when, the board, the quantity, the value.
pub type Watcher = Box<dyn FnMut(Instant, &str, &str, i64)>;

impl RigLine {
    /// Starts a rig that goes as fast as it can.
    ///
    /// # Errors
    /// [`LineError::Session`].
    pub async fn start(file: &RigFile, driver: &Driver) -> Result<Self, LineError> {
        let session = Session::start(file, driver, file.pc.uart()).await?;
        session.rig().share_one_processor();
        Ok(Self {
            name: format!("the rig '{}'", file.name),
            now: Instant::START + BEGIN,
            queued: 0,
            received: VecDeque::new(),
            watcher: None,
            session,
        })
    }

    /// Holds time back to this pace from now on.
    ///
    /// # Errors
    /// [`LineError::Session`] if the system refuses a timer.
    pub fn set_pace(&mut self, pace: Pace) -> Result<(), LineError> {
        Ok(self.session.set_pace(pace, self.now).map_err(SessionError::from)?)
    }

    /// Brings every board to one instant and ends what is recorded there, with the word for how it ended.
    ///
    /// # Errors
    /// [`LineError`] if the rig breaks over it, or the recording cannot be written.
    pub async fn end(self, outcome: &str) -> Result<Ended, LineError> {
        let until = self.now.max(self.session.rig().engine().frontier());
        Ok(self.session.finish(until, outcome, |_| ()).await?)
    }

    /// Tells `watcher` every value from now on.
    pub fn watch(&mut self, watcher: Watcher) {
        self.watcher = Some(watcher);
    }

    /// The session, for whoever records or breaks it.
    pub const fn session(&mut self) -> &mut Session {
        &mut self.session
    }

    /// How far virtual time has gone.
    pub const fn now(&self) -> Instant {
        self.now
    }

    async fn advance(&mut self, until: Instant) -> Result<(), LineError> {
        loop {
            let limit = self.session.allowed().earlier(Some(until));
            loop {
                let happened = self.session.step(limit).await?;
                self.note(&happened);
                if !happened.more {
                    break;
                }
            }
            if limit.until >= until {
                break;
            }
            let next = self.session.rig().engine().next_instant().min(until);
            self.session.wait(next).await?;
        }
        self.now = until;
        // Whatever may end this must have its turn.
        tokio::task::yield_now().await;
        Ok(())
    }

    fn note(&mut self, happened: &Happened) {
        for (_, exchange) in happened.pc() {
            match exchange {
                Exchange::Sent(..) => self.queued = self.queued.saturating_sub(1),
                Exchange::Received(byte, _) | Exchange::Garbled(byte) => self.received.push_back(*byte),
            }
        }
        let Some(watcher) = &mut self.watcher else { return };
        for fact in &happened.facts {
            if let Fact::Telemetry { node, at, signal, value } = fact {
                let node = &self.session.rig().nodes()[*node];
                let quantity = node.description.signals.get(usize::from(*signal)).map_or("?", |s| s.name.as_str());
                watcher(*at, &node.name, quantity, *value);
            }
        }
    }
}

impl ServoLine for RigLine {
    async fn send(&mut self, bytes: &[u8], mut gone: impl FnMut(usize)) -> Result<(), LineError> {
        self.queued += bytes.len();
        let pc = self.session.rig().pc();
        self.session.stimulate(pc, self.now, Stimulus::Write(bytes.to_vec()));
        let mut left = self.queued;
        while self.queued > 0 {
            self.advance(self.now + CHARACTER.times(self.queued.min(PORTION) as u64)).await?;
            gone(left - self.queued);
            left = self.queued;
        }
        // The last one is on the line for a character's time.
        self.advance(self.now + CHARACTER).await
    }

    async fn receive(&mut self, patience: Duration) -> Result<Vec<u8>, LineError> {
        let deadline = self.now + span(patience);
        while self.received.is_empty() && self.now < deadline {
            self.advance(deadline.min(self.now + SLICE)).await?;
        }
        Ok(self.received.drain(..).collect())
    }

    async fn rest(&mut self, time: Duration) -> Result<(), LineError> {
        self.advance(self.now + span(time)).await
    }

    fn name(&self) -> &str {
        &self.name
    }
}

fn span(time: Duration) -> Span {
    Span::from_nanos(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX))
}

/// A serial port of this computer.
#[derive(Debug)]
pub struct SerialDevice {
    port: SerialStream,
    name: String,
    /// When the line will have sent all that it has been given.
    free_at: tokio::time::Instant,
}

impl SerialDevice {
    /// Opens a port, at the controller's speed. It is released when this is dropped.
    ///
    /// # Errors
    /// As [`open_port`].
    pub fn open(port: &str) -> Result<Self, LineError> {
        let name = port.to_owned();
        let port = open_port(port, BAUD)?;
        port.clear(ClearBuffer::Input).map_err(|source| SendError::Open { port: name.clone(), source })?;
        Ok(Self { port, name, free_at: tokio::time::Instant::now() })
    }

    fn failed(&self, source: io::Error) -> LineError {
        SendError::Port { port: self.name.clone(), source }.into()
    }
}

impl ServoLine for SerialDevice {
    async fn send(&mut self, bytes: &[u8], mut gone: impl FnMut(usize)) -> Result<(), LineError> {
        self.free_at = self.free_at.max(tokio::time::Instant::now());
        for portion in bytes.chunks(PORTION) {
            let written = tokio::time::timeout(STUCK, self.port.write_all(portion)).await;
            let written = written.unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into()));
            written.map_err(|error| self.failed(error))?;
            self.free_at += Duration::from_nanos(CHARACTER.as_nanos()) * portion.len() as u32;
            tokio::time::sleep_until(self.free_at - AHEAD).await;
            gone(portion.len());
        }
        tokio::time::sleep_until(self.free_at).await;
        Ok(())
    }

    async fn receive(&mut self, patience: Duration) -> Result<Vec<u8>, LineError> {
        let mut bytes = [0; 256];
        match tokio::time::timeout(patience, self.port.read(&mut bytes)).await {
            Err(_) => Ok(Vec::new()),
            Ok(Ok(0)) => Err(self.failed(io::ErrorKind::UnexpectedEof.into())),
            Ok(Ok(n)) => Ok(bytes[..n].to_vec()),
            Ok(Err(error)) => Err(self.failed(error)),
        }
    }

    async fn rest(&mut self, time: Duration) -> Result<(), LineError> {
        tokio::time::sleep(time).await;
        Ok(())
    }

    fn name(&self) -> &str {
        &self.name
    }
}
