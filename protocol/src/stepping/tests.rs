use super::*;
use crate::board::{Deadline, Description};
use crate::clock::{Clock, Rate};
use crate::line::{Edge, Level};
use crate::uart::Transmitter;

const BAUD: Rate = Rate::hz(9600);

fn ms(ms: u64) -> Instant {
    Instant::START + Span::from_millis(ms)
}

/// Counts what it hears, ticks every 30 ms, and speaks at 500 ms whatever it says of itself.
#[derive(Clone, Debug)]
struct Counter {
    claims_to_be_mute: bool,
    speaks: bool,
    tick: Instant,
    uart: Transmitter,
    outputs: VecDeque<Output>,
}

impl Counter {
    fn new(claims_to_be_mute: bool, speaks: bool) -> Self {
        let uart = Transmitter::hardware(BAUD, Clock::TRUE);
        Self { claims_to_be_mute, speaks, tick: ms(30), uart, outputs: VecDeque::new() }
    }
}

impl Board for Counter {
    fn description(&self) -> Description {
        Description { ports: vec!["port".to_owned()], ..Description::default() }
    }

    fn receivers(&self) -> Vec<Receiver> {
        vec![Receiver::hardware(BAUD, Clock::TRUE)]
    }

    fn handle_input(&mut self, _: Instant, input: Input) {
        if let Input::Character { character, .. } = input {
            let event = u8::from(character.overrun);
            self.outputs.push_back(Output::Event { event, value: i64::from(character.byte) });
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.outputs.push_back(Output::Telemetry { signal: 0, value: now.as_nanos() as i64 });
        self.tick = self.tick.max(now) + Span::from_millis(30);
        if self.speaks && now >= ms(500) {
            self.speaks = false;
            self.uart.push(b'!');
            let loaded = self.uart.load(now).unwrap();
            self.outputs.push_back(Output::Character { port: 0, edges: loaded.edges, end: loaded.end });
        }
    }

    fn poll_output(&mut self) -> Option<Output> {
        self.outputs.pop_front()
    }

    fn poll_timeout(&self) -> Option<Deadline> {
        Some(Deadline { at: self.tick, why: "tick" })
    }

    fn mute(&self) -> bool {
        self.claims_to_be_mute
    }

    fn kept(&self) -> Option<Kept> {
        Some(Kept { setting: "tick".to_owned(), lines: vec![self.tick.to_string()] })
    }
}

fn byte(byte: u8, at: Instant) -> Heard {
    let mut uart = Transmitter::hardware(BAUD, Clock::TRUE);
    uart.push(byte);
    Heard::Edges { port: 0, edges: uart.load(at).unwrap().edges }
}

fn grant(until: Instant, heard: Vec<Heard>) -> Grant {
    Grant { commit: Instant::START, until, heard }
}

#[test]
fn runs_ahead_to_the_next_output_and_promises_it() {
    let mut stepper = Stepper::new(Counter::new(false, true));
    let report = stepper.grant(grant(ms(1), vec![])).unwrap();
    let spoke = report.outputs.iter().find(|told| matches!(told.output, Output::Character { .. })).unwrap();
    assert_eq!(spoke.at, ms(510));
    assert!(report.horizon > spoke.at && report.mute_since.is_none());
}

#[test]
fn a_silent_board_is_run_ahead_to_the_cap_and_a_mute_one_not_at_all() {
    let report = Stepper::new(Counter::new(false, false)).grant(grant(ms(1), vec![])).unwrap();
    assert_eq!(report.horizon, ms(1110));
    let report = Stepper::new(Counter::new(true, false)).grant(grant(ms(1), vec![])).unwrap();
    assert_eq!((report.horizon, report.mute_since), (ms(30), Some(Instant::START)));
}

/// What comes of a mute board that catches up, in reports that are full with so many outputs.
fn caught_up(report_max: usize) -> (Vec<Timed>, usize) {
    let mut stepper = Stepper::new(Counter::new(true, false)).with_report_max(report_max);
    let (mut told, mut reports) = (Vec::new(), 0);
    let mut commit = Instant::START;
    loop {
        let report = stepper.grant(Grant { commit, until: ms(9_000), heard: vec![] }).unwrap();
        assert!(report.outputs.len() <= report_max && report.mute_since == Some(Instant::START));
        assert!(report.outputs.iter().all(|told| told.at < report.horizon));
        assert!(stepper.checkpoints.len() <= 2, "{}", stepper.checkpoints.len());
        (commit, reports) = (report.horizon, reports + 1);
        told.extend(report.outputs);
        if report.horizon >= ms(9_000) {
            return (told, reports);
        }
    }
}

/// Tells when its supply comes, and wants to run again at the same instant, and never before that or later.
#[derive(Clone, Debug, Default)]
struct Starter {
    deadline: Option<Instant>,
    tells: bool,
}

impl Board for Starter {
    fn description(&self) -> Description {
        Description::default()
    }

