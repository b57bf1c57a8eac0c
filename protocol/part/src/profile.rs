//! What is left of the bar: the radius of the surface that is turned, point by point along the axis.

use std::borrow::Cow;

use crate::path::ArcSweep;
use crate::{Arc, Move, Nose, Path, Place};

/// The points are so far apart along the axis, in mm. At each the radius is that which straight moves leave, with no
/// error but that of floating point; where a shoulder stands is known within this.
pub const GRID: f64 = 0.01;

/// So many points share a bound.
const BLOCK: usize = 32;

/// Less than this is not cut, in mm: the noise of floating point.
const NOTHING: f64 = 1e-9;

/// The surface that a nose cuts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Side {
    /// The bar's: the tool is further from the axis.
    #[default]
    Outside,
    /// The bore's: the tool is nearer to the axis.
    Inside,
}

impl Side {
    /// Its name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Outside => "outside",
            Self::Inside => "inside",
        }
    }
}

/// What a move took off.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shaving {
    /// The area, in the plane of the axis and on one side of it, in mm².
    pub area: f64,
    /// The most at any one point, in mm of radius.
    pub thickest: f64,
    /// How far beyond the other surface it went, in mm, if it took off all that was left somewhere; else 0.
    pub through: f64,
}

/// The profile of a bar, from its face to the chuck: the surface that is turned, and the other one, which is not.
///
/// A bore is turned as the outside of its mirror image is: all is reckoned from the far side of the wall.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    side: Side,
    /// The bar's radius, and the bore's: 0 without one.
    bar: f64,
    bore: f64,
    /// From the face on, a [`GRID`] apart: the radius of the outside; of a bore, how far below the bar's surface it is.
    heights: Vec<f64>,
    /// The greatest of each [`BLOCK`] of them: what was turned thinner before costs no time.
    greatest: Vec<f64>,
}

impl Profile {
    /// A bar of a diameter that stands out of the chuck so far, in mm, to be turned outside.
    pub fn bar(diameter: f64, out: f64) -> Self {
        Self::tube(Side::Outside, diameter, 0.0, out)
    }

    /// A bar with a bore all through it, in mm, to be turned on one side; without a bore it is 0.
    pub fn tube(side: Side, diameter: f64, bore: f64, out: f64) -> Self {
        let points = (out / GRID).round().max(0.0) as usize + 1;
        let (bar, bore) = (diameter / 2.0, bore / 2.0);
        let mut tube = Self { side, bar, bore, heights: Vec::new(), greatest: Vec::new() };
        let stock = tube.stock_height();
        (tube.heights, tube.greatest) = (vec![stock; points], vec![stock; points.div_ceil(BLOCK)]);
        tube
    }

    /// The surface that is turned.
    pub const fn side(&self) -> Side {
        self.side
    }

    /// The diameter of the surface that is turned, uncut, in mm.
    pub const fn stock(&self) -> f64 {
        match self.side {
            Side::Outside => 2.0 * self.bar,
            Side::Inside => 2.0 * self.bore,
        }
    }

    /// The radius of the surface that is not turned, in mm: 0 if it is a bore that is not there.
    pub const fn other(&self) -> f64 {
        match self.side {
            Side::Outside => self.bore,
            Side::Inside => self.bar,
        }
    }

    /// How far the bar stands out of the chuck, in mm.
    pub fn out(&self) -> f64 {
        (self.heights.len() - 1) as f64 * GRID
    }

