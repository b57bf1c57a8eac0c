//! What can go wrong with a plant, an oscillator and a supply, and what the boards make of it.

#![allow(clippy::unwrap_used, reason = "part of tests")]

mod common;

use common::{Bench, depth, s, spindle, transverse};
use torno_protocol::board::{Board, MotorStimulus, Output, Stimulus};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{ACK, CAN, ENQ};
use torno_protocol::record::{Grant, Heard};
use torno_protocol::stepping::Stepper;
use torno_protocol::time::{Instant, Span};
use torno_slaves::{Spindle, SpindleSettings, Transverse};

/// Speed, distance and direction as the transverse axis gets them.
fn way(distance: i32) -> [u8; 4] {
    let [high, low] = u16::try_from(distance.abs()).unwrap().to_be_bytes();
    [112, high, low, u8::from(distance < 0)]
}

/// Distance and direction as the depth axis gets them.
fn slots(distance: i32) -> [u8; 3] {
    let [_, rest @ ..] = way(distance);
    rest
}

/// Executes a sub-frame; gives the replies, and how long it took in s.
fn execute<B: Board>(bench: &mut Bench<B>, part: &[u8]) -> (Vec<u8>, f64) {
    bench.send(part);
    let sent = bench.now;
    assert!(bench.run_until_mute(300));
    (bench.replies(), bench.now.since(sent).as_secs_f64())
}

/// The mean drive of the last 20 s, as a part of the whole.
fn duty(bench: &Bench<Spindle>) -> f64 {
    let from = bench.now - Span::from_secs(20);
    let history = bench.history("drive");
    let ends = history.iter().skip(1).map(|(at, _)| *at).chain([bench.now]);
    let parts = history.iter().zip(ends);
    let sum: f64 = parts.map(|((at, drive), end)| end.since((*at).max(from)).as_secs_f64() * *drive as f64).sum();
    sum / 20.0 / 1_023.0
}

#[test]
fn a_spindle_under_load_or_on_half_its_supply_comes_back_to_its_speed() {
    for (stimulus, expected) in [(MotorStimulus::Load(200).of(0), 0.4756), (MotorStimulus::Supply(500).of(0), 0.5512)] {
        let mut bench = spindle();
        execute(&mut bench, &[75]);
        bench.run_ms(s(30));
        assert!((duty(&bench) - 0.2756).abs() < 0.002);
        let at = bench.now;
        bench.stimulus(stimulus);
        assert!(bench.board.mute(), "it regulates, and has nothing to report");
        bench.run_ms(s(60));
        let slowest = bench.history("speed_rpm").iter().filter(|(told, _)| *told > at).map(|(_, rpm)| *rpm).min();
        assert!(slowest.unwrap() < 1_450, "{slowest:?}");
        assert!((bench.value("speed_rpm") - 1_500).abs() <= 20);
        assert!((duty(&bench) - expected).abs() < 0.002, "{}", duty(&bench));
        assert_eq!(bench.replies(), []);
    }
}

#[test]
fn a_loaded_spindle_stands_still_before_a_free_one() {
    let stops = |load| {
        let mut bench = spindle();
        execute(&mut bench, &[75]);
        bench.stimulus(MotorStimulus::Load(load).of(0));
        execute(&mut bench, &[0]).1
    };
    let (free, loaded) = (stops(0), stops(200));
    // 1500 rpm against a load of 1089 rpm: τ·ln(1 + 1500/1089) and eight windows.
    assert!((loaded - (2.426 + 0.24)).abs() < 0.1 && free > 2.0 * loaded, "{loaded} {free}");
}

