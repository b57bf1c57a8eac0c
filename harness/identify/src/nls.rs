//! Non-linear least squares: the model that would have counted what was counted, as nearly as can be.
//!
//! The model's response to the input as it was is compared with the data interval by interval. So any input will do,
//! and no final value needs to have been reached. Levenberg-Marquardt, as MINPACK has it.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn};

use crate::confidence::half_widths;
use crate::data::rounded;
use crate::noise::Noise;
use crate::simulate::{self, jacobian, respond};
use crate::{Data, Estimate, Finding, Fitted, Sensor};

/// Time constants tried to begin with.
const STARTS: usize = 24;
/// A fit that explains less is none, in %. (Ours.)
const LEAST_FIT: f64 = 30.0;
/// A time constant is none whose interval is wider than this share of it, to either side. (Ours.)
const VAGUE: f64 = 0.5;
/// What is left tells what the noise is, and the noise how much each sample weighs: so often in turn. (Ours; the second
/// round changes hardly anything.)
const ROUNDS: usize = 2;
/// A slower start is rest, as a share of the greatest speed. (Ours.)
const AT_REST: f64 = 0.02;
/// Shares of the largest input that friction may be, to begin with.
const FRICTIONS: [f64; 4] = [0.02, 0.1, 0.3, 0.5];
/// Friction below this share of the largest input is none. (Ours.)
const LEAST_FRICTION: f64 = 0.002;
/// Delays tried to begin with, from a sample to a share of the data. (Ours.)
const DELAYS: usize = 24;
const LONGEST_DEAD: f64 = 0.25;
/// A dead time is there that is so many times half of its interval, as friction and an offset are. (Ours.)
const CLEAR: f64 = 2.0;
/// A dead time below this share of a sample is none. (Ours.)
const LEAST_DEAD: f64 = 0.02;
/// A sensor that is off by a smaller share of the greatest speed is not worth a word. (Ours.)
const LEAST_OFFSET: f64 = 0.005;
/// Data of fewer time constants are no ground for a gain. (Ours.)
const LEAST_PASSED: f64 = 1.0;

/// The speeds that the model gives for `data`, each interval as its sensor would have it.
pub fn simulate(data: &Data, fitted: &Fitted) -> Vec<f64> {
    simulate::speeds(data, fitted)
}

/// The goodness of fit, in %: 100 is all, 0 no better than the mean (the normalised root mean square error).
pub fn fit_percent(data: &Data, fitted: &Fitted) -> f64 {
    let mean = data.samples().iter().map(|sample| sample.speed).sum::<f64>() / data.samples().len() as f64;
    let pairs = data.samples().iter().zip(simulate(data, fitted));
    let (left, all) = pairs.fold((0.0, 0.0), |(left, all), (sample, model)| {
        (left + squared(sample.speed - model), all + squared(sample.speed - mean))
    });
    100.0 * (1.0 - libm::sqrt(left / all))
}

/// What the model leaves unexplained: root mean square, in units of speed.
pub fn residual_rms(data: &Data, fitted: &Fitted) -> f64 {
    let left = data.samples().iter().zip(simulate(data, fitted)).map(|(sample, model)| squared(sample.speed - model));
    libm::sqrt(left.sum::<f64>() / data.samples().len() as f64)
}

/// The same, without what readings that are off leave by themselves: of a mean speed, what one reading adds, the next
/// takes away. No motor does that.
pub fn fit_beside_readings(data: &Data, fitted: &Fitted) -> f64 {
    let left: Vec<f64> =
        data.samples().iter().zip(simulate(data, fitted)).map(|(sample, model)| sample.speed - model).collect();
    let all: f64 = left.iter().map(|left| left * left).sum();
    let next: f64 = left.windows(2).map(|pair| pair[0] * pair[1]).sum();
    let readings = if data.sensor() == Sensor::Mean { (-2.0 * next).clamp(0.0, all) } else { 0.0 };
    100.0 - (100.0 - fit_percent(data, fitted)) * libm::sqrt(1.0 - readings / all.max(f64::MIN_POSITIVE))
}

