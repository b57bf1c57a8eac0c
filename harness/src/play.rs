//! Plays a whole program through a rig, as a PC with flow control would, and tells how it ended.

use torno_protocol::board::Stimulus;
use torno_protocol::lathe::{Conversation, Outcome, Program, Reply, ReplyDecoder};
use torno_protocol::time::{Instant, Span};

use crate::fault::{Faults, Looked, Onlooker, Planned};
use crate::observe::{Telemetry, log};
use crate::pace::{Brake, Pace};
use crate::recorder::{RECORDED, Recorder, SessionError};
use crate::rig::file::RigFile;
use crate::rig::{Cost, Driver, Incident, Rig, RigError};
use torno_bus::{PcEvent, PcProgram};
use torno_engine::{Fact, Limit, NodeId};
use torno_machines::workpiece::ToolPath;
use torno_trace::{Digest, End, Header, Sum, Trace, Waveforms};

/// The PC starts to send so long after the rig has started, or later where characters are long: a decoder wants to see
/// an idle line first.
const PROGRAM_START: Span = Span::from_millis(10);
/// Steps between two looks at what may end the run.
const STEPS_PER_LOOK: u32 = 64;
/// A program that is over in a rig with faults is left to run for so long: noise has no end.
const AFTER: Span = Span::from_secs(1);
/// Unless something else is asked for, a play is given up when no frame has been accepted for so long. (Ours: the
/// longest motion of the lathe, 65 535 counts at a count every 30 ms, takes 33 minutes.)
pub const PATIENCE: Span = Span::from_secs(3_600);

/// What is to be played, and how.
#[derive(Clone, Debug)]
pub struct Play {
    /// The rig.
    pub file: RigFile,
    /// The program.
    pub program: Program,
    /// Where the boards run.
    pub driver: Driver,
    /// How fast.
    pub pace: Pace,
    /// What breaks on the way.
    pub faults: Vec<Planned>,
    /// Whether to keep the waveforms of all lines.
    pub waveforms: bool,
    /// Whether to measure what wall time is spent on.
    pub measure: bool,
    /// What heads the trace that is to be kept in memory, if one is.
    pub keep: Option<Header>,
    /// It is given up when no frame has been accepted for so long, in virtual time.
    pub patience: Span,
}

/// Why a play ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The program is over, and nothing more happens, but for faults.
    Over,
    /// No frame has been accepted for as long as it was to be waited for.
    OutOfPatience,
    /// It was to end.
    Interrupted,
}

/// A program that sends no more once a board has failed: with a frame missing, the rest would turn another part.
#[derive(Clone, Debug, Default)]
pub struct Careful {
    decoder: ReplyDecoder,
}

impl PcProgram for Careful {
    fn gives_up(&mut self, byte: u8) -> bool {
        self.decoder.push(byte).iter().any(|reply| matches!(reply, Reply::Can(..)))
    }
}

/// How far a play has come.
#[derive(Clone, Copy, Debug)]
pub struct Progress<'a> {
    /// Everything before this has happened.
    pub now: Instant,
    /// What has been said.
    pub conversation: &'a Conversation,
    /// What has happened since the last time.
    pub facts: &'a [Fact],
}

/// How a play ended.
pub struct Played {
    /// What was said.
    pub conversation: Conversation,
    /// How the program ended.
    pub outcome: Outcome,
    /// Why the play did.
    pub ended: Ended,
    /// The virtual time it took until the rig was quiet, or the play ended.
    pub end: Instant,
    /// The digest of everything that happened.
    pub digest: Sum,
    /// The boards: name, process, last telemetry.
    pub boards: Vec<PlayedBoard>,
    /// What became of their processes.
    pub incidents: Vec<Incident>,
    /// What the boards and the PC have cost.
    pub costs: Vec<Cost>,
    /// The wall time from when all boards stood, if it was to be measured.
    pub measured: Option<std::time::Duration>,
    /// The waveforms, if they were to be kept.
    pub waveforms: Option<Waveforms>,
    /// The way that the tool went, if the rig turns a part.
    pub path: Option<ToolPath>,
    /// Everything that happened, if it was to be kept.
    pub trace: Option<Trace>,
    /// The faults that have not fired.
    pub unfired: Vec<String>,
}

