//! The noise in an encoder's data, as two parts: pushes that turn the shaft, and readings that are rounded.
//!
//! A push is white torque: it goes through the motor's own lag, and is remembered for its time constant. A reading is
//! off by its own rounding and by no other's: a count that was rounded away comes in the next window. So the data are
//! taken as the positions that they sum up to, and a Kalman filter makes of them what each reading says that is new.
//! What is new is independent, and so can be weighed by squares. (Ours.)

use nalgebra::DMatrix;

use crate::{Data, Sensor};

/// The variance of pushes that is tried: so many powers of ten around that of one rounding in a window. (Ours.)
const TRIED: [f64; 8] = [-8.0, -6.0, -4.0, -3.0, -2.0, -1.0, 1.0, 4.0];
/// What changes by less, as a share, does not change any more.
const STEADY: f64 = 1e-12;
/// Narrowings of the interval in which the likeliest lies.
const ROUNDS: usize = 10;

/// How much of each part there is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Noise {
    /// The time for which a push is remembered, in s.
    pub(crate) tau: f64,
    /// The variance of speed, in the long run, that comes of pushes.
    pub(crate) slow: f64,
    /// The variance of a reading: of a position, if the sensor tells the mean speed.
    pub(crate) reading: f64,
    /// How many independent numbers that is known from.
    pub(crate) freedom: f64,
}

/// Columns of which each row is independent of the others, with variance 1; and the logarithm of what that took.
pub(crate) struct White {
    pub(crate) columns: DMatrix<f64>,
    pub(crate) log: f64,
}

impl Noise {
    /// What rounding alone makes, and so the least that the variance of a reading can be.
    pub(crate) fn rounding(data: &Data) -> f64 {
        let quantum = if data.sensor() == Sensor::Mean { data.quantum() * data.period() } else { 0.0 };
        quantum * quantum / 12.0
    }

    /// The likeliest noise in what a fit leaves, `residuals`, of a motor with this time constant: what the fit may have
    /// taken out, along its derivatives, is not looked at (restricted maximum likelihood).
    pub(crate) fn of(data: &Data, tau: f64, jacobian: &DMatrix<f64>, residuals: &DMatrix<f64>) -> Self {
        let mut columns = jacobian.clone().resize_horizontally(jacobian.ncols() + 1, 0.0);
        columns.set_column(jacobian.ncols(), &residuals.column(0));
        let window = data.period();
        // Beside a reading whose variance is 1.
        let unit = if data.sensor() == Sensor::Mean { 1.0 / (window * window) } else { 1.0 };
        let least = Self::rounding(data);
        let unlikely = |ratio: f64| {
            let noise = Self { tau, slow: ratio * unit, reading: 1.0, freedom: 0.0 };
            noise.unlikely(data, &columns, least)
        };
        let none = unlikely(0.0);
        let power = |power: f64| unlikely(libm::pow(10.0, power));
        let tried = TRIED.map(|n| (n, power(n)));
        let (middle, best) =
            tried.into_iter().fold((0.0, (f64::MAX, 1.0)), |best, new| if new.1.0 < best.1.0 { new } else { best });
        let rest = (residuals.nrows() - jacobian.ncols()) as f64;
        if none.0 <= best.0 {
            return Self { tau, slow: 0.0, reading: none.1, freedom: rest };
        }
        let golden = 0.618_034;
        let beside = |side: fn(f64, f64) -> bool| TRIED.into_iter().filter(move |n| side(*n, middle));
        let mut low = beside(|n, middle| n < middle).fold(middle - 2.0, f64::max);
        let mut high = beside(|n, middle| n > middle).fold(middle + 3.0, f64::min);
        let (mut a, mut b) = (high - golden * (high - low), low + golden * (high - low));
        let (mut of_a, mut of_b) = (power(a).0, power(b).0);
        for _ in 0..ROUNDS {
            if of_a < of_b {
                (high, b, of_b) = (b, a, of_a);
                a = high - golden * (high - low);
                of_a = power(a).0;
            } else {
                (low, a, of_a) = (a, b, of_b);
                b = low + golden * (high - low);
                of_b = power(b).0;
            }
        }
        let best = 0.5 * (low + high);
        let (at, reading) = power(best);
        // A variance from ν numbers has a likelihood that bends by ν/2, over its logarithm.
        let side = 0.5 * core::f64::consts::LN_10;
        let bend = (power(best - 0.5).0 + power(best + 0.5).0 - 2.0 * at) / (side * side);
        let freedom = (2.0 * bend).clamp(3.0, rest.max(3.0));
        Self { tau, slow: libm::pow(10.0, best) * unit * reading, reading, freedom }
    }

