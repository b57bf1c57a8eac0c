//! The loop that steps a board, and runs it ahead to make its promises.
//!
//! Between inputs a board is deterministic. So the stepper runs it ahead of what the harness has granted, says what it
//! will do, and keeps checkpoints. If an input then arrives at an instant that has been run past, it goes back to
//! a checkpoint and runs again from there; only what lies at or after the input's first effect is told again.
//! What is run ahead may never happen, so a board affects nothing but through its outputs.

use std::collections::VecDeque;

use crate::board::{Board, Input, Kept, MotorStimulus, Output, Pin, Stimulus};
use crate::record::{Grant, Heard, Report, Silence, Timed};
use crate::time::{Instant, Span};
use crate::uart::{Character, Fifo, Receiver};

/// How far a board is run ahead when nothing comes out of it. A little over the period of the master's enquiries, so
/// that these, and not the cap, wake a busy slave.
const RUN_AHEAD: Span = Span::from_millis(1_100);
/// How long a board is run on after the first of its outputs, in the hope of others: longer than a character, shorter
/// than the time in which an answer is missed. What follows in a long stream would mostly be run ahead in vain.
const RUN_ON: Span = Span::from_millis(10);
/// A checkpoint is taken after so many things handled.
const CHECKPOINT_EVERY: u32 = 24;

/// A report that holds so many outputs is full: a board that is far behind tells what it has caught up with in several.
const REPORT_MAX: usize = 20_000;

/// A board with the receivers of its ports: everything that must be put back to run it again from an earlier instant.
#[derive(Clone, Debug)]
pub struct Cell<B> {
    board: B,
    receivers: Vec<Receiver>,
    /// The first character that one of them hands over, and which. Kept, as it is looked at for every thing handled.
    coming: Option<(Instant, usize)>,
    /// What each port has received and the firmware has not fetched.
    waiting: Vec<UnreadInput>,
    /// Whether there is anything of that. Kept, as `coming` is.
    waits: bool,
    stimuli: VecDeque<(Instant, Stimulus)>,
    /// There is no supply.
    off: bool,
    /// How often the firmware has been hung and not released: a release can be overtaken by the next hang.
    hung: u32,
    /// Its process is stopped. What would make it speak meanwhile, in order.
    stopped: Option<Vec<Stimulus>>,
    /// How long the firmware takes over each thing.
    slow: Span,
    /// Until when it is at the last one.
    busy_until: Instant,
    /// The instant of the last thing handled.
    handled: Instant,
    /// If nothing can leave by a port until something reaches the board: since when.
    mute_since: Option<Instant>,
    /// The board waits for the world outside to stay silent.
    silence: Option<Silence>,
}

impl<B: Board> Cell<B> {
    /// A board as at power-on.
    pub fn new(board: B) -> Self {
        let receivers = board.receivers();
        let waiting = receivers.iter().map(UnreadInput::at).collect();
        let mut cell = Self {
            board,
            receivers,
            coming: None,
            waiting,
            waits: false,
            stimuli: VecDeque::new(),
            off: false,
            hung: 0,
            stopped: None,
            slow: Span::ZERO,
            busy_until: Instant::START,
            handled: Instant::START,
            mute_since: None,
            silence: None,
        };
        cell.note_mute();
        cell.note_silence();
        cell
    }

    /// The board.
    pub const fn board(&self) -> &B {
        &self.board
    }

    /// Tells what will reach the board.
    pub fn hear(&mut self, heard: &Heard) {
        match heard {
            Heard::Edges { port, edges } => {
                if let Some(receiver) = self.receivers.get_mut(usize::from(*port)) {
                    receiver.hear_ahead(edges);
                    self.note_coming();
                }
            }
            Heard::Cut { port, at } => {
                if let Some(receiver) = self.receivers.get_mut(usize::from(*port)) {
                    receiver.hear_cut(*at);
                    self.note_coming();
                }
            }
            Heard::Stimulus { at, stimulus } => {
                let after = self.stimuli.partition_point(|(other, _)| other <= at);
                self.stimuli.insert(after, (*at, stimulus.clone()));
            }
        }
        self.note_mute();
    }

