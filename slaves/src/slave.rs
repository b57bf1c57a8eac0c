//! A slave board: a machine, the link to its master, and the timer that samples the one for the other.

use core::fmt::Debug;

use torno_protocol::board::{Board, Deadline, Description, Heeds, Input, Output, Signal, Stimulus};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{Fault, RATE, Refusal};
use torno_protocol::time::Instant;
use torno_protocol::uart::Receiver;

use crate::link::{Event, Link};
use crate::schedule::Schedule;

/// What one slave has and the others have not: its control law, its encoder and its plant.
///
/// It gets sub-frames of `N` bytes and shows `S` quantities. It does nothing of itself: the board calls it.
pub trait Machine<const N: usize, const S: usize>: Clone + Debug {
    /// The quantities' names.
    const SIGNALS: [&'static str; S];
    /// Its motor drives an axis.
    const IS_AXIS: bool = true;

    /// The quantities, as the firmware has them.
    fn values(&self) -> [i64; S];

    /// Starts to execute a sub-frame.
    ///
    /// # Errors
    /// [`Refusal`] if it is none that the master would send.
    fn start(&mut self, now: Instant, part: [u8; N]) -> Result<(), Refusal>;

    /// One sample of the control law. `busy`: a sub-frame is being executed.
    fn sample(&mut self, now: Instant, busy: bool) -> Progress;

    /// The shaft is blocked or free again.
    fn stall(&mut self, now: Instant, blocked: bool);

    /// Something happens to the encoder, the motor or the axis.
    fn disturb(&mut self, now: Instant, stimulus: &Stimulus);

    /// The supply goes or comes: as a reset, but the firmware counts from 0 again.
    fn power(&mut self, now: Instant);

    /// The firmware starts anew. The plant stays as it is, but for the drive, which is off.
    fn reset(&mut self, now: Instant);

    /// Without a sub-frame or a stimulus, further samples would change nothing.
    fn is_at_rest(&self) -> bool;

    /// A sample may fail although no sub-frame is being executed.
    fn is_on_watch(&self) -> bool {
        false
    }
}

/// How far a machine has got with its sub-frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Still at it, or nothing to do.
    Going,
    /// Executed.
    Done,
    /// Failed; the drive is off.
    Failed(Fault),
}

/// A slave board.
#[derive(Clone, Debug)]
pub struct Slave<M, const N: usize, const S: usize> {
    machine: M,
    link: Link<N>,
    schedule: Schedule,
    clock: Clock,
    now: Instant,
    /// The values that telemetry has told.
    told: [i64; S],
}

impl<M: Machine<N, S>, const N: usize, const S: usize> Slave<M, N, S> {
    /// A board as at power-on, which samples every `period_ms` milliseconds of `clock`.
    pub(crate) fn with(machine: M, period_ms: u32, clock: Clock) -> Self {
        let told = machine.values();
        let (link, schedule) = (Link::new(clock), Schedule::new(period_ms, clock));
        let mut slave = Self { machine, link, schedule, clock, now: Instant::START, told };
        // A load may move the axis that nobody drives.
        slave.sample_unless_at_rest(Instant::START);
        slave
    }

    fn execute(&mut self, now: Instant, part: [u8; N]) {
        match self.machine.start(now, part) {
            Ok(()) => {
                self.link.start();
                self.schedule.start(now);
            }
            Err(refusal) => self.link.refuse(refusal),
        }
    }

    fn stimulus(&mut self, now: Instant, stimulus: &Stimulus) {
        match stimulus {
            Stimulus::Stall(blocked) => self.machine.stall(now, *blocked),
            Stimulus::Reset => {
                self.machine.reset(now);
                self.link.reset();
            }
            Stimulus::Power(_) => {
                self.machine.power(now);
                self.link.power(self.clock);
                self.schedule.stop();
                self.sample_unless_at_rest(now);
            }
            Stimulus::Clock(clock) => {
                self.clock = *clock;
                self.link.retune(*clock);
                self.schedule.retune(now, *clock);
            }
            Stimulus::Counts(_)
            | Stimulus::Load(_)
            | Stimulus::Supply(_)
            | Stimulus::Backlash(_)
            | Stimulus::EndStop(_)
            | Stimulus::Drive(_) => {
                self.machine.disturb(now, stimulus);
                self.sample_unless_at_rest(now);
            }
            // The stepping loop sees to the first three; the others are for PCs.
            Stimulus::Hang(_) | Stimulus::Slow(_) | Stimulus::Stop(_) => {}
            Stimulus::Write(_) | Stimulus::Discard | Stimulus::Configure { .. } => {}
        }
    }

    fn sample_unless_at_rest(&mut self, now: Instant) {
        if !self.machine.is_at_rest() {
            self.schedule.start(now);
        }
    }

    fn sample(&mut self, now: Instant) {
        match self.machine.sample(now, self.link.is_busy()) {
            Progress::Going => {}
            Progress::Done => self.link.finish(),
            Progress::Failed(fault) => self.link.fail(fault),
        }
        if !self.link.is_busy() && self.machine.is_at_rest() {
            self.schedule.stop();
        }
    }

    fn poll_telemetry(&mut self) -> Option<Output> {
        let values = self.machine.values();
        let changed = values.iter().zip(&self.told).position(|(value, told)| value != told)?;
        self.told[changed] = values[changed];
        Some(Output::Telemetry { signal: u8::try_from(changed).ok()?, value: values[changed] })
    }

    fn poll_event(&mut self) -> Option<Output> {
        let (event, value) = self.link.poll_event()?;
        Some(Output::Event { event: event.place(), value })
    }

    fn poll_character(&mut self) -> Option<Output> {
        let loaded = self.link.poll_character(self.now)?;
        Some(Output::Character { port: 0, edges: loaded.edges, end: loaded.end })
    }
}

impl<M: Machine<N, S>, const N: usize, const S: usize> Board for Slave<M, N, S> {
    fn description(&self) -> Description {
        // At power-on every quantity is 0: the firmware counts from where the axis stands.
        let signals = M::SIGNALS.iter().map(|name| Signal::new(name, 0)).collect();
        let mut heeds = vec![Heeds::Reset, Heeds::Motor];
        heeds.extend(M::IS_AXIS.then_some(Heeds::Axis));
        Description { ports: vec!["master".to_owned()], signals, events: Event::texts(), waits: Vec::new(), heeds }
    }

    fn receivers(&self) -> Vec<Receiver> {
        vec![Receiver::hardware(RATE, self.clock)]
    }

    fn handle_input(&mut self, now: Instant, input: Input) {
        self.now = now;
        match input {
            Input::Character { character, .. } => {
                if let Some(part) = self.link.receive(now, character) {
                    self.execute(now, part);
                }
            }
            Input::Stimulus(stimulus) => self.stimulus(now, &stimulus),
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.now = now;
        self.link.handle_timeout(now);
        if self.schedule.take(now) {
            self.sample(now);
        }
    }

    fn poll_output(&mut self) -> Option<Output> {
        self.poll_telemetry().or_else(|| self.poll_event()).or_else(|| self.poll_character())
    }

    fn poll_timeout(&self) -> Option<Deadline> {
        let sample = self.schedule.poll_timeout().map(|at| (at, "sample"));
        let (at, why) =
            self.link.poll_timeout().into_iter().chain(sample).reduce(|a, b| if b.0 < a.0 { b } else { a })?;
        Some(Deadline { at, why })
    }

    fn mute(&self) -> bool {
        !self.link.is_about_to_speak() && !self.machine.is_on_watch()
    }
}
