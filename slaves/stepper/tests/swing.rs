//! A rotor that swings: 150 Hz, ζ = 0.1, unless said.

#![allow(clippy::unwrap_used, reason = "part of tests")]

mod common;

use common::{Bench, MM, ms, with};
use torno_protocol::time::Span;
use torno_protocol::train::Train;
use torno_stepper::{AxisSettings, Fault, Law, LoopEvent, Mode};

fn swinging(change: impl FnOnce(&mut AxisSettings)) -> AxisSettings {
    with(|axis| {
        axis.motor.rotor_hz = 150.0;
        change(axis);
    })
}

fn train(bench: &Bench, mm_per_s: f64) -> Train {
    let per = (mm_per_s * 1_000.0).round() as u64;
    Train { first: bench.now, nanos: 2_500_000_000, per, count: 100_000, high: Span::from_micros(3) }
}

/// Whether the axis keeps in step from rest at this speed at once, under a constant push. The field moves evenly, or in
/// steps.
fn starts(settings: &AxisSettings, push: u32, mm_per_s: f64, in_steps: bool) -> bool {
    let mut bench = Bench::new(settings);
    // Slowly, so that the rotor does not swing about its new place.
    for n in 1..=push {
        bench.fault(f64::from(n) * 4.0, Fault::Push(n.cast_signed()));
    }
    bench.wait(f64::from(push) * 4.0 + 100.0);
    let lasts = Span::from_millis(100);
    if in_steps {
        let hz = mm_per_s / settings.scale().pulse_mm();
        for n in 0..(hz * lasts.as_secs_f64()) as u64 {
            let first = bench.now + Span::from_nanos((n as f64 / hz * 1e9).round() as u64);
            let step = Train { first, nanos: 1_000, per: 1, count: 1, high: Span::from_nanos(500) };
            bench.axis.train(first, true, step);
        }
    } else {
        bench.axis.train(bench.now, true, train(&bench, mm_per_s));
    }
    bench.axis.deviation(bench.now + lasts).abs() < MM / 20
}

fn start_limit(settings: &AxisSettings, push: u32, in_steps: bool) -> f64 {
    let (mut starts_at, mut fails_at) = (5.0, 100.0);
    while fails_at - starts_at > 0.005 {
        let middle = f64::midpoint(starts_at, fails_at);
        if starts(settings, push, middle, in_steps) {
            starts_at = middle;
        } else {
            fails_at = middle;
        }
    }
    starts_at
}

fn free(damping: f64, corner: f64, per_rev: u32) -> AxisSettings {
    swinging(|axis| {
        axis.control.mode = Mode::Open;
        (axis.motor.friction, axis.motor.damping, axis.motor.corner_mm_per_s) = (0.0, damping, corner);
        (axis.drive.pulses_per_rev, axis.drive.max_hz, axis.drive.min_pulse_us) = (per_rev, 1e7, 0.0);
    })
}

/// v = f0·E·√(2B), B = 2·cos a − L(π − 2a), a = asin L.
#[test]
fn the_start_limit_falls_with_the_load() {
    for (corner, expected) in [(0.0, [30.0, 27.62, 22.73, 17.56]), (50.0, [28.02, 25.76, 21.19, 16.42])] {
        for (push, expected) in [0, 100, 300, 500].into_iter().zip(expected) {
            let found = start_limit(&free(0.0, corner, 2_000), push, false);
            println!("v_c {corner}, load {push}: {found:.2} ({expected})");
            assert!((found / expected - 1.0).abs() < 0.005, "{corner} {push}: {found} {expected}");
        }
    }
}

/// See the documentation of the module `swing`.
#[test]
fn damping_raises_the_start_limit_and_steps_lower_it() {
    let found = |damping, per_rev, in_steps| {
        let found = [100, 300, 500].map(|push| start_limit(&free(damping, 0.0, per_rev), push, in_steps));
        println!("damping {damping}, {per_rev} pulses, in steps {in_steps}: {found:.2?}");
        found
    };
    let even = found(0.0, 2_000, false);
    let damped = [0.05, 0.1, 0.2].map(|damping| found(damping, 2_000, false));
    let fine = [0.0, 0.1].map(|damping| found(damping, 2_000, true));
    let coarse = [0.0, 0.1].map(|damping| found(damping, 200, true));
    for n in 0..3 {
        assert!(even[n] < damped[0][n] && damped[0][n] < damped[1][n] && damped[1][n] < damped[2][n]);
        assert!((fine[0][n] / even[n] - 1.0).abs() < 0.03 && coarse[0][n] < even[n]);
    }
}

