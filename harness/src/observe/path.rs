//! The way that the tool went: what the boards tell of their axes, kept until the part is to be cut.

use torno_part::{Happening, Profile, Turning};
use torno_protocol::time::Instant;

use crate::rig::part::{Part, Source};
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::file::RigFile;

    const TRANSVERSE: usize = 2;
    const DEPTH: usize = 3;

    fn told(node: usize, ms: u64, signal: u8, value: i64) -> Fact {
        Fact::Telemetry { node, at: Instant::from_nanos(ms * 1_000_000), signal, value }
    }

    fn cut(facts: &[Fact]) -> Turned {
        let mut path = ToolPath::new(RigFile::load("lathe").unwrap().part.as_ref().unwrap());
        facts.iter().for_each(|fact| path.add(fact));
        path.cut()
    }

    #[test]
    fn the_carriage_is_where_it_is_and_not_where_the_firmware_believes_it_to_be() {
        // Seven slots in, two of them clear of the bar; the firmware has counted five.
        let [position, offset] = [0, 3];
        let turned = cut(&[
            told(DEPTH, 1_000, position, -5),
            told(DEPTH, 2_000, offset, -2),
            told(TRANSVERSE, 3_000, position, -900),
            told(TRANSVERSE, 3_000, 1, -70_000),
        ]);
        let slot = 160.0 / 900.0;
        assert!((turned.profile.diameter(-1.0).unwrap() - (28.0 - 2.0 * 5.0 * slot)).abs() < 1e-9);
        assert_eq!(turned.profile.diameter(-2.01), Some(28.0));
    }

    #[test]
    fn in_what_order_boards_are_heard_does_not_matter() {
        let depth = [told(DEPTH, 10, 0, -4), told(DEPTH, 4_000, 0, 0)];
        let feed: Vec<Fact> = (1..100).map(|n| told(TRANSVERSE, 30 * n, 0, -50 * n as i64)).collect();
        let one = cut(&[&depth[..], &feed].concat());
        let other = cut(&[&feed[..], &depth].concat());
        assert_eq!(one.profile, other.profile);
        assert_eq!(one.happenings, other.happenings);
        assert!(one.profile.diameter(-1.0).unwrap() < 28.0);
    }

    #[test]
    fn a_slip_that_the_sum_does_not_show_is_no_move() {
        // The encoder invents counts: what the firmware believes changes, where the carriage is does not.
        let slip = [told(DEPTH, 10, 0, -4), told(DEPTH, 10, 3, 4), told(TRANSVERSE, 20, 0, -900)];
        assert_eq!(cut(&slip).profile.diameter(-1.0), Some(28.0));
    }
}
