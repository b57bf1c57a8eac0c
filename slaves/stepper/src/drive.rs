//! The drive: pulses become the motion of the motor's field.
//!
//! Pulse `n` of a train begins at tick `n`; meanwhile, up to tick `n + 1`, the field moves evenly by a pulse, as the
//! current of a microstepping drive nearly does. (Ours.) The timer's period is then over, and the firmware counts the
//! pulse as issued. If the next pulse comes earlier, the field has arrived by then.

use torno_protocol::clock::Ticks;
use torno_protocol::time::{Instant, Span};
use torno_protocol::train::Train;

use crate::settings::DriveSettings;

/// More pulses than this in one train are not taken.
const MOST: u64 = 1 << 30;

/// A train under way, or to come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ScheduledTrain {
    ticks: Ticks,
    count: u64,
    pub(crate) first: Instant,
    /// When the period of its last pulse is over, or the next train begins.
    pub(crate) end: Instant,
    /// 1 or −1.
    pub(crate) sense: i64,
    pub(crate) hz: f64,
    /// The loop has added these pulses; the program does not know them.
    pub(crate) extra: bool,
    /// The drive takes none of them.
    pub(crate) lost: bool,
    /// How far the pulses have come, in units: a pulse is `pulse` of them.
    pub(crate) reached: i64,
    pulse: i64,
    /// The time of a unit.
    seconds: f64,
    /// Where substeps of a rotor that swings end.
    grid: Grid,
}

/// A grid that every pulse begins on, or every so many pulses.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Grid {
    /// So many units apart, which are whole pulses.
    Pulses(i64),
    /// At so many equal parts of a pulse.
    Parts(i64),
}

impl Grid {
    /// For substeps of at most so many units.
    const fn new(most: i64, pulse: i64) -> Self {
        if most >= pulse { Self::Pulses(most / pulse * pulse) } else { Self::Parts((pulse + most - 1) / most) }
    }
}

impl ScheduledTrain {
    /// A substep is at most so many nanoseconds and units: `substep`.
    pub(crate) fn new(train: &Train, sense: i64, extra: bool, lost: bool, pulse: i64, substep: (i64, i64)) -> Self {
        let count = train.count.min(MOST);
        let (ticks, hz) = (train.ticks(), train.hz());
        let (first, end, seconds) = (train.first, ticks.at(count), 1.0 / (hz * pulse as f64));
        // A rate in whole nanoseconds is not exact.
        let most = ((substep.0 as f64 * 1e-9 / seconds * (1.0 + 1e-9)) as i64).min(substep.1).max(1);
        let grid = Grid::new(most, pulse);
        Self { ticks, count, first, end, sense, hz, extra, lost, reached: 0, pulse, seconds, grid }
    }

    pub(crate) const fn count(&self) -> i64 {
        self.count as i64
    }

    /// Pulses whose period is over.
    pub(crate) const fn completed(&self) -> i64 {
        self.reached / self.pulse
    }

    /// Pulses that have begun before `t`.
    pub(crate) fn begun(&self, t: Instant) -> i64 {
        self.ticks.first_from(t).min(self.count) as i64
    }

    /// The beginning of the last pulse.
    pub(crate) fn last(&self) -> Instant {
        self.ticks.at(self.count.saturating_sub(1))
    }

    /// When the period of this pulse begins, and that of the one before is over.
    pub(crate) fn tick(&self, n: i64) -> Instant {
        if n >= self.count() { self.end } else { self.ticks.at(n.unsigned_abs()).min(self.end) }
    }

    /// No pulse begins from `t` on. Gives whether any is left.
    pub(crate) fn cut(&mut self, t: Instant) -> bool {
        let begun = self.begun(t).unsigned_abs();
        if begun < self.count {
            self.end = self.end.min(self.ticks.at(begun));
            self.count = begun;
        }
        self.count > 0
    }

    /// How far the pulses have come at `t`, in units.
    pub(crate) fn at(&self, t: Instant) -> i64 {
        if t >= self.end {
            return self.count() * self.pulse;
        }
        let Some(n) = self.ticks.first_from(t.next()).checked_sub(1) else { return 0 };
        let n = n.min(self.count.saturating_sub(1)) as i64;
        let (begin, end) = (self.tick(n), self.tick(n + 1));
        let whole = i128::from(end.since(begin).as_nanos().max(1));
        let part = i128::from(t.since(begin).as_nanos()) * i128::from(self.pulse) / whole;
        n * self.pulse + part.min(self.pulse.into()) as i64
    }

    /// How long it takes from one place to another, in seconds.
    pub(crate) fn seconds(&self, from: i64, to: i64) -> f64 {
        if to > (self.count() - 1) * self.pulse && self.end < self.ticks.at(self.count) {
            // The next train comes early.
            return self.when(to).since(self.when(from)).as_secs_f64();
        }
        (to - from) as f64 * self.seconds
    }

    /// Where the substep ends that begins at this place.
    pub(crate) fn substep(&self, place: i64) -> i64 {
        match self.grid {
            Grid::Pulses(way) => (place / way + 1) * way,
            Grid::Parts(parts) => {
                let (pulses, beyond) = (place / self.pulse, place % self.pulse);
                let mut part = beyond * parts / self.pulse + 1;
                if part * self.pulse / parts <= beyond {
                    part += 1;
                }
                pulses * self.pulse + part * self.pulse / parts
            }
        }
    }

