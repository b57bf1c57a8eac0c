//! The board's conversation, and what its motors do meanwhile: bytes in over a real waveform, replies out.

#![allow(clippy::unwrap_used, reason = "in a test, a panic is an answer")]

mod common;

use common::{Bench, DEPTH, FRAME, SPINDLE, TRANSVERSE};
use torno_dspic::DspicSettings;
use torno_protocol::board::{Board, Heeds, Stimulus};
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
        bench.stimulus(Stimulus::Stall(true).of(motor));
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
    bench.stimulus(Stimulus::Stall(true).of(SPINDLE));
    assert!(!bench.cell.board().mute());
    bench.run_ms(10_000);
    assert_eq!(bench.replies(), "CAN s s XON");
    assert_eq!(bench.value("spindle_drive"), 0);
}

#[test]
fn a_stimulus_that_says_no_motor_or_one_that_there_is_not_means_nothing() {
    let mut bench = Bench::new();
    bench.stimulus(Stimulus::Stall(true));
    bench.stimulus(Stimulus::Drive(1_000));
    bench.stimulus(Stimulus::Drive(1_000).of(3));
    bench.send(&FRAME);
    bench.run_until_mute(30);
    bench.run_ms(2);
    assert_eq!(bench.replies(), "ACK XON");
}

#[test]
fn each_motor_has_a_service_mode_of_its_own() {
    let mut bench = Bench::new();
    bench.stimulus(Stimulus::Drive(500).of(TRANSVERSE));
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
    assert_eq!(description.heeds, [Heeds::Reset]);
    let motors: Vec<_> = description.motors.iter().map(|motor| (motor.name.as_str(), &motor.heeds[..])).collect();
    let axis = &[Heeds::Motor, Heeds::Axis][..];
    assert_eq!(motors, [("spindle", &[Heeds::Motor][..]), ("transverse", axis), ("depth", axis)]);
}
