//! Motion without interpolation: each axis has a timer of its own, which makes pulses at one frequency until it has
//! made as many as were asked for.
//!
//! After "Research on Low-Cost Implementation of Closed-loop Control Program for a Small Engraving Machine" (Lu and
//! others, 2016): `Stepping_Motor_Y(dir, pul, amount)` takes a sense, a frequency and a number of pulses, and an axis
//! starts when another one has made a set number of pulses. What the paper leaves open is ours: in a feed all axes
//! start at once, with frequencies in the ratio of their ways; in a rapid motion each goes as fast as it can, Z first
//! if it goes up and last if it goes down. There are no ramps. A motion begins when all axes have ended the one before.

use std::collections::VecDeque;

use torno_protocol::time::{Instant, Span};

use crate::block::{Block, Overrides, Rate};
use crate::limits::{AXES, Limits};
use crate::segment::{Period, Segment, Train};

/// What the timers count with: an STM32F217's APB2 timers.
const TIMER_HZ: u64 = 120_000_000;
/// A timer's reload has 16 bits.
const RELOADS: u64 = 1 << 16;
const Z: usize = 2;

/// A motion that has not begun.
#[derive(Clone, Debug)]
struct QueuedMotion {
    block: Block,
    rapid: bool,
}

/// Runs motions one after the other. The interface is the [`Planner`](crate::Planner)'s.
#[derive(Clone, Debug)]
pub struct Sequencer {
    limits: Limits,
    capacity: usize,
    prescaler: u32,
    waiting: VecDeque<QueuedMotion>,
    under_way: Option<(QueuedMotion, Segment)>,
    runs: bool,
    overrides: Overrides,
    /// Where the last motion ends.
    end: [i32; AXES],
    /// Where the segment under way starts, or the axes stand.
    position: [i32; AXES],
}

impl Sequencer {
    /// A sequencer at position 0 with room for `motions`. The timers count 120 MHz divided by at least `prescaler`: a
    /// slow train needs a larger one.
    pub fn new(limits: Limits, motions: usize, prescaler: u32) -> Self {
        Self {
            limits: limits.usable(),
            capacity: motions,
            prescaler: prescaler.max(1),
            waiting: VecDeque::new(),
            under_way: None,
            runs: false,
            overrides: Overrides { feed: 100, rapid: 100 },
            end: [0; AXES],
            position: [0; AXES],
        }
    }

    /// Other limits, for the motions that are pushed from now on.
    pub fn set_limits(&mut self, limits: Limits) {
        self.limits = limits.usable();
    }

    /// How many more motions it takes.
    pub fn room(&self) -> usize {
        self.capacity.saturating_sub(self.waiting.len())
    }

