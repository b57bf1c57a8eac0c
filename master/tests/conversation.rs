//! The master's conversation, to the byte: characters in and out over real waveforms, the slaves played by the test.

#![allow(clippy::unwrap_used, reason = "in a test, a panic is an answer")]

use proptest::prelude::*;
use torno_master::{Master, MasterSettings};
use torno_protocol::board::{Board, Capability, Output, Stimulus, Wait, event_text};
use torno_protocol::clock::{Clock, Rate};
use torno_protocol::lathe::{ACK, BEL, CAN, CHARACTER, ENQ, NAK, RATE, Slave, XOFF, XON};
use torno_protocol::record::Heard;
use torno_protocol::stepping::Cell;
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::{Character, Receiver, Transmitter};

const FRAME: [u8; 8] = [0x4b, 0x70, 0x23, 0x28, 0x01, 0x00, 0x38, 0x00];
const AT_REST: [u8; 8] = [0; 8];
/// What slaves that have started with the master answer.
const STARTED: [u8; 2] = [CAN, b'r'];
const EVEN: [u8; 2] = [ACK, b'e'];
const ODD: [u8; 2] = [ACK, b'o'];

/// A master with the test at the other end of its four ports.
struct Bench {
    cell: Cell<Master>,
    now: Instant,
    transmitters: Vec<Transmitter>,
    receivers: Vec<Receiver>,
    /// Telemetry, events and cuts.
    outputs: Vec<Output>,
    /// How many sub-frames each slave has executed.
    sub_frames: [u64; 3],
}

impl Bench {
    fn new() -> Self {
        Self::with_pc_at(RATE)
    }

    /// The machine has been switched on, and all slaves have answered.
    fn with_pc_at(baud: Rate) -> Self {
        let mut bench = Self::switched_on(baud);
        bench.slaves_answer([&STARTED; 3]);
        bench.run(ms(2));
        assert_eq!(bench.received(0), [], "there is nothing to tell");
        bench
    }

    fn switched_on(baud: Rate) -> Self {
        let master = Master::new(&MasterSettings::default(), Clock::TRUE);
        let mut transmitters = vec![Transmitter::hardware(RATE, Clock::TRUE); 4];
        transmitters[0] = Transmitter::hardware(baud, Clock::TRUE);
        let receivers = vec![Receiver::hardware(RATE, Clock::TRUE); 4];
        let now = Instant::from_nanos(1_000_000);
        Self { cell: Cell::new(master), now, transmitters, receivers, outputs: Vec::new(), sub_frames: [0; 3] }
    }

    /// The master, just started, asks all slaves; these answer so.
    fn slaves_answer(&mut self, answers: [&[u8]; 3]) {
        self.run(ms(4));
        for (port, answer) in (1..).zip(answers) {
            assert_eq!(self.received(port), [ENQ]);
            self.send(port, answer);
        }
    }

    /// Sends bytes to a port back to back, and lets them arrive.
    fn send(&mut self, port: usize, bytes: &[u8]) {
        for byte in bytes {
            let transmitter = &mut self.transmitters[port];
            transmitter.push(*byte);
            let loaded = transmitter.load(self.now.max(transmitter.free_at())).unwrap();
            self.cell.hear(&Heard::Edges { port: port as u8, edges: loaded.edges });
            self.run_to(loaded.end);
        }
    }

    fn run_to(&mut self, until: Instant) {
        let Self { receivers, outputs, .. } = self;
        self.cell.run(until, |at, output| match output {
            Output::Character { port, edges, .. } => receivers[usize::from(port)].hear(&edges),
            Output::Cut { port } => {
                receivers[usize::from(port)].hear_cut(at);
                outputs.push(output);
            }
            Output::Telemetry { .. } | Output::Event { .. } | Output::Pin { .. } => outputs.push(output),
        });
        self.now = until;
    }

    /// A stimulus so many milliseconds from now.
    fn stimulate(&mut self, ms: u64, stimulus: Stimulus) {
        let at = self.now + Span::from_millis(ms);
        self.cell.hear(&Heard::Stimulus { at, stimulus });
    }

    fn run(&mut self, span: Span) {
        self.run_to(self.now + span);
    }

    /// What has arrived from a port by now.
    fn received(&mut self, port: usize) -> Vec<u8> {
        let now = self.now;
        let receiver = &mut self.receivers[port];
        let due =
            core::iter::from_fn(|| receiver.poll_timeout().filter(|at| *at < now).and_then(|at| receiver.take(at)));
        due.map(|character: Character| character.ok().unwrap()).collect()
    }

