//! The boards' pins, beside what their telemetry tells.

#![allow(clippy::unwrap_used, reason = "part of tests")]

mod common;

use common::{Bench, depth, s, spindle, transverse};
use torno_protocol::board::{Board, MotorStimulus, Pin, Stimulus};
use torno_protocol::clock::{Clock, Rate, Ticks};
use torno_protocol::line::Level;
use torno_protocol::time::{Instant, Span};
use torno_slaves::{Depth, DepthSettings, Spindle, SpindleSettings, Transverse, TransverseSettings};

/// A period of the pulse-width modulator, in ns.
const PERIOD: u64 = 819_200;

/// A board whose pins are watched.
fn watched<B: Board>(mut board: B) -> Bench<B> {
    board.watch_pins();
    Bench::new(board)
}

fn pin<B: Board>(bench: &mut Bench<B>, name: &str) -> Pin {
    bench.board.pins(bench.now).into_iter().find(|pin| pin.name == name).unwrap()
}

/// How many edges to `level` there are up to `at`.
fn edges(pin: &Pin, level: Level, at: Instant) -> i64 {
    pin.edges.iter().filter(|edge| edge.level == level && edge.at <= at).count() as i64
}

fn level_at(pin: &Pin, at: Instant) -> bool {
    pin.edges.iter().take_while(|edge| edge.at <= at).last().map_or(pin.first, |edge| edge.level) == Level::High
}

#[test]
fn the_spindles_encoder_has_as_many_pulses_as_its_windows_count() {
    let mut bench = watched(Spindle::new(&SpindleSettings::default(), Clock::TRUE));
    bench.send(&[75]);
    bench.run_ms(s(8));
    bench.send(&[0]);
    bench.run_ms(s(20));
    let encoder = pin(&mut bench, "encoder");
    assert!(encoder.edges.windows(2).all(|pair| pair[0].at < pair[1].at && pair[0].level != pair[1].level));
    let window = Ticks::new(Instant::START, Rate::fraction(1_000, 30), Clock::TRUE);
    let counted = bench.history("speed_counts");
    let count = |at: Instant| counted.iter().take_while(|(since, _)| *since <= at).last().unwrap().1;
    let mut sum = 0;
    for n in 1..900 {
        sum += count(window.at(n));
        assert_eq!(edges(&encoder, Level::High, window.at(n)), sum, "window {n}");
    }
    assert!(sum > 10_000, "{sum}");
}

#[test]
fn each_period_of_the_modulator_is_high_for_the_drives_share() {
    let mut bench = watched(Spindle::new(&SpindleSettings::default(), Clock::TRUE));
    bench.send(&[200]);
    bench.run_ms(s(8));
    bench.send(&[0]);
    bench.run_ms(s(1));
    let pwm = pin(&mut bench, "pwm");
    let drives = bench.history("drive");
    assert!(drives.iter().any(|(_, drive)| *drive == 1_023), "full drive is among them");
    let mut next = pwm.edges.iter().peekable();
    let mut high = pwm.first == Level::High;
    for n in 0..8_000_000_000 / PERIOD {
        let begin = Instant::from_nanos(n * PERIOD);
        let end = begin + Span::from_nanos(PERIOD);
        let drive = drives.iter().take_while(|(since, _)| *since <= begin).last().unwrap().1;
        let (mut on, mut since) = (0, begin);
        while let Some(edge) = next.next_if(|edge| edge.at < end) {
            on += if high { edge.at.since(since).as_nanos() } else { 0 };
            (high, since) = (edge.level == Level::High, edge.at);
        }
        on += if high { end.since(since).as_nanos() } else { 0 };
        assert_eq!(on, (PERIOD * drive as u64 + 511) / 1_023, "period {n}, drive {drive}");
    }
    // Set to 0, it was off at once.
    let off = drives.last().unwrap();
    assert_eq!((off.1, level_at(&pwm, off.0), pwm.edges.last().unwrap().at <= off.0), (0, false, true));
}

