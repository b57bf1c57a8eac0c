//! What the machine can do.

/// How many axes there can be. Those that a machine does not have stay at 0.
pub const AXES: usize = 4;

/// The limits of one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisLimits {
    /// Steps for a millimetre, or for a degree: GRBL's `$100` and on.
    pub steps_per_mm: f64,
    /// mm a minute: `$110` and on.
    pub max_rate: f64,
    /// mm/s²: `$120` and on.
    pub acceleration: f64,
}

/// The limits of the machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// X, Y, Z, A.
    pub axes: [AxisLimits; AXES],
    /// mm: `$11`, 0.010 by default. The larger it is, the faster a corner is taken.
    pub junction_deviation: f64,
}

/// Least steps for a millimetre, mm a minute and mm/s². A planner raises what is below, so that each motion has an end.
const LEAST: AxisLimits = AxisLimits { steps_per_mm: 1e-3, max_rate: 1.0, acceleration: 1e-2 };

impl Limits {
    /// Limits with which each motion has an end.
    pub(crate) fn usable(mut self) -> Self {
        let usable = |value: f64, least: f64| if value.is_finite() { value.max(least) } else { least };
        for axis in &mut self.axes {
            axis.steps_per_mm = usable(axis.steps_per_mm, LEAST.steps_per_mm);
            axis.max_rate = usable(axis.max_rate, LEAST.max_rate);
            axis.acceleration = usable(axis.acceleration, LEAST.acceleration);
        }
        self.junction_deviation = usable(self.junction_deviation, 0.0);
        self
    }

    /// The largest value along a direction with which no axis exceeds its own `limit`.
    pub(crate) fn along(&self, direction: &[f64; AXES], limit: impl Fn(&AxisLimits) -> f64) -> f64 {
        let axes = self.axes.iter().zip(direction).filter(|(_, part)| **part != 0.0);
        axes.map(|(axis, part)| limit(axis) / part.abs()).fold(f64::INFINITY, f64::min)
    }
}

/// A direction of length 1, and the length that it had.
pub(crate) fn unit(vector: [f64; AXES]) -> ([f64; AXES], f64) {
    let length = libm::sqrt(vector.iter().map(|part| part * part).sum());
    (vector.map(|part| part / length), length)
}
