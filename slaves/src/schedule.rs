//! A board's periodic timer.

use torno_protocol::clock::{Clock, Rate, Ticks};
use torno_protocol::time::Instant;

/// Ticks of the board's own clock, counted from the start of the rig, handled one at a time.
///
/// The grid is fixed: stopping and starting again does not shift it, and ticks that were missed are lost.
#[derive(Clone, Debug)]
pub(crate) struct Schedule {
    rate: Rate,
    ticks: Ticks,
    next: Option<(u64, Instant)>,
}

impl Schedule {
    /// A stopped timer of `period_ms` milliseconds in `clock`.
    pub(crate) fn new(period_ms: u32, clock: Clock) -> Self {
        let rate = Rate::fraction(1_000, u64::from(period_ms));
        Self { rate, ticks: Ticks::new(Instant::START, rate, clock), next: None }
    }

    /// Counts in `clock` from the tick on that is to come.
    pub(crate) fn retune(&mut self, now: Instant, clock: Clock) {
        let coming = self.next.unwrap_or_else(|| self.first_from(now)).1;
        self.ticks = Ticks::new(coming, self.rate, clock);
        self.next = self.next.map(|_| (0, coming));
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
        let following = (n + 1, self.ticks.at(n + 1));
        let late = following.1 <= now || at.is_never();
        self.next = Some(if late { self.first_from(now.next()) } else { following });
        true
    }

    fn first_from(&self, t: Instant) -> (u64, Instant) {
        let n = self.ticks.first_from(t);
        (n, self.ticks.at(n))
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
        let mut schedule = Schedule::new(30, Clock::TRUE);
        schedule.start(ms(61));
        assert_eq!(schedule.poll_timeout(), Some(ms(90)));
        schedule.start(ms(0));
        assert_eq!(schedule.poll_timeout(), Some(ms(90)));
        schedule.stop();
        schedule.start(ms(120));
        assert_eq!(schedule.poll_timeout(), Some(ms(120)));
    }

    #[test]
    fn missed_ticks_are_lost() {
        let mut schedule = Schedule::new(30, Clock::TRUE);
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
        let mut schedule = Schedule::new(30, Clock::TRUE);
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
