//! A program that is played at the PC's gateway from here, as a program outside would play it.

use std::collections::VecDeque;

use torno_bus::{Answer, Conversation};
use torno_protocol::time::Instant;

use crate::control::ProgramState;
use crate::job::{FrameJob, Job};
use crate::planning::Text;
use crate::rig::file::RigFile;
use crate::session::{Exchange, INTERRUPTED};

/// A program that is played, or was.
pub(super) struct Player {
    playing: Box<dyn Playing>,
    of: usize,
    outcome: Option<&'static str>,
}

/// What a player does, whatever its program is made of.
trait Playing: Send {
    fn hear(&mut self, at: Instant, exchange: &Exchange) -> bool;
    fn due(&mut self) -> Vec<u8>;
    fn accepted(&self) -> usize;
    fn is_over(&self) -> bool;
    fn outcome(&self) -> &'static str;
}

struct Play<J: Job> {
    job: J,
    program: J::Program,
    waiting: VecDeque<u8>,
}

impl Player {
    /// Reads a program for a rig.
    ///
    /// # Errors
    /// What is wrong with it, for people.
    pub(super) fn read(file: &RigFile, text: &str) -> Result<Self, String> {
        Ok(match Text::read(file, text)? {
            Text::Lines(job) => Self::new(job.total(), job),
            Text::Frames { program, .. } => Self::new(program.frames.len(), FrameJob::new(program)),
        })
    }

    fn new<J: Job + Send + 'static>(of: usize, job: J) -> Self {
        let (program, waiting) = (job.program(), job.first().into());
        Self { playing: Box::new(Play { job, program, waiting }), of, outcome: None }
    }

    /// Whether it is still played.
    pub(super) const fn is_playing(&self) -> bool {
        self.outcome.is_none()
    }

    /// Something has been sent or received. Where the program gives up after a failure, that is its end.
    pub(super) fn hear(&mut self, at: Instant, exchange: &Exchange) {
        let gives_up = self.playing.hear(at, exchange);
        if self.is_playing() && (gives_up || self.playing.is_over()) {
            self.outcome = Some(self.playing.outcome());
        }
    }

    /// What the UART is given now.
    pub(super) fn due(&mut self) -> Vec<u8> {
        self.playing.due()
    }

    /// It is ended before its end.
    pub(super) const fn stop(&mut self) {
        self.outcome = Some(INTERRUPTED);
    }

    pub(super) fn state(&self) -> ProgramState {
        ProgramState { accepted: self.playing.accepted(), of: self.of, outcome: self.outcome.map(str::to_owned) }
    }
}

impl<J: Job + Send> Playing for Play<J> {
    fn hear(&mut self, at: Instant, exchange: &Exchange) -> bool {
        match exchange {
            Exchange::Sent(byte, _) => self.job.sent(at, *byte),
            Exchange::Received(byte, _) => {
                self.job.received(*byte);
                match self.program.hear(*byte) {
                    Answer::Nothing => {}
                    Answer::Send(bytes) => self.waiting.extend(bytes),
                    Answer::GiveUp => {
                        self.waiting.clear();
                        return true;
                    }
                }
            }
            Exchange::Garbled(_) => {}
        }
        false
    }

    fn due(&mut self) -> Vec<u8> {
        let mut bytes = Vec::new();
        while !self.waiting.is_empty() && self.program.lets_go(&self.waiting) {
            bytes.extend(self.waiting.pop_front());
        }
        bytes
    }

    fn accepted(&self) -> usize {
        self.job.accepted()
    }

    fn is_over(&self) -> bool {
        self.job.is_over()
    }

    fn outcome(&self) -> &'static str {
        self.job.outcome().name()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(rig: &str, text: &str) -> Result<Player, String> {
        Player::read(&RigFile::load(rig).unwrap(), text)
    }

    fn received(player: &mut Player, text: &str) {
        text.bytes().for_each(|byte| player.hear(Instant::START, &Exchange::Received(byte, Vec::new())));
    }

    #[test]
    fn a_program_of_frames_is_written_at_once_and_given_up_after_a_failure() {
        let mut player = read("lathe", "0A E1 00 E1 00 00 00 00\n00 00 00 00 00 00 00 00").unwrap();
        assert_eq!((player.due().len(), player.due().len()), (16, 0));
        received(&mut player, "\u{6}\u{11}");
        assert_eq!((player.state().accepted, player.state().of, player.is_playing()), (1, 2, true));
        received(&mut player, "\u{18}dn");
        assert_eq!(player.state().outcome.as_deref(), Some("faulted"));
    }

    #[test]
    fn lines_go_when_the_controller_is_there_and_end_with_the_last_answer() {
        let mut player = read("lathe-grbl", "G21\nM2\n").unwrap();
        assert!(player.due().is_empty());
        received(&mut player, "\r\nGrbl 1.1h ['$' for help]\r\n");
        let first = String::from_utf8(player.due()).unwrap();
        assert!(first.starts_with("G10 L20 P1 X") && first.ends_with("\nG21\nM2\n"), "{first}");
        received(&mut player, "ok\r\nok\r\nok\r\n");
        assert_eq!((player.state().outcome.as_deref(), player.state().accepted), (Some("completed"), 3));
    }

    #[test]
    fn what_is_no_program_is_refused_with_the_reason() {
        assert!(read("lathe", "0A E1").err().unwrap().contains("line 1"));
        assert!(read("lathe", "G1 X3").err().unwrap().contains("line 1"));
        assert!(read("servo", "x1").err().unwrap().contains("torno servo"));
    }
}