/// A friction of 1.5 for 10 to 50 ms in mid-cruise.
#[test]
fn a_rotor_is_locked_a_tenth_of_a_second_after_a_shock() {
    let settings = swinging(|axis| axis.control.mode = Mode::Open);
    for speed in [1.0, 10.0, 25.0] {
        for k in (0..200).step_by(8) {
            let k = f64::from(k);
            let mut bench = Bench::new(&settings);
            bench.axis.train(bench.now, true, train(&bench, speed));
            let (at, end) = (ms(500.0 + 0.7 * k), ms(510.0 + 0.9 * k));
            let before = bench.axis.stats(at).substeps;
            assert_eq!(before, bench.axis.stats(ms(400.0)).substeps);
            bench.axis.fault(at, Fault::Load(1_500));
            bench.axis.fault(end, Fault::Load(0));
            let substeps = [100, 2_000].map(|ms| bench.axis.stats(end + Span::from_millis(ms)).substeps);
            assert!(substeps[0] > before && substeps[0] == substeps[1], "{speed} {k}: {substeps:?}");
        }
    }
}

#[test]
fn the_lock_changes_nothing() {
    let mut substeps = [0; 2];
    for k in 0..200 {
        let k = f64::from(k);
        let [locked, integrated] = [true, false].map(|lock| {
            let mut bench = Bench::new(&swinging(|axis| axis.motor.lock = lock));
            bench.fault(150.0 + 0.7 * k, Fault::Load(1_500)).fault(160.0 + 0.9 * k, Fault::Load(0)).go(10.0, 10.0);
            substeps[usize::from(lock)] += bench.stats().substeps;
            bench
        });
        assert_eq!(locked.events, integrated.events);
        assert!((locked.worst_mm() - integrated.worst_mm()).abs() < 1e-5);
    }
    assert!(2 * substeps[1] < substeps[0], "{substeps:?}");
}

/// Stops, corrections and alarms in so many of 12 encoder phases, where nothing is wrong.
fn false_alarms(law: Law, rotor_hz: f64, acceleration: f64, smooth: bool, dead_band: u32) -> (usize, u64, u64, u32) {
    let (mut stops, mut corrections, mut alarms, mut phases) = (0, 0, 0, 0);
    for phase in 0..12 {
        let mut bench = Bench::new(&with(|axis| {
            axis.motor.rotor_hz = rotor_hz;
            axis.control.law = law;
            (axis.control.dead_band_pulses, axis.control.force) = (dead_band, true);
            axis.encoder.phase = f64::from(phase) / 12.0;
        }));
        (bench.smooth, bench.acceleration) = (smooth, acceleration);
        bench.go(10.0, 25.0);
        let stopped = bench.events.iter().filter(|(_, event)| *event == LoopEvent::Stop).count();
        (stops, phases) = (stops + stopped, phases + u32::from(stopped > 0));
        (corrections, alarms) = (corrections + bench.stats().corrections, alarms + bench.stats().alarms);
    }
    println!(
        "{law}, {rotor_hz} Hz, {acceleration} mm/s2, smooth {smooth}, dead band {dead_band}: {stops} stops, \
         {corrections} corrections, {alarms} alarms in {phases} phases"
    );
    (stops, corrections, alarms, phases)
}

