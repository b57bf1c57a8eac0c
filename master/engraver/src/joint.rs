//! One axis with the pins that drive it, and the part of the plan that it still has to do.

use std::collections::VecDeque;

use torno_motion::Train as Planned;
use torno_protocol::board::{Deadline, Output, Pin, PinOutput};
use torno_protocol::line::Level;
use torno_protocol::time::{Instant, Span};
use torno_protocol::train::Train;
use torno_stepper::{Alarm, Axis, LoopEvent, State, Stats};

use crate::probe::Probe;

/// How long a step pulse is high. The drive wants 2.5 µs at least.
const HIGH: Span = Span::from_micros(3);
/// From one pulse to the next where a few are left over. (Ours.)
const LEFT_OVER: Span = Span::from_micros(100);
/// An axis that stood alone gains speed in steps of so long, as GRBL ramps. (Ours.)
const RAMP_STEP: Span = Span::from_millis(10);
/// What is told of an axis: what it is to do, where its carriage is, how often its loop has corrected; and at rest also
/// how often it has looked, and how far the carriage was off while the program moved it.
pub(crate) const SIGNALS: u8 = 5;
/// So many of them are told while it moves.
const WHILE_MOVING: usize = 3;

/// What has come of an axis's loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LoopReport {
    /// Its train has stopped.
    Stopped,
    /// The encoder's index mark has passed.
    Index,
    /// At the index mark so many counts were missing.
    Miscounted(i64),
    /// It gives up.
    Alarm(Alarm),
}

/// What a segment of the plan asks of one axis. Instants are the plan's.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Piece {
    pub(crate) start: Instant,
    pub(crate) end: Instant,
    /// Where it begins, in steps.
    pub(crate) from: i64,
    pub(crate) train: Planned,
}

impl Piece {
    /// Where it ends, in steps.
    fn to(&self) -> i64 {
        self.from + i64::from(self.train.sign()) * i64::from(self.train.count)
    }

    /// Steps in a second.
    fn hz(&self) -> f64 {
        match self.train.period.numerator {
            0 => 0.0,
            nanos => f64::from(self.train.period.denominator) * 1e9 / nanos as f64,
        }
    }

    /// It ends at `at`, and the pulses after that do not come.
    fn cut(&mut self, at: Instant) {
        if at < self.end {
            self.train.count = self.train.issued(at);
            self.end = at;
        }
    }
}

/// The way from rest back to the plan's speed, in steps of [`RAMP_STEP`].
#[derive(Clone, Copy, Debug)]
struct Ramp {
    /// The step under way, from 0, and how many there are.
    step: u64,
    steps: u64,
    began: Instant,
}

impl Ramp {
    fn ends(&self) -> Instant {
        self.began + RAMP_STEP
    }

    /// The speed as a share of the plan's: these twice.
    const fn share(&self) -> (u64, u64) {
        (2 * self.step + 1, 2 * self.steps)
    }

    /// How much later it is at `now` than at the beginning of the step.
    fn loses(&self, now: Instant) -> Span {
        let (part, of) = self.share();
        let gone = now.since(self.began).as_nanos();
        Span::from_nanos(gone - (u128::from(gone) * u128::from(part) / u128::from(of)) as u64)
    }
}

/// An axis and its pins.
#[derive(Clone, Debug)]
pub(crate) struct Joint {
    axis: Axis,
    probe: Option<Probe>,
    /// Something has happened to the axis last.
    touched: Instant,
    /// The number of its step pin; behind it comes the one for the direction.
    pin: u8,
    forward: bool,
    /// A train is on the step pin.
    steps: bool,
    /// When the motor has done the last pulse that was put on it.
    until: Instant,
    /// From a pulse of it to the next.
    period: Span,
    /// The plan counts so many more steps than the axis.
    offset: i64,
    /// What it is doing, and what comes then.
    current: Option<Piece>,
    queue: VecDeque<Piece>,
    /// It is so much later than the others.
    lag: Span,
    /// Since when it stands alone while the others go on.
    stopped: Option<Instant>,
    /// It gains speed after that.
    ramp: Option<Ramp>,
    told: [i64; SIGNALS as usize],
    outputs: VecDeque<Output>,
}

