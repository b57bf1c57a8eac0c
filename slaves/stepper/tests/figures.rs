//! The figures that an axis must come to: rigid rotor, friction 0.05, 200 mm/s², 10 mm, law `pause`, unless said.

mod common;

use common::{Bench, MM, ms, with};
use torno_protocol::time::{Instant, Span};
use torno_protocol::train::Train;
use torno_stepper::{Axis, AxisSettings, Cause, Channel, CountScale, Fault, Law, LoopEvent, Mode, Sensor};

const SPEEDS: [f64; 8] = [0.1, 0.3, 1.0, 3.0, 5.0, 10.0, 17.0, 25.0];
const MODES: [Mode; 2] = [Mode::Open, Mode::Dynamic];

fn in_phase(twelfth: u32, change: impl FnOnce(&mut AxisSettings)) -> AxisSettings {
    with(|axis| {
        axis.encoder.phase = f64::from(twelfth) / 12.0;
        change(axis);
    })
}

fn in_mode(mode: Mode, change: impl FnOnce(&mut AxisSettings)) -> AxisSettings {
    with(|axis| {
        axis.control.mode = mode;
        change(axis);
    })
}

/// A move of 10 mm with a friction of 1.5 from `at` on for `lasts` ms.
fn shocked(settings: &AxisSettings, speed: f64, at: f64, lasts: f64) -> Bench {
    let mut bench = Bench::new(settings);
    bench.fault(at, Fault::Load(1_500)).fault(at + lasts, Fault::Load(0)).go(10.0, speed);
    bench
}

#[test]
fn without_a_fault_nothing_is_corrected() {
    for mode in [Mode::Dynamic, Mode::Fixed] {
        for phase in 0..12 {
            for speed in SPEEDS {
                let mut bench = Bench::new(&in_phase(phase, |axis| axis.control.mode = mode));
                bench.go(10.0, speed);
                let end = bench.carriage_mm() - 10.0;
                assert!(bench.events.is_empty() && end.abs() <= 0.0015, "{mode} {phase} {speed}: {end}");
                bench.go(-10.0, speed);
                assert!(bench.events.is_empty() && bench.carriage_mm().abs() <= 0.0015, "{mode} {phase} {speed}");
                if mode == Mode::Dynamic {
                    assert_eq!(bench.stats().checks, 2_002, "one every four pulses, and one at each end");
                }
            }
        }
    }
}

#[test]
fn in_the_open_loop_an_overload_costs_whole_electrical_turns() {
    let open = in_mode(Mode::Open, |_| {});
    for (speed, lasts, lost) in
        [(10.0, 34.0, 0.3), (10.0, 50.0, 0.5), (10.0, 62.0, 0.6), (25.0, 60.0, 1.5), (5.0, 79.0, 0.4)]
    {
        let found = shocked(&open, speed, 250.0, lasts).deviation_mm();
        assert!((found - lost).abs() <= 0.002, "{speed} {lasts}: {found}");
    }
}

#[test]
fn an_axis_that_is_blocked_for_good_is_stopped_in_a_fifth_of_a_second() {
    for speed in [1.0, 5.0, 10.0, 25.0] {
        let blocked = |settings: &AxisSettings, at: f64| {
            let mut bench = Bench::new(settings);
            bench.fault(at, Fault::Stall(true)).go(10.0, speed);
            bench
        };
        let (at, alarm) = blocked(&with(|_| {}), 250.0).alarm().unwrap();
        let after = at.as_secs_f64() - 0.25;
        assert!((0.17..=0.20).contains(&after), "{speed}: {after}");
        assert!(alarm.cause == Cause::Stalled && (1..=18_500_000).contains(&alarm.error_pm), "{speed}: {alarm:?}");
        let open = blocked(&in_mode(Mode::Open, |_| {}), 250.0);
        assert!(open.events.is_empty() && open.deviation_mm() > 5.0);
        // A correction takes as many milliseconds as it has pulses, four to eight, so the phase matters.
        for phase in 0..12 {
            for at in [250.0, 251.0, 253.3, 257.7] {
                let (time, alarm) = blocked(&in_phase(phase, |_| {}), at).alarm().unwrap();
                let after = time.as_secs_f64() - at / 1_000.0;
                assert!((0.164..=0.212).contains(&after), "{speed} {phase}: {after}");
                assert!((10_000_000..20_000_000).contains(&alarm.error_pm), "{speed} {phase}: {alarm:?}");
            }
        }
    }
}

