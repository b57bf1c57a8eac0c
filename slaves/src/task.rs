//! A machine with the timer that samples it: what a board does for its motor, whoever tells it what to do.

use torno_protocol::board::{Heeds, Signal, Stimulus};
use torno_protocol::clock::Clock;
use torno_protocol::time::Instant;

use crate::machine::{Machine, Progress, QUANTITIES};
use crate::schedule::Schedule;
use crate::telemetry::Telemetry;

/// A machine with the timer that samples it.
///
/// A board of several motors handles its tasks as `Task<dyn Machine>`.
#[derive(Clone, Debug)]
pub struct Task<M: ?Sized> {
    schedule: Schedule,
    telemetry: Telemetry<QUANTITIES>,
    machine: M,
}

impl<M: Machine> Task<M> {
    /// As at power-on: the motor stands, an axis in mid-travel.
    pub fn new(settings: &M::Settings, clock: Clock) -> Self {
        let (machine, period_ms) = M::new(settings);
        let telemetry = Telemetry::new(machine.values());
        let mut task = Self { schedule: Schedule::new(period_ms, clock), telemetry, machine };
        // A load may move the axis that nobody drives.
        task.sample_unless_at_rest(Instant::START);
        task
    }

    /// Starts to execute a sub-frame.
    pub fn start(&mut self, now: Instant, part: M::Part) {
        self.machine.start(now, part);
        self.schedule.start(now);
    }
}

impl<M: Machine + ?Sized> Task<M> {
    /// The machine's quantities. At power-on each is 0: the firmware counts from where the axis stands.
    pub fn signals(&self) -> Vec<Signal> {
        self.machine.signals().iter().map(|name| Signal::new(name, 0)).collect()
    }

    /// What the machine heeds of the stimuli that mean nothing to some.
    pub fn heeds(&self) -> &'static [Heeds] {
        self.machine.heeds()
    }

    /// Something happens to the machine, its supply, its firmware or its oscillator.
    pub fn stimulus(&mut self, now: Instant, stimulus: &Stimulus) {
        match stimulus {
            Stimulus::Stall(_)
            | Stimulus::Counts(_)
            | Stimulus::Load(_)
            | Stimulus::Supply(_)
            | Stimulus::Backlash(_)
            | Stimulus::EndStop(_)
            | Stimulus::Drive(_) => {
                self.machine.plant().disturb(now, stimulus);
                if let Stimulus::Drive(per_mille) = stimulus {
                    self.machine.serve(*per_mille);
                }
            }
            Stimulus::Reset => self.machine.reset(now),
            Stimulus::Power(_) => {
                self.machine.plant().restart(now);
                self.machine.reset(now);
                self.schedule.stop();
            }
            Stimulus::Clock(clock) => self.schedule.retune(now, *clock),
            // The stepping loop sees to the first three; the others are for PCs, and for boards of several motors.
            Stimulus::Hang(_) | Stimulus::Slow(_) | Stimulus::Stop(_) => {}
            Stimulus::Write(_) | Stimulus::Discard | Stimulus::Configure { .. } | Stimulus::Of(..) => {}
        }
        self.sample_unless_at_rest(now);
    }

    /// The next sample, if it is due. `busy`: a sub-frame is being executed.
    pub fn sample(&mut self, now: Instant, busy: bool) -> Progress {
        if !self.schedule.take(now) {
            return Progress::Going;
        }
        let progress = self.machine.sample(now, busy);
        if (!busy || progress != Progress::Going) && self.machine.is_at_rest() {
            self.schedule.stop();
        }
        progress
    }

    /// A quantity that has changed: its place among the signals, and its value.
    pub fn poll_telemetry(&mut self) -> Option<(u8, i64)> {
        self.telemetry.poll(self.machine.values())
    }

    /// When the next sample is due.
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.schedule.poll_timeout()
    }

    /// A sample may fail although no sub-frame is being executed.
    pub fn is_on_watch(&self) -> bool {
        self.machine.is_on_watch()
    }

    fn sample_unless_at_rest(&mut self, now: Instant) {
        if !self.machine.is_at_rest() {
            self.schedule.start(now);
        }
    }
}

#[cfg(test)]
mod tests {
    use torno_protocol::time::Span;

    use super::*;
    use crate::DepthTask;
    use crate::settings::DepthSettings;

    #[test]
    fn an_axis_that_a_torque_moves_is_sampled_once_its_shaft_is_free() {
        let mut settings = DepthSettings::default();
        settings.plant.load_torque = 0.5;
        let mut task = DepthTask::new(&settings, Clock::TRUE);
        task.stimulus(Instant::START, &Stimulus::Stall(true));
        task.sample(Instant::START, false);
        assert_eq!(task.poll_timeout(), None, "blocked it stands");
        let later = Instant::START + Span::from_secs(1);
        task.stimulus(later, &Stimulus::Stall(false));
        assert_eq!(task.poll_timeout(), Some(later));
    }
}
