//! A session: a rig that runs, and what is made of everything that happens in it.
//!
//! This is the only place that advances a rig. Faults begin when they are due. What happens goes into the digest, the
//! telemetry and the recording, and a recording is ended here. A user of a session looks at what each
//! [step](Session::step) gives, and decides how far the next one may go.

use std::future::Future;
use std::io;
use std::pin::{Pin, pin};
use std::task::{Context, Poll, Waker};

use torno_bus::{Conversation, PcEvent, PcUart, Replies, Reply};
use torno_engine::{Fact, Hit, Input, Limit, NodeId};
use torno_protocol::board::{Kept, Stimulus};
use torno_protocol::time::{Instant, Span};
use torno_trace::{Digest, End, Header, Trace};

use crate::fault::{Faults, Planned, Unfired};
use crate::observe::{Telemetry, log};
use crate::pace::{Brake, Pace};
use crate::recorder::{RECORDED, Recorder, RecordingError};
use crate::rig::file::RigFile;
use crate::rig::{Driver, Incident, Rig, RigError};
use crate::spool::{SoFar, Spool};

/// The place of the PC's gateway in the rig file.
pub const PC: usize = 0;
/// The word for how something ended that Ctrl-C or a signal has ended.
pub const INTERRUPTED: &str = "interrupted";
/// The word for how a session has ended that has no end of its own: its user has ended it.
pub const ENDED: &str = "ended";
/// So many of the PC's replies are remembered for the faults that wait for one.
const REPLIES: usize = 16;

/// Why a session cannot go on. It is not the machine in the rig that broke.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The rig itself broke.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The rig is fine, but what happens cannot be recorded.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The serial port of the rig, or the timer that holds time back.
    #[error("the PC port failed")]
    Port(#[from] io::Error),
}

/// A running rig with all that is made of it.
pub struct Session {
    rig: Rig,
    digest: Digest,
    telemetry: Telemetry,
    /// What was said at each gateway.
    replies: Vec<Replies>,
    faults: Faults,
    recorder: Option<Recorder>,
    spool: Option<Spool>,
    trace: Option<Trace>,
    brake: Option<Brake>,
    logs: bool,
    /// When a fault began or ended last.
    turned: Instant,
    /// The faults that have begun, and when.
    begun: Vec<(String, Instant)>,
    /// Everything that has been noted lies before this.
    noted: Instant,
    /// Nothing of this and later counts.
    end: Option<Instant>,
    /// The boards of which is asked at the end what they keep, and what they said.
    keepers: Vec<NodeId>,
    kept: Vec<Option<Kept>>,
    /// Who watches, and holds time back; but no more where it comes to its end.
    audience: Option<Box<dyn Audience>>,
    comes_to_its_end: bool,
}

/// A step that an [`Audience`] lets a session take.
pub type Stepping<'a> = Pin<Box<dyn Future<Output = Result<Happened, SessionError>> + 'a>>;

/// Who watches a session and holds its time back. As long as nothing is done to the rig, nothing that comes of the
/// session depends on it.
pub trait Audience {
    /// Takes note of what has happened.
    fn note(&mut self, happened: &Happened);

    /// The program that is played has come so far: how much of it has been accepted, and how much there is.
    fn tell_program(&mut self, accepted: usize, of: usize);

    /// Does what [`Session::step`] is to do, as far as time may go by now. As long as that is not as far as `limit`,
    /// there may be [more](Happened::more). Meanwhile the session has no audience.
    fn step<'a>(&'a mut self, session: &'a mut Session, limit: Limit) -> Stepping<'a>;

    /// Everything before `until` has happened and has been noted, and this is the end.
    fn end(&mut self, session: &mut Session, until: Instant);
}

/// What has happened in a step.
#[derive(Debug, Default)]
pub struct Happened {
    /// What has been settled.
    pub facts: Vec<Fact>,
    /// What came from outside.
    pub inputs: Vec<Input>,
    /// What has become of boards' processes.
    pub incidents: Vec<Incident>,
    /// What watches have seen.
    pub hits: Vec<Hit>,
    /// The faults that have begun, and when.
    pub begun: Vec<(String, Instant)>,
    /// What the gateways have sent and received: when, the gateway's place in the rig file, and what.
    pub outside: Vec<(Instant, usize, Exchange)>,
    /// Everything before this has been settled.
    pub settled: Instant,
    /// There may be more before the limit.
    pub more: bool,
}

