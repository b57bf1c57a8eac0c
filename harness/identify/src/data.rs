//! What a motor was driven with, and what its sensor said.

use crate::Finding;

/// Fewer say nothing. (Ours.)
const LEAST: usize = 20;
/// The largest deviation from even spacing, as a share of it. (Ours.)
const EVEN: f64 = 0.01;

/// With fewer counts in a time constant, there is no telling when in it they came. (Ours.)
const LEAST_COUNTS: f64 = 3.0;

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
        let data = Self { sensor, start, samples, quantum };
        match data.saturation() {
            Some(finding) => Err(finding),
            None => Ok(data),
        }
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

    /// The mean length of an interval, in s.
    pub fn period(&self) -> f64 {
        self.seconds() / self.samples.len() as f64
    }

    /// The length of every interval, in s.
    ///
    /// # Errors
    /// [`Finding::Uneven`] if they are not all the same, within 1 %.
    pub fn even_period(&self) -> Result<f64, Finding> {
        let expected = self.period();
        let uneven = (1..).zip(self.intervals()).find(|(_, found)| (found - expected).abs() > EVEN * expected);
        match uneven {
            Some((sample, found)) => Err(Finding::Uneven { sample, expected, found }),
            None => Ok(expected),
        }
    }

    /// Whether the input is 0, if at all, and then one value to the end: that value, and where it begins.
    pub fn step(&self) -> Option<(f64, usize)> {
        let begin = self.samples.iter().position(|sample| sample.input != 0.0)?;
        let input = self.samples[begin].input;
        self.samples[begin..].iter().all(|sample| sample.input == input).then_some((input, begin))
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

    /// The samples begin with the motor at rest, as far as its sensor can tell.
    pub fn starts_at_rest(&self) -> bool {
        let largest = self.samples.iter().map(|sample| sample.speed.abs()).fold(0.0, f64::max);
        self.samples[0].speed.abs() <= (0.05 * largest).max(1.5 * self.quantum)
    }

    /// What makes a response useless: it runs into a limit.
    fn saturation(&self) -> Option<Finding> {
        self.standstill().or_else(|| self.ceiling())
    }

    /// A motor that has turned, is driven, and stands.
    fn standstill(&self) -> Option<Finding> {
        let mean = self.samples.iter().map(|sample| sample.speed.abs()).sum::<f64>() / self.samples.len() as f64;
        // So long that several counts are missing, and no passage through zero either.
        let counts = if self.quantum > 0.0 { (10.0 * self.quantum / mean).ceil() as usize } else { 0 };
        let long = counts.max(self.samples.len() / 20).max(5);
        let moved = self.samples.iter().position(|sample| sample.speed != 0.0)?;
        let mut stands = 0;
        for pair in self.samples[moved..].windows(2) {
            let driven = pair[1].input != 0.0 && pair[1].input.signum() == pair[0].input.signum();
            stands = if driven && pair[1].speed == 0.0 { stands + 1 } else { 0 };
            if stands >= long {
                let place = self.samples.iter().position(|sample| sample.time == pair[1].time)?;
                return Some(Finding::StopsDead { at: rounded(self.samples[place + 1 - stands].time - self.start) });
            }
        }
        None
    }

    /// A response to a step that stops rising at once. One that tends to its end does so ever more slowly.
    fn ceiling(&self) -> Option<Finding> {
        let (input, begin) = self.step()?;
        let rising: Vec<f64> = self.samples[begin..].iter().map(|sample| sample.speed * input.signum()).collect();
        let limit = rising.iter().copied().fold(f64::MIN, f64::max);
        let tolerance = (1.5 * self.quantum).max(1e-9 * limit.abs());
        let first = rising.iter().position(|speed| limit - speed <= tolerance)?;
        let flat = rising[first..].iter().all(|speed| limit - speed <= tolerance);
        let span = (first / 4).clamp(4, 40);
        if !flat || rising.len() - first < 10 || first < 2 * span {
            return None;
        }
        let rise = |from: usize, to: usize| {
            (rising[to] - rising[from], self.samples[begin + to].time - self.samples[begin + from].time)
        };
        let ((last, last_s), (whole, whole_s)) = (rise(first - 1 - span, first - 1), rise(0, first - 1));
        let slope = last / last_s;
        let at = rounded(self.samples[begin + first].time - self.start);
        let finding = Finding::Saturated { limit: rounded(limit), at, slope: rounded(slope) };
        (slope > 0.3 * whole / whole_s && last > 2.0 * tolerance).then_some(finding)
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