    /// How unlikely columns are, the last of which is a residual (minus the logarithm of the likelihood), and the
    /// likeliest variance of a reading that is not below `least`: time stamps and code wheels are not exact either.
    fn unlikely(&self, data: &Data, columns: &DMatrix<f64>, least: f64) -> (f64, f64) {
        let White { columns, log } = self.whiten(data, columns);
        let (rows, last) = (columns.nrows(), columns.ncols() - 1);
        let products = columns.transpose() * &columns;
        let inner = products.view((0, 0), (last, last)).into_owned();
        let mixed = products.view((0, last), (last, 1)).into_owned();
        let Some(factor) = inner.cholesky() else { return (f64::MAX, 1.0) };
        let left = (products[(last, last)] - mixed.dot(&factor.solve(&mixed))).max(f64::MIN_POSITIVE);
        let spread: f64 = factor.l().diagonal().iter().map(|x| libm::log(*x)).sum();
        let freedom = (rows - last) as f64;
        let reading = least.max(left / freedom);
        (0.5 * (log + freedom * libm::log(reading) + left / reading) + spread, reading)
    }

    /// What each row of the columns says that is new, the rows before it known.
    pub(crate) fn whiten(&self, data: &Data, columns: &DMatrix<f64>) -> White {
        let (rows, count) = columns.shape();
        let mean = data.sensor() == Sensor::Mean;
        let Self { tau, slow, reading, .. } = *self;
        let mut white = DMatrix::zeros(rows, count);
        let mut log = 0.0;
        // Position and speed of each column; of the noise, their covariance. The first reading is rounded, too.
        let mut state = vec![[0.0, 0.0, 0.0]; count];
        let (mut pp, mut pv, mut vv) = (if mean { reading } else { 0.0 }, 0.0, 0.0);
        let mut step = Step::of(0.0, tau, slow);
        let (mut gains, mut size, mut own_log, mut steady) = ([0.0, 0.0], 1.0, 0.0, false);
        for (row, length) in data.intervals().enumerate() {
            if length != step.length {
                (step, steady) = (Step::of(length, tau, slow), false);
            }
            let Step { kept, way, pushed: [push_pp, push_pv, push_vv], .. } = step;
            // With even samples, what is known soon becomes no more and no less.
            if !steady {
                pp += 2.0 * way * pv + way * way * vv + push_pp;
                pv = kept * (pv + way * vv) + push_pv;
                vv = kept * kept * vv + push_vv;
                let own = if mean { [pp, pv] } else { [pv, vv] };
                let all = if mean { pp } else { vv } + reading;
                let before = core::mem::replace(&mut gains, own.map(|covariance| covariance / all));
                steady = gains.iter().zip(before).all(|(now, before)| (now - before).abs() <= STEADY * now.abs());
                (size, own_log) = (libm::sqrt(all), libm::log(all));
                let [to_position, to_speed] = gains;
                let across = if mean { pv } else { vv };
                (pp, pv, vv) = (pp - to_position * own[0], pv - to_position * across, vv - to_speed * own[1]);
            }
            log += own_log;
            for (column, [position, speed, sum]) in state.iter_mut().enumerate() {
                *position += way * *speed;
                *speed *= kept;
                let value = columns[(row, column)];
                *sum += length * value;
                let new = if mean { *sum - *position } else { value - *speed };
                *position += gains[0] * new;
                *speed += gains[1] * new;
                white[(row, column)] = new / size;
            }
        }
        White { columns: white, log }
    }
}

/// What an interval does to position and speed: what is kept of a speed, the way that it makes, and the covariance of
/// what pushes add.
struct Step {
    length: f64,
    kept: f64,
    way: f64,
    pushed: [f64; 3],
}

impl Step {
    fn of(length: f64, tau: f64, slow: f64) -> Self {
        let x = length / tau;
        let (kept, gone) = (libm::exp(-x), -libm::expm1(-x));
        let square = gone * (1.0 + kept);
        // By its series where the difference would be nothing but rounding.
        let drift = if x < 1e-2 { x * x * x / 3.0 * (1.0 - 0.75 * x) } else { x - 2.0 * gone + 0.5 * square };
        let pushed = [2.0 * slow * tau * tau * drift, slow * tau * gone * gone, slow * square];
        Self { length, kept, way: tau * gone, pushed }
    }
}