/// Fits gain and time constant; also the speed at the start, unless the motor was at rest.
///
/// # Errors
/// [`Finding`] if the fit does not converge, means nothing, or the data are too short for it.
pub fn first_order(data: &Data) -> Result<Fitted, Finding> {
    check(data, unchecked(data)?)
}

/// The same, whatever it means.
pub(crate) fn unchecked(data: &Data) -> Result<Fitted, Finding> {
    let free_start = !data.starts_at_rest();
    let measured = DVector::from_iterator(data.samples().len(), data.samples().iter().map(|sample| sample.speed));
    // For a given time constant the model is linear in the rest: the best of these is near enough to begin with.
    let (shortest, longest) = (0.2 * data.period(), 5.0 * data.seconds());
    let tried = (0..STARTS).map(|n| {
        let share = n as f64 / (STARTS - 1) as f64;
        shortest * libm::pow(longest / shortest, share)
    });
    let best = tried.filter_map(|tau| {
        let basis = jacobian(&respond(data, 1.0, tau, 0.0), free_start);
        // The columns of gain and start alone.
        let basis = basis.remove_column(1);
        let linear = basis.clone().svd(true, true).solve(&measured, 1e-12).ok()?;
        let left = (&measured - basis * &linear).norm_squared();
        left.is_finite().then_some((left, tau, linear))
    });
    let (_, tau, linear) = best.min_by(|a, b| a.0.total_cmp(&b.0)).ok_or(Finding::NoConvergence)?;
    let mut start = vec![linear[0], libm::log(tau)];
    start.extend(linear.iter().skip(1));
    let evaluate = |p: &DVector<f64>| {
        let tau = libm::exp(p[1]);
        let response = respond(data, p[0], tau, p.get(2).copied().unwrap_or(0.0));
        let model = DVector::from_iterator(response.len(), response.iter().map(|row| row[0]));
        let mut jacobian = jacobian(&response, free_start);
        jacobian.column_mut(1).scale_mut(tau);
        (model - &measured, jacobian)
    };
    let (p, halves) = weighed(data, DVector::from_vec(start), &evaluate)?;
    let estimate = |value: f64, place: usize| Estimate { value, half: halves.as_ref().map(|halves| halves[place]) };
    let start = p.get(2).copied().unwrap_or(0.0);
    Ok(Fitted {
        gain: estimate(p[0], 0),
        tau: estimate(libm::exp(p[1]), 1),
        start,
        friction: None,
        offset: None,
        dead: None,
    })
}

/// Fits Coulomb friction besides, of data whose input changes: at one level, friction is a smaller gain.
///
/// # Errors
/// [`Finding::NoFriction`] if there is none to be seen; otherwise as [`first_order`].
pub fn with_friction(data: &Data) -> Result<Fitted, Finding> {
    if data.step().is_some() {
        return Err(Finding::NoFriction);
    }
    let first = unchecked(data)?;
    let measured = DVector::from_iterator(data.samples().len(), data.samples().iter().map(|sample| sample.speed));
    let largest = data.samples().iter().map(|sample| sample.input.abs()).fold(0.0, f64::max);
    let free_start = !data.starts_at_rest();
    let of = |p: &DVector<f64>| [p[0], libm::exp(p[1]), largest * p[2], p.get(3).copied().unwrap_or(0.0)];
    let evaluate = |p: &DVector<f64>| {
        let at = of(p);
        let [gain, tau, friction, start] = at;
        let free = [true, true, true, false, free_start];
        let (seen, mut jacobian) = simulate::derived(data, [gain, tau, friction, 0.0, start], free);
        jacobian.column_mut(1).scale_mut(at[1]);
        jacobian.column_mut(2).scale_mut(largest);
        (DVector::from_vec(seen) - &measured, jacobian)
    };
    // Gain and friction trade for each other: the best of some shares to begin with.
    let begin = |share: f64| {
        let gain = first.gain.value / (1.0 - share);
        let mut p = vec![gain, libm::log(first.tau.value), share];
        p.extend(free_start.then_some(first.start));
        DVector::from_vec(p)
    };
    let tried = FRICTIONS.map(begin).map(|p| {
        least_squares(p, &evaluate).map_or((f64::MAX, DVector::zeros(0)), |(p, left, _)| (left.norm_squared(), p))
    });
    let (_, p) = tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).ok_or(Finding::NoConvergence)?;
    if p.is_empty() {
        return Err(Finding::NoConvergence);
    }
    let (p, halves) = weighed(data, p, &evaluate)?;
    let [gain, tau, friction, start] = of(&p);
    let half = |place: usize, unit: f64| halves.as_ref().map(|halves| unit * halves[place]);
    let friction = Estimate { value: friction, half: half(2, largest) };
    let clear =
        friction.half.is_some_and(|half| friction.value > 2.0 * half) && friction.value > LEAST_FRICTION * largest;
    if !clear {
        return Err(Finding::NoFriction);
    }
    let (gain, tau) = (Estimate { value: gain, half: half(0, 1.0) }, Estimate { value: tau, half: half(1, 1.0) });
    check(data, Fitted { gain, tau, start, friction: Some(friction), offset: None, dead: None })
}

