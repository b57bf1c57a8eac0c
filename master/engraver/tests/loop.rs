//! What the loop does about lost steps: figures through the board and its port.

#![allow(clippy::unwrap_used, reason = "part of tests")]

mod common;

use common::Bench;
use torno_protocol::board::{Channel, MotorStimulus, Output};
use torno_protocol::time::{Instant, Span};

const OPEN: &str = "loop.mode = \"open\"\n";

/// X by so many millimetres, at so many mm/s; gives the last status.
fn move_x(bench: &mut Bench, mm: f64, mm_per_s: f64) -> String {
    let said = bench.line(&format!("G91 G1 X{mm} F{}", mm_per_s * 60.0));
    if said.iter().any(|line| line.starts_with("ALARM")) { said.concat() } else { bench.rest() }
}

/// This happens in the middle of a motion of 10 mm.
fn in_the_middle(bench: &mut Bench, mm_per_s: f64, what: MotorStimulus) -> Instant {
    let middle = bench.now + Span::from_millis((5_000.0 / mm_per_s) as u64);
    bench.stimuli.push_back((middle, 0, what));
    middle
}

#[test]
fn without_a_fault_nothing_is_corrected() {
    for phase in 0..12 {
        for mm_per_s in [0.1, 1.0, 10.0, 25.0] {
            let mut bench = Bench::new(&format!("encoder.phase = {}", f64::from(phase) / 12.0));
            let status = move_x(&mut bench, 10.0, mm_per_s);
            assert!(status.contains("<Idle|MPos:10.000,0.000,0.000,0.000"), "{status}");
            assert_eq!(bench.corrections(0), 0, "phase {phase}, {mm_per_s} mm/s");
            let off = bench.carriage(0) - 10.0;
            assert!(off.abs() <= 0.0015, "phase {phase}, {mm_per_s} mm/s: {off}");
            assert_eq!(bench.pulses(0), 4_000);
        }
    }
}

#[test]
fn an_open_loop_loses_whole_electrical_turns() {
    for (mm_per_s, ms, lost) in [(10.0, 34, 0.3), (10.0, 50, 0.5), (10.0, 62, 0.6), (25.0, 60, 1.5), (5.0, 79, 0.4)] {
        let mut bench = Bench::new(OPEN);
        let middle = in_the_middle(&mut bench, mm_per_s, MotorStimulus::Load(1_500));
        bench.stimuli.push_back((middle + Span::from_millis(ms), 0, MotorStimulus::Load(0)));
        move_x(&mut bench, 10.0, mm_per_s);
        let off = 10.0 - bench.carriage(0) - lost;
        assert!(off.abs() <= 0.002, "{mm_per_s} mm/s, {ms} ms: {off} more than {lost}");
        let mut bench = Bench::new("");
        let middle = in_the_middle(&mut bench, mm_per_s, MotorStimulus::Load(1_500));
        bench.stimuli.push_back((middle + Span::from_millis(ms), 0, MotorStimulus::Load(0)));
        let status = move_x(&mut bench, 10.0, mm_per_s);
        assert!(status.contains("<Idle|MPos:10.000"), "{status}");
        assert!((10.0 - bench.carriage(0)).abs() <= 0.01 && bench.corrections(0) > 0);
    }
}

#[test]
fn a_carriage_that_is_blocked_for_good_is_told() {
    for mm_per_s in [1.0, 5.0, 10.0, 25.0] {
        let mut bench = Bench::new("");
        let middle = in_the_middle(&mut bench, mm_per_s, MotorStimulus::Stall(true));
        bench.send(&format!("G91 G1 X10 F{}\n", mm_per_s * 60.0));
        let said = bench.wait_for(|heard| heard.contains("ALARM:3"));
        // The alarm takes 45 characters of line time.
        let after = bench.now.since(middle).as_secs_f64() - 45.0 * 86.8e-6;
        assert!((0.16..=0.225).contains(&after), "{mm_per_s} mm/s: {after}");
        let text = said.iter().find_map(|line| line.strip_prefix("[MSG:X stalled, ")).unwrap();
        let short: f64 = text.split(' ').next().unwrap().parse().unwrap();
        assert!((0.01..0.02).contains(&short), "{said:?}");
        assert!(bench.line("G1 X1")[0].starts_with("error:9"), "locked");
        bench.stimuli.push_back((bench.now, 0, MotorStimulus::Stall(false)));
        assert_eq!(bench.line("$X"), ["[MSG:Caution: Unlocked]", "ok"]);
        assert!(move_x(&mut bench, -1.0, 5.0).starts_with("<Idle"));
        let mut open = Bench::new(OPEN);
        in_the_middle(&mut open, mm_per_s, MotorStimulus::Stall(true));
        assert!(move_x(&mut open, 10.0, mm_per_s).contains("<Idle|MPos:10.000"), "an open loop never notices");
    }
}

