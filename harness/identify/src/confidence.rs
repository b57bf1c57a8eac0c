//! How sure one may be of a fit: the interval of each parameter, from what the fit leaves unexplained. (Ours.)

use nalgebra::{DMatrix, DVector};

use crate::noise::{Noise, White};
use crate::{Data, Sensor};

/// The share of a normal distribution within so many standard deviations is 95 %.
const NORMAL: f64 = 1.959_964;
/// So many places in a slot are tried for the encoder to begin at.
const PHASES: usize = 16;

/// So many changes of the input are looked at one by one, at most: the largest.
const EDGES: usize = 64;

/// Half of the interval of each parameter that holds the true one in 95 of 100 cases. `path` is what the model gives
/// for each sample; `jacobian` and `residuals` are those of the fit to it, whitened with this noise or not at all.
pub(crate) fn half_widths(
    data: &Data,
    gain: f64,
    noise: &Noise,
    jacobian: &DMatrix<f64>,
    residuals: &DVector<f64>,
    path: &[f64],
) -> Option<DVector<f64>> {
    let White { columns: white, .. } = noise.whiten(data, jacobian);
    let spread = (white.transpose() * &white).try_inverse()?;
    let left = noise.whiten(data, &DMatrix::from_column_slice(residuals.len(), 1, residuals.as_slice())).columns;
    let unexplained = left.norm_squared() - (white.transpose() * &left).dot(&(&spread * white.transpose() * &left));
    // Never less than the noise that there must be.
    let scale = (unexplained / (white.nrows() - white.ncols()) as f64).max(1.0);
    let times = student(noise.freedom);
    let mut squares = spread.diagonal() * (scale * times * times);
    if let Some(errors) = rounding(data, path) {
        // What is rounded is not random: while the shaft stands still, all readings are off alike. So it is tried.
        let off = &spread * white.transpose() * noise.whiten(data, &errors).columns;
        for (row, square) in squares.iter_mut().enumerate() {
            *square = square.max(NORMAL * NORMAL * off.row(row).norm_squared() / PHASES as f64);
        }
    }
    if let Some(errors) = edges(data, gain, noise, path) {
        let off = &spread * white.transpose() * noise.whiten(data, &errors).columns;
        // What many changes do looks like pushes, and has been counted as such: so readings and changes alone.
        let still = Noise { slow: 0.0, ..*noise }.whiten(data, jacobian).columns;
        let still = (still.transpose() * &still).try_inverse()?;
        for (row, square) in squares.iter_mut().enumerate() {
            *square = square.max(NORMAL * NORMAL * (still[(row, row)] + off.row(row).norm_squared()));
        }
    }
    let halves = squares.map(|square| libm::sqrt(square.max(0.0)));
    halves.iter().all(|half| half.is_finite()).then_some(halves)
}

/// What an encoder's rounding makes of speeds, for each place in a slot that it may begin at: the errors of speed.
fn rounding(data: &Data, path: &[f64]) -> Option<DMatrix<f64>> {
    let slot = data.quantum() * data.period();
    if data.sensor() != Sensor::Mean || slot <= 0.0 {
        return None;
    }
    let mut errors = DMatrix::zeros(path.len(), PHASES);
    for phase in 0..PHASES {
        let begin = (phase as f64 + 0.5) / PHASES as f64;
        let (mut position, mut before) = (begin, -begin);
        for (row, (speed, length)) in path.iter().zip(data.intervals()).enumerate() {
            position += speed * length / slot;
            let error = libm::floor(position) - position;
            errors[(row, phase)] = (error - before) * slot / length;
            before = error;
        }
    }
    Some(errors)
}

