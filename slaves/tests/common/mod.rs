//! A bench: one board, a line to it, and a record of what it does.

#![allow(dead_code, reason = "each test file uses a part of it")]
#![allow(clippy::unwrap_used, reason = "part of tests")]

pub(crate) mod envelope;
pub(crate) mod response;

use torno_protocol::board::{Board, Input, Output, Stimulus, event_text};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{ACK, BEL, CAN, CHARACTER, ENQ, Fault, Parity, RATE};
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::{Character, Receiver};
use torno_slaves::{Depth, DepthSettings, Spindle, SpindleSettings, Transverse, TransverseSettings};

#[derive(Clone)]
pub(crate) struct Bench<B> {
    pub(crate) board: B,
    pub(crate) now: Instant,
    pub(crate) hung: bool,
    pub(crate) outputs: Vec<(Instant, Output)>,
    line: Receiver,
    /// The bytes that the board has sent, and when each could be read.
    pub(crate) sent: Vec<(Instant, u8)>,
}

impl<B: Board> Bench<B> {
    /// A board that the master has asked after its start: before that it takes no sub-frame.
    pub(crate) fn new(board: B) -> Self {
        let mut bench = Self::as_switched_on(board);
        bench.ask();
        assert_eq!(bench.replies(), [CAN, b'r']);
        bench.outputs.clear();
        bench
    }

    /// A board that nothing has reached.
    pub(crate) fn as_switched_on(board: B) -> Self {
        let line = Receiver::hardware(RATE, Clock::TRUE);
        Self { board, now: Instant::START, hung: false, outputs: Vec::new(), line, sent: Vec::new() }
    }

    /// The master asks, and gets its answer.
    pub(crate) fn ask(&mut self) {
        self.send(&[ENQ]);
        self.run_ms(6);
    }

    /// Lets everything happen that is due before `t`.
    pub(crate) fn run_to(&mut self, t: Instant) {
        while let Some(at) =
            self.board.poll_timeout().map(|next| next.at.max(self.now)).filter(|at| *at < t && !self.hung)
        {
            self.now = at;
            self.board.handle_timeout(at);
            self.drain();
        }
        self.now = t;
    }

    pub(crate) fn run_ms(&mut self, ms: u64) {
        self.run_to(self.now + Span::from_millis(ms));
    }

    /// Runs until the board is mute; gives up after `limit_s` seconds.
    pub(crate) fn run_until_mute(&mut self, limit_s: u64) -> bool {
        let limit = self.now + Span::from_secs(limit_s);
        while !self.board.mute() && self.now < limit {
            self.run_ms(10);
        }
        self.board.mute()
    }

    pub(crate) fn hear(&mut self, input: Input) {
        self.board.handle_input(self.now, input);
        self.drain();
    }

    pub(crate) fn character(&mut self, character: Character) {
        self.hear(Input::Character { port: 0, character });
    }

    pub(crate) fn stimulus(&mut self, stimulus: Stimulus) {
        self.cut_short(&stimulus);
        self.hear(Input::Stimulus(stimulus));
    }

    /// A restart forgets what the board was about to send, so a reply that it has begun stays without its letter.
    fn cut_short(&mut self, stimulus: &Stimulus) {
        match stimulus {
            Stimulus::Reset => {}
            // The line goes idle: the character on it is lost too.
            Stimulus::Power(_) => self.sent.retain(|(at, _)| *at <= self.now),
            _ => return,
        }
        self.sent.pop_if(|(_, byte)| matches!(*byte, ACK | CAN));
    }

    /// Delivers bytes at the speed of the line, the first one character from now.
    pub(crate) fn send(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.run_to(self.now + CHARACTER);
            self.character(Character::good(*byte));
        }
    }

    fn drain(&mut self) {
        while let Some(output) = self.board.poll_output() {
            if let Output::Character { edges, .. } = &output {
                assert!(edges[0].at >= self.now);
                self.line.hear(edges);
                while let Some(at) = self.line.poll_timeout() {
                    self.sent.extend(self.line.take(at).and_then(Character::ok).map(|byte| (at, byte)));
                }
            }
            self.outputs.push((self.now, output));
        }
    }

    /// The bytes sent since the last call, without the parities after `ACK`. Each must be part of a whole reply.
    pub(crate) fn replies(&mut self) -> Vec<u8> {
        let mut replies = Vec::new();
        let mut sent = self.sent.drain(..).map(|(_, byte)| byte);
        while let Some(byte) = sent.next() {
            replies.push(byte);
            match byte {
                ACK => assert!(sent.next().is_some_and(|letter| Parity::from_letter(letter).is_some())),
                CAN => replies.push(sent.next().filter(|letter| Fault::from_letter(*letter).is_some()).unwrap()),
                _ => assert_eq!(byte, BEL),
            }
        }
        replies
    }

    /// A quantity's values and since when each holds.
    pub(crate) fn history(&self, name: &str) -> Vec<(Instant, i64)> {
        let description = self.board.description();
        let wanted = description.signals.iter().position(|signal| signal.name == name).unwrap();
        let mut history = vec![(Instant::START, description.signals[wanted].initial)];
        history.extend(self.outputs.iter().filter_map(|(at, output)| match output {
            Output::Telemetry { signal, value } if usize::from(*signal) == wanted => Some((*at, *value)),
            _ => None,
        }));
        history
    }

    pub(crate) fn value(&self, name: &str) -> i64 {
        self.history(name).last().unwrap().1
    }

    /// The events' texts since the start.
    pub(crate) fn events(&self) -> Vec<String> {
        let texts = self.board.description().events;
        let event = |(_, output): &(Instant, Output)| match output {
            Output::Event { event, value } => Some(event_text(&texts[usize::from(*event)], *value)),
            _ => None,
        };
        self.outputs.iter().filter_map(event).collect()
    }
}

pub(crate) const fn s(seconds: u64) -> u64 {
    1_000 * seconds
}

pub(crate) fn spindle() -> Bench<Spindle> {
    Bench::new(Spindle::new(&SpindleSettings::default(), Clock::TRUE))
}

pub(crate) fn transverse() -> Bench<Transverse> {
    Bench::new(Transverse::new(&TransverseSettings::default(), Clock::TRUE))
}

pub(crate) fn depth() -> Bench<Depth> {
    Bench::new(Depth::new(&DepthSettings::default(), Clock::TRUE))
}
