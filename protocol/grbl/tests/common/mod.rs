//! A controller on a bench.

// Not every test uses all of it.
#![allow(dead_code)]

use std::collections::VecDeque;

use torno_grbl::code::Alarm;
use torno_grbl::controller::Controller;
use torno_grbl::machine::{Machine, Move, Overrides, Progress};
use torno_grbl::memory::{Memory, Settings};
use torno_grbl::{Abilities, Axes, Spindle};
use torno_protocol::time::Instant;

pub(crate) mod answers;
pub(crate) mod transcript;

/// X and Z move, and the spindle turns one way.
pub(crate) const LATHE: Abilities =
    Abilities { axes: [true, false, true, false], counterclockwise: false, single_homing: false, holds_slowly: true };

/// A machine whose motions are done when it is told so.
#[derive(Clone, Default)]
pub(crate) struct Puppet {
    position: Axes<i32>,
    motions: Vec<Move>,
    running: bool,
    progress: VecDeque<Progress>,
    /// As it was told last.
    pub(crate) settings: Settings,
    /// What it looks for the ends of.
    pub(crate) homes: Option<Axes<bool>>,
    pub(crate) ends: Axes<bool>,
    /// How fast the spindle is to turn, rpm.
    pub(crate) spindle: f32,
}

impl Puppet {
    /// It stands where it is, and has not done what it was given.
    pub(crate) fn stand(&mut self) {
        self.progress.push_back(Progress::Held);
    }

    /// It has come so far.
    pub(crate) fn go_to(&mut self, position: Axes<i32>) {
        self.position = position;
    }

    /// It cannot go on, and says why.
    pub(crate) fn fail(&mut self, alarm: Alarm, why: &str) {
        self.running = false;
        self.progress.extend([Progress::Message(why.to_owned()), Progress::Failed(alarm)]);
    }

    /// It has found the ends that it was to look for, and stands 1 mm before them.
    pub(crate) fn find(&mut self) {
        for (axis, _) in self.homes.take().unwrap_or_default().iter().enumerate().filter(|(_, homes)| **homes) {
            self.position[axis] = -250;
        }
        self.progress.push_back(Progress::Homed);
    }

    /// What it has to do.
    pub(crate) fn motions(&self) -> &[Move] {
        &self.motions
    }

    /// Does what it was given.
    pub(crate) fn finish(&mut self) {
        if let Some(last) = self.motions.last().filter(|_| self.running) {
            self.position = last.to;
            self.motions.clear();
            self.running = false;
            self.progress.push_back(Progress::Finished);
        }
    }
}

impl Machine for Puppet {
    fn configure(&mut self, settings: &Settings) {
        self.settings = settings.clone();
    }

    fn room(&self) -> usize {
        15 - self.motions.len()
    }

    fn has_motions(&self) -> bool {
        !self.motions.is_empty()
    }

    fn push(&mut self, _: Instant, motion: Move) {
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

    fn home(&mut self, _: Instant, axes: Axes<bool>) {
        self.homes = Some(axes);
    }

    fn spindle(&mut self, _: Instant, _: Spindle, rpm: f32) {
        self.spindle = rpm;
    }

    fn override_by(&mut self, _: Instant, _: Overrides) {}

    fn position(&self, _: Instant) -> Axes<i32> {
        self.position
    }

    fn rate(&self, _: Instant) -> f32 {
        0.0
    }

    fn ends(&self) -> Axes<bool> {
        self.ends
    }

    fn poll_progress(&mut self) -> Option<Progress> {
        self.progress.pop_front()
    }
}

/// A controller, and what it says.
pub(crate) struct Board {
    pub(crate) controller: Controller<Puppet>,
    pub(crate) now: Instant,
}

impl Board {
    /// One with power that has said who it is. Its machine can do all that the firmware can; there is no A axis.
    pub(crate) fn new() -> Self {
        Self::with(
            Abilities { axes: [true, true, true, false], counterclockwise: true, holds_slowly: false, ..LATHE },
            Settings::default(),
        )
    }

    /// One with an A axis. It homes one axis, too.
    pub(crate) fn with_a() -> Self {
        let abilities = Abilities { axes: [true; 4], counterclockwise: true, single_homing: true, holds_slowly: false };
        Self::with(abilities, Settings::with_a())
    }

    /// One with these settings in front of a machine that can do so much.
    pub(crate) fn with(abilities: Abilities, settings: Settings) -> Self {
        let controller = Controller::new(Memory::new(settings), abilities, Puppet::default());
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

    /// What it says to bytes, while the machine does nothing by itself.
    pub(crate) fn says(&mut self, bytes: &[u8]) -> Vec<String> {
        self.send(bytes);
        self.heard()
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
