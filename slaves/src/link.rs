//! The link to the master: the part of the firmware that all slaves share.
//!
//! The master sends a sub-frame, the slave executes it and then says `ACK` and the parity of the sub-frames that it has
//! taken, or `CAN` and a letter if it fails. Asked with `ENQ`, it says `BEL` while busy, `CAN` and the letter while a
//! fault stands, and else `ACK` and the parity: [`torno_protocol::lathe`] tells what for.
//!
//! A sub-frame that it could not take is such a fault. It is told when asked only, since what is heard may as well be
//! noise on an idle line, and every time until a sub-frame is taken, since the answer may get lost. The same after
//! a start: whatever was being executed before is not. Before that has been told, no sub-frame is taken.
//!
//! (Ours: the paper only says that the slaves report the end of their process, §3.)

use std::collections::VecDeque;

use torno_protocol::clock::Clock;
use torno_protocol::lathe::{ACK, BEL, CAN, CHARACTER, ENQ, Fault, Parity, RATE, Refusal};
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::{Character, Loaded, Transmitter};

/// The longest time from one delivery to the next within a sub-frame, in characters of the slave's clock.
///
/// A delivery comes with a character's last sample; so this is one character and a silence of two. (Ours.)
const GAP_CHARACTERS: u64 = 3;

/// What the firmware tells, in the order of the boards' event texts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Event {
    /// The value is the byte.
    Dropped,
    /// The value is the number of bytes.
    CutShort,
    /// The value is the reason's letter.
    Refused,
    FramingError,
    Overrun,
    Done,
    Stalled,
    EndOfTravel,
    Reset,
}