#[test]
fn every_400th_pulse_lost_is_made_up_for_in_two_corrections() {
    for mode in MODES {
        for speed in [1.0, 3.0, 5.0, 10.0, 17.0, 25.0] {
            let mut bench = Bench::new(&in_mode(mode, |_| {}));
            bench.fault(0.0, Fault::Skip(400)).go(10.0, speed);
            let (end, stats) = (bench.deviation_mm(), bench.stats());
            match mode {
                Mode::Open => assert!((end - 0.025).abs() <= 0.0015, "{speed}: {end}"),
                _ => assert!(end.abs() <= 0.006 && stats.corrections == 2, "{speed}: {end} {stats:?}"),
            }
        }
    }
}

#[test]
fn backlash_costs_twenty_pulses_there_and_back() {
    for mode in MODES {
        for speed in [1.0, 5.0, 10.0, 25.0] {
            let mut bench = Bench::new(&in_mode(mode, |axis| axis.mechanics.backlash_mm = 0.05));
            bench.go(10.0, speed).go(-10.0, speed);
            let (end, stats) = (bench.deviation_mm(), bench.stats());
            match mode {
                Mode::Open => assert!((end + 0.05).abs() <= 0.0015, "{speed}: {end}"),
                _ => assert!(end.abs() <= 0.002 && stats.corrected_pulses == 20, "{speed}: {end} {stats:?}"),
            }
        }
    }
}

#[test]
fn steady_friction_is_corrected_once() {
    for mode in MODES {
        let mut bench = Bench::new(&in_mode(mode, |axis| axis.motor.friction = 0.8));
        bench.go(10.0, 10.0);
        let (end, stats) = (bench.deviation_mm(), bench.stats());
        match mode {
            Mode::Open => assert!((end - 0.0148).abs() <= 0.0001, "{end}"),
            _ => {
                assert_eq!((stats.corrections, stats.corrected_pulses), (1, 4));
                assert!(stats.worst_pm <= 10_000_000, "{stats:?}");
            }
        }
    }
}

#[test]
fn with_the_papers_scale_100_mm_end_at_101_2456() {
    let mut bench = Bench::new(&with(|axis| axis.control.scale = CountScale::Paper));
    bench.go(100.0, 10.0);
    let stats = bench.stats();
    assert_eq!((stats.corrections, stats.corrected_pulses), (124, 496));
    assert!((bench.carriage_mm() - 101.2456).abs() <= 0.01, "{}", bench.carriage_mm());
}

#[test]
fn a_dead_band_below_a_count_hunts() {
    let hunts = [4, 5, 6, 3, 2, 1].map(|dead_band| {
        let run = |phase| {
            let mut bench = Bench::new(&in_phase(phase, |axis| {
                axis.control.dead_band_pulses = dead_band;
                axis.control.force = true;
            }));
            bench.go(10.0, 10.0);
            bench.stats()
        };
        let all: Vec<_> = (0..12).map(run).collect();
        (all.iter().map(|stats| stats.corrections).sum::<u64>(), all.iter().map(|stats| stats.alarms).sum::<u64>())
    });
    assert_eq!(hunts[..5], [(0, 0), (0, 0), (0, 0), (64, 0), (868, 0)]);
    assert_eq!(hunts[5].1, 12);
}

#[test]
fn the_counter_underflows_harmlessly() {
    for (bits, below) in [(16, 65_535), (32, u32::MAX)] {
        let mut bench = Bench::new(&with(|axis| axis.encoder.counter_bits = bits));
        bench.go(-24.74, 25.0);
        let near = bench.axis.register(bench.now);
        bench.go(-0.02, 25.0);
        assert_eq!((near, bench.axis.register(bench.now)), (1, below));
        bench.go(-40.0, 25.0).go(124.76, 25.0);
        assert!(bench.events.is_empty() && (bench.carriage_mm() - 60.0).abs() <= 0.0015);
        assert_eq!(bench.axis.count(bench.now), 7_273);
    }
}