#[test]
fn every_400th_pulse_lost_is_made_up_for_in_two_corrections() {
    for mm_per_s in [1.0, 5.0, 10.0, 25.0] {
        for mode in [OPEN, ""] {
            let mut bench = Bench::new(mode);
            bench.stimuli.push_back((bench.now, 0, MotorStimulus::Skip(400)));
            move_x(&mut bench, 10.0, mm_per_s);
            let off = 10.0 - bench.carriage(0);
            match mode {
                OPEN => assert!((off - 0.025).abs() <= 0.0015, "{mm_per_s} mm/s: {off}"),
                _ => assert!(off.abs() <= 0.006 && bench.corrections(0) == 2, "{mm_per_s} mm/s: {off}"),
            }
        }
    }
}

#[test]
fn backlash_costs_twenty_pulses_there_and_back() {
    for mm_per_s in [1.0, 5.0, 10.0, 25.0] {
        for mode in [OPEN, ""] {
            let mut bench = Bench::new(&format!("{mode}mechanics.backlash_mm = 0.05"));
            move_x(&mut bench, 10.0, mm_per_s);
            move_x(&mut bench, -10.0, mm_per_s);
            let off = bench.carriage(0);
            match mode {
                OPEN => assert!((off - 0.05).abs() <= 0.0015, "{mm_per_s} mm/s: {off}"),
                _ => {
                    assert!(off.abs() <= 0.002 && bench.pulses(0) == -20, "{mm_per_s} mm/s: {off}, {}", bench.pulses(0))
                }
            }
        }
    }
}

#[test]
fn the_papers_scale_sees_lost_steps_where_there_are_none() {
    let mut bench = Bench::new("loop.scale = \"paper\"");
    move_x(&mut bench, 100.0, 10.0);
    let off = bench.carriage(0) - 101.2456;
    assert!(off.abs() <= 0.01, "{off}");
    assert_eq!((bench.corrections(0), bench.pulses(0)), (124, 40_496));
}

#[test]
fn wiring_errors_of_the_encoder_stop_the_axis_within_a_millimetre() {
    let wrong =
        [MotorStimulus::Swap(true), MotorStimulus::Dead(Some(Channel::A)), MotorStimulus::Dead(Some(Channel::B))];
    for what in wrong {
        let mut bench = Bench::new("");
        bench.stimuli.push_back((bench.now, 0, what));
        let status = move_x(&mut bench, 10.0, 10.0);
        assert!(status.contains("ALARM:3") || status.starts_with("<Alarm"), "{what:?}: {status}");
        assert!(bench.carriage(0).abs() < 1.0, "{what:?}: {}", bench.carriage(0));
    }
}

#[test]
fn the_others_wait_so_that_the_path_is_kept() {
    // Pulses that are added while X is still blocked turn the field on. Half an electrical turn ahead of the rotor, it
    // pulls the rotor back once that is free.
    for (others, mm_per_s, rigid, swinging) in [
        ("wait", 10.0, 0.0272, 0.0355),
        ("wait", 25.0, 0.0378, 0.0449),
        ("go-on", 10.0, 0.565, 0.578),
        ("go-on", 25.0, 1.764, 4.221),
    ] {
        for (rotor_hz, expected) in [(0.0, rigid), (150.0, swinging)] {
            let mut bench = Bench::with_rotor(&format!("others = \"{others}\""), rotor_hz);
            bench.every = Some((Span::from_micros(500), Vec::new()));
            let middle = in_the_middle(&mut bench, mm_per_s, MotorStimulus::Load(1_500));
            bench.stimuli.push_back((middle + Span::from_millis(50), 0, MotorStimulus::Load(0)));
            bench.line(&format!("G91 G1 X10 Y10 F{}", mm_per_s * 60.0));
            let status = bench.rest();
            assert!(status.contains("<Idle|MPos:10.000,10.000"), "{status}");
            let (_, places) = bench.every.take().unwrap();
            // How far the path is from the diagonal.
            let worst = places.iter().map(|[x, y]| (x - y).abs() / 2_f64.sqrt()).fold(0.0, f64::max);
            println!("{others}, {mm_per_s} mm/s, rotor {rotor_hz} Hz: {worst:.4} mm off the path");
            assert!((worst / expected - 1.0).abs() < 0.005, "{others}, {mm_per_s} mm/s, {rotor_hz} Hz: {worst}");
            let off = [0, 1].map(|axis| (bench.carriage(axis) - 10.0).abs());
            assert!(off.iter().all(|off| *off <= 0.01), "{others}, {mm_per_s} mm/s: {off:?}");
        }
    }
}

