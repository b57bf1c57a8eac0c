//! Frames for the lathe's master.

use torno_bus::{Answer, Conversation};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{FrameDecoder, Program, Reply, ReplyDecoder};
use torno_protocol::time::Instant;
use torno_protocol::uart::Character;

use super::{Job, Outcome, Tally};

/// A program of frames: written at once, as its `XOFF` holds the PC.
#[derive(Clone, Debug)]
pub struct FrameJob {
    /// The program.
    pub program: Program,
    /// What has been said.
    pub tally: Tally,
    replies: ReplyDecoder,
    /// The program's frames follow one another, whatever the master makes of them.
    sending: FrameDecoder,
}

impl FrameJob {
    /// Nothing has been sent yet.
    pub fn new(program: Program) -> Self {
        let sending = FrameDecoder::new(Clock::TRUE);
        Self { program, tally: Tally::default(), replies: ReplyDecoder::default(), sending }
    }
}

impl Job for FrameJob {
    type Program = Careful;

    const UNIT: &str = "frame";

    fn first(&self) -> Vec<u8> {
        self.program.bytes()
    }

    fn program(&self) -> Careful {
        Careful::default()
    }

    fn sent(&mut self, at: Instant, byte: u8) {
        if self.sending.push(at, Character::good(byte)).is_some() {
            self.tally.sent();
        }
    }

    fn received(&mut self, byte: u8) {
        self.replies.push(byte).into_iter().for_each(|reply| self.tally.reply(reply));
    }

    fn accepted(&self) -> usize {
        self.tally.accepted
    }

    fn reached(&self) -> (usize, usize) {
        (self.accepted(), self.program.frames.len())
    }

    fn is_over(&self) -> bool {
        self.tally.sent == self.program.frames.len() && self.tally.is_over()
    }

    fn outcome(&self) -> Outcome {
        self.tally.outcome(self.program.frames.len())
    }
}

/// A program that sends no more once a board has failed: with a frame missing, the rest would turn another part.
#[derive(Clone, Debug, Default)]
pub struct Careful {
    decoder: ReplyDecoder,
}

impl Conversation for Careful {
    fn hear(&mut self, byte: u8) -> Answer {
        let failed = self.decoder.push(byte).iter().any(|reply| matches!(reply, Reply::Can(..)));
        if failed { Answer::GiveUp } else { Answer::Nothing }
    }
}