#[test]
fn a_load_that_full_drive_cannot_turn_is_a_stall() {
    let mut bench = spindle();
    bench.stimulus(MotorStimulus::Load(1_000).of(0));
    assert_eq!(execute(&mut bench, &[75]).0, [CAN, b's']);
    // While it regulates it says so unasked.
    bench.stimulus(MotorStimulus::Load(0).of(0));
    assert_eq!(execute(&mut bench, &[75]).0, [ACK]);
    bench.stimulus(MotorStimulus::Supply(0).of(0));
    assert!(!bench.board.mute());
    assert!(bench.run_until_mute(60));
    assert_eq!(bench.replies(), [CAN, b's']);

    let mut bench = transverse();
    bench.send(&way(9_000));
    bench.run_ms(s(1));
    bench.stimulus(MotorStimulus::Load(1_001).of(0));
    // A load hardly stronger than full drive takes 4.5 s to stop it.
    assert!(bench.run_until_mute(10));
    assert_eq!((bench.replies(), bench.value("drive")), (vec![CAN, b's'], 0));

    let mut bench = depth();
    bench.stimulus(MotorStimulus::Load(1_000).of(0));
    assert_eq!(execute(&mut bench, &slots(3)).0, [CAN, b's']);
    bench.stimulus(MotorStimulus::Load(999).of(0));
    bench.stimulus(MotorStimulus::Load(0).of(0));
    assert_eq!(execute(&mut bench, &slots(3)).0, [ACK]);
}

#[test]
fn an_axis_ends_off_by_the_counts_that_its_encoder_lost_or_invented() {
    for (distance, counts, offset) in [(900, -7, 7), (900, 12, -12), (-900, -7, -7), (-900, 12, 12)] {
        let mut bench = transverse();
        bench.send(&way(distance));
        bench.run_ms(400);
        bench.stimulus(MotorStimulus::Counts(counts).of(0));
        assert!(bench.run_until_mute(10));
        bench.run_ms(s(60));
        assert_eq!(bench.replies(), [ACK]);
        assert_eq!(bench.value("position_counts"), i64::from(distance), "the firmware knows nothing of it");
        assert_eq!(bench.value("carriage_offset_counts"), offset);
    }
    // At rest the loop is closed: it makes up for what was never gone.
    let mut bench = transverse();
    execute(&mut bench, &way(900));
    bench.run_ms(s(60));
    let positions = bench.history("position_counts");
    let [.., (_, before), (_, last)] = positions[..] else { panic!("{positions:?}") };
    bench.stimulus(MotorStimulus::Counts(5).of(0));
    bench.run_ms(s(60));
    // They are counted in the sense of the last count.
    let offset = -5 * (last - before).signum();
    assert_eq!((bench.value("position_counts"), bench.value("carriage_offset_counts")), (900, offset));
    assert_eq!(bench.replies(), []);

    let mut bench = depth();
    bench.send(&slots(-9));
    bench.run_ms(s(3));
    bench.stimulus(MotorStimulus::Counts(-2).of(0));
    assert!(bench.run_until_mute(20));
    assert_eq!((bench.value("position_counts"), bench.value("carriage_offset_counts")), (-9, -2));

    // A spindle's windows make up for it.
    let mut bench = spindle();
    execute(&mut bench, &[75]);
    bench.stimulus(MotorStimulus::Counts(-1_000).of(0));
    bench.run_ms(300);
    assert_eq!(bench.value("speed_counts"), 0);
    assert!(bench.history("speed_counts").iter().all(|(_, counts)| *counts >= 0));
    bench.run_ms(s(20));
    assert!((bench.value("speed_rpm") - 1_500).abs() <= 20);
}

#[test]
fn with_half_the_supply_an_axis_is_late_but_arrives() {
    let (mut nominal, mut sagging) = (transverse(), transverse());
    let part = [225, 0x23, 0x28, 0];
    let (replies, in_time) = execute(&mut nominal, &part);
    assert_eq!(replies, [ACK]);
    sagging.send(&part);
    sagging.run_ms(s(1));
    sagging.stimulus(MotorStimulus::Supply(500).of(0));
    assert!(sagging.run_until_mute(30));
    let late = sagging.now.as_secs_f64() - in_time;
    assert!(late > 0.2, "{late}");
    sagging.run_ms(s(60));
    assert_eq!((sagging.replies(), sagging.value("position_counts")), (vec![ACK], 9_000));
    assert_eq!(sagging.value("carriage_offset_counts"), 0);
}

