//! A bench: one axis, and a sender of trapezoids that stops and goes on as the axis's loop says.

#![allow(dead_code, reason = "each test file uses a part of it")]
#![allow(clippy::unwrap_used, reason = "part of tests")]

pub(crate) mod slow;

use std::collections::VecDeque;

use torno_protocol::time::{Instant, Span};
use torno_protocol::train::Train;
use torno_stepper::{Alarm, Axis, AxisSettings, Fault, LoopEvent, State, Stats};

pub(crate) const MM: i64 = 1_000_000_000;

/// The acceleration in mm/s², and how long a step of a ramp lasts.
const ACCELERATION: f64 = 200.0;
const STEP_MS: u64 = 5;

/// Pulses at a constant rate for as long as they take.
#[derive(Clone, Copy, Debug)]
struct Segment {
    nanos: u64,
    per: u64,
    count: u64,
}

/// What a bench drives: an axis, or something that ought to be like one.
pub(crate) trait Driven {
    fn train(&mut self, now: Instant, forward: bool, train: Train);
    fn end(&mut self, now: Instant);
    fn deadline(&self) -> Option<Instant>;
    fn handle_timeout(&mut self, now: Instant);
    fn poll_event(&mut self) -> Option<LoopEvent>;
    fn fault(&mut self, now: Instant, fault: Fault);
    fn issued(&self, now: Instant) -> i64;
    fn is_ready(&self) -> bool;
}

impl Driven for Axis {
    fn train(&mut self, now: Instant, forward: bool, train: Train) {
        Self::train(self, now, forward, train);
    }

    fn end(&mut self, now: Instant) {
        Self::end(self, now);
    }

    fn deadline(&self) -> Option<Instant> {
        self.poll_timeout().map(|deadline| deadline.at)
    }

    fn handle_timeout(&mut self, now: Instant) {
        Self::handle_timeout(self, now);
    }

    fn poll_event(&mut self) -> Option<LoopEvent> {
        Self::poll_event(self)
    }

    fn fault(&mut self, now: Instant, fault: Fault) {
        Self::fault(self, now, fault);
    }

    fn issued(&self, now: Instant) -> i64 {
        Self::issued(self, now)
    }