/// Something that a gateway's UART has sent or received.
#[derive(Clone, Debug)]
pub enum Exchange {
    /// A byte has gone onto the line; what is complete with it, for people.
    Sent(u8, Vec<String>),
    /// A byte has come; the replies that are complete with it.
    Received(u8, Vec<Reply>),
    /// A character has come with an error.
    Garbled(u8),
}

/// What is left of a session.
pub struct Ended {
    /// The digest of everything that happened, when it ended, and how.
    pub end: End,
    /// The boards.
    pub boards: Vec<EndedBoard>,
    /// Everything that happened, if it was kept.
    pub trace: Option<Trace>,
    /// What those boards keep without power that were [to be asked](Session::ask_at_the_end), in that order. None of
    /// one that is gone or does not answer.
    pub kept: Vec<Option<Kept>>,
    /// The faults that have begun, and when.
    pub begun: Vec<(String, Instant)>,
    /// The rig, for what it cost.
    pub rig: Rig,
}

/// How a board ended.
#[derive(Clone, Debug)]
pub struct EndedBoard {
    /// Its name.
    pub name: String,
    /// Its process; its own or the harness's.
    pub pid: u32,
    /// The last value of each of its quantities.
    pub telemetry: std::collections::BTreeMap<String, i64>,
    /// The boards that it waits for.
    pub waits_for: Vec<String>,
}

impl Happened {
    /// All that has happened in two steps, of which this is the first.
    pub(crate) fn followed_by(mut self, next: Self) -> Self {
        self.facts.extend(next.facts);
        self.inputs.extend(next.inputs);
        self.incidents.extend(next.incidents);
        self.hits.extend(next.hits);
        self.begun.extend(next.begun);
        self.outside.extend(next.outside);
        Self { settled: next.settled, more: next.more, ..self }
    }

    /// What the PC's gateway has sent and received.
    pub fn pc(&self) -> impl Iterator<Item = (Instant, &Exchange)> {
        self.outside.iter().filter(|(_, gateway, _)| *gateway == PC).map(|(at, _, exchange)| (*at, exchange))
    }
}

impl Session {
    /// Starts the rig of `file`, with `uart` for the PC.
    ///
    /// # Errors
    /// [`SessionError::Rig`] if a board cannot be started.
    pub async fn start<P>(file: &RigFile, driver: &Driver, uart: PcUart<P>) -> Result<Self, SessionError>
    where
        P: Conversation + Send + 'static,
    {
        let rig = Rig::start(file, driver, uart).await?;
        Ok(Self {
            digest: Digest::new(rig.layout()),
            telemetry: Telemetry::new(&rig).with_speeds(file),
            replies: file.gateways().map(|gateway| Replies::new(gateway.dialect)).collect(),
            faults: Faults::default(),
            recorder: None,
            spool: None,
            trace: None,
            brake: None,
            logs: true,
            turned: Instant::START,
            begun: Vec::new(),
            noted: Instant::START,
            end: None,
            keepers: Vec::new(),
            kept: Vec::new(),
            audience: None,
            comes_to_its_end: false,
            rig,
        })
    }

    /// Without a log: many sessions run at once, or one again.
    #[must_use]
    pub fn quiet(self) -> Self {
        Self { logs: false, ..self }
    }

    /// Records everything from the start. For a rig that does not run yet.
    pub fn record(&mut self, recorder: Recorder) {
        self.recorder = Some(recorder);
    }

    /// Keeps everything from the start, under this header. For a rig that does not run yet.
    pub fn keep(&mut self, header: Header) {
        self.trace = Some(Trace::new(header));
    }

    /// Keeps everything from the start for whoever asks before the end. For a rig that does not run yet.
    pub fn spool(&mut self, spool: Spool) {
        self.spool = Some(spool);
    }

    /// What is kept for whoever asks before the end.
    pub const fn spooled(&self) -> Option<&Spool> {
        self.spool.as_ref()
    }