impl Joint {
    pub(crate) fn new(axis: Axis, pin: u8) -> Self {
        Self {
            axis,
            probe: None,
            touched: Instant::START,
            pin,
            forward: true,
            steps: false,
            until: Instant::START,
            period: Span::ZERO,
            offset: 0,
            current: None,
            queue: VecDeque::new(),
            lag: Span::ZERO,
            stopped: None,
            ramp: None,
            told: [0; SIGNALS as usize],
            outputs: VecDeque::new(),
        }
    }

    pub(crate) const fn axis(&self) -> &Axis {
        &self.axis
    }

    /// The axis, for something that happens to it at `now`.
    pub(crate) fn axis_mut(&mut self, now: Instant) -> &mut Axis {
        self.note(now);
        &mut self.axis
    }

    /// A logic analyser is on the lines of its encoder from now on, which is power-on.
    pub(crate) fn watch(&mut self, name: &str) {
        self.probe = Some(Probe::new(&self.axis, name));
    }

    /// What the lines of its encoder have done before `until`.
    pub(crate) fn pins(&mut self, until: Instant) -> Vec<Pin> {
        self.note(until);
        self.probe.as_ref().map_or(Vec::new(), |probe| probe.pins().to_vec())
    }

    fn note(&mut self, now: Instant) {
        if let Some(probe) = &mut self.probe {
            probe.note(&self.axis, self.touched, now);
        }
        self.touched = now;
    }

    /// The next segment asks this of it; what it has to do for the one before ends there.
    pub(crate) fn push(&mut self, piece: Piece) {
        self.cut_plan(piece.start);
        self.queue.push_back(piece);
    }

    /// The plan ends at `at`.
    pub(crate) fn cut_plan(&mut self, at: Instant) {
        if let Some(last) = self.queue.back_mut().or(self.current.as_mut()) {
            last.cut(at);
        }
    }

    /// Begins what is due. The plan's time is `shift` behind. Says whether there was anything.
    pub(crate) fn begin(&mut self, now: Instant, shift: Span) -> bool {
        if self.stopped.is_some() || self.ramp.is_some() || self.axis.state() != State::Ready {
            return false;
        }
        if self.queue.front().is_none_or(|piece| piece.start + shift + self.lag > now) {
            return false;
        }
        self.current = self.queue.pop_front();
        self.go_on(now, shift);
        true
    }

    /// Does what is left of the piece under way.
    pub(crate) fn go_on(&mut self, now: Instant, shift: Span) {
        let Some(Piece { train, .. }) = self.current else { return };
        let left = self.left(now);
        if left == 0 {
            return self.cut(now);
        }
        let (forward, count) = (left > 0, left.unsigned_abs());
        let next = u64::from(train.count).checked_sub(count).and_then(|next| u32::try_from(next).ok());
        let (nanos, per) = match forward == train.forward && train.period.numerator > 0 {
            true => (train.period.numerator, u64::from(train.period.denominator)),
            false => (LEFT_OVER.as_nanos(), 1),
        };
        if let Some(ramp) = self.ramp {
            let (part, of) = ramp.share();
            let nanos = (u128::from(nanos) * u128::from(of)).div_ceil(u128::from(part));
            let period = nanos.div_ceil(u128::from(per)) as u64;
            let count = count.min(RAMP_STEP.as_nanos().div_ceil(period));
            let nanos = nanos.min(u128::from(u64::MAX)) as u64;
            return self.feed(now, forward, Train { first: now.max(self.until), nanos, per, count, high: HIGH });
        }
        let first = match next {
            Some(next) if forward == train.forward && train.count > 0 => train.pulse(next) + shift + self.lag,
            _ => now,
        };
        self.feed(now, forward, Train { first: first.max(now), nanos, per, count, high: HIGH });
    }

