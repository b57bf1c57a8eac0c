//! Data that are no good, and what is said of them.

#![allow(clippy::unwrap_used, reason = "in a test, a panic is an answer")]

mod bench;

use bench::{Bench, SPINDLE, feed};
use torno_identify::{Data, Finding, Sample, Sensor, arx, nls, step};

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
    assert!(matches!(arx::least_squares(&uneven), Err(Finding::Uneven { sample: 301, .. })));
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
