//! Whatever reaches a board: it does not panic, it keeps its promises, and it can be used afterwards.

#![allow(clippy::unwrap_used, reason = "part of tests")]

mod common;

use common::Bench;
use proptest::prelude::*;
use torno_protocol::board::{Board, MotorStimulus, Output, Stimulus};
use torno_protocol::clock::{Clock, Rate};
use torno_protocol::lathe::{ACK, CAN, ENQ};
use torno_protocol::record::{Grant, Heard, Report, Timed};
use torno_protocol::stepping::Stepper;
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::{Character, Transmitter};
use torno_slaves::{
    Depth, DepthPlant, DepthSettings, Spindle, SpindleController, SpindleDrive, SpindlePlant, SpindleSettings,
    Transverse, TransversePlant, TransverseSettings,
};

#[derive(Clone, Debug)]
enum Act {
    Wait(u64),
    Bytes(Vec<u8>),
    Bad(Character),
    Reset,
    Stall(bool),
    /// Something goes wrong.
    Wrong(Stimulus),
    /// Deadlines are not seen to for so many milliseconds.
    Hang(u64),
}

fn acts() -> impl Strategy<Value = Vec<Act>> {
    let bytes = prop_oneof![
        any::<Vec<u8>>().prop_map(|bytes| bytes[..bytes.len().min(12)].to_vec()),
        Just(vec![ENQ]),
        (10..=200u8).prop_map(|speed| vec![speed]),
        (1..=225u8, 0..4u8, any::<u8>(), 0..2u8).prop_map(|(speed, high, low, way)| vec![speed, high, low, way]),
        (0..1u8, 0..9u8, 0..2u8).prop_map(|(high, low, way)| vec![high, low, way]),
    ];
    let act = prop_oneof![
        3 => (0..8_000u64).prop_map(Act::Wait),
        2 => (0..12u64).prop_map(Act::Wait),
        5 => bytes.prop_map(Act::Bytes),
        1 => (any::<u8>(), any::<bool>()).prop_map(|(byte, framing_error)| {
            Act::Bad(Character { byte, framing_error, overrun: !framing_error })
        }),
        1 => Just(Act::Reset),
        1 => any::<bool>().prop_map(Act::Stall),
        4 => faults().prop_map(Act::Wrong),
        1 => (0..3_000u64).prop_map(Act::Hang),
    ];
    prop::collection::vec(act, 0..14)
}

fn faults() -> impl Strategy<Value = Stimulus> {
    prop_oneof![
        (-300..300i32).prop_map(|value| MotorStimulus::Counts(value).of(0)),
        (-100..1_500i32).prop_map(|value| MotorStimulus::Load(value).of(0)),
        (0..2_000u16).prop_map(|value| MotorStimulus::Supply(value).of(0)),
        (0..300u16).prop_map(|value| MotorStimulus::Backlash(value).of(0)),
        (-40_000..40_000i32).prop_map(|value| MotorStimulus::EndStop(value).of(0)),
        (-1_200..1_200i32).prop_map(|value| MotorStimulus::Drive(value).of(0)),
        any::<bool>().prop_map(Stimulus::Power),
        clocks().prop_map(Stimulus::Clock),
        // Any number that can be written down.
        any::<i32>().prop_map(|value| MotorStimulus::Load(value).of(0)),
        any::<u16>().prop_map(|value| MotorStimulus::Supply(value).of(0)),
    ]
}

/// What puts everything right again.
const HEALED: [Stimulus; 6] = [
    MotorStimulus::Drive(0).of(0),
    MotorStimulus::Stall(false).of(0),
    MotorStimulus::Load(0).of(0),
    MotorStimulus::Supply(1_000).of(0),
    MotorStimulus::Backlash(0).of(0),
    MotorStimulus::EndStop(0).of(0),
];

fn perform<B: Board>(bench: &mut Bench<B>, act: Act) {
    match act {
        Act::Wait(ms) => bench.run_ms(ms),
        Act::Bytes(bytes) => bench.send(&bytes),
        Act::Bad(character) => bench.character(character),
        Act::Reset => bench.stimulus(Stimulus::Reset),
        Act::Stall(blocked) => bench.stimulus(MotorStimulus::Stall(blocked).of(0)),
        Act::Wrong(stimulus) => bench.stimulus(stimulus),
        Act::Hang(ms) => {
            bench.hung = true;
            bench.run_ms(ms);
            bench.hung = false;
        }
    }
}

/// After each act: if the board says that it is mute, it stays so for an hour and a half.
fn keeps_silent<B: Board>(board: B, acts: Vec<Act>) -> Result<(), TestCaseError> {
    let mut bench = Bench::new(board);
    for act in acts.into_iter().chain([Act::Wait(20_000)]) {
        perform(&mut bench, act);
        if bench.board.mute() {
            let mut left_alone = bench.clone();
            left_alone.outputs.clear();
            left_alone.run_ms(5_400_000);
            let speaks =
                |(_, output): &(Instant, Output)| matches!(output, Output::Character { .. } | Output::Cut { .. });
            prop_assert!(!left_alone.outputs.iter().any(speaks));
        }
    }
    Ok(())
}

