//! How far a part is from the one that was asked for.

use std::cmp::Ordering;
use std::fmt;

use crate::{GRID, Profile, Side};

/// Near a shoulder, what was asked for so far to either side is what was asked for, in mm: a shoulder that stands a
/// hair beside its place is no wrong diameter. What is further off is.
pub const SHOULDER: f64 = 0.05;

/// Where a part is furthest from what was asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deviation {
    /// How much more is left there than asked, in mm of diameter: it is thicker, or a bore narrower.
    pub diameter: f64,
    /// Where: a `z` in mm. In the middle, if it is the same on a stretch.
    pub z: f64,
    /// Of which surface.
    pub side: Side,
}

/// Whether a diameter that is off by so much is within a tolerance: on the bound, as written, it is. All in mm.
pub fn is_within(off: f64, tolerance: f64) -> bool {
    off.abs() <= tolerance + 1e-9
}

impl fmt::Display for Deviation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { diameter, z, side } = self;
        let [more, less] = match side {
            Side::Outside => ["thick", "thin"],
            Side::Inside => ["narrow", "wide"],
        };
        let how = match diameter.partial_cmp(&0.0) {
            Some(Ordering::Greater) => more,
            Some(Ordering::Less) => less,
            _ => return f.write_str("none: it is as asked"),
        };
        write!(f, "{:.2} mm of diameter too {how}, at z = {z:.2} mm", diameter.abs())
    }
}

/// How much more is left of a part than of another, point by point, in mm of diameter; both come of the same bar.
/// What is within [`SHOULDER`] is right.
pub fn deviations(got: &Profile, asked: &Profile) -> Vec<f64> {
    let near = (SHOULDER / GRID).round() as usize;
    let heights = asked.heights();
    let off = |(point, height): (usize, &f64)| {
        let Some(last) = heights.len().checked_sub(1) else { return 0.0 };
        if heights.get(point) == Some(height) {
            return 0.0;
        }
        let around = &heights[point.saturating_sub(near).min(last)..=(point + near).min(last)];
        let least = around.iter().copied().fold(f64::INFINITY, f64::min);
        let most = around.iter().copied().fold(0.0, f64::max);
        2.0 * (height - height.clamp(least, most))
    };
    got.heights().iter().enumerate().map(off).collect()
}

/// The worst of the [`deviations`].
pub fn deviation(got: &Profile, asked: &Profile) -> Deviation {
    let mut worst = (0.0, 0..0);
    for (point, here) in deviations(got, asked).into_iter().enumerate() {
        if here.abs() > f64::abs(worst.0) + 1e-9 {
            worst = (here, point..point);
        } else if here != 0.0 && (here - worst.0).abs() <= 1e-9 && point == worst.1.end + 1 {
            worst.1.end = point;
        }
    }
    Deviation { diameter: worst.0, z: Profile::z(worst.1.start.midpoint(worst.1.end)), side: got.side() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Nose, Place};

    fn shaft(x: f64, z: f64) -> Profile {
        let mut part = Profile::bar(28.0, 60.0);
        part.cut(&Nose::new(0.4, 90.0, 32.0).unwrap(), Place { z: 0.0, x }, Place { z, x });
        part
    }

    #[test]
    fn a_wrong_diameter_is_found_in_its_middle_and_has_a_sign() {
        let found = deviation(&shaft(12.1, -20.0), &shaft(12.0, -20.0));
        assert!((found.diameter - 0.2).abs() < 1e-9 && (found.z + 10.0).abs() < 0.3, "{found:?}");
        let found = deviation(&shaft(11.9, -20.0), &shaft(12.0, -20.0));
        assert!((found.diameter + 0.2).abs() < 1e-9, "{found:?}");
    }

    #[test]
    fn a_diameter_on_the_bound_is_within_it() {
        assert!(is_within(0.3, 0.1 + 0.2) && is_within(-0.1 - 0.2, 0.3) && is_within(0.0, 0.0));
        assert!(!is_within(0.3001, 0.3) && !is_within(-1e-6, 0.0) && !is_within(f64::NAN, 1.0));
    }

    #[test]
    fn a_shoulder_may_stand_a_hair_beside_its_place_but_not_two() {
        assert_eq!(deviation(&shaft(12.0, -20.0), &shaft(12.0, -20.0)), Deviation::default());
        assert_eq!(deviation(&shaft(12.0, -20.04), &shaft(12.0, -20.0)).diameter, 0.0);
        assert_eq!(deviation(&shaft(12.0, -19.96), &shaft(12.0, -20.0)).diameter, 0.0);
        let found = deviation(&shaft(12.0, -20.2), &shaft(12.0, -20.0));
        assert!(found.diameter < -3.0 && (found.z + 20.1).abs() < 0.11, "{found:?}");
    }
}