impl Played {
    /// In words, why it ended before the rig was quiet; nothing, if it did not.
    pub fn cut_short(&self) -> Option<String> {
        let why = match self.ended {
            Ended::Over => return None,
            Ended::OutOfPatience => "given up: no frame has been accepted for long",
            Ended::Interrupted => "interrupted",
        };
        let waits = self.boards.iter().filter(|board| !board.waits_for.is_empty());
        let waits = waits.map(|board| format!("{} waits for {}", board.name, board.waits_for.join(", ")));
        let waits = waits.collect::<Vec<_>>().join("; ");
        Some(if waits.is_empty() { why.to_owned() } else { format!("{why}; {waits}") })
    }
}

/// How a board ended.
pub struct PlayedBoard {
    /// Its name.
    pub name: String,
    /// Its process; its own or the harness's.
    pub pid: u32,
    /// The last value of each of its quantities.
    pub telemetry: std::collections::BTreeMap<String, i64>,
    /// The boards that it waits for.
    pub waits_for: Vec<String>,
}

struct Session {
    rig: Rig,
    digest: Digest,
    telemetry: Telemetry,
    waveforms: Option<Waveforms>,
    path: Option<ToolPath>,
    recorder: Option<Recorder>,
    trace: Option<Trace>,
    decoder: ReplyDecoder,
    conversation: Conversation,
    facts: Vec<Fact>,
    bytes_sent: usize,
    now: Instant,
    /// When a frame has been accepted last.
    accepted: Instant,
    /// Since when the program is over, if it is.
    over: Option<Instant>,
    /// How many frames it has.
    frames: usize,
    faults: Faults,
    onlooker: Onlooker,
    /// What waits for something has been seen: the engine may have waited for that.
    acted: bool,
    incidents: Vec<Incident>,
}

impl Play {
    /// A play in which nothing breaks, as fast as can be.
    pub const fn new(file: RigFile, program: Program, driver: Driver) -> Self {
        Self {
            file,
            program,
            driver,
            pace: Pace::Max,
            faults: Vec::new(),
            waveforms: false,
            measure: false,
            keep: None,
            patience: PATIENCE,
        }
    }

