//! Keeps a rig up, with a PC port that anybody's software may open.

mod steering;

use std::time::Duration;

use torno_protocol::board::Stimulus;
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::BITS_PER_CHARACTER;

use crate::observe::log;
use crate::pace::{Brake, Lapse, Pace};
use crate::port::{LineSettings, PcPort, PortEvent};
use crate::recorder::{RECORDED, Recorder, RecordingError};
use crate::rig::file::RigFile;
use crate::rig::{Driver, Rig};
use crate::session::{Exchange, Happened, Session, SessionError};
use steering::{Steering, next_call};
use torno_bus::STOPPED;
use torno_engine::{Fact, Input, Limit, What};

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
    session: Session,
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
    steering: Option<Steering>,
}

impl Live {
    /// Starts the rig behind `port`.
    ///
    /// # Errors
    /// [`SessionError`] if a board cannot be started.
    pub async fn start(file: &RigFile, driver: &Driver, pace: Pace, port: PcPort) -> Result<Self, SessionError> {
        let session = Session::start(file, driver, file.uart()).await?;
        let settings = LineSettings { baud: file.pc.baud, ixon: false };
        Ok(Self {
            session,
            port,
            brake: Brake::new(pace)?,
            settings,
            queued: 0,
            began: false,
            held: false,
            reached: Instant::START,
            kept_up: Instant::START,
            supply: Vec::new(),
            steering: None,
        })
    }

    /// Records everything from the start. For a rig that does not run yet.
    pub fn record(&mut self, recorder: Recorder) {
        self.session.record(recorder);
    }

    /// Ends it, and the recording, if there is one: every board is brought to one instant, so that what is recorded is
    /// all that happened before it. Gives the faults that have broken nothing.
    ///
    /// # Errors
    /// [`SessionError`] if the rig breaks over it, or the recording cannot be written.
    pub async fn end(mut self) -> Result<Vec<String>, SessionError> {
        if self.session.is_recorded() {
            let until = self.now().max(self.session.rig().engine().frontier()).max(Instant::START.next());
            self.session.settle(until, |_| ()).await?;
            let unfired = self.session.unfired();
            self.session.close(until, "interrupted")?;
            return Ok(unfired);
        }
        Ok(self.session.unfired())
    }

    /// The rig.
    pub const fn rig(&self) -> &Rig {
        self.session.rig()
    }

    /// The PC port.
    pub const fn port(&self) -> &PcPort {
        &self.port
    }

