//! The axis beside one that goes through every sixteenth of a pulse and makes every check.

mod common;

use common::slow::Slow;
use common::{Bench, MM};
use proptest::prelude::*;
use torno_stepper::{AxisSettings, Channel, CountScale, Fault, Law, Mode, Sensor};

fn settings() -> impl Strategy<Value = AxisSettings> {
    (
        prop_oneof![Just(Mode::Open), Just(Mode::Fixed), Just(Mode::Dynamic), Just(Mode::Dynamic)],
        prop_oneof![Just(Sensor::Belt), Just(Sensor::Belt), Just(Sensor::Motor), Just(Sensor::Scale)],
        prop_oneof![Just(CountScale::Exact), Just(CountScale::Exact), Just(CountScale::Paper)],
        prop_oneof![Just(0.0), 0.0..0.9],
        prop_oneof![Just(0.0), 0.0..0.06],
        (0.0..0.99, prop_oneof![Just(0.5), 0.5..20.0], 0_u32..9, 0_u32..9),
        prop_oneof![Just(2_000_u32), Just(1_000), Just(4_000)],
        prop_oneof![Just(0.0), 0.0..0.06],
    )
        .prop_map(|(mode, sensor, scale, friction, backlash, (phase, period, n, dead_band), per_rev, pay)| {
            let mut settings = AxisSettings::default();
            settings.motor.rotor_hz = 0.0;
            settings.control.mode = mode;
            settings.control.sensor = sensor;
            settings.control.scale = if sensor == Sensor::Belt { scale } else { CountScale::Exact };
            settings.motor.friction = friction;
            settings.mechanics.backlash_mm = (backlash * 1e4_f64).round() / 1e4;
            settings.encoder.phase = phase;
            settings.control.period_ms = period;
            settings.control.pulses = n;
            settings.control.dead_band_pulses = dead_band;
            settings.control.force = true;
            settings.drive.pulses_per_rev = per_rev;
            settings.control.backlash_mm = pay;
            settings
        })
}

fn fault() -> impl Strategy<Value = (Fault, Fault)> {
    prop_oneof![
        Just((Fault::Stall(true), Fault::Stall(false))),
        (1_u32..2_000).prop_map(|load| (Fault::Load(load), Fault::Load(0))),
        (-800_i32..=800).prop_map(|push| (Fault::Push(push), Fault::Push(0))),
        (0_u32..=1_200).prop_map(|supply| (Fault::Supply(supply), Fault::Supply(1_000))),
        (0_u32..100_000_000).prop_map(|pm| (Fault::Backlash(Some(pm)), Fault::Backlash(None))),
        (-MM..MM).prop_map(|pm| (Fault::EndStop(pm), Fault::EndStop(0))),
        (-20_i64..=20).prop_map(|counts| (Fault::Counts(counts), Fault::Counts(-counts))),
        (-3_i32..=3).prop_map(|turns| (Fault::Slip(turns), Fault::Slip(-turns))),
        (2_u32..500).prop_map(|every| (Fault::Skip(every), Fault::Skip(0))),
        (-MM / 20..MM / 20).prop_map(|pm| (Fault::Shift(pm), Fault::Shift(-pm))),
        Just((Fault::SwappedChannels(true), Fault::SwappedChannels(false))),
        Just((Fault::DeadChannel(Some(Channel::A)), Fault::DeadChannel(None))),
        Just((Fault::DeadChannel(Some(Channel::B)), Fault::DeadChannel(None))),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn comes_out_as_step_by_step(
        settings in settings(),
        moves in prop::collection::vec((-1.5..1.5, prop_oneof![0.5..5.0, 5.0..25.0]), 1..4),
        faults in prop::collection::vec((fault(), 0.0..400.0, 0.5..120.0), 0..3),
    ) {
        let mut fast = Bench::new(&settings);
        let mut slow = Bench::of(Slow::new(&settings), &settings);
        for ((begin, end), at, lasts) in faults {
            fast.fault(at, begin).fault(at + lasts, end);
            slow.fault(at, begin).fault(at + lasts, end);
        }
        for (mm, speed) in moves {
            fast.go(mm, speed);
            slow.go(mm, speed);
            slow.axis.advance(slow.now);
        }
        // A sensor on an edge may be on either side of it.
        prop_assume!(slow.axis.margin > 1e-7);
        let events = |events: &[_]| events.iter().map(|event| format!("{event:?}")).collect::<Vec<_>>();
        prop_assert_eq!(events(&fast.events), events(&slow.events));
        prop_assert_eq!(fast.now, slow.now);
        let (found, expected) = (fast.carriage_mm(), slow.axis.carriage_mm());
        prop_assert!((found - expected).abs() < 1e-6, "{} {}", found, expected);
        prop_assert_eq!(fast.axis.count(fast.now), slow.axis.total);
        prop_assert_eq!(fast.stats().corrections, slow.axis.corrections);
        // It has been looked at every sixteenth of a pulse.
        let (found, expected) = (fast.worst_mm() / settings.scale().pulse_mm(), slow.axis.worst);
        prop_assert!(found > expected - 1e-3 && found < expected + 0.07, "{} {}", found, expected);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 300, ..ProptestConfig::default() })]

    /// However often it is told that nothing happens, and asked where it is.
    #[test]
    fn however_time_is_cut_the_same_comes_out(
        mut settings in settings(),
        (rotor_hz, damping) in prop_oneof![Just((0.0, 0.1)), Just((150.0, 0.1)), (20.0..400.0, 0.01..0.5)],
        law in prop_oneof![3 => Just(Law::Pause), 1 => Just(Law::AtOnce)],
        mm in -1.5..1.5,
        speed in 0.5..25.0,
        (begin, end) in fault(),
        (at, lasts) in (0.0..400.0, 0.5..120.0),
        cuts in prop::collection::vec(0.0..600.0, 0..40),
    ) {
        (settings.motor.rotor_hz, settings.motor.damping, settings.control.law) = (rotor_hz, damping, law);
        let mut whole = Bench::new(&settings);
        whole.fault(at, begin).fault(at + lasts, end);
        let mut cut = whole.clone();
        for at in cuts {
            cut.fault(at, Fault::Counts(0));
        }
        whole.go(mm, speed);
        cut.go(mm, speed);
        prop_assert_eq!(&whole.events, &cut.events);
        let now = whole.now.max(cut.now);
        prop_assert_eq!(whole.axis.carriage(now), cut.axis.carriage(now));
        prop_assert_eq!(whole.axis.stats(now), cut.axis.stats(now));
    }
}
