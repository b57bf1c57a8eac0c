//! What a response that a board has told says about the system behind it.

#![allow(clippy::disallowed_methods, reason = "what is compared with a tolerance may differ in its last digits")]

use torno_protocol::board::Board;
use torno_protocol::time::{Instant, Span};

use super::Bench;

/// A quantity's value after each of `count` ticks of `period_ms`, from the tick at `from` on.
pub(crate) fn sampled<B: Board>(bench: &Bench<B>, name: &str, from: Instant, period_ms: u64, count: u64) -> Vec<f64> {
    let history = bench.history(name);
    let mut next = 0;
    let value = |n: u64| {
        let at = from + Span::from_millis(period_ms * n) + Span::from_micros(1);
        while next < history.len() && history[next].0 <= at {
            next += 1;
        }
        history[next - 1].1 as f64
    };
    (0..count).map(value).collect()
}

/// When a quantity first becomes something else than it was at `after`.
pub(crate) fn changed<B: Board>(bench: &Bench<B>, name: &str, after: Instant) -> Instant {
    bench.history(name).iter().find(|(at, _)| *at > after).unwrap().0
}

/// Where a response first crosses `level`, in samples, between two of them by a straight line.
pub(crate) fn crossing(response: &[f64], level: f64) -> f64 {
    let side = |value: f64| value >= level;
    let after = (1..response.len()).find(|k| side(response[*k]) != side(response[0])).unwrap();
    let (a, b) = (response[after - 1], response[after]);
    (after - 1) as f64 + (level - a) / (b - a)
}

/// After which sample a response stays within `band` of `end`, between two of them by a straight line.
pub(crate) fn settled(response: &[f64], end: f64, band: f64) -> f64 {
    let last = response.iter().rposition(|value| (value - end).abs() > band).unwrap();
    let (a, b) = ((response[last] - end).abs(), (response[last + 1] - end).abs());
    last as f64 + (a - band) / (a - b)
}

/// When the highest point of a response is, in samples, and how high, by a parabola.
pub(crate) fn peak(response: &[f64]) -> (f64, f64) {
    let highest = response.iter().copied().fold(f64::MIN, f64::max);
    let first = response.iter().position(|value| *value == highest).unwrap();
    let last = response.iter().rposition(|value| *value == highest).unwrap();
    let middle = (first + last) / 2;
    // Far enough apart for the quantum not to matter.
    let far = (middle / 50).max(1);
    let [a, b, c] = [middle - far, middle, middle + far].map(|k| response[k]);
    let shift = 0.5 * (a - c) / (a - 2.0 * b + c);
    (middle as f64 + shift * far as f64, b - 0.25 * (a - c) * shift)
}

/// Solves a small system of equations (Gauss, with the largest pivot).
pub(crate) fn solve(mut matrix: Vec<Vec<f64>>, mut right: Vec<f64>) -> Vec<f64> {
    let n = right.len();
    for column in 0..n {
        let pivot = (column..n).max_by(|a, b| matrix[*a][column].abs().total_cmp(&matrix[*b][column].abs())).unwrap();
        matrix.swap(column, pivot);
        right.swap(column, pivot);
        let (top, of_top) = (matrix[column].clone(), right[column]);
        for row in (0..n).filter(|row| *row != column) {
            let factor = matrix[row][column] / top[column];
            matrix[row].iter_mut().zip(&top).for_each(|(value, top)| *value -= factor * top);
            right[row] -= factor * of_top;
        }
    }
    (0..n).map(|k| right[k] / matrix[k][k]).collect()
}

/// The least-squares solution of `rows · x = values`.
pub(crate) fn least_squares(rows: &[Vec<f64>], values: &[f64]) -> Vec<f64> {
    let n = rows[0].len();
    let sum = |f: &dyn Fn(usize) -> f64| (0..rows.len()).map(f).sum::<f64>();
    let matrix = (0..n).map(|i| (0..n).map(|j| sum(&|k| rows[k][i] * rows[k][j])).collect()).collect();
    let right = (0..n).map(|i| sum(&|k| rows[k][i] * values[k])).collect();
    solve(matrix, right)
}

/// The coefficients a of y(k) = a1·y(k−1) + a2·y(k−2) + … that fit a response best.
pub(crate) fn recurrence(response: &[f64], order: usize) -> Vec<f64> {
    let rows: Vec<Vec<f64>> =
        (order..response.len()).map(|k| (1..=order).map(|back| response[k - back]).collect()).collect();
    least_squares(&rows, &response[order..])
}

/// The poles of that recurrence (Durand and Kerner's method), the largest first.
pub(crate) fn poles(coefficients: &[f64]) -> Vec<(f64, f64)> {
    let times = |(a, b): (f64, f64), (c, d): (f64, f64)| (a * c - b * d, a * d + b * c);
    let over = |(a, b): (f64, f64), (c, d): (f64, f64)| {
        let size = c * c + d * d;
        ((a * c + b * d) / size, (b * c - a * d) / size)
    };
    let value = |z| {
        coefficients.iter().fold((1.0, 0.0), |sum, a| {
            let (re, im) = times(sum, z);
            (re - a, im)
        })
    };
    let mut roots: Vec<(f64, f64)> = vec![(0.4, 0.9)];
    while roots.len() < coefficients.len() {
        roots.push(times(*roots.last().unwrap(), (0.4, 0.9)));
    }
    for _ in 0..2_000 {
        for n in 0..roots.len() {
            let others = (0..roots.len())
                .filter(|m| *m != n)
                .fold((1.0, 0.0), |product, m| times(product, (roots[n].0 - roots[m].0, roots[n].1 - roots[m].1)));
            let step = over(value(roots[n]), others);
            roots[n] = (roots[n].0 - step.0, roots[n].1 - step.1);
        }
    }
    roots.sort_by(|a, b| b.0.hypot(b.1).total_cmp(&a.0.hypot(a.1)).then(b.1.total_cmp(&a.1)));
    roots
}

/// The sum of y(k)·e^(−jωk), with ω in radians a sample.
pub(crate) fn spectrum(response: &[f64], omega: f64) -> (f64, f64) {
    (0..).zip(response).fold((0.0, 0.0), |(re, im), (k, value)| {
        let angle = omega * f64::from(k);
        (re + value * angle.cos(), im - value * angle.sin())
    })
}

/// What comes from sample to sample.
pub(crate) fn differences(response: &[f64]) -> Vec<f64> {
    response.windows(2).map(|pair| pair[1] - pair[0]).collect()
}

/// Whether `found` is `expected`, or as near as `tolerance`.
pub(crate) fn near(what: &str, found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{what}: expected {expected} ± {tolerance}, found {found}");
}