    /// Lets somebody watch, and hold time back. For a rig that does not run yet.
    pub fn show(&mut self, audience: Box<dyn Audience>) {
        self.audience = Some(audience);
    }

    /// Whether somebody may watch, and hold time back.
    pub const fn is_shown(&self) -> bool {
        self.audience.is_some()
    }

    /// Tells who watches how much of the program has been accepted, and how much there is.
    pub fn tell_program(&mut self, (accepted, of): (usize, usize)) {
        if let Some(audience) = &mut self.audience {
            audience.tell_program(accepted, of);
        }
    }

    /// Asks these boards at the end what they keep without power.
    pub fn ask_at_the_end(&mut self, boards: Vec<NodeId>) {
        self.keepers = boards;
    }

    /// Holds time back to a pace from `now` on.
    ///
    /// # Errors
    /// If the system refuses a timer.
    pub fn set_pace(&mut self, pace: Pace, now: Instant) -> io::Result<()> {
        match &mut self.brake {
            Some(brake) => brake.set_pace(pace, now),
            none => none.insert(Brake::new(pace)?).set_pace(pace, now),
        }
        Ok(())
    }

    /// What holds time back, if anything does.
    pub const fn brake(&mut self) -> Option<&mut Brake> {
        self.brake.as_mut()
    }

    /// The pace.
    pub fn pace(&self) -> Pace {
        self.brake.as_ref().map_or(Pace::Max, Brake::pace)
    }

    /// How far time may go by now.
    pub fn allowed(&self) -> Limit {
        self.brake.as_ref().filter(|brake| brake.pace() != Pace::Max).map_or(Limit::NONE, Brake::limit)
    }

    /// Takes the faults that begin by themselves. For a rig that does not run yet. Says which have begun at once.
    pub fn plan(&mut self, planned: &[Planned]) -> Vec<(String, Instant)> {
        planned
            .iter()
            .filter_map(|planned| Some((planned.fault.name.clone(), self.plan_one(planned, Instant::START)?)))
            .collect()
    }

    /// Takes a fault that begins by itself, from `now` on. Says since when, if it has begun.
    pub fn plan_one(&mut self, planned: &Planned, now: Instant) -> Option<Instant> {
        let telemetry = &self.telemetry;
        let value = |node: NodeId, signal: u8| telemetry.value(node, signal);
        let since = self.faults.plan(&mut self.rig, planned, now, value)?;
        self.note_begun(&[(planned.fault.name.clone(), since)]);
        Some(since)
    }

    /// The rig.
    pub const fn rig(&self) -> &Rig {
        &self.rig
    }

    /// The rig, for whoever watches it.
    pub const fn rig_mut(&mut self) -> &mut Rig {
        &mut self.rig
    }

    /// The last value of each quantity.
    pub const fn telemetry(&self) -> &Telemetry {
        &self.telemetry
    }

    /// What the PC has heard lately.
    pub fn replies(&self) -> &Replies {
        &self.replies[PC]
    }

    /// The faults, and the rig that they break.
    pub const fn faults(&mut self) -> (&mut Faults, &mut Rig) {
        (&mut self.faults, &mut self.rig)
    }

    /// What is recorded is written within a second, if it is told of waits.
    pub const fn recorder(&mut self) -> Option<&mut Recorder> {
        self.recorder.as_mut()
    }

    /// Whether it is recorded.
    pub const fn is_recorded(&self) -> bool {
        self.recorder.is_some()
    }

    /// Gives a board, or the PC's UART, a stimulus.
    pub fn stimulate(&mut self, node: NodeId, at: Instant, stimulus: Stimulus) -> Instant {
        self.rig.stimulate(node, at, stimulus)
    }

    /// Lets something happen before `limit`, and takes note of it. Faults that are due on the way begin there.
    ///
    /// # Errors
    /// [`SessionError`] if the rig itself breaks, or the recording cannot go on.
    pub async fn step(&mut self, limit: Limit) -> Result<Happened, SessionError> {
        let Some(mut audience) = self.audience.take_if(|_| !self.comes_to_its_end) else {
            return self.step_at_once(limit).await;
        };
        let happened = audience.step(self, limit).await;
        self.audience = Some(audience);
        happened
    }