#[test]
fn backlash_is_hidden_from_the_feed_and_costs_the_infeed_time() {
    let mut bench = transverse();
    bench.stimulus(MotorStimulus::Backlash(100).of(0));
    for (distance, offset) in [(900, 0), (-400, 100), (-200, 100), (400, 0)] {
        assert_eq!(execute(&mut bench, &way(distance)).0, [ACK]);
        bench.run_ms(s(60));
        // The motor overshoots by some counts; the carriage stays there when it comes back.
        let found = bench.value("carriage_offset_counts");
        assert!((0..=100).contains(&found) && (found - offset).abs() <= 20, "{distance}: {found}");
    }
    assert_eq!(bench.value("position_counts"), 700);
    execute(&mut bench, &way(-100));
    bench.stimulus(MotorStimulus::Backlash(0).of(0));
    execute(&mut bench, &way(1));
    assert_eq!(bench.value("carriage_offset_counts"), 0);

    let mut bench = depth();
    bench.stimulus(MotorStimulus::Backlash(2).of(0));
    let forth = execute(&mut bench, &slots(5));
    let back = execute(&mut bench, &slots(-5));
    assert_eq!((forth.0, back.0), (vec![ACK], vec![ACK]));
    assert_eq!((bench.value("position_counts"), bench.value("carriage_offset_counts")), (0, 0));
    // Two slots of 0.667 s.
    assert!((back.1 - forth.1 - 1.33).abs() < 0.7, "{} {}", forth.1, back.1);
    // More than the firmware has patience for.
    bench.stimulus(MotorStimulus::Backlash(9).of(0));
    assert_eq!(execute(&mut bench, &slots(-5)).0, [CAN, b's']);
}

#[test]
fn a_chip_in_the_way_is_a_stall_and_can_be_backed_off() {
    for sign in [1, -1] {
        let mut bench = transverse();
        bench.stimulus(MotorStimulus::EndStop(500 * sign).of(0));
        assert_eq!(execute(&mut bench, &way(900 * sign)).0, [CAN, b's']);
        assert_eq!(bench.value("position_counts"), i64::from(500 * sign));
        assert_eq!(execute(&mut bench, &way(-300 * sign)).0, [ACK]);
        bench.stimulus(MotorStimulus::EndStop(0).of(0));
        assert_eq!(execute(&mut bench, &way(900 * sign)).0, [ACK]);
        assert!((bench.value("position_counts") - i64::from(1_100 * sign)).abs() <= 1);

        let mut bench = depth();
        bench.stimulus(MotorStimulus::EndStop(3 * sign).of(0));
        assert_eq!(execute(&mut bench, &slots(5 * sign)).0, [CAN, b's']);
        assert_eq!(bench.value("position_counts"), i64::from(3 * sign));
    }
}