#[test]
fn a_dead_band_below_a_count_hunts() {
    // Pulses that an error must be for a correction, and the corrections on 10 mm in 12 phases of the encoder.
    for (dead_band, expected) in [(6, 0), (5, 0), (4, 0), (3, 64), (2, 868)] {
        let mut corrections = 0;
        for phase in 0..12 {
            let phase = f64::from(phase) / 12.0;
            let mut bench =
                Bench::new(&format!("encoder.phase = {phase}\nloop.dead_band_pulses = {dead_band}\nloop.force = true"));
            assert!(move_x(&mut bench, 10.0, 10.0).starts_with("<Idle"));
            corrections += bench.corrections(0);
        }
        assert_eq!(corrections, expected, "{dead_band} pulses");
    }
    for phase in 0..12 {
        let mut bench = Bench::new(&format!(
            "encoder.phase = {}\nloop.dead_band_pulses = 1\nloop.force = true",
            f64::from(phase) / 12.0
        ));
        assert!(!move_x(&mut bench, 10.0, 10.0).starts_with("<Idle"), "phase {phase}: alarm");
    }
}

#[test]
fn the_period_of_the_loop_follows_from_the_parts() {
    let pulses = |toml: &str, axis: usize| {
        let settings: torno_engraver::EngraverSettings = toml::from_str(toml).unwrap();
        settings.check().unwrap();
        settings.axis(axis).scale().least_pulses()
    };
    let all = [
        ("", 0, 4),
        ("encoder.belt_lines = 1000", 0, 7),
        ("encoder.belt_lines = 500", 0, 14),
        ("mechanics.lead_mm = 4.0", 0, 5),
        ("drive.pulses_per_rev = 4000", 0, 7),
        ("", 3, 2),
    ];
    for (toml, axis, expected) in all {
        assert_eq!(pulses(toml, axis), expected, "{toml}, axis {axis}");
    }
}

#[test]
fn a_counter_underflows_harmlessly() {
    // X has a counter of 16 bits, Y one of 32; both begin at 3000, 24.75 mm from their lowest value.
    let mut bench = Bench::new("");
    bench.line("G91 G1 X-30 Y-30 F600");
    let status = bench.rest();
    assert!(status.contains("<Idle|MPos:-30.000,-30.000"), "{status}");
    for axis in [0, 1] {
        assert_eq!(bench.corrections(axis), 0);
        assert!((bench.carriage(axis) + 30.0).abs() <= 0.0015);
    }
}

#[test]
fn steady_friction_is_corrected_once() {
    let mut bench = Bench::new("motor.friction = 0.8");
    move_x(&mut bench, 10.0, 10.0);
    assert!(bench.worst(0) <= 0.0101 && bench.corrections(0) == 1 && bench.pulses(0) == 4_004);
}

/// Everything that was done by pins, with a status asked for ten times a second or never.
fn moved(asks: bool) -> Vec<(Instant, Output)> {
    let mut bench = Bench::new("");
    let shock = in_the_middle(&mut bench, 10.0, MotorStimulus::Load(1_500));
    bench.stimuli.push_back((shock + Span::from_millis(40), 0, MotorStimulus::Load(0)));
    bench.send("G91G1X10Y4F600\nX-3Z1\nG2X4Y4I4\n");
    let end = bench.now + Span::from_secs(6);
    while bench.now < end {
        bench.run_to(bench.now + Span::from_millis(100));
        if asks {
            assert!(bench.status().contains('<'));
        }
    }
    let is_pin = |output: &Output| matches!(output, Output::Pin { .. });
    bench.outputs.into_iter().filter(|(_, output)| is_pin(output)).collect()
}

#[test]
fn whoever_asks_changes_no_pulse() {
    let (asked, left_alone) = (moved(true), moved(false));
    assert!(left_alone.len() > 100);
    assert_eq!(asked, left_alone);
}