    fn replies(&mut self) -> Vec<u8> {
        self.run(Span::from_millis(5));
        self.received(0)
    }

    /// The telemetry, the events and the cuts since the last call, in words.
    fn told(&mut self) -> Vec<String> {
        let description = self.cell.board().description();
        let word = |output| match output {
            Output::Telemetry { signal, value } => format!("{}={value}", description.signals[usize::from(signal)].name),
            Output::Event { event, value } => event_text(&description.events[usize::from(event)], value),
            Output::Cut { port } => format!("{} is cut", description.ports[usize::from(port)]),
            Output::Character { .. } | Output::Pin { .. } => String::new(),
        };
        self.outputs.drain(..).map(word).collect()
    }

    /// A slave reports one sub-frame more.
    fn done(&mut self, port: usize) {
        self.sub_frames[port - 1] += 1;
        let parity = if self.sub_frames[port - 1].is_multiple_of(2) { EVEN } else { ODD };
        self.send(port, &parity);
    }

    /// All three slaves report done.
    fn slaves_done(&mut self) {
        (1..=3).for_each(|port| self.done(port));
    }
}

fn ms(ms: u64) -> Span {
    Span::from_millis(ms)
}

#[test]
fn a_frame_reaches_the_slaves_in_parts_and_is_acknowledged() {
    let mut bench = Bench::new();
    bench.send(0, &FRAME);
    bench.run(ms(10));
    assert_eq!(bench.received(1), FRAME[..1]);
    assert_eq!(bench.received(2), FRAME[1..5]);
    assert_eq!(bench.received(3), FRAME[5..]);
    assert_eq!(bench.replies(), [ACK]);
    bench.slaves_done();
    assert_eq!(bench.replies(), [XON]);
}

#[test]
fn the_acknowledgement_comes_when_the_longest_sub_frame_is_out() {
    let mut bench = Bench::new();
    bench.send(0, &FRAME);
    let sent = bench.now;
    bench.run_to(sent + CHARACTER.times(5) - ms(1));
    assert_eq!(bench.received(0), []);
    bench.run_to(sent + CHARACTER.times(5) + Span::from_micros(100));
    assert_eq!(bench.received(0), [ACK]);
}

#[test]
fn two_frames_in_one_write_give_ack_xoff_xon_ack_xon() {
    let mut bench = Bench::new();
    bench.send(0, &[FRAME, AT_REST].concat());
    assert_eq!(bench.replies(), [ACK, XOFF]);
    bench.slaves_done();
    bench.run(ms(10));
    assert_eq!(bench.received(2), [&FRAME[1..5], &AT_REST[1..5]].concat());
    assert_eq!(bench.replies(), [XON, ACK]);
    bench.slaves_done();
    assert_eq!(bench.replies(), [XON]);
}

#[test]
fn a_third_frame_is_refused_and_the_held_one_still_executed() {
    let mut bench = Bench::new();
    bench.send(0, &[FRAME, AT_REST, FRAME].concat());
    assert_eq!(bench.replies(), [ACK, XOFF, NAK, b'o']);
    bench.slaves_done();
    assert_eq!(bench.replies(), [XON]);
    assert_eq!(bench.replies(), [ACK]);
}

#[test]
fn an_invalid_frame_is_refused_at_once_also_while_slaves_are_busy() {
    let mut bench = Bench::new();
    let [mut direction, mut speed] = [FRAME; 2];
    direction[4] = 7;
    speed[0] = 3;
    bench.send(0, &direction);
    assert_eq!(bench.replies(), [NAK, b'd']);
    assert_eq!(bench.received(2), []);
    bench.send(0, &FRAME);
    bench.send(0, &speed);
    assert_eq!(bench.replies(), [ACK, NAK, b's']);
    bench.slaves_done();
    assert_eq!(bench.replies(), [XON]);
}

#[test]
fn what_has_come_of_a_frame_is_discarded_after_50_ms() {
    let mut bench = Bench::new();
    bench.send(0, &FRAME[..5]);
    bench.run(ms(60));
    assert_eq!(bench.received(0), [NAK, b'c']);
    bench.send(0, &FRAME);
    bench.run(ms(10));
    assert_eq!(bench.received(0), [ACK]);
}

