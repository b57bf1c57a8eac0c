//! A board's periodic timer.

use torno_protocol::clock::{Clock, Rate, Ticks};
use torno_protocol::time::{Instant, Span};

/// When a board samples.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    pub(crate) period_ms: u32,
    pub(crate) jitter: Jitter,
}

impl Timing {
    /// Every so many ms, to the nanosecond.
    pub(crate) const fn exact(period_ms: u32) -> Self {
        Self { period_ms, jitter: Jitter { longest_us: 0, seed: 0 } }
    }
}

/// How late a sample comes: from 0 up to `longest_us`, each delay as likely as any other. It is never early: the timer
/// is exact, and what the firmware does besides delays it. (Ours.)
///
/// The delay of a tick is a function of its number and the seed, so that it does not depend on who asks or how often.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Jitter {
    pub(crate) longest_us: u32,
    pub(crate) seed: u32,
}

impl Jitter {
    const fn longest(self) -> Span {
        Span::from_micros(self.longest_us as u64)
    }

    /// How late tick `n` is.
    const fn of(self, n: u64) -> Span {
        if self.longest_us == 0 {
            return Span::ZERO;
        }
        let random = mixed(((self.seed as u64) << 32 | self.seed as u64) ^ mixed(n));
        let choices = self.longest().as_nanos() as u128 + 1;
        Span::from_nanos(((random as u128 * choices) >> 64) as u64)
    }
}

/// A number that looks like none of its neighbours' (SplitMix64).
const fn mixed(n: u64) -> u64 {
    let n = n.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let n = (n ^ (n >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let n = (n ^ (n >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    n ^ (n >> 31)
}

/// Ticks of the board's own clock, counted from the start of the rig, handled one at a time.
///
/// The grid is fixed: stopping and starting again does not shift it, and ticks that were missed are lost.
#[derive(Clone, Debug)]
pub(crate) struct Schedule {
    rate: Rate,
    ticks: Ticks,
    jitter: Jitter,
    next: Option<(u64, Instant)>,
}

impl Schedule {
    /// A stopped timer in `clock`.
    pub(crate) fn new(timing: Timing, clock: Clock) -> Self {
        let rate = Rate::fraction(1_000, u64::from(timing.period_ms));
        Self { rate, ticks: Ticks::new(Instant::START, rate, clock), jitter: timing.jitter, next: None }
    }

    /// Counts in `clock` from the tick on that is to come.
    pub(crate) fn retune(&mut self, now: Instant, clock: Clock) {
        let (n, _) = self.next.unwrap_or_else(|| self.first_from(now));
        self.ticks = Ticks::new(self.ticks.at(n), self.rate, clock);
        self.next = self.next.map(|_| (0, self.at(0)));
    }

    /// Runs from the first tick at or after `now` on, if it was stopped.
    pub(crate) fn start(&mut self, now: Instant) {
        if self.next.is_none() {
            self.next = Some(self.first_from(now));
        }
    }

    pub(crate) const fn stop(&mut self) {
        self.next = None;
    }

    pub(crate) fn poll_timeout(&self) -> Option<Instant> {
        self.next.map(|(_, at)| at)
    }

    /// Whether a tick is due at `now`. If so, the next one is the first after `now`.
    pub(crate) fn take(&mut self, now: Instant) -> bool {
        let Some((n, at)) = self.next.filter(|(_, at)| *at <= now) else { return false };
        let following = (n + 1, self.at(n + 1));
        let late = following.1 <= now || at.is_never();
        self.next = Some(if late { self.first_from(now.next()) } else { following });
        true
    }

    fn first_from(&self, t: Instant) -> (u64, Instant) {
        // A tick before may be late enough.
        let before = Instant::START + Span::from_nanos(t.since(Instant::START + self.jitter.longest()).as_nanos());
        let mut n = self.ticks.first_from(before);
        while self.at(n) < t {
            n += 1;
        }
        (n, self.at(n))
    }

    fn at(&self, n: u64) -> Instant {
        self.ticks.at(n) + self.jitter.of(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: u64) -> Instant {
        Instant::from_nanos(ms * 1_000_000)
    }

    #[test]
    fn the_grid_does_not_depend_on_when_it_was_started() {
        let mut schedule = Schedule::new(Timing::exact(30), Clock::TRUE);
        schedule.start(ms(61));
        assert_eq!(schedule.poll_timeout(), Some(ms(90)));
        schedule.start(ms(0));
        assert_eq!(schedule.poll_timeout(), Some(ms(90)));
        schedule.stop();
        schedule.start(ms(120));
        assert_eq!(schedule.poll_timeout(), Some(ms(120)));
    }

    #[test]
    fn jitter_delays_each_tick_by_its_own_time_and_loses_none() {
        let times = |seed| {
            let jitter = Jitter { longest_us: 5_000, seed };
            let mut schedule = Schedule::new(Timing { period_ms: 30, jitter }, Clock::TRUE);
            schedule.start(ms(0));
            let tick = |_| {
                let at = schedule.poll_timeout().unwrap();
                assert!(schedule.take(at));
                at
            };
            (0..2_000).map(tick).collect::<Vec<Instant>>()
        };
        let found = times(1);
        let late = |n: usize| found[n].since(ms(30 * n as u64)).as_nanos();
        assert!((0..2_000).all(|n| late(n) <= 5_000_000 && found[n] >= ms(30 * n as u64)));
        let mean = (0..2_000).map(late).sum::<u64>() / 2_000;
        assert!((2_400_000..2_600_000).contains(&mean), "{mean}");
        assert!((0..2_000).any(|n| late(n) > 4_990_000) && (0..2_000).any(|n| late(n) < 10_000));
        assert_eq!(found, times(1));
        assert_ne!(found, times(2));
        // Wherever it is started, it comes back to the same ticks.
        let mut schedule =
            Schedule::new(Timing { period_ms: 30, jitter: Jitter { longest_us: 5_000, seed: 1 } }, Clock::TRUE);
        for n in 1..200 {
            schedule.start(found[n]);
            assert_eq!(schedule.poll_timeout(), Some(found[n]));
            schedule.stop();
            schedule.start(found[n - 1].next());
            assert_eq!(schedule.poll_timeout(), Some(found[n]));
            schedule.stop();
        }
    }

    #[test]
    fn missed_ticks_are_lost() {
        let mut schedule = Schedule::new(Timing::exact(30), Clock::TRUE);
        schedule.start(ms(30));
        assert!(!schedule.take(ms(29)));
        assert!(schedule.take(ms(30)));
        assert_eq!(schedule.poll_timeout(), Some(ms(60)));
        assert!(schedule.take(ms(155)));
        assert_eq!(schedule.poll_timeout(), Some(ms(180)));
    }

    #[test]
    fn another_clock_counts_from_the_tick_that_is_set() {
        let fast = Clock::from_ppb(200_000_000).unwrap();
        let mut schedule = Schedule::new(Timing::exact(30), Clock::TRUE);
        schedule.start(ms(61));
        schedule.retune(ms(70), fast);
        assert_eq!(schedule.poll_timeout(), Some(ms(90)));
        assert!(schedule.take(ms(90)));
        assert_eq!(schedule.poll_timeout(), Some(ms(115)));
        // Stopped, it keeps its grid all the same.
        schedule.stop();
        schedule.retune(ms(120), Clock::TRUE);
        schedule.start(ms(141));
        assert_eq!(schedule.poll_timeout(), Some(ms(170)));
    }
}
