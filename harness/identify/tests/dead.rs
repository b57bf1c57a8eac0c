//! A dead time between drive and motor: found with its interval, or said to be none.

#![allow(clippy::unwrap_used, reason = "in a test, a panic is an answer")]
mod bench;

use bench::{Axis, Bench, Flaws, SPINDLE, feed};
use torno_identify::{Data, Estimate, Finding, Sample, Sensor, doubt, nls, prbs};

const SEEDS: u64 = 30;

/// 30 s of a binary sequence that holds each value for 0.6 s.
fn sequence(axis: Axis, rpm: f64, [low, high]: [f64; 2], dead: f64, seed: u64) -> Data {
    let bits = prbs::bits(11 * seed, 50);
    let inputs: Vec<f64> =
        bits.into_iter().flat_map(|bit| core::iter::repeat_n(if bit { high } else { low }, 20)).collect();
    Bench::new(axis, rpm, seed).flawed(Flaws { dead, ..Flaws::default() }).counted(&inputs)
}

const fn holds(estimate: Estimate, truth: f64) -> bool {
    let Estimate { value, half: Some(half) } = estimate else { return false };
    (value - truth).abs() <= half
}

#[test]
fn intervals_hold_the_dead_time() {
    let (mut held, mut all) = ([0; 3], 0);
    for (name, axis, rpm, levels) in [("spindle", SPINDLE, 6.6, [10.0, 20.0]), ("feed", feed(), 0.72, [-240.0, 237.0])]
    {
        for dead in [0.0, 0.010, 0.050] {
            let mut here = [0; 3];
            let mut found = Vec::new();
            for seed in 0..SEEDS {
                let fitted = nls::any_dead_time(&sequence(axis, rpm, levels, dead, seed)).unwrap();
                let estimates =
                    [(fitted.gain, axis.model.gain), (fitted.tau, axis.model.tau), (fitted.dead.unwrap(), dead)];
                for (here, (estimate, truth)) in here.iter_mut().zip(estimates) {
                    *here += usize::from(holds(estimate, truth));
                }
                found.push((1e3 * fitted.dead.unwrap().value, 1e3 * fitted.dead.unwrap().half.unwrap()));
            }
            let n = SEEDS as f64;
            let mean = found.iter().map(|found| found.0).sum::<f64>() / n;
            let spread = (found.iter().map(|found| (found.0 - mean) * (found.0 - mean)).sum::<f64>() / n).sqrt();
            let half = found.iter().map(|found| found.1).sum::<f64>() / n;
            println!("{name}, dead time {dead} s: {mean:.2} ± {spread:.2} ms, 95 % ± {half:.2} ms; held {here:?}");
            assert!(here.iter().all(|held| *held >= 25), "{name}, {dead}: {here:?}");
            held.iter_mut().zip(here).for_each(|(held, here)| *held += here);
            all += SEEDS as usize;
        }
    }
    println!("held {held:?} of {all}");
    for held in held {
        assert!((90..=99).contains(&(100 * held / all)), "{held} of {all}");
    }
}

#[test]
fn a_motor_without_dead_time_has_none() {
    let (mut none, mut doubted) = (0, 0);
    for seed in 0..SEEDS {
        for data in [
            sequence(SPINDLE, 6.6, [10.0, 20.0], 0.0, seed),
            sequence(feed(), 0.72, [-240.0, 237.0], 0.0, seed),
            sequence(feed(), 0.0, [-240.0, 237.0], 0.0, seed),
        ] {
            let found = nls::with_dead_time(&data);
            none += usize::from(matches!(found, Err(Finding::NoDeadTime { .. })));
        }
        let late = sequence(feed(), 0.72, [-240.0, 237.0], 0.050, seed);
        let fitted = nls::with_dead_time(&late).unwrap();
        doubted += usize::from(!doubt::of(&late, &fitted).is_empty());
        assert!(
            doubt::of(&late, &nls::first_order(&late).unwrap())
                .iter()
                .any(|doubt| matches!(doubt, Finding::Late { .. }))
        );
    }
    assert!(none >= 3 * SEEDS as usize - 1 && doubted <= 1, "{none} without, {doubted} doubted");
}

/// Far from the time constant on both sides, and not a whole number of samples.
#[test]
fn any_dead_time_is_found() {
    for dead in [0.004, 0.0301, 0.09, 0.4, 1.7] {
        for (axis, levels) in [(SPINDLE, [10.0, 20.0]), (feed(), [-240.0, 237.0])] {
            let fitted = nls::with_dead_time(&sequence(axis, 0.0, levels, dead, 1)).unwrap();
            let (found, tau) = (fitted.dead.unwrap(), fitted.tau.value);
            assert!(
                (found.value - dead).abs() < 0.001 && (tau / axis.model.tau - 1.0).abs() < 0.002,
                "{dead}: {fitted:?}"
            );
        }
    }
}

#[test]
fn a_motor_in_motion_under_one_input_shows_no_dead_time() {
    let sample = |n: u32| {
        let time = 0.03 * f64::from(n);
        Sample { time, input: 20.0, speed: 380.0 - 200.0 * libm::exp(-time / 2.8) }
    };
    let data = Data::new(Sensor::Instant, 0.0, (1..300).map(sample).collect(), 0.0).unwrap();
    assert_eq!(nls::with_dead_time(&data), Err(Finding::NoChange));
    // A second lag is no dead time: what is left has a pattern.
    let sample = |n: u32| {
        let time = 0.03 * f64::from(n);
        let fast = 0.3 * libm::exp(-time / 0.3);
        Sample { time, input: 20.0, speed: 380.0 * (1.0 - (2.8 * libm::exp(-time / 2.8) - fast) / 2.5) }
    };
    let data = Data::new(Sensor::Instant, 0.0, (1..600).map(sample).collect(), 0.0).unwrap();
    let doubts = nls::with_dead_time(&data).map(|fitted| doubt::of(&data, &fitted));
    assert!(matches!(doubts.as_deref(), Ok([Finding::Pattern { .. }])), "{doubts:?}");
}