/// However it was treated: once it is done and the line has been silent, a valid sub-frame is obeyed.
fn obeys<B: Board>(board: B, acts: Vec<Act>, part: &[u8]) -> Result<(), TestCaseError> {
    let mut bench = Bench::new(board);
    // An axis whose count is off can be sent beyond its end of travel, and press against it.
    let miscounts =
        acts.iter().any(|act| matches!(act, Act::Wrong(Stimulus::Motor { what: MotorStimulus::Counts(_), .. })));
    acts.into_iter().for_each(|act| perform(&mut bench, act));
    HEALED.into_iter().for_each(|stimulus| bench.stimulus(stimulus));
    bench.run_ms(10);
    prop_assert!(bench.run_until_mute(10_000));
    bench.ask();
    bench.replies();
    bench.send(part);
    prop_assert!(!bench.board.mute());
    prop_assert!(bench.run_until_mute(10_000));
    let replies = bench.replies();
    let obeys = replies == [ACK] || replies == [CAN, b'e'] || (miscounts && replies == [CAN, b's']);
    prop_assert!(obeys, "{:?}", replies);
    Ok(())
}

fn clocks() -> impl Strategy<Value = Clock> {
    (-20_000_000..20_000_000i32).prop_map(|ppb| Clock::from_ppb(ppb).unwrap())
}

fn motors() -> impl Strategy<Value = SpindleSettings> {
    let settings = (0.1..100.0, 0.01..20.0, 1.0..100.0, 5..100u32, 0.0..1.0, -0.99..0.99, 0.001..10.0, 0.0..0.3);
    let settings = settings.prop_map(|(km_rad_per_s_volt, tau_s, supply_v, window_ms, alpha, beta, k, friction)| {
        let plant = SpindlePlant { km_rad_per_s_volt, tau_s, friction, ..SpindlePlant::default() };
        let controller = SpindleController { k, alpha, beta, window_ms, supply_v, ..SpindleController::default() };
        let drive = SpindleDrive { supply_v, ..SpindleDrive::default() };
        let settings = SpindleSettings { plant, drive, controller, ..SpindleSettings::default() };
        settings.check().unwrap();
        settings
    });
    prop_oneof![Just(SpindleSettings::default()), settings]
}