#[test]
fn the_bridges_pins_are_the_drive_and_the_encoder_is_the_way() {
    for sign in [1_i64, -1] {
        let mut bench = watched(Transverse::new(&TransverseSettings::default(), Clock::TRUE));
        bench.send(&[225, 0x23, 0x28, u8::from(sign < 0)]);
        bench.run_ms(s(6));
        for (at, drive) in bench.history("drive") {
            let pins = bench.board.pins(bench.now);
            let level = |name: &str| level_at(pins.iter().find(|pin| pin.name == name).unwrap(), at);
            assert_eq!((level("forward"), level("backward")), (drive > 0, drive < 0), "{at}");
            let magnitude: u64 = (0..8).map(|bit| u64::from(level(&format!("d{bit}"))) << bit).sum();
            assert_eq!(magnitude, drive.unsigned_abs(), "{at}");
        }
        // Until the axis settles, each count is an edge: rising or falling by the sense.
        let encoder = pin(&mut bench, "encoder");
        let level = if sign > 0 { Level::High } else { Level::Low };
        let way = bench.history("position_counts");
        let going: Vec<_> = way.iter().take_while(|(_, count)| sign * count < 8_990).collect();
        for (at, count) in &going {
            assert_eq!(edges(&encoder, level, *at), sign * count, "{at}");
        }
        assert!(going.len() > 50 && way.last().unwrap().1 == sign * 9_000, "{way:?}");
    }
}

#[test]
fn the_infeeds_pins_are_on_from_the_sub_frame_on() {
    let mut bench = watched(Depth::new(&DepthSettings::default(), Clock::TRUE));
    bench.send(&[0, 3, 1]);
    let received = bench.now;
    bench.run_ms(s(4));
    let backward = pin(&mut bench, "backward");
    assert_eq!((backward.edges[0].at, backward.edges.len()), (received, 2));
    assert_eq!(pin(&mut bench, "forward").edges, []);
    let encoder = pin(&mut bench, "encoder");
    assert_eq!((edges(&encoder, Level::Low, bench.now), bench.value("position_counts")), (3, -3));
}

/// What happens to a motor shows on the pins: a shaft that stops dead has no edges, and what an encoder loses is no
/// edge.
#[test]
fn a_blocked_shaft_has_no_edges_and_lost_counts_are_there() {
    let mut bench = watched(Spindle::new(&SpindleSettings::default(), Clock::TRUE));
    bench.stimulus(MotorStimulus::Drive(500).of(0));
    bench.run_ms(s(3));
    bench.stimulus(MotorStimulus::Counts(-7).of(0));
    bench.stimulus(MotorStimulus::Stall(true).of(0));
    let blocked = bench.now;
    bench.run_ms(s(1));
    bench.stimulus(Stimulus::Power(false));
    bench.run_ms(s(1));
    let (encoder, pwm) = (pin(&mut bench, "encoder"), pin(&mut bench, "pwm"));
    assert!(encoder.edges.last().unwrap().at <= blocked);
    let counted: i64 = bench.history("speed_counts").iter().map(|(_, count)| *count).sum();
    assert!(edges(&encoder, Level::High, blocked) > counted / 2);
    assert!(!level_at(&pwm, bench.now));
}

#[test]
fn a_clock_that_is_off_makes_other_periods() {
    let fast = Clock::from_ppb(100_000_000).unwrap();
    let mut board = Spindle::new(&SpindleSettings::default(), fast);
    board.watch_pins();
    let mut bench = Bench::as_switched_on(board);
    bench.stimulus(MotorStimulus::Drive(500).of(0));
    bench.run_ms(s(1));
    bench.stimulus(Stimulus::Clock(Clock::TRUE));
    let changed = bench.now;
    bench.run_ms(s(1));
    let pwm = pin(&mut bench, "pwm");
    let rising = |from: Instant, to: Instant| edges(&pwm, Level::High, to) - edges(&pwm, Level::High, from);
    let (first, second) = (rising(Instant::START, changed), rising(changed, bench.now));
    assert!((1_340..=1_343).contains(&first) && (1_220..=1_222).contains(&second), "{first} {second}");
}

#[test]
fn nobody_is_told_of_pins_unless_they_are_watched_and_watching_changes_nothing() {
    let drive = |bench: &mut Bench<Transverse>| {
        bench.send(&[225, 1, 0, 1]);
        bench.run_ms(s(3));
    };
    let (mut alone, mut seen) = (transverse(), watched(Transverse::new(&TransverseSettings::default(), Clock::TRUE)));
    drive(&mut alone);
    drive(&mut seen);
    assert_eq!(alone.outputs, seen.outputs);
    assert_eq!(alone.board.pins(alone.now), []);
    assert_eq!(spindle().board.pins(Instant::START), []);
    assert_eq!(depth().board.pins(Instant::START), []);
}
