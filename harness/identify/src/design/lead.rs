//! The main motor's law (Eq. 7), incremental: what the compensator says is a change of the drive.

use core::f64::consts::PI;

use super::{LOWER, TRIES};
use crate::discrete::Discrete;
use crate::polynomial::modulus;
use crate::response::bisect;
use crate::{Finding, FirstOrder, Polynomial};

/// The crossover to begin with, in rad a sample. (Ours: above it a count is too large a part of the drive.)
const CROSSOVER: f64 = 0.15;
/// The zero is so much slower than the crossover. (Ours: faster costs phase, slower brings the lag's own time back
/// whenever the drive has been at its limit.)
const ZERO: f64 = 5.0;

/// c(k) = −β·c(k−1) + K·(e(k) − α·e(k−1)), u(k) = u(k−1) + c(k), for speeds that are counted in windows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lead {
    /// The zero.
    pub alpha: f64,
    /// The pole, negated.
    pub beta: f64,
    /// The gain, in units of input per unit of speed.
    pub k: f64,
}

impl Lead {
    /// A compensator for a motor whose speed is counted in windows of `period` seconds.
    ///
    /// # Errors
    /// [`Finding::NoController`] if there is none with this phase margin, in degrees.
    pub fn design(model: &FirstOrder, period: f64, phase_margin: f64) -> Result<Self, Finding> {
        let mut crossover = CROSSOVER / period;
        for _ in 0..TRIES {
            if let Some(lead) = Self::with_crossover(model, period, phase_margin, crossover) {
                return Ok(lead);
            }
            crossover *= LOWER;
        }
        Err(Finding::NoController { law: "lead compensator", margin: phase_margin, crossover: crossover.round() })
    }

    fn with_crossover(model: &FirstOrder, period: f64, phase_margin: f64, crossover: f64) -> Option<Self> {
        let alpha = libm::exp(-crossover * period / ZERO);
        let with = |pole: f64, k: f64| Self { alpha, beta: -pole, k }.open_loop(model, period);
        let margin = |pole: f64| {
            let at = with(pole, 1.0).at_frequency(crossover);
            let phase = libm::atan2(at.im, at.re) * 180.0 / PI;
            180.0 + if phase > 0.0 { phase - 360.0 } else { phase }
        };
        // A pole at 0 leads most; one at the zero not at all.
        if margin(0.0) < phase_margin || model.gain * crossover <= 0.0 {
            return None;
        }
        let pole = bisect(0.0, alpha, |pole| margin(pole) - phase_margin);
        Some(Self { alpha, beta: -pole, k: 1.0 / modulus(with(pole, 1.0).at_frequency(crossover)) })
    }

    /// The compensator with its integrator, and the motor.
    pub fn open_loop(&self, model: &FirstOrder, period: f64) -> Discrete {
        let mut motor = Discrete::counted_speed(model, period);
        // The integrator is z/(z − 1); its z is the window's delay, which the motor has as its last pole.
        motor.denominator.0.pop();
        let compensator = Discrete {
            numerator: Polynomial::root(self.alpha).scaled(self.k),
            denominator: Polynomial::root(-self.beta).times(&Polynomial::root(1.0)),
            period,
        };
        compensator.times(&motor)
    }

