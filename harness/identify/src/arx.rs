//! Regression on the difference equation: v(k) = a·v(k−1) + b0·u(k) + b1·u(k−1).
//!
//! Plain least squares takes what the encoder rounds for the motor's own behaviour, and so gives a pole that is too
//! fast. It is here as a warning. Instrumental variables are free of this: in the place of the measured speed, which is
//! in the noise's company, the model's own is correlated with the residuals; that needs an input that keeps changing.

use nalgebra::{DMatrix, DVector};

use crate::confidence::{of_regression, student};
use crate::noise::Noise;
use crate::{Data, Estimate, Finding, Fitted, Sensor};

/// Repetitions, each with the instruments of the model before. (Ours; it has converged long before.)
const ROUNDS: usize = 12;

/// The regression: past speed, inputs, and what they are to explain.
struct Regression {
    regressors: DMatrix<f64>,
    speeds: DVector<f64>,
    period: f64,
}

impl Regression {
    fn of(data: &Data) -> Result<Self, Finding> {
        let period = data.even_period()?;
        let samples = data.samples();
        let pairs: Vec<_> = samples.windows(2).collect();
        // A mean speed also depends on the input before. If the input never changes, the two cannot be told apart.
        let two = data.sensor() == Sensor::Mean && pairs.iter().any(|pair| pair[0].input != pair[1].input);
        let regressors = DMatrix::from_fn(pairs.len(), if two { 3 } else { 2 }, |row, column| match column {
            0 => pairs[row][0].speed,
            1 => pairs[row][1].input,
            _ => pairs[row][0].input,
        });
        let speeds = DVector::from_fn(pairs.len(), |row, _| pairs[row][1].speed);
        Ok(Self { regressors, speeds, period })
    }

    /// The coefficients that leave nothing that correlates with the instruments.
    fn solve(&self, instruments: &DMatrix<f64>) -> Result<DVector<f64>, Finding> {
        let normal = instruments.transpose() * &self.regressors;
        normal.lu().solve(&(instruments.transpose() * &self.speeds)).ok_or(Finding::NoConvergence)
    }

    fn fitted(&self, coefficients: &DVector<f64>) -> Result<Fitted, Finding> {
        let pole = coefficients[0];
        if !(pole > 0.0 && pole < 1.0) {
            return Err(Finding::NoLag { pole });
        }
        let gain = coefficients.iter().skip(1).sum::<f64>() / (1.0 - pole);
        Ok(Fitted::bare(gain, -self.period / libm::log(pole)))
    }

    /// The model's own speeds in the place of the measured ones.
    fn instruments(&self, coefficients: &DVector<f64>) -> DMatrix<f64> {
        let mut instruments = self.regressors.clone();
        for row in 1..instruments.nrows() {
            instruments[(row, 0)] = (instruments.row(row - 1) * coefficients)[0];
        }
        instruments
    }
}

/// By least squares.
///
/// # Errors
/// [`Finding`] if the samples are not evenly spaced, or no lag comes out.
pub fn least_squares(data: &Data) -> Result<Fitted, Finding> {
    let regression = Regression::of(data)?;
    regression.fitted(&regression.solve(&regression.regressors)?)
}

/// By instrumental variables.
///
/// # Errors
/// [`Finding`] as there, or if it does not converge.
pub fn instrumental_variables(data: &Data) -> Result<Fitted, Finding> {
    let regression = Regression::of(data)?;
    let mut coefficients = regression.solve(&regression.regressors)?;
    for _ in 0..ROUNDS {
        coefficients[0] = coefficients[0].clamp(0.5, 0.999_9);
        coefficients = regression.solve(&regression.instruments(&coefficients))?;
    }
    let fitted = regression.fitted(&coefficients)?;
    data.check_fine(fitted.tau.value)?;
    Ok(with_spread(data, &regression, &coefficients, fitted))
}

/// The spread of gain and time constant, from what the model's own speeds leave unexplained.
fn with_spread(data: &Data, regression: &Regression, coefficients: &DVector<f64>, fitted: Fitted) -> Fitted {
    let pole = coefficients[0];
    let instruments = regression.instruments(coefficients);
    // Derivatives of the model's speed by the coefficients: each regressor, through the model's pole.
    let mut jacobian = instruments.clone();
    for row in 1..jacobian.nrows() {
        for column in 0..jacobian.ncols() {
            jacobian[(row, column)] += pole * jacobian[(row - 1, column)];
        }
    }
    let residuals = &regression.speeds - &instruments * coefficients;
    let residuals = DMatrix::from_column_slice(residuals.len(), 1, residuals.as_slice());
    let noise = Noise::of(data, fitted.tau.value, &padded(&jacobian), &padded(&residuals));
    let spread = of_regression(data, &noise, pole, &instruments, &regression.regressors);
    let Some(spread) = spread else { return fitted };
    let (gain, tau) = (fitted.gain.value, fitted.tau.value);
    let log = libm::log(pole);
    let by_gain =
        DVector::from_fn(coefficients.len(), |n, _| if n == 0 { gain / (1.0 - pole) } else { 1.0 / (1.0 - pole) });
    let by_tau =
        DVector::from_fn(coefficients.len(), |n, _| if n == 0 { regression.period / (log * log * pole) } else { 0.0 });
    let times = student(noise.freedom);
    let half = |by: &DVector<f64>| {
        Some(times * libm::sqrt((by.transpose() * &spread * by)[0].max(0.0))).filter(|half| half.is_finite())
    };
    let estimate = |value: f64, by: &DVector<f64>| Estimate { value, half: half(by) };
    Fitted {
        gain: estimate(gain, &by_gain),
        tau: estimate(tau, &by_tau),
        start: 0.0,
        friction: None,
        offset: None,
        dead: None,
    }
}

/// With a row of nothing for the first sample, of which a regression makes none.
fn padded(columns: &DMatrix<f64>) -> DMatrix<f64> {
    columns.clone().insert_row(0, 0.0)
}
