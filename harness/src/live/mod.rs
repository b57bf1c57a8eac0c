//! Keeps a rig up, with a PC port that anybody's software may open.

mod gateway;
mod player;
mod steering;
mod tap;
mod unread;

use std::future::{Future, poll_fn};
use std::io;
use std::sync::{Arc, Mutex};
use std::task::Poll;
use std::time::Duration;

use torno_protocol::board::Kept;
use torno_protocol::time::{Instant, Span};

use crate::fault::Unfired;
use crate::observe::log;
use crate::pace::{Brake, Lapse, Pace};
use crate::recorder::{RECORDED, Recorder, RecordingError};
use crate::rig::file::RigFile;
use crate::rig::{Driver, Incident, Rig};
use crate::session::{ENDED, Happened, PC, Session, SessionError};
use crate::spool::Spool;
use crate::steering::{AT_ONCE, KEEP_UP, Scene, Steering, WATCHED, next_call};
use gateway::Gateway;
use player::Player;
use tap::Taps;
use torno_engine::{Limit, LineId, NodeId};
use torno_machines::workpiece::{Part, ToolPath, Turned};
use torno_port::{PcPort, PortEvent};
use torno_trace::{Header, Trace};

/// A rig in which something happens goes so far at once, in virtual time.
const STRIDE: Span = Span::from_secs(1);
/// So far, in virtual time, a rig goes at once even if nothing happens: what a motor has to tell of it takes some
/// milliseconds.
const LEAP: Span = Span::from_secs(100);

/// A rig with an open PC port.
pub struct Live {
    session: Session,
    gateways: Vec<Gateway>,
    taps: Taps,
    /// The gateways at which a program must have been before time begins.
    absent: Vec<usize>,
    brake: Brake,
    /// How far time has gone.
    reached: Instant,
    /// Every board was brought to here last.
    kept_up: Instant,
    steering: Option<Steering>,
    /// Since somebody could have asked for something.
    asked: Lapse,
    /// Boards are asked at the end what they keep without power.
    asks_at_the_end: bool,
    /// What has become of boards' processes.
    incidents: Vec<Incident>,
    /// Something is made of it when it is over.
    is_whole: bool,
    /// What the rig is built of.
    file: Arc<RigFile>,
    /// The last program that was played from here.
    program: Option<Player>,
    /// One program at a time is rehearsed.
    rehearsal: Arc<Mutex<()>>,
    /// The way of the tool, if somebody wants to see the part.
    path: Option<ToolPath>,
}

/// How a session has ended.
#[derive(Debug)]
pub struct Left {
    /// How far time had gone.
    pub end: Instant,
    /// What has become of boards' processes.
    pub incidents: Vec<Incident>,
    /// The faults that have begun, and when.
    pub begun: Vec<(String, Instant)>,
    /// The faults that have broken nothing.
    pub unfired: Vec<Unfired>,
    /// What the boards keep without power that were to be asked.
    pub kept: Vec<Option<Kept>>,
    /// Everything that happened, if it was kept.
    pub trace: Option<Trace>,
    /// What has come of the bar, if it was cut.
    pub turned: Option<Turned>,
}

impl Live {
    /// Starts the rig behind these ports, one for each gateway.
    ///
    /// # Errors
    /// [`SessionError`] if a board cannot be started.
    pub async fn start(file: &RigFile, driver: &Driver, pace: Pace, ports: Vec<PcPort>) -> Result<Self, SessionError> {
        let session = Session::start(file, driver, file.pc.uart()).await?;
        let first = session.rig().pc();
        let places = file.gateways().zip(ports).enumerate();
        Ok(Self {
            gateways: places.map(|(n, (gateway, port))| Gateway::new(n, first + n, gateway, port)).collect(),
            taps: Taps::new(session.rig().layout(), Vec::new()),
            absent: Vec::new(),
            session,
            brake: Brake::new(pace)?,
            reached: Instant::START,
            kept_up: Instant::START,
            steering: None,
            asked: Lapse::begin(AT_ONCE),
            asks_at_the_end: false,
            incidents: Vec::new(),
            is_whole: false,
            file: Arc::new(file.clone()),
            program: None,
            rehearsal: Arc::default(),
            path: None,
        })
    }

    /// Cuts this part while the rig runs. For a rig that does not run yet.
    pub fn turn(&mut self, part: &Part) {
        self.path = Some(ToolPath::new(part));
    }

    /// Keeps everything from the start, under this header. For a rig that does not run yet.
    pub fn keep(&mut self, header: Header) {
        self.session.keep(header);
    }

    /// Keeps everything from the start for whoever asks before the end. For a rig that does not run yet.
    pub fn spool(&mut self, spool: Spool) {
        self.session.spool(spool);
    }

    /// Somebody makes something of what has happened when it is over: every board is brought to the end.
    pub const fn finish_whole(&mut self) {
        self.is_whole = true;
    }

    /// Records everything from the start. For a rig that does not run yet.
    pub fn record(&mut self, recorder: Recorder) {
        self.session.record(recorder);
    }