    /// The first instant at which `heard` can matter.
    fn effect(&self, heard: &Heard) -> Instant {
        let ear = |port: u8| self.receivers.get(usize::from(port)).map(Receiver::ear);
        match heard {
            Heard::Edges { port, edges } => match (ear(*port), edges.first()) {
                (Some(ear), Some(edge)) => ear.effect(edge.at),
                _ => Instant::NEVER,
            },
            Heard::Cut { port, at } => ear(*port).map_or(Instant::NEVER, |ear| ear.effect(*at)),
            Heard::Stimulus { at, .. } => *at,
        }
    }

    /// Runs everything before `until`, and gives what the board does.
    pub fn run(&mut self, until: Instant, mut emit: impl FnMut(Instant, Output)) {
        while let Some((at, next)) = self.next().filter(|(at, _)| *at < until) {
            self.step(at, next, &mut emit);
        }
    }

    /// Runs a board as at power-on by itself: with all that it hears before `until`, in order for each source. Gives
    /// what it does, and what its pins do.
    pub fn watch(mut board: B, heard: &[Heard], until: Instant) -> (Vec<Timed>, Vec<Pin>) {
        board.watch_pins();
        let mut cell = Self::new(board);
        heard.iter().for_each(|heard| cell.hear(heard));
        let mut outputs = Vec::new();
        cell.run(until, |at, output| outputs.push(Timed { at, output }));
        (outputs, cell.board.pins(until))
    }

    /// The same, with a look at its quantities every so often, from the start on.
    pub fn sample(board: B, heard: &[Heard], until: Instant, every: Span) -> Vec<(Instant, Vec<(u8, i64)>)> {
        let mut cell = Self::new(board);
        heard.iter().for_each(|heard| cell.hear(heard));
        let mut samples = Vec::new();
        let mut at = Instant::START;
        while at < until {
            cell.run(at.next(), |_, _| ());
            samples.push((at, cell.board.quantities(at)));
            at += every.max(Span::from_nanos(1));
        }
        samples
    }

