//! Where the labels of an axis are.

use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};

/// An axis with its labels at round numbers.
pub(crate) struct Axis(pub(crate) (f64, f64));

impl Ranged for Axis {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let (low, high) = self.0;
        limit.0 + ((value - low) / (high - low) * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        ticks(self.0, hint.max_num_points())
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.0.0..self.0.1
    }
}

/// The round numbers within a range that stand on its axis.
pub(crate) fn ticks((low, high): (f64, f64), most: usize) -> Vec<f64> {
    let rough = (high - low) / most.clamp(2, 12) as f64;
    let power = libm::pow(10.0, libm::floor(libm::log(rough) / core::f64::consts::LN_10));
    let step = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power).into_iter().find(|step| *step >= rough);
    let step = step.unwrap_or(10.0 * power);
    let (first, last) = ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64);
    (first..=last).map(|n| n as f64 * step).collect()
}

/// From the least to the greatest, with some room; never nothing.
pub(crate) fn range(values: impl Iterator<Item = f64>, room: f64) -> (f64, f64) {
    let (low, high) = values.fold((f64::MAX, f64::MIN), |(low, high), value| (low.min(value), high.max(value)));
    if low > high {
        return (0.0, 1.0);
    }
    let room = if high > low { room * (high - low) } else { 0.5 * high.abs().max(1.0) };
    // What is never below 0 begins there.
    (if low >= 0.0 && (low < 0.5 * high || low == high) { 0.0 } else { low - room }, high + room)
}

/// A number on an axis: no more digits than it needs.
pub(crate) fn number(value: f64) -> String {
    let text = format!("{:.6}", if value.abs() < 1e-9 { 0.0 } else { value });
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_at_round_numbers() {
        let axis = Axis((0.0, 402.8));
        assert_eq!(axis.key_points(6), [0.0, 100.0, 200.0, 300.0, 400.0]);
        assert_eq!(
            Axis((-0.3, 0.3)).key_points(4).iter().map(|x| number(*x)).collect::<Vec<_>>(),
            ["-0.2", "0", "0.2"]
        );
    }
}
