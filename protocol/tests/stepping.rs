//! The loop that steps a board: what reaches a board when, whatever state its firmware is in, and that it does not show
//! how time is cut.

#![allow(clippy::unwrap_used, reason = "part of tests")]

use std::collections::VecDeque;

use proptest::prelude::*;
use torno_protocol::board::{Board, Deadline, Description, Input, MotorStimulus, Output, Stimulus};
use torno_protocol::clock::{Clock, Rate};
use torno_protocol::record::{Grant, Heard, Timed};
use torno_protocol::stepping::{Cell, Stepper};
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::{Receiver, TickTimer, Transmitter};

const BAUD: Rate = Rate::hz(9600);
/// A hardware UART.
const HARD: u8 = 0;
/// A software UART.
const SOFT: u8 = 1;
/// From a character to its echo.
const ECHO: Span = Span::from_millis(3);

fn ms(ms: u64) -> Instant {
    Instant::START + Span::from_millis(ms)
}

/// Echoes each good character some time later, by the port that it came by, and reports all that reaches it.
#[derive(Clone, Debug)]
struct Echo {
    clock: Clock,
    hard_baud: Rate,
    due: VecDeque<(Instant, u8, u8)>,
    uarts: [Transmitter; 2],
    outputs: VecDeque<Output>,
    replaced: Option<(u8, Receiver)>,
    reached: Vec<(Instant, Input)>,
    now: Instant,
}

impl Echo {
    fn new(clock: Clock) -> Self {
        Self {
            clock,
            hard_baud: BAUD,
            due: VecDeque::new(),
            uarts: Self::uarts(clock),
            outputs: VecDeque::new(),
            replaced: None,
            reached: Vec::new(),
            now: Instant::START,
        }
    }

    fn uarts(clock: Clock) -> [Transmitter; 2] {
        [Transmitter::hardware(BAUD, clock), TickTimer::new(BAUD, clock).transmitter(0)]
    }

    fn restart(&mut self) {
        self.due.clear();
        self.uarts = Self::uarts(self.clock);
        self.outputs.extend([HARD, SOFT].map(|port| Output::Cut { port }));
    }

    fn load(&mut self) {
        for (port, uart) in (0..).zip(&mut self.uarts) {
            if let Some(loaded) = uart.load(self.now) {
                self.outputs.push_back(Output::Character { port, edges: loaded.edges, end: loaded.end });
            }
        }
    }
}

impl Board for Echo {
    fn description(&self) -> Description {
        Description { ports: ["hard", "soft"].map(str::to_owned).to_vec(), ..Description::default() }
    }

    fn receivers(&self) -> Vec<Receiver> {
        vec![Receiver::hardware(self.hard_baud, self.clock), TickTimer::new(BAUD, self.clock).receiver(0)]
    }

    fn handle_input(&mut self, now: Instant, input: Input) {
        self.now = now;
        self.outputs.push_back(Output::Telemetry { signal: 0, value: self.reached.len() as i64 + 1 });
        self.reached.push((now, input.clone()));
        match input {
            Input::Character { port, character } => {
                let errors = u8::from(character.framing_error) + 2 * u8::from(character.overrun);
                self.outputs.push_back(Output::Event { event: 4 * port + errors, value: i64::from(character.byte) });
                self.due.extend(character.ok().map(|byte| (now + self.clock.span(ECHO), port, byte)));
            }
            Input::Stimulus(Stimulus::Reset | Stimulus::Power(_)) => self.restart(),
            Input::Stimulus(Stimulus::Clock(clock)) => {
                self.clock = clock;
                self.uarts.iter_mut().zip(&Self::uarts(clock)).for_each(|(uart, tuned)| uart.keep_pace_with(tuned));
            }
            // Of this board it means: another speed on the port.
            Input::Stimulus(Stimulus::Motor { what: MotorStimulus::Load(baud), .. }) => {
                self.hard_baud = Rate::hz(baud.unsigned_abs());
                self.replaced = Some((HARD, Receiver::hardware(self.hard_baud, self.clock)));
            }
            Input::Stimulus(_) => {}
        }
        self.load();
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.now = now;
        while self.due.front().is_some_and(|(at, ..)| *at <= now)
            && let Some((_, port, byte)) = self.due.pop_front()
        {
            self.uarts[usize::from(port)].push(byte);
        }
        self.load();
    }

