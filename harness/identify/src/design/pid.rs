//! The transverse motor's law (Eq. 13 and 14): a PID on position.

use core::f64::consts::PI;

use nalgebra::{Complex, Matrix2, Vector2};

use super::{LOWER, TRIES};
use crate::discrete::Discrete;
use crate::polynomial::modulus;
use crate::response::bisect;
use crate::{Finding, FirstOrder, Polynomial};

/// The crossover to begin with, in rad a sample. (Ours: above it a count is too large a part of the drive.)
const CROSSOVER: f64 = 0.375;
/// The integral is so much slower than the crossover: Ti·ωc. (Ours: it is for standing loads, not for speed.)
const INTEGRAL: f64 = 30.0;

/// The zero K1/K3 is no more than so much slower than the crossover: from there to it, the axis creeps. (Ours.)
const SLOWEST: f64 = 4.0;
/// Without a derivative the crossover may be lower than that by this factor.
const SLOWEST_CROSSOVER: f64 = 1e-4;

/// u(k) = K1·x(k) + K2·I(k) + K3/T·(x(k) − x(k−1)), I(k) = I(k−1) + T·x(k).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pid {
    /// Kp, in units of input per count.
    pub k1: f64,
    /// Kp/Ti, in units of input per count and s.
    pub k2: f64,
    /// Kp·Td, in units of input·s per count.
    pub k3: f64,
}

/// Which parts of the law there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Structure {
    /// K1 alone.
    P,
    /// K1 and K2.
    Pi,
    /// K1 and K3.
    Pd,
    /// All three.
    Pid,
}

impl Structure {
    /// All, from the simplest on.
    pub const ALL: [Self; 4] = [Self::P, Self::Pi, Self::Pd, Self::Pid];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::P => "P",
            Self::Pi => "PI",
            Self::Pd => "PD",
            Self::Pid => "PID",
        }
    }

    /// Whether it has K2.
    pub const fn integrates(self) -> bool {
        matches!(self, Self::Pi | Self::Pid)
    }

    /// Whether it has K3.
    const fn differentiates(self) -> bool {
        matches!(self, Self::Pd | Self::Pid)
    }
}

impl Pid {
    /// A PID for an axis whose position is counted every `period` seconds.
    ///
    /// # Errors
    /// [`Finding::NoController`] if there is none with this phase margin, in degrees.
    pub fn design(model: &FirstOrder, period: f64, phase_margin: f64) -> Result<Self, Finding> {
        Self::design_as(Structure::Pid, model, period, phase_margin)
    }

    /// The same with these parts only.
    ///
    /// # Errors
    /// As there.
    pub fn design_as(
        structure: Structure,
        model: &FirstOrder,
        period: f64,
        phase_margin: f64,
    ) -> Result<Self, Finding> {
        let mut crossover = CROSSOVER / period;
        if !structure.differentiates() {
            return Self::without_derivative(structure, model, period, phase_margin, crossover);
        }
        for _ in 0..TRIES {
            if let Some(pid) = Self::with_crossover(structure, model, period, phase_margin, crossover) {
                return Ok(pid);
            }
            crossover *= LOWER;
        }
        Err(Finding::NoController { law: structure.name(), margin: phase_margin, crossover: crossover.round() })
    }

    /// At the crossover the PID must be 1/|G| long and turn by what is missing: two equations for K1 and K3.
    fn with_crossover(
        structure: Structure,
        model: &FirstOrder,
        period: f64,
        phase_margin: f64,
        crossover: f64,
    ) -> Option<Self> {
        let (sin, cos) = libm::sincos((phase_margin - 180.0) * PI / 180.0);
        let wanted = Complex::new(cos, sin) / Discrete::position(model, period).at_frequency(crossover);
        let steady = steady_part(structure, period, crossover);
        let (sin, cos) = libm::sincos(crossover * period);
        let z = Complex::new(cos, sin);
        let slope = (z - 1.0) / z / period;
        let gains =
            Matrix2::new(steady.re, slope.re, steady.im, slope.im).lu().solve(&Vector2::new(wanted.re, wanted.im))?;
        let k2 = if structure.integrates() { gains[0] * crossover / INTEGRAL } else { 0.0 };
        let pid = Self { k1: gains[0], k2, k3: gains[1] };
        // With hardly anything but a derivative the axis would never get there.
        (pid.k1 > 0.0 && pid.k3 >= 0.0 && pid.k1 * SLOWEST > pid.k3 * crossover).then_some(pid)
    }

