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