#[test]
fn after_a_loss_of_supply_a_slave_counts_from_where_it_coasted_to() {
    let mut bench = transverse();
    bench.send(&way(9_000));
    bench.run_ms(s(2));
    let before = bench.value("position_counts");
    bench.stimulus(Stimulus::Power(false));
    assert_eq!((bench.value("position_counts"), bench.value("drive"), bench.board.mute()), (0, 0, true));
    bench.hung = true;
    bench.run_ms(s(20));
    bench.hung = false;
    bench.stimulus(Stimulus::Power(true));
    // 3733 counts/s for 0.72 s.
    let coasted = bench.value("carriage_offset_counts") - before;
    assert!((coasted - 2_683).abs() < 150, "{before} {coasted}");
    assert_eq!((bench.value("position_counts"), bench.board.poll_timeout()), (0, None));
    bench.send(&[ENQ]);
    bench.run_ms(20);
    assert_eq!(bench.replies(), [CAN, b'r']);
    assert_eq!(execute(&mut bench, &way(100)).0, [ACK]);
    assert!((bench.value("position_counts") - 100).abs() <= 1);
    assert_eq!(bench.value("carriage_offset_counts"), before + coasted);

    // The infeed axis does not coast far: 13 slots, and the counts are gone.
    let mut bench = depth();
    assert_eq!(execute(&mut bench, &slots(13)).0, [ACK]);
    bench.stimulus(Stimulus::Power(false));
    bench.stimulus(Stimulus::Power(true));
    assert_eq!((bench.value("position_counts"), bench.value("carriage_offset_counts")), (0, 13));
    bench.ask();
    assert_eq!(bench.replies(), [CAN, b'r']);
    assert_eq!(execute(&mut bench, &slots(-3)).0, [ACK]);
    assert_eq!((bench.value("position_counts"), bench.value("carriage_offset_counts")), (-3, 13));

    // Powered on while it coasts, it watches itself coast.
    let mut bench = spindle();
    execute(&mut bench, &[200]);
    bench.stimulus(Stimulus::Power(false));
    bench.stimulus(Stimulus::Power(true));
    bench.run_ms(s(2));
    assert!((1_900..2_100).contains(&bench.value("speed_rpm")));
    bench.run_ms(s(60));
    assert_eq!((bench.value("speed_rpm"), bench.board.poll_timeout()), (0, None));
}

#[test]
fn another_oscillator_changes_the_window_and_the_bit() {
    let fast = Clock::from_ppb(100_000_000).unwrap();
    let mut bench = spindle();
    execute(&mut bench, &[75]);
    bench.run_ms(s(20));
    bench.stimulus(Stimulus::Clock(fast));
    bench.run_ms(s(60));
    // It takes 27.27 ms for 30, and so 1500 rpm for less.
    let told = bench.history("speed_counts");
    let counts = told.iter().rev().take(100).map(|(_, counts)| *counts).sum::<i64>();
    assert!(counts > 3_500, "{counts}");
    let windows: Vec<u64> = told.windows(2).rev().take(20).map(|pair| pair[1].0.since(pair[0].0).as_nanos()).collect();
    let window = 30e6 / 1.1;
    assert!(windows.iter().all(|ns| (*ns as f64 / window).fract().min(1.0 - (*ns as f64 / window).fract()) < 1e-3));
    let now = bench.now;
    bench.send(&[ENQ]);
    bench.run_ms(20);
    let character = bench.outputs.iter().find_map(|(at, output)| match output {
        Output::Character { end, .. } if *at > now => Some(end.since(*at)),
        _ => None,
    });
    assert_eq!(character, Some(Span::from_nanos(946_970)));
    let fresh = Spindle::new(&SpindleSettings::default(), fast);
    assert_eq!(bench.board.receivers()[0].lookahead(), fresh.receivers()[0].lookahead());
}

/// The position after each of so many samples of 30 ms.
fn positions(bench: &mut Bench<Transverse>, samples: usize) -> Vec<i64> {
    let sample = |_| {
        bench.run_ms(30);
        bench.value("position_counts")
    };
    (0..samples).map(sample).collect()
}

/// §4: 20 V for 10 s; Eq. 2 with km = 19 and τ = 2.8 s. 682 of 1023 LSB are 20.0 V.
#[test]
fn the_service_mode_drives_the_main_motor_whatever_its_law_says() {
    let mut bench = spindle();
    bench.send(&[200]);
    bench.stimulus(MotorStimulus::Drive(667).of(0));
    assert_eq!(bench.value("drive"), 682);
    bench.run_ms(s(30));
    let rpm = 380.0 * 60.0 / core::f64::consts::TAU;
    assert!((bench.value("speed_rpm") as f64 - rpm).abs() <= 5.0, "{}", bench.value("speed_rpm"));
    // At once: with its firmware hung, it stays there.
    let mut hung = spindle();
    hung.hung = true;
    hung.stimulus(MotorStimulus::Drive(667).of(0));
    hung.run_ms(s(30));
    hung.hung = false;
    hung.run_ms(s(1));
    assert!((hung.value("speed_rpm") as f64 - rpm).abs() <= 5.0, "{}", hung.value("speed_rpm"));
    // The law regulates on from where it stood.
    bench.stimulus(MotorStimulus::Drive(0).of(0));
    bench.run_ms(s(20));
    assert_eq!(bench.value("speed_rpm"), 4_000);
    // One quadrant: it does not brake.
    bench.stimulus(MotorStimulus::Drive(-500).of(0));
    bench.run_ms(s(20));
    assert_eq!(bench.value("speed_rpm"), 4_000);
}