    fn receivers(&self) -> Vec<Receiver> {
        vec![]
    }

    fn handle_input(&mut self, now: Instant, input: Input) {
        self.tells = matches!(input, Input::Stimulus(Stimulus::Power(true)));
        self.deadline = self.tells.then_some(now);
    }

    fn handle_timeout(&mut self, _: Instant) {
        self.deadline = None;
    }

    fn poll_output(&mut self) -> Option<Output> {
        core::mem::take(&mut self.tells).then_some(Output::Event { event: 0, value: 0 })
    }

    fn poll_timeout(&self) -> Option<Deadline> {
        self.deadline.map(|at| Deadline { at, why: "start" })
    }

    fn mute(&self) -> bool {
        true
    }
}

#[test]
fn a_mute_board_tells_what_it_has_done_in_as_many_reports_as_it_takes() {
    let (expected, one) = caught_up(usize::MAX);
    assert_eq!((expected.len(), one), (299, 1));
    for (report_max, reports) in [(300, 1), (100, 3), (7, 43), (1, 299)] {
        assert_eq!(caught_up(report_max), (expected.clone(), reports));
    }
}

#[test]
fn what_a_board_has_told_is_not_told_anew_when_nothing_is_heard() {
    let mut stepper = Stepper::new(Starter::default());
    let power = |at, on| stimulus(at, Stimulus::Power(on));
    let mut left: Vec<Instant> = Vec::new();
    for (until, heard) in [(1, vec![power(ms(10), false), power(ms(20), true)]), (900, vec![])] {
        let report = stepper.grant(grant(ms(until), heard)).unwrap();
        // What lies at or after `from` takes the place of what was told of that time.
        left.retain(|at| *at < report.from);
        left.extend(report.outputs.iter().map(|told| told.at));
    }
    assert_eq!(left, [ms(20)]);
}

#[test]
fn what_is_heard_takes_back_what_was_told_from_its_effect_on() {
    let mut stepper = Stepper::new(Counter::new(false, false));
    stepper.grant(grant(ms(1), vec![])).unwrap();
    let report = stepper.grant(grant(ms(1), vec![byte(7, ms(100))])).unwrap();
    assert!(report.from > ms(100) && report.from < ms(101));
    assert_eq!(report.outputs[0].output, Output::Event { event: 0, value: 7 });
    assert!(report.outputs.iter().all(|told| told.at >= report.from));
}

#[test]
fn what_is_heard_next_may_matter_before_what_was_heard_last() {
    let mut stepper = Stepper::new(Counter::new(false, false));
    stepper.grant(grant(ms(1), vec![])).unwrap();
    let reset = Heard::Stimulus { at: ms(500), stimulus: Stimulus::Reset };
    stepper.grant(grant(ms(1), vec![reset])).unwrap();
    let report = stepper.grant(grant(ms(1), vec![byte(7, ms(100))])).unwrap();
    let ticks = report.outputs.iter().filter(|told| matches!(told.output, Output::Telemetry { .. }));
    assert!(report.from < ms(102));
    assert!(ticks.map(|told| told.at).take(20).eq((4..24).map(|n| ms(30 * n))));
}

#[test]
fn noise_that_has_become_certain_leaves_nothing_behind() {
    let mut stepper = Stepper::new(Counter::new(true, false));
    let mut size = |n: u64| {
        let (from, until) = (ms(n), ms(n + 1));
        // Some are seen and found to be no start bit, some are never seen.
        let edges = [(0, Level::Low), (5_000 * (n % 6), Level::High)];
        let edge = |(ns, level): &(u64, Level)| Edge { at: from + Span::from_nanos(*ns), level: *level };
        let heard = vec![Heard::Edges { port: 0, edges: edges.iter().map(edge).collect() }];
        stepper.grant(Grant { commit: from, until, heard }).unwrap();
        format!("{:?}", stepper.head.receivers).len()
    };
    let sizes: Vec<usize> = (1..1_000).map(&mut size).collect();
    assert!(sizes.iter().max() < Some(&(2 * sizes[100])), "{:?}", sizes.iter().max());
}

#[test]
fn a_broken_promise_is_named() {
    let mut stepper = Stepper::new(Counter::new(true, true));
    stepper.grant(grant(ms(1), vec![])).unwrap();
    assert_eq!(stepper.grant(grant(ms(1000), vec![])), Err(BrokenPromise { at: ms(510) }));
}

/// Concludes something 50 ms after each character.
#[derive(Clone, Debug, Default)]
struct Patient(Option<Instant>);

impl Board for Patient {
    fn description(&self) -> Description {
        Description { ports: vec!["port".to_owned()], ..Description::default() }
    }

