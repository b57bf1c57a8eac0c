//! What a calliper would find: the cylinders of a part, their diameters and lengths.

use crate::{GRID, Profile, Side};

/// Within a cylinder the radius is the same within this, in mm.
const ROUND: f64 = 0.001;
/// A shorter one is none, in mm.
const SHORTEST: f64 = 0.5;

/// A cylinder of a part: of its outside, or of its bore.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cylinder {
    /// Its diameter, in mm.
    pub diameter: f64,
    /// Where it begins, towards the face: a `z` in mm.
    pub from: f64,
    /// Where it ends, towards the chuck: at the shoulder, if there is one.
    pub to: f64,
    /// The bar, or its bore, as it was.
    pub stock: bool,
}

impl Cylinder {
    /// Its length, in mm.
    pub fn length(&self) -> f64 {
        self.from - self.to
    }
}

/// The cylinders of a part, from the face on. What lies between two, the fillet that the nose leaves before a shoulder
/// and the slope that its edge leaves, belongs to the one that is cut deeper if it is no longer than `between`, in mm.
pub fn cylinders(part: &Profile, between: f64) -> Vec<Cylinder> {
    let heights = part.heights();
    let mut found: Vec<Cylinder> = Vec::new();
    let mut first = 0;
    while first < heights.len() {
        let same = |height: &f64| (height - heights[first]).abs() <= ROUND;
        let end = heights[first..].iter().position(|height| !same(height));
        let end = end.map_or(heights.len(), |length| first + length);
        let length = (end - 1 - first) as f64 * GRID;
        if length >= SHORTEST && heights[first] > part.floor() {
            let diameter = 2.0 * part.mirrored(heights[first]);
            let stock = heights[first] == part.stock_height();
            found.push(Cylinder { diameter, from: Profile::z(first), to: Profile::z(end - 1), stock });
        }
        first = if length >= SHORTEST { end } else { first + 1 };
    }
    for place in 1..found.len() {
        let (before, after) = (found[place - 1], found[place]);
        if before.to - after.from <= between + GRID {
            // The last point of the fillet: the next is outside the shoulder.
            let is_outside = part.side() == Side::Outside;
            let shoulder = if (before.diameter < after.diameter) == is_outside { after.from + GRID } else { before.to };
            (found[place - 1].to, found[place].from) = (shoulder, shoulder);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Nose, Place};

    #[test]
    fn the_steps_of_a_shaft_are_measured_to_their_shoulders() {
        let nose = Nose::new(0.4, 90.0, 32.0).unwrap();
        let mut part = Profile::bar(28.0, 60.0);
        for (x, z) in [(13.5, -40.0), (12.0, -26.0), (11.0, -12.0)] {
            part.cut(&nose, Place { z: 0.0, x }, Place { z, x });
        }
        let found = cylinders(&part, 2.0);
        let expected = [(22.0, 0.0, -12.0), (24.0, -12.0, -26.0), (27.0, -26.0, -40.0), (28.0, -40.0, -60.0)];
        assert_eq!(found.len(), 4, "{found:?}");
        for (cylinder, (diameter, from, to)) in found.iter().zip(expected) {
            assert!((cylinder.diameter - diameter).abs() < 1e-9, "{found:?}");
            assert!((cylinder.from - from).abs() <= 0.5 * GRID, "{found:?}");
            assert!((cylinder.to - to).abs() <= 0.5 * GRID, "{found:?}");
            assert_eq!(cylinder.stock, diameter == 28.0);
        }
    }

    #[test]
    fn a_bar_is_one_cylinder_and_a_taper_is_none() {
        let mut part = Profile::bar(28.0, 10.0);
        let whole = cylinders(&part, 2.0);
        assert_eq!((whole.len(), whole[0].diameter, whole[0].length(), whole[0].stock), (1, 28.0, 10.0, true));
        let nose = Nose::new(0.4, 90.0, 32.0).unwrap();
        part.cut(&nose, Place { z: 1.0, x: 8.0 }, Place { z: -10.0, x: 13.0 });
        assert_eq!(cylinders(&part, 2.0), []);
    }
}
