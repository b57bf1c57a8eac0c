//! A live rig at its control socket: does what it is asked, and tells what happens to those who watch.

use std::sync::{Arc, PoisonError};
use std::time::Duration;

use serde::Serialize;
use torno_protocol::board::Stimulus;
use torno_protocol::time::Instant;

use super::Live;
use super::player::Player;
use crate::control::{
    Answer, Begun, BoardState, Call, Control, Done, FaultState, Form, KeptState, PartState, Request, Rows, State,
};
use crate::fault::{Planned, RawFault};
use crate::pace::Pace;
use crate::preview::Preview;
use crate::report::{EventSummary, FaultSummary};
use crate::saving::{Product, Saving};
use crate::session::{EndedBoard, SessionError};
use torno_bus::{Ears, Names};
use torno_engine::{Fact, Input};
use torno_part::outline;
use torno_text::{Complaint, Dice, nearest, of_toml, parse_span};
use torno_trace::Header;
use torno_trace::analyser::Analyser;
use torno_trace::rows::{Filter, Row, Wanted};

/// So many may watch at once. (Ours: each costs a few megabytes while it does not read.)
const WATCHERS_MAX: usize = 16;
/// The outline of a part is drawn so exactly, in mm.
const WITHIN: f64 = 0.005;

/// What a rig needs to be steered from outside.
pub(super) struct Steering {
    pub(super) control: Control,
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

/// What is wrong with a request, for people.
type Refused = String;

impl Steering {
    pub(super) fn new(control: Control, header: Header, names: Names) -> Self {
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
    pub(super) fn note(&mut self, inputs: &[Input], facts: &[Fact]) {
        self.ears.note(inputs, &[]);
        if let Some(last) = inputs.last() {
            // What was settled when it came is over: it need not be kept.
            self.ears.hear(last.given);
        }
        self.watchers.iter_mut().for_each(|watcher| watcher.analyser.note(inputs, facts));
    }

    /// The next thing that has been asked.
    fn next_call(&mut self) -> Option<Call> {
        self.put_off.take().or_else(|| self.control.try_call())
    }

    /// Whether anybody watches.
    pub(super) const fn is_watched(&self) -> bool {
        !self.watchers.is_empty()
    }

    /// Tells those who watch what has happened before `until`, to which every board has been brought.
    pub(super) fn tell(&mut self, until: Instant) {
        let header = &self.header;
        self.watchers.retain_mut(|watcher| watcher.tell(header, until));
    }

    /// Everything before `now` has happened: tells who has waited for that.
    pub(super) fn arrive(&mut self, now: Instant) {
        if let Some((_, answer)) = self.stepping.take_if(|(target, _)| *target <= now) {
            give(answer, Ok(done(now)));
        }
    }

    /// A step that is under way will not come to its end.
    fn end_step(&mut self, what: &str, now: Instant) {
        if let Some((target, answer)) = self.stepping.take() {
            give(answer, Err::<Done, _>(format!("the step to {target} is ended by a {what} at {now}")));
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

fn give<T: Serialize>(answer: Answer, result: Result<T, Refused>) {
    answer.give(result);
}

impl Live {
    /// Does what is asked.
    pub(super) async fn carry_out(&mut self, call: Call) -> Result<(), SessionError> {
        let Call { request, answer, rows } = call;
        let now = self.now();
        match request {
            Request::State => {
                self.settle(now).await?;
                give(answer, self.state(now));
            }
            Request::Fault { fault } => {
                // It may wait for what holds already.
                loop {
                    let happened = self.session.catch_up(now).await?;
                    self.deliver(&happened)?;
                    if !happened.more {
                        break;
                    }
                }
                give(answer, self.break_it(&fault, now));
            }
            Request::Heal { name } => give(answer, self.heal(&name, now)),
            Request::Power { board, on } => give(answer, self.power(&board, on, now)),
            Request::Pause => {
                self.end_step("pause", now);
                self.brake.pause(now);
                give(answer, Ok(done(now)));
            }
            Request::Resume => {
                self.end_step("resume", now);
                self.brake.resume(now);
                give(answer, Ok(done(now)));
            }
            Request::Step { span } => match parse_span(&span) {
                Ok(span) => self.step_on(now + span, answer),
                Err(message) => give(answer, Err::<Done, _>(message)),
            },
            Request::Pace { pace } => {
                let pace = pace.parse::<Pace>().map(|pace| {
                    self.brake.set_pace(pace, now);
                    done(now)
                });
                give(answer, pace);
            }
            Request::Play { program } => {
                let played = self.play(&program, now)?;
                give(answer, played.map(|()| done(now)));
            }
            Request::Stop => {
                let stopped = self.stop(now)?;
                give(answer, stopped.map(|()| done(now)));
            }
            Request::Part => {
                self.settle(now).await?;
                give(answer, self.part(now));
            }
            Request::Preview { program } => self.preview(program, answer),
            Request::Save { what } => self.save(what, answer, now).await?,
            Request::Watch { lines, boards, kinds, form } => {
                // What comes from then on is what happens from then on.
                self.settle(now).await?;
                let wanted = Wanted { from: now, to: None, lines, boards, kinds };
                let watched = self.steering.as_mut().map(|steering| steering.watch(&wanted, form, rows));
                give(answer, watched.unwrap_or(Ok(())).map(|()| done(now)));
            }
        }
        Ok(())
    }

    fn end_step(&mut self, what: &str, now: Instant) {
        if let Some(steering) = &mut self.steering {
            steering.end_step(what, now);
        }
    }

    fn step_on(&mut self, target: Instant, answer: Answer) {
        match &mut self.steering {
            Some(Steering { stepping: Some(_), .. }) => {
                give(answer, Err::<Done, _>("a step is under way already".to_owned()));
            }
            Some(steering) => {
                self.brake.pause(target);
                steering.stepping = Some((target, answer));
            }
            None => {}
        }
    }

    fn break_it(&mut self, text: &str, now: Instant) -> Result<Begun, Refused> {
        let invalid = |(_, message): Complaint| message;
        let raw: RawFault = toml::from_str(text).map_err(|error| invalid(of_toml(&error)))?;
        let Some(steering) = &mut self.steering else { return Err(String::new()) };
        // Noise is not the same twice.
        let planned = raw.plan(&steering.names, &mut Dice::new(steering.asked)).map_err(invalid)?;
        steering.asked += 1;
        let name = planned.fault.name.clone();
        let (faults, rig) = self.session.faults();
        if faults.active(rig, now).any(|(other, ..)| other == name) {
            return Err(format!("there is a fault '{name}' already: heal it, or give this one another name"));
        }
        let since = self.session.plan_one(&planned, now);
        Ok(Begun { name, since: since.map(Instant::as_nanos) })
    }

    fn heal(&mut self, name: &str, now: Instant) -> Result<Done, Refused> {
        let (faults, rig) = self.session.faults();
        if faults.disarm(rig, name) {
            return Ok(done(now));
        }
        let healed = faults.heal(rig, name, now);
        healed.map(done).map_err(|error| format!("the fault '{name}': {error}"))
    }

    fn power(&mut self, board: &str, on: bool, now: Instant) -> Result<Done, Refused> {
        let boards: Vec<&str> = self.rig().nodes().iter().map(|node| node.name.as_str()).collect();
        let Some(place) = boards.iter().position(|name| *name == board) else {
            return Err(format!("there is no board '{board}'{}", nearest(board, &boards)));
        };
        Ok(done(self.session.stimulate(place, now, Stimulus::Power(on))))
    }

    fn state(&mut self, now: Instant) -> Result<State, Refused> {
        let nanos = |at: Instant| at.as_nanos();
        let fault = |(name, since, until): (&str, Option<Instant>, Option<Instant>)| FaultState {
            name: name.to_owned(),
            since: since.map(nanos),
            until: until.map(nanos),
        };
        let (faults, rig) = self.session.faults();
        let faults = faults.active(rig, now).map(fault).collect();
        let Some(steering) = &self.steering else { return Err(String::new()) };
        let processes = |name: &str| {
            let place = self.rig().layout().board(name).unwrap_or_default();
            self.rig().engine().life(place).to_string()
        };
        let board = |board: EndedBoard| BoardState {
            process: processes(&board.name),
            name: board.name,
            pid: board.pid,
            waits_for: board.waits_for,
            telemetry: board.telemetry,
        };
        Ok(State {
            rig: steering.header.rig.clone(),
            ns: now.as_nanos(),
            pace: self.brake.pace().to_string(),
            paused: self.brake.paused().is_some(),
            boards: self.session.nodes().into_iter().map(board).collect(),
            faults,
            program: self.program.as_ref().map(Player::state),
            kept: self.session.spooled().map(|spool| {
                let (bytes, of) = spool.size();
                KeptState { bytes, of, until: spool.over().map(Instant::as_nanos) }
            }),
        })
    }

    fn part(&mut self, now: Instant) -> Result<PartState, Refused> {
        let rig = self.steering.as_ref().map_or("", |steering| steering.header.rig.as_str());
        let none = || format!("no part of the rig '{rig}' is cut while it runs: expected 'torno up --page'");
        let path = self.path.as_mut().ok_or_else(none)?;
        path.cut_before(now);
        let turned = path.turned();
        Ok(PartState {
            outline: outline(&turned.profile.radii(), WITHIN).iter().map(|corner| (corner.z, corner.x)).collect(),
            events: turned.happenings.iter().map(EventSummary::from).collect(),
        })
    }

    /// Looks at a program that is not played yet. The rig goes on meanwhile.
    fn preview(&self, program: String, answer: Answer) {
        let (file, rehearsal) = (Arc::clone(&self.file), Arc::clone(&self.rehearsal));
        std::thread::spawn(move || {
            let _one = rehearsal.lock().unwrap_or_else(PoisonError::into_inner);
            give(answer, Ok(Preview::of(&file, &program)));
        });
    }

    /// Makes something of what has happened so far. The rig goes on meanwhile.
    async fn save(&mut self, product: Product, answer: Answer, now: Instant) -> Result<(), SessionError> {
        if let Err(why) = product.check(&self.file) {
            give(answer, Err::<Done, _>(why));
            return Ok(());
        }
        let rig = self.file.name.clone();
        let until = self.session.earliest_end(now);
        self.settle(until).await?;
        let so_far = match self.session.so_far(until) {
            Ok(Some(so_far)) => so_far,
            Ok(None) => {
                give(answer, Err::<Done, _>("nothing is kept: expected 'torno up' without '--keep 0'".to_owned()));
                return Ok(());
            }
            Err(error) => {
                give(answer, Err::<Done, _>(format!("what is kept cannot be read: {error}")));
                return Ok(());
            }
        };
        let saving = Saving { product, faults: FaultSummary::of(self.session.begun()), so_far };
        std::thread::spawn(move || match saving.make(&rig) {
            Ok(saved) => answer.hand(saving.so_far.until.as_nanos(), saved),
            Err(why) => give(answer, Err::<Done, _>(why)),
        });
        Ok(())
    }

    /// Takes faults that begin by themselves, for a rig that does not run yet.
    pub fn plan(&mut self, planned: &[Planned]) {
        self.session.plan(planned);
    }

    /// Lets the rig be steered from outside. For a rig that does not run yet.
    pub fn steer(&mut self, control: Control, header: Header, names: Names) {
        self.steering = Some(Steering::new(control, header, names));
    }

    /// A request has come: it is seen to when time has come to where it is now.
    pub(super) fn put_off(&mut self, call: Call) {
        if let Some(steering) = &mut self.steering {
            steering.put_off = Some(call);
        }
    }

    /// Does all that has been asked meanwhile. What is asked is of the instant at which it is asked: at a pace, time
    /// must be `up_to_date`, that is where the wall clock is, unless that takes longer than somebody can be kept
    /// waiting. Says whether anything was done.
    pub(super) async fn obey_due(&mut self, up_to_date: bool) -> Result<bool, SessionError> {
        let held_back = self.brake.paused().is_none() && self.brake.pace() != Pace::Max;
        if held_back && !up_to_date && !self.asked.is_over(Duration::ZERO) {
            return Ok(false);
        }
        let mut obeyed = false;
        while let Some(call) = self.steering.as_mut().and_then(Steering::next_call) {
            self.carry_out(call).await?;
            obeyed = true;
        }
        Ok(obeyed)
    }
}

/// Waits for something to be asked; for ever, if nobody can. Cancel-safe.
pub(super) async fn next_call(steering: &mut Option<Steering>) -> Call {
    match steering {
        Some(steering) => steering.control.call().await,
        None => std::future::pending().await,
    }
}
