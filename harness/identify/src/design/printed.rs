//! The laws as the paper prints them, so that it can be seen what they would do.

use super::{Lead, Pid};
use crate::discrete::Discrete;
use crate::{FirstOrder, Polynomial};

/// A law taken at its word.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Printed {
    /// Eq. 7 as the drive itself, or as an addition to a drive that the set point alone decides: u = c. The loop's
    /// poles are the same.
    Lead(Lead),
    /// Eq. 15: u(k) = K1·x(k) + K2·(u(k−1) + T·x(k)) + K3/T·(x(k) − x(k−1)).
    Pid(Pid),
    /// Fig. 9: u = Kch·x.
    Proportional(f64),
}

impl Printed {
    /// The law and the motor.
    pub fn open_loop(&self, model: &FirstOrder, period: f64) -> Discrete {
        match *self {
            Self::Lead(Lead { alpha, beta, k }) => {
                let numerator = Polynomial::root(alpha).scaled(k);
                let law = Discrete { numerator, denominator: Polynomial::root(-beta), period };
                law.times(&Discrete::counted_speed(model, period))
            }
            Self::Pid(Pid { k1, k2, k3 }) => {
                let slope = k3 / period;
                let numerator = Polynomial(vec![k1 + k2 * period + slope, -slope]);
                let law = Discrete { numerator, denominator: Polynomial::root(k2), period };
                law.times(&Discrete::position(model, period))
            }
            Self::Proportional(k) => {
                let mut open = Discrete::position(model, period);
                open.numerator = open.numerator.scaled(k);
                open
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::response::check_stable;

    const AXIS: FirstOrder = FirstOrder { gain: 7_500.0 / 255.0, tau: 0.718_75 };

    /// The whole output in the place of the integral: with K2 = 0.5 it halves every sample what should be kept.
    #[test]
    fn eq_15_is_its_difference_equation() {
        let law = Pid { k1: 1.5, k2: 0.5, k3: 0.27 };
        let open = Printed::Pid(law).open_loop(&AXIS, 0.030);
        // Without the motor: to an error of 1 from the first sample on.
        let alone = Discrete {
            numerator: Polynomial(vec![law.k1 + law.k2 * 0.030 + 9.0, -9.0]),
            denominator: Polynomial::root(law.k2),
            period: 0.030,
        };
        let mut before = (0.0, 0.0);
        for found in alone.step(20) {
            let expected = 1.5 + 0.5 * (before.0 + 0.030) + 9.0 * (1.0 - before.1);
            assert!((found - expected).abs() < 1e-9);
            before = (expected, 1.0);
        }
        assert!(check_stable(&open).is_ok());
    }

    /// The larger K2, the less of it is an integral: what the board's own simulation has.
    #[test]
    fn eq_15_is_unstable_with_a_large_k2() {
        for (k2, largest) in [(0.0, 0.744_0), (0.5, 0.875_2), (0.8, 1.043_4), (1.0, 1.141_2)] {
            let open = Printed::Pid(Pid { k1: 1.5, k2, k3: 0.27 }).open_loop(&AXIS, 0.030);
            let pole = open.closed_poles()[0];
            assert!((libm::hypot(pole.re, pole.im) - largest).abs() < 1e-4, "{k2}: {pole}");
            assert_eq!(check_stable(&open).is_ok(), largest < 1.0);
        }
    }

    /// Eq. 7 as the drive itself leaves 1/(1 + L(1)) of the set point.
    #[test]
    fn eq_7_at_its_word_leaves_a_standing_error() {
        let motor = FirstOrder { gain: 19.0, tau: 2.8 };
        let open = Printed::Lead(Lead { alpha: 0.97, beta: -0.60, k: 0.30 }).open_loop(&motor, 0.030);
        let steps = open.closed().step(20_000);
        let constant = 0.30 * 0.03 / 0.40 * 19.0;
        assert!((steps[19_999] - constant / (1.0 + constant)).abs() < 1e-6, "{}", steps[19_999]);
    }

    /// Fig. 9 with the paper's Kch is Eq. 11: the poles of e^(−ξωnT) and its angle, but for what the hold costs.
    #[test]
    fn fig_9_has_the_poles_of_eq_11() {
        let open = Printed::Proportional(0.090_582).open_loop(&AXIS, 0.001);
        let pole = open.closed_poles()[0];
        let (decay, angle) = (libm::log(libm::hypot(pole.re, pole.im)) / -0.001, libm::atan2(pole.im, pole.re) / 0.001);
        assert!((decay - 0.6956).abs() < 0.003 && (angle.abs() - 1.7952).abs() < 0.003, "{decay} {angle}");
    }
}
