//! Keeps a rig up, with a PC port that anybody's software may open.

mod steering;

use std::io;
use std::time::Duration;

use torno_protocol::board::Stimulus;
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::BITS_PER_CHARACTER;

use crate::fault::{Faults, Looked, Onlooker};
use crate::observe::log;
use crate::pace::{Brake, Lapse, Pace};
use crate::port::{LineSettings, PcPort, PortEvent};
use crate::recorder::{RECORDED, Recorder, RecordingError};
use crate::rig::file::RigFile;
use crate::rig::{Driver, Rig, RigError};
use steering::{Steering, next_call};
use torno_bus::{PcEvent, STOPPED};
use torno_engine::{Fact, Input, Limit, What};
use torno_trace::{Digest, End};

/// So many of the client's bytes wait in the driver at the most. Its settings are read with each helping, so a new
/// speed holds at most this many characters late.
const DRIVER_QUEUE: usize = 16;
/// The driver takes a new helping when no more than this is left.
const DRIVER_LOW: usize = 4;
/// Nor more often than this: above some 40 000 baud a late computer leaves gaps.
const SLICE_MIN: Span = Span::from_millis(1);
/// Boards that nothing reaches are brought up to date this often, so that none has long to catch up when something
/// does.
const KEEP_UP: Span = Span::from_secs(10);
/// While somebody watches, so often in wall time. (Ours: at once, to the eye.)
const WATCHED: Duration = Duration::from_millis(20);
/// So long, in wall time, the rig goes on at once: then whoever wants something of it has a turn.
const AT_ONCE: Duration = Duration::from_millis(20);
/// A rig in which something happens goes so far at once, in virtual time.
const STRIDE: Span = Span::from_secs(1);

/// A rig with an open PC port.
pub struct Live {
    rig: Rig,
    port: PcPort,
    brake: Brake,
    settings: LineSettings,
    /// Bytes that the client has written and that are not yet on the line.
    queued: usize,
    /// Whether the client that has the port open has written.
    began: bool,
    /// The UART has been stopped by `XOFF`.
    held: bool,
    /// How far time has gone.
    reached: Instant,
    /// Every board was brought to here last.
    kept_up: Instant,
    /// When the PC's supply has gone or come, as far as that still lies ahead: what was to be sent by then is lost.
    supply: Vec<Instant>,
    recording: Option<Recording>,
    faults: Faults,
    onlooker: Onlooker,
    /// What a watch has seen has been taken: the engine may have waited for that.
    acted: bool,
    steering: Option<Steering>,
}

struct Recording {
    recorder: Recorder,
    digest: Digest,
}

