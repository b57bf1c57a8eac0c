//! Whether the motor is what it was taken for: a wrong model can have narrow intervals, too.
//!
//! To the model is added what it may lack, one thing at a time: a delay, friction. If the data want it, the model is
//! wrong, and it is known in what. If what remains is still no noise, it is wrong in something else. (Ours.)

use nalgebra::{DMatrix, DVector};

use crate::data::rounded;
use crate::noise::Noise;
use crate::{Data, Finding, Fitted, Sensor, nls, simulate};

/// What is so many times its standard deviation is there: chance alone would do that in one of 16 000 fits. (Ours.)
const CLEAR: f64 = 4.0;
/// A delay of a smaller share of the time constant, or of the sample time, does no harm. (Ours.)
const DELAY: [f64; 2] = [0.005, 0.1];
/// Friction of a smaller share of the largest input does none. (Ours.)
const FRICTION: f64 = 0.002;
/// What leaves a smaller share of the squares explains them. (Ours.)
const EXPLAINED: f64 = 0.2;
/// Correlations looked at: so many samples apart, at most.
const LAGS: usize = 20;
/// Their sum of squares, times the number of samples, is above this by chance in one of 10 000 fits (χ² of 20).
const PATTERN: f64 = 52.4;
/// What an encoder's rounding may leave is no pattern, even if it is not random: so many times its variance. (Ours.)
const ROUNDING: f64 = 1.5;

/// What speaks against the model of a fit; nothing, if it is as good as the data can tell.
pub fn of(data: &Data, fitted: &Fitted) -> Vec<Finding> {
    let (gain, tau, start) = (fitted.gain.value, fitted.tau.value, fitted.start);
    let friction = fitted.friction.map_or(0.0, |friction| friction.value);
    let offset = fitted.offset.map_or(0.0, |offset| offset.value);
    let dead = fitted.dead.map_or(0.0, |dead| dead.value);
    let at = [gain, tau, friction, dead, start];
    let moved = simulate::run(data, at);
    let residuals =
        DVector::from_iterator(moved.len(), data.samples().iter().zip(&moved).map(|(a, b)| a.speed - b.seen - offset));
    // Gain and time constant, friction and dead time if the model has them; and the start, unless it was at rest.
    let free = [true, true, fitted.friction.is_some(), fitted.dead.is_some(), !data.starts_at_rest()];
    let (_, mut jacobian) = simulate::derived(data, at, free);
    if fitted.offset.is_some() {
        let last = jacobian.ncols();
        jacobian = jacobian.insert_column(last, 1.0);
    }
    let late = DVector::from_vec(simulate::later(data, &moved, gain, tau));
    let mut doubts = Vec::new();
    let largest = data.samples().iter().map(|sample| sample.input.abs()).fold(0.0, f64::max);
    // What explains a pattern leaves none; otherwise it is not the explanation.
    let mut pattern = has_pattern(data, tau, &jacobian, &residuals);
    if fitted.dead.is_none()
        && let Some((found, left)) = wanted(data, tau, &jacobian, &late, &residuals)
        && found.abs() > (DELAY[0] * tau).max(DELAY[1] * data.period())
    {
        pattern |= left;
        doubts.extend((!left).then(|| Finding::Late { late: libm::round(1e3 * found) / 1e3 }));
    }
    if fitted.friction.is_none()
        && let Some((found, left)) = wanted(data, tau, &jacobian, &friction_of(data, fitted), &residuals)
        && found > FRICTION * largest
    {
        pattern |= left;
        doubts.extend((!left).then_some(Finding::Friction));
    }
    if doubts.is_empty() && pattern {
        doubts.push(Finding::Pattern { left: rounded(nls::residual_rms(data, fitted)) });
    }
    doubts
}