    fn poll_output(&mut self) -> Option<Output> {
        self.outputs.pop_front()
    }

    fn poll_receiver(&mut self) -> Option<(u8, Receiver)> {
        self.replaced.take()
    }

    fn poll_timeout(&self) -> Option<Deadline> {
        let loads = self.uarts.iter().filter_map(Transmitter::poll_timeout);
        let due = self.due.iter().map(|(at, ..)| *at);
        due.chain(loads).min().map(|at| Deadline { at, why: "an echo" })
    }
}

fn bytes_at(port: u8, at: Instant, baud: Rate, bytes: &[u8]) -> Vec<Heard> {
    let mut uart = Transmitter::hardware(baud, Clock::TRUE);
    bytes.iter().for_each(|byte| uart.push(*byte));
    let mut now = at;
    let character = |_: &u8| {
        let loaded = uart.load(now).unwrap();
        now = loaded.end;
        Heard::Edges { port, edges: loaded.edges }
    };
    bytes.iter().map(character).collect()
}

fn byte(port: u8, at_ms: u64, byte: u8) -> Heard {
    bytes_at(port, ms(at_ms), BAUD, &[byte]).remove(0)
}

fn stimulus(at_ms: u64, stimulus: Stimulus) -> Heard {
    Heard::Stimulus { at: ms(at_ms), stimulus }
}

fn cell(heard: &[Heard]) -> Cell<Echo> {
    let mut cell = Cell::new(Echo::new(Clock::TRUE));
    heard.iter().for_each(|heard| cell.hear(heard));
    cell
}

fn run(cell: &mut Cell<Echo>, until: Instant) -> Vec<Timed> {
    let mut told = Vec::new();
    cell.run(until, |at, output| told.push(Timed { at, output }));
    told
}

/// What reached the board: the millisecond, the port, the byte and whether it was marked as overrun.
fn characters(cell: &Cell<Echo>) -> Vec<(u64, u8, u8, bool)> {
    let character = |(at, input): &(Instant, Input)| match input {
        Input::Character { port, character } => {
            Some((at.as_nanos() / 1_000_000, *port, character.byte, character.overrun))
        }
        Input::Stimulus(_) => None,
    };
    cell.board().reached.iter().filter_map(character).collect()
}

fn stimuli(cell: &Cell<Echo>) -> Vec<(u64, Stimulus)> {
    let stimulus = |(at, input): &(Instant, Input)| match input {
        Input::Stimulus(stimulus) => Some((at.as_nanos() / 1_000_000, stimulus.clone())),
        Input::Character { .. } => None,
    };
    cell.board().reached.iter().filter_map(stimulus).collect()
}

/// When an echo was put on a line, and by which port.
fn echoes(told: &[Timed]) -> Vec<(u64, u8)> {
    let echo = |timed: &Timed| match timed.output {
        Output::Character { port, .. } => Some((timed.at.as_nanos() / 1_000_000, port)),
        _ => None,
    };
    told.iter().filter_map(echo).collect()
}

#[test]
fn a_character_reaches_the_board_by_the_port_that_it_came_by() {
    let mut cell = cell(&[byte(SOFT, 10, 7), byte(HARD, 20, 8), byte(SOFT + 1, 30, 9)]);
    let told = run(&mut cell, ms(100));
    assert_eq!(characters(&cell), [(10, SOFT, 7, false), (20, HARD, 8, false)]);
    assert_eq!(echoes(&told), [(13, SOFT), (23, HARD)]);
    assert_eq!(cell.poll_timeout(), None);
}

#[test]
fn everything_before_an_instant_is_run_and_nothing_at_it() {
    let mut cell = cell(&[stimulus(10, MotorStimulus::Supply(1).of(0)), stimulus(20, MotorStimulus::Supply(2).of(0))]);
    assert_eq!(cell.poll_timeout(), Some(ms(10)));
    run(&mut cell, ms(10));
    assert_eq!(stimuli(&cell), []);
    run(&mut cell, ms(20));
    assert_eq!((stimuli(&cell), cell.poll_timeout()), (vec![(10, MotorStimulus::Supply(1).of(0))], Some(ms(20))));
}

