//! Encoders: a position becomes whole counts.

/// A disc or strip with slots. A count is the number of the slot that the sensor sees.
///
/// At the start the sensor is in the middle of slot 0. (Ours.) Counts take the sign of the true motion. (Ours: the
/// paper reads one channel; with the sense of the drive as the sign, every count made while the loop brakes would be
/// wrong.)
#[derive(Clone, Copy, Debug)]
pub(crate) struct Encoder {
    slots_per_unit: f64,
}

impl Encoder {
    /// An encoder with so many slots in a unit of position.
    pub(crate) const fn new(slots_per_unit: f64) -> Self {
        Self { slots_per_unit }
    }

    /// The count at `position`: whole slots, never rounded to the nearest.
    pub(crate) fn count(self, position: f64) -> i64 {
        (position * self.slots_per_unit + 0.5).floor() as i64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_count_lasts_from_edge_to_edge() {
        let encoder = Encoder::new(50.0);
        let counts = [-0.031, -0.029, -0.011, 0.0, 0.009, 0.011, 0.029, 0.031].map(|at| encoder.count(at));
        assert_eq!(counts, [-2, -1, -1, 0, 0, 1, 1, 2]);
    }

    /// §4: 50 pulses a revolution counted for 30 ms make 40 rpm a count.
    #[test]
    fn a_window_of_30_ms_at_4000_rpm_has_100_counts() {
        let encoder = Encoder::new(50.0);
        let at = |window: f64| encoder.count(window * 0.030 * 4_000.0 / 60.0 + 0.003);
        assert!((0..1_000).all(|window| at(f64::from(window + 1)) - at(f64::from(window)) == 100));
    }
}
