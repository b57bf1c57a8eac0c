//! The three boards, seen from outside: what the paper promises, and what the link owes the master.

#![allow(clippy::unwrap_used, reason = "part of tests")]

mod common;

use common::{Bench, depth, s, spindle, transverse};
use torno_protocol::board::{Board, Capability, Description, Motor, MotorStimulus, Output, Stimulus};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{ACK, BEL, CAN, CHARACTER, ENQ};
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::Character;
use torno_slaves::{Depth, DepthController, DepthPlant, DepthSettings, JudgedBy, Transverse, TransverseSettings};

/// Speed, distance and direction as the transverse axis gets them.
fn way(speed: u8, distance: i32) -> [u8; 4] {
    let [high, low] = u16::try_from(distance.abs()).unwrap().to_be_bytes();
    [speed, high, low, u8::from(distance < 0)]
}

/// Distance and direction as the depth axis gets them.
fn slots(distance: i32) -> [u8; 3] {
    let [_, rest @ ..] = way(0, distance);
    rest
}

/// The mean of a quantity from `from` to `to`.
fn mean(history: &[(Instant, i64)], from: Instant, to: Instant) -> f64 {
    let ends = history.iter().skip(1).map(|(at, _)| *at).chain([Instant::NEVER]);
    let parts = history.iter().zip(ends);
    let sum: f64 =
        parts.map(|((at, value), end)| end.min(to).since((*at).max(from)).as_secs_f64() * *value as f64).sum();
    sum / to.since(from).as_secs_f64()
}

#[test]
fn the_spindle_regulates_200_1500_and_4000_rpm() {
    for (rpm, expected, tolerance, duty) in
        [(200, 200.9, 2.0, 0.0367), (1_500, 1_500.0, 0.5, 0.2756), (4_000, 4_000.0, 0.5, 0.7349)]
    {
        let mut bench = spindle();
        bench.send(&[u8::try_from(rpm / 20).unwrap()]);
        bench.run_ms(s(45));
        let (from, to) = (bench.now - Span::from_secs(30), bench.now);
        let counts = mean(&bench.history("speed_counts"), from, to);
        let drive = mean(&bench.history("drive"), from, to) / 1_023.0;
        assert!((counts * 40.0 - expected).abs() < tolerance, "{rpm}: {}", counts * 40.0);
        assert!((drive - duty).abs() < 0.002, "{rpm}: {drive}");
        assert_eq!((bench.value("set_point_rpm"), bench.replies()), (rpm, vec![ACK]));
        assert!((bench.value("speed_rpm") - rpm).abs() <= 20);
    }
}

#[test]
fn the_spindle_is_done_at_4000_rpm_when_it_gets_there_and_not_before() {
    let mut bench = spindle();
    bench.send(&[200]);
    assert!(bench.run_until_mute(20));
    // Full voltage alone takes 3.57 s to 98 %; the loop settles to 2 % in 4.53 s; then come eight windows.
    let done = bench.sent[0].0.as_secs_f64();
    assert!((3.57..6.0).contains(&done), "{done}");
    assert!((bench.value("speed_rpm") - 4_000).abs() <= 20);
    let counts = bench.history("speed_counts");
    let first = |least: i64| counts.iter().find(|(_, n)| *n >= least).unwrap().0.as_secs_f64();
    assert!((first(90) - first(10) - 2.88).abs() < 0.09, "{}", first(90) - first(10));
    assert!(counts.iter().all(|(_, n)| *n <= 101));
}

