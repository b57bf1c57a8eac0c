//! An axis: the machine, and the loop that watches it.

use std::collections::VecDeque;
use std::sync::Arc;

use torno_protocol::board::Deadline;
use torno_protocol::time::Instant;
use torno_protocol::train::Train;

use crate::closed_loop::{Cause, ClosedLoop, Verdict};
use crate::encoder::Channels;
use crate::fault::Fault;
use crate::machine::{Machine, Stretch};
use crate::prediction::{Prediction, Predictions};
use crate::settings::{AxisSettings, Law, Mode};
use crate::timer::Counter;
use crate::watch::{Checks, Reckoning, Watch, index_mark};

/// Something that the loop does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoopEvent {
    /// The train has stopped: no pulse of it begins from now on. [`Axis::issued`] says how many have.
    Stop,
    /// The loop adds these pulses, which the program does not know.
    Correct {
        /// In the positive sense.
        forward: bool,
        /// The pulses.
        train: Train,
    },
    /// The loop is done: the program may go on.
    Resume {
        /// It is to begin from rest; otherwise at the rate at which it was stopped.
        ramp: bool,
    },
    /// The encoder's index mark has passed: see [`Axis::seek_index`].
    Index,
    /// At the index mark so many counts turn out to have been lost (invented if negative). The firmware's count is put
    /// right.
    Miscounted(i64),
    /// The loop gives up. All axes are to stop. It takes no train until [`Axis::reference`].
    Alarm(Alarm),
}

/// An alarm of the loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Alarm {
    /// Why.
    pub cause: Cause,
    /// The error that the loop reckoned with, in pm: positive if the carriage is short.
    pub error_pm: i64,
}

/// What an axis is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// It takes trains.
    Ready,
    /// Its loop has stopped the train.
    Correcting,
    /// Its loop has given up.
    Alarmed,
}

/// What the loop has done since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Checks, the quiet ones included.
    pub checks: u64,
    /// Corrections.
    pub corrections: u64,
    /// Pulses of corrections.
    pub corrected_pulses: u64,
    /// Pulses paid in advance for backlash.
    pub backlash_pulses: u64,
    /// Alarms.
    pub alarms: u64,
    /// The largest deviation of the carriage from what the program asked for while the program moves, since the last
    /// [`Axis::reference`], in pm.
    pub worst_pm: i64,
    /// The same in the pauses, and at rest: pulses that are added to free a blocked carriage take it too far once it is
    /// free.
    pub worst_paused_pm: i64,
    /// Substeps in which a rotor that swings has been integrated. All other time costs nothing.
    pub substeps: u64,
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    /// It looks.
    Watching,
    /// The rotor settles.
    Settling(Instant),
    /// Added pulses go out, until an error is found among them or they end.
    Adding {
        until: Instant,
        settle: bool,
        /// A larger error stops them, in pm.
        stop: i64,
    },
    Alarmed,
}

/// A closed-loop stepper axis.
///
/// It is driven as a board is: at its [deadline](Self::poll_timeout) call [`Self::handle_timeout`]; after each call
/// take all [events](Self::poll_event). Instants must not go back. What is asked of it changes nothing, and is told as
/// it will be at that instant if nothing more happens until then.
#[derive(Clone, Debug)]
pub struct Axis {
    machine: Machine,
    counter: Counter,
    control: ClosedLoop,
    reckoning: Reckoning,
    phase: Phase,
    /// Since when it has been in this phase.
    since: Instant,
    /// The sense in which the program moved last.
    sense: i64,
    stats: Stats,
    /// The checks when the loop last corrected at once.
    corrected: u64,
    /// When a check finds an error.
    found: Option<Instant>,
    /// When the index mark passes, if it matters.
    mark: Option<Instant>,
    /// The rotor may swing on from then on, and is looked at again.
    again: Option<Instant>,
    /// What the machine will do if nothing more happens, and what it would have done.
    ahead: Option<Arc<Prediction>>,
    predictions: Predictions,
    /// The next index mark is told.
    seeks: bool,
    /// What the count is beyond whole turns where the index mark is, once one has been sought.
    index: Option<i64>,
    events: VecDeque<LoopEvent>,
}