#[test]
fn stimuli_are_ordered_by_instant_and_those_of_one_instant_by_arrival() {
    let told = [(20, 1), (10, 2), (20, 3), (10, 4), (15, 5)];
    let mut cell = cell(&told.map(|(at, n)| stimulus(at, MotorStimulus::Supply(n).of(0))));
    run(&mut cell, ms(30));
    let expected = [(10, 2), (10, 4), (15, 5), (20, 1), (20, 3)];
    assert_eq!(stimuli(&cell), expected.map(|(at, n)| (at, MotorStimulus::Supply(n).of(0))));
}

#[test]
fn a_stimulus_comes_before_the_character_and_the_deadline_of_its_instant() {
    let mut alone = cell(&[byte(HARD, 10, 7)]);
    let delivery = alone.poll_timeout().unwrap();
    run(&mut alone, ms(12));
    let echo = alone.poll_timeout().unwrap();
    for (at, reached) in [(delivery, true), (echo, false)] {
        let reset = Heard::Stimulus { at, stimulus: Stimulus::Reset };
        let mut cell = cell(&[byte(HARD, 10, 7), reset]);
        let told = run(&mut cell, ms(30));
        assert_eq!(cell.board().reached[0].1 == Input::Stimulus(Stimulus::Reset), reached);
        assert_eq!(echoes(&told).len(), usize::from(reached), "a reset forgets the echo that is due");
    }
}

#[test]
fn a_cut_line_is_idle_from_there_on() {
    let whole = byte(HARD, 10, 0);
    let cut = Heard::Cut { port: HARD, at: ms(10) + Span::from_nanos(5 * 104_167) };
    let nowhere = Heard::Cut { port: 2, at: ms(10) };
    let mut cell = cell(&[whole, cut, nowhere]);
    run(&mut cell, ms(20));
    assert_eq!(characters(&cell), [(10, HARD, 0xf0, false)]);
}

#[test]
fn a_hung_board_loses_what_its_software_uart_would_have_sampled() {
    for (halts, goes_on) in
        [(Stimulus::Hang(true), Stimulus::Hang(false)), (Stimulus::Stop(true), Stimulus::Stop(false))]
    {
        let heard = [stimulus(5, halts), byte(HARD, 10, 7), byte(SOFT, 10, 8), stimulus(50, goes_on)];
        let mut cell = cell(&heard);
        let told = run(&mut cell, ms(100));
        assert_eq!(characters(&cell), [(50, HARD, 7, false)]);
        assert_eq!(echoes(&told), [(53, HARD)]);
    }
}

#[test]
fn hangs_are_counted_and_stops_are_not() {
    let twice = |halts: Stimulus, goes_on: Stimulus| {
        let mut cell = cell(&[
            stimulus(5, halts.clone()),
            stimulus(6, halts),
            stimulus(20, goes_on.clone()),
            byte(HARD, 30, 7),
            stimulus(50, goes_on),
        ]);
        run(&mut cell, ms(100));
        characters(&cell)[0].0
    };
    assert_eq!(twice(Stimulus::Hang(true), Stimulus::Hang(false)), 50);
    assert_eq!(twice(Stimulus::Stop(true), Stimulus::Stop(false)), 30);
}

#[test]
fn deadlines_of_a_board_that_is_hung_and_stopped_wait_for_both_to_end() {
    for order in [[true, false], [false, true]] {
        let ends = |hang: bool| if hang { Stimulus::Hang(false) } else { Stimulus::Stop(false) };
        let mut cell = cell(&[
            byte(HARD, 10, 7),
            stimulus(12, Stimulus::Hang(true)),
            stimulus(12, Stimulus::Stop(true)),
            stimulus(30, ends(order[0])),
            stimulus(40, ends(order[1])),
        ]);
        assert_eq!(echoes(&run(&mut cell, ms(100))), [(40, HARD)]);
    }
}