    /// The counted speeds, window by window, from a steady `from` on, when the set point becomes `to`. The drive stays
    /// from 0 to `limit`, as that of a motor that cannot be braked.
    pub fn simulate(
        &self,
        model: &FirstOrder,
        period: f64,
        [from, to]: [f64; 2],
        limit: f64,
        windows: usize,
    ) -> Vec<(f64, f64)> {
        let kept = libm::exp(-period / model.tau);
        let share = -libm::expm1(-period / model.tau) * model.tau / period;
        let (mut speed, mut counted, mut drive) = (from, from, from / model.gain);
        // Firmware that starts from rest has no error before the first: no kick.
        let (mut change, mut error) = (0.0, if from == 0.0 { to } else { 0.0 });
        let window = |n: usize| {
            let point = (period * n as f64, counted);
            let previous = core::mem::replace(&mut error, to - counted);
            change = self.k * (error - self.alpha * previous) - self.beta * change;
            drive = (drive + change).clamp(0.0, limit);
            let target = model.gain * drive;
            counted = target + (speed - target) * share;
            speed = target + (speed - target) * kept;
            point
        };
        (0..windows).map(window).collect()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Complex;

    use super::*;
    use crate::response::{check_stable, margins, of_step};

    const MOTOR: FirstOrder = FirstOrder { gain: 19.0, tau: 2.8 };
    const DEFAULT: Lead = Lead { alpha: 0.97, beta: -0.60, k: 0.30 };

    fn near(found: Complex<f64>, re: f64, im: f64) -> bool {
        (found.re - re).abs() < 2e-4 && (found.im.abs() - im).abs() < 2e-4
    }

    /// The board's default: the root locus and the margins that it was chosen by.
    #[test]
    fn the_default_has_the_poles_and_margins_that_it_should() {
        let open = DEFAULT.open_loop(&MOTOR, 0.030);
        let poles = open.closed_poles();
        assert!(near(poles[0], 0.9647, 0.0) && near(poles[1], 0.7971, 0.1021), "{poles:?}");
        let found = margins(&open).unwrap();
        assert!((found.crossover - 4.90).abs() < 0.01 && (found.phase - 61.9).abs() < 0.1, "{found:?}");
        assert!((found.gain_db().unwrap() - 22.1).abs() < 0.1 && (found.delay() - 0.220).abs() < 0.002, "{found:?}");
    }

    /// 2000 to 2200 rpm: 0.24 s, 2.04 s, 11.2 %. From rest to 4000 rpm the drive is at its limit: 2.88 s.
    #[test]
    fn the_default_does_what_it_should() {
        let rpm = core::f64::consts::TAU / 60.0;
        let small = DEFAULT.simulate(&MOTOR, 0.030, [2_000.0 * rpm, 2_200.0 * rpm], 30.0, 400);
        let found = of_step(&small, 2_000.0 * rpm, 2_200.0 * rpm).unwrap();
        assert!((found.rise - 0.24).abs() < 0.03 && (found.settling - 2.04).abs() < 0.05, "{found:?}");
        assert!((found.overshoot - 0.112).abs() < 0.005, "{found:?}");
        let large = of_step(&DEFAULT.simulate(&MOTOR, 0.030, [0.0, 4_000.0 * rpm], 30.0, 600), 0.0, 4_000.0 * rpm);
        let found = large.unwrap();
        assert!((found.rise - 2.88).abs() < 0.05 && found.overshoot < 0.002, "{found:?}");
        // The linear loop's own step is the small one.
        let linear = DEFAULT.open_loop(&MOTOR, 0.030).closed().step(400);
        let scaled = |(_, y): &(f64, f64)| (y / rpm - 2_000.0) / 200.0;
        assert!(small.iter().zip(&linear).all(|(point, y)| (scaled(point) - y).abs() < 1e-9));
    }

    #[test]
    fn a_designed_compensator_has_the_margin_that_was_asked_for() {
        for (gain, tau, period) in [(19.0, 2.8, 0.030), (19.0, 2.8, 0.032), (5.0, 0.4, 0.010), (400.0, 30.0, 0.1)] {
            for wanted in [45.0, 60.0, 70.0] {
                let motor = FirstOrder { gain, tau };
                let open = Lead::design(&motor, period, wanted).unwrap().open_loop(&motor, period);
                check_stable(&open).unwrap();
                assert!((margins(&open).unwrap().phase - wanted).abs() < 0.1, "{gain} {tau} {period} {wanted}");
            }
        }
        assert!(matches!(Lead::design(&MOTOR, 0.030, 175.0), Err(Finding::NoController { .. })));
    }
}
