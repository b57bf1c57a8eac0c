//! Oscillators: every board counts its own seconds, a little too fast or too slow.

use serde::{Deserialize, Serialize};

use crate::time::{Instant, Span};

const GIGA: u128 = 1_000_000_000;

/// A board's oscillator: how far its rate is from nominal.
///
/// The error is in parts per billion and lies within ±[`Clock::MAX_ERROR_PPB`]. Positive is fast: the board's second
/// is shorter than a true one. A crystal stays within about 100 ppm, a PIC's RC oscillator within a few percent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Clock {
    error_ppb: i32,
}

impl Clock {
    /// A clock without error.
    pub const TRUE: Self = Self { error_ppb: 0 };
    /// The largest error that is accepted, in parts per billion: 20 %.
    pub const MAX_ERROR_PPB: i32 = 200_000_000;

    /// How fast it is, in parts per billion.
    pub const fn error_ppb(self) -> i32 {
        self.error_ppb
    }

    /// A clock that is `ppb` parts per billion fast (negative: slow); `None` outside ±20 %.
    pub const fn from_ppb(ppb: i32) -> Option<Self> {
        if ppb > Self::MAX_ERROR_PPB || ppb < -Self::MAX_ERROR_PPB {
            return None;
        }
        Some(Self { error_ppb: ppb })
    }

    /// True time that passes while this clock counts `local`.
    pub fn span(self, local: Span) -> Span {
        if self.error_ppb == 0 {
            return local;
        }
        let true_ns = u128::from(local.as_nanos()) * GIGA / self.giga();
        Span::from_nanos(u64::try_from(true_ns).unwrap_or(u64::MAX))
    }

    /// 10⁹ ticks of a nominal gigahertz as this clock counts them in a true second.
    fn giga(self) -> u128 {
        (GIGA as i128 + i128::from(self.error_ppb)) as u128
    }
}

/// A rate in events per second, as an exact fraction.
///
/// Written down, both numbers have 32 bits: ticks at any rate that is read can then be computed with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "(u32, u32)", into = "(u32, u32)")]
pub struct Rate {
    per: u64,
    seconds: u64,
}

impl Rate {
    /// `hz` events in a second. Zero is taken as one: no rate of a board comes from outside unchecked.
    pub const fn hz(hz: u32) -> Self {
        Self::fraction(hz as u64, 1)
    }

    /// `per` events in `seconds` seconds. Zeros are taken as one.
    pub const fn fraction(per: u64, seconds: u64) -> Self {
        Self { per: if per == 0 { 1 } else { per }, seconds: if seconds == 0 { 1 } else { seconds } }
    }

    /// This rate times `n`.
    pub const fn times(self, n: u64) -> Self {
        Self::fraction(self.per.saturating_mul(n), self.seconds)
    }
}

impl From<(u32, u32)> for Rate {
    fn from((per, seconds): (u32, u32)) -> Self {
        Self::fraction(per.into(), seconds.into())
    }
}

impl From<Rate> for (u32, u32) {
    fn from(Rate { per, seconds }: Rate) -> Self {
        [per, seconds].map(|n| u32::try_from(n).unwrap_or(u32::MAX)).into()
    }
}

/// Evenly spaced ticks of a clock: tick `n` lies at `origin + n / rate`, rounded once, so that no error adds up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ticks {
    origin: Instant,
    /// Nanoseconds of `ticks` ticks.
    nanos: u128,
    ticks: u128,
}

impl Ticks {
    /// Ticks at `rate` as `clock` counts them, the first one (number 0) at `origin`.
    pub fn new(origin: Instant, rate: Rate, clock: Clock) -> Self {
        let nanos = GIGA * GIGA * u128::from(rate.seconds);
        let ticks = u128::from(rate.per) * clock.giga();
        Self::reduced(origin, nanos, ticks)
    }

    /// Ticks of which `per` take `nanos` nanoseconds, the first one at `origin`. Zeros are taken as one.
    pub fn every(origin: Instant, nanos: u64, per: u64) -> Self {
        Self::reduced(origin, nanos.max(1).into(), per.max(1).into())
    }

    const fn reduced(origin: Instant, nanos: u128, ticks: u128) -> Self {
        let divisor = gcd(nanos, ticks);
        Self { origin, nanos: nanos / divisor, ticks: ticks / divisor }
    }

    /// The same ticks, counted from another origin.
    pub const fn from(self, origin: Instant) -> Self {
        Self { origin, ..self }
    }

    /// The instant of tick `n`.
    pub fn at(&self, n: u64) -> Instant {
        self.origin + self.span(n)
    }

    /// The time that `n` ticks take, rounded to the nearest nanosecond.
    pub fn span(&self, n: u64) -> Span {
        let small = |wide: u128| u64::try_from(wide).ok();
        // 64-bit arithmetic is several times faster than 128-bit, and usually enough.
        let ns = match (small(self.nanos).and_then(|nanos| n.checked_mul(nanos)), small(self.ticks)) {
            (Some(product), Some(ticks)) => rounded(product, ticks),
            _ => {
                let product = u128::from(n).saturating_mul(self.nanos);
                u64::try_from((product + self.ticks / 2) / self.ticks).unwrap_or(u64::MAX)
            }
        };
        Span::from_nanos(ns)
    }

