//! Contours that cycles cut: lines and arcs in the plane Z X, their offsets, and roughing towards them.
//!
//! Both dialects use it. Each has its own way of reading a cycle and of moving between two cuts.

use crate::canon::{Feed, Kind, Motion, Place, Plane, Turn};
use crate::machine::{Machine, Sink};

/// A cycle makes so many cuts at most.
pub(crate) const PASSES_MAX: usize = 10_000;
pub(crate) const NEAR: f64 = 1e-9;
/// Two places of a contour that are no further apart are one.
const SAME: f64 = 1e-6;
/// What is shorter is not cut; a contour may turn back by as much. As in LinuxCNC.
const SHORT: f64 = 1e-3;
/// A wider gap between two offset segments is closed by an arc. As in LinuxCNC.
const GAP: f64 = 1e-2;

/// Z and X in the machine's coordinates; in a [`Frame`], the place along the part and the level.
pub(crate) type Point = [f64; 2];

/// Z and X of a place.
pub(crate) const fn point([x, _, z, _]: [f64; 4]) -> Point {
    [z, x]
}

fn distance(a: Point, b: Point) -> f64 {
    libm::hypot(a[0] - b[0], a[1] - b[1])
}

/// A straight line or an arc.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Segment {
    pub(crate) from: Point,
    pub(crate) to: Point,
    /// Centre, sense.
    pub(crate) arc: Option<(Point, Turn)>,
    /// None of a rapid.
    pub(crate) feed: Option<Feed>,
}

/// The segments of a contour that begins here.
pub(crate) fn segments(start: Point, motions: &[Motion]) -> Vec<Segment> {
    let mut from = start;
    let mut segments = Vec::new();
    for motion in motions {
        let (to, arc, feed) = match motion.kind {
            Kind::Rapid { to } => (to, None, None),
            Kind::Feed { to, feed } => (to, None, Some(feed)),
            Kind::Arc { to, centre, turn, feed, .. } => (to, Some((centre, turn)), Some(feed)),
            _ => continue,
        };
        let to = point(to.axes());
        segments.push(Segment { from, to, arc, feed });
        from = to;
    }
    segments
}

/// Coordinates in which a contour leads along the part in the positive sense, and in which levels grow outward.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    /// Which coordinate of a point leads along the part: 0 is Z.
    pub(crate) along: usize,
    /// The senses of both coordinates, first the one along the part.
    pub(crate) signs: Point,
}

impl Frame {
    fn into(self, point: Point) -> Point {
        [self.signs[0] * point[self.along], self.signs[1] * point[1 - self.along]]
    }

    /// Out of the frame.
    pub(crate) fn out(self, point: Point) -> Point {
        let mut out = [0.0; 2];
        (out[self.along], out[1 - self.along]) = (self.signs[0] * point[0], self.signs[1] * point[1]);
        out
    }

    fn map(self, segment: &Segment, point: impl Fn(Point) -> Point) -> Segment {
        let mirrored = (self.signs[0] * self.signs[1] < 0.0) == (self.along == 0);
        let turned = |turn| match (turn, mirrored) {
            (Turn::Clockwise, true) => Turn::Counterclockwise,
            (Turn::Counterclockwise, true) => Turn::Clockwise,
            (turn, false) => turn,
        };
        let arc = segment.arc.map(|(centre, turn)| (point(centre), turned(turn)));
        Segment { from: point(segment.from), to: point(segment.to), arc, feed: segment.feed }
    }

    /// A contour in the frame.
    pub(crate) fn contour(self, contour: &[Segment]) -> Vec<Segment> {
        contour.iter().map(|segment| self.map(segment, |point| self.into(point))).collect()
    }

    /// A segment out of the frame.
    pub(crate) fn segment(self, segment: &Segment) -> Segment {
        self.map(segment, |point| self.out(point))
    }
}

/// What follows is for segments in a [`Frame`].
impl Segment {
    pub(crate) const fn line(from: Point, to: Point) -> Self {
        Self { from, to, arc: None, feed: None }
    }

