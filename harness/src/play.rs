//! Plays a whole program through a rig, as a PC with flow control would, and tells how it ended.

use torno_protocol::board::Stimulus;
use torno_protocol::lathe::{Conversation, Outcome, Program, Reply, ReplyDecoder};
use torno_protocol::time::{Instant, Span};

use crate::engine::{Disturbance, Fact, Limit, NodeId};
use crate::observe::{Digest, Sum, Telemetry, ToolPath, Waveforms, log};
use crate::pace::{Brake, Pace};
use crate::pc::{PcEvent, PcProgram, PcUart};
use crate::rig::file::RigFile;
use crate::rig::{Cost, Driver, Incident, Rig, RigError};
use crate::trace::{End, Header, RECORDED, Recorder, SessionError, Trace};

/// The PC starts to send so long after the rig has started, or later where characters are long: a decoder wants to see
/// an idle line first.
const PROGRAM_START: Span = Span::from_millis(10);
/// Steps between two looks at what may end the run.
const STEPS_PER_LOOK: u32 = 64;
/// Unless something else is asked for, a play is given up when the PC has neither sent nor heard anything for so long.
/// (Ours: the longest motion of the lathe, 65 535 counts at a count every 30 ms, takes 33 minutes.)
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
    pub breakages: Vec<Breakage>,
    /// Whether to keep the waveforms of all lines.
    pub waveforms: bool,
    /// Whether to measure what wall time is spent on.
    pub measure: bool,
    /// What heads the trace that is to be kept in memory, if one is.
    pub keep: Option<Header>,
    /// It is given up when the PC has neither sent nor heard anything for so long, in virtual time.
    pub patience: Span,
}

/// Why a play ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// Nothing more can happen.
    Quiet,
    /// The PC has neither sent nor heard anything for as long as it was to be waited for.
    OutOfPatience,
    /// It was to end.
    Interrupted,
}

/// Something that breaks at an instant.
#[derive(Clone, Debug)]
pub enum Breakage {
    /// A line is cut.
    Cut {
        /// The line's name.
        line: String,
        /// When.
        at: Instant,
    },
    /// A board gets a stimulus.
    Stimulus {
        /// The board's name.
        board: String,
        /// When.
        at: Instant,
        /// What.
        stimulus: Stimulus,
    },
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
}

impl Played {
    /// In words, why it ended before the rig was quiet; nothing, if it did not.
    pub fn cut_short(&self) -> Option<String> {
        let why = match self.ended {
            Ended::Quiet => return None,
            Ended::OutOfPatience => "given up: the PC has heard nothing for long",
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
    /// When the PC has sent or heard something last.
    spoke: Instant,
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
            breakages: Vec::new(),
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
        let pc = &self.file.pc;
        let uart = PcUart::new(pc.baud, pc.tx_fifo, pc.clock).with_program(Careful::default());
        let mut rig = Rig::start(&self.file, &self.driver, uart).await?;
        if self.pace == Pace::Max {
            rig.share_one_processor();
        }
        if self.measure {
            rig.measure();
        }
        for breakage in &self.breakages {
            break_it(&mut rig, breakage)?;
        }
        let pc = rig.pc();
        let start = Instant::START + PROGRAM_START.max(self.file.margin());
        rig.stimulate(pc, start, Stimulus::Write(self.program.bytes()));
        let path = self.file.part.as_ref().map(ToolPath::new);
        let mut session = Session::new(rig, self.waveforms, path, recorder);
        session.trace = self.keep.map(Trace::new);
        let mut brake = Brake::new(self.pace).map_err(RigError::from)?;
        let keep_up = session.recorder.as_ref().and_then(|_| brake.span_of(RECORDED));
        let mut kept_up = Instant::START;
        let mut interrupted = std::pin::pin!(interrupted);
        let ended = 'play: loop {
            let patience = session.spoke + self.patience;
            let limit = if self.pace == Pace::Max { Limit::until(patience) } else { brake.limit() };
            let limit = limit.earlier(Some(patience));
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
            if session.rig.engine().is_quiet() {
                break Ended::Quiet;
            }
            if limit.until == session.spoke + self.patience {
                break Ended::OutOfPatience;
            }
            if self.pace == Pace::Max {
                continue;
            }
            let mut next = session.rig.engine().next_instant();
            if let Some(every) = keep_up {
                if limit.until >= kept_up + every {
                    kept_up = limit.until;
                    session.rig.settle(kept_up).await?;
                    session.take_note()?;
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
            Ended::Interrupted if self.pace != Pace::Max => brake.limit().until,
            Ended::OutOfPatience => session.spoke + self.patience,
            Ended::Interrupted | Ended::Quiet => Instant::START,
        };
        let end = session.settle(ended, now).await?;
        progress(session.progress());
        session.finish(self.program.frames.len(), ended, end)
    }
}

fn break_it(rig: &mut Rig, breakage: &Breakage) -> Result<(), RigError> {
    let unknown = |name: &str| RigError::Unknown { name: name.to_owned() };
    match breakage {
        Breakage::Cut { line, at } => {
            let id = rig.lines().iter().position(|name| name == line).ok_or_else(|| unknown(line))?;
            _ = rig.disturb(id, *at, &Disturbance::Cut);
        }
        Breakage::Stimulus { board, at, stimulus } => {
            let id = rig.nodes().iter().position(|node| node.name == *board).ok_or_else(|| unknown(board))?;
            rig.stimulate(id, *at, stimulus.clone());
        }
    }
    Ok(())
}

impl Session {
    fn new(rig: Rig, waveforms: bool, path: Option<ToolPath>, recorder: Option<Recorder>) -> Self {
        Self {
            digest: Digest::new(&rig),
            telemetry: Telemetry::new(&rig),
            waveforms: waveforms.then(|| Waveforms::new(&rig)),
            path,
            recorder,
            trace: None,
            rig,
            decoder: ReplyDecoder::default(),
            conversation: Conversation::default(),
            facts: Vec::new(),
            bytes_sent: 0,
            now: Instant::START,
            spoke: Instant::START,
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
                    self.spoke = self.spoke.max(*at);
                    self.listen(PcEvent::from_numbers(*event, *value));
                }
            }
        }
        self.facts = facts;
        self.now = self.now.max(self.rig.engine().frontier());
        Ok(())
    }

    fn listen(&mut self, event: Option<PcEvent>) {
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
    }

    fn progress(&self) -> Progress<'_> {
        Progress { now: self.now, conversation: &self.conversation, facts: &self.facts }
    }

    /// Lets happen what is left, up to `now` unless the rig is quiet. Gives the last instant of the play: the one since
    /// which the rig is quiet, if it is.
    async fn settle(&mut self, ended: Ended, now: Instant) -> Result<Instant, SessionError> {
        let end = if ended == Ended::Quiet {
            let end = self.rig.engine().quiet_since();
            self.rig.catch_up(end.next()).await?;
            end
        } else {
            let until = self.rig.engine().frontier().max(now);
            self.rig.settle(until).await?;
            until - Span::from_nanos(1)
        };
        self.take_note()?;
        Ok(end)
    }

    fn finish(mut self, frames: usize, ended: Ended, end: Instant) -> Result<Played, SessionError> {
        let outcome = self.conversation.outcome(frames);
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
            conversation: self.conversation,
        })
    }
}

/// The program that is played where none is named: it turns a stepped shaft from bar stock.
pub const DEMONSTRATION: (&str, &str) = ("shaft.frames", include_str!("../builtin/shaft.frames"));
