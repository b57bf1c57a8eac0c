//! Steering a session that runs: does what it is asked, and tells what happens to those who watch.

mod shown;

pub use shown::{Role, Shown};

use std::time::Duration;

use torno_protocol::board::Stimulus;
use torno_protocol::time::{Instant, Span};

use crate::control::{
    Answer, Begun, BoardState, Call, Control, Done, FaultState, Form, KeptState, PartState, ProgramState, Request,
    Rows, State,
};
use crate::fault::RawFault;
use crate::pace::{Brake, Pace};
use crate::report::EventSummary;
use crate::session::{EndedBoard, Session};
use torno_bus::{Ears, Names};
use torno_engine::{Fact, Input};
use torno_machines::workpiece::ToolPath;
use torno_part::outline;
use torno_text::{Complaint, Dice, nearest, of_toml, parse_span};
use torno_trace::Header;
use torno_trace::analyser::Analyser;
use torno_trace::rows::{Filter, Row, Wanted};

/// Boards that nothing reaches are brought up to date this often, so that none has long to catch up when something
/// does.
pub(crate) const KEEP_UP: Span = Span::from_secs(10);
/// While somebody watches, so often in wall time. (Ours: at once, to the eye.)
pub(crate) const WATCHED: Duration = Duration::from_millis(20);
/// So long, in wall time, the rig goes on at once: then whoever wants something of it has a turn.
pub(crate) const AT_ONCE: Duration = Duration::from_millis(20);
/// So many may watch at once. (Ours: each costs a few megabytes while it does not read.)
const WATCHERS_MAX: usize = 16;
/// The outline of a part is drawn so exactly, in mm.
const WITHIN: f64 = 0.005;

/// What a session needs to be steered from outside.
pub(crate) struct Steering {
    control: Control,
    header: Header,
    names: Names,
    watchers: Vec<Watcher>,
    /// They know how the receivers are by now, and hear no edges: who begins to watch begins with them.
    ears: Ears,
    /// Where time is to stand still, and who waits for that.
    stepping: Option<(Instant, Answer)>,
    /// So many faults have been asked for.
    asked: u64,
    /// A request that has come and is not seen to yet.
    put_off: Option<Call>,
}

/// Somebody who watches.
struct Watcher {
    analyser: Analyser,
    form: Form,
    rows: Rows,
}

/// What is steered.
pub(crate) struct Scene<'a> {
    /// The session.
    pub(crate) session: &'a mut Session,
    /// What holds its time back.
    pub(crate) brake: &'a mut Brake,
    /// The way of the tool, if somebody wants to see the part.
    pub(crate) path: Option<&'a mut ToolPath>,
    /// The program that is played, or was.
    pub(crate) program: Option<ProgramState>,
    /// Time has come to here.
    pub(crate) now: Instant,
}

/// How far the boards must have come before a request is served.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Before {
    /// It does not matter.
    Anything,
    /// What holds by now is known: the session has caught up.
    CaughtUp,
    /// Everything before now has been noted: the session has been settled.
    Settled,
}

impl Before {
    pub(crate) const fn of(request: &Request) -> Self {
        match request {
            // What is watched from then on is what happens from then on.
            Request::State | Request::Part | Request::Watch { .. } => Self::Settled,
            // It may wait for what holds already.
            Request::Fault { .. } => Self::CaughtUp,
            _ => Self::Anything,
        }
    }
}

/// What is wrong with a request, for people.
type Refused = String;

impl Steering {
    pub(crate) fn new(control: Control, header: Header, names: Names) -> Self {
        Self {
            control,
            ears: Ears::new(&header.layout),
            header,
            names,
            watchers: Vec::new(),
            stepping: None,
            asked: 0,
            put_off: None,
        }
    }

    /// Takes note of what came from outside and of what happened.
    pub(crate) fn note(&mut self, inputs: &[Input], facts: &[Fact]) {
        self.ears.note(inputs, &[]);
        if let Some(last) = inputs.last() {
            // What was settled when it came is over: it need not be kept.
            self.ears.hear(last.given);
        }
        self.watchers.iter_mut().for_each(|watcher| watcher.analyser.note(inputs, facts));
    }

    /// The next thing that has been asked.
    pub(crate) fn next_call(&mut self) -> Option<Call> {
        self.put_off.take().or_else(|| self.control.try_call())
    }