#[test]
fn the_wrong_speed_is_a_line_error() {
    for baud in [1200, 2400, 4800, 19_200, 38_400] {
        let mut bench = Bench::with_pc_at(Rate::hz(baud));
        bench.send(0, &FRAME.repeat(2));
        bench.run(ms(60));
        assert_eq!(bench.received(0), [NAK, b'l'], "{baud} baud");
    }
}

#[test]
fn what_a_stopping_pc_still_sends_is_kept() {
    let mut bench = Bench::new();
    bench.send(0, &[&FRAME[..], &AT_REST, &FRAME[..2]].concat());
    assert_eq!(bench.replies(), [ACK, XOFF]);
    bench.run(ms(200));
    bench.slaves_done();
    bench.run(ms(10));
    assert_eq!(bench.received(0), [XON, ACK]);
    bench.send(0, &FRAME[2..]);
    assert_eq!(bench.replies(), [XOFF]);
}

#[test]
fn a_busy_slave_is_asked_once_a_second() {
    let mut bench = Bench::new();
    bench.send(0, &FRAME);
    bench.run(ms(20));
    (1..=3).for_each(|port| drop(bench.received(port)));
    [1, 3].into_iter().for_each(|port| bench.done(port));
    for _ in 0..5 {
        bench.run(ms(985));
        assert_eq!(bench.received(2), [ENQ]);
        bench.send(2, &[BEL]);
        bench.run(ms(14));
    }
    assert_eq!((bench.received(1), bench.received(3)), (vec![], vec![]));
    bench.done(2);
    assert_eq!(bench.replies(), [ACK, XON]);
}

#[test]
fn a_slave_that_does_not_answer_reaches_the_pc_within_three_seconds() {
    let mut bench = Bench::new();
    bench.send(0, &FRAME);
    bench.done(1);
    bench.done(2);
    bench.run(ms(1100));
    assert_eq!(bench.received(0), [ACK, CAN, b'd', b'n', XON]);
    assert_eq!(bench.received(3)[3..], [ENQ, ENQ, ENQ]);
}

#[test]
fn one_unanswered_enquiry_is_not_enough_to_give_a_slave_up() {
    let refused = |enquiries| MasterSettings { enquiries, ..MasterSettings::default() }.check().err();
    assert_eq!(refused(1).unwrap().to_string(), "enquiries: expected 2 to 10, found 1");
    assert_eq!(refused(2), None);
}

#[test]
fn a_slave_that_missed_its_sub_frame_has_failed_and_takes_the_next_frame() {
    let mut bench = Bench::new();
    bench.send(0, &FRAME);
    [1, 2].into_iter().for_each(|port| bench.done(port));
    bench.run(ms(1_005));
    bench.send(3, &[CAN, b'g']);
    assert_eq!(bench.replies(), [ACK, CAN, b'd', b'g', XON]);
    bench.run(ms(60));
    bench.send(0, &FRAME);
    bench.run(ms(10));
    assert_eq!(bench.received(0), [ACK]);
}

#[test]
fn after_a_failure_the_others_finish_before_the_pc_may_go_on() {
    let mut bench = Bench::new();
    bench.send(0, &[FRAME, AT_REST].concat());
    bench.run(ms(20));
    bench.send(3, &[CAN, b'e']);
    assert_eq!(bench.replies(), [ACK, XOFF, CAN, b'd', b'e']);
    bench.done(1);
    assert_eq!(bench.replies(), []);
    bench.done(2);
    assert_eq!(bench.replies(), [XON]);
    // The held frame has been dropped.
    bench.run(ms(500));
    assert_eq!(bench.received(0), []);
}

#[test]
fn after_a_failure_no_later_frame_runs_by_surprise() {
    let mut bench = Bench::new();
    bench.send(0, &FRAME);
    bench.run(ms(20));
    bench.send(2, &[CAN, b's']);
    bench.send(0, &FRAME);
    [1, 3].into_iter().for_each(|port| bench.done(port));
    bench.send(0, &[FRAME, FRAME].concat());
    assert_eq!(bench.replies(), [ACK, CAN, b't', b's', NAK, b'f', XON]);
    bench.run(ms(60));
    bench.send(0, &FRAME);
    bench.run(ms(10));
    assert_eq!(bench.received(0), [ACK]);
}