    /// At the end of a ramp: the plan's next pulse comes no sooner than the last one of the ramp is over.
    fn catch_pulse(&mut self, now: Instant, shift: Span) {
        let left = u32::try_from(self.left(now).unsigned_abs()).unwrap_or(u32::MAX);
        let next = self.current.and_then(|piece| Some(piece.train.pulse(piece.train.count.checked_sub(left)?)));
        if let Some(at) = next {
            self.lag = self.lag + self.until.since(at + shift + self.lag);
        }
    }

    /// How many steps of the piece under way have not been given.
    fn left(&self, now: Instant) -> i64 {
        self.current.map_or(0, |piece| piece.to() - self.position(now))
    }

    /// Where it is, in the plan's steps.
    fn position(&self, now: Instant) -> i64 {
        self.axis.issued(now) + self.offset
    }

    /// Stands alone, while the others go on.
    pub(crate) fn stop(&mut self, now: Instant) {
        self.stopped = Some(now);
        // The rest of its train does not come.
        self.until = self.until.min(now);
        if let Some(ramp) = self.ramp.take() {
            self.lag = self.lag + ramp.loses(now);
        }
    }

    /// Goes on, if it stood alone and its loop is done, and gains `acceleration`, in steps/s². Says whether anything
    /// was due.
    pub(crate) fn follow(&mut self, now: Instant, shift: Span, acceleration: f64) -> bool {
        if let Some(since) = self.stopped.take_if(|_| self.axis.state() == State::Ready) {
            self.lag = self.lag + now.since(since);
            let speed = self.current.map_or(0.0, |piece| piece.hz());
            let steps = (speed / acceleration / RAMP_STEP.as_secs_f64()).ceil() as u64;
            self.ramp = (steps > 0).then_some(Ramp { step: 0, steps, began: now });
        } else if let Some(ramp) = self.ramp.take_if(|ramp| ramp.ends() <= now) {
            self.lag = self.lag + ramp.loses(now);
            let next = Ramp { step: ramp.step + 1, steps: ramp.steps, began: now };
            self.ramp = (next.step < next.steps).then_some(next);
            if self.ramp.is_none() {
                self.catch_pulse(now, shift);
            }
        } else {
            return false;
        }
        self.go_on(now, shift);
        true
    }

    /// No pulse from now on.
    pub(crate) fn cut(&mut self, now: Instant) {
        self.axis_mut(now).cut(now);
        self.until = self.until.min(now + self.period);
        self.put_nothing(now);
    }

    /// Forgets the plan, which is at `position`.
    pub(crate) fn forget(&mut self, now: Instant, position: i64) {
        self.cut(now);
        (self.current, self.stopped, self.ramp, self.lag) = (None, None, None, Span::ZERO);
        self.queue.clear();
        self.offset = position - self.axis.issued(now);
    }

    /// The plan has no more for it: its loop looks once more.
    pub(crate) fn finish(&mut self, now: Instant) {
        self.current = None;
        self.lag = Span::ZERO;
        self.axis_mut(now).end(now);
    }

    /// When it begins the next piece, or ends the last one.
    pub(crate) fn next(&self, shift: Span) -> Option<Instant> {
        if let Some(ramp) = &self.ramp {
            return Some(ramp.ends());
        }
        let next = self.queue.front().map(|piece| piece.start);
        let at = next.or(self.current.map(|piece| piece.end))?;
        self.stopped.is_none().then(|| at + shift + self.lag)
    }

    /// Whether it has done all of the plan.
    pub(crate) fn is_done(&self, now: Instant, shift: Span) -> bool {
        let ended = self.current.is_none_or(|piece| piece.end + shift + self.lag <= now);
        self.queue.is_empty() && self.stopped.is_none() && self.ramp.is_none() && ended
    }

