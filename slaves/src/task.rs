//! A machine with the timer that samples it: what a board does for its motor, whoever tells it what to do.

use torno_protocol::board::{Motor, MotorStimulus, Pin, Role, Signal};
use torno_protocol::clock::Clock;
use torno_protocol::time::Instant;

use crate::machine::{Machine, Progress, QUANTITIES};
use crate::pins::Pins;
use crate::schedule::Schedule;
use crate::telemetry::Telemetry;

/// A machine with the timer that samples it.
///
/// A board of several motors handles its tasks as `Task<dyn Machine>`.
#[derive(Clone, Debug)]
pub struct Task<M: ?Sized> {
    schedule: Schedule,
    telemetry: Telemetry<QUANTITIES>,
    /// If somebody looks at them.
    pins: Option<Box<Pins>>,
    machine: M,
}

impl<M: Machine> Task<M> {
    /// As at power-on: the motor stands, an axis in mid-travel.
    pub fn new(settings: &M::Settings, clock: Clock) -> Self {
        let (machine, timing) = M::new(settings);
        let telemetry = Telemetry::new(machine.values());
        let mut task = Self { schedule: Schedule::new(timing, clock), telemetry, pins: None, machine };
        // A load may move the axis that no one drives.
        task.sample_unless_at_rest(Instant::START);
        task
    }

    /// Starts to execute a sub-frame.
    pub fn start(&mut self, now: Instant, sub_frame: M::SubFrame) {
        self.machine.start(now, sub_frame);
        self.schedule.start(now);
        self.note(now);
    }
}

impl<M: Machine + ?Sized> Task<M> {
    /// The machine's quantities, all of motor 0.
    pub fn signals(&self) -> Vec<Signal> {
        self.machine.signals().to_vec()
    }

    /// The machine's motor, by this name.
    pub fn motor(&self, name: &str) -> Motor {
        Motor { name: name.to_owned(), capabilities: self.machine.capabilities().to_vec() }
    }

    /// Something happens to the motor, or to what it moves.
    pub fn disturb(&mut self, now: Instant, what: &MotorStimulus) {
        self.machine.plant().disturb(now, what);
        if let MotorStimulus::Drive(per_mille) = what {
            self.machine.serve(*per_mille);
        }
        self.sample_unless_at_rest(now);
        self.note(now);
    }

    /// The firmware restarts.
    pub fn reset(&mut self, now: Instant) {
        self.machine.reset(now);
        self.note(now);
    }

    /// The supply goes or comes.
    pub fn power(&mut self, now: Instant) {
        self.machine.plant().restart(now);
        self.machine.reset(now);
        self.schedule.stop();
        self.sample_unless_at_rest(now);
        self.note(now);
    }

    /// Counts in `clock` from the sample on that is to come.
    pub fn retune(&mut self, now: Instant, clock: Clock) {
        self.schedule.retune(now, clock);
        if let Some(pins) = &mut self.pins {
            pins.retune(now, clock);
        }
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
        self.note(now);
        progress
    }

    /// A quantity that has changed: its place among the signals, and its value.
    pub fn poll_telemetry(&mut self) -> Option<(u8, i64)> {
        self.telemetry.poll()
    }

    /// When the next sample is due.
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.schedule.poll_timeout()
    }

    /// A sample may fail although no sub-frame is being executed.
    pub fn is_on_watch(&self) -> bool {
        self.machine.is_on_watch()
    }

    /// Somebody looks at the motor's pins from now on, which is power-on.
    pub fn watch_pins(&mut self, clock: Clock) {
        let motion = self.machine.plant().motion();
        self.pins = Some(Box::new(Pins::new(self.machine.stage(), clock, motion)));
    }

    /// What the motor's pins have done before `until`, if somebody looks at them.
    pub fn pins(&mut self, until: Instant) -> Vec<Pin> {
        self.pins.as_mut().map_or(Vec::new(), |pins| pins.until(until))
    }

    /// Takes note of the quantities, of which any may have changed, and of the pins.
    fn note(&mut self, now: Instant) {
        let values = self.machine.values();
        self.telemetry.note(values);
        if let Some(pins) = &mut self.pins {
            let driven = self.machine.signals().iter().position(|signal| signal.role == Role::Drive);
            let drive = driven.map_or(0, |place| values[place]);
            pins.note(now, self.machine.plant().motion(), drive);
        }
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
        task.disturb(Instant::START, &MotorStimulus::Stall(true));
        task.sample(Instant::START, false);
        assert_eq!(task.poll_timeout(), None, "blocked it stands");
        let later = Instant::START + Span::from_secs(1);
        task.disturb(later, &MotorStimulus::Stall(false));
        assert_eq!(task.poll_timeout(), Some(later));
    }
}
