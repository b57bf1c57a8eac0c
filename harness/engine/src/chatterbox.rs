//! A board to try the engine with.

use std::collections::VecDeque;

use torno_protocol::board::{Board, Deadline, Description, Input, Output, Stimulus};
use torno_protocol::clock::{Clock, Rate};
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::{Receiver, TickTimer, Transmitter};

/// Of all lines.
pub(super) const BAUD: Rate = Rate::hz(9600);

/// A board with two ports that answers what it hears, passes on some of it, and speaks up by itself now and then.
#[derive(Clone, Debug)]
pub(super) struct Chatterbox {
    clock: Clock,
    software: bool,
    /// How long it thinks before it answers.
    delay: Span,
    timer: TickTimer,
    /// How often it speaks up by itself; it need not.
    period: Option<Span>,
    next: Option<Instant>,
    answers: VecDeque<(Instant, usize, u8)>,
    transmitters: [Transmitter; 2],
    heard: i64,
    outputs: VecDeque<Output>,
}

impl Chatterbox {
    pub(super) fn new(ppb: i32, software: bool, delay: Span, period: Option<Span>) -> Self {
        let clock = Clock::from_ppb(ppb).unwrap();
        let timer = TickTimer::new(BAUD, clock);
        let transmitter = |n| if software { timer.transmitter(n) } else { Transmitter::hardware(BAUD, clock) };
        let transmitters = [transmitter(0), transmitter(1)];
        let next = period.map(|period| Instant::START + period);
        let (answers, outputs) = (VecDeque::new(), VecDeque::new());
        Self { clock, software, delay, timer, period, next, answers, transmitters, heard: 0, outputs }
    }

    fn retune(&mut self) {
        for (n, transmitter) in (0..).zip(&mut self.transmitters) {
            if self.software {
                transmitter.keep_pace_with(&self.timer.transmitter(n));
            } else {
                transmitter.retune(BAUD, self.clock);
            }
        }
    }

    fn act(&mut self, now: Instant) {
        if let (Some(next), Some(period)) = (self.next, self.period)
            && next <= now
        {
            self.next = Some(now + period);
            self.outputs.push_back(Output::Telemetry { signal: 0, value: self.heard });
            self.transmitters[0].push(self.heard as u8);
        }
        while let Some((_, port, byte)) = self.answers.front().copied().filter(|(at, ..)| *at <= now) {
            self.answers.pop_front();
            self.transmitters[port].push(byte);
        }
        for (port, transmitter) in (0..).zip(&mut self.transmitters) {
            if let Some(loaded) = transmitter.load(now) {
                self.outputs.push_back(Output::Character { port, edges: loaded.edges, end: loaded.end });
            }
        }
    }
}

impl Board for Chatterbox {
    fn description(&self) -> Description {
        Description { ports: vec!["a".to_owned(), "b".to_owned()], ..Description::default() }
    }

    fn receivers(&self) -> Vec<Receiver> {
        let receiver = |n| if self.software { self.timer.receiver(n) } else { Receiver::hardware(BAUD, self.clock) };
        vec![receiver(0), receiver(1)]
    }

    fn handle_input(&mut self, now: Instant, input: Input) {
        match input {
            Input::Character { port, character } => {
                self.heard += 1;
                self.outputs.push_back(Output::Event { event: port, value: i64::from(character.byte) });
                // Three in four words die out, so that the talk does.
                if character.byte % 4 == 0 && self.answers.len() < 8 {
                    let to = usize::from(character.byte / 4 % 2);
                    self.answers.push_back((now + self.delay, to, character.byte.wrapping_mul(13).wrapping_add(7)));
                }
            }
            Input::Stimulus(Stimulus::Write(bytes)) => bytes.iter().for_each(|byte| self.transmitters[0].push(*byte)),
            // It forgets what it was about to say, and what is on its lines.
            Input::Stimulus(Stimulus::Power(_)) => {
                let Self { clock, software, delay, timer, period, .. } = *self;
                let outputs = std::mem::take(&mut self.outputs);
                let next = period.map(|period| now + period);
                *self = Self { clock, timer, next, outputs, ..Self::new(0, software, delay, period) };
                self.retune();
                self.outputs.push_back(Output::Telemetry { signal: 0, value: 0 });
            }
            Input::Stimulus(Stimulus::Clock(clock)) => {
                self.clock = clock;
                self.timer.retune(now, clock);
                self.retune();
            }
            // Not every board is touched by a reset, but the engine cannot know.
            Input::Stimulus(Stimulus::Reset) if self.period.is_some() => {
                self.outputs.extend([Output::Cut { port: 0 }, Output::Cut { port: 1 }]);
                let Self { clock, software, delay, period, .. } = *self;
                let outputs = std::mem::take(&mut self.outputs);
                let ppb = 0;
                *self = Self { clock, outputs, ..Self::new(ppb, software, delay, None) };
                self.period = period;
                self.next = period.map(|period| now + period);
            }
            Input::Stimulus(_) => {}
        }
        self.act(now);
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.act(now);
    }

    fn poll_output(&mut self) -> Option<Output> {
        self.outputs.pop_front()
    }

    fn poll_timeout(&self) -> Option<Deadline> {
        let loads = self.transmitters.iter().filter_map(Transmitter::poll_timeout);
        let answers = self.answers.front().map(|(at, ..)| *at);
        loads.chain(answers).chain(self.next).min().map(|at| Deadline { at, why: "talk" })
    }
}