#[test]
fn the_spindle_coasts_to_a_stop() {
    let mut bench = spindle();
    bench.send(&[200]);
    bench.run_ms(s(20));
    let asked = bench.now;
    bench.send(&[0]);
    assert!(bench.run_until_mute(60));
    let slow = bench.history("speed_counts").into_iter().find(|(at, n)| *at > asked && *n <= 5).unwrap().0;
    // A count of 5 is 240 to 160 rpm, and belongs to the middle of its window.
    let coasted = slow.since(asked).as_secs_f64();
    assert!((7.9..8.5).contains(&coasted), "{coasted}");
    assert_eq!((bench.value("speed_rpm"), bench.value("drive"), bench.replies()), (0, 0, vec![ACK, ACK]));
    // Eight empty windows are done, but the shaft still turns over a few slots before it stands.
    let done = bench.now;
    bench.run_ms(s(60));
    assert!(bench.history("speed_counts").iter().any(|(at, n)| *at > done && *n == 1));
    assert_eq!((bench.value("speed_rpm"), bench.board.poll_timeout()), (0, None));
    // The next start knows nothing of the drive that 4000 rpm took.
    let restart = bench.now;
    bench.send(&[10]);
    bench.run_ms(s(10));
    assert!(bench.history("drive").iter().all(|(at, drive)| *at < restart || *drive < 150));
}

#[test]
fn the_spindle_takes_a_new_set_point_once_it_is_done() {
    let mut bench = spindle();
    bench.send(&[100]);
    assert!(bench.run_until_mute(20));
    bench.send(&[50]);
    assert!(!bench.board.mute());
    assert!(bench.run_until_mute(20));
    assert_eq!((bench.value("set_point_rpm"), bench.replies()), (1_000, vec![ACK, ACK]));
    assert!((bench.value("speed_rpm") - 1_000).abs() <= 20);
}

#[test]
fn a_standing_spindle_wants_nothing() {
    let mut bench = spindle();
    assert!(bench.board.mute() && bench.board.poll_timeout().is_none());
    bench.send(&[0]);
    bench.run_ms(100);
    assert_eq!((bench.replies(), bench.board.poll_timeout()), (vec![ACK], None));
    bench.send(&[10]);
    bench.run_ms(s(20));
    bench.send(&[0]);
    bench.run_ms(s(60));
    assert_eq!(bench.board.poll_timeout(), None);
}

#[test]
fn a_blocked_spindle_is_reported_within_a_second_or_two() {
    let mut bench = spindle();
    bench.stimulus(MotorStimulus::Stall(true).of(0));
    bench.send(&[75]);
    bench.run_ms(1_400);
    assert_eq!(bench.replies(), [CAN, b's']);
    assert_eq!((bench.value("drive"), bench.value("set_point_rpm")), (0, 0));
    // The fault stands until there is something else to do.
    bench.send(&[ENQ]);
    bench.run_ms(20);
    assert_eq!(bench.replies(), [CAN, b's']);
    bench.stimulus(MotorStimulus::Stall(false).of(0));
    bench.run_ms(s(3));
    bench.send(&[0]);
    bench.run_ms(50);
    assert_eq!((bench.replies(), bench.value("speed_counts")), (vec![ACK], 0));
    bench.send(&[75]);
    assert!(bench.run_until_mute(20));
    assert_eq!(bench.replies(), [ACK]);
    assert_eq!(bench.events(), ["stalled", "done", "done"]);
}

#[test]
fn a_spindle_that_is_blocked_while_it_regulates_says_so_unasked() {
    let mut bench = spindle();
    bench.send(&[75]);
    assert!(bench.run_until_mute(20));
    bench.replies();
    bench.stimulus(MotorStimulus::Stall(true).of(0));
    assert!(!bench.board.mute());
    bench.run_ms(1_400);
    assert_eq!(bench.replies(), [CAN, b's']);
    assert!(bench.board.mute());
}

#[test]
fn nine_thousand_counts_take_as_long_as_the_trapezoid_and_half_a_second() {
    let mut bench = transverse();
    bench.send(&way(112, 9_000));
    let sent = bench.now;
    bench.run_ms(s(10));
    let done = bench.sent[0].0.since(sent).as_secs_f64();
    // The set point takes 3.57 s, being in position 0.45 s more, being sure of it 0.12 s.
    assert!((3.5..4.2).contains(&done), "{done}");
    let positions = bench.history("position_counts");
    assert!(positions.iter().all(|(_, count)| *count <= 9_005));
    assert!((bench.value("position_counts") - 9_000).abs() <= 1);
    assert_eq!((bench.value("set_point_counts"), bench.replies()), (9_000, vec![ACK]));
}