/// What friction of 1 would change, for as long as it does not stop the motor.
fn friction_of(data: &Data, fitted: &Fitted) -> DVector<f64> {
    let dead = fitted.dead.map_or(0.0, |dead| dead.value);
    let moved = simulate::run(data, [fitted.gain.value, fitted.tau.value, 0.0, dead, fitted.start]);
    let kept = data.intervals().map(|length| libm::exp(-length / fitted.tau.value));
    let mut speed = 0.0;
    let column = moved.iter().zip(kept).map(|(moved, kept)| {
        let against = -fitted.gain.value.abs() * moved.seen.signum();
        let before = speed;
        speed = against + (speed - against) * kept;
        if data.sensor() == Sensor::Mean { 0.5 * (before + speed) } else { speed }
    });
    DVector::from_iterator(moved.len(), column)
}

/// How much of `column` the data want, if that is clear; and whether there is a pattern even so.
fn wanted(
    data: &Data,
    tau: f64,
    jacobian: &DMatrix<f64>,
    column: &DVector<f64>,
    residuals: &DVector<f64>,
) -> Option<(f64, bool)> {
    let last = jacobian.ncols();
    let mut columns = jacobian.clone().insert_column(last, 0.0);
    columns.set_column(last, column);
    let (found, spread, _) = solved(data, tau, &columns, residuals)?;
    // What is the same as another column cannot be told from it.
    let alone = column.norm_squared();
    let parallel = jacobian.clone().svd(true, true).solve(column, 1e-12).ok()?;
    let own = (column - jacobian * parallel).norm_squared();
    if own <= 1e-6 * alone || found[last].abs() <= CLEAR * libm::sqrt(spread[(last, last)]) {
        return None;
    }
    // How much of it, plain squares tell best: beside what is wrong, the noise is small.
    let plain = columns.clone().svd(true, true).solve(residuals, 1e-12).ok()?;
    let remaining = residuals - &columns * &plain;
    let little = remaining.norm_squared() < EXPLAINED * residuals.norm_squared();
    Some((plain[last], !little && has_pattern(data, tau, &columns, &remaining)))
}

/// What remains is correlated with what came before.
fn has_pattern(data: &Data, tau: f64, jacobian: &DMatrix<f64>, residuals: &DVector<f64>) -> bool {
    let Some((_, _, left)) = solved(data, tau, jacobian, residuals) else { return false };
    let n = left.len() as f64;
    let quantum = data.quantum();
    // Two readings make a mean speed.
    let rounding = ROUNDING * quantum * quantum / 6.0;
    let exact = 1e-12 * data.samples().iter().map(|sample| sample.speed * sample.speed).sum::<f64>() / n;
    if residuals.norm_squared() / n <= rounding.max(exact) {
        return false;
    }
    let sum = |lag: usize| left.iter().zip(left.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>();
    let all = sum(0);
    let lags = LAGS.min(left.len() / 4);
    let correlation = |lag: usize| sum(lag) / all;
    let total: f64 = (1..=lags).map(|lag| correlation(lag) * correlation(lag) / (n - lag as f64)).sum();
    n * (n + 2.0) * total > PATTERN
}

/// A found solution: coefficients, their covariance, and what remains, whitened.
type Solved = (DVector<f64>, DMatrix<f64>, DVector<f64>);

fn solved(data: &Data, tau: f64, columns: &DMatrix<f64>, residuals: &DVector<f64>) -> Option<Solved> {
    let residuals = DMatrix::from_column_slice(residuals.len(), 1, residuals.as_slice());
    let noise = Noise::of(data, tau, columns, &residuals);
    let white = noise.whiten(data, columns).columns;
    let left = noise.whiten(data, &residuals).columns.column(0).into_owned();
    let spread = (white.transpose() * &white).try_inverse()?;
    let found = &spread * (white.transpose() * &left);
    let left = left - &white * &found;
    let scale = (left.norm_squared() / (white.nrows() - white.ncols()) as f64).max(1.0);
    Some((found, spread * scale, left))
}
