//! A slave board: a task, and the link to its master that tells it what to do.

use core::fmt::Debug;

use torno_protocol::board::{Board, Deadline, Description, Heeds, Input, Output, Stimulus};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{Fault, RATE, Refusal};
use torno_protocol::time::Instant;
use torno_protocol::uart::Receiver;

use crate::link::{Event, Link};
use crate::task::{Run, Task};

/// What one slave has and the others have not: its control law, its encoder and its plant.
///
/// It gets sub-frames of `N` bytes and shows `S` quantities. It does nothing of itself: a [`Task`] calls it.
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
    task: Task<M, N, S>,
    link: Link<N>,
    clock: Clock,
    now: Instant,
}

impl<M: Machine<N, S>, const N: usize, const S: usize> Slave<M, N, S> {
    /// A board as at power-on.
    pub(crate) fn with(task: Task<M, N, S>, clock: Clock) -> Self {
        Self { task, link: Link::new(clock), clock, now: Instant::START }
    }

    fn execute(&mut self, now: Instant, part: [u8; N]) {
        match self.task.start(now, part) {
            Ok(()) => self.link.start(),
            Err(refusal) => self.link.refuse(refusal),
        }
    }

    fn stimulus(&mut self, now: Instant, stimulus: &Stimulus) {
        self.task.stimulus(now, stimulus);
        match stimulus {
            Stimulus::Reset => self.link.reset(),
            Stimulus::Power(_) => self.link.power(self.clock),
            Stimulus::Clock(clock) => {
                self.clock = *clock;
                self.link.retune(*clock);
            }
            _ => {}
        }
    }

    fn poll_telemetry(&mut self) -> Option<Output> {
        let (signal, value) = self.task.poll_telemetry()?;
        Some(Output::Telemetry { signal, value })
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
        Description {
            ports: vec!["master".to_owned()],
            signals: self.task.signals(),
            events: Event::texts(),
            waits: Vec::new(),
            heeds: [Heeds::Reset].into_iter().chain(self.task.heeds()).collect(),
            motors: Vec::new(),
        }
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
        match self.task.sample(now, self.link.is_busy()) {
            Progress::Going => {}
            Progress::Done => self.link.finish(),
            Progress::Failed(fault) => self.link.fail(fault),
        }
    }

    fn poll_output(&mut self) -> Option<Output> {
        self.poll_telemetry().or_else(|| self.poll_event()).or_else(|| self.poll_character())
    }

    fn poll_timeout(&self) -> Option<Deadline> {
        let sample = self.task.poll_timeout().map(|at| (at, "sample"));
        let (at, why) =
            self.link.poll_timeout().into_iter().chain(sample).reduce(|a, b| if b.0 < a.0 { b } else { a })?;
        Some(Deadline { at, why })
    }

    fn mute(&self) -> bool {
        !self.link.is_about_to_speak() && !self.task.is_on_watch()
    }
}
