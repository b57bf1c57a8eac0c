//! The paper's method for the transverse motor: the step response of its position in a proportional loop (Eq. 8 to 10).

use core::f64::consts::PI;

use nalgebra::{DMatrix, DVector};

use crate::nls::least_squares;
use crate::{Finding, SecondOrder};

/// The band of settling: 2 % (Eq. 9: ts = 4/(ξωn)).
const BAND: f64 = 0.02;
/// What has settled stays for this share of the time that it took. (Ours: at its peak, Eq. 11 stays for a third.)
const STAYS: f64 = 0.5;
/// Fewer samples say nothing. (Ours.)
const LEAST: usize = 20;

/// What one reads off a step response.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// The time of the peak tp, in s.
    pub peak_time: f64,
    /// The settling time ts, in s: from then on within 2 %.
    pub settling_time: f64,
    /// The overshoot, as a share of the final value.
    pub overshoot: f64,
    /// The final value.
    pub end: f64,
}

/// Reads times since the step and positions.
///
/// # Errors
/// [`Finding`] if there is nothing to read.
pub fn read(points: &[(f64, f64)]) -> Result<Reading, Finding> {
    if points.len() < LEAST {
        return Err(Finding::TooFew { least: LEAST, found: points.len() });
    }
    let tail = &points[points.len() - points.len() / 5..];
    let end = tail.iter().map(|(_, y)| y).sum::<f64>() / tail.len() as f64;
    let sense = end.signum();
    let peak = points.iter().map(|(_, y)| y * sense).fold(f64::MIN, f64::max);
    if end == 0.0 {
        return Err(Finding::NoResponse { input: 1.0 });
    }
    // Whole counts make the peak flat: its middle is meant. Only the first peak, before the response turns back.
    let near: Vec<f64> = points.iter().filter(|(_, y)| y * sense >= peak - 1.0).map(|(t, _)| *t).collect();
    let out = points.iter().rposition(|(_, y)| (y - end).abs() > BAND * end.abs());
    let settling_time = out.map_or(points[0].0, |place| points[(place + 1).min(points.len() - 1)].0);
    // What stays in a band for a moment only, as at a peak, may leave it again.
    let last = points.last().map_or(0.0, |(t, _)| *t);
    if last - settling_time < STAYS * settling_time || out.is_some_and(|out| out + 1 >= points.len()) {
        return Err(Finding::NotSettled);
    }
    let peak_time = near.iter().sum::<f64>() / near.len() as f64;
    Ok(Reading { peak_time, settling_time, overshoot: peak / end.abs() - 1.0, end })
}

/// From tp and ts, as the paper does: σ = 4/ts, ωd = π/tp (Eq. 8 to 10).
///
/// # Errors
/// [`Finding::NoOvershoot`] if there is no peak to take tp from.
pub fn by_peak_and_settling(reading: &Reading) -> Result<SecondOrder, Finding> {
    if reading.overshoot <= BAND || reading.settling_time <= 0.0 || reading.peak_time <= 0.0 {
        return Err(Finding::NoOvershoot);
    }
    let (decay, damped) = (4.0 / reading.settling_time, PI / reading.peak_time);
    let omega = libm::hypot(decay, damped);
    Ok(SecondOrder { omega, xi: decay / omega })
}

/// From tp and the overshoot e^(−πξ/√(1−ξ²)).
///
/// # Errors
/// [`Finding::NoOvershoot`] if there is none.
pub fn by_peak_and_overshoot(reading: &Reading) -> Result<SecondOrder, Finding> {
    if reading.overshoot <= 0.0 || reading.overshoot >= 1.0 || reading.peak_time <= 0.0 {
        return Err(Finding::NoOvershoot);
    }
    let log = -libm::log(reading.overshoot);
    let xi = log / libm::hypot(log, PI);
    Ok(SecondOrder { omega: PI / (reading.peak_time * libm::sqrt(1.0 - xi * xi)), xi })
}

/// The response at `t` to a step of 1.
pub fn respond(model: &SecondOrder, t: f64) -> f64 {
    let SecondOrder { omega, xi } = *model;
    let root = libm::sqrt(1.0 - xi * xi);
    let (sin, cos) = libm::sincos(omega * root * t);
    1.0 - libm::exp(-xi * omega * t) * (cos + xi / root * sin)
}

