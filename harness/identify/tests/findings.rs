//! Data that are no good, and what is said of them.

#![allow(clippy::unwrap_used, reason = "in a test, a panic is an answer")]

mod bench;

use bench::{Bench, SPINDLE, feed};
use torno_identify::{Data, Finding, Sample, Sensor, arx, doubt, nls, step};

const PERIOD: f64 = 0.030;

/// What `speed` makes of time, for an input of 20.
fn data_of(samples: usize, speed: impl Fn(f64) -> f64) -> Result<Data, Finding> {
    let sample = |n: usize| {
        let time = PERIOD * (n + 1) as f64;
        Sample { time, input: 20.0, speed: speed(time) }
    };
    Data::new(Sensor::Instant, 0.0, (0..samples).map(sample).collect(), 0.0)
}

fn lag(time: f64) -> f64 {
    380.0 * -libm::expm1(-time / 2.8)
}

#[test]
fn useless_data_are_found_to_be_so() {
    assert_eq!(data_of(10, lag).unwrap_err(), Finding::TooFew { least: 20, found: 10 });
    assert_eq!(data_of(300, |_| 0.0).unwrap_err(), Finding::NoResponse { input: 20.0 });
    assert!(matches!(
        data_of(300, |t| if t > 3.0 { f64::NAN } else { t }),
        Err(Finding::NotANumber { sample: 101, .. })
    ));
    let mut samples: Vec<Sample> = data_of(300, lag).unwrap().samples().to_vec();
    samples[7].time = samples[6].time;
    let finding = Data::new(Sensor::Instant, 0.0, samples.clone(), 0.0).unwrap_err();
    assert!(matches!(finding, Finding::NotInOrder { sample: 8, .. }), "{finding}");
    samples.iter_mut().zip(1..).for_each(|(sample, n)| (sample.time, sample.input) = (f64::from(n), 0.0));
    assert_eq!(Data::new(Sensor::Instant, 0.0, samples, 0.0), Err(Finding::NoInput));
}

#[test]
fn a_response_that_runs_into_a_limit_is_no_lag() {
    let finding = data_of(300, |t| lag(t).min(250.0)).unwrap_err();
    let Finding::Saturated { limit, at, .. } = finding else { panic!("{finding}") };
    assert!(limit == 250.0 && (at - 3.0).abs() < 0.1, "{finding}");
    // Even where little is left of the rise; and with 5 digits only, what settles does not saturate.
    for share in [0.8, 0.95, 0.98] {
        assert!(matches!(data_of(700, |t| lag(t).min(share * 380.0)), Err(Finding::Saturated { .. })), "{share}");
    }
    data_of(2_000, |t| (100.0 * lag(t)).round() / 100.0).unwrap();
    // One that settles is none, noise or not.
    data_of(2_000, lag).unwrap();
    for (volts, seed) in [(20.0, 1), (5.0, 2), (30.0, 3)] {
        Bench::new(SPINDLE, 6.6, seed).counted(&vec![volts; 667]);
    }
}

#[test]
fn a_motor_that_stops_dead_is_told_from_one_that_turns_back() {
    let at = data_of(300, |t| if t < 6.0 { lag(t) } else { 0.0 }).unwrap_err();
    let Finding::StopsDead { at } = at else { panic!("{at}") };
    assert!((at - 6.0).abs() < 0.05);
    // Friction stops what is driven less and less.
    let (mut v, mut samples) = (0.0f64, Vec::new());
    for n in 0..300 {
        let input = 20.0 * libm::exp(-0.02 * f64::from(n));
        v = (v + PERIOD / 0.5 * (10.0 * (input - 2.0) - v)).max(0.0);
        samples.push(Sample { time: PERIOD * f64::from(n + 1), input, speed: v });
    }
    assert_eq!(samples[299].speed, 0.0);
    Data::new(Sensor::Instant, 0.0, samples, 0.0).unwrap();
    let back = [vec![100.0; 100], vec![-100.0; 100], vec![100.0; 100]].concat();
    Bench::new(feed(), 0.0, 1).counted(&back);
}

#[test]
fn what_data_cannot_tell_is_not_told() {
    // Half a time constant.
    let finding = nls::first_order(&data_of(40, lag).unwrap()).unwrap_err();
    assert!(matches!(finding, Finding::TooEarly { .. }), "{finding}");
    // A lag of 50 ms behind an encoder that counts three slots in two seconds.
    let slots = |n: u32| (0.015 * f64::from(n) + 0.5).floor();
    let sample = |n: u32| Sample { time: 0.01 * f64::from(n), input: 1.0, speed: 100.0 * (slots(n) - slots(n - 1)) };
    let data = Data::new(Sensor::Mean, 0.0, (1..=200).map(sample).collect(), 100.0).unwrap();
    let finding = nls::first_order(&data).unwrap_err();
    assert!(matches!(finding, Finding::Coarse { .. }), "{finding}");
    // No lag at all.
    let finding = nls::first_order(&data_of(400, |t| 100.0 * libm::sin(9.0 * t)).unwrap()).unwrap_err();
    assert!(matches!(finding, Finding::NotThisModel { .. }), "{finding}");
}