/// Ramps of K0·u after a lag of τ: 200 LSB · 29.41 counts/s each way.
#[test]
fn the_service_mode_drives_the_feed_axis_both_ways_and_leaves_it_where_it_is() {
    let mut bench = transverse();
    bench.stimulus(MotorStimulus::Drive(784).of(0));
    assert_eq!(bench.value("drive"), 200);
    let there = positions(&mut bench, 150);
    assert!((there[149] - there[148] - 176).abs() <= 2, "{there:?}");
    bench.stimulus(MotorStimulus::Drive(-784).of(0));
    let back = positions(&mut bench, 150);
    assert!((back[149] - back[148] + 176).abs() <= 2, "{back:?}");
    bench.stimulus(MotorStimulus::Drive(0).of(0));
    let rest = positions(&mut bench, 400);
    assert_eq!((bench.value("drive"), rest[398]), (0, rest[399]));
    assert!(bench.board.mute());
}

#[test]
fn a_move_waits_for_the_end_of_the_service_mode() {
    let mut bench = transverse();
    bench.send(&way(9_000));
    bench.run_ms(s(1));
    bench.stimulus(MotorStimulus::Drive(-500).of(0));
    bench.run_ms(s(3));
    assert!(bench.value("position_counts") < -3_000 && bench.value("drive") == -128);
    bench.stimulus(MotorStimulus::Drive(0).of(0));
    assert!(bench.run_until_mute(60));
    assert!((bench.value("position_counts") - 9_000).abs() <= 1, "{}", bench.value("position_counts"));

    // Driven through its target, an axis is not done either.
    let mut bench = depth();
    bench.send(&slots(5));
    bench.stimulus(MotorStimulus::Drive(1_000).of(0));
    bench.run_ms(s(20));
    assert!(bench.value("position_counts") > 25 && bench.value("drive") == 1);
    let before = bench.events();
    bench.stimulus(MotorStimulus::Drive(0).of(0));
    assert!(bench.run_until_mute(60));
    assert!((bench.value("position_counts") - 5).abs() <= 1, "{}", bench.value("position_counts"));
    assert_ne!(bench.events(), before);
}

#[test]
fn without_supply_there_is_no_service_mode() {
    let mut board = Stepper::new(Spindle::new(&SpindleSettings::default(), Clock::TRUE));
    let at = |ms: u64| Instant::START + Span::from_millis(ms);
    let heard = |ms, stimulus| Heard::Stimulus { at: at(ms), stimulus };
    let heard = vec![heard(10, Stimulus::Power(false)), heard(20, MotorStimulus::Drive(900).of(0))];
    let report = board.grant(Grant { commit: Instant::START, until: at(500), heard }).unwrap();
    assert!(!report.outputs.iter().any(|timed| matches!(timed.output, Output::Telemetry { .. })), "{report:?}");
}

#[test]
fn the_infeed_motor_is_switched_on_and_off_in_service_mode_and_a_reset_ends_it() {
    let mut bench = depth();
    bench.stimulus(MotorStimulus::Drive(-1_000).of(0));
    bench.run_ms(s(10));
    // 0.2667 mm/s for 9.95 s, in slots of 0.1778 mm.
    assert_eq!((bench.value("position_counts"), bench.value("drive")), (-15, -1));
    bench.stimulus(Stimulus::Reset);
    bench.run_ms(s(10));
    assert_eq!((bench.value("position_counts"), bench.value("drive")), (-15, 0));
}
