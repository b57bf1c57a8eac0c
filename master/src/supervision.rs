//! Supervises one slave: knows whether it is busy, enquires while it is, and counts the sub-frames that it is given.

use torno_protocol::lathe::{ACK, BEL, CAN, Fault, Parity};
use torno_protocol::time::{Instant, Span};

/// How a busy slave is watched. (Ours: the paper says that the master monitors, not how.)
#[derive(Clone, Copy, Debug)]
pub(crate) struct Patience {
    /// From one enquiry to the next.
    pub(crate) period: Span,
    /// How long an enquiry may go unanswered.
    pub(crate) answer: Span,
    /// How many enquiries in a row may go unanswered.
    pub(crate) enquiries: u32,
}

/// What the master knows of a slave.
#[derive(Clone, Debug)]
pub(crate) struct Supervision {
    patience: Patience,
    state: State,
    /// Nothing has been heard of it since the master's start: it may be at anything.
    unknown: bool,
    /// What it says once it has executed what it was given, if the master has the count.
    parity: Option<Parity>,
    /// Its parity did not fit: unless the next answer tells otherwise, it has missed its sub-frame.
    doubted: bool,
    /// `ACK` or `CAN` has come; the letter that follows says which or why.
    awaiting: Option<u8>,
    /// How it failed at what it was told last.
    failed: Option<Fault>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Waiting for instructions.
    Idle,
    /// Executing. The next enquiry is due, or the answer to the last one overdue, at the deadline.
    Busy { deadline: Instant, unanswered: u32, next_period: Instant },
    /// It does not answer.
    Lost,
}

/// What came of something that a slave sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Report {
    /// It is done with what it was told.
    Done,
    /// It has restarted while nothing was known of it.
    Started,
    /// It failed.
    Failed(Fault),
    /// It answers again.
    Back,
    /// Nothing new.
    Nothing,
    /// It makes no sense here.
    OutOfPlace,
}

/// What a deadline calls for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Due {
    /// The slave is to be asked whether it is there.
    Enquiry,
    /// It is lost: the PC must be told.
    Lost,
    /// No one waits for it.
    Nothing,
}

impl Supervision {
    /// Nothing is known of the slave. It is asked from `at` on.
    pub(crate) const fn new(patience: Patience, at: Instant) -> Self {
        let state = State::Busy { deadline: at, unanswered: 0, next_period: at };
        Self { patience, state, unknown: true, parity: None, doubted: false, awaiting: None, failed: None }
    }

    /// Watches like this from the next deadline on.
    pub(crate) const fn retune(&mut self, patience: Patience) {
        self.patience = patience;
    }

    /// The slave is being given its sub-frame. One that does not answer gets it too, but is not waited for.
    pub(crate) fn start(&mut self, now: Instant) {
        self.awaiting = None;
        self.failed = None;
        self.doubted = false;
        self.parity = self.parity.map(Parity::next);
        if self.state != State::Lost {
            self.watch(now);
        }
    }

    fn watch(&mut self, now: Instant) {
        let deadline = now + self.patience.period;
        self.state = State::Busy { deadline, unanswered: 0, next_period: deadline };
    }

    /// It is busy, for all that is known.
    pub(crate) fn is_busy(&self) -> bool {
        matches!(self.state, State::Busy { .. })
    }

    pub(crate) const fn is_unknown(&self) -> bool {
        self.unknown
    }

    pub(crate) fn is_lost(&self) -> bool {
        self.state == State::Lost
    }

    pub(crate) fn poll_timeout(&self) -> Option<Instant> {
        match self.state {
            State::Busy { deadline, .. } => Some(deadline),
            State::Idle | State::Lost => None,
        }
    }

    /// The deadline is due.
    pub(crate) fn handle_timeout(&mut self, now: Instant) -> Due {
        let State::Busy { unanswered, next_period, .. } = self.state else { return Due::Nothing };
        if unanswered >= self.patience.enquiries {
            self.state = State::Lost;
            (self.unknown, self.doubted, self.parity) = (false, false, None);
            return Due::Lost;
        }
        let next_period = if unanswered == 0 { now + self.patience.period } else { next_period };
        self.state = State::Busy { deadline: now + self.patience.answer, unanswered: unanswered + 1, next_period };
        Due::Enquiry
    }

