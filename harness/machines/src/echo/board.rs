//! The board: it sends each byte back after a while.

use std::collections::VecDeque;

use torno_protocol::board::{Board, Capability, Deadline, Description, Input, Output, Signal, Stimulus};
use torno_protocol::clock::{Clock, Rate};
use torno_protocol::settings;
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::{Receiver, Transmitter};

use super::dialect::BAUD;
use crate::kinds::{Kind, boxed, read};
use crate::motor::NO_MOTOR;

/// The kind of the board.
pub(super) const KIND: Kind = Kind {
    name: "echo",
    settings: EchoSettings::declared,
    build: |settings, clock| Ok(boxed(EchoBoard::new(&read(settings, EchoSettings::check)?, clock))),
    motor: |settings, _| read(settings, EchoSettings::check).map(|_| Err(NO_MOTOR)),
    rehearsal: |_, _| Ok(None),
    full_drive: |_, _| Ok(None),
    carriage: |settings, _| read(settings, EchoSettings::check).map(|_| None),
};

settings! {
    /// What a rig file can say of the board.
    struct EchoSettings {
        /// The time from the reception of a byte to its echo.
        delay_ms: u32 = 2, 0..=1_000, "ms", "ours";
    }
}

/// The board.
#[derive(Clone, Debug)]
struct EchoBoard {
    clock: Clock,
    delay: Span,
    /// What is to be sent back, and from when on.
    due: VecDeque<(Instant, u8)>,
    echoed: i64,
    pc: Transmitter,
    outputs: VecDeque<Output>,
}

impl EchoBoard {
    fn new(settings: &EchoSettings, clock: Clock) -> Self {
        Self {
            clock,
            delay: Span::from_millis(u64::from(settings.delay_ms)),
            due: VecDeque::new(),
            echoed: 0,
            pc: Transmitter::hardware(RATE, clock),
            outputs: VecDeque::new(),
        }
    }

    /// The firmware restarts. The character on the line ends as it began.
    fn restart(&mut self) {
        self.due.clear();
        self.pc.clear();
        self.count(0);
    }

    fn count(&mut self, echoed: i64) {
        self.echoed = echoed;
        self.outputs.push_back(Output::Telemetry { signal: 0, value: echoed });
    }

    fn proceed(&mut self, now: Instant) {
        while let Some((_, byte)) = self.due.front().copied().filter(|(at, _)| *at <= now) {
            self.due.pop_front();
            self.pc.push(byte);
        }
        if let Some(loaded) = self.pc.load(now) {
            self.outputs.push_back(Output::Character { port: 0, edges: loaded.edges, end: loaded.end });
            self.count(self.echoed + 1);
        }
    }
}

/// The speed of its line.
const RATE: Rate = Rate::hz(BAUD);

impl Board for EchoBoard {
    fn description(&self) -> Description {
        Description {
            ports: vec!["pc".to_owned()],
            signals: vec![Signal::new("bytes_echoed", 0)],
            events: vec!["line error".to_owned()],
            capabilities: vec![Capability::Reset],
            ..Description::default()
        }
    }

    fn receivers(&self) -> Vec<Receiver> {
        vec![Receiver::hardware(RATE, self.clock)]
    }

    fn handle_input(&mut self, now: Instant, input: Input) {
        match input {
            Input::Character { character, .. } => match character.ok() {
                Some(byte) => self.due.push_back((now + self.clock.span(self.delay), byte)),
                None => self.outputs.push_back(Output::Event { event: 0, value: 0 }),
            },
            Input::Stimulus(Stimulus::Reset | Stimulus::Power(_)) => self.restart(),
            Input::Stimulus(Stimulus::Clock(clock)) => {
                self.clock = clock;
                self.pc.retune(RATE, clock);
            }
            Input::Stimulus(_) => {}
        }
        self.proceed(now);
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.proceed(now);
    }

    fn poll_output(&mut self) -> Option<Output> {
        self.outputs.pop_front()
    }

    fn poll_timeout(&self) -> Option<Deadline> {
        let due = self.due.front().map(|(at, _)| Deadline { at: *at, why: "a byte is to be sent back" });
        let character = self.pc.poll_timeout().map(|at| Deadline { at, why: "the next character" });
        due.into_iter().chain(character).min_by_key(|deadline| deadline.at)
    }
}