#[test]
fn a_steep_ramp_swings_the_rotor_beyond_the_dead_band() {
    let of = |law, acceleration, smooth| false_alarms(law, 150.0, acceleration, smooth, 0);
    let none = (0, 0, 0, 0);
    for law in [Law::Pause, Law::AtOnce] {
        // 200 mm/s² are safe however the speed is gained; from pulse to pulse, 500 are, too.
        assert_eq!(
            [(200.0, false), (200.0, true), (500.0, true)].map(|(fast, smooth)| of(law, fast, smooth)),
            [none; 3]
        );
        assert_eq!(false_alarms(law, 0.0, 2_000.0, false, 0), none);
    }
    // How often the loop stops depends on where in a count the encoder is. Who waits makes few and small corrections.
    let ramps = [(300.0, false), (500.0, false), (700.0, true), (1_000.0, false)];
    let pause = ramps.map(|(acceleration, smooth)| of(Law::Pause, acceleration, smooth));
    assert_eq!(pause, [(1, 0, 0, 1), (3, 1, 0, 1), (1, 0, 0, 1), (10, 3, 0, 4)]);
    // Who corrects at once takes the swing for lost steps, and makes it worse.
    let at_once = ramps.map(|(acceleration, smooth)| of(Law::AtOnce, acceleration, smooth));
    assert_eq!(at_once, [(30, 30, 0, 1), (19, 18, 1, 1), (6, 6, 0, 1), (129, 126, 3, 4)]);
}

/// N is 34 pulses of 0.25 µm, hardly more than a count, and the default dead band is 10 µm, as it is with 2000 pulses.
#[test]
fn the_dead_band_stays_what_it_is_with_finer_microsteps() {
    let stops = [0, 34].map(|dead_band| {
        let stops_of = |phase: u32| {
            let mut bench = Bench::new(&swinging(|axis| {
                axis.drive.pulses_per_rev = 20_000;
                axis.control.dead_band_pulses = dead_band;
                axis.encoder.phase = f64::from(phase) / 12.0;
            }));
            bench.go(10.0, 25.0);
            bench.events.iter().filter(|(_, event)| *event == LoopEvent::Stop).count()
        };
        (0..12).map(stops_of).sum::<usize>()
    });
    println!("stops with the default and with 34 pulses: {stops:?}");
    assert!(stops[0] == 0 && stops[1] > 0, "{stops:?}");
}

#[test]
fn a_dead_band_below_a_count_hunts() {
    let hunts = [6, 5, 4, 3, 2].map(|dead_band| false_alarms(Law::Pause, 150.0, 200.0, true, dead_band).1);
    assert!(hunts[..3] == [0; 3] && hunts[3] > 0 && hunts[4] > hunts[3], "{hunts:?}");
}

/// What a decoder of all edges makes of the channels, while the rotor swings forwards and backwards.
#[test]
fn the_channels_show_what_is_counted() {
    for backlash in [0.0, 0.02] {
        let mut bench = Bench::new(&swinging(|axis| {
            axis.control.mode = Mode::Open;
            axis.mechanics.backlash_mm = backlash;
        }));
        bench.axis.train(bench.now, true, Train { count: 3_000, ..train(&bench, 25.0) });
        bench.axis.fault(ms(100.0), Fault::Load(1_500));
        bench.axis.fault(ms(120.0), Fault::Load(0));
        let (from, until) = (ms(120.0), ms(500.0));
        let axis = &bench.axis;
        let (mut before, mut total, mut back) = (axis.channels(from), axis.count(from), 0);
        for (at, channels) in axis.edges(until) {
            let step = match (before.a != channels.a, before.b != channels.b) {
                (true, false) if channels.a != channels.b => 1,
                (false, true) if channels.a == channels.b => 1,
                (true, true) | (false, false) => panic!("{channels:?}"),
                _ => -1,
            };
            (total, back, before) = (total + step, back + i32::from(step < 0), channels);
            assert_eq!((axis.count(at.next()), axis.channels(at.next())), (total, channels), "{at}");
        }
        assert_eq!(axis.count(until), total);
        assert!(back > 0);
    }
}

#[test]
fn the_index_is_found_however_the_rotor_swings() {
    let mut bench = Bench::new(&swinging(|axis| axis.control.mode = Mode::Open));
    bench.go(-0.5, 25.0);
    bench.axis.train(bench.now, true, Train { count: 400, ..train(&bench, 25.0) });
    bench.axis.seek_index(bench.now);
    let at = bench.axis.poll_timeout().map(|deadline| deadline.at).unwrap();
    assert_eq!((bench.axis.count(at - Span::from_nanos(10)), bench.axis.count(at)), (-1, 0));
    bench.axis.handle_timeout(at);
    assert_eq!(bench.axis.poll_event(), Some(LoopEvent::Index));
}