/// Fits a dead time besides, between drive and motor.
///
/// # Errors
/// [`Finding::NoDeadTime`] if there is none to be seen; otherwise as [`first_order`].
pub fn with_dead_time(data: &Data) -> Result<Fitted, Finding> {
    let fitted = any_dead_time(data)?;
    let Some(Estimate { value, half: Some(half) }) = fitted.dead else { return Err(Finding::NoConvergence) };
    if value <= (CLEAR * half).max(LEAST_DEAD * data.period()) {
        return Err(Finding::NoDeadTime { most: rounded(value.max(0.0) + half) });
    }
    check(data, fitted)
}

/// The same, whatever it means: of a motor without dead time, it comes out on both sides of 0.
///
/// # Errors
/// [`Finding::NoChange`] if the input never changes; [`Finding::NoConvergence`] if the fit does not converge.
pub fn any_dead_time(data: &Data) -> Result<Fitted, Finding> {
    let before = data.input_before();
    if data.samples().iter().all(|sample| sample.input == before) {
        return Err(Finding::NoChange);
    }
    let first = unchecked(data)?;
    let measured = DVector::from_iterator(data.samples().len(), data.samples().iter().map(|sample| sample.speed));
    let free_start = !data.starts_at_rest();
    let period = data.period();
    let of = |p: &DVector<f64>| [p[0], libm::exp(p[1]), 0.0, period * p[2], p.get(3).copied().unwrap_or(0.0)];
    let evaluate = |p: &DVector<f64>| {
        let at = of(p);
        let (seen, mut jacobian) = simulate::derived(data, at, [true, true, false, true, free_start]);
        jacobian.column_mut(1).scale_mut(at[1]);
        jacobian.column_mut(2).scale_mut(period);
        (DVector::from_vec(seen) - &measured, jacobian)
    };
    // The best of some delays to begin with; each takes a part of the time constant.
    let begin = |dead: f64, tau: f64| {
        let mut p = vec![first.gain.value, libm::log(tau), dead / period];
        p.extend(free_start.then_some(first.start));
        DVector::from_vec(p)
    };
    let longest = LONGEST_DEAD * data.seconds();
    let delays = (0..DELAYS).map(|n| period * libm::pow(longest / period, n as f64 / (DELAYS - 1) as f64));
    let (tau, least) = (first.tau.value, 0.2 * period);
    let tried = core::iter::once(0.0)
        .chain(delays)
        .flat_map(|dead| [tau, tau - 0.5 * dead, tau - dead].map(|tau| begin(dead, tau.max(least))));
    let left = |p: DVector<f64>| {
        let pairs = data.samples().iter().zip(simulate::run(data, of(&p)));
        (pairs.map(|(sample, moved)| squared(sample.speed - moved.seen)).sum::<f64>(), p)
    };
    let (_, p) = tried.map(left).min_by(|a, b| a.0.total_cmp(&b.0)).ok_or(Finding::NoConvergence)?;
    let (p, halves) = weighed(data, p, &evaluate)?;
    let [gain, tau, _, dead, start] = of(&p);
    let estimate = |value: f64, place: usize, unit: f64| Estimate {
        value,
        half: halves.as_ref().map(|halves| unit * halves[place]),
    };
    let (gain, tau) = (estimate(gain, 0, 1.0), estimate(tau, 1, 1.0));
    Ok(Fitted { gain, tau, start, friction: None, offset: None, dead: Some(estimate(dead, 2, period)) })
}