    /// When the next thing happens, if nothing more is heard.
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.next().map(|(at, _)| at)
    }

    fn next(&self) -> Option<(Instant, Next)> {
        let mut next = self.stimuli.front().map(|(at, _)| (*at, Next::Stimulus));
        // The least; among equals the first, which is the order that `board` prescribes.
        let mut consider = |at: Instant, what: Next| {
            if next.is_none_or(|(first, _)| at < first) {
                next = Some((at, what));
            }
        };
        let runs = self.runs();
        if runs && self.waits {
            consider(self.ready(), Next::Fetch);
        }
        if let Some((at, port)) = self.coming {
            consider(at, Next::Character(port));
        }
        if runs && let Some(deadline) = self.board.poll_timeout() {
            // One that passed while the firmware was hung or busy is due as soon as it is not.
            consider(deadline.at.max(self.ready()), Next::Deadline);
        }
        next
    }

    /// The firmware runs, if only slowly.
    const fn runs(&self) -> bool {
        self.hung == 0 && self.stopped.is_none() && !self.off
    }

    /// The first instant at which the firmware, if it runs, can handle something.
    fn ready(&self) -> Instant {
        self.busy_until.max(self.handled)
    }

    /// Something waits that the firmware will fetch.
    const fn fetches(&self) -> bool {
        self.waits && self.runs()
    }

    /// Handles the next thing, and gives what the board does.
    fn step(&mut self, at: Instant, next: Next, mut emit: impl FnMut(Instant, Output)) {
        self.handled = at;
        self.handle(at, next, &mut emit);
        self.note_mute();
        self.note_silence();
    }

    fn handle(&mut self, at: Instant, next: Next, emit: &mut impl FnMut(Instant, Output)) {
        match next {
            Next::Stimulus => {
                if let Some((_, stimulus)) = self.stimuli.pop_front() {
                    self.stimulus(at, stimulus, emit);
                }
            }
            Next::Fetch => {
                let fetched =
                    self.waiting.iter_mut().enumerate().find_map(|(port, waiting)| Some((port, waiting.take()?)));
                self.waits = !self.waiting.iter().all(UnreadInput::is_empty);
                if let Some((port, character)) = fetched {
                    self.deliver(at, port, character, emit);
                }
            }
            Next::Character(port) => self.character(at, port, emit),
            Next::Deadline => {
                self.board.handle_timeout(at);
                self.busy_until = at + self.slow;
                self.drain(at, emit);
            }
        }
    }

    fn stimulus(&mut self, at: Instant, stimulus: Stimulus, emit: &mut impl FnMut(Instant, Output)) {
        if let (Stimulus::Reset | Stimulus::Power(_), Some(missed)) = (&stimulus, &mut self.stopped) {
            missed.push(stimulus);
            return;
        }
        match stimulus {
            Stimulus::Stop(true) => _ = self.stopped.get_or_insert_default(),
            Stimulus::Stop(false) => {
                let missed = self.stopped.take().unwrap_or_default();
                missed.into_iter().for_each(|stimulus| self.stimulus(at, stimulus, emit));
            }
            Stimulus::Hang(true) => self.hung += 1,
            Stimulus::Hang(false) => self.hung = self.hung.saturating_sub(1),
            Stimulus::Slow(slow) => {
                self.slow = slow;
                if slow == Span::ZERO {
                    self.busy_until = at;
                }
            }
            // What is so already stays as it is.
            Stimulus::Power(on) if on != self.off => {}
            Stimulus::Power(on) => self.power(at, on, emit),
            Stimulus::Clock(_) => {
                self.input(at, Input::Stimulus(stimulus), emit);
                let tuned = self.board.receivers();
                self.receivers.iter_mut().zip(&tuned).for_each(|(receiver, tuned)| receiver.retune(tuned, at));
                self.note_coming();
            }
            Stimulus::Reset | Stimulus::Write(_) | Stimulus::Discard | Stimulus::Break(_) if self.off => {}
            Stimulus::Motor { what: MotorStimulus::Drive(_), .. } if self.off => {}
            _ => self.input(at, Input::Stimulus(stimulus), emit),
        }
    }

    fn power(&mut self, at: Instant, on: bool, emit: &mut impl FnMut(Instant, Output)) {
        self.waiting = self.receivers.iter().map(UnreadInput::at).collect();
        self.waits = false;
        self.busy_until = at;
        self.hung = 0;
        if !on {
            (0..self.receivers.len()).for_each(|port| emit(at, Output::Cut { port: number(port) }));
        }
        // The lines have been idle since the supply went: firmware that restarts has nothing to cut.
        let mut emit = |at, output| {
            if !matches!(output, Output::Cut { .. }) {
                emit(at, output);
            }
        };
        self.off = !on;
        self.input(at, Input::Stimulus(Stimulus::Power(on)), &mut emit);
        if on {
            // A character that began before is none.
            let fresh = self.board.receivers();
            self.receivers.iter_mut().zip(&fresh).for_each(|(receiver, fresh)| receiver.replace_by(fresh, at));
            self.note_coming();
        }
    }

    fn character(&mut self, at: Instant, port: usize, emit: &mut impl FnMut(Instant, Output)) {
        let taken = self.receivers[port].take(at);
        self.note_coming();
        let Some(character) = taken else { return };
        if self.runs() && self.busy_until <= at {
            self.deliver(at, port, character, emit);
        } else if !self.off && (self.hung == 0 && self.stopped.is_none() || self.receivers[port].is_buffered()) {
            self.waiting[port].push(character);
            self.waits = true;
        }
    }

    fn deliver(&mut self, at: Instant, port: usize, character: Character, emit: &mut impl FnMut(Instant, Output)) {
        self.busy_until = at + self.slow;
        self.input(at, Input::Character { port: number(port), character }, emit);
    }

    fn input(&mut self, at: Instant, input: Input, emit: &mut impl FnMut(Instant, Output)) {
        self.board.handle_input(at, input);
        self.drain(at, emit);
    }

    fn drain(&mut self, at: Instant, emit: &mut impl FnMut(Instant, Output)) {
        while let Some(output) = self.board.poll_output() {
            if !self.off || matches!(output, Output::Telemetry { .. }) {
                emit(at, output);
            }
        }
        while let Some((port, receiver)) = self.board.poll_receiver() {
            if let Some(present) = self.receivers.get_mut(usize::from(port)) {
                present.replace_by(&receiver, at);
                self.note_coming();
            }
        }
    }

    fn note_coming(&mut self) {
        let due = |(port, receiver): (usize, &Receiver)| receiver.poll_timeout().map(|at| (at, port));
        self.coming = self.receivers.iter().enumerate().filter_map(due).min();
    }

    fn note_mute(&mut self) {
        let mute =
            self.coming.is_none() && self.stimuli.is_empty() && (!self.runs() || self.board.mute()) && !self.fetches();
        self.mute_since = if mute { self.mute_since.or(Some(self.handled)) } else { None };
    }

    fn note_silence(&mut self) {
        // What waits to be fetched has broken it.
        let deadline = self.board.silence().filter(|_| self.runs() && !self.fetches());
        let deadline = deadline.map(|deadline| deadline.max(self.busy_until));
        if deadline != self.silence.map(|silence| silence.deadline) {
            self.silence = deadline.map(|deadline| Silence { from: self.handled, deadline });
        }
    }
}