    fn receivers(&self) -> Vec<Receiver> {
        vec![Receiver::hardware(BAUD, Clock::TRUE)]
    }

    fn handle_input(&mut self, now: Instant, _: Input) {
        self.0 = Some(now + Span::from_millis(50));
    }

    fn handle_timeout(&mut self, _: Instant) {
        self.0 = None;
    }

    fn poll_output(&mut self) -> Option<Output> {
        None
    }

    fn poll_timeout(&self) -> Option<Deadline> {
        self.0.map(|at| Deadline { at, why: "silence" })
    }

    fn silence(&self) -> Option<Instant> {
        self.0
    }
}

#[test]
fn a_silence_is_told_until_it_has_lasted_and_only_if_it_lasts() {
    let silences = |stepper: &mut Stepper<Patient>, heard| -> Vec<u64> {
        let report = stepper.grant(grant(ms(1), heard)).unwrap();
        report.silences.iter().map(|silence| silence.deadline.since(ms(0)).as_nanos() / 1_000_000).collect()
    };
    let mut stepper = Stepper::new(Patient::default());
    // The first is broken by the second character, 20 ms later.
    let heard = vec![byte(1, ms(100)), byte(2, ms(120)), byte(3, ms(300))];
    assert_eq!(silences(&mut stepper, heard), [170, 350]);
    assert_eq!(silences(&mut stepper, vec![byte(4, ms(340))]), [390], "broken after it was told");
    assert_eq!(silences(&mut stepper, vec![byte(5, ms(500))]), [550]);
}

#[test]
fn a_hung_board_does_nothing_and_its_fifo_overruns() {
    let mut cell = Cell::new(Counter::new(false, true));
    let hang = |at, hung| Heard::Stimulus { at, stimulus: Stimulus::Hang(hung) };
    [hang(ms(100), true), hang(ms(2000), false)].iter().for_each(|heard| cell.hear(heard));
    (1..=3).for_each(|n| cell.hear(&byte(n, ms(200 * u64::from(n)))));
    let mut told = Vec::new();
    cell.run(ms(2001), |at, output| told.push((at, output)));
    let during: Vec<_> = told.iter().filter(|(at, _)| *at >= ms(100) && *at < ms(2000)).collect();
    assert!(during.is_empty(), "{during:?}");
    let fetched: Vec<_> = told.iter().filter(|(_, output)| matches!(output, Output::Event { .. })).collect();
    let (first, second) = (Output::Event { event: 1, value: 1 }, Output::Event { event: 1, value: 2 });
    assert_eq!(fetched, [&(ms(2000), first), &(ms(2000), second)]);
    // The deadlines that passed meanwhile are due at once.
    assert!(told.iter().any(|(at, output)| *at == ms(2000) && matches!(output, Output::Character { .. })));
}

fn stimulus(at: Instant, stimulus: Stimulus) -> Heard {
    Heard::Stimulus { at, stimulus }
}

fn run(cell: &mut Cell<Counter>, until: Instant) -> Vec<(Instant, Output)> {
    let mut told = Vec::new();
    cell.run(until, |at, output| told.push((at, output)));
    told
}

/// When each character was handled, its byte, and whether it was marked as overrun.
fn characters(told: &[(Instant, Output)]) -> Vec<(u64, i64, bool)> {
    let character = |(at, output): &(Instant, Output)| match output {
        Output::Event { event, value } => Some((at.as_nanos() / 1_000_000, *value, *event == 1)),
        _ => None,
    };
    told.iter().filter_map(character).collect()
}

#[test]
fn slow_firmware_handles_one_thing_at_a_time_and_its_fifo_overruns() {
    let mut cell = Cell::new(Counter::new(false, false));
    cell.hear(&stimulus(ms(185), Stimulus::Slow(Span::from_millis(10))));
    (0..4).for_each(|n| cell.hear(&byte(1 + n, ms(190 + 2 * u64::from(n)))));
    cell.hear(&stimulus(ms(245), Stimulus::Slow(Span::ZERO)));
    let told = run(&mut cell, ms(280));
    assert_eq!(characters(&told), [(190, 1, false), (200, 2, true), (210, 3, true)]);
    let telemetry = told.iter().filter(|(_, output)| matches!(output, Output::Telemetry { .. }));
    let ticks: Vec<u64> = telemetry.map(|(at, _)| at.as_nanos() / 100_000).filter(|at| *at > 1_800).collect();
    // The tick of 210 ms waits for the last character; healed in mid-work, the firmware is free at once.
    assert_eq!(ticks, [2_209, 2_509]);
}

#[test]
fn a_slow_board_with_characters_to_fetch_is_not_mute() {
    let mut stepper = Stepper::new(Counter::new(true, false));
    let slow = stimulus(ms(1), Stimulus::Slow(Span::from_millis(100)));
    let report = stepper.grant(grant(ms(6), vec![slow, byte(1, ms(2)), byte(2, ms(4))])).unwrap();
    assert!(report.outputs.iter().any(|told| told.output == Output::Event { event: 0, value: 2 }));
    assert_eq!(report.mute_since.map(|since| since.as_nanos() / 1_000_000), Some(103));
}

#[test]
fn a_board_without_supply_is_cut_off_and_deaf_and_starts_with_nothing_in_its_ears() {
    let mut cell = Cell::new(Counter::new(false, true));
    let power = |at, on| stimulus(at, Stimulus::Power(on));
    // In mid-character; again without effect; back in mid-character.
    let (off, again, on) = (ms(510) + Span::from_micros(500), ms(600), ms(700) + Span::from_micros(50));
    cell.hear(&stimulus(ms(100), Stimulus::Hang(false)));
    [power(off, false), power(again, false), power(on, true), power(ms(800), true)].iter().for_each(|h| cell.hear(h));
    [(1, 509), (2, 550), (0xff, 700), (4, 720)].iter().for_each(|(n, at)| cell.hear(&byte(*n, ms(*at))));
    let told = run(&mut cell, ms(900));
    let cuts: Vec<_> = told.iter().filter(|(_, output)| matches!(output, Output::Cut { .. })).collect();
    assert_eq!(cuts, [&(off, Output::Cut { port: 0 })]);
    assert_eq!(characters(&told), [(510, 1, false), (720, 4, false)]);
    assert!(!told.iter().any(|(at, _)| *at > off && *at < on));
    assert!(told.iter().any(|(at, _)| *at == on), "its deadlines go on");
}

#[test]
fn power_on_ends_a_hang_and_empties_the_fifo() {
    let mut cell = Cell::new(Counter::new(false, false));
    let stimuli = [
        (100, Stimulus::Hang(true)),
        (300, Stimulus::Power(false)),
        (310, Stimulus::Hang(true)),
        (320, Stimulus::Power(true)),
        // The release of a hang that is over.
        (400, Stimulus::Hang(false)),
        (500, Stimulus::Hang(true)),
    ];
    stimuli.iter().for_each(|(at, what)| cell.hear(&stimulus(ms(*at), what.clone())));
    [(1, 200), (2, 350), (3, 510)].iter().for_each(|(n, at)| cell.hear(&byte(*n, ms(*at))));
    assert_eq!(characters(&run(&mut cell, ms(900))), [(350, 2, false)]);
}

/// It has been run ahead, and hears something that takes it back.
#[test]
fn what_a_board_keeps_is_what_it_keeps_at_that_instant() {
    let mut stepper = Stepper::new(Counter::new(true, false));
    let grants = [(ms(10), vec![]), (ms(1_000), vec![byte(b'a', ms(700))]), (ms(1_000), vec![byte(b'b', ms(1_100))])];
    for (until, heard) in grants {
        stepper.grant(grant(until, heard)).unwrap();
    }
    for at in [1, 29, 30, 31, 91, 700, 950, 1_400] {
        let kept = stepper.kept(ms(at)).unwrap();
        // It has ticked at what lies before.
        assert_eq!(kept.lines, [ms((at - 1) / 30 * 30 + 30).to_string()], "{at}");
    }
    let report = stepper.grant(Grant { commit: ms(1_400), until: ms(1_500), heard: vec![] }).unwrap();
    assert!(report.horizon >= ms(1_500));
    assert_eq!(stepper.kept(ms(1_400)).unwrap().lines, [ms(1_410).to_string()]);
}
