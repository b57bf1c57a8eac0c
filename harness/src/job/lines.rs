//! Lines of G-code for a controller that answers each: as many at once as its receive buffer holds.

use std::collections::VecDeque;

use torno_bus::{Answer, Conversation};
use torno_protocol::time::Instant;

use super::{Job, Outcome};

/// So many characters may be with the controller and not answered: one fewer than its buffer holds.
const WINDOW: usize = 127;

/// The states that the controller tells, by their numbers.
const STATES: &[&str] = &["Idle", "Run", "Hold", "Jog", "Home", "Alarm", "Check", "Door", "Sleep"];

/// A program of lines. Each gets one answer.
#[derive(Clone, Debug)]
pub struct LineJob {
    lines: Vec<String>,
    /// So many of them come before the program's own.
    before: usize,
    /// Lines that have been sent whole.
    pub sent: usize,
    /// Lines that have been answered with `ok`.
    pub accepted: usize,
    /// Lines that have been refused: their numbers in the program, from 1, and why.
    pub refused: Vec<(usize, String)>,
    /// What has stopped the machine, if something has.
    pub alarm: Option<String>,
    heard: Vec<u8>,
}

impl LineJob {
    /// A program with these lines before it; nothing has been sent yet. Comments and blank lines are sent, too.
    pub fn new(before: &str, text: &str) -> Self {
        let lines = before.lines().chain(text.lines()).map(str::to_owned).collect();
        Self {
            lines,
            before: before.lines().count(),
            sent: 0,
            accepted: 0,
            refused: Vec::new(),
            alarm: None,
            heard: Vec::new(),
        }
    }

    /// How many lines there are.
    pub const fn total(&self) -> usize {
        self.lines.len()
    }

    fn hear(&mut self, line: &str) {
        if line == "ok" {
            self.accepted += 1;
        } else if line.starts_with("error:") {
            let number = self.accepted + self.refused.len() + 1;
            self.refused.push((number.saturating_sub(self.before), line.to_owned()));
        } else if line.starts_with("ALARM:") {
            self.alarm = Some(line.to_owned());
        }
    }
}

impl Job for LineJob {
    type Program = Counting;

    const UNIT: &str = "line";
    const STATES: &[&str] = STATES;

    fn first(&self) -> Vec<u8> {
        self.lines.iter().flat_map(|line| line.bytes().chain([b'\n'])).collect()
    }

    fn program(&self) -> Counting {
        Counting::default()
    }

    fn sent(&mut self, _: Instant, byte: u8) {
        self.sent += usize::from(byte == b'\n');
    }

    fn received(&mut self, byte: u8) {
        match byte {
            b'\n' => {
                let line = core::mem::take(&mut self.heard);
                self.hear(String::from_utf8_lossy(&line).trim());
            }
            byte => self.heard.push(byte),
        }
    }

    fn accepted(&self) -> usize {
        self.accepted + self.refused.len()
    }

    fn reached(&self) -> (usize, usize) {
        (self.accepted().saturating_sub(self.before), self.total() - self.before)
    }

    fn is_over(&self) -> bool {
        self.alarm.is_some() || self.accepted() == self.lines.len()
    }

    fn outcome(&self) -> Outcome {
        if self.alarm.is_some() {
            Outcome::Faulted
        } else if !self.refused.is_empty() {
            Outcome::Rejected
        } else if self.accepted == self.lines.len() {
            Outcome::Completed
        } else {
            Outcome::Unanswered
        }
    }
}

/// A sender that counts characters. It begins after the controller's banner, and gives up after an alarm.
#[derive(Clone, Debug, Default)]
pub struct Counting {
    ready: bool,
    /// The lengths of the lines that are not answered.
    unanswered: VecDeque<usize>,
    /// Of the line that has begun: what has still to go.
    left: usize,
    heard: Vec<u8>,
}

impl Conversation for Counting {
    fn hear(&mut self, byte: u8) -> Answer {
        if byte != b'\n' {
            self.heard.push(byte);
            return Answer::Nothing;
        }
        let line = core::mem::take(&mut self.heard);
        let is = |start: &[u8]| line.starts_with(start);
        self.ready |= is(b"Grbl ");
        if is(b"ok") || is(b"error:") {
            self.unanswered.pop_front();
        }
        if is(b"ALARM:") { Answer::GiveUp } else { Answer::Nothing }
    }

    fn lets_go(&mut self, waiting: &VecDeque<u8>) -> bool {
        if self.left == 0 {
            let length = waiting.iter().position(|byte| *byte == b'\n').map_or(waiting.len(), |end| end + 1);
            let under_way: usize = self.unanswered.iter().sum();
            // A line that the buffer never holds goes alone.
            if !self.ready || (under_way > 0 && under_way + length > WINDOW) {
                return false;
            }
            self.unanswered.push_back(length);
            self.left = length;
        }
        self.left -= 1;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gone(sender: &mut Counting, waiting: &mut VecDeque<u8>) -> String {
        let mut bytes = Vec::new();
        while !waiting.is_empty() && sender.lets_go(waiting) {
            bytes.extend(waiting.pop_front());
        }
        String::from_utf8_lossy(&bytes).into_owned()
    }

    fn hears(sender: &mut Counting, text: &str) -> Vec<Answer> {
        text.bytes().map(|byte| sender.hear(byte)).filter(|answer| *answer != Answer::Nothing).collect()
    }

    #[test]
    fn it_waits_for_the_banner_and_keeps_the_buffer_full_and_no_fuller() {
        let line = format!("{}\n", "X".repeat(59));
        let mut waiting: VecDeque<u8> = line.repeat(4).into_bytes().into();
        let mut sender = Counting::default();
        assert_eq!(gone(&mut sender, &mut waiting), "");
        hears(&mut sender, "\r\nGrbl 1.1h ['$' for help]\r\n");
        assert_eq!(gone(&mut sender, &mut waiting), line.repeat(2));
        hears(&mut sender, "[MSG:Enabled]\r\nok\r\n");
        assert_eq!(gone(&mut sender, &mut waiting), line);
        hears(&mut sender, "error:20\r\nok\r\n");
        assert_eq!(gone(&mut sender, &mut waiting), line);
        assert_eq!(hears(&mut sender, "ALARM:1\r\n"), [Answer::GiveUp]);
    }

    #[test]
    fn a_job_counts_the_answers_to_its_lines() {
        let mut job = LineJob::new("G20\n", "G0X1\nG5\n\nM30");
        "ok\r\nok\r\nerror:20\r\nok\r\n[MSG:Pgm End]\r\n".bytes().for_each(|byte| job.received(byte));
        assert!(!job.is_over());
        "ok\r\n".bytes().for_each(|byte| job.received(byte));
        assert_eq!((job.accepted, job.refused.clone()), (4, vec![(2, "error:20".to_owned())]));
        assert!(job.is_over() && job.outcome() == Outcome::Rejected);
    }
}
