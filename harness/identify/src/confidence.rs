//! How sure one may be of a fit: the covariance of its parameters, from what it leaves unexplained.
//!
//! What a fit leaves unexplained is neither white nor independent: a count that was rounded down is followed by one
//! that is rounded up, and a shaft that has been pushed takes the motor's own time constant to come back. So it is
//! taken for the sum of two noises: a slow one, white torque through the motor's pole, and a fast one. (Ours.)

use nalgebra::{DMatrix, DVector};

/// Blocks over which residuals are averaged, in time constants: long enough for rounding to average out. (Ours.)
const BLOCK: f64 = 0.1;
/// No block is longer than so many samples.
const BLOCK_MAX: f64 = 20.0;

/// The noise in speeds.
pub(crate) struct Noise {
    /// From sample to sample, of a push.
    pub(crate) pole: f64,
    /// The variance of the slow noise.
    pub(crate) slow: f64,
    /// The variance of the fast one, and its covariance from one sample to the next.
    pub(crate) fast: [f64; 2],
}

impl Noise {
    /// Of the residuals of a fit with these derivatives. `quantum` is what a count is, 0 if the sensor does not count.
    ///
    /// The slow noise is seen in what each block's mean adds to the one before; what the fit has taken out of the
    /// residuals, and what rounding adds, is allowed for.
    pub(crate) fn of(jacobian: &DMatrix<f64>, residuals: &DVector<f64>, pole: f64, quantum: f64) -> Option<Self> {
        let spread = (jacobian.transpose() * jacobian).try_inverse()?;
        let n = residuals.len();
        let block = (BLOCK / -libm::log(pole)).ceil().clamp(1.0, BLOCK_MAX.min(n as f64 / 8.0).max(1.0)) as usize;
        let kept = libm::pow(pole, block as f64);
        let news = |columns: &DMatrix<f64>| news(columns, block, kept);
        let seen = news(&DMatrix::from_column_slice(n, 1, residuals.as_slice()));
        let decayed = decaying(jacobian, pole);
        let (of_fit, of_decayed) = (news(jacobian), news(&decayed));
        let inner = of_fit.transpose() * &of_fit;
        let per_unit = block_news(block, pole) * seen.nrows() as f64
            - 2.0 * (&spread * of_decayed.transpose() * &of_fit).trace()
            + (&spread * inner * &spread * jacobian.transpose() * &decayed).trace();
        let lagged = |lag: usize| residuals.iter().zip(residuals.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>();
        let (size, length) = (n as f64, block as f64);
        let counted = quantum > 0.0;
        let rounding = if counted {
            (1.0 + (1.0 + kept) * (1.0 + kept) + kept * kept) * quantum * quantum / 12.0 / (length * length)
        } else {
            (1.0 + kept * kept) * ((lagged(0) - lagged(1)) / size).max(0.0) / length
        };
        let slow = ((seen.norm_squared() - rounding * seen.nrows() as f64) / per_unit).max(0.0);
        let fast = (lagged(0) / size - slow).max(0.0);
        Some(Self { pole, slow, fast: [fast, if counted { -0.5 * fast } else { 0.0 }] })
    }

    /// The covariance of the parameters of a least-squares fit in this noise.
    pub(crate) fn of_least_squares(&self, jacobian: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        let spread = (jacobian.transpose() * jacobian).try_inverse()?;
        let slow = jacobian.transpose() * decaying(jacobian, self.pole) * self.slow;
        Some(&spread * (slow + banded(jacobian, &self.fast)) * &spread)
    }

    /// The covariance of the coefficients of a regression, v(k) = pole·v(k−1) + …, by instruments: there a push is
    /// news only once, and the fast noise comes twice.
    pub(crate) fn of_regression(&self, instruments: &DMatrix<f64>, regressors: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        let inverse = (instruments.transpose() * regressors).try_inverse()?;
        let (pole, [fast, next]) = (self.pole, self.fast);
        let both = 1.0 + pole * pole;
        let push = self.slow * (1.0 - pole * pole);
        let bands = [push + both * fast - 2.0 * pole * next, both * next - pole * fast, -pole * next];
        Some(&inverse * banded(instruments, &bands) * inverse.transpose())
    }
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

/// What the mean of each block adds to what was left of the one before.
fn news(columns: &DMatrix<f64>, block: usize, kept: f64) -> DMatrix<f64> {
    let mean = |n: usize, column: usize| columns.view((n * block, column), (block, 1)).mean();
    let blocks = columns.nrows() / block;
    DMatrix::from_fn(blocks.max(2) - 1, columns.ncols(), |n, column| mean(n + 1, column) - kept * mean(n, column))
}

/// The variance of that for a slow noise of variance 1.
fn block_news(block: usize, pole: f64) -> f64 {
    let kept = libm::pow(pole, block as f64);
    let pairs = || (0..block).flat_map(|i| (0..block).map(move |j| (i, j)));
    let power = |lag: usize| libm::pow(pole, lag as f64);
    let within: f64 = pairs().map(|(i, j)| power(i.abs_diff(j))).sum();
    let across: f64 = pairs().map(|(i, j)| power(block + j - i)).sum();
    ((1.0 + kept * kept) * within - 2.0 * kept * across) / (block * block) as f64
}

/// The matrix of `pole`^|i−j| times `columns`.
fn decaying(columns: &DMatrix<f64>, pole: f64) -> DMatrix<f64> {
    let (n, p) = columns.shape();
    let mut product = columns.clone();
    for column in 0..p {
        let (mut before, mut after) = (0.0, 0.0);
        for row in 1..n {
            before = pole * (before + columns[(row - 1, column)]);
            product[(row, column)] += before;
            let back = n - 1 - row;
            after = pole * (after + columns[(back + 1, column)]);
            product[(back, column)] += after;
        }
    }
    product
}