    /// Nothing adds phase: the crossover is where the axis itself leaves the margin.
    fn without_derivative(
        structure: Structure,
        model: &FirstOrder,
        period: f64,
        phase_margin: f64,
        highest: f64,
    ) -> Result<Self, Finding> {
        let axis = Discrete::position(model, period);
        let loop_at = |omega: f64| axis.at_frequency(omega) * steady_part(structure, period, omega);
        let too_much = |omega: f64| {
            let at = loop_at(omega);
            let phase = libm::atan2(at.im, at.re) * 180.0 / PI;
            (if phase > 0.0 { phase - 360.0 } else { phase }) + 180.0 - phase_margin
        };
        let lowest = highest * SLOWEST_CROSSOVER;
        if !(too_much(lowest) > 0.0 && model.gain > 0.0) {
            return Err(Finding::NoController { law: structure.name(), margin: phase_margin, crossover: lowest });
        }
        let crossover = if too_much(highest) >= 0.0 { highest } else { bisect(lowest, highest, too_much) };
        let k1 = 1.0 / modulus(loop_at(crossover));
        Ok(Self { k1, k2: if structure.integrates() { k1 * crossover / INTEGRAL } else { 0.0 }, k3: 0.0 })
    }

    /// The PID and the axis.
    pub fn open_loop(&self, model: &FirstOrder, period: f64) -> Discrete {
        let d = self.k3 / period;
        if self.k2 == 0.0 {
            // An integral that has no part in the drive is no pole of the loop.
            let (numerator, denominator) = (Polynomial(vec![self.k1 + d, -d]), Polynomial(vec![1.0, 0.0]));
            return Discrete { numerator, denominator, period }.times(&Discrete::position(model, period));
        }
        let numerator = vec![self.k1 + self.k2 * period + d, -self.k1 - 2.0 * d, d];
        let denominator = Polynomial(vec![1.0, -1.0, 0.0]);
        let pid = Discrete { numerator: Polynomial(numerator), denominator, period };
        pid.times(&Discrete::position(model, period))
    }
}

