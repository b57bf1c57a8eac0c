//! Readings that no motor can have made: a counter that wraps, a sample that was misread, a counter that was reset.

use super::columns::Output;

/// Counters that are looked for, in bits.
const BITS: [u32; 7] = [8, 10, 12, 14, 16, 24, 32];
/// What is unwrapped is so much smoother than what was not. (Ours.)
const SMOOTHER: f64 = 0.5;
/// A counter that moves by more than this share of its range between two rows may have gone the other way. (Ours.)
const TOO_FAR: f64 = 0.45;
/// A sample is misread that is so many times further off than its neighbours are apart. (Ours.)
const APART: f64 = 3.0;
/// And so many times further than the noise, ...
const NOISE: f64 = 10.0;
/// and so many counts.
const COUNTS: f64 = 4.0;
/// An input changes that changes by more than this share of its range. (Ours.)
const CHANGES: f64 = 0.05;
/// Where a larger share of the rows is misread, it is the sensor that is so. (Ours.)
const SINGLE: f64 = 0.02;

/// A row that is wrong, by its place, and how.
pub(super) type Wrong = (usize, String);

/// Times, inputs and outputs, row by row.
pub(super) struct Readings<'a> {
    pub(super) output: Output,
    pub(super) rows: &'a [[f64; 3]],
    /// What a count is, in units of the output; 0 if it does not count.
    pub(super) count: f64,
}

/// The same without the wraps of a counter of so many bits.
pub(super) fn unwrap(rows: &mut [[f64; 3]], output: Output, bits: u32) -> Result<(), Wrong> {
    let range = range(bits);
    let (mut low, mut high) = (0.0f64, 0.0f64);
    for (place, [.., found]) in rows.iter().enumerate() {
        (low, high) = (low.min(*found), high.max(*found));
        if found.fract() != 0.0 || high - low >= range {
            let before = if place > 0 { format!(" (from {low} to {high} so far)") } else { String::new() };
            return Err((place, format!("expected what a counter of {bits} bits can hold, found {found}{before}")));
        }
    }
    let mut before = rows.first().map_or(0.0, |row| row[2]);
    let mut sum = before;
    for (place, row) in rows.iter_mut().enumerate() {
        let moved = folded(if output == Output::Counts { row[2] } else { row[2] - before }, range);
        if moved.abs() > TOO_FAR * range {
            let unclear = format!("a counter of {bits} bits cannot tell in which direction");
            return Err((place, format!("moves by {moved} of {range} from the row before: {unclear}")));
        }
        before = row[2];
        sum += moved;
        row[2] = if output == Output::Counts { moved } else { sum };
    }
    Ok(())
}

fn range(bits: u32) -> f64 {
    libm::exp2(f64::from(bits))
}

/// What is nearest to 0 of all that differ by whole ranges.
fn folded(moved: f64, range: f64) -> f64 {
    moved - range * libm::round(moved / range)
}

