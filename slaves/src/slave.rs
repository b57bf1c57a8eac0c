//! A slave board: a task, and the link to its master that tells it what to do.

use torno_protocol::board::{Board, Capability, Deadline, Description, Input, Output, Pin, Stimulus};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{RATE, Refusal};
use torno_protocol::time::Instant;
use torno_protocol::uart::Receiver;

use crate::link::{Event, Link};
use crate::machine::{Machine, ONLY_MOTOR, Progress};
use crate::task::Task;

/// A slave board whose sub-frames have `N` bytes.
#[derive(Clone, Debug)]
pub struct Slave<M, const N: usize> {
    task: Task<M>,
    link: Link<N>,
    clock: Clock,
    now: Instant,
}

impl<M: Machine<SubFrame: TryFrom<[u8; N], Error = Refusal>>, const N: usize> Slave<M, N> {
    /// A board as at power-on: the motor stands, an axis in mid-travel.
    pub fn new(settings: &M::Settings, clock: Clock) -> Self {
        Self { task: Task::new(settings, clock), link: Link::new(clock), clock, now: Instant::START }
    }

    fn execute(&mut self, now: Instant, sub_frame: [u8; N]) {
        match M::SubFrame::try_from(sub_frame) {
            Ok(sub_frame) => {
                self.task.start(now, sub_frame);
                self.link.start();
            }
            Err(refusal) => self.link.refuse(refusal),
        }
    }

    fn stimulus(&mut self, now: Instant, stimulus: &Stimulus) {
        match stimulus {
            Stimulus::Motor { motor: 0, what } => self.task.disturb(now, what),
            Stimulus::Reset => {
                self.task.reset(now);
                self.link.reset();
            }
            Stimulus::Power(_) => {
                self.task.power(now);
                self.link.power(self.clock);
            }
            Stimulus::Clock(clock) => {
                self.clock = *clock;
                self.task.retune(now, *clock);
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

impl<M, const N: usize> Board for Slave<M, N>
where
    M: Machine<SubFrame: TryFrom<[u8; N], Error = Refusal>> + Clone,
{
    fn description(&self) -> Description {
        Description {
            ports: vec!["master".to_owned()],
            signals: self.task.signals(),
            events: Event::texts(),
            waits: Vec::new(),
            capabilities: vec![Capability::Reset],
            motors: vec![self.task.motor(ONLY_MOTOR)],
            pins: Vec::new(),
        }
    }

    fn receivers(&self) -> Vec<Receiver> {
        vec![Receiver::hardware(RATE, self.clock)]
    }

    fn handle_input(&mut self, now: Instant, input: Input) {
        self.now = now;
        match input {
            Input::Character { character, .. } => {
                if let Some(sub_frame) = self.link.receive(now, character) {
                    self.execute(now, sub_frame);
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

    fn watch_pins(&mut self) {
        self.task.watch_pins(self.clock);
    }

    fn pins(&mut self, until: Instant) -> Vec<Pin> {
        self.task.pins(until)
    }
}
