//! Takes a rig through a scenario.

use std::collections::VecDeque;

use torno_protocol::board::{Stimulus, event_text};
use torno_protocol::time::{Instant, Span};

use super::{Action, Failure, Scenario, Step};
use crate::condition::{Claim, Condition, is_reply};
use crate::fault::{Fault, Unfired};
use crate::recorder::Recorder;
use crate::rig::{Driver, Rig};
use crate::session::{Audience, Exchange, Happened, Session, SessionError};
use torno_engine::{Fact, Hit, Limit, NodeId, REACTION, WatchId};
use torno_machines::workpiece::ToolPath;
use torno_trace::Trace;

/// The first step takes place so long after the rig has started.
const BEGIN: Span = Span::from_millis(10);
/// So many lines of what happened before are kept for a failure.
const CONTEXT: usize = 16;
/// So many are remembered: some may have come early.
const REMEMBERED: usize = 64;

/// How a scenario ended.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// What did not hold, and the faults that have not fired; nothing, if it passed.
    pub failures: Vec<Failure>,
    /// The digest of everything that happened.
    pub digest: String,
    /// The virtual time it took.
    pub end: Instant,
    /// What the PC heard.
    pub replies: Vec<String>,
    /// Everything that happened, if that was kept.
    pub trace: Option<Trace>,
}

/// What is kept of a run beside its outcome.
pub enum Keep {
    /// Nothing.
    Nothing,
    /// A recording.
    Recording(Recorder),
    /// Everything, in [`Outcome::trace`].
    Trace,
}

/// What a scenario has shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Everything held.
    Passed,
    /// Something did not.
    Failed,
    /// Nothing failed, but a fault has not fired: what was to be shown has not been.
    Inconclusive,
}

impl Verdict {
    /// The word for it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Passed => "passed",
            Self::Failed => "failed",
            Self::Inconclusive => "inconclusive",
        }
    }

    fn of(failures: &[Failure]) -> Self {
        match failures {
            [] => Self::Passed,
            failures if failures.iter().any(|failure| failure.conclusive) => Self::Failed,
            _ => Self::Inconclusive,
        }
    }
}

impl Outcome {
    /// What it has shown.
    pub fn verdict(&self) -> Verdict {
        Verdict::of(&self.failures)
    }

    /// The failure that is told first: one that shows something, if there is one.
    pub fn first_failure(&self) -> Option<&Failure> {
        self.failures.iter().find(|failure| failure.conclusive).or(self.failures.first())
    }
}

/// Runs a scenario.
///
/// # Errors
/// [`SessionError`] if the rig itself breaks.
pub async fn run(scenario: &Scenario, driver: &Driver) -> Result<Outcome, SessionError> {
    record(scenario, driver, Keep::Nothing).await
}

/// The same, and keeps something of it.
///
/// # Errors
/// [`SessionError`] if the rig itself breaks, or the recording cannot go on.
pub async fn record(scenario: &Scenario, driver: &Driver, keep: Keep) -> Result<Outcome, SessionError> {
    conduct(scenario, driver, keep, None, None).await
}

/// The same for an audience, which then sets the pace.
///
/// # Errors
/// [`SessionError`] if the rig itself breaks, or the recording cannot go on.
pub async fn show(
    scenario: &Scenario,
    driver: &Driver,
    keep: Keep,
    audience: Box<dyn Audience>,
) -> Result<Outcome, SessionError> {
    conduct(scenario, driver, keep, Some(audience), None).await
}

/// The same as [`run`], no further than `slice` at once. Nothing may depend on it: this is how that is proved.
///
/// # Errors
/// [`SessionError`] if the rig itself breaks.
pub async fn run_in_slices(scenario: &Scenario, driver: &Driver, slice: Span) -> Result<Outcome, SessionError> {
    conduct(scenario, driver, Keep::Nothing, None, Some(slice)).await
}

async fn conduct(
    scenario: &Scenario,
    driver: &Driver,
    keep: Keep,
    audience: Option<Box<dyn Audience>>,
    slice: Option<Span>,
) -> Result<Outcome, SessionError> {
    let mut session = Session::start(&scenario.file, driver, scenario.file.pc.uart()).await?.quiet();
    match keep {
        Keep::Nothing => {}
        Keep::Recording(recorder) => session.record(recorder),
        Keep::Trace => session.keep(scenario.file.header(&scenario.rig, scenario.seed, None)),
    }
    if let Some(audience) = audience {
        session.show(audience);
    }
    let mut conductor = Conductor { slice, ..Conductor::new(scenario, session) };
    conductor.begin();
    for (number, step) in scenario.steps.iter().enumerate() {
        if let Err(failure) = conductor.step(number, step).await? {
            conductor.failures.push(*failure);
            return conductor.finish(false).await;
        }
    }
    conductor.finish(true).await
}