#[test]
fn a_restart_that_falls_into_a_stop_happens_when_the_process_goes_on() {
    let mut cell = cell(&[
        stimulus(5, Stimulus::Stop(true)),
        stimulus(10, Stimulus::Reset),
        stimulus(11, MotorStimulus::Supply(3).of(0)),
        stimulus(12, Stimulus::Power(false)),
        stimulus(30, Stimulus::Stop(false)),
        stimulus(40, Stimulus::Stop(false)),
    ]);
    run(&mut cell, ms(100));
    let expected = [(11, MotorStimulus::Supply(3).of(0)), (30, Stimulus::Reset), (30, Stimulus::Power(false))];
    assert_eq!(stimuli(&cell), expected);
}

#[test]
fn slow_firmware_keeps_the_last_character_of_a_software_uart_only() {
    let slow = stimulus(5, Stimulus::Slow(Span::from_millis(10)));
    let heard = [slow, byte(SOFT, 10, 1), byte(SOFT, 12, 2), byte(SOFT, 14, 3), byte(HARD, 15, 4)];
    let mut cell = cell(&heard);
    let told = run(&mut cell, ms(100));
    assert_eq!(characters(&cell), [(10, SOFT, 1, false), (20, HARD, 4, false), (30, SOFT, 3, false)]);
    // The deadline of 13 ms waits for all of them; each echo takes as long again.
    assert_eq!(echoes(&told), [(40, HARD), (40, SOFT), (50, SOFT)]);
}

#[test]
fn without_supply_a_board_is_told_of_its_plant_and_its_oscillator_only() {
    let clock = Stimulus::Clock(Clock::from_ppb(1_000_000).unwrap());
    let reaches =
        [MotorStimulus::Supply(1).of(0), MotorStimulus::Stall(true).of(0), clock, MotorStimulus::Load(3).of(1)];
    let does_not = [
        Stimulus::Reset,
        Stimulus::Write(vec![1]),
        Stimulus::Discard,
        MotorStimulus::Drive(5).of(0),
        MotorStimulus::Drive(5).of(1),
        Stimulus::Power(false),
    ];
    let all = || reaches.iter().chain(&does_not).cloned();
    let mut off: Vec<Heard> = all().map(|what| stimulus(20, what)).collect();
    off.push(stimulus(10, Stimulus::Power(false)));
    let mut without = cell(&off);
    run(&mut without, ms(30));
    let reached: Vec<Stimulus> = stimuli(&without).into_iter().map(|(_, what)| what).collect();
    assert_eq!(reached, [&[Stimulus::Power(false)], &reaches[..]].concat());
    let mut with = cell(&all().map(|what| stimulus(20, what)).collect::<Vec<_>>());
    run(&mut with, ms(30));
    assert_eq!(stimuli(&with).len(), reaches.len() + does_not.len());
}

#[test]
fn without_supply_nothing_leaves_a_board_but_telemetry_and_its_lines_are_cut_once() {
    let mut cell = cell(&[
        byte(HARD, 8, 7),
        stimulus(10, Stimulus::Power(false)),
        stimulus(20, MotorStimulus::Supply(1).of(0)),
        byte(HARD, 30, 8),
        stimulus(40, Stimulus::Power(true)),
        byte(HARD, 50, 9),
        stimulus(60, Stimulus::Reset),
    ]);
    let told = run(&mut cell, ms(59));
    let since = told.iter().filter(|timed| timed.at >= ms(10) && timed.at < ms(50)).cloned().collect::<Vec<_>>();
    let at = |at, output| Timed { at: ms(at), output };
    let telemetry = |value| Output::Telemetry { signal: 0, value };
    let cuts = [HARD, SOFT].map(|port| at(10, Output::Cut { port }));
    let expected = [at(10, telemetry(2)), at(20, telemetry(3)), at(40, telemetry(4))];
    assert_eq!(since, [&cuts[..], &expected].concat());
    assert_eq!(characters(&cell).last(), Some(&(50, HARD, 9, false)));
    // With supply a restart cuts them itself.
    let cuts = run(&mut cell, ms(70)).into_iter().filter(|timed| matches!(timed.output, Output::Cut { .. }));
    assert_eq!(cuts.count(), 2);
}