#[test]
fn after_a_failure_every_frame_after_a_gap_is_answered() {
    let mut bench = Bench::new();
    bench.send(0, &FRAME);
    bench.run(ms(20));
    bench.send(2, &[CAN, b's']);
    // The PC reads nothing, and goes on while the other slaves are at it.
    let mut answers = vec![bench.replies()];
    for _ in 0..3 {
        bench.send(0, &FRAME);
        answers.push(bench.replies());
        bench.run(ms(200));
    }
    let held = [vec![ACK, CAN, b't', b's'], vec![NAK, b'f'], vec![XOFF], vec![NAK, b'o']];
    assert_eq!(answers, held);
    [1, 3].into_iter().for_each(|port| bench.done(port));
    bench.run(ms(10));
    assert_eq!(bench.received(0), [XON, ACK]);
}

#[test]
fn a_frame_that_needs_a_lost_slave_is_refused_until_it_answers() {
    let mut bench = Bench::new();
    bench.send(0, &FRAME);
    [1, 2].into_iter().for_each(|port| bench.done(port));
    bench.run(ms(1200));
    bench.received(0);
    // Nothing for the depth axis to do: executed, and not waited for.
    let mut without_depth = FRAME;
    without_depth[6] = 0;
    bench.send(0, &without_depth);
    bench.run(ms(20));
    [1, 2].into_iter().for_each(|port| bench.done(port));
    assert_eq!(bench.replies(), [ACK, XON]);
    bench.received(3);
    bench.send(0, &FRAME);
    assert_eq!(bench.replies(), [NAK, b'f']);
    // Refused, but the slave has been asked; it answers.
    assert_eq!(bench.received(3), [ENQ]);
    bench.done(3);
    bench.send(0, &FRAME);
    bench.run(ms(10));
    assert_eq!(bench.received(0), [ACK]);
}

#[test]
fn silence_lies_between_an_enquiry_and_the_next_sub_frame() {
    let mut bench = Bench::new();
    bench.send(0, &[FRAME, AT_REST].concat());
    // The second has come while the first was distributed.
    let distributed = bench.now - CHARACTER.times(8);
    [1, 3].into_iter().for_each(|port| bench.done(port));
    // The transverse slave's ACK crosses the master's first enquiry.
    bench.run_to(distributed + ms(999));
    bench.received(2);
    bench.done(2);
    bench.run(ms(1));
    assert_eq!(bench.received(2), [ENQ]);
    // Its answer can be under way for so long.
    bench.run_to(distributed + ms(1000) + CHARACTER.times(8) + Span::from_micros(500));
    assert_eq!(bench.received(2), []);
    bench.run(ms(7));
    assert_eq!(bench.received(2), AT_REST[1..5]);
    assert_eq!(bench.received(0), [ACK, XOFF, XON, ACK]);
}

#[test]
fn a_reset_forgets_the_frame_but_takes_the_next() {
    let mut bench = Bench::new();
    bench.send(0, &[&FRAME[..], &FRAME[..3]].concat());
    bench.run(ms(10));
    (0..=3).for_each(|port| drop(bench.received(port)));
    bench.stimulate(0, Stimulus::Reset);
    bench.slaves_answer([&[BEL], &EVEN, &ODD]);
    assert_eq!(bench.replies(), [CAN, b'm', b'r']);
    bench.send(1, &ODD);
    assert_eq!(bench.replies(), [XON]);
    bench.run(ms(60));
    bench.send(0, &FRAME);
    bench.run(ms(10));
    assert_eq!(bench.received(0), [ACK]);
    [(1, EVEN), (2, ODD), (3, EVEN)].into_iter().for_each(|(port, done)| bench.send(port, &done));
    assert_eq!(bench.replies(), [XON], "it has taken over their counts");
}

#[test]
fn after_a_reset_nothing_reaches_a_slave_that_is_still_busy() {
    let mut bench = Bench::new();
    bench.send(0, &FRAME);
    bench.run(ms(20));
    (0..=3).for_each(|port| drop(bench.received(port)));
    bench.stimulate(0, Stimulus::Reset);
    bench.slaves_answer([&ODD, &[BEL], &ODD]);
    // The PC is not held and sends on.
    bench.send(0, &FRAME);
    assert_eq!(bench.replies(), [CAN, b'm', b'r', NAK, b'f']);
    bench.run(ms(985));
    for _ in 0..3 {
        assert_eq!(bench.received(2), [ENQ]);
        bench.send(2, &[BEL]);
        bench.run(ms(999));
    }
    assert_eq!(bench.received(2), [ENQ]);
    bench.send(2, &ODD);
    assert_eq!(bench.replies(), [XON]);
}

