//! A first-order lag and its integral, in closed form.

use torno_protocol::time::Span;

/// τ·dv/dt = v∞ − v, solved exactly for a v∞ that is held (Eq. 2).
#[derive(Clone, Debug)]
pub(super) struct Lag {
    tau_s: f64,
    rate: f64,
    /// e^(−dt/τ) for the last two lengths of dt: a clock that is off makes ticks of two lengths, a nanosecond apart.
    factors: [(Span, f64); 2],
}

impl Lag {
    /// Standing still.
    pub(super) const fn new(tau_s: f64) -> Self {
        Self { tau_s, rate: 0.0, factors: [(Span::ZERO, 1.0); 2] }
    }

    /// What is lagging, per second.
    pub(super) const fn rate(&self) -> f64 {
        self.rate
    }

    /// Brings the rate to zero at once.
    pub(super) const fn stop(&mut self) {
        self.rate = 0.0;
    }

    /// Lets `dt` pass with the rate tending to `toward`; gives the integral of the rate.
    pub(super) fn step(&mut self, dt: Span, toward: f64) -> f64 {
        let factor = self.factor(dt);
        let excess = self.rate - toward;
        self.rate = toward + excess * factor;
        toward * dt.as_secs_f64() + excess * self.tau_s * (1.0 - factor)
    }

    /// The integral of the rate from now on if it tends to zero.
    pub(super) fn coast(&self) -> f64 {
        self.rate * self.tau_s
    }

    /// The time after which the rate passes through zero on its way to `toward`, if it does.
    pub(super) fn turning(&self, toward: f64) -> Option<Span> {
        if self.rate * toward >= 0.0 {
            return None;
        }
        let seconds = self.tau_s * libm::log(1.0 - self.rate / toward);
        Some(Span::from_nanos((seconds * 1e9) as u64))
    }

    /// The time in s after which the rate is zero on its way to `toward`, if it gets there.
    pub(super) fn standstill_s(&self, toward: f64) -> Option<f64> {
        (self.rate * toward < 0.0).then(|| self.tau_s * libm::log1p(-self.rate / toward))
    }

    /// Lets the time pass that [`Lag::standstill_s`] gave; gives the integral of the rate, which is zero then.
    pub(super) const fn come_to_rest(&mut self, standstill_s: f64, toward: f64) -> f64 {
        let way = toward * standstill_s + self.rate * self.tau_s;
        self.rate = 0.0;
        way
    }

    /// As [`Lag::step`], for a time that is no whole number of nanoseconds.
    pub(super) fn pass(&mut self, seconds: f64, toward: f64) -> f64 {
        let gone = -libm::expm1(-seconds / self.tau_s);
        let excess = self.rate - toward;
        self.rate -= excess * gone;
        toward * seconds + excess * self.tau_s * gone
    }

    fn factor(&mut self, dt: Span) -> f64 {
        if let Some((_, factor)) = self.factors.iter().find(|(length, _)| *length == dt) {
            return *factor;
        }
        let factor = libm::exp(-dt.as_secs_f64() / self.tau_s);
        self.factors = [(dt, factor), self.factors[0]];
        factor
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eq. 6 holds for 32 ms, although the text says 30 ms.
    #[test]
    fn equation_6_is_this_lag_over_32_ms() {
        let mut lag = Lag::new(2.8);
        assert!((lag.factor(Span::from_millis(32)) - 0.988_636_487).abs() < 1e-9);
        lag.step(Span::from_millis(32), 19.0);
        assert!((lag.rate() - 0.215_906_753).abs() < 1e-8);
    }

    #[test]
    fn one_long_step_is_many_short_ones() {
        let (mut long, mut short) = (Lag::new(0.7), Lag::new(0.7));
        let travelled = long.step(Span::from_millis(900), 5.0);
        let sum: f64 = [100, 350, 50, 400].iter().map(|ms| short.step(Span::from_millis(*ms), 5.0)).sum();
        assert!((travelled - sum).abs() < 1e-12);
        assert!((long.rate() - short.rate()).abs() < 1e-12);
    }

    #[test]
    fn coasting_for_ever_covers_what_coast_says() {
        let mut lag = Lag::new(0.05);
        lag.step(Span::from_secs(1), 4.0);
        let coast = lag.coast();
        assert!((lag.step(Span::from_secs(10), 0.0) - coast).abs() < 1e-12);
    }

    /// From rate 8·(1 − e^−2) = 6.917, over one time constant or two.
    fn moving() -> Lag {
        let mut lag = Lag::new(0.5);
        lag.step(Span::from_secs(1), 8.0);
        lag
    }

    fn near(found: f64, expected: f64) {
        assert!((found - expected).abs() < 1e-9, "{found}, not {expected}");
    }

    #[test]
    fn a_step_covers_the_integral_of_the_rate() {
        let gone = |taus: f64| 1.0 - libm::exp(-taus);
        let mut lag = Lag::new(0.5);
        near(lag.step(Span::from_secs(1), 8.0), 8.0 - 8.0 * 0.5 * gone(2.0));
        let rate = 8.0 * gone(2.0);
        near(lag.rate(), rate);
        near(lag.coast(), rate * 0.5);
        near(lag.step(Span::from_millis(500), -3.0), -1.5 + (rate + 3.0) * 0.5 * gone(1.0));
        near(lag.rate(), -3.0 + (rate + 3.0) * libm::exp(-1.0));
        lag.stop();
        assert_eq!((lag.rate(), lag.coast()), (0.0, 0.0));
    }

    #[test]
    fn passing_is_stepping_for_any_time() {
        for (seconds, toward) in [(0.25, -3.0), (0.5, 3.0), (1.75, 0.0)] {
            let (mut passes, mut steps) = (moving(), moving());
            let way = steps.step(Span::from_nanos((seconds * 1e9) as u64), toward);
            near(passes.pass(seconds, toward), way);
            near(passes.rate(), steps.rate());
        }
    }

    #[test]
    fn it_comes_to_rest_where_a_step_of_that_time_does() {
        let (mut rests, mut passes) = (moving(), moving());
        let standstill_s = rests.standstill_s(-3.0).unwrap();
        near(standstill_s, 0.5 * libm::log(1.0 + rests.rate() / 3.0));
        near(rests.come_to_rest(standstill_s, -3.0), passes.pass(standstill_s, -3.0));
        assert_eq!(rests.rate(), 0.0);
        near(passes.rate(), 0.0);
        for toward in [3.0, 0.0, -0.0] {
            assert_eq!((moving().standstill_s(toward), moving().turning(toward)), (None, None));
        }
        let turning = moving().turning(-3.0).unwrap().as_nanos();
        assert_eq!(turning, (standstill_s * 1e9) as u64);
    }

    #[test]
    fn the_last_two_lengths_are_remembered() {
        let mut lag = Lag::new(0.5);
        let expected = |ms: u64| libm::exp(-(ms as f64) / 500.0);
        for ms in [30, 31, 30, 32, 31, 30] {
            near(lag.factor(Span::from_millis(ms)), expected(ms));
        }
        assert_eq!(lag.factors.map(|(length, _)| length), [Span::from_millis(30), Span::from_millis(32)]);
    }

    #[test]
    fn it_turns_when_it_says() {
        let mut lag = Lag::new(0.5);
        assert_eq!(lag.turning(-3.0), None);
        lag.step(Span::from_secs(1), 4.0);
        assert_eq!(lag.turning(1.0), None);
        let turning = lag.turning(-3.0).unwrap();
        lag.step(turning, -3.0);
        assert!(lag.rate().abs() < 1e-7);
    }
}