#[test]
fn a_method_says_what_it_needs() {
    let mut bench = Bench::new(SPINDLE, 0.0, 1);
    let data = bench.counted(&[vec![20.0; 200], vec![10.0; 200]].concat());
    assert_eq!(step::one_point(&data), Err(Finding::NoStep));
    let mut samples = data.samples().to_vec();
    samples[300..].iter_mut().for_each(|sample| sample.time += 0.1);
    let uneven = Data::new(Sensor::Mean, 0.0, samples, data.quantum()).unwrap();
    let finding = arx::least_squares(&uneven).unwrap_err();
    assert_eq!(finding, Finding::Uneven { sample: 301, expected: 0.03, found: 0.13 });
    assert_eq!(uneven.period(), data.period());
}

#[test]
fn a_motor_that_turns_already_is_fitted_from_where_it_is() {
    let inputs = [vec![10.0; 300], vec![20.0; 300]].concat();
    let data = Bench::new(SPINDLE, 0.0, 1).counted(&inputs);
    let start = data.samples()[199].time;
    let data = Data::new(Sensor::Mean, start, data.samples()[200..].to_vec(), data.quantum()).unwrap();
    let fitted = nls::first_order(&data).unwrap();
    assert!((fitted.gain.value / 19.0 - 1.0).abs() < 1e-3 && (fitted.tau.value / 2.8 - 1.0).abs() < 5e-3, "{fitted:?}");
}

#[test]
fn a_motor_that_is_no_lag_is_doubted() {
    let doubts = |speed: &dyn Fn(f64) -> f64| {
        let data = data_of(400, speed).unwrap();
        doubt::of(&data, &nls::first_order(&data).unwrap())
    };
    assert_eq!(doubts(&lag), []);
    let late = doubts(&|t| lag((t - 0.060).max(0.0)));
    let [Finding::Late { late }] = late[..] else { panic!("{late:?}") };
    assert!((late - 0.060).abs() < 0.005, "{late}");
    // 37 % of overshoot.
    let oscillates = |t: f64| {
        let (sin, cos) = libm::sincos(7.63 * t);
        50.0 * (1.0 - libm::exp(-2.4 * t) * (cos + 0.314 * sin))
    };
    assert!(matches!(doubts(&oscillates)[..], [Finding::Pattern { .. }]));
    let noise = |n: u32| (libm::sin(12.9898 * f64::from(n)) * 43_758.545).rem_euclid(1.0) - 0.5;
    let all: Vec<f64> = (1..=400).map(|n| lag(PERIOD * f64::from(n)) + 2.0 * noise(n)).collect();
    let at = |t: f64| all[(t / PERIOD).round() as usize - 1];
    assert_eq!(doubts(&at), []);
    assert!(matches!(data_of(400, |t| at(t).min(330.0)), Err(Finding::Saturated { .. })));
}

#[test]
fn friction_is_told_from_a_smaller_gain_once_the_input_changes() {
    // By small steps: 60 V levels of a motor with friction worth 4.
    let inputs: Vec<f64> =
        torno_identify::prbs::bits(3, 60).into_iter().map(|bit| if bit { 20.0 } else { 8.0 }).collect();
    let mut v = 0.0;
    let samples = (0..1_200).map(|n| {
        let input = inputs[n / 20];
        for _ in 0..100 {
            v += PERIOD / 100.0 / 0.8 * (10.0 * (input - 4.0) - v);
        }
        Sample { time: PERIOD * (n + 1) as f64, input, speed: v }
    });
    let data = Data::new(Sensor::Instant, 0.0, samples.collect(), 0.0).unwrap();
    assert_eq!(doubt::of(&data, &nls::first_order(&data).unwrap()), [Finding::Friction]);
    let fitted = nls::with_friction(&data).unwrap();
    let friction = fitted.friction.unwrap().value;
    assert!((fitted.gain.value - 10.0).abs() < 0.01 && (friction - 4.0).abs() < 0.01, "{fitted:?}");
    assert_eq!(doubt::of(&data, &fitted), []);
    let mut bench = Bench::new(SPINDLE, 0.0, 1);
    let inputs = [vec![20.0; 200], vec![10.0; 200]].concat();
    assert_eq!(nls::with_friction(&bench.counted(&inputs)), Err(Finding::NoFriction));
}