/// The commonest wiring errors.
#[test]
fn a_wrongly_wired_encoder_is_found_within_a_millimetre() {
    let faults =
        [Fault::SwappedChannels(true), Fault::DeadChannel(Some(Channel::A)), Fault::DeadChannel(Some(Channel::B))];
    for fault in faults {
        for (speed, mm) in [(1.0, 10.0), (1.0, -10.0), (25.0, 10.0), (25.0, -10.0)] {
            for phase in 0..12 {
                for mode in [Mode::Dynamic, Mode::Fixed] {
                    for law in [Law::Pause, Law::AtOnce] {
                        let mut bench = Bench::new(&in_phase(phase, |axis| {
                            axis.control.mode = mode;
                            axis.control.law = law;
                        }));
                        bench.fault(0.0, fault).go(mm, speed);
                        let (end, what) = (bench.carriage_mm(), format!("{fault:?} {speed} {mm} {phase} {mode} {law}"));
                        assert!(bench.alarm().is_some() && end.abs() < 1.0, "{what}: {end}");
                    }
                }
            }
        }
    }
}

/// There and back with a backlash of 0.05 mm, by what measures it, and with and without paying for it in advance.
#[test]
fn a_motors_encoder_misses_backlash() {
    let ends = [Sensor::Belt, Sensor::Motor, Sensor::Scale].map(|sensor| {
        [0.0, 0.05].map(|paid| {
            let mut bench = Bench::new(&with(|axis| {
                axis.control.sensor = sensor;
                axis.mechanics.backlash_mm = 0.05;
                axis.control.backlash_mm = paid;
                axis.control.pulses = 4;
            }));
            bench.go(10.0, 10.0).go(-10.0, 10.0);
            let stats = bench.stats();
            println!("{sensor}, {paid} mm paid: {:.4} mm, {stats:?}", bench.deviation_mm());
            (bench.deviation_mm(), stats.corrected_pulses, stats.backlash_pulses)
        })
    });
    for (n, [corrected, paid]) in ends.into_iter().enumerate() {
        let (missed, pulses) = if Sensor::NAMES[n] == "motor" { (-0.05, 0) } else { (0.0, 20) };
        assert!(
            (corrected.0 - missed).abs() <= 0.002 && (corrected.1, corrected.2) == (pulses, 0),
            "{n} {corrected:?}"
        );
        assert!(paid.0.abs() <= 0.002 && (paid.1, paid.2) == (0, 20), "{n} {paid:?}");
    }
}

#[test]
fn what_is_out_of_place_for_good_is_corrected_if_it_is_measured() {
    for (fault, off) in [(Fault::Slip(-3), 0.3), (Fault::Slip(2), -0.2), (Fault::Shift(-MM / 5), 0.2)] {
        for (mode, sensor) in
            [(Mode::Open, Sensor::Belt), (Mode::Dynamic, Sensor::Belt), (Mode::Dynamic, Sensor::Motor)]
        {
            let mut bench = Bench::new(&in_mode(mode, |axis| {
                axis.control.sensor = sensor;
                axis.control.pulses = 4;
            }));
            bench.fault(300.0, fault).go(10.0, 10.0);
            let unseen = mode == Mode::Open || (sensor == Sensor::Motor && matches!(fault, Fault::Shift(_)));
            let (end, expected) = (bench.deviation_mm(), if unseen { off } else { 0.0 });
            assert!((end - expected).abs() <= 0.01, "{fault:?} {mode} {sensor}: {end}");
        }
    }
}

#[test]
fn pulses_that_the_drive_does_not_take_are_found() {
    // At 10 mm/s they come at 4 kHz.
    let run = |mode, max_hz| {
        let mut bench = Bench::new(&in_mode(mode, |axis| axis.drive.max_hz = max_hz));
        bench.go(10.0, 10.0);
        (bench.deviation_mm(), bench.stats().corrections)
    };
    let (lost, _) = run(Mode::Open, 3_999.0);
    assert!(lost > 9.0, "{lost}");
    let (off, corrections) = run(Mode::Dynamic, 3_999.0);
    assert!(off.abs() <= 0.01 && corrections > 30, "{off} {corrections}");
    let (off, corrections) = run(Mode::Dynamic, 4_000.0);
    assert!(off.abs() <= 0.0015 && corrections == 0, "{off} {corrections}");
}

#[test]
fn too_fast_a_jump_of_the_speed_loses_the_rotor() {
    // Friction lets go at 25 mm/s: too fast for a rotor that takes half the torque.
    for (friction, kept) in [(0.05, true), (0.5, false)] {
        let mut bench = Bench::new(&in_mode(Mode::Open, |axis| axis.motor.friction = friction));
        bench.fault(250.0, Fault::Stall(true)).fault(260.0, Fault::Stall(false)).go(10.0, 25.0);
        let off = bench.deviation_mm();
        assert!((off < 0.32) == kept, "{friction}: {off}");
        // It takes hold again in the ramp down.
        assert!(kept || (0.5..8.0).contains(&off), "{friction}: {off}");
    }
}

