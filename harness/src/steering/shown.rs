//! A session that is shown: somebody may watch it, hold its time, and do to it what fits what it is for.

use std::io;
use std::time::Duration;

use torno_engine::Limit;
use torno_machines::workpiece::ToolPath;
use torno_protocol::time::{Instant, Span};
use torno_trace::Header;

use super::{AT_ONCE, Before, KEEP_UP, Scene, Steering, WATCHED};
use crate::control::{Call, Control, Done, ProgramState, Request};
use crate::observe::log;
use crate::pace::{Brake, Lapse, Pace};
use crate::recorder::RECORDED;
use crate::rig::file::RigFile;
use crate::session::{Audience, Happened, Session, SessionError, Stepping};

/// What a session is for that is shown. It says what may be done to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// A rig that is up, with a port for any program.
    Up,
    /// It plays a program.
    Run,
    /// It repeats a recording.
    Replay,
    /// It is taken through a scenario.
    Test,
}

impl Role {
    /// The command that it comes from.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Up => "up",
            Self::Run => "run",
            Self::Replay => "replay",
            Self::Test => "test",
        }
    }

    /// Why something is not done that is asked.
    const fn refuses(self, request: &Request) -> Option<&'static str> {
        match request {
            Request::State
            | Request::Part
            | Request::Watch { .. }
            | Request::Pause
            | Request::Resume
            | Request::Step { .. }
            | Request::Pace { .. } => return None,
            Request::Fault { .. } | Request::Heal { .. } | Request::Power { .. } => {}
            Request::Play { .. } | Request::Stop | Request::Preview { .. } => {
                if let Self::Run = self {
                    return Some("a run plays its own program: expected a rig that is up, as by 'torno up --page'");
                }
            }
            Request::Save { .. } => {
                if let Self::Run = self {
                    return Some("a run writes its files at its end: expected options such as --record and --report");
                }
            }
        }
        match self {
            Self::Up | Self::Run => None,
            Self::Replay => Some("a replay repeats what was recorded: expected to watch, pause, step or set the pace"),
            Self::Test => Some("a scenario says what is done: expected to watch, pause, step or set the pace"),
        }
    }
}

/// Whoever watches a session through its page.
pub struct Shown {
    steering: Steering,
    role: Role,
    brake: Brake,
    /// The way of the tool, if the rig turns a part.
    path: Option<ToolPath>,
    /// The program that is played, if one is.
    program: Option<ProgramState>,
    /// Everything before this has happened.
    reached: Instant,
    /// Every board was brought to here last.
    kept_up: Instant,
    /// Since somebody could have asked for something.
    asked: Lapse,
    has_begun: bool,
}

impl Shown {
    /// Shows a session of this rig to whoever asks through `control`. It goes at this pace at first.
    ///
    /// # Errors
    /// If the system refuses a timer.
    pub fn new(control: Control, file: &RigFile, header: Header, role: Role, pace: Pace) -> io::Result<Self> {
        Ok(Self {
            steering: Steering::new(control, header, file.names()),
            role,
            brake: Brake::new(pace)?,
            path: file.part.as_ref().map(ToolPath::new),
            program: None,
            reached: Instant::START,
            kept_up: Instant::START,
            asked: Lapse::begin(AT_ONCE),
            has_begun: false,
        })
    }

    async fn step_on(&mut self, session: &mut Session, limit: Limit) -> Result<Happened, SessionError> {
        if !core::mem::replace(&mut self.has_begun, true) {
            // The boards have been started meanwhile.
            self.brake.set_pace(self.brake.pace(), Instant::START);
        }
        let until = self.brake.limit().until.min(limit.until);
        let mut happened = session.step(limit.earlier(Some(until))).await?;
        self.note(&happened);
        let arrived = !happened.more;
        let to = if arrived && !until.is_never() { until } else { session.rig().engine().frontier() };
        self.reached = self.reached.max(to);
        if !arrived && !self.asked.is_over(Duration::ZERO) {
            return Ok(happened);
        }
        if self.reached >= self.kept_up + self.keep_up_every(session) {
            happened = happened.followed_by(self.settle(session).await?);
            self.tell();
        }
        if arrived {
            self.steering.arrive(self.reached);
        }
        let (mut obeyed, mut changed) = (false, false);
        while let Some(call) = self.steering.next_call() {
            obeyed = true;
            changed |= matches!(call.request, Request::Fault { .. } | Request::Heal { .. } | Request::Power { .. });
            happened = happened.followed_by(self.carry_out(session, call).await?);
        }
        // Others have their turn, even if all boards are in this process.
        tokio::task::yield_now().await;
        let is_all = arrived && until == limit.until && !changed && happened.hits.is_empty();
        if arrived && !is_all && !obeyed {
            self.wait(session).await?;
        }
        Ok(Happened { more: !is_all, settled: session.rig().engine().frontier(), ..happened })
    }