    /// The slave sent a byte.
    pub(crate) fn byte(&mut self, now: Instant, byte: u8) -> Report {
        let begun = self.awaiting.take();
        let told = match begun {
            Some(ACK) => Parity::from_letter(byte).map(|parity| self.acknowledged(now, parity)),
            Some(CAN) => Fault::from_letter(byte).map(|fault| self.failed(fault)),
            _ => None,
        };
        if let Some(report) = told {
            return report;
        }
        match byte {
            ACK | CAN => {
                self.awaiting = Some(byte);
                if begun.is_some() { Report::OutOfPlace } else { Report::Nothing }
            }
            BEL => self.busy(now),
            _ => Report::OutOfPlace,
        }
    }

    /// A character from the slave was spoilt: what it belonged to is none.
    pub(crate) const fn spoilt(&mut self) {
        self.awaiting = None;
    }

    fn busy(&mut self, now: Instant) -> Report {
        match self.state {
            // It is still at what it was told before it was lost: what comes next must wait for it.
            State::Lost => {
                self.watch(now);
                Report::Back
            }
            State::Busy { next_period, .. } => {
                (self.unknown, self.doubted) = (false, false);
                self.state = State::Busy { deadline: next_period, unanswered: 0, next_period };
                Report::Nothing
            }
            State::Idle => Report::OutOfPlace,
        }
    }

    fn acknowledged(&mut self, now: Instant, parity: Parity) -> Report {
        let fits = self.parity.is_none_or(|expected| expected == parity);
        match self.state {
            State::Busy { next_period, .. } if !fits && !self.doubted => {
                // It may have been said before the sub-frame was sent. When that has arrived, the slave is asked.
                self.doubted = true;
                self.state = State::Busy { deadline: now + self.patience.answer, unanswered: 0, next_period };
                Report::Nothing
            }
            State::Busy { .. } => {
                (self.state, self.unknown, self.parity) = (State::Idle, false, Some(parity));
                if fits {
                    return Report::Done;
                }
                self.failed = Some(Fault::Garbled);
                Report::Failed(Fault::Garbled)
            }
            State::Lost => {
                (self.state, self.parity) = (State::Idle, Some(parity));
                Report::Back
            }
            // The answer to an enquiry that crossed the first one.
            State::Idle => {
                self.parity = Some(parity);
                Report::Nothing
            }
        }
    }

