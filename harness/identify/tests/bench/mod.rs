//! A motor whose speed ripples, and an encoder that floors: the truth that the methods are to find.

#![allow(dead_code, reason = "each test file uses a part of it")]

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use torno_identify::{Data, FirstOrder, Sample, Sensor};

/// The window of the paper's boards, in s (§4).
pub(crate) const WINDOW: f64 = 0.030;
/// The torque that makes the ripple changes so often in a window.
const PIECES: usize = 10;

/// A motor: its model in units of speed, and its encoder.
#[derive(Clone, Copy)]
pub(crate) struct Axis {
    pub(crate) model: FirstOrder,
    /// Counts in a unit of position.
    pub(crate) counts_per_unit: f64,
    /// Units of speed in 1 rpm.
    pub(crate) rpm: f64,
}

/// §4: 19 rad/s per V, 2.8 s, 50 pulses a revolution.
pub(crate) const SPINDLE: Axis = Axis {
    model: FirstOrder { gain: 19.0, tau: 2.8 },
    counts_per_unit: 50.0 / core::f64::consts::TAU,
    rpm: core::f64::consts::TAU / 60.0,
};

/// §4: 500 rpm at 255 LSB, 900 counts a revolution, 0.71875 s.
pub(crate) fn feed() -> Axis {
    Axis { model: FirstOrder { gain: 7_500.0 / 255.0, tau: 0.718_75 }, counts_per_unit: 1.0, rpm: 900.0 / 60.0 }
}

pub(crate) struct Bench {
    axis: Axis,
    /// The deviation of each piece's torque, in units of the speed that it leads to in the end.
    push: f64,
    random: ChaCha8Rng,
    speed: f64,
    /// In counts.
    position: f64,
    flaws: Flaws,
}

/// What an encoder and its clock have besides whole counts.
#[derive(Clone, Copy, Default)]
pub(crate) struct Flaws {
    /// The deviation of the time stamps, in s.
    pub(crate) jitter: f64,
    /// By how many counts the code wheel is off, at most, as it is not centred.
    pub(crate) eccentric: f64,
    /// Counts in its revolution.
    pub(crate) per_rev: f64,
    /// The drive reaches the motor so much later, in s.
    pub(crate) dead: f64,
}

impl Bench {
    /// A motor at rest whose speed will ripple by `rpm` rms, the encoder anywhere in a slot.
    pub(crate) fn new(axis: Axis, rpm: f64, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let position = uniform(&mut random);
        let kept = libm::exp(-WINDOW / PIECES as f64 / axis.model.tau);
        // A white torque, through the motor's own lag.
        let push = rpm * axis.rpm * ((1.0 + kept) / (1.0 - kept)).sqrt();
        Self { axis, push, random, speed: 0.0, position, flaws: Flaws::default() }
    }

    /// The same with an encoder that has these flaws, the wheel turned anyhow.
    pub(crate) fn flawed(mut self, flaws: Flaws) -> Self {
        self.position += (flaws.per_rev * uniform(&mut self.random)).floor();
        self.flaws = flaws;
        self
    }

    /// What the encoder has counted.
    fn count(&self) -> f64 {
        let Flaws { eccentric, per_rev, .. } = self.flaws;
        let turned = if eccentric > 0.0 { libm::sin(core::f64::consts::TAU * self.position / per_rev) } else { 0.0 };
        (self.position + eccentric * turned).floor()
    }

    /// Lets so many seconds pass, in pieces; exact.
    fn pass(&mut self, input: f64, seconds: f64, pieces: usize) {
        let FirstOrder { gain, tau } = self.axis.model;
        let length = seconds / pieces as f64;
        let kept = libm::exp(-length / tau);
        for _ in 0..pieces {
            let toward = gain * input + self.push * normal(&mut self.random);
            let way = toward * length + (self.speed - toward) * tau * (1.0 - kept);
            self.position += way * self.axis.counts_per_unit;
            self.speed = toward + (self.speed - toward) * kept;
        }
    }

    /// One window for each input.
    pub(crate) fn counted(&mut self, inputs: &[f64]) -> Data {
        let quantum = 1.0 / (self.axis.counts_per_unit * WINDOW);
        let mut samples = Vec::new();
        let start = self.stamp(0.0);
        let mut before = start;
        for (n, input) in (1..).zip(inputs) {
            let count = self.count();
            self.pass_late(*input, &inputs[..n as usize - 1]);
            let counts = self.count() - count;
            let time = self.stamp(WINDOW * f64::from(n));
            let length = if self.flaws.jitter > 0.0 { time - before } else { WINDOW };
            before = time;
            samples.push(Sample { time, input: *input, speed: counts * quantum * WINDOW / length });
        }
        Data::new(Sensor::Mean, start, samples, quantum).unwrap()
    }

    /// Lets a window pass after others, with the dead time.
    fn pass_late(&mut self, input: f64, before: &[f64]) {
        let windows = self.flaws.dead / WINDOW;
        if windows == 0.0 {
            return self.pass(input, WINDOW, PIECES);
        }
        let set = |ago: usize| {
            let place = (before.len() + 1).checked_sub(ago + 1);
            place.map_or(0.0, |place| before.get(place).copied().unwrap_or(input))
        };
        let (whole, part) = (windows.floor() as usize, windows.fract());
        for (ago, share) in [(whole + 1, part), (whole, 1.0 - part)] {
            self.pass(set(ago), share * WINDOW, (share * PIECES as f64).ceil().max(1.0) as usize);
        }
    }

    /// What the clock says at a time.
    fn stamp(&mut self, time: f64) -> f64 {
        if self.flaws.jitter > 0.0 { time + self.flaws.jitter * normal(&mut self.random) } else { time }
    }

    /// The position in a loop with a drive of `gain` whole LSB per count of error, for a step of so many counts.
    pub(crate) fn closed(&mut self, gain: f64, counts: i32, period: f64, seconds: f64) -> Vec<(f64, f64)> {
        let origin = self.position.floor();
        let sample = |n: u32| {
            let error = f64::from(counts) - (self.position.floor() - origin);
            let drive = (gain * error).round().clamp(-255.0, 255.0);
            self.pass(drive, period, if period < 0.01 { 1 } else { PIECES });
            (period * f64::from(n), self.position.floor() - origin)
        };
        (1..=(seconds / period) as u32).map(sample).collect()
    }
}

fn uniform(random: &mut ChaCha8Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// Box and Muller.
fn normal(random: &mut ChaCha8Rng) -> f64 {
    let radius = (-2.0 * libm::log(1.0 - uniform(random))).sqrt();
    radius * libm::cos(core::f64::consts::TAU * uniform(random))
}
