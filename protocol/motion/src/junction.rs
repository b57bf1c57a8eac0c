//! How fast the junction of two blocks is taken.

use crate::limits::{AXES, Limits, unit};

/// Directions whose cosine is nearer to 1 or -1 than this are opposite or the same.
const STRAIGHT: f64 = 1e-6;

/// The square of the junction's speed, (mm/s)², from the directions before and after it.
///
/// The rule is the junction deviation of "Improving Grbl: Cornering Algorithm": a circle touches both blocks, and its
/// edge is `junction_deviation` away from the corner. The speed is that at which the acceleration towards the circle's
/// centre is the limit. With half the angle between the blocks, the radius is d·sin/(1−sin). The acceleration is that
/// of the axes along the difference of the directions. A reversal is a full stop; a straight line has no limit.
pub(crate) fn speed_squared(before: &[f64; AXES], after: &[f64; AXES], limits: &Limits) -> f64 {
    let cos = -before.iter().zip(after).map(|(before, after)| before * after).sum::<f64>();
    if cos > 1.0 - STRAIGHT {
        return 0.0;
    }
    if cos < STRAIGHT - 1.0 {
        return f64::INFINITY;
    }
    let (towards_centre, _) = unit(core::array::from_fn(|n| after[n] - before[n]));
    let acceleration = limits.along(&towards_centre, |axis| axis.acceleration);
    let sin_half = libm::sqrt(0.5 * (1.0 - cos));
    acceleration * limits.junction_deviation * sin_half / (1.0 - sin_half)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::AxisLimits;

    #[test]
    fn a_corner_is_taken_at_the_speed_of_its_circle() {
        let axis = |acceleration| AxisLimits { steps_per_mm: 250.0, max_rate: 3000.0, acceleration };
        let limits = Limits { axes: [500.0, 500.0, 200.0, 10.0].map(axis), junction_deviation: 0.01 };
        let speed = |before, after| libm::sqrt(speed_squared(&before, &after, &limits));
        let (x, y, z) = ([1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]);
        // 500·√2 mm/s² across the corner, and a circle of 0.01·2.4142 mm.
        assert!((speed(x, y) - 4.1317).abs() < 1e-4);
        // Z is the weaker axis.
        assert!((speed(x, z) - 2.6131).abs() < 1e-4);
        assert_eq!(speed(x, [-1.0, 0.0, 0.0, 0.0]), 0.0);
        assert_eq!(speed(x, x), f64::INFINITY);
    }
}