    async fn step_at_once(&mut self, limit: Limit) -> Result<Happened, SessionError> {
        let due = self.faults.next().filter(|due| *due < limit.until);
        let stepped = self.rig.step(limit.earlier(due)).await?;
        let mut happened = self.note(Instant::NEVER)?;
        happened.more = stepped || !happened.hits.is_empty();
        // Where a silence holds time back, the fault is not due yet.
        let due = due.filter(|due| limit.silence.is_never() || self.rig.engine().frontier() >= *due);
        if let Some(due) = due.filter(|_| !happened.more) {
            happened.begun.extend(self.go_on(due));
            happened.more = true;
        }
        Ok(happened)
    }

    /// Brings every board towards `until`, however little it has to do. For when the rig is quiet. There may be
    /// [more](Happened::more).
    ///
    /// # Errors
    /// As for a [step](Self::step).
    pub async fn catch_up(&mut self, until: Instant) -> Result<Happened, SessionError> {
        let more = self.rig.catch_up(until).await?;
        Ok(Happened { more, ..self.note(Instant::NEVER)? })
    }

    /// Lets everything happen until the rig is quiet, and nothing at `limit` and later. Gives what has happened and,
    /// if the rig is quiet, when that is over: not before `least`. For a rig in which nothing is planned, watched or
    /// disturbed: no one has to be asked on the way.
    ///
    /// # Errors
    /// As for a [step](Self::step).
    pub async fn fall_quiet(
        &mut self,
        least: Instant,
        limit: Instant,
    ) -> Result<(Happened, Option<Instant>), SessionError> {
        while !self.rig.engine().is_quiet() && self.rig.step(Limit::until(limit)).await? {}
        let engine = self.rig.engine();
        let quiet = engine.is_quiet().then(|| engine.quiet_since().next().max(least).min(limit));
        // Boards that are mute may have told more of themselves than that.
        let happened = self.note(quiet.unwrap_or(limit))?;
        Ok((happened, quiet))
    }

    /// Time has come to `now`, and everything before has happened: faults that are due begin, get worse and end. Gives
    /// those that have begun.
    pub fn go_on(&mut self, now: Instant) -> Vec<(String, Instant)> {
        if let Some(turn) = self.faults.next_turn().filter(|turn| *turn <= now) {
            self.turned = self.turned.max(turn);
        }
        let begun = self.faults.go_on(&mut self.rig, now);
        self.note_begun(&begun);
        begun
    }

    /// When a fault began or ended last.
    pub const fn turned(&self) -> Instant {
        self.turned
    }

    /// If nothing happens any more, neither by itself nor by a fault that begins or ends: since when.
    pub fn quiet_since(&self) -> Option<Instant> {
        let engine = self.rig.engine();
        (engine.is_quiet() && self.faults.next_turn().is_none()).then(|| engine.quiet_since().max(self.turned))
    }

    /// The rig is not [quiet](Self::quiet_since) before this instant. Who decides something by that goes no further at
    /// once: else it would depend on how time was cut.
    pub fn active_until(&mut self) -> Instant {
        self.quiet_since().unwrap_or_else(|| {
            let fault = self.faults.next().unwrap_or(Instant::NEVER);
            if self.rig.engine().is_quiet() { fault } else { self.rig.active_until().min(fault) }
        })
    }

    /// Lets everything happen before `limit`.
    ///
    /// # Errors
    /// As for a [step](Self::step).
    pub async fn advance(&mut self, limit: Limit, mut see: impl FnMut(Happened)) -> Result<(), SessionError> {
        loop {
            let happened = self.step(limit).await?;
            let more = happened.more;
            see(happened);
            if !more {
                return Ok(());
            }
        }
    }

    /// Brings every board to `until`: everything before that has happened, and has been noted, and nothing of it and
    /// later. Boards that are stopped or gone stay where they are.
    ///
    /// # Errors
    /// As for a [step](Self::step).
    pub async fn settle(&mut self, until: Instant, mut see: impl FnMut(Happened)) -> Result<(), SessionError> {
        loop {
            let happened = self.settle_on(until).await?;
            let more = happened.more;
            see(happened);
            if !more {
                return Ok(());
            }
        }
    }

