//! What the loop in the firmware decides on an error.
//!
//! err = issued pulses · pulse − counts · count, in whole picometres. The paper gives the idea of a loop every N
//! pulses; what it does about an error, and when it gives up, is ours.

use torno_protocol::time::Span;
use torno_protocol::train::Train;

use crate::scale::Scale;
use crate::settings::{AxisSettings, Law, Mode};
use crate::watch::Checks;

/// Why the loop gives up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Cause {
    /// Corrections bring nothing.
    Stalled,
    /// The error exceeds what is allowed.
    TooFar,
}

/// The stop in a row with nothing to correct after which what is left is corrected. (Ours.)
const VAIN_MAX: u32 = 3;

/// What is to be done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// Nothing.
    Quiet,
    /// So many pulses are added, with their sense.
    Correct(i64),
    /// Everything stops.
    GiveUp(Cause),
}

/// The loop's constants, and the tries since it last got on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ClosedLoop {
    pub(crate) mode: Mode,
    pub(crate) law: Law,
    pub(crate) settle: Span,
    /// The least error that is corrected, in pm.
    pub(crate) least: i64,
    /// The largest error that is not an alarm, in pm.
    pub(crate) stop: i64,
    /// Pulses that make up for backlash.
    pub(crate) backlash: i64,
    pulses: i64,
    period_ns: u64,
    pulse_pm: i64,
    half_count: i64,
    correct_hz: f64,
    tries: u32,
    tries_max: u32,
    best: Option<i64>,
    /// Stops in a row after which there was nothing to correct.
    vain: u32,
}

impl ClosedLoop {
    pub(crate) fn new(settings: &AxisSettings, scale: &Scale) -> Self {
        let control = &settings.control;
        let or = |pulses: u32, otherwise: u32| if pulses == 0 { otherwise } else { pulses };
        let pulses = or(control.pulses, scale.least_pulses());
        let dead_band = or(control.dead_band_pulses, or(control.pulses, scale.dead_band_pulses()));
        let pm = |mm: f64| libm::round(mm * 1e9) as i64;
        Self {
            mode: control.mode,
            law: control.law,
            settle: Span::from_nanos(libm::round(control.settle_ms * 1e6) as u64),
            least: i64::from(dead_band).saturating_mul(scale.pulse_pm),
            stop: pm(control.stop_mm),
            backlash: libm::round(pm(control.backlash_mm) as f64 / scale.pulse_pm as f64) as i64,
            pulses: pulses.into(),
            period_ns: (libm::round(control.period_ms * 1e6) as u64).max(1),
            pulse_pm: scale.pulse_pm,
            half_count: scale.firmware_count_pm / 2,
            correct_hz: control.correct_hz,
            tries: 0,
            tries_max: control.tries,
            best: None,
            vain: 0,
        }
    }

    /// When there are checks while the program runs.
    pub(crate) const fn checks(&self) -> Option<Checks> {
        match self.mode {
            Mode::Open => None,
            Mode::Fixed => Some(Checks::Nanos(self.period_ns)),
            Mode::Dynamic => Some(Checks::Pulses(self.pulses)),
        }
    }

    /// When there are checks while pulses are added: they must not lead astray.
    pub(crate) const fn checks_of_added(&self) -> Checks {
        Checks::Added(self.pulses)
    }

    /// The largest error that does not stop added pulses if the error is this before them, in pm.
    ///
    /// Where an encoder counts the wrong way, they make the error larger. So that the carriage does not go further than
    /// [`Self::stop`] even between two checks and within a count, they stop before; but not while the error falls.
    pub(crate) const fn stop_of_added(&self, error: i64) -> i64 {
        let before = self.stop - (self.pulses * self.pulse_pm + 2 * self.half_count);
        let grown = error.saturating_abs() + 2 * self.half_count;
        if before > grown { before } else { grown }
    }

    /// How many checks there have been when so many pulses are issued, so many nanoseconds after the start.
    pub(crate) const fn checks_until(&self, issued: i64, nanos: u64) -> u64 {
        match self.mode {
            Mode::Open => 0,
            Mode::Fixed => nanos / self.period_ns,
            Mode::Dynamic => (issued / self.pulses).unsigned_abs(),
        }
    }

    /// The loop begins again with its tries.
    pub(crate) const fn restart(&mut self) {
        (self.tries, self.best) = (0, None);
    }

    /// Whether a check finds this error.
    pub(crate) const fn finds(&self, error: i64) -> bool {
        error.unsigned_abs() >= self.least.unsigned_abs()
    }

