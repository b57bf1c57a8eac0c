//! What is left of the bar: its radius, point by point along the axis.

use crate::Nose;

/// The points are so far apart along the axis, in mm. At each the radius is that which straight moves leave, with no
/// error but that of floating point; where a shoulder stands is known within this.
pub const GRID: f64 = 0.01;

/// So many points share a bound.
const BLOCK: usize = 32;

/// Less than this is not cut, in mm: the noise of floating point.
const NOTHING: f64 = 1e-9;

/// Where the tool's tip is, in mm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Along the axis.
    pub z: f64,
    /// From the axis.
    pub x: f64,
}

/// What a move took off.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shaving {
    /// The area, in the plane of the axis and on one side of it, in mm².
    pub area: f64,
    /// The most at any one point, in mm of radius.
    pub thickest: f64,
}

/// The profile of a bar, from its face to the chuck.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    stock: f64,
    /// From the face on, a [`GRID`] apart.
    radii: Vec<f64>,
    /// The greatest of each [`BLOCK`] of them: what was turned thinner before costs no time.
    greatest: Vec<f64>,
}

impl Profile {
    /// A bar of a diameter that stands out of the chuck so far, in mm.
    pub fn bar(diameter: f64, out: f64) -> Self {
        let points = (out / GRID).round().max(0.0) as usize + 1;
        let stock = diameter / 2.0;
        Self { stock, radii: vec![stock; points], greatest: vec![stock; points.div_ceil(BLOCK)] }
    }

    /// The diameter of the bar, in mm.
    pub const fn stock(&self) -> f64 {
        2.0 * self.stock
    }

    /// How far the bar stands out of the chuck, in mm.
    pub fn out(&self) -> f64 {
        (self.radii.len() - 1) as f64 * GRID
    }

    /// The radii in mm from the face towards the chuck, a [`GRID`] apart.
    pub fn radii(&self) -> &[f64] {
        &self.radii
    }

    /// Where a point of [`Profile::radii`] lies, in mm: 0 or below.
    pub fn z(point: usize) -> f64 {
        0.0 - point as f64 * GRID
    }

    /// The diameter at `z`, in mm; none outside the bar that stands out.
    pub fn diameter(&self, z: f64) -> Option<f64> {
        let point = (-z / GRID).round();
        let radius = if point >= 0.0 { self.radii.get(point as usize) } else { None };
        radius.map(|radius| 2.0 * radius)
    }

    /// Takes off what the nose sweeps on a straight way.
    pub fn cut(&mut self, nose: &Nose, from: Place, to: Place) -> Shaving {
        let mut shaving = Shaving::default();
        let Some((first, last)) = self.reached(nose, from, to) else { return shaving };
        let lowest = from.x.min(to.x);
        let sweep = Sweep::new(nose, from, to);
        // What has been turned as thin lies within the noise of floating point of it.
        let cut = lowest + NOTHING;
        let blocks = first / BLOCK..=last / BLOCK;
        let starts = blocks.clone().map(|block| block * BLOCK);
        let radii = self.radii[blocks.start() * BLOCK..].chunks_mut(BLOCK);
        for ((radii, greatest), start) in radii.zip(&mut self.greatest[blocks]).zip(starts) {
            if *greatest <= cut {
                continue;
            }
            let within = first.saturating_sub(start)..radii.len().min(last + 1 - start);
            let from = start + within.start;
            let flat = sweep.flat(Self::z(from), Self::z(start + within.end - 1));
            for (point, radius) in (from..).zip(&mut radii[within]) {
                if *radius <= cut {
                    continue;
                }
                let left = flat.unwrap_or_else(|| sweep.height(Self::z(point)));
                let off = *radius - left;
                if off > NOTHING {
                    *radius = left;
                    shaving.area += off * GRID;
                    shaving.thickest = if off > shaving.thickest { off } else { shaving.thickest };
                }
            }
            *greatest = radii.iter().fold(0.0, |most, radius| if *radius > most { *radius } else { most });
        }
        shaving
    }

    /// The most that a straight way can take off at any point, in mm of radius: it may be less.
    pub(crate) fn thickest(&self, nose: &Nose, from: Place, to: Place) -> f64 {
        let Some((first, last)) = self.reached(nose, from, to) else { return 0.0 };
        let greatest = self.greatest[first / BLOCK..=last / BLOCK].iter().copied().fold(0.0, f64::max);
        (greatest - from.x.min(to.x)).max(0.0)
    }