#[test]
fn distances_add_up_without_drift() {
    let mut bench = transverse();
    for distance in [900, -1_500, 31, -1, 2, 568] {
        bench.send(&way(200, distance));
        assert!(bench.run_until_mute(20));
        assert_eq!(bench.replies(), [ACK]);
    }
    bench.run_ms(s(5));
    assert_eq!((bench.value("position_counts"), bench.value("set_point_counts")), (0, 0));
}

#[test]
fn a_transverse_axis_at_rest_wants_nothing() {
    let mut bench = transverse();
    assert!(bench.board.mute() && bench.board.poll_timeout().is_none());
    bench.send(&way(0, 0));
    bench.run_ms(200);
    assert_eq!((bench.replies(), bench.board.poll_timeout()), (vec![ACK], None));
    assert_eq!(bench.history("position_counts").len(), 1);
}

#[test]
fn the_transverse_axis_stops_at_both_ends_and_comes_back() {
    for sign in [1, -1] {
        let mut bench = transverse();
        bench.send(&way(225, 65_535 * sign));
        assert!(bench.run_until_mute(30));
        assert_eq!(bench.replies(), [CAN, b'e']);
        assert_eq!(bench.value("position_counts"), i64::from(36_000 * sign));
        assert_eq!((bench.value("drive"), bench.value("set_point_counts")), (0, i64::from(36_000 * sign)));
        // It may stand there. Outwards again it fails at once; inwards it goes, from where it stands.
        bench.send(&way(0, 0));
        assert!(bench.run_until_mute(1));
        assert_eq!(bench.replies(), [ACK]);
        bench.send(&way(225, 10 * sign));
        bench.run_ms(100);
        assert_eq!(bench.replies(), [CAN, b'e']);
        bench.send(&way(225, -1_000 * sign));
        assert!(bench.run_until_mute(10));
        assert_eq!(bench.replies(), [ACK]);
        assert!((bench.value("position_counts") - i64::from(35_000 * sign)).abs() <= 1);
    }
}

#[test]
fn a_blocked_axis_is_reported() {
    let mut bench = transverse();
    bench.send(&way(112, 9_000));
    bench.run_ms(s(1));
    bench.stimulus(MotorStimulus::Stall(true).of(0));
    // The error grows at once to where the drive is full, and then 0.36 s are enough.
    bench.run_ms(350);
    assert_eq!(bench.replies(), []);
    bench.run_ms(200);
    assert_eq!((bench.replies(), bench.value("drive")), (vec![CAN, b's'], 0));

    let mut settings = TransverseSettings::default();
    settings.controller.judged_by = JudgedBy::Time;
    let mut bench = Bench::new(Transverse::new(&settings, Clock::TRUE));
    bench.send(&way(112, 9_000));
    bench.run_ms(s(1));
    bench.stimulus(MotorStimulus::Stall(true).of(0));
    bench.run_ms(1_000);
    assert_eq!(bench.replies(), []);
    bench.run_ms(200);
    assert_eq!((bench.replies(), bench.value("drive")), (vec![CAN, b's'], 0));

    let mut bench = depth();
    bench.send(&slots(30));
    bench.run_ms(s(5));
    bench.stimulus(MotorStimulus::Stall(true).of(0));
    bench.run_ms(s(3));
    let last = bench.history("position_counts").last().unwrap().0;
    let silent = bench.sent[0].0.since(last).as_secs_f64();
    assert!((2.0..2.02).contains(&silent), "{silent}");
    assert_eq!((bench.replies(), bench.value("drive")), (vec![CAN, b's'], 0));
}