    /// The radii in mm from the face towards the chuck, a [`GRID`] apart.
    pub fn radii(&self) -> Cow<'_, [f64]> {
        match self.side {
            Side::Outside => Cow::Borrowed(&self.heights),
            Side::Inside => self.heights.iter().map(|height| self.bar - height).collect(),
        }
    }

    /// How much is left at each of these points, in mm, from a place that no cut changes.
    pub(crate) fn heights(&self) -> &[f64] {
        &self.heights
    }

    /// The height of the uncut surface, and that at which nothing is left.
    pub(crate) const fn stock_height(&self) -> f64 {
        match self.side {
            Side::Outside => self.bar,
            Side::Inside => self.bar - self.bore,
        }
    }

    pub(crate) const fn floor(&self) -> f64 {
        match self.side {
            Side::Outside => self.bore,
            Side::Inside => 0.0,
        }
    }

    /// The radius that is a height, and the height that is a radius.
    pub(crate) const fn mirrored(&self, x: f64) -> f64 {
        match self.side {
            Side::Outside => x,
            Side::Inside => self.bar - x,
        }
    }

    const fn own(&self, Place { z, x }: Place) -> Place {
        Place { z, x: self.mirrored(x) }
    }

    /// Where a point of [`Profile::radii`] lies, in mm: 0 or below.
    pub fn z(point: usize) -> f64 {
        0.0 - point as f64 * GRID
    }

    /// The diameter at `z`, in mm; none outside the bar that stands out.
    pub fn diameter(&self, z: f64) -> Option<f64> {
        let point = (-z / GRID).round();
        let height = if point >= 0.0 { self.heights.get(point as usize) } else { None };
        height.map(|height| 2.0 * self.mirrored(*height))
    }

    /// Whether a straight way lies where there never was anything to cut.
    pub fn is_clear(&self, from: Place, to: Place) -> bool {
        self.own(from).x.min(self.own(to).x) >= self.stock_height()
    }

    /// Takes off what the nose sweeps on a whole way.
    pub fn sweep(&mut self, nose: &Nose, path: &Path) {
        let mut from = path.start;
        for step in &path.moves {
            match step {
                Move::Line(to) => self.cut(nose, from, *to),
                Move::Arc(arc) => self.cut_arc(nose, from, arc),
            };
            from = step.end();
        }
    }

    /// Takes off what the nose sweeps on a straight way.
    pub fn cut(&mut self, nose: &Nose, from: Place, to: Place) -> Shaving {
        let (from, to) = (self.own(from), self.own(to));
        let sweep = Sweep::new(nose, from, to);
        let extent = Extent { z: (from.z.min(to.z), from.z.max(to.z)), lowest: from.x.min(to.x) };
        self.shave(nose, extent, |z| sweep.height(z), |one, other| sweep.flat(one, other))
    }

    /// Takes off what the nose sweeps on an arc.
    pub fn cut_arc(&mut self, nose: &Nose, from: Place, arc: &Arc) -> Shaving {
        let (start, centre) = (self.own(from), self.own(arc.centre));
        let swept = arc.swept(from) * if self.side == Side::Inside { -1.0 } else { 1.0 };
        let sweep = ArcSweep::new(nose, start, centre, swept);
        let extent = Extent { z: sweep.along(), lowest: sweep.lowest() };
        let shaving = self.shave(nose, extent, |z| sweep.height(z), |_, _| None);
        // Its radius may differ a little from end to end.
        let rest = self.cut(nose, self.own(sweep.end()), arc.to);
        Shaving {
            area: shaving.area + rest.area,
            thickest: shaving.thickest.max(rest.thickest),
            through: shaving.through.max(rest.through),
        }
    }

    fn shave(
        &mut self,
        nose: &Nose,
        extent: Extent,
        height: impl Fn(f64) -> f64,
        flat: impl Fn(f64, f64) -> Option<f64>,
    ) -> Shaving {
        let mut shaving = Shaving::default();
        let Some((first, last)) = self.reached(nose, extent) else { return shaving };
        let (floor, has_wall) = (self.floor(), self.other() > 0.0);
        // What has been turned as thin lies within the noise of floating point of it.
        let cut = extent.lowest.max(floor) + NOTHING;
        let blocks = first / BLOCK..=last / BLOCK;
        let starts = blocks.clone().map(|block| block * BLOCK);
        let heights = self.heights[blocks.start() * BLOCK..].chunks_mut(BLOCK);
        for ((heights, greatest), start) in heights.zip(&mut self.greatest[blocks]).zip(starts) {
            if *greatest <= cut {
                continue;
            }
            let within = first.saturating_sub(start)..heights.len().min(last + 1 - start);
            let from = start + within.start;
            let flat = flat(Self::z(from), Self::z(start + within.end - 1));
            for (point, now) in (from..).zip(&mut heights[within]) {
                if *now <= cut {
                    continue;
                }
                let swept = flat.unwrap_or_else(|| height(Self::z(point)));
                let left = if swept > floor { swept } else { floor };
                let off = *now - left;
                if off > NOTHING {
                    *now = left;
                    if left == floor && has_wall {
                        shaving.through = floor - extent.lowest;
                    }
                    shaving.area += off * GRID;
                    shaving.thickest = if off > shaving.thickest { off } else { shaving.thickest };
                }
            }
            *greatest = heights.iter().fold(0.0, |most, height| if *height > most { *height } else { most });
        }
        shaving
    }

    /// The most that a straight way can take off at any point, in mm of radius: it may be less.
    pub(crate) fn thickest(&self, nose: &Nose, from: Place, to: Place) -> f64 {
        let (from, to) = (self.own(from), self.own(to));
        let extent = Extent { z: (from.z.min(to.z), from.z.max(to.z)), lowest: from.x.min(to.x) };
        let Some((first, last)) = self.reached(nose, extent) else { return 0.0 };
        let greatest = self.greatest[first / BLOCK..=last / BLOCK].iter().copied().fold(0.0, f64::max);
        (greatest - extent.lowest).max(0.0)
    }

    /// The first and the last point that the nose can reach on a way.
    fn reached(&self, nose: &Nose, Extent { z: (least, most), lowest }: Extent) -> Option<(usize, usize)> {
        let stock = self.stock_height();
        if lowest >= stock {
            return None;
        }
        let (lead, trail) = nose.reach(stock - lowest);
        let nearest = -(most + trail) / GRID;
        let furthest = -(least - lead) / GRID;
        if !(furthest >= 0.0 && nearest < self.heights.len() as f64) {
            return None;
        }
        let first = nearest.ceil().max(0.0) as usize;
        // A way's end that lies on a point, as written, must not miss it for the noise of floating point.
        let last = ((furthest + 1e-6).floor() as usize).min(self.heights.len() - 1);
        (first <= last).then_some((first, last))
    }
}

