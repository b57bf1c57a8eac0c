//! The PID of the transverse axis (Eq. 13 and 14), and the other laws that can stand in its place.

use crate::settings::PositionForm;

/// Without a count for so long, an axis stands. (Ours.)
pub(crate) const STANDS_MS: u32 = 240;
/// What is kept of what the integral gained while the axis was stuck. (Ours.)
pub const KEPT: f64 = 0.25;

/// The gains: K1 = Kp, K2 = Kp/Ti in 1/s, K3 = Kp·Td in s; LSB of drive per count of error.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gains {
    pub(crate) k1: f64,
    pub(crate) k2: f64,
    pub(crate) k3: f64,
    /// K2 while set point and axis stand.
    pub(crate) k2_standing: f64,
    /// How fast the integral's growth grows while the axis stands, in LSB/s².
    pub(crate) breakaway: f64,
    /// The error that is not integrated while set point and axis stand, in counts.
    pub(crate) dead_band: f64,
    /// The integral state changes only while the error is no larger, in counts.
    pub(crate) zone: f64,
    /// Kch of the characterisation, LSB per count.
    pub(crate) kch: f64,
}

/// What one sample of the law goes by.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    /// The set point less the count.
    pub(crate) error: f64,
    pub(crate) set_point: f64,
    /// In LSB.
    pub(crate) feed_forward: f64,
    /// The set point stands at its target.
    pub(crate) finished: bool,
    /// The axis has counted since the sample before.
    pub(crate) moved: bool,
}

/// A PID with an integral state of its own.
///
/// Eq. 15 prints the whole output u(k−1) in the place of that state; so it would have no integral action. The integral
/// is the rectangular one of Eq. 14. It holds outside the zone, and while the output is limited in the same sense.
/// Three rules against friction are added to it, all of them ours:
///
/// - While set point and axis stand, the integral has a larger gain: an error that friction leaves is not a lag.
/// - While the axis stands out of its dead band, the integral grows faster and faster, up to full drive within about a
///   second. So it breaks away from any friction, and a shaft that full drive does not turn is blocked. Once the axis
///   moves, most of this growth is taken back, because sliding friction goes on without it.
/// - Within the dead band the integral holds once the axis stands. Otherwise it would grow until the axis breaks away
///   again, beyond its target: it would hunt.
///
/// Eq. 15 as printed and the proportional loop of Fig. 9 are there to be seen.
#[derive(Clone, Debug)]
pub(crate) struct Pid {
    form: PositionForm,
    gains: Gains,
    sample_s: f64,
    limit: f64,
    /// In LSB.
    integral: f64,
    /// What it has gained since the axis has been stuck.
    gained: f64,
    /// Samples in a row without a count, and of these those out of the dead band.
    still: u32,
    stuck: u32,
    previous: f64,
    /// The last output, limited but not rounded.
    output: f64,
}

impl Pid {
    /// A PID at rest, whose output stays within ±`limit`.
    pub(crate) const fn new(form: PositionForm, gains: Gains, sample_s: f64, limit: f64) -> Self {
        let (integral, gained, previous, output) = (0.0, 0.0, 0.0, 0.0);
        Self { form, gains, sample_s, limit, integral, gained, still: 0, stuck: 0, previous, output }
    }

    /// One sample: the output, in whole LSB.
    pub(crate) fn step(&mut self, sample: Sample) -> i64 {
        let Sample { error, set_point, feed_forward, .. } = sample;
        let Gains { k1, k2, k3, kch, .. } = self.gains;
        self.watch(sample);
        let growth = self.growth(sample);
        let integral = self.integral + growth;
        let slope = (error - self.previous) / self.sample_s;
        let wanted = match self.form {
            PositionForm::Pid => k1 * error + integral + k3 * slope + feed_forward,
            PositionForm::Literal => {
                k1 * error + k2 * (self.output + self.sample_s * error) + k3 * slope + feed_forward
            }
            PositionForm::Characterisation => kch * error,
            PositionForm::Open => set_point,
        };
        let output = wanted.max(-self.limit).min(self.limit);
        if (wanted - output) * error <= 0.0 {
            self.integral = integral;
            if self.stuck > 0 && self.gains.breakaway > 0.0 {
                self.gained += growth;
            }
        }
        self.previous = error;
        self.output = output;
        output.round() as i64
    }