struct Conductor<'a> {
    scenario: &'a Scenario,
    session: Session,
    /// The way of the tool, if something is expected of the part.
    path: Option<ToolPath>,
    /// What the PC has heard.
    replies: Vec<String>,
    context: VecDeque<(Instant, String)>,
    /// Everything before this has happened, and the next step takes place here.
    now: Instant,
    /// Characters that must not come.
    forbidden: Vec<Forbidden>,
    failures: Vec<Failure>,
    /// Time goes no further at once.
    slice: Option<Span>,
}

/// A character that must not come: of all that must not happen, the one of which no fact tells.
struct Forbidden {
    watch: WatchId,
    /// What must not happen, by its place in the scenario.
    never: usize,
    /// How often it must still be seen.
    left: u64,
}

/// What a step came to.
type Stepped = Result<Result<(), Box<Failure>>, SessionError>;

impl<'a> Conductor<'a> {
    const fn rig(&self) -> &Rig {
        self.session.rig()
    }

    fn new(scenario: &'a Scenario, session: Session) -> Self {
        Self {
            scenario,
            session,
            path: scenario.part.as_ref().map(|expected| ToolPath::new(&expected.part)),
            replies: Vec::new(),
            context: VecDeque::new(),
            now: Instant::START + BEGIN,
            forbidden: Vec::new(),
            failures: Vec::new(),
            slice: None,
        }
    }

    /// Sets the PC up, and the faults that begin by themselves; what must hold throughout must hold now.
    fn begin(&mut self) {
        let ixon = self.scenario.held;
        let configure = Stimulus::Configure { baud: self.scenario.file.pc.baud, ixon };
        let pc = self.rig().pc();
        self.session.stimulate(pc, Instant::START.next(), configure);
        let scenario = self.scenario;
        let begun = self.session.plan(&scenario.faults);
        self.note_begun(begun);
        for (never, condition) in scenario.never.iter().enumerate() {
            if let Condition::Character { nth, .. } = condition {
                let watch = self.session.rig_mut().watch(condition.watch(pc));
                self.forbidden.push(Forbidden { watch, never, left: *nth });
            }
        }
        for node in 0..self.rig().nodes().len() {
            for (signal, value) in self.session.telemetry().values(node).into_iter().enumerate() {
                self.check_value(node, Instant::START, signal as u8, value);
            }
        }
    }

    fn break_it(&mut self, fault: &Fault) {
        let (faults, rig) = self.session.faults();
        let since = faults.begin(rig, fault, self.now);
        self.note_begun([(fault.name.clone(), since)]);
    }

    fn note_begun(&mut self, begun: impl IntoIterator<Item = (String, Instant)>) {
        begun.into_iter().for_each(|(name, since)| self.note(since, &format!("fault '{name}' begins")));
    }

    async fn step(&mut self, number: usize, step: &Step) -> Stepped {
        match &step.action {
            Action::Send(bytes) => {
                let pc = self.rig().pc();
                self.session.stimulate(pc, self.now, Stimulus::Write(bytes.clone()));
            }
            Action::Run(span) => {
                let until = self.now + *span;
                self.advance(until, None).await?;
                self.now = until;
            }
            Action::Wait(condition, within) => return self.wait(number, step, condition, *within).await,
            Action::Break(fault) => self.break_it(fault),
            Action::Heal(name) => {
                self.advance(self.now, None).await?;
                let (faults, rig) = self.session.faults();
                if let Err(error) = faults.heal(rig, name, self.now) {
                    let expected = format!("the fault '{name}'");
                    return Ok(Err(self.failure(Some((number, step)), &expected, error.to_string(), None)));
                }
                self.note(self.now, &format!("fault '{name}' is healed"));
            }
            Action::Check(claim) => {
                self.catch_up(self.now).await?;
                if let Some(came) = self.contradicts(claim) {
                    return Ok(Err(self.failure(Some((number, step)), &claim.to_string(), came, Some(claim.node))));
                }
            }
            Action::CheckPart(as_asked) => {
                self.catch_up(self.now).await?;
                let turned = self.path.clone().map(ToolPath::cut);
                if let Some(came) = turned.and_then(|turned| as_asked.contradicted(&turned)) {
                    return Ok(Err(self.failure(Some((number, step)), &as_asked.to_string(), came, None)));
                }
            }
        }
        Ok(Ok(()))
    }