    /// About when they have come so far.
    pub(crate) fn when(&self, units: i64) -> Instant {
        let (n, part) = (units / self.pulse, units % self.pulse);
        let (begin, end) = (self.tick(n), self.tick(n + 1));
        let ns = i128::from(end.since(begin).as_nanos()) * i128::from(part) / i128::from(self.pulse);
        begin + Span::from_nanos(ns as u64)
    }
}

/// What the drive makes of pulses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Drive {
    max_hz: f64,
    min_pulse_ns: f64,
    /// Every so many pulses one is lost; 0: none.
    every: i64,
    /// The pulses before the fault began.
    before: i64,
    /// The pulses of the trains that are over.
    pulses: i64,
}

impl Drive {
    pub(crate) const fn new(settings: &DriveSettings) -> Self {
        let min_pulse_ns = settings.min_pulse_us * 1_000.0;
        Self { max_hz: settings.max_hz, min_pulse_ns, every: 0, before: 0, pulses: 0 }
    }

    /// Whether it takes no pulse of this train: they come too fast, or are high or low for too short a time.
    pub(crate) fn misses(&self, train: &Train) -> bool {
        let (hz, high) = (train.hz(), train.high.as_nanos() as f64);
        let low = 1e9 / hz - high;
        // A rate of 200 kHz as a fraction of whole nanoseconds is not above 200 kHz.
        hz > self.max_hz * (1.0 + 1e-9) || high < self.min_pulse_ns || low < self.min_pulse_ns * (1.0 - 1e-9)
    }

    /// From now on every `every`th pulse is lost; 0 heals.
    pub(crate) fn skip(&mut self, every: u32, run: Option<&ScheduledTrain>) {
        self.every = every.into();
        // The pulse under way is taken, or not, as before.
        self.before = self.pulses + run.map_or(0, |run| (run.reached + run.pulse - 1) / run.pulse);
    }

    /// Whether the pulse under way is lost, and how many units of the train go like that.
    pub(crate) fn part(&self, run: &ScheduledTrain) -> (bool, i64) {
        let left = run.count() * run.pulse - run.reached;
        if run.lost || self.every == 0 {
            return (run.lost, left);
        }
        // The pulses since the fault began, with the one under way.
        let number = self.pulses + run.completed() + 1 - self.before;
        let rest = run.pulse - run.reached % run.pulse;
        if number > 0 && number % self.every == 0 {
            return (true, rest);
        }
        let taken = self.every - 1 - if number > 0 { number % self.every } else { number };
        (false, (rest + taken * run.pulse).min(left))
    }

    pub(crate) const fn over(&mut self, run: &ScheduledTrain) {
        self.pulses += run.count();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn train(first: u64, nanos: u64, count: u64) -> Train {
        let high = Span::from_nanos(nanos / 2);
        Train { first: Instant::from_nanos(first), nanos, per: 1, count, high }
    }

    #[test]
    fn the_field_moves_evenly_while_a_pulse_lasts() {
        let mut run = ScheduledTrain::new(&train(100, 50, 3), 1, false, false, 1_000, (100_000, 1_000));
        let at =
            |run: &ScheduledTrain| [0, 100, 101, 125, 150, 249, 250, 900].map(|ns| run.at(Instant::from_nanos(ns)));
        assert_eq!(at(&run), [0, 0, 20, 500, 1_000, 2_980, 3_000, 3_000]);
        assert_eq!([0, 20, 1_000, 2_500].map(|units| run.when(units).as_nanos()), [100, 101, 150, 225]);
        // The pulse that has begun is completed.
        assert!(run.cut(Instant::from_nanos(151)));
        assert_eq!((run.count(), run.end.as_nanos(), at(&run)[7]), (2, 200, 2_000));
        assert!(!run.cut(Instant::from_nanos(100)));
    }

    #[test]
    fn a_dm542_misses_what_is_too_fast_or_too_short() {
        let drive = Drive::new(&DriveSettings::default());
        assert_eq!([4_999, 5_000, 100_000].map(|ns| drive.misses(&train(0, ns, 1))), [true, false, false]);
        let high = |ns| drive.misses(&Train { high: Span::from_nanos(ns), ..train(0, 10_000, 1) });
        assert_eq!([2_499, 2_500, 7_500, 7_501].map(high), [true, false, false, true]);
    }

    #[test]
    fn one_pulse_of_so_many_is_lost() {
        let mut drive = Drive::new(&DriveSettings::default());
        let mut run = ScheduledTrain::new(&train(0, 50, 10), 1, false, false, 1_000, (100_000, 1_000));
        run.reached = 1_500;
        drive.skip(3, Some(&run));
        let mut parts = Vec::new();
        while run.reached < 10_000 {
            let (lost, units) = drive.part(&run);
            parts.push((lost, units));
            run.reached += units;
        }
        // The fifth and the eighth.
        assert_eq!(parts, [(false, 2_500), (true, 1_000), (false, 2_000), (true, 1_000), (false, 2_000)]);
        drive.over(&run);
        let run = ScheduledTrain::new(&train(0, 50, 10), 1, false, false, 1_000, (100_000, 1_000));
        assert_eq!(drive.part(&run), (true, 1_000));
    }
}
