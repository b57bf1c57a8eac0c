//! The serial line to the controller: of a rig, in virtual time, or of this computer.

use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio_serial::{ClearBuffer, SerialPort, SerialPortBuilderExt, SerialStream};
use torno_protocol::board::Stimulus;
use torno_protocol::servo::{BAUD, CHARACTER};
use torno_protocol::time::{Instant, Span};

use crate::observe::{Telemetry, log};
use crate::pace::{Brake, Pace};
use crate::recorder::{Recorder, RecordingError};
use crate::rig::file::RigFile;
use crate::rig::{Driver, Node, Rig, RigError};
use crate::send::SendError;
use torno_bus::{PcEvent, PcUart};
use torno_engine::{Fact, Limit};
use torno_trace::{Digest, End, Header, Trace};

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
    /// The rig broke.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// What happens in the rig cannot be recorded any more.
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

/// A serial line as seen from the PC.
pub trait Line {
    /// Sends bytes, and tells of each part that has gone; returns when all are on the line.
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
    rig: Rig,
    name: String,
    now: Instant,
    brake: Brake,
    digest: Digest,
    telemetry: Telemetry,
    recorder: Option<Recorder>,
    trace: Option<Trace>,
    /// Bytes of the PC that are not on the line yet.
    queued: usize,
    received: VecDeque<u8>,
    /// The quantities of the boards, as telemetry has told them: board, quantity, value.
    watcher: Option<Watcher>,
}

/// Hears of every value that a board tells: when, the board, the quantity, the value.
pub type Watcher = Box<dyn FnMut(Instant, &str, &str, i64)>;

/// What is left of a rig at whose line nobody is any more.
#[derive(Clone, Debug)]
pub struct Left {
    /// The digest of everything that happened, when it ended, and how.
    pub end: End,
    /// The boards: name, process (its own or this one), last value of each quantity.
    pub boards: Vec<(String, u32, BTreeMap<String, i64>)>,
    /// Everything that happened, if it was to be kept.
    pub trace: Option<Trace>,
}

impl RigLine {
    /// Starts a rig that goes as fast as it can.
    ///
    /// # Errors
    /// [`LineError::Rig`].
    pub async fn start(file: &RigFile, driver: &Driver) -> Result<Self, LineError> {
        let uart = PcUart::new(file.pc.baud, file.pc.tx_fifo, file.pc.clock);
        let rig = Rig::start(file, driver, uart).await?;
        rig.share_one_processor();
        Ok(Self {
            name: format!("the rig '{}'", file.name),
            now: Instant::START + BEGIN,
            brake: Brake::new(Pace::Max).map_err(RigError::from)?,
            digest: Digest::new(rig.layout()),
            telemetry: Telemetry::new(&rig),
            recorder: None,
            trace: None,
            queued: 0,
            received: VecDeque::new(),
            watcher: None,
            rig,
        })
    }

    /// Records everything from the start. For a rig that does not run yet.
    pub fn record(&mut self, recorder: Recorder) {
        self.recorder = Some(recorder);
    }

    /// Keeps everything from the start. For a rig that does not run yet.
    pub fn keep(&mut self, header: Header) {
        self.trace = Some(Trace::new(header));
    }

    /// Holds time back to this pace from now on.
    pub fn set_pace(&mut self, pace: Pace) {
        self.brake.set_pace(pace, self.now);
    }

    /// Brings every board to one instant and ends what is recorded there, with the word for how it ended.
    ///
    /// # Errors
    /// [`LineError`] if the rig breaks over it, or the recording cannot be written.
    pub async fn end(mut self, outcome: &str) -> Result<Left, LineError> {
        let until = self.now.max(self.rig.engine().frontier());
        self.rig.settle(until).await?;
        self.note()?;
        let at = until - Span::from_nanos(1);
        let end = End { digest: self.digest.sum().to_string(), at, outcome: outcome.to_owned() };
        if let Some(recorder) = &mut self.recorder {
            recorder.finish(&end)?;
        }
        if let Some(trace) = &mut self.trace {
            (trace.settled, trace.end) = (until, Some(end.clone()));
        }
        let boards = self.rig.nodes().iter().enumerate().filter(|(id, _)| *id != self.rig.pc());
        let board = |(id, node): (usize, &Node)| {
            (node.name.clone(), node.pid.unwrap_or_else(std::process::id), self.telemetry.of(id))
        };
        Ok(Left { end, boards: boards.map(board).collect(), trace: self.trace })
    }