#[test]
fn three_slots_take_two_seconds_and_not_one_slot_more() {
    let mut bench = depth();
    bench.send(&slots(3));
    bench.run_ms(s(5));
    let edges: Vec<f64> = bench.history("position_counts").iter().skip(1).map(|(at, _)| at.as_secs_f64()).collect();
    assert_eq!(edges.len(), 3);
    edges.windows(2).for_each(|pair| assert!((pair[1] - pair[0] - 0.667).abs() < 0.011, "{edges:?}"));
    assert_eq!((bench.value("remaining_counts"), bench.replies()), (0, vec![ACK]));
    assert_eq!(bench.board.poll_timeout(), None);
    bench.send(&slots(-3));
    bench.run_ms(s(5));
    assert_eq!((bench.value("position_counts"), bench.replies()), (0, vec![ACK]));
}

#[test]
fn fifty_six_slots_are_exact() {
    let mut bench = depth();
    bench.send(&slots(56));
    assert!(bench.run_until_mute(60));
    let moves = bench.history("position_counts");
    assert!(moves.windows(2).all(|pair| pair[1].1 == pair[0].1 + 1));
    assert_eq!((bench.value("position_counts"), bench.replies()), (56, vec![ACK]));
    let per_slot = (moves[56].0.since(moves[1].0)).as_secs_f64() / 55.0;
    assert!((per_slot - 0.666_667).abs() < 2e-4, "{per_slot}");
}

#[test]
fn a_depth_motor_that_is_too_fast_overshoots_one_slot() {
    let plant = DepthPlant { pitch_mm: 10.0, tau_s: 0.150, ..DepthPlant::default() };
    let settings = DepthSettings { plant, controller: DepthController { poll_ms: 30 }, ..DepthSettings::default() };
    let mut bench = Bench::new(Depth::new(&settings, Clock::TRUE));
    bench.send(&slots(3));
    bench.run_ms(s(10));
    assert_eq!((bench.value("position_counts"), bench.value("remaining_counts")), (4, -1));
    assert_eq!(bench.replies(), [ACK]);
    // A distance of 0 does not move it, not even back.
    let drives = bench.history("drive").len();
    bench.send(&slots(0));
    bench.run_ms(s(1));
    assert_eq!((bench.replies(), bench.history("drive").len()), (vec![ACK], drives));
}

#[test]
fn the_depth_axis_stops_at_both_ends_and_comes_back() {
    for sign in [1, -1] {
        let mut bench = depth();
        bench.send(&slots(500 * sign));
        assert!(bench.run_until_mute(400));
        assert_eq!((bench.replies(), bench.value("position_counts")), (vec![CAN, b'e'], i64::from(450 * sign)));
        bench.send(&slots(0));
        assert!(bench.run_until_mute(1));
        assert_eq!(bench.replies(), [ACK]);
        bench.send(&slots(-2 * sign));
        assert!(bench.run_until_mute(10));
        assert_eq!((bench.replies(), bench.value("position_counts")), (vec![ACK], i64::from(448 * sign)));
    }
}

/// Every slave: what it says to an enquiry at rest, while busy, and once done, and how soon.
fn answers<B: Board>(mut bench: Bench<B>, part: &[u8]) {
    bench.run_ms(100);
    for (busy, expected) in [(false, &[CAN, b'r'][..]), (true, &[BEL]), (false, &[ACK])] {
        if busy {
            bench.send(part);
            bench.run_ms(50);
        } else {
            assert!(bench.run_until_mute(60));
            bench.run_ms(50);
            bench.replies();
        }
        bench.send(&[ENQ]);
        let asked = bench.now;
        bench.run_ms(20);
        let at = bench.sent[0].0;
        assert_eq!(bench.replies(), expected);
        let limit = if busy { Span::from_micros(1_042) } else { Span::from_micros(3_125 + 1_042) };
        assert!(at.since(asked) <= limit);
        // An answer is not a report: it does not end the move.
        assert_eq!(bench.board.mute(), !busy);
    }
}