/// Fits an offset of the sensor besides, of data that show one while the motor stands and is not driven.
///
/// # Errors
/// [`Finding::NoOffset`] if there is none to be seen; otherwise as [`first_order`].
pub fn with_offset(data: &Data) -> Result<Fitted, Finding> {
    let (stands_at, half) = data.undriven().ok_or(Finding::NoOffset)?;
    let largest = data.samples().iter().map(|sample| sample.speed.abs()).fold(0.0, f64::max);
    if stands_at.abs() < (LEAST_OFFSET * largest).max(2.0 * half) {
        return Err(Finding::NoOffset);
    }
    let first = unchecked(data)?;
    let measured = DVector::from_iterator(data.samples().len(), data.samples().iter().map(|sample| sample.speed));
    let free_start = !data.starts_at_rest();
    let evaluate = |p: &DVector<f64>| {
        let tau = libm::exp(p[1]);
        let response = respond(data, p[0], tau, p.get(3).copied().unwrap_or(0.0));
        let model = DVector::from_iterator(response.len(), response.iter().map(|row| row[0] + largest * p[2]));
        let mut jacobian = jacobian(&response, free_start).insert_column(2, largest);
        jacobian.column_mut(1).scale_mut(tau);
        (model - &measured, jacobian)
    };
    let mut begin = vec![first.gain.value, libm::log(first.tau.value), stands_at / largest];
    begin.extend(free_start.then_some(0.0));
    let (p, halves) = weighed(data, DVector::from_vec(begin), &evaluate)?;
    let estimate = |value: f64, place: usize, unit: f64| Estimate {
        value: unit * value,
        half: halves.as_ref().map(|halves| unit * halves[place]),
    };
    let offset = estimate(p[2], 2, largest);
    // A motor that coasts is no sensor that is off: then the offset is not what was seen.
    let close = |fitted: f64| (offset.value - stands_at).abs() <= 2.0 * (fitted + half) + 1e-6 * largest;
    if !offset.half.is_some_and(|half| offset.value.abs() > 2.0 * half && close(half)) {
        return Err(Finding::NoOffset);
    }
    let (gain, tau) = (estimate(p[0], 0, 1.0), estimate(libm::exp(p[1]), 1, 1.0));
    let start = p.get(3).copied().unwrap_or(0.0);
    check(data, Fitted { gain, tau, start, friction: None, offset: Some(offset), dead: None })
}

/// Least squares, each sample weighed by what it says that is new: the parameters, of which the second is the logarithm
/// of the time constant, and half of the interval of each (of that, not of its logarithm).
fn weighed<F>(data: &Data, start: DVector<f64>, evaluate: &F) -> Result<(DVector<f64>, Option<DVector<f64>>), Finding>
where
    F: Fn(&DVector<f64>) -> (DVector<f64>, DMatrix<f64>),
{
    let (mut p, mut residuals, mut jacobian) = least_squares(start, evaluate)?;
    let noise_at = |tau: f64, residuals: &DVector<f64>, jacobian: &DMatrix<f64>| {
        Noise::of(data, tau, jacobian, &DMatrix::from_column_slice(residuals.len(), 1, residuals.as_slice()))
    };
    for _ in 0..ROUNDS {
        let noise = noise_at(libm::exp(p[1]), &residuals, &jacobian);
        let whitened = |p: &DVector<f64>| {
            let (residuals, jacobian) = evaluate(p);
            let last = jacobian.ncols();
            let mut columns = jacobian.insert_column(last, 0.0);
            columns.set_column(last, &residuals);
            let white = noise.whiten(data, &columns).columns;
            (white.column(last).into_owned(), white.remove_column(last))
        };
        (p, _, _) = least_squares(p, &whitened)?;
        (residuals, jacobian) = evaluate(&p);
    }
    let tau = libm::exp(p[1]);
    let noise = noise_at(tau, &residuals, &jacobian);
    jacobian.column_mut(1).unscale_mut(tau);
    let path: Vec<f64> = data.samples().iter().zip(&residuals).map(|(sample, left)| sample.speed + left).collect();
    let halves = half_widths(data, p[0], &noise, &jacobian, &residuals, &path);
    Ok((p, halves))
}