/// Friction, a push, a supply and backlash.
fn slides() -> impl Strategy<Value = (f64, f64, f64, f64)> {
    prop_oneof![Just((0.0, 0.0, 1.0, 0.0)), (0.0..0.3, -0.3..0.3, 0.5..1.5, 0.0..0.5)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn a_mute_spindle_stays_mute(settings in motors(), clock in clocks(), acts in acts()) {
        keeps_silent(Spindle::new(&settings, clock), acts)?;
    }

    #[test]
    fn a_mute_transverse_axis_stays_mute(slide in slides(), clock in clocks(), acts in acts()) {
        let (friction, load_torque, supply, backlash_mm) = slide;
        let plant = TransversePlant { friction, load_torque, backlash_mm, ..TransversePlant::default() };
        let mut settings = TransverseSettings { plant, ..TransverseSettings::default() };
        settings.drive.supply = supply;
        keeps_silent(Transverse::new(&settings, clock), acts)?;
    }

    #[test]
    fn a_mute_depth_axis_stays_mute(slide in slides(), clock in clocks(), acts in acts()) {
        let (friction, load_torque, supply, backlash_mm) = slide;
        let plant = DepthPlant { friction, load_torque, backlash_mm, ..DepthPlant::default() };
        let mut settings = DepthSettings { plant, ..DepthSettings::default() };
        settings.drive.supply = supply;
        keeps_silent(Depth::new(&settings, clock), acts)?;
    }

    #[test]
    fn a_spindle_obeys_whatever_came_before(clock in clocks(), acts in acts()) {
        obeys(Spindle::new(&SpindleSettings::default(), clock), acts, &[75])?;
    }

    #[test]
    fn a_transverse_axis_obeys_whatever_came_before(clock in clocks(), acts in acts()) {
        obeys(Transverse::new(&TransverseSettings::default(), clock), acts, &[5, 0, 70, 1])?;
    }

    #[test]
    fn a_depth_axis_obeys_whatever_came_before(clock in clocks(), acts in acts()) {
        obeys(Depth::new(&DepthSettings::default(), clock), acts, &[0, 5, 1])?;
    }

    #[test]
    fn how_time_is_cut_does_not_show(clock in clocks(), cuts in prop::collection::vec(1..400_000u64, 1..60)) {
        let sub_frames: [(u64, &[u8]); 4] =
            [(7, &[ENQ]), (20, &[112, 2, 0, 1]), (900, &[ENQ]), (4_000, &[225, 0, 99, 0])];
        let heard: Vec<Heard> = sub_frames.iter().flat_map(|(ms, bytes)| edges(*ms, bytes)).collect();
        let board = || Transverse::new(&TransverseSettings::default(), clock);
        let end = Instant::from_nanos(8_000_000_000);
        let at_once = told(Stepper::new(board()), &heard, &[end]);
        let cut = (0..).map(|n| cuts[n % cuts.len()] * 1_000).scan(Instant::START, |now, ns| {
            *now += Span::from_nanos(ns);
            (*now < end).then_some(*now)
        });
        let cut: Vec<Instant> = cut.chain([end]).collect();
        let replies = at_once.iter().filter(|timed| matches!(timed.output, Output::Character { .. })).count();
        prop_assert_eq!(replies, 2 + 1 + 2 + 2, "CAN r, BEL, ACK o, ACK e");
        prop_assert_eq!(told(Stepper::new(board()), &heard, &cut), at_once);
    }
}

/// A restart falls between an `ACK` and its parity: the reply is cut short, and the board is not harmed.
#[test]
fn a_spindle_obeys_after_a_reset_cut_its_acknowledgement_short() {
    let acts = vec![Act::Bytes(vec![0, 0, 0]), Act::Hang(19), Act::Bytes(vec![ENQ]), Act::Reset];
    obeys(Spindle::new(&SpindleSettings::default(), Clock::TRUE), acts, &[75]).unwrap();
}

#[test]
fn a_spindle_obeys_after_a_loss_of_power_cut_its_answer_short() {
    let wait = [Act::Wait(0), Act::Wait(2_123)];
    let cut = [Act::Bytes(vec![ENQ]), Act::Wrong(Stimulus::Power(false))];
    let acts = [Act::Bytes(vec![10])].into_iter().chain(wait).chain(cut).collect();
    obeys(Spindle::new(&SpindleSettings::default(), Clock::TRUE), acts, &[75]).unwrap();
}

#[test]
fn a_spindle_with_a_fast_clock_obeys_after_a_loss_of_power_cut_its_acknowledgement_short() {
    let acts = vec![
        Act::Wait(10),
        Act::Hang(855),
        Act::Bytes(vec![0, 0, 0]),
        Act::Wait(516),
        Act::Wait(4_346),
        Act::Wait(3_136),
        Act::Bytes(vec![0, 0, 0]),
        Act::Wrong(Stimulus::Power(false)),
    ];
    let clock = Clock::from_ppb(7_177_360).unwrap();
    obeys(Spindle::new(&SpindleSettings::default(), clock), acts, &[75]).unwrap();
}

/// Two counts short, the integral cancels the proportional part for more than a second: the motor is not driven.
#[test]
fn a_transverse_axis_is_not_stalled_while_its_motor_is_not_driven() {
    let clock = |ppb| Clock::from_ppb(ppb).unwrap();
    let acts = vec![
        Act::Wait(11),
        Act::Wrong(Stimulus::Clock(clock(12_342_664))),
        Act::Hang(933),
        Act::Wrong(MotorStimulus::Drive(140).of(0)),
        Act::Wait(6),
        Act::Wrong(MotorStimulus::Supply(513).of(0)),
        Act::Wait(5_437),
        Act::Bytes(vec![ENQ]),
        Act::Bytes(vec![1, 0, 2, 0]),
        Act::Wait(1_256),
    ];
    let board = Transverse::new(&TransverseSettings::default(), clock(9_036_070));
    obeys(board, acts, &[5, 0, 70, 1]).unwrap();
}

/// Bytes one after the other, the first from `ms` milliseconds on.
fn edges(ms: u64, bytes: &[u8]) -> Vec<Heard> {
    let mut transmitter = Transmitter::hardware(Rate::hz(9_600), Clock::TRUE);
    bytes.iter().for_each(|byte| transmitter.push(*byte));
    let mut now = Instant::from_nanos(ms * 1_000_000);
    let character = |_: &u8| {
        let loaded = transmitter.load(now).unwrap();
        now = loaded.end;
        Heard::Edges { port: 0, edges: loaded.edges }
    };
    bytes.iter().map(character).collect()
}

/// What a board does up to the last cut, if it hears each character in the grant in which it begins.
fn told(mut stepper: Stepper<Transverse>, heard: &[Heard], cuts: &[Instant]) -> Vec<Timed> {
    let begin = |heard: &Heard| match heard {
        Heard::Edges { edges, .. } => edges[0].at,
        _ => Instant::START,
    };
    let mut told: Vec<Timed> = Vec::new();
    let mut commit = Instant::START;
    for until in cuts {
        let now = heard.iter().filter(|heard| (commit..*until).contains(&begin(heard))).cloned().collect();
        let report: Report = stepper.grant(Grant { commit, until: *until, heard: now }).unwrap();
        told.retain(|timed| timed.at < report.from);
        told.extend(report.outputs);
        commit = *until;
    }
    let end = cuts[cuts.len() - 1];
    told.retain(|timed| timed.at < end);
    told
}
