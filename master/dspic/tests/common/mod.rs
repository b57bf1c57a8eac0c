//! A bench: the board, a PC at its one port, and a record of what it does.

#![allow(dead_code, reason = "each test file uses a part of it")]
#![allow(clippy::unwrap_used, reason = "part of tests")]

use torno_dspic::{Dspic, DspicSettings};
use torno_protocol::board::{Board, Output, Stimulus};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::RATE;
use torno_protocol::record::Heard;
use torno_protocol::stepping::Cell;
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::{Character, Receiver, Transmitter};

pub(crate) const SPINDLE: u8 = 0;
pub(crate) const TRANSVERSE: u8 = 1;
pub(crate) const DEPTH: u8 = 2;

/// 200 rpm, 225 counts out at 225 a sample, one slot in.
pub(crate) const FRAME: [u8; 8] = [10, 225, 0, 225, 0, 0, 1, 0];

#[derive(Clone)]
pub(crate) struct Bench {
    pub(crate) cell: Cell<Dspic>,
    pub(crate) now: Instant,
    pc: (Transmitter, Receiver),
    pub(crate) outputs: Vec<(Instant, Output)>,
    /// What the board has said and no one has asked for yet: when each byte could be read.
    said: Vec<(Instant, u8)>,
}

impl Bench {
    pub(crate) fn new() -> Self {
        Self::with(&DspicSettings::default(), Clock::TRUE)
    }

    pub(crate) fn with(settings: &DspicSettings, clock: Clock) -> Self {
        Self {
            cell: Cell::new(Dspic::new(settings, clock)),
            now: Instant::from_nanos(1_000_000),
            pc: (Transmitter::hardware(RATE, Clock::TRUE), Receiver::hardware(RATE, Clock::TRUE)),
            outputs: Vec::new(),
            said: Vec::new(),
        }
    }

    /// The PC sends bytes back to back, and they arrive.
    pub(crate) fn send(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.pc.0.push(*byte);
            let loaded = self.pc.0.load(self.now.max(self.pc.0.free_at())).unwrap();
            self.cell.hear(&Heard::Edges { port: 0, edges: loaded.edges });
            self.run_to(loaded.end);
        }
    }

    pub(crate) fn stimulus(&mut self, stimulus: Stimulus) {
        self.cell.hear(&Heard::Stimulus { at: self.now, stimulus });
        self.run_to(self.now.next());
    }

    pub(crate) fn run_ms(&mut self, ms: u64) {
        self.run_to(self.now + Span::from_millis(ms));
    }

    /// Runs until the board is mute; gives up after `limit_s` seconds.
    pub(crate) fn run_until_mute(&mut self, limit_s: u64) -> bool {
        let limit = self.now + Span::from_secs(limit_s);
        while !self.cell.board().mute() && self.now < limit {
            self.run_ms(10);
        }
        self.cell.board().mute()
    }

    fn run_to(&mut self, until: Instant) {
        let Self { cell, pc: (_, line), outputs, said, .. } = self;
        cell.run(until, |at, output| {
            if let Output::Character { edges, .. } = &output {
                line.hear(edges);
                while let Some(at) = line.poll_timeout() {
                    said.extend(line.take(at).and_then(Character::ok).map(|byte| (at, byte)));
                }
            }
            outputs.push((at, output));
        });
        self.now = until;
    }

    /// What the board has said since the last call, as text: control characters by name.
    pub(crate) fn replies(&mut self) -> String {
        let name = |byte: u8| match byte {
            0x06 => "ACK".to_owned(),
            0x11 => "XON".to_owned(),
            0x13 => "XOFF".to_owned(),
            0x15 => "NAK".to_owned(),
            0x18 => "CAN".to_owned(),
            other => char::from(other).to_string(),
        };
        self.said.drain(..).map(|(_, byte)| name(byte)).collect::<Vec<_>>().join(" ")
    }

    /// When the first thing that no one has asked for yet could be read.
    pub(crate) fn answered_at(&self) -> Option<Instant> {
        self.said.first().map(|(at, _)| *at)
    }

    /// When a quantity changed, and to what.
    pub(crate) fn history(&self, name: &str) -> Vec<(Instant, i64)> {
        let signals = self.cell.board().description().signals;
        let wanted = signals.iter().position(|signal| signal.name == name).unwrap();
        let telemetry = self.outputs.iter().filter_map(|(at, output)| match output {
            Output::Telemetry { signal, value } if usize::from(*signal) == wanted => Some((*at, *value)),
            _ => None,
        });
        telemetry.collect()
    }

    pub(crate) fn value(&self, name: &str) -> i64 {
        self.history(name).last().map_or(0, |(_, value)| *value)
    }
}
