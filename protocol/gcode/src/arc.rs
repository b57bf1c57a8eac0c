//! Arcs: their centres, from I, J, K or from R.
//!
//! All in the coordinates of the plane's two axes, in mm.

use core::f64::consts::{FRAC_PI_2, TAU};

use crate::canon::Turn;

/// A radius is larger than this, as in LinuxCNC: 0.00005 inch.
const RADIUS_LEAST: f64 = 0.00127;
/// The radii at start and end may differ by this much in any case, as in LinuxCNC: for programs in mm, and in inches.
const SPIRAL_MM: f64 = 2.0 * 0.01 * core::f64::consts::SQRT_2;
const SPIRAL_INCH: f64 = 2.0 * 0.001 * core::f64::consts::SQRT_2 * 25.4;
/// They may differ by this share of the radius, up to a hundred times the above.
const SPIRAL_SHARE: f64 = 0.001;

/// The centre of an arc with a given centre: checks that it is one.
pub(crate) fn check(from: [f64; 2], to: [f64; 2], centre: [f64; 2], inches: bool) -> Result<(), String> {
    let radius = |place: [f64; 2]| libm::hypot(centre[0] - place[0], centre[1] - place[1]);
    let (start, end) = (radius(from), radius(to));
    if start < RADIUS_LEAST || end < RADIUS_LEAST {
        return Err("the arc has no radius".to_owned());
    }
    let difference = (start - end).abs();
    let least = if inches { SPIRAL_INCH } else { SPIRAL_MM };
    if difference > least * 100.0 || (difference > least && difference / start.max(end) > SPIRAL_SHARE) {
        return Err(format!(
            "the arc's radius is {start:.4} mm at its start and {end:.4} mm at its end: they differ by {difference:.4}"
        ));
    }
    Ok(())
}

/// The centre of an arc with a given radius. A negative radius means the longer arc.
pub(crate) fn centre(from: [f64; 2], to: [f64; 2], radius: f64, turn: Turn) -> Result<[f64; 2], String> {
    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
    if dx == 0.0 && dy == 0.0 {
        return Err("an arc with R cannot end where it starts".to_owned());
    }
    let size = radius.abs();
    let middle = [(from[0] + to[0]) / 2.0, (from[1] + to[1]) / 2.0];
    let mut half = libm::hypot(dx, dy) / 2.0;
    if half - size > RADIUS_LEAST {
        return Err(format!("the radius {size} mm is too small: the end is {:.4} mm away", 2.0 * half));
    }
    // A small error is forgiven for a half circle.
    if half / size > 1.0 - 1e-12 {
        half = size;
    }
    let right = (turn == Turn::Clockwise) == (radius > 0.0);
    let angle = libm::atan2(dy, dx) + if right { -FRAC_PI_2 } else { FRAC_PI_2 };
    let away = size * libm::cos(libm::asin(half / size));
    Ok([middle[0] + away * libm::cos(angle), middle[1] + away * libm::sin(angle)])
}

/// The length of an arc in its plane.
pub(crate) fn length(from: [f64; 2], to: [f64; 2], centre: [f64; 2], turn: Turn, turns: u32) -> f64 {
    let angle = |place: [f64; 2]| libm::atan2(place[1] - centre[1], place[0] - centre[0]);
    let mut swept = if turn == Turn::Clockwise { angle(from) - angle(to) } else { angle(to) - angle(from) };
    if swept <= 1e-12 {
        swept += TAU;
    }
    swept += TAU * f64::from(turns.saturating_sub(1));
    swept * libm::hypot(from[0] - centre[0], from[1] - centre[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_radius_gives_the_same_centre_as_offsets() {
        let near = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs() < 1e-9 && (a[1] - b[1]).abs() < 1e-9;
        let of = |to, radius, turn| centre([0.0, 0.0], to, radius, turn).unwrap();
        assert!(near(of([10.0, 10.0], 10.0, Turn::Clockwise), [10.0, 0.0]));
        assert!(near(of([10.0, 10.0], 10.0, Turn::Counterclockwise), [0.0, 10.0]));
        assert!(near(of([10.0, 10.0], -10.0, Turn::Clockwise), [0.0, 10.0]));
        assert!(near(of([20.0, 0.0], 10.0, Turn::Clockwise), [10.0, 0.0]), "a half circle");
        assert!(centre([0.0, 0.0], [20.0, 0.0], 9.0, Turn::Clockwise).unwrap_err().contains("too small"));
        assert!(centre([1.0, 0.0], [1.0, 0.0], 9.0, Turn::Clockwise).is_err());
    }

    #[test]
    fn radii_may_differ_as_far_as_in_linuxcnc() {
        let of = |end: f64, inches| check([0.0, 0.0], [end, 0.0], [10.0, 0.0], inches).is_ok();
        assert!(of(20.0, false) && of(20.028, false));
        assert!(!of(20.029, false) && of(20.071, true) && !of(20.073, true));
        assert!(check([0.0, 0.0], [0.0, 0.0], [0.001, 0.0], false).is_err(), "no radius");
    }

    #[test]
    fn a_full_turn_has_its_length() {
        let full = length([1.0, 0.0], [1.0, 0.0], [0.0, 0.0], Turn::Clockwise, 1);
        assert!((full - TAU).abs() < 1e-12);
        let quarter = length([1.0, 0.0], [0.0, 1.0], [0.0, 0.0], Turn::Clockwise, 2);
        assert!((quarter - 1.75 * TAU).abs() < 1e-12);
    }
}
