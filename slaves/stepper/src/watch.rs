//! When a check finds an error: by arithmetic, without running the quiet ones before it.

use torno_protocol::time::Instant;

use crate::drive::ScheduledTrain;
use crate::encoder::Encoder;
use crate::machine::{Machine, Stretch};
use crate::search::Staircase;

/// When there are checks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Checks {
    /// Whenever the program's pulses are a multiple of this.
    Pulses(i64),
    /// Whenever pulses that the loop has added are a multiple of this.
    Added(i64),
    /// At each multiple of so many nanoseconds.
    Nanos(u64),
}

/// What the firmware reckons an error from, in pm: pulses of the program and its total of counts, from where both are
/// 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Reckoning {
    pub(crate) pulse_pm: i64,
    pub(crate) count_pm: i64,
    pub(crate) zero_program: i64,
    pub(crate) zero_total: i64,
}

impl Reckoning {
    pub(crate) const fn error(&self, program: i64, total: i64) -> i64 {
        let asked = program.wrapping_sub(self.zero_program).wrapping_mul(self.pulse_pm);
        asked.wrapping_sub(total.wrapping_sub(self.zero_total).wrapping_mul(self.count_pm))
    }
}

/// What the checks look for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Watch {
    pub(crate) checks: Checks,
    pub(crate) reckoning: Reckoning,
    /// What the firmware's total is beyond what the encoder has counted.
    pub(crate) skew: i64,
    /// The least error that a check finds, in pm.
    pub(crate) least: i64,
}

/// Checks in a stretch, evenly spaced: number, and what the first one is about.
struct Series {
    count: i64,
    /// The first check comes after so many pulses of the train, and each other one after so many more.
    first: i64,
    every: i64,
    /// At the first check: the program's pulses, and the sensor; and what is added to them from check to check.
    program: (i64, i64),
    sensed: (i64, i64),
}

impl Watch {
    /// The first instant in this stretch at which a check finds an error.
    pub(crate) fn first(&self, machine: &Machine, stretch: &Stretch<'_>) -> Option<Instant> {
        match (self.checks, stretch.run) {
            (Checks::Nanos(nanos), _) => self.first_of_period(machine, stretch, nanos.max(1)),
            (Checks::Pulses(every), Some((run, from, to))) if !run.extra => {
                let series = series(machine, stretch, (run, from, to), machine.issued, every.max(1))?;
                self.first_of(machine, stretch, &series).map(|n| run.tick(n))
            }
            (Checks::Added(every), Some((run, from, to))) if run.extra => {
                let series = series(machine, stretch, (run, from, to), 0, every.max(1))?;
                self.first_of(machine, stretch, &series).map(|n| run.tick(n))
            }
            _ => None,
        }
    }

    fn finds(&self, encoder: &Encoder, program: i64, sensed: i64) -> bool {
        let total = encoder.counted(sensed).wrapping_add(self.skew);
        self.reckoning.error(program, total).abs() >= self.least
    }

    /// The error at a place within less than a count, for bounds: where the encoder's steps are a slope.
    fn about(&self, encoder: &Encoder, sense: i64, program: i64, sensed: i64) -> f64 {
        let (count, phase) = encoder.line();
        let passed = (sensed + phase) as f64 / count as f64 - 0.5;
        let beyond = encoder.counted(sensed) - sense * encoder.passed(sensed) + self.skew;
        let whole = self.reckoning.error(program, beyond) as f64;
        whole - sense as f64 * passed * self.reckoning.count_pm as f64
    }

    /// Whether no check between two places can find anything: between them, the error is where it is at them, give or
    /// take half a count, and `slack`.
    fn is_quiet(&self, encoder: &Encoder, ends: [(i64, i64); 2], slack: i64) -> bool {
        let Some(sense) = encoder.sense() else { return false };
        let margin = self.reckoning.count_pm as f64 / 2.0 + slack as f64 + 2.0;
        let bound = self.least as f64 - margin;
        ends.iter().all(|(program, sensed)| self.about(encoder, sense, *program, *sensed).abs() < bound)
    }