/// The ends of a way along the axis, and how low it comes.
#[derive(Clone, Copy)]
struct Extent {
    z: (f64, f64),
    lowest: f64,
}

/// The lowest that a nose comes on a straight way. The edge is convex, so that for each point of
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
            _ if dx == 0.0 => return self.from.x,
            far => far / (dz * dz),
        };
        self.from.x + share * dx + self.nose.height(along - share * dz)
    }

    /// The height everywhere between two points, if it is the same: along the bar, where the arc's lowest point has
    /// gone past both.
    fn flat(&self, one: f64, other: f64) -> Option<f64> {
        let Place { z: dz, x: dx } = self.way;
        let passed = |z: f64| {
            let far = (z - self.from.z - self.touch) * dz;
            far > 0.0 && far < dz * dz
        };
        (dx == 0.0 && passed(one) && passed(other)).then_some(self.from.x)
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
                prop_assert!(bar.heights.iter().zip(&before.heights).all(less));
                let lost: f64 = before.heights.iter().zip(&bar.heights).map(|(before, after)| before - after).sum();
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
            let apart = forth.heights.iter().zip(&back.heights).filter(|(a, b)| (**a - **b).abs() > 1e-6).count();
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
            prop_assert!(whole.heights.iter().zip(&parts.heights).all(|(a, b)| (a - b).abs() < 1e-6));
        }
    }
}
