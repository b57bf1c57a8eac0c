//! The PC's side of the conversation: what has been sent, what came back, whether it is over.

use torno_protocol::lathe::{Fault, Party, Refusal, Reply};

use super::Outcome;

/// A tally of frames and replies, as a PC program keeps it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Frames sent whole.
    pub sent: usize,
    /// Frames acknowledged.
    pub accepted: usize,
    /// Times a frame was held.
    pub held: usize,
    /// Frames refused, whole or cut short, with the reason.
    pub refusals: Vec<Refusal>,
    /// Boards that failed.
    pub failures: Vec<(Party, Fault)>,
    /// `XOFF` came and `XON` has not: the PC must wait.
    pub stopped: bool,
    /// A frame has been acknowledged and `XON` has not come since.
    pub running: bool,
    dropped: usize,
}

impl Tally {
    /// A frame has been sent whole.
    pub fn sent(&mut self) {
        self.sent += 1;
    }

    /// A reply came.
    pub fn reply(&mut self, reply: Reply) {
        match reply {
            Reply::Ack => {
                self.accepted += 1;
                self.running = true;
            }
            Reply::Xoff => {
                self.held += 1;
                self.stopped = true;
            }
            Reply::Xon => {
                self.running = false;
                self.stopped = false;
            }
            Reply::Nak(refusal) => self.refusals.push(refusal),
            Reply::Can(party, fault) => {
                self.failures.push((party, fault));
                // A held frame will not be executed, nor answered.
                self.dropped += self.unanswered();
            }
            Reply::Unknown(_) => {}
        }
    }

    /// Frames sent that have neither been acknowledged nor refused nor dropped after a failure.
    pub fn unanswered(&self) -> usize {
        self.sent.saturating_sub(self.accepted + self.refusals.len() + self.dropped)
    }

    /// A careful PC may send its next frame: it is not stopped and has its answer to the last one. (The master can hold
    /// one frame, so the next may be sent while the slaves are busy.)
    pub fn may_send(&self) -> bool {
        !self.stopped && self.unanswered() == 0
    }

    /// Nothing is under way: all frames are answered and the slaves are done.
    pub fn is_over(&self) -> bool {
        !self.running && self.may_send()
    }

    /// How it ended.
    pub fn outcome(&self, frames: usize) -> Outcome {
        if !self.failures.is_empty() {
            Outcome::Faulted
        } else if !self.refusals.is_empty() {
            Outcome::Rejected
        } else if self.accepted == frames && self.is_over() {
            Outcome::Completed
        } else {
            Outcome::Unanswered
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use torno_protocol::lathe::Slave;

    fn after(sent: usize, replies: &[Reply]) -> Tally {
        let mut conversation = Tally::default();
        (0..sent).for_each(|_| conversation.sent());
        replies.iter().for_each(|reply| conversation.reply(*reply));
        conversation
    }

    #[test]
    fn two_frames_in_one_write() {
        let conversation = after(2, &[Reply::Ack, Reply::Xoff, Reply::Xon, Reply::Ack]);
        assert!(!conversation.is_over());
        let conversation = after(2, &[Reply::Ack, Reply::Xoff, Reply::Xon, Reply::Ack, Reply::Xon]);
        assert_eq!(conversation.outcome(2), Outcome::Completed);
        assert_eq!((conversation.accepted, conversation.held), (2, 1));
    }

    #[test]
    fn each_reply_changes_what_the_pc_may_do() {
        let failed = Reply::Can(Slave::Depth.into(), Fault::NoAnswer);
        let nak = Reply::Nak(Refusal::Speed);
        for (sent, replies, unanswered, may_send, over) in [
            (0, &[][..], 0, true, true),
            (1, &[], 1, false, false),
            (2, &[], 2, false, false),
            (1, &[Reply::Unknown(7)], 1, false, false),
            (1, &[Reply::Ack], 0, true, false),
            (1, &[Reply::Ack, Reply::Xon], 0, true, true),
            (1, &[nak], 0, true, true),
            (3, &[nak, Reply::Ack], 1, false, false),
            (2, &[Reply::Ack, Reply::Xoff], 1, false, false),
            (1, &[Reply::Ack, Reply::Xoff], 0, false, false),
            (2, &[Reply::Ack, Reply::Xoff, failed], 0, false, false),
            (3, &[Reply::Ack, Reply::Xoff, failed], 0, false, false),
            (1, &[Reply::Xoff, Reply::Xon], 1, false, false),
            // More answers than frames.
            (1, &[Reply::Ack, Reply::Ack], 0, true, false),
        ] {
            let conversation = after(sent, replies);
            let found = (conversation.unanswered(), conversation.may_send(), conversation.is_over());
            assert_eq!(found, (unanswered, may_send, over), "{sent} {replies:?}");
        }
    }

    #[test]
    fn how_a_program_ended() {
        let done = [Reply::Ack, Reply::Xon];
        let failed = [Reply::Ack, Reply::Can(Slave::Depth.into(), Fault::Stalled), Reply::Xon];
        let nak = [Reply::Nak(Refusal::Speed)];
        for (sent, replies, frames, expected, name) in [
            (0, &[][..], 0, Outcome::Completed, "completed"),
            (1, &done, 1, Outcome::Completed, "completed"),
            (1, &done, 2, Outcome::Unanswered, "unanswered"),
            (1, &done[..1], 1, Outcome::Unanswered, "unanswered"),
            (1, &[], 1, Outcome::Unanswered, "unanswered"),
            (1, &nak, 1, Outcome::Rejected, "rejected"),
            (2, &[&nak[..], &done].concat(), 2, Outcome::Rejected, "rejected"),
            (1, &failed, 1, Outcome::Faulted, "faulted"),
            (2, &[&failed[..], &nak].concat(), 2, Outcome::Faulted, "faulted"),
        ] {
            let outcome = after(sent, replies).outcome(frames);
            assert_eq!((outcome, outcome.name()), (expected, name), "{sent} {replies:?}");
        }
    }

    #[test]
    fn failures_and_refusals_are_kept_in_order() {
        let nak = [Refusal::Speed, Refusal::Direction].map(Reply::Nak);
        let can = [(Slave::Depth, Fault::Stalled), (Slave::Spindle, Fault::NoAnswer)];
        let told = can.map(|(slave, fault)| Reply::Can(slave.into(), fault));
        let conversation = after(2, &[nak, told].concat());
        assert_eq!(conversation.refusals, [Refusal::Speed, Refusal::Direction]);
        assert_eq!(conversation.failures, can.map(|(slave, fault)| (Party::from(slave), fault)));
    }

    #[test]
    fn the_next_frame_waits_for_the_answer_to_the_last() {
        assert!(!after(1, &[]).may_send());
        assert!(after(1, &[Reply::Ack]).may_send());
        assert!(!after(2, &[Reply::Ack, Reply::Xoff]).may_send());
        assert!(!after(2, &[Reply::Ack, Reply::Xoff, Reply::Xon]).may_send());
    }

    #[test]
    fn after_a_failure_the_held_frame_is_not_waited_for() {
        let failed = Reply::Can(Slave::Depth.into(), Fault::NoAnswer);
        let conversation = after(2, &[Reply::Ack, Reply::Xoff, failed, Reply::Xon]);
        assert!(conversation.is_over());
        assert_eq!(conversation.outcome(5), Outcome::Faulted);
        assert!(after(2, &[Reply::Ack, Reply::Xoff, failed, failed, Reply::Xon]).is_over());
    }
}