    /// When the motor has done the last pulse that was put on it.
    pub(crate) const fn until(&self) -> Instant {
        self.until
    }

    /// Whether its loop lets it move.
    pub(crate) fn is_ready(&self) -> bool {
        self.axis.state() == State::Ready
    }

    /// When something of its loop happens.
    pub(crate) fn poll_timeout(&self) -> Option<Deadline> {
        self.axis.poll_timeout()
    }

    /// What its loop has done; None if that is all.
    pub(crate) fn poll(&mut self, now: Instant) -> Option<LoopReport> {
        loop {
            match self.axis.poll_event()? {
                LoopEvent::Stop => {
                    self.put_nothing(now);
                    return Some(LoopReport::Stopped);
                }
                LoopEvent::Correct { forward, train } => self.put(forward, train),
                LoopEvent::Resume { .. } => {}
                LoopEvent::Index => return Some(LoopReport::Index),
                LoopEvent::Miscounted(counts) => return Some(LoopReport::Miscounted(counts)),
                LoopEvent::Alarm(alarm) => {
                    self.put_nothing(now);
                    return Some(LoopReport::Alarm(alarm));
                }
            }
        }
    }

    fn feed(&mut self, now: Instant, forward: bool, train: Train) {
        self.axis_mut(now).train(now, forward, train);
        if self.is_ready() {
            (self.until, self.period) = (train.end(), Span::from_nanos(train.nanos / train.per));
            self.put(forward, train);
        }
    }

    fn put(&mut self, forward: bool, train: Train) {
        if forward != self.forward {
            self.forward = forward;
            let level = if forward { Level::Low } else { Level::High };
            self.outputs.push_back(Output::Pin { pin: self.pin + 1, what: PinOutput::Level(level) });
        }
        self.steps = true;
        self.outputs.push_back(Output::Pin { pin: self.pin, what: PinOutput::Pulses(Train { high: HIGH, ..train }) });
    }

    fn put_nothing(&mut self, now: Instant) {
        if core::mem::take(&mut self.steps) {
            let nothing = Train { first: now, nanos: 1, per: 1, count: 0, high: HIGH };
            self.outputs.push_back(Output::Pin { pin: self.pin, what: PinOutput::Pulses(nothing) });
        }
    }

    /// What it is to do, where its carriage is, in nm, and how often its loop has corrected. A pulse is `pulse_nm`.
    pub(crate) fn values(&self, at: Instant, pulse_nm: f64) -> [i64; WHILE_MOVING] {
        let asked = (self.position(at) as f64 * pulse_nm) as i64;
        [asked, self.axis.carriage(at) / 1_000, self.axis.corrections().cast_signed()]
    }

    /// Tells at rest what its loop has done so far, in quantities from `signal` on.
    pub(crate) fn tell_rest(&mut self, now: Instant, signal: u8) {
        let Stats { checks, worst_pm, .. } = self.axis.stats(now);
        let values = [checks.cast_signed(), worst_pm / 1_000];
        self.note_told(signal, WHILE_MOVING, &values);
    }

    /// Tells where it is, in quantities from `signal` on. A pulse is worth `pulse_nm`.
    pub(crate) fn tell(&mut self, now: Instant, pulse_nm: f64, signal: u8) {
        let values = self.values(now, pulse_nm);
        self.note_told(signal, 0, &values);
    }

    /// Tells what of these quantities, from number `first` on, is another than it was told last.
    fn note_told(&mut self, signal: u8, first: usize, values: &[i64]) {
        let told = (signal..).zip(&mut self.told).skip(first);
        for ((n, told), value) in told.zip(values) {
            if core::mem::replace(told, *value) != *value {
                self.outputs.push_back(Output::Telemetry { signal: n, value: *value });
            }
        }
    }

    pub(crate) fn poll_output(&mut self) -> Option<Output> {
        self.outputs.pop_front()
    }
}