    /// Whether all motions are done.
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty() && self.under_way.is_none()
    }

    /// Takes a motion to `target`, in steps from position 0, after all others.
    pub fn push(&mut self, now: Instant, target: [i32; AXES], rate: Rate) {
        let steps: [i64; AXES] = core::array::from_fn(|n| i64::from(target[n]) - i64::from(self.end[n]));
        self.end = target;
        let rapid = rate == Rate::Rapid;
        let only = |of: &dyn Fn(usize) -> bool| core::array::from_fn(|n| if of(n) { steps[n] } else { 0 });
        let (lift, others) = (only(&|n| n == Z), only(&|n| n != Z));
        let parts = match (rapid, steps[Z] > 0) {
            (true, true) => vec![lift, others],
            (true, false) => vec![others, lift],
            (false, _) => vec![steps],
        };
        let blocks = parts.into_iter().filter_map(|steps| Block::new(steps, rate, &self.limits));
        self.waiting.extend(blocks.map(|(block, _)| QueuedMotion { block, rapid }));
        if self.runs && self.under_way.is_none() {
            self.begin(now);
        }
    }

    /// Starts the motions, or goes on.
    pub fn start(&mut self, now: Instant) {
        self.runs = true;
        if self.under_way.is_none() {
            self.begin(now);
        }
    }

    /// Stands at once, as no timer has a ramp. What is left waits for a [start](Self::start).
    pub fn hold(&mut self, now: Instant) {
        self.stop(now);
    }

    /// The same.
    pub fn stop(&mut self, now: Instant) {
        while self.advance(now) {}
        self.runs = false;
        if let Some((waiting, segment)) = self.under_way.take() {
            let issued = segment.issued(now);
            self.position = self.reached(&segment, now);
            let left = core::array::from_fn(|n| waiting.block.steps[n] - i64::from(issued[n]));
            if let Some(block) = waiting.block.with_steps(left, &self.limits) {
                self.waiting.push_front(QueuedMotion { block, ..waiting });
            }
        }
    }

    /// Stands at once, and forgets its motions.
    pub fn abort(&mut self, now: Instant) {
        self.stop(now);
        self.waiting.clear();
        self.end = self.position;
    }

    /// Overrides in percent, for the motions that begin from now on.
    pub fn set_overrides(&mut self, _now: Instant, feed: u8, rapid: u8) {
        self.overrides = Overrides { feed, rapid };
    }

    /// The steps that have been given until `now`.
    pub fn position(&self, now: Instant) -> [i32; AXES] {
        self.segment().map_or(self.position, |segment| self.reached(segment, now))
    }

    /// How fast the axes are to move together, mm a minute.
    pub fn rate(&self, now: Instant) -> f64 {
        let under_way = self.under_way.as_ref().filter(|(_, segment)| now < segment.end);
        under_way.map_or(0.0, |(waiting, _)| waiting.block.nominal(self.overrides) * 60.0)
    }

    /// The motion under way. None while the axes stand.
    pub fn segment(&self) -> Option<&Segment> {
        self.under_way.as_ref().map(|(_, segment)| segment)
    }

    /// Goes to the next motion, if the one under way has ended until `now`; says whether it had.
    pub fn advance(&mut self, now: Instant) -> bool {
        let Some((_, segment)) = self.under_way.take_if(|(_, segment)| segment.end <= now) else { return false };
        self.position = self.reached(&segment, segment.end);
        self.begin(segment.end);
        true
    }

    fn reached(&self, segment: &Segment, now: Instant) -> [i32; AXES] {
        let issued = segment.issued(now);
        core::array::from_fn(|n| self.position[n].wrapping_add(issued[n]))
    }

    fn begin(&mut self, now: Instant) {
        let Some(waiting) = self.waiting.pop_front() else {
            self.runs = false;
            return;
        };
        let QueuedMotion { block, rapid } = &waiting;
        let speed = block.nominal(self.overrides);
        let share = f64::from(self.overrides.rapid) / 100.0;
        let trains = core::array::from_fn(|n| {
            let steps = block.steps[n];
            let hz = match rapid {
                true => self.limits.axes[n].max_rate / 60.0 * share * self.limits.axes[n].steps_per_mm,
                false => speed / block.length * steps.unsigned_abs() as f64,
            };
            self.train(now, steps, hz)
        });
        let ends = |train: &Train| train.pulse(train.count.saturating_sub(1));
        let moves = trains.iter().filter(|train: &&Train| train.count > 0);
        let end = moves.map(ends).max().unwrap_or(now).max(now.next());
        self.under_way = Some((waiting, Segment { start: now, end, trains }));
    }

    /// So many steps by a timer that is to make `hz`. The first pulse comes when the timer has counted once.
    fn train(&self, now: Instant, steps: i64, hz: f64) -> Train {
        let ticks = (TIMER_HZ as f64 / hz.max(1e-3)) as u64;
        let prescaler = u64::from(self.prescaler).max(ticks / RELOADS + 1).min(RELOADS);
        let reload = libm::round(TIMER_HZ as f64 / prescaler as f64 / hz.max(1e-3)) as u64;
        // 25/3 ns a tick.
        let numerator = reload.clamp(1, RELOADS) * prescaler * 25;
        let count = u32::try_from(steps.unsigned_abs()).unwrap_or(u32::MAX);
        let first = now + Span::from_nanos(numerator / 3);
        Train {
            first: if count == 0 { Instant::NEVER } else { first },
            period: Period { numerator: if count == 0 { 0 } else { numerator }, denominator: 3 },
            count,
            forward: steps >= 0,
        }
    }
}