    /// What is to be done about this error.
    pub(crate) fn judge(&mut self, error: i64) -> Verdict {
        let size = error.saturating_abs();
        if size > self.stop {
            return Verdict::GiveUp(Cause::TooFar);
        }
        if !self.finds(error) {
            let is_first = self.best.is_none();
            self.restart();
            return if is_first { self.stop_in_vain(error) } else { Verdict::Quiet };
        }
        self.vain = 0;
        match self.best {
            Some(best) if best - size < self.half_count => self.tries += 1,
            _ => (self.tries, self.best) = (0, Some(size)),
        }
        if self.tries > self.tries_max {
            return Verdict::GiveUp(Cause::Stalled);
        }
        Verdict::Correct(error.signum() * ((size + self.pulse_pm / 2) / self.pulse_pm))
    }

    /// At rest, an error is smaller than in motion, and a stop may find nothing to correct. If that happens thrice in a
    /// row, what is left is corrected although it is small: else the loop would stop again and again. That may be less
    /// than the encoder tells for certain, but three stops in a row say that something is left. Half a pulse is the
    /// least that a pulse makes better.
    fn stop_in_vain(&mut self, error: i64) -> Verdict {
        self.vain += 1;
        if self.vain < VAIN_MAX || 2 * error.saturating_abs() < self.pulse_pm {
            return Verdict::Quiet;
        }
        (self.vain, self.best) = (0, Some(error.saturating_abs()));
        Verdict::Correct(error.signum() * ((error.saturating_abs() + self.pulse_pm / 2) / self.pulse_pm))
    }

    /// The train of `pulses` that are added; at the rate of the program's, if there is one.
    pub(crate) fn added(&self, first: torno_protocol::time::Instant, pulses: i64, program_hz: Option<f64>) -> Train {
        let hz = match self.law {
            Law::AtOnce => program_hz.unwrap_or(self.correct_hz),
            Law::Pause => self.correct_hz,
        };
        let nanos = (libm::round(1e9 / hz) as u64).max(1);
        Train { first, nanos, per: 1, count: pulses.unsigned_abs(), high: Span::from_nanos(nanos / 2) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paper() -> ClosedLoop {
        let settings = AxisSettings::default();
        ClosedLoop::new(&settings, &settings.scale())
    }

    #[test]
    fn an_error_of_four_pulses_is_corrected_by_the_nearest_number_of_pulses() {
        let judged = |error| paper().judge(error);
        assert_eq!([judged(9_999_999), judged(-9_999_999)], [Verdict::Quiet; 2]);
        assert_eq!([10_000_000, -10_000_000, 11_250_000, 11_249_999].map(judged), [4, -4, 5, 4].map(Verdict::Correct));
        assert_eq!(judged(1_000_000_000), Verdict::Correct(400));
        assert_eq!([1_000_000_001, -1_000_000_001].map(judged), [Verdict::GiveUp(Cause::TooFar); 2]);
    }

    #[test]
    fn three_stops_in_vain_correct_what_is_half_a_pulse_or_more() {
        let judged = |error| {
            let mut control = paper();
            [0; 4].map(|_| {
                control.restart();
                control.judge(error)
            })
        };
        use Verdict::{Correct, Quiet};
        assert_eq!(judged(1_249_999), [Quiet; 4]);
        assert_eq!(judged(1_250_000), [Quiet, Quiet, Correct(1), Quiet]);
        assert_eq!(judged(-4_125_000), [Quiet, Quiet, Correct(-2), Quiet]);
    }

    #[test]
    fn a_correction_and_ten_tries_without_half_a_count_are_given_up() {
        let mut control = paper();
        assert!((0..=10).all(|_| control.judge(12_000_000) == Verdict::Correct(5)));
        assert_eq!(control.judge(12_000_000), Verdict::GiveUp(Cause::Stalled));
        // Half a count is enough to go on trying.
        let mut control = paper();
        assert!((0..100).all(|n| control.judge(900_000_000 - n * 4_125_000) != Verdict::GiveUp(Cause::Stalled)));
        let mut control = paper();
        let gave_up = (0..100).find(|n| control.judge(900_000_000 - n * 375_000) == Verdict::GiveUp(Cause::Stalled));
        // The eleventh step of these is half a count.
        assert_eq!(gave_up, None);
        let mut control = paper();
        let gave_up = (0..100).find(|n| control.judge(900_000_000 - n * 374_999) == Verdict::GiveUp(Cause::Stalled));
        assert_eq!(gave_up, Some(11));
    }
}