    async fn wait(&mut self, number: usize, step: &Step, condition: &Condition, within: Span) -> Stepped {
        let deadline = self.now + within;
        if let Condition::Value(claim) = condition {
            self.catch_up(self.now).await?;
            if self.contradicts(claim).is_none() {
                return Ok(Ok(()));
            }
        }
        let heard = self.replies.len();
        let pc = self.rig().pc();
        let watch = self.session.rig_mut().watch(condition.watch(pc));
        let happened = self.advance(deadline, Some((watch, condition))).await?;
        self.session.rig_mut().unwatch(watch);
        match happened {
            Some(at) => {
                self.now = at;
                Ok(Ok(()))
            }
            None => {
                self.catch_up(deadline).await?;
                self.now = deadline;
                let (came, node) = match condition {
                    Condition::Reply(_) if self.replies.len() == heard => ("no reply".to_owned(), None),
                    Condition::Reply(_) => (self.replies[heard..].join(" "), None),
                    Condition::Value(claim) => (self.contradicts(claim).unwrap_or_default(), Some(claim.node)),
                    Condition::Event { node, .. } | Condition::Character { node, .. } => {
                        ("nothing of the kind".to_owned(), Some(*node))
                    }
                };
                let expected = format!("{condition} within {within}");
                Ok(Err(self.failure(Some((number, step)), &expected, came, node)))
            }
        }
    }

    /// What contradicts a claim.
    fn contradicts(&self, claim: &Claim) -> Option<String> {
        let value = self.session.telemetry().value(claim.node, claim.signal);
        (!claim.holds(value)).then(|| format!("{} = {value}", claim.name))
    }

    /// Lets everything happen before `until`, or up to what is waited for. Says when that was acted on.
    async fn advance(
        &mut self,
        until: Instant,
        awaited: Option<(WatchId, &Condition)>,
    ) -> Result<Option<Instant>, SessionError> {
        let mut count = awaited.map_or(0, |(_, condition)| condition.occurrences());
        loop {
            let part = self.slice.map(|slice| self.rig().engine().frontier() + slice);
            let happened = self.session.step(Limit::until(until).earlier(part)).await?;
            let more = happened.more || part.is_some_and(|part| part < until);
            let hits = self.take_note(happened);
            let mut met = None;
            for hit in hits {
                self.check_forbidden(hit);
                if let Some((_, condition)) = awaited.filter(|(watch, _)| *watch == hit.watch)
                    && met.is_none()
                    && condition.is_met(self.session.replies(), hit.at)
                {
                    count -= 1;
                    met = (count == 0).then_some(hit.at + REACTION);
                }
            }
            if met.is_some() || !more {
                return Ok(met);
            }
        }
    }

    /// Brings every board's quantities up to `at`, mute or not.
    async fn catch_up(&mut self, at: Instant) -> Result<(), SessionError> {
        loop {
            let happened = self.session.settle_on(at).await?;
            let more = happened.more;
            let hits = self.take_note(happened);
            hits.into_iter().for_each(|hit| self.check_forbidden(hit));
            if !more {
                return Ok(());
            }
        }
    }

    /// Brings every board to the end. Gives that.
    async fn reach_end(&mut self, until: Instant) -> Result<Instant, SessionError> {
        self.catch_up(until).await?;
        // What is left lies between `until` and what has been noted already.
        let mut left = Vec::new();
        let end = self.session.reach_end(until, |happened| left.push(happened)).await?;
        for happened in left {
            let hits = self.take_note(happened);
            hits.into_iter().for_each(|hit| self.check_forbidden(hit));
        }
        Ok(end)
    }