/// What a port has received while the firmware could not see to it.
#[derive(Clone, Copy, Debug)]
enum UnreadInput {
    /// In a hardware UART.
    Buffered(Fifo),
    /// In the variable of a software UART.
    Variable(Option<Character>),
}

impl UnreadInput {
    /// Nothing, at `receiver`.
    fn at(receiver: &Receiver) -> Self {
        if receiver.is_buffered() { Self::Buffered(Fifo::default()) } else { Self::Variable(None) }
    }

    fn push(&mut self, character: Character) {
        match self {
            Self::Buffered(fifo) => fifo.push(character),
            Self::Variable(variable) => *variable = Some(character),
        }
    }

    fn take(&mut self) -> Option<Character> {
        match self {
            Self::Buffered(fifo) => fifo.pop(),
            Self::Variable(variable) => variable.take(),
        }
    }

    const fn is_empty(&self) -> bool {
        match self {
            Self::Buffered(fifo) => fifo.is_empty(),
            Self::Variable(variable) => variable.is_none(),
        }
    }
}

/// A port's number.
fn number(port: usize) -> u8 {
    u8::try_from(port).unwrap_or(u8::MAX)
}

#[derive(Clone, Copy)]
enum Next {
    Stimulus,
    /// The firmware fetches what has waited.
    Fetch,
    Character(usize),
    Deadline,
}

/// Steps one board through the grants that the harness gives it.
#[derive(Debug)]
pub struct Stepper<B> {
    head: Cell<B>,
    /// Earlier states, oldest first.
    checkpoints: Vec<Checkpoint<B>>,
    /// How many things have been handled since the last of them.
    since_checkpoint: u32,
    /// Everything before this instant has been run and told.
    horizon: Instant,
    /// A report with so many outputs is full.
    report_max: usize,
    /// So many outputs are made room for at once: as many as there were lately.
    room: usize,
}

/// An earlier state. Most are never gone back to, so it hears what has come since only if it is.
#[derive(Debug)]
struct Checkpoint<B> {
    cell: Cell<B>,
    /// What the head has heard between this checkpoint and the next.
    since: Vec<Heard>,
}

