//! Plays a whole program through a rig, as a PC with flow control would, and tells how it ended.

use std::pin::{Pin, pin};

use torno_engine::{Fact, NodeId};
use torno_machines::workpiece::ToolPath;
use torno_protocol::board::{Kept, Stimulus};
use torno_protocol::lathe::Program;
use torno_protocol::time::{Instant, Span};
use torno_trace::{Header, Trace, Waveforms};

use crate::fault::{Planned, Unfired};
use crate::job::{FrameJob, Job, Outcome};
use crate::pace::Pace;
use crate::recorder::Recorder;
use crate::rig::file::RigFile;
use crate::rig::{Cost, Driver, Incident};
use crate::session::{self, Audience, EndedBoard, Exchange, Happened, INTERRUPTED, Session, SessionError};

/// The PC starts to send so long after the rig has started, or later where characters are long: a decoder wants to see
/// an idle line first.
const PROGRAM_START: Span = Span::from_millis(10);
/// Steps between two looks at what may end the run.
const STEPS_PER_LOOK: u32 = 64;
/// A program that is over in a rig with faults is left to run for so long: noise has no end.
const AFTER: Span = Span::from_secs(1);
/// Unless something else is asked for, a play is given up when nothing of the program has been accepted for so long.
/// (Ours: the longest motion of the lathe, 65 535 counts at a count every 30 ms, takes 33 minutes.)
pub const PATIENCE: Span = Span::from_secs(3_600);

/// What is to be played, and how.
#[derive(Clone, Debug)]
pub struct Play<J = FrameJob> {
    /// The rig.
    pub file: RigFile,
    /// What the PC does.
    pub job: J,
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
    /// The boards of which is asked at the end what they keep without power.
    pub keepers: Vec<NodeId>,
    /// It is given up when nothing of the program has been accepted for so long, in virtual time.
    pub patience: Span,
    /// Whether nothing of it is logged: somebody is only to be shown what would come of it.
    pub quiet: bool,
    /// Time goes no further at once, in virtual time. Nothing may depend on it: this is how that is proved.
    pub slice: Option<Span>,
}

/// Why a play ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlayEnd {
    /// The program is over, and nothing more happens, but for faults.
    Over,
    /// No frame has been accepted for as long as it was to be waited for.
    OutOfPatience,
    /// It was to end.
    Interrupted,
}

impl PlayEnd {
    /// The word for how a play ended that came to `outcome`.
    const fn of(self, outcome: Outcome) -> &'static str {
        match self {
            Self::Interrupted => INTERRUPTED,
            Self::Over | Self::OutOfPatience => outcome.name(),
        }
    }
}

/// How far a play has come.
#[derive(Clone, Copy, Debug)]
pub struct Progress<'a, J = FrameJob> {
    /// Everything before this has happened.
    pub now: Instant,
    /// What the PC does, and how far it has come.
    pub job: &'a J,
    /// What has happened since the last time.
    pub facts: &'a [Fact],
}

/// How a play ended.
pub struct Played<J = FrameJob> {
    /// What the PC did.
    pub job: J,
    /// How the program ended.
    pub outcome: Outcome,
    /// Why the play did.
    pub ended: PlayEnd,
    /// From the first byte that was sent until the controller told that it is idle, all of the program being answered.
    pub idle_after: Option<Span>,
    /// The virtual time it took until the rig was quiet, or the play ended.
    pub end: Instant,
    /// The digest of everything that happened.
    pub digest: String,
    /// The boards: name, process, last telemetry.
    pub boards: Vec<EndedBoard>,
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
    /// What the boards keep without power that were to be asked.
    pub kept: Vec<Option<Kept>>,
    /// The faults that have begun, and when.
    pub begun: Vec<(String, Instant)>,
    /// The faults that have not fired.
    pub unfired: Vec<Unfired>,
}

impl<J> Played<J> {
    /// The word for how it ended.
    pub const fn outcome(&self) -> &'static str {
        self.ended.of(self.outcome)
    }

    /// In words, why it ended before the rig was quiet; nothing, if it did not.
    pub fn cut_short(&self) -> Option<String> {
        let why = match self.ended {
            PlayEnd::Over => return None,
            PlayEnd::OutOfPatience => "given up: nothing has been accepted for long",
            PlayEnd::Interrupted => INTERRUPTED,
        };
        let waits = self.boards.iter().filter(|board| !board.waits_for.is_empty());
        let waits = waits.map(|board| format!("{} waits for {}", board.name, board.waits_for.join(", ")));
        let waits = waits.collect::<Vec<_>>().join("; ");
        Some(if waits.is_empty() { why.to_owned() } else { format!("{why}; {waits}") })
    }
}

/// The state of the controller at the PC's port, if it is one.
struct Controller {
    /// The board, and the quantity that tells the state.
    state: Option<(NodeId, u8)>,
    idle_since: Option<Instant>,
}

