//! Frames out of the PC's characters. A frame has no delimiter, so silence is what tells them apart.

use super::frame::LENGTH;
use super::{CHARACTER, FRAME_GAP, Refusal};
use crate::clock::Clock;
use crate::time::{Instant, Span};
use crate::uart::Character;

/// What a PC has already loaded still comes after it has been told to stop: what has come of a frame waits for the
/// `XON` if its last byte comes within this time of the `XOFF`. (Ours: one character of `XOFF` itself, two in the PC's
/// UART.)
const STOPPING: Span = CHARACTER.times(3);

/// A frame's bytes, in range or not.
type Bytes = [u8; LENGTH];

/// Puts the PC's characters together into frames, as the master takes them: by the silences between them, and by what
/// the master tells the PC.
#[derive(Clone, Debug)]
pub struct FrameDecoder {
    /// How long the line may be silent in mid-frame. Counted from the end of one character to the end of the next,
    /// so one character time longer than the silence itself.
    silence: Span,
    stopping: Span,
    bytes: Vec<u8>,
    last: Instant,
    mode: Mode,
    /// When the line has been silent for long enough to draw a conclusion.
    deadline: Option<Instant>,
    /// `XOFF` has been decided on, and `XON` has not since. On the line both come later.
    holding: bool,
    /// When `XOFF` went on the line, if `XON` has not since.
    stopped_at: Option<Instant>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    Collecting,
    /// Everything is thrown away until the line falls silent; the answer is still to be given, or has been.
    Discarding(Option<Refusal>),
    /// The same, but the silence counts only from the next `XON`: until then the PC may be silent because it is held.
    Abandoned(Option<Refusal>),
}

impl FrameDecoder {
    /// A decoder that measures silences with `clock`.
    pub fn new(clock: Clock) -> Self {
        Self {
            silence: clock.span(FRAME_GAP + CHARACTER),
            stopping: clock.span(STOPPING),
            bytes: Vec::with_capacity(LENGTH),
            last: Instant::START,
            mode: Mode::Collecting,
            deadline: None,
            holding: false,
            stopped_at: None,
        }
    }

    /// Measures with `clock` from now on; a deadline that is set stays.
    pub fn retune(&mut self, clock: Clock) {
        let Self { silence, stopping, .. } = Self::new(clock);
        (self.silence, self.stopping) = (silence, stopping);
    }

    /// A character came. Gives a frame that is complete with it, or a refusal that it causes.
    pub fn push(&mut self, now: Instant, character: Character) -> Option<Result<Bytes, Refusal>> {
        self.last = now;
        if self.mode == Mode::Collecting {
            self.deadline = Some(now + self.silence);
            return match character.ok() {
                Some(byte) => self.collect(byte).map(Ok),
                None => {
                    self.throw_away(now, None);
                    Some(Err(Refusal::LineError))
                }
            };
        }
        match &mut self.mode {
            Mode::Collecting => None,
            Mode::Discarding(answer) => {
                self.deadline = Some(now + self.silence);
                answer.take().map(Err)
            }
            Mode::Abandoned(answer) => answer.take().map(Err),
        }
    }

    fn collect(&mut self, byte: u8) -> Option<Bytes> {
        self.bytes.push(byte);
        let frame = Bytes::try_from(self.bytes.as_slice()).ok()?;
        self.bytes.clear();
        self.deadline = None;
        Some(frame)
    }