/// By non-linear least squares on the whole response.
///
/// # Errors
/// [`Finding`] if it does not overshoot, or the fit does not converge.
pub fn by_least_squares(points: &[(f64, f64)]) -> Result<SecondOrder, Finding> {
    let reading = read(points)?;
    let first = by_peak_and_overshoot(&reading)?;
    // So that any numbers make a frequency above 0, and a damping from 0 to 1.
    let model = |p: &DVector<f64>| SecondOrder { omega: libm::exp(p[0]), xi: 1.0 / (1.0 + libm::exp(-p[1])) };
    let residuals = |p: &DVector<f64>| {
        let model = model(p);
        DVector::from_iterator(points.len(), points.iter().map(|(t, y)| p[2] * respond(&model, *t) - y / reading.end))
    };
    let evaluate = |p: &DVector<f64>| {
        let columns: Vec<DVector<f64>> = (0..3)
            .map(|place| {
                let beside = |step: f64| {
                    let mut p = p.clone();
                    p[place] += step;
                    residuals(&p)
                };
                (beside(STEP) - beside(-STEP)) / (2.0 * STEP)
            })
            .collect();
        (residuals(p), DMatrix::from_columns(&columns))
    };
    let start = DVector::from_vec(vec![libm::log(first.omega), libm::log(first.xi / (1.0 - first.xi)), 1.0]);
    let (p, _, _) = least_squares(start, &evaluate)?;
    Ok(model(&p))
}

/// The step of the numeric derivatives: about the cube root of the precision of an `f64`.
const STEP: f64 = 1e-5;

/// What the damping was without the hold: a loop sampled every T lags by T/2 more, so that ξ' = ξ·(1 − Km·T/2).
#[must_use]
pub fn without_hold(model: &SecondOrder, period: f64) -> SecondOrder {
    // Of the open loop, Km = ωn/2ξ; with ξ as measured it is too large, so it is found again.
    let mut xi = model.xi;
    for _ in 0..30 {
        xi = model.xi / (1.0 - model.omega / (2.0 * xi) * period / 2.0);
    }
    SecondOrder { xi, ..*model }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRUE: SecondOrder = SecondOrder { omega: 1.925_269, xi: 0.361_327 };

    fn points(step: f64, rounded: bool) -> Vec<(f64, f64)> {
        let point = |n: usize| {
            let t = step * n as f64;
            let y = 900.0 * respond(&TRUE, t);
            (t, if rounded { y.floor() } else { y })
        };
        (1..=(25.0 / step) as usize).map(point).collect()
    }

    /// §4: tp = 1.75 s, ts = 5.75 s, so ξ = 0.3613 and ωn = 1.925 rad/s (Eq. 10 prints 1925,35).
    #[test]
    fn tp_and_ts_give_what_the_paper_found() {
        let reading = Reading { peak_time: 1.75, settling_time: 5.75, overshoot: 0.296, end: 1.0 };
        let found = by_peak_and_settling(&reading).unwrap();
        assert!((found.omega - TRUE.omega).abs() < 1e-6 && (found.xi - TRUE.xi).abs() < 1e-6, "{found:?}");
    }

    /// The true settling time is 5.642 s: Eq. 9's 4/(ξωn) is that of the envelope.
    #[test]
    fn a_response_is_read_as_it_is() {
        let found = read(&points(0.001, false)).unwrap();
        assert!((found.peak_time - 1.750).abs() < 0.002, "{found:?}");
        assert!((found.settling_time - 5.642).abs() < 0.003, "{found:?}");
        assert!((found.overshoot - 0.2960).abs() < 0.001, "{found:?}");
    }

    #[test]
    fn whole_counts_do_not_mislead_the_fit() {
        let found = by_least_squares(&points(0.03, true)).unwrap();
        assert!((found.omega / TRUE.omega - 1.0).abs() < 1e-3, "{found:?}");
        assert!((found.xi / TRUE.xi - 1.0).abs() < 2e-3, "{found:?}");
    }

    #[test]
    fn what_the_hold_took_is_given_back() {
        let held = SecondOrder { xi: TRUE.xi * (1.0 - 2.664_162 * 0.030 / 2.0), ..TRUE };
        assert!((without_hold(&held, 0.030).xi / TRUE.xi - 1.0).abs() < 1e-6);
    }

    /// At 2 s the paper's response has just passed its peak, and seems to stay there.
    #[test]
    fn data_that_end_too_soon_are_not_read() {
        for seconds in [0.7, 1.0, 1.5, 2.0, 2.5, 4.0, 6.0] {
            let mut points = points(0.03, true);
            points.retain(|(t, _)| *t <= seconds);
            assert_eq!(read(&points), Err(Finding::NotSettled), "{seconds}");
        }
    }

    #[test]
    fn without_overshoot_there_is_no_tp() {
        let points: Vec<(f64, f64)> =
            (1..400).map(|n| (0.03 * f64::from(n), 1.0 - libm::exp(-0.03 * f64::from(n)))).collect();
        assert_eq!(by_peak_and_settling(&read(&points).unwrap()), Err(Finding::NoOvershoot));
    }
}