    /// For how long the axis has stood. One that breaks away gives back what it took.
    fn watch(&mut self, sample: Sample) {
        let out = sample.error.abs() > self.gains.dead_band;
        self.still = if sample.moved { 0 } else { self.still.saturating_add(1) };
        self.stuck = if sample.moved || !out { 0 } else { self.stuck.saturating_add(1) };
        if sample.moved {
            self.integral -= (1.0 - KEPT) * self.gained;
            self.gained = 0.0;
        }
    }

    /// By how much the integral is to grow.
    fn growth(&self, sample: Sample) -> f64 {
        let Sample { error, finished, .. } = sample;
        let Gains { k2, k2_standing, breakaway, dead_band, zone, .. } = self.gains;
        let stands = f64::from(self.still) * self.sample_s >= f64::from(STANDS_MS) / 1_000.0;
        let holds = error.abs() > zone || (finished && stands && error.abs() <= dead_band);
        let gain = if finished && self.still > 0 { k2_standing } else { k2 };
        let growth = if holds { 0.0 } else { gain * self.sample_s * error };
        let stuck_s = f64::from(self.stuck.saturating_sub(1)) * self.sample_s;
        growth + breakaway * self.sample_s * stuck_s * error.signum()
    }

    /// The last error was 0: with the error staying there, the output is what the integral makes it.
    pub(crate) fn is_level(&self) -> bool {
        let stays = self.form != PositionForm::Literal || self.output == 0.0 || self.gains.k2 <= 1.0;
        self.previous == 0.0 && stays
    }