    /// Plays to the end: until the rig is quiet, or for as long as its [patience](Self::patience) lasts.
    ///
    /// # Errors
    /// [`SessionError`] if the rig itself breaks.
    pub async fn run(self, progress: impl FnMut(Progress<'_>)) -> Result<Played, SessionError> {
        self.record(None, progress, std::future::pending()).await
    }

    /// The same, and records it; or until `interrupted`.
    ///
    /// # Errors
    /// [`SessionError`] if the rig itself breaks, or the recording cannot go on.
    pub async fn record(
        self,
        recorder: Option<Recorder>,
        mut progress: impl FnMut(Progress<'_>),
        interrupted: impl Future<Output = ()>,
    ) -> Result<Played, SessionError> {
        let uart = self.file.uart().with_program(Careful::default());
        let mut rig = Rig::start(&self.file, &self.driver, uart).await?;
        if self.pace == Pace::Max {
            rig.share_one_processor();
        }
        if self.measure {
            rig.measure();
        }
        let (mut faults, onlooker) = (Faults::default(), Onlooker::new(self.file.dialect));
        let begun = onlooker.plan(&mut rig, &mut faults, &self.faults);
        begun.iter().for_each(|(name, since)| log::begun(name, *since));
        let pc = rig.pc();
        let start = Instant::START + PROGRAM_START.max(self.file.margin());
        rig.stimulate(pc, start, Stimulus::Write(self.program.bytes()));
        let path = self.file.part.as_ref().map(ToolPath::new);
        let frames = self.program.frames.len();
        let mut session = Session { faults, frames, ..Session::new(rig, onlooker, self.waveforms, path, recorder) };
        session.trace = self.keep.map(Trace::new);
        let mut brake = Brake::new(self.pace).map_err(RigError::from)?;
        let keep_up = session.recorder.as_ref().and_then(|_| brake.span_of(RECORDED));
        let mut kept_up = Instant::START;
        let mut interrupted = std::pin::pin!(interrupted);
        let ended = 'play: loop {
            let deadline = session.deadline(self.patience);
            let allowed = if self.pace == Pace::Max { Limit::NONE } else { brake.limit() };
            let limit = allowed.earlier(Some(deadline)).earlier(session.faults.next()).earlier(session.stride());
            let mut steps = 0;
            while session.rig.step(limit).await? {
                session.take_note()?;
                progress(session.progress());
                steps += 1;
                if steps % STEPS_PER_LOOK == 0 {
                    tokio::select! {
                        biased;
                        () = &mut interrupted => break 'play Ended::Interrupted,
                        () = tokio::task::yield_now() => {}
                    }
                }
            }
            session.take_note()?;
            progress(session.progress());
            if core::mem::take(&mut session.acted) {
                continue;
            }
            if session.rig.engine().is_quiet() && session.faults.next_turn().is_none() {
                break Ended::Over;
            }
            if session.faults.next() == Some(limit.until) {
                let begun = session.faults.go_on(&mut session.rig, limit.until);
                begun.iter().for_each(|(name, since)| log::begun(name, *since));
                continue;
            }
            if limit.until == session.deadline(self.patience) {
                break if session.over.is_some() { Ended::Over } else { Ended::OutOfPatience };
            }
            if self.pace == Pace::Max {
                continue;
            }
            let next = session.rig.engine().next_instant();
            let mut next = session.faults.next().map_or(next, |fault| fault.min(next));
            if let Some(every) = keep_up {
                if limit.until >= kept_up + every {
                    kept_up = limit.until;
                    session.bring_to(kept_up).await?;
                }
                next = next.min(kept_up + every);
            }
            if let Some(recorder) = &mut session.recorder {
                recorder.before_wait(brake.wall_until(next))?;
            }
            tokio::select! {
                () = &mut interrupted => break Ended::Interrupted,
                () = session.rig.news() => {}
                passed = brake.wait_past(next) => {
                    passed.map_err(RigError::from)?;
                    if let Some(by) = brake.reached(next) {
                        log::behind(next, by);
                    }
                }
            }
        };
        let now = match ended {
            Ended::Interrupted if self.pace == Pace::Max => Instant::START,
            Ended::Interrupted => brake.limit().until,
            Ended::Over | Ended::OutOfPatience => session.deadline(self.patience),
        };
        let end = session.settle(now).await?;
        progress(session.progress());
        session.finish(ended, end)
    }
}

impl Session {
    fn new(rig: Rig, onlooker: Onlooker, waveforms: bool, path: Option<ToolPath>, recorder: Option<Recorder>) -> Self {
        Self {
            digest: Digest::new(rig.layout()),
            telemetry: Telemetry::new(&rig),
            waveforms: waveforms.then(|| Waveforms::new(rig.layout())),
            path,
            recorder,
            trace: None,
            rig,
            decoder: ReplyDecoder::default(),
            conversation: Conversation::default(),
            facts: Vec::new(),
            bytes_sent: 0,
            now: Instant::START,
            accepted: Instant::START,
            over: None,
            frames: 0,
            faults: Faults::default(),
            onlooker,
            acted: false,
            incidents: Vec::new(),
        }
    }

    /// Makes of the facts what is to be made of them.
    fn take_note(&mut self) -> Result<(), SessionError> {
        for incident in self.rig.take_incidents() {
            log::set_time(incident.at);
            tracing::warn!("{incident}");
            self.incidents.push(incident);
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
            if let Some(waveforms) = &mut self.waveforms {
                waveforms.add(fact);
            }
            if let Some(path) = &mut self.path {
                path.add(fact);
            }
            if let Fact::Event { node, at, event, value } = fact {
                self.now = self.now.max(*at);
                if *node == self.rig.pc() {
                    self.listen(*at, PcEvent::from_numbers(*event, *value));
                }
            }
        }
        let Looked { seen, begun } = self.onlooker.look(&mut self.rig, &mut self.faults, &facts);
        self.acted |= seen;
        begun.iter().for_each(|(name, since)| log::begun(name, *since));
        self.facts = facts;
        self.now = self.now.max(self.rig.engine().frontier());
        Ok(())
    }