#[test]
fn a_reference_ends_an_alarm() {
    let mut bench = Bench::new(&with(|_| {}));
    bench.fault(300.0, Fault::Stall(true)).fault(600.0, Fault::Stall(false)).go(10.0, 10.0);
    assert!(bench.alarm().is_some());
    bench.axis.reference(bench.now);
    assert_eq!((bench.axis.error(bench.now), bench.axis.deviation(bench.now)), (0, 0));
    bench.events.clear();
    bench.go(0.0, 10.0);
    assert!(bench.events.is_empty() && bench.deviation_mm().abs() <= 0.0015);
}

#[test]
fn the_papers_wording_corrects_without_stopping_for_long() {
    for speed in [1.0, 10.0, 25.0] {
        let mut bench = Bench::new(&with(|axis| axis.control.law = Law::AtOnce));
        bench.fault(0.0, Fault::Skip(400)).go(10.0, speed);
        assert!(bench.deviation_mm().abs() <= 0.006 && bench.stats().corrections == 2, "{speed}: {:?}", bench.stats());
        let pauses = bench.events.windows(3).filter(|events| matches!(events[0].1, LoopEvent::Stop));
        for pause in pauses {
            let [(stop, _), (_, LoopEvent::Correct { .. }), (resume, LoopEvent::Resume { ramp: false })] = pause else {
                panic!("{pause:?}");
            };
            // Four pulses at the rate of the program.
            assert_eq!(resume.since(*stop).as_nanos(), (4.0 * 2.5e6 / speed) as u64);
        }
    }
}

/// A mark every 66 mm; there is one where the carriage begins.
#[test]
fn the_index_finds_lost_counts() {
    let mut bench = Bench::new(&with(|_| {}));
    bench.go(-5.0, 25.0);
    let (mut axis, first) = (bench.axis.clone(), bench.now);
    axis.train(first, true, train(first, 4_000));
    axis.seek_index(first);
    let at = axis.poll_timeout().unwrap().at;
    assert_eq!((axis.count(at - Span::from_nanos(10)), axis.count(at)), (-1, 0));
    bench.axis.seek_index(bench.now);
    bench.go(10.0, 25.0);
    assert!(matches!(bench.events[..], [(_, LoopEvent::Index)]), "{:?}", bench.events);
    // The loop takes two lost counts for lost pulses, and takes the carriage too far; at the next mark it is put right.
    bench.events.clear();
    bench.fault(100.0, Fault::Counts(-2)).go(50.0, 25.0);
    assert!(bench.deviation_mm() < -0.015, "{}", bench.deviation_mm());
    bench.events.clear();
    bench.go(20.0, 25.0);
    assert!(matches!(bench.events[0], (_, LoopEvent::Miscounted(2))), "{:?}", bench.events);
    assert!(bench.deviation_mm().abs() <= 0.01, "{}", bench.deviation_mm());
}

/// A tooth of the belt is 363.64 counts, 3 mm.
#[test]
fn a_belt_that_jumps_a_tooth_is_an_alarm() {
    let mut bench = Bench::new(&with(|_| {}));
    bench.fault(300.0, Fault::Counts(-364)).go(10.0, 10.0);
    let (_, alarm) = bench.alarm().unwrap();
    assert!(alarm.cause == Cause::TooFar && (alarm.error_pm - 3 * MM).abs() < 10_000_000, "{alarm:?}");
}

#[test]
fn an_end_stop_is_an_alarm_and_an_open_loop_rattles_at_it() {
    for mode in MODES {
        for side in [1, -1] {
            let mut bench = Bench::new(&in_mode(mode, |_| {}));
            bench.fault(0.0, Fault::EndStop(side * 5 * MM)).go(side as f64 * 10.0, 10.0);
            let end = side as f64 * bench.carriage_mm();
            // Where the field has run half a turn ahead, it throws the rotor back.
            assert!((4.9..=5.0).contains(&end), "{mode} {side}: {end}");
            assert_eq!(bench.alarm().is_some(), mode == Mode::Dynamic);
        }
    }
}

