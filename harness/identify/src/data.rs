//! What a motor was driven with, and what its sensor said.

use crate::Finding;

/// Fewer say nothing. (Ours.)
const LEAST: usize = 20;
/// The largest deviation from even spacing, as a share of it. (Ours.)
const EVEN: f64 = 0.01;

/// A change of the input is at the end of an interval if it is nearer to it than this share of a period: rounding.
const SHORTEST: f64 = 1e-9;

/// Fewer samples before the motor is driven do not tell what the sensor says then. (Ours.)
const UNDRIVEN: usize = 4;
/// With fewer counts in a time constant, there is no telling when in it they came. (Ours.)
const LEAST_COUNTS: f64 = 3.0;

/// What was so fast before it stood has not come to rest by itself, as a share of its greatest speed. (Ours.)
const DEAD: f64 = 0.1;
/// What stands although it is driven by more than this share of the greatest drive is held. (Ours.)
const FULL: f64 = 0.9;

/// What the sensor tells, and so what a sample's output is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensor {
    /// The mean speed over the interval: counts in a window, divided by it. An encoder gives this.
    Mean,
    /// The speed at the end of the interval. A tachometer gives this.
    Instant,
}

/// An interval in which the input was held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// The end of the interval, in s.
    pub time: f64,
    /// The input in the interval, in whatever unit.
    pub input: f64,
    /// The speed, in whatever unit per second: see [`Sensor`].
    pub speed: f64,
}

/// Data that have been found to be fit for use.
#[derive(Clone, Debug, PartialEq)]
pub struct Data {
    sensor: Sensor,
    start: f64,
    samples: Vec<Sample>,
    /// What one count in an interval is, in units of speed; 0 if the sensor does not count.
    quantum: f64,
    /// Most intervals are so long, in s.
    period: f64,
    /// Somebody knows that the motor was at rest.
    rest: bool,
}

impl Data {
    /// Data that begin at `start`, in s. `quantum` is what one count in an interval is, in units of speed; 0 if the
    /// sensor does not count.
    ///
    /// # Errors
    /// What makes them useless: too few, not in order, no input, no response, a response that runs into a limit.
    pub fn new(sensor: Sensor, start: f64, samples: Vec<Sample>, quantum: f64) -> Result<Self, Finding> {
        let mut before = start;
        for (sample, Sample { time, input, speed }) in (1..).zip(&samples) {
            if let Some(found) = [*time, *input, *speed].into_iter().find(|number| !number.is_finite()) {
                return Err(Finding::NotANumber { sample, found });
            }
            if *time <= before {
                return Err(Finding::NotInOrder { sample, before, found: *time });
            }
            before = *time;
        }
        if samples.len() < LEAST {
            return Err(Finding::TooFew { least: LEAST, found: samples.len() });
        }
        let input = samples.iter().map(|sample| sample.input.abs()).fold(0.0, f64::max);
        if input == 0.0 {
            return Err(Finding::NoInput);
        }
        let first = samples[0].speed;
        if samples.iter().all(|sample| sample.speed == first) {
            return Err(Finding::NoResponse { input });
        }
        let starts = core::iter::once(start).chain(samples.iter().map(|sample| sample.time));
        let mut lengths: Vec<f64> = samples.iter().zip(starts).map(|(sample, start)| sample.time - start).collect();
        lengths.sort_by(f64::total_cmp);
        let period = lengths[lengths.len() / 2];
        let data = Self { sensor, start, samples, quantum, period, rest: false };
        match data.saturation() {
            Some(finding) => Err(finding),
            None => Ok(data),
        }
    }

    /// The same of a motor that is known to have been at rest at the start.
    #[must_use]
    pub const fn from_rest(mut self) -> Self {
        self.rest = true;
        self
    }

    /// The same with other samples, from the same start to the same end.
    pub(crate) fn with_samples(&self, samples: Vec<Sample>) -> Self {
        Self { samples, ..self.clone() }
    }

    /// The same with its input later by `dead` seconds. An interval is parted where the input changes within it: the
    /// number of each part's interval is given, too. The parts have no speed.
    pub(crate) fn late(&self, dead: f64) -> (Self, Vec<usize>) {
        let shortest = SHORTEST * self.period;
        let starts = core::iter::once(self.start).chain(self.samples.iter().map(|sample| sample.time));
        let mut coming = starts.zip(&self.samples).map(|(start, sample)| (start + dead, sample.input)).peekable();
        let (mut input, mut begin) = (self.input_before(), self.start);
        let (mut parts, mut intervals) = (Vec::new(), Vec::new());
        for (interval, sample) in self.samples.iter().enumerate() {
            while let Some((at, next)) = coming.next_if(|(at, _)| *at < sample.time - shortest) {
                if next != input && at > begin + shortest {
                    parts.push(Sample { time: at, input, speed: 0.0 });
                    intervals.push(interval);
                    begin = at;
                }
                input = next;
            }
            parts.push(Sample { time: sample.time, input, speed: 0.0 });
            intervals.push(interval);
            begin = sample.time;
        }
        (self.with_samples(parts), intervals)
    }

