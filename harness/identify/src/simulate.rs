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
    let dead = fitted.dead.map_or(0.0, |dead| dead.value);
    run(data, [gain, tau, friction, dead, fitted.start]).into_iter().map(|moved| moved.seen + offset).collect()
}

/// What an interval makes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moved {
    /// What the sensor tells.
    pub(crate) seen: f64,
    /// The speeds at its beginning and end.
    pub(crate) ends: [f64; 2],
}

/// The motor of gain, time constant, Coulomb friction, dead time and speed at the start: what it is driven with comes
/// later by the dead time. Below 0, which no motor has, the dead time goes on as it begins at 0: so an estimate is free
/// to scatter to both sides.
pub(crate) fn run(data: &Data, [gain, tau, friction, dead, start]: [f64; 5]) -> Vec<Moved> {
    if dead <= 0.0 {
        let moved = lag(data, gain, tau, start, friction);
        if dead == 0.0 {
            return moved;
        }
        let late = later(data, &moved, gain, tau);
        return moved
            .iter()
            .zip(late)
            .map(|(moved, late)| Moved { seen: moved.seen + dead * late, ..*moved })
            .collect();
    }
    let (parted, intervals) = data.late(dead);
    let mut whole: Vec<Moved> = Vec::new();
    let parts = lag(&parted, gain, tau, start, friction).into_iter().zip(parted.intervals()).zip(intervals);
    let lengths: Vec<f64> = data.intervals().collect();
    for ((part, length), interval) in parts {
        let share = if data.sensor() == Sensor::Mean { length / lengths[interval] } else { 1.0 };
        match whole.get_mut(interval) {
            Some(moved) if data.sensor() == Sensor::Mean => {
                moved.seen += share * part.seen;
                moved.ends[1] = part.ends[1];
            }
            Some(moved) => *moved = Moved { seen: part.seen, ends: [moved.ends[0], part.ends[1]] },
            None => whole.push(Moved { seen: share * part.seen, ..part }),
        }
    }
    whole
}

/// What a delay of 1 s would change, if it were as little as to change nothing else.
pub(crate) fn later(data: &Data, moved: &[Moved], gain: f64, tau: f64) -> Vec<f64> {
    let of = |((moved, sample), length): ((&Moved, &crate::Sample), f64)| {
        let [begin, end] = moved.ends;
        match data.sensor() {
            Sensor::Mean => -(end - begin) / length,
            Sensor::Instant => -(gain * sample.input - end) / tau,
        }
    };
    moved.iter().zip(data.samples()).zip(data.intervals()).map(of).collect()
}

/// The motor with Coulomb friction: τ·dv/dt = K·(u − F·sgn v) − v, and at rest for as long as |u| is not above F.
fn lag(data: &Data, gain: f64, tau: f64, start: f64, friction: f64) -> Vec<Moved> {
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

/// The speeds with friction and dead time, and their derivatives by those of gain, time constant, friction, dead time
/// and speed at the start that are free: numerically, as there is none where the motor stops.
pub(crate) fn derived(data: &Data, at: [f64; 5], free: [bool; 5]) -> (Vec<f64>, DMatrix<f64>) {
    let seen = |at: [f64; 5]| -> Vec<f64> { run(data, at).into_iter().map(|moved| moved.seen).collect() };
    let [gain, tau, ..] = at;
    let largest = data.samples().iter().map(|sample| sample.input.abs()).fold(0.0, f64::max);
    let steps =
        [STEP * gain.abs(), STEP * tau, STEP * largest, STEP * tau.min(data.period()), STEP * gain.abs() * largest];
    let places: Vec<usize> = (0..5).filter(|place| free[*place]).collect();
    let mut jacobian = DMatrix::zeros(data.samples().len(), places.len());
    for (column, place) in places.into_iter().enumerate() {
        let beside = |sign: f64| {
            let mut at = at;
            at[place] += sign * steps[place];
            seen(at)
        };
        let (after, before) = (beside(1.0), beside(-1.0));
        for (row, (after, before)) in after.iter().zip(&before).enumerate() {
            jacobian[(row, column)] = (after - before) / (2.0 * steps[place]);
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