#[test]
fn after_a_start_a_frame_waits_until_the_slaves_are_known() {
    let mut bench = Bench::switched_on(RATE);
    bench.run(ms(4));
    assert_eq!([1, 2, 3].map(|port| bench.received(port)), [[ENQ]; 3]);
    bench.send(1, &STARTED);
    bench.send(0, &FRAME);
    assert_eq!(bench.replies(), [XOFF]);
    [2, 3].into_iter().for_each(|port| bench.send(port, &STARTED));
    bench.run(ms(20));
    assert_eq!(bench.received(0), [XON, ACK]);
}

#[test]
fn a_slave_that_does_not_answer_at_the_start_is_told_of_at_once() {
    let mut bench = Bench::switched_on(RATE);
    bench.run(ms(4));
    [1, 2].into_iter().for_each(|port| bench.send(port, &STARTED));
    bench.run(ms(70));
    assert_eq!(bench.received(0), [CAN, b'd', b'n', XON]);
}

#[test]
fn an_answer_that_is_spoilt_between_its_characters_is_none() {
    let mut bench = Bench::new();
    bench.send(0, &FRAME);
    [1, 3].into_iter().for_each(|port| bench.done(port));
    assert_eq!(bench.replies(), [ACK]);
    bench.send(2, &[ACK]);
    bench.transmitters[2] = Transmitter::hardware(Rate::hz(4800), Clock::TRUE);
    bench.send(2, &[0]);
    bench.transmitters[2] = Transmitter::hardware(RATE, Clock::TRUE);
    bench.send(2, &ODD[1..]);
    assert_eq!(bench.replies(), []);
    bench.done(2);
    assert_eq!(bench.replies(), [XON]);
}

#[test]
fn an_idle_slave_that_has_taken_nothing_has_missed_its_sub_frame() {
    let mut bench = Bench::new();
    bench.send(0, &FRAME);
    [1, 3].into_iter().for_each(|port| bench.done(port));
    bench.run(ms(980));
    bench.received(2);
    bench.run(ms(20));
    assert_eq!(bench.received(2), [ENQ]);
    bench.send(2, &EVEN);
    assert_eq!(bench.replies(), [ACK]);
    bench.run(ms(20));
    assert_eq!(bench.received(2), [ENQ], "it may have been said before");
    bench.send(2, &EVEN);
    assert_eq!(bench.replies(), [CAN, b't', b'g', XON]);
}

#[test]
fn a_slave_that_restarts_in_the_middle_of_its_reply_is_asked_and_has_failed() {
    let mut bench = Bench::new();
    bench.send(0, &FRAME);
    bench.run(ms(10));
    [1, 3].into_iter().for_each(|port| bench.done(port));
    bench.send(2, &[ACK]);
    assert_eq!(bench.replies(), [ACK]);
    bench.received(2);
    bench.run(ms(1_000));
    assert_eq!(bench.received(2), [ENQ]);
    bench.send(2, &STARTED);
    assert_eq!(bench.replies(), [CAN, b't', b'r', XON]);
}

#[test]
fn telemetry_and_events_tell_of_a_frame_and_of_each_slave() {
    let mut bench = Bench::new();
    bench.told();
    bench.send(0, &FRAME);
    bench.run(ms(10));
    assert_eq!(bench.told(), ["slaves_busy=7", "frame 1 distributed", "frames_distributed=1"]);
    bench.send(0, &FRAME);
    bench.run(ms(1));
    assert_eq!(bench.told(), ["frame held: slaves are busy", "frame_held=1"]);
    for (port, busy) in [(2, 5), (1, 4)] {
        bench.done(port);
        assert_eq!(bench.told(), [format!("slaves_busy={busy}")]);
    }
    bench.done(3);
    bench.run(ms(20));
    let expected = ["slaves_busy=0", "all slaves done", "frame_held=0", "slaves_busy=7", "frame 2 distributed"];
    assert_eq!(bench.told(), [&expected[..], &["frames_distributed=2"]].concat());
    for (port, busy) in [(3, 3), (2, 1), (1, 0)] {
        bench.done(port);
        assert_eq!(bench.told()[0], format!("slaves_busy={busy}"));
    }
}