    /// The input before the first sample, as far as can be told.
    pub(crate) fn input_before(&self) -> f64 {
        if self.starts_at_rest() { 0.0 } else { self.samples[0].input }
    }

    /// What the sensor tells.
    pub const fn sensor(&self) -> Sensor {
        self.sensor
    }

    /// The samples, in order of time.
    pub fn samples(&self) -> &[Sample] {
        &self.samples
    }

    /// When they begin, in s.
    pub const fn start(&self) -> f64 {
        self.start
    }

    /// What one count in an interval is, in units of speed; 0 if the sensor does not count.
    pub const fn quantum(&self) -> f64 {
        self.quantum
    }

    /// How long they last, in s.
    pub fn seconds(&self) -> f64 {
        self.samples.last().map_or(0.0, |last| last.time - self.start)
    }

    /// The length of each interval, in s.
    pub fn intervals(&self) -> impl Iterator<Item = f64> + '_ {
        let starts = core::iter::once(self.start).chain(self.samples.iter().map(|sample| sample.time));
        self.samples.iter().zip(starts).map(|(sample, start)| sample.time - start)
    }

    /// The length that most intervals have (their median), in s.
    pub const fn period(&self) -> f64 {
        self.period
    }

    /// The length of every interval, in s.
    ///
    /// # Errors
    /// [`Finding::Uneven`] if they are not all the same, within 1 %.
    pub fn even_period(&self) -> Result<f64, Finding> {
        let expected = self.period();
        let uneven = (1..).zip(self.intervals()).find(|(_, found)| (found - expected).abs() > EVEN * expected);
        match uneven {
            Some((sample, found)) => {
                Err(Finding::Uneven { sample, expected: rounded(expected), found: rounded(found) })
            }
            None => Ok(expected),
        }
    }

    /// Whether the input is 0, if at all, and then one value to the end: that value, and where it begins.
    pub fn step(&self) -> Option<(f64, usize)> {
        let begin = self.samples.iter().position(|sample| sample.input != 0.0)?;
        let input = self.samples[begin].input;
        self.samples[begin..].iter().all(|sample| sample.input == input).then_some((input, begin))
    }

    /// What the sensor says before the motor is driven for the first time: the mean, and half of the interval that
    /// holds it in 95 of 100 cases. None if that is too short to be told.
    pub(crate) fn undriven(&self) -> Option<(f64, f64)> {
        let count = self.samples.iter().take_while(|sample| sample.input == 0.0).count();
        if count < UNDRIVEN {
            return None;
        }
        let n = count as f64;
        let speeds = || self.samples[..count].iter().map(|sample| sample.speed);
        let mean = speeds().sum::<f64>() / n;
        let squares: f64 = speeds().map(|speed| (speed - mean) * (speed - mean)).sum();
        Some((mean, 2.0 * libm::sqrt(squares / (n - 1.0) / n)))
    }

    /// The middle of each interval, or its end: the instant at which its speed is best said to have been.
    pub fn instants(&self) -> Vec<f64> {
        let back = if self.sensor == Sensor::Mean { 0.5 } else { 0.0 };
        self.samples.iter().zip(self.intervals()).map(|(sample, length)| sample.time - back * length).collect()
    }

    /// Whether the sensor can see a lag of `tau` seconds at all.
    pub(crate) fn check_fine(&self, tau: f64) -> Result<(), Finding> {
        let speed = self.samples.iter().map(|sample| sample.speed.abs()).sum::<f64>() / self.samples.len() as f64;
        let counts = if self.quantum > 0.0 { speed * tau / (self.quantum * self.period()) } else { f64::MAX };
        if counts >= LEAST_COUNTS {
            return Ok(());
        }
        Err(Finding::Coarse { speed: rounded(speed), counts: rounded(counts), tau: rounded(tau), least: LEAST_COUNTS })
    }

    /// The samples begin with the motor at rest, as far as is known or its sensor can tell.
    pub fn starts_at_rest(&self) -> bool {
        if self.rest {
            return true;
        }
        let largest = self.samples.iter().map(|sample| sample.speed.abs()).fold(0.0, f64::max);
        self.samples[0].speed.abs() <= (0.05 * largest).max(1.5 * self.quantum)
    }

    /// What makes a response useless: it runs into a limit.
    fn saturation(&self) -> Option<Finding> {
        self.standstill().or_else(|| self.ceiling())
    }

    /// A motor that has turned, is driven, and stands: from one sample to the next, or driven as much as ever. One that
    /// comes to rest little by little while it is driven less has friction, which is another matter.
    fn standstill(&self) -> Option<Finding> {
        let largest =
            |number: fn(&Sample) -> f64| self.samples.iter().map(number).fold(0.0, |a: f64, b| a.max(b.abs()));
        let (fastest, fullest) = (largest(|sample| sample.speed), largest(|sample| sample.input));
        let mean = self.samples.iter().map(|sample| sample.speed.abs()).sum::<f64>() / self.samples.len() as f64;
        // So long that several counts are missing, and no passage through zero either.
        let counts = if self.quantum > 0.0 { (10.0 * self.quantum / mean).ceil() as usize } else { 0 };
        let short = counts.max(5);
        let long = short.max(self.samples.len() / 20);
        let moved = self.samples.iter().position(|sample| sample.speed != 0.0)?;
        let mut stands = 0;
        for (place, pair) in (moved + 1..).zip(self.samples[moved..].windows(2)) {
            let driven = pair[1].input != 0.0 && pair[1].input.signum() == pair[0].input.signum();
            stands = if driven && pair[1].speed == 0.0 { stands + 1 } else { 0 };
            if stands < short {
                continue;
            }
            let first = place + 1 - stands;
            // In the window before it may have moved for a part of it only.
            let before = self.samples[first.saturating_sub(2)].speed.abs();
            let dead = before > (DEAD * fastest).max(2.0 * self.quantum);
            let held = pair[1].input.abs() > FULL * fullest;
            // Whoever is stopped dead at full drive need not stand for long to be believed.
            if (dead && held) || (stands >= long && (dead || held)) {
                return Some(Finding::StopsDead { at: rounded(self.samples[first].time - self.start) });
            }
        }
        None
    }

    /// A response to a step that stops rising at once. One that tends to its end does so ever more slowly. With noise
    /// above the limit's own, or a limit within what is left of the rise, this cannot be seen.
    fn ceiling(&self) -> Option<Finding> {
        let (input, begin) = self.step()?;
        let rising: Vec<f64> = self.samples[begin..].iter().map(|sample| sample.speed * input.signum()).collect();
        let limit = rising.iter().copied().fold(f64::MIN, f64::max);
        // What is written with few digits is equal sooner than it is at its end.
        let digit = rising.windows(2).map(|pair| (pair[1] - pair[0]).abs()).filter(|step| *step > 0.0);
        let digit = digit.fold(f64::MAX, f64::min);
        let tolerance = (1.5 * self.quantum.max(digit)).max(1e-9 * limit.abs());
        let first = rising.iter().rposition(|speed| limit - speed > tolerance)? + 1;
        let span = (first / 4).clamp(4, 40);
        if rising.len() - first < 10 || first < 2 * span {
            return None;
        }
        let rise = |from: usize, to: usize| {
            (rising[to] - rising[from], self.samples[begin + to].time - self.samples[begin + from].time)
        };
        let ((last, last_s), (whole, whole_s)) = (rise(first - 1 - span, first - 1), rise(0, first - 1));
        let before = if first > 2 * span { rise(first - 1 - 2 * span, first - 1 - span).0 } else { f64::MAX };
        let slope = last / last_s;
        let at = rounded(self.samples[begin + first].time - self.start);
        let finding = Finding::Saturated { limit: rounded(limit), at, slope: rounded(slope) };
        // Of a lag, what is still to come follows from what has come.
        let to_come = if before > last { last * last / (before - last) } else { f64::MAX };
        let steep = slope > 0.3 * whole / whole_s && last > 2.0 * tolerance;
        (steep || (last > 4.0 * tolerance && to_come > 4.0 * tolerance)).then_some(finding)
    }
}

/// For people: four digits.
pub(crate) fn rounded(number: f64) -> f64 {
    if number == 0.0 {
        return 0.0;
    }
    let scale = libm::pow(10.0, 3.0 - libm::floor(libm::log(number.abs()) / core::f64::consts::LN_10));
    libm::round(number * scale) / scale
}