/// Whether a fit means anything.
fn check(data: &Data, fitted: Fitted) -> Result<Fitted, Finding> {
    let Estimate { value: tau, half } = fitted.tau;
    data.check_fine(tau)?;
    check_fit(data, &fitted)?;
    let passed = data.seconds() / tau;
    if passed < LEAST_PASSED {
        return Err(Finding::TooEarly {
            passed: libm::floor(100.0 * passed) / 100.0,
            tau: round2(tau),
            least: LEAST_PASSED,
        });
    }
    let half = half.ok_or(Finding::NoConvergence)?;
    if half > VAGUE * tau {
        return Err(Finding::Vague { tau: round3(tau), half: round3(half) });
    }
    Ok(fitted)
}

/// Whether the motor was at rest at the start, even if it is so fast that the first sample does not show it: then the
/// model's speed at the start comes out as 0.
pub fn begins_at_rest(data: &Data) -> bool {
    let largest = data.samples().iter().map(|sample| sample.speed.abs()).fold(0.0, f64::max);
    data.starts_at_rest() || unchecked(data).is_ok_and(|fitted| fitted.start.abs() < AT_REST * largest)
}

/// Whether a model explains anything.
///
/// # Errors
/// [`Finding::NotThisModel`] if it does not.
pub fn check_fit(data: &Data, fitted: &Fitted) -> Result<(), Finding> {
    // What one count or a time stamp hides is not the model's fault.
    let fit = fit_beside_readings(data, fitted);
    if fit < LEAST_FIT && residual_rms(data, fitted) > data.quantum() {
        return Err(Finding::NotThisModel { fit, expected: "lag of the first order" });
    }
    Ok(())
}

/// The parameters of a fit, and the residuals and their derivatives there.
type Least = (DVector<f64>, DVector<f64>, DMatrix<f64>);

/// Least squares from a start.
pub(crate) fn least_squares<F>(start: DVector<f64>, evaluate: &F) -> Result<Least, Finding>
where
    F: Fn(&DVector<f64>) -> (DVector<f64>, DMatrix<f64>),
{
    let (residuals, jacobian) = evaluate(&start);
    let problem = Problem { evaluate, parameters: start, residuals, jacobian };
    let (problem, report) = LevenbergMarquardt::new().minimize(problem);
    let finite = problem.parameters.iter().chain(problem.residuals.iter()).all(|number| number.is_finite());
    if !finite || !report.termination.was_successful() {
        return Err(Finding::NoConvergence);
    }
    Ok((problem.parameters, problem.residuals, problem.jacobian))
}

struct Problem<'a, F> {
    evaluate: &'a F,
    parameters: DVector<f64>,
    residuals: DVector<f64>,
    jacobian: DMatrix<f64>,
}

impl<F> LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_, F>
where
    F: Fn(&DVector<f64>) -> (DVector<f64>, DMatrix<f64>),
{
    type ParameterStorage = Owned<f64, Dyn>;
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;

    fn set_params(&mut self, parameters: &DVector<f64>) {
        self.parameters.copy_from(parameters);
        (self.residuals, self.jacobian) = (self.evaluate)(parameters);
    }

    fn params(&self) -> DVector<f64> {
        self.parameters.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        Some(self.residuals.clone())
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        Some(self.jacobian.clone())
    }
}

fn squared(x: f64) -> f64 {
    x * x
}

fn round2(x: f64) -> f64 {
    libm::round(100.0 * x) / 100.0
}

fn round3(x: f64) -> f64 {
    libm::round(1_000.0 * x) / 1_000.0
}