impl Axis {
    /// An axis at rest in mid-travel, referenced there. The settings must have been [checked](AxisSettings::check).
    pub fn new(settings: &AxisSettings) -> Self {
        let machine = Machine::new(settings);
        let scale = machine.scale;
        let mut axis = Self {
            machine,
            counter: Counter::new(settings.encoder.counter_bits, settings.encoder.counter_start),
            control: ClosedLoop::new(settings, &scale),
            reckoning: Reckoning {
                pulse_pm: scale.pulse_pm,
                count_pm: scale.firmware_count_pm,
                zero_program: 0,
                zero_total: 0,
            },
            phase: Phase::Watching,
            since: Instant::START,
            sense: 1,
            stats: Stats::default(),
            corrected: 0,
            found: None,
            mark: None,
            again: None,
            ahead: None,
            predictions: Predictions::default(),
            seeks: false,
            index: None,
            events: VecDeque::new(),
        };
        axis.reference(Instant::START);
        axis
    }

    /// The program's pulses from now on, instead of those that have not begun.
    ///
    /// While the loop corrects, and after an alarm, no train is taken. Where the sense changes and backlash is paid in
    /// advance, it is not taken either: [`LoopEvent::Stop`] tells.
    pub fn train(&mut self, now: Instant, forward: bool, train: Train) {
        self.pass(now);
        if !matches!(self.phase, Phase::Watching) {
            return;
        }
        let sense = if forward { 1 } else { -1 };
        if sense != self.sense && self.control.backlash > 0 {
            self.sense = sense;
            self.machine.cut();
            self.events.push_back(LoopEvent::Stop);
            self.stats.backlash_pulses += self.control.backlash.unsigned_abs();
            if self.machine.on_motor {
                // The motor is to turn by them, and the loop to know it.
                self.reckoning.zero_program -= sense * self.control.backlash;
            }
            self.add(sense * self.control.backlash, None, false);
        } else {
            self.sense = sense;
            self.machine.feed(&train, sense, false);
        }
        self.look();
    }

    /// No pulse of the program begins from now on. One that has begun is completed.
    pub fn cut(&mut self, now: Instant) {
        self.pass(now);
        if matches!(self.phase, Phase::Watching) {
            self.machine.cut();
            self.look();
        }
    }

    /// The motion is over: a loop that counts pulses checks once more, whatever its count.
    pub fn end(&mut self, now: Instant) {
        self.pass(now);
        if matches!(self.phase, Phase::Watching) && self.control.mode == Mode::Dynamic {
            self.stats.checks += 1;
            if self.control.finds(self.err()) {
                self.found = Some(now);
                self.check();
            }
        }
        self.look();
    }

    /// The next index mark (Z) of the encoder that the carriage passes is told as [`LoopEvent::Index`].
    ///
    /// From then on the firmware knows what its count is to be at each mark, and finds what has been lost.
    pub fn seek_index(&mut self, now: Instant) {
        self.pass(now);
        self.seeks = true;
        self.look();
    }

    /// When something of the loop happens next, and what.
    pub fn poll_timeout(&self) -> Option<Deadline> {
        let of_the_loop = match self.phase {
            Phase::Watching => self.found.map(|at| (at, "an error is found")),
            Phase::Settling(until) => Some((until, "the rotor has settled")),
            Phase::Adding { until, .. } => Some((self.found.unwrap_or(until), "a correction ends")),
            Phase::Alarmed => None,
        };
        let mark = self.mark.map(|at| (at, "the index mark"));
        let again = self.again.map(|at| (at, "the rotor still swings"));
        let (at, why) = [mark, of_the_loop, again].into_iter().flatten().min_by_key(|(at, _)| *at)?;
        Some(Deadline { at, why })
    }