    /// Tells `watcher` every value from now on.
    pub fn watch(&mut self, watcher: Watcher) {
        self.watcher = Some(watcher);
    }

    /// The rig, for whoever breaks it.
    pub const fn rig(&mut self) -> &mut Rig {
        &mut self.rig
    }

    /// How far virtual time has gone.
    pub const fn now(&self) -> Instant {
        self.now
    }

    async fn advance(&mut self, until: Instant) -> Result<(), LineError> {
        loop {
            let at_once = Limit::until(until);
            let limit = if self.brake.pace() == Pace::Max { at_once } else { self.brake.limit().earlier(Some(until)) };
            while self.rig.step(limit).await? {
                self.note()?;
            }
            self.note()?;
            if limit.until >= until {
                break;
            }
            let next = self.rig.engine().next_instant().min(until);
            if let Some(recorder) = &mut self.recorder {
                recorder.before_wait(self.brake.wall_until(next))?;
            }
            tokio::select! {
                () = self.rig.news() => {}
                passed = self.brake.wait_past(next) => {
                    passed.map_err(RigError::from)?;
                    if let Some(by) = self.brake.reached(next) {
                        log::behind(next, by);
                    }
                }
            }
        }
        self.now = until;
        // Whatever may end this must have its turn.
        tokio::task::yield_now().await;
        Ok(())
    }

    fn note(&mut self) -> Result<(), LineError> {
        for incident in self.rig.take_incidents() {
            log::set_time(incident.at);
            tracing::warn!("{incident}");
        }
        let (inputs, facts) = (self.rig.take_inputs(), self.rig.take_facts());
        if let Some(recorder) = &mut self.recorder {
            recorder.note(&inputs, &facts, self.rig.engine().frontier())?;
        }
        if let Some(trace) = &mut self.trace {
            trace.inputs.extend_from_slice(&inputs);
            trace.facts.extend_from_slice(&facts);
        }
        for fact in &facts {
            log::log(&self.rig, fact);
            self.digest.add(fact);
            self.telemetry.add(fact);
            match *fact {
                Fact::Event { node, event, value, .. } if node == self.rig.pc() => {
                    match PcEvent::from_numbers(event, value) {
                        Some(PcEvent::Sent(_)) => self.queued = self.queued.saturating_sub(1),
                        Some(PcEvent::Received(byte) | PcEvent::Garbled(byte)) => self.received.push_back(byte),
                        None => {}
                    }
                }
                Fact::Telemetry { node, at, signal, value } => {
                    if let Some(watcher) = &mut self.watcher {
                        let node = &self.rig.nodes()[node];
                        let quantity = &node.description.signals[usize::from(signal)].name;
                        watcher(at, &node.name, quantity, value);
                    }
                }
                Fact::Event { .. } | Fact::Edges { .. } => {}
            }
        }
        Ok(())
    }
}

impl Line for RigLine {
    async fn send(&mut self, bytes: &[u8], mut gone: impl FnMut(usize)) -> Result<(), LineError> {
        self.queued += bytes.len();
        let pc = self.rig.pc();
        self.rig.stimulate(pc, self.now, Stimulus::Write(bytes.to_vec()));
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
pub struct SerialLine {
    port: SerialStream,
    name: String,
    /// When the line will have sent all that it has been given.
    free_at: tokio::time::Instant,
}

impl SerialLine {
    /// Opens a port, at the controller's speed. It is released when this is dropped.
    ///
    /// # Errors
    /// [`SendError::Open`].
    pub fn open(port: &str) -> Result<Self, LineError> {
        let name = port.to_owned();
        let open = tokio_serial::new(port, BAUD).open_native_async();
        let open = open.and_then(|stream| stream.clear(ClearBuffer::Input).map(|()| stream));
        let port = open.map_err(|source| SendError::Open { port: name.clone(), source })?;
        Ok(Self { port, name, free_at: tokio::time::Instant::now() })
    }

    fn failed(&self, source: io::Error) -> LineError {
        SendError::Port { port: self.name.clone(), source }.into()
    }
}

impl Line for SerialLine {
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