#[test]
fn a_board_hears_by_its_new_clock_and_by_its_new_speed() {
    let fast = Clock::from_ppb(100_000_000).unwrap();
    let fast_byte = |at| bytes_at(HARD, ms(at), Rate::fraction(96_000, 9), &[0x55]).remove(0);
    let cell_of = |what: Stimulus, heard: Heard| {
        let mut cell = cell(&[stimulus(5, what), heard]);
        run(&mut cell, ms(50));
        characters(&cell).first().map(|(_, _, byte, _)| *byte)
    };
    assert_eq!(cell_of(Stimulus::Clock(fast), fast_byte(10)), Some(0x55));
    assert_ne!(cell_of(MotorStimulus::Supply(1).of(0), fast_byte(10)), Some(0x55));
    let quick = bytes_at(HARD, ms(10), Rate::hz(19_200), &[0x55]).remove(0);
    assert_eq!(cell_of(MotorStimulus::Load(19_200).of(0), quick.clone()), Some(0x55));
    assert_ne!(cell_of(MotorStimulus::Supply(1).of(0), quick), Some(0x55));
}

/// Since when the board is mute, in milliseconds, once all before `until` has been run.
fn mute_since(heard: &[Heard], until: u64) -> Option<u64> {
    let mut stepper = Stepper::new(Echo::new(Clock::TRUE));
    let grant = Grant { commit: Instant::START, until: ms(until), heard: heard.to_vec() };
    stepper.grant(grant).unwrap().mute_since.map(|since| since.as_nanos() / 1_000_000)
}

#[test]
fn a_board_is_mute_while_nothing_can_make_it_speak() {
    // A character on its line, an echo to come, a stimulus to come: run on until they are over.
    assert_eq!(mute_since(&[], 5), Some(0));
    assert_eq!(mute_since(&[byte(HARD, 10, 7)], 5), Some(13));
    assert_eq!(mute_since(&[stimulus(10, MotorStimulus::Supply(1).of(0))], 5), Some(10));
    // Hung, it is mute although an echo is due, and so is one without supply.
    for halts in [Stimulus::Hang(true), Stimulus::Stop(true), Stimulus::Power(false)] {
        assert_eq!(mute_since(&[byte(HARD, 10, 7), stimulus(12, halts)], 5), Some(12));
    }
    // What waits to be fetched will be answered.
    let slow = stimulus(5, Stimulus::Slow(Span::from_millis(10)));
    assert_eq!(mute_since(&[slow, byte(HARD, 10, 1), byte(HARD, 12, 2)], 41), Some(40));
}

#[test]
fn a_board_is_run_on_for_a_while_after_it_has_spoken() {
    let horizon = |echoes: &[u64]| {
        let mut stepper = Stepper::new(Echo::new(Clock::TRUE));
        let mut heard: Vec<Heard> = echoes.iter().map(|at| byte(HARD, at - 4, 7)).collect();
        // Something that keeps it from being mute.
        heard.push(stimulus(900, MotorStimulus::Supply(1).of(0)));
        let report = stepper.grant(Grant { commit: Instant::START, until: ms(1), heard }).unwrap();
        report.horizon.as_nanos() / 1_000_000
    };
    assert_eq!(horizon(&[10]), 900, "at least to the next thing");
    assert_eq!(horizon(&[10, 18, 100]), 96, "an echo of 18 ms is within ten of the first");
    assert_eq!(horizon(&[10, 30, 40]), 26);
    assert_eq!(horizon(&[10, 18, 26, 34, 42, 50]), 23, "but not for ever");
}

#[derive(Clone, Debug)]
enum Act {
    Byte(u8, u8),
    Happens(Stimulus),
}

/// What reaches a board; its speed is set to one of `speeds`, in baud.
fn acts(speeds: std::ops::Range<i32>) -> impl Strategy<Value = Vec<(u64, Act)>> {
    let happens = prop_oneof![
        any::<bool>().prop_map(Stimulus::Hang),
        any::<bool>().prop_map(Stimulus::Stop),
        any::<bool>().prop_map(Stimulus::Power),
        (0..20u64).prop_map(|ms| Stimulus::Slow(Span::from_millis(ms))),
        (-50_000_000..50_000_000i32).prop_map(|ppb| Stimulus::Clock(Clock::from_ppb(ppb).unwrap())),
        speeds.prop_map(|baud| MotorStimulus::Load(baud).of(0)),
        Just(Stimulus::Reset),
        Just(MotorStimulus::Supply(1).of(0)),
    ];
    let act = prop_oneof![
        5 => (0..2u8, any::<u8>()).prop_map(|(port, byte)| Act::Byte(port, byte)),
        2 => happens.prop_map(Act::Happens),
    ];
    prop::collection::vec((0..20_000_000u64, act), 0..40)
}