    /// Takes note of what has happened. Gives what watches have seen.
    fn take_note(&mut self, mut happened: Happened) -> Vec<Hit> {
        // What may be the cause of a failure first, as a failure tells what has been noted before.
        for incident in &happened.incidents {
            self.note(incident.at, &incident.to_string());
        }
        self.note_begun(core::mem::take(&mut happened.begun));
        for (at, exchange) in happened.pc() {
            self.note_pc(at, exchange);
        }
        let Happened { facts, hits, .. } = happened;
        for fact in facts {
            if let Some(path) = &mut self.path {
                path.add(&fact);
            }
            match fact {
                Fact::Telemetry { node, at, signal, value } => self.check_value(node, at, signal, value),
                Fact::Event { node, .. } if self.rig().layout().boards[node].is_gateway() => {}
                Fact::Event { node, at, event, value } => {
                    let node_of = &self.rig().nodes()[node];
                    let text = node_of.description.events.get(usize::from(event)).map_or("?", String::as_str);
                    let line = format!("{}: {}", node_of.name, event_text(text, value));
                    self.note(at, &line);
                    let is = |n: NodeId, e: u8| (n, e) == (node, event);
                    self.check_never(
                        at,
                        node,
                        |never| matches!(never, Condition::Event { node, event, .. } if is(*node, *event)),
                    );
                }
                Fact::Edges { .. } | Fact::Pin { .. } => {}
            }
        }
        hits
    }

    fn note_pc(&mut self, at: Instant, exchange: &Exchange) {
        match exchange {
            Exchange::Sent(_, texts) => {
                texts.iter().for_each(|text| self.note(at, &format!("pc sends {text}")));
            }
            Exchange::Received(_, replies) => {
                for reply in replies {
                    self.note(at, &format!("pc hears {}", reply.text));
                    let pc = self.rig().pc();
                    self.check_never(
                        at,
                        pc,
                        |never| matches!(never, Condition::Reply(expected) if is_reply(&reply.code, expected)),
                    );
                    self.replies.push(reply.code.clone());
                }
            }
            Exchange::Garbled(byte) => self.note(at, &format!("pc hears a garbled {byte:02X}")),
        }
    }

    /// A quantity has this value from now on.
    fn check_value(&mut self, node: NodeId, at: Instant, signal: u8, value: i64) {
        let scenario = self.scenario;
        let is = |claim: &Claim| (claim.node, claim.signal) == (node, signal);
        for claim in scenario.always.iter().filter(|claim| is(claim) && !claim.holds(value)) {
            self.violated(at, &format!("always {claim}"), format!("{} = {value}", claim.name), node);
        }
        let holds = |claim: &Claim| is(claim) && claim.holds(value);
        self.check_never(at, node, |never| matches!(never, Condition::Value(claim) if holds(claim)));
    }

    /// A watch has seen something.
    fn check_forbidden(&mut self, hit: Hit) {
        let scenario = self.scenario;
        let Some(forbidden) = self.forbidden.iter_mut().find(|forbidden| forbidden.watch == hit.watch) else { return };
        forbidden.left = forbidden.left.saturating_sub(1);
        if forbidden.left == 0
            && let never @ Condition::Character { node, .. } = &scenario.never[forbidden.never]
        {
            let watch = forbidden.watch;
            self.session.rig_mut().unwatch(watch);
            self.violated(hit.at, &format!("never {never}"), "it happened".to_owned(), *node);
        }
    }

    fn check_never(&mut self, at: Instant, node: NodeId, is: impl Fn(&Condition) -> bool) {
        let scenario = self.scenario;
        for never in scenario.never.iter().filter(|never| is(never)) {
            self.violated(at, &format!("never {never}"), "it happened".to_owned(), node);
        }
    }

    /// Each promise is broken once only.
    fn violated(&mut self, at: Instant, expected: &str, came: String, node: NodeId) {
        if self.failures.iter().all(|failure| failure.expected != expected) {
            let failure = self.failure(None, expected, came, Some(node));
            self.failures.push(Failure { at, context: self.context(at).collect(), ..*failure });
        }
    }

    fn failure(
        &self,
        step: Option<(usize, &Step)>,
        expected: &str,
        came: String,
        node: Option<NodeId>,
    ) -> Box<Failure> {
        Box::new(Failure {
            step: step.map(|(number, step)| (number + 1, step.does.clone())),
            expected: expected.to_owned(),
            came,
            at: self.now,
            board: node.map(|node| self.rig().nodes()[node].name.clone()),
            context: self.context(self.now).collect(),
            conclusive: true,
        })
    }

