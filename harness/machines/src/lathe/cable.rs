//! The conversation over the PC's cable, heard from outside.

use std::collections::VecDeque;

use torno_bus::{Listener, Phase, Stopwatch, hex};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{CHARACTER, Frame, FrameDecoder, Party, Refusal, Reply, ReplyDecoder};
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::Character;

/// Takes frames and replies apart. Where a frame begins follows from the replies too, so it is the master's own decoder
/// that is told what the master knows of itself.
#[derive(Clone, Debug)]
pub(super) struct ExchangeDecoder {
    frames: FrameDecoder,
    replies: ReplyDecoder,
}

impl ExchangeDecoder {
    pub(super) fn new() -> Self {
        Self { frames: FrameDecoder::new(Clock::TRUE), replies: ReplyDecoder::default() }
    }

    /// What the PC's silence before `at` has cut short: so many bytes of a frame.
    pub(super) fn silence(&mut self, at: Instant) -> Option<usize> {
        // What comes when the silence ends comes in time.
        let due = self.frames.poll_timeout().filter(|due| *due < at)?;
        let bytes = self.unfinished();
        self.frames.handle_timeout(due).map(|_| bytes)
    }

    /// How many bytes of a frame have come.
    pub(super) fn unfinished(&self) -> usize {
        self.frames.pending().len()
    }

    /// The master has a character of the PC. Gives the frame that is complete with it.
    pub(super) fn pc(&mut self, at: Instant, character: Character) -> Option<[u8; Frame::LENGTH]> {
        self.silence(at);
        self.frames.push(at, character)?.ok()
    }

    /// The PC has a byte of the master.
    pub(super) fn master(&mut self, at: Instant, byte: u8) -> Vec<Reply> {
        self.silence(at);
        let replies = self.replies.push(byte);
        replies.iter().for_each(|reply| self.follow(at, *reply));
        replies
    }

    /// The master did what it tells when the reply began.
    fn follow(&mut self, at: Instant, reply: Reply) {
        let began = at - CHARACTER.times(reply.emit().len() as u64);
        match reply {
            Reply::Xoff => self.hold(began),
            Reply::Xon => {
                self.frames.hold(false);
                self.frames.go_on(began);
            }
            Reply::Can(party, _) => {
                // A master that has restarted takes the PC to be held.
                if party == Party::Master {
                    self.hold(began);
                }
                self.frames.abandon(began);
            }
            Reply::Nak(Refusal::LineError) => self.frames.discard(),
            Reply::Ack | Reply::Nak(_) | Reply::Unknown(_) => {}
        }
    }

    fn hold(&mut self, at: Instant) {
        self.frames.hold(true);
        self.frames.stop(at);
    }
}

/// Listens at the PC's side.
#[derive(Clone, Debug)]
pub(super) struct Cable(pub(super) ExchangeDecoder);

impl Listener for Cable {
    fn sent(&mut self, at: Instant, byte: u8) -> Vec<String> {
        // It leaves now, and is with the master a character later.
        let Some(frame) = self.0.pc(at + CHARACTER, Character::good(byte)) else { return Vec::new() };
        let meaning = Frame::parse(frame).map_or_else(|refusal| refusal.to_string(), |_| "a frame".to_owned());
        vec![format!("{} ({meaning})", hex(&frame))]
    }

    fn received(&mut self, at: Instant, byte: u8) -> Vec<torno_bus::Reply> {
        let reply = |reply: Reply| torno_bus::Reply { code: reply.code(), text: reply.to_string() };
        self.0.master(at, byte).into_iter().map(reply).collect()
    }
}

/// Measures how long the master takes for frames.
#[derive(Clone, Debug)]
pub(super) struct Times {
    talk: ExchangeDecoder,
    /// Frames without an answer: when the last byte came, and whether it is held.
    waiting: VecDeque<(Instant, bool)>,
    /// Frames that are being executed: when the last byte came, and when the `ACK`.
    running: Vec<(Instant, Instant)>,
    resumed: Option<Instant>,
}

impl Times {
    pub(super) fn new() -> Self {
        Self { talk: ExchangeDecoder::new(), waiting: VecDeque::new(), running: Vec::new(), resumed: None }
    }
}

impl Stopwatch for Times {
    fn sent(&mut self, at: Instant, character: Character) {
        if self.talk.pc(at, character).is_some() {
            self.waiting.push_back((at, false));
        }
    }

    fn received(&mut self, at: Instant, byte: u8) -> Vec<(Phase, Span)> {
        let mut over = Vec::new();
        for reply in self.talk.master(at, byte) {
            match reply {
                Reply::Ack => {
                    let Some((sent, held)) = self.waiting.pop_front() else { continue };
                    self.running.push((sent, at));
                    over.push(match (held, self.resumed) {
                        (true, Some(resumed)) => (Phase::HeldAnswer, at.since(resumed)),
                        _ => (Phase::Answer, at.since(sent)),
                    });
                }
                Reply::Xoff => self.waiting.iter_mut().for_each(|(_, held)| *held = true),
                Reply::Xon => {
                    self.resumed = Some(at);
                    for (sent, acknowledged) in self.running.drain(..) {
                        over.push((Phase::Whole, at.since(sent)));
                        over.push((Phase::Execution, at.since(acknowledged)));
                    }
                }
                // None of these was a whole frame.
                Reply::Nak(Refusal::CutShort | Refusal::LineError) | Reply::Unknown(_) => {}
                Reply::Nak(_) => drop(self.waiting.pop_front()),
                // What was held is dropped.
                Reply::Can(..) => self.waiting.clear(),
            }
        }
        over
    }
}

