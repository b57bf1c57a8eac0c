//! The board's conversation, and what its motors do meanwhile: bytes in over a real waveform, replies out.

#![allow(clippy::unwrap_used, reason = "in a test, a panic is an answer")]

mod common;

use common::{Bench, DEPTH, FRAME, SPINDLE, TRANSVERSE};
use torno_dspic::DspicSettings;
use torno_protocol::board::{Board, Capability, MotorStimulus, Output, Stimulus, event_text};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::CHARACTER;

/// A frame that keeps the infeed axis busy for a while.
const DEEP: [u8; 8] = [10, 225, 0, 225, 0, 0, 40, 0];

#[test]
fn a_frame_is_acknowledged_at_once_and_the_pc_let_go_when_all_three_are_done() {
    let mut bench = Bench::new();
    bench.send(&FRAME);
    let sent = bench.now;
    bench.run_ms(3);
    // The character itself, and no more than its start.
    assert!(bench.answered_at().unwrap().since(sent) < CHARACTER.times(2));
    assert_eq!(bench.replies(), "ACK");
    assert_eq!(bench.value("slaves_busy"), 7);
    assert!(bench.run_until_mute(30));
    bench.run_ms(2);
    assert_eq!(bench.replies(), "XON");
    let positions = ["spindle_set_point_rpm", "transverse_position_counts", "depth_position_counts", "slaves_busy"];
    assert_eq!(positions.map(|name| bench.value(name)), [200, 225, 1, 0]);
}

#[test]
fn a_second_frame_is_held_and_a_third_overruns() {
    let mut bench = Bench::new();
    bench.send(&[FRAME, FRAME, FRAME].concat());
    bench.run_ms(4);
    assert_eq!(bench.replies(), "ACK XOFF NAK o");
    bench.run_until_mute(60);
    assert_eq!(bench.replies(), "XON ACK XON");
    assert!((449..=451).contains(&bench.value("transverse_position_counts")), "twice");
}

#[test]
fn what_no_frame_is_is_refused_with_the_reason() {
    let mut bench = Bench::new();
    bench.send(&[9, 0, 0, 0, 0, 0, 0, 0]);
    bench.send(&[0, 0, 0, 0, 2, 0, 0, 0]);
    bench.send(&FRAME[..5]);
    bench.run_ms(100);
    assert_eq!(bench.replies(), "NAK s NAK d NAK c");
    assert!(bench.cell.board().mute());
    assert_eq!(bench.value("frames_distributed"), 0);
}

#[test]
fn the_motor_that_is_blocked_is_the_one_that_fails() {
    for (motor, letter) in [(SPINDLE, 's'), (TRANSVERSE, 't'), (DEPTH, 'd')] {
        let mut bench = Bench::new();
        bench.stimulus(MotorStimulus::Stall(true).of(motor));
        bench.send(&[DEEP, FRAME].concat());
        bench.run_until_mute(60);
        bench.run_ms(2);
        let expected = format!("ACK XOFF CAN {letter} s XON");
        assert_eq!(bench.replies(), expected, "what was held is not executed");
        let others = [bench.value("spindle_speed_rpm") > 150, bench.value("transverse_position_counts") >= 224];
        assert_eq!(others, [letter != 's', letter != 't']);
        assert_eq!(bench.value("depth_position_counts"), if letter == 'd' { 0 } else { 40 });
    }
}

#[test]
fn a_shaft_that_is_blocked_while_it_is_regulated_is_told_of_unasked() {
    let mut bench = Bench::new();
    bench.send(&FRAME);
    assert!(bench.run_until_mute(30), "it regulates, and has nothing to say");
    bench.run_ms(2);
    assert_eq!(bench.replies(), "ACK XON");
    bench.stimulus(MotorStimulus::Stall(true).of(SPINDLE));
    assert!(!bench.cell.board().mute());
    bench.run_ms(10_000);
    assert_eq!(bench.replies(), "CAN s s XON");
    assert_eq!(bench.value("spindle_drive"), 0);
}

#[test]
fn a_stimulus_of_a_motor_that_there_is_not_means_nothing() {
    let mut bench = Bench::new();
    bench.stimulus(MotorStimulus::Stall(true).of(3));
    bench.stimulus(MotorStimulus::Drive(1_000).of(255));
    bench.send(&FRAME);
    bench.run_until_mute(30);
    bench.run_ms(2);
    assert_eq!(bench.replies(), "ACK XON");
}

#[test]
fn each_motor_has_a_service_mode_of_its_own() {
    let mut bench = Bench::new();
    bench.stimulus(MotorStimulus::Drive(500).of(TRANSVERSE));
    bench.run_ms(1_000);
    assert_eq!(bench.value("transverse_drive"), 128);
    assert!(bench.value("transverse_position_counts") > 1_000);
    assert_eq!((bench.value("spindle_drive"), bench.value("depth_drive")), (0, 0));
}

#[test]
fn a_reset_in_mid_process_stops_the_motors_and_tells_the_pc() {
    let mut bench = Bench::new();
    bench.send(&[DEEP, FRAME].concat());
    bench.run_ms(100);
    assert_eq!(bench.replies(), "ACK XOFF");
    bench.stimulus(Stimulus::Reset);
    bench.run_ms(10);
    assert_eq!(bench.replies(), "CAN m r XON");
    let drives = ["spindle_drive", "transverse_drive", "depth_drive", "frame_held", "slaves_busy"];
    assert_eq!(drives.map(|name| bench.value(name)), [0; 5]);
    bench.run_ms(100);
    bench.send(&FRAME);
    bench.run_until_mute(30);
    bench.run_ms(2);
    assert_eq!(bench.replies(), "ACK XON");
}