    pub(crate) fn moved(mut self, by: Point) -> Self {
        let add = |point: Point| [point[0] + by[0], point[1] + by[1]];
        (self.from, self.to) = (add(self.from), add(self.to));
        self.arc = self.arc.map(|(centre, turn)| (add(centre), turn));
        self
    }

    /// Whether it leads along the part without turning back.
    pub(crate) fn is_forward(&self) -> bool {
        let way = self.to[0] - self.from[0];
        let Some((centre, turn)) = self.arc else { return way >= -SHORT };
        let side = if turn == Turn::Clockwise { 1.0 } else { -1.0 };
        let in_half = |point: Point| (point[1] - centre[1]) * side >= -SHORT;
        in_half(self.from) && in_half(self.to) && way >= SHORT
    }

    /// Whether it leads outward all the way, or stays on its level.
    pub(crate) fn is_outward(&self) -> bool {
        let past = |place: f64, centre: f64| place - centre > -SHORT;
        let one_side = match self.arc {
            None => true,
            Some((centre, Turn::Clockwise)) => past(centre[0], self.to[0]),
            Some((centre, Turn::Counterclockwise)) => past(self.from[0], centre[0]),
        };
        one_side && self.to[1] - self.from[1] >= -NEAR
    }

    /// Where it meets a level, along the part and in the order of the segment.
    fn meets(&self, level: f64) -> Vec<f64> {
        let (from, to) = (self.from, self.to);
        let Some((centre, turn)) = self.arc else {
            return if from[1].min(to[1]) > level + SAME || from[1].max(to[1]) < level - SAME {
                Vec::new()
            } else if (from[1] - to[1]).abs() < SAME {
                vec![from[0], to[0]]
            } else {
                vec![from[0] + (level - from[1]) / (to[1] - from[1]) * (to[0] - from[0])]
            };
        };
        let (radius, height) = (distance(from, centre), level - centre[1]);
        let square = radius * radius - height * height;
        let other_half = if turn == Turn::Clockwise { height < -SAME } else { height > SAME };
        if square < -SAME || other_half {
            return Vec::new();
        }
        let half = libm::sqrt(square.max(0.0));
        let places = [centre[0] - half, centre[0] + half].into_iter();
        places.filter(|place| (from[0] - SAME..=to[0] + SAME).contains(place)).collect()
    }

    /// The part of it up to a place.
    const fn up_to(mut self, from: Point, to: Point) -> Self {
        (self.from, self.to) = (from, to);
        self
    }

    /// How it leads inward from a place, to a level or to its end; none if it does not.
    fn dive(&self, at: Point, level: f64) -> Option<Point> {
        let Some((centre, turn)) = self.arc else {
            if self.from[1] <= self.to[1] {
                return None;
            }
            let met = if level < self.to[1] { None } else { self.meets(level).first().copied() };
            return Some(met.map_or(self.to, |along| [along, level]));
        };
        if distance(at, self.to) < SHORT {
            return Some(at);
        }
        let met = self.meets(level);
        let met = match turn {
            Turn::Clockwise if at[0] < centre[0] => return None,
            Turn::Clockwise => met.last().copied().filter(|along| *along >= centre[0]),
            Turn::Counterclockwise if at[0] >= centre[0] => return None,
            Turn::Counterclockwise => met.first().copied().filter(|along| *along <= centre[0]),
        };
        Some(met.map_or(self.to, |along| [along, level]))
    }

    /// Where it leads outward to from a place; none if it leads inward there.
    fn climb(&self, at: Point) -> Option<Point> {
        match self.arc {
            None => (self.to[1] >= self.from[1]).then_some(self.to),
            Some((centre, Turn::Clockwise)) => (at[0] <= centre[0]).then(|| self.top(centre)),
            Some((centre, Turn::Counterclockwise)) => (at[0] >= centre[0]).then_some(self.to),
        }
    }

