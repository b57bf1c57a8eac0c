//! What comes of motion without interpolation, as the engraver's paper has it.

use torno_motion::{AxisLimits, Limits, Planner, Rate, Segment, Sequencer};
use torno_protocol::time::{Instant, Span};

const PULSE_MM: f64 = 0.0025;

fn limits(acceleration: f64) -> Limits {
    let axis = AxisLimits { steps_per_mm: 1.0 / PULSE_MM, max_rate: 1_500.0, acceleration };
    Limits { axes: [axis; 4], junction_deviation: 0.01 }
}

fn steps(mm: [f64; 4]) -> [i32; 4] {
    mm.map(|mm| (mm / PULSE_MM).round() as i32)
}

/// How far the places of a segment are at most from the line to `end`, in the plane of X and Y, mm.
fn off_the_line(segment: &Segment, end: [f64; 4]) -> f64 {
    let place = |at: Instant| segment.issued(at).map(|steps| f64::from(steps) * PULSE_MM);
    let length = (end[0] * end[0] + end[1] * end[1]).sqrt();
    let span = segment.end.since(segment.start).as_nanos();
    let looks = (0..=20_000).map(|n| segment.start + Span::from_nanos(span / 20_000 * n));
    looks.map(|at| (place(at)[0] * end[1] - place(at)[1] * end[0]).abs() / length).fold(0.0, f64::max)
}

fn sequenced(prescaler: u32, to: [f64; 4], rate: Rate) -> Sequencer {
    let mut sequencer = Sequencer::new(limits(200.0), 15, prescaler);
    sequencer.push(Instant::START, steps(to), rate);
    sequencer.start(Instant::START);
    sequencer
}

#[test]
fn a_line_is_left_by_as_much_as_the_timers_are_coarse() {
    let line = [100.0, 33.3, 0.0, 0.0];
    let off = |prescaler| off_the_line(sequenced(prescaler, line, Rate::Feed(1_500.0)).segment().unwrap(), line);
    let (coarse, fine) = (off(120), off(1));
    assert!((coarse - 0.170).abs() < 0.01, "{coarse}");
    assert!((fine - 0.0024).abs() < 0.0006, "{fine}");
    let mut planner = Planner::new(limits(1e9), 15);
    planner.push(Instant::START, steps(line), Rate::Feed(1_500.0));
    planner.start(Instant::START);
    let interpolated = off_the_line(planner.segment().unwrap(), line);
    // Half a step of each axis.
    assert!((interpolated - 0.00158).abs() < 0.00001, "{interpolated}");
    // A DDA makes a pulse of Y, or none, with each pulse of X: half a step of Y.
    let nearest = |x: i32| (f64::from(x) * 0.333).round();
    let dda = (0..=40_000).map(|x| (nearest(x) - f64::from(x) * 0.333).abs() * PULSE_MM * 100.0 / 105.4);
    let dda = dda.fold(0.0, f64::max);
    assert!((dda - 0.00119).abs() < 0.00001, "{dda}");
    println!("off the line, mm: timers {coarse:.4} and {fine:.5}, interpolated {interpolated:.5}, a DDA {dda:.5}");
}

#[test]
fn in_a_rapid_motion_each_axis_goes_its_own_way() {
    let to = [30.0, 17.0, 0.0, 0.0];
    let off = off_the_line(sequenced(1, to, Rate::Rapid).segment().unwrap(), to);
    assert!((off - 6.41).abs() < 0.02, "{off}");
    println!("off the line in a rapid motion, mm: {off:.3}");
    // Z first up, and last down.
    for (z, first) in [(5.0, [0, 0, 2_000, 0]), (-5.0, [4_000, 0, 0, 0])] {
        let mut sequencer = sequenced(1, [10.0, 0.0, z, 0.0], Rate::Rapid);
        let end = sequencer.segment().unwrap().end;
        assert_eq!(sequencer.position(end), first);
        assert!(sequencer.advance(end));
        let end = sequencer.segment().unwrap().end;
        assert!(sequencer.advance(end) && sequencer.is_empty());
        assert_eq!(sequencer.position(end), steps([10.0, 0.0, z, 0.0]));
    }
}

#[test]
fn what_is_left_after_a_hold_comes_first() {
    let mut sequencer = sequenced(1, [10.0, 5.0, 0.0, 0.0], Rate::Feed(600.0));
    sequencer.push(Instant::START, steps([0.0, 0.0, 0.0, 0.0]), Rate::Feed(600.0));
    let half = Instant::START + Span::from_millis(500);
    sequencer.hold(half);
    let held = sequencer.position(half);
    assert!(sequencer.segment().is_none() && !sequencer.is_empty() && held[0] > 1_000 && held[0] < 2_500, "{held:?}");
    let later = half + Span::from_secs(1);
    assert_eq!(sequencer.position(later), held);
    sequencer.start(later);
    let end = sequencer.segment().unwrap().end;
    assert_eq!(sequencer.position(end), steps([10.0, 5.0, 0.0, 0.0]));
    assert!(sequencer.advance(end));
    let end = sequencer.segment().unwrap().end;
    assert!(sequencer.advance(end) && sequencer.is_empty());
    assert_eq!(sequencer.position(end), [0; 4]);
}

#[test]
fn a_slow_train_has_a_larger_prescaler() {
    // 1 mm a minute are 6.67 pulses a second, and 120 MHz go into 16 bits only if they are divided by 275 at least.
    let sequencer = sequenced(1, [0.0025 * 4.0, 0.0, 0.0, 0.0], Rate::Feed(1.0));
    let end = sequencer.segment().unwrap().end.as_secs_f64();
    assert!((end - 0.6).abs() < 0.001, "{end}");
}