    /// The first and the last point that the nose can reach on a straight way.
    fn reached(&self, nose: &Nose, from: Place, to: Place) -> Option<(usize, usize)> {
        let lowest = from.x.min(to.x);
        if lowest >= self.stock {
            return None;
        }
        let (lead, trail) = nose.reach(self.stock - lowest);
        let nearest = -(from.z.max(to.z) + trail) / GRID;
        let furthest = -(from.z.min(to.z) - lead) / GRID;
        if !(furthest >= 0.0 && nearest < self.radii.len() as f64) {
            return None;
        }
        let first = nearest.ceil().max(0.0) as usize;
        // A way's end that lies on a point, as written, must not miss it for the noise of floating point.
        let last = ((furthest + 1e-6).floor() as usize).min(self.radii.len() - 1);
        (first <= last).then_some((first, last))
    }
}

/// The lowest that a nose comes on a straight way, not beyond the axis. The edge is convex, so that for each point of
/// the axis one part of the way is the lowest.
struct Sweep<'a> {
    nose: &'a Nose,
    from: Place,
    way: Place,
    touch: f64,
}

impl<'a> Sweep<'a> {
    fn new(nose: &'a Nose, from: Place, to: Place) -> Self {
        let way = Place { z: to.z - from.z, x: to.x - from.x };
        Self { nose, from, way, touch: nose.touch(way.x / way.z) }
    }

    fn height(&self, z: f64) -> f64 {
        let Place { z: dz, x: dx } = self.way;
        let along = z - self.from.z;
        // How much of the way has been gone when it is lowest here.
        let share = match (along - self.touch) * dz {
            _ if dz == 0.0 => f64::from(u8::from(dx < 0.0)),
            far if far <= 0.0 => 0.0,
            far if far >= dz * dz => 1.0,
            // Along the bar, the arc's lowest point has gone past here.
            _ if dx == 0.0 => return self.from.x.max(0.0),
            far => far / (dz * dz),
        };
        (self.from.x + share * dx + self.nose.height(along - share * dz)).max(0.0)
    }

