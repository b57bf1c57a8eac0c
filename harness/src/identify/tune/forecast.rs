//! What a loop will do: a controller, and what its closed loop foretells.

use std::fmt;

use serde::Serialize;
use torno_identify::design::{Lead, Pid, Printed, Structure};
use torno_identify::discrete::Discrete;
use torno_identify::{Complex, Finding, FirstOrder, response};
use torno_machines::motor::{Form, Law, Motor};

/// Samples of a step response that is looked at, at least; and in time constants of the motor.
const SAMPLES: (usize, f64) = (400, 12.0);
/// And in time constants of its slowest pole.
const POLES: f64 = 8.0;
/// So many at most.
const LONGEST: usize = 100_000;

/// A controller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Controller {
    /// For speed.
    Lead(Lead),
    /// For position.
    Pid(Pid),
}

impl Controller {
    /// The controller that a law's values make.
    pub const fn of(law: &Law) -> Option<Self> {
        match law {
            Law::Lead([(_, alpha), (_, beta), (_, k)]) => Some(Self::Lead(Lead { alpha: *alpha, beta: *beta, k: *k })),
            Law::Pid([(_, k1), (_, k2), (_, k3)]) => Some(Self::Pid(Pid { k1: *k1, k2: *k2, k3: *k3 })),
            Law::OnOff => None,
        }
    }

    /// One with this phase margin, in degrees, its values rounded as they are told.
    pub(super) fn design(axis: bool, model: &FirstOrder, period: f64, margin: f64) -> Result<Self, Finding> {
        Ok(if axis {
            Self::of_parts(Structure::Pid, model, period, margin)?
        } else {
            let Lead { alpha, beta, k } = Lead::design(model, period, margin)?;
            Self::Lead(Lead { alpha: rounded(alpha), beta: rounded(beta), k: rounded(k) })
        })
    }

    /// A PID of these parts only.
    pub(super) fn of_parts(
        structure: Structure,
        model: &FirstOrder,
        period: f64,
        margin: f64,
    ) -> Result<Self, Finding> {
        let Pid { k1, k2, k3 } = Pid::design_as(structure, model, period, margin)?;
        Ok(Self::Pid(Pid { k1: rounded(k1), k2: rounded(k2), k3: rounded(k3) }))
    }

    pub(super) fn open_loop(&self, model: &FirstOrder, period: f64) -> Discrete {
        match self {
            Self::Lead(lead) => lead.open_loop(model, period),
            Self::Pid(pid) => pid.open_loop(model, period),
        }
    }

    /// The values, in the order of the law's settings.
    pub(super) const fn values(&self) -> [f64; 3] {
        match self {
            Self::Lead(lead) => [lead.alpha, lead.beta, lead.k],
            Self::Pid(pid) => [pid.k1, pid.k2, pid.k3],
        }
    }
}

impl fmt::Display for Controller {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lead(Lead { alpha, beta, k }) => write!(f, "alpha {alpha}, beta {beta}, k {k}"),
            Self::Pid(Pid { k1, k2, k3 }) => write!(f, "k1 {k1}, k2 {k2}, k3 {k3}"),
        }
    }
}

/// Four digits.
fn rounded(number: f64) -> f64 {
    format!("{number:.3e}").parse().unwrap_or(number)
}

/// What a loop will do.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Forecast {
    /// The closed loop's poles in z: real and imaginary parts, the largest modulus first.
    pub poles: Vec<[f64; 2]>,
    /// Where the open loop's gain is 1, in rad/s; none if it is below 1 at every frequency.
    pub crossover_rad_per_s: Option<f64>,
    /// In degrees.
    pub phase_margin_deg: Option<f64>,
    /// In dB; none if no gain is too much.
    pub gain_margin_db: Option<f64>,
    /// The time by which the loop may still be late, in s.
    pub delay_margin_s: Option<f64>,
    /// The least damping of the closed loop's poles; 1 if none oscillates.
    pub damping: f64,
    /// The response to a step so small that the drive stays off its limits.
    pub small_step: Option<Indices>,
    /// What is missing in the end, in % of the set point; none if nothing is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub standing_error_percent: Option<f64>,
}

