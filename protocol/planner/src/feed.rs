//! From mm a minute to the units of a frame.

use torno_protocol::lathe::TransverseSubFrame;

use crate::finding::{Findings, Once};
use crate::scale::Feed;

/// A feed that is rounded by more is told.
const ROUNDED: f64 = 0.05;
/// A feed lower than this share of the lowest is refused: 4.44 mm a minute is as good as 4.444.
const LOWEST: f64 = 0.99;

/// The nearest unit to a feed in mm a minute; None if it is too slow, which is refused.
pub(crate) fn units(axis: &Feed, feed: f64, line: usize, findings: &mut Findings) -> Option<u8> {
    let (unit, most) = (axis.unit(), axis.most());
    if feed < LOWEST * unit {
        findings.refuse(line, b'f', format!("the feed is {feed:.2} mm a minute: the slowest is {unit:.2}"));
        return None;
    }
    let units = (feed / unit).round().clamp(1.0, f64::from(TransverseSubFrame::SPEED_MAX)) as u8;
    let got = f64::from(units) * unit;
    if feed > most + unit / 2.0 {
        findings.warn(Once::FeedClamped, line, b'f', || {
            format!("the feed is {feed:.2} mm a minute: the machine goes {most:.2}, here and wherever more is asked")
        });
    } else if (got - feed).abs() > ROUNDED * feed {
        findings.warn(Once::FeedRounded, line, b'f', || {
            format!("the feed is {feed:.2} mm a minute: the machine goes {got:.2}, as it has steps of {unit:.2}")
        });
    }
    Some(units)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_feed_is_rounded_clamped_or_refused() {
        let axis = Feed { mm_per_count: 1.0 / 450.0, sample_s: 0.03, reach: 36_000 };
        assert!((axis.unit() - 4.444_444_444).abs() < 1e-6 && (axis.most() - 1000.0).abs() < 1e-9);
        let of = |feed: f64| {
            let mut findings = Findings::default();
            let found = units(&axis, feed, 7, &mut findings);
            (found, findings.list().pop().map(|finding| finding.message))
        };
        let says = |text: &str| Some(text.to_owned());
        assert_eq!(of(1000.0), (Some(225), None));
        assert_eq!(of(4.44), (Some(1), None));
        assert_eq!(of(4.39), (None, says("the feed is 4.39 mm a minute: the slowest is 4.44")));
        let rounded = "the feed is 6.00 mm a minute: the machine goes 4.44, as it has steps of 4.44";
        assert_eq!(of(6.0), (Some(1), says(rounded)));
        let most = "the feed is 1200.00 mm a minute: the machine goes 1000.00, here and wherever more is asked";
        assert_eq!(of(1200.0), (Some(225), says(most)));
    }
}