#[test]
fn after_a_loss_of_supply_there_is_nothing_to_tell() {
    let mut bench = Bench::new();
    bench.send(&DEEP);
    bench.run_ms(100);
    bench.replies();
    bench.stimulus(Stimulus::Power(false));
    bench.run_ms(20);
    bench.stimulus(Stimulus::Power(true));
    bench.run_ms(3_000);
    assert_eq!(bench.replies(), "");
    bench.send(&FRAME);
    bench.run_until_mute(30);
    bench.run_ms(2);
    assert_eq!(bench.replies(), "ACK XON");
}

#[test]
fn each_law_samples_in_its_own_period() {
    let mut settings = DspicSettings::default();
    settings.spindle.controller.window_ms = 32;
    settings.depth.controller.poll_ms = 7;
    let mut bench = Bench::with(&settings, Clock::TRUE);
    bench.send(&DEEP);
    bench.run_ms(1_500);
    for (name, period_ms) in
        [("spindle_speed_rpm", 32), ("transverse_position_counts", 30), ("depth_position_counts", 7)]
    {
        let history = bench.history(name);
        assert!(history.len() >= 2, "{name}: {history:?}");
        let on_grid = history.iter().all(|(at, _)| at.as_nanos() % (period_ms * 1_000_000) == 0);
        assert!(on_grid, "{name}: {history:?}");
    }
}

#[test]
fn it_says_what_it_is() {
    let description = Bench::new().cell.board().description();
    assert_eq!(description.ports, ["pc"]);
    let names: Vec<&str> = description.signals.iter().map(|signal| signal.name.as_str()).collect();
    assert_eq!(
        names[..5],
        ["frames_distributed", "frame_held", "slaves_busy", "spindle_speed_counts", "spindle_speed_rpm"]
    );
    assert_eq!((names.len(), names[14]), (15, "depth_carriage_offset_counts"));
    assert_eq!(description.capabilities, [Capability::Reset]);
    let motors: Vec<_> =
        description.motors.iter().map(|motor| (motor.name.as_str(), &motor.capabilities[..])).collect();
    let axis = &[Capability::Motor, Capability::Axis][..];
    assert_eq!(motors, [("spindle", &[Capability::Motor][..]), ("transverse", axis), ("depth", axis)]);
}

#[test]
fn it_tells_who_is_busy_bit_by_bit() {
    let mut bench = Bench::new();
    bench.send(&DEEP);
    assert!(bench.run_until_mute(60));
    let busy: Vec<i64> = bench.history("slaves_busy").iter().map(|(_, busy)| *busy).collect();
    // The feed axis is done first, then the main motor, then the infeed axis.
    assert_eq!(busy, [7, 5, 4, 0]);
}

#[test]
fn events_tell_of_a_frame_from_its_coming_to_its_end() {
    let mut bench = Bench::new();
    let texts = bench.cell.board().description().events;
    bench.stimulus(MotorStimulus::Stall(true).of(DEPTH));
    bench.send(&[DEEP, FRAME].concat());
    bench.run_until_mute(60);
    let event = |(_, output): &(_, Output)| match output {
        Output::Event { event, value } => Some(event_text(&texts[usize::from(*event)], *value)),
        _ => None,
    };
    let told: Vec<String> = bench.outputs.iter().filter_map(event).collect();
    let expected =
        ["frame 1 distributed", "frame held: slaves are busy", "slave 'd' reports: stalled", "all slaves done"];
    assert_eq!(told, expected);
}

#[test]
fn after_a_reset_it_is_silent_for_two_milliseconds() {
    let mut bench = Bench::new();
    bench.stimulus(Stimulus::Reset);
    let at = bench.now;
    assert!(!bench.cell.board().mute());
    bench.run_ms(10);
    // The third vote of the stop bit of its first character.
    let said = bench.answered_at().unwrap().since(at).as_nanos();
    assert!((2_990_000..3_000_000).contains(&said), "{said}");
    assert_eq!(bench.replies(), "CAN m r XON");
}

#[test]
fn it_is_mute_only_if_it_waits_for_nothing() {
    let mut bench = Bench::new();
    assert!(bench.cell.board().mute());
    bench.send(&FRAME[..1]);
    let silence = bench.cell.board().silence();
    assert!(silence.is_some() && !bench.cell.board().mute(), "it will refuse what is cut short");
    assert_eq!(bench.cell.board().poll_timeout().map(|deadline| deadline.at), silence);
    bench.run_ms(100);
    assert!(bench.cell.board().mute());
    bench.send(&FRAME);
    assert!(bench.cell.board().silence().is_none() && !bench.cell.board().mute(), "it executes a frame");
}

#[test]
fn another_clock_changes_its_line_and_its_samples() {
    let mut bench = Bench::new();
    bench.stimulus(Stimulus::Clock(Clock::from_ppb(20_000_000).unwrap()));
    bench.send(&DEEP);
    bench.run_ms(1_000);
    let samples: Vec<u64> = bench.history("transverse_position_counts")[2..]
        .windows(2)
        .map(|two| two[1].0.since(two[0].0).as_nanos())
        .collect();
    let period = 29_411_765;
    assert!(samples.len() > 5, "{samples:?}");
    assert!(samples.iter().all(|ns| (ns + period / 2) / period >= 1 && (ns + 5) % period < 20), "{samples:?}");
    let character = |(_, output): &(_, Output)| match output {
        Output::Character { edges, end, .. } => Some(end.since(edges[0].at).as_nanos()),
        _ => None,
    };
    assert_eq!(bench.outputs.iter().find_map(character), Some(1_021_242));
}