impl Controller {
    fn of(file: &RigFile, states: &[&str]) -> Self {
        let state = file.state().filter(|_| !states.is_empty());
        Self { state, idle_since: state.map(|_| Instant::START) }
    }

    fn take(&mut self, fact: &Fact) {
        let Fact::Telemetry { node, at, signal, value } = fact else { return };
        if self.state == Some((*node, *signal)) {
            // Idle is the first state.
            self.idle_since = (*value == 0).then_some(*at);
        }
    }
}

/// What the player makes of a session.
struct Player<J> {
    waveforms: Option<Waveforms>,
    path: Option<ToolPath>,
    job: J,
    controller: Controller,
    facts: Vec<Fact>,
    now: Instant,
    /// Patience counts from here: when something has been accepted last, or the program was over last.
    accepted: Instant,
    /// When the first byte was sent.
    began: Option<Instant>,
    /// Since when the program is over, if it is.
    over: Option<Instant>,
    incidents: Vec<Incident>,
}

impl Play {
    /// A play of frames in which nothing breaks, as fast as can be.
    pub fn new(file: RigFile, program: Program, driver: Driver) -> Self {
        Self::of(file, FrameJob::new(program), driver)
    }
}

impl<J: Job> Play<J> {
    /// A play in which nothing breaks, as fast as can be.
    pub const fn of(file: RigFile, job: J, driver: Driver) -> Self {
        Self {
            file,
            job,
            driver,
            pace: Pace::Max,
            faults: Vec::new(),
            waveforms: false,
            measure: false,
            keep: None,
            keepers: Vec::new(),
            patience: PATIENCE,
            quiet: false,
            slice: None,
        }
    }