#[cfg(test)]
mod tests {
    use torno_protocol::lathe::{ACK, NAK, XOFF, XON};

    use super::*;

    const FRAME: [u8; Frame::LENGTH] = [0x0a, 0xe1, 0x00, 0xe1, 0x01, 0x00, 0x01, 0x00];

    fn ms(ms: u64) -> Instant {
        Instant::START + Span::from_millis(ms)
    }

    /// What is told of bytes that the PC sends one after the other.
    fn sent(cable: &mut Cable, at: Instant, bytes: &[u8]) -> Vec<String> {
        let at = |n: usize| at + CHARACTER.times(n as u64);
        bytes.iter().enumerate().flat_map(|(n, byte)| cable.sent(at(n), *byte)).collect()
    }

    #[test]
    fn a_frame_after_one_that_was_cut_short_is_told_as_it_is() {
        let mut cable = Cable(ExchangeDecoder::new());
        assert_eq!(sent(&mut cable, ms(0), &FRAME[..3]).len(), 0);
        assert_eq!(sent(&mut cable, ms(200), &FRAME), ["0A E1 00 E1 01 00 01 00 (a frame)"]);
        // A character time longer than the silence, and no more.
        sent(&mut cable, ms(300), &FRAME[..3]);
        let last = ms(300) + CHARACTER.times(2);
        let resumed = last + CHARACTER + Span::from_millis(50);
        assert_eq!(sent(&mut cable, resumed, &FRAME[3..]), ["0A E1 00 E1 01 00 01 00 (a frame)"]);
    }

    /// The PC's characters after an `XOFF` whose first edge is at 100 ms: whether the last byte of three has `late` to
    /// come on, and what is told of the rest of the frame after the `XON`.
    #[test]
    fn a_begun_frame_that_comes_while_the_pc_stops_waits_for_the_xon() {
        let stopping = ms(100) + CHARACTER.times(3);
        for (last, told) in [(stopping, 1), (stopping + Span::from_nanos(1), 0)] {
            let mut cable = Cable(ExchangeDecoder::new());
            cable.received(ms(100) + CHARACTER, XOFF);
            // It leaves a character before the master has it.
            sent(&mut cable, last - CHARACTER.times(3), &FRAME[..3]);
            cable.received(ms(9_000), XON);
            assert_eq!(sent(&mut cable, ms(9_001), &FRAME[3..]).len(), told, "{last}");
        }
    }

    #[test]
    fn what_is_thrown_away_until_a_silence_is_no_frame() {
        for reply in [&b"\x18dn"[..], &[NAK, b'l']] {
            let mut cable = Cable(ExchangeDecoder::new());
            sent(&mut cable, ms(0), &FRAME[..2]);
            reply.iter().for_each(|byte| drop(cable.received(ms(4), *byte)));
            assert_eq!(sent(&mut cable, ms(5), &FRAME).len(), 0);
            assert_eq!(sent(&mut cable, ms(100), &FRAME).len(), 1);
        }
        // A master that has restarted holds the PC for all it knows: no silence counts before its XON.
        let mut cable = Cable(ExchangeDecoder::new());
        b"\x18mr".iter().for_each(|byte| drop(cable.received(ms(4), *byte)));
        assert_eq!(sent(&mut cable, ms(500), &FRAME).len(), 0);
        cable.received(ms(600), XON);
        assert_eq!(sent(&mut cable, ms(700), &FRAME).len(), 1);
    }

    #[test]
    fn a_held_frame_is_answered_from_the_xon_on() {
        let mut times = Times::new();
        (1..=16).for_each(|n| times.sent(ms(n), Character::good(0)));
        let replies = [(10, ACK), (18, XOFF), (500, XON), (505, ACK), (900, XON)];
        let over: Vec<_> = replies.into_iter().flat_map(|(at, reply)| times.received(ms(at), reply)).collect();
        let expected = [
            (Phase::Answer, 2),
            (Phase::Whole, 492),
            (Phase::Execution, 490),
            (Phase::HeldAnswer, 5),
            (Phase::Whole, 884),
            (Phase::Execution, 395),
        ];
        assert_eq!(over, expected.map(|(phase, ms)| (phase, Span::from_millis(ms))));
    }

    #[test]
    fn the_refusal_of_what_was_no_frame_answers_none() {
        let mut times = Times::new();
        let send = |times: &mut Times, at: u64, bytes: u64| {
            (0..bytes).for_each(|n| times.sent(ms(at + n), Character::good(0)));
        };
        send(&mut times, 1, 3);
        send(&mut times, 200, 8);
        let replies = [(206, NAK), (207, b'c'), (210, ACK)];
        let over: Vec<_> = replies.into_iter().flat_map(|(at, reply)| times.received(ms(at), reply)).collect();
        assert_eq!(over, [(Phase::Answer, Span::from_millis(3))]);
    }
}