    /// Whether anybody watches.
    pub(crate) const fn is_watched(&self) -> bool {
        !self.watchers.is_empty()
    }

    /// Tells those who watch what has happened before `until`, to which every board has been brought.
    pub(crate) fn tell(&mut self, until: Instant) {
        let header = &self.header;
        self.watchers.retain_mut(|watcher| watcher.tell(header, until));
    }

    /// Everything before `now` has happened: tells who has waited for that.
    pub(crate) fn arrive(&mut self, now: Instant) {
        if let Some((_, answer)) = self.stepping.take_if(|(target, _)| *target <= now) {
            answer.give(Ok(done(now)));
        }
    }

    /// A step that is under way will not come to its end.
    fn end_step(&mut self, what: &str, now: Instant) {
        if let Some((target, answer)) = self.stepping.take() {
            answer.give(Err::<Done, _>(format!("the step to {target} is ended by a {what} at {now}")));
        }
    }

    fn watch(&mut self, wanted: &Wanted, form: Form, rows: Rows) -> Result<(), Refused> {
        self.watchers.retain(|watcher| !watcher.rows.is_closed());
        if self.watchers.len() >= WATCHERS_MAX {
            return Err(format!("{WATCHERS_MAX} watch already: expected no more"));
        }
        let filter = Filter::new(&self.header, wanted).map_err(|error| error.to_string())?;
        let mut analyser = Analyser::new(&self.header, filter, torno_machines::dialect).with_ears(&self.ears);
        // That was before anybody watched.
        analyser.take(wanted.from);
        self.watchers.push(Watcher { analyser, form, rows });
        Ok(())
    }

    /// Waits for something to be asked. Cancel-safe.
    async fn call(&mut self) -> Call {
        self.control.call().await
    }

    /// It is over: whoever asks later is told how it was at the end.
    pub(crate) fn end(&self, mut scene: Scene<'_>) {
        let part = self.part(scene.path.take(), scene.now).ok();
        self.control.end(&self.state(scene), part.as_ref());
    }

    /// A request has come: it is seen to when time has come to where it is now.
    pub(crate) fn put_off(&mut self, call: Call) {
        self.put_off = Some(call);
    }

    /// Does what is asked. The boards have come as far as it [needs](Before).
    pub(crate) fn carry_out(&mut self, call: Call, scene: Scene<'_>) {
        let Call { request, answer, rows } = call;
        let now = scene.now;
        match request {
            Request::State => answer.give(Ok(self.state(scene))),
            Request::Fault { fault } => answer.give(self.break_it(&fault, scene)),
            Request::Heal { name } => answer.give(heal(&name, scene)),
            Request::Power { board, on } => answer.give(power(&board, on, scene)),
            Request::Pause => {
                self.end_step("pause", now);
                scene.brake.pause(now);
                answer.give(Ok(done(now)));
            }
            Request::Resume => {
                self.end_step("resume", now);
                scene.brake.resume(now);
                answer.give(Ok(done(now)));
            }
            Request::Step { span } => match parse_span(&span) {
                Ok(span) => self.step_on(now + span, answer, scene.brake),
                Err(message) => answer.give(Err::<Done, _>(message)),
            },
            Request::Pace { pace } => {
                let pace = pace.parse::<Pace>().map(|pace| {
                    scene.brake.set_pace(pace, now);
                    done(now)
                });
                answer.give(pace);
            }
            Request::Part => answer.give(self.part(scene.path, now)),
            Request::Watch { lines, boards, kinds, form } => {
                let wanted = Wanted { from: now, to: None, lines, boards, kinds };
                answer.give(self.watch(&wanted, form, rows).map(|()| done(now)));
            }
            Request::Play { .. } | Request::Stop | Request::Preview { .. } | Request::Save { .. } => {
                answer.give(Err::<Done, _>("this is for a rig that is up: expected 'torno up'".to_owned()));
            }
        }
    }

    fn step_on(&mut self, target: Instant, answer: Answer, brake: &mut Brake) {
        if self.stepping.is_some() {
            return answer.give(Err::<Done, _>("a step is under way already".to_owned()));
        }
        brake.pause(target);
        self.stepping = Some((target, answer));
    }