    /// The outermost place of a clockwise arc.
    fn top(&self, centre: Point) -> Point {
        if self.to[0] > centre[0] { [centre[0], centre[1] + distance(self.from, centre)] } else { self.to }
    }

    /// Where the way at this level meets a part of it that leads outward, and where that part ends.
    fn rise(&self, level: f64) -> Option<(Point, Point)> {
        let met = self.meets(level);
        let (first, last) = (*met.first()?, *met.last()?);
        match self.arc {
            None => (self.to[1] >= self.from[1]).then_some(([first, level], self.to)),
            Some((centre, Turn::Clockwise)) => (first <= centre[0]).then(|| ([first, level], self.top(centre))),
            Some((centre, Turn::Counterclockwise)) => (last >= centre[0]).then_some(([last, level], self.to)),
        }
    }

    fn offset(&self, by: f64) -> Option<Self> {
        let mut moved = *self;
        match self.arc {
            None => {
                let [du, dv] = [self.to[0] - self.from[0], self.to[1] - self.from[1]];
                let length = libm::hypot(du, dv);
                if length < SAME {
                    return None;
                }
                moved = moved.moved([-dv / length * by, du / length * by]);
            }
            Some((centre, turn)) => {
                let radius = distance(self.from, centre);
                let wanted = if turn == Turn::Clockwise { radius + by } else { radius - by };
                if wanted < SHORT {
                    return None;
                }
                let scaled =
                    |point: Point| [0, 1].map(|nth| centre[nth] + (point[nth] - centre[nth]) * wanted / radius);
                (moved.from, moved.to) = (scaled(self.from), scaled(self.to));
            }
        }
        Some(moved)
    }

    /// Whether an offset has turned it around.
    fn is_reversed(&self, before: &Self) -> bool {
        let way = |segment: &Self| [segment.to[0] - segment.from[0], segment.to[1] - segment.from[1]];
        let (a, b) = (way(self), way(before));
        a[0] * b[0] + a[1] * b[1] <= 0.0
    }
}

/// Where the lines or circles of two segments meet, nearest to a place.
fn crossing(a: &Segment, b: &Segment, near: Point) -> Option<Point> {
    let candidates: Vec<Point> = match (a.arc, b.arc) {
        (None, None) => {
            let way = |segment: &Segment| [segment.to[0] - segment.from[0], segment.to[1] - segment.from[1]];
            let (p, q) = (way(a), way(b));
            let cross = p[0] * q[1] - p[1] * q[0];
            let between = [b.from[0] - a.from[0], b.from[1] - a.from[1]];
            let share = (between[0] * q[1] - between[1] * q[0]) / cross;
            vec![[a.from[0] + share * p[0], a.from[1] + share * p[1]]]
        }
        (None, Some((centre, _))) => on_circle(a, centre, distance(b.from, centre)),
        (Some((centre, _)), None) => on_circle(b, centre, distance(a.from, centre)),
        (Some((one, _)), Some((other, _))) => {
            let (r, s, apart) = (distance(a.from, one), distance(b.from, other), distance(one, other));
            let along = (apart * apart + r * r - s * s) / (2.0 * apart);
            let aside = libm::sqrt((r * r - along * along).max(0.0));
            let unit = [(other[0] - one[0]) / apart, (other[1] - one[1]) / apart];
            let place =
                |aside: f64| [one[0] + unit[0] * along - unit[1] * aside, one[1] + unit[1] * along + unit[0] * aside];
            vec![place(aside), place(-aside)]
        }
    };
    let finite = candidates.into_iter().filter(|point| point.iter().all(|value| value.is_finite()));
    finite.min_by(|a, b| distance(*a, near).total_cmp(&distance(*b, near)))
}

