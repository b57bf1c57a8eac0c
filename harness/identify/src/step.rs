//! The paper's method for the main motor: a step, its final value, and when 63 % of it is reached (Eq. 2 to 4).
//!
//! Each needs a step from rest that is left alone until the speed has settled; what would be taken for the final value
//! is too low otherwise, and the time constant with it.

use nalgebra::{DMatrix, DVector};

use crate::{Data, Finding, Fitted};

/// The share of the data, at their end, whose mean is taken for the final value. (Ours.)
const FINAL: usize = 4;
/// What is still to come of a response that has settled, as a share of it, at most. (Ours.)
const SETTLED: f64 = 0.02;
/// What adds less in a part of the data is noise, not a response. (Ours.)
const NO_LONGER: f64 = 0.01;
/// 1 − 1/e: where Eq. 4 is least sensitive, dτ/τ = e·dr.
const AT_TAU: f64 = 0.632;
/// The part of the rise that averages are taken over. (Ours.)
const RISE: (f64, f64) = (0.2, 0.9);

/// A step from rest: the input, the final value, and time since the step and share of the final value of each sample.
struct Rise {
    input: f64,
    end: f64,
    points: Vec<(f64, f64)>,
}

impl Rise {
    fn of(data: &Data) -> Result<Self, Finding> {
        let (input, begin) = data.step().filter(|_| data.starts_at_rest()).ok_or(Finding::NoStep)?;
        let samples = data.samples();
        let origin = if begin == 0 { data.start() } else { samples[begin - 1].time };
        let tail = &samples[samples.len() - samples.len() / FINAL..];
        let end = tail.iter().map(|sample| sample.speed).sum::<f64>() / tail.len() as f64;
        if end == 0.0 {
            return Err(Finding::NoResponse { input });
        }
        let after = &samples[begin..];
        let part = |n: usize| {
            let part = &after[after.len() * n / FINAL..after.len() * (n + 1) / FINAL];
            part.iter().map(|sample| sample.speed).sum::<f64>() / part.len().max(1) as f64
        };
        // Each part of a lag's response adds the same share of what the one before has added, and so on for ever.
        let [before, last] = [part(FINAL - 2) - part(FINAL - 3), part(FINAL - 1) - part(FINAL - 2)];
        let [before, last] = [before, last].map(|added| added / end);
        let to_come = if before > last { last * last / (before - last) } else { f64::MAX };
        if last > NO_LONGER && to_come > SETTLED {
            return Err(Finding::NotSettled);
        }
        let points = data.instants().into_iter().zip(samples).skip(begin);
        let points = points.map(|(instant, sample)| (instant - origin, sample.speed / end)).collect();
        Ok(Self { input, end, points })
    }

    fn gain(&self) -> f64 {
        self.end / self.input
    }

    /// The points on the rise, before the end of the data.
    fn on_the_way(&self) -> Result<Vec<(f64, f64)>, Finding> {
        let (least, most) = RISE;
        let kept = |(_, share): &&(f64, f64)| *share > least && *share < most;
        let points: Vec<(f64, f64)> = self.points.iter().filter(kept).copied().collect();
        if points.is_empty() { Err(Finding::NoRise) } else { Ok(points) }
    }
}

/// Eq. 4 with the first sample at 63 % of the final value: τ = −t0/ln(1 − w(t0)/w(∞)).
///
/// # Errors
/// [`Finding::NoStep`] if the input is none.
pub fn one_point(data: &Data) -> Result<Fitted, Finding> {
    let rise = Rise::of(data)?;
    let point = rise.points.iter().find(|(_, share)| *share >= AT_TAU && *share < 1.0);
    let (t0, share) = point.ok_or(Finding::NoRise)?;
    Ok(Fitted::bare(rise.gain(), -t0 / libm::log(1.0 - share)))
}

/// Eq. 4 averaged over the samples from 20 to 90 % of the final value. (Ours.)
///
/// # Errors
/// [`Finding::NoStep`] if the input is none.
pub fn averaged(data: &Data) -> Result<Fitted, Finding> {
    let rise = Rise::of(data)?;
    let points = rise.on_the_way()?;
    let sum: f64 = points.iter().map(|(t0, share)| -t0 / libm::log(1.0 - share)).sum();
    Ok(Fitted::bare(rise.gain(), sum / points.len() as f64))
}

/// The slope of ln(1 − w/w(∞)) over the same samples, by least squares. (Ours.)
///
/// # Errors
/// [`Finding::NoStep`] if the input is none.
pub fn log_linear(data: &Data) -> Result<Fitted, Finding> {
    let rise = Rise::of(data)?;
    let points = rise.on_the_way()?;
    let times = DMatrix::from_fn(points.len(), 2, |row, column| if column == 0 { points[row].0 } else { 1.0 });
    let logs = DVector::from_fn(points.len(), |row, _| libm::log(1.0 - points[row].1));
    let line = times.svd(true, true).solve(&logs, 1e-12).map_err(|_| Finding::NoConvergence)?;
    let tau = -1.0 / line[0];
    if tau.is_finite() && tau > 0.0 { Ok(Fitted::bare(rise.gain(), tau)) } else { Err(Finding::NoConvergence) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Sample, Sensor};

    fn exact(seconds: usize) -> Data {
        let sample = |n: usize| {
            let time = 0.03 * (n + 1) as f64;
            Sample { time, input: 20.0, speed: 380.0 * (1.0 - libm::exp(-time / 2.8)) }
        };
        let samples = (0..seconds * 100 / 3).map(sample).collect();
        Data::new(Sensor::Instant, 0.0, samples, 0.0).unwrap()
    }

    #[test]
    fn all_three_are_right_once_the_speed_has_settled() {
        for method in [one_point, averaged, log_linear] {
            let fitted = method(&exact(60)).unwrap();
            assert!((fitted.gain.value / 19.0 - 1.0).abs() < 1e-6, "{fitted:?}");
            assert!((fitted.tau.value / 2.8 - 1.0).abs() < 1e-3, "{fitted:?}");
        }
    }

    /// At three time constants, 8 % would be missing from the gain, and 13 % from the time constant.
    #[test]
    fn what_has_not_settled_has_no_final_value() {
        for seconds in [2, 8, 12] {
            for method in [one_point, averaged, log_linear] {
                assert_eq!(method(&exact(seconds)), Err(Finding::NotSettled), "{seconds}");
            }
        }
        let fitted = one_point(&exact(16)).unwrap();
        assert!((fitted.gain.value / 19.0 - 1.0 + 0.008).abs() < 0.003, "{fitted:?}");
    }
}
