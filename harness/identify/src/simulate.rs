//! What a motor does with an input, interval by interval, as its sensor would have it.

use nalgebra::DMatrix;

use crate::{Data, Fitted, Sensor};

/// The steps of numeric derivatives, as a share: about the cube root of the precision of an `f64`.
const STEP: f64 = 1e-5;

/// The speeds that the model gives for `data`.
pub(crate) fn speeds(data: &Data, fitted: &Fitted) -> Vec<f64> {
    let (gain, tau) = (fitted.gain.value, fitted.tau.value);
    let friction = fitted.friction.map_or(0.0, |friction| friction.value);
    let offset = fitted.offset.map_or(0.0, |offset| offset.value);
    run(data, gain, tau, fitted.start, friction).into_iter().map(|moved| moved.seen + offset).collect()
}

/// What an interval makes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moved {
    /// What the sensor tells.
    pub(crate) seen: f64,
    /// The speeds at its beginning and end.
    pub(crate) ends: [f64; 2],
}

/// The motor with Coulomb friction: τ·dv/dt = K·(u − F·sgn v) − v, and at rest for as long as |u| is not above F.
pub(crate) fn run(data: &Data, gain: f64, tau: f64, start: f64, friction: f64) -> Vec<Moved> {
    let mut speed = start;
    let interval = |(sample, length): (&crate::Sample, f64)| {
        let (begin, mut way, mut left) = (speed, 0.0, length);
        // It may come to rest, and from there go the other way: twice at most, as the input is held.
        for _ in 0..3 {
            let sense = if speed == 0.0 { sample.input.signum() * gain.signum() } else { speed.signum() };
            let target = gain * sample.input - sense * gain.abs() * friction;
            if left <= 0.0 || (speed == 0.0 && target * sense <= 0.0) {
                break;
            }
            let rest =
                if speed * target < 0.0 && friction > 0.0 { tau * libm::log1p(-speed / target) } else { f64::MAX };
            let passed = left.min(rest);
            let gone = -libm::expm1(-passed / tau);
            way += target * passed + (speed - target) * tau * gone;
            speed = if rest < left { 0.0 } else { speed + (target - speed) * gone };
            left -= passed;
        }
        let seen = if data.sensor() == Sensor::Mean { way / length } else { speed };
        Moved { seen, ends: [begin, speed] }
    };
    data.samples().iter().zip(data.intervals()).map(interval).collect()
}

/// The speeds with friction, and their derivatives by gain, time constant, friction and, if that is free, the speed at
/// the start: numerically, as there is none where the motor stops.
pub(crate) fn with_friction(
    data: &Data,
    [gain, tau, friction, start]: [f64; 4],
    free_start: bool,
) -> (Vec<f64>, DMatrix<f64>) {
    let seen = |[gain, tau, friction, start]: [f64; 4]| -> Vec<f64> {
        run(data, gain, tau, start, friction).into_iter().map(|moved| moved.seen).collect()
    };
    let at = [gain, tau, friction, start];
    let largest = data.samples().iter().map(|sample| sample.input.abs()).fold(0.0, f64::max);
    let steps = [STEP * gain.abs(), STEP * tau, STEP * largest, STEP * gain.abs() * largest];
    let columns = if free_start { 4 } else { 3 };
    let mut jacobian = DMatrix::zeros(data.samples().len(), columns);
    for column in 0..columns {
        let beside = |sign: f64| {
            let mut at = at;
            at[column] += sign * steps[column];
            seen(at)
        };
        let (after, before) = (beside(1.0), beside(-1.0));
        for (row, (after, before)) in after.iter().zip(&before).enumerate() {
            jacobian[(row, column)] = (after - before) / (2.0 * steps[column]);
        }
    }
    (seen(at), jacobian)
}

/// The model's speed in each interval, and its derivatives by gain, time constant and speed at the start.
pub(crate) fn respond(data: &Data, gain: f64, tau: f64, start: f64) -> Vec<[f64; 4]> {
    // The speed and its derivatives at the beginning of the interval.
    let mut v = [start, 0.0, 0.0, 1.0];
    let interval = |(sample, length): (&crate::Sample, f64)| {
        let target = gain * sample.input;
        let kept = libm::exp(-length / tau);
        let gone = -libm::expm1(-length / tau);
        let excess = v[0] - target;
        let end = [
            target + excess * kept,
            sample.input * gone + v[1] * kept,
            v[2] * kept + excess * kept * length / (tau * tau),
            v[3] * kept,
        ];
        let share = gone * tau / length;
        let by_tau = gone / length - kept / tau;
        let mean = [
            target + excess * share,
            sample.input * (1.0 - share) + v[1] * share,
            v[2] * share + excess * by_tau,
            v[3] * share,
        ];
        v = end;
        if data.sensor() == Sensor::Mean { mean } else { end }
    };
    data.samples().iter().zip(data.intervals()).map(interval).collect()
}

/// The derivatives alone: by gain, time constant and, if that is free, the speed at the start.
pub(crate) fn jacobian(response: &[[f64; 4]], free_start: bool) -> DMatrix<f64> {
    let columns = if free_start { 3 } else { 2 };
    DMatrix::from_fn(response.len(), columns, |row, column| response[row][column + 1])
}