#[test]
fn after_homing_lost_counts_are_found_at_the_index_mark() {
    let mut bench = Bench::new("eeprom = [\"$22=1\"]");
    assert_eq!(bench.line("$H"), ["ok"]);
    assert!(bench.status().contains("<Idle|MPos:-1.000,-1.000,-1.000,0.000"));
    assert!((bench.carriage(0) - 149.0).abs() <= 0.002, "{}", bench.carriage(0));
    move_x(&mut bench, -20.0, 25.0);
    bench.stimuli.push_back((bench.now, 0, MotorStimulus::Counts(5)));
    // The loop believes the counts, and takes the carriage away.
    move_x(&mut bench, -1.0, 25.0);
    assert!((bench.carriage(0) - 128.0).abs() > 0.03, "{}", bench.carriage(0));
    let said = bench.line("G91 G1 X-70 F1500");
    assert_eq!(said, ["ok"]);
    let said = bench.wait_for(|heard| heard.contains("counts]"));
    assert!(said.iter().any(|line| line.starts_with("[MSG:X had ") && line.ends_with(" 5 counts]")), "{said:?}");
    bench.rest();
    assert!((bench.carriage(0) - 58.0).abs() <= 0.01, "{}", bench.carriage(0));
}

#[test]
fn sequenced_motion_goes_where_it_is_to_and_not_on_a_line() {
    let mut bench = Bench::new("motion = \"sequenced\"\ntimer_prescaler = 120");
    bench.every = Some((Span::from_micros(500), Vec::new()));
    bench.line("G91 G1 X100 Y33.3 F1500");
    let status = bench.rest();
    assert!(status.contains("<Idle|MPos:100.000,33.300"), "{status}");
    let (_, places) = bench.every.take().unwrap();
    let off = places.iter().map(|[x, y]| (33.3 * x - 100.0 * y).abs() / 105.4).fold(0.0, f64::max);
    assert!((0.165..0.175).contains(&off), "{off}");
    assert!((bench.carriage(0) - 100.0).abs() < 0.002 && (bench.carriage(1) - 33.3).abs() < 0.002);
    assert_eq!((bench.corrections(0), bench.corrections(1)), (0, 0));
    // A hold stops it at once, and a start goes on.
    bench.line("G1 X-20 F600");
    bench.run_to(bench.now + Span::from_millis(500));
    bench.send("!");
    bench.run_to(bench.now + Span::from_millis(100));
    let held = bench.carriage(0);
    bench.run_to(bench.now + Span::from_millis(500));
    assert!((bench.carriage(0) - held).abs() < 1e-9 && held < 96.0, "{held}");
    bench.send("~");
    let status = bench.rest();
    assert!(status.contains("<Idle|MPos:80.000,33.300"), "{status}");
}

/// From rest to 25 mm/s at once the rotor swings by more than the dead band, while the last pulses of Y are out too.
#[test]
fn a_motion_ends_whose_axes_swing_to_its_end() {
    let mut bench = Bench::with_rotor("motion = \"sequenced\"", 150.0);
    bench.line("G91 G1 X10 Y3.33 F1500");
    let status = bench.rest();
    assert!(status.contains("<Idle|MPos:10.000,3.330"), "{status}");
    assert!(bench.corrections(0) > 100 && (bench.carriage(0) - 10.0).abs() < 0.01, "{}", bench.carriage(0));
}

#[test]
fn as_the_paper_has_it_it_moves_and_corrects_what_is_right() {
    let mut bench = Bench::new("preset = \"paper\"");
    let status = move_x(&mut bench, 100.0, 10.0);
    assert!(status.contains("<Idle|MPos:100.000"), "{status}");
    assert!(bench.corrections(0) > 100, "{}", bench.corrections(0));
    assert!((bench.carriage(0) - 101.2456).abs() < 0.02, "{}", bench.carriage(0));
}

#[test]
fn as_the_paper_has_it_but_without_a_loop_nothing_is_corrected() {
    let mut bench = Bench::new("preset = \"paper\"\nloop.mode = \"open\"");
    let status = move_x(&mut bench, 100.0, 10.0);
    assert!(status.contains("<Idle|MPos:100.000"), "{status}");
    assert!(bench.corrections(0) == 0 && (bench.carriage(0) - 100.0).abs() < 0.002, "{}", bench.carriage(0));
}

#[test]
fn the_motor_of_a_turns_as_fast_as_the_others() {
    // 300 degrees a second are 10 000 pulses a second, as 25 mm/s are.
    let mut bench = Bench::new("a = { degrees_per_s = 300.0, degrees_per_s2 = 2400.0 }");
    bench.line("G91 G0 X50 A600");
    let status = bench.rest();
    assert!(status.contains("<Idle|MPos:50.000,0.000,0.000,600.000"), "{status}");
    assert_eq!((bench.corrections(0), bench.corrections(3)), (0, 0));
    assert!((bench.carriage(3) - 600.0).abs() <= 0.02, "{}", bench.carriage(3));
}
