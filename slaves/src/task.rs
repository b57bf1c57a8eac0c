//! A machine with the timer that samples it: what a board does for its motor, whoever tells it what to do.

use torno_protocol::board::{Heeds, Signal, Stimulus};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::Refusal;
use torno_protocol::time::Instant;

use crate::schedule::Schedule;
use crate::slave::{Machine, Progress};

/// A machine with the timer that samples it, and what telemetry has told of it.
#[derive(Clone, Debug)]
pub struct Task<M, const N: usize, const S: usize> {
    machine: M,
    schedule: Schedule,
    /// The values that telemetry has told.
    told: [i64; S],
}

impl<M: Machine<N, S>, const N: usize, const S: usize> Task<M, N, S> {
    /// A machine as at power-on, sampled every `period_ms` milliseconds of `clock`.
    pub(crate) fn with(machine: M, period_ms: u32, clock: Clock) -> Self {
        let told = machine.values();
        let mut task = Self { machine, schedule: Schedule::new(period_ms, clock), told };
        // A load may move the axis that nobody drives.
        task.sample_unless_at_rest(Instant::START);
        task
    }

    /// Starts to execute a sub-frame.
    ///
    /// # Errors
    /// [`Refusal`] if it is none that the master would send.
    pub fn start(&mut self, now: Instant, part: [u8; N]) -> Result<(), Refusal> {
        self.machine.start(now, part)?;
        self.schedule.start(now);
        Ok(())
    }

    fn sample_unless_at_rest(&mut self, now: Instant) {
        if !self.machine.is_at_rest() {
            self.schedule.start(now);
        }
    }
}

/// A task, whatever its machine.
pub trait Run {
    /// The machine's quantities. At power-on each is 0: the firmware counts from where the axis stands.
    fn signals(&self) -> Vec<Signal>;

    /// What the machine heeds of the stimuli that mean nothing to some.
    fn heeds(&self) -> Vec<Heeds>;

    /// Something happens to the machine, its supply, its firmware or its oscillator.
    fn stimulus(&mut self, now: Instant, stimulus: &Stimulus);

    /// The next sample, if it is due. `busy`: a sub-frame is being executed.
    fn sample(&mut self, now: Instant, busy: bool) -> Progress;

    /// A quantity that has changed: its place among the signals, and its value.
    fn poll_telemetry(&mut self) -> Option<(u8, i64)>;

    /// When the next sample is due.
    fn poll_timeout(&self) -> Option<Instant>;

    /// A sample may fail although no sub-frame is being executed.
    fn is_on_watch(&self) -> bool;
}

impl<M: Machine<N, S>, const N: usize, const S: usize> Run for Task<M, N, S> {
    fn signals(&self) -> Vec<Signal> {
        M::SIGNALS.iter().map(|name| Signal::new(name, 0)).collect()
    }

    fn heeds(&self) -> Vec<Heeds> {
        let axis = M::IS_AXIS.then_some(Heeds::Axis);
        [Heeds::Motor].into_iter().chain(axis).collect()
    }

    fn stimulus(&mut self, now: Instant, stimulus: &Stimulus) {
        match stimulus {
            Stimulus::Stall(blocked) => self.machine.stall(now, *blocked),
            Stimulus::Reset => self.machine.reset(now),
            Stimulus::Power(_) => {
                self.machine.power(now);
                self.schedule.stop();
                self.sample_unless_at_rest(now);
            }
            Stimulus::Clock(clock) => self.schedule.retune(now, *clock),
            Stimulus::Counts(_)
            | Stimulus::Load(_)
            | Stimulus::Supply(_)
            | Stimulus::Backlash(_)
            | Stimulus::EndStop(_)
            | Stimulus::Drive(_) => {
                self.machine.disturb(now, stimulus);
                self.sample_unless_at_rest(now);
            }
            // The stepping loop sees to the first three; the others are for PCs, and for boards of several motors.
            Stimulus::Hang(_) | Stimulus::Slow(_) | Stimulus::Stop(_) => {}
            Stimulus::Write(_) | Stimulus::Discard | Stimulus::Configure { .. } | Stimulus::Of(..) => {}
        }
    }

    fn sample(&mut self, now: Instant, busy: bool) -> Progress {
        if !self.schedule.take(now) {
            return Progress::Going;
        }
        let progress = self.machine.sample(now, busy);
        if (!busy || progress != Progress::Going) && self.machine.is_at_rest() {
            self.schedule.stop();
        }
        progress
    }

    fn poll_telemetry(&mut self) -> Option<(u8, i64)> {
        let values = self.machine.values();
        let changed = values.iter().zip(&self.told).position(|(value, told)| value != told)?;
        self.told[changed] = values[changed];
        Some((u8::try_from(changed).ok()?, values[changed]))
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.schedule.poll_timeout()
    }

    fn is_on_watch(&self) -> bool {
        self.machine.is_on_watch()
    }
}
