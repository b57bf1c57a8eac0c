//! A controller on a bench.

// Not every test uses all of it.
#![allow(dead_code)]

use torno_grbl::controller::Controller;
use torno_grbl::machine::{Machine, Move, Overrides, Progress};
use torno_grbl::memory::{Memory, Settings};
use torno_grbl::{Abilities, Spindle};
use torno_protocol::time::Instant;

/// A machine whose motions are done when it is told so.
#[derive(Clone, Default)]
pub(crate) struct Puppet {
    position: [i32; 3],
    motions: Vec<Move>,
    running: bool,
    progress: Vec<Progress>,
}

impl Puppet {
    /// It stands where it is, and has not done what it was given.
    pub(crate) fn stand(&mut self) {
        self.progress.push(Progress::Held);
    }

    /// Does what it was given.
    pub(crate) fn finish(&mut self) {
        if let Some(last) = self.motions.last().filter(|_| self.running) {
            self.position = last.to;
            self.motions.clear();
            self.running = false;
            self.progress.push(Progress::Finished);
        }
    }
}

impl Machine for Puppet {
    fn room(&self) -> usize {
        15 - self.motions.len()
    }

    fn has_motions(&self) -> bool {
        !self.motions.is_empty()
    }

    fn push(&mut self, motion: Move) {
        if motion.to != self.motions.last().map_or(self.position, |last| last.to) {
            self.motions.push(motion);
        }
    }

    fn start(&mut self, _: Instant, _: Overrides) {
        self.running = true;
    }

    fn hold(&mut self, _: Instant) {
        self.running = false;
    }

    fn forget(&mut self, _: Instant) {
        self.motions.clear();
        self.running = false;
    }

    fn home(&mut self, _: Instant) {}

    fn spindle(&mut self, _: Instant, _: Spindle, _: f32) {}

    fn override_by(&mut self, _: Instant, _: Overrides) {}

    fn position(&self, _: Instant) -> [i32; 3] {
        self.position
    }

    fn rate(&self, _: Instant) -> f32 {
        0.0
    }

    fn ends(&self) -> [bool; 3] {
        [false; 3]
    }

    fn poll_progress(&mut self) -> Option<Progress> {
        self.progress.pop()
    }
}

/// A controller, and what it says.
pub(crate) struct Board {
    pub(crate) controller: Controller<Puppet>,
    pub(crate) now: Instant,
}

impl Board {
    /// One with power that has said who it is.
    pub(crate) fn new() -> Self {
        Self::with(Abilities { axes: [true; 3], counterclockwise: true })
    }

    /// The same in front of a machine that can do so much.
    pub(crate) fn with(abilities: Abilities) -> Self {
        let controller = Controller::new(Memory::new(Settings::default()), abilities, Puppet::default());
        let mut board = Self { controller, now: Instant::START };
        board.controller.power_on(board.now);
        board.said();
        board
    }

    /// Sends bytes, of which none is lost.
    pub(crate) fn send(&mut self, bytes: &[u8]) {
        for byte in bytes {
            assert!(self.controller.receive(self.now, *byte));
        }
    }

    /// What it says now.
    pub(crate) fn heard(&mut self) -> Vec<String> {
        self.controller.run(self.now);
        let bytes: Vec<u8> = std::iter::from_fn(|| self.controller.poll_transmit(self.now)).collect();
        lines(&bytes)
    }

    /// What it says until nothing more happens.
    pub(crate) fn said(&mut self) -> Vec<String> {
        let mut bytes = Vec::new();
        loop {
            self.controller.run(self.now);
            let before = bytes.len();
            bytes.extend(std::iter::from_fn(|| self.controller.poll_transmit(self.now)));
            let waits = self.controller.poll_timeout();
            if bytes.len() == before && waits.is_none() && !self.controller.machine().running {
                break;
            }
            self.now = self.now.max(waits.unwrap_or(self.now));
            self.controller.machine_mut().finish();
        }
        lines(&bytes)
    }
}

fn lines(bytes: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(bytes);
    text.split_terminator('\n').map(|line| line.trim_end_matches('\r').to_owned()).collect()
}