    fn break_it(&mut self, text: &str, Scene { session, now, .. }: Scene<'_>) -> Result<Begun, Refused> {
        let invalid = |(_, message): Complaint| message;
        let raw: RawFault = toml::from_str(text).map_err(|error| invalid(of_toml(&error)))?;
        // Noise is not the same twice.
        let planned = raw.plan(&self.names, &mut Dice::new(self.asked)).map_err(invalid)?;
        self.asked += 1;
        let name = planned.fault.name.clone();
        let (faults, rig) = session.faults();
        if faults.active(rig, now).any(|(other, ..)| other == name) {
            return Err(format!("there is a fault '{name}' already: heal it, or give this one another name"));
        }
        let since = session.plan_one(&planned, now);
        Ok(Begun { name, since: since.map(Instant::as_nanos) })
    }

    fn state(&self, Scene { session, brake, program, now, .. }: Scene<'_>) -> State {
        let nanos = |at: Instant| at.as_nanos();
        let fault = |(name, since, until): (&str, Option<Instant>, Option<Instant>)| FaultState {
            name: name.to_owned(),
            since: since.map(nanos),
            until: until.map(nanos),
        };
        let (faults, rig) = session.faults();
        let faults = faults.active(rig, now).map(fault).collect();
        let rig = session.rig();
        let processes = |name: &str| {
            let place = rig.layout().board(name).unwrap_or_default();
            rig.engine().life(place).to_string()
        };
        let board = |board: EndedBoard| BoardState {
            process: processes(&board.name),
            name: board.name,
            pid: board.pid,
            waits_for: board.waits_for,
            telemetry: board.telemetry,
        };
        State {
            rig: self.header.rig.clone(),
            ns: now.as_nanos(),
            pace: brake.pace().to_string(),
            paused: brake.paused().is_some(),
            boards: session.nodes().into_iter().map(board).collect(),
            faults,
            program,
            kept: session.spooled().map(|spool| {
                let (bytes, of) = spool.size();
                KeptState { bytes, of, until: spool.over().map(Instant::as_nanos) }
            }),
        }
    }

    fn part(&self, path: Option<&mut ToolPath>, now: Instant) -> Result<PartState, Refused> {
        let rig = &self.header.rig;
        let none = || format!("no part of the rig '{rig}' is cut while it runs: expected 'torno up --page'");
        let path = path.ok_or_else(none)?;
        path.cut_before(now);
        let turned = path.turned();
        Ok(PartState {
            outline: outline(&turned.profile.radii(), WITHIN).iter().map(|corner| (corner.z, corner.x)).collect(),
            events: turned.happenings.iter().map(EventSummary::from).collect(),
        })
    }
}

impl Watcher {
    /// Says whether anybody still watches.
    fn tell(&mut self, header: &Header, until: Instant) -> bool {
        let (analyser, form) = (&mut self.analyser, self.form);
        let text = |row: Row| match form {
            Form::Json => row.json(header).to_string(),
            Form::Text => row.text(header, false),
            Form::Colour => row.text(header, true),
        };
        let due = analyser.take(until);
        due.into_iter().for_each(|row| self.rows.tell(text(row)));
        !self.rows.is_closed()
    }
}

const fn done(at: Instant) -> Done {
    Done { ns: at.as_nanos() }
}

/// Answers that something was done at `now`, or why it was not.
pub(crate) fn tell_done(answer: Answer, result: Result<(), Refused>, now: Instant) {
    answer.give(result.map(|()| done(now)));
}

fn heal(name: &str, Scene { session, now, .. }: Scene<'_>) -> Result<Done, Refused> {
    let (faults, rig) = session.faults();
    if faults.disarm(rig, name) {
        return Ok(done(now));
    }
    let healed = faults.heal(rig, name, now);
    healed.map(done).map_err(|error| format!("the fault '{name}': {error}"))
}

fn power(board: &str, on: bool, Scene { session, now, .. }: Scene<'_>) -> Result<Done, Refused> {
    let boards: Vec<&str> = session.rig().nodes().iter().map(|node| node.name.as_str()).collect();
    let Some(place) = boards.iter().position(|name| *name == board) else {
        return Err(format!("there is no board '{board}'{}", nearest(board, &boards)));
    };
    Ok(done(session.stimulate(place, now, Stimulus::Power(on))))
}

/// Waits for something to be asked; for ever, if nobody can. Cancel-safe.
pub(crate) async fn next_call(steering: &mut Option<Steering>) -> Call {
    match steering {
        Some(steering) => steering.call().await,
        None => std::future::pending().await,
    }
}
