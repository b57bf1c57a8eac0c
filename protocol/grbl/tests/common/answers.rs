//! Counts answers by the rule alone: one for each CR and each LF that is taken out of the receive buffer, none for what
//! overflows it or what a reset finds in it. What is being done when a reset comes is answered before the banner.

use std::collections::VecDeque;

use torno_grbl::code::Alarm;
use torno_grbl::controller::RECEIVE;
use torno_grbl::state::State;

use super::Board;

/// Bytes that mean nothing to the firmware; here, the machine gets on with them.
pub(crate) const MACHINE: [u8; 6] = [FINISHES, STANDS, FAILS, AT_AN_END, HOMES, WAITS];
const FINISHES: u8 = 0xc0;
const STANDS: u8 = 0xc1;
const FAILS: u8 = 0xc2;
const AT_AN_END: u8 = 0xc3;
const HOMES: u8 = 0xc4;
const WAITS: u8 = 0xc5;

/// What of all bytes goes into the receive buffer, as the firmware's documentation tells it.
fn is_buffered(byte: u8) -> bool {
    byte < 0x80 && !matches!(byte, b'?' | b'!' | b'~' | 0x18)
}

fn is_end(byte: &u8) -> bool {
    matches!(byte, b'\r' | b'\n')
}

struct Counter {
    board: Board,
    /// What has been taken and not answered, and what waits behind it.
    open: VecDeque<u8>,
    /// Nothing but a reset is heard.
    dead: bool,
}

/// Sends all bytes, and holds the answers against the rule after each of them.
pub(crate) fn hold(bytes: &[u8]) {
    let mut counter = Counter { board: Board::new(), open: VecDeque::new(), dead: false };
    bytes.iter().for_each(|byte| counter.take(*byte));
}

impl Counter {
    fn take(&mut self, byte: u8) {
        let before = self.unanswered();
        let waited = self.board.controller.waiting();
        let taken = self.board.controller.receive(self.board.now, byte);
        assert_eq!(taken, !is_buffered(byte) || waited < RECEIVE, "the buffer holds {RECEIVE}: {byte:#x}");
        if is_buffered(byte) && taken {
            self.open.push_back(byte);
        }
        self.move_on(byte);
        let lines = self.board.heard();
        if byte == 0x18 {
            let restart = lines.iter().position(|line| line.starts_with("Grbl "));
            let said = &lines[..restart.expect("a reset is always heard")];
            assert_eq!(said.iter().filter(|line| is_answer(line)).count(), before, "{said:?}");
        }
        lines.iter().for_each(|line| self.hear(line));
        let unanswered = self.unanswered();
        assert!(unanswered <= 1, "{unanswered} lines at once");
        if self.is_free() {
            assert_eq!((unanswered, self.board.controller.waiting()), (0, 0), "after {byte:#x}: {lines:?}");
        }
    }

    fn move_on(&mut self, byte: u8) {
        let machine = self.board.controller.machine_mut();
        match byte {
            FINISHES => machine.finish(),
            STANDS => machine.stand(),
            FAILS => machine.fail(Alarm::Aborted, "lost"),
            AT_AN_END => machine.fail(Alarm::HardLimit, "an end"),
            HOMES if machine.homes.is_some() => machine.find(),
            WAITS => self.board.now = self.board.now.max(self.board.controller.poll_timeout().unwrap_or_default()),
            _ => {}
        }
    }

    fn hear(&mut self, line: &str) {
        if line.starts_with("Grbl ") {
            self.open.clear();
            self.dead = false;
        } else if line == "[MSG:Reset to continue]" {
            self.dead = true;
        } else if is_answer(line) {
            let end = self.open.iter().position(is_end).expect("an answer to no line");
            self.open.drain(..=end);
        }
    }

    /// The lines that have been taken out of the buffer and not been answered.
    fn unanswered(&self) -> usize {
        let taken = self.open.len() - self.board.controller.waiting();
        self.open.iter().take(taken).filter(|byte| is_end(byte)).count()
    }

    /// Whether the main loop waits for nothing but bytes.
    fn is_free(&self) -> bool {
        let rests = matches!(self.board.controller.state(), State::Idle | State::Check | State::Alarm);
        rests && !self.dead && self.board.controller.poll_timeout().is_none()
    }
}

fn is_answer(line: &str) -> bool {
    line == "ok" || line.starts_with("error:")
}