    /// Runs until something breaks.
    ///
    /// # Errors
    /// [`SessionError`]: this is the only way in which it ends by itself.
    pub async fn run(&mut self) -> Result<std::convert::Infallible, SessionError> {
        loop {
            let allowed = self.brake.limit();
            let limit = self.slice(allowed).earlier(self.session.faults().0.next());
            let arrived = self.go(limit).await?;
            let frontier = self.rig().engine().frontier();
            // At full speed a silence may have held time back.
            let went = frontier >= limit.until;
            self.reached = match arrived {
                true if went || !allowed.until.is_never() => limit.until,
                true => Instant::NEVER,
                false => frontier,
            };
            self.session.go_on(self.now());
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
    async fn go(&mut self, limit: Limit) -> Result<bool, SessionError> {
        let mut lapse = Lapse::begin(AT_ONCE);
        loop {
            let happened = self.session.step(limit).await?;
            let more = happened.more;
            self.deliver(happened)?;
            if !more {
                return Ok(true);
            }
            // Whatever may end this must have its turn, even if all boards are in this process.
            tokio::task::yield_now().await;
            if lapse.is_over(Duration::ZERO) {
                return Ok(false);
            }
        }
    }

    /// Brings every board to `until`: everything before that has happened, and has been delivered.
    async fn settle(&mut self, until: Instant) -> Result<(), SessionError> {
        let mut all = Vec::new();
        self.session.settle(until, |happened| all.push(happened)).await?;
        all.into_iter().try_for_each(|happened| self.deliver(happened))
    }

    /// Waits for something to do.
    async fn wait(&mut self) -> Result<(), SessionError> {
        let next = self.next_instant();
        let room = self.room();
        self.write_recording(self.brake.wall_until(next))?;
        tokio::select! {
            biased;
            () = self.session.rig_mut().news() => {}
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
        self.session.recorder().map_or(Ok(()), |recorder| recorder.before_wait(wait))
    }

    /// How far to go at once: while something happens, no further than [`STRIDE`], as noise has no end; and while the
    /// UART has something to send, no further than to where it can want more after the next thing that happens. So a
    /// stream has no gap, however late this computer looks.
    fn slice(&self, allowed: Limit) -> Limit {
        let engine = self.session.rig().engine();
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
    fn take_waiting(&mut self) -> Result<bool, SessionError> {
        let mut took = false;
        while let Some(event) = self.port.try_event(self.room())? {
            let at = if self.queued > 0 { self.now() } else { self.brake.now().unwrap_or(self.now()) };
            self.take(event, at)?;
            took = true;
        }
        Ok(took)
    }

    fn hold_for_silence(&mut self) {
        let engine = self.session.rig().engine();
        self.brake.hold_for_silence(engine.silence(), engine.frontier());
    }

    fn check_pace(&mut self, due: Instant) {
        if let Some(behind) = self.brake.reached(due) {
            log::behind(due, behind);
        }
    }

    fn next_instant(&mut self) -> Instant {
        let next = self.session.rig().engine().next_instant();
        let next = self.session.faults().0.next().map_or(next, |worse| worse.min(next));
        if self.brake.pace() == Pace::Max { next } else { next.min(self.kept_up + self.keep_up_every()) }
    }

    fn is_watched(&self) -> bool {
        self.steering.as_ref().is_some_and(Steering::is_watched)
    }

    /// How far time may go before boards that nothing reaches are brought up to date. Where it is not held back it goes
    /// so far as there is something to do, and where it stands still, as far as somebody has asked: then at once.
    fn keep_up_every(&self) -> Span {
        let recorded = || self.session.is_recorded().then(|| self.brake.span_of(RECORDED)).flatten();
        match self.is_watched() {
            true => self.brake.span_of(WATCHED).unwrap_or(Span::from_nanos(1)),
            false => recorded().map_or(KEEP_UP, |span| span.min(KEEP_UP)),
        }
    }

    /// Brings every board to where time is, if that is due, and tells those who watch what has happened before.
    async fn keep_up(&mut self) -> Result<(), SessionError> {
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

    /// Tells those who watch what has happened, and hands the client what has come for it.
    fn deliver(&mut self, happened: Happened) -> Result<(), SessionError> {
        let pc = self.rig().pc();
        for Input { at, what, .. } in &happened.inputs {
            if matches!(what, What::Stimulus { board, stimulus: Stimulus::Power(_) } if *board == pc) {
                self.supply.push(*at);
            }
        }
        if let Some(steering) = &mut self.steering {
            steering.note(&happened.inputs, &happened.facts);
        }
        for fact in &happened.facts {
            if let Fact::Telemetry { node, signal: STOPPED, value, .. } = fact
                && *node == pc
            {
                self.held = *value != 0;
            }
        }
        let mut received = Vec::new();
        for (_, exchange) in &happened.pc {
            match exchange {
                Exchange::Sent(..) => self.queued = self.queued.saturating_sub(1),
                Exchange::Received(byte, _) | Exchange::Garbled(byte) => received.push(*byte),
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
        if self.reached.is_never() { self.session.rig().engine().frontier() } else { self.reached }
    }

    fn take(&mut self, event: PortEvent, at: Instant) -> Result<(), SessionError> {
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
    fn begin(&mut self, at: Instant) -> Result<(), SessionError> {
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
    fn configure(&mut self, at: Instant) -> Result<(), SessionError> {
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
        let pc = self.rig().pc();
        self.session.stimulate(pc, at, stimulus);
    }
}
