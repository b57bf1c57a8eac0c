//! Dead time: what lies between the firmware's drive and the motor.

use std::collections::VecDeque;

use torno_protocol::time::{Instant, Span};

/// A drive reaches the motor so much later: a delay line of its changes, exact to the nanosecond.
#[derive(Clone, Debug)]
pub(crate) struct DeadTime {
    length: Span,
    /// When each change reaches the motor, in order.
    under_way: VecDeque<(Instant, f64)>,
    /// What was set last.
    set: f64,
}

impl DeadTime {
    /// Of so many ms; the drive is 0.
    pub(crate) fn new(ms: f64) -> Self {
        Self { length: Span::from_nanos(libm::round(ms * 1e6) as u64), under_way: VecDeque::new(), set: 0.0 }
    }

    /// The firmware sets a drive at `now`. Without dead time it is given back, because it has reached the motor.
    pub(crate) fn set(&mut self, now: Instant, drive: f64) -> Option<f64> {
        if self.length == Span::ZERO {
            return Some(drive);
        }
        if drive != self.set {
            self.under_way.push_back((now + self.length, drive));
            self.set = drive;
        }
        None
    }

    /// The next drive that reaches the motor up to `now`, and when.
    pub(crate) fn due(&mut self, now: Instant) -> Option<(Instant, f64)> {
        let due = self.under_way.front().is_some_and(|(at, _)| *at <= now);
        if due { self.under_way.pop_front() } else { None }
    }

    /// What has not reached the motor, and when it will, in order.
    pub(crate) fn under_way(&self) -> impl Iterator<Item = (Instant, f64)> {
        self.under_way.iter().copied()
    }

    /// Some drive has not reached the motor.
    pub(crate) fn is_pending(&self) -> bool {
        !self.under_way.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: u64) -> Instant {
        Instant::from_nanos(ms * 1_000_000)
    }

    #[test]
    fn without_dead_time_a_drive_is_there_at_once() {
        let mut none = DeadTime::new(0.0);
        assert_eq!((none.set(ms(30), 5.0), none.due(ms(900)), none.is_pending()), (Some(5.0), None, false));
    }

    #[test]
    fn a_change_comes_so_much_later_and_once() {
        let mut dead = DeadTime::new(12.5);
        for (at, drive) in [(0, 3.0), (5, 3.0), (10, -2.0)] {
            assert_eq!(dead.set(ms(at), drive), None);
        }
        assert_eq!(dead.due(ms(12)), None);
        let coming = [(Instant::from_nanos(12_500_000), 3.0), (Instant::from_nanos(22_500_000), -2.0)];
        assert!(dead.under_way().eq(coming));
        assert_eq!(dead.due(ms(30)), Some(coming[0]));
        assert!(dead.is_pending());
        assert_eq!(dead.due(ms(30)), Some(coming[1]));
        assert_eq!((dead.due(ms(30)), dead.is_pending()), (None, false));
    }
}