impl Event {
    const TEXTS: [(Self, &'static str); 9] = [
        (Self::Dropped, "dropped byte {} out of place"),
        (Self::CutShort, "sub-frame cut short after {} bytes"),
        (Self::Refused, "sub-frame refused ({c})"),
        (Self::FramingError, "framing error"),
        (Self::Overrun, "overrun"),
        (Self::Done, "done"),
        (Self::Stalled, "stalled"),
        (Self::EndOfTravel, "end of travel"),
        (Self::Reset, "reset"),
    ];

    /// All texts, in order.
    pub(crate) fn texts() -> Vec<String> {
        Self::TEXTS.iter().map(|(_, text)| (*text).to_owned()).collect()
    }

    /// The place among the texts.
    pub(crate) const fn place(self) -> u8 {
        self as u8
    }

    const fn of(fault: Fault) -> Self {
        match fault {
            Fault::EndOfTravel => Self::EndOfTravel,
            // Of the others, a machine only ever finds itself stalled.
            Fault::Stalled | Fault::NoAnswer | Fault::Garbled | Fault::Restarted => Self::Stalled,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Idle,
    Busy,
    Faulted(Fault),
}

fn gap(clock: Clock) -> Span {
    clock.span(CHARACTER.times(GAP_CHARACTERS))
}

/// The slave's end of the link, for sub-frames of `N` bytes.
#[derive(Clone, Debug)]
pub(crate) struct Link<const N: usize> {
    gap: Span,
    state: State,
    /// Of the sub-frames taken since the start.
    parity: Parity,
    /// It has restarted and has not been asked since.
    untold: bool,
    sub_frame: [u8; N],
    length: usize,
    /// After the last character: the silence that separates sub-frames is over.
    gap_at: Instant,
    /// Something was out of place: until the next gap no one knows where a sub-frame would start.
    out_of_step: bool,
    transmitter: Transmitter,
    events: VecDeque<(Event, i64)>,
}

impl<const N: usize> Link<N> {
    /// An idle link of a slave whose clock is `clock`.
    pub(crate) fn new(clock: Clock) -> Self {
        Self {
            gap: gap(clock),
            state: State::Faulted(Fault::Restarted),
            parity: Parity::default(),
            untold: true,
            sub_frame: [0; N],
            length: 0,
            gap_at: Instant::START,
            out_of_step: false,
            transmitter: Transmitter::hardware(RATE, clock),
            events: VecDeque::new(),
        }
    }

    pub(crate) fn is_busy(&self) -> bool {
        self.state == State::Busy
    }

    /// Something will be sent although nothing more is received.
    pub(crate) fn is_about_to_speak(&self) -> bool {
        self.is_busy() || self.transmitter.poll_timeout().is_some() || self.holds_enquiry()
    }

    /// Takes a character; gives the sub-frame that is complete with it.
    pub(crate) fn receive(&mut self, now: Instant, character: Character) -> Option<[u8; N]> {
        if now > self.gap_at {
            self.gap_passed();
        }
        self.gap_at = now + self.gap;
        let Some(byte) = character.ok() else {
            self.tell(if character.framing_error { Event::FramingError } else { Event::Overrun }, 0);
            return self.lose_step();
        };
        if byte == ENQ && (N == 1 || self.is_busy()) {
            self.answer();
            return None;
        }
        if self.is_busy() || (N > 1 && self.out_of_step) {
            self.tell(Event::Dropped, i64::from(byte));
            return self.lose_step();
        }
        self.sub_frame[self.length] = byte;
        self.length += 1;
        if self.length < N {
            return None;
        }
        self.length = 0;
        if self.untold {
            self.tell(Event::Refused, i64::from(Fault::Restarted.letter()));
            return None;
        }
        Some(self.sub_frame)
    }

    /// The sub-frame cannot be executed. The master is told nothing: it asks.
    pub(crate) fn refuse(&mut self, refusal: Refusal) {
        self.tell(Event::Refused, i64::from(refusal.letter()));
        self.miss();
    }

    /// The sub-frame is being executed from now on.
    pub(crate) const fn start(&mut self) {
        self.state = State::Busy;
        self.parity = self.parity.next();
    }

    /// The sub-frame has been executed.
    pub(crate) fn finish(&mut self) {
        self.state = State::Idle;
        self.tell(Event::Done, 0);
        self.answer();
    }

    /// The machine has failed and stands until it gets another sub-frame.
    pub(crate) fn fail(&mut self, fault: Fault) {
        self.state = State::Faulted(fault);
        self.tell(Event::of(fault), 0);
        self.answer();
    }

    /// The firmware restarts. A character on the line goes on.
    pub(crate) fn reset(&mut self) {
        self.state = State::Faulted(Fault::Restarted);
        self.parity = Parity::default();
        self.untold = true;
        self.length = 0;
        self.out_of_step = false;
        self.transmitter.clear();
        self.tell(Event::Reset, 0);
    }

    /// The supply goes or comes: the firmware restarts, and no character is on the line.
    pub(crate) fn power(&mut self, clock: Clock) {
        let events = core::mem::take(&mut self.events);
        *self = Self { events, ..Self::new(clock) };
        self.tell(Event::Reset, 0);
    }

    /// Counts in `clock` from the next character on.
    pub(crate) fn retune(&mut self, clock: Clock) {
        self.gap = gap(clock);
        self.transmitter.retune(RATE, clock);
    }

    /// When the silence in a sub-frame has been too long, or the next character can be sent.
    pub(crate) fn poll_timeout(&self) -> Option<(Instant, &'static str)> {
        let gap = (self.length > 0).then_some((self.gap_at, "gap in a sub-frame"));
        let send = self.transmitter.poll_timeout().map(|at| (at, "transmitter free"));
        gap.into_iter().chain(send).reduce(|a, b| if b.0 < a.0 { b } else { a })
    }

    pub(crate) fn handle_timeout(&mut self, now: Instant) {
        if self.length > 0 && now >= self.gap_at {
            self.gap_passed();
        }
    }

    pub(crate) fn poll_event(&mut self) -> Option<(Event, i64)> {
        self.events.pop_front()
    }

    /// The next character that can go on the line at `now`.
    pub(crate) fn poll_character(&mut self, now: Instant) -> Option<Loaded> {
        self.transmitter.load(now)
    }

    fn gap_passed(&mut self) {
        self.out_of_step = false;
        if self.holds_enquiry() {
            self.answer();
        } else if self.length > 0 {
            self.tell(Event::CutShort, self.length as i64);
            self.miss();
        }
        self.length = 0;
    }

    /// A sub-frame may begin with the byte of an enquiry; only the silence after it tells them apart.
    fn holds_enquiry(&self) -> bool {
        self.length == 1 && self.sub_frame[0] == ENQ
    }

    fn answer(&mut self) {
        self.untold = false;
        match self.state {
            State::Idle => {
                self.transmitter.push(ACK);
                self.transmitter.push(self.parity.letter());
            }
            State::Busy => self.transmitter.push(BEL),
            State::Faulted(fault) => {
                self.transmitter.push(CAN);
                self.transmitter.push(fault.letter());
            }
        }
    }

    /// What may have been a sub-frame is not executed. Of a busy slave the master expects none, and of one that has
    /// restarted there is more to tell.
    fn miss(&mut self) {
        if !self.is_busy() && !self.untold {
            self.state = State::Faulted(Fault::Garbled);
        }
    }

    fn lose_step(&mut self) -> Option<[u8; N]> {
        self.miss();
        self.length = 0;
        self.out_of_step = true;
        None
    }

    fn tell(&mut self, event: Event, value: i64) {
        self.events.push_back((event, value));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;
    /// The parities after one sub-frame, which is the one that [`LinkBench::new`] has executed, and after two.
    const ONE: [u8; 2] = [ACK, b'o'];
    const TWO: [u8; 2] = [ACK, b'e'];

    /// What is sent and told after bytes that are delivered at the given times, in microseconds.
    struct LinkBench<const N: usize> {
        link: Link<N>,
        taken: Vec<[u8; N]>,
    }

    impl<const N: usize> LinkBench<N> {
        /// A slave that has been asked and has executed one sub-frame.
        fn new() -> Self {
            let mut link = Link::new(Clock::TRUE);
            link.answer();
            link.start();
            link.finish();
            link.transmitter.clear();
            link.events.clear();
            Self { link, taken: Vec::new() }
        }

        fn byte(&mut self, us: u64, byte: u8) {
            self.character(us, Character::good(byte));
        }

        fn character(&mut self, us: u64, character: Character) {
            self.taken.extend(self.link.receive(Instant::from_nanos(us * 1_000), character));
        }

        fn silence(&mut self, us: u64) {
            self.link.handle_timeout(Instant::from_nanos(us * 1_000));
        }

        fn sent(&mut self) -> Vec<u8> {
            let mut sent = Vec::new();
            while let Some(loaded) =
                self.link.poll_character(Instant::from_nanos(1_000_000 * MS).max(self.link.transmitter.free_at()))
            {
                sent.push(loaded.byte);
            }
            sent
        }

        fn told(&mut self) -> Vec<(Event, i64)> {
            core::iter::from_fn(|| self.link.poll_event()).collect()
        }
    }

    #[test]
    fn the_events_are_in_the_order_of_their_texts() {
        for (place, (event, _)) in Event::TEXTS.iter().enumerate() {
            assert_eq!(usize::from(event.place()), place);
        }
    }

    #[test]
    fn bytes_three_characters_apart_are_one_sub_frame() {
        let mut heard = LinkBench::<3>::new();
        [0, 3_124, 6_248].iter().zip([1, 2, 3]).for_each(|(us, byte)| heard.byte(*us, byte));
        assert_eq!(heard.taken, [[1, 2, 3]]);
        assert!(heard.link.poll_timeout().is_none());
    }

    #[test]
    fn a_longer_gap_drops_what_came_before_it() {
        let mut heard = LinkBench::<3>::new();
        heard.byte(0, 1);
        heard.byte(1_042, 2);
        assert_eq!(heard.link.poll_timeout().unwrap().0.as_nanos(), 1_042_000 + 3 * CHARACTER.as_nanos());
        // After a hang the timer has not been seen to; the silence counts all the same.
        heard.byte(4_168, 3);
        heard.byte(5_210, 4);
        heard.byte(6_252, 5);
        assert_eq!(heard.taken, [[3, 4, 5]]);
        assert_eq!(heard.told(), [(Event::CutShort, 2)]);
    }

    #[test]
    fn a_character_at_the_instant_at_which_the_gap_ends_still_belongs_to_the_sub_frame() {
        for (late, taken) in [(0, true), (1, false)] {
            let mut link = LinkBench::<2>::new().link;
            assert_eq!(link.receive(Instant::START, Character::good(1)), None);
            let at = Instant::START + CHARACTER.times(GAP_CHARACTERS) + Span::from_nanos(late);
            assert_eq!(link.receive(at, Character::good(2)).is_some(), taken);
        }
    }

    #[test]
    fn it_wants_to_run_at_the_earlier_of_a_gap_and_a_free_transmitter() {
        let mut heard = LinkBench::<4>::new();
        heard.byte(0, 1);
        let gap = (Instant::START + CHARACTER.times(GAP_CHARACTERS), "gap in a sub-frame");
        assert_eq!(heard.link.poll_timeout(), Some(gap));
        heard.link.answer();
        assert_eq!(heard.link.poll_timeout(), Some((Instant::START, "transmitter free")));
        let free = heard.link.poll_character(Instant::from_nanos(1_000)).unwrap().end;
        assert_eq!(heard.link.poll_timeout(), Some((free, "transmitter free")));
        heard.link.poll_character(free);
        heard.link.answer();
        let later = heard.link.poll_character(free + CHARACTER.times(2)).unwrap().end;
        assert!(later > gap.0);
        assert_eq!(heard.link.poll_timeout(), Some(gap));
    }

    #[test]
    fn a_lone_enq_is_an_enquiry_after_the_gap() {
        let mut heard = LinkBench::<4>::new();
        heard.byte(0, ENQ);
        heard.silence(3_124);
        assert!(heard.link.is_about_to_speak());
        assert_eq!(heard.sent(), []);
        heard.silence(3_125);
        assert!(heard.link.is_about_to_speak());
        assert_eq!(heard.sent(), ONE);
        assert!(!heard.link.is_about_to_speak());
    }

    #[test]
    fn a_sub_frame_may_begin_with_05() {
        let mut heard = LinkBench::<4>::new();
        (0..4).zip([ENQ, 0, 9, 1]).for_each(|(n, byte)| heard.byte(n * 1_042, byte));
        heard.silence(20_000);
        assert_eq!(heard.taken, [[ENQ, 0, 9, 1]]);
        assert_eq!(heard.sent(), []);
    }

    #[test]
    fn two_enquiries_at_once_are_none() {
        let mut heard = LinkBench::<4>::new();
        heard.byte(0, ENQ);
        heard.byte(1_042, ENQ);
        heard.silence(20_000);
        assert_eq!((heard.sent(), heard.told()), (vec![], vec![(Event::CutShort, 2)]));
    }

    #[test]
    fn one_that_has_started_anew_says_so_when_asked() {
        let mut heard = LinkBench::<1>::new();
        heard.link.start();
        heard.link.reset();
        assert_eq!(heard.sent(), [], "unasked it says nothing");
        heard.byte(0, ENQ);
        assert_eq!(heard.sent(), [CAN, b'r']);
    }

    #[test]
    fn a_restart_between_an_acknowledgement_and_its_parity_leaves_it_cut_short() {
        for power in [false, true] {
            let mut heard = LinkBench::<1>::new();
            heard.byte(0, ENQ);
            assert_eq!(heard.link.poll_character(Instant::START).map(|loaded| loaded.byte), Some(ACK));
            if power {
                heard.link.power(Clock::TRUE)
            } else {
                heard.link.reset()
            }
            assert_eq!(heard.sent(), []);
            heard.byte(2_000, ENQ);
            assert_eq!(heard.sent(), [CAN, b'r']);
        }
    }

    #[test]
    fn one_that_has_started_anew_takes_nothing_before_it_has_said_so() {
        let bad = Character { framing_error: true, ..Character::good(1) };
        for power in [false, true] {
            let mut heard = LinkBench::<1>::new();
            if power {
                heard.link.power(Clock::TRUE)
            } else {
                heard.link.reset()
            }
            heard.byte(0, 9);
            assert_eq!(heard.told(), [(Event::Reset, 0), (Event::Refused, i64::from(b'r'))]);
            heard.character(10_000, bad);
            heard.byte(20_000, ENQ);
            assert_eq!((heard.sent(), heard.taken.len()), (vec![CAN, b'r'], 0));
            heard.byte(30_000, 9);
            assert_eq!(heard.taken, [[9]]);
            heard.link.start();
            heard.link.finish();
            assert_eq!(heard.sent(), ONE, "it counts from 0 again");
        }
    }

    #[test]
    fn a_sub_frame_that_is_cut_to_the_byte_of_an_enquiry_is_not_counted() {
        let mut heard = LinkBench::<4>::new();
        heard.byte(0, ENQ);
        heard.silence(3_125);
        assert_eq!(heard.sent(), ONE, "as before it");
    }

    #[test]
    fn a_spindle_answers_enq_at_once() {
        let mut heard = LinkBench::<1>::new();
        heard.byte(0, ENQ);
        assert_eq!((heard.sent(), heard.taken.len()), (ONE.to_vec(), 0));
    }

    #[test]
    fn while_busy_enq_gives_bel_and_the_rest_is_dropped() {
        let mut heard = LinkBench::<3>::new();
        heard.link.start();
        heard.byte(0, 9);
        heard.byte(1_042, ENQ);
        assert_eq!((heard.sent(), heard.told()), (vec![BEL], vec![(Event::Dropped, 9)]));
        // What was begun while busy is not taken for a sub-frame after it.
        heard.link.finish();
        (2..5).for_each(|n| heard.byte(n * 1_042, 0));
        assert_eq!((heard.taken.len(), heard.sent()), (0, TWO.to_vec()));
        (0..3).for_each(|n| heard.byte(20_000 + n * 1_042, 0));
        assert_eq!(heard.taken.len(), 1);
    }

    #[test]
    fn a_standing_fault_is_told_again_until_the_next_start() {
        let mut heard = LinkBench::<1>::new();
        heard.link.start();
        heard.link.fail(Fault::Stalled);
        assert_eq!(heard.sent(), [CAN, b's']);
        heard.byte(0, ENQ);
        assert_eq!(heard.sent(), [CAN, b's']);
        heard.link.start();
        heard.link.finish();
        heard.byte(0, ENQ);
        assert_eq!(heard.sent(), [ONE, ONE].concat());
    }

    #[test]
    fn a_missed_sub_frame_is_told_when_asked_until_one_is_taken() {
        let bad = Character { framing_error: true, ..Character::good(1) };
        let misses: [fn(&mut LinkBench<3>, Character); 4] = [
            |heard, bad| heard.character(0, bad),
            |heard, _| (heard.byte(0, 1), heard.byte(1_042, 2)).1,
            |heard, _| heard.link.refuse(Refusal::Direction),
            // What follows a bad character in the same burst; then the silence.
            |heard, bad| (heard.character(0, bad), heard.byte(1_042, 2)).1,
        ];
        for miss in misses {
            let mut heard = LinkBench::<3>::new();
            miss(&mut heard, bad);
            heard.silence(9_000);
            assert_eq!(heard.sent(), [], "unasked it says nothing");
            for ask in [10_000, 30_000] {
                heard.byte(ask, ENQ);
                heard.silence(ask + 9_000);
                assert_eq!(heard.sent(), [CAN, b'g']);
            }
            heard.link.start();
            heard.link.finish();
            heard.byte(50_000, ENQ);
            heard.silence(60_000);
            assert_eq!(heard.sent(), [TWO, TWO].concat());
        }
    }

    #[test]
    fn noise_while_busy_is_no_missed_sub_frame() {
        let mut heard = LinkBench::<1>::new();
        heard.link.start();
        heard.character(0, Character { framing_error: true, ..Character::good(1) });
        heard.byte(10_000, 7);
        heard.link.finish();
        heard.byte(20_000, ENQ);
        assert_eq!(heard.sent(), [TWO, TWO].concat());
    }

    #[test]
    fn a_bad_character_drops_the_sub_frame_up_to_the_next_gap() {
        for (bad, event) in [
            (Character { byte: 1, framing_error: true, overrun: false }, Event::FramingError),
            (Character { byte: 1, framing_error: false, overrun: true }, Event::Overrun),
        ] {
            let mut heard = LinkBench::<3>::new();
            heard.byte(0, 0);
            heard.character(1_042, bad);
            (2..6).for_each(|n| heard.byte(n * 1_042, 0));
            assert_eq!(heard.taken.len(), 0);
            assert_eq!(heard.told()[0], (event, 0));
            (0..3).for_each(|n| heard.byte(20_000 + n * 1_042, 0));
            assert_eq!(heard.taken.len(), 1);
        }
    }

    #[test]
    fn a_reset_forgets_what_was_begun() {
        let mut heard = LinkBench::<3>::new();
        heard.byte(0, ENQ);
        heard.link.reset();
        assert_eq!((heard.link.poll_timeout(), heard.link.is_about_to_speak()), (None, false));
        heard.silence(20_000);
        assert_eq!(heard.sent(), []);
        // Of a fault and its letter, what is not on the line yet is lost.
        heard.link.fail(Fault::Stalled);
        assert_eq!(heard.link.poll_character(Instant::START).map(|loaded| loaded.byte), Some(CAN));
        heard.link.reset();
        assert_eq!(heard.sent(), []);
    }
}