#[test]
fn enquiries_are_answered_within_milliseconds() {
    answers(spindle(), &[100]);
    answers(transverse(), &way(ENQ, 200));
    answers(depth(), &slots(2));
}

#[test]
fn sub_frames_that_begin_like_an_enquiry_are_executed() {
    let mut bench = transverse();
    bench.send(&way(ENQ, 50));
    assert!(bench.run_until_mute(20));
    assert_eq!((bench.replies(), bench.value("set_point_counts")), (vec![ACK], 50));
    let mut bench = depth();
    bench.send(&slots(i32::from(ENQ) * 256));
    bench.run_ms(50);
    assert_eq!((bench.replies(), bench.value("remaining_counts")), (vec![], 1_280));
}

#[test]
fn what_is_no_sub_frame_is_dropped_and_told() {
    let mut bench = transverse();
    bench.send(&[112, 0, 9]);
    bench.run_ms(10);
    bench.send(&[112, 0, 9, 2]);
    bench.run_ms(10);
    bench.send(&[226, 0, 9, 0]);
    bench.run_ms(10);
    bench.send(&[112]);
    bench.character(Character { byte: 0, framing_error: true, overrun: false });
    bench.send(&[9, 0]);
    bench.run_ms(10);
    bench.character(Character { byte: 0, framing_error: false, overrun: true });
    bench.run_ms(10);
    assert_eq!(
        bench.events(),
        [
            "sub-frame cut short after 3 bytes",
            "sub-frame refused (d)",
            "sub-frame refused (s)",
            "framing error",
            "dropped byte 9 out of place",
            "dropped byte 0 out of place",
            "overrun",
        ]
    );
    assert_eq!((bench.replies(), bench.board.mute()), (vec![], true));
    bench.send(&way(112, 9));
    assert!(bench.run_until_mute(5));
    assert_eq!(bench.replies(), [ACK]);

    let mut bench = spindle();
    bench.send(&[9]);
    bench.run_ms(100);
    assert_eq!((bench.replies(), bench.events()), (vec![], vec!["sub-frame refused (s)".to_owned()]));
}

#[test]
fn a_sub_frame_to_a_busy_axis_is_dropped() {
    let mut bench = transverse();
    bench.send(&way(112, 900));
    bench.run_ms(100);
    bench.send(&way(112, -9_000));
    assert!(bench.run_until_mute(20));
    assert_eq!((bench.replies(), bench.value("set_point_counts")), (vec![ACK], 900));
    assert_eq!(bench.events().len(), 5);
}

#[test]
fn a_reset_loses_the_firmwares_state_and_not_the_position() {
    let mut bench = transverse();
    bench.send(&way(112, 9_000));
    bench.run_ms(s(2));
    let before = bench.value("position_counts");
    bench.send(&way(1, 1)[..2]);
    bench.stimulus(Stimulus::Reset);
    assert_eq!((bench.value("drive"), bench.board.mute()), (0, true));
    // The carriage coasts on (3733 counts/s for 0.72 s) and then stands; nothing is said, and no one holds it.
    bench.run_ms(s(20));
    let after = bench.value("position_counts");
    assert!((after - before - 2_683).abs() < 150, "{before} {after}");
    assert_eq!((bench.replies(), bench.value("set_point_counts"), bench.board.poll_timeout()), (vec![], after, None));
    bench.ask();
    assert_eq!(bench.replies(), [CAN, b'r']);
    bench.send(&way(112, -100));
    assert!(bench.run_until_mute(5));
    assert_eq!((bench.replies(), bench.value("set_point_counts")), (vec![ACK], after - 100));

    let mut bench = depth();
    bench.send(&slots(9));
    bench.run_ms(2_700);
    let before = bench.value("position_counts");
    bench.stimulus(Stimulus::Reset);
    bench.run_ms(s(3));
    assert!(before > 3 && bench.value("position_counts") == before);
    assert_eq!((bench.value("remaining_counts"), bench.value("drive")), (0, 0));
    bench.ask();
    assert_eq!(bench.replies(), [CAN, b'r']);
    bench.send(&slots(-before as i32));
    assert!(bench.run_until_mute(10));
    assert_eq!((bench.replies(), bench.value("position_counts")), (vec![ACK], 0));

    let mut bench = spindle();
    bench.send(&[200]);
    bench.run_ms(s(10));
    bench.replies();
    bench.stimulus(Stimulus::Reset);
    assert_eq!((bench.value("set_point_rpm"), bench.value("drive")), (0, 0));
    bench.run_ms(s(2));
    let speed = bench.value("speed_rpm");
    assert!((1_900..2_100).contains(&speed), "{speed}");
    assert_eq!((bench.replies(), bench.events()), (vec![], vec!["done".to_owned(), "reset".to_owned()]));
    bench.run_ms(s(60));
    assert_eq!((bench.value("speed_counts"), bench.value("speed_rpm"), bench.board.poll_timeout()), (0, 0, None));
}

