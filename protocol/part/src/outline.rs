//! The outline of a part in few points, to be drawn.

use crate::{Place, Profile};

/// The corners of a profile's radii, from the face on: straight lines from one to the next are nowhere further from
/// them than `within`, in mm.
pub fn outline(radii: &[f64], within: f64) -> Vec<Place> {
    let Some(end) = radii.len().checked_sub(1) else { return Vec::new() };
    let mut corners = vec![0];
    let mut open = vec![(0, end)];
    while let Some((first, last)) = open.pop() {
        let slope = (radii[last] - radii[first]) / (last - first).max(1) as f64;
        let off = |point: usize| (radii[point] - radii[first] - slope * (point - first) as f64).abs();
        let worst = (first + 1..last).max_by(|a, b| off(*a).total_cmp(&off(*b))).filter(|point| off(*point) > within);
        match worst {
            Some(corner) => open.extend([(corner, last), (first, corner)]),
            None => corners.push(last),
        }
    }
    corners.dedup();
    corners.into_iter().map(|point| Place { z: Profile::z(point), x: radii[point] }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Nose;

    #[test]
    fn a_shaft_has_few_corners_and_they_are_near() {
        let mut part = Profile::bar(28.0, 60.0);
        for (x, z) in [(13.5, -40.0), (12.0, -26.0)] {
            let nose = Nose::new(0.4, 90.0, 32.0).unwrap();
            part.cut(&nose, Place { z: 0.0, x }, Place { z, x });
        }
        let corners = outline(&part.radii(), 0.005);
        assert!((8..60).contains(&corners.len()), "{corners:?}");
        assert!(corners.windows(2).all(|pair| pair[0].z > pair[1].z));
        for (point, radius) in part.radii().iter().enumerate() {
            let z = Profile::z(point);
            let pair = corners.windows(2).find(|pair| (pair[1].z..=pair[0].z).contains(&z)).unwrap();
            let share = (z - pair[0].z) / (pair[1].z - pair[0].z);
            assert!((pair[0].x + share * (pair[1].x - pair[0].x) - radius).abs() <= 0.005 + 1e-9, "{z}");
        }
        assert_eq!(outline(&Profile::bar(28.0, 60.0).radii(), 0.01).len(), 2);
    }
}