/// What one says of a step response.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Indices {
    /// From 10 to 90 %, in s.
    pub rise_s: f64,
    /// To within 2 %, in s.
    pub settling_s: f64,
    /// In % of the step.
    pub overshoot_percent: f64,
}

impl From<response::StepResponse> for Indices {
    fn from(found: response::StepResponse) -> Self {
        let response::StepResponse { rise, settling, overshoot } = found;
        Self { rise_s: rise, settling_s: settling, overshoot_percent: 100.0 * overshoot }
    }
}

impl Forecast {
    /// Of a controller for a motor.
    ///
    /// # Errors
    /// [`Finding::Unstable`] if the loop is.
    pub fn of(controller: &Controller, model: &FirstOrder, period: f64) -> Result<Self, Finding> {
        Self::of_loop(&controller.open_loop(model, period), model)
    }

    /// Of an open loop with this motor.
    pub(super) fn of_loop(open: &Discrete, model: &FirstOrder) -> Result<Self, Finding> {
        response::check_stable(open)?;
        let margins = response::margins(open);
        let points = small_step(open, model);
        // A loop without an integrator settles, too, only elsewhere.
        let end = open.closed().at(Complex::new(1.0, 0.0)).re;
        Ok(Self {
            poles: open.closed_poles().iter().map(|pole| [pole.re, pole.im]).collect(),
            crossover_rad_per_s: margins.map(|margins| margins.crossover),
            phase_margin_deg: margins.map(|margins| margins.phase),
            gain_margin_db: margins.and_then(|margins| margins.gain_db()),
            delay_margin_s: margins.map(|margins| margins.delay()),
            damping: response::damping(open),
            small_step: response::of_step(&points, 0.0, end).map(Indices::from),
            standing_error_percent: Some(100.0 * (1.0 - end)).filter(|error| error.abs() > 1e-6),
        })
    }
}

/// What a speed does that nothing regulates: the drive is what the set point takes.
pub(super) fn without_loop(model: &FirstOrder, period: f64) -> Option<Indices> {
    let motor = Discrete::counted_speed(model, period);
    let long = (SAMPLES.1 * model.tau / period) as usize;
    let step = motor.step(long.clamp(SAMPLES.0, LONGEST)).into_iter().map(|y| y / model.gain);
    let points: Vec<(f64, f64)> = (0..).zip(step).map(|(n, y)| (period * f64::from(n), y)).collect();
    response::of_step(&points, 0.0, 1.0).map(Indices::from)
}

/// The response to a step of 1 of a loop that is closed: times in s, and shares.
pub(super) fn small_step(open: &Discrete, model: &FirstOrder) -> Vec<(f64, f64)> {
    let step = open.closed().step(samples(open, model));
    (0..).zip(step).map(|(n, y)| (open.period * f64::from(n), y)).collect()
}

/// How long its slowest pole takes, too.
fn samples(open: &Discrete, model: &FirstOrder) -> usize {
    let (least, taus) = SAMPLES;
    let slowest = open.closed_poles().first().map_or(0.0, |pole| libm::hypot(pole.re, pole.im));
    let long = (taus * model.tau / open.period).max(POLES / (1.0 - slowest).max(1e-9));
    least.max(long as usize).min(LONGEST)
}

/// The loop as the board has it now, in whatever form; None if there is none.
pub(super) fn present_loop(motor: &Motor, model: &FirstOrder, period: f64) -> Option<Discrete> {
    let controller = Controller::of(&motor.law)?;
    let printed = match (motor.printed, controller) {
        (None, _) => return Some(controller.open_loop(model, period)),
        (Some(Form::Lead), Controller::Lead(lead)) => Printed::Lead(lead),
        (Some(Form::Pid), Controller::Pid(pid)) => Printed::Pid(pid),
        (Some(Form::Proportional(k)), _) => Printed::Proportional(k),
        _ => return None,
    };
    Some(printed.open_loop(model, period))
}