    /// A slave that says how it failed has answered, so it may be given new instructions.
    fn failed(&mut self, fault: Fault) -> Report {
        let unknown = core::mem::take(&mut self.unknown);
        self.parity = (fault == Fault::Restarted).then_some(Parity::Even);
        match (core::mem::replace(&mut self.state, State::Idle), fault) {
            (State::Lost, _) => Report::Back,
            (_, Fault::Restarted) if unknown => Report::Started,
            // The answer to an enquiry that is over: it has been given nothing to miss.
            (State::Idle, Fault::Garbled | Fault::Restarted) => Report::Nothing,
            // The answer to an enquiry that crossed the report.
            (State::Idle, _) if self.failed == Some(fault) => Report::Nothing,
            _ => {
                self.failed = Some(fault);
                Report::Failed(fault)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EVEN: [u8; 2] = [ACK, b'e'];
    const ODD: [u8; 2] = [ACK, b'o'];
    const PATIENCE: Patience = Patience { period: Span::from_secs(1), answer: Span::from_millis(20), enquiries: 3 };

    fn ms(ms: u64) -> Instant {
        Instant::START + Span::from_millis(ms)
    }

    fn say(slave: &mut Supervision, bytes: [u8; 2]) -> Report {
        assert_eq!(slave.byte(ms(1_005), bytes[0]), Report::Nothing);
        slave.byte(ms(1_006), bytes[1])
    }

    /// One that has started with the master.
    fn idle() -> Supervision {
        let mut slave = Supervision::new(PATIENCE, ms(0));
        assert_eq!(slave.handle_timeout(ms(0)), Due::Enquiry);
        assert_eq!(say(&mut slave, [CAN, b'r']), Report::Started);
        slave
    }

    fn busy() -> Supervision {
        let mut slave = idle();
        slave.start(ms(0));
        slave
    }

    fn lost() -> Supervision {
        let mut slave = busy();
        for at in [1000, 1020, 1040] {
            assert_eq!(slave.poll_timeout(), Some(ms(at)));
            assert_eq!(slave.handle_timeout(ms(at)), Due::Enquiry);
        }
        assert_eq!(slave.handle_timeout(ms(1060)), Due::Lost);
        assert_eq!(slave.handle_timeout(ms(1080)), Due::Nothing);
        slave
    }

    #[test]
    fn enquires_once_a_second() {
        let mut slave = busy();
        for second in 1..4 {
            assert_eq!(slave.poll_timeout(), Some(ms(1000 * second)));
            assert_eq!(slave.handle_timeout(ms(1000 * second)), Due::Enquiry);
            assert_eq!(slave.byte(ms(0), BEL), Report::Nothing);
        }
        assert_eq!(say(&mut slave, ODD), Report::Done);
        assert_eq!(slave.poll_timeout(), None);
    }

    #[test]
    fn the_third_unanswered_enquiry_loses_it() {
        let mut slave = lost();
        assert!(slave.is_lost() && !slave.is_busy());
        slave.start(ms(2000));
        assert!(slave.is_lost(), "instructions alone do not bring it back");
        assert_eq!(slave.byte(ms(0), ACK), Report::Nothing);
        assert_eq!(slave.byte(ms(1), b'e'), Report::Back);
    }

    #[test]
    fn one_that_comes_back_busy_is_waited_for() {
        let mut slave = lost();
        assert_eq!(slave.byte(ms(5000), BEL), Report::Back);
        assert_eq!(slave.poll_timeout(), Some(ms(6000)));
        assert_eq!(say(&mut slave, EVEN), Report::Done, "no one has the count any more");
        slave.start(ms(6_000));
        assert_eq!([say(&mut slave, EVEN), say(&mut slave, EVEN)][1], Report::Failed(Fault::Garbled));
    }

    #[test]
    fn an_answer_starts_the_count_anew() {
        let mut slave = busy();
        slave.handle_timeout(ms(1000));
        slave.handle_timeout(ms(1020));
        slave.byte(ms(0), BEL);
        assert_eq!(slave.poll_timeout(), Some(ms(2000)));
    }

    #[test]
    fn a_fault_is_reported_with_its_letter() {
        let mut slave = busy();
        assert_eq!(slave.byte(ms(0), CAN), Report::Nothing);
        assert_eq!(slave.byte(ms(0), b'e'), Report::Failed(Fault::EndOfTravel));
        assert!(!slave.is_busy() && !slave.is_lost());
    }

    #[test]
    fn a_failure_is_told_once_for_each_instruction() {
        let mut slave = busy();
        let mut stalled = |start| {
            if start {
                slave.start(ms(5_000));
            }
            [CAN, b's'].map(|byte| slave.byte(ms(0), byte))[1]
        };
        assert_eq!(stalled(false), Report::Failed(Fault::Stalled));
        assert_eq!(stalled(false), Report::Nothing, "an enquiry has crossed the report");
        assert_eq!(stalled(true), Report::Failed(Fault::Stalled));
    }

    #[test]
    fn a_missed_sub_frame_is_a_fault_only_of_a_slave_that_was_given_one() {
        let garbled = |mut slave: Supervision| [CAN, b'g'].map(|byte| slave.byte(ms(1_001), byte))[1];
        assert_eq!(garbled(busy()), Report::Failed(Fault::Garbled));
        assert_eq!(garbled(idle()), Report::Nothing);
        assert_eq!(garbled(lost()), Report::Back);
    }

    #[test]
    fn a_broken_fault_report_leaves_it_busy() {
        let mut slave = busy();
        slave.byte(ms(0), CAN);
        assert_eq!(slave.byte(ms(0), 0xff), Report::OutOfPlace);
        assert!(slave.is_busy());
    }

    #[test]
    fn an_idle_slave_that_has_taken_nothing_has_missed_its_sub_frame() {
        let mut slave = busy();
        assert_eq!(say(&mut slave, ODD), Report::Done);
        slave.start(ms(1_100));
        assert_eq!(say(&mut slave, ODD), Report::Nothing, "it may have been under way before");
        assert_eq!(slave.poll_timeout(), Some(ms(1_026)));
        assert_eq!(slave.handle_timeout(ms(1_026)), Due::Enquiry);
        assert_eq!(say(&mut slave, ODD), Report::Failed(Fault::Garbled));
        slave.start(ms(1_200));
        assert_eq!(say(&mut slave, EVEN), Report::Done, "and takes the next");
    }

    #[test]
    fn a_parity_that_does_not_fit_is_forgotten_when_the_slave_is_busy_after_all() {
        let mut slave = busy();
        say(&mut slave, EVEN);
        assert_eq!(slave.byte(ms(1_030), BEL), Report::Nothing);
        assert_eq!(say(&mut slave, EVEN), Report::Nothing, "not the second in a row");
        assert_eq!(say(&mut slave, ODD), Report::Done);
    }

    #[test]
    fn without_its_letter_an_ack_is_none() {
        let mut slave = busy();
        slave.byte(ms(0), ACK);
        assert_eq!(slave.byte(ms(1), b'd'), Report::OutOfPlace);
        assert_eq!(slave.byte(ms(2), b'o'), Report::OutOfPlace);
        slave.byte(ms(3), ACK);
        slave.spoilt();
        assert_eq!(slave.byte(ms(4), b'o'), Report::OutOfPlace);
        slave.byte(ms(5), ACK);
        assert_eq!(slave.byte(ms(6), ACK), Report::OutOfPlace, "the first one");
        assert_eq!(slave.byte(ms(7), b'o'), Report::Done);
    }

    #[test]
    fn a_reply_that_a_restart_cut_short_tells_nothing() {
        for begun in [ACK, CAN] {
            let mut slave = busy();
            assert_eq!(slave.byte(ms(0), begun), Report::Nothing);
            assert_eq!(slave.handle_timeout(ms(1_000)), Due::Enquiry, "it is still waited for");
            assert_eq!([CAN, b'r'].map(|byte| slave.byte(ms(1_005), byte))[1], Report::Failed(Fault::Restarted));
            slave.start(ms(2_000));
            assert_eq!(say(&mut slave, ODD), Report::Done);
        }
    }

    #[test]
    fn after_a_fault_the_slave_has_the_count() {
        let mut slave = busy();
        assert_eq!(say(&mut slave, [CAN, b's']), Report::Failed(Fault::Stalled));
        slave.start(ms(2_000));
        assert_eq!(say(&mut slave, EVEN), Report::Done);
        slave.start(ms(3_000));
        assert_eq!(say(&mut slave, EVEN), Report::Nothing);
        assert_eq!(say(&mut slave, [CAN, b'r']), Report::Failed(Fault::Restarted));
        slave.start(ms(4_000));
        assert_eq!(say(&mut slave, ODD), Report::Done, "it counts from 0 again");
    }

    #[test]
    fn what_a_slave_says_means_something_else_in_each_state() {
        let unknown = || {
            let mut slave = Supervision::new(PATIENCE, ms(0));
            slave.handle_timeout(ms(0));
            slave
        };
        use Report::{Back, Done, Failed, Nothing, OutOfPlace, Started};
        let fails = |fault| [Failed(fault), Failed(fault), Failed(fault), Back];
        // Answered so by one of which nothing is known, an idle one, a busy one, and one that was lost.
        for (reply, expected) in [
            ([CAN, b'r'], [Started, Nothing, Failed(Fault::Restarted), Back]),
            ([CAN, b'g'], [Failed(Fault::Garbled), Nothing, Failed(Fault::Garbled), Back]),
            ([CAN, b's'], fails(Fault::Stalled)),
            ([CAN, b'e'], fails(Fault::EndOfTravel)),
            ([CAN, b'n'], fails(Fault::NoAnswer)),
            (EVEN, [Done, Nothing, Nothing, Back]),
            (ODD, [Done, Nothing, Done, Back]),
        ] {
            let slaves = [unknown(), idle(), busy(), lost()];
            let doubts = reply == EVEN;
            for (mut slave, expected) in slaves.into_iter().zip(expected) {
                let was_busy_and_doubts = doubts && slave.is_busy() && !slave.is_unknown();
                assert_eq!(say(&mut slave, reply), expected, "{reply:?}");
                assert_eq!((slave.is_busy(), slave.is_unknown(), slave.is_lost()), (was_busy_and_doubts, false, false));
                assert_eq!(slave.poll_timeout().is_some(), was_busy_and_doubts);
            }
        }
        let bel = [unknown(), idle(), busy(), lost()].map(|mut slave| {
            let report = slave.byte(ms(1_005), BEL);
            (report, slave.is_busy(), slave.is_unknown(), slave.is_lost())
        });
        let still_busy = |report| (report, true, false, false);
        let idle = (OutOfPlace, false, false, false);
        assert_eq!(bel, [still_busy(Nothing), idle, still_busy(Nothing), still_busy(Back)]);
    }

    #[test]
    fn enquiries_follow_a_period_and_answers_a_limit_of_their_own() {
        let mut slave = busy();
        assert_eq!((slave.poll_timeout(), slave.handle_timeout(ms(1_003))), (Some(ms(1_000)), Due::Enquiry));
        assert_eq!(slave.poll_timeout(), Some(ms(1_023)), "an answer is due 20 ms after the enquiry");
        assert_eq!(slave.handle_timeout(ms(1_023)), Due::Enquiry);
        slave.byte(ms(1_030), BEL);
        assert_eq!(slave.poll_timeout(), Some(ms(2_003)), "and the next enquiry a second after the first");
        let quick = Patience { period: Span::from_millis(100), answer: Span::from_millis(8), enquiries: 2 };
        slave.retune(quick);
        assert_eq!(slave.poll_timeout(), Some(ms(2_003)));
        assert_eq!(slave.handle_timeout(ms(2_003)), Due::Enquiry);
        assert_eq!(slave.poll_timeout(), Some(ms(2_011)));
        assert_eq!(slave.handle_timeout(ms(2_011)), Due::Enquiry);
        assert_eq!((slave.handle_timeout(ms(2_019)), slave.poll_timeout()), (Due::Lost, None));
        slave.byte(ms(2_500), BEL);
        assert_eq!(slave.poll_timeout(), Some(ms(2_600)));
    }

    #[test]
    fn another_failure_is_told_although_one_has_been() {
        let mut slave = busy();
        assert_eq!(say(&mut slave, [CAN, b's']), Report::Failed(Fault::Stalled));
        assert_eq!(say(&mut slave, [CAN, b'e']), Report::Failed(Fault::EndOfTravel));
        assert_eq!(say(&mut slave, [CAN, b'e']), Report::Nothing);
    }

    #[test]
    fn a_parity_that_did_not_fit_is_no_doubt_about_the_next_sub_frame() {
        let mut slave = busy();
        assert_eq!(say(&mut slave, EVEN), Report::Nothing);
        assert_eq!(say(&mut slave, EVEN), Report::Failed(Fault::Garbled));
        slave.start(ms(2_000));
        assert_eq!(say(&mut slave, EVEN), Report::Nothing, "one answer alone is none");
        slave.start(ms(3_000));
        assert_eq!(say(&mut slave, ODD), Report::Nothing);
    }

    #[test]
    fn one_that_is_busy_at_the_masters_start_is_waited_for() {
        let mut slave = Supervision::new(PATIENCE, ms(2));
        assert_eq!((slave.is_busy(), slave.is_unknown(), slave.poll_timeout()), (true, true, Some(ms(2))));
        assert_eq!(slave.handle_timeout(ms(2)), Due::Enquiry);
        assert_eq!(slave.byte(ms(8), BEL), Report::Nothing);
        assert_eq!((slave.is_busy(), slave.is_unknown(), slave.poll_timeout()), (true, false, Some(ms(1_002))));
        assert_eq!(say(&mut slave, EVEN), Report::Done);
    }
}
