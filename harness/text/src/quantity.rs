//! Quantities with their units, as people write them: `200 ms`, `3 %`, `-500 ppm`.

use torno_protocol::time::Span;

/// A ratio in parts per billion.
pub type Ratio = i64;

/// Units and what they are, in ns; of those that end alike the longer first.
const TIMES: [(&str, f64); 5] = [("ms", 1e6), ("us", 1e3), ("µs", 1e3), ("ns", 1.0), ("s", 1e9)];
/// In parts per billion.
const RATIOS: [(&str, f64); 2] = [("%", 1e7), ("ppm", 1e3)];
/// In mm.
const LENGTHS: [(&str, f64); 3] = [("mm", 1.0), ("um", 1e-3), ("µm", 1e-3)];

/// No end of a range is beyond this, so that the way between them is a number too.
const BOUND_MAX: f64 = 1e18;

/// Reads a time: a number and `s`, `ms`, `us` or `ns`.
///
/// # Errors
/// What was expected.
pub fn parse_span(text: &str) -> Result<Span, String> {
    match scaled(text, &TIMES) {
        Some(nanos) if (0.0..=1e18).contains(&nanos) => Ok(Span::from_nanos(nanos.round() as u64)),
        _ => Err(format!("'{text}': expected a time, such as \"1.5 s\", \"200 ms\" or \"50 us\"")),
    }
}

/// Reads a ratio: a number and `%` or `ppm`.
///
/// # Errors
/// What was expected.
pub fn parse_ratio(text: &str) -> Result<Ratio, String> {
    match scaled(text, &RATIOS) {
        Some(ppb) if ppb.abs() <= 1e12 => Ok(ppb.round() as i64),
        _ => Err(format!("'{text}': expected a ratio, such as \"3 %\" or \"-500 ppm\"")),
    }
}

/// Reads a length, in mm: a number and `mm` or `um`.
///
/// # Errors
/// What was expected.
pub fn parse_length(text: &str) -> Result<f64, String> {
    let expected = || format!("'{text}': expected a length, such as \"-20 mm\" or \"50 um\"");
    scaled(text, &LENGTHS).ok_or_else(expected)
}

/// From a quantity to another one that is not below it, both included.
#[derive(Clone, Debug, PartialEq)]
pub struct Range {
    from: f64,
    to: f64,
    unit: String,
}

impl Range {
    /// Reads `FROM..TO`, with a unit at either end or at both; `None` if it is no range at all. The values in between
    /// have the unit of TO.
    ///
    /// # Errors
    /// What was expected.
    pub fn parse(text: &str) -> Option<Result<Self, String>> {
        let (from, to) = text.split_once("..")?;
        let ((from, unit_from), (to, unit_to)) = (number(from), number(to));
        let (Some(from), Some(to)) = (from, to) else {
            return Some(Err(format!("'{text}': expected FROM..TO, such as \"1 s..3 s\" or \"1..16\"")));
        };
        let unit = if unit_to.is_empty() { unit_from } else { unit_to };
        let factor = if unit_from.is_empty() || unit_from == unit { Some(1.0) } else { factor(unit_from, unit) };
        let Some(factor) = factor else {
            return Some(Err(format!("'{text}': FROM and TO have different units")));
        };
        let from = from * factor;
        if from.abs().max(to.abs()) > BOUND_MAX {
            return Some(Err(format!("'{text}': FROM and TO lie beyond {BOUND_MAX:e}")));
        }
        if from > to {
            return Some(Err(format!("'{text}': FROM is above TO")));
        }
        Some(Ok(Self { from, to, unit: unit.to_owned() }))
    }

    /// The values by which it shows whether all of it is allowed: both ends, and 0 if that lies between them.
    pub fn extremes(&self) -> [String; 3] {
        let zero = if self.from < 0.0 && self.to > 0.0 { -self.from / (self.to - self.from) } else { 0.0 };
        [0.0, zero, 1.0].map(|share| self.at(share))
    }

    /// The value at a share of the way, as a file would have it.
    pub fn at(&self, share: f64) -> String {
        let value = self.from + (self.to - self.from) * share;
        // What is written in a file must not end in the noise of floating point.
        let value = (value * 1e9).round() / 1e9;
        if self.unit.is_empty() { format!("{value}") } else { format!("{value} {}", self.unit) }
    }

    /// A value for a fraction from 0 to below 1: an integer, if both ends are and there is no unit.
    pub fn draw(&self, fraction: f64) -> String {
        if self.unit.is_empty() && self.from.fract() == 0.0 && self.to.fract() == 0.0 {
            return format!("{}", (self.from + (self.to - self.from + 1.0) * fraction).floor());
        }
        self.at(fraction)
    }
}

/// What one unit is in another one, if both are of one kind.
fn factor(from: &str, to: &str) -> Option<f64> {
    let find = |units: &[(&str, f64)], name: &str| units.iter().find(|(unit, _)| *unit == name).map(|(_, one)| *one);
    [&TIMES[..], &RATIOS, &LENGTHS].into_iter().find_map(|units| Some(find(units, from)? / find(units, to)?))
}

/// A number and its unit.
fn number(text: &str) -> (Option<f64>, &str) {
    let text = text.trim();
    let end = text.find(|c: char| !matches!(c, '0'..='9' | '.' | '-' | '+')).unwrap_or(text.len());
    (text[..end].parse().ok().filter(|number: &f64| number.is_finite()), text[end..].trim())
}

fn scaled(text: &str, units: &[(&str, f64)]) -> Option<f64> {
    let (number, scale) =
        units.iter().find_map(|(unit, scale)| text.trim().strip_suffix(unit).map(|number| (number.trim(), scale)))?;
    number.parse::<f64>().ok().filter(|number| number.is_finite()).map(|number| number * scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_units() {
        for (text, nanos) in [("1.5 s", 1_500_000_000), ("200ms", 200_000_000), ("50 us", 50_000), ("7 ns", 7)] {
            assert_eq!(parse_span(text), Ok(Span::from_nanos(nanos)), "{text}");
        }
        for wrong in ["", "5", "5 m", "s", "-1 s", "nan s", "5 %", "1e99 s"] {
            assert!(parse_span(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn lengths_have_units() {
        for (text, mm) in [("-20 mm", -20.0), ("0.4mm", 0.4), ("500 um", 0.5), ("2 µm", 0.002)] {
            assert_eq!(parse_length(text), Ok(mm), "{text}");
        }
        for wrong in ["", "20", "mm", "20 m", "nan mm", "20 s"] {
            assert!(parse_length(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn ratios_have_units() {
        for (text, ppb) in [("3 %", 30_000_000), ("-500 ppm", -500_000), ("+0.5%", 5_000_000)] {
            assert_eq!(parse_ratio(text), Ok(ppb), "{text}");
        }
        for wrong in ["", "3", "3 ms", "inf %"] {
            assert!(parse_ratio(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_range_has_ends_between_which_there_are_numbers() {
        let wide = ["-{9}..{9}", "0..1000000000000000001{0}", "-{9} s..1 ns"];
        for text in wide.map(|text| text.replace("{9}", &"9".repeat(305)).replace("{0}", "0000")) {
            let complaint = Range::parse(&text).unwrap().unwrap_err();
            assert!(complaint.ends_with("FROM and TO lie beyond 1e18"), "{complaint}");
        }
        assert_eq!(Range::parse("-1000000..1000000").unwrap().unwrap().extremes(), ["-1000000", "0", "1000000"]);
    }
}