#[test]
fn each_refusal_is_an_event() {
    let mut bench = Bench::new();
    bench.told();
    let refused = |reason: &str| vec![format!("frame refused: {reason}")];
    for (frame, reason) in [([1, 0, 0, 0, 0, 0, 0, 0], "speed"), ([0, 0, 0, 0, 2, 0, 0, 0], "direction")] {
        bench.send(0, &frame);
        assert_eq!(bench.told(), refused(reason));
    }
    bench.send(0, &FRAME[..4]);
    bench.run(ms(60));
    assert_eq!(bench.told(), refused("cut short"));
    bench.transmitters[0] = Transmitter::hardware(Rate::hz(4800), Clock::TRUE);
    bench.send(0, &[0x41]);
    bench.transmitters[0] = Transmitter::hardware(RATE, Clock::TRUE);
    bench.run(ms(100));
    let told = bench.told();
    assert_eq!(told[..2], ["framing error on the line from the PC", "frame refused: line error"]);
    bench.send(0, &FRAME);
    bench.run(ms(10));
    [FRAME, FRAME].iter().for_each(|frame| bench.send(0, frame));
    assert_eq!(bench.told().last(), refused("overrun").last());
    (1..=3).for_each(|port| bench.send(port, &[CAN, b's']));
    bench.told();
    bench.send(0, &FRAME);
    assert_eq!(bench.told(), refused("faulted"));
}

#[test]
fn a_pc_whose_characters_nobody_fetched_has_overrun() {
    let mut bench = Bench::new();
    bench.told();
    bench.stimulate(0, Stimulus::Hang(true));
    bench.stimulate(20, Stimulus::Hang(false));
    bench.send(0, &FRAME[..4]);
    bench.run(ms(30));
    let overrun = "overrun on the line from the PC";
    assert_eq!(bench.told(), [overrun, "frame refused: line error", overrun]);
    assert_eq!(bench.replies(), [NAK, b'l']);
}

#[test]
fn each_slave_fails_in_its_own_name() {
    for (port, letter) in [(1, 's'), (2, 't'), (3, 'd')] {
        for (fault, word) in
            [(b's', "stalled"), (b'e', "end of travel"), (b'g', "sub-frame garbled"), (b'r', "restarted")]
        {
            let mut bench = Bench::new();
            bench.send(0, &FRAME);
            bench.run(ms(10));
            bench.told();
            bench.send(port, &[CAN, fault]);
            let busy = 7 & !(1 << (port - 1));
            assert_eq!(bench.told(), [format!("slaves_busy={busy}"), format!("slave '{letter}' reports: {word}")]);
            assert_eq!(bench.replies(), [ACK, CAN, letter as u8, fault]);
        }
    }
}

#[test]
fn a_lost_slave_and_one_that_is_back_are_events() {
    for (port, letter) in [(1, 's'), (2, 't'), (3, 'd')] {
        let mut bench = Bench::new();
        bench.send(0, &FRAME);
        (1..=3).filter(|other| *other != port).for_each(|other| bench.done(other));
        bench.told();
        bench.run(ms(1_100));
        let busy = "slaves_busy=0".to_owned();
        assert_eq!(bench.told(), [busy, format!("slave '{letter}' does not answer"), "all slaves done".to_owned()]);
        assert_eq!(bench.replies(), [ACK, CAN, letter as u8, b'n', XON]);
        bench.send(port, &[BEL]);
        let busy = 1 << (port - 1);
        assert_eq!(bench.told(), [format!("slave '{letter}' answers again"), format!("slaves_busy={busy}")]);
    }
}

#[test]
fn what_makes_no_sense_on_a_slaves_line_is_an_event() {
    for (port, letter) in [(1, 's'), (2, 't'), (3, 'd')] {
        let mut bench = Bench::new();
        bench.told();
        bench.send(port, b"x");
        assert_eq!(bench.told(), [format!("a byte from slave '{letter}' makes no sense")]);
        bench.transmitters[port] = Transmitter::hardware(Rate::hz(4800), Clock::TRUE);
        bench.send(port, &[0x41]);
        bench.run(ms(5));
        assert_eq!(bench.told()[0], format!("line error from slave '{letter}'"));
    }
}

