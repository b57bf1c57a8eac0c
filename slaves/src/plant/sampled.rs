//! A plant given as a difference equation of second order, as the paper prints its Eq. 12.

/// y(k) = a1·y(k−1) − a2·y(k−2) + g·(u(k−1) + z·u(k−2)), which is g(z + zero)/(z² − a1·z + a2).
///
/// Printed, 1.958 and 0.9568 in the place of 1.953 and 0.9565 put a pole at 1.0195.
#[derive(Clone, Debug)]
pub(crate) struct SampledPlant {
    gain: f64,
    zero: f64,
    a1: f64,
    a2: f64,
    /// It goes no further either way.
    end: f64,
    outputs: [f64; 2],
    input: f64,
}

/// What is smaller has come to rest.
const STANDS: f64 = 1e-6;

impl SampledPlant {
    /// At rest at 0.
    pub(crate) const fn new(gain: f64, zero: f64, a1: f64, a2: f64, end: f64) -> Self {
        Self { gain, zero, a1, a2, end, outputs: [0.0; 2], input: 0.0 }
    }

    /// The output at this sample.
    pub(crate) const fn position(&self) -> f64 {
        self.outputs[0]
    }

    /// Goes on to the next sample with `input` until then.
    pub(crate) fn step(&mut self, input: f64) {
        let [y1, y2] = self.outputs;
        let next = self.a1 * y1 - self.a2 * y2 + self.gain * (input + self.zero * self.input);
        let next = next.max(-self.end).min(self.end);
        let stands = input == 0.0 && self.input == 0.0 && next.abs() < STANDS && y1.abs() < STANDS;
        self.outputs = if stands { [0.0; 2] } else { [next, y1] };
        self.input = input;
    }

    /// Without an input it stays as it is.
    pub(crate) fn is_at_rest(&self) -> bool {
        let mut next = self.clone();
        next.step(0.0);
        self.input == 0.0 && next.outputs == self.outputs
    }

    /// The end that it has reached: +1, −1 or 0 for none.
    pub(crate) fn end_stop(&self) -> i64 {
        i64::from(self.outputs[0] >= self.end) - i64::from(self.outputs[0] <= -self.end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn with_the_right_coefficients_it_settles_and_as_printed_it_runs_away() {
        let after = |zero: f64, a1: f64, a2: f64| {
            let mut plant = SampledPlant::new(0.001_869_5, zero, a1, a2, 1e4);
            (0..2_000).for_each(|_| plant.step(100.0));
            (plant.position(), plant.end_stop())
        };
        // Rounded to four digits its gain is 1.06 instead of 1.
        assert!((after(0.9853, 1.953, 0.9565).0 - 106.0).abs() < 0.1, "{:?}", after(0.9853, 1.953, 0.9565));
        assert_eq!(after(0.9653, 1.958, 0.9568), (1e4, 1));
    }

    #[test]
    fn left_alone_it_comes_to_rest() {
        let mut plant = SampledPlant::new(0.001_869_5, 0.9853, 1.953, 0.9565, 1e4);
        (0..100).for_each(|_| plant.step(100.0));
        assert!(!plant.is_at_rest());
        (0..3_000).for_each(|_| plant.step(0.0));
        assert!(plant.is_at_rest() && plant.position() == 0.0);
        // One that has run away stays where it is.
        let mut plant = SampledPlant::new(0.001_869_5, 0.9653, 1.958, 0.9568, 1e4);
        (0..2_000).for_each(|_| plant.step(100.0));
        (0..3).for_each(|_| plant.step(0.0));
        assert!(plant.is_at_rest() && plant.end_stop() == 1);
    }
}
