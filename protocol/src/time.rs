//! Virtual time: instants and spans in whole nanoseconds since the rig started.

use core::fmt;
use core::ops::{Add, AddAssign, Sub};

use serde::{Deserialize, Serialize};

/// An instant of virtual time, in nanoseconds since the rig started.
///
/// Range: 584 years. Additions saturate, so that [`Instant::NEVER`] stays never.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Instant(u64);

/// A length of virtual time, in nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Span(u64);

impl Instant {
    /// The instant at which the rig started.
    pub const START: Self = Self(0);
    /// Later than anything that happens.
    pub const NEVER: Self = Self(u64::MAX);

    /// The instant `ns` nanoseconds after the start.
    pub const fn from_nanos(ns: u64) -> Self {
        Self(ns)
    }

    /// Nanoseconds since the start.
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// Seconds since the start, for people; not exact.
    pub fn as_secs_f64(self) -> f64 {
        self.0 as f64 / 1e9
    }

    /// The time that has passed since `earlier`; zero if `earlier` is later.
    pub const fn since(self, earlier: Self) -> Span {
        Span(self.0.saturating_sub(earlier.0))
    }

    /// The next representable instant: turns "up to and including" into "before".
    pub const fn next(self) -> Self {
        Self(self.0.saturating_add(1))
    }

    /// Whether this is [`Instant::NEVER`].
    pub const fn is_never(self) -> bool {
        self.0 == u64::MAX
    }
}

impl Span {
    /// No time at all.
    pub const ZERO: Self = Self(0);

    /// A span of `ns` nanoseconds.
    pub const fn from_nanos(ns: u64) -> Self {
        Self(ns)
    }

    /// A span of `us` microseconds.
    pub const fn from_micros(us: u64) -> Self {
        Self(us * 1_000)
    }

    /// A span of `ms` milliseconds.
    pub const fn from_millis(ms: u64) -> Self {
        Self(ms * 1_000_000)
    }

    /// A span of `s` seconds.
    pub const fn from_secs(s: u64) -> Self {
        Self(s * 1_000_000_000)
    }

    /// The span in nanoseconds.
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// The span in seconds.
    pub fn as_secs_f64(self) -> f64 {
        self.0 as f64 / 1e9
    }

    /// `n` times this span; saturates.
    pub const fn times(self, n: u64) -> Self {
        Self(self.0.saturating_mul(n))
    }
}

impl Add<Span> for Instant {
    type Output = Self;
    fn add(self, span: Span) -> Self {
        Self(self.0.saturating_add(span.0))
    }
}

impl AddAssign<Span> for Instant {
    fn add_assign(&mut self, span: Span) {
        *self = *self + span;
    }
}

impl Sub<Span> for Instant {
    type Output = Self;
    fn sub(self, span: Span) -> Self {
        Self(self.0.saturating_sub(span.0))
    }
}

impl Add for Span {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0.saturating_add(other.0))
    }
}

impl fmt::Display for Instant {
    /// Seconds with microseconds, as the log prints them: `12.034567s`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_never() {
            return f.write_str("never");
        }
        let micros = self.0 / 1_000;
        write!(f, "{}.{:06}s", micros / 1_000_000, micros % 1_000_000)
    }
}

impl fmt::Display for Span {
    /// In the unit that suits it: `1.5 s`, `200 ms`, `50 us`, `7 ns`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let nanos = self.as_nanos();
        let units = [(1_000_000_000, "s"), (1_000_000, "ms"), (1_000, "us")];
        match units.iter().find(|(unit, _)| nanos >= *unit) {
            Some((unit, name)) => write!(f, "{} {name}", nanos as f64 / *unit as f64),
            None => write!(f, "{nanos} ns"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn never_stays_never() {
        assert!((Instant::NEVER + Span::from_secs(1)).is_never());
        assert_eq!(Instant::START - Span::from_nanos(1), Instant::START);
    }

    #[test]
    fn units_are_powers_of_a_thousand() {
        let spans = [Span::from_nanos(3), Span::from_micros(3), Span::from_millis(3), Span::from_secs(3)];
        assert_eq!(spans.map(Span::as_nanos), [3, 3_000, 3_000_000, 3_000_000_000]);
        assert_eq!(Span::from_micros(2_500_000).as_secs_f64(), 2.5);
        assert_eq!(Instant::from_nanos(2_500_000_000).as_secs_f64(), 2.5);
    }

    #[test]
    fn sums_and_differences() {
        let five = Instant::from_nanos(5);
        assert_eq!(five.since(Instant::from_nanos(2)), Span::from_nanos(3));
        assert_eq!(five.since(Instant::from_nanos(7)), Span::ZERO);
        assert_eq!(five - Span::from_nanos(2), Instant::from_nanos(3));
        assert_eq!((five.next(), Instant::NEVER.next()), (Instant::from_nanos(6), Instant::NEVER));
        assert_eq!(Span::from_nanos(3) + Span::from_nanos(4), Span::from_nanos(7));
        assert_eq!(Span::from_nanos(3).times(4), Span::from_nanos(12));
        let mut now = five;
        now += Span::from_nanos(4);
        assert_eq!(now, Instant::from_nanos(9));
        assert!(!five.is_never());
    }

    #[test]
    fn prints_seconds_and_microseconds() {
        assert_eq!(Instant::from_nanos(12_034_567_891).to_string(), "12.034567s");
        assert_eq!(Instant::NEVER.to_string(), "never");
    }

    #[test]
    fn a_span_is_printed_in_the_largest_unit_that_it_fills() {
        let texts = [0, 7, 999, 1_000, 50_000, 1_000_000, 200_000_000, 1_000_000_000, 1_500_000_000];
        let texts = texts.map(|ns| Span::from_nanos(ns).to_string());
        assert_eq!(texts, ["0 ns", "7 ns", "999 ns", "1 us", "50 us", "1 ms", "200 ms", "1 s", "1.5 s"]);
    }
}
