//! The same programs, and the positions that were recorded from GRBL 1.1h (20190830) on an emulated ATmega328P, every
//! 10 ms from the first byte sent.

#![allow(clippy::unwrap_used, reason = "in a test, a panic is an answer")]

mod common;

/// Between two looks at the place, ms.
const SAMPLE: f64 = 10.0;

fn recorded(csv: &str) -> Vec<[i32; 3]> {
    let row = |line: &str| {
        let numbers: Vec<i32> = line.split(',').map(|number| number.parse().unwrap()).collect();
        [numbers[1], numbers[2], numbers[3]]
    };
    csv.lines().skip(1).map(row).collect()
}

/// A place between two looks, mm.
fn place(places: &[[i32; 3]], ms: f64) -> [f64; 3] {
    let n = (ms / SAMPLE).floor();
    let at = |n: f64| places[(n.max(0.0) as usize).min(places.len() - 1)];
    let share = ms / SAMPLE - n;
    core::array::from_fn(|axis| {
        let [before, after] = [n, n + 1.0].map(|n| f64::from(at(n)[axis]) / 250.0);
        before + (after - before) * share
    })
}

/// When the last step was seen, ms.
fn end(places: &[[i32; 3]]) -> f64 {
    let last = places.last().unwrap();
    SAMPLE * places.iter().rposition(|place| place != last).unwrap() as f64 + SAMPLE
}

/// How far the places are from one another at the most, mm, if one is late by `shift` ms.
fn distance(ours: &[[i32; 3]], theirs: &[[i32; 3]], shift: f64) -> f64 {
    let apart = |n: usize| {
        let theirs = theirs[n].map(|steps| f64::from(steps) / 250.0);
        let ours = place(ours, n as f64 * SAMPLE + shift);
        let apart = |axis: usize| ours[axis] - theirs[axis];
        (0..3).map(|axis| apart(axis) * apart(axis)).sum::<f64>().sqrt()
    };
    (0..theirs.len()).map(apart).fold(0.0, f64::max)
}

fn compare(name: &str, program: &str, csv: &str) {
    let theirs = recorded(csv);
    let seen = common::stream(program);
    let ours = seen.places;
    let (time, theirs_time) = (end(&ours), end(&theirs));
    let shifts = (-80..=80).map(|quarter| f64::from(quarter) / 4.0);
    let best = shifts.map(|shift| (distance(&ours, &theirs, shift), shift));
    let (worst, shift) = best.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
    println!(
        "{name}: {time} ms, the firmware {theirs_time} ms; {worst:.4} mm apart at the most, {shift} ms shifted; \
         {} segments",
        seen.segments
    );
    assert!((time / theirs_time - 1.0).abs() < 0.005, "{time} and {theirs_time} ms");
    assert!(worst < 0.025, "{worst} mm apart");
    assert_eq!(ours.last(), theirs.last());
}

#[test]
fn a_square_goes_as_the_firmware_does_it() {
    compare("square", include_str!("firmware/square.nc"), include_str!("firmware/square-steps.csv"));
}

#[test]
fn circles_go_as_the_firmware_does_them() {
    compare("circle", include_str!("firmware/circle.nc"), include_str!("firmware/circle-steps.csv"));
}