    /// The height everywhere between two points, if it is the same: along the bar, where the arc's lowest point has
    /// gone past both.
    fn flat(&self, one: f64, other: f64) -> Option<f64> {
        let Place { z: dz, x: dx } = self.way;
        let passed = |z: f64| {
            let far = (z - self.from.z - self.touch) * dz;
            far > 0.0 && far < dz * dz
        };
        (dx == 0.0 && passed(one) && passed(other)).then_some(self.from.x.max(0.0))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn place(z: f64, x: f64) -> Place {
        Place { z, x }
    }

    fn nose() -> Nose {
        Nose::new(0.4, 90.0, 32.0).unwrap()
    }

    #[test]
    fn a_straight_cut_leaves_a_cylinder_a_fillet_and_a_square_shoulder() {
        let mut bar = Profile::bar(28.0, 60.0);
        let shaving = bar.cut(&nose(), place(0.0, 12.0), place(-20.0, 12.0));
        assert_eq!(bar.diameter(-10.0), Some(24.0));
        assert_eq!(bar.diameter(-19.6), Some(24.0));
        // The fillet: half way up the arc's width.
        let fillet = 2.0 * (12.0 + 0.4 - (0.16_f64 - 0.04).sqrt());
        assert!((bar.diameter(-19.8).unwrap() - fillet).abs() < 1e-9);
        assert_eq!(bar.diameter(-20.0), Some(2.0 * 12.4));
        assert_eq!(bar.diameter(-20.01), Some(28.0));
        assert_eq!((bar.diameter(0.01), bar.diameter(-60.01)), (None, None));
        assert!((shaving.area - 40.0).abs() < 0.1, "{shaving:?}");
        assert_eq!(shaving.thickest, 2.0);
    }

    #[test]
    fn a_taper_is_swept_by_the_side_of_the_arc() {
        let mut bar = Profile::bar(28.0, 60.0);
        let (from, to) = (place(-1.0, 10.0), place(-11.0, 12.0));
        bar.cut(&nose(), from, to);
        // At any point, the lowest of very many noses along the way.
        for z in [-2.0, -5.0, -10.0] {
            let low = (0..=100_000).map(|n| {
                let share = f64::from(n) / 100_000.0;
                from.x + share * 2.0 + nose().height(z - from.z + share * 10.0)
            });
            let low = low.fold(f64::INFINITY, f64::min);
            let found = bar.diameter(z).unwrap() / 2.0;
            assert!(found <= low && low - found < 1e-6, "{z}: {found} {low}");
        }
    }

    #[test]
    fn a_plunge_leaves_the_nose() {
        let mut bar = Profile::bar(28.0, 60.0);
        bar.cut(&nose(), place(-5.0, 15.0), place(-5.0, 13.0));
        assert!((bar.diameter(-4.6).unwrap() - 26.0).abs() < 1e-12);
        assert_eq!(bar.diameter(-5.01), Some(28.0));
    }

    #[test]
    fn the_tool_cuts_nothing_beside_the_bar_and_no_less_than_nothing() {
        let mut bar = Profile::bar(28.0, 60.0);
        let whole = bar.clone();
        for (from, to) in [
            (place(0.0, 14.0), place(-50.0, 14.0)),
            (place(1.0, -3.0), place(9.0, -3.0)),
            // Its edge slants back over 21 mm, up to the bar's surface.
            (place(-120.0, 1.0), place(-85.0, 1.0)),
        ] {
            assert_eq!(bar.cut(&nose(), from, to), Shaving::default());
            assert_eq!(bar, whole);
        }
        bar.cut(&nose(), place(-3.0, -9.0), place(-5.0, -9.0));
        assert_eq!(bar.diameter(-4.0), Some(0.0));
    }

    fn ways() -> impl Strategy<Value = Vec<(Place, Place)>> {
        let place = || (-25.0..5.0, -1.0..9.0).prop_map(|(z, x)| Place { z, x });
        proptest::collection::vec((place(), place()), 1..8)
    }

    fn noses() -> impl Strategy<Value = Nose> {
        (0.0..1.0, 20.0..=90.0, 10.0..80.0).prop_map(|(r, lead, trail)| Nose::new(r, lead, trail).unwrap())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn more_way_leaves_less_and_the_shavings_add_up(ways in ways(), nose in noses()) {
            let mut bar = Profile::bar(14.0, 20.0);
            for (from, to) in ways {
                let before = bar.clone();
                let shaving = bar.cut(&nose, from, to);
                let less = |(after, before): (&f64, &f64)| after <= before && *after >= 0.0;
                prop_assert!(bar.radii.iter().zip(&before.radii).all(less));
                let lost: f64 = before.radii.iter().zip(&bar.radii).map(|(before, after)| before - after).sum();
                prop_assert!((lost * GRID - shaving.area).abs() < 1e-6);
            }
        }

        #[test]
        fn no_way_along_the_bar_takes_off_more_than_the_thickness_there(
            ways in ways(),
            nose in noses(),
            (from, to, x) in (-25.0..5.0, -25.0..5.0, -1.0..9.0),
        ) {
            let mut bar = Profile::bar(14.0, 20.0);
            for (from, to) in ways {
                bar.cut(&nose, from, to);
            }
            let (from, to) = (Place { z: from, x }, Place { z: to, x });
            bar.cut(&nose, from, from);
            let thickest = bar.thickest(&nose, from, to);
            let shaving = bar.cut(&nose, from, to);
            prop_assert!(shaving.thickest <= thickest);
            prop_assert!(shaving.area <= thickest * ((to.z - from.z).abs() + 2.0 * GRID));
        }

        #[test]
        fn the_order_and_the_sense_of_cuts_do_not_matter(ways in ways(), nose in noses()) {
            let (mut forth, mut back) = (Profile::bar(14.0, 20.0), Profile::bar(14.0, 20.0));
            for (from, to) in &ways {
                forth.cut(&nose, *from, *to);
            }
            for (from, to) in ways.iter().rev() {
                back.cut(&nose, *to, *from);
            }
            // An upright edge's very end may fall on a point from one side only.
            let apart = forth.radii.iter().zip(&back.radii).filter(|(a, b)| (**a - **b).abs() > 1e-6).count();
            prop_assert!(apart <= ways.len(), "{apart}");
        }

        #[test]
        fn a_way_in_two_parts_is_the_same_way(ways in ways(), nose in noses(), share in 0.0..1.0) {
            let (mut whole, mut parts) = (Profile::bar(14.0, 20.0), Profile::bar(14.0, 20.0));
            for (from, to) in ways {
                let part = Place { z: from.z + share * (to.z - from.z), x: from.x + share * (to.x - from.x) };
                whole.cut(&nose, from, to);
                parts.cut(&nose, from, part);
                parts.cut(&nose, part, to);
            }
            prop_assert!(whole.radii.iter().zip(&parts.radii).all(|(a, b)| (a - b).abs() < 1e-6));
        }
    }
}
