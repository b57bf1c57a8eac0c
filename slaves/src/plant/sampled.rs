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
    fn each_sample_follows_the_difference_equation() {
        let mut plant = SampledPlant::new(0.5, 0.25, 1.5, 0.75, 100.0);
        let (mut y, mut u) = ([0.0, 0.0], 0.0);
        for input in [4.0, -2.0, 8.0, 0.0, 0.0, 3.0] {
            let next = 1.5 * y[0] - 0.75 * y[1] + 0.5 * (input + 0.25 * u);
            (y, u) = ([next, y[0]], input);
            plant.step(input);
            assert!((plant.position() - next).abs() < 1e-12, "{} {next}", plant.position());
        }
    }

    #[test]
    fn it_goes_no_further_than_its_ends() {
        for sign in [1.0, -1.0] {
            let mut plant = SampledPlant::new(1.0, 0.0, 1.0, 0.0, 5.0);
            let mut ends = [3.0, 1.5, 1.0].map(|input| {
                plant.step(sign * input);
                (plant.position(), plant.end_stop())
            });
            ends[1].0 *= sign;
            assert_eq!(ends, [(3.0 * sign, 0), (4.5, 0), (5.0 * sign, sign as i64)]);
        }
    }

    #[test]
    fn it_rests_only_without_input_and_without_motion() {
        // An integrator of this input and of the one before. Smaller than a millionth, it comes to rest at 0.
        let plant = || SampledPlant::new(1.0, 1.0, 1.0, 0.0, 5.0);
        let mut moves = plant();
        assert!(moves.is_at_rest());
        moves.step(2e-6);
        assert!(!moves.is_at_rest(), "there was an input");
        moves.step(0.0);
        assert!(!moves.is_at_rest(), "the output before was another");
        moves.step(0.0);
        assert!(moves.is_at_rest() && moves.position() == 4e-6);
        let mut settles = plant();
        let places = [0.4e-6, 0.0, 0.0].map(|input| {
            settles.step(input);
            settles.position()
        });
        assert_eq!(places, [0.4e-6, 0.8e-6, 0.0]);
        // A millionth itself is not smaller.
        let mut stays = plant();
        [STANDS, 0.0, 0.0].into_iter().for_each(|input| stays.step(input));
        assert_eq!(stays.position(), 2.0 * STANDS);
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