#[test]
fn a_push_beyond_the_torque_carries_the_axis_to_its_end() {
    let mut bench = Bench::new(&with(|_| {}));
    bench.fault(300.0, Fault::Push(1_200)).go(10.0, 10.0);
    assert!(bench.alarm().is_some_and(|(_, alarm)| alarm.cause == Cause::TooFar));
    assert!((bench.carriage_mm() + 150.0).abs() < 1e-6, "{}", bench.carriage_mm());
    // A weaker one only takes up the backlash.
    let mut bench = Bench::new(&in_mode(Mode::Open, |axis| axis.mechanics.backlash_mm = 0.05));
    bench.fault(0.0, Fault::Push(300)).go(10.0, 10.0).go(-10.0, 10.0);
    assert!(bench.deviation_mm().abs() < 0.006, "{}", bench.deviation_mm());
}

/// What a decoder of all edges makes of the channels.
#[test]
fn the_channels_show_what_is_counted() {
    let mut bench = Bench::new(&with(|axis| axis.mechanics.backlash_mm = 0.02));
    bench.go(65.0, 25.0);
    for (forward, fault) in [(true, None), (false, None), (true, Some(Fault::SwappedChannels(true)))] {
        if let Some(fault) = fault {
            bench.axis.fault(bench.now, fault);
        }
        let first = bench.now;
        bench.axis.train(first, forward, train(first, 4_000));
        bench.now = train(first, 4_000).end();
        let axis = &bench.axis;
        let (mut before, mut total, mut marks) = (axis.channels(first), axis.count(first), 0);
        for (at, channels) in axis.edges(bench.now) {
            total += match (before.a != channels.a, before.b != channels.b) {
                (true, false) if channels.a != channels.b => 1,
                (false, true) if channels.a == channels.b => 1,
                (true, true) | (false, false) => panic!("{channels:?}"),
                _ => -1,
            };
            marks += i32::from(channels.z && !before.z);
            before = channels;
            assert_eq!((axis.count(at.next()), axis.channels(at.next())), (total, channels), "{at}");
        }
        assert_eq!((axis.count(bench.now), marks), (total, 1));
    }
}

/// 4 kHz: 10 mm/s.
fn train(first: Instant, count: u64) -> Train {
    Train { first, nanos: 1_000_000, per: 4, count, high: Span::from_micros(5) }
}

#[test]
fn a_check_sees_what_happens_at_its_instant() {
    let mut axis = Axis::new(&with(|_| {}));
    axis.train(Instant::START, true, train(Instant::START, 400));
    let (before, at) = (ms(9.0), ms(10.0));
    axis.fault(before, Fault::Counts(0));
    assert_eq!(axis.poll_timeout(), None);
    axis.fault(at, Fault::Counts(-9));
    assert_eq!(axis.poll_timeout().map(|deadline| deadline.at), Some(at));
    axis.handle_timeout(at);
    assert_eq!((axis.poll_event(), axis.issued(at)), (Some(LoopEvent::Stop), 40));
}

#[test]
fn a_pulse_is_over_when_the_next_one_comes() {
    let mut axis = Axis::new(&in_mode(Mode::Open, |axis| axis.motor.friction = 0.0));
    axis.train(Instant::START, true, train(Instant::START, 4));
    axis.train(ms(0.9), true, train(ms(0.9), 4));
    let pulses = [0.9, 1.15, 1.9, 5.0].map(|at| axis.carriage(ms(at)) / 2_500_000);
    assert_eq!(pulses, [4, 5, 8, 8]);
    assert_eq!(axis.issued(ms(0.9)), 4);
    // A cut completes the pulse that has begun.
    axis.cut(ms(1.2));
    assert_eq!((axis.issued(ms(1.2)), axis.carriage(ms(9.0)) / 2_500_000), (6, 6));
}

#[test]
fn corrections_at_once_with_quiet_checks_between_are_no_alarm() {
    let mut bench = Bench::new(&with(|axis| {
        axis.control.law = Law::AtOnce;
        axis.control.scale = CountScale::Paper;
    }));
    bench.go(100.0, 10.0);
    assert_eq!((bench.stats().corrections, bench.stats().alarms), (124, 0));
    assert!((bench.carriage_mm() - 101.2456).abs() <= 0.01, "{}", bench.carriage_mm());
}

#[test]
fn a_jump_of_half_the_counters_range_is_taken_for_another_one() {
    for (bits, seen) in [(16, false), (32, true)] {
        let mut axis = Axis::new(&in_mode(Mode::Open, |axis| axis.encoder.counter_bits = bits));
        axis.fault(ms(1.0), Fault::Counts(-65_536));
        assert_eq!(axis.count(ms(1.0)) == -65_536, seen, "{bits}");
    }
}
