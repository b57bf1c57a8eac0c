//! From s to z: what a firmware sees that holds its drive from one sample to the next (zero-order hold, exact).

use nalgebra::Complex;

use crate::{FirstOrder, Polynomial, SecondOrder};

/// A transfer function in z.
#[derive(Clone, Debug, PartialEq)]
pub struct Discrete {
    /// The numerator.
    pub numerator: Polynomial,
    /// The denominator.
    pub denominator: Polynomial,
    /// The sample time, in s.
    pub period: f64,
}

impl Discrete {
    /// Speed at the sample (Eq. 6).
    pub fn speed(model: &FirstOrder, period: f64) -> Self {
        let pole = libm::exp(-period / model.tau);
        let gain = -model.gain * libm::expm1(-period / model.tau);
        Self { numerator: Polynomial(vec![gain]), denominator: Polynomial::root(pole), period }
    }

    /// The mean speed of the window that ends at the sample, which is what an encoder's counts tell: half a window
    /// older than the speed itself.
    pub fn counted_speed(model: &FirstOrder, period: f64) -> Self {
        let FirstOrder { gain, tau } = *model;
        let pole = libm::exp(-period / tau);
        let share = -libm::expm1(-period / tau) * tau / period;
        let numerator = Polynomial(vec![gain * (1.0 - share), gain * (share - pole)]);
        Self { numerator, denominator: Polynomial(vec![1.0, -pole, 0.0]), period }
    }

    /// Position at the sample.
    pub fn position(model: &FirstOrder, period: f64) -> Self {
        let FirstOrder { gain, tau } = *model;
        let pole = libm::exp(-period / tau);
        let gone = -libm::expm1(-period / tau);
        let numerator = Polynomial(vec![gain * (period - tau * gone), gain * (tau * gone - period * pole)]);
        Self { numerator, denominator: Polynomial::root(1.0).times(&Polynomial::root(pole)), period }
    }

    /// The second order (Eq. 12), underdamped.
    pub fn second_order(model: &SecondOrder, period: f64) -> Self {
        let SecondOrder { omega, xi } = *model;
        let damped = omega * libm::sqrt(1.0 - xi * xi);
        let decay = libm::exp(-xi * omega * period);
        let (sin, cos) = libm::sincos(damped * period);
        let ratio = xi * omega / damped * sin;
        let (a1, a2) = (-2.0 * decay * cos, decay * decay);
        let (b0, b1) = (1.0 - decay * (cos + ratio), decay * (decay + ratio - cos));
        Self { numerator: Polynomial(vec![b0, b1]), denominator: Polynomial(vec![1.0, a1, a2]), period }
    }

    /// Its value at `z`.
    pub fn at(&self, z: Complex<f64>) -> Complex<f64> {
        self.numerator.at(z) / self.denominator.at(z)
    }

    /// Its value at ω, in rad/s.
    pub fn at_frequency(&self, omega: f64) -> Complex<f64> {
        let (sin, cos) = libm::sincos(omega * self.period);
        self.at(Complex::new(cos, sin))
    }

    /// The product, sampled as this one.
    #[must_use]
    pub fn times(&self, other: &Self) -> Self {
        Self {
            numerator: self.numerator.times(&other.numerator),
            denominator: self.denominator.times(&other.denominator),
            period: self.period,
        }
    }

    /// The poles of the loop that is closed around it with unity feedback, the largest modulus first.
    pub fn closed_poles(&self) -> Vec<Complex<f64>> {
        self.denominator.plus(&self.numerator).roots()
    }

    /// The loop closed around it with unity feedback.
    #[must_use]
    pub fn closed(&self) -> Self {
        let denominator = self.denominator.plus(&self.numerator);
        Self { numerator: self.numerator.clone(), denominator, period: self.period }
    }

    /// So many samples of the response to a step of 1, from the instant of the step on.
    pub fn step(&self, samples: usize) -> Vec<f64> {
        let (a, b) = (&self.denominator.0, &self.numerator.0);
        let shift = a.len() - b.len();
        let mut output: Vec<f64> = Vec::with_capacity(samples);
        for n in 0..samples {
            let fed: f64 = b.iter().enumerate().filter(|(m, _)| n >= m + shift).map(|(_, b)| b).sum();
            let back: f64 = (1..a.len()).filter(|m| *m <= n).map(|m| a[m] * output[n - m]).sum();
            output.push((fed - back) / a[0]);
        }
        output
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: &[f64], expected: &[f64], tolerance: f64) {
        assert_eq!(found.len(), expected.len());
        let off = |(found, expected): (&f64, &f64)| (found - expected).abs() > tolerance;
        assert!(!found.iter().zip(expected).any(off), "{found:?}, expected {expected:?}");
    }

    /// Eq. 6 prints 0.21591/(z − 0.9886), which is for T = 32 ms; with the 30 ms of the text it is another.
    #[test]
    fn eq_6_is_eq_5_sampled_every_32_ms() {
        let motor = FirstOrder { gain: 19.0, tau: 2.8 };
        let at = |period| Discrete::speed(&motor, period);
        near(&at(0.032).numerator.0, &[0.215_907], 1e-6);
        near(&at(0.032).denominator.0, &[1.0, -0.988_636], 1e-6);
        near(&at(0.030).numerator.0, &[0.202_485], 1e-6);
        near(&at(0.030).denominator.0, &[1.0, -0.989_343], 1e-6);
    }

    /// Eq. 12, with the three digits put right that it misprints.
    #[test]
    fn eq_12_is_eq_11_sampled_every_32_ms() {
        let omega = libm::sqrt(3.707);
        let motor = SecondOrder { omega, xi: 1.39 / (2.0 * omega) };
        let Discrete { numerator, denominator, .. } = Discrete::second_order(&motor, 0.032);
        near(&[numerator.0[0], numerator.0[1] / numerator.0[0]], &[0.001_869_56, 0.985_281], 1e-6);
        near(&denominator.0, &[1.0, -1.952_783, 0.956_495], 1e-6);
        near(&Discrete::second_order(&motor, 0.032).step(2_000)[1_999..], &[1.0], 1e-9);
    }

    #[test]
    fn the_mean_of_a_window_is_what_position_gained_in_it() {
        let motor = FirstOrder { gain: 29.4, tau: 0.719 };
        let position = Discrete::position(&motor, 0.030).step(200);
        let counted = Discrete::counted_speed(&motor, 0.030).step(200);
        for n in 1..200 {
            // The position gained up to sample n is the speed of the window that ends there.
            assert!(((position[n] - position[n - 1]) / 0.030 - counted[n]).abs() < 1e-9);
        }
    }
}