fn on_circle(line: &Segment, centre: Point, radius: f64) -> Vec<Point> {
    let length = distance(line.from, line.to);
    let unit = [(line.to[0] - line.from[0]) / length, (line.to[1] - line.from[1]) / length];
    let to = [centre[0] - line.from[0], centre[1] - line.from[1]];
    let (along, aside) = (to[0] * unit[0] + to[1] * unit[1], to[0] * unit[1] - to[1] * unit[0]);
    let half = libm::sqrt((radius * radius - aside * aside).max(0.0));
    let place = |along: f64| [line.from[0] + unit[0] * along, line.from[1] + unit[1] * along];
    vec![place(along + half), place(along - half)]
}

/// A contour further out by a distance, all along: corners that point outward become arcs. Its first segment leads
/// there from the start, and still does. None if the contour has no room for the distance.
pub(crate) fn offset(contour: &[Segment], by: f64) -> Option<Vec<Segment>> {
    let (entry, rest) = contour.split_first()?;
    if by == 0.0 {
        return Some(contour.to_vec());
    }
    // Outward is where the start is.
    let way = |to: Point| [to[0] - entry.from[0], to[1] - entry.from[1]];
    let (first, last) = (way(entry.to), way(rest.last()?.from));
    let by = if first[0] * last[1] - first[1] * last[0] < 0.0 { -by } else { by };
    let mut moved = rest.iter().map(|segment| segment.offset(by)).collect::<Option<Vec<_>>>()?;
    // Of each segment, the arc behind it.
    let mut corners = vec![None; moved.len()];
    for nth in 1..moved.len() {
        let (before, behind) = (moved[nth - 1], moved[nth]);
        if behind.from[0] - before.to[0] > GAP {
            let turn = if by > 0.0 { Turn::Clockwise } else { Turn::Counterclockwise };
            let arc = Some((rest[nth].from, turn));
            corners[nth - 1] = Some(Segment { arc, ..Segment::line(before.to, behind.from) });
        } else if distance(before.to, behind.from) > SAME {
            let corner = crossing(&before, &behind, behind.from)?;
            (moved[nth - 1].to, moved[nth].from) = (corner, corner);
        }
    }
    if moved.iter().zip(rest).any(|(moved, before)| moved.is_reversed(before)) {
        return None;
    }
    let entry = entry.up_to(entry.from, moved.first()?.from);
    let behind = moved.into_iter().zip(corners).flat_map(|(segment, corner)| [Some(segment), corner]);
    Some([Some(entry)].into_iter().chain(behind).flatten().collect())
}

/// What is done about pockets: the places where a contour leads inward behind its first segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Pockets {
    Cut,
    Leave,
    /// Cuts nothing else.
    Only,
}

/// What roughing does next.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Step {
    /// Goes inward along a segment.
    Dive {
        way: Segment,
        /// Along the contour's first segment, where nothing is cut.
        entry: bool,
    },
    /// Cuts along a level, and comes back.
    Pass { from: Point, to: Point, entry: bool },
    /// Cuts outward along the contour.
    Follow(Segment),
    /// Cuts along a level up to a segment of the contour.
    Reach(Point),
}