impl<B: Clone> Checkpoint<B> {
    fn of(head: &Cell<B>) -> Self {
        Self { cell: head.clone(), since: Vec::new() }
    }
}

/// A board put something on a port although it had been promised that nothing would come: a defect of the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("broken promise: the board said it was mute, but spoke at {at}")]
pub struct BrokenPromise {
    /// When it spoke.
    pub at: Instant,
}

impl<B: Board> Stepper<B> {
    /// A stepper for `board`, as at power-on.
    pub fn new(board: B) -> Self {
        let head = Cell::new(board);
        Self {
            checkpoints: vec![Checkpoint::of(&head)],
            head,
            since_checkpoint: 0,
            horizon: Instant::START,
            report_max: REPORT_MAX,
            room: 0,
        }
    }

    /// The same with reports that are full with fewer outputs. Nothing may depend on it: this is how that is proved.
    #[must_use]
    pub fn with_report_max(self, report_max: usize) -> Self {
        Self { report_max, ..self }
    }

    /// The board, run ahead.
    pub const fn board(&self) -> &B {
        self.head.board()
    }

    /// What the board keeps without power, as everything before `until` leaves it. That lies before nothing that has
    /// been committed.
    pub fn kept(&self, until: Instant) -> Option<Kept> {
        let usable = self.checkpoints.partition_point(|checkpoint| checkpoint.cell.handled < until).max(1);
        let later = self.checkpoints.get(usable - 1..)?;
        let mut cell = later.first()?.cell.clone();
        later.iter().flat_map(|checkpoint| &checkpoint.since).for_each(|heard| cell.hear(heard));
        cell.run(until, |_, _| ());
        cell.board().kept()
    }

    /// Takes a grant: hears what the harness says, runs ahead, and says what comes out. Where nothing is heard, the
    /// report ends before the grant does if it is full.
    ///
    /// # Errors
    /// [`BrokenPromise`] if the board's `mute` was wrong.
    pub fn grant(&mut self, grant: Grant) -> Result<Report, BrokenPromise> {
        self.forget_before(grant.commit);
        let effect = grant.heard.iter().map(|heard| self.head.effect(heard)).min();
        if let Some(effect) = effect.filter(|effect| *effect <= self.head.handled) {
            self.roll_back(effect, grant.commit);
        }
        let from = self.horizon.min(effect.unwrap_or(Instant::NEVER));
        let mut report = Report { from, outputs: Vec::with_capacity(self.room), ..Report::default() };
        report.silences.extend(self.head.silence);
        let report_max = if effect.is_none() { self.report_max } else { usize::MAX };
        match self.catch_up(effect.unwrap_or(grant.until), report_max, &mut report)? {
            Some(next) => {
                self.checkpoint();
                self.horizon = next;
            }
            None => {
                for heard in &grant.heard {
                    self.head.hear(heard);
                }
                if let Some(last) = self.checkpoints.last_mut() {
                    last.since.extend(grant.heard);
                }
                self.run_ahead(grant.until, effect, &mut report);
            }
        }
        self.settle(grant.commit);
        self.room = report.outputs.len().max(self.room - self.room / 8);
        report.horizon = self.horizon;
        report.mute_since = self.head.mute_since;
        report.ears = self.head.receivers.iter().map(Receiver::ear).collect();
        Ok(report)
    }

    /// Lets the receivers forget what nothing can change that is still heard or still happens.
    fn settle(&mut self, commit: Instant) {
        let certain = self.horizon.min(commit);
        for receiver in &mut self.head.receivers {
            // An edge matters when the character is complete that it starts or changes.
            let settled = certain - receiver.lookahead().times(2);
            receiver.settle(settled);
        }
    }

