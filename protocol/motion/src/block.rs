//! A block: one straight motion.

use crate::limits::{AXES, Limits, unit};

/// GRBL's least feed, mm a minute. A feed of 0 would never end.
const LEAST_FEED: f64 = 1.0;

/// How fast a motion goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rate {
    /// As fast as the axes can: G0.
    Rapid,
    /// mm a minute: G94.
    Feed(f64),
    /// mm a minute, and no override changes it: `$J=`.
    Jog(f64),
    /// The whole motion takes this part of a minute: G93.
    InverseTime(f64),
}

/// What the operator has changed, percent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Overrides {
    pub(crate) feed: u8,
    pub(crate) rapid: u8,
}

/// A straight motion with what the look-ahead knows of it. Speeds are mm/s.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    /// With their signs.
    pub(crate) steps: [i64; AXES],
    /// mm.
    pub(crate) length: f64,
    /// mm/s², along the motion.
    pub(crate) acceleration: f64,
    /// As fast as the axes can.
    rapid: f64,
    rate: Rate,
    /// The square of what the junction before it allows.
    pub(crate) junction: f64,
    /// The square of what the junction, this block and the one before it allow.
    pub(crate) max_entry: f64,
    /// The square of the planned entry speed.
    pub(crate) entry: f64,
}

impl Block {
    /// A block with its direction. None if no axis has a step to go.
    pub(crate) fn new(steps: [i64; AXES], rate: Rate, limits: &Limits) -> Option<(Self, [f64; AXES])> {
        if steps == [0; AXES] {
            return None;
        }
        let (direction, length) = unit(core::array::from_fn(|n| steps[n] as f64 / limits.axes[n].steps_per_mm));
        let block = Self {
            steps,
            length,
            acceleration: limits.along(&direction, |axis| axis.acceleration),
            rapid: limits.along(&direction, |axis| axis.max_rate) / 60.0,
            rate,
            junction: 0.0,
            max_entry: 0.0,
            entry: 0.0,
        };
        Some((block, direction))
    }

    /// The same motion with other steps, along the same line as far as steps allow. None if there are none.
    pub(crate) fn with_steps(&self, steps: [i64; AXES], limits: &Limits) -> Option<Self> {
        Self::new(steps, self.rate, limits).map(|(block, _)| block)
    }

    /// The speed that it is to go at.
    pub(crate) fn nominal(&self, overrides: Overrides) -> f64 {
        let percent = |percent: u8| f64::from(percent) / 100.0;
        let feed = |per_minute: f64| (per_minute / 60.0).min(self.rapid);
        let speed = match self.rate {
            Rate::Rapid => self.rapid * percent(overrides.rapid),
            Rate::Feed(rate) => feed(rate * percent(overrides.feed)),
            Rate::Jog(rate) => feed(rate),
            Rate::InverseTime(per_minute) => feed(per_minute * self.length * percent(overrides.feed)),
        };
        // Whatever is not a number ends up here, too.
        speed.max(LEAST_FEED / 60.0)
    }

    /// The steps of the axis that has most of them.
    pub(crate) fn most_steps(&self) -> u64 {
        self.steps.iter().map(|steps| steps.unsigned_abs()).max().unwrap_or(0)
    }
}