    /// The number of the first tick at or after `t` (0 before the origin).
    pub fn first_from(&self, t: Instant) -> u64 {
        let elapsed = t.since(self.origin).as_nanos();
        let small = |wide: u128| u64::try_from(wide).ok();
        let mut n = match (small(self.ticks).and_then(|ticks| elapsed.checked_mul(ticks)), small(self.nanos)) {
            (Some(product), Some(nanos)) => product / nanos,
            _ => u64::try_from(u128::from(elapsed) * self.ticks / self.nanos).unwrap_or(u64::MAX),
        };
        while n > 0 && self.at(n - 1) >= t {
            n -= 1;
        }
        while self.at(n) < t {
            n += 1;
        }
        n
    }
}

fn rounded(dividend: u64, divisor: u64) -> u64 {
    let quotient = dividend / divisor;
    if dividend % divisor >= divisor.div_ceil(2) { quotient + 1 } else { quotient }
}

/// The greatest common divisor.
pub const fn gcd(mut a: u128, mut b: u128) -> u128 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_fast_clock_counts_its_second_early() {
        let fast = Clock::from_ppb(10_000_000).unwrap();
        assert_eq!(fast.span(Span::from_secs(1)), Span::from_nanos(990_099_009));
        assert_eq!(Clock::TRUE.span(Span::from_secs(1)), Span::from_secs(1));
        assert!(Clock::from_ppb(200_000_001).is_none());
    }

    #[test]
    fn an_error_of_a_fifth_is_the_largest() {
        for ppb in [-200_000_000, -1, 0, 7, 200_000_000] {
            assert_eq!(Clock::from_ppb(ppb).map(Clock::error_ppb), Some(ppb));
        }
        assert_eq!([-200_000_001, 200_000_001, i32::MIN].map(Clock::from_ppb), [None; 3]);
    }

    #[test]
    fn no_rate_is_zero() {
        let second = |rate| Ticks::new(Instant::START, rate, Clock::TRUE).span(1);
        assert_eq!(second(Rate::hz(0)), Span::from_secs(1));
        assert_eq!(second(Rate::fraction(0, 3)), Span::from_secs(3));
        assert_eq!(second(Rate::fraction(4, 0)), Span::from_millis(250));
        assert_eq!(second(Rate::fraction(4, 3)), Span::from_millis(750));
        assert_eq!(second(Rate::hz(5).times(2)), Span::from_millis(100));
    }

    #[test]
    fn ticks_can_be_counted_from_another_origin() {
        let ticks = Ticks::new(Instant::from_nanos(7), Rate::hz(1_000), Clock::TRUE);
        assert_eq!(ticks.at(2).as_nanos(), 2_000_007);
        assert_eq!(ticks.from(Instant::from_nanos(50)).at(2).as_nanos(), 2_000_050);
    }

    #[test]
    fn of_several_ticks_in_a_nanosecond_the_first_is_found() {
        let ticks = Ticks::new(Instant::START, Rate::hz(4_000_000_000), Clock::TRUE);
        // Tick 2 lies at half a nanosecond, which is rounded up.
        assert_eq!([0, 1, 2].map(|ns| ticks.first_from(Instant::from_nanos(ns))), [0, 2, 6]);
    }

    #[test]
    fn a_tick_that_is_far_away_is_found_at_once() {
        let ticks = Ticks::new(Instant::START, Rate::hz(9600), Clock::TRUE);
        let year = Instant::START + Span::from_secs(365 * 86_400);
        assert_eq!(ticks.first_from(year), 9600 * 365 * 86_400);
    }

    #[test]
    fn ten_bits_at_9600_baud_take_1041667_ns() {
        let bits = Ticks::new(Instant::START, Rate::hz(9600), Clock::TRUE);
        assert_eq!(bits.span(1).as_nanos(), 104_167);
        assert_eq!(bits.span(10).as_nanos(), 1_041_667);
        assert_eq!(bits.span(9600 * 3600).as_nanos(), 3_600_000_000_000);
    }

    proptest! {
        #[test]
        fn first_from_is_the_first(
            origin in 0..1_000_000_000u64,
            t in 0..4_000_000_000u64,
            hz in 1..2_000_000u32,
            ppb in -200_000_000..200_000_000i32,
        ) {
            let ticks = Ticks::new(Instant::from_nanos(origin), Rate::hz(hz), Clock::from_ppb(ppb).unwrap());
            let t = Instant::from_nanos(t);
            let n = ticks.first_from(t);
            prop_assert!(ticks.at(n) >= t);
            prop_assert!(n == 0 || ticks.at(n - 1) < t);
        }

        #[test]
        fn a_tick_is_rounded_once(n in 0..1_000_000_000u64, hz in 1..2_000_000u32) {
            let ticks = Ticks::new(Instant::START, Rate::hz(hz), Clock::TRUE);
            let exact = u128::from(n) * GIGA / u128::from(hz);
            let got = u128::from(ticks.span(n).as_nanos());
            prop_assert!(got == exact || got == exact + 1);
        }

        /// Also where the numbers are beyond 64 bits.
        #[test]
        fn a_tick_is_at_the_nearest_nanosecond(
            n in 0..1_000_000_000u64,
            per in 1..2_000_000u64,
            seconds in 1..1_000u64,
            ppb in -200_000_000..200_000_000i32,
        ) {
            let ticks = Ticks::new(Instant::START, Rate::fraction(per, seconds), Clock::from_ppb(ppb).unwrap());
            let divisor = u128::from(per) * (GIGA as i128 + i128::from(ppb)) as u128;
            let exact = u128::from(n) * GIGA * GIGA * u128::from(seconds);
            let rest = exact % divisor;
            let expected = exact / divisor + u128::from(2 * rest >= divisor);
            prop_assert_eq!(u128::from(ticks.span(n).as_nanos()), expected.min(u128::from(u64::MAX)));
        }
    }
}