    fn listen(&mut self, at: Instant, event: Option<PcEvent>) {
        let accepted = self.conversation.accepted;
        match event {
            Some(PcEvent::Sent(_)) => {
                self.bytes_sent += 1;
                if self.bytes_sent.is_multiple_of(8) {
                    self.conversation.sent();
                }
            }
            Some(PcEvent::Received(byte)) => {
                self.decoder.push(byte).into_iter().for_each(|reply| self.conversation.reply(reply));
            }
            Some(PcEvent::Garbled(_)) | None => {}
        }
        if self.conversation.accepted > accepted {
            self.accepted = at;
        }
        let over = self.conversation.sent == self.frames && self.conversation.is_over();
        self.over = over.then(|| self.over.unwrap_or(at));
    }

    /// How far to go at once, so that a play with faults does not go past its end.
    fn stride(&self) -> Option<Instant> {
        let engine = self.rig.engine();
        (!engine.is_undisturbed()).then(|| engine.frontier() + AFTER)
    }

    /// When the play ends, unless the rig is quiet before.
    fn deadline(&self, patience: Span) -> Instant {
        match self.over {
            Some(over) if !self.rig.engine().is_undisturbed() => over + AFTER,
            _ => self.accepted + patience,
        }
    }

    fn progress(&self) -> Progress<'_> {
        Progress { now: self.now, conversation: &self.conversation, facts: &self.facts }
    }

    /// Lets happen what is left, up to `now` unless the rig is quiet. Gives the last instant of the play: the one since
    /// which the rig is quiet, if it is.
    async fn settle(&mut self, now: Instant) -> Result<Instant, SessionError> {
        let end = if self.rig.engine().is_quiet() {
            let end = self.rig.engine().quiet_since();
            self.rig.catch_up(end.next()).await?;
            end
        } else {
            let until = self.rig.engine().frontier().max(now);
            self.bring_to(until).await?;
            until - Span::from_nanos(1)
        };
        self.take_note()?;
        Ok(end)
    }

    /// Brings every board to `until`: everything before that has happened, and has been noted.
    async fn bring_to(&mut self, until: Instant) -> Result<(), SessionError> {
        loop {
            self.rig.settle(until).await?;
            self.take_note()?;
            if !core::mem::take(&mut self.acted) {
                return Ok(());
            }
        }
    }

    fn finish(mut self, ended: Ended, end: Instant) -> Result<Played, SessionError> {
        let outcome = self.conversation.outcome(self.frames);
        let digest = self.digest.sum();
        let last = End { digest: digest.to_string(), at: end, outcome: outcome.name().to_owned() };
        if let Some(recorder) = &mut self.recorder {
            recorder.finish(&last)?;
        }
        if let Some(trace) = &mut self.trace {
            (trace.settled, trace.end) = (end.next(), Some(last));
        }
        let board = |(id, node): (NodeId, &crate::rig::Node)| PlayedBoard {
            name: node.name.clone(),
            pid: node.pid.unwrap_or_else(std::process::id),
            telemetry: self.telemetry.of(id),
            waits_for: self.rig.waits_for(id, &self.telemetry.values(id)),
        };
        Ok(Played {
            outcome,
            ended,
            end,
            digest,
            boards: self.rig.nodes().iter().enumerate().filter(|(id, _)| *id != self.rig.pc()).map(board).collect(),
            incidents: self.incidents,
            costs: self.rig.costs(),
            measured: self.rig.measured(),
            waveforms: self.waveforms,
            path: self.path,
            trace: self.trace,
            unfired: self.faults.unfired(&mut self.rig),
            conversation: self.conversation,
        })
    }
}

/// The program that is played where none is named: it turns a stepped shaft from bar stock.
pub const DEMONSTRATION: (&str, &str) = ("shaft.frames", include_str!("../builtin/shaft.frames"));
