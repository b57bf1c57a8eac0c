//! What a loop will do: its step response, and its margins.

use core::f64::consts::PI;

use nalgebra::Complex;

use crate::Finding;
use crate::discrete::Discrete;
use crate::polynomial::modulus;

/// A pole this near to 1, or beyond, never settles.
const STABLE: f64 = 1.0 - 1e-9;
/// A response has settled within this share of the step.
const SETTLED: f64 = 0.02;
/// Frequencies looked at, from the lowest to half the sampling frequency.
const GRID: usize = 4_000;

/// What one says of a step response.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepResponse {
    /// From 10 to 90 % of the step, in s.
    pub rise: f64,
    /// From the step until it stays within 2 % of it, in s.
    pub settling: f64,
    /// Beyond the step, as a share of it; 0 if it does not go there.
    pub overshoot: f64,
}

/// How far a loop is from instability.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins {
    /// Where the open loop's gain is 1, in rad/s: the highest such frequency.
    pub crossover: f64,
    /// What its phase may still lag there, in degrees.
    pub phase: f64,
    /// What its gain may still grow, as a factor, where its phase is −180°; none if it never is.
    pub gain: Option<f64>,
}

impl Margins {
    /// What the gain may still grow, in dB.
    pub fn gain_db(&self) -> Option<f64> {
        self.gain.map(|gain| 20.0 * libm::log(gain) / core::f64::consts::LN_10)
    }

    /// The time by which the loop may still be late, in s.
    pub fn delay(&self) -> f64 {
        self.phase * PI / 180.0 / self.crossover
    }
}

/// Says what is to be said of times since a step and outputs, for a step from `from` to `to`. A response is between its
/// samples on a straight line. None if it does not get there, or does not stay.
pub fn of_step(points: &[(f64, f64)], from: f64, to: f64) -> Option<StepResponse> {
    of_step_within(points, [from, to], SETTLED)
}

/// The same, settled within this share of the step: of what is counted, a count may be more than 2 %.
pub fn of_step_within(points: &[(f64, f64)], [from, to]: [f64; 2], settled: f64) -> Option<StepResponse> {
    let share = |y: f64| (y - from) / (to - from);
    let reaches = |level: f64| {
        let place = points.iter().position(|(_, y)| share(*y) >= level)?;
        let (t1, y1) = points[place];
        let Some((t0, y0)) = place.checked_sub(1).map(|before| points[before]) else { return Some(t1) };
        Some(t0 + (t1 - t0) * (level - share(y0)) / (share(y1) - share(y0)))
    };
    let rise = reaches(0.9)? - reaches(0.1)?;
    let out = points.iter().rposition(|(_, y)| (share(*y) - 1.0).abs() > settled);
    let settling = points.get(out.map_or(0, |place| place + 1))?.0;
    let peak = points.iter().map(|(_, y)| share(*y)).fold(f64::MIN, f64::max);
    Some(StepResponse { rise, settling, overshoot: (peak - 1.0).max(0.0) })
}

/// Whether a loop is stable that is closed with unity feedback.
///
/// # Errors
/// [`Finding::Unstable`] with the largest pole.
pub fn check_stable(open: &Discrete) -> Result<(), Finding> {
    let largest = open.closed_poles().first().map_or(0.0, |pole| modulus(*pole));
    if largest.is_finite() && largest < STABLE { Ok(()) } else { Err(Finding::Unstable { pole: largest }) }
}

/// The least damping of a loop that is closed with unity feedback: of each pole in z that of ln(z)/T in s. 1 if no pole
/// oscillates.
pub fn damping(open: &Discrete) -> f64 {
    let of = |pole: &Complex<f64>| {
        let (decay, angle) = (-libm::log(modulus(*pole)), libm::atan2(pole.im, pole.re));
        decay / libm::hypot(decay, angle)
    };
    let poles = open.closed_poles();
    // A pole at 0 is a delay.
    poles.iter().filter(|pole| modulus(**pole) > 1e-6).map(of).fold(1.0, f64::min)
}

