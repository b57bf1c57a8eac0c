//! Quantities with their units, as people write them: `200 ms`, `3 %`, `-500 ppm`.

use torno_protocol::time::Span;

/// A ratio in parts per billion.
pub type Ratio = i64;

/// Reads a time: a number and `s`, `ms`, `us` or `ns`.
///
/// # Errors
/// What was expected.
pub fn parse_span(text: &str) -> Result<Span, String> {
    let units = [("ms", 1e6), ("us", 1e3), ("µs", 1e3), ("ns", 1.0), ("s", 1e9)];
    match scaled(text, &units) {
        Some(nanos) if (0.0..=1e18).contains(&nanos) => Ok(Span::from_nanos(nanos.round() as u64)),
        _ => Err(format!("'{text}': expected a time, such as \"1.5 s\", \"200 ms\" or \"50 us\"")),
    }
}

/// Reads a ratio: a number and `%` or `ppm`.
///
/// # Errors
/// What was expected.
pub fn parse_ratio(text: &str) -> Result<Ratio, String> {
    match scaled(text, &[("%", 1e7), ("ppm", 1e3)]) {
        Some(ppb) if ppb.abs() <= 1e12 => Ok(ppb.round() as i64),
        _ => Err(format!("'{text}': expected a ratio, such as \"3 %\" or \"-500 ppm\"")),
    }
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
    fn ratios_have_units() {
        for (text, ppb) in [("3 %", 30_000_000), ("-500 ppm", -500_000), ("+0.5%", 5_000_000)] {
            assert_eq!(parse_ratio(text), Ok(ppb), "{text}");
        }
        for wrong in ["", "3", "3 ms", "inf %"] {
            assert!(parse_ratio(wrong).is_err(), "{wrong}");
        }
    }
}
