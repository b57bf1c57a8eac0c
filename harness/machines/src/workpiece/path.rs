//! The way that the tool went: what the boards report of their axes, and the bar as it is cut along it.

use std::collections::VecDeque;

use torno_part::{Happening, Place, Profile, Turning};
use torno_protocol::time::Instant;

use super::{Follower, Part, Source};
use torno_engine::Fact;

/// The way of a rig's tool, as the boards told it.
#[derive(Clone, Debug)]
pub struct ToolPath {
    part: Part,
    /// What moves the tool along the bar and across it, and what turns the bar.
    sums: [Sum; 3],
    turning: Turning,
    place: Place,
}

/// A quantity's new value.
#[derive(Clone, Copy, Debug)]
struct NewValue {
    at: Instant,
    signal: u8,
    value: i64,
}

/// What came of the bar.
#[derive(Clone, Debug)]
pub struct Turned {
    /// What is left of it.
    pub profile: Profile,
    /// What should not have happened.
    pub happenings: Vec<Happening>,
}

/// The sum of a source's quantities, and where the slide is that they count.
#[derive(Clone, Debug)]
struct Sum {
    source: Source,
    follower: Option<Follower>,
    /// What has been told and not been cut yet.
    told: VecDeque<NewValue>,
    values: Vec<i64>,
    sum: i64,
}

impl Sum {
    /// Quantities count from where the rig starts: they are 0 there.
    fn new(source: &Source, follower: Option<&Follower>) -> Self {
        let values = vec![0; source.signals.len()];
        Self { source: source.clone(), follower: follower.cloned(), told: VecDeque::new(), values, sum: 0 }
    }

    /// Takes note of a fact.
    fn add(&mut self, fact: &Fact) {
        let Fact::Telemetry { node, at, signal, value } = fact else { return };
        let follows = || self.follower.as_ref().is_some_and(|it| it.drive == *signal);
        if self.source.node == *node && (self.source.signals.contains(signal) || follows()) {
            self.told.push_back(NewValue { at: *at, signal: *signal, value: *value });
        }
    }

    /// When it next changes, as far as that is known. A slide that has been switched off coasts, and no board tells
    /// where to.
    fn next(&self) -> Option<Instant> {
        let coasting = self.follower.as_ref().and_then(|follower| follower.slide.stands_at());
        self.told.front().map(|told| told.at).into_iter().chain(coasting).min()
    }

    /// Goes on to `at`, which is not after the next change.
    fn go_on(&mut self, at: Instant) {
        let Self { source, follower, told, values, sum } = self;
        if let Some(Follower { slide, .. }) = follower {
            slide.advance(at);
        }
        let mut changed = false;
        while told.front().is_some_and(|told| told.at == at)
            && let Some(NewValue { signal, value, .. }) = told.pop_front()
        {
            changed = true;
            for (known, place) in source.signals.iter().zip(&mut *values) {
                if *known == signal {
                    *place = value;
                }
            }
            if let Some(Follower { drive, slide }) = follower
                && signal == *drive
            {
                slide.drive(value);
            }
        }
        if changed {
            *sum = values.iter().fold(0, |sum, value| sum.saturating_add(*value));
            if let Some(Follower { slide, .. }) = follower {
                slide.count(*sum);
            }
        }
    }

    fn counts(&self) -> f64 {
        self.follower.as_ref().map_or(self.sum as f64, |follower| follower.slide.counts())
    }
}

impl ToolPath {
    /// A tool that has not moved yet.
    pub fn new(part: &Part) -> Self {
        let Part { z, x, spindle, .. } = part;
        let place = part.place(0, 0);
        Self {
            sums: [
                Sum::new(&z.way, z.follower.as_ref()),
                Sum::new(&x.way, x.follower.as_ref()),
                Sum::new(spindle, None),
            ],
            turning: Turning::new(part.bar(), part.nose, part.limits, part.resolution(), place),
            place,
            part: part.clone(),
        }
    }

    /// Takes note of a fact.
    pub fn add(&mut self, fact: &Fact) {
        self.sums.iter_mut().for_each(|sum| sum.add(fact));
    }

    /// Cuts the bar along all that was gone before `until`, if every fact before that has been added. What different
    /// boards tell is settled in no certain order; what one tells is in the order of time.
    pub fn cut_before(&mut self, until: Instant) {
        while let Some(at) = self.sums.iter().filter_map(Sum::next).min().filter(|at| *at < until) {
            self.sums.iter_mut().for_each(|sum| sum.go_on(at));
            let to = self.part.between(self.sums[0].counts(), self.sums[1].counts());
            if to != self.place {
                self.place = to;
                self.turning.go(at.as_secs_f64(), to);
            }
            self.turning.spin(self.part.spindle.per_count * self.sums[2].sum as f64);
        }
    }

    /// What has come of the bar so far.
    pub fn turned(&self) -> Turned {
        let (profile, happenings) = self.turning.clone().finish();
        Turned { profile, happenings }
    }

    /// Cuts the bar along the whole way.
    pub fn cut(mut self) -> Turned {
        self.cut_before(Instant::NEVER);
        let (profile, happenings) = self.turning.finish();
        Turned { profile, happenings }
    }
}