#[test]
fn a_restart_cuts_the_lines_and_puts_the_telemetry_back() {
    let mut bench = Bench::new();
    bench.send(0, &FRAME);
    bench.send(0, &FRAME);
    bench.told();
    bench.stimulate(0, Stimulus::Reset);
    bench.run(ms(1));
    let cuts = ["pc is cut", "spindle is cut", "transverse is cut", "depth is cut"];
    let expected = ["reset", "frames_distributed=0", "frame_held=0", "slaves_busy=0"];
    assert_eq!(bench.told(), [cuts, expected].concat());
    // It says that it has restarted as soon as it may speak, and asks all slaves then.
    bench.run(ms(3));
    assert_eq!([1, 2, 3].map(|port| bench.received(port).ends_with(&[ENQ])), [true; 3]);
    assert_eq!(bench.replies(), [ACK, CAN, b'm', b'r'], "the XOFF was cut");
}

#[test]
fn a_frame_is_refused_only_if_it_would_move_the_lost_slave() {
    // Moves one slave, and the other two only if it must not.
    let moves = [[10, 0, 0, 0, 0, 0, 0, 0], [0, 1, 0, 1, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0, 1, 0]];
    let others = [[0, 1, 0, 1, 0, 0, 1, 0], [10, 0, 0, 0, 0, 0, 1, 0], [10, 1, 0, 1, 0, 0, 0, 0]];
    for lost in 0..3 {
        let mut bench = Bench::switched_on(RATE);
        bench.run(ms(4));
        (1..=3).for_each(|port| _ = bench.received(port));
        (1..=3).filter(|port| *port != lost + 1).for_each(|port| bench.send(port, &STARTED));
        bench.run(ms(200));
        assert_eq!(bench.replies()[..1], [CAN]);
        bench.send(0, &moves[lost]);
        assert_eq!(bench.replies(), [NAK, b'f']);
        assert_eq!(bench.received(lost + 1).last(), Some(&ENQ), "it is asked whether it is back");
        bench.run(ms(50));
        bench.send(0, &others[lost]);
        bench.run(ms(15));
        assert_eq!(bench.received(0), [ACK]);
    }
}

#[test]
fn it_says_what_it_is() {
    let description = Bench::switched_on(RATE).cell.board().description();
    assert_eq!(description.ports, ["pc", "spindle", "transverse", "depth"]);
    let names: Vec<&str> = description.signals.iter().map(|signal| signal.name.as_str()).collect();
    assert_eq!(names, ["frames_distributed", "frame_held", "slaves_busy"]);
    assert!(description.signals.iter().all(|signal| signal.initial == 0));
    assert_eq!(description.waits, [Wait { signal: 2, ports: vec![1, 2, 3] }]);
    assert_eq!((description.capabilities, description.events.len()), (vec![Capability::Reset], 20));
}

#[test]
fn settings_have_these_ranges() {
    assert_eq!(MasterSettings::default().check(), Ok(()));
    let at = |enquiry_period_ms, answer_ms, enquiries| MasterSettings { enquiry_period_ms, answer_ms, enquiries };
    assert_eq!([at(100, 8, 2), at(10_000, 1_000, 10)].map(|settings| settings.check()), [Ok(()), Ok(())]);
    for (settings, expected) in [
        (at(99, 20, 3), "enquiry_period_ms: expected 100 to 10000, found 99"),
        (at(10_001, 20, 3), "enquiry_period_ms: expected 100 to 10000, found 10001"),
        (at(1_000, 7, 3), "answer_ms: expected 8 to 1000, found 7"),
        (at(1_000, 1_001, 3), "answer_ms: expected 8 to 1000, found 1001"),
        (at(1_000, 20, 1), "enquiries: expected 2 to 10, found 1"),
        (at(1_000, 20, 11), "enquiries: expected 2 to 10, found 11"),
    ] {
        assert_eq!(settings.check().unwrap_err().to_string(), expected);
    }
}

fn anything() -> impl Strategy<Value = Vec<(usize, Vec<u8>, u64)>> {
    let bytes = prop_oneof![
        prop::collection::vec(any::<u8>(), 1..12),
        Just(FRAME.to_vec()),
        Just(EVEN.to_vec()),
        Just(ODD.to_vec()),
        Just(vec![ACK]),
        Just(vec![CAN, b's']),
        Just(vec![BEL]),
    ];
    // Port 4: a reset instead.
    prop::collection::vec((0..5usize, bytes, 0..1_500u64), 0..40)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn whatever_comes_a_valid_frame_after_a_gap_is_obeyed(anything in anything()) {
        let mut bench = Bench::new();
        for (port, bytes, gap) in anything {
            match port {
                4 => bench.stimulate(0, Stimulus::Reset),
                _ => bench.send(port, &bytes),
            }
            bench.run(ms(gap));
        }
        // Let whatever is executing come to an end: the slaves have restarted.
        for _ in 0..3 {
            bench.run(ms(200));
            (1..=3).for_each(|port| bench.send(port, &STARTED));
        }
        bench.run(ms(200));
        (0..4).for_each(|port| drop(bench.received(port)));
        bench.send(0, &FRAME);
        bench.run(ms(15));
        prop_assert_eq!(bench.received(0), vec![ACK]);
        let sub_frames: Vec<Vec<u8>> = Slave::ALL.iter().map(|slave| bench.received(*slave as usize + 1)).collect();
        prop_assert_eq!(sub_frames, vec![FRAME[..1].to_vec(), FRAME[1..5].to_vec(), FRAME[5..].to_vec()]);
    }
}

