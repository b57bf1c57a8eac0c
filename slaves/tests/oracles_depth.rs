//! The figures of the infeed axis (§4), found again at the real board: sub-frames in, telemetry out.

#![allow(clippy::unwrap_used, reason = "part of tests")]
#![allow(clippy::disallowed_methods, reason = "what is compared with a tolerance may differ in its last digits")]

mod common;

use common::response::{changed, near};
use common::{Bench, depth, s};
use torno_protocol::board::Stimulus;
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{ACK, CAN};
use torno_protocol::time::{Instant, Span};
use torno_slaves::{Depth, DepthController, DepthPlant, DepthSettings};

/// A move by so many slots; the bench when it is over.
fn go(settings: &DepthSettings, slots: u16) -> Bench<Depth> {
    let mut bench = Bench::new(Depth::new(settings, Clock::TRUE));
    then(&mut bench, slots, 0);
    bench
}

/// In mid-move on a fine strip, after so many ms.
fn going(settings: &DepthSettings, ms: u64) -> Bench<Depth> {
    settings.check().unwrap();
    let mut bench = Bench::new(Depth::new(settings, Clock::TRUE));
    bench.send(&[0xFF, 0xFF, 0]);
    bench.run_ms(ms);
    bench
}

fn then(bench: &mut Bench<Depth>, slots: u16, direction: u8) {
    let [high, low] = slots.to_be_bytes();
    bench.send(&[high, low, direction]);
    assert!(bench.run_until_mute(2_000));
    bench.run_ms(s(2));
}

/// A strip with a slot every 0.16 µm, and a poll every millisecond.
fn fine() -> DepthSettings {
    let mut settings = DepthSettings::default();
    settings.encoder.slots = 1_000_000;
    settings.controller.poll_ms = 1;
    settings
}

/// mm of slide from slots of the fine strip.
fn mm(slots: i64) -> f64 {
    slots as f64 * 0.000_16
}

/// The mean time of a slot in mid-move, in s.
fn slot_time(bench: &Bench<Depth>) -> f64 {
    let moves = bench.history("position_counts");
    let (first, last) = (moves[2], moves[moves.len() - 1]);
    last.0.since(first.0).as_secs_f64() / (last.1 - first.1) as f64
}

#[test]
fn a_slot_is_0_178_mm_and_takes_two_thirds_of_a_second() {
    let strip = going(&fine(), s(20));
    let at = |ms: u64| {
        let until = Instant::START + Span::from_millis(ms);
        mm(strip.history("position_counts").iter().rfind(|(at, _)| *at <= until).unwrap().1)
    };
    let speed = (at(19_000) - at(9_000)) / 10.0;
    near("speed, mm/s", speed, 0.266_666_667, 2e-5);
    let slots = go(&DepthSettings::default(), 300);
    near("slot time", slot_time(&slots), 0.666_666_667, 5e-5);
    near("slot, mm", speed * slot_time(&slots), 0.177_777_778, 2e-5);
    // As printed, and a strip of 150 lines an inch.
    for (length_mm, slot_mm) in [(153.0, 0.17), (152.4, 0.169_333_333)] {
        let mut settings = DepthSettings::default();
        settings.encoder.length_mm = length_mm;
        near("slot, mm", speed * slot_time(&go(&settings, 300)), slot_mm, 2e-5);
    }
}

#[test]
fn the_whole_way_has_900_slots_and_takes_ten_minutes() {
    let mut bench = depth();
    then(&mut bench, 500, 1);
    assert_eq!((bench.replies(), bench.value("position_counts")), (vec![CAN, b'e'], -450));
    let from = bench.now;
    then(&mut bench, 1_000, 0);
    assert_eq!((bench.replies(), bench.value("position_counts")), (vec![CAN, b'e'], 450));
    let started = changed(&bench, "drive", from);
    let arrived = bench.history("position_counts").last().unwrap().0;
    // A time constant is lost at the start, and the last slot is counted from its edge, half a slot before the stop.
    near("160 mm", (arrived.since(started).as_secs_f64() - 0.05) / 899.5 * 900.0, 600.0, 0.011);
}

/// What the slide still covers after it is switched off: one time constant's way.
#[test]
fn it_coasts_13_micrometres() {
    let mut bench = going(&fine(), s(5));
    // A reset switches off wherever it is, and lets it lie where it comes to rest.
    bench.stimulus(Stimulus::Reset);
    let at_off = bench.value("position_counts");
    bench.run_ms(s(2));
    assert_eq!(bench.value("drive"), 0);
    near("coast, mm", mm(bench.value("position_counts") - at_off), 0.013_333_333, mm(1));
}

/// "Before the sensor gives a pulse, the motor is in its steady state" (§4): four time constants within a slot.
#[test]
fn a_motor_of_a_sixth_of_a_second_is_just_settled_within_a_slot() {
    let mut settings = fine();
    settings.plant.tau_s = 1.0 / 6.0;
    let bench = going(&settings, s(2));
    let started = changed(&bench, "drive", Instant::START);
    let positions = bench.history("position_counts");
    let at = |seconds: f64| {
        let found = positions.iter().rfind(|(at, _)| at.since(started).as_secs_f64() <= seconds && *at >= started);
        mm(found.unwrap().1)
    };
    let speed = (at(0.686_667) - at(0.646_667)) / 0.04;
    near("share of its speed", speed / 0.266_666_667, 1.0 - (-4.0_f64).exp(), 0.02);
    near("tau", 0.666_666_667 / 4.0, settings.plant.tau_s, 1e-8);
}

#[test]
fn it_overshoots_no_slot_and_a_faster_one_with_a_slow_poll_one() {
    let mut bench = go(&DepthSettings::default(), 56);
    assert_eq!((bench.replies(), bench.value("position_counts")), (vec![ACK], 56));
    let plant = DepthPlant { pitch_mm: 10.0, tau_s: 0.150, ..DepthPlant::default() };
    let settings = DepthSettings { plant, controller: DepthController { poll_ms: 30 }, ..DepthSettings::default() };
    let mut bench = go(&settings, 56);
    assert_eq!((bench.replies(), bench.value("position_counts")), (vec![ACK], 57));
}
