//! What a program asks for: a way over time, and its increments.

use crate::element::Element;
use crate::set_points::SetPoints;

/// An element in its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// The element.
    pub element: Element,
    /// Its line, from 1.
    pub line: usize,
    /// When it begins, in s.
    pub from_s: f64,
    /// Where it begins, in mm.
    pub from_mm: f64,
}

/// A program without an error.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Program {
    /// Its elements, in order. At least one.
    pub motions: Vec<Motion>,
}

impl Program {
    /// How long it takes, in s.
    pub fn seconds(&self) -> f64 {
        self.motions.last().map_or(0.0, |last| last.from_s + last.element.seconds())
    }

    /// Where it ends, in mm from its beginning.
    pub fn end_mm(&self) -> f64 {
        self.motions.last().map_or(0.0, |last| last.from_mm + last.element.way_mm())
    }

    /// How many increments it makes: the ticks up to its end, and one more if it does not end on a tick.
    pub fn ticks(&self) -> usize {
        self.exact(1.0).ticks()
    }

    /// The set point at each tick after the beginning, in counts of which so many are a mm: rounded over the whole, not
    /// for each increment, so that nothing drifts and the sum is exact. A half is rounded up.
    pub fn set_points(&self, counts_per_mm: f64) -> impl Iterator<Item = i64> {
        self.exact(counts_per_mm)
    }

    fn exact(&self, counts_per_mm: f64) -> SetPoints {
        let elements: Vec<Element> = self.motions.iter().map(|motion| motion.element).collect();
        SetPoints::new(&elements, counts_per_mm)
    }

    /// The increments, in counts a tick: what is sent to the controller.
    pub fn increments(&self, counts_per_mm: f64) -> Vec<i8> {
        let mut before = 0;
        let increment = |set_point: i64| {
            let increment = set_point - before;
            before = set_point;
            increment.clamp(i64::from(i8::MIN), i64::from(i8::MAX)) as i8
        };
        self.set_points(counts_per_mm).map(increment).collect()
    }

    /// Points of the graph of way (mm) over time (s): the ends of each element, and enough between them for a parabola.
    pub fn graph(&self) -> Vec<(f64, f64)> {
        let points = |motion: &Motion| {
            let Motion { element, from_s, from_mm, .. } = *motion;
            let parts = if element.acceleration_mm_s2() == 0.0 { 1 } else { 32 };
            let point = move |part: i32| {
                let seconds = element.seconds() * f64::from(part) / f64::from(parts);
                (from_s + seconds, from_mm + element.way_at(seconds))
            };
            (0..=parts).map(point)
        };
        self.motions.iter().flat_map(points).collect()
    }
}