    /// Does the next part of [settling](Self::settle) everything before `until`: no more than the boards can tell in a
    /// report each.
    ///
    /// # Errors
    /// As for a [step](Self::step).
    pub async fn settle_on(&mut self, until: Instant) -> Result<Happened, SessionError> {
        let happened = self.step(Limit::until(until)).await?;
        if happened.more {
            return Ok(happened);
        }
        let behind = self.rig.settle(until).await?;
        let mut next = self.note(Instant::NEVER)?;
        next.more = behind || !next.hits.is_empty();
        Ok(happened.followed_by(next))
    }

    /// Waits until time may go past `next`, or something becomes of a board's process. Cancel-safe.
    ///
    /// # Errors
    /// [`SessionError`] if the system refuses the timer, or the recording cannot go on.
    pub async fn wait(&mut self, next: Instant) -> Result<(), SessionError> {
        let Self { brake: Some(brake), recorder, rig, .. } = self else {
            rig_news(&mut self.rig).await;
            return Ok(());
        };
        if let Some(recorder) = recorder {
            recorder.before_wait(brake.wall_until(next))?;
        }
        tokio::select! {
            biased;
            () = rig.news() => {}
            passed = brake.wait_past(next) => {
                passed?;
                if let Some(by) = brake.reached(next) {
                    log::behind(next, by);
                }
            }
        }
        Ok(())
    }

    /// At a pace, boards that nothing reaches are asked so often for what they have to tell, so that it is recorded.
    pub fn keep_up_every(&self) -> Option<Span> {
        self.recorder.as_ref()?;
        self.brake.as_ref()?.span_of(RECORDED)
    }

    /// The faults that have not fired.
    pub fn unfired(&mut self) -> Vec<Unfired> {
        self.faults.unfired(&mut self.rig)
    }

    /// Brings every board to the end of the session: digest and recording hold everything before that instant, and
    /// nothing of it and later. It is `until`, unless something later has been noted. Characters on the lines are cut.
    /// Gives the end.
    ///
    /// # Errors
    /// As for a [step](Self::step).
    pub async fn reach_end(&mut self, until: Instant, see: impl FnMut(Happened)) -> Result<Instant, SessionError> {
        let until = until.max(self.noted).max(Instant::START.next());
        self.comes_to_its_end = true;
        self.settle(until, see).await?;
        self.end = Some(until);
        for board in core::mem::take(&mut self.keepers) {
            self.kept.push(self.rig.kept(board, until).await?);
        }
        Ok(until)
    }

    /// Ends the session at `until`, and its recording: with the word for how it ended.
    ///
    /// # Errors
    /// [`SessionError`] if the rig breaks over it, or the recording cannot be written.
    pub async fn finish(
        mut self,
        until: Instant,
        outcome: &str,
        see: impl FnMut(Happened),
    ) -> Result<Ended, SessionError> {
        self.reach_end(until, see).await?;
        self.close(outcome)
    }

    /// The same where the [end](Self::reach_end) has been reached.
    ///
    /// # Errors
    /// [`SessionError::Recording`] if the recording cannot be written.
    pub fn close(mut self, outcome: &str) -> Result<Ended, SessionError> {
        let until = self.end.unwrap_or(self.noted).max(Instant::START.next());
        if let Some(mut audience) = self.audience.take() {
            audience.end(&mut self, until);
        }
        let end = self.end_at(until, outcome);
        if let Some(recorder) = &mut self.recorder {
            recorder.finish(&end)?;
        }
        if let Some(trace) = &mut self.trace {
            (trace.settled, trace.end) = (until, Some(end.clone()));
        }
        let boards = self.boards();
        Ok(Ended { end, boards, trace: self.trace, kept: self.kept, begun: self.begun, rig: self.rig })
    }

    fn end_at(&self, until: Instant, outcome: &str) -> End {
        End { digest: self.digest.sum().to_string(), at: until - Span::from_nanos(1), outcome: outcome.to_owned() }
    }