    /// The deadline is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.poll_timeout().is_none_or(|deadline| deadline.at > now) {
            return;
        }
        self.pass(now);
        if self.mark.is_some_and(|at| at <= now) {
            self.pass_index();
            return self.look();
        }
        if self.again.is_some_and(|at| at <= now) {
            return self.look();
        }
        match self.phase {
            Phase::Watching => self.check(),
            Phase::Settling(_) => {
                self.stats.checks += 1;
                self.decide(None);
            }
            Phase::Adding { .. } if self.found.is_some() => self.give_up(Cause::TooFar),
            Phase::Adding { settle: true, .. } => self.enter(Phase::Settling(now + self.control.settle)),
            Phase::Adding { settle: false, .. } => {
                self.enter(Phase::Watching);
                self.events.push_back(LoopEvent::Resume { ramp: self.control.law == Law::Pause });
            }
            Phase::Alarmed => {}
        }
        self.look();
    }

    /// What the loop has done; after each call until there is none.
    pub fn poll_event(&mut self) -> Option<LoopEvent> {
        self.events.pop_front()
    }

    /// Something goes wrong, or is mended.
    pub fn fault(&mut self, now: Instant, fault: Fault) {
        self.pass(now);
        let before = self.machine.counted();
        let sensed = self.machine.sensed();
        let machine = &mut self.machine;
        let units = |pm: i64| machine.scale.units(pm);
        match fault {
            Fault::Stall(stalled) => machine.disturb(|plant| plant.stall(stalled)),
            Fault::Load(per_mille) => machine.disturb(|plant| plant.set_friction(per_mille)),
            Fault::Push(per_mille) => machine.disturb(|plant| plant.set_push(per_mille)),
            Fault::Supply(per_mille) => machine.disturb(|plant| plant.set_supply(per_mille)),
            Fault::Backlash(pm) => {
                let backlash = pm.map(|pm| units(pm.into()));
                machine.disturb(|plant| plant.set_backlash(backlash));
            }
            Fault::EndStop(pm) => {
                let at = units(pm);
                machine.disturb(|plant| plant.mechanics.stop(at));
            }
            Fault::Slip(turns) => machine.disturb(|plant| plant.slip(turns)),
            Fault::Shift(pm) => {
                let by = units(pm);
                machine.disturb(|plant| plant.mechanics.bend(by));
            }
            Fault::Skip(every) => machine.skip(every),
            Fault::Counts(counts) => machine.encoder.invent(self.sense * counts),
            Fault::SwappedChannels(swapped) => machine.encoder.swap(swapped, sensed),
            Fault::DeadChannel(dead) => machine.encoder.cut(dead, sensed),
        }
        self.counter.jump(before, self.machine.counted());
        self.look();
    }

    /// The firmware takes the place where the carriage is for the one where it ought to be: its error is 0. This ends
    /// an alarm, and a correction.
    pub fn reference(&mut self, now: Instant) {
        self.pass(now);
        self.machine.cut();
        self.machine.zero();
        self.reckoning.zero_program = self.machine.program_now().0;
        self.reckoning.zero_total = self.counter.total(self.machine.counted());
        self.enter(Phase::Watching);
        self.control.restart();
        self.look();
    }

    /// What it is doing.
    pub const fn state(&self) -> State {
        match self.phase {
            Phase::Watching => State::Ready,
            Phase::Settling(_) | Phase::Adding { .. } => State::Correcting,
            Phase::Alarmed => State::Alarmed,
        }
    }

    /// The program's pulses that have begun before `now`, with their sense: since the start, whatever the reference.
    pub fn issued(&self, now: Instant) -> i64 {
        self.machine.begun(now)
    }

    /// Where the carriage is, in pm from where it was at the start.
    pub fn carriage(&self, now: Instant) -> i64 {
        let machine = self.at(now);
        machine.scale.pm(machine.plant.mechanics.carriage)
    }

    /// How far the motor has turned, in pm of the way that the screw would make of it.
    pub fn rotor(&self, now: Instant) -> i64 {
        let machine = self.at(now);
        machine.scale.pm(machine.plant.mechanics.rotor)
    }

    /// What the firmware has counted since the start.
    pub fn count(&self, now: Instant) -> i64 {
        self.counter.total(self.at(now).counted())
    }

    /// The register of the timer that counts.
    pub fn register(&self, now: Instant) -> u32 {
        self.counter.register(self.at(now).counted())
    }

    /// What the encoder's channels show.
    pub fn channels(&self, now: Instant) -> Channels {
        let machine = self.at(now);
        machine.encoder.channels(machine.encoder.passed(machine.sensed()))
    }

    /// What the encoder's channels show from each instant on at which one of them changes, up to `until` and if nothing
    /// more happens: as many as the counts that pass.
    pub fn edges(&self, until: Instant) -> Vec<(Instant, Channels)> {
        self.machine.clone().edges(until)
    }

    /// The error as the loop reckons it, in pm: positive if the carriage is short.
    pub fn error(&self, now: Instant) -> i64 {
        let machine = self.at(now);
        self.reckoning.error(machine.program_now().0, self.counter.total(machine.counted()))
    }

    /// How far the carriage is short of what the program asked for, in truth: in pm, since the last
    /// [`Self::reference`].
    pub fn deviation(&self, now: Instant) -> i64 {
        let machine = self.at(now);
        machine.scale.pm(machine.deviation())
    }

    /// How often the loop has corrected.
    pub const fn corrections(&self) -> u64 {
        self.stats.corrections
    }

    /// What the loop has done.
    pub fn stats(&self, now: Instant) -> Stats {
        let mut axis = self.clone();
        axis.pass(now);
        let Machine { scale, worst, worst_paused, plant, .. } = &axis.machine;
        let (worst_pm, worst_paused_pm) = (scale.pm(*worst), scale.pm(*worst_paused));
        Stats { worst_pm, worst_paused_pm, substeps: plant.substeps(), ..axis.stats }
    }

    /// The last state of the machine that is known, up to `now`.
    fn known(&self, now: Instant) -> &Machine {
        let state = self.ahead.as_ref().and_then(|ahead| ahead.state(self.machine.at, now));
        state.unwrap_or(&self.machine)
    }

    /// The machine at `now`.
    fn at(&self, now: Instant) -> Machine {
        let mut machine = self.known(now).clone();
        machine.advance(now);
        machine
    }

    /// Lets the time up to `now` pass, and counts the checks in it.
    fn pass(&mut self, now: Instant) {
        let done = |axis: &Self| axis.control.checks_until(axis.machine.program_now().1, axis.machine.at.as_nanos());
        let before = done(self);
        if let Some(state) = self.ahead.take().as_ref().and_then(|ahead| ahead.state(self.machine.at, now)) {
            self.machine = state.clone();
        }
        self.machine.advance(now.max(self.machine.at));
        if matches!(self.phase, Phase::Watching) {
            self.stats.checks += done(self) - before;
        }
    }

    /// The error as the loop reckons it now.
    fn err(&self) -> i64 {
        self.reckoning.error(self.machine.program_now().0, self.counter.total(self.machine.counted()))
    }

    /// Looks ahead for the check that finds an error, and for the index mark.
    fn look(&mut self) {
        (self.again, self.mark, self.found) = (None, None, None);
        let watch = self.watch();
        // A check that is due at this very instant comes after whatever has just happened.
        if matches!(self.phase, Phase::Watching) && self.is_checked_now() && self.control.finds(self.err()) {
            self.found = Some(self.machine.at);
        } else if self.machine.plant.can_swing() {
            let ahead = self.predictions.of(&self.machine, watch);
            let looks_on = watch.is_some_and(|watch| matches!(watch.checks, Checks::Nanos(_)));
            (self.found, self.again) = (ahead.found, ahead.again.filter(|_| looks_on));
            self.ahead = Some(ahead);
        } else {
            self.found = watch.and_then(|watch| self.first(|machine, stretch| watch.first(machine, stretch)));
        }
        if self.seeks || self.index.is_some_and(|known| self.miscounted().is_some_and(|counts| counts != known)) {
            if self.machine.plant.can_swing() {
                let ahead = Prediction::new(&self.machine, index_mark);
                (self.mark, self.again) = (ahead.found, self.again.into_iter().chain(ahead.again).min());
            } else {
                self.mark = self.first(index_mark);
            }
        }
    }

    /// The first instant that `watch` finds, if nothing more happens: with a rotor in closed form.
    fn first(&self, watch: impl FnMut(&Machine, &Stretch<'_>) -> Option<Instant>) -> Option<Instant> {
        self.machine.clone().walk(Instant::NEVER, watch)
    }

    fn miscounted(&self) -> Option<i64> {
        let Machine { encoder, .. } = &self.machine;
        encoder.miscounted(self.machine.sensed(), self.counter.total(self.machine.counted()))
    }

    /// The index mark has passed.
    fn pass_index(&mut self) {
        if let Some(counts) = self.miscounted() {
            if let Some(known) = self.index.filter(|known| *known != counts) {
                self.reckoning.zero_total += counts - known;
                self.events.push_back(LoopEvent::Miscounted(known - counts));
            }
            self.index = Some(counts);
        }
        if self.seeks {
            self.seeks = false;
            self.events.push_back(LoopEvent::Index);
        }
    }

    /// The checks of this phase, and what they look for.
    fn watch(&self) -> Option<Watch> {
        let (checks, least) = match self.phase {
            Phase::Watching => (self.control.checks()?, self.control.least),
            Phase::Adding { stop, .. } if self.control.mode != Mode::Open => {
                (self.control.checks_of_added(), stop.saturating_add(1))
            }
            _ => return None,
        };
        let counted = self.machine.counted();
        let skew = self.counter.total(counted).wrapping_sub(counted);
        Some(Watch { checks, reckoning: self.reckoning, skew, least })
    }

    const fn enter(&mut self, phase: Phase) {
        (self.phase, self.since) = (phase, self.machine.at);
    }

    /// Whether a check is due at this very instant.
    fn is_checked_now(&self) -> bool {
        let now = self.machine.at;
        if now == self.since {
            return false;
        }
        let just = now.as_nanos().checked_sub(1);
        let issued = self.machine.program_now().1;
        match self.control.mode {
            Mode::Open => false,
            Mode::Fixed => just.is_some_and(|just| {
                self.control.checks_until(issued, now.as_nanos()) != self.control.checks_until(issued, just)
            }),
            Mode::Dynamic => {
                let done = self.control.checks_until(issued, 0);
                issued > 0 && done != self.control.checks_until(issued - 1, 0) && self.machine.has_issued()
            }
        }
    }

    /// A check finds an error.
    fn check(&mut self) {
        let error = self.err();
        let hz = self.machine.run.map(|run| run.hz);
        self.machine.cut();
        self.events.push_back(LoopEvent::Stop);
        if error.saturating_abs() > self.control.stop {
            self.give_up(Cause::TooFar);
        } else if self.control.law == Law::AtOnce {
            // A quiet check in between has ended the tries.
            if self.stats.checks > self.corrected + 1 {
                self.control.restart();
            }
            self.corrected = self.stats.checks;
            self.decide(hz);
        } else {
            self.control.restart();
            self.enter(Phase::Settling(self.machine.at + self.control.settle));
        }
    }

    /// The loop looks at the error, and decides.
    fn decide(&mut self, hz: Option<f64>) {
        match self.control.judge(self.err()) {
            Verdict::Quiet => {
                self.enter(Phase::Watching);
                self.events.push_back(LoopEvent::Resume { ramp: self.control.law == Law::Pause });
            }
            Verdict::Correct(pulses) => {
                self.stats.corrections += 1;
                self.stats.corrected_pulses += pulses.unsigned_abs();
                self.add(pulses, hz, self.control.law == Law::Pause);
            }
            Verdict::GiveUp(cause) => self.give_up(cause),
        }
    }

    /// Adds pulses from now on.
    fn add(&mut self, pulses: i64, hz: Option<f64>, settle: bool) {
        // The pulse that has begun is completed first.
        let first = self.machine.run.map_or(self.machine.at, |run| run.end.max(self.machine.at));
        let train = self.control.added(first, pulses, hz);
        self.machine.feed(&train, pulses.signum(), true);
        let stop = self.control.stop_of_added(self.err());
        self.enter(Phase::Adding { until: train.end(), settle, stop });
        self.events.push_back(LoopEvent::Correct { forward: pulses > 0, train });
    }

    fn give_up(&mut self, cause: Cause) {
        let error_pm = self.err();
        self.machine.cut();
        self.enter(Phase::Alarmed);
        self.stats.alarms += 1;
        self.events.push_back(LoopEvent::Alarm(Alarm { cause, error_pm }));
    }
}