#[test]
fn a_reset_switches_the_drive_off_at_once() {
    let mut bench = spindle();
    bench.send(&[200]);
    bench.run_ms(s(20));
    bench.stimulus(Stimulus::Reset);
    bench.hung = true;
    bench.run_ms(8_388);
    bench.hung = false;
    bench.run_ms(60);
    // 200 rpm: it has coasted although no window was seen to.
    assert!((4..=5).contains(&bench.value("speed_counts")));
}

#[test]
fn a_coasting_axis_is_taken_from_where_it_is() {
    let mut bench = transverse();
    bench.send(&way(112, 9_000));
    bench.run_ms(s(2));
    bench.stimulus(Stimulus::Reset);
    bench.ask();
    assert_eq!(bench.replies(), [CAN, b'r']);
    let sampled = bench.value("position_counts");
    bench.send(&way(0, 0));
    let taken = bench.value("position_counts");
    assert!(taken > sampled + 15, "{sampled} {taken}");
    assert_eq!(bench.value("set_point_counts"), taken);
    assert!(bench.run_until_mute(10));
    assert_eq!((bench.replies(), bench.value("set_point_counts")), (vec![ACK], taken));
}

#[test]
fn an_axis_stays_where_it_was_sent() {
    // With a strong integral the drive is often not yet 0 when the axis first stands.
    for k2 in [0.5, 5.0] {
        let mut settings = TransverseSettings::default();
        settings.controller.k2 = k2;
        let mut bench = Bench::new(Transverse::new(&settings, Clock::TRUE));
        let mut target = 0;
        for distance in (1..40).map(|n| (n * 37 % 101) * if n % 2 == 0 { 1 } else { -1 }) {
            bench.send(&way(225, distance));
            target += i64::from(distance);
            bench.run_ms(s(120));
            bench.send(&way(0, 0));
            assert!(bench.run_until_mute(2));
            assert!((bench.value("position_counts") - target).abs() <= 1);
            assert_eq!((bench.replies(), bench.value("set_point_counts")), (vec![ACK, ACK], target));
        }
    }
}

#[test]
fn after_a_hang_the_plant_has_moved_on_and_the_ticks_keep_their_grid() {
    let mut bench = spindle();
    bench.send(&[100]);
    bench.run_ms(s(1));
    let seen = bench.outputs.len();
    bench.hung = true;
    bench.run_to(Instant::from_nanos(2_020_000_000));
    bench.hung = false;
    bench.run_to(Instant::from_nanos(2_021_000_000));
    // One late window with all pulses of the second, then the grid of 30 ms again.
    let late = bench.outputs[seen..].iter().find_map(|(at, output)| match output {
        Output::Telemetry { signal: 0, value } => Some((*at, *value)),
        _ => None,
    });
    let (at, value) = late.unwrap();
    assert_eq!(at, Instant::from_nanos(2_020_000_000));
    assert!(value > 700);
    assert_eq!(bench.board.poll_timeout().unwrap().at, Instant::from_nanos(2_040_000_000));
}