    /// Boards are settled one after the other: what comes later can have been earlier.
    fn note(&mut self, at: Instant, line: &str) {
        let place = self.context.partition_point(|(other, _)| *other <= at);
        self.context.insert(place, (at, line.to_owned()));
        if self.context.len() > REMEMBERED {
            self.context.pop_front();
        }
    }

    /// What has happened last by `until`, in order: faults are noted ahead of their time.
    fn context(&self, until: Instant) -> impl Iterator<Item = String> {
        let known = self.context.partition_point(|(at, _)| *at <= until);
        let lines = self.context.range(known.saturating_sub(CONTEXT)..known);
        lines.map(|(at, line)| format!("{at}  {line}"))
    }

    async fn finish(mut self, passed: bool) -> Result<Outcome, SessionError> {
        let limit = Instant::START + self.scenario.end;
        let end = if passed { self.fall_quiet(limit).await? } else { self.now };
        self.now = self.reach_end(end).await?;
        if passed {
            self.check_end();
        }
        self.check_part(passed);
        let ended = self.session.close(Verdict::of(&self.failures).name())?;
        let (digest, trace) = (ended.end.digest, ended.trace);
        Ok(Outcome { failures: self.failures, digest, end: self.now, replies: self.replies, trace })
    }

    /// Lets everything happen until the rig is quiet, but nothing after `limit`. Says when that is.
    async fn fall_quiet(&mut self, limit: Instant) -> Result<Instant, SessionError> {
        let limit = limit.max(self.now);
        let at_once = self.slice.is_none() && !self.session.is_shown();
        if at_once && self.rig().engine().is_undisturbed() && self.session.faults().0.next().is_none() {
            let (happened, quiet) = self.session.fall_quiet(self.now, limit).await?;
            self.take_note(happened);
            if let Some(end) = quiet {
                return Ok(end);
            }
        }
        loop {
            self.advance(self.now, None).await?;
            let quiet = self.session.quiet_since();
            if self.now >= limit || quiet.is_some_and(|since| since < self.now) {
                return Ok(self.now);
            }
            // As far as the next thing that happens, and no further: a watched board that is mute is never at an end.
            let turn = self.session.faults().0.next().unwrap_or(Instant::NEVER);
            let next = quiet.unwrap_or_else(|| self.rig().engine().next_instant().min(turn));
            self.now = limit.min(next.next().max(self.now.next()));
        }
    }

    /// Cuts the part, and holds it against what is expected: of its diameters only if all has been done.
    fn check_part(&mut self, passed: bool) {
        let scenario = self.scenario;
        let Some((expected, path)) = scenario.part.as_ref().zip(self.path.take()) else { return };
        let turned = path.cut();
        for never in &expected.never {
            if let Some(first) = turned.happenings.iter().find(|happening| happening.event == *never) {
                let at = Instant::START + Span::from_nanos((first.at.0 * 1e9).round() as u64);
                let came = format!("at z = {:.2} mm, {:.2} {}", first.place.z, first.worst, never.unit());
                let failure = self.failure(None, &format!("never {}", never.text()), came, None);
                self.failures.push(Failure { at, context: self.context(at).collect(), ..*failure });
            }
        }
        for diameter in expected.diameters.iter().filter(|_| passed) {
            if let Some(came) = diameter.contradicted(&turned) {
                let failure = self.failure(None, &diameter.to_string(), came, None);
                self.failures.push(*failure);
            }
        }
    }

    fn check_end(&mut self) {
        let scenario = self.scenario;
        if let Some(expected) = &scenario.replies {
            let came: Vec<&str> = self.replies.iter().map(String::as_str).collect();
            let alike = |(came, expected): (&&str, &String)| is_reply(came, expected);
            if expected.len() != came.len() || !came.iter().zip(expected).all(alike) {
                let failure = self.failure(None, &format!("the replies {}", expected.join(" ")), came.join(" "), None);
                self.failures.push(*failure);
            }
        }
        for claim in &scenario.finally {
            if let Some(came) = self.contradicts(claim) {
                let failure = self.failure(None, &format!("finally {claim}"), came, Some(claim.node));
                self.failures.push(*failure);
            }
        }
        for Unfired { name, cause } in self.session.unfired() {
            let failure = self.failure(None, &format!("the fault '{name}'"), cause.to_string(), None);
            self.failures.push(Failure { conclusive: false, ..*failure });
        }
    }
}