    /// Drops the checkpoints that no input can make necessary any more: none will matter before `commit`.
    fn forget_before(&mut self, commit: Instant) {
        let usable = self.checkpoints.partition_point(|checkpoint| checkpoint.cell.handled < commit);
        self.checkpoints.drain(..usable.saturating_sub(1));
    }

    /// Goes back to a state in which nothing at or after `effect` has been handled. What lies before has been told.
    fn roll_back(&mut self, effect: Instant, commit: Instant) {
        let usable = self.checkpoints.partition_point(|checkpoint| checkpoint.cell.handled < effect).max(1);
        let mut later = self.checkpoints.drain(usable - 1..);
        let Some(Checkpoint { mut cell, mut since }) = later.next() else { return };
        later.for_each(|later| since.extend(later.since));
        since.iter().for_each(|heard| cell.hear(heard));
        // Otherwise nothing before `effect` will be gone back to.
        if commit < effect {
            self.checkpoints.push(Checkpoint::of(&cell));
        }
        self.head = cell;
        self.since_checkpoint = 0;
        while let Some((at, next)) = self.head.next().filter(|(at, _)| *at < effect) {
            self.since_checkpoint += 1;
            self.head.step(at, next, |_, _| {});
        }
    }

    /// Runs and tells what lies between the horizon and `until`: that is how a mute board catches up. Says where it is
    /// to go on if the report is full before.
    fn catch_up(
        &mut self,
        until: Instant,
        report_max: usize,
        report: &mut Report,
    ) -> Result<Option<Instant>, BrokenPromise> {
        let promised = self.head.mute_since.is_some();
        let mut spoke = None;
        let mut rest = None;
        while let Some((at, next)) = self.head.next().filter(|(at, _)| *at < until) {
            // What happens at one instant is told at once.
            if report.outputs.len() >= report_max && at > self.head.handled {
                rest = Some(at);
                break;
            }
            self.tell(at, next, report, |output| {
                if matches!(output, Output::Character { .. } | Output::Cut { .. }) {
                    spoke.get_or_insert(at);
                }
            });
        }
        match spoke {
            Some(at) if promised => Err(BrokenPromise { at }),
            _ => Ok(rest),
        }
    }

    /// Runs at least to `until`, then on to the next outputs.
    fn run_ahead(&mut self, until: Instant, effect: Option<Instant>, report: &mut Report) {
        let cap = self.head.handled.max(until).max(effect.unwrap_or_default()) + RUN_AHEAD;
        let mut run_on = Instant::NEVER;
        if self.since_checkpoint > 0 || self.checkpoints.is_empty() {
            self.checkpoint();
        }
        loop {
            let Some((at, next)) = self.head.next() else {
                self.horizon = Instant::NEVER;
                break;
            };
            self.horizon = at;
            // What is told lies before the horizon, so it does not end within an instant.
            let begun = at == self.head.handled;
            if !begun && at >= until && (self.head.mute_since.is_some() || at >= cap || at >= run_on) {
                break;
            }
            if self.since_checkpoint >= CHECKPOINT_EVERY {
                self.checkpoint();
            }
            self.tell(at, next, report, |output| {
                if let Output::Character { .. } = output {
                    run_on = run_on.min(at + RUN_ON);
                }
            });
        }
    }

    fn checkpoint(&mut self) {
        self.since_checkpoint = 0;
        self.checkpoints.push(Checkpoint::of(&self.head));
    }

    /// Handles the next thing, and tells what comes of it.
    fn tell(&mut self, at: Instant, next: Next, report: &mut Report, mut look: impl FnMut(&Output)) {
        self.since_checkpoint += 1;
        self.head.step(at, next, |at, output| {
            look(&output);
            report.outputs.push(Timed { at, output });
        });
        if report.silences.last() != self.head.silence.as_ref() {
            // One that did not last is no silence.
            report.silences.pop_if(|silence| silence.deadline > at);
            report.silences.extend(self.head.silence);
        }
    }
}

#[cfg(test)]
mod tests;
