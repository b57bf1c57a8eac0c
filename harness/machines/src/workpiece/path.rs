//! The way that the tool went: what the boards tell of their axes, kept until the part is to be cut.

use torno_part::{Happening, Profile, Turning};
use torno_protocol::time::Instant;

use super::{Part, Source};
use torno_engine::Fact;

/// The way of a rig's tool, as the boards told it.
#[derive(Clone, Debug)]
pub struct ToolPath {
    part: Part,
    told: Vec<Told>,
}

/// A quantity's new value.
#[derive(Clone, Copy, Debug)]
struct Told {
    at: Instant,
    /// 0 is z, 1 is x, 2 the spindle.
    source: usize,
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
}

impl<'a> Sum<'a> {
    /// Quantities count from where the rig starts: they are 0 there.
    fn new(source: &'a Source) -> Self {
        Self { source, values: vec![0; source.signals.len()] }
    }

    fn put(&mut self, signal: u8, value: i64) {
        for (known, place) in self.source.signals.iter().zip(&mut self.values) {
            if *known == signal {
                *place = value;
            }
        }
    }

    fn sum(&self) -> i64 {
        self.values.iter().fold(0, |sum, value| sum.saturating_add(*value))
    }
}

impl ToolPath {
    /// A tool that has not moved yet.
    pub fn new(part: &Part) -> Self {
        Self { part: part.clone(), told: Vec::new() }
    }

    /// Takes note of a fact.
    pub fn add(&mut self, fact: &Fact) {
        let Fact::Telemetry { node, at, signal, value } = fact else { return };
        let sources = [&self.part.z.way, &self.part.x.way, &self.part.spindle];
        for (source, known) in sources.into_iter().enumerate() {
            if known.node == *node && known.signals.contains(signal) {
                self.told.push(Told { at: *at, source, signal: *signal, value: *value });
            }
        }
    }

    /// Cuts the bar along it.
    pub fn cut(mut self) -> Turned {
        let part = &self.part;
        let mut sums = [&part.z.way, &part.x.way, &part.spindle].map(Sum::new);
        let mut place = part.place(0, 0);
        let mut turning = Turning::new(part.bar(), part.nose, part.limits, part.resolution(), place);
        // What different boards tell is settled in no certain order; what one tells is in the order of time.
        self.told.sort_by_key(|told| told.at);
        for told in self.told.chunk_by(|a, b| a.at == b.at) {
            for Told { source, signal, value, .. } in told {
                sums[*source].put(*signal, *value);
            }
            let to = part.place(sums[0].sum(), sums[1].sum());
            if to != place {
                place = to;
                turning.go(told[0].at.as_secs_f64(), place);
            }
            turning.spin(part.spindle.per_count * sums[2].sum() as f64);
        }
        let (profile, happenings) = turning.finish();
        Turned { profile, happenings }
    }
}
