//! Trains of pulses: what a timer puts on a step pin while its rate is constant, told as one record.

use serde::{Deserialize, Serialize};

use crate::clock::Ticks;
use crate::time::{Instant, Span};

/// Pulses at a constant rate. Which way they turn a motor is said by another pin.
///
/// The period is a fraction of whole nanoseconds, so that the last pulse of a long train is where it ought to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Train {
    /// The rising edge of the first pulse.
    pub first: Instant,
    /// Nanoseconds of [`Self::per`] periods. Zero is taken as one.
    pub nanos: u64,
    /// Periods that take [`Self::nanos`]. Zero is taken as one.
    pub per: u64,
    /// How many pulses there are.
    pub count: u64,
    /// How long each pulse is high.
    pub high: Span,
}

impl Train {
    /// The rising edges, by their numbers: pulse `n` begins at tick `n`, and its period ends at tick `n + 1`.
    ///
    /// ```
    /// use torno_protocol::time::{Instant, Span};
    /// use torno_protocol::train::Train;
    ///
    /// let high = Span::from_micros(5);
    /// let train = Train { first: Instant::START, nanos: 1_000_000, per: 3, count: 9, high };
    /// assert_eq!([1, 2, 3].map(|n| train.ticks().at(n).as_nanos()), [333_333, 666_667, 1_000_000]);
    /// assert_eq!(train.end().as_nanos(), 3_000_000);
    /// ```
    pub fn ticks(&self) -> Ticks {
        Ticks::every(self.first, self.nanos, self.per)
    }

    /// When the period of the last pulse ends.
    pub fn end(&self) -> Instant {
        self.ticks().at(self.count)
    }

    /// Pulses in a second; not exact.
    pub fn hz(&self) -> f64 {
        self.per.max(1) as f64 * 1e9 / self.nanos.max(1) as f64
    }

    /// How many pulses have begun before `t`.
    pub fn begun(&self, t: Instant) -> u64 {
        self.ticks().first_from(t).min(self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pulse_has_begun_once_its_edge_is_past() {
        let train = Train { first: Instant::from_nanos(100), nanos: 10, per: 1, count: 3, high: Span::from_nanos(5) };
        let begun = [99, 100, 101, 110, 111, 120, 121, 500].map(|ns| train.begun(Instant::from_nanos(ns)));
        assert_eq!(begun, [0, 0, 1, 1, 2, 2, 3, 3]);
        assert_eq!((train.end(), train.hz()), (Instant::from_nanos(130), 1e8));
    }

    #[test]
    fn zeros_are_taken_as_one() {
        let train = Train { first: Instant::START, nanos: 0, per: 0, count: 2, high: Span::ZERO };
        assert_eq!((train.end(), train.hz()), (Instant::from_nanos(2), 1e9));
    }
}