    /// The pulses of the train at the first check that finds an error.
    fn first_of(&self, machine: &Machine, stretch: &Stretch<'_>, series: &Series) -> Option<i64> {
        let encoder = &machine.encoder;
        let Series { count, first, every, program, sensed } = *series;
        if let Some(path) = &stretch.path {
            // There are few in a substep.
            return (0..count).map(|i| first + i * every).zip(0..).find_map(|(n, i)| {
                let sensed = machine.senses(path, n * machine.scale.pulse);
                self.finds(encoder, program.0 + i * program.1, sensed).then_some(n)
            });
        }
        let at = |i: i64| (program.0 + i * program.1, sensed.0 + i * sensed.1);
        if self.is_quiet(encoder, [at(0), at(count - 1)], 0) {
            return None;
        }
        let number = match encoder.sense() {
            // With a dead channel the error grows, so that there is one soon.
            None => (0..count).find(|i| self.finds(encoder, at(*i).0, at(*i).1)),
            Some(sense) => {
                let (line, phase) = encoder.line();
                let beyond = encoder.counted(sensed.0) - sense * encoder.passed(sensed.0) + self.skew;
                let whole = i128::from(self.reckoning.error(program.0, beyond));
                let up = Staircase {
                    add: i128::from(program.1) * i128::from(self.reckoning.pulse_pm),
                    step: -i128::from(sense) * i128::from(self.reckoning.count_pm),
                    slope: sensed.1.into(),
                    offset: i128::from(sensed.0) + i128::from(phase),
                    run: line.into(),
                };
                let down = Staircase { add: -up.add, step: -up.step, ..up };
                let (least, count) = (i128::from(self.least), i128::from(count));
                let above = up.first(least - whole, count);
                let below = down.first(least + whole, above.unwrap_or(count));
                below.or(above).map(|i| i as i64)
            }
        };
        number.map(|i| first + i * every)
    }

    /// The same of checks at each multiple of so many nanoseconds.
    fn first_of_period(&self, machine: &Machine, stretch: &Stretch<'_>, nanos: u64) -> Option<Instant> {
        let (begin, end) = stretch.times();
        let (begin, end) = (begin.as_nanos(), end.as_nanos());
        let encoder = &machine.encoder;
        let mut ticks = (begin / nanos + 1..=end / nanos).map(|n| Instant::from_nanos(n * nanos));
        let Some((run, from, to)) = stretch.run else {
            let sensed = |tick: Instant| match &stretch.path {
                Some(path) => machine.senses(path, tick.as_nanos().cast_signed()),
                None => stretch.sensed,
            };
            // Where nothing moves, the first one is as good as any.
            let most = if stretch.path.is_some() { usize::MAX } else { 1 };
            return ticks.take(most).find(|tick| self.finds(encoder, machine.program, sensed(*tick)));
        };
        let sense = if run.extra { 0 } else { run.sense };
        let completed = |reached: i64| machine.program + sense * (reached / machine.scale.pulse);
        let place = |reached: i64| {
            let even = || stretch.sensed + stretch.slope * (reached - from);
            (completed(reached), stretch.path.as_ref().map_or_else(even, |path| machine.senses(path, reached)))
        };
        if stretch.path.is_none() && self.is_quiet(encoder, [place(from), place(to)], self.reckoning.pulse_pm) {
            return None;
        }
        ticks.find(|tick| {
            let (program, sensed) = place(run.at(*tick).clamp(from, to));
            self.finds(encoder, program, sensed)
        })
    }
}

/// When an index mark is passed in this stretch.
pub(crate) fn index_mark(machine: &Machine, stretch: &Stretch<'_>) -> Option<Instant> {
    if let Some(path) = &stretch.path {
        let (from, to) = stretch.places();
        let [begin, end] = [from, to].map(|place| machine.senses(path, place));
        let sense = if end > begin { 1 } else { -1 };
        let mark = begin + sense * machine.encoder.index_ahead(begin, sense);
        let place = stretch.first_place(machine, |sensed| sense * sensed >= sense * mark)?;
        return Some(stretch.instant(place).next());
    }
    let (run, from, to) = stretch.run.filter(|_| stretch.slope != 0)?;
    let way = machine.encoder.index_ahead(stretch.sensed, stretch.slope);
    // The last place before the mark, or the first one on it, is not known better than to a nanosecond.
    (way <= to - from).then(|| run.when(from + way).next())
}

/// The checks in a stretch of a train, before which so many pulses have been counted.
fn series(
    machine: &Machine,
    stretch: &Stretch<'_>,
    (run, from, to): (&ScheduledTrain, i64, i64),
    before: i64,
    every: i64,
) -> Option<Series> {
    let pulse = machine.scale.pulse;
    let next = from / pulse + 1;
    let first = next + (-(before + next)).rem_euclid(every);
    let last = to / pulse;
    let sense = if run.extra { 0 } else { run.sense };
    (first <= last).then(|| Series {
        count: (last - first) / every + 1,
        first,
        every,
        program: (machine.program + sense * first, sense * every),
        sensed: (stretch.sensed + stretch.slope * (first * pulse - from), stretch.slope * every * pulse),
    })
}