#[test]
fn telemetry_comes_first_then_events_then_characters() {
    let mut bench = spindle();
    bench.send(&[10]);
    bench.stimulus(MotorStimulus::Stall(true).of(0));
    bench.run_ms(s(3));
    let rank = |output: &Output| match output {
        Output::Telemetry { signal, .. } => i32::from(*signal),
        Output::Event { .. } => 10,
        _ => 20,
    };
    for pair in bench.outputs.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
        assert!(rank(&pair[0].1) <= rank(&pair[1].1), "{pair:?}");
    }
    assert!(bench.outputs.iter().any(|(_, output)| rank(output) == 20));
}

#[test]
fn each_board_says_what_it_is() {
    let signals = |description: &Description| -> Vec<String> {
        assert!(description.signals.iter().all(|signal| (signal.initial, signal.motor) == (0, Some(0))));
        description.signals.iter().map(|of| format!("{}: {:?}, {}", of.name, of.role, of.unit)).collect()
    };
    let (spindle, transverse, depth) =
        (spindle().board.description(), transverse().board.description(), depth().board.description());
    let position = "position_counts: Position, counts";
    let offset = "carriage_offset_counts: Offset, counts";
    let set_point = "set_point_counts: SetPoint, counts";
    let of_spindle =
        ["speed_counts: Speed, counts", "speed_rpm: Speed, rpm", "set_point_rpm: SetPoint, rpm", "drive: Drive, LSB"];
    assert_eq!(signals(&spindle), of_spindle);
    assert_eq!(signals(&transverse), [position, set_point, "drive: Drive, LSB", offset]);
    assert_eq!(signals(&depth), [position, "remaining_counts: Remaining, counts", "drive: Drive, ", offset]);
    let (motor, axis) = (vec![Capability::Motor], vec![Capability::Motor, Capability::Axis]);
    for (description, capabilities) in [(&spindle, motor), (&transverse, axis.clone()), (&depth, axis)] {
        assert_eq!(description.capabilities, [Capability::Reset]);
        assert_eq!(description.motors, [Motor { name: "motor".to_owned(), capabilities }]);
    }
    for description in [spindle, transverse, depth] {
        assert_eq!((description.ports, description.waits.len()), (vec!["master".to_owned()], 0));
        let events = [
            "dropped byte {} out of place",
            "sub-frame cut short after {} bytes",
            "sub-frame refused ({c})",
            "framing error",
            "overrun",
            "done",
            "stalled",
            "end of travel",
            "reset",
        ];
        assert_eq!(description.events, events);
    }
}

#[test]
fn a_board_wants_to_run_at_the_earliest_of_what_it_waits_for() {
    let mut bench = transverse();
    assert_eq!(bench.board.poll_timeout(), None);
    bench.send(&way(112, 900)[..2]);
    let gap = bench.board.poll_timeout().unwrap();
    assert_eq!((gap.at, gap.why), (bench.now + CHARACTER.times(3), "gap in a sub-frame"));
    bench.send(&way(112, 900)[2..]);
    let sample = bench.board.poll_timeout().unwrap();
    assert_eq!((sample.at.as_nanos() % 30_000_000, sample.why), (0, "sample"));
    // Asked, it has a second character to send, long before the next sample.
    bench.run_to(sample.at + CHARACTER);
    bench.send(&[ENQ]);
    let free = bench.board.poll_timeout();
    assert_eq!(free.map(|deadline| deadline.why), Some("sample"), "BEL is one character");
    let mut bench = spindle();
    bench.send(&[ENQ]);
    let free = bench.board.poll_timeout().unwrap();
    assert_eq!(free.why, "transmitter free");
    assert_eq!(free.at.since(bench.now).as_nanos(), 1_041_667);
    assert!(!bench.board.mute());
}
