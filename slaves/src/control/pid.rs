//! The PID of the transverse axis (Eq. 13 and 14), and the other laws that can stand in its place.

use crate::settings::PositionForm;

/// The gains: K1 = Kp, K2 = Kp/Ti in 1/s, K3 = Kp·Td in s; LSB of drive per count of error.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gains {
    pub(crate) k1: f64,
    pub(crate) k2: f64,
    pub(crate) k3: f64,
    /// The integral state changes only while the error is no larger, in counts.
    pub(crate) zone: f64,
    /// Kch of the characterisation, LSB per count.
    pub(crate) kch: f64,
}

/// A PID with an integral state of its own.
///
/// Eq. 15 prints the whole output u(k−1) in the place of that state; so it would have no integral action. The integral
/// is the rectangular one of Eq. 14. It holds outside the zone, and while the output is limited in the same sense.
/// Eq. 15 as printed and the proportional loop of Fig. 9 are there to be seen.
#[derive(Clone, Debug)]
pub(crate) struct Pid {
    form: PositionForm,
    gains: Gains,
    sample_s: f64,
    limit: f64,
    integral: f64,
    previous: f64,
    /// The last output, limited but not rounded.
    output: f64,
}

impl Pid {
    /// A PID at rest, whose output stays within ±`limit`.
    pub(crate) const fn new(form: PositionForm, gains: Gains, sample_s: f64, limit: f64) -> Self {
        Self { form, gains, sample_s, limit, integral: 0.0, previous: 0.0, output: 0.0 }
    }

    /// One sample: the output for `error` before a set point, with `feed_forward` added, in whole LSB.
    pub(crate) fn step(&mut self, error: f64, set_point: f64, feed_forward: f64) -> i64 {
        let Gains { k1, k2, k3, zone, kch } = self.gains;
        let integral = if error.abs() <= zone { self.integral + self.sample_s * error } else { self.integral };
        let slope = (error - self.previous) / self.sample_s;
        let wanted = match self.form {
            PositionForm::Pid => k1 * error + k2 * integral + k3 * slope + feed_forward,
            PositionForm::Literal => {
                k1 * error + k2 * (self.output + self.sample_s * error) + k3 * slope + feed_forward
            }
            PositionForm::Characterisation => kch * error,
            PositionForm::Open => set_point,
        };
        let output = wanted.max(-self.limit).min(self.limit);
        if (wanted - output) * error <= 0.0 {
            self.integral = integral;
        }
        self.previous = error;
        self.output = output;
        output.round() as i64
    }

    /// The last error was 0: with the error staying there, the output is what the integral makes it.
    pub(crate) fn is_level(&self) -> bool {
        let stays = self.form != PositionForm::Literal || self.output == 0.0 || self.gains.k2 <= 1.0;
        self.previous == 0.0 && stays
    }

    /// Forgets everything.
    pub(crate) const fn reset(&mut self) {
        self.integral = 0.0;
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

    const GAINS: Gains = Gains { k1: 1.5, k2: 0.5, k3: 0.27, zone: 50.0, kch: 0.0 };

    #[test]
    fn one_count_is_worth_10_5_lsb_at_first() {
        assert_eq!(Pid::new(PositionForm::Pid, GAINS, 0.030, 255.0).step(1.0, 0.0, 0.0), 11);
        assert_eq!(Pid::new(PositionForm::Pid, GAINS, 0.030, 255.0).step(-1.0, 0.0, 0.0), -11);
        assert_eq!(Pid::new(PositionForm::Pid, GAINS, 0.030, 255.0).step(1.0, 0.0, 5.0), 16);
    }

    #[test]
    fn a_standing_error_is_integrated_within_the_zone_only() {
        let settled = |error: f64, k2: f64| {
            let mut pid = Pid::new(PositionForm::Pid, Gains { k2, ..GAINS }, 0.030, 255.0);
            (0..400).fold(0, |_, _| pid.step(error, 0.0, 0.0))
        };
        // 12 s of 4 counts at 0.5 1/s are 24 LSB on top of the proportional 6.
        assert_eq!((settled(4.0, 0.5), settled(4.0, 0.0)), (30, 6));
        assert_eq!(settled(51.0, 0.5), settled(51.0, 0.0));
    }

    #[test]
    fn it_is_level_if_the_output_stays_with_the_error_at_zero() {
        let after = |form: PositionForm, k2: f64, errors: &[f64]| {
            let mut pid = Pid::new(form, Gains { k2, ..GAINS }, 0.030, 255.0);
            errors.iter().for_each(|error| _ = pid.step(*error, 0.0, 0.0));
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

    #[test]
    fn the_integral_does_not_wind_up_at_the_limit() {
        let mut pid = Pid::new(PositionForm::Pid, Gains { zone: 1e9, ..GAINS }, 0.030, 255.0);
        (0..10_000).for_each(|_| _ = pid.step(300.0, 0.0, 0.0));
        assert_eq!(pid.step(300.0, 0.0, 0.0), 255);
        (0..2).for_each(|_| _ = pid.step(0.0, 0.0, 0.0));
        assert!(pid.step(0.0, 0.0, 0.0) < 10);
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
            motor.drive(pid.step(error as f64, 0.0, 0.0) as f64 * 7_500.0 / 255.0);
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