    /// Plays to the end: until the rig is quiet, or for as long as its [patience](Self::patience) lasts.
    ///
    /// # Errors
    /// [`SessionError`] if the rig itself breaks.
    pub async fn run(self, progress: impl FnMut(Progress<'_, J>)) -> Result<Played<J>, SessionError> {
        self.record(None, progress, std::future::pending()).await
    }

    /// The same, and records it; or until `interrupted`.
    ///
    /// # Errors
    /// [`SessionError`] if the rig itself breaks, or the recording cannot go on.
    pub async fn record(
        self,
        recorder: Option<Recorder>,
        progress: impl FnMut(Progress<'_, J>),
        interrupted: impl Future<Output = ()>,
    ) -> Result<Played<J>, SessionError> {
        self.show(recorder, None, progress, interrupted).await
    }

    /// The same for an audience, which then sets the pace.
    ///
    /// # Errors
    /// [`SessionError`] if the rig itself breaks, or the recording cannot go on.
    pub async fn show(
        self,
        recorder: Option<Recorder>,
        audience: Option<Box<dyn Audience>>,
        mut progress: impl FnMut(Progress<'_, J>),
        interrupted: impl Future<Output = ()>,
    ) -> Result<Played<J>, SessionError> {
        let uart = self.file.pc.uart().with_program(self.job.program());
        let session = Session::start(&self.file, &self.driver, uart).await?;
        let mut session = if self.quiet { session.quiet() } else { session };
        if let Some(audience) = audience {
            session.show(audience);
        } else if self.pace == Pace::Max {
            session.rig().share_one_processor();
        } else {
            session.set_pace(self.pace, Instant::START)?;
        }
        if self.measure {
            session.rig_mut().measure();
        }
        session.plan(&self.faults);
        let pc = session.rig().pc();
        let start = Instant::START + PROGRAM_START.max(self.file.margin());
        let first = self.job.first();
        if !first.is_empty() {
            session.stimulate(pc, start, Stimulus::Write(first));
        }
        if let Some(recorder) = recorder {
            session.record(recorder);
        }
        if let Some(header) = self.keep {
            session.keep(header);
        }
        session.ask_at_the_end(self.keepers);
        let mut player = Player {
            waveforms: self.waveforms.then(|| Waveforms::new(&self.file.layout)),
            path: self.file.part.as_ref().map(ToolPath::new),
            job: self.job,
            controller: Controller::of(&self.file, J::STATES),
            facts: Vec::new(),
            now: Instant::START,
            accepted: Instant::START,
            began: None,
            over: None,
            incidents: Vec::new(),
        };
        let mut kept_up = Instant::START;
        let mut interrupted = pin!(interrupted);
        let mut steps = 0;
        // Everything before this has happened.
        let mut reached = Instant::START;
        // Fixed until it has been reached: a host that falls behind must get to where it notices that.
        let mut allowed = session.allowed();
        let (ended, until) = loop {
            let deadline = player.deadline(&session, self.patience);
            let slice = self.slice.map(|slice| reached + slice);
            let mut limit = allowed.earlier(Some(deadline)).earlier(slice);
            if !self.faults.is_empty() || session.is_shown() {
                // No further than to where the play can end: what comes after that must not count.
                let end = session.active_until().next().min(reached + AFTER.min(self.patience));
                limit = limit.earlier(Some(end));
            }
            let happened = session.step(limit).await?;
            let more = happened.more;
            let before = player.take(happened);
            session.rig_mut().reuse(before);
            progress(player.progress());
            session.tell_program(player.job.reached());
            steps += 1;
            if (steps % STEPS_PER_LOOK == 0 || session.is_shown()) && has_come(interrupted.as_mut()).await {
                let now = if session.pace() == Pace::Max { Instant::START } else { session.allowed().until };
                break (PlayEnd::Interrupted, now.max(session.rig().engine().frontier()));
            }
            if more {
                continue;
            }
            reached = reached.max(limit.until);
            let quiet = session.quiet_since();
            if let Some(since) = quiet.filter(|since| *since < reached) {
                break (PlayEnd::Over, since.next());
            }
            if limit.until == player.deadline(&session, self.patience) {
                break (if player.over.is_some() { PlayEnd::Over } else { PlayEnd::OutOfPatience }, reached);
            }
            if session.pace() == Pace::Max {
                allowed = session.allowed();
                continue;
            }
            let next = session.rig().engine().next_instant().min(quiet.unwrap_or(deadline));
            let mut next = session.faults().0.next().map_or(next, |fault| fault.min(next));
            if let Some(every) = session.keep_up_every() {
                if limit.until >= kept_up + every {
                    kept_up = limit.until;
                    session.settle(kept_up, |happened| drop(player.take(happened))).await?;
                }
                next = next.min(kept_up + every);
            }
            tokio::select! {
                () = &mut interrupted => break (PlayEnd::Interrupted, session.allowed().until),
                waited = session.wait(next) => waited?,
            }
            allowed = session.allowed();
        };
        session.reach_end(until, |happened| drop(player.take(happened))).await?;
        progress(player.progress());
        let unfired = session.unfired();
        let outcome = player.job.outcome();
        let session::Ended { end, boards, trace, kept, begun, rig } = session.close(ended.of(outcome))?;
        Ok(Played {
            outcome,
            ended,
            idle_after: player.idle_after(),
            end: end.at,
            digest: end.digest,
            boards,
            incidents: player.incidents,
            costs: rig.costs(),
            measured: rig.measured(),
            waveforms: player.waveforms,
            path: player.path,
            trace,
            kept,
            begun,
            unfired,
            job: player.job,
        })
    }
}

impl<J: Job> Player<J> {
    /// Makes of what has happened what is to be made of it. Gives back the facts of the time before.
    fn take(&mut self, happened: Happened) -> Vec<Fact> {
        if let Some(waveforms) = &mut self.waveforms {
            happened.facts.iter().for_each(|fact| waveforms.add(fact));
        }
        if let Some(path) = &mut self.path {
            happened.facts.iter().for_each(|fact| path.add(fact));
        }
        happened.facts.iter().for_each(|fact| self.controller.take(fact));
        happened.pc().for_each(|(at, exchange)| self.listen(at, exchange));
        self.incidents.extend(happened.incidents);
        self.now = self.now.max(happened.settled);
        core::mem::replace(&mut self.facts, happened.facts)
    }

    fn listen(&mut self, at: Instant, exchange: &Exchange) {
        let accepted = self.job.accepted();
        self.began.get_or_insert(at);
        match exchange {
            Exchange::Sent(byte, _) => self.job.sent(at, *byte),
            Exchange::Received(byte, _) => self.job.received(*byte),
            Exchange::Garbled(_) => {}
        }
        if self.job.accepted() > accepted {
            self.accepted = at;
        }
        let over = self.job.is_over();
        if self.over.is_some() && !over {
            self.accepted = at;
        }
        self.over = over.then(|| self.over.unwrap_or(at));
    }

    fn idle_after(&self) -> Option<Span> {
        Some(self.controller.idle_since?.max(self.over?).since(self.began?))
    }

    /// When the play ends, unless the rig is quiet before.
    fn deadline(&self, session: &Session, patience: Span) -> Instant {
        let patient = self.accepted + patience;
        let Some(over) = self.over.map(|over| over.max(session.turned()) + AFTER) else { return patient };
        if session.rig().engine().is_undisturbed() { patient.max(over) } else { over }
    }

    fn progress(&self) -> Progress<'_, J> {
        Progress { now: self.now, job: &self.job, facts: &self.facts }
    }
}

/// Whether a future has come to its end by now. Others have their turn.
async fn has_come(future: Pin<&mut impl Future<Output = ()>>) -> bool {
    tokio::select! {
        biased;
        () = future => true,
        () = tokio::task::yield_now() => false,
    }
}
