//! A code wheel that is not centred: its counts are early on one side and late on the other.
//!
//! In each revolution the error is the same, so it is a wave over the angle, which the counts themselves tell well
//! enough. Its first two harmonics are fitted together with the motor and taken out. (Ours.)

use nalgebra::{DMatrix, DVector};

use crate::noise::Noise;
use crate::{Data, Sample, Sensor, nls, simulate};

/// Fewer revolutions do not tell a wave from the motor. (Ours.)
const REVOLUTIONS: f64 = 3.0;
/// The wave's squares, each over its variance, are above this by chance in one of 20 000 wheels (χ² of 4).
const CLEAR: f64 = 25.0;
/// With the wave gone the next fit is better.
const ROUNDS: usize = 3;

/// Data without the wave of the wheel, and how far it was off at most; None if there is none that is clear.
/// `revolution` is one, in units of position.
pub fn centred(data: &Data, revolution: f64) -> Option<(Data, f64)> {
    if data.sensor() != Sensor::Mean {
        return None;
    }
    let turned: f64 = data.samples().iter().zip(data.intervals()).map(|(sample, s)| sample.speed.abs() * s).sum();
    if turned < REVOLUTIONS * revolution {
        return None;
    }
    let (mut cleaned, mut sizes) = (data.clone(), DVector::zeros(4));
    for round in 0..ROUNDS {
        // What the wheel counts too much it also takes for an angle, until that is taken out.
        let rows = waves(&cleaned, revolution);
        let (found, clear) = wanted(data, &cleaned, &rows)?;
        if round == 0 && !clear {
            return None;
        }
        let off = &rows * &found;
        let samples = data.samples().iter().zip(&off);
        let samples = samples.map(|(sample, off)| Sample { speed: sample.speed - off, ..*sample }).collect();
        (cleaned, sizes) = (data.with_samples(samples), found);
    }
    let most = (0..360).map(|degrees| {
        let at = wave(f64::from(degrees).to_radians());
        at.iter().zip(&sizes).map(|(wave, size)| wave * size).sum::<f64>()
    });
    Some((cleaned, most.fold(0.0, |most, off| off.abs().max(most))))
}

/// What each harmonic makes of the speed in each interval.
fn waves(data: &Data, revolution: f64) -> DMatrix<f64> {
    let (mut angle, mut before) = (0.0, wave(0.0));
    let mut rows = DMatrix::zeros(data.samples().len(), 4);
    for (row, (sample, length)) in data.samples().iter().zip(data.intervals()).enumerate() {
        angle += core::f64::consts::TAU * sample.speed * length / revolution;
        let now = wave(angle);
        for (column, (now, before)) in now.iter().zip(before).enumerate() {
            rows[(row, column)] = (now - before) / length;
        }
        before = now;
    }
    rows
}

/// The first two harmonics.
fn wave(angle: f64) -> [f64; 4] {
    let ((sin, cos), (sin2, cos2)) = (libm::sincos(angle), libm::sincos(2.0 * angle));
    [sin, cos, sin2, cos2]
}

/// How much of each wave the data want beside the motor, which is known from `cleaned`, and whether that is clear.
fn wanted(data: &Data, cleaned: &Data, waves: &DMatrix<f64>) -> Option<(DVector<f64>, bool)> {
    let fitted = nls::unchecked(cleaned).ok()?;
    let (gain, tau) = (fitted.gain.value, fitted.tau.value);
    let response = simulate::respond(data, gain, tau, fitted.start);
    let motor = simulate::jacobian(&response, !data.starts_at_rest());
    let left = data.samples().iter().zip(&response).map(|(sample, row)| sample.speed - row[0]);
    let left = DMatrix::from_iterator(response.len(), 1, left);
    let own = motor.ncols();
    let mut columns = motor.resize_horizontally(own + 4, 0.0);
    columns.columns_mut(own, 4).copy_from(waves);
    let noise = Noise::of(data, tau, &columns, &left);
    let white = noise.whiten(data, &columns).columns;
    let left = noise.whiten(data, &left).columns.column(0).into_owned();
    let spread = (white.transpose() * &white).try_inverse()?;
    let found = (&spread * (white.transpose() * left)).rows(own, 4).into_owned();
    let certain = spread.view((own, own), (4, 4)).into_owned().try_inverse()?;
    let clear = (found.transpose() * certain * &found)[0] > CLEAR;
    Some((found, clear))
}
