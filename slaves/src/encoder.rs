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
        let slots = self.slots(position);
        // The floor: where the processor has no instruction for it, this is quicker than the call.
        let whole = slots as i64;
        if whole as f64 > slots { whole.saturating_sub(1) } else { whole }
    }

    /// How many slots have passed at `position`, and what part of the next one.
    pub(crate) fn slots(self, position: f64) -> f64 {
        position * self.slots_per_unit + 0.5
    }

    /// What so many counts are in units of position.
    pub(crate) fn way(self, counts: i32) -> f64 {
        f64::from(counts) / self.slots_per_unit
    }
}

/// The firmware's count of what an encoder shows: it can be wrong, and is lost with the supply.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Counter {
    encoder: Encoder,
    /// What the firmware counts beyond what the encoder shows.
    skew: i64,
    shown: i64,
    /// The sense in which it counted last.
    sense: i64,
}

impl Counter {
    pub(crate) const fn new(encoder: Encoder) -> Self {
        Self { encoder, skew: 0, shown: 0, sense: 1 }
    }

    /// Follows the encoder to `position`; gives the count.
    pub(crate) fn count(&mut self, position: f64) -> i64 {
        let shown = self.encoder.count(position);
        if shown != self.shown {
            self.sense = (shown - self.shown).signum();
        }
        self.shown = shown;
        self.shown.saturating_add(self.skew)
    }

    /// What the count would be at `position`.
    pub(crate) fn count_at(&self, position: f64) -> i64 {
        self.encoder.count(position).saturating_add(self.skew)
    }

    /// Counts so many more in the sense in which it counted last; fewer if negative.
    pub(crate) fn invent(&mut self, position: f64, counts: i32) {
        self.count(position);
        self.skew = self.skew.saturating_add(self.sense * i64::from(counts));
    }

    /// Counts from 0 again.
    pub(crate) fn restart(&mut self, position: f64) {
        self.count(position);
        self.skew = -self.shown;
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

    #[test]
    fn so_many_counts_are_a_way() {
        assert_eq!([0, 1, -25].map(|counts| Encoder::new(50.0).way(counts)), [0.0, 0.02, -0.5]);
    }

    #[test]
    fn a_counter_that_has_not_counted_yet_invents_upwards() {
        let mut counter = Counter::new(Encoder::new(1.0));
        counter.invent(0.0, 4);
        assert_eq!((counter.count(0.0), counter.count_at(2.0)), (4, 6));
    }

    #[test]
    fn a_counter_is_wrong_in_the_sense_in_which_it_counts() {
        let mut counter = Counter::new(Encoder::new(1.0));
        counter.count(100.0);
        counter.invent(100.0, -3);
        assert_eq!(counter.count(110.0), 107);
        // Downwards, one that loses counts is too high.
        counter.count(90.0);
        counter.invent(80.0, -5);
        assert_eq!((counter.count(80.0), counter.count_at(100.0)), (82, 102));
        counter.restart(70.0);
        assert_eq!(counter.count(75.0), 5);
    }

    /// §4: 50 pulses a revolution counted for 30 ms make 40 rpm a count.
    #[test]
    fn a_window_of_30_ms_at_4000_rpm_has_100_counts() {
        let encoder = Encoder::new(50.0);
        let at = |window: f64| encoder.count(window * 0.030 * 4_000.0 / 60.0 + 0.003);
        assert!((0..1_000).all(|window| at(f64::from(window + 1)) - at(f64::from(window)) == 100));
    }
}