    /// Asks these boards at the end what they keep without power.
    pub fn ask_at_the_end(&mut self, boards: Vec<NodeId>) {
        self.asks_at_the_end = !boards.is_empty();
        self.session.ask_at_the_end(boards);
    }

    /// Lets time begin when a program has opened each of these gateways, by their places in the rig file. For a rig
    /// that does not run yet.
    pub fn wait_for(&mut self, gateways: Vec<usize>) {
        if !gateways.is_empty() {
            self.absent = gateways;
            self.brake.pause(self.reached);
        }
    }

    /// Time begins if all are there that it waits for.
    fn begin(&mut self) {
        if !self.absent.is_empty() {
            let gateways = &self.gateways;
            self.absent.retain(|place| gateways.get(*place).is_some_and(|gateway| !gateway.was_opened));
            if self.absent.is_empty() {
                self.brake.resume(self.reached);
            }
        }
    }

    /// Passes on what is on these lines, from the start. For a rig that does not run yet.
    pub fn tap(&mut self, taps: Vec<(LineId, PcPort)>) {
        self.taps = Taps::new(self.session.rig().layout(), taps);
    }

    /// Ends it, and the recording, if there is one: every board is brought to one instant, so that what is recorded is
    /// all that happened before it.
    ///
    /// # Errors
    /// [`SessionError`] if the rig breaks over it, or the recording cannot be written.
    pub async fn end(mut self) -> Result<Left, SessionError> {
        let mut end = self.now().max(self.session.rig().engine().frontier()).max(Instant::START.next());
        let whole = self.session.is_recorded() || self.is_whole || self.asks_at_the_end;
        if whole {
            self.settle(end).await?;
            end = self.session.reach_end(end, |_| ()).await?;
        }
        if let Some(steering) = &mut self.steering {
            steering.tell(end);
            let program = self.program.as_ref().map(Player::state);
            let (session, brake, path) = (&mut self.session, &mut self.brake, self.path.as_mut());
            steering.end(Scene { session, brake, path, program, now: end });
        }
        let unfired = self.session.unfired();
        let turned = self.path.map(ToolPath::cut);
        let crate::session::Ended { trace, kept, begun, .. } = self.session.close(ENDED)?;
        Ok(Left { end, begun, unfired, kept, incidents: self.incidents, trace, turned })
    }

    /// The rig.
    pub const fn rig(&self) -> &Rig {
        self.session.rig()
    }

    /// The ports, in the order of the rig's gateways.
    pub fn ports(&self) -> impl Iterator<Item = &PcPort> {
        self.gateways.iter().map(|gateway| &gateway.port)
    }

    /// The taps: the names of their lines, and their ports.
    pub fn taps(&self) -> impl Iterator<Item = (&str, &PcPort)> {
        self.taps.ports()
    }