/// What time stamps that are off by a standard deviation make of speeds, one column for each change of the input: it
/// came as much earlier or later, and all that follows with it. Readings that are worse than rounded say how far stamps
/// are off.
fn edges(data: &Data, gain: f64, noise: &Noise, path: &[f64]) -> Option<DMatrix<f64>> {
    let excess = noise.reading - Noise::rounding(data);
    let square = path.iter().map(|speed| speed * speed).sum::<f64>() / path.len() as f64;
    if data.sensor() != Sensor::Mean || excess <= 1e-6 * noise.reading || square <= 0.0 {
        return None;
    }
    let late = libm::sqrt(excess / square);
    let mut before = data.input_before();
    let mut changes: Vec<(usize, f64)> = Vec::new();
    for (row, sample) in data.samples().iter().enumerate() {
        let change = sample.input - before;
        changes.extend((change != 0.0).then_some((row, change)));
        before = sample.input;
    }
    let squares = |changes: &[(usize, f64)]| changes.iter().map(|(_, change)| change * change).sum::<f64>();
    let all = squares(&changes);
    changes.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    changes.truncate(EDGES);
    // The largest stand for the others.
    let scale = libm::sqrt(all / squares(&changes));
    let mut errors = DMatrix::zeros(path.len(), changes.len());
    for (column, (row, change)) in changes.into_iter().enumerate() {
        let mut left = gain * change * late * scale;
        for (row, length) in data.intervals().enumerate().skip(row) {
            let gone = -left * libm::expm1(-length / noise.tau);
            errors[(row, column)] = gone / length;
            left -= gone;
        }
    }
    Some(errors)
}

/// In the place of 1.96 where the standard deviation itself is known from so many numbers only (Student's t).
pub(crate) fn student(freedom: f64) -> f64 {
    let z = NORMAL;
    let (z2, n) = (z * z, freedom.max(3.0));
    let first = (z2 + 1.0) / 4.0;
    let second = (5.0 * z2 * z2 + 16.0 * z2 + 3.0) / 96.0;
    let third = (3.0 * z2 * z2 * z2 + 19.0 * z2 * z2 + 17.0 * z2 - 15.0) / 384.0;
    z * (1.0 + first / n + second / (n * n) + third / (n * n * n))
}

/// The covariance of the coefficients of a regression, v(k) = pole·v(k−1) + …, by instruments: there a push is news
/// only once, and a rounded reading comes three times.
pub(crate) fn of_regression(
    data: &Data,
    noise: &Noise,
    pole: f64,
    instruments: &DMatrix<f64>,
    regressors: &DMatrix<f64>,
) -> Option<DMatrix<f64>> {
    let inverse = (instruments.transpose() * regressors).try_inverse()?;
    let both = 1.0 + pole * pole;
    let push = noise.slow * (1.0 - pole * pole);
    // Of a mean speed, the difference of two readings: its variance, and its covariance with the next.
    let [fast, next] = match data.sensor() {
        Sensor::Mean => [2.0, -1.0].map(|times| times * noise.reading / (data.period() * data.period())),
        Sensor::Instant => [noise.reading, 0.0],
    };
    let bands = [push + both * fast - 2.0 * pole * next, both * next - pole * fast, -pole * next];
    Some(&inverse * banded(instruments, &bands) * inverse.transpose())
}

/// JᵀΩJ, with a covariance Ω that depends on the distance only and is 0 from some on.
fn banded(columns: &DMatrix<f64>, covariances: &[f64]) -> DMatrix<f64> {
    let n = columns.nrows();
    let mut sum = columns.transpose() * columns * covariances[0];
    for (lag, covariance) in covariances.iter().enumerate().skip(1) {
        let crossed = columns.rows(0, n - lag).transpose() * columns.rows(lag, n - lag);
        sum += (&crossed + crossed.transpose()) * *covariance;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn students_t_is_that_of_the_tables() {
        for (freedom, expected, tolerance) in
            [(3.0, 3.182, 0.03), (5.0, 2.571, 0.005), (10.0, 2.228, 0.001), (30.0, 2.042, 0.001)]
        {
            assert!((student(freedom) - expected).abs() < tolerance, "{freedom}: {}", student(freedom));
        }
    }
}