    /// The earliest instant, not before `now`, at which the session could end: nothing that has been noted is later.
    pub fn earliest_end(&self, now: Instant) -> Instant {
        now.max(self.rig.engine().frontier()).max(self.noted).max(Instant::START.next())
    }

    /// What has happened so far, if it is kept: as if the session ended at `until`, its
    /// [earliest end](Self::earliest_end), to which every board has been [brought](Self::settle_on).
    ///
    /// # Errors
    /// If the system refuses it.
    pub fn so_far(&mut self, until: Instant) -> io::Result<Option<SoFar>> {
        let end = self.end_at(until, ENDED);
        self.spool.as_mut().map(|spool| spool.so_far(&end)).transpose()
    }

    /// The faults that have begun, and when.
    pub fn begun(&self) -> &[(String, Instant)] {
        &self.begun
    }

    /// How the boards stand, without the gateways' UARTs.
    fn boards(&self) -> Vec<EndedBoard> {
        let nodes = self.nodes().into_iter().zip(&self.rig.layout().boards);
        nodes.filter(|(_, board)| !board.is_gateway()).map(|(node, _)| node).collect()
    }

    /// How the boards and the gateways' UARTs stand.
    pub fn nodes(&self) -> Vec<EndedBoard> {
        let board = |(id, node): (NodeId, &crate::rig::Node)| EndedBoard {
            name: node.name.clone(),
            pid: node.pid.unwrap_or_else(std::process::id),
            telemetry: self.telemetry.of(id),
            waits_for: self.rig.waits_for(id, &self.telemetry.values(id)),
        };
        self.rig.nodes().iter().enumerate().map(board).collect()
    }

    /// Makes of what has happened before `until` what is to be made of it.
    fn note(&mut self, until: Instant) -> Result<Happened, SessionError> {
        let mut happened = Happened {
            incidents: self.rig.take_incidents(),
            inputs: self.rig.take_inputs(),
            facts: self.rig.take_facts(),
            settled: self.rig.engine().frontier(),
            ..Happened::default()
        };
        if !until.is_never() {
            happened.facts.retain(|fact| fact.at() < until);
        }
        if self.logs {
            happened.incidents.iter().for_each(log::incident);
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.note(&happened.inputs, &happened.facts, self.rig.engine().frontier())?;
        }
        if let Some(spool) = &mut self.spool {
            spool.note(&happened.inputs, &happened.facts, self.rig.engine().frontier());
        }
        if let Some(trace) = &mut self.trace {
            trace.inputs.extend_from_slice(&happened.inputs);
            trace.facts.extend_from_slice(&happened.facts);
        }
        for fact in &happened.facts {
            self.noted = self.noted.max(fact.last().next());
            self.digest.add(fact);
            self.telemetry.add(fact);
            let Fact::Event { node, at, event, value } = *fact else { continue };
            if self.logs {
                log::event(&self.rig, node, at, event, value);
            }
            if let Some(gateway) = node.checked_sub(self.rig.pc())
                && let Some(replies) = self.replies.get_mut(gateway)
                && let Some(event) = PcEvent::from_numbers(event, value)
            {
                happened.outside.push((at, gateway, hear(replies, at, event)));
            }
        }
        self.telemetry.settle(happened.settled);
        for hit in self.rig.take_hits() {
            let begun = self.faults.see(&mut self.rig, hit, &self.replies[PC]);
            happened.begun.extend(begun);
            happened.hits.push(hit);
        }
        self.note_begun(&happened.begun);
        self.replies.iter_mut().for_each(|replies| replies.keep_last(REPLIES));
        if let Some(audience) = &mut self.audience {
            audience.note(&happened);
        }
        Ok(happened)
    }

    fn note_begun(&mut self, begun: &[(String, Instant)]) {
        self.begun.extend_from_slice(begun);
        self.turned = begun.iter().map(|(_, since)| *since).chain([self.turned]).max().unwrap_or_default();
        if self.logs {
            begun.iter().for_each(|(name, since)| log::begun(name, *since));
        }
    }
}

