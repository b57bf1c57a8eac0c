//! Supervises one slave: knows whether it is busy, and enquires while it is.

use torno_protocol::lathe::{ACK, BEL, CAN, Fault};
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
    /// `CAN` has come; the letter that follows says why.
    cancelling: bool,
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
    /// Nobody waits for it.
    Nothing,
}

impl Supervision {
    pub(crate) const fn new(patience: Patience) -> Self {
        Self { patience, state: State::Idle, cancelling: false, failed: None }
    }

    /// Watches like this from the next deadline on.
    pub(crate) const fn retune(&mut self, patience: Patience) {
        self.patience = patience;
    }

    /// The slave is being given its part of a frame. One that does not answer gets it too, but is not waited for.
    pub(crate) fn start(&mut self, now: Instant) {
        self.cancelling = false;
        self.failed = None;
        if self.state != State::Lost {
            self.watch(now);
        }
    }

    fn watch(&mut self, now: Instant) {
        let deadline = now + self.patience.period;
        self.state = State::Busy { deadline, unanswered: 0, next_period: deadline };
    }

    pub(crate) fn is_busy(&self) -> bool {
        matches!(self.state, State::Busy { .. })
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
            return Due::Lost;
        }
        let next_period = if unanswered == 0 { now + self.patience.period } else { next_period };
        self.state = State::Busy { deadline: now + self.patience.answer, unanswered: unanswered + 1, next_period };
        Due::Enquiry
    }

    /// The slave sent a byte.
    pub(crate) fn byte(&mut self, now: Instant, byte: u8) -> Report {
        if core::mem::take(&mut self.cancelling) {
            return match Fault::from_letter(byte) {
                Some(fault) => self.failed(fault),
                None => Report::OutOfPlace,
            };
        }
        match (byte, self.state) {
            (CAN, _) => {
                self.cancelling = true;
                Report::Nothing
            }
            (ACK, State::Lost) => {
                self.state = State::Idle;
                Report::Back
            }
            // It is still at what it was told before it was lost: what comes next must wait for it.
            (BEL, State::Lost) => {
                self.watch(now);
                Report::Back
            }
            (ACK, State::Busy { .. }) => {
                self.state = State::Idle;
                Report::Done
            }
            // The answer to an enquiry that crossed the first `ACK`.
            (ACK, State::Idle) => Report::Nothing,
            (BEL, State::Busy { next_period, .. }) => {
                self.state = State::Busy { deadline: next_period, unanswered: 0, next_period };
                Report::Nothing
            }
            _ => Report::OutOfPlace,
        }
    }

    /// A slave that says how it failed has answered, so it may be given new instructions.
    fn failed(&mut self, fault: Fault) -> Report {
        match (core::mem::replace(&mut self.state, State::Idle), fault) {
            (State::Lost, _) => Report::Back,
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

    const PATIENCE: Patience = Patience { period: Span::from_secs(1), answer: Span::from_millis(20), enquiries: 3 };

    fn ms(ms: u64) -> Instant {
        Instant::START + Span::from_millis(ms)
    }

    fn busy() -> Supervision {
        let mut supervision = Supervision::new(PATIENCE);
        supervision.start(ms(0));
        supervision
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
        assert_eq!(slave.byte(ms(0), ACK), Report::Done);
        assert_eq!(slave.poll_timeout(), None);
    }

    #[test]
    fn the_third_unanswered_enquiry_loses_it() {
        let mut slave = lost();
        assert!(slave.is_lost() && !slave.is_busy());
        slave.start(ms(2000));
        assert!(slave.is_lost(), "instructions alone do not bring it back");
        assert_eq!(slave.byte(ms(0), ACK), Report::Back);
    }

    #[test]
    fn one_that_comes_back_busy_is_waited_for() {
        let mut slave = lost();
        assert_eq!(slave.byte(ms(5000), BEL), Report::Back);
        assert_eq!(slave.poll_timeout(), Some(ms(6000)));
        assert_eq!(slave.byte(ms(5500), ACK), Report::Done);
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
    fn a_missed_part_is_a_fault_only_of_a_slave_that_was_given_one() {
        let garbled = |mut slave: Supervision| [CAN, b'g'].map(|byte| slave.byte(ms(1_001), byte))[1];
        assert_eq!(garbled(busy()), Report::Failed(Fault::Garbled));
        assert_eq!(garbled(Supervision::new(PATIENCE)), Report::Nothing);
        assert_eq!(garbled(lost()), Report::Back);
    }

    #[test]
    fn a_broken_fault_report_leaves_it_busy() {
        let mut slave = busy();
        slave.byte(ms(0), CAN);
        assert_eq!(slave.byte(ms(0), 0xff), Report::OutOfPlace);
        assert!(slave.is_busy());
    }
}