    /// Runs until something breaks.
    ///
    /// # Errors
    /// [`SessionError`]: this is the only way in which it ends by itself.
    pub async fn run(&mut self) -> Result<std::convert::Infallible, SessionError> {
        loop {
            self.begin();
            let allowed = self.brake.limit();
            let limit = self.slice(allowed).earlier(self.session.faults().0.next());
            // At full speed there is no limit where nothing happens: time stands still.
            let leap = (!limit.until.is_never()).then(|| self.kept_up + LEAP);
            let limit = limit.earlier(leap);
            let arrived = self.go(limit).await?;
            let frontier = self.rig().engine().frontier();
            // At full speed a silence may have held time back.
            let went = frontier >= limit.until;
            self.reached = match arrived {
                true if went || !allowed.until.is_never() => limit.until,
                true => Instant::NEVER,
                false => frontier,
            };
            let now = self.now();
            self.session.go_on(now);
            self.gateways.iter_mut().for_each(|gateway| gateway.lose_supply(now));
            self.keep_up().await?;
            if arrived {
                self.arrive();
                self.hold_for_silence();
            }
            let took = self.take_waiting()? | self.carry_out_due(limit == allowed).await?;
            if arrived && !took && (limit == allowed || !went) {
                // Where there is nothing to wait for, others must have their turn all the same.
                tokio::task::yield_now().await;
                self.wait().await?;
                self.asked = Lapse::begin(AT_ONCE);
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
            self.deliver(&happened)?;
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
        loop {
            let happened = self.session.settle_on(until).await?;
            self.deliver(&happened)?;
            if !happened.more {
                return Ok(());
            }
            // Whatever may end this must have its turn, even if all boards are in this process.
            tokio::task::yield_now().await;
        }
    }

    /// Waits for something to do.
    async fn wait(&mut self) -> Result<(), SessionError> {
        let next = self.next_instant();
        self.write_recording(self.brake.wall_until(next))?;
        tokio::select! {
            biased;
            () = self.session.rig_mut().news() => {}
            passed = self.brake.wait_past(next) => {
                passed?;
                self.check_pace(next);
            }
            (place, event) = next_event(&mut self.gateways) => {
                let now = self.brake.now().unwrap_or(self.now());
                self.gateways[place].take(event?, now, &mut self.session)?;
            }
            event = self.taps.event() => event?,
            call = next_call(&mut self.steering) => {
                if let Some(steering) = &mut self.steering {
                    steering.put_off(call);
                }
            }
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
        let low = self.gateways.iter().filter_map(Gateway::low).min();
        let Some(low) = low.filter(|_| self.brake.pace() != Pace::Max) else { return allowed };
        let next = engine.next_instant().max(self.reached);
        Limit::until(allowed.until.min(next + low))
    }

    /// Takes what has come from clients meanwhile. It follows on what came before, if that is not all sent yet.
    fn take_waiting(&mut self) -> Result<bool, SessionError> {
        let now = self.now();
        let wall = self.brake.now().unwrap_or(now);
        let mut took = false;
        self.taps.attend()?;
        for gateway in &mut self.gateways {
            while let Some(event) = gateway.try_event()? {
                let at = if gateway.is_sending() { now } else { wall };
                gateway.take(event, at, &mut self.session)?;
                took = true;
            }
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
        if let Some(path) = &mut self.path {
            path.cut_before(now);
        }
        if let Some(steering) = &mut self.steering {
            steering.tell(now);
        }
        Ok(())
    }

    /// Time has come to where it was to stand still, or to go on from.
    fn arrive(&mut self) {
        let now = self.now();
        self.taps.deliver(now);
        if let Some(steering) = &mut self.steering {
            steering.arrive(now);
        }
    }

    /// Tells those who watch what has happened, and hands clients what has come for them.
    fn deliver(&mut self, happened: &Happened) -> Result<(), SessionError> {
        let now = self.now();
        self.incidents.extend(happened.incidents.iter().cloned());
        if let Some(steering) = &mut self.steering {
            steering.note(&happened.inputs, &happened.facts);
        }
        self.taps.note(happened);
        if let Some(path) = &mut self.path {
            happened.facts.iter().for_each(|fact| path.add(fact));
        }
        let session = &mut self.session;
        self.gateways.iter_mut().try_for_each(|gateway| gateway.deliver(happened, now, session))?;
        self.play_on(happened, now)
    }

    /// Goes on with the program that is played from here, if one is. A program outside that opens the port ends it.
    fn play_on(&mut self, happened: &Happened, now: Instant) -> Result<(), SessionError> {
        let Some(program) = self.program.as_mut().filter(|program| program.is_playing()) else { return Ok(()) };
        let gateway = &mut self.gateways[PC];
        happened.pc().for_each(|(at, exchange)| program.hear(at, exchange));
        if gateway.is_open() && program.is_playing() {
            program.stop();
        }
        if !program.is_playing() {
            return gateway.play(false, now, &mut self.session);
        }
        let due = program.due();
        if !due.is_empty() {
            gateway.write(due, now, &mut self.session);
        }
        Ok(())
    }

    /// Plays a program, or says why not.
    fn play(&mut self, text: &str, now: Instant) -> Result<Result<(), String>, SessionError> {
        let gateway = &mut self.gateways[PC];
        if gateway.is_taken() {
            let link = gateway.port.url();
            let why = "or has left something there that is not sent yet: expected it to be closed, and empty";
            return Ok(Err(format!("a program outside has the port {link} open, {why}")));
        }
        if self.program.as_ref().is_some_and(Player::is_playing) {
            return Ok(Err("a program is played already: expected it to be stopped, or to end".to_owned()));
        }
        let program = match Player::read(&self.file, text) {
            Ok(program) => program,
            Err(why) => return Ok(Err(why)),
        };
        self.program = Some(program);
        gateway.play(true, now, &mut self.session)?;
        self.play_on(&Happened::default(), now)?;
        Ok(Ok(()))
    }

    /// Plays no more of it, or says why not.
    fn stop(&mut self, now: Instant) -> Result<Result<(), String>, SessionError> {
        let Some(program) = self.program.as_mut().filter(|program| program.is_playing()) else {
            return Ok(Err("no program is played from here".to_owned()));
        };
        program.stop();
        self.gateways[PC].play(false, now, &mut self.session)?;
        Ok(Ok(()))
    }

    /// How far time has gone; what comes from the client follows on that.
    fn now(&self) -> Instant {
        if self.reached.is_never() { self.session.rig().engine().frontier() } else { self.reached }
    }
}

/// Waits for something from a client. Says at which gateway. Cancel-safe.
async fn next_event(gateways: &mut [Gateway]) -> (usize, io::Result<PortEvent>) {
    let mut events: Vec<_> = gateways.iter_mut().map(|gateway| Box::pin(gateway.event())).collect();
    poll_fn(|context| {
        for (place, event) in events.iter_mut().enumerate() {
            if let Poll::Ready(event) = event.as_mut().poll(context) {
                return Poll::Ready((place, event));
            }
        }
        Poll::Pending
    })
    .await
}