impl Readings<'_> {
    /// The first row that cannot be.
    pub(super) fn check(&self) -> Option<Wrong> {
        self.wraps().or_else(|| self.misread()).or_else(|| self.jumps())
    }

    fn value(&self, row: usize) -> f64 {
        self.rows[row][2]
    }

    /// A counter that goes round.
    fn wraps(&self) -> Option<Wrong> {
        if !self.output.is_counts() || self.rows.iter().any(|row| row[2].fract() != 0.0) {
            return None;
        }
        let (low, high) =
            self.rows.iter().fold((0.0, 0.0), |(low, high): (f64, f64), row| (low.min(row[2]), high.max(row[2])));
        let holds = |bits: &u32| {
            let range = range(*bits);
            (low >= 0.0 && high < range) || (low >= -0.5 * range && high < 0.5 * range)
        };
        let bits = BITS.into_iter().find(holds)?;
        let range = range(bits);
        let moved: Vec<f64> = match self.output {
            Output::Counts => self.rows.iter().map(|row| row[2]).collect(),
            _ => self.rows.windows(2).map(|pair| pair[1][2] - pair[0][2]).collect(),
        };
        let first = moved.iter().position(|moved| moved.abs() > 0.5 * range)?;
        let rough = |moved: &[f64]| moved.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum::<f64>();
        let smooth: Vec<f64> = moved.iter().map(|moved| folded(*moved, range)).collect();
        if rough(&smooth) > SMOOTHER * rough(&moved) {
            return None;
        }
        let wraps = format!("a counter of {bits} bits that wraps: give --unwrap {bits}");
        Some(match self.output {
            Output::Counts => (first, format!("the count is {}, which is {} of {wraps}", moved[first], smooth[first])),
            _ => {
                let (from, to) = (self.value(first), self.value(first + 1));
                (first + 1, format!("the position jumps by {} (from {from} to {to}), as that of {wraps}", moved[first]))
            }
        })
    }

    /// A single row that is off, while those before and after agree.
    fn misread(&self) -> Option<Wrong> {
        let n = self.rows.len();
        let offs: Vec<f64> = (1..n.saturating_sub(1)).map(|row| self.off(row)).collect();
        let noise = NOISE * median(offs.iter().map(|off| off.abs()));
        let largest = self.rows.iter().map(|row| row[2].abs()).fold(0.0, f64::max);
        let is = |row: &usize| {
            let row = *row;
            let (before, now, after) = (self.value(row - 1), self.value(row), self.value(row + 1));
            let outside = (now > before && now > after) || (now < before && now < after);
            let apart =
                [(row.checked_sub(2), Some(row - 1)), (Some(row + 1), Some(row + 2)), (Some(row - 1), Some(row + 1))];
            let apart =
                apart.into_iter().filter_map(|(a, b)| Some((self.rows.get(a?)?[2] - self.rows.get(b?)?[2]).abs()));
            let least = APART * apart.fold(0.0, f64::max) + noise + COUNTS * self.count;
            let off = self.off(row).abs();
            // No change of the input makes a position jump.
            let possible = self.output.is_rate() && !self.is_steady(row);
            outside && off > least && off > CHANGES * largest && !possible
        };
        let found: Vec<usize> = (1..n.saturating_sub(1)).filter(is).collect();
        let row = *found.first()?;
        if found.len() as f64 > (SINGLE * n as f64).max(5.0) {
            return None;
        }
        let (before, now, after) = (self.value(row - 1), self.value(row), self.value(row + 1));
        let others = match found.len() - 1 {
            0 => String::new(),
            others => format!(" ({others} more rows are like this)"),
        };
        let word = self.output.word();
        Some((
            row,
            format!(
                "the {word} jumps by {} to {} and back, between {} and {}: no motor does this; remove the row{others}",
                short(now - before),
                short(now),
                short(before),
                short(after)
            ),
        ))
    }

    /// A position that goes on from somewhere else.
    fn jumps(&self) -> Option<Wrong> {
        if self.output.is_rate() {
            return None;
        }
        let rates: Vec<f64> =
            self.rows.windows(2).map(|pair| (pair[1][2] - pair[0][2]) / (pair[1][0] - pair[0][0])).collect();
        let noise = NOISE * median((1..self.rows.len().saturating_sub(1)).map(|row| self.off(row).abs()));
        let is = |place: &usize| {
            let place = *place;
            let beside: Vec<f64> = (place.saturating_sub(2)..rates.len().min(place + 3))
                .filter(|other| *other != place)
                .map(|other| rates[other])
                .collect();
            let largest = beside.iter().fold(0.0, |largest: f64, rate| largest.max(rate.abs()));
            let length = self.rows[place + 1][0] - self.rows[place][0];
            let off = (rates[place] - median(beside.into_iter())).abs() * length;
            off > APART * largest * length + noise + COUNTS * self.count && (place == 0 || self.is_steady(place))
        };
        let place = (0..rates.len()).find(is)?;
        let (from, to) = (self.value(place), self.value(place + 1));
        let usual = (place.checked_sub(1).or(Some(place + 1)))
            .and_then(|other| rates.get(other))
            .map_or(0.0, |rate| rate * (self.rows[place + 1][0] - self.rows[place][0]));
        let jump = format!("the position jumps by {} (from {} to {})", short(to - from), short(from), short(to));
        let advice = "no motor does this; was the counter reset? take the rows before or after";
        Some((place + 1, format!("{jump}, where {} is usual: {advice}", short(usual))))
    }

    /// How far a row is from the line between its neighbours.
    fn off(&self, row: usize) -> f64 {
        let [[start, _, before], [time, _, now], [end, _, after]] =
            [self.rows[row - 1], self.rows[row], self.rows[row + 1]];
        now - before - (after - before) * (time - start) / (end - start)
    }

    /// The input is the same around a row.
    fn is_steady(&self, row: usize) -> bool {
        let inputs = |rows: &[[f64; 3]]| {
            rows.iter().fold([f64::MAX, f64::MIN], |[low, high], row| [low.min(row[1]), high.max(row[1])])
        };
        let ([low, high], [lowest, highest]) = (inputs(&self.rows[row.saturating_sub(2)..=row]), inputs(self.rows));
        high - low <= CHANGES * (highest.max(0.0) - lowest.min(0.0))
    }
}

fn median(numbers: impl Iterator<Item = f64>) -> f64 {
    let mut numbers: Vec<f64> = numbers.collect();
    numbers.sort_by(f64::total_cmp);
    numbers.get(numbers.len() / 2).copied().unwrap_or(0.0)
}

/// Four digits.
fn short(number: f64) -> String {
    format!("{}", (number * 1e4).round() / 1e4)
}