/// The margins of a loop; of one that is stable, or they mean nothing. None if its gain never is 1.
pub fn margins(open: &Discrete) -> Option<Margins> {
    let nyquist = PI / open.period;
    let lowest = nyquist * 1e-5;
    let frequency = |n: usize| lowest * libm::pow(nyquist / lowest, n as f64 / GRID as f64);
    let gain = |omega: f64| modulus(open.at_frequency(omega));
    // Above 0 if the curve is below the real axis.
    let sine = |omega: f64| -open.at_frequency(omega).im;
    let last = (0..GRID).rev().find(|n| gain(frequency(*n)) >= 1.0 && gain(frequency(n + 1)) < 1.0)?;
    let crossover = bisect(frequency(last), frequency(last + 1), |omega| gain(omega) - 1.0);
    let at = open.at_frequency(crossover);
    let phase = libm::atan2(at.im, at.re) * 180.0 / PI;
    let phase = if phase > 0.0 { phase - 360.0 } else { phase } + 180.0;
    let turns = (0..GRID - 1).find(|n| {
        let (a, b) = (frequency(*n), frequency(n + 1));
        sine(a) * sine(b) <= 0.0 && open.at_frequency(a).re < 0.0 && a > crossover
    });
    let gain = turns.map(|n| 1.0 / gain(bisect(frequency(n), frequency(n + 1), sine)));
    Some(Margins { crossover, phase, gain })
}

/// Where `f` changes its sign between `low` and `high`.
pub(crate) fn bisect(mut low: f64, mut high: f64, f: impl Fn(f64) -> f64) -> f64 {
    let positive = f(low) > 0.0;
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if (f(middle) > 0.0) == positive {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FirstOrder;

    #[test]
    fn a_lag_rises_in_2_2_time_constants_and_settles_in_3_9() {
        let points: Vec<(f64, f64)> = (0..20_000)
            .map(|n| {
                let t = 1e-3 * f64::from(n);
                (t, 100.0 + 50.0 * -libm::expm1(-t / 2.8))
            })
            .collect();
        let found = of_step(&points, 100.0, 150.0).unwrap();
        assert!((found.rise - 6.152).abs() < 2e-3 && (found.settling - 10.954).abs() < 2e-3, "{found:?}");
        assert_eq!(found.overshoot, 0.0);
        // Half way there is not there.
        assert_eq!(of_step(&points[..2_000], 100.0, 150.0), None);
    }

    /// Eq. 11: ξ is 0.361; the hold takes 4 % of it.
    #[test]
    fn the_damping_is_that_of_eq_11() {
        let loop_of = |gain: f64, period: f64| Discrete::position(&FirstOrder { gain, tau: 0.71875 }, period);
        assert!((damping(&loop_of(2.664, 0.001)) - 0.361).abs() < 0.001, "{}", damping(&loop_of(2.664, 0.001)));
        assert!((damping(&loop_of(2.664, 0.030)) - 0.347).abs() < 0.001, "{}", damping(&loop_of(2.664, 0.030)));
        // Below a quarter of 1/τ nothing oscillates.
        assert_eq!(damping(&loop_of(0.3, 0.030)), 1.0);
    }

    /// The loop that Eq. 11 is: at 30 ms and a gain of 1 far from instability, at a gain of 60 beyond it.
    #[test]
    fn an_unstable_loop_is_called_so() {
        let loop_of = |gain: f64| Discrete::position(&FirstOrder { gain: gain * 2.664, tau: 0.71875 }, 0.030);
        assert_eq!(check_stable(&loop_of(1.0)), Ok(()));
        let Err(Finding::Unstable { pole }) = check_stable(&loop_of(60.0)) else { panic!() };
        assert!(pole > 1.0);
        // Where the gain margin says that it is.
        let gain = margins(&loop_of(1.0)).unwrap().gain.unwrap();
        assert_eq!(check_stable(&loop_of(0.99 * gain)), Ok(()));
        assert!(check_stable(&loop_of(1.01 * gain)).is_err());
        let [stable, unstable] = [0.99, 1.01].map(|share| margins(&loop_of(share * gain)).unwrap().phase);
        assert!(stable > 0.0 && stable < 5.0 && unstable < 0.0 && unstable > -5.0, "{stable} {unstable}");
    }
}