/// What the law without its derivative is at a crossover, with K1 = 1.
fn steady_part(structure: Structure, period: f64, crossover: f64) -> Complex<f64> {
    if !structure.integrates() {
        return Complex::new(1.0, 0.0);
    }
    let (sin, cos) = libm::sincos(crossover * period);
    let z = Complex::new(cos, sin);
    z / (z - 1.0) * (period * crossover / INTEGRAL) + 1.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::response::{check_stable, margins};

    const AXIS: FirstOrder = FirstOrder { gain: 7_500.0 / 255.0, tau: 0.718_75 };
    const DEFAULT: Pid = Pid { k1: 1.5, k2: 0.5, k3: 0.27 };

    /// The board's default, with all of the integral active.
    #[test]
    fn the_default_has_the_poles_that_it_should() {
        let poles = DEFAULT.open_loop(&AXIS, 0.030).closed_poles();
        let near =
            |pole: Complex<f64>, re: f64, im: f64| (pole.re - re).abs() < 2e-4 && (pole.im.abs() - im).abs() < 2e-4;
        assert!(
            near(poles[0], 0.9894, 0.0) && near(poles[1], 0.7437, 0.0778) && near(poles[3], 0.2914, 0.0),
            "{poles:?}"
        );
    }

    #[test]
    fn a_designed_pid_has_the_margin_that_was_asked_for() {
        for (gain, tau, period) in [(29.41, 0.71875, 0.030), (29.41, 0.71875, 0.005), (2.0, 0.1, 0.010)] {
            for wanted in [45.0, 60.0, 75.0, 85.0, 88.0] {
                let axis = FirstOrder { gain, tau };
                let open = Pid::design(&axis, period, wanted).unwrap().open_loop(&axis, period);
                check_stable(&open).unwrap();
                assert!((margins(&open).unwrap().phase - wanted).abs() < 0.1, "{gain} {tau} {period} {wanted}");
            }
        }
    }

    /// More phase is bought with a lower crossover; the axis gets there all the same, and without creeping for long.
    #[test]
    fn a_large_margin_is_slow_and_not_for_ever() {
        let mut before = f64::MAX;
        for wanted in [60.0, 75.0, 80.0, 85.0, 88.0, 90.0] {
            let open = Pid::design(&AXIS, 0.030, wanted).unwrap().open_loop(&AXIS, 0.030);
            let crossover = margins(&open).unwrap().crossover;
            assert!(crossover <= before, "{wanted}: {crossover} after {before}");
            before = crossover;
            let points: Vec<(f64, f64)> =
                (0..).zip(open.closed().step(2_000)).map(|(n, y)| (0.030 * f64::from(n), y)).collect();
            let step = crate::response::of_step(&points, 0.0, 1.0).unwrap();
            assert!(step.rise < 1.0 && step.settling < 20.0, "{wanted}: {step:?}");
        }
    }

    #[test]
    fn each_structure_has_the_margin_that_was_asked_for() {
        for structure in Structure::ALL {
            for wanted in [45.0, 60.0, 75.0] {
                let pid = Pid::design_as(structure, &AXIS, 0.030, wanted).unwrap();
                assert_eq!((pid.k2 > 0.0, pid.k3 > 0.0), (structure.integrates(), structure.differentiates()));
                let open = pid.open_loop(&AXIS, 0.030);
                check_stable(&open).unwrap();
                assert!((margins(&open).unwrap().phase - wanted).abs() < 0.1, "{structure:?} {wanted}");
            }
        }
        // What the integral lags, nothing gives back.
        let Err(refused) = Pid::design_as(Structure::Pi, &AXIS, 0.030, 89.0) else { panic!() };
        assert!(refused.to_string().starts_with("no PI has a phase margin of 89°"), "{refused}");
    }

    /// P, PI, PD and PID: by the decay of the difference equations themselves, and with too much gain.
    #[test]
    fn each_part_may_be_missing() {
        let (period, kept) = (0.030, libm::exp(-0.030 / AXIS.tau));
        for (k2, k3) in [(0.0, 0.0), (0.1, 0.0), (0.0, 0.27), (0.5, 0.27)] {
            for (k1, stable) in [(0.5, true), (30.0, false)] {
                let pid = Pid { k1, k2, k3 };
                let open = pid.open_loop(&AXIS, period);
                assert_eq!(check_stable(&open).is_ok(), stable, "{pid:?}");
                // The axis from 1 to 0, sample by sample.
                let (mut position, mut speed, mut integral, mut before) = (1.0, 0.0, 0.0, -1.0);
                for _ in 0..4_000 {
                    let error = -position;
                    integral += period * error;
                    let drive = k1 * error + k2 * integral + k3 / period * (error - before);
                    before = error;
                    let end = AXIS.gain * drive;
                    position += end * period + (speed - end) * AXIS.tau * (1.0 - kept);
                    speed = end + (speed - end) * kept;
                }
                assert_eq!(position.abs() < 1e-3, stable, "{pid:?}: {position}");
            }
        }
    }

    #[test]
    fn too_much_gain_is_found_to_be_unstable() {
        let wild = Pid { k1: 30.0, ..DEFAULT };
        let Err(finding) = check_stable(&wild.open_loop(&AXIS, 0.030)) else { panic!() };
        assert!(finding.to_string().starts_with("the loop is unstable: largest pole 1."), "{finding}");
    }
}
