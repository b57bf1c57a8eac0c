//! The way that the tool went: what the boards tell of their axes, kept until the part is to be cut.

use torno_part::{Happening, Profile, Turning};
use torno_protocol::time::Instant;

use super::{Part, Source};
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

/// The sum of a source's quantities.
struct Sum<'a> {
    source: &'a Source,
    values: Vec<i64>,
    sum: i64,
}

impl<'a> Sum<'a> {
    /// Quantities count from where the rig starts: they are 0 there.
    fn new(source: &'a Source) -> Self {
        Self { source, values: vec![0; source.signals.len()], sum: 0 }
    }

    fn put(&mut self, signal: u8, value: i64) {
        for (known, place) in self.source.signals.iter().zip(&mut self.values) {
            if *known == signal {
                *place = value;
            }
        }
        self.sum = self.values.iter().fold(0, |sum, value| sum.saturating_add(*value));
    }
}

/// What moves the tool along the bar and across it, and what turns the bar.
fn sources(part: &Part) -> [&Source; 3] {
    [&part.z.way, &part.x.way, &part.spindle]
}

impl ToolPath {
    /// A tool that has not moved yet.
    pub fn new(part: &Part) -> Self {
        Self { part: part.clone(), told: Default::default() }
    }

    /// Takes note of a fact.
    pub fn add(&mut self, fact: &Fact) {
        let Fact::Telemetry { node, at, signal, value } = fact else { return };
        for (source, told) in sources(&self.part).iter().zip(&mut self.told) {
            if source.node == *node && source.signals.contains(signal) {
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
        while let Some(at) = told.iter().filter_map(|told| told.first()).map(|told| told.at).min() {
            for (sum, told) in sums.iter_mut().zip(&mut told) {
                while let [first, rest @ ..] = *told
                    && first.at == at
                {
                    sum.put(first.signal, first.value);
                    *told = rest;
                }
            }
            let to = part.place(sums[0].sum, sums[1].sum);
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
