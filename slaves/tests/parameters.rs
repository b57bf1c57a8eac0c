//! What a rig file can say of the machine that the paper does not: friction, load, backlash, supply, end stops.

#![allow(clippy::unwrap_used, reason = "part of tests")]

mod common;

use common::response::near;
use common::{Bench, s};
use torno_protocol::board::Board;
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{ACK, CAN};
use torno_slaves::{
    Depth, DepthSettings, LeadForm, PositionForm, SetPoint, Spindle, SpindleSettings, Transverse, TransverseSettings,
};

/// The speed that a spindle without a loop comes to, in rpm.
fn speed(change: impl Fn(&mut SpindleSettings)) -> f64 {
    let mut settings = SpindleSettings::default();
    (settings.controller.form, settings.controller.k) = (LeadForm::FeedForward, 0.0);
    change(&mut settings);
    settings.check().unwrap();
    let mut bench = Bench::new(Spindle::new(&settings, Clock::TRUE));
    bench.send(&[100]);
    bench.run_ms(s(60));
    bench.value("speed_rpm") as f64
}

#[test]
fn a_spindle_loses_what_friction_load_and_supply_take() {
    near("as it is", speed(|_| ()), 2_000.0, 10.0);
    near("friction", speed(|s| s.plant.friction = 0.1), 2_000.0 - 544.3, 10.0);
    near("both", speed(|s| (s.plant.friction, s.plant.load_torque) = (0.1, 0.1)), 2_000.0 - 1_088.6, 10.0);
    near("supply", speed(|s| s.drive.supply_v = 24.0), 1_600.0, 10.0);
    near("what the firmware takes it for", speed(|s| s.controller.supply_v = 24.0), 2_500.0, 10.0);
    near("held", speed(|s| s.plant.friction = 0.4), 0.0, 0.0);
}

/// How far a feed axis without a loop goes in 3 s.
fn way(change: impl Fn(&mut TransverseSettings)) -> f64 {
    let mut settings = TransverseSettings::default();
    (settings.controller.form, settings.controller.set_point) = (PositionForm::Open, SetPoint::Step);
    change(&mut settings);
    settings.check().unwrap();
    let mut bench = Bench::new(Transverse::new(&settings, Clock::TRUE));
    bench.send(&[225, 0, 255, 0]);
    bench.run_ms(3_030 - 5);
    bench.value("position_counts") as f64
}

#[test]
fn a_feed_axis_loses_what_friction_load_and_supply_take() {
    let free = way(|_| ());
    near("supply", way(|s| s.drive.supply = 0.8), 0.8 * free, 1.0);
    near("friction", way(|s| s.plant.friction = 0.1), 0.9 * free, 1.0);
    assert!(way(|s| s.plant.load_torque = 0.1) < 0.9 * free + 1.0 && way(|s| s.plant.load_torque = -0.1) > 1.09 * free);
    near("half the speed", way(|s| s.plant.rpm = 250.0), 0.5 * free, 1.0);
    near("half the slots", way(|s| s.encoder.slots_per_rev = 450), 0.5 * free, 1.0);
    near("held", way(|s| s.plant.friction = 1.0), 0.0, 0.0);
}

#[test]
fn a_push_moves_what_nobody_drives_unless_friction_holds_it() {
    for (friction, end) in [(0.0, -36_000), (0.2, 0)] {
        let mut settings = TransverseSettings::default();
        (settings.plant.load_torque, settings.plant.friction) = (0.1, friction);
        let mut bench = Bench::new(Transverse::new(&settings, Clock::TRUE));
        bench.run_ms(s(120));
        assert_eq!((bench.value("position_counts"), bench.value("drive")), (end, 0));
        assert_eq!(bench.board.poll_timeout(), None);
    }
}

#[test]
fn backlash_is_hidden_from_the_encoder_on_the_motor_and_seen_by_the_one_on_the_slide() {
    let mut settings = TransverseSettings::default();
    settings.plant.backlash_mm = 0.1;
    let mut bench = Bench::new(Transverse::new(&settings, Clock::TRUE));
    bench.send(&[112, 0x03, 0x84, 1]);
    assert!(bench.run_until_mute(20));
    bench.run_ms(s(2));
    // 45 counts, less what the motor overshot and came back.
    assert_eq!(bench.value("position_counts"), -900);
    assert!((40..=45).contains(&bench.value("carriage_offset_counts")));

    let mut settings = DepthSettings::default();
    settings.plant.backlash_mm = 0.2;
    let mut bench = Bench::new(Depth::new(&settings, Clock::TRUE));
    bench.send(&[0, 3, 1]);
    assert!(bench.run_until_mute(30));
    let backwards = bench.sent[0].0.as_secs_f64();
    assert_eq!((bench.replies(), bench.value("position_counts")), (vec![ACK], -3));
    let mut bench = Bench::new(Depth::new(&DepthSettings::default(), Clock::TRUE));
    bench.send(&[0, 3, 1]);
    assert!(bench.run_until_mute(30));
    near("longer by the gap", backwards - bench.sent[0].0.as_secs_f64(), 0.2 / 0.266_667, 0.011);
}

#[test]
fn the_end_stops_are_where_the_file_has_them() {
    let mut settings = TransverseSettings::default();
    settings.plant.travel_mm = 10.0;
    let mut bench = Bench::new(Transverse::new(&settings, Clock::TRUE));
    bench.send(&[225, 0xFF, 0xFF, 1]);
    assert!(bench.run_until_mute(20));
    assert_eq!((bench.replies(), bench.value("position_counts")), (vec![CAN, b'e'], -2_250));
}
