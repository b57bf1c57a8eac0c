//! Whatever reaches the board: it does not panic, it keeps its promises, and it can be used afterwards.

#![allow(clippy::unwrap_used, reason = "part of tests")]

mod common;

use common::{Bench, FRAME};
use proptest::prelude::*;
use torno_dspic::{Dspic, DspicSettings};
use torno_protocol::board::{Board, MotorStimulus, Output, Stimulus};
use torno_protocol::clock::Clock;
use torno_protocol::record::{Grant, Heard, Timed};
use torno_protocol::stepping::Stepper;
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::Transmitter;

#[derive(Clone, Debug)]
enum Act {
    Wait(u64),
    Bytes(Vec<u8>),
    Happens(Stimulus),
}

fn frames() -> impl Strategy<Value = Vec<u8>> {
    let frame = (10..=200u8, 1..=225u8, 0..4u8, any::<u8>(), 0..2u8, any::<u8>(), 0..2u8);
    frame.prop_map(|(rpm, speed, high, low, way, slots, depth_way)| {
        vec![rpm, speed, high, low, way, 0, slots, depth_way]
    })
}

fn acts() -> impl Strategy<Value = Vec<Act>> {
    let act = prop_oneof![
        3 => (0..8_000u64).prop_map(Act::Wait),
        2 => (0..60u64).prop_map(Act::Wait),
        3 => frames().prop_map(Act::Bytes),
        2 => prop::collection::vec(any::<u8>(), 0..20).prop_map(Act::Bytes),
        4 => happenings().prop_map(Act::Happens),
    ];
    prop::collection::vec(act, 0..14)
}

fn happenings() -> impl Strategy<Value = Stimulus> {
    let of_a_motor = prop_oneof![
        any::<bool>().prop_map(MotorStimulus::Stall),
        any::<i32>().prop_map(MotorStimulus::Load),
        (0..2_000u16).prop_map(MotorStimulus::Supply),
        (0..300u16).prop_map(MotorStimulus::Backlash),
        (-40_000..40_000i32).prop_map(MotorStimulus::EndStop),
        (-1_200..1_200i32).prop_map(MotorStimulus::Drive),
    ];
    prop_oneof![
        4 => (of_a_motor, 0..4u8).prop_map(|(stimulus, motor)| stimulus.of(motor)),
        1 => Just(Stimulus::Reset),
        1 => any::<bool>().prop_map(Stimulus::Power),
        1 => any::<bool>().prop_map(Stimulus::Hang),
        1 => clocks().prop_map(Stimulus::Clock),
    ]
}

fn clocks() -> impl Strategy<Value = Clock> {
    (-20_000_000..20_000_000i32).prop_map(|ppb| Clock::from_ppb(ppb).unwrap())
}

fn perform(bench: &mut Bench, act: Act) {
    match act {
        Act::Wait(ms) => bench.run_ms(ms),
        Act::Bytes(bytes) => bench.send(&bytes),
        Act::Happens(stimulus) => bench.stimulus(stimulus),
    }
}

/// Puts everything right again.
fn heal(bench: &mut Bench) {
    bench.stimulus(Stimulus::Power(false));
    bench.stimulus(Stimulus::Power(true));
    let healed = [
        MotorStimulus::Stall(false),
        MotorStimulus::Load(0),
        MotorStimulus::Supply(1_000),
        MotorStimulus::Backlash(0),
        MotorStimulus::EndStop(0),
    ];
    for motor in 0..3 {
        healed.iter().for_each(|stimulus| bench.stimulus(stimulus.of(motor)));
    }
    bench.stimulus(Stimulus::Clock(Clock::TRUE));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn once_it_is_mute_it_stays_so(clock in clocks(), acts in acts()) {
        let mut bench = Bench::with(&DspicSettings::default(), clock);
        for act in acts.into_iter().chain([Act::Wait(20_000)]) {
            perform(&mut bench, act);
            if bench.cell.board().mute() {
                let mut left_alone = bench.clone();
                left_alone.outputs.clear();
                left_alone.run_ms(600_000);
                let speaks = |output: &Output| matches!(output, Output::Character { .. } | Output::Cut { .. });
                prop_assert!(!left_alone.outputs.iter().any(|(_, output)| speaks(output)));
            }
        }
    }

    /// However it was treated: once it has its supply again, a frame is executed.
    #[test]
    fn it_obeys_whatever_came_before(acts in acts()) {
        let mut bench = Bench::new();
        acts.into_iter().for_each(|act| perform(&mut bench, act));
        heal(&mut bench);
        bench.run_ms(100);
        prop_assert!(bench.run_until_mute(1_000));
        bench.replies();
        bench.send(&FRAME);
        prop_assert!(bench.run_until_mute(1_000));
        bench.run_ms(2);
        let replies = bench.replies();
        // An axis that stands at its end can go no further.
        let ends = ["", "CAN t e ", "CAN d e ", "CAN d e CAN t e ", "CAN t e CAN d e "];
        prop_assert!(ends.iter().any(|ends| replies == format!("ACK {ends}XON")), "{}", replies);
    }

    #[test]
    fn how_time_is_cut_does_not_show(clock in clocks(), cuts in prop::collection::vec(1..400_000u64, 1..60)) {
        let mut pc = Transmitter::hardware(torno_protocol::lathe::RATE, Clock::TRUE);
        let mut now = Instant::from_nanos(7_000_000);
        let heard: Vec<Heard> = [FRAME, FRAME].concat().into_iter().map(|byte| {
            pc.push(byte);
            let loaded = pc.load(now).unwrap();
            now = loaded.end;
            Heard::Edges { port: 0, edges: loaded.edges }
        }).collect();
        let end = Instant::from_nanos(20_000_000_000);
        let at_once = told(clock, &heard, &[end]);
        let cut = (0..).map(|n| cuts[n % cuts.len()] * 1_000).scan(Instant::START, |now, ns| {
            *now += Span::from_nanos(ns);
            (*now < end).then_some(*now)
        });
        let cut: Vec<Instant> = cut.chain([end]).collect();
        let replies = at_once.iter().filter(|timed| matches!(timed.output, Output::Character { .. })).count();
        prop_assert_eq!(replies, 5, "ACK XOFF XON ACK XON");
        prop_assert_eq!(told(clock, &heard, &cut), at_once);
    }
}

/// What the board does up to the last cut, if it hears each character in the grant in which it begins.
fn told(clock: Clock, heard: &[Heard], cuts: &[Instant]) -> Vec<Timed> {
    let mut stepper = Stepper::new(Dspic::new(&DspicSettings::default(), clock));
    let begin = |heard: &Heard| match heard {
        Heard::Edges { edges, .. } => edges[0].at,
        _ => Instant::START,
    };
    let mut told: Vec<Timed> = Vec::new();
    let mut commit = Instant::START;
    for until in cuts {
        let now = heard.iter().filter(|heard| (commit..*until).contains(&begin(heard))).cloned().collect();
        let report = stepper.grant(Grant { commit, until: *until, heard: now }).unwrap();
        told.retain(|timed| timed.at < report.from);
        told.extend(report.outputs);
        commit = *until;
    }
    let end = cuts[cuts.len() - 1];
    told.retain(|timed| timed.at < end);
    told
}