    /// When the silence that counts has lasted long enough.
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.deadline.filter(|_| !self.waits_for_the_pc_to_go_on())
    }

    /// A frame has begun while the PC was stopping: its silence means nothing.
    fn waits_for_the_pc_to_go_on(&self) -> bool {
        let stopping = self.stopped_at.is_some_and(|stopped| self.last <= stopped + self.stopping);
        self.mode == Mode::Collecting && stopping
    }

    /// What the silence up to `now` tells: that a frame was cut short.
    pub fn handle_timeout(&mut self, now: Instant) -> Option<Refusal> {
        if self.poll_timeout().is_none_or(|at| at > now) {
            return None;
        }
        self.deadline = None;
        if self.mode != Mode::Collecting {
            self.mode = Mode::Collecting;
            return None;
        }
        self.bytes.clear();
        Some(Refusal::CutShort)
    }

    /// The bytes of a frame that is not complete yet.
    pub fn pending(&self) -> &[u8] {
        &self.bytes
    }

    /// The PC is to be held (`true`) or no longer; nothing of that is on the line yet.
    pub const fn hold(&mut self, holding: bool) {
        self.holding = holding;
    }

    /// `XOFF` goes on the line.
    pub const fn stop(&mut self, now: Instant) {
        self.stopped_at = Some(now);
    }

    /// `XON` goes on the line. The silence of a PC that was stopped counts from here; that of another has counted.
    pub fn go_on(&mut self, now: Instant) {
        if self.stopped_at.take().is_none() {
            return;
        }
        if let Mode::Abandoned(answer) = self.mode
            && !self.holding
        {
            self.mode = Mode::Discarding(answer);
        }
        if !self.bytes.is_empty() || matches!(self.mode, Mode::Discarding(_)) {
            self.deadline = Some(now + self.silence);
        }
    }

    /// Throws away what has been received and whatever comes until the PC's line has been silent; if the PC is held, or
    /// is about to be, until it has been silent after `XON`.
    pub fn abandon(&mut self, now: Instant) {
        self.throw_away(now, Some(Refusal::Faulted));
    }

    /// The receiver reports a line error that has not been seen here: the same from the last character on.
    pub fn discard(&mut self) {
        if self.mode == Mode::Collecting {
            self.throw_away(self.last, None);
        }
    }

    fn throw_away(&mut self, now: Instant, answer: Option<Refusal>) {
        self.bytes.clear();
        (self.mode, self.deadline) = if self.holding || self.stopped_at.is_some() {
            (Mode::Abandoned(answer), None)
        } else {
            (Mode::Discarding(answer), Some(now + self.silence))
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: Bytes = [1, 2, 3, 4, 5, 6, 7, 8];

    fn ms(ms: u64) -> Instant {
        Instant::START + Span::from_millis(ms)
    }

    fn send(decoder: &mut FrameDecoder, at: Instant, bytes: &[u8]) -> Vec<Result<Bytes, Refusal>> {
        let at = |n: usize| at + CHARACTER.times(n as u64);
        bytes.iter().enumerate().filter_map(|(n, byte)| decoder.push(at(n), Character::good(*byte))).collect()
    }

    #[test]
    fn a_silence_of_50_ms_is_still_mid_frame() {
        let mut decoder = FrameDecoder::new(Clock::TRUE);
        send(&mut decoder, ms(0), &FRAME[..4]);
        let resumes = ms(0) + CHARACTER.times(4) + FRAME_GAP;
        assert!(decoder.poll_timeout().is_some_and(|deadline| deadline >= resumes));
        assert_eq!(send(&mut decoder, resumes, &FRAME[4..]), [Ok(FRAME)]);
        assert_eq!(decoder.poll_timeout(), None);
    }

    #[test]
    fn the_silence_counts_from_the_last_character_in_the_boards_own_time() {
        // The silence and a character, counted from the end of one to the end of the next.
        let silence = |clock: Clock| clock.span(FRAME_GAP + CHARACTER);
        let slow = Clock::from_ppb(-100_000_000).unwrap();
        let mut decoder = FrameDecoder::new(Clock::TRUE);
        assert_eq!(decoder.poll_timeout(), None);
        send(&mut decoder, ms(7), &FRAME[..1]);
        assert_eq!(decoder.poll_timeout(), Some(ms(7) + silence(Clock::TRUE)));
        decoder.retune(slow);
        assert_eq!(decoder.poll_timeout(), Some(ms(7) + silence(Clock::TRUE)), "one that is set stays");
        send(&mut decoder, ms(9), &FRAME[1..2]);
        assert_eq!(decoder.poll_timeout(), Some(ms(9) + silence(slow)));
        // While characters are thrown away each of them sets it again, and so does the decision to throw away.
        decoder.abandon(ms(11));
        assert_eq!(decoder.poll_timeout(), Some(ms(11) + silence(slow)));
        send(&mut decoder, ms(15), &FRAME[..1]);
        assert_eq!(decoder.poll_timeout(), Some(ms(15) + silence(slow)));
        assert_eq!((decoder.handle_timeout(Instant::NEVER), decoder.poll_timeout()), (None, None));
    }

    #[test]
    fn a_begun_frame_waits_if_it_comes_within_three_characters_of_the_xoff() {
        for (after, waits) in [(CHARACTER.times(3), true), (CHARACTER.times(3) + Span::from_nanos(1), false)] {
            let mut decoder = FrameDecoder::new(Clock::TRUE);
            decoder.stop(ms(10));
            decoder.push(ms(10) + after, Character::good(1));
            assert_eq!(decoder.poll_timeout().is_none(), waits);
            let goes_on = ms(200);
            decoder.go_on(goes_on);
            assert_eq!(decoder.poll_timeout(), Some(goes_on + FRAME_GAP + CHARACTER));
        }
    }

    #[test]
    fn an_xon_without_a_begun_frame_sets_no_silence() {
        let mut decoder = FrameDecoder::new(Clock::TRUE);
        decoder.stop(ms(10));
        decoder.go_on(ms(20));
        assert_eq!(decoder.poll_timeout(), None);
        send(&mut decoder, ms(30), &FRAME[..3]);
        let deadline = decoder.poll_timeout();
        decoder.go_on(ms(40));
        assert_eq!(decoder.poll_timeout(), deadline, "it has not been stopped again");
    }

    #[test]
    fn a_pc_that_is_about_to_be_held_or_is_stopped_must_be_silent_after_the_xon() {
        for (holding, stopped, deadline) in
            [(false, false, true), (true, false, false), (false, true, false), (true, true, false)]
        {
            let mut decoder = FrameDecoder::new(Clock::TRUE);
            decoder.hold(holding);
            if stopped {
                decoder.stop(ms(1));
            }
            decoder.abandon(ms(5));
            let expected = deadline.then(|| ms(5) + FRAME_GAP + CHARACTER);
            assert_eq!(decoder.poll_timeout(), expected, "{holding} {stopped}");
        }
    }

    #[test]
    fn a_longer_silence_cuts_the_frame_short() {
        let mut decoder = FrameDecoder::new(Clock::TRUE);
        send(&mut decoder, ms(0), &FRAME[..7]);
        assert_eq!(decoder.handle_timeout(Instant::NEVER), Some(Refusal::CutShort));
        assert_eq!(send(&mut decoder, ms(100), &FRAME), [Ok(FRAME)]);
    }

    #[test]
    fn a_line_error_is_answered_once_and_the_rest_thrown_away_until_silence() {
        let mut decoder = FrameDecoder::new(Clock::TRUE);
        let broken = Character { framing_error: true, ..Character::good(0) };
        assert_eq!(decoder.push(ms(0), broken), Some(Err(Refusal::LineError)));
        assert_eq!(send(&mut decoder, ms(1), &FRAME), []);
        assert_eq!(decoder.handle_timeout(Instant::NEVER), None);
        assert_eq!(send(&mut decoder, ms(100), &FRAME), [Ok(FRAME)]);
    }

    #[test]
    fn after_a_line_error_that_was_seen_elsewhere_the_silence_counts_from_the_last_character() {
        let mut decoder = FrameDecoder::new(Clock::TRUE);
        send(&mut decoder, ms(0), &FRAME[..1]);
        send(&mut decoder, ms(9), &FRAME[..2]);
        let silent = ms(9) + CHARACTER + FRAME_GAP + CHARACTER;
        decoder.discard();
        assert_eq!((decoder.pending(), decoder.poll_timeout()), (&[][..], Some(silent)));
        assert_eq!(send(&mut decoder, ms(12), &FRAME), []);
        // It is told twice.
        decoder.discard();
        assert_eq!(decoder.handle_timeout(Instant::NEVER), None);
        assert_eq!(send(&mut decoder, ms(100), &FRAME), [Ok(FRAME)]);
    }

    #[test]
    fn a_silence_that_is_not_over_tells_nothing() {
        let mut decoder = FrameDecoder::new(Clock::TRUE);
        send(&mut decoder, ms(0), &FRAME[..3]);
        let deadline = decoder.poll_timeout().unwrap();
        assert_eq!(decoder.handle_timeout(deadline - Span::from_nanos(1)), None);
        assert_eq!(decoder.pending(), &FRAME[..3]);
        assert_eq!(decoder.handle_timeout(deadline), Some(Refusal::CutShort));
        assert_eq!((decoder.pending(), decoder.poll_timeout()), (&[][..], None));
    }

    #[test]
    fn a_begun_frame_that_comes_while_the_pc_stops_waits_for_it_to_go_on() {
        let mut decoder = FrameDecoder::new(Clock::TRUE);
        decoder.stop(ms(10));
        send(&mut decoder, ms(11), &FRAME[..2]);
        assert_eq!(decoder.poll_timeout(), None);
        decoder.go_on(ms(9_000));
        assert!(decoder.poll_timeout().is_some());
        assert_eq!(send(&mut decoder, ms(9_001), &FRAME[2..]), [Ok(FRAME)]);
    }

    #[test]
    fn a_begun_frame_that_comes_later_does_not() {
        let mut decoder = FrameDecoder::new(Clock::TRUE);
        decoder.stop(ms(10));
        send(&mut decoder, ms(14), &FRAME[..2]);
        assert!(decoder.poll_timeout().is_some_and(|deadline| deadline < ms(70)));
        assert_eq!(decoder.handle_timeout(Instant::NEVER), Some(Refusal::CutShort));
    }

    #[test]
    fn after_a_failure_a_held_pc_must_be_silent_after_xon() {
        let mut decoder = FrameDecoder::new(Clock::TRUE);
        decoder.hold(true);
        decoder.stop(ms(0));
        send(&mut decoder, ms(0), &FRAME[..2]);
        decoder.abandon(ms(5));
        assert_eq!(decoder.poll_timeout(), None);
        assert_eq!(send(&mut decoder, ms(2_000), &FRAME), [Err(Refusal::Faulted)]);
        decoder.hold(false);
        decoder.go_on(ms(3_000));
        assert_eq!(send(&mut decoder, ms(3_010), &FRAME), []);
        assert!(decoder.poll_timeout().is_some_and(|deadline| deadline > ms(3_060)));
        decoder.handle_timeout(Instant::NEVER);
        assert_eq!(send(&mut decoder, ms(4_000), &FRAME), [Ok(FRAME)]);
    }

    #[test]
    fn after_a_failure_the_silence_of_a_pc_that_is_not_held_counts_at_once() {
        let mut decoder = FrameDecoder::new(Clock::TRUE);
        send(&mut decoder, ms(0), &FRAME[..2]);
        decoder.abandon(ms(5));
        assert_eq!(send(&mut decoder, ms(10), &FRAME), [Err(Refusal::Faulted)]);
        let deadline = decoder.poll_timeout().unwrap();
        decoder.go_on(ms(20));
        assert_eq!(decoder.poll_timeout(), Some(deadline), "its silence has counted already");
        decoder.handle_timeout(Instant::NEVER);
        assert_eq!(send(&mut decoder, ms(500), &FRAME), [Ok(FRAME)]);
    }

    #[test]
    fn an_xon_that_was_decided_on_before_the_xoff_ends_nothing() {
        let mut decoder = FrameDecoder::new(Clock::TRUE);
        decoder.stop(ms(0));
        // Queued: the XON of the last hold, the XOFF of the next.
        decoder.hold(true);
        decoder.abandon(ms(1));
        decoder.go_on(ms(2));
        decoder.stop(ms(3));
        assert_eq!(decoder.poll_timeout(), None);
        decoder.hold(false);
        decoder.go_on(ms(900));
        assert!(decoder.poll_timeout().is_some_and(|deadline| deadline > ms(950)));
    }
}