/// Cuts level by level towards a contour whose first segment leads inward to it from the start.
pub(crate) fn rough(
    contour: &[Segment],
    depth: f64,
    pockets: Pockets,
    step: &mut dyn FnMut(Step),
) -> Result<(), String> {
    let mut contour = contour.to_vec();
    let (Some(first), Some(last)) = (contour.first(), contour.last().copied()) else { return Ok(()) };
    let (start, outermost) = (first.from, first.from[1]);
    let lowest = contour.iter().fold(outermost, |lowest, segment| lowest.min(segment.to[1]));
    let many = || Err(format!("the cycle has more than {PASSES_MAX} passes"));
    if (outermost - lowest) / depth > PASSES_MAX as f64 {
        return many();
    }
    if last.to[1] < outermost {
        contour.push(Segment::line(last.to, [last.to[0], outermost]));
    }
    let (mut nth, mut at, mut level) = (0, start, outermost);
    // The levels of the first pocket begin at its rim then.
    let mut only = pockets == Pockets::Only;
    if only {
        while let Some(to) = contour.get(nth).and_then(|segment| segment.dive(at, f64::NEG_INFINITY)) {
            step(Step::Dive { way: contour[nth].up_to(at, to), entry: nth == 0 });
            (at, nth) = (to, nth + 1);
        }
    }
    for _ in 0..4 * PASSES_MAX {
        let Some(segment) = contour.get(nth) else { return Ok(()) };
        while level > at[1] {
            level -= depth;
        }
        let Some(to) = segment.dive(at, level) else {
            // The floor.
            if pockets == Pockets::Leave {
                for segment in &contour[nth..] {
                    if let Some((from, to)) = segment.rise(at[1]) {
                        step(Step::Reach(from));
                        if segment.arc.is_none() || distance(from, to) > SHORT {
                            step(Step::Follow(segment.up_to(from, to)));
                        }
                        at = to;
                    }
                }
                return Ok(());
            }
            while let Some(segment) = contour.get(nth) {
                let Some(to) = segment.climb(at) else { break };
                if segment.arc.is_none() || distance(at, to) > SHORT {
                    step(Step::Follow(segment.up_to(at, to)));
                }
                at = to;
                // Behind the top of an arc, a pocket may begin.
                if matches!(segment.arc, Some((_, Turn::Clockwise))) {
                    break;
                }
                nth += 1;
            }
            level = if core::mem::take(&mut only) { at[1] } else { outermost };
            continue;
        };
        if segment.arc.is_none() || distance(at, to) > SHORT {
            step(Step::Dive { way: segment.up_to(at, to), entry: nth == 0 });
            at = to;
        }
        if at[1] > level || (at[1] - level).abs() > SAME {
            nth += 1;
            continue;
        }
        let mut found = false;
        for (other, segment) in contour.iter().enumerate().skip(nth) {
            let met = segment.meets(at[1]);
            let Some(along) = (if other == nth { met.last() } else { met.first() }) else { continue };
            let away = (along - at[0]).abs();
            if away < SAME && other == nth {
                continue;
            }
            found = true;
            if away < SAME {
                nth += 1;
            } else {
                step(Step::Pass { from: at, to: [*along, at[1]], entry: nth == 0 });
                level -= depth;
            }
            break;
        }
        if !found {
            nth += 1;
        }
    }
    many()
}

/// A tool that cuts, in the machine's coordinates.
pub(crate) struct Cut<'m, 's> {
    pub(crate) machine: &'m mut Machine,
    pub(crate) sink: Sink<'s>,
    pub(crate) feed: Feed,
    /// Where it stands on the axes that the cycle does not move.
    pub(crate) start: [f64; 4],
}

impl Cut<'_, '_> {
    fn emit(&mut self, [z, x]: Point, kind: impl FnOnce(Place) -> Kind) {
        let to = [x, self.start[1], z, self.start[3]];
        let offsets: [f64; 4] = core::array::from_fn(|axis| self.machine.offset(axis));
        self.machine.at = core::array::from_fn(|axis| to[axis] - offsets[axis]);
        self.machine.emit(kind(Place::of(to)), self.sink);
    }

    pub(crate) fn rapid(&mut self, to: Point) {
        self.emit(to, |to| Kind::Rapid { to });
    }

    pub(crate) fn to(&mut self, to: Point, slow: bool) {
        let feed = self.feed;
        self.emit(to, |to| if slow { Kind::Feed { to, feed } } else { Kind::Rapid { to } });
    }

    /// Cuts along a segment; goes straight without a feed.
    pub(crate) fn follow(&mut self, segment: &Segment, feed: Option<Feed>) {
        self.emit(segment.to, |to| match (feed, segment.arc) {
            (None, _) => Kind::Rapid { to },
            (Some(feed), None) => Kind::Feed { to, feed },
            (Some(feed), Some((centre, turn))) => Kind::Arc { to, plane: Plane::Zx, centre, turn, turns: 1, feed },
        });
    }
}
