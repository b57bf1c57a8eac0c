//! Segments: all axes move evenly between two instants, and each has a train of pulses.

use torno_protocol::time::{Instant, Span};

use crate::limits::AXES;

/// How finely the place along a block is divided. A whole number of parts keeps the sums of the pulses exact.
pub(crate) const WHOLE: u64 = 1 << 40;

/// The time from a pulse to the next, ns, as a fraction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Period {
    /// ns, for as many periods as the denominator says.
    pub numerator: u64,
    /// Never 0.
    pub denominator: u32,
}

/// The pulses of one axis in a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Train {
    /// The first pulse.
    pub first: Instant,
    /// From a pulse to the next. With fewer than two pulses, what it would be at the axis's speed; 0 if it stands.
    pub period: Period,
    /// How many pulses there are.
    pub count: u32,
    /// Whether the axis moves towards larger positions.
    pub forward: bool,
}

/// A stretch of even motion. A pulse at its start belongs to the segment before; one at its end belongs to it.
///
/// The position of each axis is a straight line in time, and a pulse falls where the line crosses half a step, rounded
/// up to 1 ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Segment {
    /// Where it starts: at the end of the one before, unless the axes stood.
    pub start: Instant,
    /// Where it ends, if nothing [cuts](crate::Planner::hold) it.
    pub end: Instant,
    /// X, Y, Z, A.
    pub trains: [Train; AXES],
}

impl Train {
    /// An axis that stands.
    const NONE: Self =
        Self { first: Instant::NEVER, period: Period { numerator: 0, denominator: 1 }, count: 0, forward: true };

    /// When pulse `n` falls; the first one is number 0.
    pub const fn pulse(&self, n: u32) -> Instant {
        let after = n as u128 * self.period.numerator as u128 / self.period.denominator as u128;
        Instant::from_nanos(self.first.as_nanos().saturating_add(after as u64))
    }

    /// How many pulses have fallen until `now`, `now` included.
    pub fn issued(&self, now: Instant) -> u32 {
        if self.count == 0 || now < self.first {
            return 0;
        }
        if self.period.numerator == 0 {
            return self.count;
        }
        // n·numerator/denominator, rounded down, is at most what has passed.
        let passed = u128::from(now.since(self.first).as_nanos());
        let before = (passed + 1) * u128::from(self.period.denominator);
        before.div_ceil(u128::from(self.period.numerator)).min(u128::from(self.count)) as u32
    }

    /// +1 or -1.
    pub const fn sign(&self) -> i32 {
        if self.forward { 1 } else { -1 }
    }
}

impl Segment {
    /// The steps of each axis until `now`, `now` included.
    pub fn issued(&self, now: Instant) -> [i32; AXES] {
        self.trains.map(|train| train.sign().wrapping_mul(train.issued(now) as i32))
    }
}

/// A stretch of a block, between two places of [`WHOLE`] parts.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stretch {
    pub(crate) from: u64,
    pub(crate) to: u64,
    pub(crate) start: Instant,
    /// Longer than 0.
    pub(crate) time: Span,
}

/// How many pulses an axis of `steps` has given at a place of the block.
fn given(steps: u64, place: u64) -> u32 {
    ((u128::from(steps) * u128::from(place) + u128::from(WHOLE / 2)) / u128::from(WHOLE)) as u32
}

impl Stretch {
    /// The segment, where `issued` pulses of the block are already given.
    pub(crate) fn segment(&self, steps: &[i64; AXES], issued: &[u32; AXES]) -> Segment {
        let trains = core::array::from_fn(|n| self.train(steps[n], issued[n]));
        Segment { start: self.start, end: self.start + self.time, trains }
    }

    fn train(&self, steps: i64, issued: u32) -> Train {
        let distance = u128::from(self.to - self.from);
        if steps == 0 || distance == 0 && issued >= given(steps.unsigned_abs(), self.to) {
            return Train::NONE;
        }
        let forward = steps > 0;
        let steps = steps.unsigned_abs();
        let count = given(steps, self.to).saturating_sub(issued);
        let pace = u128::from(steps) * distance;
        let time = u128::from(self.time.as_nanos());
        let end = self.start + self.time;
        // Pulse n of the block lies at (2n - 1)/(2·steps) of it. One that rounding has left behind comes at once.
        let pulse = |n: u32| {
            let place = (2 * u128::from(n) - 1) * u128::from(WHOLE);
            let beyond = place.saturating_sub(2 * u128::from(steps) * u128::from(self.from));
            let after = (time * beyond).div_ceil((2 * pace).max(1)).max(1);
            (self.start + Span::from_nanos(after as u64)).min(end)
        };
        let first = pulse(issued + 1);
        let period = match count {
            0 | 1 => Period { numerator: (time * u128::from(WHOLE) / pace.max(1)) as u64, denominator: 1 },
            _ => Period { numerator: pulse(issued + count).since(first).as_nanos(), denominator: count - 1 },
        };
        Train { first: if count == 0 { Instant::NEVER } else { first }, period, count, forward }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stretch(from: u64, to: u64, start: u64, time: u64) -> Stretch {
        Stretch { from, to, start: Instant::from_nanos(start), time: Span::from_nanos(time) }
    }

    #[test]
    fn pulses_fall_at_the_half_steps() {
        let segment = stretch(0, WHOLE, 1000, 1_000_000).segment(&[4, -1, 0, 0], &[0; AXES]);
        let [x, y, z, _] = segment.trains;
        let pulses: Vec<u64> = (0..x.count).map(|n| x.pulse(n).as_nanos()).collect();
        assert_eq!(pulses, [126_000, 376_000, 626_000, 876_000]);
        assert_eq!((y.count, y.first.as_nanos(), y.forward), (1, 501_000, false));
        assert_eq!(y.period, Period { numerator: 1_000_000, denominator: 1 });
        assert_eq!(z.count, 0);
    }

    #[test]
    fn issued_counts_the_pulses_up_to_an_instant() {
        let train = stretch(0, WHOLE, 7, 1_000_001).segment(&[13, 0, 0, 0], &[0; AXES]).trains[0];
        assert_eq!((train.issued(train.first - Span::from_nanos(1)), train.issued(train.first)), (0, 1));
        for n in 1..13 {
            let pulse = train.pulse(n);
            assert_eq!((train.issued(pulse - Span::from_nanos(1)), train.issued(pulse)), (n, n + 1));
        }
        assert_eq!(train.issued(Instant::NEVER), 13);
    }
}