/// The acts one after the other, each so many nanoseconds after the one before, or when the line is free.
fn heard(acts: Vec<(u64, Act)>) -> Vec<(Instant, Heard)> {
    let mut uarts = [Transmitter::hardware(BAUD, Clock::TRUE), Transmitter::hardware(BAUD, Clock::TRUE)];
    let mut now = Instant::START;
    let each = |(gap, act)| {
        now += Span::from_nanos(gap);
        match act {
            Act::Byte(port, byte) => {
                let uart = &mut uarts[usize::from(port)];
                uart.push(byte);
                let loaded = uart.load(now.max(uart.free_at())).unwrap();
                (loaded.edges[0].at, Heard::Edges { port, edges: loaded.edges })
            }
            Act::Happens(stimulus) => (now, Heard::Stimulus { at: now, stimulus }),
        }
    };
    acts.into_iter().map(each).collect()
}

/// A stepper tells, however time is cut, what a cell does that hears everything at once; and it takes nothing back from
/// before the instant that it says.
fn agree(acts: Vec<(u64, Act)>, cuts: &[u64], report_max: usize) -> Result<(), TestCaseError> {
    let heard = heard(acts);
    let end = ms(1_500);
    let mut whole = Cell::new(Echo::new(Clock::TRUE));
    heard.iter().for_each(|(_, heard)| whole.hear(heard));
    let expected = run(&mut whole, end);

    let mut stepper = Stepper::new(Echo::new(Clock::TRUE)).with_report_max(report_max);
    let mut told: Vec<Timed> = Vec::new();
    let mut commit = Instant::START;
    let mut cuts = cuts.iter().cycle();
    while commit < end {
        let until = (commit + Span::from_nanos(*cuts.next().unwrap())).min(end);
        let now = heard.iter().filter(|(at, _)| (commit..until).contains(at)).map(|(_, heard)| heard.clone());
        let mut now: Vec<Heard> = now.collect();
        loop {
            let report = stepper.grant(Grant { commit, until, heard: core::mem::take(&mut now) }).unwrap();
            prop_assert!(report.from >= commit);
            prop_assert!(report.outputs.iter().all(|timed| timed.at >= report.from && timed.at < report.horizon));
            told.retain(|timed| timed.at < report.from);
            told.extend(report.outputs);
            if report.horizon >= until {
                break;
            }
            commit = report.horizon;
        }
        commit = until;
    }
    told.retain(|timed| timed.at < end);
    prop_assert_eq!(told, expected);
    Ok(())
}

/// Edges are heard in the same grant as a change of speed before them: a start that the old speed rejects must not be
/// forgotten.
#[test]
fn edges_that_are_heard_before_the_speed_changes_are_followed_up_at_the_new_speed() {
    let mut acts: Vec<(u64, Act)> =
        [13_684_241, 16_420_525, 3_932_343, 10_495_544, 16_837_152].map(|gap| (gap, Act::Byte(HARD, 0))).to_vec();
    let speed = |baud| Act::Happens(MotorStimulus::Load(baud).of(0));
    acts.extend([
        (7_637_266, speed(4_000)),
        (11_301_956, Act::Byte(HARD, 0)),
        (14_260_792, Act::Byte(HARD, 0)),
        (8_767_493, speed(5_035)),
        (305_625, Act::Byte(HARD, 125)),
        (0, Act::Byte(HARD, 0)),
    ]);
    agree(acts, &[44_879_646, 27_827_759, 21_862_415, 1], usize::MAX).unwrap();
}

proptest! {
    #[test]
    fn how_time_is_cut_does_not_show(
        acts in acts(4_000..20_000),
        cuts in prop::collection::vec(1..60_000_000u64, 1..40),
        report_max in 1..20usize,
    ) {
        agree(acts, &cuts, report_max)?;
    }
}
