//! The way that the tool went: what the boards tell of their axes, kept until the part is to be cut.

use torno_part::{Happening, Profile, Turning};
use torno_protocol::time::Instant;

use super::{Follower, Part, Source};
use torno_engine::Fact;

/// The way of a rig's tool, as the boards told it.
#[derive(Clone, Debug)]
pub struct ToolPath {
    part: Part,
    /// Of each of the part's [sources](sources), in order.
    told: [Vec<Told>; 3],
}

/// A quantity's new value.
#[derive(Clone, Copy, Debug)]
struct Told {
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
struct Sum<'a> {
    source: &'a Source,
    follower: Option<Follower>,
    values: Vec<i64>,
    sum: i64,
}

impl<'a> Sum<'a> {
    /// Quantities count from where the rig starts: they are 0 there.
    fn new((source, follower): (&'a Source, Option<&Follower>)) -> Self {
        Self { source, follower: follower.cloned(), values: vec![0; source.signals.len()], sum: 0 }
    }

    /// What has been told of `at`.
    fn put(&mut self, at: Instant, told: &[Told]) {
        for Told { signal, value, .. } in told {
            for (known, place) in self.source.signals.iter().zip(&mut self.values) {
                if known == signal {
                    *place = *value;
                }
            }
        }
        self.sum = self.values.iter().fold(0, |sum, value| sum.saturating_add(*value));
        let Some(Follower { drive, slide }) = &mut self.follower else { return };
        slide.advance(at);
        if !told.is_empty() {
            told.iter().filter(|told| told.signal == *drive).for_each(|told| slide.drive(told.value));
            slide.count(self.sum);
        }
    }

    fn counts(&self) -> f64 {
        self.follower.as_ref().map_or(self.sum as f64, |follower| follower.slide.counts())
    }
}

/// What moves the tool along the bar and across it, and what turns the bar.
fn sources(part: &Part) -> [(&Source, Option<&Follower>); 3] {
    let Part { z, x, spindle, .. } = part;
    [(&z.way, z.follower.as_ref()), (&x.way, x.follower.as_ref()), (spindle, None)]
}

impl ToolPath {
    /// A tool that has not moved yet.
    pub fn new(part: &Part) -> Self {
        Self { part: part.clone(), told: Default::default() }
    }

    /// Takes note of a fact.
    pub fn add(&mut self, fact: &Fact) {
        let Fact::Telemetry { node, at, signal, value } = fact else { return };
        for ((source, follower), told) in sources(&self.part).iter().zip(&mut self.told) {
            let needed = source.signals.contains(signal) || follower.is_some_and(|it| it.drive == *signal);
            if source.node == *node && needed {
                told.push(Told { at: *at, signal: *signal, value: *value });
            }
        }
    }

    /// Cuts the bar along it.
    pub fn cut(self) -> Turned {
        let Self { part, told } = self;
        let mut sums = sources(&part).map(Sum::new);
        let mut place = part.place(0, 0);
        let mut turning = Turning::new(part.bar(), part.nose, part.limits, part.resolution(), place);
        // What different boards tell is settled in no certain order; what one tells is in the order of time.
        let mut told = told.each_ref().map(Vec::as_slice);
        loop {
            let next = told.iter().filter_map(|told| told.first()).map(|told| told.at);
            // A slide that has been switched off coasts, and no board tells where to.
            let coasting = sums.iter().filter_map(|sum| sum.follower.as_ref()?.slide.stands_at());
            let Some(at) = next.chain(coasting).min() else { break };
            for (sum, told) in sums.iter_mut().zip(&mut told) {
                let (now, later) = told.split_at(told.iter().take_while(|told| told.at == at).count());
                sum.put(at, now);
                *told = later;
            }
            let to = part.between(sums[0].counts(), sums[1].counts());
            if to != place {
                place = to;
                turning.go(at.as_secs_f64(), place);
            }
            turning.spin(part.spindle.per_count * sums[2].sum as f64);
        }
        let (profile, happenings) = turning.finish();
        Turned { profile, happenings }
    }
}