    /// Forgets everything.
    pub(crate) const fn reset(&mut self) {
        self.integral = 0.0;
        self.gained = 0.0;
        self.still = 0;
        self.stuck = 0;
        self.previous = 0.0;
        self.output = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoder::Encoder;
    use crate::plant::PositionMotor;
    use torno_protocol::time::{Instant, Span};

    /// Eq. 14, and nothing else.
    const GAINS: Gains =
        Gains { k1: 1.5, k2: 0.5, k3: 0.27, k2_standing: 0.5, breakaway: 0.0, dead_band: 0.0, zone: 50.0, kch: 0.0 };

    /// With the set point where it stays, and an axis that moves.
    fn step(pid: &mut Pid, error: f64, feed_forward: f64) -> i64 {
        pid.step(Sample { error, set_point: 0.0, feed_forward, finished: true, moved: true })
    }

    #[test]
    fn one_count_is_worth_10_5_lsb_at_first() {
        let first =
            |error, feed_forward| step(&mut Pid::new(PositionForm::Pid, GAINS, 0.030, 255.0), error, feed_forward);
        assert_eq!((first(1.0, 0.0), first(-1.0, 0.0), first(1.0, 5.0)), (11, -11, 16));
    }

    #[test]
    fn a_standing_error_is_integrated_within_the_zone_only() {
        let settled = |error: f64, k2: f64| {
            let mut pid = Pid::new(PositionForm::Pid, Gains { k2, ..GAINS }, 0.030, 255.0);
            (0..400).fold(0, |_, _| step(&mut pid, error, 0.0))
        };
        // 12 s of 4 counts at 0.5 1/s are 24 LSB on top of the proportional 6.
        assert_eq!((settled(4.0, 0.5), settled(4.0, 0.0)), (30, 6));
        assert_eq!(settled(51.0, 0.5), settled(51.0, 0.0));
    }

    #[test]
    fn it_is_level_if_the_output_stays_with_the_error_at_zero() {
        let after = |form: PositionForm, k2: f64, errors: &[f64]| {
            let mut pid = Pid::new(form, Gains { k2, ..GAINS }, 0.030, 255.0);
            errors.iter().for_each(|error| _ = step(&mut pid, *error, 0.0));
            pid.is_level()
        };
        for (form, k2, errors, level) in [
            (PositionForm::Pid, 0.5, &[][..], true),
            (PositionForm::Pid, 0.5, &[4.0], false),
            (PositionForm::Pid, 2.0, &[4.0, 0.0], true),
            (PositionForm::Literal, 0.5, &[4.0, 0.0], true),
            // Its output feeds itself: with a gain above one it grows.
            (PositionForm::Literal, 2.0, &[4.0, 0.0], false),
            (PositionForm::Literal, 1.0, &[4.0, 0.0], true),
            (PositionForm::Literal, 2.0, &[], true),
            (PositionForm::Literal, 0.5, &[4.0], false),
        ] {
            assert_eq!(after(form, k2, errors), level, "{form:?} {k2} {errors:?}");
        }
    }

    /// What becomes of the drive of an axis that stands, with the set point at its target.
    fn standing(gains: Gains, errors: &[f64]) -> Vec<i64> {
        let mut pid = Pid::new(PositionForm::Pid, gains, 0.030, 255.0);
        let sample = |error: f64| Sample { error, set_point: 0.0, feed_forward: 0.0, finished: true, moved: false };
        errors.iter().map(|error| pid.step(sample(*error))).collect()
    }

    #[test]
    fn a_stuck_axis_is_driven_fully_within_1_1_s_however_small_the_error() {
        let gains = Gains { k2: 1.5, k2_standing: 3.0, breakaway: 500.0, dead_band: 1.0, ..GAINS };
        for error in [2.0, -2.0, 20.0] {
            let drives = standing(gains, &[error; 50]);
            let full = drives.iter().position(|drive| *drive == 255 * error.signum() as i64).unwrap();
            assert!((20..=36).contains(&full), "{error}: {full}");
            assert!(drives[1..].windows(2).all(|pair| pair[1].abs() >= pair[0].abs()), "{drives:?}");
        }
        let plain = standing(Gains { breakaway: 0.0, ..gains }, &[2.0; 50]);
        assert!(plain[49] < 20, "{plain:?}");
    }

    #[test]
    fn an_axis_that_has_broken_away_gives_back_three_quarters_of_what_it_took() {
        let gains = Gains { k1: 0.0, k3: 0.0, k2: 0.0, k2_standing: 0.0, breakaway: 500.0, dead_band: 1.0, ..GAINS };
        let mut pid = Pid::new(PositionForm::Pid, gains, 0.030, 255.0);
        let sample = |moved| Sample { error: 2.0, set_point: 0.0, feed_forward: 0.0, finished: true, moved };
        let before = (0..20).fold(0, |_, _| pid.step(sample(false)));
        // 0.45 LSB a sample more with each sample after the first.
        assert_eq!(before, 86);
        assert_eq!([true, true].map(|moved| pid.step(sample(moved))), [21, 21]);
    }

    #[test]
    fn within_the_dead_band_the_integral_holds_once_the_axis_stands() {
        let gains = Gains { k2: 1.5, k2_standing: 3.0, breakaway: 500.0, dead_band: 1.0, ..GAINS };
        let drives = standing(gains, &[1.0; 400]);
        assert!(drives[10..].iter().all(|drive| *drive == drives[10]), "{drives:?}");
        assert!(standing(Gains { dead_band: 0.0, ..gains }, &[1.0; 400])[399] == 255);
    }

    #[test]
    fn the_integral_does_not_wind_up_at_the_limit() {
        let mut pid = Pid::new(PositionForm::Pid, Gains { zone: 1e9, ..GAINS }, 0.030, 255.0);
        (0..10_000).for_each(|_| _ = step(&mut pid, 300.0, 0.0));
        assert_eq!(step(&mut pid, 300.0, 0.0), 255);
        (0..2).for_each(|_| _ = step(&mut pid, 0.0, 0.0));
        assert!(step(&mut pid, 0.0, 0.0) < 10);
    }

    /// The step response that the gains were chosen for, without a profile.
    #[test]
    fn a_step_of_900_counts_rises_in_0_39_s_and_settles_in_0_69_s() {
        let mut motor = PositionMotor::new(0.71875, 7_500.0, 36_000.0);
        let mut pid = Pid::new(PositionForm::Pid, GAINS, 0.030, 255.0);
        let mut now = Instant::START;
        let mut path = vec![(0.0, 0.0)];
        for _ in 0..300 {
            let error = 900 - Encoder::new(1.0).count(motor.position());
            motor.drive(step(&mut pid, error as f64, 0.0) as f64 * 7_500.0 / 255.0);
            now += Span::from_millis(30);
            motor.advance(now);
            path.push((now.as_secs_f64(), motor.position()));
        }
        let first = |level: f64| path.iter().find(|(_, x)| *x >= level).unwrap().0;
        let settled = path.iter().rev().find(|(_, x)| (x - 900.0).abs() > 18.0).unwrap().0 + 0.030;
        let peak = path.iter().map(|(_, x)| *x).fold(0.0, f64::max);
        let rise = first(810.0) - first(90.0);
        assert!((rise - 0.39).abs() <= 0.039 + 1e-9, "{rise}");
        assert!((settled - 0.69).abs() <= 0.069, "{settled}");
        assert!(peak < 909.0, "{peak}");
        assert_eq!(Encoder::new(1.0).count(motor.position()), 900);
    }
}