    fn is_ready(&self) -> bool {
        self.state() == State::Ready
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Bench<A = Axis> {
    pub(crate) axis: A,
    pub(crate) now: Instant,
    pub(crate) events: Vec<(Instant, LoopEvent)>,
    pulse_mm: f64,
    /// Where the program is to go, in pulses, and how fast.
    target: i64,
    speed: f64,
    segments: VecDeque<Segment>,
    current: Segment,
    /// When the next segment begins, and where the program's pulses are then.
    next: Instant,
    planned: i64,
    ended: bool,
    /// In mm/s².
    pub(crate) acceleration: f64,
    /// Ramps gain speed from pulse to pulse, instead of every 5 ms.
    pub(crate) smooth: bool,
    /// Each pulse is over after a microsecond: the field steps, and the pulse is counted, as it begins.
    pub(crate) stepped: bool,
    pub(crate) faults: VecDeque<(Instant, Fault)>,
}

pub(crate) fn ms(ms: f64) -> Instant {
    Instant::from_nanos((ms * 1e6).round() as u64)
}

/// Settings of an axis whose rotor is in closed form, unless it is changed.
pub(crate) fn with(change: impl FnOnce(&mut AxisSettings)) -> AxisSettings {
    let mut settings = AxisSettings::default();
    settings.motor.rotor_hz = 0.0;
    change(&mut settings);
    settings.check().unwrap();
    settings
}

impl Bench {
    pub(crate) fn new(settings: &AxisSettings) -> Self {
        Self::of(Axis::new(settings), settings)
    }

    pub(crate) fn stats(&self) -> Stats {
        self.axis.stats(self.now)
    }

    pub(crate) fn carriage_mm(&self) -> f64 {
        self.axis.carriage(self.now) as f64 / 1e9
    }

    pub(crate) fn deviation_mm(&self) -> f64 {
        self.axis.deviation(self.now) as f64 / 1e9
    }

    pub(crate) fn worst_mm(&self) -> f64 {
        self.stats().worst_pm as f64 / 1e9
    }
}

impl<A: Driven> Bench<A> {
    pub(crate) fn of(axis: A, settings: &AxisSettings) -> Self {
        Self {
            axis,
            now: Instant::START,
            events: Vec::new(),
            pulse_mm: settings.scale().pulse_mm(),
            target: 0,
            speed: 0.0,
            segments: VecDeque::new(),
            current: Segment { nanos: 1, per: 1, count: 0 },
            next: Instant::START,
            planned: 0,
            ended: true,
            acceleration: ACCELERATION,
            smooth: false,
            stepped: false,
            faults: VecDeque::new(),
        }
    }

    /// A fault so many milliseconds from now, and another one later.
    pub(crate) fn fault(&mut self, at: f64, fault: Fault) -> &mut Self {
        self.faults.push_back((self.now + Span::from_nanos((at * 1e6).round() as u64), fault));
        self.faults.make_contiguous().sort_by_key(|(at, _)| *at);
        self
    }

    /// Goes by so many mm, waits until the axis is at rest, and some more.
    pub(crate) fn go(&mut self, mm: f64, speed: f64) -> &mut Self {
        self.target += (mm / self.pulse_mm).round() as i64;
        self.speed = speed;
        self.ended = false;
        self.plan(true);
        self.run();
        self
    }

    /// Waits while faults come.
    pub(crate) fn wait(&mut self, ms: f64) -> &mut Self {
        let until = self.now + Span::from_nanos((ms * 1e6).round() as u64);
        self.run();
        self.now = self.now.max(until);
        self
    }

    pub(crate) fn alarm(&self) -> Option<(Instant, Alarm)> {
        self.events.iter().find_map(|(at, event)| match event {
            LoopEvent::Alarm(alarm) => Some((*at, *alarm)),
            _ => None,
        })
    }

    /// A trapezoid from where the program is to its target, from now on.
    fn plan(&mut self, ramp: bool) {
        self.next = self.now;
        self.planned = self.axis.issued(self.now);
        if !ramp {
            return;
        }
        self.segments.clear();
        let left = (self.target - self.planned).unsigned_abs();
        if self.smooth {
            return self.plan_smooth(left);
        }
        let step_s = STEP_MS as f64 / 1_000.0;
        let mut ramp = Vec::new();
        loop {
            let speed = self.acceleration * step_s * (ramp.len() as f64 + 0.5);
            let count = (speed * step_s / self.pulse_mm).round().max(1.0) as u64;
            let all = ramp.iter().map(|segment: &Segment| segment.count).sum::<u64>() + count;
            if speed >= self.speed || 2 * all > left {
                break;
            }
            ramp.push(Segment { nanos: STEP_MS * 1_000_000, per: count, count });
        }
        let ramped: u64 = ramp.iter().map(|segment| segment.count).sum();
        let reached = match ramp.last() {
            // It may not get as fast as it ought to.
            Some(last) if 2 * (ramped + last.count) > left => last.per as f64 / step_s * self.pulse_mm,
            Some(_) => self.speed,
            None => self.speed.min(self.acceleration * step_s),
        };
        let cruise = left - 2 * ramped;
        self.segments.extend(ramp.iter());
        if cruise > 0 {
            let (nanos, per) = ((self.pulse_mm * 1e12).round() as u64, (reached * 1e3).round() as u64);
            self.segments.push_back(Segment { nanos, per, count: cruise });
        }
        self.segments.extend(ramp.iter().rev());
    }

    fn plan_smooth(&mut self, left: u64) {
        let at = |pulses: u64| (2.0 * pulses as f64 * self.pulse_mm / self.acceleration).sqrt();
        let fast = (self.speed * self.speed / 2.0 / self.acceleration / self.pulse_mm).floor() as u64;
        let ramp = (0..fast.min(left / 2)).map(|n| {
            let nanos = ((at(n + 1) - at(n)) * 1e9).round() as u64;
            Segment { nanos, per: 1, count: 1 }
        });
        let ramp: Vec<_> = ramp.collect();
        let count = left - 2 * ramp.len() as u64;
        let nanos = ((self.pulse_mm / self.speed * 1e9).round() as u64).max(ramp.last().map_or(0, |last| last.nanos));
        self.segments.extend(ramp.iter());
        if count > 0 {
            self.segments.push_back(Segment { nanos: nanos * count, per: count, count });
        }
        self.segments.extend(ramp.iter().rev());
    }

    fn run(&mut self) {
        let rest = Span::from_millis(30);
        // A loop may hunt for ever.
        let way = (self.target - self.axis.issued(self.now)) as f64 * self.pulse_mm;
        let most = self.now + ms(60_000.0 + 2_000.0 * (way / self.speed.max(0.1)).abs()).since(Instant::START);
        loop {
            let deadline = self.axis.deadline();
            let fault = self.faults.front().map(|(at, _)| *at);
            let segment = (self.axis.is_ready() && !self.ended).then_some(self.next);
            let Some(at) = [fault, deadline, segment].into_iter().flatten().min() else { break };
            if at > most {
                break;
            }
            self.now = at.max(self.now);
            if fault == Some(at) {
                let (_, fault) = self.faults.pop_front().unwrap();
                self.axis.fault(self.now, fault);
            } else if deadline == Some(at) {
                self.axis.handle_timeout(self.now);
            } else {
                self.begin_segment();
            }
            self.drain();
        }
        self.now += rest;
    }

    fn begin_segment(&mut self) {
        let Some(segment) = self.segments.pop_front() else {
            self.ended = true;
            return self.axis.end(self.now);
        };
        let Segment { nanos, per, mut count } = segment;
        let mut train = Train { first: self.now, nanos, per, count, high: Span::from_nanos(nanos / per / 2) };
        let forward = self.target >= self.planned;
        self.next = train.end();
        if self.stepped {
            train = Train { first: self.now, nanos: 1_000, per: 1, count: 1, high: Span::from_nanos(500) };
            self.next = self.now + Span::from_nanos((nanos + per / 2) / per);
            if count > 1 {
                self.segments.push_front(Segment { count: count - 1, ..segment });
                count = 1;
            }
        }
        self.planned += if forward { count as i64 } else { -(count as i64) };
        self.current = segment;
        self.axis.train(self.now, forward, train);
    }

    fn drain(&mut self) {
        while let Some(event) = self.axis.poll_event() {
            self.events.push((self.now, event));
            match event {
                LoopEvent::Stop => {
                    // The rest of the segment under way is still to come.
                    let left = (self.planned - self.axis.issued(self.now)).unsigned_abs();
                    if left > 0 {
                        self.segments.push_front(Segment { count: left, ..self.current });
                    }
                }
                LoopEvent::Resume { ramp } => {
                    self.ended = false;
                    self.plan(ramp);
                }
                LoopEvent::Correct { .. } | LoopEvent::Index | LoopEvent::Miscounted(_) | LoopEvent::Alarm(_) => {}
            }
        }
    }
}