/// What a held PC sends after `XON` goes on where it was stopped.
#[test]
fn line_error_while_the_pc_stops_does_not_put_the_rest_out_of_step() {
    let mut bench = Bench::new();
    bench.send(0, &FRAME);
    bench.run(ms(10));
    bench.send(0, &FRAME);
    bench.run(ms(1));
    // The PC, stopping, sends two more characters; noise spoils the second.
    bench.send(0, &AT_REST[..1]);
    bench.transmitters[0] = Transmitter::hardware(Rate::hz(4800), Clock::TRUE);
    bench.send(0, &[0]);
    bench.transmitters[0] = Transmitter::hardware(RATE, Clock::TRUE);
    assert_eq!(bench.replies(), [ACK, XOFF, NAK, b'l']);
    bench.run(ms(500));
    bench.slaves_done();
    bench.run(ms(20));
    assert_eq!(bench.replies(), [XON, ACK]);
    (1..=3).for_each(|port| drop(bench.received(port)));
    bench.slaves_done();
    assert_eq!(bench.replies(), [XON]);
    // The other six bytes of the spoiled frame, and the frame after it: nothing of these is a frame.
    bench.send(0, &[0, 0, 0, 0, 0, 0, 0, 10, 225, 0, 0, 0]);
    assert_eq!((bench.received(1), bench.replies()), (vec![], vec![]));
}

#[test]
fn a_master_that_loses_its_supply_is_silent_and_starts_anew() {
    for (answers, told) in [([&STARTED; 3], vec![]), ([&STARTED, &ODD, &STARTED], vec![CAN, b'm', b'r', XON])] {
        let mut bench = Bench::new();
        bench.send(0, &FRAME);
        bench.run(ms(20));
        assert_eq!(bench.replies(), [ACK]);
        bench.stimulate(1, Stimulus::Power(false));
        bench.stimulate(500, Stimulus::Power(true));
        let on = bench.now + ms(500);
        bench.run(ms(100));
        (1..=3).for_each(|port| _ = bench.received(port));
        // No one is there.
        bench.send(0, &AT_REST);
        bench.slaves_done();
        assert_eq!(bench.replies(), []);
        bench.run_to(on);
        // Whether the rest of the machine has lost its supply, too, is for the slaves to tell.
        bench.slaves_answer(answers.map(|answer| &answer[..]));
        bench.run(ms(100));
        assert_eq!(bench.received(0), told);
        bench.send(0, &AT_REST);
        bench.run(ms(10));
        assert_eq!(bench.received(0), [ACK]);
    }
}

#[test]
fn a_master_with_another_oscillator_speaks_and_hears_by_it() {
    let fast = Clock::from_ppb(100_000_000).unwrap();
    let mut bench = Bench::new();
    bench.cell.hear(&Heard::Stimulus { at: bench.now, stimulus: Stimulus::Clock(fast) });
    bench.run(Span::from_millis(5));
    // 10 % off, neither side understands the other; by its own clock both do, on the software UARTs too.
    bench.transmitters.fill(Transmitter::hardware(RATE, fast));
    bench.receivers.fill(Receiver::hardware(RATE, fast));
    bench.send(0, &FRAME);
    bench.run(Span::from_millis(20));
    assert_eq!(bench.received(2), FRAME[1..5]);
    bench.slaves_done();
    assert_eq!(bench.replies(), [ACK, XON]);
    // Its second is short: busy slaves are asked after 0.909 s.
    bench.send(0, &FRAME);
    bench.run(Span::from_millis(30));
    (1..=3).for_each(|port| _ = bench.received(port));
    bench.run(Span::from_millis(890));
    assert_eq!(bench.received(1), [ENQ]);
}
