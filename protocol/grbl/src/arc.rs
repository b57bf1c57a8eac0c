//! Arcs: their centres, and the lines that stand for them.

use core::f64::consts::TAU;

use crate::axes::Axes;
use crate::code::Code;
use crate::path::{Rate, Straight};

/// A turn that is less than this, rad, is a full one.
const LEAST_TURN: f64 = 5e-7;
/// The radii at the start and at the end of an arc may differ by this, mm.
const RADII: f32 = 0.005;
/// They may differ by this in no case, mm.
const RADII_MOST: f32 = 0.5;
/// They may differ by this share of the radius.
const RADII_SHARE: f32 = 0.001;

/// An arc, as the lines that are left of it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Arc {
    from: Axes,
    to: Axes,
    /// The plane's axes.
    plane: [usize; 2],
    /// From the start to the centre.
    offset: [f32; 2],
    /// Counterclockwise, rad.
    turn: f64,
    lines: u32,
    done: u32,
    rate: Rate,
}

/// From the start of an arc to its centre, in the plane, from its radius. A negative one means the longer arc.
pub(crate) fn offset([x, y]: [f32; 2], radius: f32, clockwise: bool) -> Result<[f32; 2], Code> {
    let square = 4.0 * radius * radius - x * x - y * y;
    if square < 0.0 {
        return Err(Code::ArcRadius);
    }
    // The centre lies beside the middle of the chord.
    let aside = libm::sqrtf(square) / libm::hypotf(x, y);
    let aside = if clockwise == (radius < 0.0) { aside } else { -aside };
    Ok([0.5 * (x - y * aside), 0.5 * (y + x * aside)])
}

/// Whether an arc's end lies on its circle; both from its start.
pub(crate) fn check([x, y]: [f32; 2], [i, j]: [f32; 2]) -> Result<(), Code> {
    let radius = libm::hypotf(i, j);
    let difference = (libm::hypotf(x - i, y - j) - radius).abs();
    if difference > RADII && (difference > RADII_MOST || difference > RADII_SHARE * radius) {
        return Err(Code::InvalidTarget);
    }
    Ok(())
}

impl Arc {
    /// The lines that depart from the arc by `tolerance` mm at the most.
    pub(crate) fn new(
        from: Axes,
        to: Axes,
        plane: [usize; 2],
        offset: [f32; 2],
        clockwise: bool,
        tolerance: f32,
        rate: Rate,
    ) -> Self {
        let [a, b] = plane;
        let start = offset.map(|offset| -f64::from(offset));
        let end = [f64::from(to[a] - from[a]) + start[0], f64::from(to[b] - from[b]) + start[1]];
        let mut turn = libm::atan2(start[0] * end[1] - start[1] * end[0], start[0] * end[0] + start[1] * end[1]);
        if clockwise && turn >= -LEAST_TURN {
            turn -= TAU;
        } else if !clockwise && turn <= LEAST_TURN {
            turn += TAU;
        }
        let radius = libm::hypot(start[0], start[1]);
        let tolerance = f64::from(tolerance);
        let lines = libm::floor((0.5 * turn * radius).abs() / libm::sqrt(tolerance * (2.0 * radius - tolerance)));
        // As many as a 16-bit number holds; none if the tolerance is larger than the circle.
        let lines = if lines.is_finite() { (lines as u32 & 0xffff).max(1) } else { 1 };
        let rate = match rate {
            Rate::PerMinute(per_minute) => Rate::PerMinute(per_minute * lines as f32),
            rate => rate,
        };
        Self { from, to, plane, offset, turn, lines, done: 0, rate }
    }
}

impl Iterator for Arc {
    type Item = Straight;

    fn next(&mut self) -> Option<Straight> {
        if self.done == self.lines {
            return None;
        }
        self.done += 1;
        if self.done == self.lines {
            return Some(Straight { to: self.to, rate: self.rate });
        }
        let share = f64::from(self.done) / f64::from(self.lines);
        let (sin, cos) = libm::sincos(self.turn * share);
        let [i, j] = self.offset.map(f64::from);
        let [a, b] = self.plane;
        // Every other axis goes evenly.
        let mut to = core::array::from_fn(|axis| {
            let (from, to) = (self.from[axis], self.to[axis]);
            from + (f64::from(to - from) * share) as f32
        });
        to[a] = self.from[a] + (i - i * cos + j * sin) as f32;
        to[b] = self.from[b] + (j - i * sin - j * cos) as f32;
        Some(Straight { to, rate: self.rate })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const XY: [usize; 2] = [0, 1];

    #[test]
    fn the_lines_of_an_arc_lie_on_it() {
        let arc = Arc::new([10.0, 0.0, 0.0, 0.0], [0.0, 10.0, 4.0, 90.0], XY, [-10.0, 0.0], false, 0.002, Rate::Rapid);
        let places: Vec<Axes> = arc.map(|line| line.to).collect();
        assert_eq!(places.len(), 39);
        assert!(places.iter().all(|[x, y, ..]| (libm::hypotf(*x, *y) - 10.0).abs() < 1e-5));
        assert!(places.windows(2).all(|two| two[1][1] > two[0][1] && two[1][2] > two[0][2]));
        assert!(places.iter().all(|[.., z, a]| (a / z - 22.5).abs() < 1e-4));
        assert_eq!(places.last(), Some(&[0.0, 10.0, 4.0, 90.0]));
    }

    #[test]
    fn an_arc_that_ends_where_it_starts_is_a_full_turn() {
        let places = |clockwise| {
            let arc =
                Arc::new([1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], XY, [-1.0, 0.0], clockwise, 0.002, Rate::Rapid);
            arc.map(|line| line.to).collect::<Vec<_>>()
        };
        assert!(places(true)[0][1] < 0.0 && places(false)[0][1] > 0.0);
        assert!(places(true).len() > 40);
    }

    #[test]
    fn a_radius_gives_its_centre() {
        assert_eq!(offset([10.0, 10.0], 10.0, true), Ok([10.0, 0.0]));
        assert_eq!(offset([10.0, 10.0], 10.0, false), Ok([0.0, 10.0]));
        assert_eq!(offset([10.0, 10.0], -10.0, true), Ok([0.0, 10.0]));
        assert_eq!(offset([10.0, 0.0], 1.0, true), Err(Code::ArcRadius));
    }
}