    /// Brings every board to where time is.
    async fn settle(&mut self, session: &mut Session) -> Result<Happened, SessionError> {
        let mut happened = Happened::default();
        loop {
            let next = session.settle_on(self.reached).await?;
            self.note(&next);
            happened = happened.followed_by(next);
            if !happened.more {
                return Ok(happened);
            }
            tokio::task::yield_now().await;
        }
    }

    /// Everything has been noted up to where time is: tells those who watch.
    fn tell(&mut self) {
        self.kept_up = self.reached;
        if let Some(path) = &mut self.path {
            path.cut_before(self.reached);
        }
        self.steering.tell(self.reached);
    }

    /// Does what is asked, if it fits. Gives what has happened meanwhile.
    async fn carry_out(&mut self, session: &mut Session, call: Call) -> Result<Happened, SessionError> {
        if let Some(why) = self.role.refuses(&call.request) {
            call.answer.give(Err::<Done, _>(why.to_owned()));
            return Ok(Happened::default());
        }
        let happened = match Before::of(&call.request) {
            Before::Anything => Happened::default(),
            Before::CaughtUp | Before::Settled => self.settle(session).await?,
        };
        let Self { steering, brake, path, program, reached, .. } = self;
        let (path, program) = (path.as_mut(), program.clone());
        steering.carry_out(call, Scene { session, brake, path, program, now: *reached });
        Ok(happened)
    }

    /// Waits for something to do: not for long, so that whoever takes the session's steps has a turn.
    async fn wait(&mut self, session: &mut Session) -> Result<(), SessionError> {
        let next = session.rig().engine().next_instant().min(self.kept_up + self.keep_up_every(session));
        let next = session.faults().0.next().map_or(next, |fault| fault.min(next));
        if let Some(recorder) = session.recorder() {
            recorder.before_wait(self.brake.wall_until(next))?;
        }
        tokio::select! {
            biased;
            () = session.rig_mut().news() => {}
            passed = self.brake.wait_past(next) => {
                passed?;
                if let Some(behind) = self.brake.reached(next) {
                    log::behind(next, behind);
                }
            }
            call = self.steering.call() => self.steering.put_off(call),
            () = tokio::time::sleep(AT_ONCE) => {}
        }
        Ok(())
    }

    /// How far time may go before boards that nothing reaches are brought up to date.
    fn keep_up_every(&self, session: &Session) -> Span {
        let recorded = || session.is_recorded().then(|| self.brake.span_of(RECORDED)).flatten();
        match self.steering.is_watched() {
            true => self.brake.span_of(WATCHED).unwrap_or(Span::from_nanos(1)),
            false => recorded().map_or(KEEP_UP, |span| span.min(KEEP_UP)),
        }
    }
}

impl Audience for Shown {
    fn note(&mut self, happened: &Happened) {
        self.steering.note(&happened.inputs, &happened.facts);
        if let Some(path) = &mut self.path {
            happened.facts.iter().for_each(|fact| path.add(fact));
        }
    }

    fn tell_program(&mut self, accepted: usize, of: usize) {
        self.program = Some(ProgramState { accepted, of, outcome: None });
    }

    fn step<'a>(&'a mut self, session: &'a mut Session, limit: Limit) -> Stepping<'a> {
        Box::pin(self.step_on(session, limit))
    }

    fn end(&mut self, session: &mut Session, until: Instant) {
        self.reached = until;
        self.tell();
        let Self { steering, brake, path, program, .. } = self;
        let (path, program) = (path.as_mut(), program.clone());
        steering.end(Scene { session, brake, path, program, now: until });
    }
}