/// Why a live rig ended.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The rig itself broke.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The PC port, or the timer.
    #[error("the PC port failed")]
    Port(#[from] io::Error),
    /// What happens cannot be recorded any more.
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

impl Live {
    /// Starts the rig behind `port`.
    ///
    /// # Errors
    /// [`LiveError`] if a board cannot be started.
    pub async fn start(file: &RigFile, driver: &Driver, pace: Pace, port: PcPort) -> Result<Self, LiveError> {
        let rig = Rig::start(file, driver, file.uart()).await?;
        let settings = LineSettings { baud: file.pc.baud, ixon: false };
        Ok(Self {
            rig,
            port,
            brake: Brake::new(pace)?,
            settings,
            queued: 0,
            began: false,
            held: false,
            reached: Instant::START,
            kept_up: Instant::START,
            supply: Vec::new(),
            recording: None,
            faults: Faults::default(),
            onlooker: Onlooker::new(file.dialect),
            acted: false,
            steering: None,
        })
    }

    /// Records everything from the start. For a rig that does not run yet.
    pub fn record(&mut self, recorder: Recorder) {
        self.recording = Some(Recording { recorder, digest: Digest::new(self.rig.layout()) });
    }

    /// Ends the recording, if there is one: every board is brought to one instant, so that what is recorded is all that
    /// happened before it.
    ///
    /// # Errors
    /// [`LiveError`] if the rig breaks over it, or the recording cannot be written.
    pub async fn end_recording(&mut self) -> Result<(), LiveError> {
        if self.recording.is_none() {
            return Ok(());
        }
        let until = self.now().max(self.rig.engine().frontier()).max(Instant::START.next());
        loop {
            self.rig.settle(until).await?;
            self.note()?;
            if !core::mem::take(&mut self.acted) {
                break;
            }
        }
        if let Some(Recording { mut recorder, digest, .. }) = self.recording.take() {
            let at = until - Span::from_nanos(1);
            recorder.finish(&End { digest: digest.sum().to_string(), at, outcome: "interrupted".to_owned() })?;
        }
        Ok(())
    }

    /// The rig.
    pub const fn rig(&self) -> &Rig {
        &self.rig
    }

    /// The PC port.
    pub const fn port(&self) -> &PcPort {
        &self.port
    }

    /// Runs until something breaks.
    ///
    /// # Errors
    /// [`LiveError`]: this is the only way in which it ends by itself.
    pub async fn run(&mut self) -> Result<std::convert::Infallible, LiveError> {
        loop {
            let allowed = self.brake.limit();
            let limit = self.slice(allowed).earlier(self.faults.next());
            let arrived = self.go(limit).await?;
            let frontier = self.rig.engine().frontier();
            // At full speed a silence may have held time back.
            let went = frontier >= limit.until;
            self.reached = match arrived {
                true if went || !allowed.until.is_never() => limit.until,
                true => Instant::NEVER,
                false => frontier,
            };
            let now = self.now();
            for (name, since) in self.faults.go_on(&mut self.rig, now) {
                log::begun(&name, since);
            }
            self.lose_supply();
            self.keep_up().await?;
            if arrived {
                self.arrive();
                self.hold_for_silence();
            }
            let took = self.take_waiting()? | self.obey_all().await?;
            if arrived && !took && (limit == allowed || !went) {
                // Where there is nothing to wait for, others must have their turn all the same.
                tokio::task::yield_now().await;
                self.wait().await?;
            } else {
                self.check_pace(self.reached);
                self.write_recording(Duration::ZERO)?;
                tokio::task::yield_now().await;
            }
        }
    }

    /// Lets everything happen before `limit`, or what comes first of it: not for long at once. Says whether it was all.
    async fn go(&mut self, limit: Limit) -> Result<bool, LiveError> {
        let mut lapse = Lapse::begin(AT_ONCE);
        loop {
            while self.rig.step(limit).await? {
                self.deliver()?;
                // Whatever may end this must have its turn, even if all boards are in this process.
                tokio::task::yield_now().await;
                if lapse.is_over(Duration::ZERO) {
                    return Ok(false);
                }
            }
            self.deliver()?;
            // The engine waits for whoever watches; having acted, go on.
            if !core::mem::take(&mut self.acted) {
                return Ok(true);
            }
        }
    }

    /// Brings every board to `until`: everything before that has happened, and has been noted.
    async fn settle(&mut self, until: Instant) -> Result<(), LiveError> {
        loop {
            self.rig.settle(until).await?;
            self.deliver()?;
            if !core::mem::take(&mut self.acted) {
                return Ok(());
            }
        }
    }

    /// Waits for something to do.
    async fn wait(&mut self) -> Result<(), LiveError> {
        let next = self.next_instant();
        let room = self.room();
        self.write_recording(self.brake.wall_until(next))?;
        tokio::select! {
            biased;
            () = self.rig.news() => {}
            passed = self.brake.wait_past(next) => {
                passed?;
                self.check_pace(next);
            }
            event = self.port.event(room) => {
                let now = self.brake.now().unwrap_or(self.now());
                self.take(event?, now)?;
            }
            call = next_call(&mut self.steering) => self.obey(call).await?,
        }
        Ok(())
    }

    /// Lets the recording know that nothing happens for so long.
    fn write_recording(&mut self, wait: Duration) -> Result<(), RecordingError> {
        self.recording.as_mut().map_or(Ok(()), |recording| recording.recorder.before_wait(wait))
    }

    /// How far to go at once: while something happens, no further than [`STRIDE`], as noise has no end; and while the
    /// UART has something to send, no further than to where it can want more after the next thing that happens. So a
    /// stream has no gap, however late this computer looks.
    fn slice(&self, allowed: Limit) -> Limit {
        let engine = self.rig.engine();
        let allowed = if engine.is_quiet() { allowed } else { allowed.earlier(Some(engine.frontier() + STRIDE)) };
        if self.queued == 0 || self.brake.pace() == Pace::Max {
            return allowed;
        }
        let low = BITS_PER_CHARACTER * DRIVER_LOW as u64 * 1_000_000_000 / u64::from(self.settings.baud.max(1));
        let low = Span::from_nanos(low).max(SLICE_MIN);
        let next = engine.next_instant().max(self.reached);
        Limit::until(allowed.until.min(next + low))
    }

    /// How many of the client's bytes the driver takes; the others stay in the kernel.
    const fn room(&self) -> usize {
        if self.queued > DRIVER_LOW { 0 } else { DRIVER_QUEUE - self.queued }
    }

    /// Takes what has come from the client meanwhile. It follows on what came before, if that is not all sent yet.
    fn take_waiting(&mut self) -> Result<bool, LiveError> {
        let mut took = false;
        while let Some(event) = self.port.try_event(self.room())? {
            let at = if self.queued > 0 { self.now() } else { self.brake.now().unwrap_or(self.now()) };
            self.take(event, at)?;
            took = true;
        }
        Ok(took)
    }

    fn hold_for_silence(&mut self) {
        let engine = self.rig.engine();
        self.brake.hold_for_silence(engine.silence(), engine.frontier());
    }

    fn check_pace(&mut self, due: Instant) {
        if let Some(behind) = self.brake.reached(due) {
            log::behind(due, behind);
        }
    }

    fn next_instant(&self) -> Instant {
        let next = self.rig.engine().next_instant();
        let next = self.faults.next().map_or(next, |worse| worse.min(next));
        if self.brake.pace() == Pace::Max { next } else { next.min(self.kept_up + self.keep_up_every()) }
    }

    fn is_watched(&self) -> bool {
        self.steering.as_ref().is_some_and(Steering::is_watched)
    }

    /// How far time may go before boards that nothing reaches are brought up to date. Where it is not held back it goes
    /// so far as there is something to do, and where it stands still, as far as somebody has asked: then at once.
    fn keep_up_every(&self) -> Span {
        let recorded = || self.recording.as_ref().and_then(|_| self.brake.span_of(RECORDED));
        match self.is_watched() {
            true => self.brake.span_of(WATCHED).unwrap_or(Span::from_nanos(1)),
            false => recorded().map_or(KEEP_UP, |span| span.min(KEEP_UP)),
        }
    }

    /// Brings every board to where time is, if that is due, and tells those who watch what has happened before.
    async fn keep_up(&mut self) -> Result<(), LiveError> {
        let now = self.now();
        if now < self.kept_up + self.keep_up_every() {
            return Ok(());
        }
        self.kept_up = now;
        self.settle(now).await?;
        if let Some(steering) = &mut self.steering {
            steering.tell(now);
        }
        Ok(())
    }

    /// Time has come to where it was to stand still, or to go on from.
    fn arrive(&mut self) {
        let now = self.now();
        if let Some(steering) = &mut self.steering {
            steering.arrive(now);
        }
    }

    /// Forgets what waited for the PC's UART when its supply went or came.
    fn lose_supply(&mut self) {
        let now = self.now();
        let before = self.supply.len();
        self.supply.retain(|at| *at >= now);
        if self.supply.len() < before {
            self.queued = 0;
        }
    }

    /// What has happened since the last call, logged and recorded.
    fn note(&mut self) -> Result<Vec<Fact>, RecordingError> {
        for incident in self.rig.take_incidents() {
            log::set_time(incident.at);
            tracing::warn!("{incident}");
        }
        let (inputs, facts) = (self.rig.take_inputs(), self.rig.take_facts());
        for Input { at, what, .. } in &inputs {
            if matches!(what, What::Stimulus { board, stimulus: Stimulus::Power(_) } if *board == self.rig.pc()) {
                self.supply.push(*at);
            }
        }
        facts.iter().for_each(|fact| log::log(&self.rig, fact));
        if let Some(Recording { recorder, digest, .. }) = &mut self.recording {
            facts.iter().for_each(|fact| digest.add(fact));
            recorder.note(&inputs, &facts, self.rig.engine().frontier())?;
        }
        if let Some(steering) = &mut self.steering {
            steering.note(&inputs, &facts);
        }
        let Looked { seen, begun } = self.onlooker.look(&mut self.rig, &mut self.faults, &facts);
        self.acted |= seen;
        begun.iter().for_each(|(name, since)| log::begun(name, *since));
        Ok(facts)
    }

    /// Hands the client what has come for it.
    fn deliver(&mut self) -> Result<(), LiveError> {
        let mut received = Vec::new();
        for fact in self.note()? {
            let event = match fact {
                Fact::Event { node, event, value, .. } if node == self.rig.pc() => PcEvent::from_numbers(event, value),
                Fact::Telemetry { node, signal: STOPPED, value, .. } if node == self.rig.pc() => {
                    self.held = value != 0;
                    None
                }
                _ => None,
            };
            match event {
                Some(PcEvent::Sent(_)) => self.queued = self.queued.saturating_sub(1),
                Some(PcEvent::Received(byte) | PcEvent::Garbled(byte)) => received.push(byte),
                None => {}
            }
        }
        if received.is_empty() {
            return Ok(());
        }
        // A client that has only changed its speed since it last wrote is to be heard at the new one.
        self.configure(self.now())?;
        let lost = self.port.write(&received);
        if lost > 0 {
            tracing::warn!("the program at the PC port does not read: {lost} bytes are lost");
        }
        Ok(())
    }

    /// How far time has gone; what comes from the client follows on that.
    fn now(&self) -> Instant {
        if self.reached.is_never() { self.rig.engine().frontier() } else { self.reached }
    }

    fn take(&mut self, event: PortEvent, at: Instant) -> Result<(), LiveError> {
        log::set_time(at);
        self.began &= !matches!(event, PortEvent::Opened | PortEvent::Closed);
        self.configure(at)?;
        match event {
            PortEvent::Data(bytes) => {
                self.queued += bytes.len();
                self.stimulate(at, Stimulus::Write(bytes));
            }
            PortEvent::Flushed => {
                self.queued = 0;
                self.stimulate(at, Stimulus::Discard);
            }
            PortEvent::Opened => tracing::info!("the PC port has been opened"),
            PortEvent::Began => self.begin(at)?,
            PortEvent::FlowControl => {}
            PortEvent::Closed => tracing::info!("the PC port has been closed"),
        }
        Ok(())
    }

    /// A client writes for the first time. If the one before has left the UART held, neither its hold nor what it could
    /// not send is this one's.
    fn begin(&mut self, at: Instant) -> Result<(), LiveError> {
        self.began = true;
        if core::mem::take(&mut self.held) {
            let left = self.port.forget_leftover() + self.queued;
            if left > 0 {
                tracing::warn!("{left} bytes that the program before could not send are dropped");
            }
            self.queued = 0;
            self.stimulate(at, Stimulus::Discard);
            let LineSettings { baud, .. } = self.settings;
            self.settings.ixon = false;
            self.stimulate(at, Stimulus::Configure { baud, ixon: false });
        }
        self.configure(at)
    }

    /// Sets the UART to what the client has set. What the one before has left is still sent as that one wanted.
    fn configure(&mut self, at: Instant) -> Result<(), LiveError> {
        if self.port.leftover() > 0 || (!self.began && self.queued > 0) {
            return Ok(());
        }
        let settings = self.port.settings()?;
        if settings != self.settings {
            self.settings = settings;
            let LineSettings { baud, ixon } = settings;
            tracing::info!("the program at the PC port sets {baud} baud, XON/XOFF {}", if ixon { "on" } else { "off" });
            self.stimulate(at, Stimulus::Configure { baud, ixon });
        }
        Ok(())
    }

    fn stimulate(&mut self, at: Instant, stimulus: Stimulus) {
        let pc = self.rig.pc();
        self.rig.stimulate(pc, at, stimulus);
    }
}