/// What a gateway's UART has told.
fn hear(replies: &mut Replies, at: Instant, event: PcEvent) -> Exchange {
    match event {
        PcEvent::Sent(byte) => Exchange::Sent(byte, replies.send(at, byte)),
        PcEvent::Received(byte) => Exchange::Received(byte, replies.hear(at, byte)),
        PcEvent::Garbled(byte) => Exchange::Garbled(byte),
    }
}

async fn rig_news(rig: &mut Rig) {
    rig.news().await;
}

/// Runs what waits for nothing outside this process: a session whose boards are all in it, as fast as it can.
///
/// # Errors
/// [`RigError::Waits`] if it waits all the same.
pub fn in_process<T, E: From<RigError>>(session: impl Future<Output = Result<T, E>>) -> Result<T, E> {
    match pin!(session).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(result) => result,
        Poll::Pending => Err(RigError::Waits.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The lathe without its depth board: a gateway sits at the master's software UART in its place.
    fn rig() -> RigFile {
        let lathe = include_str!("../builtin/lathe.toml").split("[part]").next().unwrap();
        let (board, link) = ("[[board]]\nname = \"depth\"\nkind = \"depth\"", "\"master.depth\", \"depth.master\"");
        assert!(lathe.contains(board) && lathe.contains(link));
        let lathe = lathe.replace(board, "");
        let links: Vec<&str> = lathe.split("[[link]]").filter(|text| !text.contains(link)).collect();
        let gateway = "[[gateway]]\nname = \"probe\"\nport = \"master.depth\"\n";
        RigFile::parse("my.toml", &(links.join("[[link]]") + gateway)).unwrap()
    }

    #[test]
    fn each_gateway_has_its_own_line_and_its_own_talk() {
        let file = rig();
        assert_eq!(file.layout.gateways().collect::<Vec<_>>(), [3, 4]);
        let session = async {
            let mut session = Session::start(&file, &Driver::InProcess, file.pc.uart()).await?.quiet();
            let [pc, probe] = [0, 1].map(|gateway| session.rig().pc() + gateway);
            let ms = |ms| Instant::START + Span::from_millis(ms);
            // As the depth board answers the master's first enquiry, and says that it is done.
            session.stimulate(probe, ms(5), Stimulus::Write(b"\x18r".to_vec()));
            session.stimulate(pc, ms(100), Stimulus::Write(vec![0, 0, 0, 0, 0, 0, 5, 1]));
            session.stimulate(probe, ms(150), Stimulus::Write(b"\x06o".to_vec()));
            let mut received = [Vec::new(), Vec::new()];
            let end = ms(300);
            let see = |happened: Happened| {
                for (_, gateway, exchange) in happened.outside {
                    if let Exchange::Received(byte, _) = exchange {
                        received[gateway].push(byte);
                    }
                }
            };
            session.finish(end, "ended", see).await?;
            Ok::<_, SessionError>(received)
        };
        let received = in_process(session).unwrap();
        assert_eq!(received, [vec![0x06, 0x11], vec![0x05, 0, 5, 1]]);
    }

    #[test]
    fn a_session_ends_after_all_that_has_been_noted() {
        let file = RigFile::load("lathe").unwrap();
        let ms = |ms| Instant::START + Span::from_millis(ms);
        let session = async {
            let mut session = Session::start(&file, &Driver::InProcess, file.pc.uart()).await?.quiet();
            session.keep(file.header("lathe", 0, None));
            let pc = session.rig().pc();
            session.stimulate(pc, ms(10), Stimulus::Write(vec![0x55; 8]));
            session.advance(Limit::until(ms(15)), |_| ()).await?;
            session.finish(ms(12), "ended", |_| ()).await
        };
        let ended: Result<Ended, SessionError> = in_process(session);
        let trace = ended.unwrap().trace.unwrap();
        let last = trace.facts.iter().map(Fact::last).max().unwrap();
        // In the middle of a character.
        assert!(ms(14) < last && last < ms(15), "{last}");
        assert_eq!(trace.until(), last.next());
    }

    #[test]
    fn a_session_in_this_process_that_waits_says_so() {
        let waits = in_process(std::future::pending::<Result<(), RigError>>());
        assert!(matches!(waits, Err(RigError::Waits)));
    }
}
